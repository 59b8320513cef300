"""Can the robot do the program: every motion sampled, one posture for all of it, joint limits kept.

What stands between two samples is not looked at: they are so close that no joint may turn by more than 30 deg from one
to the next. Collisions are not looked at either.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.errors import JobError, NoSafeProgram
from camgen.ir import Comment, Instruction, Joints, Motion, MoveC, MoveJ, MoveL, Program
from camgen.passes import along, circle
from camgen.pose import FloatArray, Pose, angle_between, rotation_between
from camgen.robots.continuity import Stuck, follow
from camgen.robots.models import Robot
from camgen.robots.reasons import why
from camgen.robots.values import within
from camgen.text import short

#: Samples along a motion are at most so far apart: mm and rad.
_STEP, _TURN = 10.0, math.radians(10.0)


class Reach(Struct, frozen=True, eq=False):
    """What was found. samples: poses that were solved. joints: (samples, J), values on the way, rad or mm. owner:
    (samples,), the instruction that each belongs to.
    """

    robot: str
    samples: int
    joints: FloatArray
    owner: NDArray[np.int64]


def reached(program: Program, robot: Robot, file: str) -> Reach:
    """The joints with which ``robot`` runs ``program``, all of it in one posture from its first pose to its last.

    file: for messages. Raises JobError for a program that is not for this kind of arm, NoSafeProgram with the motion
    and the reason for what it cannot do.
    """
    home = _home(program, robot)
    poses, owner = _sampled(program.body)
    if not poses:
        return Reach(robot.name, 0, np.zeros((0, len(robot.home))), np.zeros(0, np.int64))
    rotations, origins = _flanges(program, poses)
    found = follow(robot, rotations, origins, home)
    if isinstance(found, Stuck):
        reason = why(robot, rotations, origins, found)
        index = owner[reason.row]
        place = " ".join(short(v, 1) for v in poses[reason.row].origin)
        what = f"{robot.name} cannot run {_path(program.body, index)} at {place} mm: {reason.text}"
        raise NoSafeProgram(file, what, f"instruction {index}", "move or turn the part: cell.base_from_work")
    return Reach(robot.name, len(poses), found.joints, np.array(owner))


def _home(program: Program, robot: Robot) -> FloatArray:
    """The joint values from which the program starts."""
    first = next(item for item in program.body if isinstance(item, MoveJ))
    if not isinstance(first.target, Joints):
        raise JobError("job", "the post is for a machine, not for an arm", "cell.robot", "leave it out")
    values = np.array(first.target.values)
    if len(values) != len(robot.home):
        what = f"{robot.name} has {len(robot.home)} joints, home has {len(values)}"
        raise JobError("job", what, "cell.robot", "give cell.home for this robot, or another post")
    if not within(robot, values[None])[0]:
        raise JobError("job", f"is beyond the limits of {robot.name}", "cell.home", "give joint values within them")
    return values


def _sampled(body: Sequence[Instruction]) -> tuple[list[Pose], list[int]]:
    """Poses along all motions to poses, and the instruction that each belongs to."""
    poses: list[Pose] = []
    owner: list[int] = []
    start: Pose | None = None
    for index, item in enumerate(body):
        if not isinstance(item, (MoveJ, MoveL, MoveC)):
            continue
        target = item.target
        if isinstance(target, Joints):
            start = None
            continue
        found = [target] if start is None or isinstance(item, MoveJ) else _between(start, item, target)
        poses += found
        owner += [index] * len(found)
        start = target
    return poses, owner


def _between(start: Pose, item: Motion, target: Pose) -> list[Pose]:
    """Poses along a line or an arc, without its start."""
    same = start.rotation is target.rotation
    turn = 0.0 if same else angle_between(start.rotation, target.rotation)
    if isinstance(item, MoveC):
        _, radius, _, sweep = circle(start.origin, item.via.origin, target.origin)
        count = _count(radius * sweep, max(turn, sweep / 4))
        return [*along(start, item, [k / count for k in range(1, count)]), target]
    length = math.dist(start.origin, target.origin)
    count = _count(length, turn)
    a, b = np.asarray(start.origin), np.asarray(target.origin)
    poses = []
    for k in range(1, count):
        x, y, z = (a + (b - a) * (k / count)).tolist()
        rotation = start.rotation if same else rotation_between(start.rotation, target.rotation, k / count)
        poses.append(Pose(rotation, (x, y, z)))
    return [*poses, target]


def _count(length: float, turn: float) -> int:
    return max(1, math.ceil(length / _STEP), math.ceil(turn / _TURN))


def _flanges(program: Program, poses: Sequence[Pose]) -> tuple[FloatArray, FloatArray]:
    """base_from_flange of the TCP poses: rotations (N, 3, 3) and origins (N, 3)."""
    base, tool = program.base_from_work, program.flange_from_tool.inverse()
    rotations = base.rotation @ np.stack([pose.rotation for pose in poses])
    origins = np.array([pose.origin for pose in poses]) @ base.rotation.T + np.asarray(base.origin)
    return rotations @ tool.rotation, origins + rotations @ np.asarray(tool.origin)


def _path(body: Sequence[Instruction], index: int) -> str:
    """The path that an instruction belongs to, as the comment before it says."""
    said = [item.text for item in body[: index + 1] if isinstance(item, Comment)]
    return " ".join(said[-1].split()[:2]) if said else "the way to the first path"
