"""Speeds of motions that a time or a speed of turning limits, as robot languages state them.

A controller keeps the speed of the TCP and the speed of turning: the slower of the two sets the
time of a motion. The model has one speed for a motion: the speed of the TCP if it travels, and the
speed of turning if the TCP stays in its place.
"""

from __future__ import annotations

import math

from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.arcs import compute_circle
from camgen.model.pose import Pose, angle_between
from camgen.model.program import MoveC, MoveJ, MoveL
from camgen.model.tolerance import SAME_POINT_MM

#: A motion is slower than it is programmed if its time is longer by this part; digits are smaller.
_SLOWER = 1e-9


class Limit(Struct, frozen=True):
    """The limits of a motion.

    speed: speed of the TCP, mm/s.
    turn: speed at which the tool turns, rad/s, 0 without one.
    seconds: least time of the motion, s, 0 without one.
    is_exact: whether it takes `seconds` whatever the speeds are.
    """

    speed: float
    turn: float = 0.0
    seconds: float = 0.0
    is_exact: bool = False


class Extent(Struct, frozen=True):
    """The extent of a motion: length of the TCP, mm, and angle that the tool turns, rad."""

    length: float
    angle: float


def measure_line(start: Pose, target: Pose) -> Extent:
    """The extent of a straight motion, or of a joint motion as if it were straight."""
    length = math.dist(start.origin, target.origin)
    steps = zip(start.origin, target.origin, strict=True)
    if max(abs(a - b) for a, b in steps) < SAME_POINT_MM:
        length = 0.0
    if start.rotation is target.rotation:
        return Extent(length, 0.0)
    return Extent(length, angle_between(start.rotation, target.rotation))


def measure_arc(start: Pose, via: Pose, target: Pose, *, turns_by_via: bool = False) -> Extent:
    """The extent of an arc, that of its chord if the three points are on one line.

    turns_by_via: whether the tool turns by way of the orientation of the via point.
    """
    straight = measure_line(start, target)
    if turns_by_via:
        angle = measure_line(start, via).angle + measure_line(via, target).angle
        straight = Extent(straight.length, angle)
    try:
        _, radius, _, sweep = compute_circle(start.origin, via.origin, target.origin)
    except ValueError:
        return straight
    return Extent(radius * sweep, straight.angle)


def limit_speed(extent: Extent, limit: Limit) -> tuple[float, float]:
    """The speed of the TCP, mm/s, and that of turning, rad/s, 0 for a motion that travels."""
    if extent.length < SAME_POINT_MM:
        return limit.speed, _limit_turn(extent.angle, limit)
    if limit.is_exact:
        return extent.length / limit.seconds, 0.0
    travel = extent.length / limit.speed
    turning = extent.angle / limit.turn if limit.turn else 0.0
    seconds = max(turning, limit.seconds)
    if seconds <= travel * (1 + _SLOWER):
        return limit.speed, 0.0
    return extent.length / seconds, 0.0


def _limit_turn(angle: float, limit: Limit) -> float:
    """The speed of turning in place, rad/s, 0 without a turn."""
    if not angle or not limit.seconds:
        return limit.turn if angle else 0.0
    timed = angle / limit.seconds
    return timed if limit.is_exact or not limit.turn else min(timed, limit.turn)


def pace_motion(
    item: MoveJ | MoveL | MoveC, start: Pose | None, limit: Limit
) -> MoveJ | MoveL | MoveC:
    """The motion at the speed that its limits allow.

    start: pose of the TCP before the motion, None if it is not known.
    """
    if start is None or not isinstance(item.target, Pose):
        return item
    if isinstance(item, MoveC):
        speed, _ = limit_speed(measure_arc(start, item.via, item.target), limit)
        return item if speed == item.speed else replace(item, speed=speed)
    speed, turn = limit_speed(measure_line(start, item.target), limit)
    if (speed, turn) == (item.speed, item.turn):
        return item
    return replace(item, speed=speed, turn=turn)
