"""Orders the paths of a flat part for an arm by joint time, with postures and rolls."""

from __future__ import annotations

from collections.abc import Container, Sequence
from itertools import pairwise

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.collision.cell import make_cell_scene
from camgen.geometry.ragged import count_rows
from camgen.model.job import Job
from camgen.model.part import IntArray, Note
from camgen.model.path import ToolPath, Tour
from camgen.model.pose import FloatArray, frozen
from camgen.model.sequences import take_rows
from camgen.model.text import counted, short
from camgen.motion.cell import find_home, make_free_space, make_setup
from camgen.motion.limits import LinkSpeeds, choose_link_speeds, compute_joint_speed, make_limits
from camgen.motion.pose_paths import PosePath
from camgen.motion.reach import reach_along
from camgen.motion.rolls import find_freedom, list_rolls
from camgen.motion.setup import EdgeMotion, OrientationFreedom, Setup, UnreachableEdge
from camgen.order.arm.detours import ClearTest
from camgen.order.arm.items import (
    Item,
    States,
    choose_each,
    compute_state_joints,
    find_states,
    join_states,
    reverse_states,
    sample_path,
)
from camgen.order.arm.lattice import GRAZE_MM
from camgen.order.arm.layers import FORBIDDEN, CostModel
from camgen.order.arm.links import LinkedTour, link_paths
from camgen.order.arm.margin import insert_items, make_clear_test, make_margin_test
from camgen.order.arm.points import are_points, find_point_tour
from camgen.order.arm.search import (
    OnProgress,
    SearchOptions,
    Solution,
    TourProblem,
    find_tour,
    improve_tour,
    prove_tour,
)
from camgen.order.solver import matrix
from camgen.order.tours import ArmTour
from camgen.plan import Watch
from camgen.plan.pieces import begin_at, lengths_along, split_at
from camgen.robots.workcell import Workcell

#: Rolls that are tried if the tool may have any; finer steps are searched around them.
_ROLLS = 24
#: The same for an arm whose joint values are iterated.
_ITERATED_ROLLS = 12
#: Maximum number of searches, each with what the searches before have learnt.
_MAX_SEARCHES = 4
#: Times that a proved tour is improved again.
_IMPROVEMENTS = 1
#: Fraction of all paths that may fail to keep the margin. If there are more, the whole tour is
#: searched without it.
_MAX_TIGHT_FRACTION = 0.25
#: Contacts at which the clearance of each pair is measured.
_CONTACTS = 40
#: rad: rolls that differ by no more are the same.
_SAME_ROLL = 1e-6


class RollProfile(Struct, frozen=True, eq=False):
    """The roll of the tool along a path if it changes.

    positions: (K,) positions along the path, mm.
    roll: (K,) roll at these positions, rad.
    vertices: (V,) positions at which the program needs a waypoint, mm.
    """

    positions: FloatArray
    roll: FloatArray
    vertices: FloatArray


class TourRequest(Struct, frozen=True, eq=False):
    """A tour that an arm is to run in less time.

    tour: paths in the order from which the search starts.
    rules: precedence of the paths, by their index in `tour`.
    fixed: whether order, directions and starts stay.
    """

    tour: Tour
    rules: matrix.Rules
    fixed: bool = False


class _Rolls(Struct, frozen=True):
    """The rolls that are tried.

    angles: rolls of which one is to reach a whole path, rad.
    free: freedom of the roll along a path that none of `angles` reaches; None for a fixed roll.
    """

    angles: Sequence[float]
    free: OrientationFreedom | None = None


class _Preparation(Struct, frozen=True, eq=False):
    """The problem before the search.

    problem: the items with their states.
    profiles: roll that changes along a path, by path, if no single roll reaches all of it.
    lost: reason why a path has no state, by path.
    keeps_margin: test of joint values for the margin, None if there is no margin.
    """

    problem: TourProblem
    profiles: dict[int, RollProfile]
    lost: dict[int, str]
    keeps_margin: ClearTest | None


