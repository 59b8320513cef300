"""One tour over all processing motions, from and back to home, with every link on it proved (RFA paper, III.C).

Only motions in free space that the tour takes are tested: one that collides is taken out and the tour found again.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import count, pairwise
from typing import Literal

import numpy as np
from msgspec import Struct, field
from msgspec.structs import replace

from camgen.model.part import BoolArray, IntArray, Line
from camgen.model.pose import FloatArray
from camgen.model.text import counted
from camgen.motion.limits import LinkSpeeds
from camgen.motion.pose_paths import Way
from camgen.motion.setup import Hit, Reached, Room, Setup, Track, Unreached
from camgen.order.edges import links
from camgen.order.edges.detour import find_detour
from camgen.order.edges.retract import Retraction, retractions, shorter
from camgen.order.solver import matrix
from camgen.robots.models import Robot

#: Ends of edges nearer than this are one vertex, mm.
_VERTEX = 0.01
#: So many tours are found before those motions that still collide are given up, and so many again when motions to
#: which none leads have been left out.
_ROUNDS, _AGAIN = 30, 5
#: After so often motions to which the way home collides are left out too: the others can always be reached by it.
_PASSES = 10
#: Share of the usual search while links still turn out to collide, and then.
_QUICK, _FULL = 0.05, 0.3
#: s added to a link that comes nearer than the margin: more than any tour takes, so that it is taken only where
#: no other leads.
_NEAR = 1e5
#: mm: a motion that comes so little nearer than its ends keeps what they have.
_AS_NEAR_MM = 0.05
#: Searches for a way home that find none, after which no more is searched.
_FRUITLESS = 12
#: s: a power of two, so that a sum of less than two months is exact.
_TICK = 2.0**-30
_REMEDY = "cell.safety or another place (camgen place) may help"


class Wish(Struct, frozen=True):
    """The wishes of a job for its links.

    speeds: speeds of the links.
    best: whether the shortest tour is searched for; else the nearest neighbour is next.
    lifted: whether each link leaves the part, as a tool that presses has to.
    """

    speeds: LinkSpeeds
    best: bool
    lifted: bool = False


class Leg(Struct, frozen=True, eq=False):
    """A processing motion and the link that leads to it."""

    link: tuple[links.Piece, ...]
    motion: Reached


class Route(Struct, frozen=True, eq=False):
    """legs in order; back: from the last to home. dropped: motions to which no free way leads. seconds: of all links at
    the joints' and the travel's speed. nearest: the same of the paper's nearest neighbour. searched: of how many
    motions the way home was searched for.
    """

    legs: tuple[Leg, ...]
    back: tuple[links.Piece, ...]
    dropped: tuple[Unreached, ...]
    seconds: float
    nearest: float
    searched: int = 0


class _Known(Struct, eq=False):
    """What has been found out about free motions, filled in as tours need them: (2 n + 1, 2 n + 1) from end to end, the
    last one home, those that collide and those that do not, and of these the ones that come nearer than the margin.
    """

    blocked: BoolArray
    clear: BoolArray
    near: BoolArray


class _Work(Struct, frozen=True, eq=False):
    """n motions that can be left at both ends. at_part: as of ``links.along``."""

    room: Room
    motions: tuple[Reached, ...]
    out: tuple[Retraction, ...]
    ends: links.Ends
    at_part: tuple[FloatArray, IntArray]
    home: FloatArray
    to_home: FloatArray
    known: _Known


class _Found(Struct, frozen=True, eq=False):
    """An order, how each link in it begins, its seconds and those of the nearest neighbour's order."""

    order: matrix.Order
    first: IntArray
    seconds: float
    nearest: float


def _ignore(_: str) -> None:
    """The search of a caller who does not look at it."""


