"""One tour over all processing motions, from and back to home, with every link on it proved (RFA paper, III.C).

Only motions in free space that the tour takes are tested: one that collides is taken out and the tour found again.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import count, pairwise

import numpy as np
from msgspec import Struct

from camgen.model.part import BoolArray, Edge, IntArray
from camgen.model.pose import FloatArray
from camgen.order.edges import links
from camgen.order.edges.retract import Retraction, retractions
from camgen.order.solver import matrix
from camgen.plan.edges.motion import Reached, Room, Setup, Track, Unreached
from camgen.plan.edges.ways import Way

#: Ends of edges nearer than this are one vertex, mm.
_VERTEX = 0.01
#: So many tours are found before those motions that still collide are given up.
_ROUNDS = 30
#: Share of the usual search while links still turn out to collide, and then.
_QUICK, _FULL = 0.05, 0.3
_REMEDY = "raise cell.safety, or move the part: cell.base_from_work"


class Leg(Struct, frozen=True, eq=False):
    """A processing motion and the link that leads to it."""

    link: tuple[links.Piece, ...]
    motion: Reached


class Route(Struct, frozen=True, eq=False):
    """legs in order; back: from the last to home. dropped: motions to which no free way leads. seconds: of all links at
    the joints' and the travel's speed. nearest: the same of the paper's nearest neighbour.
    """

    legs: tuple[Leg, ...]
    back: tuple[links.Piece, ...]
    dropped: tuple[Unreached, ...]
    seconds: float
    nearest: float


class _Known(Struct, eq=False):
    """What has been found out about free motions, filled in as tours need them. blocked: (2 n, 2 n) and home_blocked:
    (2 n,), those that collide. clear: pairs of ends, -1 for home, that do not.
    """

    blocked: BoolArray
    home_blocked: BoolArray
    clear: set[tuple[int, int]]


class _Work(Struct, frozen=True, eq=False):
    """n motions that can be left at both ends."""

    room: Room
    motions: tuple[Reached, ...]
    out: tuple[Retraction, ...]
    ends: links.Ends
    home: FloatArray
    to_home: FloatArray
    known: _Known


class _Found(Struct, frozen=True, eq=False):
    """An order, how each link in it begins, its seconds and those of the nearest neighbour's order."""

    order: matrix.Order
    first: IntArray
    seconds: float
    nearest: float


def route(
    setup: Setup,
    room: Room,
    motions: Sequence[Reached],
    edges: Sequence[Edge],
    home: FloatArray,
    speed: float,
    best: bool,
    lifted: bool = False,
) -> Route:
    """The tour over ``motions`` along ``edges`` (one each), from ``home`` (J,), at ``speed`` mm/s between them.

    best: the shortest that is found, else the nearest neighbour's. lifted: every link leaves the part, as it must do
    where a force presses.
    """
    by_id = {edge.id: edge for edge in edges}
    left, outs, dropped = _left(setup, room, motions)
    while left:
        own = [by_id[motion.id] for motion in left]
        work = _work(setup, room, left, outs, own, home, speed, lifted)
        found = _order(work, best)
        lost = _find_lost(work, found)
        if not lost:
            legs, back = _legs(work, found)
            return Route(legs, back, tuple(dropped), found.seconds, found.nearest)
        dropped += [Unreached(left[k].id, "collision", "no free motion leads to it") for k in sorted(lost)]
        kept = [k for k in range(len(left)) if k not in lost]
        left, outs = [left[k] for k in kept], [outs[2 * k + end] for k in kept for end in (0, 1)]
    return Route((), (), tuple(dropped), 0.0, 0.0)


def _left(
    setup: Setup, room: Room, motions: Sequence[Reached]
) -> tuple[list[Reached], list[Retraction], list[Unreached]]:
    """The motions with a way out of both ends, the two ways of each, and those without any."""
    kept: list[Reached] = []
    outs: list[Retraction] = []
    dropped: list[Unreached] = []
    ends = [(_row(motion.way, k), motion.joints[k]) for motion in motions for k in (0, -1)]
    found = retractions(setup, room, ends)
    for motion, *pair in zip(motions, found[::2], found[1::2], strict=True):
        texts = [one for one in pair if isinstance(one, str)]
        if len(texts) == 2:
            dropped.append(Unreached(motion.id, "collision", f"no way back from it: {texts[0]}"))
            continue
        ways = [one for one in pair if isinstance(one, Retraction)]
        if isinstance(pair[0], str):
            ways.insert(0, links.by_way_of(motion, 0, ways[0]))
        if isinstance(pair[1], str):
            ways.append(links.by_way_of(motion, 1, ways[0]))
        kept.append(motion)
        outs += ways
    return kept, outs, dropped


def _row(way: Way, k: int) -> Way:
    return Way(way.position[[k]], np.full((1, 3), np.nan), way.rotation[[k]])


