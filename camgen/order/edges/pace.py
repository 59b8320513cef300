"""How fast links are run: in free space as fast as the joints may be, at the part at the speed of travel."""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct

from camgen.model.pose import FloatArray, frozen
from camgen.motion.pose_paths import Index, Way
from camgen.motion.setup import Setup
from camgen.robots.kinematics.rates import fastest, held_share

#: mm/s: speeds of lines from here on are whole.
_WHOLE = 10.0
#: Places on the way of the joints at which the speed of the tool is looked at, and in how many parts a share is told.
_LOOKS, _SHARES = 33, 10**6


class Pace(Struct, frozen=True):
    """speed: mm/s at the part. free: mm/s in free space at most. share: of the joints' greatest speeds there at most;
    0: the speed alone holds. acceleration: mm/s2 of the TCP. pressed: an edge is left and come to with a force.
    """

    speed: float
    free: float
    share: float
    acceleration: float = 5000.0
    pressed: bool = False


def pace_lines(setup: Setup, pace: Pace, dense: Way, joints: FloatArray, at: Index) -> FloatArray:
    """The speed of each segment of a way out, mm/s (N - 1,), at which no joint is faster than it may be anywhere along
    it, whole where it is not below 10; and no more than what is reached from rest half-way, or than the speed at the
    part where it presses. at: (N,) where the segments begin and end among the rows of ``dense`` (D), which have
    ``joints`` (D, J).
    """
    seconds = (np.abs(np.diff(joints, axis=0)) / setup.robot.fastest).max(axis=1)
    with np.errstate(divide="ignore"):
        most = np.minimum.reduceat(dense.length / seconds, at[:-1])
    reached = np.sqrt(pace.acceleration * np.add.reduceat(dense.length, at[:-1]))
    most = np.minimum(np.minimum(most, reached), pace.speed if pace.pressed else pace.free)
    return frozen(np.where(most >= _WHOLE, np.floor(most), most))


def pace_turn(setup: Setup, a: FloatArray, b: FloatArray, pace: Pace) -> tuple[float, float]:
    """The speed of the TCP, mm/s, and the share of the joints' greatest speeds, 0 where the speed alone holds, of an
    even motion of the joints from ``a`` to ``b`` (J,) in free space.
    """
    if pace.share == 0:
        return pace.free, 0.0
    way = a + np.linspace(0.0, 1.0, _LOOKS)[:, None] * (b - a)
    moved, _ = fastest(setup.robot, way, setup.flange_from_tool.origin)
    if moved == 0:
        return pace.speed, 0.0
    most = min(pace.share, held_share(setup.robot, b - a), pace.free / moved)
    share = math.floor(most * _SHARES) / _SHARES
    # Whole mm/s, no less than the joints make of it: then it is the joints that hold the tool back.
    return min(float(math.ceil(share * moved)), pace.free), share
