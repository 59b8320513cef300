"""One tour over all processing motions, from and back to home (RFA paper, III.C).

Every link of the tour is proved. Only the free motions that the tour takes are tested: a motion
that collides is taken out, and the tour is found again. At last the whole turns of the joints are
chosen along the tour (``turns``).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import count, pairwise
from typing import Literal

import numpy as np
from msgspec import Struct, field
from msgspec.structs import replace

from camgen.model.advice import ANOTHER_PLACE
from camgen.model.part import BoolArray, IntArray, Line
from camgen.model.pose import FloatArray
from camgen.model.text import counted
from camgen.motion.limits import LinkSpeeds
from camgen.motion.pose_paths import PosePath
from camgen.motion.setup import (
    Blockage,
    EdgeMotion,
    FreeSpace,
    SampledMotion,
    Setup,
    UnreachableEdge,
)
from camgen.order.edges import links
from camgen.order.edges.detour import find_detour
from camgen.order.edges.retract import Retraction, retractions, shorter
from camgen.order.edges.turns import find_cheapest, list_turns, turn_motion, turn_retraction
from camgen.order.solver import matrix
from camgen.plan import ignore_stages

#: Ends of edges nearer than this are one vertex, mm.
_VERTEX = 0.01
#: So many tours are found before those motions that still collide are given up, and so many again when motions to
#: which none leads have been left out.
_ROUNDS, _AGAIN = 30, 5
#: After so often motions to which the way home collides are left out too: the others can always be reached by it.
_PASSES = 10
#: Places of a joint motion that are tested before all of it.
_FIRST_PLACES = 11
#: Rounds of tests for other whole turns of the joints.
_TURN_ROUNDS = 6
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
_REMEDY = f"cell.safety or {ANOTHER_PLACE} may help"


class RouteCell(Struct, frozen=True, eq=False):
    """The place in which a route is searched.

    setup: the arm, and the collision test of joint values.
    free_space: the safety level, and the collision test of motions.
    home: (J,) joint values from which the route starts and to which it returns.
    rims: ids of the lines whose own rim may enter the tip of the tool, as ``free_space`` allows.
    strict: ``free_space`` for all other lines; None without rims.
    """

    setup: Setup
    free_space: FreeSpace
    home: FloatArray
    rims: frozenset[str] = frozenset()
    strict: FreeSpace | None = None

    @property
    def spaces(self) -> tuple[FreeSpace, ...]:
        """The free spaces of all motions."""
        return (self.free_space,) if self.strict is None else (self.free_space, self.strict)

    def space_of(self, *motions: EdgeMotion) -> FreeSpace:
        """The free space of the retractions and links of some motions."""
        if self.strict is None or any(motion.line in self.rims for motion in motions):
            return self.free_space
        return self.strict


class RouteOptions(Struct, frozen=True):
    """The settings of a job for its links.

    speeds: speeds of the links.
    best: whether the shortest tour is searched for; else the nearest neighbour is next.
    lifted: whether each link leaves the part, as a tool that presses has to.
    barred: pairs of motions, by their ids, between which no link stays at the part.
    """

    speeds: LinkSpeeds
    best: bool
    lifted: bool = False
    barred: frozenset[frozenset[str]] = frozenset()


class Leg(Struct, frozen=True, eq=False):
    """A processing motion and the link that leads to it."""

    link: tuple[links.Piece, ...]
    motion: EdgeMotion


class Route(Struct, frozen=True, eq=False):
    """A tour over processing motions with all its links.

    legs: motions in order, each with the link to it.
    back: link from the last motion to home.
    dropped: motions to which no free motion leads.
    seconds: time of all links at the speeds of joints and travel, s.
    nearest: the same time of the nearest neighbour's order of the paper, s.
    searched: number of motions whose motion home was found by a search.
    """

    legs: tuple[Leg, ...]
    back: tuple[links.Piece, ...]
    dropped: tuple[UnreachableEdge, ...]
    seconds: float
    nearest: float
    searched: int = 0


class _TestedLinks(Struct, eq=False):
    """The results of all collision tests so far, (2 n + 1, 2 n + 1) from end to end, home last.

    blocked: whether the motion collides.
    clear: whether it is tested and does not collide.
    near: whether it is clear and comes nearer than the margin.
    """

    blocked: BoolArray
    clear: BoolArray
    near: BoolArray


class _RouteProblem(Struct, frozen=True, eq=False):
    """All that the search of a route knows.

    cell: the place.
    motions: n motions that can be left at both ends.
    out: (2 n) retraction of each end.
    ends: joint values and link times of the ends.
    at_part: result of ``links.along``.
    to_home: (2 n,) time from free space to home, s.
    tested: results of the collision tests, which grow.
    """

    cell: RouteCell
    motions: tuple[EdgeMotion, ...]
    out: tuple[Retraction, ...]
    ends: links.MotionEnds
    at_part: tuple[FloatArray, IntArray]
    to_home: FloatArray
    tested: _TestedLinks


class _TourCandidate(Struct, frozen=True, eq=False):
    """A tour before its links are known to be clear.

    order: order and directions of the motions.
    first: how each link begins, result of ``links.steps``.
    seconds: time of its links, s.
    nearest: the same time of the nearest neighbour's order, s.
    """

    order: matrix.Order
    first: IntArray
    seconds: float
    nearest: float


def route(
    cell: RouteCell,
    motions: Sequence[EdgeMotion],
    edges: Sequence[Line],
    options: RouteOptions,
    tell: Callable[[str], None] = ignore_stages,
) -> Route:
    """The tour over ``motions`` along ``edges``, one each, from and back to home.

    tell: callback that gets the progress of the search.

    The search ends after at most ``_ROUNDS`` and ``_PASSES`` times ``_AGAIN`` tours, and a few.
    """
    by_id = {edge.id: edge for edge in edges}
    detours = _Detours(cell)
    left, outs, dropped = _left(detours, motions, options.speeds)
    if not left:
        return Route((), (), tuple(dropped), 0.0, 0.0)
    problem = _make_problem(cell, left, outs, [by_id[motion.line] for motion in left], options)
    for attempt in count():
        candidate = _order(problem, options.best, _AGAIN if attempt else _ROUNDS, tell)
        lost = _find_lost(problem, candidate, attempt >= _PASSES)
        if not lost:
            problem, candidate = _choose_turns(problem, candidate, options.speeds)
            legs, back = _pace(cell, *_legs(problem, candidate), options.speeds)
            return Route(
                legs,
                back,
                tuple(dropped),
                candidate.seconds,
                candidate.nearest,
                _count_searched(problem),
            )
        if turned := _find_one_sided(problem, lost):
            problem = _turn_back(problem, turned, options.speeds)
            continue
        if turned_motions := _turn_lost(detours, problem, lost):
            lines = [by_id[motion.line] for motion in problem.motions]
            problem = _make_problem(cell, *turned_motions, lines, options)
            continue
        tell(f"{counted(len(problem.motions), 'edge')}, ways round what stands between")
        opened = _search_homes(detours, problem, lost)
        if opened:
            problem = _open(problem, opened, options.speeds)
            continue
        names = [problem.motions[k].id for k in sorted(lost)]
        dropped += [
            UnreachableEdge(name, "collision", "no free motion leads to it", _REMEDY)
            for name in names
        ]
        if len(lost) == len(problem.motions):
            return Route((), (), tuple(dropped), 0.0, 0.0)
        problem = _without(problem, lost)
    raise AssertionError("every attempt leaves at least one motion out")


class _Detours(Struct, eq=False):
    """The search for detours to home.

    cell: the place.
    fruitless: number of searches that found no detour.
    done: ids of the motions from whose ends a detour was searched.
    turned: ids of the motions whose whole turns were tried.
    """

    cell: RouteCell
    fruitless: int = 0
    done: set[str] = field(default_factory=set)
    turned: set[str] = field(default_factory=set)

    def lead_home(self, joints: FloatArray) -> FloatArray | None:
        """By way of which joint values (K, J) the joints go home from ``joints`` (J,); None where no way is found."""
        if self.fruitless >= _FRUITLESS:
            return None
        way = find_detour(self.cell.setup, self.cell.free_space, joints, self.cell.home)
        self.fruitless += way is None
        return None if way is None else way[1:-1]


def _left(
    detours: _Detours, motions: Sequence[EdgeMotion], speeds: LinkSpeeds
) -> tuple[list[EdgeMotion], list[Retraction], list[UnreachableEdge]]:
    """The motions with a way out of both ends, the two ways of each, and those without any."""
    kept: list[EdgeMotion] = []
    outs: list[Retraction] = []
    dropped: list[UnreachableEdge] = []
    for motion, both in zip(motions, _retract(detours.cell, motions, speeds), strict=True):
        texts = [one for one in both if isinstance(one, str)]
        pair = both
        if len(texts) == 2:
            space = detours.cell.space_of(motion)
            pair = [_search_out(detours, space, end, speeds) or texts[0] for end in _ends(motion)]
        if isinstance(pair[0], str) and isinstance(pair[1], str):
            dropped.append(
                UnreachableEdge(motion.id, "collision", f"no way back from it: {texts[0]}", _REMEDY)
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


def _retract(
    cell: RouteCell, motions: Sequence[EdgeMotion], speeds: LinkSpeeds
) -> list[list[Retraction | str]]:
    """The retractions of both ends of each motion, or the reasons against them."""
    found: list[list[Retraction | str]] = [[] for _ in motions]
    for space in cell.spaces:
        chosen = [k for k, motion in enumerate(motions) if cell.space_of(motion) is space]
        ends: list[tuple[PosePath, FloatArray]] = []
        for k in chosen:
            ends += _ends(motions[k])
        results = retractions(cell.setup, space, ends, speeds) if chosen else []
        for k, *both in zip(chosen, results[::2], results[1::2], strict=True):
            found[k] = both
    return found


def _ends(motion: EdgeMotion) -> tuple[tuple[PosePath, FloatArray], tuple[PosePath, FloatArray]]:
    """Where the motion begins and where it ends, each with its joints."""
    return (_row(motion.way, 0), motion.joints[0]), (_row(motion.way, -1), motion.joints[-1])


def _search_out(
    detours: _Detours, space: FreeSpace, end: tuple[PosePath, FloatArray], speeds: LinkSpeeds
) -> Retraction | None:
    """A way out of one end and home that is no way of RFA's: back a little, and from there as a search finds it."""
    out = shorter(detours.cell.setup, space, *end, speeds)
    via = None if out is None else detours.lead_home(out.joints[-1])
    return None if out is None or via is None else replace(out, via=via)


