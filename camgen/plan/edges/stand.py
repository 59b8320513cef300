"""How the tool stands along a curve in space: as it is fixed, as the points say, or square to the nearest face."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from camgen.geometry.arcs import chain
from camgen.geometry.ragged import each_once, offsets
from camgen.geometry.rotations import SURE_TURN, angles_between, turn_vectors
from camgen.geometry.surface import find_nearest
from camgen.geometry.vectors import angles, cross, unit
from camgen.model.errors import JobError
from camgen.model.job import Job
from camgen.model.part import FEATURE_ANGLE, Curve, IntArray, Solid
from camgen.model.pose import TOOL_DOWN, FloatArray, frozen, rotation_from_fixed_xyz
from camgen.model.text import counted, short
from camgen.motion.pose_paths import PosePath, count_parts, divide
from camgen.motion.setup import UnreachableEdge

#: mm: a face is looked at so often along a curve; of the looks the rows stay that the axis needs to be so near, rad.
_LOOK_MM, _AXIS = 1.0, math.radians(0.5)
_NO_TURN = np.eye(3)


def stand(curve: Curve, job: Job, solid: Solid | None) -> PosePath | UnreachableEdge:
    """The TCP poses along ``curve``, in its own direction. JobError where the job asks for what is not there."""
    axis = choose_axis(curve, job)
    if axis == "normal":
        if solid is None:
            what = '"normal" needs the part on whose faces the curves lie'
            raise JobError("job", what, "tool.axis", "give its mesh or STEP file as another input")
        return _square_to_faces(_bare(curve), curve.id, solid)
    if axis == "given":
        return _as_given(curve)
    turned = np.broadcast_to(fixed_rotation(job), (len(curve.points), 3, 3))
    return PosePath(curve.points, _bare(curve).via, frozen(turned))


def choose_axis(curve: Curve, job: Job) -> str:
    """What holds for the tool along ``curve``: "fixed", "given" or "normal". JobError for what cannot be meant."""
    tool = job.tool
    axis = tool.axis if tool.axis != "auto" else "given" if curve.rotations is not None else "fixed"
    if axis == "given" and curve.rotations is None:
        what = f"curve {curve.id} has no angles"
        raise JobError(
            "job",
            what,
            "tool.axis",
            'give points with x,y,z,rx,ry,rz, or set it to "fixed" or "normal"',
        )
    if axis != "fixed" and tool.angles is not None:
        raise JobError(
            "job", f"has no effect on a tool that stands as {axis}", "tool.angles", "leave it out"
        )
    return axis


def fixed_rotation(job: Job) -> FloatArray:
    """work_from_tool of a tool that does not turn. JobError for angles that are none."""
    values = job.tool.angles
    if values is None:
        return TOOL_DOWN
    if len(values) != 3 or not all(math.isfinite(v) for v in values):
        raise JobError(
            "job",
            f"has {counted(len(values), 'value')}",
            "tool.angles",
            "give three angles: [rx, ry, rz]",
        )
    return rotation_from_fixed_xyz(*(math.radians(v) for v in values))


def _bare(curve: Curve) -> PosePath:
    """The places alone."""
    via = np.concatenate([np.full((1, 3), np.nan), curve.via])
    return PosePath(curve.points, frozen(via), np.broadcast_to(_NO_TURN, (len(curve.points), 3, 3)))


def _as_given(curve: Curve) -> PosePath | UnreachableEdge:
    assert curve.rotations is not None
    turn = angles_between(curve.rotations[:-1], curve.rotations[1:])
    wide = np.flatnonzero(turn > SURE_TURN)
    if len(wide):
        k = int(wide[0])
        what = f"the tool turns by {short(math.degrees(turn[k]), 1)} deg from point {k + 1} to the next"
        return UnreachableEdge(
            curve.id, "shape", f"{what}, either way round: give points between them"
        )
    return PosePath(curve.points, _bare(curve).via, curve.rotations)


def _square_to_faces(way: PosePath, name: str, solid: Solid) -> PosePath | UnreachableEdge:
    """The way with tool z against the normal of the nearest face, turned about it as little as it goes along."""
    parts = count_parts(way, _LOOK_MM, math.tau)
    looks = divide(way, parts)
    axis = -find_nearest(solid, looks.position).normal
    jump = angles(axis[:-1], axis[1:])
    wide = np.flatnonzero(jump > FEATURE_ANGLE)
    if len(wide):
        k = int(wide[0])
        place = " ".join(short(v, 2) for v in looks.position[k].tolist())
        what = f"the nearest face changes its direction by {short(math.degrees(jump[k]), 1)} deg at {place} mm"
        return UnreachableEdge(
            name, "shape", f"{what}: end the curve there, or fix the tool: tool.axis, tool.angles"
        )
    at = offsets(parts)
    kept = each_once(np.concatenate([at, *(_needed(axis, a, b) for a, b in pairwise(at.tolist()))]))
    return _keep(way, parts, looks, kept, _carry(axis[kept]))


def _needed(axis: FloatArray, low: int, high: int) -> IntArray:
    """The rows between two that the turn from row to row needs, so that the axis is everywhere as at the looks."""
    kept: list[int] = []
    open_ = [(low, high)]
    while open_:
        a, b = open_.pop()
        if b - a < 2:
            continue
        share = (np.arange(a + 1, b) - a) / (b - a)
        off = angles(_turning(axis[a], axis[b], share), axis[a + 1 : b])
        worst = int(off.argmax())
        if off[worst] > _AXIS:
            kept.append(a + 1 + worst)
            open_ += [(a, a + 1 + worst), (a + 1 + worst, b)]
    return np.array(kept, dtype=np.int64)


def _turning(a: FloatArray, b: FloatArray, share: FloatArray) -> FloatArray:
    """Unit vectors at ``share`` (K,) of the shortest turn from ``a`` to ``b``."""
    normal = cross(a, b)
    size = float(np.linalg.norm(normal))
    angle = math.atan2(size, float(a @ b))
    about = np.broadcast_to(normal / size if size > 0 else normal, (len(share), 3))
    return turn_vectors(np.broadcast_to(a, (len(share), 3)), about, share * angle)


def _carry(axis: FloatArray) -> FloatArray:
    """Rotations (N, 3, 3) with z along ``axis``: x with the work's x at first (its y where that is along the axis), and
    carried on from row to row without a turn about the axis.
    """
    side = np.array([0.0, 1.0, 0.0]) if abs(axis[0, 0]) > 0.9 else np.array([1.0, 0.0, 0.0])
    made = np.empty((len(axis), 3, 3))
    for k, z in enumerate(axis):
        if k:
            about = cross(axis[k - 1], z)
            size = float(np.linalg.norm(about))
            if size > 0:
                angle = math.atan2(size, float(axis[k - 1] @ z))
                side = turn_vectors(side[None], (about / size)[None], np.array([angle]))[0]
        side = unit(side - z * float(side @ z))
        made[k] = np.stack([side, cross(z, side), z], axis=1)
    return made


def _keep(
    way: PosePath, parts: IntArray, looks: PosePath, kept: IntArray, rotations: FloatArray
) -> PosePath:
    """The rows ``kept`` of the looks as a way of their own, arcs as arcs."""
    at = offsets(parts)
    segment = np.searchsorted(at, kept[1:], side="left") - 1
    middle = ((kept[:-1] + kept[1:]) / 2 - at[segment]) / parts[segment]
    via = chain(way.position, way.via[1:]).point(middle, segment)
    via[np.isnan(way.via[1:, 0])[segment]] = np.nan
    own = np.concatenate([np.full((1, 3), np.nan), via])
    return PosePath(frozen(looks.position[kept]), frozen(own), frozen(rotations))
