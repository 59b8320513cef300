"""Biarcs and arcs by their bulges, many at once: (K, 2) points, (K,) bulges, stable down to a straight line."""

from __future__ import annotations

import math

import numpy as np

from camgen.pose import FloatArray


def radius(a: FloatArray, b: FloatArray, bulge: FloatArray) -> FloatArray:
    """Radii (K,) of the arcs a -> b, inf for a line."""
    size = np.abs(bulge)
    return np.asarray(np.hypot(*(b - a).T) * (1 + size * size) / (4 * size))


def biarc(start: FloatArray, end: FloatArray, t0: FloatArray, t1: FloatArray) -> tuple[FloatArray, ...]:
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
        half0, half1 = _turn(t0, joint - start), _turn(end - joint, t1)
        wrong = (np.abs(half0) > math.pi / 2) | (np.abs(half1) > math.pi / 2) | ~np.isfinite(d)
        b0, b1 = np.tan(half0 / 2), np.tan(half1 / 2)
    b0[wrong] = b1[wrong] = np.nan
    return joint, b0, b1


def _turn(a: FloatArray, b: FloatArray) -> FloatArray:
    """Angle (K,) from a to b."""
    return np.asarray(np.arctan2(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], np.einsum("kd,kd->k", a, b)))


def to_arc(x: FloatArray, y: FloatArray, a: FloatArray, b: FloatArray, bulge: FloatArray) -> FloatArray:
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
