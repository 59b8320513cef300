"""What is wrong with the way of a RAPID motion, or open: the shape of an arc, a half turn, a posture that no arm has.

MoveC: RAPID system data types manual, its limitations; a public quotation of the manual for 240 deg.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from camgen.model.pose import Pose, Vec3

#: The most that one arc may turn, rad, and how near to its chord, seen from its ends, its circle point may be, rad: it
#: is 1 deg, less what printed digits lose.
_WIDEST, _FLATTEST = math.radians(240.01), math.radians(0.9)
#: Nearer than this, mm, points are one to the controller; and the part of the arc that its shorter piece should be.
_CLOSEST, _SHORTER = 0.1, 0.2
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
    if min(math.dist(start, via), math.dist(via, end), math.dist(start, end)) < _CLOSEST:
        return "", f"the points of an arc are less than {_CLOSEST:g} mm apart"
    return "", "the circle point of an arc is near an end of it" if min(first, last) < _SHORTER * (first + last) else ""


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
