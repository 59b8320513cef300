"""Divides closed outlines into runs of points, each of which is one line or one arc.

Runs of two points are merged, the cheapest pairs first and all over the picture at once, as long as
one curve for both needs fewer numbers than two (minimum description length; the noise is known).
Then each end between two runs is moved to where both fit best together, and points that the blur of
a corner has moved are left out.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import (
    compute_first_rows,
    find_following_rows,
    list_owners,
    list_range_numbers,
    number_rows,
)
from camgen.geometry.rings import ComplexArray, Rings
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray
from camgen.vision.lines_arcs.fit import Curves, Sums, fit_best, join_sums, sum_runs

#: Points of the first runs.
_FIRST_POINTS = 2
#: Squared noise that one number of a curve must save.
PRICE = 8.0
#: Standard deviations of the noise: a point farther from the curve of its run belongs to a rounded
#: corner, and does not count.
_FAR_SIGMAS = 4.0
#: Standard deviations beyond which the distance makes no difference any more.
_MAX_SIGMAS = 40.0
#: Sigmas of the blur, to each side, over which a corner is rounded.
_ROUNDED_REACH = 2.5
#: Rounds of merging, at most. Many pairs are merged in each.
_MAX_ROUNDS = 60


class Runs(Struct, frozen=True, eq=False):
    """P runs of points, loop after loop and in order along each loop.

    A run may pass over the end of its loop to its beginning.

    first: (P,) row of the first point.
    count: (P,) number of points.
    loop: (P,) number of the loop.
    """

    first: IntArray
    count: IntArray
    loop: IntArray

    def __len__(self) -> int:
        return len(self.first)

    def following(self) -> IntArray:
        """The run after each run along its loop, (P,)."""
        return find_following_rows(np.bincount(self.loop))

    def before(self) -> IntArray:
        """The run before each run along its loop, (P,)."""
        before = np.empty(len(self.first), dtype=np.int64)
        before[self.following()] = np.arange(len(before))
        return before

    def several(self) -> BoolArray:
        """Whether the loop of each run has more than one run, (P,)."""
        return np.asarray(np.bincount(self.loop)[self.loop] > 1)

    def rows(self, loops: Rings) -> tuple[IntArray, IntArray]:
        """Rows (N,) of the points, run after run, and the index (P,) at which each run begins."""
        place = list_range_numbers(self.first, self.count)
        loop = np.repeat(self.loop, self.count)
        base = loops.first[loop]
        return base + (place - base) % loops.count[loop], compute_first_rows(self.count)


def make_blocks(loops: Rings) -> Runs:
    """Divide the loops into runs of about two points."""
    parts = np.maximum(loops.count // _FIRST_POINTS, 1)
    loop, k = list_owners(parts), number_rows(parts)
    low = k * loops.count[loop] // parts[loop]
    high = (k + 1) * loops.count[loop] // parts[loop]
    return Runs(loops.first[loop] + low, high - low, loop)


def fit_runs(
    runs: Runs, loops: Rings, points: ComplexArray, weight: FloatArray, sigma: FloatArray
) -> tuple[Sums, Curves, FloatArray]:
    """Fit a line or arc to each run.

    weight: (N,) weight of each point.
    sigma: (L,) noise of the points of each loop, px.

    Returns the sums, the curves, and their prices (P,) in squared noise.
    """
    rows, begin = runs.rows(loops)
    sums = sum_runs(points[rows], weight[rows], begin)
    curves, cost = fit_best(sums, sigma[runs.loop], PRICE)
    return sums, curves, cost


def merge(
    runs: Runs, loops: Rings, points: ComplexArray, weight: FloatArray, sigma: FloatArray
) -> Runs:
    """Merge neighbouring runs until no merge lowers the price.

    A corner between two runs has points that do not count. They must be paid for if it vanishes.

    weight: (N,) 1 for points that count, else 0.
    sigma: (L,) noise of the points of each loop, px.
    """
    sums, _, cost = fit_runs(runs, loops, points, weight, sigma)
    begins, ends = _count_left_out(runs, loops, weight)
    for _ in range(_MAX_ROUNDS):
        after = runs.following()
        pair = join_sums(sums, sums.take(after))
        pair_cost = fit_best(pair, sigma[runs.loop], PRICE)[1]
        corner_cost = _FAR_SIGMAS**2 * (ends + begins[after])
        saving = cost + cost[after] - pair_cost - corner_cost
        saving[~runs.several()] = -np.inf
        chosen = _choose_merges(runs, after, saving)
        if not len(chosen):
            break
        merged = after[chosen]
        sums.sums[chosen], sums.origin[chosen] = pair.sums[chosen], pair.origin[chosen]
        # The price of a vanished corner is paid once: it is not added to that of the merged run.
        cost[chosen] = pair_cost[chosen]
        ends[chosen] = ends[merged]
        count = runs.count.copy()
        count[chosen] += runs.count[merged]
        kept = np.delete(np.arange(len(runs)), merged)
        runs = Runs(runs.first[kept], count[kept], runs.loop[kept])
        sums, cost, begins, ends = sums.take(kept), cost[kept], begins[kept], ends[kept]
    return runs


def _count_left_out(runs: Runs, loops: Rings, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Number of points that do not count in the first and in the second half of each run (P,)."""
    rows, begin = runs.rows(loops)
    is_first_half = number_rows(runs.count) < np.repeat(runs.count, runs.count) / 2
    left_out = 1.0 - weight[rows]
    first = np.add.reduceat(left_out * is_first_half, begin)
    return first, np.add.reduceat(left_out * ~is_first_half, begin)


