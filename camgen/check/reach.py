"""Finds the joint values along a whole program, or the motions that the robot cannot run.

Motions to joint values are anchors. The motions between two anchors are followed as one stretch, in
one posture, from the joint values of the first anchor. No joint may turn by more than 30 deg from
one row to the next. `trace_joints` then follows the motions between the rows as a controller does,
with the TCP on its line or arc.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from camgen.check.lost import JointFailure, Stretch, find_failures, join_losses
from camgen.geometry.arcs import find_arc_middles
from camgen.geometry.ragged import compute_offsets, list_owners, mark_run_ends, number_rows
from camgen.model.errors import Blocked, BlockedPath, JobError
from camgen.model.pose import FloatArray, Pose
from camgen.model.program import Joints, MoveC, MoveJ, Program
from camgen.model.text import join_short
from camgen.motion.joint_paths import JointPath, follow_closely
from camgen.motion.pose_paths import Index, PosePath, count_parts, divide
from camgen.motion.setup import Setup, compute_flange_poses
from camgen.robots.kinematics.continuity import Stuck, Ties, follow
from camgen.robots.kinematics.forward import compute_flange
from camgen.robots.kinematics.joint_limits import are_within_limits
from camgen.robots.models import Robot
from camgen.robots.posture import compute_postures
from camgen.robots.workcell import make_machine_error

#: mm: maximum step of the TCP, or of the flange on a joint motion, from row to row.
STEP = 10.0
#: rad: maximum steps of the orientation of the tool, of the angle of an arc, and of a joint.
_STEP_TURN, _STEP_SWEEP, _STEP_JOINT = math.radians(10.0), math.radians(40.0), math.radians(2.0)
#: What to do about a motion that the arm cannot run.
_REMEDY = "move or turn the part: cell.base_from_work"


class MotionRows(Struct, frozen=True, eq=False):
    """R rows of poses along M motions.

    pose_path: TCP in the work frame; row 0 is the end of the first motion.
    motion: (R,) motion of each row.
    at: (M,) row in which each motion ends.
    free: (R,) rows to which the joints are interpolated from the row before.
    """

    pose_path: PosePath
    motion: Index
    at: Index
    free: NDArray[np.bool_]


def sample_motions(program: Program, pose_path: PosePath) -> MotionRows:
    """Sample the motions of `program`; `pose_path` has the TCP at the end of each motion."""
    free = program.columns.moves_are(MoveJ)
    pose_path, owner = _divide_arcs(pose_path, program)
    arc_parts = np.ceil(pose_path.spans.sweep / _STEP_SWEEP).astype(np.int64)
    parts = np.maximum(count_parts(pose_path, STEP, _STEP_TURN), arc_parts)
    parts[free[owner[1:]]] = 1
    motion = np.concatenate([owner[:1], np.repeat(owner[1:], parts)])
    at = np.flatnonzero(mark_run_ends(motion))
    return MotionRows(divide(pose_path, parts), motion, at, free[motion])


def compute_ends(
    program: Program, robot: Robot, anchors: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Compute positions (M, 3) and rotations (M, 3, 3) of the TCP at the ends of motions.

    anchors: (A, J) joint values of the motions that end at joint values.
    """
    columns = program.columns
    posed, position = columns.posed, columns.ends.copy()
    rotation = np.empty((len(posed), 3, 3))
    if posed.any():
        rotation[posed] = np.stack(columns.table)[columns.rotation[posed]]
    turned, origin = compute_flange(robot, anchors)
    tool, base = program.flange_from_tool, program.base_from_work
    rotation[~posed] = base.rotation.T @ turned @ tool.rotation
    position[~posed] = (
        origin + turned @ np.asarray(tool.origin) - np.asarray(base.origin)
    ) @ base.rotation
    return position, rotation


def _divide_arcs(pose_path: PosePath, program: Program) -> tuple[PosePath, Index]:
    """Add a row in the middle of each arc along which the orientation of the tool changes.

    The row has the orientation of the via point, since half a turn has no shorter direction.
    Returns the finer path, and the motion of each row.
    """
    changes = (pose_path.rotation[1:] != pose_path.rotation[:-1]).any(axis=(1, 2))
    turning = np.append(False, ~np.isnan(pose_path.via[1:, 0]) & changes)
    parts = np.where(turning[1:], 2, 1)
    owner = np.concatenate([[0], np.repeat(np.arange(1, len(pose_path)), parts)])
    if not turning.any():
        return pose_path, owner
    finer = divide(pose_path, parts)
    rotation = finer.rotation.copy()
    columns = program.columns
    vias = columns.via_rotation[np.searchsorted(columns.arcs, np.flatnonzero(turning))]
    rotation[compute_offsets(parts)[turning] - 1] = np.stack(columns.table)[vias]
    return PosePath(finer.position, finer.via, rotation), owner


