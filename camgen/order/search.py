"""Tool paths as items of the search for a short tour: samples of closed paths, exact starts."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from camgen.geometry.nearest import find_nearest_items
from camgen.geometry.ragged import compute_offsets, count_rows, list_owners, number_rows
from camgen.geometry.vectors import measure_plane_lengths
from camgen.model.part import BoolArray, IntArray
from camgen.model.path import ToolPath
from camgen.model.pose import FloatArray
from camgen.model.tolerance import NONZERO
from camgen.order.solver import bound
from camgen.order.solver.greedy import join_greedily
from camgen.order.solver.kernel import BOTH_WAYS, CLOSED, ONE_WAY
from camgen.order.solver.plane import (
    DONE,
    Clock,
    Items,
    OnFraction,
    Problem,
    Start,
    make_discs,
    shorten_tour,
    sum_ends,
)
from camgen.order.solver.speed import available
from camgen.order.solver.together import shorten_together
from camgen.order.starts import Starts
from camgen.plan.starting import SEAM

#: Minimum number of samples of a closed path.
_MIN_SAMPLES = 8
#: Maximum number of samples of a closed path.
_MAX_SAMPLES = 256
#: Samples on a section as long as the usual distance of two items.
_SAMPLES_PER_DISTANCE = 3
#: Nearest discs of each disc; their items are the near items to which moves are tried.
_NEAR_DISCS = 10
#: Evaluations of each item without `tour.seconds`, so that a job has one result on every machine.
_EVALUATIONS = 40
#: Limit of the evaluations. Measured: 0.3 s of plain Python at 1,000 items.
_MAX_EVALUATIONS = 6_000
#: Evaluations of each item above that limit.
_MORE_EVALUATIONS = 1.3
#: Evaluations of the compiled search.
_FAST_EVALUATIONS = 60_000
#: Evaluations of each item by the compiled search, in addition.
_MORE_FAST_EVALUATIONS = 20
#: Number of items above which the compiled search is used: below, its start takes longer than it
#: saves.
_MANY = 500
#: More evaluations than any clock lets the search make.
_ENDLESS = 10**15
#: Number of items above which a greedy tour, where it is possible, replaces the nearest order,
#: because it is shorter; plain Python then shortens it at all items together. The compiled search
#: does as much in the same time.
_CROWD = 5_000
#: Number of items above which there is no other search. Measured against evaluations of single
#: items: tours are up to 16 % shorter, at most 0.3 % longer, and found in half the time.
_ALL_TOGETHER = 25_000
#: Number of items above which a bound is computed only with `_BOUND_SECONDS` for each item.
_MANY_FOR_BOUND = 20_000
#: s: duration of the search for each item from which a bound is computed for any number of items.
_BOUND_SECONDS = 3e-4
#: Minimum and maximum number of trees of the bound. With `tour.seconds` there are as many as take
#: about a fourth of that time.
_TREES = (4, 80)
#: s: duration of a tree for each item.
_TREE_SECONDS = 4e-6
#: Distances that the bound may measure, without and with `tour.seconds`.
_DISTANCES = (100_000, 6_000_000)
#: More distances for each second of `tour.seconds`.
_DISTANCES_PER_SECOND = 10_000_000
#: Rounds, each of which moves every start to its best point between its neighbours.
_ROUNDS = 2
#: Points to each side of a start among which the best one is chosen, and factor by which their
#: distance then shrinks.
_POINTS_TO_EACH_SIDE = 4
#: Number of times that the best point is narrowed down.
_NARROWINGS = 4
#: Closed paths whose starts are moved in one go: small enough to stay in the cache.
_AT_ONCE = 1_000


class Choices(Struct, frozen=True):
    """The order of the paths, and their starts.

    order: indices of the paths in the order in which they are run.
    row: row of each path at which it begins.
    fraction: fraction of the segment before that row at which a closed path begins.
    end: end of the search, see `plane`.
    """

    order: list[int]
    row: list[int]
    fraction: list[float]
    end: int = DONE


class Sampled(Struct, frozen=True, eq=False):
    """Paths as items of the search.

    items: the items.
    where: all starts of the paths.
    along: (starts + 1,) summed lengths of the segments of all starts, mm.
    whole: (N,) length of each path, mm.
    step: (N,) distance along each path from one sample to the next, mm.
    """

    items: Items
    where: Starts
    along: FloatArray
    whole: FloatArray
    step: FloatArray


def count_evaluations(count: int, together: bool) -> int:
    """The evaluation budget for `count` items without `tour.seconds`.

    together: whether the tour was shortened at all items together before.
    """
    if is_compiled(count):
        return _FAST_EVALUATIONS + _MORE_FAST_EVALUATIONS * count
    if together and count > _ALL_TOGETHER:
        return 0
    return round(min(_EVALUATIONS * count, _MAX_EVALUATIONS + _MORE_EVALUATIONS * count))


def is_crowd(count: int) -> bool:
    """Whether a nearest order besides a greedy tour would cost more time than it gains."""
    return count > _CROWD


def is_large(count: int) -> bool:
    """Whether the search without `tour.seconds` is the compiled one, where that is installed."""
    return count > _MANY


def is_compiled(count: int) -> bool:
    """Whether the search without ``tour.seconds`` is the compiled one."""
    return is_large(count) and available()


def sample_paths(
    paths: Sequence[ToolPath], where: Starts, parent: Sequence[int], rank: Sequence[int]
) -> Sampled:
    """The paths as items: ends of open paths, evenly spaced samples of closed ones.

    parent: index of the path that comes later than each path, or -1.
    rank: rank of each path; lower ranks come first.
    """
    count = len(paths)
    along = np.concatenate([[0.0], np.cumsum(where.shape.length)])
    whole = along[where.first[1:]] - along[where.first[:-1]]
    rows = count_rows(paths)
    closed = np.array([path.closed for path in paths])
    reversible = np.array([path.reversible for path in paths])
    loop = closed & (rows > 1) & (whole > 0)
    lone = (rows == 1) | (closed & ~loop)
    kind = np.where(loop | lone, CLOSED, np.where(reversible, BOTH_WAYS, ONE_WAY))
    corners = np.concatenate([where.begin, where.end])
    area = max(np.prod(np.ptp(corners, axis=0)), float(np.ptp(corners)) ** 2 / 100)
    distance = max(float(np.sqrt(area / count)), NONZERO)
    samples = np.clip(np.ceil(whole * _SAMPLES_PER_DISTANCE / distance), _MIN_SAMPLES, _MAX_SAMPLES)
    samples = np.where(loop, samples.astype(np.int64), np.where(lone, 1, 2))
    first, owner, number = compute_offsets(samples), list_owners(samples), number_rows(samples)
    points = np.where((number == 0)[:, None], where.begin[owner], where.end[owner])
    step = whole / samples
    # A corner between two samples may be excluded as a start: then they are farther apart.
    excluded = (1 - where.span) / np.maximum(where.span, NONZERO)
    excluded = np.where(where.span > 0, excluded, 0.0) * where.shape.length
    largest = np.maximum.reduceat(excluded, where.first[:-1])
    sample_distance = np.where(loop, step + 2 * largest, 1.0)
    parents, ranks = np.array(parent, dtype=np.int64), np.array(rank, dtype=np.int64)
    items = Items(first, points, kind, sample_distance, parents, ranks)
    sampled = Sampled(items, where, along, whole, step)
    inside = loop[owner]
    points[inside] = compute_points(sampled, owner[inside], (number * step[owner])[inside])
    return sampled


def is_bound_affordable(seconds: float, count: int) -> bool:
    """Whether a lower bound is computed: for many items only if enough seconds are given."""
    return count <= _MANY_FOR_BOUND or seconds >= _BOUND_SECONDS * count


def compute_lower_bound(
    known: Sampled, home: tuple[float, float] | None, travel: float, seconds: float
) -> float:
    """A length that no tour of the paths is below, mm.

    travel: length of a known tour, mm.
    seconds: duration of the search, s; 0 for a few trees.
    """
    count = len(known.whole)
    rounds = min(max(10_000 // count, 2), 5)
    max_distances = _DISTANCES[0]
    if seconds:
        rounds = min(max(round(seconds / 4 / (_TREE_SECONDS * count)), _TREES[0]), _TREES[1])
        max_distances = round(_DISTANCES[1] + _DISTANCES_PER_SECOND * seconds)
    point = None if home is None else np.array(home)
    dense = _make_dense_points(known, max_distances)
    return bound.compute_lower_bound(known.items, point, travel, rounds, dense)


def _make_dense_points(known: Sampled, max_distances: int) -> bound.DensePoints | None:
    """Points along the items so close that near pairs need at most `max_distances` distances.

    Returns None if these would be too few to improve a bound.
    """
    items = known.items
    count = np.diff(items.first)
    loop = (items.kind == CLOSED) & (count > 1)
    each = min(int(math.sqrt(max_distances / (_NEAR_DISCS * len(count)))), _MAX_SAMPLES)
    if each < _MIN_SAMPLES:
        return None
    samples = np.where(loop, each, count)
    first, owner, number = compute_offsets(samples), list_owners(samples), number_rows(samples)
    inside = loop[owner]
    points = np.empty((len(owner), 2))
    points[~inside] = items.points[~np.repeat(loop, count)]
    step = known.whole / samples
    points[inside] = compute_points(known, owner[inside], (number * step[owner])[inside])
    # `items.step` includes corners that are excluded as starts.
    return bound.DensePoints(
        first, points, np.where(loop, (items.step - known.step + step) / 2, 0.0)
    )


def search_tour(
    known: Sampled,
    first: Choices | None,
    home: tuple[float, float] | None,
    seed: int,
    on_progress: OnFraction | None,
    clock: Clock | None = None,
) -> Choices:
    """Search a short tour, from `first` or a greedy tour, then move every start to its best point.

    first: a tour; None only if `join_greedily` gives one.
    on_progress: callback that gets the used fraction of the budget, and may stop the search.
    clock: end of the search; None for a budget of `count_evaluations`.
    """
    items = known.items
    count = len(items.kind)
    discs = make_discs(items)
    point = None if home is None else np.array(home)
    problem = Problem(items, find_nearest_items(discs, count, _NEAR_DISCS), point)
    greedy = join_greedily(items, discs, point)
    tours = [Start(np.array(first.order), _find_entered_points(known, first))] if first else []
    tours += [greedy] if greedy else []
    start = min(tours, key=lambda tour: _measure_travel(items, tour, point))
    together = start is greedy and is_crowd(count) and not is_compiled(count)
    if together:
        start = shorten_together(problem, start)
    budget = count_evaluations(count, together) if clock is None else _ENDLESS
    tour = shorten_tour(problem, start, budget, seed, on_progress, clock) if budget else start
    closed = items.kind == CLOSED
    number = tour.enter - items.first[:-1]
    length = polish_starts(known, tour, point, np.where(closed, number * known.step, 0.0))
    return make_choices(known, tour.order, np.where(closed, length, number), closed, tour.end)


def _measure_travel(items: Items, tour: Start, home: FloatArray | None) -> float:
    leave = np.where(items.kind == CLOSED, tour.enter, sum_ends(items) - tour.enter)
    begins, ends = items.points[tour.enter[tour.order]], items.points[leave[tour.order]]
    if home is not None:
        begins, ends = np.concatenate([begins, home[None]]), np.concatenate([home[None], ends])
    else:
        begins, ends = begins[1:], ends[:-1]
    return math.fsum(np.sqrt(((begins - ends) ** 2).sum(axis=1)).tolist())


def measure_starts(known: Sampled, chosen: Choices) -> FloatArray:
    """(N,) position at which each closed path begins, mm; 1 for a reversed open path, else 0."""
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


def _find_entered_points(known: Sampled, first: Choices) -> IntArray:
    """The point at which each item is entered, for a closed path the sample nearest its start."""
    items, along = known.items, measure_starts(known, first)
    closed = items.kind == CLOSED
    number = np.round(np.where(closed, along, 0.0) / np.maximum(known.step, NONZERO)).astype(
        np.int64
    )
    return items.first[:-1] + np.where(closed, number % np.diff(items.first), along > 0)


def _locate(known: Sampled, path: IntArray, length: FloatArray) -> tuple[IntArray, FloatArray]:
    """The start at positions along closed paths, and the distance along its segment, mm.

    path: (K,) indices of closed paths.
    length: (..., K) positions along them, mm.
    """
    where, whole = known.where, np.maximum(known.whole[path], NONZERO)
    # A remainder takes ten times as long as the test whether there is one.
    outside = (length < 0) | (length >= whole)
    length = np.remainder(length, whole, out=np.array(length), where=outside)
    first, last = where.first[path], where.first[path + 1] - 1
    total = known.along[first] + length
    # Only among the starts of these paths, which are few if the paths are neighbours.
    low, high = first.min(initial=len(known.along)), last.max(initial=0) + 1
    number = low + np.searchsorted(known.along[low:high], total, side="right") - 1
    # `clip` takes four times as long for few numbers.
    number = np.minimum(np.maximum(number, first), last)
    rest = np.maximum(total - known.along[number], 0.0)
    return number, np.minimum(rest, where.shape.length[number])


def compute_points(known: Sampled, path: IntArray, length: FloatArray) -> FloatArray:
    """Points x, y (..., K, 2) of closed paths (K,) at positions (..., K) along them, mm."""
    number, rest = _locate(known, path, length)
    shape = known.where.shape
    part = rest / np.maximum(shape.length[number], NONZERO)
    return shape.point(part.reshape(-1), number.reshape(-1), axes=2).reshape(*length.shape, 2)


def measure_sections(
    known: Sampled, path: IntArray, low: FloatArray, high: FloatArray
) -> FloatArray:
    """Lengths of closed paths between two positions along their starts, mm.

    The corners that are excluded as starts are included.
    """
    where = known.where
    whole = where.shape.length / where.span
    before = np.concatenate([[0.0], np.cumsum(whole)])

    def measure(length: FloatArray) -> FloatArray:
        number, rest = _locate(known, path, length)
        return before[number] + where.low[number] * whole[number] + rest

    start, end = measure(low), measure(high)
    around = before[where.first[path + 1]] - before[where.first[path]]
    return np.where(end < start, end - start + around, end - start)


def compute_ends(known: Sampled, along: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points x, y (N, 2) at which the paths are entered and left, mm.

    along: (N,) result of `measure_starts`.
    """
    items = known.items
    closed = (items.kind == CLOSED) & (np.diff(items.first) > 1)
    first, last = items.points[items.first[:-1]], items.points[items.first[1:] - 1]
    back = (~closed & (along > 0))[:, None]
    enter, leave = np.where(back, last, first), np.where(back, first, last)
    loops = np.flatnonzero(closed)
    enter[loops] = leave[loops] = compute_points(known, loops, along[loops])
    return enter, leave


