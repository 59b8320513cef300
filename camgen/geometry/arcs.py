"""Circles and arcs in space: through three points, and fitted to many."""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct

from camgen.model.pose import FloatArray

#: An arc whose height is below this part of its chord is straight.
_FLAT = 1e-9


_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """The cross product of vectors (..., 3): for a few of them five times as fast as numpy's."""
    return np.asarray(a[..., _NEXT] * b[..., _LAST] - a[..., _LAST] * b[..., _NEXT])


class Circle(Struct, frozen=True, eq=False):
    """center (3,), unit axis (3,), radius; angles count from ``first`` (3,), counter-clockwise about the axis."""

    center: FloatArray
    axis: FloatArray
    first: FloatArray
    radius: float

    def angles(self, points: FloatArray) -> FloatArray:
        """(N,) rad of ``points`` (N, 3), from 0 to 2 pi."""
        away = points - self.center
        angle = np.arctan2(away @ cross(self.axis, self.first), away @ self.first)
        return np.asarray(np.where(angle < -1e-9, angle + 2 * np.pi, angle))

    def at(self, angles: FloatArray) -> FloatArray:
        """Points (N, 3) at ``angles`` (N,)."""
        return np.asarray(self.center + self.radius * self.radial(angles))

    def radial(self, angles: FloatArray) -> FloatArray:
        """Unit vectors (N, 3) from the centre."""
        second = cross(self.axis, self.first)
        return np.asarray(np.cos(angles)[:, None] * self.first + np.sin(angles)[:, None] * second)

    def distances(self, points: FloatArray) -> FloatArray:
        """(N,) how far ``points`` (N, 3) are from the circle."""
        away = points - self.center
        height = away @ self.axis
        return np.asarray(np.hypot(np.sqrt(np.maximum((away**2).sum(axis=1) - height**2, 0.0)) - self.radius, height))


def through(p: FloatArray, q: FloatArray, r: FloatArray) -> Circle | None:
    """The circle through three points, running p, q, r; None if they are in line."""
    u, w = q - p, r - p
    normal = cross(u, w)
    square, longest = float(normal @ normal), max(float(u @ u), float(w @ w))
    if square <= (_FLAT * longest) ** 2:
        return None
    center = p + cross(float(u @ u) * w - float(w @ w) * u, normal) / (2 * square)
    return _about(center, normal / math.sqrt(square), p)


def fitted(points: FloatArray) -> Circle | None:
    """The circle of least squares of ``points`` (N, 3), in their plane of least squares, running in their order.

    The middle and the radius are linear in x, y and x x + y y; exact where the points are.
    """
    middle = points.mean(axis=0)
    away = points - middle
    _, size, axes = np.linalg.svd(away, full_matrices=False)
    if size[1] <= _FLAT * size[0]:
        return None
    x, y = away @ axes[0], away @ axes[1]
    solution, *_ = np.linalg.lstsq(np.column_stack([x, y, np.ones(len(x))]), x * x + y * y, rcond=None)
    center = middle + axes[0] * (solution[0] / 2) + axes[1] * (solution[1] / 2)
    arms = points - center
    turning = cross(arms[:-1], arms[1:]).sum(axis=0)
    axis = cross(axes[0], axes[1])
    circle = _about(center, axis if float(axis @ turning) > 0 else -axis, points[0])
    radius = math.sqrt(max(float(solution[2]) + float(solution[0]) ** 2 / 4 + float(solution[1]) ** 2 / 4, 0.0))
    return Circle(circle.center, circle.axis, circle.first, radius)


def _about(center: FloatArray, axis: FloatArray, start: FloatArray) -> Circle:
    arm = start - center
    flat = arm - axis * float(arm @ axis)
    radius = float(np.linalg.norm(flat))
    return Circle(center, axis, flat / radius, radius)


def span_lengths(points: FloatArray, via: FloatArray) -> FloatArray:
    """(N - 1,) lengths of the spans from ``points`` (N, 3) to the next over ``via`` (N - 1, 3), at most half circles.

    An arc of chord c and height h sweeps 4 atan(2 h / c) about the radius (c c / 4 + h h) / (2 h).
    """
    chord = np.linalg.norm(points[1:] - points[:-1], axis=1)
    height = np.linalg.norm(via - (points[1:] + points[:-1]) / 2, axis=1)
    curved = height > _FLAT * chord
    h = np.where(curved, height, 1.0)
    arc = 4 * np.arctan2(2 * h, chord) * (chord**2 / 4 + h**2) / (2 * h)
    return np.asarray(np.where(curved, arc, chord))


def arc_middles(start: FloatArray, via: FloatArray, end: FloatArray) -> FloatArray:
    """The points (N, 3) half-way along the arcs from ``start`` through ``via``, wherever on it, to ``end``.

    In the arc's plane, with the middle of the chord as origin: via = (u, h), half the chord a; the centre is (0, k)
    with k = (u^2 + h^2 - a^2) / 2h. Three points on one line: half-way if via is between the others, else via itself,
    so that it is not mistaken for an arc. A start that is not known (NaN): via too.
    """
    centre, span = (start + end) / 2, end - start
    length = np.linalg.norm(span, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        along = np.where(length[:, None] > 0, span / length[:, None], 0.0)
        u = np.einsum("ni,ni->n", via - centre, along)
        across = via - centre - u[:, None] * along
        h = np.linalg.norm(across, axis=1)
        a = length / 2
        k = (u * u + h * h - a * a) / (2 * h)
        radius = np.hypot(a, k)
        # The same number twice: the one for the short way does not lose digits for very flat arcs.
        height = np.where(k < 0, a * a / (radius - k), radius + k)
        flat = h < 1e-9 * a
        middle = centre + np.where(flat, 0.0, height / h)[:, None] * across
    unknown = np.isnan(start).any(axis=1) | (flat & (np.abs(u) > a * (1 - 1e-9))) | ((a == 0) & (h == 0))
    return np.where(unknown[:, None], via, middle)


def arc_lengths(start: FloatArray, via: FloatArray, end: FloatArray) -> FloatArray:
    """Lengths (N,) of the arcs from start through via to end, each (N, 3).

    The angle at via sees the chord from the arc: sweep = 2 (pi - angle), radius = chord / (2 sin(angle)).
    """
    to_start, to_end = start - via, end - via
    sine = np.linalg.norm(np.cross(to_start, to_end), axis=1)
    angle = np.arctan2(sine, np.einsum("ij,ij->i", to_start, to_end))
    flat = np.linalg.norm(to_start, axis=1) + np.linalg.norm(to_end, axis=1)
    turn = np.pi - angle
    with np.errstate(divide="ignore", invalid="ignore"):
        curved = np.linalg.norm(end - start, axis=1) / np.sin(turn) * turn
    # Three points on one line, in any order, are no arc; a foreign program may hold them.
    return np.asarray(np.where(np.sin(turn) > 1e-9, curved, flat), dtype=np.float64)
