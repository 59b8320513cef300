"""From joints to frames, many configurations at once."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from camgen.geometry.rotations import about
from camgen.model.pose import FloatArray
from camgen.robots.chain import Joint
from camgen.robots.models import Robot


def frames(robot: Robot, joints: FloatArray) -> tuple[FloatArray, FloatArray]:
    """base_from_link of every link for N configurations (N, J): rotations (N, J + 1, 3, 3), origins (N, J + 1, 3), mm.

    Link 0 is the base, link k moves with joint k. Joint values are the controller's, rad or mm.
    """
    joints = np.asarray(joints, dtype=np.float64)
    serial = joints @ robot.coupling.T
    count = len(joints)
    rotations = np.empty((count, len(robot.joints) + 1, 3, 3))
    origins = np.empty((count, len(robot.joints) + 1, 3))
    rotations[:, 0], origins[:, 0] = np.eye(3), 0.0
    for k, joint in enumerate(robot.joints):
        rotation, place = rotations[:, k], np.asarray(joint.previous_from_joint.origin)
        if joint.sliding:
            along = joint.previous_from_joint.rotation @ np.asarray(joint.axis)
            origins[:, k + 1] = origins[:, k] + (rotation @ (place + serial[:, k, None] * along)[..., None])[..., 0]
            rotations[:, k + 1] = rotation @ joint.previous_from_joint.rotation
        else:
            origins[:, k + 1] = origins[:, k] + rotation @ place
            rotations[:, k + 1] = rotation @ _rotate(joint, serial[:, k])
    return rotations, origins


def flange(robot: Robot, joints: FloatArray) -> tuple[FloatArray, FloatArray]:
    """base_from_flange for N configurations (N, J): rotations (N, 3, 3) and origins (N, 3), mm."""
    rotations, origins = frames(robot, joints)
    last = rotations[:, -1]
    return last @ robot.flange.rotation, origins[:, -1] + last @ np.asarray(robot.flange.origin)


def jacobian(robot: Robot, joints: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """How the flange moves with the controller's joint values: (N, 6, J), rows are mm and rad of the base frame; and
    base_from_flange as ``flange`` gives it, which falls out.
    """
    rotations, origins = frames(robot, joints)
    last = rotations[:, -1]
    tip = origins[:, -1] + last @ np.asarray(robot.flange.origin)
    serial = np.zeros((len(joints), 6, len(robot.joints)))
    for k, joint in enumerate(robot.joints):
        axis = rotations[:, k + 1] @ np.asarray(joint.axis)
        serial[:, :3, k] = axis if joint.sliding else np.cross(axis, tip - origins[:, k + 1])
        if not joint.sliding:
            serial[:, 3:, k] = axis
    return serial @ robot.coupling, last @ robot.flange.rotation, tip


def _rotate(joint: Joint, angles: FloatArray) -> FloatArray:
    """previous_from_joint's rotation (N, 3, 3) at N angles."""
    parts = np.stack([np.ones(len(angles)), np.cos(angles), np.sin(angles)], axis=1)
    return np.asarray((parts @ _parts(joint)).reshape(-1, 3, 3))


@lru_cache(maxsize=256)
def _parts(joint: Joint) -> FloatArray:
    """What of a joint's rotation stays, goes with the cosine of its angle and with the sine: (3, 9)."""
    return (joint.previous_from_joint.rotation @ about(np.asarray(joint.axis))).reshape(3, 9)