def make_choices(
    known: Sampled, order: IntArray, along: FloatArray, closed: BoolArray, end: int = DONE
) -> Choices:
    """The choices of a tour.

    No piece shorter than SEAM is cut off a segment.

    along: (N,) position at which each closed path begins, mm; above 0 for a reversed open path.
    closed: (N,) paths that may begin at any position.
    """
    where = known.where
    number, rest = _locate(known, np.arange(len(closed)), np.where(closed, along, 0.0))
    whole = where.shape.length[number]
    part = np.divide(rest, whole, out=np.zeros_like(rest), where=whole > 0)
    part = np.where(np.minimum(rest, whole - rest) < SEAM, np.round(part), part)
    fraction = np.where(closed, where.low[number] + part * where.span[number], 0.0)
    row_of_open = np.where(along > 0, where.row[where.first[1:] - 1], 0)
    row = np.where(closed, where.row[number], row_of_open)
    return Choices(order.tolist(), row.tolist(), fraction.tolist(), end)


def polish_starts(
    known: Sampled, tour: Start, home: FloatArray | None, length: FloatArray
) -> FloatArray:
    """Move the start of every other closed path in turn to its best point between its neighbours.

    length: (N,) positions of the starts along the paths, mm; the result is the same.
    """
    items, order = known.items, tour.order
    count = len(order)
    enter = items.points[tour.enter]
    leave = items.points[sum_ends(items) - tour.enter]
    closed = (items.kind == CLOSED) & (np.diff(items.first) > 1)
    loops = np.flatnonzero(closed)
    enter[loops] = compute_points(known, loops, length[loops])
    leave = np.where((items.kind == CLOSED)[:, None], enter, leave)
    for parity in (0, 1) * _ROUNDS:
        places = np.arange(parity, count, 2)
        places = places[closed[order[places]]]
        places = places[np.argsort(order[places])]  # neighbours in the tables come together
        # Without a home nothing comes before the first or after the last: the other one counts.
        before, after = leave[order[places - 1]], enter[order[(places + 1) % count]]
        for place, side, other in ((0, before, after), (count - 1, after, before)):
            side[places == place] = other[places == place] if home is None else home
        paths = order[places]
        length[paths] = _find_best_starts(known, paths, length[paths], before, after)
        enter[paths] = leave[paths] = compute_points(known, paths, length[paths])
    return length


def _find_best_starts(
    known: Sampled, path: IntArray, length: FloatArray, before: FloatArray, after: FloatArray
) -> FloatArray:
    """Find the positions near `length` with the shortest links from `before` and to `after`, mm."""
    shift = np.linspace(-1.0, 1.0, 2 * _POINTS_TO_EACH_SIDE + 1)
    # The present position comes first, so that it stays if all others cost as much.
    shift = shift[np.argsort(np.abs(shift), kind="stable"), None]
    best = np.empty(len(path))
    for begin in range(0, len(path), _AT_ONCE):
        rows = slice(begin, begin + _AT_ONCE)
        position, radius = length[rows], known.step[path[rows]]
        for _ in range(_NARROWINGS):
            positions = position + shift * radius
            points = compute_points(known, path[rows], positions)
            cost = measure_plane_lengths(points - before[rows]) + measure_plane_lengths(
                points - after[rows]
            )
            position = positions[cost.argmin(axis=0), np.arange(len(position))]
            radius = radius / _POINTS_TO_EACH_SIDE
        best[rows] = position % np.maximum(known.whole[path[rows]], NONZERO)
    return best
