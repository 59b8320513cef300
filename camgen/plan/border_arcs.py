"""Thinned borders as lines and arcs that are known better than any of their points.

From corner to corner the longest run is looked for that one line, or one circle, laid through all points of the border
there, leaves nowhere too far. A corner is where two lines cross. Whatever leaves the border by more than the tolerance
goes back to points of the border itself.

All borders are handled at once: their points (V,) end to end, as complex numbers. Knots are the rows at which lines and
arcs meet; one begins at each knot but the last of its border.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.curves import measure_from_arc
from camgen.geometry.ragged import begins, owners, stretches
from camgen.geometry.thinning import IntArray, Polylines, measure_from_lines
from camgen.model.pose import FloatArray
from camgen.model.tolerance import NONZERO

BoolArray = NDArray[np.bool_]
ComplexArray = NDArray[np.complex128]

# Lines and circles through many points: those of many stretches at once.

#: Arcs of a smaller radius, in tolerances, are left to lines: each point of an arc must have its own of the border.
SMALLEST = 2.5


class Stretches(Struct, frozen=True, eq=False):
    """Points (N,) of G stretches of borders end to end, ``count`` (G,) of each. begin: (G,) their first. of: (N,)."""

    points: ComplexArray
    begin: IntArray
    count: IntArray
    of: IntArray | slice

    @classmethod
    def between(cls, line: ComplexArray, low: IntArray, high: IntArray) -> Stretches:
        """The points of the rows low[g] to high[g] of ``line``, both included."""
        count = high - low + 1
        return cls(line[stretches(low, count)], begins(count), count, owners(count))

    @classmethod
    def one(cls, points: ComplexArray) -> Stretches:
        """All of ``points`` as one stretch: no index is looked up."""
        return cls(points, np.zeros(1, dtype=np.int64), np.array([len(points)]), slice(None))

    def local(self) -> tuple[ComplexArray, ComplexArray]:
        """The middle (G,) of each stretch, and the points (N,) as seen from it."""
        middle = (
            np.asarray(np.add.reduceat(self.points, self.begin), dtype=np.complex128) / self.count
        )
        return middle, self.points - middle[self.of]

    def steps(self, values: ComplexArray) -> ComplexArray:
        """(N,) from each point to the next one of its stretch; 0 at its last one."""
        step = np.empty_like(values)
        np.subtract(values[1:], values[:-1], out=step[:-1])
        step[self.begin + self.count - 1] = 0.0
        return step

    def most(self, values: FloatArray) -> FloatArray:
        """(G,) the largest of the ``values`` (N,) of each stretch."""
        return np.asarray(np.maximum.reduceat(values, self.begin))


def circles_of(given: Stretches) -> tuple[ComplexArray, FloatArray, FloatArray]:
    """Centre and radius of the circle through each stretch with the least algebraic error (Kasa 1976).

    Then its largest distance from the lines between the points: what they cut off of the circle counts too. NaN for
    points on a line.
    """
    middle, local = given.local()
    square = local.real**2 + local.imag**2
    size, twice, skew = (
        np.add.reduceat(x, given.begin) for x in (square, local * local, local * square)
    )
    determinant = size**2 - np.abs(twice) ** 2
    determinant[determinant <= 4e-12 * size**2] = np.nan
    centre = (size * skew - twice * np.conj(skew)) * (1 / determinant)
    radius = np.sqrt(size / given.count + np.abs(centre) ** 2)
    off = given.most(np.abs(np.abs(local - centre[given.of]) - radius[given.of]))
    longest = given.most(np.abs(given.steps(given.points)))
    return middle + centre, radius, off + longest**2 / (8 * radius)


def lines_of(given: Stretches) -> tuple[ComplexArray, ComplexArray, FloatArray]:
    """A point and the direction of the line through each stretch with the least square distance; the largest one."""
    middle, local = given.local()
    along = np.exp(0.5j * np.angle(np.add.reduceat(local * local, given.begin)))
    return middle, along, given.most(np.abs((local * np.conj(along)[given.of]).imag))


def turns_of(given: Stretches, centre: ComplexArray) -> FloatArray:
    """The angles by which the stretches go round ``centre``, rad."""
    local = given.points - centre[given.of]
    turn = np.angle((local + given.steps(local)) * np.conj(local))
    return np.asarray(np.add.reduceat(turn, given.begin))


def _are_arcs(given: Stretches, tolerance: float) -> BoolArray:
    centre, radius, off = circles_of(given)
    fits = (given.count > _POINTS) & (off <= tolerance) & (radius >= SMALLEST * tolerance)
    if fits.any():
        fits &= np.abs(turns_of(given, centre)) <= _MOST_ARC_TURN
    return fits


# Borders as whole circles, or as runs of lines and arcs.

#: A circle may be so many times as far from the border as the thinned lines are, rms. Of what was measured circles stay
#: below 1.15, also those of three pixels' radius, and squares from six pixels' width on are above 1.3.
_ROUNDER = 1.2
#: So many lines make an arc; fewer are as likely a corner with a chamfer.
_LEAST_LINES = 3
#: A turn above this (rad) between two of them is a corner.
_CORNER_TURN = np.radians(75.0)
#: An arc turns by at most this (rad), so that it stays below a half circle.
_MOST_ARC_TURN = np.radians(170.0)
#: Part of the tolerance that a line or an arc may use by itself; the rest is for its ends, which its neighbours move.
_FIT_SHARE = 0.8
#: So often what fails is looked at again; then the border's own points remain.
_MOST_REPAIRS = 6
#: Shorter lines, in tolerances, are no more than a corner cut off by the pixels.
_CHAMFER = 5.0
#: A line is laid through its points if it has so many.
_POINTS = 4
#: Corners are where lines cross that turn by more than this (rad).
_CROSSING_TURN = np.radians(8.0)


class _Borders(Struct, frozen=True, eq=False):
    """Points (V,) of the borders, and of each (B,) its first and its last row and whether it is closed."""

    line: ComplexArray
    first: IntArray
    last: IntArray
    closed: BoolArray

    def owner(self, rows: IntArray) -> IntArray:
        return np.asarray(np.searchsorted(self.first, rows, side="right") - 1)


class _Knots(Struct, frozen=True, eq=False):
    """Rows (K,) of the borders, sorted; whether an arc begins there (else a line), and whether the knot stays there."""

    row: IntArray
    is_arc: BoolArray
    stays: BoolArray

    def of(self, where: BoolArray) -> _Knots:
        return _Knots(self.row[where], self.is_arc[where], self.stays[where])

    def segments(self, borders: _Borders) -> IntArray:
        """The knots (S,) at which a line or an arc begins; it ends at the next one."""
        return np.flatnonzero(~np.isin(self.row, borders.last))


#: Rows, points and bulges (M,).
_Found = tuple[IntArray, ComplexArray, FloatArray]


def with_arcs(
    chains: Polylines, kept: IntArray, closed: BoolArray, tolerance: float
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Rows (M,) of the borders ``chains``, of which the rows ``kept`` are thinned out, and there the points (M, 2) and
    bulges (M,) of their lines and arcs.

    A closed border ends with its first point again, and so does what is returned.
    """
    borders = _Borders(
        chains.points @ np.array([1, 1j]), chains.first[:-1], chains.first[1:] - 1, closed
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        circles, is_circle = _whole_circles(borders, kept, tolerance)
        rest = kept[~is_circle[borders.owner(kept)]]
        row, point, bulge = (
            np.concatenate(c)
            for c in zip(circles, *_with_runs(borders, rest, tolerance), strict=True)
        )
    order = np.argsort(row)
    return row[order], _xy(point[order]), bulge[order]


def _with_runs(borders: _Borders, kept: IntArray, tolerance: float) -> list[_Found]:
    """The borders of ``kept`` as lines and arcs: those that are good at once, those that are after each repair; others
    are as they were thinned out.
    """
    knots = _runs(borders, kept, tolerance)
    found = []
    for _ in range(_MOST_REPAIRS):
        placed = _place(borders, knots, tolerance)
        bulges = _bulges(borders, knots, placed)
        bad = _too_far(borders, knots, placed, bulges, tolerance)
        owner = borders.owner(knots.row)
        again = np.isin(owner, owner[bad])
        found.append((knots.row[~again], placed[~again], bulges[~again]))
        if not again.any():
            return found
        knots = _repaired(borders, kept, knots.of(again), bad[again])
    left = kept[np.isin(borders.owner(kept), borders.owner(knots.row))]
    return [*found, (left, borders.line[left], np.zeros(len(left)))]


def _repaired(borders: _Borders, kept: IntArray, knots: _Knots, bad: BoolArray) -> _Knots:
    """What fails gets the border's own points as ends; if it has them, the lines over the corners ``kept``."""
    hopeless = bad & knots.stays & np.roll(knots.stays, -1)
    stays = knots.stays | bad | np.roll(bad, 1)
    first, last = (np.isin(knots.row, rows) for rows in (borders.first, borders.last))
    one = (stays[first] | stays[last]) & borders.closed[borders.owner(knots.row[first])]
    stays[first] |= one
    stays[last] |= one
    gone = hopeless[np.searchsorted(knots.row, kept, side="right") - 1]
    rows = np.union1d(knots.row, kept[gone])
    old = np.searchsorted(knots.row, rows, side="right") - 1
    return _Knots(rows, (knots.is_arc & ~hopeless)[old], stays[old] | ~np.isin(rows, knots.row))


def _whole_circles(borders: _Borders, kept: IntArray, tolerance: float) -> tuple[_Found, BoolArray]:
    """The closed borders that are circles as two arcs each; which of all they are (B,)."""
    low, high = borders.first, borders.last
    is_circle = borders.closed & (high - low >= 8)
    centre, radius, off = circles_of(
        Stretches.between(borders.line, low, np.maximum(high - 1, low))
    )
    is_circle &= (off <= tolerance) & (radius >= SMALLEST * tolerance)
    chosen = np.flatnonzero(is_circle)
    low, high, centre, radius = low[chosen], high[chosen], centre[chosen], radius[chosen]
    # A small square, too, is nowhere far from a circle; but lines follow it more closely.
    ring = Stretches.between(borders.line, low, high - 1)
    row = stretches(low, high - low)
    corner = np.searchsorted(kept, row, side="right") - 1
    by_lines = measure_from_lines(
        _xy(ring.points), *(_xy(borders.line[kept[k]]) for k in (corner, corner + 1))
    )
    by_circle = np.abs(ring.points - centre[ring.of]) - radius[ring.of]
    good = np.add.reduceat(by_circle**2, ring.begin) <= _ROUNDER**2 * np.add.reduceat(
        by_lines**2, ring.begin
    )
    turn = turns_of(Stretches.between(borders.line, low, high), centre)
    # A thin crescent lies on a circle too, there and back.
    good &= np.abs(turn) >= np.pi
    is_circle[chosen] = good
    rows = np.stack([low, low + 1, high])[:, good].ravel()
    ends = (centre + np.array([[1], [-1], [1]]) * radius)[:, good].ravel()
    return (rows, ends, (np.array([[1], [1], [0]]) * np.sign(turn))[:, good].ravel()), is_circle


def _runs(borders: _Borders, kept: IntArray, tolerance: float) -> _Knots:
    """The rows at which lines and arcs meet, and which of those between them are arcs."""
    line, rows = borders.line, kept.tolist()
    tolerance *= _FIT_SHARE
    limits = _before_corners(line[kept], np.isin(kept, borders.last))

    def straight(k: int, end: int) -> bool:
        return bool(lines_of(Stretches.one(line[rows[k] : rows[end] + 1]))[2][0] <= tolerance)

    def round_(k: int, end: int) -> bool:
        return bool(_are_arcs(Stretches.one(line[rows[k] : rows[end] + 1]), tolerance)[0])

    # Most runs are short: whether a longer one is worth looking for is told for all corners at once.
    longer, curved = np.zeros(len(kept), np.bool_), np.zeros(len(kept), np.bool_)
    k = np.flatnonzero(np.arange(len(kept)) + 2 <= limits)
    longer[k] = lines_of(Stretches.between(line, kept[k], kept[k + 2]))[2] <= tolerance
    k = np.flatnonzero(np.arange(len(kept)) + _LEAST_LINES <= limits)
    curved[k] = _are_arcs(Stretches.between(line, kept[k], kept[k + _LEAST_LINES]), tolerance)
    on, arcs = [], []
    at = 0
    while at < len(rows):
        limit = int(limits[at])
        end = _farthest(straight, at, at + 1, limit) if longer[at] else at + 1
        by_arc = (
            _farthest(round_, at, at + _LEAST_LINES, limit) if curved[at] and end < limit else at
        )
        on.append(at)
        arcs.append(by_arc > end)
        at = max(end, by_arc)
    knots = _Knots(
        kept[np.array(on, np.int64)], np.array(arcs, np.bool_), np.zeros(len(on), np.bool_)
    )
    return _without_chamfers(borders, knots, tolerance)


def _before_corners(corners: ComplexArray, ends: BoolArray) -> IntArray:
    """For each corner (K,) the next one at which the way turns sharply or ends; itself where its border ends."""
    step = np.diff(corners)
    turn = np.angle(step[1:] * np.conj(step[:-1]))
    sharp = ends.copy()
    sharp[1:-1] |= np.abs(turn) >= _CORNER_TURN
    limits = np.arange(len(corners))
    way = np.flatnonzero(~ends)
    at = np.flatnonzero(sharp)
    limits[way] = at[np.searchsorted(at, way, side="right")]
    return limits


def _farthest(fits: Callable[[int, int], bool], k: int, good: int, limit: int) -> int:
    """The last of good .. limit to which it fits from ``k``, if those that do come first; ``good`` does."""
    step = 1
    while good + step <= limit and fits(k, good + step):
        good += step
        step *= 2
    while step > 1:
        step //= 2
        if good + step <= limit and fits(k, good + step):
            good += step
    return good


def _without_chamfers(borders: _Borders, knots: _Knots, tolerance: float) -> _Knots:
    """Without the short lines that the border of pixels has across each corner: their neighbours meet in the middle."""
    row = knots.row.copy()
    first, last = np.isin(row, borders.first), np.isin(row, borders.last)
    size, count = np.abs(np.diff(borders.line[row])), np.diff(row)
    short = (
        (size <= _CHAMFER * tolerance)
        & (count <= _POINTS)
        & ~(knots.is_arc | first | last)[:-1]
        & ~last[1:]
    )
    # Of two short ones in a row the first goes.
    short[1:] &= ~short[:-1]
    k = np.flatnonzero(short)
    row[k] = (row[k] + row[k + 1]) // 2
    return _Knots(np.delete(row, k + 1), np.delete(knots.is_arc, k), np.delete(knots.stays, k))


class _Shapes(Struct, frozen=True, eq=False):
    """Of lines a point and their direction, of arcs their centre and radius (K,). NaN: too few points to know it.

    radius: NaN for a line.
    """

    point: ComplexArray
    along: ComplexArray
    radius: FloatArray

    @classmethod
    def of(cls, borders: _Borders, knots: _Knots) -> _Shapes:
        count = len(knots.row)
        point, along, radius = (
            np.full(count, np.nan + 0j),
            np.zeros(count, np.complex128),
            np.full(count, np.nan),
        )
        begin = knots.segments(borders)
        low, high = knots.row[begin], knots.row[begin + 1]
        arc = knots.is_arc[begin]
        k = begin[arc]
        point[k], radius[k], _ = circles_of(Stretches.between(borders.line, low[arc], high[arc]))
        # The ends may be rounded by the corners there.
        line = ~arc & (high - low > _POINTS)
        k = begin[line]
        point[k], along[k], _ = lines_of(
            Stretches.between(borders.line, low[line] + 1, high[line] - 1)
        )
        return cls(point, along, radius)

    def __getitem__(self, k: IntArray) -> _Shapes:
        return _Shapes(self.point[k], self.along[k], self.radius[k])

    def nearest(self, at: ComplexArray) -> ComplexArray:
        away = at - self.point
        on_line = self.along * (away * np.conj(self.along)).real
        on_arc = away * (self.radius / np.maximum(np.abs(away), NONZERO))
        return np.asarray(self.point + np.where(np.isnan(self.radius), on_line, on_arc))


def _place(borders: _Borders, knots: _Knots, tolerance: float) -> ComplexArray:
    """The knots (K,) moved to where lines cross or arcs begin, by at most ``tolerance``, except those that stay."""
    placed = borders.line[knots.row]
    shapes = _Shapes.of(borders, knots)
    first, last = (
        np.flatnonzero(np.isin(knots.row, rows)) for rows in (borders.first, borders.last)
    )
    closed = borders.closed[borders.owner(knots.row[first])]
    before, after = np.arange(-1, len(placed) - 1), np.arange(len(placed))
    before[first], after[last] = last - 1, first
    moves = ~knots.stays
    moves[first] &= closed
    moves[last] &= closed
    k = np.flatnonzero(moves)
    met = _meetings(placed[k], shapes[before[k]], shapes[after[k]])
    near = np.abs(met - placed[k]) <= tolerance
    placed[k[near]] = met[near]
    return placed


def _meetings(at: ComplexArray, before: _Shapes, after: _Shapes) -> ComplexArray:
    """Where neighbours meet near ``at`` (N,): two lines where they cross, else half-way between their nearest points.

    A neighbour of too few points to know it is met where the other one ends. NaN if both are.
    """
    one, other = before.nearest(at), after.nearest(at)
    met = np.where(
        np.isnan(before.point), other, np.where(np.isnan(after.point), one, (one + other) / 2)
    )
    cross = (np.conj(before.along) * after.along).imag
    share = (np.conj(after.point - before.point) * after.along).imag / cross
    # An arc has no direction: its cross product is zero.
    return np.asarray(
        np.where(np.abs(cross) > np.sin(_CROSSING_TURN), before.point + before.along * share, met)
    )


def _bulges(borders: _Borders, knots: _Knots, placed: ComplexArray) -> FloatArray:
    """Bulges (K,): of an arc the mean of what the points of its middle half say (inscribed angle)."""
    bulges = np.zeros(len(placed))
    k = np.flatnonzero(knots.is_arc)
    low, high = knots.row[k], knots.row[k + 1]
    quarter = (high - low) // 4
    inner = Stretches.between(borders.line, low + quarter, high - quarter)
    half = np.angle(
        (placed[k + 1][inner.of] - inner.points) * np.conj(inner.points - placed[k][inner.of])
    )
    bulges[k] = np.tan(np.add.reduceat(half, inner.begin) / inner.count / 2)
    return bulges


def _too_far(
    borders: _Borders, knots: _Knots, placed: ComplexArray, bulges: FloatArray, tolerance: float
) -> BoolArray:
    """Which of the lines and arcs (K,) leave the border by more than ``tolerance`` somewhere."""
    begin = knots.segments(borders)
    given = Stretches.between(borders.line, knots.row[begin], knots.row[begin + 1])
    a, b, bulge = placed[begin], placed[begin + 1], bulges[begin]
    length, size = np.abs(b - a), np.abs(bulge)
    off = measure_from_arc(
        given.points.real, given.points.imag, _xy(a)[given.of], _xy(b)[given.of], bulge[given.of]
    )
    radius = length * (1 + bulge**2) / (4 * size)
    most = given.most(off) + given.most(np.abs(given.steps(given.points))) ** 2 / (8 * radius)
    flat, small = length < 1e-9, radius < SMALLEST * tolerance
    bad = np.zeros(len(placed), dtype=np.bool_)
    bad[begin] = flat | small | (size > 1.0) | ~(most <= tolerance * (1 + 1e-9))
    return bad


def _xy(points: ComplexArray) -> FloatArray:
    """(N, 2) of complex numbers (N,)."""
    return np.column_stack([points.real, points.imag])
