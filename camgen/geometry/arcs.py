"""Arcs in space: start, via and end are three points of an arc, in order. Arrays have a row for each, mm and rad.

Where via is said to be half-way, the arc is at most half a circle, and NaN as via makes a straight line. Single arcs
are worked out without arrays, on three numbers ten times as fast.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct

from camgen.geometry.vectors import cross, dots, lengths, unit
from camgen.model.part import BoolArray, IntArray
from camgen.model.path import ToolPath
from camgen.model.pose import FloatArray, Vec3

#: An arc whose height is below this part of its chord is straight; of three points in another order, the sine of the
#: angle between them. Beyond it the centre is so far away that it has no digits left.
FLAT = 1e-9
#: The height, mm, that keeps the radius of a straight arc finite.
_LEAST_HEIGHT_MM = 1e-9
#: Three points are on one line when the squared sine of the angle between them is below this.
_LINE_SINE_SQUARED = FLAT**2


# Many arcs, via half-way.


class Spans(Struct, frozen=True, eq=False):
    """K lines and arcs. An arc is written from its middle ``via``: towards it from the centre, along the travel there.

    start, end, via: (K, 3) mm. curved: (K,) bool. towards, along: (K, 3) unit. radius: (K,) mm, sweep: (K,) rad,
    positive from ``towards`` to ``along``; both 0 for a line. length: (K,) mm.
    """

    start: FloatArray
    end: FloatArray
    via: FloatArray
    curved: BoolArray
    towards: FloatArray
    along: FloatArray
    radius: FloatArray
    sweep: FloatArray
    length: FloatArray

    def point(self, fraction: FloatArray, row: IntArray | None = None, axes: int = 3) -> FloatArray:
        """(M, axes): the points at ``fraction`` (M,) 0..1 of the length of those at ``row`` (M,), else of all in order;
        axes = 2: seen from above.
        """
        row = np.arange(len(self.length)) if row is None else row
        points = np.empty((len(row), axes))
        curved = self.curved[row]
        # Most calls ask for few points, often of lines alone.
        if not curved.all():
            lines = (~curved).nonzero()[0]
            self._put_lines(points, lines, fraction[lines], row[lines])
        if curved.any():
            arcs = curved.nonzero()[0]
            self._put_arcs(points, arcs, fraction[arcs], row[arcs])
        return points

    def _put_lines(
        self, points: FloatArray, places: IntArray, fraction: FloatArray, row: IntArray
    ) -> None:
        # Axis by axis, which numpy does in half the time.
        for axis in range(points.shape[1]):
            start = self.start[row, axis]
            points[places, axis] = start + fraction * (self.end[row, axis] - start)

    def _put_arcs(
        self, points: FloatArray, places: IntArray, fraction: FloatArray, row: IntArray
    ) -> None:
        angle, radius = (fraction - 0.5) * self.sweep[row], self.radius[row]
        # From the middle, not from the centre: a flat arc's centre is far away and would cost digits.
        rise = -2 * radius * np.sin(angle / 2) ** 2
        run = radius * np.sin(angle)
        for axis in range(points.shape[1]):
            points[places, axis] = (
                self.via[row, axis] + rise * self.towards[row, axis] + run * self.along[row, axis]
            )

    def tangents(self) -> tuple[FloatArray, FloatArray]:
        """The directions of travel (K, 3) at the start and at the end; 0 where there is no length.

        Half-way along an arc its tangent is parallel to its chord. The chord of half the arc makes equal angles with
        the tangents at its two ends, so each end tangent is the arc's chord mirrored about the chord of that half.
        """
        leaves, arrives = self.along.copy(), self.along.copy()
        arc = np.flatnonzero(self.curved)
        if len(arc):
            via, along = self.via[arc], self.along[arc]
            for out, half in ((leaves, via - self.start[arc]), (arrives, self.end[arc] - via)):
                mirror = unit(half)
                out[arc] = 2 * dots(mirror, along)[:, None] * mirror - along
        return leaves, arrives

    def to_middle(self, vectors: FloatArray) -> FloatArray:
        """``vectors`` (K, 3) at the start, turned with the arc to its middle, where the travel is along the chord."""
        start, along = self.tangents()[0], self.along
        axis = unit(cross(start, along))
        turned = np.zeros_like(vectors)
        for here, there in ((start, along), (cross(axis, start), cross(axis, along)), (axis, axis)):
            turned += dots(vectors, here)[:, None] * there
        return turned

    def pick(self, index: IntArray) -> Spans:
        """Those at ``index``, in that order."""
        return Spans(*(getattr(self, name)[index] for name in Spans.__struct_fields__))


def spans(start: FloatArray, via: FloatArray, end: FloatArray) -> Spans:
    """Spans from ``start`` to ``end``, arcs through ``via`` half-way along them (NaN: a line), each (K, 3) mm.

    Of chord c and height h the sweep is 4 atan(2 h / c), the radius (c c / 4 + h h) / (2 h).
    """
    curved = ~np.isnan(via[:, 0])
    chord = end - start
    length = np.sqrt(dots(chord, chord))
    along = chord / np.where(length > 0, length, 1.0)[:, None]
    towards = np.zeros_like(chord)
    radius, sweep = np.zeros_like(length), np.zeros_like(length)
    arc = np.flatnonzero(curved)
    if len(arc):
        rise = via[arc] - (start[arc] + end[arc]) / 2
        height, half = np.maximum(np.sqrt(dots(rise, rise)), _LEAST_HEIGHT_MM), length[arc] / 2
        towards[arc] = rise / height[:, None]
        radius[arc] = (half**2 + height**2) / (2 * height)
        sweep[arc] = 4 * np.arctan2(height, half)
        length[arc] = radius[arc] * sweep[arc]
    return Spans(start, end, via, curved, towards, along, radius, sweep, length)


def spans_through(start: FloatArray, via: FloatArray, end: FloatArray) -> Spans:
    """``spans`` with ``via`` anywhere on the arcs, of any sweep; a line where the three points are on one."""
    a, b = start - via, end - via
    normal = cross(a, b)
    arc = np.flatnonzero(dots(normal, normal) > FLAT**2 * dots(a, a) * dots(b, b))
    middle = np.full_like(via, np.nan)
    middle[arc] = arc_middles(start[arc], via[arc], end[arc])
    return spans(start, middle, end)


def chain(points: FloatArray, via: FloatArray) -> Spans:
    """The N - 1 spans from each of ``points`` (N, 3) to the next, over ``via`` (N - 1, 3)."""
    return spans(points[:-1], via, points[1:])


def span_lengths(points: FloatArray, via: FloatArray) -> FloatArray:
    """(N - 1,) lengths of the spans from ``points`` (N, 3) to the next over ``via`` (N - 1, 3)."""
    chord = np.linalg.norm(np.diff(points, axis=0), axis=1)
    arc = np.flatnonzero(~np.isnan(via[:, 0]))
    if len(arc):
        chord[arc] = spans(points[arc], via[arc], points[arc + 1]).length
    return np.asarray(chord, dtype=np.float64)


def path_length(path: ToolPath) -> float:
    """Length of one pass, mm."""
    return float(span_lengths(path.position, path.via[1:]).sum())


def are_bent(start: FloatArray, via: FloatArray, end: FloatArray) -> BoolArray:
    """(N,) whether arcs are none that are straight; via is half-way."""
    height = np.linalg.norm(via - (start + end) / 2, axis=1)
    return np.asarray(height > FLAT * np.linalg.norm(end - start, axis=1))


def bulges(start: FloatArray, via: FloatArray, end: FloatArray) -> FloatArray:
    """(N,) of arcs seen from above: tan(sweep / 4), positive counter-clockwise; via is half-way, 0 for lines.

    That is the height over half the chord. An arc that turns left has its middle on the right of the chord.
    """
    chord, rise = (end - start)[:, :2], (via - start)[:, :2]
    square = dots(chord, chord)
    height = chord[:, 0] * rise[:, 1] - chord[:, 1] * rise[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.nan_to_num(np.where(square > 0, -2 * height / square, 0.0))


def bulge_middles(start: FloatArray, bulge: FloatArray, end: FloatArray) -> FloatArray:
    """The points (N, 2 or 3) half-way along arcs in the plane with bulges (N,): as far to the right of the chord's
    middle as the bulge is part of half the chord.
    """
    half = (end - start) / 2
    middle: FloatArray = start + half
    middle[:, 0] += half[:, 1] * bulge
    middle[:, 1] -= half[:, 0] * bulge
    return middle


# Many arcs, via anywhere on them.


def arc_middles(start: FloatArray, via: FloatArray, end: FloatArray) -> FloatArray:
    """The points (N, 3) half-way along the arcs from ``start`` through ``via``, wherever on it, to ``end``.

    In the arc's plane, with the middle of the chord as origin: via = (u, h), half the chord a; the centre is (0, k)
    with k = (u^2 + h^2 - a^2) / 2h. Three points on one line: half-way if via is between the others, else via itself,
    so that it is not mistaken for an arc. A start that is not known (NaN): via too.
    """
    centre, span = (start + end) / 2, end - start
    length = lengths(span)
    with np.errstate(divide="ignore", invalid="ignore"):
        along = np.where(length[:, None] > 0, span / length[:, None], 0.0)
        u = np.einsum("ni,ni->n", via - centre, along)
        across = via - centre - u[:, None] * along
        h = lengths(across)
        a = length / 2
        k = (u * u + h * h - a * a) / (2 * h)
        radius = np.hypot(a, k)
        # The same number twice: the one for the short way does not lose digits for very flat arcs.
        height = np.where(k < 0, a * a / (radius - k), radius + k)
        flat = h < FLAT * a
        middle = centre + np.where(flat, 0.0, height / h)[:, None] * across
    unknown = (
        np.isnan(start).any(axis=1) | (flat & (np.abs(u) > a * (1 - FLAT))) | ((a == 0) & (h == 0))
    )
    return np.where(unknown[:, None], via, middle)


def arc_lengths(start: FloatArray, via: FloatArray, end: FloatArray) -> FloatArray:
    """Lengths (N,) of the arcs from start through via to end, each (N, 3).

    The angle at via sees the chord from the arc: sweep = 2 (pi - angle), radius = chord / (2 sin(angle)).
    """
    to_start, to_end = start - via, end - via
    sine = lengths(cross(to_start, to_end))
    angle = np.arctan2(sine, np.einsum("ij,ij->i", to_start, to_end))
    flat = lengths(to_start) + lengths(to_end)
    turn = np.pi - angle
    with np.errstate(divide="ignore", invalid="ignore"):
        curved = lengths(end - start) / np.sin(turn) * turn
    # Three points on one line, in any order, are no arc; a foreign program may hold them.
    return np.asarray(np.where(np.sin(turn) > FLAT, curved, flat), dtype=np.float64)


def level_arms(
    start: FloatArray, via: FloatArray, end: FloatArray
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Of arcs seen from above: from the start to the centre (N, 2), the sweep (N,) and whether they turn left (N,)."""
    u, w = (via - start)[:, :2], (end - start)[:, :2]
    (ux, uy), (wx, wy) = u.T, w.T
    uu, ww, area = ux * ux + uy * uy, wx * wx + wy * wy, ux * wy - uy * wx
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y = (uu * wy - ww * uy) / (2 * area), (ww * ux - uu * wx) / (2 * area)
        rest_x, rest_y = wx - x, wy - y
        turn = np.sign(area) * (y * rest_x - x * rest_y)
        sweep = np.arctan2(turn, -(x * rest_x + y * rest_y)) % (2 * np.pi)
    return np.column_stack([x, y]), sweep, area > 0


