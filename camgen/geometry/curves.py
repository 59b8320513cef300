"""Ellipses, B-splines and Bezier curves as arcs and lines within a tolerance.

Every curve becomes a run of rational Bezier segments first (an ellipse is one exactly), so that one fitter serves all.
The fitter lays a biarc (two arcs that meet with a common tangent) through both ends of an interval and their tangents,
measures the curve against it, and divides the interval until it fits. The deviation falls with the cube of the width,
which tells into how many parts: halving would leave up to twice as many arcs. Many curves are handled at once.

Only distances from the curve to the biarc are taken. The way back holds by continuity: while the point runs along the
curve its foot runs along the biarc from end to end, so that every point of the biarc is a foot. That needs arcs whose
radius is well above the tolerance; smaller ones are refused, and the curve is divided until lines serve.

A run is an array (S, degree + 1, 3) of segments as homogeneous control points (w x, w y, w).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from math import comb

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.ragged import begins, ramp
from camgen.geometry.vectors import turns
from camgen.model.pose import FloatArray
from camgen.model.text import counted

# Biarcs and arcs by their bulges, many at once: (K, 2) points, (K,) bulges, stable down to a straight line.


def radius(a: FloatArray, b: FloatArray, bulge: FloatArray) -> FloatArray:
    """Radii (K,) of the arcs a -> b, inf for a line."""
    size = np.abs(bulge)
    return np.asarray(np.hypot(*(b - a).T) * (1 + size * size) / (4 * size))


def biarc(
    start: FloatArray, end: FloatArray, t0: FloatArray, t1: FloatArray
) -> tuple[FloatArray, ...]:
    """Joint (K, 2) and the two bulges of the biarc with equal tangent lengths; NaN if an arc passes a half circle.

    The joint lies at distance d along both tangents such that |joint0 - joint1| = 2 d (Bolton 1975).
    """
    v, t = end - start, t0 + t1
    vv, vt, tt = (np.einsum("kd,kd->k", a, b) for a, b in ((v, v), (v, t), (t0, t1)))
    bend = 2 * (1 - tt)
    with np.errstate(all="ignore"):
        root = np.sqrt(vt * vt + bend * vv)
        # The form without cancellation: bend -> 0 leaves vv / (2 vt), the parallel case.
        d = vv / (vt + root)
        joint = (start + end + d[:, None] * (t0 - t1)) / 2
        half0, half1 = turns(t0, joint - start), turns(end - joint, t1)
        wrong = (np.abs(half0) > math.pi / 2) | (np.abs(half1) > math.pi / 2) | ~np.isfinite(d)
        b0, b1 = np.tan(half0 / 2), np.tan(half1 / 2)
    b0[wrong] = b1[wrong] = np.nan
    return joint, b0, b1


def to_arc(
    x: FloatArray, y: FloatArray, a: FloatArray, b: FloatArray, bulge: FloatArray
) -> FloatArray:
    """Distances (..., K) of points x, y (..., K) to the arcs a -> b; stable down to bulge 0, a line."""
    chord = b - a
    c = np.hypot(chord[:, 0], chord[:, 1])
    ex, ey = chord.T / c
    right, up = x - a[:, 0], y - a[:, 1]
    x, y = right * ex + up * ey, up * ex - right * ey
    g = bulge
    k = 4 * g / c
    square = x * x + y * y
    # Everything times 4 |bulge| / chord: the circle's equation stays finite when its centre runs away.
    radial = np.sqrt((k * (x - c / 2)) ** 2 + (k * y - (1 - g * g)) ** 2)
    off = np.abs(((square - c * x) * k - 2 * (1 - g * g) * y) / (radial + 1 + g * g))
    half = 2 * np.arctan(g)
    cos, sin = np.cos(half), np.sin(half)
    ahead = x * cos - y * sin >= 0
    behind = (x - c) * cos + y * sin <= 0
    ends = np.sqrt(np.minimum(square, (x - c) ** 2 + y * y))
    return np.asarray(np.where(ahead & behind, off, ends))


IntArray = NDArray[np.intp]
BoolArray = NDArray[np.bool_]
#: Segments, where their intervals begin, and rows (K, 2, 3) of x, y, bulge.
_Done = tuple[IntArray, FloatArray, FloatArray]
Outline = tuple[FloatArray, FloatArray]

#: Samples per interval; the deviation of a biarc is smooth, so its maximum lies close to one of them.
_INTERVAL_SAMPLES = 12
_EVENLY = np.linspace(0.0, 1.0, _INTERVAL_SAMPLES + 1)
#: Part of the tolerance that the samples may use; the rest is for what lies between them.
_SAMPLES_SHARE = 0.9
#: Least deviation asked for, as a part of the size of the curve.
_FINEST = 1e-11
#: Control points beyond this are damage.
_FARTHEST_CONTROL = 1e15
#: Divisions at most: a cusp ends in an interval far below any tolerance.
_MOST_DIVISIONS = 40
#: Parts at most of one division, since a large deviation says little.
_MOST_PARTS = 6
#: Segments fitted together: more would only leave the processor's cache.
_BATCH = 512
#: Intervals that turn further are divided whatever the samples say, so that no loop hides between them (cosine).
_LEAST_TURN_COSINE = 0.2


def ellipse(
    center: FloatArray, first: FloatArray, second: FloatArray, start: float, end: float
) -> FloatArray:
    """The arc center + first cos t + second sin t, t from ``start`` to ``end`` (rad), as rational quadratics.

    ``first`` and ``second`` (2,) are any two conjugate half diameters; ``end`` may lie before ``start``.
    """
    count = max(1, math.ceil(abs(end - start) / (math.pi / 2) - 1e-9))
    knots = np.linspace(start, end, count + 1)
    half = (end - start) / count / 2
    weight = math.cos(half)
    middle = (knots[:-1] + knots[1:]) / 2
    outer = center + np.cos(knots)[:, None] * first + np.sin(knots)[:, None] * second
    inner = center * weight + np.cos(middle)[:, None] * first + np.sin(middle)[:, None] * second
    segments = np.ones((count, 3, 3))
    segments[:, 0, :2], segments[:, 2, :2] = outer[:-1], outer[1:]
    segments[:, 1, :2], segments[:, 1, 2] = inner, weight
    return segments


def bezier(control: FloatArray) -> FloatArray:
    """Plain Bezier segments (S, degree + 1, 2) as a run."""
    return np.concatenate([control, np.ones((*control.shape[:2], 1))], axis=2)


def bspline(
    control: FloatArray, knots: FloatArray, degree: int, weights: FloatArray | None = None
) -> FloatArray:
    """A B-spline with ``control`` (N, D) and N + degree + 1 ``knots`` as Bezier segments (S, degree + 1, D + 1), by
    blossoming.

    The control points of the segment between two knots are the blossom of the spline at those two knots (Ramshaw),
    which holds for clamped, open and periodic knots alike. ``ValueError`` if the numbers do not make a spline.
    """
    count = len(control)
    if (
        degree < 1
        or count <= degree
        or len(knots) != count + degree + 1
        or not np.all(np.diff(knots) >= 0)
    ):
        raise ValueError(
            f"{counted(count, 'control point')}, {counted(len(knots), 'knot')} and degree {degree} make no spline"
        )
    weight = (
        np.ones(count)
        if weights is None or len(weights) != count
        else np.asarray(weights, dtype=np.float64)
    )
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
    """De Boor's triangle with a different argument at each level, for all ``spans`` at once."""
    local = points[spans[:, None] + np.arange(-degree, 1)]
    for level, t in enumerate(arguments, start=1):
        index = spans[:, None] + np.arange(level - degree, 1)
        left, right = knots[index], knots[index + degree + 1 - level]
        share = ((t[:, None] - left) / (right - left))[:, :, None]
        local = local[:, :-1] * (1 - share) + local[:, 1:] * share
    return np.asarray(local[:, 0])


