"""From joints to frames, many configurations at once."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from camgen.geometry.rotations import about
from camgen.geometry.vectors import cross
from camgen.model.pose import FloatArray
from camgen.robots.chain import Joint
from camgen.robots.models import Robot


def frames(robot: Robot, joints: FloatArray) -> tuple[FloatArray, FloatArray]:
    """base_from_link of every link for N configurations (N, J): rotations (N, J + 1, 3, 3), origins (N, J + 1, 3), mm.

    Link 0 is the base, link k moves with joint k. Joint values are the controller's, rad or mm.
    """
    joints = np.asarray(joints, dtype=np.float64)
    serial = (joints @ robot.coupling.T).T
    count, many = len(joints), len(robot.joints)
    # All joints at once turn in a third of the time; link by link in memory, as they are worked out.
    shares = np.empty((many, count, 3))
    shares[..., 0] = 1.0
    np.cos(serial, out=shares[..., 1])
    np.sin(serial, out=shares[..., 2])
    turns = (shares @ _parts(robot.joints)).reshape(many, count, 3, 3)
    rotations, origins = np.empty((many + 1, count, 3, 3)), np.empty((many + 1, count, 3))
    rotations[0], origins[0] = np.eye(3), 0.0
    for k, joint in enumerate(robot.joints):
        place = np.asarray(joint.previous_from_joint.origin)
        if joint.sliding:
            along = joint.previous_from_joint.rotation @ np.asarray(joint.axis)
            moved = (rotations[k] @ (place + serial[k][:, None] * along)[..., None])[..., 0]
        else:
            moved = (rotations[k].reshape(-1, 3) @ place).reshape(-1, 3)
        np.add(origins[k], moved, out=origins[k + 1])
        np.matmul(rotations[k], turns[k], out=rotations[k + 1])
    return rotations.swapaxes(0, 1), origins.swapaxes(0, 1)


def flange(robot: Robot, joints: FloatArray) -> tuple[FloatArray, FloatArray]:
    """base_from_flange for N configurations (N, J): rotations (N, 3, 3) and origins (N, 3), mm."""
    rotations, origins = frames(robot, joints)
    last = rotations[:, -1]
    return last @ robot.flange.rotation, origins[:, -1] + last @ np.asarray(robot.flange.origin)


def set_out(robot: Robot, links: tuple[FloatArray, FloatArray], moved: FloatArray) -> FloatArray:
    """How links at ``links``, as of ``frames``, set out where the joints of the chain (N, C, J) move, rad or mm, C ways
    at each: (J + 1, N, C, 6), rad about the axes of the base, and mm of what is at its origin.
    """
    rotations, origins = links
    axes = np.stack(
        [rotations[:, k + 1] @ np.asarray(joint.axis) for k, joint in enumerate(robot.joints)],
        axis=1,
    )
    sliding = np.array([joint.sliding for joint in robot.joints])[:, None]
    along = np.where(sliding, axes, cross(origins[:, 1:], axes))
    screws = np.concatenate([np.where(sliding, 0.0, axes), along], axis=2)
    found = np.zeros((len(robot.joints) + 1, *moved.shape[:2], 6))
    np.cumsum(
        moved.transpose(2, 0, 1)[..., None] * screws.swapaxes(0, 1)[:, :, None],
        axis=0,
        out=found[1:],
    )
    return found


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


@lru_cache(maxsize=256)
def _parts(joints: tuple[Joint, ...]) -> FloatArray:
    """What of each joint's rotation stays, goes with the cosine of its angle and with the sine: (J, 3, 9)."""
    return np.stack([_part(joint) for joint in joints])


def _part(joint: Joint) -> FloatArray:
    turn = joint.previous_from_joint.rotation
    turned = turn @ about(np.asarray(joint.axis))
    return (np.stack([turn, 0 * turn, 0 * turn]) if joint.sliding else turned).reshape(3, 9)
