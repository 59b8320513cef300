"""Where the tool centre and its contact point run in proportion: along a line, an arc, around a sharp corner.

The observed feed is the slope of one run over the other, and the derivative of an angle: what noise the angle has is
many times as large in it. So it is averaged, and over stretches that end where the curvature changes: run over run is a
chain of straight stretches, found by joining neighbours as long as the noise allows (Ward's method), with its knots
where the lines of two stretches cross. Where a smooth curve alone makes a knot, the slope goes over from the middle of
one stretch to that of the next, and does not jump.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import ramp, stretches
from camgen.geometry.rings import Rings, make_rings
from camgen.geometry.segments import BoolArray, IntArray
from camgen.model.pose import FloatArray

#: Rows of the first stretches, which are then joined.
_SEED = 4
#: How often the stretches are fitted again between their new knots.
_ROUNDS = 6
#: By how much (squares of the noise) two stretches may fit worse as one: neighbours are noisy together.
_WORSE = 60.0
#: Rows of a curve that are seen beyond its seam, at either end.
_BEYOND = 400


class _Sums(Struct, frozen=True, eq=False):
    """Of stretches (P,): rows, and the sums of x, y, xx, xy, yy over them, as (P, 6)."""

    table: FloatArray

    def slope(self) -> FloatArray:
        count, x, y, xx, xy, _ = self.table.T
        return np.asarray((count * xy - x * y) / np.maximum(count * xx - x * x, 1e-9))

    def height(self) -> FloatArray:
        """Of the lines at x = 0."""
        count, x, y, *_ = self.table.T
        return np.asarray((y - self.slope() * x) / np.maximum(count, 1))

    def noise(self) -> FloatArray:
        """Square of the noise as a multiple of that on a line: where the contact point runs faster, it is less sure."""
        return np.asarray(np.maximum(self.slope() + 1.0, 1.0))

    def misfit(self) -> FloatArray:
        """Sum of squares that the least-squares line leaves."""
        count, x, y, xx, xy, yy = self.table.T
        count = np.maximum(count, 1)
        across, along = xy - x * y / count, np.maximum(xx - x * x / count, 1e-9)
        return np.asarray(np.maximum(yy - y * y / count - across**2 / along, 0.0))


def steady_ratio(table: Rings, along: FloatArray, step: FloatArray, noise: float) -> FloatArray:
    """(N,) by how much the contact point runs, at least 0, while the tool centre runs a px, on the segment that ends in
    each row. along, step: (N,) px of both on that segment. noise: px, of the sum of `along` at a row.
    """
    beyond = min(_BEYOND, int(np.max(table.count, initial=0)))
    padded = make_rings(table.count + 2 * beyond)
    row = table.first[padded.loop] + (ramp(padded.count) - beyond) % table.count[padded.loop]
    begin = padded.first[padded.loop]
    gone, ran = (np.cumsum(run[row]) for run in (step, along))
    gone, ran = gone - gone[begin], ran - ran[begin]
    # Their difference has small numbers, and its slope is less by 1.
    columns = np.column_stack(
        [np.ones(len(row)), gone, ran - gone, gone**2, gone * (ran - gone), (ran - gone) ** 2]
    )
    first = _refine(_join(padded, columns, _WORSE * noise**2), padded, gone, columns)
    while len(fewer := _drop_bridges(first, padded, gone, columns, _WORSE * noise**2)) < len(first):
        first = _refine(fewer, padded, gone, columns)
    slope = _slopes(first, padded, gone, columns, _WORSE * noise**2)
    own = stretch_rows(table, beyond)
    return np.maximum(slope[own] + 1.0, 0.0)


def stretch_rows(table: Rings, beyond: int) -> IntArray:
    """The rows of a padded table that are those of `table`."""
    return np.asarray(np.arange(len(table)) + (2 * table.loop + 1) * beyond)


def _join(padded: Rings, columns: FloatArray, worse: float) -> IntArray:
    """First rows (P,) of the stretches that are left when no two neighbours fit as one, to `worse` px2."""
    place = ramp(padded.count)
    left = padded.count[padded.loop] - place
    # The last stretch of a curve may be longer, none is shorter.
    first = np.flatnonzero((place % _SEED == 0) & ((left >= _SEED) | (place == 0)))
    sums = _Sums(np.add.reduceat(columns, first, axis=0))
    while len(first) > 1:
        both = _Sums(sums.table[:-1] + sums.table[1:])
        cost = (both.misfit() - sums.misfit()[:-1] - sums.misfit()[1:]) / both.noise()
        cost[padded.loop[first[1:]] != padded.loop[first[:-1]]] = np.inf
        around = np.concatenate([[np.inf], cost, [np.inf]])
        best = (cost < worse) & (cost <= around[:-2]) & (cost < around[2:])
        if not best.any():
            break
        stays = np.flatnonzero(np.append(True, ~best))
        first, sums = first[stays], _Sums(np.add.reduceat(sums.table, stays, axis=0))
    return first


def _refine(first: IntArray, padded: Rings, gone: FloatArray, columns: FloatArray) -> IntArray:
    """The stretches with their ends brought to where their lines cross."""
    last = np.append(first[1:], len(gone)) - 1
    for _ in range(_ROUNDS):
        sums = _Sums(np.add.reduceat(columns, first, axis=0))
        slope, height = sums.slope(), sums.height()
        middle = (first + last) // 2
        inner = padded.loop[first[1:]] == padded.loop[first[:-1]]
        bend = slope[:-1] - slope[1:]
        with np.errstate(divide="ignore", invalid="ignore"):
            cross = (height[1:] - height[:-1]) / bend
        low, high = gone[middle[:-1]], gone[middle[1:]]
        sure = inner & (cross > low) & (cross < high)
        moved = first.copy()
        k = np.flatnonzero(sure)
        moved[k + 1] = middle[k] + _before(gone, middle, np.diff(middle, append=0), k, cross[k])
        moved = _apart(moved, first)
        if (moved == first).all():
            break
        first, last = moved, np.append(moved[1:], len(gone)) - 1
    return first


def _drop_bridges(
    first: IntArray, padded: Rings, gone: FloatArray, columns: FloatArray, worse: float
) -> IntArray:
    """Without the stretches that only bridge the bend between their neighbours: the lines of these, up to where they
    cross, fit nearly as well.
    """
    sums = _Sums(np.add.reduceat(columns, first, axis=0))
    slope, height, loop = sums.slope(), sums.height(), padded.loop[first]
    count = np.diff(np.append(first, len(gone)))
    inner = np.flatnonzero((loop[:-2] == loop[1:-1]) & (loop[2:] == loop[1:-1])) + 1
    with np.errstate(divide="ignore", invalid="ignore"):
        cross = (height[inner + 1] - height[inner - 1]) / (slope[inner - 1] - slope[inner + 1])
    within = (cross > gone[first[inner]]) & (cross < gone[first[inner] + count[inner] - 1])
    inner, cross = inner[within], cross[within]
    row = stretches(first[inner], count[inner])
    own = np.repeat(np.arange(len(inner)), count[inner])
    line = np.where(gone[row] < cross[own], inner[own] - 1, inner[own] + 1)
    off = columns[row, 2] - height[line] - slope[line] * gone[row]
    cost = np.full(len(first) + 2, np.inf)
    cost[inner + 1] = (np.bincount(own, off**2, len(inner)) - sums.misfit()[inner]) / sums.noise()[
        inner
    ]
    best = (cost[1:-1] < worse) & (cost[1:-1] <= cost[:-2]) & (cost[1:-1] < cost[2:])
    ends = first.copy()
    at = np.searchsorted(inner, np.flatnonzero(best))
    ends[inner[at] + 1] = first[inner[at]] + _before(gone, first, count, inner[at], cross[at])
    return ends[~best]


def _before(
    gone: FloatArray, first: IntArray, count: IntArray, chosen: IntArray, cross: FloatArray
) -> IntArray:
    """How many rows of each stretch in `chosen` lie before `cross`."""
    row = stretches(first[chosen], count[chosen])
    own = np.repeat(np.arange(len(chosen)), count[chosen])
    return np.bincount(own, gone[row] < cross[own], len(chosen)).astype(np.int64)


def _apart(moved: IntArray, first: IntArray) -> IntArray:
    """`moved` where every stretch keeps two rows, else as it was."""
    good = np.append(np.diff(moved) >= 2, True)
    good[1:] &= good[:-1]
    return (
        np.where(good, moved, first)
        if (np.diff(np.where(good, moved, first)) >= 1).all()
        else first
    )


def _slopes(
    first: IntArray, padded: Rings, gone: FloatArray, columns: FloatArray, worse: float
) -> FloatArray:
    """(N,) slopes: of the stretch, or between the middles of two where what lies between is no sharper than a curve."""
    sums = _Sums(np.add.reduceat(columns, first, axis=0))
    slope = sums.slope()
    count = np.diff(np.append(first, len(gone)))
    owner = np.repeat(np.arange(len(first)), count)
    hard = _knots_are_hard(first, count, padded, columns, worse)
    middle = (gone[first] + gone[first + count - 1]) / 2
    result = slope[owner]
    before, after = np.append(True, hard), np.append(hard, True)
    other = np.where(gone > middle[owner], owner + 1, owner - 1)
    bound = np.where(gone > middle[owner], after[owner], before[owner])
    soft = np.flatnonzero(~bound)
    a, b = owner[soft], other[soft]
    share = (gone[soft] - middle[a]) / (middle[b] - middle[a])
    result[soft] = slope[a] + share * (slope[b] - slope[a])
    return np.asarray(result)


def _knots_are_hard(
    first: IntArray, count: IntArray, padded: Rings, columns: FloatArray, worse: float
) -> BoolArray:
    """(P - 1,) whether the slope jumps from each stretch to the next: half of the shorter one on both sides of the knot
    do not fit as one.
    """
    reach = np.maximum(np.minimum(count[:-1], count[1:]) // 2, 2)
    total = np.concatenate([np.zeros((1, columns.shape[1])), np.cumsum(columns, axis=0)])
    knot = first[1:]
    low, high = np.maximum(knot - reach, first[:-1]), np.minimum(knot + reach, knot + count[1:])
    left, right = _Sums(total[knot] - total[low]), _Sums(total[high] - total[knot])
    both = _Sums(left.table + right.table)
    cost = (both.misfit() - left.misfit() - right.misfit()) / both.noise()
    return np.asarray((cost > worse) | (padded.loop[knot] != padded.loop[knot - 1]))