def order_by_time(request: TourRequest, job: Job, cell: Workcell, watch: Watch) -> Tour:
    """The tour that takes the joints least time, where the tool keeps its roll.

    The TCP goes straight from path to path. The tour is unchanged if no posture reaches all of its
    paths.
    """
    tour = request.tour
    problem = _prepare(request, job, cell, _Rolls((0.0,)), lines=True).problem
    if not all(len(states) for states in problem.states):
        return tour
    on_progress = _report_to(watch)
    solution = find_tour(problem, range(len(tour.paths)), False, on_progress)
    solution = improve_tour(problem, solution, False, on_progress)
    if solution.seconds >= FORBIDDEN:
        return tour
    items = problem.cost_model.items
    paths = [_turn_path(tour.paths[k], items[k], solution.states, k)[0] for k in solution.order]
    if all(path is before for path, before in zip(paths, tour.paths, strict=True)):
        return tour
    return replace(tour, paths=tuple(paths), method="joint time", bound=None)


def _report_to(watch: Watch) -> OnProgress:
    return lambda message: watch(f"ordering, {message}")


def order_with_rolls(
    request: TourRequest, job: Job, cell: Workcell, watch: Watch, prove: bool = True
) -> ArmTour:
    """The tour with the rolls of the tool and the postures chosen together with the order.

    prove: whether the paths and links that are chosen are tested for collisions.
    """
    assert cell.arm is not None
    tour = request.tour
    freedom = replace(find_freedom(job), tilt=0.0)
    rolls = list_rolls(freedom, _ROLLS if cell.arm.arm is not None else _ITERATED_ROLLS)
    prepared = _prepare(request, job, cell, _Rolls(rolls.angles, freedom), lines=False)
    problem, lost = prepared.problem, prepared.lost
    kept = [k for k in range(len(tour.paths)) if k not in lost]
    on_progress = _report_to(watch)
    linked = LinkedTour(Solution([], problem.states[0], 0.0))
    if kept and prove:
        problem, linked = _search_with_margin(prepared, kept, request.fixed, on_progress)
    elif kept:
        linked = _search(problem, kept, prove, on_progress)
    for k in sorted(problem.lost):
        lost[k] = "it collides in every posture and with every roll of the tool that is tried"
    prepared = replace(prepared, problem=problem, lost=lost | linked.lost)
    what = "rolls of the tool" if freedom.roll else "links between the paths"
    speeds = choose_link_speeds(job.process, cell.pace)
    return _make_tour(tour, prepared, linked, f"{what} chosen by joint time", speeds)


def _search_with_margin(
    prepared: _Preparation, kept: Sequence[int], fixed: bool, on_progress: OnProgress
) -> tuple[TourProblem, LinkedTour]:
    """The tour over the paths `kept` with the margin, and the problem that it solves.

    Paths that cannot keep the margin, or have no link that does, are inserted into the tour of the
    others.
    """
    problem = prepared.problem
    if prepared.keeps_margin is None:
        return problem, _search(problem, kept, True, on_progress)
    all_states = list(problem.states)
    with_margin = _restart(problem, all_states, replace(problem.setup, clear=prepared.keeps_margin))
    # Points are searched as paths here. The margin blocks most of their links, and the tables of
    # 245 holes would take minutes.
    linked = _search_paths(with_margin, kept, True, on_progress)
    solution = linked.solution
    tight = [k for k in kept if k not in solution.order]
    if not tight:
        return with_margin, linked
    if len(tight) > _MAX_TIGHT_FRACTION * len(kept):
        return problem, _search(problem, kept, True, on_progress)
    states = solution.states.split()
    for k in tight:
        states[k] = all_states[k]
    rest = _restart(problem, states, problem.setup)
    rest = replace(rest, free=with_margin.free, detours=with_margin.detours)
    rest = replace(rest, options=replace(problem.options, any_roll=False))
    order = insert_items(rest, solution, tight, fixed)
    solution = prove_tour(rest, find_tour(rest, order, True, on_progress), on_progress)
    return rest, link_paths(rest, solution)


def _restart(problem: TourProblem, states: Sequence[States], setup: Setup) -> TourProblem:
    """The problem with other states and another collision test, before anything is tested."""
    return TourProblem(
        setup,
        problem.free_space,
        problem.cost_model,
        list(states),
        problem.rules,
        problem.options,
    )


