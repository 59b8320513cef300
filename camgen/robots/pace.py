"""How long joints take from rest to rest: speeds and accelerations, the slowest joint and the TCP counting."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.model.cell import Dynamics
from camgen.model.pose import FloatArray
from camgen.robots.models import Robot


class Pace(Struct, frozen=True, eq=False):
    """speeds, gains: (J,) rad/s or mm/s of the joints, and what they gain in a second. travel: mm/s of the TCP, gain:
    mm/s2.
    """

    speeds: FloatArray
    gains: FloatArray
    travel: float
    gain: float

    def seconds(self, moved: FloatArray, way: FloatArray | float) -> FloatArray:
        """(...) of motions of the joints by ``moved`` (..., J), whose TCP goes ``way`` (...) mm: all joints begin and
        end together, so that the slowest counts.
        """
        joints = from_rest(np.abs(moved), self.speeds, self.gains).max(axis=-1)
        return np.asarray(np.maximum(joints, from_rest(np.asarray(way), self.travel, self.gain)))

    def between(self, start: FloatArray, end: FloatArray, way: FloatArray | float) -> FloatArray:
        """``seconds`` (..., M, K) from each of ``start`` (..., M, J) to each of ``end`` (..., K, J), without a table of
        all joints.
        """
        shape = (*start.shape[:-1], end.shape[-2])
        short, long = np.zeros(shape), np.zeros(shape)
        paces = zip(self.speeds.tolist(), self.gains.tolist(), strict=True)
        for joint, (speed, gain) in enumerate(paces):
            moved = np.abs(start[..., :, None, joint] - end[..., None, :, joint])
            # From where on a joint comes to its full speed, its time is the way's and that of gaining it once.
            full = moved >= speed * speed / gain
            np.maximum(long, np.where(full, moved / speed + speed / gain, 0.0), out=long)
            np.maximum(short, moved / gain, out=short)
        joints = np.maximum(2 * np.sqrt(short), long)
        return np.asarray(np.maximum(joints, from_rest(np.asarray(way), self.travel, self.gain)))


def pace_of(robot: Robot, dynamics: Dynamics, travel: float) -> Pace:
    """The pace of ``robot`` on a controller that is taken to do ``dynamics``."""
    gains = robot.speeds / dynamics.ramp if robot.accelerations is None else robot.accelerations
    return Pace(robot.fastest, gains, travel, dynamics.acceleration)


def from_rest(
    way: FloatArray, speed: FloatArray | float, acceleration: FloatArray | float
) -> FloatArray:
    """Seconds from rest to rest over ``way`` >= 0, in units that go together: a trapezoid, or a triangle if short."""
    speed, acceleration = np.asarray(speed), np.asarray(acceleration)
    short = way * acceleration < speed * speed
    return np.where(short, 2 * np.sqrt(way / acceleration), way / speed + speed / acceleration)
