"""The paths of a flat part in the order, postures and turns in which an arm is through with them soonest."""

from __future__ import annotations

from collections.abc import Container, Sequence
from itertools import pairwise

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.collision.cell import around
from camgen.model.job import Job
from camgen.model.part import Note
from camgen.model.path import ToolPath, Tour
from camgen.model.pose import FloatArray, frozen
from camgen.model.text import counted, short
from camgen.motion.cell import home_of, room_of, setup_of
from camgen.motion.limits import LinkSpeeds, limits_of, turn_speed
from camgen.motion.pose_paths import Way
from camgen.motion.reach import reach_along
from camgen.motion.rolls import freedom_of, rolls_of
from camgen.motion.setup import Freedom, Reached, Setup, Unreached
from camgen.order.arm.items import (
    Item,
    States,
    find_states,
    join_states,
    lay_out,
    stand,
    turn_round,
)
from camgen.order.arm.lattice import GRAZE
from camgen.order.arm.layers import WALL, Ground
from camgen.order.arm.links import Links, link_up
from camgen.order.arm.margin import Clear, clear_of, put_in, roomy_of
from camgen.order.arm.points import are_points, find_points
from camgen.order.arm.search import Found, Tell, Wish, Work, better_tour, find_tour, prove_tour
from camgen.order.pieces import begin_at, lengths_along, split_at
from camgen.order.solver import matrix
from camgen.order.tours import ArmTour
from camgen.plan import Watch
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
    work, _, _, _ = _begin(asked, job, cell, (0.0,), lines=True)
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
    tour: Tour,
    rules: matrix.Rules,
    job: Job,
    cell: Workcell,
    watch: Watch,
    fixed: bool,
    prove: bool = True,
) -> ArmTour:
    """``tour`` with the turns of its tool, and the postures, chosen with the order. fixed: order, directions and starts
    stay as they are. prove: what is chosen is tested for collisions.
    """
    assert cell.arm is not None
    freedom = replace(freedom_of(job), tilt=0.0)
    rolls = rolls_of(freedom, _TURNS if cell.arm.arm is not None else _FEW_TURNS)
    asked = _Asked(tour.paths, rules, fixed, job.tour.seam == "any" and not fixed)
    work, profiles, lost, roomy = _begin(asked, job, cell, rolls.angles, lines=False, free=freedom)
    kept = [k for k in range(len(tour.paths)) if k not in lost]

    def tell(said: str) -> None:
        watch(f"ordering, {said}")

    found, links = None, Links({}, (), {})
    if kept and prove:
        work, found, links = _search_with_margin(work, roomy, kept, fixed, tell)
    elif kept:
        found, links = _search(work, kept, prove, tell)
    for k in sorted(work.lost):
        lost[k] = "it collides in every posture and with every turn that is tried"
    what = (
        "turns of the tool chosen by joint time"
        if freedom.roll
        else "ways between the paths chosen by joint time"
    )
    free, share = (
        (job.process.travel, 0.0) if job.process.travel else (cell.pace.fastest, cell.pace.most)
    )
    speeds = LinkSpeeds(job.process.travel_speed, free, share, cell.pace.acceleration)
    return _tour(tour, work, found, links, profiles, lost | links.lost, what, speeds)


def _search_with_margin(
    work: Work, roomy: Clear | None, kept: Sequence[int], fixed: bool, tell: Tell
) -> tuple[Work, Found, Links]:
    """The tour with the margin; paths that cannot keep it, or to which no way does, come in when the rest is found.
    roomy: which joint values keep it; None: there is none to keep.
    """
    if roomy is None:
        return work, *_search(work, kept, True, tell)
    every = list(work.states)
    wide = _fresh(work, every, replace(work.setup, clear=roomy))
    # Of points the margin closes so many links that tables of all of them are mended for minutes: 245 holes.
    found, links = _search_paths(wide, kept, True, tell)
    tight = [k for k in kept if k not in found.order]
    if not tight:
        return wide, found, links
    if len(tight) > _TIGHT * len(kept):
        return work, *_search(work, kept, True, tell)
    states = [every[k] if k in tight else found.now.pick(np.array([k])) for k in range(len(every))]
    rest = replace(_fresh(work, states, work.setup), free=wide.free, detours=wide.detours)
    rest = replace(rest, wish=replace(work.wish, loose=False))
    made = prove_tour(rest, find_tour(rest, put_in(rest, found, tight, fixed), True, tell), tell)
    return rest, *link_up(rest, made)