def interpolate_joints(
    robot: Robot, joints: FloatArray, free: NDArray[np.bool_]
) -> tuple[FloatArray, Index]:
    """Add rows of joint values on joint motions, with all joints interpolated together.

    No joint turns by more than 2 deg from row to row, and the flange moves by about 10 mm at most.

    joints: (R, J) joint values.
    free: (R,) rows that a joint motion leads to.

    Returns the joint values with the added rows, and the row of each old one (R,).
    """
    angle = (np.abs(np.diff(joints, axis=0)) * robot.revolute).max(axis=1, initial=0.0)
    steps = np.maximum(np.ceil(angle / _STEP_JOINT - 1e-9), 1)
    parts = np.where(free[1:], steps, 1).astype(np.int64)
    if not free[1:].any():
        return joints, compute_offsets(parts)
    dense = _interpolate(joints, parts)
    is_free = np.repeat(free[1:], parts)
    needed = np.append(is_free, False) | np.append(False, is_free)
    origin = np.zeros((len(dense), 3))
    origin[needed] = compute_flange(robot, dense[needed])[1]
    moved = np.linalg.norm(np.diff(origin, axis=0), axis=1) * is_free
    longest = np.maximum.reduceat(moved, compute_offsets(parts)[:-1])
    parts = parts * np.maximum(np.ceil(longest / STEP), 1).astype(np.int64)
    return _interpolate(joints, parts), compute_offsets(parts)


def _interpolate(joints: FloatArray, parts: Index) -> FloatArray:
    segment = list_owners(parts)
    fraction = (number_rows(parts) + 1) / parts[segment]
    between = joints[segment] + fraction[:, None] * np.diff(joints, axis=0)[segment]
    dense = np.concatenate([joints[:1], between])
    dense[compute_offsets(parts)] = joints
    return dense


class JointTrace(Struct, frozen=True, eq=False):
    """Joint values along a whole program.

    On a joint motion no joint turns by more than 2 deg from row to row, and the flange moves by
    about 10 mm at most. On other motions the TCP moves by about 10 mm at most.

    robot: name of the robot.
    joints: (S, J) joint values from the end of the first motion to the end of the last one, rad or
        mm.
    owner: (S,) instruction of each row.
    program: the program, with joint values and posture at every motion to a pose.
    rows: poses of R of the rows, all but those between the ends of joint motions.
    at: (R,) indices of these rows among the S.
    """

    robot: str
    joints: FloatArray
    owner: NDArray[np.int64]
    program: Program
    rows: MotionRows
    at: Index


def join_traces(
    program: Program, traces: Sequence[JointTrace], shifts: Sequence[int]
) -> JointTrace:
    """Join the joint values of several programs to those of `program`, which runs them in order.

    shifts: (N,) index of an instruction in `program` less that in its own program, by trace.
    """
    joints = np.concatenate([trace.joints for trace in traces])
    owners = [trace.owner + shift for trace, shift in zip(traces, shifts, strict=True)]
    return replace(traces[0], joints=joints, owner=np.concatenate(owners), program=program)


def compute_tips(robot: Robot, joints: FloatArray, flange_from_tool: Pose) -> FloatArray:
    """Compute the TCP (N, 3) in the base frame, mm, at joint values (N, J)."""
    rotation, origin = compute_flange(robot, joints)
    return np.asarray(origin + rotation @ np.asarray(flange_from_tool.origin))


def check_reach(program: Program, robot: Robot, file: str) -> JointTrace:
    """Find joint values for all motions, in one posture between two motions to joint values.

    file: name of the input, for messages.

    Raises JobError for a program that is not for this kind of arm. Raises Blocked with the first
    motion that the arm cannot run, the reason, and all paths that cannot be run.
    """
    anchors = _read_anchors(program, robot, file)
    rows = sample_motions(program, make_pose_path(program, robot, anchors))
    joints = _follow(program, robot, file, rows, anchors)
    dense, at = interpolate_joints(robot, joints, rows.free)
    owner = program.columns.at[np.repeat(rows.motion, np.diff(at, prepend=-1))]
    return JointTrace(robot.name, dense, owner, _fill(program, robot, joints[rows.at]), rows, at)


def trace_joints(
    reach: JointTrace,
    robot: Robot,
    distance: Callable[[FloatArray, FloatArray], FloatArray],
    file: str,
) -> JointPath:
    """Compute the joint path of the whole program, with the TCP on its lines and arcs.

    Places of the joint path are counted in rows of `reach.rows`.

    distance: upper bound of the distance of a point at two joint values, see `Setup.measure_apart`.
    file: name of the input, for messages.

    Raises Blocked with the motion and the position at which the joints cannot follow.
    """
    program, rows = reach.program, reach.rows
    setup = Setup(robot, program.base_from_work, program.flange_from_tool, measure_apart=distance)
    joint_path = follow_closely(setup, rows.pose_path, reach.joints[reach.at], ~rows.free[1:])
    failures = [
        JointFailure(row + 1, "the joints cannot follow", False) for row in joint_path.lost.tolist()
    ]
    if failures:
        raise _make_error(program, robot, file, rows, failures[0], failures)
    return joint_path


