"""Speed profiles of an arm's motions, and the time that a corner with a blend saves."""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct

from camgen.check.reach import JointTrace, compute_tips
from camgen.model.cell import Dynamics
from camgen.model.part import IntArray
from camgen.model.pose import FloatArray
from camgen.model.program import Comment, MoveJ, Program
from camgen.robots.models import Robot

#: mm: a motion on which the TCP travels less has no speed profile.
_STILL_MM = 0.01
#: s: smallest change of direction of a corner (`_pass`), so that a straight corner has a speed.
_MIN_BEND = 1e-3


class MotionTrace(Struct, frozen=True, eq=False):
    """The samples of a program, with the path of the TCP and the fastest times of the joints.

    Each motion but the first begins at the last sample of the motion before it.

    scaled_joints: (S, J) joint values divided by the maximum speeds of the joints, s.
    tip: (S, 3) TCP in the base frame, mm.
    owner: (S,) motion of each sample.
    travelled: (S,) path of the TCP up to each sample, mm.
    seconds: (S,) time up to each sample if the slowest joint runs at its maximum speed, s.
    """

    scaled_joints: FloatArray
    tip: FloatArray
    owner: IntArray
    travelled: FloatArray
    seconds: FloatArray

    def rows(self, motion: int) -> slice:
        """The samples of `motion`, which is not the first, from its start to its end."""
        begin, end = np.searchsorted(self.owner, [motion, motion + 1]).tolist()
        return slice(begin - 1, end)


def trace_motions(program: Program, reach: JointTrace, robot: Robot) -> MotionTrace:
    """Compute TCP and times at all samples of `reach`."""
    tip = compute_tips(robot, reach.joints, program.flange_from_tool)
    scaled = reach.joints / robot.speeds
    steps_mm = np.linalg.norm(np.diff(tip, axis=0), axis=1)
    steps_s = np.abs(np.diff(scaled, axis=0)).max(axis=1)
    travelled = np.append(0.0, np.cumsum(steps_mm))
    seconds = np.append(0.0, np.cumsum(steps_s))
    return MotionTrace(
        scaled, tip, np.searchsorted(program.columns.at, reach.owner), travelled, seconds
    )


def find_corners(program: Program) -> IntArray:
    """Find the motions, except the first, that another motion follows without a stop between.

    Only comments may be between the two.
    """
    columns = program.columns
    done = np.cumsum(~columns.are(Comment))[columns.at]
    return np.flatnonzero(np.diff(done)[1:] == 1) + 1


class SpeedProfile(Struct, frozen=True):
    """Length, maximum speed and acceleration of one motion.

    A line or an arc is measured in mm along it, a joint motion in seconds at the joints' maximum
    speeds.

    length: mm or s.
    max_speed: mm/s, or a fraction of the maximum joint speeds.
    acceleration: mm/s2, or 1/s.
    mm: path of the TCP.
    seconds: time of the motion at the joints' maximum speeds, s.
    """

    length: float
    max_speed: float
    acceleration: float
    mm: float
    seconds: float

    @property
    def peak(self) -> float:
        """The highest speed of the motion if it starts and ends at rest."""
        return min(self.max_speed, math.sqrt(self.acceleration * self.length))


def make_speed_profile(
    trace: MotionTrace, program: Program, motion: int, pace: Dynamics
) -> SpeedProfile | None:
    """Return the speed profile of `motion`, None if the TCP or the joints hardly move."""
    rows, move = trace.rows(motion), program.columns.moves[motion]
    first, last = rows.start, rows.stop - 1
    mm = float(trace.travelled[last] - trace.travelled[first])
    seconds = float(trace.seconds[last] - trace.seconds[first])
    if mm < _STILL_MM or seconds <= 0:
        return None
    if isinstance(move, MoveJ) and pace.shares and move.share > 0:
        return SpeedProfile(seconds, move.share, 1 / pace.ramp, mm, seconds)
    if isinstance(move, MoveJ):
        max_speed = min(1.0, move.speed * seconds / mm)
        gain = min(1 / pace.ramp, pace.acceleration * seconds / mm)
        return SpeedProfile(seconds, max_speed, gain, mm, seconds)
    steps = np.diff(trace.seconds[rows])
    moving = steps > 0
    slowest = float((np.diff(trace.travelled[rows])[moving] / steps[moving]).min(initial=math.inf))
    return SpeedProfile(mm, min(move.speed, slowest), pace.acceleration, mm, seconds)