# One arc, without arrays.


def circle(start: Vec3, via: Vec3, end: Vec3) -> tuple[Vec3, float, Vec3, float]:
    """Centre, radius, unit axis and sweep (rad, about that axis) of the arc through three points.

    ValueError when they are on one line. Plain arithmetic: on three numbers it is ten times as fast as arrays.
    """
    if start[2] == via[2] == end[2]:
        return _flat_circle(start, via, end)
    (x0, y0, z0), (ux, uy, uz), (wx, wy, wz) = start, minus(via, start), minus(end, start)
    ax, ay, az = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
    uu, ww, area2 = (
        ux * ux + uy * uy + uz * uz,
        wx * wx + wy * wy + wz * wz,
        ax * ax + ay * ay + az * az,
    )
    if area2 < _LINE_SINE_SQUARED * uu * ww or area2 == 0.0:
        raise ValueError("the three points of the arc are on one line")
    # From the centre to the start: -(ww axis x u + uu w x axis) / 2 area^2.
    f, g = ww / (2 * area2), uu / (2 * area2)
    rx = (az * uy - ay * uz) * f + (ay * wz - az * wy) * g
    ry = (ax * uz - az * ux) * f + (az * wx - ax * wz) * g
    rz = (ay * ux - ax * uy) * f + (ax * wy - ay * wx) * g
    size = math.sqrt(area2)
    ax, ay, az = ax / size, ay / size, az / size
    lx, ly, lz = wx + rx, wy + ry, wz + rz
    sine = (ry * lz - rz * ly) * ax + (rz * lx - rx * lz) * ay + (rx * ly - ry * lx) * az
    sweep = math.atan2(sine, rx * lx + ry * ly + rz * lz) % (2 * math.pi)
    return (x0 - rx, y0 - ry, z0 - rz), math.sqrt(rx * rx + ry * ry + rz * rz), (ax, ay, az), sweep


