"""Computes the speeds of joint motions as controllers state them: a share, and rad/s."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from camgen.check.reach import JointTrace
from camgen.geometry.ragged import mark_run_ends
from camgen.geometry.rotations import measure_angles_between
from camgen.model.pose import FloatArray, Vec3
from camgen.model.program import MoveJ, Program
from camgen.model.tolerance import NONZERO
from camgen.motion.limits import measure_point_speed, round_down, slow_down
from camgen.robots.kinematics.forward import compute_flange
from camgen.robots.kinematics.rates import find_held_fraction, measure_fastest
from camgen.robots.models import Robot
from camgen.robots.workcell import Workcell

#: rad/s: no turning joint is faster, also if the TCP hardly moves. Digits of a share.
_FASTEST_TURN, _DIGITS = math.radians(60.0), 6
#: A motion that takes this share of the time that it needs is slow enough: speeds are rounded.
_NEARLY = 0.999
#: Parts of a degree in a speed of turning, and the speed, rad/s, of motions without one.
_PARTS, _ON_THE_WAY = 1000, math.radians(500.0)
#: mm: a TCP that moves farther has a speed that limits its motion.
_MOVES_MM = 1.0


class _Swing(NamedTuple):
    """A joint motion.

    joints: (R, J) values along it.
    tip: the TCP in the flange frame, mm.
    fastest: speed of its fastest point at the joints' maximum speeds, mm/s.
    """

    joints: FloatArray
    tip: Vec3
    fastest: float


def share_joints(
    reach: JointTrace,
    cell: Workcell,
    distance: Callable[[FloatArray, FloatArray], FloatArray],
    point: float,
) -> Program:
    """The program with share and rate of each joint motion between known joint values.

    All joints start and end together. So the joint whose travel takes longest at its maximum speed
    runs at the share. The share is as large as three limits allow: the TCP keeps to the speed of
    the motion everywhere, no joint turns by more than 60 deg/s, and no point of arm, holder and
    tool is faster than `point`. A share that a motion has already stays: in free space it may be
    more.

    Where the TCP hardly moves, its speed does not limit the other points. A controller whose joint
    motions keep to a speed of turning gets that speed too.

    reach: joint values of the program.
    cell: the cell with its arm.
    distance: upper bound of the distance of a point at two joint values, see `Setup.measure_apart`.
    point: mm/s, infinite without a limit.
    """
    program, robot = reach.program, cell.arm
    assert robot is not None
    columns = program.columns
    swings = np.flatnonzero(columns.moves_are(MoveJ))[1:]
    ends = np.flatnonzero(mark_run_ends(np.searchsorted(columns.at, reach.owner)))
    body = list(program.body)
    tip = program.flange_from_tool.origin
    for swing in swings.tolist():
        joints = reach.joints[int(ends[swing - 1]) : int(ends[swing]) + 1]
        move = columns.moves[swing]
        share, speed, turn = move.share, move.speed, move.turn
        if not share:
            share = _share(robot, joints, tip, speed, turn)
        is_judged = not move.share or cell.pace.turns
        if share > 0 and is_judged and math.isfinite(point):
            swing_at = _Swing(joints, tip, measure_point_speed(robot, distance, joints))
            limited = _floor(point / max(swing_at.fastest, NONZERO))
            if limited < share and not move.share:
                share = limited
                speed = min(speed, slow_down(robot, joints, tip, share))
            if cell.pace.turns:
                speed, limit = _limit(robot, swing_at, speed, point)
                turn = min(turn or limit, limit or turn)
        turn = turn if cell.pace.turns else 0.0
        rate = _rate(robot, joints[-1] - joints[0], share)
        body[int(columns.at[swing])] = replace(move, share=share, rate=rate, speed=speed, turn=turn)
    return program.with_body(tuple(body))


def _limit(robot: Robot, swing: _Swing, speed: float, point: float) -> tuple[float, float]:
    """The speeds of TCP, mm/s, and tool, rad/s, at which no point of an arm is too fast.

    The speed of the tool is 0 for any; it limits a motion whose TCP hardly moves.

    speed: speed of the TCP as planned, mm/s.
    point: maximum speed of all points, mm/s.
    """
    seconds = float((np.abs(swing.joints[-1] - swing.joints[0]) / robot.speeds).max())
    rotation, origin = compute_flange(robot, swing.joints)
    places = origin + rotation @ np.asarray(swing.tip)
    length = float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())
    angle = float(measure_angles_between(rotation[:1], rotation[-1:])[0])
    needed = seconds * swing.fastest / point
    if max(seconds, length / speed, angle / _ON_THE_WAY) >= _NEARLY * needed:
        return speed, 0.0
    if length >= _MOVES_MM:
        return round_down(length / needed), 0.0
    degrees = math.floor(math.degrees(angle) / needed * _PARTS) / _PARTS
    return speed, math.radians(max(degrees, 1 / _PARTS))


def _share(robot: Robot, joints: FloatArray, tip: Vec3, speed: float, turn: float) -> float:
    """The share for a motion with joint values (R, J) on it, 0 where the arm stands.

    tip: the TCP in the flange frame, mm.
    speed: limit of the speed of the TCP, mm/s.
    turn: limit of the speed at which the tool turns, rad/s, 0 without one.
    """
    travel = joints[-1] - joints[0]
    if not travel.any():
        return 0.0
    moved, turning = measure_fastest(robot, joints, tip)
    fastest_turn = min(turn or _FASTEST_TURN, _FASTEST_TURN)
    bounds = (limit / rate for limit, rate in ((speed, moved), (fastest_turn, turning)) if rate > 0)
    return _floor(min([find_held_fraction(robot, travel), *bounds]))


def _rate(robot: Robot, travel: FloatArray, share: float) -> float:
    """The speed of the turning joint with the longest travel, rad/s, rounded down; 0 if none turns.

    travel: (J,) rad or mm from the start to the end.
    share: share of the joints' maximum speeds.
    """
    longest = np.abs(travel)[robot.revolute].max(initial=0.0)
    if not longest:
        return 0.0
    return _floor(float(longest * share / (np.abs(travel) / robot.speeds).max()))


def _floor(share: float) -> float:
    return float(math.floor(share * 10**_DIGITS) / 10**_DIGITS)
