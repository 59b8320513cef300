"""Named passes that replace an instruction by ones that every controller has. Each is a function of the pose where the
motion starts, the motion, and the distance (mm) by which the replacement may leave it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from msgspec.structs import replace

from camgen.geometry.arcs import circle, subtract, turn_about
from camgen.model.body import NUMBER, Body, Indices, Packed
from camgen.model.pose import FloatArray, Pose, Vec3, rotation_between, to_vec3
from camgen.model.program import Columns, Force, Instruction, MoveC, MoveJ, MoveL, Program, pack
from camgen.model.tolerance import SMALLEST_ZONE, ZONES

#: Blends, mm, at the seam of two arcs of one circle, the largest first.
SEAMS = (*ZONES, SMALLEST_ZONE)
#: A unit vector as near as this to the tool's axis is along it.
_ALONG = 1e-9

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
    presses = _press(arc, poses, axis, sweep)
    lines: list[MoveL | MoveC] = [
        MoveL(pose, arc.speed, blend, arc.force, press, None, None, arc.path, arc.work)
        for pose, press in zip(poses, presses, strict=True)
    ]
    last = (
        arc.speed,
        arc.blend,
        arc.force,
        arc.force_direction,
        arc.joints,
        arc.posture,
        arc.path,
        arc.work,
    )
    lines.append(MoveL(arc.target, *last))
    return lines


def halves(start: Pose, arc: MoveC, tolerance: float) -> list[MoveL | MoveC]:
    """The arc as two arcs of half the sweep, exact.

    A controller passes the seam between them without a stop if it keeps the tolerance there.
    """
    _, radius, axis, sweep = circle(start.origin, arc.via.origin, arc.target.origin)
    first, middle, last = along(start, arc, (0.25, 0.5, 0.75))
    press = _press(arc, [middle], axis, sweep)[0]
    seam = float(seam_blends(np.array([radius]), np.array([sweep]), tolerance)[0])
    return [
        replace(
            arc,
            via=first,
            target=middle,
            force_direction=press,
            blend=seam,
            joints=None,
            posture=None,
        ),
        replace(arc, via=last),
    ]


def halve_each(columns: Columns, arcs: Indices, tolerance: float) -> tuple[Indices, Body]:
    """Those of the motions ``arcs``, which make arcs, that are halved by column, and a body of three instructions for
    each: a motion to where it starts, then the same two arcs as ``halves`` makes, to the last bit.

    These are level, say nothing that is no column, and start from a pose with the rotation of their end.
    """
    packed = pack(columns.body).packed
    before = np.maximum(arcs - 1, 0)
    via, start, end = columns.vias_of(arcs), columns.ends[before], columns.ends[arcs]
    plain = (arcs > 0) & ~packed.kept[columns.at[arcs]]
    plain &= (start[:, 2] == via[:, 2]) & (via[:, 2] == end[:, 2])
    plain &= (columns.rotation[before] >= 0) & (columns.rotation[before] == columns.rotation[arcs])
    arcs, via, start, end = arcs[plain], via[plain], start[plain], end[plain]
    radius, sweep, inner = _along_level(start, via, end, (0.25, 0.5, 0.75))
    points = [start, *inner, end]
    rows = np.repeat(arcs, 3)
    blend, seam = columns.blend[arcs], seam_blends(radius, sweep, tolerance)
    kind = np.tile(np.array([NUMBER[MoveJ], NUMBER[MoveC], NUMBER[MoveC]], np.int8), len(arcs))
    turned = columns.rotation[rows]
    return arcs, Body(
        Packed(
            kind=kind,
            end=np.stack([start, points[2], end], axis=1).reshape(-1, 3),
            rotation=turned,
            speed=columns.speed[rows],
            blend=np.stack([np.zeros(len(arcs)), seam, blend], axis=1).ravel(),
            path=columns.path[rows],
            work=columns.works[rows],
            via=np.stack([points[1], points[3]], axis=1).reshape(-1, 3),
            via_rotation=np.repeat(columns.rotation[arcs], 2),
            kept=np.zeros(len(rows), np.bool_),
        ),
        columns.table,
        [],
    )


def _along_level(
    start: FloatArray, via: FloatArray, end: FloatArray, fractions: Sequence[float]
) -> tuple[FloatArray, FloatArray, list[FloatArray]]:
    """Radius (N,), sweep (N,) and points (N, 3) of level arcs at fractions of their sweeps.

    It computes ``circle`` and ``turn_about``, operation by operation. Sines are those of single
    numbers, because those of numpy differ in the last bit.
    """
    u, w = (via - start)[:, :2], (end - start)[:, :2]
    uu, ww = (side[:, 0] * side[:, 0] + side[:, 1] * side[:, 1] for side in (u, w))
    area = u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0]
    cx, cy = (uu * w[:, 1] - ww * u[:, 1]) / (2 * area), (ww * u[:, 0] - uu * w[:, 0]) / (2 * area)
    lx, ly = w[:, 0] - cx, w[:, 1] - cy
    up = np.copysign(1.0, area)
    sweep = _each(math.atan2, up * (cy * lx - cx * ly), -cx * lx - cy * ly) % (2 * math.pi)
    centre = np.column_stack([start[:, 0] + cx, start[:, 1] + cy])
    arm = start[:, :2] - centre
    made = []
    for fraction in fractions:
        c, s = (_each(f, sweep * fraction) for f in (math.cos, math.sin))
        x, y = c * arm[:, 0] - s * (up * arm[:, 1]), c * arm[:, 1] + s * (up * arm[:, 0])
        made.append(np.column_stack([centre[:, 0] + x, centre[:, 1] + y, start[:, 2]]))
    return np.hypot(arm[:, 0], arm[:, 1]), sweep, made


def _each(function: Callable[..., float], *values: FloatArray) -> FloatArray:
    return np.fromiter(map(function, *(one.tolist() for one in values)), np.float64, len(values[0]))


#: The passes by the name under which a post lists them.
PASSES: dict[str, Pass] = {"halves": halves, "chords": chords}


def corner_blend(turn: float, tolerance: float) -> float:
    """The largest usual blend radius (mm) that leaves a corner of ``turn`` rad by at most ``tolerance`` mm.

    A blend that starts b before the corner follows a parabola, which passes the corner at b sin(turn / 2) / 2. The
    result is one of 0 (stop), 0.3, 1 and 5 mm: the usual fly-by zones.
    """
    reach = 2 * tolerance / max(math.sin(min(abs(turn), math.pi) / 2), 1e-9)
    return next((zone for zone in ZONES if zone <= reach), 0.0)


def seam_blends(radius: FloatArray, sweep: FloatArray, tolerance: float) -> FloatArray:
    """(N,) the largest usual blend, mm, in the middle of an arc that becomes two; 0 is a stop.

    A controller that runs both halves at once leaves the arc by 2 R (1 - cos(b / 4R)). A
    controller that runs a parabola with the tangents of both leaves it by
    R (1 - cos(b / R))^2 / (2 cos(b / R)). Both cut a blend at half of either half.

    radius: (N,) mm.
    sweep: (N,) rad, up to a turn.
    tolerance: mm.
    """
    blend, across = np.array(SEAMS), radius[:, None]
    angle = np.minimum(blend / np.maximum(across, 1e-9), sweep[:, None] / 4)
    both = 2 * across * (1 - np.cos(angle / 4))
    cosine = np.maximum(np.cos(angle), 1e-9)
    parabola = across * (1 - cosine) ** 2 / (2 * cosine)
    fits = np.maximum(both, parabola) <= tolerance
    return np.asarray(np.where(fits.any(axis=1), blend[np.argmax(fits, axis=1)], 0.0))


def along(start: Pose, arc: MoveC, fractions: Sequence[float]) -> list[Pose]:
    """Poses on the arc at fractions 0..1 of its sweep; the orientation turns from start through via to target."""
    centre, _, axis, sweep = circle(start.origin, arc.via.origin, arc.target.origin)
    arm = subtract(start.origin, centre)
    same = start.rotation is arc.target.rotation or np.array_equal(
        start.rotation, arc.target.rotation
    )
    poses = []
    for fraction in fractions:
        x, y, z = turn_about(arm, axis, sweep * fraction)
        rotation = start.rotation if same else _turning(start, arc, fraction)
        poses.append(Pose(rotation, (centre[0] + x, centre[1] + y, centre[2] + z)))
    return poses


def without_force(program: Program) -> Program:
    """The program without force control: for a job that says to ignore it. Nothing else changes."""
    body: list[Instruction] = []
    for item in program.body:
        if isinstance(item, (MoveL, MoveC)) and (item.force or any(item.force_direction)):
            body.append(replace(item, force=0.0, force_direction=(0.0, 0.0, 0.0)))
        elif not isinstance(item, Force):
            body.append(item)
    return program.with_body(tuple(body))


def _turning(start: Pose, arc: MoveC, fraction: float) -> FloatArray:
    """The orientation at ``fraction``: evenly to the via point, evenly on. Half a turn has no shorter way otherwise."""
    if fraction <= 0.5:
        return rotation_between(start.rotation, arc.via.rotation, 2 * fraction)
    return rotation_between(arc.via.rotation, arc.target.rotation, 2 * fraction - 1)


def _press(arc: MoveC, poses: Sequence[Pose], axis: Vec3, sweep: float) -> list[Vec3]:
    """The press direction at the inner points of equal pieces, which has ``arc`` at its end: along the tool where that
    presses along itself, however it turns, else turned with the arc.
    """
    press = arc.force_direction
    if not any(press):
        return [press] * len(poses)
    if math.dist(press, arc.target.rotation[:, 2].tolist()) < _ALONG:
        return [_axis_of(pose) for pose in poses]
    count = len(poses) + 1
    return [turn_about(press, axis, sweep * (i / count - 1)) for i in range(1, count)]


def _axis_of(pose: Pose) -> Vec3:
    return to_vec3(pose.rotation[:, 2])