def compute_saved_seconds(
    program: Program, reach: JointTrace, robot: Robot, pace: Dynamics
) -> FloatArray:
    """Compute by how much motions (M,) are shorter than from rest to rest, s.

    Only corners with a blend count, and only if one of their two motions is a joint motion.
    """
    columns = program.columns
    saved = np.zeros(len(columns.moves))
    is_joint = columns.moves_are(MoveJ)
    candidates = find_corners(program)
    has_blend = columns.blend[candidates] > 0
    corners = candidates[has_blend & (is_joint[candidates] | is_joint[candidates + 1])].tolist()
    if not corners or pace.corner not in ("zone", "overlap"):
        return saved
    trace = trace_motions(program, reach, robot)
    for corner in corners:
        before = make_speed_profile(trace, program, corner, pace)
        after = make_speed_profile(trace, program, corner + 1, pace)
        if before is None or after is None:
            continue
        if pace.corner == "overlap":
            # The next motion accelerates while this one brakes, so the shorter ramp saves its time.
            ramps = before.peak / before.acceleration, after.peak / after.acceleration
            saved[corner + 1] += min(ramps)
            continue
        blend = float(columns.blend[corner])
        fraction, held = _pass(trace, corner, (before, after), blend, pace)
        for motion, profile in ((corner, before), (corner + 1, after)):
            # From seconds at full speed to the unit of the motion's length.
            scale = profile.length / profile.seconds
            saved[motion] += _save(profile, fraction * scale, held * scale)
    return saved


def _pass(
    trace: MotionTrace,
    corner: int,
    profiles: tuple[SpeedProfile, SpeedProfile],
    zone: float,
    pace: Dynamics,
) -> tuple[float, float]:
    """Compute the speed at which the corner after the motion `corner` is passed, and its length.

    Within the zone, joints and TCP change from one direction to the other with constant
    acceleration. At the speed fraction f, held over the length s on both sides of the corner, the
    directions change by f times their difference in the time 2 s / f. The rest of each half motion
    must be long enough to come to rest.

    Returns the fraction of the maximum joint speeds, the same on both sides, and the length on
    either side over which it is held, in seconds at full speed.
    """
    before, after = trace.rows(corner), trace.rows(corner + 1)
    joint_rate, tip_rate = _measure_rates(trace, before.stop - 2, before.stop - 1)
    next_joint_rate, next_tip_rate = _measure_rates(trace, after.start, after.start + 1)
    turn = float(np.abs(next_joint_rate - joint_rate).max()) * pace.ramp
    bend = float(np.linalg.norm(next_tip_rate - tip_rate)) / pace.acceleration
    hard = max(turn, bend, _MIN_BEND)
    held, fraction = math.inf, math.inf
    for profile in profiles:
        held = min(held, min(zone / profile.mm, 0.5) * profile.seconds)
        fraction = min(fraction, profile.max_speed * profile.seconds / profile.length)
    # A shorter zone leaves more length to come to rest in: at best 2 s / hard = 2 g (half - s).
    for profile in profiles:
        gain = profile.acceleration * profile.seconds / profile.length
        held = min(held, gain * profile.seconds / 2 / (1 / hard + gain))
    return min(math.sqrt(2 * held / hard), fraction), held


def _measure_rates(trace: MotionTrace, first: int, last: int) -> tuple[FloatArray, FloatArray]:
    """Measure the speeds between two samples if the slowest joint runs at its maximum speed.

    Returns the joint speeds (J,) as fractions of their maxima, and the TCP velocity (3,), mm/s.
    """
    seconds = max(float(trace.seconds[last] - trace.seconds[first]), 1e-9)
    joints = (trace.scaled_joints[last] - trace.scaled_joints[first]) / seconds
    return joints, (trace.tip[last] - trace.tip[first]) / seconds


def _save(profile: SpeedProfile, speed: float, held: float) -> float:
    """Compute the seconds that half of a motion saves if it ends at `speed` instead of at rest.

    held: length at the end over which `speed` is held, in the unit of the profile's length.
    """
    half, peak, gain = profile.length / 2, profile.peak, profile.acceleration
    stopped = peak / gain / 2 + half / peak
    top = min(peak, math.sqrt(speed**2 + 2 * gain * (half - held)))
    ramp = (top**2 - speed**2) / (2 * gain)
    passed = held / speed + (top - speed) / gain + (half - held - ramp) / top
    return max(stopped - passed, 0.0)