def _search(
    problem: TourProblem, kept: Sequence[int], prove: bool, on_progress: OnProgress
) -> LinkedTour:
    """The tour over the paths `kept` with its links, searched as points if they are points."""
    best = None
    if prove and are_points(problem, kept):
        solution = find_point_tour(problem, kept, on_progress)
        best = None if solution is None else link_paths(problem, solution)
    if best is not None and not best.lost:
        return best
    return _search_paths(problem, kept, prove, on_progress, best)


def _search_paths(
    problem: TourProblem,
    kept: Sequence[int],
    prove: bool,
    on_progress: OnProgress,
    best: LinkedTour | None = None,
) -> LinkedTour:
    """The tour over the paths `kept` with its links, for paths of any kind.

    While the tour leaves out a path, the search starts again with what it has learnt.

    best: the best tour so far, None before the first.
    """
    for _ in range(_MAX_SEARCHES if prove else 1):
        order = [k for k in kept if k not in problem.lost]
        linked = LinkedTour(find_tour(problem, order, prove, on_progress))
        if linked.solution.order:
            linked = LinkedTour(improve_tour(problem, linked.solution, prove, on_progress))
        if linked.solution.order and prove:
            linked = link_paths(problem, _prove_again(problem, linked.solution, on_progress))
        if best is None or len(linked.solution.order) > len(best.solution.order):
            best = linked
        if not linked.lost:
            break
    assert best is not None
    return best


def _prove_again(problem: TourProblem, solution: Solution, on_progress: OnProgress) -> Solution:
    """Prove a tour, improve it with what the proof has learnt, and prove it again."""
    best = prove_tour(problem, solution, on_progress)
    for _ in range(_IMPROVEMENTS):
        other = prove_tour(problem, improve_tour(problem, best, True, on_progress), on_progress)
        if (len(other.order), -other.seconds) <= (len(best.order), -best.seconds):
            break
        best = other
    return best


def _prepare(
    request: TourRequest, job: Job, cell: Workcell, rolls: _Rolls, lines: bool
) -> _Preparation:
    """The problem of a request. lines: whether the TCP goes straight from path to path."""
    arm = cell.arm
    assert arm is not None
    # The search tests for collisions without the margin, which has a test of its own.
    with_margin = make_cell_scene(job, cell, None)
    scene = replace(with_margin, margin=0.0)
    setup = replace(make_setup(arm, cell, scene), clear=make_clear_test(scene.scene))
    seams = job.tour.seam == "any" and not request.fixed and arm.arm is not None
    paths, clearance = request.tour.paths, job.process.clearance
    items = [sample_path(path, clearance, seams and not path.pinned) for path in paths]
    if request.fixed:
        items = [replace(item, reversible=False) for item in items]
    angles = np.array(rolls.angles)
    states = find_states(setup, items, angles, _list_neighbours(angles))
    profiles: dict[int, RollProfile] = {}
    lost: dict[int, str] = {}
    if rolls.free is not None:
        profiles, lost = _find_other_states(setup, paths, items, states, rolls, job)
    limits = make_limits(arm, cell.pace, job.process.travel_speed)
    cost_model = CostModel(tuple(items), limits, find_home(arm, cell, scene.scene), lines)
    options = SearchOptions(
        may_reorder=not request.fixed and job.tour.method == "best",
        any_roll=job.tool.symmetric and arm.arm is not None,
        least_height=job.process.least_height,
    )
    free_space = make_free_space(replace(scene, margin=GRAZE_MM), setup)
    problem = TourProblem(setup, free_space, cost_model, states, request.rules, options)
    keeps_margin = None
    if rolls.free is not None and with_margin.margin != 0:
        keeps_margin = make_margin_test(with_margin, cost_model.home, _find_contacts(problem, lost))
    return _Preparation(problem, profiles, lost, keeps_margin)


