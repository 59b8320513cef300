"""Speeds of an arm: the limits of joints and TCP, and the speeds of links between paths."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from msgspec import Struct

from camgen.model.cell import Dynamics
from camgen.model.job import ProcessTable
from camgen.model.pose import FloatArray, Vec3, frozen
from camgen.model.tolerance import NONZERO
from camgen.motion.pose_paths import Index, PosePath
from camgen.motion.setup import Setup
from camgen.robots.kinematics.forward import compute_flange
from camgen.robots.kinematics.rates import find_held_fraction, measure_fastest
from camgen.robots.models import Robot

#: From this speed on, mm/s, speeds of lines are whole numbers.
_WHOLE = 10.0
#: Samples of a joint path at which the speed of the tool is computed.
_LOOKS = 33
#: A share of the joints' maximum speeds is a whole number of these parts.
_SHARES = 10**6
#: Part of the change of a rate between two intervals by which the rate may exceed its mean.
_PEAK = 0.75
#: A speed below 10 mm/s is a whole number of these parts.
_PARTS = 10**3
#: mm/s: maximum speed of each point of arm, holder and tool in free space without
#: `process.travel`. It is the reduced speed of ISO 10218-1.
REDUCED_SPEED = 250.0


class MotionLimits(Struct, frozen=True, eq=False):
    """Maximum speeds and accelerations of the J joints and of the TCP.

    joint_speeds: (J,) rad/s or mm/s.
    joint_accelerations: (J,) rad/s2 or mm/s2.
    speed: maximum speed of the TCP, mm/s.
    acceleration: maximum acceleration of the TCP, mm/s2.
    """

    joint_speeds: FloatArray
    joint_accelerations: FloatArray
    speed: float
    acceleration: float

    def seconds(self, moved: FloatArray, length: FloatArray | float) -> FloatArray:
        """(...) durations from rest to rest, s; all joints begin and end together.

        moved: (..., J) changes of the joints, rad or mm.
        length: (...) length of the way of the TCP, mm.
        """
        joints = time_from_rest(np.abs(moved), self.joint_speeds, self.joint_accelerations)
        tool = time_from_rest(np.asarray(length), self.speed, self.acceleration)
        return np.asarray(np.maximum(joints.max(axis=-1), tool))

    def between(self, start: FloatArray, end: FloatArray, length: FloatArray | float) -> FloatArray:
        """(..., M, K) `seconds` from each start to each end, without a table of all joints.

        start: (..., M, J) joint values, rad or mm.
        end: (..., K, J) joint values, rad or mm.
        length: (..., M, K) length of the way of the TCP, mm.
        """
        shape = (*start.shape[:-1], end.shape[-2])
        short, long = np.zeros(shape), np.zeros(shape)
        limits = zip(self.joint_speeds.tolist(), self.joint_accelerations.tolist(), strict=True)
        for joint, (speed, acceleration) in enumerate(limits):
            moved = np.abs(start[..., :, None, joint] - end[..., None, :, joint])
            # A joint that reaches its speed takes the time of the way and of one acceleration.
            full = moved >= speed * speed / acceleration
            np.maximum(long, np.where(full, moved / speed + speed / acceleration, 0.0), out=long)
            np.maximum(short, moved / acceleration, out=short)
        joints = np.maximum(2 * np.sqrt(short), long)
        tool = time_from_rest(np.asarray(length), self.speed, self.acceleration)
        return np.asarray(np.maximum(joints, tool))


def make_limits(robot: Robot, dynamics: Dynamics, speed: float) -> MotionLimits:
    """The limits of `robot` on a controller with `dynamics`.

    speed: maximum speed of the TCP, mm/s.
    """
    return MotionLimits(
        robot.fastest, _choose_accelerations(robot, dynamics.ramp), speed, dynamics.acceleration
    )


def _choose_accelerations(robot: Robot, ramp: float) -> FloatArray:
    """(J,) the stated accelerations, rad/s2 or mm/s2, else those of full speed within `ramp`, s."""
    return robot.fastest / ramp if robot.accelerations is None else robot.accelerations


def time_from_rest(
    length: FloatArray, speed: FloatArray | float, acceleration: FloatArray | float
) -> FloatArray:
    """Durations from rest to rest, s: a trapezoid of speed, or a triangle on a short way.

    length: not negative; its unit is that of speed and acceleration.
    """
    speed, acceleration = np.asarray(speed), np.asarray(acceleration)
    short = length * acceleration < speed * speed
    trapezoid = length / speed + speed / acceleration
    return np.where(short, 2 * np.sqrt(length / acceleration), trapezoid)


class LinkSpeeds(Struct, frozen=True):
    """Speeds of links at the part and in free space.

    part: speed at the part, mm/s.
    free: maximum speed of the TCP in free space, mm/s.
    share: maximum share of the joints' maximum speeds in free space; 0: `free` alone counts.
    acceleration: acceleration of the TCP, mm/s2.
    pressed: whether an edge is left and approached with a force.
    point: maximum speed of all points of arm, holder and tool, mm/s; infinite without a limit.
    ramp: time in which a joint comes to full speed, s.
    """

    part: float
    free: float
    share: float
    acceleration: float = 5000.0
    pressed: bool = False
    point: float = math.inf
    ramp: float = 0.2

    def time_joints(self, robot: Robot, moved: FloatArray) -> FloatArray:
        """(...) durations of joint motions from rest to rest, s; moved: (..., J) rad or mm."""
        gains = _choose_accelerations(robot, self.ramp)
        return np.asarray(time_from_rest(np.abs(moved), robot.fastest, gains).max(axis=-1))

    def time_tool(self, length: FloatArray | float, speed: FloatArray | float) -> FloatArray:
        """(...) durations of motions of the TCP from rest to rest, s; length: mm; speed: mm/s."""
        return time_from_rest(np.asarray(length), speed, self.acceleration)


def choose_link_speeds(
    process: ProcessTable, dynamics: Dynamics, *, pressed: bool = False
) -> LinkSpeeds:
    """The speeds of links that a job asks for.

    Without `process.travel` no point is faster than the reduced speed.

    dynamics: dynamics of the controller.
    pressed: whether an edge is left and approached with a force.
    """
    free, share = min(dynamics.fastest, REDUCED_SPEED), dynamics.max_fraction
    if process.travel:
        free, share = process.travel, 0.0
    return LinkSpeeds(
        process.travel_speed,
        free,
        share,
        dynamics.acceleration,
        pressed,
        limit_points(process),
        dynamics.ramp,
    )


def limit_points(process: ProcessTable) -> float:
    """The maximum speed, mm/s, of all points of an arm in free space."""
    return math.inf if process.travel else REDUCED_SPEED


def measure_point_speed(
    robot: Robot, distance: Callable[[FloatArray, FloatArray], FloatArray], joints: FloatArray
) -> float:
    """The speed, mm/s, of the fastest point of an arm at the maximum speeds of its joints.

    distance: upper bound of the distance of a point at two joint values, see `Setup.measure_apart`.
    joints: (R, J) values along a joint motion.
    """
    seconds = (np.abs(np.diff(joints, axis=0)) / robot.speeds).max(axis=1)
    moves = seconds > 0
    distances = distance(joints[:-1][moves], joints[1:][moves])
    return float((distances / seconds[moves]).max(initial=0.0))


def compute_line_speeds(
    setup: Setup, speeds: LinkSpeeds, dense: PosePath, joints: FloatArray, at: Index
) -> FloatArray:
    """(N - 1,) speeds, mm/s, of the segments of a retraction, within the limits of an arm.

    A speed of 10 mm/s and more is a whole number. It is no more than the speed that is reached
    from rest half-way, and for a tool that presses no more than the speed at the part.

    dense: D samples of the retraction.
    joints: (D, J) joint values there.
    at: (N,) the samples at which segments begin and end.
    """
    slowest = (_peak_rates(joints, dense.length, at) / setup.robot.fastest).max(axis=1)
    reached = np.sqrt(speeds.acceleration * np.add.reduceat(dense.length, at[:-1]))
    allowed = np.asarray(speeds.part if speeds.pressed else speeds.free)
    with np.errstate(divide="ignore"):
        by_joints = np.minimum.reduceat(1.0 / slowest, at[:-1])
        if math.isfinite(speeds.point):
            by_points = speeds.point * dense.length / setup.measure_apart(joints[:-1], joints[1:])
            allowed = np.minimum(allowed, np.minimum.reduceat(by_points, at[:-1]))
    speed = np.minimum(np.minimum(by_joints, reached), allowed)
    return frozen(np.where(speed >= _WHOLE, np.floor(speed), speed))


def _peak_rates(joints: FloatArray, length: FloatArray, at: Index) -> FloatArray:
    """(D - 1, J) greatest rates of the joints between samples, rad or mm for each mm of a path.

    A rate that changes evenly is at the end of an interval half a change beyond its mean. A rate
    with a peak in the interval exceeds it by less than `_PEAK` of a change. At a corner of the path
    the rate jumps, so the change there counts only beside a segment of one interval, whose own
    changes are not known.

    joints: (D, J) joint values at the samples.
    length: (D - 1,) lengths of the path between them, mm.
    at: (N,) the samples at which segments begin and end.
    """
    rates = np.diff(joints, axis=0) / np.maximum(length, NONZERO)[:, None]
    changes = _PEAK * np.abs(np.diff(rates, axis=0))
    none = np.zeros((1, joints.shape[1]))
    before, after = np.concatenate([none, changes]), np.concatenate([changes, none])
    is_long = np.diff(at) > 1
    before[at[:-1][is_long]] = 0.0
    after[at[1:][is_long] - 1] = 0.0
    return np.asarray(np.abs(rates) + np.maximum(before, after))


def compute_joint_speed(
    setup: Setup, start: FloatArray, end: FloatArray, speeds: LinkSpeeds
) -> tuple[float, float]:
    """The speed of the TCP, mm/s, and the share of the joints' maximum speeds of a joint motion.

    The share is 0 where the speed alone counts.
    start, end: (J,) joint values, in free space.
    """
    if speeds.share == 0:
        return speeds.free, 0.0
    samples = start + np.linspace(0.0, 1.0, _LOOKS)[:, None] * (end - start)
    moved, _ = measure_fastest(setup.robot, samples, setup.flange_from_tool.origin)
    if moved == 0:
        return speeds.part, 0.0
    allowed = min(speeds.share, find_held_fraction(setup.robot, end - start), speeds.free / moved)
    by_points = speeds.point / max(
        moved, measure_point_speed(setup.robot, setup.measure_apart, samples)
    )
    share = math.floor(min(allowed, by_points) * _SHARES) / _SHARES
    if by_points < allowed:
        return slow_down(setup.robot, samples, setup.flange_from_tool.origin, share), share
    # A whole number, not below the speed that the joints give: then the joints are the limit.
    return min(float(math.ceil(share * moved)), speeds.free), share


def slow_down(robot: Robot, joints: FloatArray, tip: Vec3, share: float) -> float:
    """The mean speed of the TCP, mm/s, in a joint motion at a share of the maximum speeds.

    A controller to which the speed of a joint motion is that of the TCP takes no less time.

    joints: (R, J) values along the motion.
    tip: the TCP in the flange frame, mm.
    """
    seconds = float((np.abs(joints[-1] - joints[0]) / robot.speeds).max())
    rotation, origin = compute_flange(robot, joints)
    steps = np.diff(origin + rotation @ np.asarray(tip), axis=0)
    return round_down(share * float(np.linalg.norm(steps, axis=1).sum()) / seconds)


def round_down(speed: float) -> float:
    """A speed, mm/s, as programs state it: a whole number from 10 on, else in thousandths."""
    if speed >= _WHOLE:
        return float(math.floor(speed))
    return max(math.floor(speed * _PARTS) / _PARTS, 1 / _PARTS)
