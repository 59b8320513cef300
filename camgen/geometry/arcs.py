"""Arcs in space, each given by three points in order: start, via and end.

Arrays have one row per arc; units are mm and rad. Where via has to be half-way along the arc, the
arc is at most half a circle, and NaN as via makes a straight line. Single arcs are computed without
arrays, which is ten times as fast.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct

from camgen.geometry.vectors import cross, measure_lengths, multiply_rows, normalize
from camgen.model.part import BoolArray, IntArray
from camgen.model.path import ToolPath
from camgen.model.pose import FloatArray, Vec3

#: An arc whose height is below this fraction of its chord is straight. For three points in another
#: order it is the sine of the angle between them. A flatter arc has its centre so far away that no
#: digits are left.
FLAT = 1e-9
#: mm: lower bound of the height of an arc, which keeps the radius of a straight arc finite.
_LEAST_HEIGHT_MM = 1e-9
#: Three points are on one line if the squared sine of the angle between them is below this.
_LINE_SINE_SQUARED = FLAT**2


#: mm: lower bound of a chord by which an area is divided.
_LEAST_CHORD_MM = 1e-9
#: rad: an angle may be below 0 by this much through rounding.
_ANGLE_ROUNDING = 1e-9


# Many arcs, with via half-way.


class Spans(Struct, frozen=True, eq=False):
    """K lines and arcs. An arc is computed from its middle, along `towards` and `along`.

    start, end: (K, 3) mm.
    via: (K, 3) the middle of an arc, mm, NaN for a line.
    curved: (K,) whether it is an arc.
    towards: (K, 3) unit vector from the centre of an arc to its middle, 0 for a line.
    along: (K, 3) unit vector of the chord, which is the direction of travel at the middle.
    radius: (K,) mm, 0 for a line.
    sweep: (K,) angle of an arc, rad, positive from `towards` to `along`, 0 for a line.
    length: (K,) length along the arc or line, mm.
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
        """(M, axes) points at `fraction` (M,), 0 to 1, of the length of the lines and arcs, mm.

        row: (M,) the line or arc of each point; None for all in order.
        axes: 2 for the coordinates x and y alone.
        """
        row = np.arange(len(self.length)) if row is None else row
        points = np.empty((len(row), axes))
        curved = self.curved[row]
        # Most calls want few points, often of lines alone.
        if not curved.all():
            lines = (~curved).nonzero()[0]
            self._fill_lines(points, lines, fraction[lines], row[lines])
        if curved.any():
            arcs = curved.nonzero()[0]
            self._fill_arcs(points, arcs, fraction[arcs], row[arcs])
        return points

    def _fill_lines(
        self, points: FloatArray, places: IntArray, fraction: FloatArray, row: IntArray
    ) -> None:
        # Axis by axis takes half the time.
        for axis in range(points.shape[1]):
            start = self.start[row, axis]
            points[places, axis] = start + fraction * (self.end[row, axis] - start)

    def _fill_arcs(
        self, points: FloatArray, places: IntArray, fraction: FloatArray, row: IntArray
    ) -> None:
        angle, radius = (fraction - 0.5) * self.sweep[row], self.radius[row]
        # From the middle, because the centre of a flat arc is far away and would cost digits.
        rise = -2 * radius * np.sin(angle / 2) ** 2
        run = radius * np.sin(angle)
        for axis in range(points.shape[1]):
            middle, towards = self.via[row, axis], self.towards[row, axis]
            points[places, axis] = middle + rise * towards + run * self.along[row, axis]

    def tangents(self) -> tuple[FloatArray, FloatArray]:
        """Unit directions of travel (K, 3) at the start and at the end; 0 without a length.

        The tangent at the middle of an arc is parallel to its chord. The chord of half the arc
        makes equal angles with the tangents at its two ends. So each end tangent is the chord of
        the arc, mirrored at the chord of that half.
        """
        leaves, arrives = self.along.copy(), self.along.copy()
        arc = np.flatnonzero(self.curved)
        if len(arc):
            via, along = self.via[arc], self.along[arc]
            for out, half in ((leaves, via - self.start[arc]), (arrives, self.end[arc] - via)):
                mirror = normalize(half)
                out[arc] = 2 * multiply_rows(mirror, along)[:, None] * mirror - along
        return leaves, arrives

    def to_middle(self, vectors: FloatArray) -> FloatArray:
        """`vectors` (K, 3) at the start, rotated with the direction of travel to the middle."""
        start, along = self.tangents()[0], self.along
        axis = normalize(cross(start, along))
        at_start = start, cross(axis, start), axis
        at_middle = along, cross(axis, along), axis
        rotated = np.zeros_like(vectors)
        for before, after in zip(at_start, at_middle, strict=True):
            rotated += multiply_rows(vectors, before)[:, None] * after
        return rotated

    def pick(self, index: IntArray) -> Spans:
        """The lines and arcs at `index`, in that order."""
        return Spans(*(getattr(self, name)[index] for name in Spans.__struct_fields__))


