"""Closed outlines divided into runs of points that are one line or one arc each.

Runs of two points are joined, cheapest first and all over the picture at once, as long as one curve for both is told
in fewer numbers than two (minimum description length; the noise is known). Then every end between two runs goes to
where both together fit best, and what has become too small is given to its neighbours.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import begins, following, owners, ramp, stretches
from camgen.geometry.rings import ComplexArray, Rings
from camgen.model.part import IntArray
from camgen.model.pose import FloatArray
from camgen.vision.lines_arcs.fit import BoolArray, Curves, Sums, best, join_sums, sum_runs

#: Points of the runs that everything begins with.
_BLOCK = 2
#: What one number of a curve must gain, in squared noise.
PRICE = 8.0
#: A point farther from its run's curve than this many sigma belongs to a rounded corner; it does not count.
_FAR_SIGMAS = 4.0
#: Beyond this many sigma it does not matter how far.
_LOST_SIGMAS = 40.0
#: A corner is rounded for so many blurs to each side.
_ROUNDED = 2.5
_ROUNDS = 60


class Runs(Struct, frozen=True, eq=False):
    """P runs of points, loop after loop and in order along each: first (P,) row, count (P,), loop (P,).

    A run may go over the end of its loop.
    """

    first: IntArray
    count: IntArray
    loop: IntArray

    def __len__(self) -> int:
        return len(self.first)

    def following(self) -> IntArray:
        """(P,) the run after each along its loop."""
        return following(np.bincount(self.loop))

    def before(self) -> IntArray:
        """(P,) the run before each along its loop."""
        found = np.empty(len(self.first), dtype=np.int64)
        found[self.following()] = np.arange(len(found))
        return found

    def several(self) -> BoolArray:
        """(P,) whether the loop of each run has another one."""
        return np.asarray(np.bincount(self.loop)[self.loop] > 1)

    def rows(self, loops: Rings) -> tuple[IntArray, IntArray]:
        """Rows (N,) of the points run after run, and where each run begins among them (P,)."""
        place = stretches(self.first, self.count)
        loop = np.repeat(self.loop, self.count)
        base = loops.first[loop]
        return base + (place - base) % loops.count[loop], begins(self.count)


def blocks(loops: Rings) -> Runs:
    """Runs of about two points."""
    parts = np.maximum(loops.count // _BLOCK, 1)
    loop, k = owners(parts), ramp(parts)
    low, high = k * loops.count[loop] // parts[loop], (k + 1) * loops.count[loop] // parts[loop]
    return Runs(loops.first[loop] + low, high - low, loop)


def fit_runs(
    runs: Runs, loops: Rings, points: ComplexArray, weight: FloatArray, sigma: FloatArray
) -> tuple[Sums, Curves, FloatArray]:
    """Sums, curves and prices of the runs; weight (N,): which points count; sigma (L,) px."""
    rows, begin = runs.rows(loops)
    sums = sum_runs(points[rows], weight[rows], begin)
    curves, cost = best(sums, sigma[runs.loop], PRICE)
    return sums, curves, cost


def merge(
    runs: Runs, loops: Rings, points: ComplexArray, weight: FloatArray, sigma: FloatArray
) -> Runs:
    """Neighbours joined until none gains by it. Points that do not count at a corner must be paid when it goes."""
    sums, _, cost = fit_runs(runs, loops, points, weight, sigma)
    begins, ends = _left_out(runs, loops, weight)
    for _ in range(_ROUNDS):
        after = runs.following()
        pair = join_sums(sums, sums.take(after))
        both = best(pair, sigma[runs.loop], PRICE)[1]
        paid = _FAR_SIGMAS**2 * (ends + begins[after])
        gain = cost + cost[after] - both - paid
        gain[~runs.several()] = -np.inf
        chosen = _choose_joins(runs, after, gain)
        if not len(chosen):
            break
        gone = after[chosen]
        sums.sums[chosen], sums.origin[chosen] = pair.sums[chosen], pair.origin[chosen]
        # What was paid stays paid: it is taken off the price that the next joint is compared with.
        cost[chosen] = both[chosen]
        ends[chosen] = ends[gone]
        count = runs.count.copy()
        count[chosen] += runs.count[gone]
        keep = np.ones(len(runs), dtype=np.bool_)
        keep[gone] = False
        runs = Runs(runs.first[keep], count[keep], runs.loop[keep])
        sums, cost, begins, ends = sums.take(keep), cost[keep], begins[keep], ends[keep]
    return runs


def _left_out(runs: Runs, loops: Rings, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    """How many points do not count in the first and in the second half of each run (P,)."""
    rows, begin = runs.rows(loops)
    early = ramp(runs.count) < np.repeat(runs.count, runs.count) / 2
    out = 1.0 - weight[rows]
    return np.add.reduceat(out * early, begin), np.add.reduceat(out * ~early, begin)


def _choose_joins(runs: Runs, after: IntArray, gain: FloatArray) -> IntArray:
    """Runs to be joined with the one after: what gains, and costs less than joining either of the two elsewhere."""
    before = runs.before()
    # Gains of the same size are told apart by a number without pattern, so that many are chosen at a time.
    level = np.floor(-gain / PRICE * 4)
    tie = (np.arange(len(gain)) * 2654435761) % 4294967296
    rank = np.empty(len(gain), dtype=np.int64)
    rank[np.lexsort([tie, level])] = np.arange(len(gain))
    low = (rank < rank[before]) | (before == np.arange(len(after)))
    low &= (rank < rank[after]) | (after == np.arange(len(after)))
    return np.flatnonzero(low & (gain > 0))


def relax(
    runs: Runs, loops: Rings, points: ComplexArray, curves: Curves, sigma: FloatArray
) -> Runs:
    """Every end between two runs where both together fit best; the middle of each run stays with it."""
    several, after = runs.several(), runs.following()
    half = runs.count // 2
    # From the middle of each run to the middle of the next.
    size = np.where(several, runs.count - half + half[after], runs.count)
    rows, begin = Runs(runs.first + half, size, runs.loop).rows(loops)
    which = owners(size)
    cap = (_LOST_SIGMAS * sigma[runs.loop])[which] ** 2
    own = np.minimum(curves.take(which).distances(points[rows]) ** 2, cap)
    other = np.minimum(curves.take(after[which]).distances(points[rows]) ** 2, cap)
    total = np.append(0.0, np.cumsum(own - other))
    # How far each run ends later than it did, and the next one begins.
    later = np.where(several, half + _lowest(total, begin, size) - runs.count, 0)
    start = np.empty_like(later)
    start[after] = later
    return within(Runs(runs.first + start, runs.count - start + later, runs.loop), loops)


def within(runs: Runs, loops: Rings) -> Runs:
    """The same runs with their first rows counted around their loops."""
    base = loops.first[runs.loop]
    return Runs(base + (runs.first - base) % loops.count[runs.loop], runs.count, runs.loop)


def _lowest(total: FloatArray, begin: IntArray, size: IntArray) -> IntArray:
    """For each span, after how many of its rows the running sum ``total`` (N + 1,) is lowest; at least one on each side
    where there are two.
    """
    place, span, local = np.arange(len(total) - 1), owners(size), ramp(size)
    value = np.where((local > 0) | (size[span] < 2), total[place] - total[begin[span]], np.inf)
    low = np.minimum.reduceat(value, begin)
    hit = np.flatnonzero(value <= low[span])
    first = np.full(len(begin), -1)
    first[span[hit][::-1]] = local[hit][::-1]
    return first


def trim(
    runs: Runs,
    loops: Rings,
    points: ComplexArray,
    curves: Curves,
    sigma: FloatArray,
    blur: FloatArray,
) -> FloatArray:
    """Weights (N,): 0 for points at the ends of a run, as far as the blur may round them, that are off its curve."""
    rows, begin = runs.rows(loops)
    which = owners(runs.count)
    far = (
        np.abs(curves.take(which).distances(points[rows])) >= _FAR_SIGMAS * sigma[runs.loop][which]
    )
    place = ramp(runs.count)
    from_end = np.minimum(place, runs.count[which] - 1 - place)
    off = far & (from_end < _ROUNDED * blur[runs.loop][which] + 1)
    few = np.add.reduceat((~off).astype(np.int64), begin) < np.maximum(0.5 * runs.count, 3)
    weight = np.empty(len(points))
    weight[rows] = ~off | few[which]
    return weight
