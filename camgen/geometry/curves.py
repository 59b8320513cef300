"""Fits lines and arcs to ellipses, B-splines and Bezier curves within a tolerance.

Every curve first becomes a run of rational Bezier segments (an ellipse is one exactly), so that one
fitter serves all. A run is an array (S, degree + 1, 3) of segments as homogeneous control points
(w x, w y, w).

The fitter puts a biarc (two arcs that meet with a common tangent) through both ends of an interval
and their tangents, measures its distance from the curve, and divides the interval until it fits.
The deviation falls with the cube of the width, so one division makes as many parts as are needed;
halving would leave up to twice as many arcs. Many curves are fitted at once.

Only distances from points of the curve to the biarc are measured. The other direction follows by
continuity: while a point moves along the curve, its foot moves along the biarc from end to end, so
every point of the biarc is a foot. That needs arcs with a radius well above the tolerance. Smaller
arcs are refused, and the curve is divided until lines fit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from math import comb

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import (
    compute_first_rows,
    concatenate_columns,
    count_rows,
    list_owners,
    number_rows,
)
from camgen.geometry.vectors import measure_signed_angles
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray
from camgen.model.text import counted

# Many biarcs, and arcs given by their bulges: points (K, 2), bulges (K,). The formulas are stable
# down to a straight line.


def compute_radius(a: FloatArray, b: FloatArray, bulge: FloatArray) -> FloatArray:
    """(K,) radii of the arcs from a to b (K, 2), inf for a line."""
    size = np.abs(bulge)
    return np.asarray(np.hypot(*(b - a).T) * (1 + size * size) / (4 * size))


def make_biarc(
    start: FloatArray, end: FloatArray, t0: FloatArray, t1: FloatArray
) -> tuple[FloatArray, ...]:
    """Biarcs with equal tangent lengths: the joint (K, 2) of both arcs, and their bulges (K,).

    start, end: (K, 2) ends.
    t0, t1: (K, 2) unit tangents there.

    Bulges are NaN if an arc would exceed half a circle. The joint is at the distance d along both
    tangents for which |joint0 - joint1| = 2 d (Bolton 1975).
    """
    v, t = end - start, t0 + t1
    vv, vt, tt = (np.einsum("kd,kd->k", a, b) for a, b in ((v, v), (v, t), (t0, t1)))
    bend = 2 * (1 - tt)
    with np.errstate(all="ignore"):
        # This form has no cancellation: for bend = 0, the parallel case, it is vv / (2 vt).
        d = vv / (vt + np.sqrt(vt * vt + bend * vv))
        joint = (start + end + d[:, None] * (t0 - t1)) / 2
        half0 = measure_signed_angles(t0, joint - start)
        half1 = measure_signed_angles(end - joint, t1)
        wrong = (np.abs(half0) > math.pi / 2) | (np.abs(half1) > math.pi / 2) | ~np.isfinite(d)
        b0, b1 = np.tan(half0 / 2), np.tan(half1 / 2)
    b0[wrong] = b1[wrong] = np.nan
    return joint, b0, b1


def measure_from_arc(
    x: FloatArray, y: FloatArray, a: FloatArray, b: FloatArray, bulge: FloatArray
) -> FloatArray:
    """(..., K) distances of points x, y from the arcs a to b; stable down to a line, bulge 0."""
    chord = b - a
    c = np.hypot(chord[:, 0], chord[:, 1])
    ex, ey = chord.T / c
    right, up = x - a[:, 0], y - a[:, 1]
    x, y = right * ex + up * ey, up * ex - right * ey
    g = bulge
    k = 4 * g / c
    square = x * x + y * y
    # All is multiplied by 4 |bulge| / chord, so that the equation of the circle stays finite when
    # its centre goes to infinity.
    radial = np.sqrt((k * (x - c / 2)) ** 2 + (k * y - (1 - g * g)) ** 2)
    to_circle = np.abs(((square - c * x) * k - 2 * (1 - g * g) * y) / (radial + 1 + g * g))
    half = 2 * np.arctan(g)
    cos, sin = np.cos(half), np.sin(half)
    is_after_start = x * cos - y * sin >= 0
    is_before_end = (x - c) * cos + y * sin <= 0
    to_ends = np.sqrt(np.minimum(square, (x - c) ** 2 + y * y))
    return np.asarray(np.where(is_after_start & is_before_end, to_circle, to_ends))


#: Segments (K,), the parameters at which their intervals begin (K,), and rows of x, y, bulge
#: (K, 2, 3).
_Done = tuple[IntArray, FloatArray, FloatArray]
#: Points (N, 2) and bulges (N,) of an open contour.
Outline = tuple[FloatArray, FloatArray]

#: Samples per interval. The deviation of a biarc is smooth, so its maximum is close to a sample.
_INTERVAL_SAMPLES = 12
_SAMPLE_PLACES = np.linspace(0.0, 1.0, _INTERVAL_SAMPLES + 1)
#: Fraction of the tolerance that is allowed at the samples. The rest is for the curve between them.
SAMPLE_FRACTION = 0.9
#: Smallest tolerance, as a fraction of the size of the curve; below it rounding decides.
FINEST = 1e-11
#: mm: a control point farther away is damage.
_FARTHEST_CONTROL = 1e15
#: Divisions of an interval, at most. A cusp ends in an interval far below any tolerance.
MAX_DIVISIONS = 40
#: Parts of one division, at most: a large deviation is a poor estimate of the parts needed.
_MAX_PARTS = 6
#: Segments that are fitted together. More would not stay in the cache of the processor.
_BATCH = 512
#: Cosine of the angle between the ends of an interval. An interval that turns more is divided
#: whatever the samples are, so that no loop hides between them.
_LEAST_TURN_COSINE = 0.2
#: Fraction of the size of a segment. A derivative below it has no reliable direction.
_LEAST_SLOPE = 1e-7
#: Part of an interval whose chord replaces the tangent where the derivative vanishes.
_TANGENT_CHORD = 1e-3
#: Quarter turns by which an arc of an ellipse may exceed its segments through rounding.
_QUARTER_ROUNDING = 1e-9
#: Fraction of a chord by which samples are off it through rounding.
_LINE_ROUNDING = 1e-9


def make_ellipse(
    center: FloatArray, first: FloatArray, second: FloatArray, start: float, end: float
) -> FloatArray:
    """The arc center + first cos t + second sin t, for t from `start` to `end`, rad, as a run.

    Its segments are rational quadratics.

    first, second: (2,) any two conjugate half diameters, mm.
    end: may be below `start`.
    """
    count = max(1, math.ceil(abs(end - start) / (math.pi / 2) - _QUARTER_ROUNDING))
    knots = np.linspace(start, end, count + 1)
    weight = math.cos((end - start) / count / 2)
    middle = (knots[:-1] + knots[1:]) / 2
    outer = center + np.cos(knots)[:, None] * first + np.sin(knots)[:, None] * second
    inner = center * weight + np.cos(middle)[:, None] * first + np.sin(middle)[:, None] * second
    segments = np.ones((count, 3, 3))
    segments[:, 0, :2], segments[:, 2, :2] = outer[:-1], outer[1:]
    segments[:, 1, :2], segments[:, 1, 2] = inner, weight
    return segments


def make_bezier(control: FloatArray) -> FloatArray:
    """Bezier segments (S, degree + 1, 2) without weights as a run."""
    return np.concatenate([control, np.ones((*control.shape[:2], 1))], axis=2)


def make_bspline(
    control: FloatArray, knots: FloatArray, degree: int, weights: FloatArray | None = None
) -> FloatArray:
    """A B-spline as Bezier segments (S, degree + 1, D + 1), by blossoming.

    The control points of the segment between two knots are the blossom of the spline at these knots
    (Ramshaw). That holds for clamped, open and periodic knots.

    control: (N, D).
    knots: (N + degree + 1,), not decreasing.
    weights: (N,), positive. None or an empty array stands for 1 throughout.

    Raises ValueError if the numbers do not make a spline.
    """
    count = len(control)
    has_size = degree >= 1 and count > degree and len(knots) == count + degree + 1
    if not has_size or not np.all(np.diff(knots) >= 0):
        points, knot_count = counted(count, "control point"), counted(len(knots), "knot")
        raise ValueError(f"{points}, {knot_count} and degree {degree} make no spline")
    weight = np.ones(count)
    if weights is not None and len(weights):
        weight = np.asarray(weights, dtype=np.float64)
    if len(weight) != count:
        points, weight_count = counted(count, "control point"), counted(len(weight), "weight")
        raise ValueError(f"{points} and {weight_count} make no spline")
    if not np.all(weight > 0):
        raise ValueError("a weight that is not positive")
    homogeneous = np.column_stack([control * weight[:, None], weight])
    spans = degree + np.flatnonzero(np.diff(knots[degree : count + 1]) > 0)
    if not len(spans):
        raise ValueError("all knots are one")
    low, high = knots[spans], knots[spans + 1]
    segments = np.empty((len(spans), degree + 1, homogeneous.shape[1]))
    for k in range(degree + 1):
        arguments = [low] * (degree - k) + [high] * k
        segments[:, k] = _blossom(homogeneous, knots, degree, spans, arguments)
    return segments


def _blossom(
    points: FloatArray, knots: FloatArray, degree: int, spans: IntArray, arguments: list[FloatArray]
) -> FloatArray:
    """De Boor's triangle for all `spans` (S,) at once, with a different argument at each level."""
    local = points[spans[:, None] + np.arange(-degree, 1)]
    for level, t in enumerate(arguments, start=1):
        index = spans[:, None] + np.arange(level - degree, 1)
        left, right = knots[index], knots[index + degree + 1 - level]
        fraction = ((t[:, None] - left) / (right - left))[:, :, None]
        local = local[:, :-1] * (1 - fraction) + local[:, 1:] * fraction
    return np.asarray(local[:, 0])


