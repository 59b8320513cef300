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
from math import comb

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.pose import FloatArray
from camgen.readers.curves_biarc import biarc, radius, to_arc

IntArray = NDArray[np.intp]
Outline = tuple[FloatArray, FloatArray]

#: Samples per interval; the deviation of a biarc is smooth, so its maximum lies close to one of them.
_SAMPLES = 12
#: Part of the tolerance that the samples may use; the rest is for what lies between them.
_SHARE = 0.9
#: Least deviation asked for, as a part of the size of the curve.
_FINEST = 1e-11
#: Control points beyond this are damage.
_FARTHEST = 1e15
#: Divisions at most: a cusp ends in an interval far below any tolerance.
_DEPTH = 40
#: Parts at most of one division, since a large deviation says little.
_MOST_PARTS = 6
#: Segments fitted together: more would only leave the processor's cache.
_BATCH = 512
#: Intervals that turn further are divided whatever the samples say, so that no loop hides between them (cosine).
_LEAST_TURN_COSINE = 0.2


def ellipse(center: FloatArray, first: FloatArray, second: FloatArray, start: float, end: float) -> FloatArray:
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


def bspline(control: FloatArray, knots: FloatArray, degree: int, weights: FloatArray | None = None) -> FloatArray:
    """A B-spline with ``control`` (N, 2) and N + degree + 1 ``knots`` as Bezier segments, by blossoming.

    The control points of the segment between two knots are the blossom of the spline at those two knots (Ramshaw),
    which holds for clamped, open and periodic knots alike. ``ValueError`` if the numbers do not make a spline.
    """
    count = len(control)
    if degree < 1 or count <= degree or len(knots) != count + degree + 1 or not np.all(np.diff(knots) >= 0):
        raise ValueError(f"{count} control points, {len(knots)} knots and degree {degree} make no spline")
    weight = np.ones(count) if weights is None or len(weights) != count else np.asarray(weights, dtype=np.float64)
    if not np.all(weight > 0):
        raise ValueError("a weight that is not positive")
    homogeneous = np.column_stack([control * weight[:, None], weight])
    spans = degree + np.flatnonzero(np.diff(knots[degree : count + 1]) > 0)
    if not len(spans):
        raise ValueError("all knots are one")
    low, high = knots[spans], knots[spans + 1]
    segments = np.empty((len(spans), degree + 1, 3))
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
        sound = [bool((np.abs(c[..., :2] / c[..., 2:]) < _FARTHEST).all()) for c in curves]
    outlines: dict[int, Outline] = {}
    for size in {c.shape[1] for c, good in zip(curves, sound, strict=True) if good}:
        members = [i for i, c in enumerate(curves) if sound[i] and c.shape[1] == size]
        outlines |= zip(members, _fit_alike([curves[i] for i in members], chord), strict=True)
    return [outlines.get(i, lost) for i in range(len(curves))]


class _Run(Struct, frozen=True):
    """Bezier segments of several curves of one degree end to end; parameter u runs over segment floor(u)."""

    control: FloatArray
    origin: FloatArray

    def points(self, segment: IntArray, t: FloatArray) -> FloatArray:
        """Points (K, M, 2) at ``t`` (K, M) of segment[k]."""
        h = np.einsum("kmp,kpd->kmd", _bernstein(self.control.shape[1] - 1, t), self.control[segment])
        return np.asarray(h[..., :2] / h[..., 2:])

    def tangents(self, segment: IntArray, t: FloatArray, inwards: FloatArray) -> FloatArray:
        """Unit tangents (K, 2) at ``t`` (K,); the chord to t + inwards gives them where the derivative vanishes."""
        control = self.control[segment]
        degree = control.shape[1] - 1
        value = np.einsum("kp,kpd->kd", _bernstein(degree, t), control)
        slope = np.einsum("kp,kpd->kd", _bernstein(degree - 1, t), np.diff(control, axis=1)) * degree
        tangent = (slope[:, :2] * value[:, 2:] - value[:, :2] * slope[:, 2:]) / value[:, 2:] ** 2
        size = np.abs(control[..., :2] / control[..., 2:] - (value[:, :2] / value[:, 2:])[:, None]).max(axis=(1, 2))
        flat = np.hypot(tangent[:, 0], tangent[:, 1]) < 1e-7 * size
        if flat.any():
            near = np.stack([t, t + inwards], axis=1)[flat]
            ends = self.points(segment[flat], near)
            tangent[flat] = (ends[:, 1] - ends[:, 0]) * np.sign(inwards[flat])[:, None]
        norm = np.hypot(tangent[:, 0], tangent[:, 1])[:, None]
        return np.asarray(tangent / np.where(norm > 0, norm, 1.0))


def _bernstein(degree: int, t: FloatArray) -> FloatArray:
    """The Bernstein polynomials at ``t``, in a last axis of their own."""
    i = np.arange(degree + 1)
    binomials = np.array([comb(degree, k) for k in i], dtype=np.float64)
    return np.asarray(binomials * t[..., None] ** i * (1 - t[..., None]) ** (degree - i))