def make_spans(start: FloatArray, via: FloatArray, end: FloatArray) -> Spans:
    """Lines and arcs from `start` to `end`, each (K, 3), mm.

    via: (K, 3) middle of the arc, mm, NaN for a line.

    With the chord c and the height h, the sweep is 4 atan(2 h / c) and the radius is
    (c c / 4 + h h) / (2 h).
    """
    curved = ~np.isnan(via[:, 0])
    chord = end - start
    length = np.sqrt(multiply_rows(chord, chord))
    along = chord / np.where(length > 0, length, 1.0)[:, None]
    towards = np.zeros_like(chord)
    radius, sweep = np.zeros_like(length), np.zeros_like(length)
    arc = np.flatnonzero(curved)
    if len(arc):
        rise = via[arc] - (start[arc] + end[arc]) / 2
        height, half = (
            np.maximum(np.sqrt(multiply_rows(rise, rise)), _LEAST_HEIGHT_MM),
            length[arc] / 2,
        )
        towards[arc] = rise / height[:, None]
        radius[arc] = (half**2 + height**2) / (2 * height)
        sweep[arc] = 4 * np.arctan2(height, half)
        length[arc] = radius[arc] * sweep[arc]
    return Spans(start, end, via, curved, towards, along, radius, sweep, length)


def make_spans_through(start: FloatArray, via: FloatArray, end: FloatArray) -> Spans:
    """`make_spans` with `via` anywhere on the arcs, which may have any sweep.

    Three points on one line make a line.
    """
    a, b = start - via, end - via
    normal = cross(a, b)
    arc = np.flatnonzero(
        multiply_rows(normal, normal) > FLAT**2 * multiply_rows(a, a) * multiply_rows(b, b)
    )
    middle = np.full_like(via, np.nan)
    middle[arc] = find_arc_middles(start[arc], via[arc], end[arc])
    return make_spans(start, middle, end)


def make_span_chain(points: FloatArray, via: FloatArray) -> Spans:
    """The N - 1 lines and arcs from each of `points` (N, 3) to the next.

    via: (N - 1, 3) middles of the arcs, NaN for a line.
    """
    return make_spans(points[:-1], via, points[1:])


def measure_spans(points: FloatArray, via: FloatArray) -> FloatArray:
    """(N - 1,) lengths of the lines and arcs from each of `points` (N, 3) to the next, mm.

    via: (N - 1, 3) middles of the arcs, NaN for a line.
    """
    chord = np.linalg.norm(np.diff(points, axis=0), axis=1)
    arc = np.flatnonzero(~np.isnan(via[:, 0]))
    if len(arc):
        chord[arc] = make_spans(points[arc], via[arc], points[arc + 1]).length
    return np.asarray(chord, dtype=np.float64)


def measure_path(path: ToolPath) -> float:
    """Length of one pass along `path`, mm."""
    return float(measure_spans(path.position, path.via[1:]).sum())


def are_bent(start: FloatArray, via: FloatArray, end: FloatArray) -> BoolArray:
    """(N,) whether arcs are not straight; via is half-way along them."""
    height = np.linalg.norm(via - (start + end) / 2, axis=1)
    return np.asarray(height > FLAT * np.linalg.norm(end - start, axis=1))