def fit(curves: Sequence[FloatArray], chord: float) -> list[Outline]:
    """Outlines of curves, given as runs: open, the last bulge 0, within `chord` mm of the curve.

    That is the deviation in both directions (Hausdorff distance). No arc exceeds half a circle. A
    curve with numbers that are not finite, or much too large, becomes two points at infinity.
    """
    damaged = (np.full((2, 2), np.inf), np.zeros(2))
    members_of: dict[int, list[int]] = {}
    for index, curve in enumerate(curves):
        with np.errstate(all="ignore"):
            is_valid = (np.abs(curve[..., :2] / curve[..., 2:]) < _FARTHEST_CONTROL).all()
        if is_valid:
            members_of.setdefault(curve.shape[1], []).append(index)
    outlines: dict[int, Outline] = {}
    for members in members_of.values():
        same_degree = [curves[index] for index in members]
        outlines |= zip(members, _fit_same_degree(same_degree, chord), strict=True)
    return [outlines.get(index, damaged) for index in range(len(curves))]


class _Intervals(Struct, frozen=True):
    """K pieces of segments, with their own control points.

    segment: (K,) the segment of each piece.
    low: (K,) parameter of the segment at which the piece begins, 0 to 1.
    control: (K, degree + 1, 3) homogeneous control points of the piece.
    size: (K,) extent of the control points of the segment, mm.
    width: (K,) length of the piece as a part of the segment, 0 to 1.
    """

    segment: IntArray
    low: FloatArray
    control: FloatArray
    size: FloatArray
    width: FloatArray

    @classmethod
    def whole(cls, segment: IntArray, control: FloatArray) -> _Intervals:
        """Whole segments (K,) with their control points."""
        places = control[..., :2] / control[..., 2:]
        size = np.maximum(*np.abs(places - places[:, :1]).max(axis=1).T)
        return cls(segment, np.zeros(len(segment)), control, size, np.ones(len(segment)))

    def divided(self, which: BoolArray, parts: IntArray) -> _Intervals:
        """The pieces chosen by the mask `which`, each divided into `parts` (M,) equal parts."""
        owner = np.repeat(np.flatnonzero(which), parts)
        count = np.repeat(parts, parts)
        step = number_rows(parts)
        start, end = step / count, (step + 1) / count
        width = self.width[owner] / count
        low = self.low[owner] + width * step
        control = _divide_control(self.control[owner], start, end)
        return _Intervals(self.segment[owner], low, control, self.size[owner], width)

    def points(self, u: FloatArray) -> FloatArray:
        """(2, M, K) x and y of the points at `u` (M,), 0 to 1 from end to end of each piece."""
        basis = compute_bernstein(self.control.shape[1] - 1, u)
        h = np.tensordot(basis, self.control, axes=(1, 1))
        return np.moveaxis(h[..., :2] / h[..., 2:], 2, 0)

    def tangents(self, end: bool) -> FloatArray:
        """(K, 2) unit tangents at the start or the end of each piece.

        Where the derivative vanishes, it is the direction of a short chord.
        """
        at, before, after = (-1, -2, -1) if end else (0, 0, 1)
        value = self.control[:, at]
        difference = self.control[:, after] - self.control[:, before]
        slope = difference * (self.control.shape[1] - 1) / self.width[:, None]
        tangent = (slope[:, :2] * value[:, 2:] - value[:, :2] * slope[:, 2:]) / value[:, 2:] ** 2
        flat = np.hypot(tangent[:, 0], tangent[:, 1]) < _LEAST_SLOPE * self.size
        if flat.any():
            places = [1 - _TANGENT_CHORD, 1.0] if end else [0.0, _TANGENT_CHORD]
            near = self.points(np.array(places))[..., flat]
            tangent[flat] = (near[:, 1] - near[:, 0]).T
        norm = np.hypot(tangent[:, 0], tangent[:, 1])[:, None]
        return np.asarray(tangent / np.where(norm > 0, norm, 1.0))