class _Intervals(Struct, frozen=True):
    """Pieces of segments by their parameters."""

    segment: IntArray
    low: FloatArray
    high: FloatArray

    def divided(self, parts: IntArray) -> _Intervals:
        """Each interval in so many equal parts."""
        of = np.repeat(np.arange(len(parts)), parts)
        step = np.arange(len(of)) - np.repeat(np.cumsum(parts) - parts, parts)
        width = ((self.high - self.low) / parts)[of]
        low = self.low[of] + width * step
        high = np.where(step + 1 == parts[of], self.high[of], low + width)
        return _Intervals(self.segment[of], low, high)


def _fit_alike(curves: list[FloatArray], chord: float) -> list[Outline]:
    """``fit`` for curves of one degree."""
    counts = np.array([len(c) for c in curves])
    owner = np.repeat(np.arange(len(curves)), counts)
    origin = np.array([c[0, 0, :2] / c[0, 0, 2] for c in curves])
    control = np.concatenate(curves)
    # Close to zero the full precision is there, wherever the drawing lies.
    control[..., :2] -= origin[owner][:, None] * control[..., 2:]
    run = _Run(control, origin)
    # No interval can be closer than rounding leaves it.
    reach = np.abs(control[..., :2] / control[..., 2:]).max(axis=(1, 2))
    limit = _SHARE * np.maximum(chord, _FINEST * reach)
    done: list[tuple[IntArray, FloatArray, FloatArray]] = []
    for first in range(0, len(control), _BATCH):
        segment = np.arange(first, min(first + _BATCH, len(control)))
        _divide(run, _Intervals(segment, np.zeros(len(segment)), np.ones(len(segment))), limit, done)
    return _outlines(run, owner, len(curves), done)


def _divide(
    run: _Run, todo: _Intervals, limit: FloatArray, done: list[tuple[IntArray, FloatArray, FloatArray]]
) -> None:
    """Append segment, start and rows of every interval that fits to ``done``, dividing what does not.

    limit: deviation allowed for each segment of the run.
    """
    for depth in range(_DEPTH):
        allowed = limit[todo.segment]
        rows, deviation = _biarcs(run, todo, allowed)
        bad = (deviation > allowed) & (depth < _DEPTH - 1)
        done.append((todo.segment[~bad], todo.low[~bad], rows[~bad]))
        if not bad.any():
            return
        wanted = np.where(np.isinf(deviation), 2, np.ceil(np.cbrt(deviation / allowed)))[bad]
        parts = np.clip(wanted, 2, _MOST_PARTS).astype(np.intp)
        todo = _Intervals(todo.segment[bad], todo.low[bad], todo.high[bad]).divided(parts)


def _outlines(
    run: _Run, owner: IntArray, count: int, done: list[tuple[IntArray, FloatArray, FloatArray]]
) -> list[Outline]:
    """The pieces (K, 2, 3) of x, y, bulge in order of their curves, each run closed with its last point."""
    segment, low, pieces = (np.concatenate(column) for column in zip(*done, strict=True))
    order = np.lexsort([low, segment])
    curve = owner[segment[order]]
    rows = pieces[order].reshape(-1, 3)
    ends = np.searchsorted(curve, np.arange(count + 1)) * 2
    last = np.searchsorted(owner, np.arange(count), side="right") - 1
    final = run.points(last, np.ones((count, 1)))[:, 0]
    outlines = []
    for i in range(count):
        mine = rows[ends[i] : ends[i + 1]]
        mine = mine[~np.isnan(mine[:, 0])]
        points = np.concatenate([mine[:, :2], final[i : i + 1]]) + run.origin[i]
        outlines.append((points, np.append(mine[:, 2], 0.0)))
    return outlines


def _biarcs(run: _Run, todo: _Intervals, allowed: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rows of x, y, bulge (K, 2, 3) of the biarc of each interval and its deviation (K,), inf where there is none.

    A straight interval is one row, the other is NaN.
    """
    u = np.linspace(0.0, 1.0, _SAMPLES + 1)
    width = todo.high - todo.low
    samples = run.points(todo.segment, todo.low[:, None] + width[:, None] * u)
    start, end, inner = samples[:, 0], samples[:, -1], samples[:, 1:-1]
    t0 = run.tangents(todo.segment, todo.low, width * 1e-3)
    t1 = run.tangents(todo.segment, todo.high, -width * 1e-3)
    joint, b0, b1 = biarc(start, end, t0, t1)
    with np.errstate(all="ignore"):
        deviation = np.minimum(to_arc(inner, start, joint, b0), to_arc(inner, joint, end, b1)).max(axis=1)
        refused = (np.einsum("kd,kd->k", t0, t1) < _LEAST_TURN_COSINE) | ~np.isfinite(deviation)
        refused |= np.minimum(radius(start, joint, b0), radius(joint, end, b1)) < 2 * allowed
        straight = to_arc(inner, start, end, np.zeros(len(start))).max(axis=1)
    straight = np.where(np.isfinite(straight), straight, np.ptp(samples, axis=1).max(axis=1))
    line = (straight <= 1e-9 * np.hypot(*(end - start).T)) | (refused & (straight <= allowed))
    rows = np.stack([np.column_stack([start, b0]), np.column_stack([joint, b1])], axis=1)
    rows[line, 0, 2] = 0.0
    rows[line, 1] = np.nan
    return rows, np.where(line, 0.0, np.where(refused, np.inf, deviation))
