"""Which arcs MoveC takes. Its limits are not confirmed, so arcs stay well inside them (docs, what is not certain)."""

from __future__ import annotations

import math

from camgen.pose import Vec3

#: Sweep in rad; distance in mm between any two of the three points.
_WIDEST, _FLATTEST, _CLOSEST = math.radians(120), math.radians(4), 0.2


def arc_fault(start: Vec3, via: Vec3, end: Vec3, digit: float) -> str:
    """Why the arc cannot be one MoveC, empty when it can. digit: the last one printed, mm."""
    sweep, height = _sweep(start, via, end)
    if sweep > _WIDEST + 1e-6:
        return "an arc of more than 120 deg; split it"
    closest = max(_CLOSEST, 10 * digit)
    near = min(math.dist(start, via), math.dist(via, end), math.dist(start, end))
    if sweep < _FLATTEST or height < 2 * digit or near < closest:
        return f"an arc of less than 4 deg, {closest:g} mm or {2 * digit:g} mm height; use a straight motion"
    return ""


def _sweep(start: Vec3, via: Vec3, end: Vec3) -> tuple[float, float]:
    """Sweep (rad) of the arc through three points, the rest of which is twice the angle that its ends make at ``via``,
    and the distance (mm) of ``via`` from the line through its ends.
    """
    (sx, sy, sz), (vx, vy, vz), (ex, ey, ez) = start, via, end
    ux, uy, uz, wx, wy, wz = sx - vx, sy - vy, sz - vz, ex - vx, ey - vy, ez - vz
    area = math.hypot(uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx)
    sweep = 2 * (math.pi - math.atan2(area, ux * wx + uy * wy + uz * wz))
    return sweep, area / max(math.dist(start, end), 1e-9)
