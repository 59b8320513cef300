"""Can the robot do the program: every motion looked at row by row, joint limits kept, and its joints written into it.

Motions to joint values are anchors: what is between two of them is followed as one stretch, in one posture, from the
very values of the first. No joint may turn by more than 30 deg from one row to the next. What is between two rows is
looked at by ``trace``, which finds the joints there as a controller does, with the TCP on its line or arc.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from camgen.check.lost import Lost, Stretch, find_lost, join_losses
from camgen.geometry.arcs import find_arc_middles
from camgen.geometry.ragged import ends_run, offsets, owners, ramp
from camgen.model.errors import Blocked, BlockedPath, JobError
from camgen.model.pose import FloatArray
from camgen.model.program import Joints, MoveC, MoveJ, Program
from camgen.model.text import short
from camgen.motion.joint_paths import JointPath, follow_closely
from camgen.motion.pose_paths import Index, PosePath, count_parts, divide
from camgen.motion.setup import Setup, compute_flange_poses
from camgen.robots.kinematics.continuity import Stuck, Ties, follow
from camgen.robots.kinematics.forward import flange
from camgen.robots.kinematics.joint_limits import are_within_limits
from camgen.robots.models import Robot
from camgen.robots.posture import postures
from camgen.robots.workcell import make_machine_error

# The motions of a program as rows of poses, and joint motions between rows as rows of joints: what is to be looked at.

#: Rows along a motion are at most so far apart: mm of the TCP or of the flange; rad of the tool; of an arc; of a joint.
STEP, _STEP_TURN, _STEP_SWEEP, _STEP_JOINT = (
    10.0,
    math.radians(10.0),
    math.radians(40.0),
    math.radians(2.0),
)


class MotionRows(Struct, frozen=True, eq=False):
    """R rows on the way of M motions. way: the TCP in the work frame; row 0 is where the first motion ends. motion:
    (R,) the motion that each row belongs to. at: (M,) the row in which each motion ends. free: (R,) rows to which the
    joints are interpolated from the row before.
    """

    way: PosePath
    motion: Index
    at: Index
    free: NDArray[np.bool_]


def sample_motions(program: Program, way: PosePath) -> MotionRows:
    """The rows of ``program``. way: of the TCP, a row for each motion."""
    free = program.columns.moves_are(MoveJ)
    way, own = _through_middles(way, program)
    parts = np.where(
        free[own[1:]],
        1,
        np.maximum(
            count_parts(way, STEP, _STEP_TURN),
            np.ceil(way.spans.sweep / _STEP_SWEEP).astype(np.int64),
        ),
    )
    motion = np.concatenate([own[:1], np.repeat(own[1:], parts)])
    at = np.flatnonzero(ends_run(motion))
    return MotionRows(divide(way, parts), motion, at, free[motion])


def ends(program: Program, robot: Robot, anchors: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Positions (M, 3) and rotations (M, 3, 3) of the TCP in the work frame where motions end."""
    columns = program.columns
    posed, position = columns.posed, columns.ends.copy()
    rotation = np.empty((len(posed), 3, 3))
    if posed.any():
        rotation[posed] = np.stack(columns.table)[columns.rotation[posed]]
    turned, origin = flange(robot, anchors)
    tool, base = program.flange_from_tool, program.base_from_work
    rotation[~posed] = base.rotation.T @ turned @ tool.rotation
    position[~posed] = (
        origin + turned @ np.asarray(tool.origin) - np.asarray(base.origin)
    ) @ base.rotation
    return position, rotation


def _through_middles(way: PosePath, program: Program) -> tuple[PosePath, Index]:
    """The way with a row in the middle of each arc along which the tool turns, where it stands as at the via point:
    half a turn has no shorter way. And the motion that each row belongs to.
    """
    turning = np.append(
        False, ~np.isnan(way.via[1:, 0]) & (way.rotation[1:] != way.rotation[:-1]).any(axis=(1, 2))
    )
    parts = np.where(turning[1:], 2, 1)
    own = np.concatenate([[0], np.repeat(np.arange(1, len(way)), parts)])
    if not turning.any():
        return way, own
    finer = divide(way, parts)
    rotation = finer.rotation.copy()
    columns = program.columns
    vias = columns.via_rotation[np.searchsorted(columns.arcs, np.flatnonzero(turning))]
    rotation[offsets(parts)[turning] - 1] = np.stack(columns.table)[vias]
    return PosePath(finer.position, finer.via, rotation), own