def _flat_circle(start: Vec3, via: Vec3, end: Vec3) -> tuple[Vec3, float, Vec3, float]:
    """``circle`` for three points of the same height, as almost all are."""
    x0, y0, z0 = start
    ux, uy, wx, wy = via[0] - x0, via[1] - y0, end[0] - x0, end[1] - y0
    uu, ww, area = ux * ux + uy * uy, wx * wx + wy * wy, ux * wy - uy * wx
    if area * area < _LINE_SINE_SQUARED * uu * ww or area == 0.0:
        raise ValueError("the three points of the arc are on one line")
    cx, cy = (uu * wy - ww * uy) / (2 * area), (ww * ux - uu * wx) / (2 * area)
    lx, ly = wx - cx, wy - cy
    up = math.copysign(1.0, area)
    sweep = math.atan2(up * (cy * lx - cx * ly), -cx * lx - cy * ly) % (2 * math.pi)
    return (x0 + cx, y0 + cy, z0), math.hypot(cx, cy), (0.0, 0.0, up), sweep


def is_arc(start: Vec3, via: Vec3, end: Vec3) -> bool:
    """Whether three points make an arc: they are apart and not on one line."""
    (ux, uy, uz), (wx, wy, wz) = minus(via, start), minus(end, start)
    ax, ay, az = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
    area2 = ax * ax + ay * ay + az * az
    return area2 > 0.0 and area2 >= _LINE_SINE_SQUARED * (ux * ux + uy * uy + uz * uz) * (
        wx * wx + wy * wy + wz * wz
    )