def _find_other_states(
    setup: Setup,
    paths: Sequence[ToolPath],
    items: list[Item],
    states: list[States],
    rolls: _Rolls,
    job: Job,
) -> tuple[dict[int, RollProfile], dict[int, str]]:
    """Find states for the paths that no single roll reaches, and put them into `items`, `states`.

    First the roll may change along the path. Then the path may come near a singularity, where the
    joint values do not jump. Returns by path the rolls that change, and why it has no state.
    """
    assert rolls.free is not None
    profiles: dict[int, RollProfile] = {}
    lost: dict[int, str] = {}
    angles = np.array(rolls.angles)
    for k in np.flatnonzero(count_rows(states) == 0).tolist():
        with_profile = _change_roll_along(setup, paths[k], items[k], job, rolls.free)
        if not isinstance(with_profile, UnreachableEdge):
            profiles[k], states[k] = with_profile
            continue
        item = replace(items[k], min_distance=0.0)
        near_singularity = find_states(setup, [item], angles, _list_neighbours(angles))[0]
        if len(near_singularity):
            items[k], states[k] = item, near_singularity
        else:
            # A lost path has a state for the tables, and is in no order.
            lost[k] = with_profile.text
            states[k] = States.fixed(setup.robot.home)
    return profiles, lost


def _find_contacts(problem: TourProblem, lost: Container[int]) -> FloatArray:
    """(K, J) joint values in contact at the start of some of the paths."""
    has_states = np.flatnonzero(count_rows(problem.states)).tolist()
    paths = [k for k in has_states if k not in lost and problem.states[k].branch[0] >= 0]
    paths = paths[:: max(len(paths) // _CONTACTS, 1)]
    if not paths:
        return np.zeros((0, len(problem.cost_model.home)))
    first = choose_each(take_rows(problem.states, paths), np.zeros(len(paths), dtype=np.int64))
    items = take_rows(problem.cost_model.items, paths)
    state_joints = compute_state_joints(
        problem.setup, items, first.roll, first.branch, first.gate[:, 0], first.enter
    )
    joints = state_joints.joints[state_joints.first[:-1] + 1]
    return joints[state_joints.is_valid & np.isfinite(joints).all(axis=1)]


def _list_neighbours(rolls: FloatArray) -> IntArray:
    """(3, C) index of each roll and of its neighbours, from which its joint values are followed."""
    index = np.arange(len(rolls))
    return np.stack([index, index - 1, np.where(index + 1 < len(index), index + 1, -1)])


def _change_roll_along(
    setup: Setup, path: ToolPath, item: Item, job: Job, free: OrientationFreedom
) -> tuple[RollProfile, States] | UnreachableEdge:
    """Find the one state of a path along which the roll changes, or why it has no state."""
    start, end = item.position[[0]], item.position[[item.gates[item.last_gate]]]
    depth = np.array([0.0, 0.0, max(path.depths)])
    no_via = np.full((1, 3), np.nan)
    pose_path = PosePath(
        frozen(np.concatenate([start, path.position - depth, end])),
        frozen(np.concatenate([no_via, no_via, path.via[1:] - depth, no_via])),
        frozen(np.broadcast_to(item.rotation[0], (len(path.position) + 2, 3, 3))),
    )
    motion = reach_along(setup, path.id, pose_path, free)
    if isinstance(motion, UnreachableEdge):
        return motion
    if not _allows_passes(path, motion, job.operation.entry):
        reason = (
            "no single roll of the tool reaches all of it, "
            "and its next pass cannot start with the roll at which a pass ends"
        )
        return UnreachableEdge(path.id, "jump", reason)
    approach = float(np.linalg.norm(start[0] - pose_path.position[1]))
    lengths = np.append(0.0, np.cumsum(motion.sampled_path.length)) - approach
    whole = float(lengths_along(path)[-1])
    vertices = np.unique(np.clip(lengths[motion.at], 0.0, whole))
    profile = RollProfile(np.clip(lengths, 0.0, whole), np.unwrap(motion.roll), vertices)
    gate = np.array([[0, item.last_gate]])
    state = States(motion.joints[[0]], motion.joints[[-1]], gate, np.zeros(1), np.array([-1]))
    if item.reversible:
        state = join_states([state, reverse_states(state)])
    return profile, state


def _allows_passes(path: ToolPath, motion: EdgeMotion, entry: str) -> bool:
    """Whether every pass can start with the roll at which the pass before it ends.

    Passes go back and forth, or once around a closed path.
    """
    if max(path.depths) > 0 and entry != "plunge":
        return False
    changes = abs(float(np.unwrap(motion.roll)[-1] - motion.roll[0])) > _SAME_ROLL
    return len(path.depths) == 1 or not (path.closed and changes)


def _turn_path(
    path: ToolPath, item: Item, current: States, k: int, profile: RollProfile | None = None
) -> tuple[ToolPath, FloatArray]:
    """The path as its state runs it, and its rolls (N,), rad."""
    gate = int(current.gate[k, 0])
    if profile is not None:
        divided = split_at(path, profile.vertices)
        roll = np.interp(lengths_along(divided), profile.positions, profile.roll)
        if gate:
            return divided.reversed(), roll[::-1]
        return divided, roll
    if gate:
        path = begin_at(path, float(item.along[gate])) if item.closed else path.reversed()
    return path, np.full(len(path.position), current.roll[k])


def _time_links(problem: TourProblem, linked: LinkedTour) -> float:
    """Time of all links, s. A straight link counts with the time of its joint motion."""
    cost_model, states = problem.cost_model, linked.solution.states
    rows = [cost_model.home]
    total = 0.0
    for k in linked.solution.order:
        rows += linked.to.get(k) or (states.enter[k],)
        total += float(cost_model.limits.seconds(np.diff(rows, axis=0), 0.0).sum())
        rows = [states.leave[k]]
    rows += [*linked.back, cost_model.home]
    return total + float(cost_model.limits.seconds(np.diff(rows, axis=0), 0.0).sum())


def _choose_speeds(
    problem: TourProblem, linked: LinkedTour, speeds: LinkSpeeds
) -> list[tuple[tuple[float, float], ...]]:
    """The speeds of the joint motions to each path, and at the end those back to home."""
    start, chosen = problem.cost_model.home, []
    for k in [*linked.solution.order, -1]:
        rows = [start, *(linked.back if k < 0 else linked.to.get(k, ()))]
        chosen.append(
            tuple(compute_joint_speed(problem.setup, a, b, speeds) for a, b in pairwise(rows))
        )
        start = start if k < 0 else linked.solution.states.leave[k]
    return chosen


def _make_tour(
    tour: Tour, prepared: _Preparation, linked: LinkedTour, what: str, speeds: LinkSpeeds
) -> ArmTour:
    """The result: the paths as their states run them, with the links.

    what: text of the note.
    """
    problem, profiles, order = prepared.problem, prepared.profiles, linked.solution.order
    paths: list[ToolPath] = []
    rolls: list[FloatArray] = []
    for k in order:
        item, states = problem.cost_model.items[k], linked.solution.states
        path, roll = _turn_path(tour.paths[k], item, states, k, profiles.get(k))
        paths.append(path)
        rolls.append(frozen(roll))
    notes = []
    for k, reason in sorted(prepared.lost.items()):
        path_id = tour.paths[k].id
        notes.append(Note("skipped", f"path {path_id}", reason, (path_id,)))
    changed = [tour.paths[k].id for k in order if k in profiles]
    if changed:
        count, names = counted(len(changed), "path"), ", ".join(changed[:8])
        along = f"{count} along which the tool is rolled: {names}"
        notes.append(Note("assumed", along, "no single roll of the tool reaches all of it"))
    seconds = _time_links(problem, linked) if order else 0.0
    *link_speeds, home_speeds = _choose_speeds(problem, linked, speeds)
    notes.append(Note("assumed", f"{what}: {short(seconds, 1)} s between the paths"))
    result = tuple(paths)
    return ArmTour(
        result,
        tour.travel,
        "joint time",
        notes=(*tour.notes, *notes),
        stopped=tour.stopped,
        rolls=tuple(rolls),
        links=tuple(linked.to.get(k, ()) for k in order),
        back=linked.back,
        link_speeds=tuple(link_speeds),
        back_speeds=home_speeds,
        seconds=seconds,
        original_paths=result,
    )
