"""Tool paths as items of the search for a short tour: samples of closed ones before it, exact starts after it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from camgen.geometry.nearest import find_nearest_items
from camgen.geometry.ragged import offsets, owners, ramp
from camgen.geometry.vectors import plane_lengths
from camgen.model.part import IntArray
from camgen.model.path import ToolPath
from camgen.model.pose import FloatArray
from camgen.model.tolerance import NONZERO
from camgen.order.solver.bound import Dense, at_least
from camgen.order.solver.greedy import join_greedily
from camgen.order.solver.kernel import BOTH_WAYS, CLOSED, ONE_WAY
from camgen.order.solver.plane import (
    DONE,
    Clock,
    Items,
    Problem,
    Start,
    Tell,
    both_ends,
    discs_of,
    shorten,
)
from camgen.order.solver.speed import available
from camgen.order.solver.together import shorten_together
from camgen.order.starts import Starts
from camgen.plan.starting import SEAM

__all__ = [
    "Choices",
    "Sampled",
    "is_bound_worth",
    "is_compiled",
    "is_crowd",
    "is_large",
    "lower_bound",
    "sample_paths",
    "search",
]

#: Samples of a closed path: at least, at most, and so many on a stretch as long as an item's usual room.
_LEAST_SAMPLES, _MOST_SAMPLES, _SAMPLES_PER_ROOM = 8, 256, 3
#: Near discs that are listed; of these come the near items that are tried.
_NEAR_DISCS = 10
#: Looks without ``tour.seconds``, so that a job gives one result on every machine: so many at each item, at most so
#: many and some more at each. Measured: 0.3 s of plain Python at 1,000 items.
_LOOKS, _MOST_LOOKS, _MORE_LOOKS = 40, 6_000, 1.3
#: The same of the compiled search, used above ``_MANY`` items: below, its start takes longer than what it saves.
_FAST_LOOKS, _MORE_FAST_LOOKS, _MANY = 60_000, 20, 500
#: More looks than any clock lets the search take.
_ENDLESS = 10**15
#: For more than so many items a nearest order is not made where a greedy one can be, which is shorter; and plain Python
#: first shortens that at all items together. (The compiled search does as much in the same time.)
_CROWD = 5_000
#: For more than so many items that is all. Measured against the looks alone: tours are 0 to 16 % shorter, 0.3 % longer
#: at most, and beyond this number found in half the time.
_ALL_TOGETHER = 25_000
#: For more than so many items there is no bound, unless so many seconds for each were asked for.
_MANY_FOR_BOUND, _BOUND_SECONDS = 20_000, 3e-4
#: Trees of the bound: at least and at most; with ``tour.seconds`` as many as take about a fourth of that time, at
#: so many seconds for each tree and item.
_TREES, _TREE = (4, 80), 4e-6
#: Distances that the bound may measure, without and with ``tour.seconds``, and more for each of these.
_CLOSE, _CLOSE_SECOND = (100_000, 6_000_000), 10_000_000
#: Each round moves every start to its best place between its neighbours; so finely, narrowed down so often.
_ROUNDS, _FINER, _NARROWER = 2, 4, 4
#: Closed paths whose starts are moved in one go: so many that they stay in the cache.
_AT_ONCE = 1_000


class Choices(Struct, frozen=True):
    """order: indices of the paths as they are run. row, fraction: by path, where it begins. end: of the search for it,
    see ``plane``.
    """

    order: list[int]
    row: list[int]
    fraction: list[float]
    end: int = DONE


class Sampled(Struct, frozen=True, eq=False):
    """Paths as items. along: (starts + 1,) mm, the lengths of all starts' segments summed up; whole: by path, mm.
    step: by path, mm along it from one sample to the next.
    """

    items: Items
    where: Starts
    along: FloatArray
    whole: FloatArray
    step: FloatArray


def looks(count: int, together: bool) -> int:
    """How many looks at an item the search takes where no seconds are asked for. together: after that was done."""
    if is_compiled(count):
        return _FAST_LOOKS + _MORE_FAST_LOOKS * count
    if together and count > _ALL_TOGETHER:
        return 0
    return round(min(_LOOKS * count, _MOST_LOOKS + _MORE_LOOKS * count))


def is_crowd(count: int) -> bool:
    """Whether there are so many that a nearest order beside another one costs more than it is worth."""
    return count > _CROWD


def is_large(count: int) -> bool:
    """Whether the compiled search looks farther, where it is installed, without ``tour.seconds``."""
    return count > _MANY


def is_compiled(count: int) -> bool:
    """Whether the search without ``tour.seconds`` is the compiled one."""
    return is_large(count) and available()


def sample_paths(
    paths: Sequence[ToolPath], where: Starts, parent: Sequence[int], rank: Sequence[int]
) -> Sampled:
    """The paths as items: ends of open ones, samples of closed ones, evenly along them.

    parent: by path, the one that comes later, or -1. rank: by path, lower ranks come first.
    """
    count = len(paths)
    along = np.concatenate([[0.0], np.cumsum(where.shape.length)])
    whole = along[where.first[1:]] - along[where.first[:-1]]
    rows, closed = (
        np.array([len(path) for path in paths]),
        np.array([path.closed for path in paths]),
    )
    loop = closed & (rows > 1) & (whole > 0)
    lone = (rows == 1) | (closed & ~loop)
    begins, ends = where.begin, where.end
    corners = np.concatenate([begins, ends])
    room = float(
        np.sqrt(max(np.prod(np.ptp(corners, axis=0)), float(np.ptp(corners)) ** 2 / 100) / count)
    )
    samples = np.clip(
        np.ceil(whole * _SAMPLES_PER_ROOM / max(room, NONZERO)), _LEAST_SAMPLES, _MOST_SAMPLES
    ).astype(np.int64)
    samples = np.where(loop, samples, np.where(lone, 1, 2))
    first, owner, step = offsets(samples), owners(samples), ramp(samples)
    points = np.where((step == 0)[:, None], begins[owner], ends[owner])
    step_mm = whole / samples
    both = np.array([path.reversible for path in paths])
    kind = np.where(loop | lone, CLOSED, np.where(both, BOTH_WAYS, ONE_WAY))
    # Between two samples may lie a corner that is no start: so much farther are they apart.
    skipped = (
        np.where(where.span > 0, (1 - where.span) / np.maximum(where.span, NONZERO), 0.0)
        * where.shape.length
    )
    wide = np.maximum.reduceat(skipped, where.first[:-1])
    apart = np.where(loop, step_mm + 2 * wide, 1.0)
    items = Items(
        first, points, kind, apart, np.array(parent, dtype=np.int64), np.array(rank, dtype=np.int64)
    )
    found = Sampled(items, where, along, whole, step_mm)
    inside = loop[owner]
    points[inside] = point_at(found, owner[inside], (step * step_mm[owner])[inside])
    return found


def is_bound_worth(seconds: float, count: int) -> bool:
    """Whether ``lower_bound`` is worth its time: for a crowd only where seconds were asked for."""
    return count <= _MANY_FOR_BOUND or seconds >= _BOUND_SECONDS * count


def lower_bound(
    known: Sampled, home: tuple[float, float] | None, travel: float, seconds: float
) -> float:
    """What no tour of the paths is below, mm. travel: of a tour that is known. seconds: as for the search; without
    them few trees are looked at.
    """
    count = len(known.whole)
    rounds = min(max(10_000 // count, 2), 5)
    if seconds:
        rounds = min(max(round(seconds / 4 / (_TREE * count)), _TREES[0]), _TREES[1])
    place = None if home is None else np.array(home)
    most = round(_CLOSE[1] + _CLOSE_SECOND * seconds) if seconds else _CLOSE[0]
    return at_least(known.items, place, travel, rounds, _dense(known, most))


def _dense(known: Sampled, most: int) -> Dense | None:
    """Points of the items, those of closed ones so close that ``most`` distances measure their near pairs; None where
    these would be too few to tell anything.
    """
    items = known.items
    count = np.diff(items.first)
    loop = (items.kind == CLOSED) & (count > 1)
    each = min(int(math.sqrt(most / (_NEAR_DISCS * len(count)))), _MOST_SAMPLES)
    if each < _LEAST_SAMPLES:
        return None
    samples = np.where(loop, each, count)
    first, owner, place = offsets(samples), owners(samples), ramp(samples)
    inside = loop[owner]
    points = np.empty((len(owner), 2))
    points[~inside] = items.points[~np.repeat(loop, count)]
    length = known.whole / samples
    points[inside] = point_at(known, owner[inside], (place * length[owner])[inside])
    # ``items.step`` counts corners that are no starts as well.
    wide = items.step - known.step + length
    return Dense(first, points, np.where(loop, wide / 2, 0.0))


def search(
    known: Sampled,
    first: Choices | None,
    home: tuple[float, float] | None,
    seed: int,
    tell: Tell | None,
    clock: Clock | None = None,
) -> Choices:
    """A short tour: ``first`` or a greedy one, the shorter one searched; then every start moved to its best point.

    first: None only where ``join_greedily`` gives a tour. tell: who watches, and may stop the search. clock: when to
    end it; None: after ``looks``.
    """
    items = known.items
    count = len(items.kind)
    discs = discs_of(items)
    place = None if home is None else np.array(home)
    problem = Problem(items, find_nearest_items(discs, count, _NEAR_DISCS), place)
    greedy = join_greedily(items, discs, place)
    begun = [Start(np.array(first.order), _enter(known, first))] if first else []
    start = min(
        [*begun, *([greedy] if greedy else [])], key=lambda tour: _travel(items, tour, place)
    )
    together = start is greedy and is_crowd(count) and not is_compiled(count)
    if together:
        start = shorten_together(problem, start)
    budget = looks(count, together) if clock is None else _ENDLESS
    found = shorten(problem, start, budget, seed, tell, clock) if budget else start
    closed = items.kind == CLOSED
    length = np.zeros(count)
    number = found.enter - items.first[:-1]
    length[closed] = (number * known.step)[closed]
    length = polish_starts(known, found, place, length)
    row, fraction = place_starts(known, length)
    turned = ~closed & (number > 0)
    row = np.where(closed, row, np.where(turned, known.where.row[known.where.first[1:] - 1], 0))
    return Choices(
        found.order.tolist(), row.tolist(), np.where(closed, fraction, 0.0).tolist(), found.end
    )


def _travel(items: Items, tour: Start, home: FloatArray | None) -> float:
    """Between the items, from and to home, mm."""
    leave = np.where(items.kind == CLOSED, tour.enter, both_ends(items) - tour.enter)
    begins, ends = items.points[tour.enter[tour.order]], items.points[leave[tour.order]]
    if home is not None:
        begins, ends = np.concatenate([begins, home[None]]), np.concatenate([home[None], ends])
    else:
        begins, ends = begins[1:], ends[:-1]
    return math.fsum(np.sqrt(((begins - ends) ** 2).sum(axis=1)).tolist())


def lengths(known: Sampled, chosen: Choices) -> FloatArray:
    """By path, where it is entered: of closed ones mm along it, of others 1 for backwards, else 0."""
    where = known.where
    row, fraction = np.array(chosen.row), np.array(chosen.fraction)
    segment = np.minimum(where.first[:-1] + np.maximum(row - 1, 0), where.first[1:] - 1)
    fraction = np.clip((fraction - where.low[segment]) / where.span[segment], 0.0, 1.0)
    length = (
        known.along[segment]
        - known.along[where.first[:-1]]
        + fraction * where.shape.length[segment]
    )
    return np.where(known.items.kind == CLOSED, length, row > 0)


def _enter(known: Sampled, first: Choices) -> IntArray:
    """The points where the items are entered in a tour whose closed paths may begin between samples."""
    items, along = known.items, lengths(known, first)
    closed = items.kind == CLOSED
    number = np.round(np.where(closed, along, 0.0) / np.maximum(known.step, NONZERO)).astype(
        np.int64
    )
    return items.first[:-1] + np.where(closed, number % np.diff(items.first), along > 0)


def _segment(known: Sampled, path: IntArray, length: FloatArray) -> tuple[IntArray, FloatArray]:
    """The start (segment) of each closed path (K,) that holds the point ``length`` (..., K) mm along it, and how far
    along that.
    """
    where, whole = known.where, np.maximum(known.whole[path], NONZERO)
    # A remainder takes ten times as long as a look at whether there is one.
    length = np.remainder(
        length, whole, out=np.array(length), where=(length < 0) | (length >= whole)
    )
    first, last = where.first[path], where.first[path + 1] - 1
    total = known.along[first] + length
    # Among the starts of these paths alone, which are few where they are neighbours.
    low, high = first.min(initial=len(known.along)), last.max(initial=0) + 1
    number = low + np.searchsorted(known.along[low:high], total, side="right") - 1
    # `clip` takes four times as long for few numbers.
    number = np.minimum(np.maximum(number, first), last)
    rest = np.maximum(total - known.along[number], 0.0)
    return number, np.minimum(rest, where.shape.length[number])


def point_at(known: Sampled, path: IntArray, length: FloatArray) -> FloatArray:
    """Points x, y (..., K, 2) of closed paths (K,), ``length`` (..., K) mm along each."""
    number, rest = _segment(known, path, length)
    shape = known.where.shape
    part = rest / np.maximum(shape.length[number], NONZERO)
    return shape.point(part.reshape(-1), number.reshape(-1), axes=2).reshape(*length.shape, 2)


def real_length(known: Sampled, path: IntArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """How long closed paths are from ``low`` to ``high`` mm along their starts, with the corners that are none, mm."""
    where = known.where
    whole = where.shape.length / where.span
    before = np.concatenate([[0.0], np.cumsum(whole)])

    def real(length: FloatArray) -> FloatArray:
        number, rest = _segment(known, path, length)
        return before[number] + where.low[number] * whole[number] + rest

    one, two = real(low), real(high)
    around = before[where.first[path + 1]] - before[where.first[path]]
    return np.where(two < one, two - one + around, two - one)


def ends_at(known: Sampled, along: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Where each path is entered and left, x y (N, 2) mm. along: by path, see ``lengths``."""
    items = known.items
    closed = (items.kind == CLOSED) & (np.diff(items.first) > 1)
    first, last = items.points[items.first[:-1]], items.points[items.first[1:] - 1]
    back = (~closed & (along > 0))[:, None]
    enter, leave = np.where(back, last, first), np.where(back, first, last)
    loops = np.flatnonzero(closed)
    enter[loops] = leave[loops] = point_at(known, loops, along[loops])
    return enter, leave


