"""Fits lines and arcs to thinned borders, through all points of a border between two corners.

From each corner the longest stretch is searched through whose points one line, or one circle,
fits within the tolerance. A corner is the crossing of two lines. A stretch that leaves the border
by more than the tolerance goes back to points of the border.

All borders are handled at once: their points (V,) are joined, as complex numbers. Knots are the
rows at which lines and arcs meet. A line or an arc starts at each knot except the last one of a
border.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.curves import measure_from_arc
from camgen.geometry.ragged import (
    compute_first_rows,
    concatenate_columns,
    list_owners,
    list_range_numbers,
)
from camgen.geometry.thinning import Polylines, measure_from_lines
from camgen.model.part import IntArray
from camgen.model.pose import FloatArray
from camgen.model.tolerance import NONZERO

BoolArray = NDArray[np.bool_]
ComplexArray = NDArray[np.complex128]

# Lines and circles through many points, for many stretches at once.

#: Minimum radius of an arc, in tolerances. Points of a smaller arc could share a border point.
SMALLEST = 2.5


class Stretches(Struct, frozen=True, eq=False):
    """G stretches of borders, joined.

    points: (N,) points of all stretches.
    begin: (G,) row of the first point of each.
    count: (G,) number of points of each.
    owner: (N,) stretch of each point, or a slice over all groups if there is only one.
    """

    points: ComplexArray
    begin: IntArray
    count: IntArray
    owner: IntArray | slice

    @classmethod
    def between(cls, line: ComplexArray, low: IntArray, high: IntArray) -> Stretches:
        """The points of the rows low[g] to high[g] of `line`, both included."""
        count = high - low + 1
        return cls(
            line[list_range_numbers(low, count)],
            compute_first_rows(count),
            count,
            list_owners(count),
        )

    @classmethod
    def single(cls, points: ComplexArray) -> Stretches:
        """All `points` as one stretch, without an index for each point."""
        return cls(points, np.zeros(1, dtype=np.int64), np.array([len(points)]), slice(None))

    def local(self) -> tuple[ComplexArray, ComplexArray]:
        """The mean (G,) of each stretch, and the points (N,) relative to it."""
        sums = np.add.reduceat(self.points, self.begin)
        mean = np.asarray(sums, dtype=np.complex128) / self.count
        return mean, self.points - mean[self.owner]

    def steps(self, values: ComplexArray) -> ComplexArray:
        """(N,) difference from each value to the next one of its stretch, 0 for the last one."""
        step = np.empty_like(values)
        np.subtract(values[1:], values[:-1], out=step[:-1])
        step[self.begin + self.count - 1] = 0.0
        return step

    def maxima(self, values: FloatArray) -> FloatArray:
        """(G,) the largest of the `values` (N,) of each stretch."""
        return np.asarray(np.maximum.reduceat(values, self.begin))


def fit_circles(given: Stretches) -> tuple[ComplexArray, FloatArray, FloatArray]:
    """Fit a circle to each stretch with the least algebraic error (Kasa 1976).

    Returns centres, radii and largest distances (G,) of the circles from the lines between the
    points; the sagitta of these lines is included. NaN for points on a line.
    """
    mean, local = given.local()
    square = local.real**2 + local.imag**2
    size, twice, skew = (
        np.add.reduceat(product, given.begin) for product in (square, local * local, local * square)
    )
    determinant = size**2 - np.abs(twice) ** 2
    determinant[determinant <= 4e-12 * size**2] = np.nan
    centre = (size * skew - twice * np.conj(skew)) * (1 / determinant)
    radius = np.sqrt(size / given.count + np.abs(centre) ** 2)
    deviation = np.abs(np.abs(local - centre[given.owner]) - radius[given.owner])
    longest = given.maxima(np.abs(given.steps(given.points)))
    return mean + centre, radius, given.maxima(deviation) + longest**2 / (8 * radius)


def fit_lines(given: Stretches) -> tuple[ComplexArray, ComplexArray, FloatArray]:
    """Fit a line to each stretch with the least square distance.

    Returns a point, the direction and the largest distance of each line, (G,).
    """
    mean, local = given.local()
    along = np.exp(0.5j * np.angle(np.add.reduceat(local * local, given.begin)))
    return mean, along, given.maxima(np.abs((local * np.conj(along)[given.owner]).imag))


def measure_turns(given: Stretches, centre: ComplexArray) -> FloatArray:
    """(G,) angles by which the stretches go around their `centre` (G,), rad."""
    local = given.points - centre[given.owner]
    turn = np.angle((local + given.steps(local)) * np.conj(local))
    return np.asarray(np.add.reduceat(turn, given.begin))


def _are_arcs(given: Stretches, tolerance: float) -> BoolArray:
    centre, radius, deviation = fit_circles(given)
    fits = (given.count > _POINTS) & (deviation <= tolerance) & (radius >= SMALLEST * tolerance)
    if fits.any():
        fits &= np.abs(measure_turns(given, centre)) <= _MAX_ARC_TURN
    return fits


# Borders as whole circles, or as sequences of lines and arcs.

#: Maximum ratio of the rms distance of a border from a circle to that from the thinned lines.
#: Measured circles are below 1.15, even with a radius of 3 px; squares from 6 px on are above 1.3.
_MAX_CIRCLE_RATIO = 1.2
#: Minimum number of lines of an arc. Fewer lines may as well be a corner with a chamfer.
_MIN_LINES = 3
#: Minimum angle between two lines of a corner, rad.
_CORNER_TURN = np.radians(75.0)
#: Maximum sweep of an arc, rad, below a half circle.
_MAX_ARC_TURN = np.radians(170.0)
#: Fraction of the tolerance for the fit of a line or an arc. The rest is for its ends, which its
#: neighbours move.
_FIT_FRACTION = 0.8
#: Maximum number of repairs of a border. Then it keeps its thinned points.
_MAX_REPAIRS = 6
#: Maximum length of a line across a corner that the pixels cut off, in tolerances.
_CHAMFER = 5.0
#: Minimum number of points of a fitted line.
_POINTS = 4
#: Minimum angle of two lines that meet in their crossing, rad.
_CROSSING_TURN = np.radians(8.0)


class _Borders(Struct, frozen=True, eq=False):
    """All borders, joined.

    line: (V,) points.
    first, last: (B,) first and last row of each border.
    closed: (B,) true for closed borders.
    """

    line: ComplexArray
    first: IntArray
    last: IntArray
    closed: BoolArray

    def owner(self, rows: IntArray) -> IntArray:
        return np.asarray(np.searchsorted(self.first, rows, side="right") - 1)


class _Knots(Struct, frozen=True, eq=False):
    """The knots of the borders.

    row: (K,) sorted rows of the points.
    is_arc: (K,) true if an arc starts at the knot, otherwise a line.
    stays: (K,) true if the knot keeps its position.
    """

    row: IntArray
    is_arc: BoolArray
    stays: BoolArray

    def select(self, mask: BoolArray) -> _Knots:
        return _Knots(self.row[mask], self.is_arc[mask], self.stays[mask])

    def segments(self, borders: _Borders) -> IntArray:
        """(S,) indices of the knots at which a line or an arc starts; it ends at the next knot."""
        return np.flatnonzero(~np.isin(self.row, borders.last))


#: Rows, points and bulges (M,) of lines and arcs.
_Fitted = tuple[IntArray, ComplexArray, FloatArray]


def fit_arcs(
    chains: Polylines, kept: IntArray, closed: BoolArray, tolerance: float
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Replace the thinned borders by lines and arcs.

    chains: the borders; the first point of a closed one is repeated at its end.
    kept: rows of the points that remain after thinning.
    closed: (B,) true for closed borders.
    Returns the rows (M,) of their ends, the points (M, 2) and the bulges (M,). The first point of
    a closed border is repeated.
    """
    borders = _Borders(
        chains.points @ np.array([1, 1j]), chains.first[:-1], chains.first[1:] - 1, closed
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        circles, is_circle = _fit_whole_circles(borders, kept, tolerance)
        fitted = [circles, *_fit_borders(borders, kept[~is_circle[borders.owner(kept)]], tolerance)]
        row, point, bulge = concatenate_columns(fitted)
    order = np.argsort(row)
    return row[order], _to_xy(point[order]), bulge[order]


def _fit_borders(borders: _Borders, kept: IntArray, tolerance: float) -> list[_Fitted]:
    """Fit lines and arcs to the borders of `kept`.

    Returns the borders that are within the tolerance at once, those that are after each repair,
    and the others as they were thinned.
    """
    knots = _find_knots(borders, kept, tolerance)
    fitted = []
    for _ in range(_MAX_REPAIRS):
        placed = _place(borders, knots, tolerance)
        bulges = _compute_bulges(borders, knots, placed)
        is_bad = _is_too_far(borders, knots, placed, bulges, tolerance)
        owner = borders.owner(knots.row)
        failed = np.isin(owner, owner[is_bad])
        fitted.append((knots.row[~failed], placed[~failed], bulges[~failed]))
        if not failed.any():
            return fitted
        knots = _repair(borders, kept, knots.select(failed), is_bad[failed])
    rows = kept[np.isin(borders.owner(kept), borders.owner(knots.row))]
    return [*fitted, (rows, borders.line[rows], np.zeros(len(rows)))]


def _repair(borders: _Borders, kept: IntArray, knots: _Knots, is_bad: BoolArray) -> _Knots:
    """Fix the ends of bad lines and arcs at points of the border.

    If both ends are fixed already, lines through the thinned points `kept` replace them.
    """
    hopeless = is_bad & knots.stays & np.roll(knots.stays, -1)
    stays = knots.stays | is_bad | np.roll(is_bad, 1)
    first, last = np.isin(knots.row, borders.first), np.isin(knots.row, borders.last)
    # First and last knot of a closed border are one point.
    both = (stays[first] | stays[last]) & borders.closed[borders.owner(knots.row[first])]
    stays[first] |= both
    stays[last] |= both
    replaced = hopeless[np.searchsorted(knots.row, kept, side="right") - 1]
    rows = np.union1d(knots.row, kept[replaced])
    previous = np.searchsorted(knots.row, rows, side="right") - 1
    is_new = ~np.isin(rows, knots.row)
    return _Knots(rows, (knots.is_arc & ~hopeless)[previous], stays[previous] | is_new)


def _fit_whole_circles(
    borders: _Borders, kept: IntArray, tolerance: float
) -> tuple[_Fitted, BoolArray]:
    """Fit two arcs to each closed border that is a circle. Returns also which ones are, (B,)."""
    low, high = borders.first, borders.last
    is_circle = borders.closed & (high - low >= 8)
    centre, radius, deviation = fit_circles(
        Stretches.between(borders.line, low, np.maximum(high - 1, low))
    )
    is_circle &= (deviation <= tolerance) & (radius >= SMALLEST * tolerance)
    chosen = np.flatnonzero(is_circle)
    low, high, centre, radius = low[chosen], high[chosen], centre[chosen], radius[chosen]
    # A small square is near to a circle too, but lines are nearer to its border.
    ring = Stretches.between(borders.line, low, high - 1)
    corner = np.searchsorted(kept, list_range_numbers(low, high - low), side="right") - 1
    starts, ends = _to_xy(borders.line[kept[corner]]), _to_xy(borders.line[kept[corner + 1]])
    by_lines = measure_from_lines(_to_xy(ring.points), starts, ends)
    by_circle = np.abs(ring.points - centre[ring.owner]) - radius[ring.owner]
    limit = _MAX_CIRCLE_RATIO**2 * np.add.reduceat(by_lines**2, ring.begin)
    is_good = np.add.reduceat(by_circle**2, ring.begin) <= limit
    turn = measure_turns(Stretches.between(borders.line, low, high), centre)
    # A thin crescent lies on a circle too, there and back.
    is_good &= np.abs(turn) >= np.pi
    is_circle[chosen] = is_good
    rows = np.stack([low, low + 1, high])[:, is_good].ravel()
    points = (centre + np.array([[1], [-1], [1]]) * radius)[:, is_good].ravel()
    bulges = (np.array([[1], [1], [0]]) * np.sign(turn))[:, is_good].ravel()
    return (rows, points, bulges), is_circle


def _find_knots(borders: _Borders, kept: IntArray, tolerance: float) -> _Knots:
    """The rows at which lines and arcs meet, each as long as possible."""
    line, rows = borders.line, kept.tolist()
    tolerance *= _FIT_FRACTION
    limits = _find_corners(line[kept], np.isin(kept, borders.last))

    def is_line(k: int, end: int) -> bool:
        return bool(fit_lines(Stretches.single(line[rows[k] : rows[end] + 1]))[2][0] <= tolerance)

    def is_arc(k: int, end: int) -> bool:
        return bool(_are_arcs(Stretches.single(line[rows[k] : rows[end] + 1]), tolerance)[0])

    # Most lines and arcs are short. One test for all corners finds those that may be longer.
    longer, curved = np.zeros(len(kept), np.bool_), np.zeros(len(kept), np.bool_)
    k = np.flatnonzero(np.arange(len(kept)) + 2 <= limits)
    longer[k] = fit_lines(Stretches.between(line, kept[k], kept[k + 2]))[2] <= tolerance
    k = np.flatnonzero(np.arange(len(kept)) + _MIN_LINES <= limits)
    curved[k] = _are_arcs(Stretches.between(line, kept[k], kept[k + _MIN_LINES]), tolerance)
    starts, arcs = [], []
    start = 0
    while start < len(rows):
        limit = int(limits[start])
        first, shortest = start + 1, start + _MIN_LINES
        line_end = _find_farthest(is_line, start, first, limit) if longer[start] else first
        may_bend = curved[start] and line_end < limit
        arc_end = _find_farthest(is_arc, start, shortest, limit) if may_bend else start
        starts.append(start)
        arcs.append(arc_end > line_end)
        start = max(line_end, arc_end)
    stays = np.zeros(len(starts), np.bool_)
    knots = _Knots(kept[np.array(starts, np.int64)], np.array(arcs, np.bool_), stays)
    return _drop_chamfers(borders, knots, tolerance)


def _find_corners(points: ComplexArray, ends: BoolArray) -> IntArray:
    """The next sharp corner or end of its border for each of the `points` (K,).

    An end gives itself.
    """
    step = np.diff(points)
    turn = np.angle(step[1:] * np.conj(step[:-1]))
    is_sharp = ends.copy()
    is_sharp[1:-1] |= np.abs(turn) >= _CORNER_TURN
    limits = np.arange(len(points))
    inner, sharp = np.flatnonzero(~ends), np.flatnonzero(is_sharp)
    limits[inner] = sharp[np.searchsorted(sharp, inner, side="right")]
    return limits


def _find_farthest(fits: Callable[[int, int], bool], k: int, good: int, limit: int) -> int:
    """The last index up to `limit` to which a line or an arc from `k` fits, by doubling steps.

    It fits to `good`, and is assumed to fit to all indices before the last one.
    """
    step = 1
    while good + step <= limit and fits(k, good + step):
        good += step
        step *= 2
    while step > 1:
        step //= 2
        if good + step <= limit and fits(k, good + step):
            good += step
    return good


def _drop_chamfers(borders: _Borders, knots: _Knots, tolerance: float) -> _Knots:
    row = knots.row.copy()
    first, last = np.isin(row, borders.first), np.isin(row, borders.last)
    size, count = np.abs(np.diff(borders.line[row])), np.diff(row)
    is_inner = ~(knots.is_arc | first | last)[:-1] & ~last[1:]
    short = (size <= _CHAMFER * tolerance) & (count <= _POINTS) & is_inner
    # If two short lines follow each other, the first is dropped.
    short[1:] &= ~short[:-1]
    k = np.flatnonzero(short)
    row[k] = (row[k] + row[k + 1]) // 2
    return _Knots(np.delete(row, k + 1), np.delete(knots.is_arc, k), np.delete(knots.stays, k))


class _Shapes(Struct, frozen=True, eq=False):
    """The line or circle of each knot.

    point: (K,) point of a line, centre of an arc; NaN if it has too few points for a fit.
    along: (K,) direction of a line, 0 for an arc.
    radius: (K,) radius of an arc, NaN for a line.
    """

    point: ComplexArray
    along: ComplexArray
    radius: FloatArray

    @classmethod
    def fit(cls, borders: _Borders, knots: _Knots) -> _Shapes:
        count = len(knots.row)
        point, radius = np.full(count, np.nan + 0j), np.full(count, np.nan)
        along = np.zeros(count, np.complex128)
        begin = knots.segments(borders)
        low, high = knots.row[begin], knots.row[begin + 1]
        arc = knots.is_arc[begin]
        k = begin[arc]
        point[k], radius[k], _ = fit_circles(Stretches.between(borders.line, low[arc], high[arc]))
        # The ends are left out: corners may be rounded there.
        line = ~arc & (high - low > _POINTS)
        k = begin[line]
        inner = Stretches.between(borders.line, low[line] + 1, high[line] - 1)
        point[k], along[k], _ = fit_lines(inner)
        return cls(point, along, radius)

    def __getitem__(self, k: IntArray) -> _Shapes:
        return _Shapes(self.point[k], self.along[k], self.radius[k])

    def nearest(self, points: ComplexArray) -> ComplexArray:
        """(K,) the nearest point of each line or circle to `points` (K,)."""
        offset = points - self.point
        on_line = self.along * (offset * np.conj(self.along)).real
        on_arc = offset * (self.radius / np.maximum(np.abs(offset), NONZERO))
        return np.asarray(self.point + np.where(np.isnan(self.radius), on_line, on_arc))


def _place(borders: _Borders, knots: _Knots, tolerance: float) -> ComplexArray:
    """(K,) positions of the knots: where their neighbours meet, if that is within `tolerance`.

    Knots that stay, and the ends of open borders, keep their positions.
    """
    placed = borders.line[knots.row]
    shapes = _Shapes.fit(borders, knots)
    first = np.flatnonzero(np.isin(knots.row, borders.first))
    last = np.flatnonzero(np.isin(knots.row, borders.last))
    closed = borders.closed[borders.owner(knots.row[first])]
    before, after = np.arange(-1, len(placed) - 1), np.arange(len(placed))
    before[first], after[last] = last - 1, first
    moves = ~knots.stays
    moves[first] &= closed
    moves[last] &= closed
    k = np.flatnonzero(moves)
    meeting = _find_meetings(placed[k], shapes[before[k]], shapes[after[k]])
    near = np.abs(meeting - placed[k]) <= tolerance
    placed[k[near]] = meeting[near]
    return placed


def _find_meetings(points: ComplexArray, before: _Shapes, after: _Shapes) -> ComplexArray:
    """The points at which two neighbours meet near `points` (N,).

    Two lines meet in their crossing. Otherwise the middle of their nearest points is returned. If
    one neighbour has no fit, the nearest point of the other one counts; NaN if both have none.
    """
    first, second = before.nearest(points), after.nearest(points)
    middle = np.where(np.isnan(after.point), first, (first + second) / 2)
    meeting = np.where(np.isnan(before.point), second, middle)
    cross = (np.conj(before.along) * after.along).imag
    share = (np.conj(after.point - before.point) * after.along).imag / cross
    # An arc has no direction: its cross product is zero.
    is_crossing = np.abs(cross) > np.sin(_CROSSING_TURN)
    return np.asarray(np.where(is_crossing, before.point + before.along * share, meeting))


def _compute_bulges(borders: _Borders, knots: _Knots, placed: ComplexArray) -> FloatArray:
    bulges = np.zeros(len(placed))
    k = np.flatnonzero(knots.is_arc)
    low, high = knots.row[k], knots.row[k + 1]
    quarter = (high - low) // 4
    inner = Stretches.between(borders.line, low + quarter, high - quarter)
    start, end = placed[k][inner.owner], placed[k + 1][inner.owner]
    half = np.angle((end - inner.points) * np.conj(inner.points - start))
    bulges[k] = np.tan(np.add.reduceat(half, inner.begin) / inner.count / 2)
    return bulges


def _is_too_far(
    borders: _Borders, knots: _Knots, placed: ComplexArray, bulges: FloatArray, tolerance: float
) -> BoolArray:
    """(K,) true for invalid lines and arcs, and for those beyond `tolerance` from the border."""
    begin = knots.segments(borders)
    given = Stretches.between(borders.line, knots.row[begin], knots.row[begin + 1])
    a, b, bulge = placed[begin], placed[begin + 1], bulges[begin]
    length, size = np.abs(b - a), np.abs(bulge)
    start, end = _to_xy(a)[given.owner], _to_xy(b)[given.owner]
    x, y = given.points.real, given.points.imag
    deviation = measure_from_arc(x, y, start, end, bulge[given.owner])
    radius = length * (1 + bulge**2) / (4 * size)
    sagitta = given.maxima(np.abs(given.steps(given.points))) ** 2 / (8 * radius)
    largest = given.maxima(deviation) + sagitta
    is_small = (length < 1e-9) | (radius < SMALLEST * tolerance)
    is_bad = np.zeros(len(placed), dtype=np.bool_)
    is_bad[begin] = is_small | (size > 1.0) | ~(largest <= tolerance * (1 + 1e-9))
    return is_bad


def _to_xy(points: ComplexArray) -> FloatArray:
    return np.column_stack([points.real, points.imag])
