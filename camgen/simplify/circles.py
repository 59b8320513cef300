"""Circles in borders: the one through many points, and whether a whole border is one."""

from __future__ import annotations

import numpy as np

from camgen.pose import FloatArray
from camgen.simplify.thinning import IntArray, to_lines

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
    turn = turned(points - centre)
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
    middle = points.mean(axis=0)
    local = points - middle
    square = (local * local).sum(axis=1)
    normal = local.T @ local
    determinant = float(normal[0, 0] * normal[1, 1] - normal[0, 1] * normal[1, 0])
    if determinant <= 1e-12 * float(np.trace(normal)) ** 2:
        return middle, np.inf, np.inf
    u, v = (local.T @ (square - square.mean()) / 2).tolist()
    centre = np.array([normal[1, 1] * u - normal[0, 1] * v, normal[0, 0] * v - normal[1, 0] * u]) / determinant
    radius = float(np.sqrt(square.mean() + centre @ centre))
    off = float(np.abs(np.hypot(*(local - centre).T) - radius).max())
    return middle + centre, radius, off + _cut_off(points, radius)


def _cut_off(points: FloatArray, radius: float) -> float:
    """How far the longest line between ``points`` is inside the circle at its middle, at most."""
    step = np.diff(points, axis=0)
    return float(np.einsum("nd,nd->n", step, step).max()) / (8 * radius)


def turned(local: FloatArray) -> float:
    """The angle by which ``local`` (N, 2) goes round the origin, rad."""
    u, v = local[:-1], local[1:]
    return float(np.arctan2(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0], np.einsum("nd,nd->n", u, v)).sum())