def fit(curves: Sequence[FloatArray], chord: float) -> list[Outline]:
    """Each curve as points (N, 2) and bulges (N,), open, last bulge 0; no farther than ``chord`` from the curve.

    Deviation is meant both ways (Hausdorff). Every arc is at most a half circle. A curve with numbers that are not
    finite or out of all proportion comes back as two points at infinity.
    """
    lost = (np.full((2, 2), np.inf), np.zeros(2))
    with np.errstate(all="ignore"):
        sound = [bool((np.abs(c[..., :2] / c[..., 2:]) < _FARTHEST_CONTROL).all()) for c in curves]
    outlines: dict[int, Outline] = {}
    for size in {c.shape[1] for c, good in zip(curves, sound, strict=True) if good}:
        members = [i for i, c in enumerate(curves) if sound[i] and c.shape[1] == size]
        outlines |= zip(members, _fit_alike([curves[i] for i in members], chord), strict=True)
    return [outlines.get(i, lost) for i in range(len(curves))]


class _Intervals(Struct, frozen=True):
    """Pieces of segments by their own control points, (K, degree + 1, 3). low: where they begin, 0 to 1.

    size: how far the segment's control points are apart, widths: the part of the segment, both (K,).
    """

    segment: IntArray
    low: FloatArray
    control: FloatArray
    size: FloatArray
    width: FloatArray

    @classmethod
    def whole(cls, segment: IntArray, control: FloatArray) -> _Intervals:
        places = control[..., :2] / control[..., 2:]
        size = np.maximum(*np.abs(places - places[:, :1]).max(axis=1).T)
        return cls(segment, np.zeros(len(segment)), control, size, np.ones(len(segment)))

    def divided(self, which: BoolArray, parts: IntArray) -> _Intervals:
        """Those of ``which``, each in so many equal parts."""
        of = np.repeat(np.flatnonzero(which), parts)
        count = np.repeat(parts, parts)
        step = ramp(parts)
        start, end = step / count, (step + 1) / count
        width = self.width[of] / count
        low = self.low[of] + width * step
        return _Intervals(
            self.segment[of], low, _between(self.control[of], start, end), self.size[of], width
        )

    def points(self, u: FloatArray) -> FloatArray:
        """Points (2, M, K) at ``u`` (M,), 0 to 1 from end to end of each interval."""
        h = np.tensordot(_bernstein(self.control.shape[1] - 1, u), self.control, axes=(1, 1))
        return np.moveaxis(h[..., :2] / h[..., 2:], 2, 0)

    def tangents(self, end: bool) -> FloatArray:
        """Unit tangents (K, 2) at the start or the end, from a short chord where the derivative vanishes."""
        at, before, after = (-1, -2, -1) if end else (0, 0, 1)
        value = self.control[:, at]
        slope = (
            (self.control[:, after] - self.control[:, before])
            * (self.control.shape[1] - 1)
            / self.width[:, None]
        )
        tangent = (slope[:, :2] * value[:, 2:] - value[:, :2] * slope[:, 2:]) / value[:, 2:] ** 2
        flat = np.hypot(tangent[:, 0], tangent[:, 1]) < 1e-7 * self.size
        if flat.any():
            near = self.points(np.array([1 - 1e-3, 1.0] if end else [0.0, 1e-3]))[..., flat]
            tangent[flat] = (near[:, 1] - near[:, 0]).T
        norm = np.hypot(tangent[:, 0], tangent[:, 1])[:, None]
        return np.asarray(tangent / np.where(norm > 0, norm, 1.0))