def _choose_merges(runs: Runs, after: IntArray, saving: FloatArray) -> IntArray:
    """Choose runs to be merged with the run after them.

    Their merge saves something, and saves more than a merge of either of the two with its other
    neighbour.
    """
    before = runs.before()
    # Savings of about the same size are ordered by a number without pattern, so that many pairs
    # are chosen at a time.
    level = np.floor(-saving / PRICE * 4)
    tie = (np.arange(len(saving)) * 2654435761) % 4294967296
    rank = np.empty(len(saving), dtype=np.int64)
    rank[np.lexsort([tie, level])] = np.arange(len(saving))
    is_best = (rank < rank[before]) | (before == np.arange(len(after)))
    is_best &= (rank < rank[after]) | (after == np.arange(len(after)))
    return np.flatnonzero(is_best & (saving > 0))


def relax(
    runs: Runs, loops: Rings, points: ComplexArray, curves: Curves, sigma: FloatArray
) -> Runs:
    """Move each end between two runs to where both fit best together.

    The middle of each run stays with it.

    sigma: (L,) noise of the points of each loop, px.
    """
    several, after = runs.several(), runs.following()
    half = runs.count // 2
    # From the middle of each run to the middle of the next.
    size = np.where(several, runs.count - half + half[after], runs.count)
    rows, begin = Runs(runs.first + half, size, runs.loop).rows(loops)
    owner = list_owners(size)
    limit = (_MAX_SIGMAS * sigma[runs.loop])[owner] ** 2
    first = np.minimum(curves.take(owner).distances(points[rows]) ** 2, limit)
    second = np.minimum(curves.take(after[owner]).distances(points[rows]) ** 2, limit)
    total = np.append(0.0, np.cumsum(first - second))
    # Number of points by which each run ends later than before, and the next one begins later.
    later = np.where(several, half + _find_lowest(total, begin, size) - runs.count, 0)
    start = np.empty_like(later)
    start[after] = later
    return wrap_rows(Runs(runs.first + start, runs.count - start + later, runs.loop), loops)


def wrap_rows(runs: Runs, loops: Rings) -> Runs:
    """The runs with first rows that lie within their loops."""
    base = loops.first[runs.loop]
    return Runs(base + (runs.first - base) % loops.count[runs.loop], runs.count, runs.loop)


def _find_lowest(total: FloatArray, begin: IntArray, size: IntArray) -> IntArray:
    """Number of rows of each span (P,) after which the running sum `total` (N + 1,) is lowest.

    The first one of equal values counts. In a span of two rows or more at least one row is on
    either side.

    begin, size: (P,) first row and number of rows of each span.
    """
    place, span, local = np.arange(len(total) - 1), list_owners(size), number_rows(size)
    is_allowed = (local > 0) | (size[span] < 2)
    value = np.where(is_allowed, total[place] - total[begin[span]], np.inf)
    lowest = np.minimum.reduceat(value, begin)
    is_lowest = np.flatnonzero(value <= lowest[span])
    first = np.full(len(begin), -1)
    # Backwards, so that the first one is assigned last.
    first[span[is_lowest][::-1]] = local[is_lowest][::-1]
    return first


def trim(
    runs: Runs,
    loops: Rings,
    points: ComplexArray,
    curves: Curves,
    sigma: FloatArray,
    blur: FloatArray,
) -> FloatArray:
    """Leave out points that the blur of a corner has moved away from the curve of their run.

    They are at the ends of a run, within reach of the blur. A run that would keep fewer than half
    of its points, or fewer than 3, keeps them all.

    sigma: (L,) noise of the points of each loop, px.
    blur: (L,) sigma of the blur of each loop, px.

    Returns the weight (N,) of each point, 0 or 1.
    """
    rows, begin = runs.rows(loops)
    owner = list_owners(runs.count)
    distance = np.abs(curves.take(owner).distances(points[rows]))
    is_far = distance >= _FAR_SIGMAS * sigma[runs.loop][owner]
    place = number_rows(runs.count)
    from_end = np.minimum(place, runs.count[owner] - 1 - place)
    is_moved = is_far & (from_end < _ROUNDED_REACH * blur[runs.loop][owner] + 1)
    remaining = np.add.reduceat((~is_moved).astype(np.int64), begin)
    keeps_all = remaining < np.maximum(0.5 * runs.count, 3)
    weight = np.empty(len(points))
    weight[rows] = ~is_moved | keeps_all[owner]
    return weight
