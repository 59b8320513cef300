"""Named passes that replace an instruction by ones that every controller has. Each is a function of the pose where the
motion starts, the motion, and the distance (mm) by which the replacement may leave it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from camgen.ir import MoveC, MoveL
from camgen.pose import FloatArray, Pose, Vec3, rotation_about_axis, rotation_between

Pass = Callable[[Pose, MoveC, float], list[MoveL | MoveC]]


def chords(start: Pose, arc: MoveC, tolerance: float) -> list[MoveL | MoveC]:
    """The arc as straight lines, sagitta R (1 - cos(step / 2)) <= tolerance. Orientation turns evenly with the arc.

    The blend of the arc stays with its last line. Between the lines the tool flies by: a zone reaches at most half-way
    to the next corner, and from there the corner of two chords is cut by no more than their sagitta.
    """
    _, radius, axis, sweep = circle(start.origin, arc.via.origin, arc.target.origin)
    step = 2 * math.acos(max(-1.0, 1 - tolerance / radius)) if tolerance < radius else math.pi / 2
    count = max(1, math.ceil(sweep / step - 1e-9))
    blend = max(corner_blend(sweep / count, tolerance), ZONES[-1])
    poses = along(start, arc, np.arange(1, count) / count)
    presses = _turned(arc.press, axis, sweep, count)
    lines: list[MoveL | MoveC] = [
        MoveL(pose, arc.speed, blend, arc.force, press) for pose, press in zip(poses, presses, strict=True)
    ]
    lines.append(MoveL(arc.target, arc.speed, arc.blend, arc.force, arc.press, arc.joints))
    return lines


def halves(start: Pose, arc: MoveC, _tolerance: float) -> list[MoveL | MoveC]:
    """The arc as two arcs of half the sweep, exact."""
    _, _, axis, sweep = circle(start.origin, arc.via.origin, arc.target.origin)
    first, middle, last = along(start, arc, np.array([0.25, 0.5, 0.75]))
    press = _turned(arc.press, axis, sweep, 2)[0]
    seam = max(arc.blend, 1.0)
    return [
        replace(arc, via=first, target=middle, press=press, blend=seam, joints=None),
        replace(arc, via=last),
    ]


#: The passes by the name under which a post lists them.
PASSES: dict[str, Pass] = {"halves": halves, "chords": chords}


#: The usual fly-by zones, mm, the widest first.
ZONES = (5.0, 1.0, 0.3)


def corner_blend(turn: float, tolerance: float) -> float:
    """The largest usual blend radius (mm) that leaves a corner of ``turn`` rad by at most ``tolerance`` mm.

    A blend that starts b before the corner follows a parabola, which passes the corner at b sin(turn / 2) / 2. The
    result is one of 0 (stop), 0.3, 1 and 5 mm: the usual fly-by zones.
    """
    reach = 2 * tolerance / max(math.sin(min(abs(turn), math.pi) / 2), 1e-9)
    return next((zone for zone in ZONES if zone <= reach), 0.0)


def circle(start: Vec3, via: Vec3, end: Vec3) -> tuple[FloatArray, float, FloatArray, float]:
    """Centre (3,), radius, unit axis (3,) and sweep (rad, about that axis) of the arc through three points.

    ValueError when they are on one line.
    """
    p, q, r = (np.asarray(v, dtype=np.float64) for v in (start, via, end))
    u, w = q - p, r - p
    axis = np.cross(u, w)
    area2 = float(axis @ axis)
    if area2 < 1e-18 * float(u @ u) * float(w @ w) or area2 == 0.0:
        raise ValueError("the three points of the arc are on one line")
    to_centre = (np.cross(axis, u) * float(w @ w) + np.cross(w, axis) * float(u @ u)) / (2 * area2)
    centre = p + to_centre
    radius = float(np.linalg.norm(to_centre))
    axis = axis / math.sqrt(area2)
    a, b = p - centre, r - centre
    sweep = math.atan2(float(np.cross(a, b) @ axis), float(a @ b)) % (2 * math.pi)
    return centre, radius, axis, sweep


def is_arc(start: Pose, arc: MoveC) -> bool:
    """Whether the three points of an arc make one: they are apart and not on one line."""
    try:
        circle(start.origin, arc.via.origin, arc.target.origin)
    except ValueError:
        return False
    return True


def along(start: Pose, arc: MoveC, fractions: FloatArray) -> list[Pose]:
    """Poses on the arc at fractions 0..1 of its sweep; the orientation turns from start through via to target."""
    centre, _, axis, sweep = circle(start.origin, arc.via.origin, arc.target.origin)
    arm = np.asarray(start.origin) - centre
    same = start.rotation is arc.target.rotation or np.array_equal(start.rotation, arc.target.rotation)
    poses = []
    for fraction in fractions.tolist():
        x, y, z = (centre + rotation_about_axis(axis, sweep * fraction) @ arm).tolist()
        rotation = start.rotation if same else _turning(start, arc, fraction)
        poses.append(Pose(rotation, (x, y, z)))
    return poses


def _turning(start: Pose, arc: MoveC, fraction: float) -> FloatArray:
    """The orientation at ``fraction``: evenly to the via point, evenly on. Half a turn has no shorter way otherwise."""
    if fraction <= 0.5:
        return rotation_between(start.rotation, arc.via.rotation, 2 * fraction)
    return rotation_between(arc.via.rotation, arc.target.rotation, 2 * fraction - 1)


def _turned(press: Vec3, axis: FloatArray, sweep: float, count: int) -> list[Vec3]:
    """The press direction at the inner points of ``count`` equal pieces, given at the end of the arc."""
    if not any(press):
        return [press] * (count - 1)
    result: list[Vec3] = []
    for i in range(1, count):
        x, y, z = (rotation_about_axis(axis, sweep * (i / count - 1)) @ np.asarray(press)).tolist()
        result.append((x, y, z))
    return result