def _row(way: PosePath, k: int) -> PosePath:
    return PosePath(way.position[[k]], np.full((1, 3), np.nan), way.rotation[[k]])


def _make_problem(
    cell: RouteCell,
    motions: Sequence[EdgeMotion],
    outs: Sequence[Retraction],
    edges: Sequence[Line],
    options: RouteOptions,
) -> _RouteProblem:
    """The problem with the times of all links, the direct ones tested."""
    setup, home = cell.setup, cell.home
    speed = options.speeds.part
    joints = np.concatenate([motion.joints[[0, -1]] for motion in motions])
    safe = np.stack([out.joints[-1] for out in outs])
    out = np.array([out.time(options.speeds) for out in outs])
    lengths = np.array([motion.way.length.sum() for motion in motions])
    through = options.speeds.time_tool(lengths, speed)
    free = links.seconds(setup, safe[:, None], safe[None], options.speeds)
    vertices = np.concatenate(
        [_vertices(motion, edge) for motion, edge in zip(motions, edges, strict=True)]
    )
    direct = links.seconds(setup, joints[:, None], joints[None], options.speeds, at_part=True)
    direct[options.lifted | ~links.distinct(vertices, _VERTEX)] = math.inf
    direct[direct >= free + out[:, None] + out[None]] = math.inf
    number = {motion.id: k for k, motion in enumerate(motions)}
    for pair in options.barred:
        if pair <= number.keys():
            first, second = (slice(2 * number[name], 2 * number[name] + 2) for name in pair)
            direct[first, second] = direct[second, first] = math.inf
    near = np.argwhere(np.triu(np.isfinite(direct)))
    looks = [(joints[[a, b]], (motions[a // 2], motions[b // 2])) for a, b in near.tolist()]
    for (a, b), seen in zip(near.tolist(), _look(cell, looks), strict=True):
        if seen != "clear":
            direct[a, b] = direct[b, a] = math.inf if seen == "blocked" else direct[a, b] + _NEAR
    ends = links.MotionEnds(joints, safe, out, free, direct, through, speed)
    to_home = links.seconds(setup, safe, home[None], options.speeds)
    size = (len(joints) + 1,) * 2
    tested = _TestedLinks(*(np.zeros(size, dtype=bool) for _ in range(3)))
    for end in (k for k, one in enumerate(outs) if len(one.via)):
        to_home[end] = _time_home(setup, outs[end], home, options.speeds)
        tested.clear[end, -1] = tested.clear[-1, end] = True
    return _RouteProblem(
        cell, tuple(motions), tuple(outs), ends, links.along(ends), to_home, tested
    )


_Verdict = Literal["blocked", "near", "clear"]


def _look(
    cell: RouteCell, several: Sequence[tuple[FloatArray, tuple[EdgeMotion, ...]]]
) -> list[_Verdict]:
    """The verdicts on joint motions: near are those that come nearer than the margin, and nearer
    than their ends are.

    several: two rows of joint values (2, J) of each, and the motions that it links.
    """
    if not several:
        return []
    shares = np.linspace(0.0, 1.0, _FIRST_PLACES)[:, None]
    places = np.stack([(1 - shares) * rows[0] + shares * rows[1] for rows, _ in several])
    free = np.asarray(cell.setup.clear(places.reshape(-1, places.shape[-1])))
    all_free = np.asarray(free.reshape(places.shape[:2]).all(axis=1))
    verdicts: list[_Verdict] = ["clear" if is_free else "blocked" for is_free in all_free.tolist()]
    for space in cell.spaces:
        chosen = [
            k
            for k, (_, linked) in enumerate(several)
            if verdicts[k] == "clear" and cell.space_of(*linked) is space
        ]
        looks = space.look([SampledMotion(several[k][0]) for k in chosen])
        for k, kept in zip(chosen, looks, strict=True):
            if isinstance(kept, Blockage):
                verdicts[k] = "blocked"
            elif kept < space.margin and kept < space.gaps(several[k][0]).min() - _AS_NEAR_MM:
                verdicts[k] = "near"
    return verdicts


def _without(problem: _RouteProblem, lost: set[int]) -> _RouteProblem:
    """The others alone, with all that is known of them."""
    kept = [k for k in range(len(problem.motions)) if k not in lost]
    at = np.array([2 * k + end for k in kept for end in (0, 1)])
    ends, square, all_of = problem.ends, np.ix_(at, at), np.ix_([*at, -1], [*at, -1])
    places = ends.joints[at], ends.safe[at], ends.out[at]
    ends = links.MotionEnds(
        *places, ends.free[square], ends.direct[square], ends.through[kept], ends.speed
    )
    return _RouteProblem(
        cell=problem.cell,
        motions=tuple(problem.motions[k] for k in kept),
        out=tuple(problem.out[k] for k in at),
        ends=ends,
        at_part=links.along(ends),
        to_home=problem.to_home[at],
        tested=_TestedLinks(
            problem.tested.blocked[all_of],
            problem.tested.clear[all_of],
            problem.tested.near[all_of],
        ),
    )


def _vertices(motion: EdgeMotion, edge: Line) -> FloatArray:
    """(2, 3) where the edge starts and ends as it is run, NaN where the motion does not go so far."""
    ends = edge.points[[-1, 0] if motion.backwards else [0, -1]].copy()
    ends[np.array(motion.trimmed) != 0] = np.nan
    return np.asarray(ends)


def _order(
    problem: _RouteProblem, best: bool, rounds: int, tell: Callable[[str], None]
) -> _TourCandidate:
    """The tour, all its links tested unless they are infinite. After so many rounds what is known to be clear alone is
    taken.
    """
    effort, surely = _QUICK, False
    order: matrix.Order | None = None
    for attempt in count():
        tell(f"{counted(len(problem.motions), 'edge')}, tour {attempt + 1}")
        if attempt == rounds:
            surely = True
            _test_home(problem)
        between, first, home = _steps(problem, surely)
        ends = _in_ticks(home + problem.ends.out).reshape(-1, 2)
        between = _in_ticks(between).reshape(len(problem.motions), 2, -1, 2)
        table = matrix.Table(between, ends, ends)
        near = matrix.nearest(table)
        # A large tour goes on from the last one, of which little has changed.
        start = order if len(problem.motions) > links.MANY else None
        order = matrix.shortest(table, effort=effort, start=start) if best else near
        costs = [matrix.total(table, *one) for one in (order, near)]
        if not surely and _collides(problem, order, first):
            continue
        if effort == _FULL:
            return _TourCandidate(order, first, *(_bare(cost) for cost in costs))
        effort = _FULL
    raise AssertionError("every round tests at least one motion more")


def _bare(seconds: float) -> float:
    """The time of a tour without what is added to links that come near."""
    return math.fmod(seconds, _NEAR) if math.isfinite(seconds) else seconds


def _steps(problem: _RouteProblem, surely: bool) -> tuple[FloatArray, IntArray, FloatArray]:
    """What ``links.steps`` says of the links, and s home (2 n,), infinite where that collides; with more for those that
    come near. surely: whatever has not been tested is taken to collide.
    """
    tested = problem.tested
    blocked, more = ~tested.clear if surely else tested.blocked, _NEAR * tested.near
    home = np.where(blocked[:-1, -1], math.inf, problem.to_home + more[:-1, -1])
    ends = replace(problem.ends, free=problem.ends.free + more[:-1, :-1])
    return *links.steps(ends, problem.at_part, blocked[:-1, :-1], home), home


def _in_ticks(seconds: FloatArray) -> FloatArray:
    """Times whose sums are exact in any order: tours of the same links are equally long then, and which of them is
    taken does not hang on the last bit, in which processors differ.
    """
    return np.asarray(np.rint(seconds / _TICK) * _TICK)


def _collides(problem: _RouteProblem, order: matrix.Order, first: IntArray) -> bool:
    """Test the free motions of the tour that are not known yet. Does one collide?"""
    states = _states(order)
    pairs = {(states[0][0], -1), (states[-1][1], -1)}
    for (_, a), (b, _) in pairwise(states):
        if first[a, b] == links.FREE:
            pairs.add((max(a, b), min(a, b)))
        elif first[a, b] == links.BY_HOME:
            pairs |= {(a, -1), (b, -1)}
    return _test(problem, pairs)


def _test(problem: _RouteProblem, pairs: set[tuple[int, int]]) -> bool:
    """Test the free motions ``pairs`` of ends, -1 for home, that are not known yet. Does one collide or come near?"""
    tested, safe, motions = problem.tested, problem.ends.safe, problem.motions
    new = [pair for pair in sorted(pairs) if not (tested.clear[pair] or tested.blocked[pair])]
    looks = [
        (
            np.stack([safe[a], problem.cell.home if b < 0 else safe[b]]),
            tuple(motions[end // 2] for end in (a, b) if end >= 0),
        )
        for a, b in new
    ]
    seen = _look(problem.cell, looks)
    for (a, b), what in zip(new, seen, strict=True):
        table = tested.blocked if what == "blocked" else tested.clear
        table[a, b] = table[b, a] = True
        tested.near[a, b] = tested.near[b, a] = what == "near"
    return any(what != "clear" for what in seen)


def _test_home(problem: _RouteProblem) -> None:
    """Test all ways home that are not known yet."""
    _test(problem, {(end, -1) for end in range(len(problem.to_home))})


def _find_lost(problem: _RouteProblem, candidate: _TourCandidate, strictly: bool) -> set[int]:
    """The motions to which the tour has no finite link; not those behind one of them, to which another may lead.
    strictly: and those from whose ends the way home is not known to be clear.
    """
    if math.isfinite(candidate.seconds):
        return set()
    if strictly:
        _test_home(problem)
    states = _states(candidate.order)
    between, _, home = _steps(problem, surely=True)
    away = np.isinf(home)
    lost = {states[0][0] // 2} if away[states[0][0]] else set()
    lost |= {states[-1][1] // 2} if away[states[-1][1]] else set()
    for (_, a), (b, _) in pairwise(states):
        if math.isinf(between[a, b]) and a // 2 not in lost:
            # One of both cannot go home, or the link would lead there.
            lost.add(b // 2 if away[b] else a // 2)
    return lost | {end // 2 for end in np.flatnonzero(away).tolist()} if strictly else lost


def _time_home(setup: Setup, out: Retraction, home: FloatArray, speeds: LinkSpeeds) -> float:
    """Seconds from the end of a way out to home."""
    way = np.concatenate([out.joints[-1:], out.via, home[None]])
    return float(links.seconds(setup, way[:-1], way[1:], speeds).sum())


def _search_homes(
    detours: _Detours, problem: _RouteProblem, lost: Iterable[int]
) -> dict[int, FloatArray]:
    """Detours to home for the motions ``lost``: by an end of each, the joint values (K, J)."""
    opened = {}
    for motion in sorted(lost):
        name = problem.motions[motion].id
        if name in detours.done:
            continue
        detours.done.add(name)
        for end in (2 * motion, 2 * motion + 1):
            via = detours.lead_home(problem.ends.safe[end])
            if via is not None and len(via):
                opened[end] = via
                break
    return opened


def _open(
    problem: _RouteProblem, opened: Mapping[int, FloatArray], speeds: LinkSpeeds
) -> _RouteProblem:
    """With the ways home that were found from ends of motions."""
    out, to_home, tested = list(problem.out), problem.to_home.copy(), problem.tested
    for end, via in opened.items():
        out[end] = replace(out[end], via=via)
        to_home[end] = _time_home(problem.cell.setup, out[end], problem.cell.home, speeds)
        tested.clear[end, -1] = tested.clear[-1, end] = True
        tested.blocked[end, -1] = tested.blocked[-1, end] = False
        tested.near[end, -1] = tested.near[-1, end] = False
    return replace(problem, out=tuple(out), to_home=to_home)


def _count_searched(problem: _RouteProblem) -> int:
    """The motions with a way home that was searched for."""
    return sum(
        any(len(one.via) for one in problem.out[2 * k : 2 * k + 2])
        for k in range(len(problem.motions))
    )


def _turn_lost(
    detours: _Detours, problem: _RouteProblem, lost: Iterable[int]
) -> tuple[list[EdgeMotion], list[Retraction]] | None:
    """All motions and retractions, those of ``lost`` moved by whole turns that lead home.

    None if no turns do.
    """
    cell, motions, outs = problem.cell, list(problem.motions), list(problem.out)
    turned = False
    for number in sorted(lost):
        motion, both = motions[number], outs[2 * number : 2 * number + 2]
        if motion.id in detours.turned or any(len(out.via) for out in both):
            continue
        detours.turned.add(motion.id)
        joints = np.concatenate([motion.dense, both[0].dense, both[1].dense])
        table = list_turns(cell.setup.robot, joints, cell.home)[1:]
        looks = []
        for whole, out in itertools.product(table, both):
            looks.append((np.stack([out.joints[-1] + math.tau * whole, cell.home]), (motion,)))
        verdicts = _look(cell, looks)
        if "clear" in verdicts:
            whole = table[verdicts.index("clear") // 2]
            motions[number] = turn_motion(motion, whole)
            outs[2 * number : 2 * number + 2] = [turn_retraction(out, whole) for out in both]
            turned = True
    return (motions, outs) if turned else None


class _Block(Struct, frozen=True, eq=False):
    """Motions of a tour between which the tool stays at the part: they turn together.

    enter, leave: ends at which it begins and ends.
    motions: numbers of the motions.
    turns: (T, J) whole turns to choose from; the first row is zero.
    """

    enter: int
    leave: int
    motions: tuple[int, ...]
    turns: IntArray


def _list_blocks(problem: _RouteProblem, candidate: _TourCandidate) -> list[_Block]:
    """The blocks of a tour. Those that need a run along another edge keep their turns."""
    cell, first, states = problem.cell, candidate.first, _states(candidate.order)
    groups, fixed = [[states[0]]], set()
    for before, state in pairwise(states):
        end, goal = before[1], state[0]
        if first[end, goal] < 0:
            groups.append([state])
            continue
        groups[-1].append(state)
        while end != goal:
            following = int(first[end, goal])
            if following == end ^ 1:
                fixed |= {end // 2, state[0] // 2}
            end = following
    blocks = []
    for group in groups:
        enter, leave = group[0][0], group[-1][1]
        motions = tuple(end // 2 for end, _ in group)
        outs = [problem.out[enter], problem.out[leave]]
        joints = [out.dense for out in outs] + [problem.motions[k].dense for k in motions]
        table = list_turns(cell.setup.robot, np.concatenate(joints), cell.home)
        if not fixed.isdisjoint(motions) or any(len(out.via) for out in outs):
            table = table[:1]
        blocks.append(_Block(enter, leave, motions, table))
    return blocks


class _TurnTimes(Struct, frozen=True, eq=False):
    """Times of the joint motions between two stops of a tour, in all turns of both.

    A stop is an end of a motion; -1 is home.

    rows: (T, J) joint values of each stop in free space.
    seconds: (T, U) times of the motions from a stop to another, inf if they collide.
    tested: (T, U) whether each was tested.
    """

    rows: dict[int, FloatArray]
    seconds: dict[tuple[int, int], FloatArray] = field(default_factory=dict)
    tested: dict[tuple[int, int], BoolArray] = field(default_factory=dict)

    def add(self, problem: _RouteProblem, pair: tuple[int, int], speeds: LinkSpeeds) -> None:
        """Adds a pair of stops, with the results that are known without turns."""
        first, second = (self.rows[stop] for stop in pair)
        seconds = links.seconds(problem.cell.setup, first[:, None], second[None], speeds)
        tested = np.zeros(seconds.shape, dtype=np.bool_)
        known = problem.tested
        tested[0, 0] = known.clear[pair] or known.blocked[pair]
        seconds[0, 0] += _NEAR * known.near[pair]
        if known.blocked[pair]:
            seconds[0, 0] = math.inf
        self.seconds[pair], self.tested[pair] = _in_ticks(seconds), tested

    def by_home(self, pair: tuple[int, int]) -> FloatArray:
        """(T, U) times between two stops by way of home."""
        first, second = (self.seconds[stop, -1][:, 0] for stop in pair)
        return np.asarray(first[:, None] + second)

    def between(self, pair: tuple[int, int]) -> FloatArray:
        """(T, U) times between two stops on the faster of both ways."""
        direct = self.seconds[pair]
        return direct if -1 in pair else np.minimum(direct, self.by_home(pair))

    def motions(self, pair: tuple[int, int], turn: tuple[int, int]) -> list[_Turned]:
        """The joint motions of that way, with the turns of both ends."""
        if -1 in pair or self.seconds[pair][turn] <= self.by_home(pair)[turn]:
            return [(pair, turn)]
        return [((stop, -1), (number, 0)) for stop, number in zip(pair, turn, strict=True)]

    def test(self, problem: _RouteProblem, motions: Sequence[_Turned]) -> None:
        """Tests joint motions."""
        looks = []
        for pair, turn in motions:
            rows = np.stack([self.rows[stop][k] for stop, k in zip(pair, turn, strict=True)])
            linked = tuple(problem.motions[stop // 2] for stop in pair if stop >= 0)
            looks.append((rows, linked))
        for (pair, turn), verdict in zip(motions, _look(problem.cell, looks), strict=True):
            self.tested[pair][turn] = True
            self.seconds[pair][turn] += {"clear": 0.0, "near": _NEAR, "blocked": math.inf}[verdict]

    def block_untested(self) -> None:
        """Counts motions that were not tested as blocked."""
        for pair, tested in self.tested.items():
            self.seconds[pair][~tested] = math.inf


#: Two stops, and the numbers of their turns.
_Turned = tuple[tuple[int, int], tuple[int, int]]


def _choose_turns(
    problem: _RouteProblem, candidate: _TourCandidate, speeds: LinkSpeeds
) -> tuple[_RouteProblem, _TourCandidate]:
    """The problem and the tour with the whole turns of its motions that take least time."""
    blocks = _list_blocks(problem, candidate)
    if all(len(block.turns) == 1 for block in blocks):
        return problem, candidate
    rows = {-1: problem.cell.home[None]}
    for block in blocks:
        for end in (block.enter, block.leave):
            rows[end] = problem.ends.safe[end] + math.tau * block.turns
    times = _TurnTimes(rows)
    inner = [(a.leave, b.enter) for a, b in pairwise(blocks)]
    pairs = [(blocks[0].enter, -1), *inner, (blocks[-1].leave, -1)]
    for pair in {*pairs, *((end, -1) for end in rows if end >= 0)}:
        times.add(problem, pair, speeds)
    chosen, motions, saved = _find_turns(problem, times, pairs)
    if not any(chosen):
        return problem, candidate
    first = candidate.first.copy()
    for pair in inner:
        first[pair] = links.FREE if pair in motions else links.BY_HOME
    turned = _turn(problem, blocks, chosen)
    return turned, replace(candidate, first=first, seconds=candidate.seconds - saved)


def _find_turns(
    problem: _RouteProblem, times: _TurnTimes, pairs: Sequence[tuple[int, int]]
) -> tuple[list[int], set[tuple[int, int]], float]:
    """The numbers of the turns with the least time, with all motions between them tested.

    Returns them, the stops between which the joints move, and the time that is saved, s. After
    `_TURN_ROUNDS` rounds motions that were not tested count as blocked.

    pairs: ends of the links, in order.
    """
    for attempt in count():
        if attempt == _TURN_ROUNDS:
            times.block_untested()
        tables = [times.between(pair) for pair in pairs]
        chosen, seconds = find_cheapest(tables[0][:, 0], tables[1:-1], tables[-1][:, 0])
        used = [(chosen[0], 0), *pairwise(chosen), (chosen[-1], 0)]
        motions: list[_Turned] = []
        for pair, turn in zip(pairs, used, strict=True):
            motions += times.motions(pair, turn)
        new = [(pair, turn) for pair, turn in motions if not times.tested[pair][turn]]
        if not new:
            before = sum(float(table[0, 0]) for table in tables)
            return chosen, {pair for pair, _ in motions}, _bare(before) - _bare(seconds)
        times.test(problem, new)
    raise AssertionError("the motions of the tour itself are tested")


def _turn(problem: _RouteProblem, blocks: Sequence[_Block], chosen: Sequence[int]) -> _RouteProblem:
    """The problem with the blocks in the turns of these numbers."""
    motions, outs, ends = list(problem.motions), list(problem.out), problem.ends
    joints, safe = ends.joints.copy(), ends.safe.copy()
    for block, number in zip(blocks, chosen, strict=True):
        whole = block.turns[number]
        for k in block.motions:
            motions[k] = turn_motion(motions[k], whole)
            joints[2 * k : 2 * k + 2] += math.tau * whole
        for end in {block.enter, block.leave} if whole.any() else ():
            outs[end] = turn_retraction(outs[end], whole)
            safe[end] += math.tau * whole
    return replace(
        problem,
        motions=tuple(motions),
        out=tuple(outs),
        ends=replace(ends, joints=joints, safe=safe),
    )


def _find_one_sided(problem: _RouteProblem, motions: Iterable[int]) -> list[int]:
    """The ends of some motions from which the way home collides while that from the other end does not."""
    _test_home(problem)
    away = ~problem.tested.clear[:-1, -1]
    ends = (end for k in sorted(motions) for end in (2 * k, 2 * k + 1))
    return [end for end in ends if away[end] and not away[end ^ 1]]


def _turn_back(problem: _RouteProblem, turned: Sequence[int], speeds: LinkSpeeds) -> _RouteProblem:
    """Out of each of the ends ``turned`` the way leads back along its motion and then as from the other end."""
    ends, tested, out = problem.ends, problem.tested, list(problem.out)
    here, there = np.array(turned), np.array(turned) ^ 1
    for end in turned:
        out[end] = links.by_way_of(problem.motions[end // 2], end % 2, out[end ^ 1], speeds.part)
    safe, seconds, free, to_home = (
        ends.safe.copy(),
        ends.out.copy(),
        ends.free.copy(),
        problem.to_home.copy(),
    )
    safe[here], to_home[here] = safe[there], to_home[there]
    seconds[here] = [out[end].time(speeds) for end in turned]
    for table in (free, tested.blocked, tested.clear, tested.near):
        table[here], table[:, here] = table[there], table[:, there]
        table[here[:, None], here] = table[there[:, None], there]
    return replace(
        problem,
        out=tuple(out),
        ends=replace(ends, safe=safe, out=seconds, free=free),
        to_home=to_home,
        tested=tested,
    )


def _states(order: matrix.Order) -> list[tuple[int, int]]:
    """The end at which each motion is entered and the one at which it is left."""
    return [(2 * i + back, 2 * i + 1 - back) for i, back in zip(*order, strict=True)]


def _pace(
    cell: RouteCell, legs: Sequence[Leg], back: tuple[links.Piece, ...], speeds: LinkSpeeds
) -> tuple[tuple[Leg, ...], tuple[links.Piece, ...]]:
    """The legs and the link to home with the speeds of their links."""
    start, paced = cell.home, []
    for leg in legs:
        paced.append(replace(leg, link=links.paced(cell.setup, leg.link, start, speeds)))
        start = leg.motion.joints[-1]
    return tuple(paced), links.paced(cell.setup, back, start, speeds)


def _legs(
    problem: _RouteProblem, candidate: _TourCandidate
) -> tuple[tuple[Leg, ...], tuple[links.Piece, ...]]:
    """The motions with their links, and the link to home."""
    legs = []
    before = -1
    for (enter, leave), item, back in zip(_states(candidate.order), *candidate.order, strict=True):
        if before < 0:
            out = problem.out[enter]
            rows = (*out.via[::-1], problem.ends.safe[enter])
            link: list[links.Piece] = [*map(links.JointLink, rows), links.entering(out)]
        else:
            link = list(_link(problem, candidate.first, before, enter))
        motion = problem.motions[item]
        legs.append(Leg(tuple(link), motion.reversed() if back else motion))
        before = leave
    out = problem.out[before]
    rows = (*out.via, problem.cell.home)
    return tuple(legs), (links.leaving(out), *map(links.JointLink, rows))


def _link(problem: _RouteProblem, first: IntArray, a: int, b: int) -> Iterator[links.Piece]:
    """The motions of the link from end ``a`` to end ``b``. first: result of ``links.steps``."""
    ends, out = problem.ends, problem.out
    if first[a, b] < 0:
        yield links.leaving(out[a])
        if first[a, b] == links.BY_HOME:
            rows = (*out[a].via, problem.cell.home, *out[b].via[::-1])
            yield from map(links.JointLink, rows)
        yield links.JointLink(ends.safe[b])
        yield links.entering(out[b])
        return
    while a != b:
        next_end = int(first[a, b])
        if next_end == a ^ 1:
            motion = problem.motions[a // 2]
            motion = motion if a % 2 == 0 else motion.reversed()
            speed = np.full(len(motion.way) - 1, ends.speed)
            yield links.PathLink(motion.way, motion.joints, speed, "shared edge")
        else:
            yield links.JointLink(ends.joints[next_end], free=False)
        a = next_end