def _between(control: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """The control points (K, degree + 1, 3) of the stretches start to end, by de Casteljau with mixed arguments."""
    degree = control.shape[1] - 1
    a, b = start[:, None, None], end[:, None, None]
    found = np.empty_like(control)
    # Each row of the loop has one level more with ``start`` behind it; the rest is done with ``end``.
    for k in range(degree, -1, -1):
        local = control
        for _ in range(k):
            local = local[:, :-1] * (1 - b) + local[:, 1:] * b
        found[:, k] = local[:, 0]
        if k:
            control = control[:, :-1] * (1 - a) + control[:, 1:] * a
    return found


def _bernstein(degree: int, t: FloatArray) -> FloatArray:
    """The Bernstein polynomials at ``t``, in a last axis of their own."""
    i = np.arange(degree + 1)
    binomials = np.array([comb(degree, k) for k in i], dtype=np.float64)
    return np.asarray(binomials * t[..., None] ** i * (1 - t[..., None]) ** (degree - i))


def _fit_alike(curves: list[FloatArray], chord: float) -> list[Outline]:
    """``fit`` for curves of one degree."""
    counts = np.array([len(c) for c in curves])
    owner = np.repeat(np.arange(len(curves)), counts)
    control = np.concatenate(curves)
    first = begins(counts)
    origin = control[first, 0, :2] / control[first, 0, 2:]
    # Close to zero the full precision is there, wherever the drawing lies.
    control[..., :2] -= origin[owner][:, None] * control[..., 2:]
    # No interval can be closer than rounding leaves it.
    reach = np.abs(control[..., :2] / control[..., 2:]).max(axis=(1, 2))
    limit = _SAMPLES_SHARE * np.maximum(chord, _FINEST * reach)
    done: list[_Done] = []
    for begin in range(0, len(control), _BATCH):
        segment = np.arange(begin, min(begin + _BATCH, len(control)))
        _divide(_Intervals.whole(segment, control[segment]), limit, done)
    final = control[np.cumsum(counts) - 1, -1]
    return _outlines(owner, origin, final[:, :2] / final[:, 2:], done)


def _divide(todo: _Intervals, limit: FloatArray, done: list[_Done]) -> None:
    """Append segment, start and rows of every interval that fits to ``done``, dividing what does not.

    limit: deviation allowed for each segment.
    """
    for depth in range(_MOST_DIVISIONS):
        allowed = limit[todo.segment]
        rows, deviation = _biarcs(todo, allowed)
        bad = (deviation > allowed) & (depth < _MOST_DIVISIONS - 1)
        done.append((todo.segment[~bad], todo.low[~bad], rows[~bad]))
        if not bad.any():
            return
        wanted = np.where(np.isinf(deviation), 2, np.ceil(np.cbrt(deviation / allowed)))[bad]
        todo = todo.divided(bad, np.clip(wanted, 2, _MOST_PARTS).astype(np.intp))


def _outlines(
    owner: IntArray, origin: FloatArray, final: FloatArray, done: list[_Done]
) -> list[Outline]:
    """The pieces (K, 2, 3) of x, y, bulge in order of their curves, each closed with its last point ``final``."""
    segment, low, pieces = (np.concatenate(column) for column in zip(*done, strict=True))
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


def _biarcs(todo: _Intervals, allowed: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rows of x, y, bulge (K, 2, 3) of the biarc of each interval and its deviation (K,), inf where there is none.

    A straight interval is one row, the other is NaN.
    """
    x, y = todo.points(_EVENLY)
    start, end = np.column_stack([x[0], y[0]]), np.column_stack([x[-1], y[-1]])
    t0, t1 = todo.tangents(end=False), todo.tangents(end=True)
    joint, b0, b1 = biarc(start, end, t0, t1)
    with np.errstate(all="ignore"):
        first, second = (
            to_arc(x[1:-1], y[1:-1], start, joint, b0),
            to_arc(x[1:-1], y[1:-1], joint, end, b1),
        )
        deviation = np.minimum(first, second).max(axis=0)
        refused = (np.einsum("kd,kd->k", t0, t1) < _LEAST_TURN_COSINE) | ~np.isfinite(deviation)
        refused |= np.minimum(radius(start, joint, b0), radius(joint, end, b1)) < 2 * allowed
    line = _straight(x, y, np.where(refused, allowed, 0.0))
    rows = np.stack([np.column_stack([start, b0]), np.column_stack([joint, b1])], axis=1)
    rows[line, 0, 2] = 0.0
    rows[line, 1] = np.nan
    return rows, np.where(line, 0.0, np.where(refused, np.inf, deviation))


def _straight(x: FloatArray, y: FloatArray, allowed: FloatArray) -> BoolArray:
    """Which columns of the samples x, y (M, K) lie within ``allowed`` (K,), or rounding, of the line over them."""
    chord = np.hypot(x[-1] - x[0], y[-1] - y[0])
    allowed = np.maximum(allowed, 1e-9 * chord)
    # From the middle sample few are left to look at.
    k, middle = np.arange(len(chord)), len(x) // 2
    away = (x[middle] - x[0]) * (y[-1] - y[0]) - (y[middle] - y[0]) * (x[-1] - x[0])
    k = k[np.abs(away) <= 2 * allowed * chord]
    start, end = np.column_stack([x[0, k], y[0, k]]), np.column_stack([x[-1, k], y[-1, k]])
    with np.errstate(all="ignore"):
        off = to_arc(x[1:-1, k], y[1:-1, k], start, end, np.zeros(len(k))).max(axis=0)
    off = np.where(
        np.isfinite(off), off, np.maximum(np.ptp(x[:, k], axis=0), np.ptp(y[:, k], axis=0))
    )
    found = np.zeros(len(chord), dtype=np.bool_)
    found[k] = off <= allowed[k]
    return found