def route(
    setup: Setup,
    room: Room,
    motions: Sequence[Reached],
    edges: Sequence[Line],
    home: FloatArray,
    wish: Wish,
    tell: Callable[[str], None] = _ignore,
) -> Route:
    """The tour over ``motions`` along ``edges`` (one each), from ``home`` (J,). tell: is told how far the search is.

    It ends after ``_ROUNDS`` and ``_PASSES`` times ``_AGAIN`` tours, and a few.
    """
    by_id = {edge.id: edge for edge in edges}
    detours = _Detours(setup, room, home)
    left, outs, dropped = _left(detours, motions, wish.speeds)
    if not left:
        return Route((), (), tuple(dropped), 0.0, 0.0)
    work = _work(setup, room, left, outs, [by_id[motion.id] for motion in left], home, wish)
    for attempt in count():
        found = _order(work, wish.best, _AGAIN if attempt else _ROUNDS, tell)
        lost = _find_lost(work, found, attempt >= _PASSES)
        if not lost:
            legs, back = _pace(setup, *_legs(work, found), home, wish.speeds)
            return Route(
                legs, back, tuple(dropped), found.seconds, found.nearest, _count_searched(work)
            )
        if turned := _find_one_sided(work, lost):
            work = _turn_back(work, turned, wish.speeds.part)
            continue
        tell(f"{counted(len(work.motions), 'edge')}, ways round what stands between")
        if opened := {
            k: way for k in sorted(lost) if (way := _search_home(detours, work, k)) is not None
        }:
            work = _open(work, opened, setup.robot, wish.speeds)
            continue
        names = [work.motions[k].id for k in sorted(lost)]
        dropped += [
            Unreached(name, "collision", "no free motion leads to it", _REMEDY) for name in names
        ]
        if len(lost) == len(work.motions):
            return Route((), (), tuple(dropped), 0.0, 0.0)
        work = _without(work, lost)
    raise AssertionError("every attempt leaves at least one motion out")


class _Detours(Struct, eq=False):
    """Ways home that are searched for. fruitless: how many searches in all have found none. done: the ids of motions
    whose ends were asked for.
    """

    setup: Setup
    room: Room
    home: FloatArray
    fruitless: int = 0
    done: set[str] = field(default_factory=set)

    def lead_home(self, joints: FloatArray) -> FloatArray | None:
        """By way of which joint values (K, J) the joints go home from ``joints`` (J,); None where no way is found."""
        if self.fruitless >= _FRUITLESS:
            return None
        way = find_detour(self.setup, self.room, joints, self.home)
        self.fruitless += way is None
        return None if way is None else way[1:-1]


def _left(
    detours: _Detours, motions: Sequence[Reached], speeds: LinkSpeeds
) -> tuple[list[Reached], list[Retraction], list[Unreached]]:
    """The motions with a way out of both ends, the two ways of each, and those without any."""
    kept: list[Reached] = []
    outs: list[Retraction] = []
    dropped: list[Unreached] = []
    ends = [end for motion in motions for end in _ends(motion)]
    found = retractions(detours.setup, detours.room, ends, speeds)
    for motion, *both in zip(motions, found[::2], found[1::2], strict=True):
        texts = [one for one in both if isinstance(one, str)]
        pair = both
        if len(texts) == 2:
            pair = [_search_out(detours, end, speeds) or texts[0] for end in _ends(motion)]
        if isinstance(pair[0], str) and isinstance(pair[1], str):
            dropped.append(
                Unreached(motion.id, "collision", f"no way back from it: {texts[0]}", _REMEDY)
            )
            continue
        ways = [one for one in pair if isinstance(one, Retraction)]
        if isinstance(pair[0], str):
            ways.insert(0, links.by_way_of(motion, 0, ways[0], speeds.part))
        if isinstance(pair[1], str):
            ways.append(links.by_way_of(motion, 1, ways[0], speeds.part))
        kept.append(motion)
        outs += ways
    return kept, outs, dropped


def _ends(motion: Reached) -> tuple[tuple[Way, FloatArray], tuple[Way, FloatArray]]:
    """Where the motion begins and where it ends, each with its joints."""
    return (_row(motion.way, 0), motion.joints[0]), (_row(motion.way, -1), motion.joints[-1])


def _search_out(
    detours: _Detours, end: tuple[Way, FloatArray], speeds: LinkSpeeds
) -> Retraction | None:
    """A way out of one end and home that is no way of RFA's: back a little, and from there as a search finds it."""
    out = shorter(detours.setup, detours.room, *end, speeds)
    via = None if out is None else detours.lead_home(out.joints[-1])
    return None if out is None or via is None else replace(out, via=via)


def _row(way: Way, k: int) -> Way:
    return Way(way.position[[k]], np.full((1, 3), np.nan), way.rotation[[k]])


