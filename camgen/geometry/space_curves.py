"""Curves in space as chains of lines and arcs. Circles stay arcs, other curves become chords.

A chain is points (N, 3), mm, and via points (N - 1, 3), half-way along an arc of at most half a
circle, NaN for a line.
"""

from __future__ import annotations

import math

import numpy as np

from camgen.geometry.curves import FINEST, MAX_DIVISIONS, SAMPLE_FRACTION, compute_bernstein
from camgen.geometry.ragged import concatenate_columns, number_rows
from camgen.geometry.vectors import cross, multiply_rows
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray

Chain = tuple[FloatArray, FloatArray]

#: Fraction of the size. Half diameters that differ by less, and are perpendicular to within it, are
#: those of a circle.
_CIRCLE_TOLERANCE = 1e-9
#: Fractions along a stretch of a curve at which its distance from the chord is measured.
_SAMPLES = np.array([0.1, 0.25, 0.4, 0.5, 0.6, 0.75, 0.9])
#: Parts into which a stretch is divided at once, at most.
_MAX_PARTS = 8
#: Fraction of half a circle by which an arc may exceed it through rounding and still stay whole.
_HALF_CIRCLE_ROUNDING = 1e-12


def make_lines(points: FloatArray) -> Chain:
    """`points` (N, 3) as a chain of lines."""
    return points, np.full((max(len(points) - 1, 0), 3), np.nan)


def make_turn(
    center: FloatArray, u: FloatArray, v: FloatArray, start: float, end: float, chord: float
) -> Chain:
    """The arc center + u cos t + v sin t, for t from `start` to `end`, rad.

    A circle becomes arcs, exactly. An ellipse becomes chords that deviate by at most `chord` mm:
    the curve leaves the chord over a step h by at most h^2 / 8 of its greatest second derivative,
    which is the longer half axis.

    u, v: (3,) any two conjugate half diameters, mm.
    """
    sweep = end - start
    tolerance = _CIRCLE_TOLERANCE * max(float(u @ u), float(v @ v))
    is_circle = abs(float(u @ u - v @ v)) <= tolerance and abs(float(u @ v)) <= tolerance
    if is_circle:
        count = max(1, math.ceil(abs(sweep) / math.pi - _HALF_CIRCLE_ROUNDING))
    else:
        longer = float(np.linalg.svd(np.stack([u, v]), compute_uv=False)[0])
        steps = abs(sweep) * math.sqrt(longer / (8 * max(chord, FINEST * longer)))
        count = max(2, math.ceil(steps))

    def at(t: FloatArray) -> FloatArray:
        return np.asarray(center + np.cos(t)[:, None] * u + np.sin(t)[:, None] * v)

    t = np.linspace(start, end, count + 1)
    points = at(t)
    if not is_circle:
        return make_lines(points)
    return points, at((t[:-1] + t[1:]) / 2)


def make_chords(segments: FloatArray, chord: float) -> FloatArray:
    """Points (N, 3) on consecutive Bezier segments, whose chords deviate by at most `chord` mm.

    segments: (S, degree + 1, 4) homogeneous control points.

    Returns two points of NaN if a segment is not finite.
    """
    with np.errstate(all="ignore"):
        size = float(np.ptp(segments[..., :3] / segments[..., 3:], axis=(0, 1)).max())
    if not math.isfinite(size):
        return np.full((2, 3), np.nan)
    limit = SAMPLE_FRACTION * max(chord, FINEST * size)
    segment: IntArray = np.arange(len(segments))
    low, width = np.zeros(len(segments)), np.ones(len(segments))
    done: list[tuple[FloatArray, FloatArray]] = []
    for depth in range(MAX_DIVISIONS):
        deviation = _measure_deviations(segments, segment, low, width)
        fits: BoolArray = (deviation <= limit) | (depth == MAX_DIVISIONS - 1)
        done.append((segment[fits] + low[fits], _evaluate(segments, segment[fits], low[fits])))
        if fits.all():
            break
        parts = np.clip(np.ceil(np.sqrt(deviation[~fits] / limit)), 2, _MAX_PARTS).astype(np.int64)
        segment = np.repeat(segment[~fits], parts)
        width = np.repeat(width[~fits] / parts, parts)
        low = np.repeat(low[~fits], parts) + number_rows(parts) * width
    position, points = concatenate_columns(done)
    last = _evaluate(segments, np.array([len(segments) - 1]), np.ones(1))
    return np.concatenate([points[np.argsort(position, kind="stable")], last])


def _measure_deviations(
    segments: FloatArray, segment: IntArray, low: FloatArray, width: FloatArray
) -> FloatArray:
    """(K,) maximum distance of stretches of segments from their chords at the samples, mm.

    segment: (K,) the segment of each stretch.
    low, width: (K,) where each stretch begins, and its length, as parameters from 0 to 1.
    """
    start, end = _evaluate(segments, segment, low), _evaluate(segments, segment, low + width)
    chord = end - start
    length = np.sqrt(multiply_rows(chord, chord))
    greatest = np.zeros(len(low))
    for sample in _SAMPLES:
        arm = _evaluate(segments, segment, low + sample * width) - start
        moment = cross(arm, chord)
        with np.errstate(all="ignore"):
            distance = np.sqrt(multiply_rows(moment, moment)) / length
        greatest = np.maximum(
            greatest, np.where(length > 0, distance, np.sqrt(multiply_rows(arm, arm)))
        )
        # A stretch that runs beyond the ends of its chord turns back.
        forward = multiply_rows(arm, chord) / np.where(length > 0, length, 1.0)
        greatest = np.maximum(greatest, np.maximum(-forward, forward - length))
    return greatest


def _evaluate(segments: FloatArray, segment: IntArray, t: FloatArray) -> FloatArray:
    """Points (K, 3) of the Bezier curves `segment` (K,) at their parameters `t` (K,), 0 to 1."""
    basis = compute_bernstein(segments.shape[1] - 1, t)
    mixed = np.einsum("kd,kdc->kc", basis, segments[segment])
    return np.asarray(mixed[:, :3] / mixed[:, 3:])
