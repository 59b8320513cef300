"""Named passes that replace an instruction by ones that every controller has.

A pass is a function of the pose at which the motion starts, the motion, and the distance by which
the replacement may leave it, mm.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from msgspec.structs import replace

from camgen.geometry.arcs import compute_circle, subtract, turn_about
from camgen.model.body import NUMBER, Body, Indices, Packed
from camgen.model.pose import FloatArray, Pose, Vec3, rotation_between, to_vec3
from camgen.model.program import Columns, Force, Instruction, MoveC, MoveJ, MoveL, Program, pack
from camgen.model.tolerance import SMALLEST_ZONE, ZONES

#: Blends, mm, at the seam of two arcs of one circle, the largest first.
SEAMS = (*ZONES, SMALLEST_ZONE)
#: A unit vector whose distance from the tool axis is smaller is along it.
_ALONG = 1e-9

Pass = Callable[[Pose, MoveC, float], list[MoveL | MoveC]]


def chords(start: Pose, arc: MoveC, tolerance: float) -> list[MoveL | MoveC]:
    """Replace an arc by straight lines, sagitta R (1 - cos(step / 2)) <= tolerance.

    The orientation changes linearly along the arc. The last line has the blend of the arc. The
    other lines have blends: a zone reaches at most half-way to the next corner, so the corner of
    two chords is cut by no more than their sagitta.
    """
    _, radius, axis, sweep = compute_circle(start.origin, arc.via.origin, arc.target.origin)
    step = 2 * math.acos(max(-1.0, 1 - tolerance / radius)) if tolerance < radius else math.pi / 2
    count = max(1, math.ceil(sweep / step - 1e-9))
    blend = max(corner_blend(sweep / count, tolerance), ZONES[-1])
    poses = along(start, arc, [k / count for k in range(1, count)])
    presses = _press(arc, poses, axis, sweep)
    last = MoveL(
        arc.target,
        arc.speed,
        arc.blend,
        arc.force,
        arc.force_direction,
        arc.joints,
        arc.posture,
        arc.path,
        arc.work,
    )
    inner = replace(last, blend=blend, joints=None, posture=None)
    lines: list[MoveL | MoveC] = [
        replace(inner, target=pose, force_direction=press)
        for pose, press in zip(poses, presses, strict=True)
    ]
    return [*lines, last]


def halves(start: Pose, arc: MoveC, tolerance: float) -> list[MoveL | MoveC]:
    """Replace an arc by two arcs of half the sweep, which is exact.

    A controller passes the seam between them without a stop if it keeps the tolerance there.
    """
    _, radius, axis, sweep = compute_circle(start.origin, arc.via.origin, arc.target.origin)
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
    """Halve arcs by column, with the same results as `halves` to the last bit.

    arcs: motions that are arcs. Only those are halved that are level, have all their properties in
        columns, and start from a pose with the rotation of their end.

    Returns the halved arcs, and a body of three instructions for each: a motion to its start, then
    its two halves.
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
    """Compute radius (N,), sweep (N,) and points (N, 3) of level arcs at fractions of their sweeps.

    It does the same operations as `circle` and `turn_about`. Sines are computed one by one, because
    those of numpy differ in the last bit.
    """
    u, w = (via - start)[:, :2], (end - start)[:, :2]
    uu, ww = (u * u).sum(axis=1), (w * w).sum(axis=1)
    area = u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0]
    cx, cy = (uu * w[:, 1] - ww * u[:, 1]) / (2 * area), (ww * u[:, 0] - uu * w[:, 0]) / (2 * area)
    lx, ly = w[:, 0] - cx, w[:, 1] - cy
    up = np.copysign(1.0, area)
    sweep = _each(math.atan2, up * (cy * lx - cx * ly), -cx * lx - cy * ly) % (2 * math.pi)
    centre = np.column_stack([start[:, 0] + cx, start[:, 1] + cy])
    arm = start[:, :2] - centre
    points = []
    for fraction in fractions:
        c, s = _each(math.cos, sweep * fraction), _each(math.sin, sweep * fraction)
        x, y = c * arm[:, 0] - s * (up * arm[:, 1]), c * arm[:, 1] + s * (up * arm[:, 0])
        points.append(np.column_stack([centre[:, 0] + x, centre[:, 1] + y, start[:, 2]]))
    return np.hypot(arm[:, 0], arm[:, 1]), sweep, points


