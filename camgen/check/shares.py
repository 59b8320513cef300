"""How fast joint motions may be, in the only measure that some controllers have: a share of the joints' speeds."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from msgspec.structs import replace

from camgen.check.reach import Reach
from camgen.geometry.ragged import ends_run
from camgen.model.pose import FloatArray, Vec3
from camgen.model.program import MoveJ, Program
from camgen.model.tolerance import NONZERO
from camgen.motion.limits import measure_point_speed, slow_down
from camgen.robots.kinematics.rates import fastest, held_share
from camgen.robots.models import Robot

#: No joint that turns is faster on the way (rad/s), also where the TCP hardly moves. Digits of a share.
_FASTEST_TURN, _DIGITS = math.radians(60.0), 6


def share_joints(
    found: Reach,
    robot: Robot,
    distance: Callable[[FloatArray, FloatArray], FloatArray],
    point: float,
) -> Program:
    """The program with the share of the joints' maximum speeds in each joint motion between known joints.

    All joints start and end together, each in proportion to its way, so that the one with the longest way for its speed
    runs at the share. It is as large as it may be for the TCP to keep to the motion's speed wherever it is fastest, for
    no joint to turn by more than 60 deg/s, and for no point of arm, holder and tool to be faster than ``point``. A
    share that a motion has already stays: in free space it may be more.

    found: joint values of the program.
    distance: upper bound of the distance of a point in two configurations, see `Setup.apart`.
    point: mm/s, infinite without a limit.
    """
    program = found.program
    columns = program.columns
    swings = np.flatnonzero(columns.moves_are(MoveJ))[1:]
    motion = np.searchsorted(columns.at, found.owner)
    ends = np.flatnonzero(ends_run(motion))
    body = list(program.body)
    tip = program.flange_from_tool.origin
    for swing in swings.tolist():
        joints = found.joints[int(ends[swing - 1]) : int(ends[swing]) + 1]
        move = columns.moves[swing]
        if move.share > 0:
            continue
        share, speed = _share(robot, joints, tip, move.speed), move.speed
        if share > 0 and math.isfinite(point):
            limited = _floor(point / max(measure_point_speed(robot, distance, joints), NONZERO))
            if limited < share:
                share = limited
                speed = min(speed, slow_down(robot, joints, tip, share))
        body[int(columns.at[swing])] = replace(move, share=share, speed=speed)
    return program.with_body(tuple(body))


def _share(robot: Robot, joints: FloatArray, tip: Vec3, speed: float) -> float:
    """The share for a motion with joint values (R, J) on its way, 0 where the arm stands. tip: from the flange, mm."""
    way = joints[-1] - joints[0]
    if not way.any():
        return 0.0
    moved, turning = fastest(robot, joints, tip)
    bounds = (most / rate for most, rate in ((speed, moved), (_FASTEST_TURN, turning)) if rate > 0)
    return _floor(min([held_share(robot, way), *bounds]))


def _floor(share: float) -> float:
    return float(math.floor(share * 10**_DIGITS) / 10**_DIGITS)
