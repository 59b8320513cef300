"""Named passes that replace an instruction by ones that every controller has. Each is a function of the pose where the
motion starts, the motion, and the distance (mm) by which the replacement may leave it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from msgspec.structs import replace

from camgen.ir import Force, Instruction, MoveC, MoveL, Program
from camgen.pose import FloatArray, Pose, Vec3, rotation_between

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
    poses = along(start, arc, [k / count for k in range(1, count)])
    presses = _turned(arc.press, axis, sweep, count)
    lines: list[MoveL | MoveC] = [
        MoveL(pose, arc.speed, blend, arc.force, press) for pose, press in zip(poses, presses, strict=True)
    ]
    lines.append(MoveL(arc.target, arc.speed, arc.blend, arc.force, arc.press, arc.joints))
    return lines


def halves(start: Pose, arc: MoveC, _tolerance: float) -> list[MoveL | MoveC]:
    """The arc as two arcs of half the sweep, exact."""
    _, _, axis, sweep = circle(start.origin, arc.via.origin, arc.target.origin)
    first, middle, last = along(start, arc, (0.25, 0.5, 0.75))
    press = _turned(arc.press, axis, sweep, 2)[0]
    seam = max(arc.blend, 1.0)
    return [
        replace(arc, via=first, target=middle, press=press, blend=seam, joints=None),
        replace(arc, via=last),
    ]


#: The passes by the name under which a post lists them.
PASSES: dict[str, Pass] = {"halves": halves, "chords": chords}


#: Three points are on one line when the squared sine of the angle between them is below this.
_LINE = 1e-18
#: The usual fly-by zones, mm, the widest first.
ZONES = (5.0, 1.0, 0.3)


def corner_blend(turn: float, tolerance: float) -> float:
    """The largest usual blend radius (mm) that leaves a corner of ``turn`` rad by at most ``tolerance`` mm.

    A blend that starts b before the corner follows a parabola, which passes the corner at b sin(turn / 2) / 2. The
    result is one of 0 (stop), 0.3, 1 and 5 mm: the usual fly-by zones.
    """
    reach = 2 * tolerance / max(math.sin(min(abs(turn), math.pi) / 2), 1e-9)
    return next((zone for zone in ZONES if zone <= reach), 0.0)


def circle(start: Vec3, via: Vec3, end: Vec3) -> tuple[Vec3, float, Vec3, float]:
    """Centre, radius, unit axis and sweep (rad, about that axis) of the arc through three points.

    ValueError when they are on one line. Plain arithmetic: on three numbers it is ten times as fast as arrays.
    """
    u, w = _minus(via, start), _minus(end, start)
    axis = _cross(u, w)
    uu, ww, area2 = _dot(u, u), _dot(w, w), _dot(axis, axis)
    if area2 < _LINE * uu * ww or area2 == 0.0:
        raise ValueError("the three points of the arc are on one line")
    one, two = _cross(axis, u), _cross(w, axis)
    f, g = ww / (2 * area2), uu / (2 * area2)
    arm = (-one[0] * f - two[0] * g, -one[1] * f - two[1] * g, -one[2] * f - two[2] * g)
    centre = _minus(start, arm)
    size = math.sqrt(area2)
    unit = (axis[0] / size, axis[1] / size, axis[2] / size)
    last = _minus(end, centre)
    sweep = math.atan2(_dot(_cross(arm, last), unit), _dot(arm, last)) % (2 * math.pi)
    return centre, math.sqrt(_dot(arm, arm)), unit, sweep


def is_arc(start: Pose, arc: MoveC) -> bool:
    """Whether the three points of an arc make one: they are apart and not on one line."""
    u, w = _minus(arc.via.origin, start.origin), _minus(arc.target.origin, start.origin)
    axis = _cross(u, w)
    area2 = _dot(axis, axis)
    return area2 > 0.0 and area2 >= _LINE * _dot(u, u) * _dot(w, w)


def along(start: Pose, arc: MoveC, fractions: Sequence[float]) -> list[Pose]:
    """Poses on the arc at fractions 0..1 of its sweep; the orientation turns from start through via to target."""
    centre, _, axis, sweep = circle(start.origin, arc.via.origin, arc.target.origin)
    arm = _minus(start.origin, centre)
    same = start.rotation is arc.target.rotation or np.array_equal(start.rotation, arc.target.rotation)
    poses = []
    for fraction in fractions:
        x, y, z = _turn(arm, axis, sweep * fraction)
        rotation = start.rotation if same else _turning(start, arc, fraction)
        poses.append(Pose(rotation, (centre[0] + x, centre[1] + y, centre[2] + z)))
    return poses


def without_force(program: Program) -> Program:
    """The program without force control: for a job that says to ignore it. Nothing else changes."""
    body: list[Instruction] = []
    for item in program.body:
        if isinstance(item, (MoveL, MoveC)) and (item.force or any(item.press)):
            body.append(replace(item, force=0.0, press=(0.0, 0.0, 0.0)))
        elif not isinstance(item, Force):
            body.append(item)
    return program.with_body(tuple(body))


def _turning(start: Pose, arc: MoveC, fraction: float) -> FloatArray:
    """The orientation at ``fraction``: evenly to the via point, evenly on. Half a turn has no shorter way otherwise."""
    if fraction <= 0.5:
        return rotation_between(start.rotation, arc.via.rotation, 2 * fraction)
    return rotation_between(arc.via.rotation, arc.target.rotation, 2 * fraction - 1)


def _turned(press: Vec3, axis: Vec3, sweep: float, count: int) -> list[Vec3]:
    """The press direction at the inner points of ``count`` equal pieces, given at the end of the arc."""
    if not any(press):
        return [press] * (count - 1)
    return [_turn(press, axis, sweep * (i / count - 1)) for i in range(1, count)]


def _turn(v: Vec3, axis: Vec3, angle: float) -> Vec3:
    """``v`` turned about the unit vector ``axis`` (Rodrigues)."""
    c, s = math.cos(angle), math.sin(angle)
    across, along_axis = _cross(axis, v), _dot(axis, v) * (1 - c)
    return (
        c * v[0] + s * across[0] + along_axis * axis[0],
        c * v[1] + s * across[1] + along_axis * axis[1],
        c * v[2] + s * across[2] + along_axis * axis[2],
    )


def _minus(a: Vec3, b: Vec3) -> Vec3:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def _dot(a: Vec3, b: Vec3) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Vec3, b: Vec3) -> Vec3:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