def _each(function: Callable[..., float], *values: FloatArray) -> FloatArray:
    return np.fromiter(map(function, *map(np.ndarray.tolist, values)), np.float64, len(values[0]))


#: The passes by the name under which a post lists them.
PASSES: dict[str, Pass] = {"halves": halves, "chords": chords}


def corner_blend(turn: float, tolerance: float) -> float:
    """Choose the largest blend radius, mm, that leaves a corner by at most `tolerance` mm.

    A blend that starts b before the corner follows a parabola, which passes the corner at a
    distance of b sin(turn / 2) / 2. The result is one of the usual zones 0 (stop), 0.3, 1 and 5 mm.

    turn: corner angle, rad.
    """
    reach = 2 * tolerance / max(math.sin(min(abs(turn), math.pi) / 2), 1e-9)
    return next((zone for zone in ZONES if zone <= reach), 0.0)


def seam_blends(radius: FloatArray, sweep: FloatArray, tolerance: float) -> FloatArray:
    """Choose the largest usual blend (N,), mm, in the middle of a halved arc; 0 is a stop.

    A controller that runs both halves at once leaves the arc by 2 R (1 - cos(b / 4R)). A
    controller that runs a parabola with the tangents of both leaves it by
    R (1 - cos(b / R))^2 / (2 cos(b / R)). Both cut a blend at half of either half.

    radius: (N,) radius, mm.
    sweep: (N,) sweep of the whole arc, rad.
    tolerance: allowed distance from the arc, mm.
    """
    blend, across = np.array(SEAMS), radius[:, None]
    angle = np.minimum(blend / np.maximum(across, 1e-9), sweep[:, None] / 4)
    both = 2 * across * (1 - np.cos(angle / 4))
    cosine = np.maximum(np.cos(angle), 1e-9)
    fits = np.maximum(both, across * (1 - cosine) ** 2 / (2 * cosine)) <= tolerance
    return np.asarray(np.where(fits.any(axis=1), blend[np.argmax(fits, axis=1)], 0.0))


def along(start: Pose, arc: MoveC, fractions: Sequence[float]) -> list[Pose]:
    """Compute poses on the arc at fractions of its sweep, 0 to 1.

    The orientation changes from start through via to target.
    """
    centre, _, axis, sweep = compute_circle(start.origin, arc.via.origin, arc.target.origin)
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


def remove_force(program: Program) -> Program:
    """Return the program without force control, for a job that ignores it."""
    body: list[Instruction] = []
    for item in program.body:
        if isinstance(item, (MoveL, MoveC)) and (item.force or any(item.force_direction)):
            body.append(replace(item, force=0.0, force_direction=(0.0, 0.0, 0.0)))
        elif not isinstance(item, Force):
            body.append(item)
    return program.with_body(tuple(body))


def _turning(start: Pose, arc: MoveC, fraction: float) -> FloatArray:
    """Interpolate the orientation to the via point, and from it to the target.

    Between orientations half a turn apart neither direction would be shorter.
    """
    if fraction <= 0.5:
        return rotation_between(start.rotation, arc.via.rotation, 2 * fraction)
    return rotation_between(arc.via.rotation, arc.target.rotation, 2 * fraction - 1)


def _press(arc: MoveC, poses: Sequence[Pose], axis: Vec3, sweep: float) -> list[Vec3]:
    """Compute the force direction at the inner points of equal pieces of an arc.

    If the arc presses along the tool axis, so do the pieces. Otherwise the direction rotates with
    the arc.
    """
    press = arc.force_direction
    if not any(press):
        return [press] * len(poses)
    if math.dist(press, arc.target.rotation[:, 2].tolist()) < _ALONG:
        return [to_vec3(pose.rotation[:, 2]) for pose in poses]
    count = len(poses) + 1
    return [turn_about(press, axis, sweep * (i / count - 1)) for i in range(1, count)]