def _work(
    setup: Setup,
    room: Room,
    motions: Sequence[Reached],
    outs: Sequence[Retraction],
    edges: Sequence[Line],
    home: FloatArray,
    wish: Wish,
) -> _Work:
    speed = wish.speeds.part
    joints = np.concatenate([motion.joints[[0, -1]] for motion in motions])
    safe = np.stack([out.joints[-1] for out in outs])
    out = np.array([out.seconds for out in outs])
    through = np.array([motion.way.length.sum() for motion in motions]) / speed
    free = links.seconds(setup.robot, safe[:, None], safe[None], wish.speeds.free)
    vertices = np.concatenate(
        [_vertices(motion, edge) for motion, edge in zip(motions, edges, strict=True)]
    )
    direct = links.seconds(setup.robot, joints[:, None], joints[None], speed)
    direct[wish.lifted | ~links.distinct(vertices, _VERTEX)] = math.inf
    direct[direct >= free + out[:, None] + out[None]] = math.inf
    near = np.argwhere(np.triu(np.isfinite(direct)))
    for (a, b), seen in zip(
        near.tolist(), _look(room, [joints[pair] for pair in near]), strict=True
    ):
        if seen != "clear":
            direct[a, b] = direct[b, a] = math.inf if seen == "blocked" else direct[a, b] + _NEAR
    ends = links.Ends(joints, safe, out, free, direct, through, speed)
    to_home = links.seconds(setup.robot, safe, home[None], wish.speeds.free)
    size = (len(joints) + 1,) * 2
    known = _Known(*(np.zeros(size, dtype=bool) for _ in range(3)))
    for end in (k for k, one in enumerate(outs) if len(one.via)):
        to_home[end] = _time_home(setup.robot, outs[end], home, wish.speeds)
        known.clear[end, -1] = known.clear[-1, end] = True
    return _Work(room, tuple(motions), tuple(outs), ends, links.along(ends), home, to_home, known)


def _look(room: Room, several: Sequence[FloatArray]) -> list[Literal["blocked", "near", "clear"]]:
    """What comes of motions of the joints from row to row (2, J): near are those that come nearer than the margin, and
    nearer than their ends are.
    """
    found: list[Literal["blocked", "near", "clear"]] = []
    for rows, kept in zip(several, room.look([Track(rows) for rows in several]), strict=True):
        if isinstance(kept, Hit):
            found.append("blocked")
        else:
            near = kept < room.margin and kept < room.gaps(rows).min() - _AS_NEAR_MM
            found.append("near" if near else "clear")
    return found


def _without(work: _Work, lost: set[int]) -> _Work:
    """The others alone, with all that is known of them."""
    kept = [k for k in range(len(work.motions)) if k not in lost]
    at = np.array([2 * k + end for k in kept for end in (0, 1)])
    ends, square, all_of = work.ends, np.ix_(at, at), np.ix_([*at, -1], [*at, -1])
    places = ends.joints[at], ends.safe[at], ends.out[at]
    ends = links.Ends(
        *places, ends.free[square], ends.direct[square], ends.through[kept], ends.speed
    )
    return _Work(
        room=work.room,
        motions=tuple(work.motions[k] for k in kept),
        out=tuple(work.out[k] for k in at),
        ends=ends,
        at_part=links.along(ends),
        home=work.home,
        to_home=work.to_home[at],
        known=_Known(work.known.blocked[all_of], work.known.clear[all_of], work.known.near[all_of]),
    )


def _vertices(motion: Reached, edge: Line) -> FloatArray:
    """(2, 3) where the edge starts and ends as it is run, NaN where the motion does not go so far."""
    ends = edge.points[[-1, 0] if motion.backwards else [0, -1]].copy()
    ends[np.array(motion.trimmed) > 0] = np.nan
    return np.asarray(ends)


def _order(work: _Work, best: bool, rounds: int, tell: Callable[[str], None]) -> _Found:
    """The tour, all its links tested unless they are infinite. After so many rounds what is known to be clear alone is
    taken.
    """
    effort, surely = _QUICK, False
    order: matrix.Order | None = None
    for attempt in count():
        tell(f"{counted(len(work.motions), 'edge')}, tour {attempt + 1}")
        if attempt == rounds:
            surely = True
            _test_home(work)
        between, first, home = _steps(work, surely)
        ends = _in_ticks(home + work.ends.out).reshape(-1, 2)
        between = _in_ticks(between).reshape(len(work.motions), 2, -1, 2)
        table = matrix.Table(between, ends, ends)
        near = matrix.nearest(table)
        # A large tour goes on from the last one, of which little has changed.
        start = order if len(work.motions) > links.MANY else None
        order = matrix.shortest(table, effort=effort, start=start) if best else near
        costs = [matrix.total(table, *one) for one in (order, near)]
        if not surely and _collides(work, order, first):
            continue
        if effort == _FULL:
            return _Found(order, first, *(_bare(cost) for cost in costs))
        effort = _FULL
    raise AssertionError("every round tests at least one motion more")


