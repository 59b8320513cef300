"""Finds stretches on which tool centre and contact point run in proportion: lines, arcs, corners.

The observed feed is the slope of the length that the contact point runs over that of the tool
centre. As a derivative of an angle it multiplies the noise of the angle, so it is averaged over
stretches that end where the curvature changes. One length over the other is a chain of straight
stretches. Neighbours are joined as long as the noise allows it (Ward's method), with knots at the
crossings of their lines. At a knot of a smooth curve the slope does not jump: it is interpolated
from the middle of one stretch to the middle of the next.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import list_range_numbers, number_rows
from camgen.geometry.rings import Rings, make_rings
from camgen.geometry.segments import BoolArray, IntArray
from camgen.model.pose import FloatArray

#: Number of rows of the first stretches, which are then joined.
_SEED = 4
#: Number of times that stretches are fitted again between their new knots.
_ROUNDS = 6
#: Maximum increase of the misfit of two joined stretches, in squares of the noise. It is large
#: because the noise of neighbours is correlated.
_WORSE = 60.0
#: Number of rows by which a curve is extended beyond its seam, at both ends.
_BEYOND = 400


class _Sums(Struct, frozen=True, eq=False):
    """Sums over P stretches.

    table: (P, 6) number of rows, and sums of x, y, xx, xy and yy.
    """

    table: FloatArray

    def slope(self) -> FloatArray:
        count, x, y, xx, xy, _ = self.table.T
        return np.asarray((count * xy - x * y) / np.maximum(count * xx - x * x, 1e-9))

    def height(self) -> FloatArray:
        """The value of each line at x = 0."""
        count, x, y, *_ = self.table.T
        return np.asarray((y - self.slope() * x) / np.maximum(count, 1))

    def noise(self) -> FloatArray:
        """Squared noise as a multiple of that on a line. It grows with the speed of the contact."""
        return np.asarray(np.maximum(self.slope() + 1.0, 1.0))

    def misfit(self) -> FloatArray:
        """Sum of the squared residuals of the least-squares line."""
        count, x, y, xx, xy, yy = self.table.T
        count = np.maximum(count, 1)
        across, along = xy - x * y / count, np.maximum(xx - x * x / count, 1e-9)
        return np.asarray(np.maximum(yy - y * y / count - across**2 / along, 0.0))


def compute_ratios(table: Rings, along: FloatArray, step: FloatArray, noise: float) -> FloatArray:
    """(N,) length that the contact point runs per length of the tool centre, averaged, at least 0.

    table: lengths of the closed curves.
    along, step: (N,) lengths of contact point and tool centre on the segment before each row, px.
    noise: noise of the sum of `along` at a row, px.
    """
    extension = min(_BEYOND, int(np.max(table.count, initial=0)))
    padded = make_rings(table.count + 2 * extension)
    row = (
        table.first[padded.loop]
        + (number_rows(padded.count) - extension) % table.count[padded.loop]
    )
    begin = padded.first[padded.loop]
    centre_run, contact_run = np.cumsum(step[row]), np.cumsum(along[row])
    x = centre_run - centre_run[begin]
    # The difference of both runs has small numbers; its slope is less by 1.
    y = (contact_run - contact_run[begin]) - x
    columns = np.column_stack([np.ones(len(row)), x, y, x**2, x * y, y**2])
    worse = _WORSE * noise**2
    first = _refine(_join(padded, columns, worse), padded, columns)
    while len(fewer := _drop_bridges(first, padded, columns, worse)) < len(first):
        first = _refine(fewer, padded, columns)
    slope = _compute_slopes(first, padded, columns, worse)
    inner_rows: IntArray = np.arange(len(table)) + (2 * table.loop + 1) * extension
    return np.maximum(slope[inner_rows] + 1.0, 0.0)


def _join(padded: Rings, columns: FloatArray, worse: float) -> IntArray:
    """First rows (P,) of the stretches after joining neighbours that fit as one, to `worse` px2."""
    place = number_rows(padded.count)
    remaining = padded.count[padded.loop] - place
    # The last stretch of a curve may be longer, none is shorter.
    first = np.flatnonzero((place % _SEED == 0) & ((remaining >= _SEED) | (place == 0)))
    sums = _Sums(np.add.reduceat(columns, first, axis=0))
    while len(first) > 1:
        both = _Sums(sums.table[:-1] + sums.table[1:])
        cost = (both.misfit() - sums.misfit()[:-1] - sums.misfit()[1:]) / both.noise()
        cost[padded.loop[first[1:]] != padded.loop[first[:-1]]] = np.inf
        padded_cost = np.concatenate([[np.inf], cost, [np.inf]])
        joins = (cost < worse) & (cost <= padded_cost[:-2]) & (cost < padded_cost[2:])
        if not joins.any():
            break
        stays = np.flatnonzero(np.append(True, ~joins))
        first, sums = first[stays], _Sums(np.add.reduceat(sums.table, stays, axis=0))
    return first


def _refine(first: IntArray, padded: Rings, columns: FloatArray) -> IntArray:
    """First rows of the stretches, moved to the crossings of their lines."""
    x = columns[:, 1]
    last = np.append(first[1:], len(x)) - 1
    for _ in range(_ROUNDS):
        sums = _Sums(np.add.reduceat(columns, first, axis=0))
        slope, height = sums.slope(), sums.height()
        middle = (first + last) // 2
        is_inner = padded.loop[first[1:]] == padded.loop[first[:-1]]
        bend = slope[:-1] - slope[1:]
        with np.errstate(divide="ignore", invalid="ignore"):
            cross = (height[1:] - height[:-1]) / bend
        low, high = x[middle[:-1]], x[middle[1:]]
        k = np.flatnonzero(is_inner & (cross > low) & (cross < high))
        moved = first.copy()
        moved[k + 1] = middle[k] + _count_before(x, middle, np.diff(middle, append=0), k, cross[k])
        moved = _keep_apart(moved, first)
        if (moved == first).all():
            break
        first, last = moved, np.append(moved[1:], len(x)) - 1
    return first


def _drop_bridges(first: IntArray, padded: Rings, columns: FloatArray, worse: float) -> IntArray:
    """Drop stretches that only bridge the bend between their neighbours.

    The lines of the neighbours, up to their crossing, fit nearly as well.
    """
    x = columns[:, 1]
    sums = _Sums(np.add.reduceat(columns, first, axis=0))
    slope, height, loop = sums.slope(), sums.height(), padded.loop[first]
    count = np.diff(np.append(first, len(x)))
    inner = np.flatnonzero((loop[:-2] == loop[1:-1]) & (loop[2:] == loop[1:-1])) + 1
    with np.errstate(divide="ignore", invalid="ignore"):
        cross = (height[inner + 1] - height[inner - 1]) / (slope[inner - 1] - slope[inner + 1])
    within = (cross > x[first[inner]]) & (cross < x[first[inner] + count[inner] - 1])
    inner, cross = inner[within], cross[within]
    row = list_range_numbers(first[inner], count[inner])
    owner = np.repeat(np.arange(len(inner)), count[inner])
    line = np.where(x[row] < cross[owner], inner[owner] - 1, inner[owner] + 1)
    deviation = columns[row, 2] - height[line] - slope[line] * x[row]
    misfit = np.bincount(owner, deviation**2, len(inner))
    cost = np.full(len(first) + 2, np.inf)
    cost[inner + 1] = (misfit - sums.misfit()[inner]) / sums.noise()[inner]
    drops = (cost[1:-1] < worse) & (cost[1:-1] <= cost[:-2]) & (cost[1:-1] < cost[2:])
    moved = first.copy()
    dropped = np.searchsorted(inner, np.flatnonzero(drops))
    before = _count_before(x, first, count, inner[dropped], cross[dropped])
    moved[inner[dropped] + 1] = first[inner[dropped]] + before
    return moved[~drops]


def _count_before(
    x: FloatArray, first: IntArray, count: IntArray, chosen: IntArray, cross: FloatArray
) -> IntArray:
    """Number of rows of each `chosen` stretch before `cross`."""
    row = list_range_numbers(first[chosen], count[chosen])
    owner = np.repeat(np.arange(len(chosen)), count[chosen])
    return np.bincount(owner, x[row] < cross[owner], len(chosen)).astype(np.int64)


def _keep_apart(moved: IntArray, first: IntArray) -> IntArray:
    is_valid = np.append(np.diff(moved) >= 2, True)
    is_valid[1:] &= is_valid[:-1]
    chosen = np.where(is_valid, moved, first)
    return chosen if (np.diff(chosen) >= 1).all() else first


def _compute_slopes(
    first: IntArray, padded: Rings, columns: FloatArray, worse: float
) -> FloatArray:
    """(N,) slopes: of the stretch, or interpolated between the middles of two at a smooth knot."""
    x = columns[:, 1]
    slope = _Sums(np.add.reduceat(columns, first, axis=0)).slope()
    count = np.diff(np.append(first, len(x)))
    owner = np.repeat(np.arange(len(first)), count)
    is_hard = _is_hard(first, count, padded, columns, worse)
    middle = (x[first] + x[first + count - 1]) / 2
    slopes = slope[owner]
    before, after = np.append(True, is_hard), np.append(is_hard, True)
    is_after = x > middle[owner]
    soft = np.flatnonzero(~np.where(is_after, after[owner], before[owner]))
    a, b = owner[soft], np.where(is_after, owner + 1, owner - 1)[soft]
    fraction = (x[soft] - middle[a]) / (middle[b] - middle[a])
    slopes[soft] = slope[a] + fraction * (slope[b] - slope[a])
    return np.asarray(slopes)


def _is_hard(
    first: IntArray, count: IntArray, padded: Rings, columns: FloatArray, worse: float
) -> BoolArray:
    """(P - 1,) true if the slope jumps from a stretch to the next.

    Half of the shorter stretch on both sides of the knot does not fit as one.
    """
    reach = np.maximum(np.minimum(count[:-1], count[1:]) // 2, 2)
    total = np.concatenate([np.zeros((1, columns.shape[1])), np.cumsum(columns, axis=0)])
    knot = first[1:]
    low, high = np.maximum(knot - reach, first[:-1]), np.minimum(knot + reach, knot + count[1:])
    left, right = _Sums(total[knot] - total[low]), _Sums(total[high] - total[knot])
    both = _Sums(left.table + right.table)
    cost = (both.misfit() - left.misfit() - right.misfit()) / both.noise()
    return np.asarray((cost > worse) | (padded.loop[knot] != padded.loop[knot - 1]))