def _read_anchors(program: Program, robot: Robot, file: str) -> FloatArray:
    columns = program.columns
    posed = columns.posed
    if posed[0]:
        raise make_machine_error()
    motions = np.flatnonzero(~posed)
    targets = [move.target.values for move in columns.pick(columns.at[motions])]
    for motion, values in zip(motions.tolist(), targets, strict=True):
        if len(values) != len(robot.home):
            name = f"motion {motion + 1}" if motion else "home"
            raise JobError(
                "job",
                f"{robot.name} has {len(robot.home)} joints, {name} has {len(values)}",
                "cell.robot",
                "give cell.home for this robot, or another post",
            )
    anchors = np.array(targets)
    beyond = motions[~are_within_limits(robot, anchors)].tolist()
    if 0 in beyond:
        what, remedy = f"is beyond the limits of {robot.name}", "give joint values within them"
        raise JobError("job", what, "cell.home", remedy)
    if beyond:
        index = int(columns.at[beyond[0]])
        what = f"{robot.name} cannot run {program.place_of(index)}: joint values beyond its limits"
        lost = (BlockedPath(program.path_at(index), "jump", "joint values beyond the limits"),)
        raise Blocked(file, what, f"instruction {index}", _REMEDY, lost)
    return anchors


def make_pose_path(program: Program, robot: Robot, anchors: FloatArray) -> PosePath:
    """Compute the TCP at the ends of the motions, as `compute_ends`, with the middles of arcs."""
    position, rotation = compute_ends(program, robot, anchors)
    middles = program.columns.vias.copy()
    arc = np.flatnonzero(program.columns.moves_are(MoveC))
    middles[arc] = find_arc_middles(position[arc - 1], middles[arc], position[arc])
    return PosePath(position, middles, rotation)


def _follow(
    program: Program, robot: Robot, file: str, rows: MotionRows, anchors: FloatArray
) -> FloatArray:
    setup = Setup(robot, program.base_from_work, program.flange_from_tool)
    pose_path, columns = rows.pose_path, program.columns
    rotations, origins = compute_flange_poses(setup, pose_path.position, pose_path.rotation)
    joints = np.empty((len(origins), len(robot.home)))
    fixed = rows.at[~columns.posed]
    joints[fixed] = anchors
    path = columns.path[rows.motion].astype(np.int64)
    on_link = columns.arrives[rows.motion]
    # A path begins where the link to it ends.
    on_link[rows.at] = False
    stops: list[JointFailure] = []
    failures: list[JointFailure] = []
    for number, first in enumerate(fixed.tolist()):
        last, end = len(joints), None
        if number + 1 < len(fixed):
            last, end = int(fixed[number + 1]), anchors[number + 1]
        if first + 1 == last:
            continue
        part = slice(first + 1, last)
        free = rows.free[part]
        poses = rotations[part], origins[part]
        ties = Ties(joined=not free[0], end=end, free=free)
        choice = follow(robot, poses, anchors[number], ties=ties)
        if not isinstance(choice, Stuck):
            joints[part] = choice.joints
            continue
        stretch = Stretch(robot, *poses, path[part], on_link[part], free)
        stop, stretch_failures = find_failures(stretch, choice)
        stops.append(replace(stop, row=stop.row + first + 1))
        failures += [replace(each, row=each.row + first + 1) for each in stretch_failures]
    if stops:
        raise _make_error(program, robot, file, rows, stops[0], failures)
    return joints


def _make_error(
    program: Program,
    robot: Robot,
    file: str,
    rows: MotionRows,
    stop: JointFailure,
    failures: Sequence[JointFailure],
) -> Blocked:

    def locate(row: int) -> tuple[int, str]:
        position = join_short(rows.pose_path.position[row].tolist(), 1)
        return int(program.columns.at[rows.motion[row]]), f"at {position} mm"

    index, position = locate(stop.row)
    what = f"{robot.name} cannot run {program.place_of(index)} {position}: {stop.text}"
    losses = []
    for failure in failures:
        at, place = locate(failure.row)
        losses.append(
            BlockedPath(program.path_at(at), "jump", f"{failure.text}, {place}", failure.on_link)
        )
    return Blocked(file, what, f"instruction {index}", _REMEDY, join_losses(losses))


def _fill(program: Program, robot: Robot, joints: FloatArray) -> Program:
    columns = program.columns
    postures_at = compute_postures(robot, joints, ~columns.moves_are(MoveJ))
    body = list(program.body)
    values = [tuple(row) for row in joints.tolist()]
    for motion in np.flatnonzero(columns.posed).tolist():
        index = int(columns.at[motion])
        target = Joints(values[motion])
        body[index] = replace(body[index], joints=target, posture=postures_at[motion])
    return program.with_body(tuple(body))