def _work(
    setup: Setup,
    room: Room,
    motions: Sequence[Reached],
    outs: Sequence[Retraction],
    edges: Sequence[Edge],
    home: FloatArray,
    speed: float,
    lifted: bool,
) -> _Work:
    joints = np.concatenate([motion.joints[[0, -1]] for motion in motions])
    safe = np.stack([out.joints[-1] for out in outs])
    out = np.array([out.way.length.sum() for out in outs]) / speed
    through = np.array([motion.way.length.sum() for motion in motions]) / speed
    free = links.seconds(setup.robot, safe[:, None], safe[None], speed)
    vertices = np.concatenate([_vertices(motion, edge) for motion, edge in zip(motions, edges, strict=True)])
    direct = links.seconds(setup.robot, joints[:, None], joints[None], speed)
    direct[lifted | ~links.distinct(vertices, _VERTEX)] = math.inf
    direct[direct >= free + out[:, None] + out[None]] = math.inf
    near = np.argwhere(np.triu(np.isfinite(direct)))
    for (a, b), hit in zip(near.tolist(), room.hits([Track(joints[pair]) for pair in near]), strict=True):
        if hit:
            direct[a, b] = direct[b, a] = math.inf
    ends = links.Ends(joints, safe, out, free, direct, through)
    to_home = links.seconds(setup.robot, safe, home[None], speed)
    count = len(joints)
    known = _Known(np.zeros((count, count), dtype=bool), np.zeros(count, dtype=bool), set())
    return _Work(room, tuple(motions), tuple(outs), ends, home, to_home, known)


def _vertices(motion: Reached, edge: Edge) -> FloatArray:
    """(2, 3) where the edge starts and ends as it is run, NaN where the motion does not go so far."""
    ends = edge.points[[-1, 0] if motion.backwards else [0, -1]].copy()
    ends[np.array(motion.trimmed) > 0] = np.nan
    return np.asarray(ends)


def _order(work: _Work, best: bool) -> _Found:
    """The tour, all its links tested unless they are infinite."""
    known = work.known
    effort = _QUICK
    for attempt in count():
        if attempt == _ROUNDS:
            _only_clear(known)
        home = np.where(known.home_blocked, math.inf, work.to_home)
        between, first = links.steps(work.ends, known.blocked, home)
        table = between.reshape(len(work.motions), 2, -1, 2)
        ends = (home + work.ends.out).reshape(-1, 2)
        near = matrix.nearest(table, ends)
        order = matrix.shortest(table, ends, ends, effort=effort) if best else near
        costs = [matrix.total(table, ends, ends, *one) for one in (order, near)]
        if _collides(work, order, first):
            continue
        if effort == _FULL:
            return _Found(order, first, *costs)
        effort = _FULL
    raise AssertionError("every round tests at least one motion more")


def _only_clear(known: _Known) -> None:
    """Take whatever has not been tested to collide."""
    known.blocked[:] = True
    for a, b in known.clear:
        if b >= 0:
            known.blocked[a, b] = known.blocked[b, a] = False


def _collides(work: _Work, order: matrix.Order, first: IntArray) -> bool:
    """Test the free motions of the tour that are not known yet. Does one collide?"""
    states = _states(order)
    pairs = {(states[0][0], -1), (states[-1][1], -1)}
    for (_, a), (b, _) in pairwise(states):
        if first[a, b] == links.FREE:
            pairs.add((max(a, b), min(a, b)))
        elif first[a, b] == links.BY_HOME:
            pairs |= {(a, -1), (b, -1)}
    known, safe = work.known, work.ends.safe
    new = [p for p in sorted(pairs - known.clear) if not (known.home_blocked[p[0]] if p[1] < 0 else known.blocked[p])]
    hits = work.room.hits([Track(np.stack([safe[a], work.home if b < 0 else safe[b]])) for a, b in new])
    for (a, b), hit in zip(new, hits, strict=True):
        if not hit:
            known.clear.add((a, b))
        elif b < 0:
            known.home_blocked[a] = True
        else:
            known.blocked[a, b] = known.blocked[b, a] = True
    return any(hits)


def _find_lost(work: _Work, found: _Found) -> set[int]:
    """The motions to which, or from which, the tour has no finite link."""
    if math.isfinite(found.seconds):
        return set()
    home = ~work.known.home_blocked
    states = _states(found.order)
    lost = {states[0][0] // 2} if not home[states[0][0]] else set()
    lost |= {states[-1][1] // 2} if not home[states[-1][1]] else set()
    between, _ = links.steps(work.ends, work.known.blocked, np.where(home, work.to_home, math.inf))
    lost |= {b // 2 for (_, a), (b, _) in pairwise(states) if not math.isfinite(between[a, b])}
    return lost


def _states(order: matrix.Order) -> list[tuple[int, int]]:
    """The end at which each motion is entered and the one at which it is left."""
    return [(2 * i + back, 2 * i + 1 - back) for i, back in zip(*order, strict=True)]


def _legs(work: _Work, found: _Found) -> tuple[tuple[Leg, ...], tuple[links.Piece, ...]]:
    legs = []
    before = -1
    for (enter, leave), item, back in zip(_states(found.order), *found.order, strict=True):
        if before < 0:
            link: tuple[links.Piece, ...] = (links.Turn(work.ends.safe[enter]), links.entering(work.out[enter]))
        else:
            link = tuple(links.pieces(before, enter, work.ends, found.first, work.motions, work.out, work.home))
        motion = work.motions[item]
        legs.append(Leg(link, motion.reversed() if back else motion))
        before = leave
    return tuple(legs), (links.leaving(work.out[before]), links.Turn(work.home))
