"""How fast a tool and a joint are where all joints run evenly, the slowest for its way at its greatest speed."""

from __future__ import annotations

import numpy as np

from camgen.model.pose import FloatArray, Vec3
from camgen.model.tolerance import NONZERO
from camgen.robots.kinematics.forward import jacobian
from camgen.robots.models import Robot


def fastest(robot: Robot, joints: FloatArray, tip: Vec3) -> tuple[float, float]:
    """The greatest speed, mm/s, of the point ``tip`` (mm, from the flange) at the values (R, J) on the way of an even
    motion of the joints from the first row to the last, and rad/s of the fastest joint that turns; 0 where it stands.
    """
    way = joints[-1] - joints[0]
    seconds = float((np.abs(way) / robot.speeds).max())
    if seconds == 0.0:
        return 0.0, 0.0
    rate = way / seconds
    moves, rotation, _ = jacobian(robot, joints)
    flange = moves @ rate
    moved = np.linalg.norm(
        flange[:, :3] + np.cross(flange[:, 3:], rotation @ np.asarray(tip)), axis=1
    ).max()
    turning = np.abs(rate[[not joint.sliding for joint in robot.joints]]).max(initial=0.0)
    return float(moved), float(turning)


def held_share(robot: Robot, way: FloatArray) -> float:
    """The share of the joints' own speeds at which an even motion by ``way`` (J,), not all 0, keeps to those to which
    the job holds them: the joint that is slowest for its way at its own speed sets the time of all.
    """
    moved = np.maximum(np.abs(way), NONZERO)
    return min(1.0, float((robot.fastest / moved).min() / (robot.speeds / moved).min()))
