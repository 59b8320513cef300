"""Named passes that replace an instruction by ones that every controller has. Each is a function of the pose where the
motion starts, the motion, and the distance (mm) by which the replacement may leave it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from msgspec.structs import replace

from camgen.lower.columns import ZONES
from camgen.model.pose import FloatArray, Pose, Vec3, rotation_between
from camgen.model.program import Force, Instruction, MoveC, MoveL, Program

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
        MoveL(pose, arc.speed, blend, arc.force, press, None, None, arc.path, arc.work)
        for pose, press in zip(poses, presses, strict=True)
    ]
    last = (arc.speed, arc.blend, arc.force, arc.press, arc.joints, arc.posture, arc.path, arc.work)
    lines.append(MoveL(arc.target, *last))
    return lines


def halves(start: Pose, arc: MoveC, _tolerance: float) -> list[MoveL | MoveC]:
    """The arc as two arcs of half the sweep, exact."""
    _, _, axis, sweep = circle(start.origin, arc.via.origin, arc.target.origin)
    first, middle, last = along(start, arc, (0.25, 0.5, 0.75))
    press = _turned(arc.press, axis, sweep, 2)[0]
    seam = max(arc.blend, 1.0)
    return [
        replace(arc, via=first, target=middle, press=press, blend=seam, joints=None, posture=None),
        replace(arc, via=last),
    ]


#: The passes by the name under which a post lists them.
PASSES: dict[str, Pass] = {"halves": halves, "chords": chords}


#: Three points are on one line when the squared sine of the angle between them is below this.
_LINE = 1e-18


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
    if start[2] == via[2] == end[2]:
        return _flat_circle(start, via, end)
    (x0, y0, z0), (ux, uy, uz), (wx, wy, wz) = start, _minus(via, start), _minus(end, start)
    ax, ay, az = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
    uu, ww, area2 = ux * ux + uy * uy + uz * uz, wx * wx + wy * wy + wz * wz, ax * ax + ay * ay + az * az
    if area2 < _LINE * uu * ww or area2 == 0.0:
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
    if area * area < _LINE * uu * ww or area == 0.0:
        raise ValueError("the three points of the arc are on one line")
    cx, cy = (uu * wy - ww * uy) / (2 * area), (ww * ux - uu * wx) / (2 * area)
    lx, ly = wx - cx, wy - cy
    up = math.copysign(1.0, area)
    sweep = math.atan2(up * (cy * lx - cx * ly), -cx * lx - cy * ly) % (2 * math.pi)
    return (x0 + cx, y0 + cy, z0), math.hypot(cx, cy), (0.0, 0.0, up), sweep


def is_arc(start: Pose, arc: MoveC) -> bool:
    """Whether the three points of an arc make one: they are apart and not on one line."""
    (ux, uy, uz), (wx, wy, wz) = _minus(arc.via.origin, start.origin), _minus(arc.target.origin, start.origin)
    ax, ay, az = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
    area2 = ax * ax + ay * ay + az * az
    return area2 > 0.0 and area2 >= _LINE * (ux * ux + uy * uy + uz * uz) * (wx * wx + wy * wy + wz * wz)


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