def _fresh(work: Work, states: Sequence[States], setup: Setup) -> Work:
    """The same task, of which nothing is known."""
    own = list(states)
    return Work(
        setup,
        work.room,
        work.ground,
        own,
        work.rules,
        work.wish,
        set(),
        [],
        set(),
        set(),
        set(),
        {},
        {},
    )


def _search(work: Work, kept: Sequence[int], prove: bool, tell: Tell) -> tuple[Found, Links]:
    """The tour over the paths ``kept``, and its ways: begun anew, with what was learnt, while it leaves some out."""
    best = _search_points(work, kept, tell) if prove and are_points(work, kept) else None
    if best is not None and not best[1].lost:
        return best
    return _search_paths(work, kept, prove, tell, best)


def _search_paths(
    work: Work,
    kept: Sequence[int],
    prove: bool,
    tell: Tell,
    best: tuple[Found, Links] | None = None,
) -> tuple[Found, Links]:
    """The same for paths of any kind. best: what is known already."""
    for _ in range(_BEGINNINGS if prove else 1):
        found, links = (
            find_tour(work, [k for k in kept if k not in work.lost], prove, tell),
            Links({}, (), {}),
        )
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


def _search_points(work: Work, kept: Sequence[int], tell: Tell) -> tuple[Found, Links] | None:
    """The tour over points that may come in any order, and its ways; None where none is found."""
    found = find_points(work, kept, tell)
    return None if found is None else link_up(work, found)


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
    asked: _Asked,
    job: Job,
    cell: Workcell,
    angles: Sequence[float],
    lines: bool,
    free: Freedom | None = None,
) -> tuple[Work, dict[int, _Profile], dict[int, str], Clear | None]:
    """What the search begins with; the turns of paths that no single one does for; why paths have no state; and which
    joint values keep the margin, None where there is none.

    free: what else is tried for a path that none of ``angles`` does for; None: nothing is.
    """
    arm = cell.arm
    assert arm is not None
    # What a search looks at collides or does not; the margin is asked for beside it.
    wide = around(job, cell, None)
    where = replace(wide, margin=0.0)
    setup = replace(setup_of(arm, cell, where), clear=clear_of(where.scene))
    high = job.process.clearance
    seams = asked.seams and not asked.fixed and arm.arm is not None
    items = [lay_out(path, high, seams and not path.pinned) for path in asked.paths]
    if asked.fixed:
        items = [replace(item, reversible=False) for item in items]
    turns = np.array(angles)
    states = find_states(setup, items, turns, _beside(turns))
    profiles, lost = (
        _find_others(setup, asked.paths, items, states, turns, job, free)
        if free is not None
        else ({}, {})
    )
    limits = limits_of(arm, cell.pace, job.process.travel_speed)
    ground = Ground(tuple(items), limits, home_of(arm, cell, where.scene), lines)
    # The tip keeps above the part where it goes from path to path.
    loose, floor = job.tool.symmetric and arm.arm is not None, job.process.least_height
    wish = Wish(not asked.fixed and job.tour.method == "best", loose, floor)
    room = room_of(replace(where, margin=GRAZE), setup)
    work = Work(
        setup, room, ground, states, asked.rules, wish, set(), [], set(), set(), set(), {}, {}
    )
    if free is None or wide.margin == 0:
        return work, profiles, lost, None
    return work, profiles, lost, roomy_of(wide, ground.home, _find_contacts(work, lost))


