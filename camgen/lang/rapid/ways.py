"""Faults in the geometry of RAPID motions: arcs, half turns, configurations, joint values.

Limits of MoveC: technical reference manual; 240 deg from a public quotation of it.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from camgen.geometry.arcs import compute_circle, turn_about
from camgen.geometry.vectors import cross, measure_lengths, multiply_rows
from camgen.model.part import BoolArray
from camgen.model.pose import FloatArray, Pose, Vec3, rotation_between

#: rad: longest arc of MoveC, with a margin for rounding.
_WIDEST = math.radians(240.01)
#: rad: angles between circle point and end of an arc below which it is a fault or a remark. The
#: manual asks for 1 degree, and rounding of the coordinates may lose a part of it.
_FLATTEST, _LEAST_ANGLE = math.radians(0.9), math.radians(1.0)
#: mm: the manual asks for this distance between the points of an arc.
_CLOSEST = 0.1
#: Fraction of an arc that the shorter part before or after its circle point should have.
_SHORTER = 0.2
#: rad or mm: margin of the limits, within which arcs are tested one by one.
_SURE = 1e-7
#: A rotation is half a turn to 0.1 deg, in an open sense, if its trace is below this.
_HALF_TURN = -1 + math.radians(0.1) ** 2
#: Quarter turns that axes 1, 4 and 6 of arms have.
_QUARTERS = ((-3, 2), (-5, 4), (-5, 4))
#: ``cfx`` of arms with six axes.
_CFX = range(8)
#: deg: no arm turns axes 1, 2, 3 and 5 further. Axes 4 and 6 may have any range.
_FARTHEST = 450.0


def find_arc_faults(start: Vec3, via: Vec3, end: Vec3) -> tuple[str, str]:
    """The fault and the remark of an arc through three points, mm; empty without one.

    No controller accepts an arc with a fault. The manual advises against one with a remark.
    """
    first, last = _angle_at(start, via, end), _angle_at(end, via, start)
    if min(first, last) < 1e-9:
        return "the points of an arc are on one line", ""
    if 2 * (first + last) > _WIDEST:
        return f"an arc of {math.degrees(2 * (first + last)):.0f} deg; MoveC takes up to 240", ""
    if min(first, last) < _FLATTEST:
        return "the circle point of an arc is at an end of it, or nearly on its chord", ""
    if min(first, last) < _LEAST_ANGLE:
        return "", "the circle point and the end of an arc are less than 1 deg apart"
    if min(math.dist(start, via), math.dist(via, end), math.dist(start, end)) < _CLOSEST:
        return "", f"the points of an arc are less than {_CLOSEST:g} mm apart"
    if min(first, last) < _SHORTER * (first + last):
        return "", "the circle point of an arc is near an end of it"
    return "", ""


def is_usual_arc(start: FloatArray, via: FloatArray, end: FloatArray) -> BoolArray:
    """(N,) whether arcs through three points (N, 3), mm, certainly have no fault or remark."""
    sides = [via - start, end - via, end - start]
    to_via, to_end, chord = sides
    area = measure_lengths(cross(to_via, chord))
    first, last = (
        np.arctan2(area, multiply_rows(to_via, chord)),
        np.arctan2(area, multiply_rows(to_end, chord)),
    )
    smaller = np.minimum(first, last)
    shortest_squared = np.minimum.reduce([multiply_rows(side, side) for side in sides])
    is_usual = (smaller > _LEAST_ANGLE + _SURE) & (2 * (first + last) < _WIDEST - _SURE)
    is_usual &= shortest_squared > (_CLOSEST + _SURE) ** 2
    return np.asarray(is_usual & (smaller > _SHORTER * (first + last) + _SURE))


def _angle_at(corner: Vec3, a: Vec3, b: Vec3) -> float:
    """The angle of a triangle at `corner`, rad: half of the arc between `a` and `b`.

    0 if two of the points are equal.
    """
    ux, uy, uz = a[0] - corner[0], a[1] - corner[1], a[2] - corner[2]
    wx, wy, wz = b[0] - corner[0], b[1] - corner[1], b[2] - corner[2]
    area = math.hypot(uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx)
    return math.atan2(area, ux * wx + uy * wy + uz * wz)


def is_half_turn(start: Pose, end: Pose) -> bool:
    """Whether a straight motion turns the tool by 180 deg, so that the sense is open."""
    if start.rotation is end.rotation:
        return False
    return float(np.vdot(start.rotation, end.rotation)) < _HALF_TURN


@lru_cache(maxsize=1000)
def find_posture_fault(confdata: tuple[int, ...]) -> str:
    """Why no arm of six axes has this configuration, empty if one may have it."""
    return f"cfx is {confdata[3]}, not 0 to 7" if confdata[3] not in _CFX else ""


@lru_cache(maxsize=1000)
def find_posture_remark(confdata: tuple[int, ...]) -> str:
    """Which axis needs an endless range for this configuration, empty without one."""
    for axis, quarter, (first, last) in zip((1, 4, 6), confdata, _QUARTERS, strict=False):
        if not first <= quarter <= last:
            return f"axis {axis} in quarter turn {quarter}; arms have {first} to {last}"
    return ""


def find_joints_fault(axes: tuple[float, ...]) -> str:
    """Why no arm takes these joint values, deg; empty if one may take them."""
    return _format_far_axis(axes, (0, 1, 2, 4))


def find_joints_remark(axes: tuple[float, ...]) -> str:
    """Which axis needs an endless range for these joint values, deg; empty without one."""
    return _format_far_axis(axes, (3, 5))


def _format_far_axis(axes: tuple[float, ...], indices: tuple[int, ...]) -> str:
    far = next((k for k in indices if abs(axes[k]) > _FARTHEST), None)
    return "" if far is None else f"axis {far + 1} at {axes[far]:g} deg"


def split_arc(start: Pose, via: Pose, target: Pose) -> list[Pose]:
    """Split an arc into pieces of at most half a circle, along which the tool turns evenly.

    Returns the via point and the end of each piece in turn.
    """
    a = start.origin
    ab, ac = _minus(via.origin, a), _minus(target.origin, a)
    normal = _cross(ab, ac)
    square = _dot(normal, normal)
    # The vector from the start to the centre is a weighted sum of one normal to each chord.
    m, n = _cross(normal, ab), _cross(ac, normal)
    p, q = _dot(ac, ac) / (2 * square), _dot(ab, ab) / (2 * square)
    to_centre = (m[0] * p + n[0] * q, m[1] * p + n[1] * q, m[2] * p + n[2] * q)
    u = (-to_centre[0], -to_centre[1], -to_centre[2])
    length = math.sqrt(square)
    v = _cross((normal[0] / length, normal[1] / length, normal[2] / length), u)
    end = _minus(ac, to_centre)
    angle = math.atan2(_dot(end, v), _dot(end, u)) % (2 * math.pi)
    pieces = 1 if angle <= math.pi * 1.0001 else 2
    poses = []
    for k in range(1, 2 * pieces + 1):
        c, s = math.cos(angle * k / (2 * pieces)), math.sin(angle * k / (2 * pieces))
        x, y, z = (a[i] + to_centre[i] + u[i] * c + v[i] * s for i in range(3))
        poses.append(Pose(_turned(start, target, k / (2 * pieces)), (x, y, z)))
    return poses


def split_at_circle_point(start: Pose, via: Pose, target: Pose) -> list[Pose]:
    """Split an arc as `split_arc` does, but through the orientation of the circle point.

    The tool turns evenly from the start to the circle point, and from there to the end.
    """
    centre, _, axis, sweep = compute_circle(start.origin, via.origin, target.origin)
    arms = [_minus(pose.origin, centre) for pose in (start, via)]
    sine, cosine = _dot(_cross(arms[0], arms[1]), axis), _dot(arms[0], arms[1])
    first = math.atan2(sine, cosine) % (2 * math.pi)
    poses: list[Pose] = []
    for begin, end, angle in ((start, via, first), (via, target, sweep - first)):
        arm = _minus(begin.origin, centre)
        pieces = 1 if angle <= math.pi * 1.0001 else 2
        for k in range(1, 2 * pieces):
            part = k / (2 * pieces)
            x, y, z = turn_about(arm, axis, part * angle)
            place = (centre[0] + x, centre[1] + y, centre[2] + z)
            poses.append(Pose(_turned(begin, end, part), place))
        poses.append(end)
    return poses


def _turned(start: Pose, target: Pose, part: float) -> FloatArray:
    if start.rotation is target.rotation:
        return target.rotation
    return rotation_between(start.rotation, target.rotation, part)


def _minus(a: Vec3, b: Vec3) -> Vec3:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def _dot(a: Vec3, b: Vec3) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Vec3, b: Vec3) -> Vec3:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