def _divide_control(control: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """(K, degree + 1, 3) control points of the parts from `start` to `end`, each (K,).

    It is the algorithm of de Casteljau with mixed arguments.
    """
    degree = control.shape[1] - 1
    a, b = start[:, None, None], end[:, None, None]
    result = np.empty_like(control)
    # Point k of the result has k levels with `end` and the others with `start`. Each iteration adds
    # one level with `start` to `control`.
    for k in range(degree, -1, -1):
        local = control
        for _ in range(k):
            local = local[:, :-1] * (1 - b) + local[:, 1:] * b
        result[:, k] = local[:, 0]
        if k:
            control = control[:, :-1] * (1 - a) + control[:, 1:] * a
    return result


def compute_bernstein(degree: int, t: FloatArray) -> FloatArray:
    """(..., degree + 1) Bernstein polynomials at `t` (...)."""
    i = np.arange(degree + 1)
    binomials = np.array([comb(degree, k) for k in i], dtype=np.float64)
    return np.asarray(binomials * t[..., None] ** i * (1 - t[..., None]) ** (degree - i))


def _fit_same_degree(curves: list[FloatArray], chord: float) -> list[Outline]:
    """`fit` for curves of one degree."""
    counts = count_rows(curves)
    owner = list_owners(counts)
    control = np.concatenate(curves)
    first = compute_first_rows(counts)
    origin = control[first, 0, :2] / control[first, 0, 2:]
    # Coordinates relative to the start have full precision, wherever the drawing lies.
    control[..., :2] -= origin[owner][:, None] * control[..., 2:]
    # Rounding limits how closely a curve can be fitted.
    reach = np.abs(control[..., :2] / control[..., 2:]).max(axis=(1, 2))
    limit = SAMPLE_FRACTION * np.maximum(chord, FINEST * reach)
    done: list[_Done] = []
    for begin in range(0, len(control), _BATCH):
        segment = np.arange(begin, min(begin + _BATCH, len(control)))
        _divide(_Intervals.whole(segment, control[segment]), limit, done)
    final = control[np.cumsum(counts) - 1, -1]
    return _make_outlines(owner, origin, final[:, :2] / final[:, 2:], done)


def _divide(todo: _Intervals, limit: FloatArray, done: list[_Done]) -> None:
    """Appends segment, start and rows of each interval that fits to `done`; divides the others.

    limit: allowed deviation of each segment, mm.
    """
    for depth in range(MAX_DIVISIONS):
        allowed = limit[todo.segment]
        rows, deviation = _fit_biarcs(todo, allowed)
        too_far = (deviation > allowed) & (depth < MAX_DIVISIONS - 1)
        fits = ~too_far
        done.append((todo.segment[fits], todo.low[fits], rows[fits]))
        if fits.all():
            return
        parts = np.where(np.isinf(deviation), 2, np.ceil(np.cbrt(deviation / allowed)))[too_far]
        todo = todo.divided(too_far, np.clip(parts, 2, _MAX_PARTS).astype(np.int64))


def _make_outlines(
    owner: IntArray, origin: FloatArray, final: FloatArray, done: list[_Done]
) -> list[Outline]:
    """The outline of each curve from the rows of its intervals and its last point.

    owner: curve of each segment.
    origin, final: (curves, 2) first and last point; all but `origin` is relative to it, mm.
    """
    segment, low, pieces = concatenate_columns(done)
    order = np.lexsort([low, segment])
    rows = pieces[order].reshape(-1, 3)
    curve = np.repeat(owner[segment[order]], 2)
    used = ~np.isnan(rows[:, 0])
    rows, curve = rows[used], curve[used]
    ends = np.searchsorted(curve, np.arange(len(origin)), side="right")
    rows = np.insert(rows, ends, np.column_stack([final, np.zeros(len(final))]), axis=0)
    ends += np.arange(1, len(ends) + 1)
    points = rows[:, :2] + np.repeat(origin, np.diff(ends, prepend=0), axis=0)
    bulges = np.ascontiguousarray(rows[:, 2])
    return [(points[a:b], bulges[a:b]) for a, b in pairwise([0, *ends.tolist()])]


def _fit_biarcs(todo: _Intervals, allowed: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The biarc of each interval as rows of x, y, bulge (K, 2, 3), and its deviation (K,), mm.

    The deviation is inf if there is no biarc. A straight interval is one row; the other is NaN.
    """
    x, y = todo.points(_SAMPLE_PLACES)
    start, end = np.column_stack([x[0], y[0]]), np.column_stack([x[-1], y[-1]])
    t0, t1 = todo.tangents(end=False), todo.tangents(end=True)
    joint, b0, b1 = make_biarc(start, end, t0, t1)
    with np.errstate(all="ignore"):
        first = measure_from_arc(x[1:-1], y[1:-1], start, joint, b0)
        second = measure_from_arc(x[1:-1], y[1:-1], joint, end, b1)
        deviation = np.minimum(first, second).max(axis=0)
        refused = (np.einsum("kd,kd->k", t0, t1) < _LEAST_TURN_COSINE) | ~np.isfinite(deviation)
        refused |= (
            np.minimum(compute_radius(start, joint, b0), compute_radius(joint, end, b1))
            < 2 * allowed
        )
    line = _are_straight(x, y, np.where(refused, allowed, 0.0))
    rows = np.stack([np.column_stack([start, b0]), np.column_stack([joint, b1])], axis=1)
    rows[line, 0, 2] = 0.0
    rows[line, 1] = np.nan
    return rows, np.where(line, 0.0, np.where(refused, np.inf, deviation))


def _are_straight(x: FloatArray, y: FloatArray, allowed: FloatArray) -> BoolArray:
    """(K,) whether the samples x, y (M, K) of an interval are within `allowed` (K,) mm of a line.

    It is the line from the first to the last sample. Rounding is always allowed.
    """
    chord = np.hypot(x[-1] - x[0], y[-1] - y[0])
    allowed = np.maximum(allowed, _LINE_ROUNDING * chord)
    # The middle sample excludes most intervals.
    k, middle = np.arange(len(chord)), len(x) // 2
    moment = (x[middle] - x[0]) * (y[-1] - y[0]) - (y[middle] - y[0]) * (x[-1] - x[0])
    k = k[np.abs(moment) <= 2 * allowed * chord]
    start, end = np.column_stack([x[0, k], y[0, k]]), np.column_stack([x[-1, k], y[-1, k]])
    with np.errstate(all="ignore"):
        distance = measure_from_arc(x[1:-1, k], y[1:-1, k], start, end, np.zeros(len(k))).max(
            axis=0
        )
    # Without a chord there is no line: the extent of the samples decides.
    extent = np.maximum(np.ptp(x[:, k], axis=0), np.ptp(y[:, k], axis=0))
    distance = np.where(np.isfinite(distance), distance, extent)
    result = np.zeros(len(chord), dtype=np.bool_)
    result[k] = distance <= allowed[k]
    return result
