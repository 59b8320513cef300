"""Speeds of the tool and the joints in a joint motion at maximum speed.

All joints start and end together, so the slowest one for its angle runs at its maximum speed.
"""

from __future__ import annotations

import numpy as np

from camgen.model.pose import FloatArray, Vec3
from camgen.model.tolerance import NONZERO
from camgen.robots.kinematics.forward import compute_jacobian
from camgen.robots.models import Robot


def measure_fastest(robot: Robot, joints: FloatArray, tip: Vec3) -> tuple[float, float]:
    """The largest speeds of a point of the tool and of a revolute joint, mm/s and rad/s.

    They are those of a joint motion at maximum speed, and 0 without a motion.

    joints: (R, J) joint values along the motion, from its start to its end.
    tip: the point in the frame of the flange, mm.
    """
    change = joints[-1] - joints[0]
    seconds = float((np.abs(change) / robot.speeds).max())
    if seconds == 0.0:
        return 0.0, 0.0
    rate = change / seconds
    moves, rotation, _ = compute_jacobian(robot, joints)
    flange = moves @ rate
    velocity = flange[:, :3] + np.cross(flange[:, 3:], rotation @ np.asarray(tip))
    turning = np.abs(rate[robot.revolute]).max(initial=0.0)
    return float(np.linalg.norm(velocity, axis=1).max()), float(turning)


def find_held_fraction(robot: Robot, change: FloatArray) -> float:
    """The fraction of the maximum speeds at which a joint motion keeps the speeds of the job.

    change: (J,) change of the joint values, not all 0. The slowest joint for its change at its
        maximum speed determines the time.
    """
    moved = np.maximum(np.abs(change), NONZERO)
    return min(1.0, float((robot.fastest / moved).min() / (robot.speeds / moved).min()))
