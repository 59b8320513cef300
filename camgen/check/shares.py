"""How fast joint motions may be, in the only measure that some controllers have: a share of the joints' speeds."""

from __future__ import annotations

import math

import numpy as np
from msgspec.structs import replace

from camgen.check.reach import Reach
from camgen.geometry.ragged import ends_run
from camgen.model.pose import FloatArray, Vec3
from camgen.model.program import MoveJ, Program
from camgen.robots.kinematics.rates import fastest, held_share
from camgen.robots.models import Robot

#: No joint that turns is faster on the way (rad/s), also where the TCP hardly moves. Digits of a share.
_FASTEST_TURN, _DIGITS = math.radians(60.0), 6


def share_joints(found: Reach, robot: Robot) -> Program:
    """The program of ``found``, its joint motions with the share of the joints' greatest speeds, where both ends are
    known.

    All joints start and end together, each in proportion to its way, so that the one with the longest way for its speed
    runs at the share. It is as large as it may be for the TCP to keep to the motion's speed wherever it is fastest, and
    for no joint to turn by more than 60 deg/s. A share that a motion has already stays: in free space it may be more.
    """
    program = found.program
    columns = program.columns
    swings = np.flatnonzero(columns.moves_are(MoveJ))[1:]
    motion = np.searchsorted(columns.at, found.owner)
    ends = np.flatnonzero(ends_run(motion))
    body = list(program.body)
    for swing in swings.tolist():
        rows = slice(int(ends[swing - 1]), int(ends[swing]) + 1)
        move = columns.moves[swing]
        if move.share > 0:
            continue
        share = _share(robot, found.joints[rows], program.flange_from_tool.origin, move.speed)
        body[int(columns.at[swing])] = replace(move, share=share)
    return program.with_body(tuple(body))


def _share(robot: Robot, joints: FloatArray, tip: Vec3, speed: float) -> float:
    """The share for a motion with joint values (R, J) on its way, 0 where the arm stands. tip: from the flange, mm."""
    way = joints[-1] - joints[0]
    if not way.any():
        return 0.0
    moved, turning = fastest(robot, joints, tip)
    bounds = (most / rate for most, rate in ((speed, moved), (_FASTEST_TURN, turning)) if rate > 0)
    limits = [held_share(robot, way), *bounds]
    return float(math.floor(float(min(limits)) * 10**_DIGITS) / 10**_DIGITS)
