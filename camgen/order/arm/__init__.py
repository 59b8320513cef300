"""The paths of a flat part in the order, postures and turns in which an arm is through with them soonest."""

from __future__ import annotations

from collections.abc import Container, Sequence
from itertools import pairwise

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.collision.cell import make_surroundings
from camgen.model.job import Job
from camgen.model.part import Note
from camgen.model.path import ToolPath, Tour
from camgen.model.pose import FloatArray, frozen
from camgen.model.text import counted, short
from camgen.motion.cell import find_home, make_free_space, make_setup
from camgen.motion.limits import LinkSpeeds, choose_link_speeds, compute_joint_speed, make_limits
from camgen.motion.pose_paths import PosePath
from camgen.motion.reach import reach_along
from camgen.motion.rolls import find_freedom, list_rolls
from camgen.motion.setup import EdgeMotion, OrientationFreedom, Setup, UnreachableEdge
from camgen.order.arm.items import (
    Item,
    States,
    compute_state_joints,
    find_states,
    join_states,
    lay_out,
    turn_round,
)
from camgen.order.arm.lattice import GRAZE
from camgen.order.arm.layers import FORBIDDEN, CostModel
from camgen.order.arm.links import LinkedTour, link_up
from camgen.order.arm.margin import Clear, clear_of, put_in, roomy_of
from camgen.order.arm.points import are_points, find_points
from camgen.order.arm.search import (
    SearchOptions,
    Solution,
    Tell,
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

#: Turns of a tool that may have any, from which the finer ones are found; of an arm whose joints are iterated, fewer.
_TURNS, _FEW_TURNS = 24, 12
#: So often a tour is begun at most, and one that is proved is bettered once more.
_BEGINNINGS, _AGAIN = 4, 1
#: If more than this share of all paths cannot keep the margin, the tour is found without it.
_TIGHT = 0.25
#: Contacts at which pairs are looked at that are meant to be near.
_CONTACTS = 40
#: rad: turns that differ by no more are the same.
_SAME_TURN = 1e-6


class RollProfile(Struct, frozen=True, eq=False):
    """The roll of the tool along a path where it changes.

    at: (K,) positions along the path, mm.
    turn: (K,) roll at these positions, rad.
    vertices: (V,) positions at which the program needs a waypoint, mm.
    """

    at: FloatArray
    turn: FloatArray
    vertices: FloatArray


class TourRequest(Struct, frozen=True, eq=False):
    """A tour that an arm is to run in less time.

    tour: paths in the order from which the search starts.
    rules: precedence of the paths, by their index in ``tour``.
    fixed: whether order, directions and starts stay.
    """

    tour: Tour
    rules: matrix.Rules
    fixed: bool = False


class _Rolls(Struct, frozen=True):
    """The rolls that are tried.

    angles: rolls of which one is to reach a whole path, rad.
    free: freedom for a path that none of ``angles`` reaches, None: such a path has no state.
    """

    angles: Sequence[float]
    free: OrientationFreedom | None = None


class _Preparation(Struct, frozen=True, eq=False):
    """The problem before the search.

    problem: the items with their states.
    profiles: by path, the roll that changes along it, where no single roll reaches all of it.
    lost: by path, why it has no state.
    roomy: test of joint values for the margin, None where there is no margin.
    """

    problem: TourProblem
    profiles: dict[int, RollProfile]
    lost: dict[int, str]
    roomy: Clear | None


def order_by_time(request: TourRequest, job: Job, cell: Workcell, watch: Watch) -> Tour:
    """The tour that takes the joints least time, where the tool keeps its roll.

    The TCP goes straight from path to path. The tour is unchanged where no posture reaches all of
    its paths.
    """
    tour = request.tour
    problem = _prepare(request, job, cell, _Rolls((0.0,)), lines=True).problem
    if not all(len(states) for states in problem.states):
        return tour

    def tell(message: str) -> None:
        watch(f"ordering, {message}")

    solution = find_tour(problem, range(len(tour.paths)), False, tell)
    solution = improve_tour(problem, solution, False, tell)
    if solution.seconds >= FORBIDDEN:
        return tour
    items = problem.cost_model.items
    paths = [_run(tour.paths[k], items[k], solution.states, k)[0] for k in solution.order]
    if all(path is before for path, before in zip(paths, tour.paths, strict=True)):
        return tour
    return replace(tour, paths=tuple(paths), method="joint time", bound=None)


def order_with_turns(
    request: TourRequest, job: Job, cell: Workcell, watch: Watch, prove: bool = True
) -> ArmTour:
    """The tour with the rolls of the tool and the postures chosen together with the order.

    prove: whether the paths and links that are chosen are tested for collisions.
    """
    assert cell.arm is not None
    tour = request.tour
    freedom = replace(find_freedom(job), tilt=0.0)
    rolls = list_rolls(freedom, _TURNS if cell.arm.arm is not None else _FEW_TURNS)
    prepared = _prepare(request, job, cell, _Rolls(rolls.angles, freedom), lines=False)
    problem, lost = prepared.problem, prepared.lost
    kept = [k for k in range(len(tour.paths)) if k not in lost]

    def tell(message: str) -> None:
        watch(f"ordering, {message}")

    linked = LinkedTour(Solution([], problem.states[0], 0.0))
    if kept and prove:
        problem, linked = _search_with_margin(prepared, kept, request.fixed, tell)
    elif kept:
        linked = _search(problem, kept, prove, tell)
    for k in sorted(problem.lost):
        lost[k] = "it collides in every posture and with every turn that is tried"
    prepared = replace(prepared, problem=problem, lost=lost | linked.lost)
    what = "turns of the tool" if freedom.roll else "ways between the paths"
    speeds = choose_link_speeds(job.process, cell.pace)
    return _make_tour(tour, prepared, linked, f"{what} chosen by joint time", speeds)


def _search_with_margin(
    prepared: _Preparation, kept: Sequence[int], fixed: bool, tell: Tell
) -> tuple[TourProblem, LinkedTour]:
    """The tour over the paths ``kept`` with the margin, and the problem that it solves.

    Paths that cannot keep the margin, or to which no link does, are added to the tour of the others.
    """
    problem = prepared.problem
    if prepared.roomy is None:
        return problem, _search(problem, kept, True, tell)
    every = list(problem.states)
    wide = _restart(problem, every, replace(problem.setup, clear=prepared.roomy))
    # Of points the margin blocks so many links that their tables take minutes: 245 holes.
    linked = _search_paths(wide, kept, True, tell)
    solution = linked.solution
    tight = [k for k in kept if k not in solution.order]
    if not tight:
        return wide, linked
    if len(tight) > _TIGHT * len(kept):
        return problem, _search(problem, kept, True, tell)
    states = [every[k] if k in tight else solution.states.single(k) for k in range(len(every))]
    rest = _restart(problem, states, problem.setup)
    rest = replace(rest, free=wide.free, detours=wide.detours)
    rest = replace(rest, options=replace(problem.options, any_roll=False))
    order = put_in(rest, solution, tight, fixed)
    return rest, link_up(rest, prove_tour(rest, find_tour(rest, order, True, tell), tell))


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


def _search(problem: TourProblem, kept: Sequence[int], prove: bool, tell: Tell) -> LinkedTour:
    """The tour over the paths ``kept`` with its links, as points where they are points."""
    best = None
    if prove and are_points(problem, kept):
        solution = find_points(problem, kept, tell)
        best = None if solution is None else link_up(problem, solution)
    if best is not None and not best.lost:
        return best
    return _search_paths(problem, kept, prove, tell, best)


def _search_paths(
    problem: TourProblem,
    kept: Sequence[int],
    prove: bool,
    tell: Tell,
    best: LinkedTour | None = None,
) -> LinkedTour:
    """The tour over the paths ``kept`` with its links, for paths of any kind.

    While the tour leaves out a path, the search starts again with what it has learnt.
    best: the best tour so far, None before the first.
    """
    for _ in range(_BEGINNINGS if prove else 1):
        order = [k for k in kept if k not in problem.lost]
        linked = LinkedTour(find_tour(problem, order, prove, tell))
        if linked.solution.order:
            linked = LinkedTour(improve_tour(problem, linked.solution, prove, tell))
        if linked.solution.order and prove:
            linked = link_up(problem, _prove_again(problem, linked.solution, tell))
        if best is None or len(linked.solution.order) > len(best.solution.order):
            best = linked
        if not linked.lost:
            break
    assert best is not None
    return best


def _prove_again(problem: TourProblem, solution: Solution, tell: Tell) -> Solution:
    """The best tour of some that are proved: what is learnt of links that collide goes into the next one."""
    best = prove_tour(problem, solution, tell)
    for _ in range(_AGAIN):
        other = prove_tour(problem, improve_tour(problem, best, True, tell), tell)
        if (len(other.order), -other.seconds) <= (len(best.order), -best.seconds):
            break
        best = other
    return best


def _prepare(
    request: TourRequest, job: Job, cell: Workcell, rolls: _Rolls, lines: bool
) -> _Preparation:
    """The problem of ``request``. lines: whether the TCP goes straight from path to path."""
    arm = cell.arm
    assert arm is not None
    # The search tests for collisions without the margin, which ``roomy`` tests beside it.
    wide = make_surroundings(job, cell, None)
    scene = replace(wide, margin=0.0)
    setup = replace(make_setup(arm, cell, scene), clear=clear_of(scene.scene))
    seams = job.tour.seam == "any" and not request.fixed and arm.arm is not None
    paths = request.tour.paths
    items = [lay_out(path, job.process.clearance, seams and not path.pinned) for path in paths]
    if request.fixed:
        items = [replace(item, reversible=False) for item in items]
    angles = np.array(rolls.angles)
    states = find_states(setup, items, angles, _beside(angles))
    profiles: dict[int, RollProfile] = {}
    lost: dict[int, str] = {}
    if rolls.free is not None:
        profiles, lost = _find_others(setup, paths, items, states, rolls, job)
    limits = make_limits(arm, cell.pace, job.process.travel_speed)
    cost_model = CostModel(tuple(items), limits, find_home(arm, cell, scene.scene), lines)
    options = SearchOptions(
        may_reorder=not request.fixed and job.tour.method == "best",
        any_roll=job.tool.symmetric and arm.arm is not None,
        least_height=job.process.least_height,
    )
    free_space = make_free_space(replace(scene, margin=GRAZE), setup)
    problem = TourProblem(setup, free_space, cost_model, states, request.rules, options)
    roomy = None
    if rolls.free is not None and wide.margin != 0:
        roomy = roomy_of(wide, cost_model.home, _find_contacts(problem, lost))
    return _Preparation(problem, profiles, lost, roomy)


def _find_others(
    setup: Setup,
    paths: Sequence[ToolPath],
    items: list[Item],
    states: list[States],
    rolls: _Rolls,
    job: Job,
) -> tuple[dict[int, RollProfile], dict[int, str]]:
    """States for the paths that no single roll reaches, which are put into ``items`` and ``states``.

    First the roll may change along the path. Then the path may come near a singularity, where the
    joints go on without a jump. Returns by path the rolls that change, and why it has no state.
    """
    assert rolls.free is not None
    profiles: dict[int, RollProfile] = {}
    lost: dict[int, str] = {}
    angles = np.array(rolls.angles)
    for k in [k for k, path_states in enumerate(states) if not len(path_states)]:
        turned = _turn_along(setup, paths[k], items[k], job, rolls.free)
        if not isinstance(turned, UnreachableEdge):
            profiles[k], states[k] = turned
            continue
        near = replace(items[k], off=0.0)
        close = find_states(setup, [near], angles, _beside(angles))[0]
        if len(close):
            items[k], states[k] = near, close
        else:
            # A lost path has a state for the tables, and is in no order.
            lost[k] = turned.text
            states[k] = States.fixed(setup.robot.home)
    return profiles, lost


def _find_contacts(problem: TourProblem, lost: Container[int]) -> FloatArray:
    """(K, J) joint values where some of the paths begin, at the contact."""
    some = [
        k
        for k, states in enumerate(problem.states)
        if k not in lost and len(states) and states.branch[0] >= 0
    ]
    some = some[:: max(len(some) // _CONTACTS, 1)]
    if not some:
        return np.zeros((0, len(problem.cost_model.home)))
    one = join_states([problem.states[k].single(0) for k in some])
    items = [problem.cost_model.items[k] for k in some]
    state_joints = compute_state_joints(
        problem.setup, items, one.turn, one.branch, one.gate[:, 0], one.enter
    )
    joints = state_joints.joints[state_joints.first[:-1] + 1]
    return joints[state_joints.is_valid & np.isfinite(joints).all(axis=1)]


def _beside(turns: FloatArray) -> np.ndarray[tuple[int, ...], np.dtype[np.int64]]:
    """(3, C) the turn itself, and those beside it, from which its joints are followed."""
    own = np.arange(len(turns))
    return np.stack([own, own - 1, np.where(own + 1 < len(own), own + 1, -1)])


def _turn_along(
    setup: Setup, path: ToolPath, item: Item, job: Job, free: OrientationFreedom
) -> tuple[RollProfile, States] | UnreachableEdge:
    """The one state of a path along which the turn changes, or why there is none."""
    begin, end = item.position[[0]], item.position[[item.gates[-1] if not item.closed else 0]]
    depth = np.array([0.0, 0.0, max(path.depths)])
    nominal = item.rotation[0]
    none = np.full((1, 3), np.nan)
    way = PosePath(
        frozen(np.concatenate([begin, path.position - depth, end])),
        frozen(np.concatenate([none, none, path.via[1:] - depth, none])),
        frozen(np.broadcast_to(nominal, (len(path.position) + 2, 3, 3))),
    )
    made = reach_along(setup, path.id, way, free)
    if isinstance(made, UnreachableEdge):
        return made
    if not _goes_with_passes(path, made, job.operation.entry):
        return UnreachableEdge(
            path.id,
            "jump",
            "no single turn reaches all of it, and its passes do not go on from a turned end",
        )
    lengths = np.append(0.0, np.cumsum(made.looks.length)) - float(
        np.linalg.norm(begin[0] - way.position[1])
    )
    whole = float(lengths_along(path)[-1])
    inside = np.clip(lengths[made.at], 0.0, whole)
    profile = RollProfile(np.clip(lengths, 0.0, whole), np.unwrap(made.roll), np.unique(inside))
    last = 0 if item.closed else len(item.gates) - 1
    one = States(
        made.joints[[0]], made.joints[[-1]], np.array([[0, last]]), np.zeros(1), np.array([-1])
    )
    return profile, join_states([one, turn_round(one)]) if item.reversible else one


def _goes_with_passes(path: ToolPath, made: EdgeMotion, entry: str) -> bool:
    """Whether every pass can begin with the turn that the one before ended with: there and back, or once round."""
    if max(path.depths) > 0 and entry != "plunge":
        return False
    turned = abs(float(np.unwrap(made.roll)[-1] - made.roll[0])) > _SAME_TURN
    return len(path.depths) == 1 or not (path.closed and turned)


def _run(
    path: ToolPath, item: Item, current: States, k: int, profile: RollProfile | None = None
) -> tuple[ToolPath, FloatArray]:
    """The path as its state runs it, and its turns (N,)."""
    gate = int(current.gate[k, 0])
    if profile is not None:
        made = split_at(path, profile.vertices)
        turn = np.interp(lengths_along(made), profile.at, profile.turn)
        return (made.reversed(), turn[::-1]) if gate else (made, turn)
    if item.closed:
        made = begin_at(path, float(item.along[gate])) if gate else path
    else:
        made = path.reversed() if gate else path
    return made, np.full(len(made.position), current.turn[k])


def _time_links(problem: TourProblem, linked: LinkedTour) -> float:
    """Seconds of all links, as the joints go; of straight links the time that the joints would take."""
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
    """The speeds of the joint motions to each path, and last of those back to home."""
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
    """The result: the paths as their states run them, with the links. what: text of the note."""
    problem, profiles, order = prepared.problem, prepared.profiles, linked.solution.order
    paths: list[ToolPath] = []
    rolls: list[FloatArray] = []
    for k in order:
        item, states = problem.cost_model.items[k], linked.solution.states
        path, roll = _run(tour.paths[k], item, states, k, profiles.get(k))
        paths.append(path)
        rolls.append(frozen(roll))
    notes = []
    for k, reason in sorted(prepared.lost.items()):
        path_id = tour.paths[k].id
        notes.append(Note("skipped", f"path {path_id}", reason, (path_id,)))
    changed = [tour.paths[k].id for k in order if k in profiles]
    if changed:
        count, names = counted(len(changed), "path"), ", ".join(changed[:8])
        turned = f"{count} along which the tool is turned: {names}"
        notes.append(Note("assumed", turned, "no single turn reaches all of it"))
    seconds = _time_links(problem, linked) if order else 0.0
    paces = _choose_speeds(problem, linked, speeds)
    notes.append(Note("assumed", f"{what}: {short(seconds, 1)} s between the paths"))
    made = tuple(paths)
    return ArmTour(
        made,
        tour.travel,
        "joint time",
        notes=(*tour.notes, *notes),
        stopped=tour.stopped,
        turns=tuple(rolls),
        ways=tuple(linked.to.get(k, ()) for k in order),
        back=linked.back,
        paces=tuple(paces[:-1]),
        back_paces=paces[-1],
        seconds=seconds,
        made=made,
    )
