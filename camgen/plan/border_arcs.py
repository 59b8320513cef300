"""A thinned border as lines and arcs that are known better than any of its points.

From corner to corner the longest run is looked for that one line, or one circle, laid through all points of the border
there, leaves nowhere too far. A corner is where two lines cross. Whatever leaves the border by more than the tolerance
goes back to points of the border itself.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from camgen.geometry.curves import to_arc
from camgen.geometry.ragged import begins, owners, stretches
from camgen.geometry.thinning import IntArray, to_lines
from camgen.geometry.vectors import turns
from camgen.model.pose import FloatArray
from camgen.model.tolerance import NONZERO

# Circles in borders: the one through many points, and whether a whole border is one.

#: Arcs of a smaller radius, in tolerances, are left to lines: each point of an arc must have its own of the border.
SMALLEST = 2.5
#: A circle may be so many times as far from the border as the thinned lines are, rms. Of what was measured circles stay
#: below 1.15, also those of three pixels' radius, and squares from six pixels' width on are above 1.3.
_ROUNDER = 1.2


def whole_circle(points: FloatArray, kept: IntArray, tolerance: float) -> tuple[FloatArray, FloatArray] | None:
    """The closed border ``points`` (N, 2), its first point again at its end, as two arcs; None where it is no circle.

    kept: the rows of the thinned border.
    """
    if len(points) < 9:
        return None
    centre, radius, off = circle_of(points[:-1])
    if off > tolerance or radius < SMALLEST * tolerance:
        return None
    # A small square, too, is nowhere far from a circle; but lines follow it more closely.
    stretch = np.searchsorted(kept, np.arange(len(points) - 1), side="right") - 1
    by_lines = to_lines(points[:-1], points[kept[stretch]], points[kept[stretch + 1]])
    by_circle = np.hypot(*(points[:-1] - centre).T) - radius
    if by_circle @ by_circle > _ROUNDER**2 * (by_lines @ by_lines):
        return None
    turn = measure_turn(points - centre)
    # A thin crescent lies on a circle too, there and back.
    if abs(turn) < np.pi:
        return None
    ends = centre + np.array([[radius, 0.0], [-radius, 0.0], [radius, 0.0]])
    bulge = float(np.sign(turn))
    return ends, np.array([bulge, bulge, 0.0])


def circle_of(points: FloatArray) -> tuple[FloatArray, float, float]:
    """Centre and radius of the circle through ``points`` with the least algebraic error (Kasa 1976).

    Then its largest distance from the lines between the points: what they cut off of the circle counts too.
    """
    middle = np.add.reduce(points) / len(points)
    local = points - middle
    square = np.einsum("nd,nd->n", local, local)
    normal = local.T @ local
    determinant = float(normal[0, 0] * normal[1, 1] - normal[0, 1] * normal[1, 0])
    if determinant <= 1e-12 * float(np.trace(normal)) ** 2:
        return middle, np.inf, np.inf
    mean = np.add.reduce(square) / len(square)
    u, v = (local.T @ (square - mean) / 2).tolist()
    centre = np.array([normal[1, 1] * u - normal[0, 1] * v, normal[0, 0] * v - normal[1, 0] * u]) / determinant
    radius = float(np.sqrt(mean + centre @ centre))
    off = float(np.abs(np.hypot(*(local - centre).T) - radius).max())
    return middle + centre, radius, off + _cut_off(points, radius)


def _cut_off(points: FloatArray, radius: float) -> float:
    """How far the longest line between ``points`` is inside the circle at its middle, at most."""
    step = np.diff(points, axis=0)
    return float(np.einsum("nd,nd->n", step, step).max()) / (8 * radius)


def measure_turn(local: FloatArray) -> float:
    """The angle by which ``local`` (N, 2) goes round the origin, rad."""
    return float(turns(local[:-1], local[1:]).sum())


BoolArray = NDArray[np.bool_]

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


def with_arcs(points: FloatArray, kept: IntArray, closed: bool, tolerance: float) -> tuple[FloatArray, FloatArray]:
    """Points (M, 2) and bulges (M,) of the border ``points`` (N, 2) of which the rows ``kept`` are thinned out.

    A closed border ends with its first point again, and so does what is returned.
    """
    if closed:
        circle = whole_circle(points, kept, tolerance)
        if circle is not None:
            return circle
    corners = points[kept]
    knots, is_arc = _runs(points, kept, tolerance)
    stays = np.zeros(len(knots), dtype=np.bool_)
    for _ in range(_MOST_REPAIRS):
        placed = _place(points, knots, is_arc, stays, closed, tolerance)
        bulges = _bulges(points, knots, is_arc, placed)
        bad = _too_far(points, knots, placed, bulges, tolerance)
        if not bad.any():
            return placed, np.append(bulges, 0.0)
        # What fails gets the border's own points as ends, then becomes lines again.
        hopeless = bad & stays[:-1] & stays[1:]
        stays |= np.append(bad, False) | np.append(False, bad)
        stays[[0, -1]] |= closed and bool(stays[0] | stays[-1])
        knots, is_arc, stays = _as_lines(kept, knots, is_arc, stays, hopeless)
    return corners, np.zeros(len(corners))


def _as_lines(
    kept: IntArray, knots: IntArray, is_arc: BoolArray, stays: BoolArray, hopeless: BoolArray
) -> tuple[IntArray, BoolArray, BoolArray]:
    """Knots, arcs and knots that stay with the arcs ``hopeless`` as the lines over the corners ``kept``."""
    if not hopeless.any():
        return knots, is_arc, stays
    gone = np.repeat(hopeless, np.diff(np.searchsorted(kept, knots)))
    all_knots = np.union1d(knots, np.append(kept[:-1][gone], knots[-1]))
    old = np.searchsorted(knots, all_knots[:-1], side="right") - 1
    arcs = is_arc[old] & ~hopeless[old]
    at_knot = np.isin(all_knots, knots)
    stay = np.ones(len(all_knots), dtype=np.bool_)
    stay[at_knot] = stays
    return all_knots, arcs, stay


def _runs(points: FloatArray, kept: IntArray, tolerance: float) -> tuple[IntArray, BoolArray]:
    """The rows of ``points`` at which lines and arcs meet, and which of those between them are arcs."""
    rows, count = kept.tolist(), len(kept) - 1
    tolerance *= _FIT_SHARE
    limits = _before_corners(points[kept])
    knots, arcs = [0], []
    k = 0
    while k < count:
        limit = limits[k]

        def straight(end: int, first: int = rows[k]) -> bool:
            return _line_off(points[first : rows[end] + 1]) <= tolerance

        def round_(end: int, first: int = rows[k]) -> bool:
            return _is_arc(points[first : rows[end] + 1], tolerance)

        end = _farthest(straight, k + 1, limit)
        by_arc = (
            _farthest(round_, k + _LEAST_LINES, limit) if limit - k >= _LEAST_LINES and round_(k + _LEAST_LINES) else k
        )
        arcs.append(by_arc > end)
        k = max(end, by_arc)
        knots.append(rows[k])
    return _without_chamfers(points, np.array(knots), np.array(arcs, dtype=np.bool_), tolerance)


def _before_corners(corners: FloatArray) -> list[int]:
    """For each corner but the last the next one, from the second after it on, at which the way turns sharply."""
    step = np.diff(corners, axis=0)
    turn = turns(step[:-1], step[1:])
    sharp = np.append(np.flatnonzero(np.abs(turn) >= _CORNER_TURN) + 1, len(corners) - 1)
    following = np.searchsorted(sharp, np.arange(len(corners) - 1), side="right")
    return [int(k) for k in sharp[following]]


def _farthest(fits: Callable[[int], bool], good: int, limit: int) -> int:
    """The last of good .. limit that fits, if those that do come first; ``good`` does."""
    step = 1
    while good + step <= limit and fits(good + step):
        good += step
        step *= 2
    while step > 1:
        step //= 2
        if good + step <= limit and fits(good + step):
            good += step
    return good


def _line_off(stretch: FloatArray) -> float:
    """The largest distance of points from the line through them with the least square distance."""
    local = stretch - np.add.reduce(stretch) / len(stretch)
    x, y = local.T
    angle = np.arctan2(2 * float(x @ y), float(x @ x - y @ y)) / 2
    return float(np.abs(y * np.cos(angle) - x * np.sin(angle)).max())


def _is_arc(stretch: FloatArray, tolerance: float) -> bool:
    if len(stretch) <= _POINTS:
        return False
    centre, radius, off = circle_of(stretch)
    if off > tolerance or radius < SMALLEST * tolerance:
        return False
    return bool(abs(measure_turn(stretch - centre)) <= _MOST_ARC_TURN)


def _without_chamfers(
    points: FloatArray, knots: IntArray, is_arc: BoolArray, tolerance: float
) -> tuple[IntArray, BoolArray]:
    """Without the short lines that the border of pixels has across each corner: their neighbours meet in the middle."""
    size = np.hypot(*(points[knots[1:]] - points[knots[:-1]]).T)
    short = (size <= _CHAMFER * tolerance) & (np.diff(knots) <= _POINTS) & ~is_arc
    short[[0, -1]] = False
    # Of two short ones in a row the first goes.
    short[1:] &= ~short[:-1]
    k = np.flatnonzero(short)
    knots = knots.copy()
    knots[k] = (knots[k] + knots[k + 1]) // 2
    return np.delete(knots, k + 1), np.delete(is_arc, k)


def _place(
    points: FloatArray, knots: IntArray, is_arc: BoolArray, stays: BoolArray, closed: bool, tolerance: float
) -> FloatArray:
    """The knots moved to where lines cross or arcs begin, by at most ``tolerance``, except those that stay."""
    placed = points[knots].copy()
    shapes = [_shape(points[a : b + 1], bool(arc)) for (a, b), arc in zip(pairwise(knots), is_arc, strict=True)]
    for k in range(len(knots)):
        if stays[k] or (not closed and k in (0, len(knots) - 1)):
            continue
        before, after = shapes[k - 1 if k else -1], shapes[k if k < len(shapes) else 0]
        moved = _meeting(placed[k], before, after)
        if moved is not None and np.hypot(*(moved - placed[k])) <= tolerance:
            placed[k] = moved
    return placed


#: Of a line: a point and its direction. Of an arc: its centre and (radius, NaN). None: too few points.
_Shape = tuple[FloatArray, FloatArray] | None


def _shape(stretch: FloatArray, arc: bool) -> _Shape:
    if arc:
        centre, radius, _ = circle_of(stretch)
        return centre, np.array([radius, np.nan])
    # The ends may be rounded by the corners there.
    inner = stretch[1:-1]
    if len(inner) < _POINTS:
        return None
    middle = np.add.reduce(inner) / len(inner)
    x, y = (inner - middle).T
    angle = np.arctan2(2 * float(x @ y), float(x @ x - y @ y)) / 2
    return middle, np.array([np.cos(angle), np.sin(angle)])


def _meeting(at: FloatArray, before: _Shape, after: _Shape) -> FloatArray | None:
    """Where two neighbours meet near ``at``: two lines where they cross, else half-way between their nearest points.

    A neighbour of too few points to know it is met where the other one ends.
    """
    if before is None or after is None:
        only = before or after
        return None if only is None else _nearest(at, *only)
    (p, u), (q, v) = before, after
    if not np.isnan(u[1]) and not np.isnan(v[1]):
        cross = float(u[0] * v[1] - u[1] * v[0])
        if abs(cross) > np.sin(_CROSSING_TURN):
            d = q - p
            return np.asarray(p + u * float(d[0] * v[1] - d[1] * v[0]) / cross)
    return (_nearest(at, p, u) + _nearest(at, q, v)) / 2


def _nearest(at: FloatArray, p: FloatArray, u: FloatArray) -> FloatArray:
    if np.isnan(u[1]):
        away = at - p
        return np.asarray(p + away * (u[0] / max(float(np.hypot(*away)), NONZERO)))
    return np.asarray(p + u * float((at - p) @ u))


def _bulges(points: FloatArray, knots: IntArray, is_arc: BoolArray, placed: FloatArray) -> FloatArray:
    """Bulges (K - 1,): of an arc the mean of what the points of its middle half say (inscribed angle)."""
    bulges = np.zeros(len(is_arc))
    for k in np.flatnonzero(is_arc).tolist():
        low, high = int(knots[k]), int(knots[k + 1])
        quarter = (high - low) // 4
        inner = points[low + quarter : high + 1 - quarter]
        half = turns(inner - placed[k], placed[k + 1] - inner)
        bulges[k] = np.tan(half.mean() / 2)
    return bulges


def _too_far(
    points: FloatArray, knots: IntArray, placed: FloatArray, bulges: FloatArray, tolerance: float
) -> BoolArray:
    """Which of the lines and arcs (K - 1,) leave the border by more than ``tolerance`` somewhere."""
    counts = np.diff(knots) + 1
    of, begin, rows = owners(counts), begins(counts), stretches(knots[:-1], counts)
    length = np.hypot(*np.diff(placed, axis=0).T)
    flat = length < 1e-9
    with np.errstate(all="ignore"):
        x, y = points[rows].T
        off = to_arc(x, y, placed[:-1][of], placed[1:][of], bulges[of])
        radius = length * (1 + bulges**2) / (4 * np.abs(bulges))
        step = np.hypot(*np.diff(points[rows], axis=0, append=points[-1:]).T)
    step[begin + counts - 1] = 0.0
    most = np.maximum.reduceat(off, begin) + np.maximum.reduceat(step, begin) ** 2 / (8 * radius)
    small = radius < SMALLEST * tolerance
    return np.asarray(flat | small | (np.abs(bulges) > 1.0) | ~(most <= tolerance * (1 + 1e-9)))
