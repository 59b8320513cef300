"""Tool orientation along a curve in space: fixed, given by the points, or normal to a face."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from camgen.geometry.arcs import make_span_chain
from camgen.geometry.ragged import compute_offsets, select_distinct
from camgen.geometry.rotations import SURE_TURN, measure_angles_between, turn_vectors
from camgen.geometry.surface import find_nearest
from camgen.geometry.vectors import cross, measure_angles, normalize
from camgen.model.errors import JobError
from camgen.model.job import Job
from camgen.model.part import FEATURE_ANGLE, Curve, IntArray, Solid
from camgen.model.pose import TOOL_DOWN, FloatArray, frozen, rotation_from_fixed_xyz
from camgen.model.text import counted, short
from camgen.motion.pose_paths import PosePath, count_parts, divide
from camgen.motion.setup import UnreachableEdge
from camgen.plan.unused import check_rules

#: Distance of the samples at which the normal of the nearest face is taken, mm.
_SAMPLE_MM = 1.0
#: Maximum deviation of the interpolated tool axis from the samples, rad. It decides which stay.
_AXIS_DEVIATION = math.radians(0.5)
_NO_ROTATION = np.eye(3)


def plan_orientation(curve: Curve, job: Job, solid: Solid | None) -> PosePath | UnreachableEdge:
    """The TCP poses along `curve`, in its direction, or the reason why it has no poses.

    Raises JobError if the job needs a part or angles that the input does not have.
    """
    axis = choose_axis(curve, job)
    if axis == "normal":
        if solid is None:
            raise JobError(
                "job",
                '"normal" needs the part on whose faces the curves lie',
                "tool.axis",
                "give its mesh or STEP file as another input",
            )
        return _orient_to_faces(_make_bare_path(curve), curve.id, solid)
    if axis == "given":
        return _orient_as_given(curve)
    rotations = np.broadcast_to(fixed_rotation(job), (len(curve.points), 3, 3))
    return PosePath(curve.points, _make_bare_path(curve).via, frozen(rotations))


def choose_axis(curve: Curve, job: Job) -> str:
    """The kind of tool axis along `curve`: "fixed", "given" or "normal".

    Raises JobError for settings that do not suit the curve.
    """
    tool = job.tool
    axis: str = tool.axis
    if axis == "auto":
        axis = "fixed" if curve.rotations is None else "given"
    check_rules(
        [
            (
                axis == "given" and curve.rotations is None,
                f"curve {curve.id} has no angles",
                "tool.axis",
                'give points with x,y,z,rx,ry,rz, or set it to "fixed" or "normal"',
            ),
            (
                axis != "fixed" and tool.angles is not None,
                f"has no effect on a tool that stands as {axis}",
                "tool.angles",
                "leave it out",
            ),
        ]
    )
    return axis


def fixed_rotation(job: Job) -> FloatArray:
    """The rotation work_from_tool of a fixed tool. Raises JobError for invalid angles."""
    values = job.tool.angles
    if values is None:
        return TOOL_DOWN
    if len(values) != 3 or not np.isfinite(values).all():
        raise JobError(
            "job",
            f"has {counted(len(values), 'value')}",
            "tool.angles",
            "give three angles: [rx, ry, rz]",
        )
    return rotation_from_fixed_xyz(*(math.radians(v) for v in values))


def _make_bare_path(curve: Curve) -> PosePath:
    via = np.concatenate([np.full((1, 3), np.nan), curve.via])
    return PosePath(
        curve.points, frozen(via), np.broadcast_to(_NO_ROTATION, (len(curve.points), 3, 3))
    )


def _orient_as_given(curve: Curve) -> PosePath | UnreachableEdge:
    """The path with the rotations of the curve; an error where one turns by more than 120 deg."""
    assert curve.rotations is not None
    turn = measure_angles_between(curve.rotations[:-1], curve.rotations[1:])
    wide = np.flatnonzero(turn > SURE_TURN)
    if len(wide):
        k = int(wide[0])
        return UnreachableEdge(
            curve.id,
            "shape",
            f"the tool turns by {short(math.degrees(turn[k]), 1)} deg from point {k + 1} to the "
            "next, too far to know in which direction: give points between them",
        )
    return PosePath(curve.points, _make_bare_path(curve).via, curve.rotations)


def _orient_to_faces(pose_path: PosePath, name: str, solid: Solid) -> PosePath | UnreachableEdge:
    """The path with tool z against the normal of the nearest face, and the least roll.

    An error where that normal turns by more than the 30.05 deg of a sharp edge between samples.
    """
    parts = count_parts(pose_path, _SAMPLE_MM, math.tau)
    samples = divide(pose_path, parts)
    axis = -find_nearest(solid, samples.position).normal
    jump = measure_angles(axis[:-1], axis[1:])
    wide = np.flatnonzero(jump > FEATURE_ANGLE)
    if len(wide):
        k = int(wide[0])
        place = " ".join(short(v, 2) for v in samples.position[k].tolist())
        return UnreachableEdge(
            name,
            "shape",
            f"the nearest face changes its direction by {short(math.degrees(jump[k]), 1)} deg at "
            f"{place} mm: end the curve there, or fix the tool: tool.axis, tool.angles",
        )
    vertices = compute_offsets(parts)
    needed = [_find_needed(axis, a, b) for a, b in pairwise(vertices.tolist())]
    kept = select_distinct(np.concatenate([vertices, *needed]))
    return _select_samples(pose_path, parts, samples, kept, _make_rotations(axis[kept]))


def _find_needed(axis: FloatArray, low: int, high: int) -> IntArray:
    """The samples between two that interpolation of the axis needs, within `_AXIS_DEVIATION`."""
    kept: list[int] = []
    pending = [(low, high)]
    while pending:
        a, b = pending.pop()
        if b - a < 2:
            continue
        fraction = (np.arange(a + 1, b) - a) / (b - a)
        deviation = measure_angles(_interpolate_axis(axis[a], axis[b], fraction), axis[a + 1 : b])
        worst = int(deviation.argmax())
        if deviation[worst] > _AXIS_DEVIATION:
            kept.append(a + 1 + worst)
            pending += [(a, a + 1 + worst), (a + 1 + worst, b)]
    return np.array(kept, dtype=np.int64)


def _interpolate_axis(a: FloatArray, b: FloatArray, fraction: FloatArray) -> FloatArray:
    normal = cross(a, b)
    size = float(np.linalg.norm(normal))
    angle = math.atan2(size, float(a @ b))
    about = np.broadcast_to(normal / size if size > 0 else normal, (len(fraction), 3))
    return turn_vectors(np.broadcast_to(a, (len(fraction), 3)), about, fraction * angle)


def _make_rotations(axis: FloatArray) -> FloatArray:
    """Rotations (N, 3, 3) with z along `axis` (N, 3), carried from row to row without roll.

    The first x axis is the work's x axis, or its y axis if `axis` is along x.
    """
    side = np.array([0.0, 1.0, 0.0]) if abs(axis[0, 0]) > 0.9 else np.array([1.0, 0.0, 0.0])
    rotations = np.empty((len(axis), 3, 3))
    for k, z in enumerate(axis):
        if k:
            about = cross(axis[k - 1], z)
            size = float(np.linalg.norm(about))
            if size > 0:
                angle = math.atan2(size, float(axis[k - 1] @ z))
                side = turn_vectors(side[None], (about / size)[None], np.array([angle]))[0]
        side = normalize(side - z * float(side @ z))
        rotations[k] = np.stack([side, cross(z, side), z], axis=1)
    return rotations


def _select_samples(
    pose_path: PosePath,
    parts: IntArray,
    samples: PosePath,
    kept: IntArray,
    rotations: FloatArray,
) -> PosePath:
    """The samples `kept` as a pose path with these rotations. Arcs stay arcs.

    parts: number of samples of each segment of `pose_path`.
    """
    first = compute_offsets(parts)
    segment = np.searchsorted(first, kept[1:], side="left") - 1
    middle = ((kept[:-1] + kept[1:]) / 2 - first[segment]) / parts[segment]
    via = make_span_chain(pose_path.position, pose_path.via[1:]).point(middle, segment)
    via[np.isnan(pose_path.via[1:, 0])[segment]] = np.nan
    via = np.concatenate([np.full((1, 3), np.nan), via])
    return PosePath(frozen(samples.position[kept]), frozen(via), frozen(rotations))