def _bare(seconds: float) -> float:
    """The time of a tour without what is added to links that come near."""
    return math.fmod(seconds, _NEAR) if math.isfinite(seconds) else seconds


def _steps(work: _Work, surely: bool) -> tuple[FloatArray, IntArray, FloatArray]:
    """What ``links.steps`` says of the links, and s home (2 n,), infinite where that collides; with more for those that
    come near. surely: whatever has not been tested is taken to collide.
    """
    known = work.known
    blocked, more = ~known.clear if surely else known.blocked, _NEAR * known.near
    home = np.where(blocked[:-1, -1], math.inf, work.to_home + more[:-1, -1])
    ends = replace(work.ends, free=work.ends.free + more[:-1, :-1])
    return *links.steps(ends, work.at_part, blocked[:-1, :-1], home), home


def _in_ticks(seconds: FloatArray) -> FloatArray:
    """Times whose sums are exact in any order: tours of the same links are equally long then, and which of them is
    taken does not hang on the last bit, in which processors differ.
    """
    return np.asarray(np.rint(seconds / _TICK) * _TICK)


def _collides(work: _Work, order: matrix.Order, first: IntArray) -> bool:
    """Test the free motions of the tour that are not known yet. Does one collide?"""
    states = _states(order)
    pairs = {(states[0][0], -1), (states[-1][1], -1)}
    for (_, a), (b, _) in pairwise(states):
        if first[a, b] == links.FREE:
            pairs.add((max(a, b), min(a, b)))
        elif first[a, b] == links.BY_HOME:
            pairs |= {(a, -1), (b, -1)}
    return _test(work, pairs)


def _test(work: _Work, pairs: set[tuple[int, int]]) -> bool:
    """Test the free motions ``pairs`` of ends, -1 for home, that are not known yet. Does one collide or come near?"""
    known, safe = work.known, work.ends.safe
    new = [pair for pair in sorted(pairs) if not (known.clear[pair] or known.blocked[pair])]
    seen = _look(work.room, [np.stack([safe[a], work.home if b < 0 else safe[b]]) for a, b in new])
    for (a, b), what in zip(new, seen, strict=True):
        table = known.blocked if what == "blocked" else known.clear
        table[a, b] = table[b, a] = True
        known.near[a, b] = known.near[b, a] = what == "near"
    return any(what != "clear" for what in seen)


def _test_home(work: _Work) -> None:
    """Test all ways home that are not known yet."""
    _test(work, {(end, -1) for end in range(len(work.to_home))})


