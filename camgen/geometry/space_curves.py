"""Curves in space as chains of arcs and lines: circles stay arcs, all else becomes chords within a tolerance, mm.

A chain is points (N, 3) and via (N - 1, 3), half-way along an arc of at most half a circle and NaN for a line.
"""

from __future__ import annotations

import math
from math import comb

import numpy as np

from camgen.geometry.vectors import cross, dots
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray

Chain = tuple[FloatArray, FloatArray]

#: Half diameters that differ by less than this part, and are square to within it, are those of a circle.
_ROUND = 1e-9
#: Where each chord is measured against its curve, 0 to 1 along it.
_PLACES = np.array([0.1, 0.25, 0.4, 0.5, 0.6, 0.75, 0.9])
#: Of the tolerance, what the measured places may use; the rest is for what lies between them.
_SHARE = 0.9
#: Least deviation asked for, as a part of the size of the curve.
_FINEST = 1e-11
#: A division is never into more parts at once, and there are never more divisions.
_MOST_PARTS, _MOST_DIVISIONS = 8, 40


def lines(points: FloatArray) -> Chain:
    """The points as a chain of lines."""
    return points, np.full((max(len(points) - 1, 0), 3), np.nan)


def turn(
    center: FloatArray, u: FloatArray, v: FloatArray, start: float, end: float, chord: float
) -> Chain:
    """The arc center + u cos t + v sin t, t from ``start`` to ``end`` (rad); u, v (3,) any two conjugate half
    diameters.

    Of a circle as arcs, exactly. Of an ellipse as chords: between two points a step h apart it leaves its chord by at
    most h^2 / 8 of its greatest second derivative, which is its longer half axis.
    """
    sweep = end - start
    size = max(float(u @ u), float(v @ v))
    round_ = abs(float(u @ u - v @ v)) <= _ROUND * size and abs(float(u @ v)) <= _ROUND * size
    if round_:
        count = max(1, math.ceil(abs(sweep) / math.pi - 1e-12))
    else:
        longer = float(np.linalg.svd(np.stack([u, v]), compute_uv=False)[0])
        count = max(
            2, math.ceil(abs(sweep) * math.sqrt(longer / (8 * max(chord, _FINEST * longer))))
        )

    def at(t: FloatArray) -> FloatArray:
        return np.asarray(center + np.cos(t)[:, None] * u + np.sin(t)[:, None] * v)

    t = np.linspace(start, end, count + 1)
    points = at(t)
    return (points, at((t[:-1] + t[1:]) / 2)) if round_ else lines(points)


def chords(segments: FloatArray, chord: float) -> FloatArray:
    """Points (N, 3) on a run of Bezier segments (S, degree + 1, 4), homogeneous, whose chords leave it by at most
    ``chord``. Not finite where the segments are not.
    """
    with np.errstate(all="ignore"):
        size = float(np.ptp(segments[..., :3] / segments[..., 3:], axis=(0, 1)).max())
    if not math.isfinite(size):
        return np.full((2, 3), np.nan)
    limit = _SHARE * max(chord, _FINEST * size)
    segment: IntArray = np.arange(len(segments))
    low, width = np.zeros(len(segments)), np.ones(len(segments))
    done: list[tuple[FloatArray, FloatArray]] = []
    for depth in range(_MOST_DIVISIONS):
        off = _deviations(segments, segment, low, width)
        fits: BoolArray = (off <= limit) | (depth == _MOST_DIVISIONS - 1)
        done.append((segment[fits] + low[fits], _at(segments, segment[fits], low[fits])))
        if fits.all():
            break
        parts = np.clip(np.ceil(np.sqrt(off[~fits] / limit)), 2, _MOST_PARTS).astype(np.int64)
        step = np.concatenate([np.arange(k) for k in parts])
        segment = np.repeat(segment[~fits], parts)
        width = np.repeat(width[~fits] / parts, parts)
        low = np.repeat(low[~fits], parts) + step * width
    place, points = (np.concatenate(column) for column in zip(*done, strict=True))
    last = _at(segments, np.array([len(segments) - 1]), np.ones(1))
    return np.concatenate([points[np.argsort(place, kind="stable")], last])


def _deviations(
    segments: FloatArray, segment: IntArray, low: FloatArray, width: FloatArray
) -> FloatArray:
    """How far (K,) each stretch of a segment leaves its chord."""
    start, end = _at(segments, segment, low), _at(segments, segment, low + width)
    along = end - start
    length = np.sqrt(dots(along, along))
    most = np.zeros(len(low))
    for place in _PLACES:
        out = _at(segments, segment, low + place * width) - start
        beside = cross(out, along)
        with np.errstate(all="ignore"):
            off = np.sqrt(dots(beside, beside)) / length
        most = np.maximum(most, np.where(length > 0, off, np.sqrt(dots(out, out))))
        # A stretch that runs beyond the ends of its chord turns back.
        forward = dots(out, along) / np.where(length > 0, length, 1.0)
        most = np.maximum(most, np.maximum(-forward, forward - length))
    return most


def _at(segments: FloatArray, segment: IntArray, t: FloatArray) -> FloatArray:
    """Points (K, 3) of the segments at their parameters ``t`` (K,), 0 to 1."""
    degree = segments.shape[1] - 1
    k = np.arange(degree + 1)
    binomials = np.array([comb(degree, i) for i in k], dtype=np.float64)
    basis = binomials * t[:, None] ** k * (1 - t[:, None]) ** (degree - k)
    mixed = np.einsum("kd,kdc->kc", basis, segments[segment])
    return np.asarray(mixed[:, :3] / mixed[:, 3:])