def sweep_and_height(start: Vec3, via: Vec3, end: Vec3) -> tuple[float, float]:
    """Sweep (rad) of the arc through three points, the rest of which is twice the angle that its ends make at ``via``,
    and the distance (mm) of ``via`` from the line through its ends.
    """
    (sx, sy, sz), (vx, vy, vz), (ex, ey, ez) = start, via, end
    ux, uy, uz, wx, wy, wz = sx - vx, sy - vy, sz - vz, ex - vx, ey - vy, ez - vz
    area = math.hypot(uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx)
    sweep = 2 * (math.pi - math.atan2(area, ux * wx + uy * wy + uz * wz))
    return sweep, area / max(math.dist(start, end), 1e-9)


def turn_about(v: Vec3, axis: Vec3, angle: float) -> Vec3:
    """``v`` turned by ``angle`` rad about the unit vector ``axis`` (Rodrigues)."""
    c, s = math.cos(angle), math.sin(angle)
    inline = (axis[0] * v[0] + axis[1] * v[1] + axis[2] * v[2]) * (1 - c)
    across = (
        axis[1] * v[2] - axis[2] * v[1],
        axis[2] * v[0] - axis[0] * v[2],
        axis[0] * v[1] - axis[1] * v[0],
    )
    return (
        c * v[0] + s * across[0] + inline * axis[0],
        c * v[1] + s * across[1] + inline * axis[1],
        c * v[2] + s * across[2] + inline * axis[2],
    )


def minus(a: Vec3, b: Vec3) -> Vec3:
    """A - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


# Circles, through three points and fitted to many.


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
        return np.asarray(
            np.hypot(
                np.sqrt(np.maximum((away**2).sum(axis=1) - height**2, 0.0)) - self.radius, height
            )
        )


def through(p: FloatArray, q: FloatArray, r: FloatArray) -> Circle | None:
    """The circle through three points, running p, q, r; None if they are in line."""
    u, w = q - p, r - p
    normal = cross(u, w)
    square, longest = float(normal @ normal), max(float(u @ u), float(w @ w))
    if square <= (FLAT * longest) ** 2:
        return None
    center = p + cross(float(u @ u) * w - float(w @ w) * u, normal) / (2 * square)
    return _about(center, normal / math.sqrt(square), p)


def fit_circle(points: FloatArray) -> Circle | None:
    """The circle of least squares of ``points`` (N, 3), in their plane of least squares, running in their order.

    The middle and the radius are linear in x, y and x x + y y; exact where the points are.
    """
    middle = points.mean(axis=0)
    away = points - middle
    _, size, axes = np.linalg.svd(away, full_matrices=False)
    if size[1] <= FLAT * size[0]:
        return None
    x, y = away @ axes[0], away @ axes[1]
    solution, *_ = np.linalg.lstsq(
        np.column_stack([x, y, np.ones(len(x))]), x * x + y * y, rcond=None
    )
    center = middle + axes[0] * (solution[0] / 2) + axes[1] * (solution[1] / 2)
    arms = points - center
    turning = cross(arms[:-1], arms[1:]).sum(axis=0)
    axis = cross(axes[0], axes[1])
    circle = _about(center, axis if float(axis @ turning) > 0 else -axis, points[0])
    radius = math.sqrt(
        max(float(solution[2]) + float(solution[0]) ** 2 / 4 + float(solution[1]) ** 2 / 4, 0.0)
    )
    return Circle(circle.center, circle.axis, circle.first, radius)


def _about(center: FloatArray, axis: FloatArray, start: FloatArray) -> Circle:
    arm = start - center
    flat = arm - axis * float(arm @ axis)
    radius = float(np.linalg.norm(flat))
    return Circle(center, axis, flat / radius, radius)