def _find_others(
    setup: Setup,
    paths: Sequence[ToolPath],
    items: list[Item],
    states: list[States],
    turns: FloatArray,
    job: Job,
    free: Freedom,
) -> tuple[dict[int, _Profile], dict[int, str]]:
    """States of the paths that no single turn does for, put into ``items`` and ``states``: with turns that change, or
    else near a singularity, where the joints go on without a jump as those of a tool that keeps its turn may. The
    turns that change; and why paths have no state, by path.
    """
    profiles: dict[int, _Profile] = {}
    lost: dict[int, str] = {}
    home = setup.robot.home[None]
    for k in (k for k, own in enumerate(states) if not len(own)):
        made = _turn_along(setup, paths[k], items[k], job, free)
        if not isinstance(made, Unreached):
            profiles[k], states[k] = made
            continue
        near = replace(items[k], off=0.0)
        close = find_states(setup, [near], turns, _beside(turns))[0]
        if len(close):
            items[k], states[k] = near, close
        else:
            # It has a state to stand in a table, and is in no order.
            lost[k] = made.text
            states[k] = States(home, home, np.zeros((1, 2), np.int64), np.zeros(1), np.array([-1]))
    return profiles, lost


def _find_contacts(work: Work, lost: Container[int]) -> FloatArray:
    """(K, J) joint values where some of the paths begin, at the contact."""
    some = [
        k
        for k, states in enumerate(work.states)
        if k not in lost and len(states) and states.branch[0] >= 0
    ]
    some = some[:: max(len(some) // _CONTACTS, 1)]
    if not some:
        return np.zeros((0, len(work.ground.home)))
    one = join_states([work.states[k].pick(np.array([0])) for k in some])
    items = [work.ground.items[k] for k in some]
    stood = stand(work.setup, items, one.turn, one.branch, one.gate[:, 0], one.enter)
    joints = stood.joints[stood.first[:-1] + 1]
    return joints[stood.good & np.isfinite(joints).all(axis=1)]


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
            path.id,
            "jump",
            "no single turn reaches all of it, and its passes do not go on from a turned end",
        )
    lengths = np.append(0.0, np.cumsum(made.looks.length)) - float(
        np.linalg.norm(begin[0] - way.position[1])
    )
    whole = float(lengths_along(path)[-1])
    inside = np.clip(lengths[made.at], 0.0, whole)
    profile = _Profile(np.clip(lengths, 0.0, whole), np.unwrap(made.roll), np.unique(inside))
    last = 0 if item.closed else len(item.gates) - 1
    one = States(
        made.joints[[0]], made.joints[[-1]], np.array([[0, last]]), np.zeros(1), np.array([-1])
    )
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
        total += float(work.ground.limits.seconds(np.diff(rows, axis=0), 0.0).sum())
        rows = [found.now.leave[k]]
    rows += [*links.back, work.ground.home]
    return total + float(work.ground.limits.seconds(np.diff(rows, axis=0), 0.0).sum())


def _pace_ways(
    work: Work, found: Found | None, links: Links, speeds: LinkSpeeds
) -> list[tuple[tuple[float, float], ...]]:
    """How fast the motions of the joints to each path, and last those back, are run: as fast as the joints may be."""
    at, paces = work.ground.home, []
    for k in [*found.order, -1] if found is not None else [-1]:
        ways = links.to.get(k, ()) if k >= 0 else links.back
        rows = [at, *ways]
        paces.append(tuple(turn_speed(work.setup, a, b, speeds) for a, b in pairwise(rows)))
        at = found.now.leave[k] if found is not None and k >= 0 else at
    return paces


def _tour(
    tour: Tour,
    work: Work,
    found: Found | None,
    links: Links,
    profiles: dict[int, _Profile],
    lost: dict[int, str],
    what: str,
    speeds: LinkSpeeds,
) -> ArmTour:
    order = found.order if found is not None else []
    made = [
        _run(tour.paths[k], work.ground.items[k], found.now, k, profiles.get(k))
        for k in order
        if found
    ]
    paths = tuple(path for path, _ in made)
    notes = [
        Note("skipped", f"path {tour.paths[k].id}", why, (tour.paths[k].id,))
        for k, why in sorted(lost.items())
    ]
    changed = [tour.paths[k].id for k in order if k in profiles]
    if changed:
        turned = f"{counted(len(changed), 'path')} along which the tool is turned: {', '.join(changed[:8])}"
        notes.append(Note("assumed", turned, "no single turn reaches all of it"))
    seconds = _time_ways(work, found, links) if found is not None else 0.0
    paces = _pace_ways(work, found, links, speeds)
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
        paces=tuple(paces[:-1]),
        back_paces=paces[-1],
        seconds=seconds,
        made=paths,
    )