def compute_bulges(start: FloatArray, via: FloatArray, end: FloatArray) -> FloatArray:
    """(N,) bulges of arcs seen from above: tan(sweep / 4), counter-clockwise positive.

    via: middle of the arc. NaN, or a chord of no length, gives 0.

    The bulge is the height over half the chord. An arc that turns left has its middle on the right
    of the chord.
    """
    chord, rise = (end - start)[:, :2], (via - start)[:, :2]
    square = multiply_rows(chord, chord)
    height = chord[:, 0] * rise[:, 1] - chord[:, 1] * rise[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.nan_to_num(np.where(square > 0, -2 * height / square, 0.0))


def find_bulge_middles(start: FloatArray, bulge: FloatArray, end: FloatArray) -> FloatArray:
    """(N, 2 or 3) middles of arcs in the plane with bulges (N,).

    The middle is on the right of the middle of the chord, by bulge times half the chord.
    """
    half = (end - start) / 2
    middle: FloatArray = start + half
    middle[:, 0] += half[:, 1] * bulge
    middle[:, 1] -= half[:, 0] * bulge
    return middle


# Many arcs, with via anywhere on them.


def find_arc_middles(start: FloatArray, via: FloatArray, end: FloatArray) -> FloatArray:
    """(N, 3) middles of the arcs from `start` through `via` to `end`, each (N, 3), mm.

    In the plane of the arc, with the middle of the chord as origin, via is (u, h) and half the
    chord is a. The centre is (0, k) with k = (u^2 + h^2 - a^2) / 2h.

    Three points on one line give the point half-way if via is between the others. Else they give
    via itself, so that they are not mistaken for an arc. An unknown start (NaN) gives via too.
    """
    centre, span = (start + end) / 2, end - start
    length = measure_lengths(span)
    with np.errstate(divide="ignore", invalid="ignore"):
        along = np.where(length[:, None] > 0, span / length[:, None], 0.0)
        u = np.einsum("ni,ni->n", via - centre, along)
        across = via - centre - u[:, None] * along
        h = measure_lengths(across)
        a = length / 2
        k = (u * u + h * h - a * a) / (2 * h)
        radius = np.hypot(a, k)
        # Two forms of one number. The first has all digits of a very flat arc on the short side.
        height = np.where(k < 0, a * a / (radius - k), radius + k)
        flat = h < FLAT * a
        middle = centre + np.where(flat, 0.0, height / h)[:, None] * across
    has_no_start = np.isnan(start).any(axis=1)
    is_outside = flat & (np.abs(u) > a * (1 - FLAT))
    keep_via = has_no_start | is_outside | ((a == 0) & (h == 0))
    return np.where(keep_via[:, None], via, middle)


def measure_arcs(start: FloatArray, via: FloatArray, end: FloatArray) -> FloatArray:
    """(N,) lengths of the arcs from start through via to end, each (N, 3), mm.

    With the angle at via between the directions to the two ends, the sweep is 2 (pi - angle), and
    the radius is chord / (2 sin(angle)). Three points on one line give the length of the two lines.
    """
    to_start, to_end = start - via, end - via
    sine = measure_lengths(cross(to_start, to_end))
    angle = np.arctan2(sine, np.einsum("ij,ij->i", to_start, to_end))
    flat = measure_lengths(to_start) + measure_lengths(to_end)
    turn = np.pi - angle
    with np.errstate(divide="ignore", invalid="ignore"):
        curved = measure_lengths(end - start) / np.sin(turn) * turn
    # A third-party program may contain an arc with its three points on one line, in any order.
    return np.asarray(np.where(np.sin(turn) > FLAT, curved, flat), dtype=np.float64)


def level_arms(
    start: FloatArray, via: FloatArray, end: FloatArray
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Arms, sweeps and senses of arcs seen from above.

    Returns the vector from the start to the centre (N, 2), mm, the sweep (N,), rad, 0 to 2 pi, and
    whether the arc turns left (N,).
    """
    u, w = (via - start)[:, :2], (end - start)[:, :2]
    (ux, uy), (wx, wy) = u.T, w.T
    uu, ww, area = ux * ux + uy * uy, wx * wx + wy * wy, ux * wy - uy * wx
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y = (uu * wy - ww * uy) / (2 * area), (ww * ux - uu * wx) / (2 * area)
        end_x, end_y = wx - x, wy - y
        turn = np.sign(area) * (y * end_x - x * end_y)
        sweep = np.arctan2(turn, -(x * end_x + y * end_y)) % (2 * np.pi)
    return np.column_stack([x, y]), sweep, area > 0


# One arc, without arrays.


def compute_circle(start: Vec3, via: Vec3, end: Vec3) -> tuple[Vec3, float, Vec3, float]:
    """Centre, radius, unit axis and sweep of the arc through three points, mm and rad.

    The sweep is from 0 to 2 pi about the axis. Raises ValueError if the points are on one line.
    """
    if start[2] == via[2] == end[2]:
        return _flat_circle(start, via, end)
    (x0, y0, z0), (ux, uy, uz), (wx, wy, wz) = start, subtract(via, start), subtract(end, start)
    ax, ay, az = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
    uu, ww = ux * ux + uy * uy + uz * uz, wx * wx + wy * wy + wz * wz
    area2 = ax * ax + ay * ay + az * az
    if area2 < _LINE_SINE_SQUARED * uu * ww or area2 == 0.0:
        raise ValueError("the three points of the arc are on one line")
    # From the centre to the start: -(ww (a x u) + uu (w x a)) / 2 area^2, a as the unscaled axis.
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
    """`circle` for three points of the same height, as almost all are."""
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
    """Whether three points make an arc: no two of them are equal and they are not on one line."""
    (ux, uy, uz), (wx, wy, wz) = subtract(via, start), subtract(end, start)
    ax, ay, az = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
    area2 = ax * ax + ay * ay + az * az
    uu, ww = ux * ux + uy * uy + uz * uz, wx * wx + wy * wy + wz * wz
    return area2 > 0.0 and area2 >= _LINE_SINE_SQUARED * uu * ww


def measure_sweep(start: Vec3, via: Vec3, end: Vec3) -> tuple[float, float]:
    """Sweep of the arc through three points, rad, and the distance of `via` from its chord, mm.

    The rest of the circle, 2 pi - sweep, is twice the angle at `via` between the two ends.
    """
    (sx, sy, sz), (vx, vy, vz), (ex, ey, ez) = start, via, end
    ux, uy, uz, wx, wy, wz = sx - vx, sy - vy, sz - vz, ex - vx, ey - vy, ez - vz
    area = math.hypot(uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx)
    sweep = 2 * (math.pi - math.atan2(area, ux * wx + uy * wy + uz * wz))
    return sweep, area / max(math.dist(start, end), _LEAST_CHORD_MM)


def turn_about(v: Vec3, axis: Vec3, angle: float) -> Vec3:
    """`v` rotated by `angle` rad about the unit vector `axis` (Rodrigues)."""
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


def subtract(a: Vec3, b: Vec3) -> Vec3:
    """The difference a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


# Circles, through three points and fitted to many.


class Circle(Struct, frozen=True, eq=False):
    """A circle in space. Angles on it are measured from `first`, counter-clockwise about the axis.

    center: (3,) mm.
    axis: (3,) unit vector.
    first: (3,) unit vector from the centre, direction of the angle 0.
    radius: mm.
    """

    center: FloatArray
    axis: FloatArray
    first: FloatArray
    radius: float

    def angles(self, points: FloatArray) -> FloatArray:
        """(N,) angles of `points` (N, 3), rad, 0 to 2 pi."""
        arms = points - self.center
        angle = np.arctan2(arms @ cross(self.axis, self.first), arms @ self.first)
        return np.asarray(np.where(angle < -_ANGLE_ROUNDING, angle + 2 * np.pi, angle))

    def at(self, angles: FloatArray) -> FloatArray:
        """(N, 3) points of the circle at `angles` (N,), rad, mm."""
        return np.asarray(self.center + self.radius * self.radial(angles))

    def radial(self, angles: FloatArray) -> FloatArray:
        """(N, 3) unit vectors from the centre at `angles` (N,), rad."""
        second = cross(self.axis, self.first)
        return np.asarray(np.cos(angles)[:, None] * self.first + np.sin(angles)[:, None] * second)

    def distances(self, points: FloatArray) -> FloatArray:
        """(N,) distances of `points` (N, 3) from the circle, mm."""
        arms = points - self.center
        height = arms @ self.axis
        in_plane = np.sqrt(np.maximum((arms**2).sum(axis=1) - height**2, 0.0))
        return np.asarray(np.hypot(in_plane - self.radius, height))


def find_circle(p: FloatArray, q: FloatArray, r: FloatArray) -> Circle | None:
    """The circle through three points (3,), in the order p, q, r; None if they are on one line."""
    u, w = q - p, r - p
    normal = cross(u, w)
    square, longest = float(normal @ normal), max(float(u @ u), float(w @ w))
    if square <= (FLAT * longest) ** 2:
        return None
    center = p + cross(float(u @ u) * w - float(w @ w) * u, normal) / (2 * square)
    return _about(center, normal / math.sqrt(square), p)


def fit_circle(points: FloatArray) -> Circle | None:
    """The circle fitted to `points` (N, 3) by least squares, in their order.

    First the plane is fitted, then the circle in it: centre and radius are linear in x, y and
    x x + y y. Points on a circle give that circle exactly. None if the points are on one line.
    """
    middle = points.mean(axis=0)
    arms = points - middle
    _, size, axes = np.linalg.svd(arms, full_matrices=False)
    if size[1] <= FLAT * size[0]:
        return None
    x, y = arms @ axes[0], arms @ axes[1]
    solution, *_ = np.linalg.lstsq(
        np.column_stack([x, y, np.ones(len(x))]), x * x + y * y, rcond=None
    )
    center = middle + axes[0] * (solution[0] / 2) + axes[1] * (solution[1] / 2)
    arms = points - center
    turning = cross(arms[:-1], arms[1:]).sum(axis=0)
    axis = cross(axes[0], axes[1])
    circle = _about(center, axis if float(axis @ turning) > 0 else -axis, points[0])
    square = float(solution[2]) + float(solution[0]) ** 2 / 4 + float(solution[1]) ** 2 / 4
    radius = math.sqrt(max(square, 0.0))
    return Circle(circle.center, circle.axis, circle.first, radius)


def _about(center: FloatArray, axis: FloatArray, start: FloatArray) -> Circle:
    """The circle about an axis through `center` on which `start` lies, at the angle 0."""
    arm = start - center
    flat = arm - axis * float(arm @ axis)
    radius = float(np.linalg.norm(flat))
    return Circle(center, axis, flat / radius, radius)