def _find_lost(work: _Work, found: _Found, strictly: bool) -> set[int]:
    """The motions to which the tour has no finite link; not those behind one of them, to which another may lead.
    strictly: and those from whose ends the way home is not known to be clear.
    """
    if math.isfinite(found.seconds):
        return set()
    if strictly:
        _test_home(work)
    states = _states(found.order)
    between, _, home = _steps(work, surely=True)
    away = np.isinf(home)
    lost = {states[0][0] // 2} if away[states[0][0]] else set()
    lost |= {states[-1][1] // 2} if away[states[-1][1]] else set()
    for (_, a), (b, _) in pairwise(states):
        if math.isinf(between[a, b]) and a // 2 not in lost:
            # One of both cannot go home, or the link would lead there.
            lost.add(b // 2 if away[b] else a // 2)
    return lost | {end // 2 for end in np.flatnonzero(away).tolist()} if strictly else lost


def _time_home(robot: Robot, out: Retraction, home: FloatArray, speeds: LinkSpeeds) -> float:
    """Seconds from the end of a way out to home."""
    way = np.concatenate([out.joints[-1:], out.via, home[None]])
    return float(links.seconds(robot, way[:-1], way[1:], speeds.free).sum())


def _search_home(detours: _Detours, work: _Work, motion: int) -> tuple[int, FloatArray] | None:
    """One of the ends of a motion and the way home that a search finds from there, by joint values (K, J). It is done
    once.
    """
    name = work.motions[motion].id
    if name in detours.done:
        return None
    detours.done.add(name)
    found = ((end, detours.lead_home(work.ends.safe[end])) for end in (2 * motion, 2 * motion + 1))
    return next(((end, via) for end, via in found if via is not None and len(via)), None)


def _open(
    work: _Work, opened: Mapping[int, tuple[int, FloatArray]], robot: Robot, speeds: LinkSpeeds
) -> _Work:
    """With the ways home that were found from ends of motions."""
    out, to_home, known = list(work.out), work.to_home.copy(), work.known
    for end, via in opened.values():
        out[end] = replace(out[end], via=via)
        to_home[end] = _time_home(robot, out[end], work.home, speeds)
        known.clear[end, -1] = known.clear[-1, end] = True
        known.blocked[end, -1] = known.blocked[-1, end] = False
        known.near[end, -1] = known.near[-1, end] = False
    return replace(work, out=tuple(out), to_home=to_home)


def _count_searched(work: _Work) -> int:
    """The motions with a way home that was searched for."""
    return sum(
        any(len(one.via) for one in work.out[2 * k : 2 * k + 2]) for k in range(len(work.motions))
    )


def _find_one_sided(work: _Work, motions: Iterable[int]) -> list[int]:
    """The ends of some motions from which the way home collides while that from the other end does not."""
    _test_home(work)
    away = ~work.known.clear[:-1, -1]
    ends = (end for k in sorted(motions) for end in (2 * k, 2 * k + 1))
    return [end for end in ends if away[end] and not away[end ^ 1]]


def _turn_back(work: _Work, turned: Sequence[int], speed: float) -> _Work:
    """Out of each of the ends ``turned`` the way leads back along its motion and then as from the other end."""
    ends, known, out = work.ends, work.known, list(work.out)
    here, there = np.array(turned), np.array(turned) ^ 1
    for end in turned:
        out[end] = links.by_way_of(work.motions[end // 2], end % 2, out[end ^ 1], speed)
    safe, seconds, free, to_home = (
        ends.safe.copy(),
        ends.out.copy(),
        ends.free.copy(),
        work.to_home.copy(),
    )
    safe[here], to_home[here] = safe[there], to_home[there]
    seconds[here] = [out[end].seconds for end in turned]
    for table in (free, known.blocked, known.clear, known.near):
        table[here], table[:, here] = table[there], table[:, there]
        table[here[:, None], here] = table[there[:, None], there]
    return replace(
        work,
        out=tuple(out),
        ends=replace(ends, safe=safe, out=seconds, free=free),
        to_home=to_home,
        known=known,
    )


def _states(order: matrix.Order) -> list[tuple[int, int]]:
    """The end at which each motion is entered and the one at which it is left."""
    return [(2 * i + back, 2 * i + 1 - back) for i, back in zip(*order, strict=True)]


def _pace(
    setup: Setup,
    legs: Sequence[Leg],
    back: tuple[links.Piece, ...],
    home: FloatArray,
    speeds: LinkSpeeds,
) -> tuple[tuple[Leg, ...], tuple[links.Piece, ...]]:
    """The legs and the way back with the speeds of their links."""
    here, found = home, []
    for leg in legs:
        found.append(replace(leg, link=links.paced(setup, leg.link, here, speeds)))
        here = leg.motion.joints[-1]
    return tuple(found), links.paced(setup, back, here, speeds)


def _legs(work: _Work, found: _Found) -> tuple[tuple[Leg, ...], tuple[links.Piece, ...]]:
    legs = []
    before = -1
    for (enter, leave), item, back in zip(_states(found.order), *found.order, strict=True):
        if before < 0:
            out = work.out[enter]
            turns = [links.Turn(joints) for joints in (*out.via[::-1], work.ends.safe[enter])]
            link: tuple[links.Piece, ...] = (*turns, links.entering(out))
        else:
            link = tuple(
                links.pieces(
                    before, enter, work.ends, found.first, work.motions, work.out, work.home
                )
            )
        motion = work.motions[item]
        legs.append(Leg(link, motion.reversed() if back else motion))
        before = leave
    out = work.out[before]
    return tuple(legs), (
        links.leaving(out),
        *(links.Turn(joints) for joints in (*out.via, work.home)),
    )