def place_starts(known: Sampled, length: FloatArray) -> tuple[IntArray, FloatArray]:
    """Row and fraction of the point ``length`` mm along each path; no piece shorter than SEAM is cut off a segment."""
    path = np.arange(len(known.items.kind))
    number, rest = _segment(known, path, length)
    whole = known.where.shape.length[number]
    part = np.divide(rest, whole, out=np.zeros_like(rest), where=whole > 0)
    part = np.where(np.minimum(rest, whole - rest) < SEAM, np.round(part), part)
    return known.where.row[number], known.where.low[number] + part * known.where.span[number]


def polish_starts(
    known: Sampled, found: Start, home: FloatArray | None, length: FloatArray
) -> FloatArray:
    """Where along it each closed path begins, mm: every other one in turn moved to its best place."""
    items, order = known.items, found.order
    count = len(order)
    if count == 0:
        return length
    enter = items.points[found.enter]
    leave = items.points[items.first[:-1] + items.first[1:] - 1 - found.enter]
    closed = (items.kind == CLOSED) & (np.diff(items.first) > 1)
    loops = np.flatnonzero(closed)
    enter[loops] = point_at(known, loops, length[loops])
    leave = np.where((items.kind == CLOSED)[:, None], enter, leave)
    for _ in range(_ROUNDS):
        for odd in (0, 1):
            at = np.arange(odd, count, 2)
            at = at[closed[order[at]]]
            at = at[np.argsort(order[at])]  # neighbours in the tables are looked at together
            # Nothing before the first or after the last where there is no home: the other neighbour counts alone.
            before = leave[order[at - 1]]
            after = enter[order[(at + 1) % count]]
            for edge, side, other in ((0, before, after), (count - 1, after, before)):
                side[at == edge] = other[at == edge] if home is None else home
            own = order[at]
            length[own] = _best(known, own, length[own], before, after)
            enter[own] = leave[own] = point_at(known, own, length[own])
    return length


def _best(
    known: Sampled, path: IntArray, length: FloatArray, before: FloatArray, after: FloatArray
) -> FloatArray:
    """The places along the closed paths, near ``length``, with the shortest way from ``before`` to ``after``."""
    shift = np.linspace(-1.0, 1.0, 2 * _FINER + 1)
    # The place itself comes first, so that it stays where nothing is shorter.
    shift = shift[np.argsort(np.abs(shift), kind="stable"), None]
    best = np.empty(len(path))
    for begin in range(0, len(path), _AT_ONCE):
        part = slice(begin, begin + _AT_ONCE)
        own, place, reach = path[part], length[part], known.step[path[part]]
        for _ in range(_NARROWER):
            places = place + shift * reach
            points = point_at(known, own, places)
            cost = plane_lengths(points - before[part]) + plane_lengths(points - after[part])
            place = places[cost.argmin(axis=0), np.arange(len(own))]
            reach = reach / _FINER
        best[part] = place % np.maximum(known.whole[own], NONZERO)
    return best
