"""The way of a RAPID motion, and what is wrong with it or open: the shape of an arc, a half turn, an odd posture.

MoveC: RAPID system data types manual, its limitations; a public quotation of the manual for 240 deg.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from camgen.geometry.arcs import circle, turn_about
from camgen.geometry.vectors import cross, dots, lengths
from camgen.model.part import BoolArray
from camgen.model.pose import FloatArray, Pose, Vec3, rotation_between

#: rad: the widest arc.
_WIDEST = math.radians(240.01)
#: rad: smaller angles between circle point and end of an arc are a fault, and a remark. The manual
#: asks for 1 degree; the digits of a text may lose a part of it.
_FLATTEST, _LEAST_ANGLE = math.radians(0.9), math.radians(1.0)
#: Nearer than this, mm, points are one to the controller; and the part of the arc that its shorter piece should be.
_CLOSEST, _SHORTER = 0.1, 0.2
#: What is as near as this to a bound, rad or mm, is looked at one by one.
_SURE = 1e-7
#: A turn whose trace is below this is half a turn, to 0.1 deg: its sense is open.
_HALF_TURN = -1 + math.radians(0.1) ** 2
#: Quarter turns of axes 1, 4 and 6 as far as arms have them, and ``cfx`` of arms with six axes.
_QUARTERS, _CFX = ((-3, 2), (-5, 4), (-5, 4)), range(8)
#: deg: no arm turns axes 1, 2, 3 and 5 further; axes 4 and 6 may be set up to.
_FARTHEST = 450.0


def judge_arc(start: Vec3, via: Vec3, end: Vec3) -> tuple[str, str]:
    """Why no controller takes the arc from ``start`` through ``via`` to ``end``, and what the manual advises against in
    one that it takes; empty where there is nothing.
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
    return "", "the circle point of an arc is near an end of it" if min(first, last) < _SHORTER * (
        first + last
    ) else ""


def judge_arcs(start: FloatArray, via: FloatArray, end: FloatArray) -> BoolArray:
    """(N,): the arcs through three points (N, 3) of which ``judge_arc`` says nothing for sure."""
    sides = [via - start, end - via, end - start]
    on, off, chord = sides
    area = lengths(cross(on, chord))
    first, last = np.arctan2(area, dots(on, chord)), np.arctan2(area, dots(off, chord))
    least = np.minimum(first, last)
    near = np.minimum.reduce([dots(side, side) for side in sides])
    usual = (least > _LEAST_ANGLE + _SURE) & (2 * (first + last) < _WIDEST - _SURE)
    return np.asarray(
        usual & (near > (_CLOSEST + _SURE) ** 2) & (least > _SHORTER * (first + last) + _SURE)
    )


def _angle_at(corner: Vec3, a: Vec3, b: Vec3) -> float:
    """The angle of a triangle at ``corner``, rad: half of the arc between ``a`` and ``b``; 0 where points are one."""
    ux, uy, uz = a[0] - corner[0], a[1] - corner[1], a[2] - corner[2]
    wx, wy, wz = b[0] - corner[0], b[1] - corner[1], b[2] - corner[2]
    area = math.hypot(uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx)
    return math.atan2(area, ux * wx + uy * wy + uz * wz)


def is_half_turn(start: Pose, end: Pose) -> bool:
    """Whether a straight motion turns the tool by 180 deg, in a sense that nothing tells."""
    if start.rotation is end.rotation:
        return False
    return float(np.vdot(start.rotation, end.rotation)) < _HALF_TURN


@lru_cache(maxsize=1000)
def posture_fault(confdata: tuple[int, ...]) -> str:
    """Why no arm of six axes has this configuration, empty when one may."""
    return f"cfx is {confdata[3]}, not 0 to 7" if confdata[3] not in _CFX else ""


@lru_cache(maxsize=1000)
def posture_remark(confdata: tuple[int, ...]) -> str:
    """What only an arm with turns without end can have."""
    for axis, quarter, (least, most) in zip((1, 4, 6), confdata, _QUARTERS, strict=False):
        if not least <= quarter <= most:
            return f"axis {axis} in quarter turn {quarter}; arms have {least} to {most}"
    return ""


def joints_fault(axes: tuple[float, ...]) -> str:
    """Why no arm takes these joint values, deg; empty when one may."""
    far = next((k for k in (0, 1, 2, 4) if abs(axes[k]) > _FARTHEST), None)
    return "" if far is None else f"axis {far + 1} at {axes[far]:g} deg"


def joints_remark(axes: tuple[float, ...]) -> str:
    """What only an arm with turns without end takes."""
    far = next((k for k in (3, 5) if abs(axes[k]) > _FARTHEST), None)
    return "" if far is None else f"axis {far + 1} at {axes[far]:g} deg"


def split_arc(start: Pose, via: Pose, target: Pose) -> list[Pose]:
    """The points half-way and at the end of the pieces of an arc, each at most half a circle; the tool turns evenly."""
    a = start.origin
    ab, ac = _minus(via.origin, a), _minus(target.origin, a)
    normal = _cross(ab, ac)
    square = _dot(normal, normal)
    one, two = _cross(normal, ab), _cross(ac, normal)
    p, q = _dot(ac, ac) / (2 * square), _dot(ab, ab) / (2 * square)
    out = (
        one[0] * p + two[0] * q,
        one[1] * p + two[1] * q,
        one[2] * p + two[2] * q,
    )  # from the start to the centre
    u = (-out[0], -out[1], -out[2])
    length = math.sqrt(square)
    v = _cross((normal[0] / length, normal[1] / length, normal[2] / length), u)
    end = _minus(ac, out)
    angle = math.atan2(_dot(end, v), _dot(end, u)) % (2 * math.pi)
    pieces = 1 if angle <= math.pi * 1.0001 else 2
    made = []
    for k in range(1, 2 * pieces + 1):
        c, s = math.cos(angle * k / (2 * pieces)), math.sin(angle * k / (2 * pieces))
        x, y, z = (a[i] + out[i] + u[i] * c + v[i] * s for i in range(3))
        made.append(Pose(_turned(start, target, k / (2 * pieces)), (x, y, z)))
    return made


def split_at_circle_point(start: Pose, via: Pose, target: Pose) -> list[Pose]:
    """Splits an arc as `split_arc` does, by way of the orientation of the circle point.

    The tool turns evenly from the start to the circle point, and from there to the end.
    """
    centre, _, axis, sweep = circle(start.origin, via.origin, target.origin)
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
    """The rotation of the tool after a part of a motion."""
    if start.rotation is target.rotation:
        return target.rotation
    return rotation_between(start.rotation, target.rotation, part)


def _minus(a: Vec3, b: Vec3) -> Vec3:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def _dot(a: Vec3, b: Vec3) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Vec3, b: Vec3) -> Vec3:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