def interpolate_joints(
    robot: Robot, joints: FloatArray, free: NDArray[np.bool_]
) -> tuple[FloatArray, Index]:
    """The joint values (R, J) with more rows on the way to those in ``free`` (R,), all joints together: no joint turns
    by more than 2 deg from row to row, and the flange moves by about 10 mm at most. And where the old rows are (R,).
    """
    angle = (np.abs(np.diff(joints, axis=0)) * robot.revolute).max(axis=1, initial=0.0)
    parts = np.where(free[1:], np.maximum(np.ceil(angle / _STEP_JOINT - 1e-9), 1), 1).astype(
        np.int64
    )
    if not free[1:].any():
        return joints, offsets(parts)
    dense = _between(joints, parts)
    own = np.repeat(free[1:], parts)
    looked = np.append(own, False) | np.append(False, own)
    place = np.zeros((len(dense), 3))
    place[looked] = flange(robot, dense[looked])[1]
    moved = np.linalg.norm(np.diff(place, axis=0), axis=1) * own
    longest = np.maximum.reduceat(moved, offsets(parts)[:-1])
    parts = parts * np.maximum(np.ceil(longest / STEP), 1).astype(np.int64)
    return _between(joints, parts), offsets(parts)


def _between(joints: FloatArray, parts: Index) -> FloatArray:
    """The values with each step cut into equal parts."""
    segment = owners(parts)
    share = (ramp(parts) + 1) / parts[segment]
    found = np.concatenate(
        [joints[:1], joints[segment] + share[:, None] * np.diff(joints, axis=0)[segment]]
    )
    found[offsets(parts)] = joints
    return found


class Reach(Struct, frozen=True, eq=False):
    """What was found. joints: (S, J), values on the way from the first motion's end to the last one's, rad or mm; along
    joint-interpolated motions no joint turns by more than 2 deg from row to row and the flange moves by about 10 mm at
    most, along others the TCP does. owner: (S,), the instruction that each row belongs to. program: the one that was
    looked at, with joints and posture at every motion to a pose. rows: the poses of R of the rows, all but those along
    joint-interpolated motions. at: (R,) where those are among the S.
    """

    robot: str
    joints: FloatArray
    owner: NDArray[np.int64]
    program: Program
    rows: MotionRows
    at: Index

    @property
    def samples(self) -> int:
        """The number of rows."""
        return len(self.joints)


def check_reach(program: Program, robot: Robot, file: str) -> Reach:
    """The joints with which ``robot`` runs ``program``, in one posture from each motion to joint values to the next.

    file: for messages. Raises JobError for a program that is not for this kind of arm, Blocked with the motion
    and the reason for what it cannot do, and all paths that it concerns.
    """
    columns = program.columns
    anchors = _anchors(program, robot, file)
    found = sample_motions(program, _way(program, robot, anchors))
    joints = _follow(program, robot, file, found, anchors)
    dense, at = interpolate_joints(robot, joints, found.free)
    motion = np.repeat(found.motion, np.diff(at, prepend=-1))
    return Reach(
        robot.name, dense, columns.at[motion], _fill(program, robot, joints[found.at]), found, at
    )


def trace(
    reach: Reach, robot: Robot, apart: Callable[[FloatArray, FloatArray], FloatArray], file: str
) -> JointPath:
    """The joints on the way of the whole program, its places in rows of ``reach.rows``: the TCP keeps to lines and
    arcs, but for joint-interpolated motions. apart: as in ``Setup``. file: for messages. Blocked with the motion
    and the place for what no joints lead along.
    """
    program, found = reach.program, reach.rows
    setup = Setup(robot, program.base_from_work, program.flange_from_tool, apart=apart)
    course = follow_closely(setup, found.way, reach.joints[reach.at], ~found.free[1:])
    if len(course.lost):
        lost = [Lost(row + 1, "the joints cannot follow", False) for row in course.lost.tolist()]
        raise _refusal(program, robot, file, found, lost[0], lost)
    return course


