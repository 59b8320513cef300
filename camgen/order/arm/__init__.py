"""The paths of a flat part in the order, postures and turns in which an arm is through with them soonest."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.collision.cell import around
from camgen.collision.hits import hits
from camgen.collision.scene import Scene, narrow
from camgen.model.job import Job
from camgen.model.part import BoolArray, Note
from camgen.model.path import ToolPath, Tour
from camgen.model.pose import FloatArray, frozen
from camgen.model.text import counted, short
from camgen.order.arm.items import Item, States, find_states, join_states, lay_out, turn_round
from camgen.order.arm.layers import WALL, Ground
from camgen.order.arm.links import Links, link_up
from camgen.order.arm.search import Found, Tell, Wish, Work, better_tour, find_tour, prove_tour
from camgen.order.pieces import begin_at, lengths_along, split_at
from camgen.order.solver import matrix
from camgen.order.tours import ArmTour
from camgen.plan import Watch
from camgen.plan.edges import freedom_of, home_of, room_of, setup_of
from camgen.plan.edges.motion import MARGIN, Freedom, Reached, Setup, Unreached
from camgen.plan.edges.reach import reach_along
from camgen.plan.edges.turns import rolls_of
from camgen.plan.edges.ways import Way
from camgen.robots.pace import pace_of
from camgen.robots.workcell import Workcell

#: Turns of a tool that may have any, from which the finer ones are found; of an arm whose joints are iterated, fewer.
_TURNS, _FEW_TURNS = 24, 12
#: So often a tour is begun at most, and one that is proved is bettered once more.
_BEGINNINGS, _AGAIN = 4, 1
#: rad: turns that differ by no more are the same.
_SAME_TURN = 1e-6


class _Profile(Struct, frozen=True, eq=False):
    """Turns that change along a path. at: (K,) mm along it; turn: (K,) rad there. vertices: (V,) mm, where the program
    needs a waypoint.
    """

    at: FloatArray
    turn: FloatArray
    vertices: FloatArray


class _Asked(Struct, frozen=True, eq=False):
    """paths: in an order to begin with. rules: between them. fixed: order, directions and starts stay."""

    paths: tuple[ToolPath, ...]
    rules: matrix.Rules
    fixed: bool
    seams: bool


def order_by_time(tour: Tour, rules: matrix.Rules, job: Job, cell: Workcell, watch: Watch) -> Tour:
    """``tour`` in the order, directions and starts that take the joints least time where the tool keeps its turn and
    goes straight from path to path; as it is where no posture reaches all of its paths.

    rules: what comes before what, by the places in ``tour``.
    """
    asked = _Asked(tour.paths, rules, False, job.tour.seam == "any")
    work, _, _ = _begin(asked, job, cell, (0.0,), lines=True)
    if not all(len(states) for states in work.states):
        return tour

    def tell(said: str) -> None:
        watch(f"ordering, {said}")

    found = better_tour(work, find_tour(work, range(len(tour.paths)), False, tell), False, tell)
    if found.seconds >= WALL:
        return tour
    paths = tuple(_run(tour.paths[k], work.ground.items[k], found.now, k)[0] for k in found.order)
    if all(one is other for one, other in zip(paths, tour.paths, strict=True)):
        return tour
    return replace(tour, paths=paths, method="joint time", bound=None)


def order_with_turns(
    tour: Tour, rules: matrix.Rules, job: Job, cell: Workcell, watch: Watch, fixed: bool, prove: bool = True
) -> ArmTour:
    """``tour`` with the turns of its tool, and the postures, chosen with the order. fixed: order, directions and starts
    stay as they are. prove: what is chosen is tested for collisions.
    """
    assert cell.arm is not None
    freedom = replace(freedom_of(job), tilt=0.0)
    rolls = rolls_of(freedom, _TURNS if cell.arm.arm is not None else _FEW_TURNS)
    asked = _Asked(tour.paths, rules, fixed, job.tour.seam == "any" and not fixed)
    work, profiles, lost = _begin(asked, job, cell, rolls.angles, lines=False, free=freedom)
    kept = [k for k in range(len(tour.paths)) if k not in lost]

    def tell(said: str) -> None:
        watch(f"ordering, {said}")

    found, links = _search(work, kept, prove, tell) if kept else (None, Links({}, (), {}))
    for k in sorted(work.lost):
        lost[k] = "it collides in every posture and with every turn that is tried"
    what = "turns of the tool chosen by joint time" if freedom.roll else "ways between the paths chosen by joint time"
    return _tour(tour, work, found, links, profiles, lost | links.lost, what)


def _search(work: Work, kept: Sequence[int], prove: bool, tell: Tell) -> tuple[Found, Links]:
    """The tour over the paths ``kept``, and its ways: begun anew, with what was learnt, while it leaves some out."""
    best: tuple[Found, Links] | None = None
    for _ in range(_BEGINNINGS if prove else 1):
        found, links = find_tour(work, [k for k in kept if k not in work.lost], prove, tell), Links({}, (), {})
        if found.order:
            found = better_tour(work, found, prove, tell)
        if found.order and prove:
            found, links = link_up(work, _prove_again(work, found, tell))
        if best is None or len(found.order) > len(best[0].order):
            best = found, links
        if not links.lost:
            break
    assert best is not None
    return best


def _prove_again(work: Work, found: Found, tell: Tell) -> Found:
    """The best tour of some that are proved: what is learnt of links that collide goes into the next one."""
    best = prove_tour(work, found, tell)
    for _ in range(_AGAIN):
        other = prove_tour(work, better_tour(work, best, True, tell), tell)
        if (len(other.order), -other.seconds) <= (len(best.order), -best.seconds):
            break
        best = other
    return best


def _begin(
    asked: _Asked, job: Job, cell: Workcell, angles: Sequence[float], lines: bool, free: Freedom | None = None
) -> tuple[Work, dict[int, _Profile], dict[int, str]]:
    """What the search begins with; the turns of paths that no single one does for; and why paths have no state.

    free: what else is tried for a path that none of ``angles`` does for; None: nothing is.
    """
    arm = cell.arm
    assert arm is not None
    # What comes nearer than ``cell.margin`` is told by the check of the program.
    where = around(replace(job, cell=replace(job.cell, margin=0.0)), arm, cell, None, cell.meshes)
    # A tool with one turn has no way round a singularity; whether the joints go on there without a jump is looked at.
    off = 0.0 if free is not None and not free.roll else MARGIN
    setup = replace(setup_of(arm, cell, where), clear=_clear_of(where.scene), off=off)
    high = job.process.clearance
    seams = asked.seams and not asked.fixed and arm.arm is not None
    items = [lay_out(path, high, seams) for path in asked.paths]
    if asked.fixed:
        items = [replace(item, reversible=False) for item in items]
    turns = np.array(angles)
    states = find_states(setup, items, turns, _beside(turns))
    profiles: dict[int, _Profile] = {}
    lost: dict[int, str] = {}
    for k in range(len(items)):
        if free is not None and not len(states[k]):
            made = _turn_along(setup, asked.paths[k], items[k], job, free)
            if isinstance(made, Unreached):
                # It has a state to stand in a table, and is in no order.
                lost[k] = made.text
                states[k] = States(
                    arm.home[None], arm.home[None], np.zeros((1, 2), np.int64), np.zeros(1), np.array([-1])
                )
            else:
                profiles[k], states[k] = made
    pace = pace_of(arm, cell.pace, job.process.travel_speed)
    ground = Ground(tuple(items), pace, home_of(arm, cell, where.scene), lines)
    # The tip keeps above the part where it goes from path to path.
    floor = min(job.process.approach, high / 2) if high > 0 else -math.inf
    wish = Wish(not asked.fixed and job.tour.method == "best", job.tool.symmetric and arm.arm is not None, floor)
    work = Work(setup, room_of(where, setup), ground, states, asked.rules, wish, set(), [], set(), set(), set(), {})
    return work, profiles, lost


def _clear_of(scene: Scene) -> Callable[[FloatArray], BoolArray]:
    """Which joint values collide with nothing. Most of those that do collide with a box: meshes come last."""
    meshed = {int(pair) for target in scene.targets for pair in target.of_strike}
    boxed = narrow(scene, [k for k in range(len(scene.pairs)) if k not in meshed])

    def clear(joints: FloatArray) -> BoolArray:
        good: BoolArray = np.asarray(hits(boxed, joints) < 0)
        if meshed and good.any():
            good[good] = hits(scene, joints[good]) < 0
        return good

    return clear


def _beside(turns: FloatArray) -> np.ndarray[tuple[int, ...], np.dtype[np.int64]]:
    """(3, C) the turn itself, and those beside it, from which its joints are followed."""
    own = np.arange(len(turns))
    return np.stack([own, own - 1, np.where(own + 1 < len(own), own + 1, -1)])


def _turn_along(
    setup: Setup, path: ToolPath, item: Item, job: Job, free: Freedom
) -> tuple[_Profile, States] | Unreached:
    """The one state of a path along which the turn changes, or why there is none."""
    begin, end = item.position[[0]], item.position[[item.gates[-1] if not item.closed else 0]]
    depth = np.array([0.0, 0.0, max(path.depths)])
    nominal = item.rotation[0]
    none = np.full((1, 3), np.nan)
    way = Way(
        frozen(np.concatenate([begin, path.position - depth, end])),
        frozen(np.concatenate([none, none, path.via[1:] - depth, none])),
        frozen(np.broadcast_to(nominal, (len(path.position) + 2, 3, 3))),
    )
    made = reach_along(setup, path.id, way, free)
    if isinstance(made, Unreached):
        return made
    if not _goes_with_passes(path, made, job.operation.entry):
        return Unreached(
            path.id, "jump", "no single turn reaches all of it, and its passes do not go on from a turned end"
        )
    lengths = np.append(0.0, np.cumsum(made.looks.length)) - float(np.linalg.norm(begin[0] - way.position[1]))
    whole = float(lengths_along(path)[-1])
    inside = np.clip(lengths[made.at], 0.0, whole)
    profile = _Profile(np.clip(lengths, 0.0, whole), np.unwrap(made.roll), np.unique(inside))
    last = 0 if item.closed else len(item.gates) - 1
    one = States(made.joints[[0]], made.joints[[-1]], np.array([[0, last]]), np.zeros(1), np.array([-1]))
    return profile, join_states([one, turn_round(one)]) if item.reversible else one


def _goes_with_passes(path: ToolPath, made: Reached, entry: str) -> bool:
    """Whether every pass can begin with the turn that the one before ended with: there and back, or once round."""
    if max(path.depths) > 0 and entry != "plunge":
        return False
    turned = abs(float(np.unwrap(made.roll)[-1] - made.roll[0])) > _SAME_TURN
    return len(path.depths) == 1 or not (path.closed and turned)


def _run(
    path: ToolPath, item: Item, now: States, k: int, profile: _Profile | None = None
) -> tuple[ToolPath, FloatArray]:
    """The path as its state runs it, and its turns (N,)."""
    gate = int(now.gate[k, 0])
    if profile is not None:
        made = split_at(path, profile.vertices)
        turn = np.interp(lengths_along(made), profile.at, profile.turn)
        return (made.reversed(), turn[::-1]) if gate else (made, turn)
    if item.closed:
        made = begin_at(path, float(item.along[gate])) if gate else path
    else:
        made = path.reversed() if gate else path
    return made, np.full(len(made.position), now.turn[k])


def _time_ways(work: Work, found: Found, links: Links) -> float:
    """Seconds of all ways between the paths, as the joints go; of straight ones those that the joints would take."""
    rows = [work.ground.home]
    total = 0.0
    for k in found.order:
        rows += links.to.get(k) or (found.now.enter[k],)
        total += float(work.ground.pace.seconds(np.diff(rows, axis=0), 0.0).sum())
        rows = [found.now.leave[k]]
    rows += [*links.back, work.ground.home]
    return total + float(work.ground.pace.seconds(np.diff(rows, axis=0), 0.0).sum())


def _tour(
    tour: Tour,
    work: Work,
    found: Found | None,
    links: Links,
    profiles: dict[int, _Profile],
    lost: dict[int, str],
    what: str,
) -> ArmTour:
    order = found.order if found is not None else []
    made = [_run(tour.paths[k], work.ground.items[k], found.now, k, profiles.get(k)) for k in order if found]
    paths = tuple(path for path, _ in made)
    notes = [Note("skipped", f"path {tour.paths[k].id}", why, (tour.paths[k].id,)) for k, why in sorted(lost.items())]
    changed = [tour.paths[k].id for k in order if k in profiles]
    if changed:
        turned = f"{counted(len(changed), 'path')} along which the tool is turned: {', '.join(changed[:8])}"
        notes.append(Note("assumed", turned, "no single turn reaches all of it"))
    seconds = _time_ways(work, found, links) if found is not None else 0.0
    notes.append(Note("assumed", f"{what}: {short(seconds, 1)} s between the paths"))
    return ArmTour(
        paths,
        tour.travel,
        "joint time",
        notes=(*tour.notes, *notes),
        stopped=tour.stopped,
        turns=tuple(frozen(turn) for _, turn in made),
        ways=tuple(links.to.get(k, ()) for k in order),
        back=links.back,
        seconds=seconds,
        made=paths,
    )