def _anchors(program: Program, robot: Robot, file: str) -> FloatArray:
    """The joint values (A, J) to which motions go, in order, the first of them home."""
    columns = program.columns
    posed = columns.posed
    if posed[0]:
        raise make_machine_error()
    places = np.flatnonzero(~posed)
    targets = [move.target.values for move in columns.pick(columns.at[places])]
    for place, values in zip(places.tolist(), targets, strict=True):
        if len(values) != len(robot.home):
            what = f"{robot.name} has {len(robot.home)} joints, {_name(place)} has {len(values)}"
            raise JobError(
                "job", what, "cell.robot", "give cell.home for this robot, or another post"
            )
    anchors = np.array(targets)
    beyond = places[~are_within_limits(robot, anchors)]
    if 0 in beyond:
        raise JobError(
            "job",
            f"is beyond the limits of {robot.name}",
            "cell.home",
            "give joint values within them",
        )
    for place in beyond[:1].tolist():
        index = int(columns.at[place])
        what = f"{robot.name} cannot run {program.place_of(index)}: joint values beyond its limits"
        lost = (BlockedPath(program.path_at(index), "jump", "joint values beyond the limits"),)
        raise Blocked(
            file, what, f"instruction {index}", "move or turn the part: cell.base_from_work", lost
        )
    return anchors


def _name(motion: int) -> str:
    return f"motion {motion + 1}" if motion else "home"


def _way(program: Program, robot: Robot, anchors: FloatArray) -> PosePath:
    """The way of the TCP, a row for each motion."""
    position, rotation = ends(program, robot, anchors)
    middles = program.columns.vias.copy()
    arc = np.flatnonzero(program.columns.moves_are(MoveC))
    middles[arc] = find_arc_middles(position[arc - 1], middles[arc], position[arc])
    return PosePath(position, middles, rotation)


def _follow(
    program: Program, robot: Robot, file: str, found: MotionRows, anchors: FloatArray
) -> FloatArray:
    """The joint values (R, J) of all rows, one stretch between anchors after the other."""
    setup = Setup(robot, program.base_from_work, program.flange_from_tool)
    rotations, origins = compute_flange_poses(setup, found.way.position, found.way.rotation)
    joints = np.empty((len(origins), len(robot.home)))
    fixed = found.at[~program.columns.posed]
    joints[fixed] = anchors
    path, way = _sections(program, found)
    stops: list[Lost] = []
    lost: list[Lost] = []
    for number, first in enumerate(fixed.tolist()):
        last = int(fixed[number + 1]) if number + 1 < len(fixed) else len(joints)
        here = slice(first + 1, last)
        if first + 1 == last:
            continue
        free = found.free[here]
        end = anchors[number + 1] if number + 1 < len(fixed) else None
        ties = Ties(joined=not free[0], end=end, free=free)
        choice = follow(robot, rotations[here], origins[here], anchors[number], ties=ties)
        if isinstance(choice, Stuck):
            stretch = Stretch(robot, rotations[here], origins[here], path[here], way[here], free)
            stop, some = find_lost(stretch, choice)
            stops.append(replace(stop, row=stop.row + first + 1))
            lost += [replace(one, row=one.row + first + 1) for one in some]
        else:
            joints[here] = choice.joints
    if stops:
        raise _refusal(program, robot, file, found, stops[0], lost)
    return joints


def _sections(program: Program, found: MotionRows) -> tuple[Index, NDArray[np.bool_]]:
    """(R,) the path that each row belongs to, and whether it is on the way to it; where a way ends the path begins."""
    columns = program.columns
    way = columns.arrives[found.motion]
    way[found.at] = False
    return columns.path[found.motion].astype(np.int64), way


def _refusal(
    program: Program, robot: Robot, file: str, found: MotionRows, stop: Lost, lost: Sequence[Lost]
) -> Blocked:
    """The error about ``stop``, with all that is lost."""

    def place(row: int) -> str:
        return " ".join(short(v, 1) for v in found.way.position[row].tolist())

    def index(row: int) -> int:
        return int(program.columns.at[found.motion[row]])

    at = index(stop.row)
    what = f"{robot.name} cannot run {program.place_of(at)} at {place(stop.row)} mm: {stop.text}"
    losses = [
        BlockedPath(
            program.path_at(index(one.row)), "jump", f"{one.text}, at {place(one.row)} mm", one.way
        )
        for one in lost
    ]
    return Blocked(
        file,
        what,
        f"instruction {at}",
        "move or turn the part: cell.base_from_work",
        join_losses(losses),
    )


def _fill(program: Program, robot: Robot, joints: FloatArray) -> Program:
    """The program with joints and posture at every motion to a pose. joints: (M, J) where motions end."""
    columns = program.columns
    posed = columns.posed
    named = postures(robot, joints, ~columns.moves_are(MoveJ))
    body = list(program.body)
    values = [tuple(row) for row in joints.tolist()]
    for motion, index in zip(
        np.flatnonzero(posed).tolist(), columns.at[posed].tolist(), strict=True
    ):
        body[index] = replace(body[index], joints=Joints(values[motion]), posture=named[motion])
    return program.with_body(tuple(body))
