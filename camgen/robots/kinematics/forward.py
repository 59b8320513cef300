"""Forward kinematics: frames of the links and the flange, for many joint values at once."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from camgen.geometry.rotations import compute_rotation_terms
from camgen.geometry.vectors import cross
from camgen.model.pose import FloatArray
from camgen.robots.chain import Joint
from camgen.robots.models import Robot


def compute_link_frames(robot: Robot, joints: FloatArray) -> tuple[FloatArray, FloatArray]:
    """base_from_link of all links: rotations (N, J + 1, 3, 3) and origins (N, J + 1, 3), mm.

    Link 0 is the base, link k moves with joint k.

    joints: (N, J) joint values of the controller, rad or mm.
    """
    joints = np.asarray(joints, dtype=np.float64)
    serial = (joints @ robot.coupling.T).T
    count, joint_count = len(joints), len(robot.joints)
    # The rotations of all joints together take a third of the time. They are stored link by link.
    factors = np.empty((joint_count, count, 3))
    factors[..., 0] = 1.0
    np.cos(serial, out=factors[..., 1])
    np.sin(serial, out=factors[..., 2])
    parts, places = _split_joints(robot.joints)
    turns = (factors @ parts).reshape(joint_count, count, 3, 3)
    rotations = np.empty((joint_count + 1, count, 3, 3))
    origins = np.empty((joint_count + 1, count, 3))
    rotations[0], rotations[1], origins[0] = np.eye(3), turns[0], 0.0
    for k, (joint, place) in enumerate(zip(robot.joints, places, strict=True)):
        if joint.sliding:
            along = joint.previous_from_joint.rotation @ np.asarray(joint.axis)
            moved = (rotations[k] @ (place + serial[k][:, None] * along)[..., None])[..., 0]
        else:
            moved = (rotations[k].reshape(-1, 3) @ place).reshape(-1, 3)
        np.add(origins[k], moved, out=origins[k + 1])
        if k > 0:
            np.matmul(rotations[k], turns[k], out=rotations[k + 1])
    return rotations.swapaxes(0, 1), origins.swapaxes(0, 1)


def compute_flange(robot: Robot, joints: FloatArray) -> tuple[FloatArray, FloatArray]:
    """base_from_flange at joint values (N, J): rotations (N, 3, 3) and origins (N, 3), mm."""
    rotations, origins = compute_link_frames(robot, joints)
    last = rotations[:, -1]
    return last @ robot.flange.rotation, origins[:, -1] + last @ np.asarray(robot.flange.origin)


def compute_velocities(
    robot: Robot, links: tuple[FloatArray, FloatArray], moved: FloatArray
) -> FloatArray:
    """The velocities of links for changes of the joint values, (J + 1, N, C, 6).

    Columns: rad about the axes of the base, and mm of the point of the link at its origin.

    links: frames of the links, see `compute_link_frames`.
    moved: (N, C, J) changes of the values of the serial chain, C at each frame, rad or mm.
    """
    rotations, origins = links
    axes = np.stack(
        [rotations[:, k + 1] @ np.asarray(joint.axis) for k, joint in enumerate(robot.joints)],
        axis=1,
    )
    revolute = robot.revolute[:, None]
    along = np.where(revolute, cross(origins[:, 1:], axes), axes)
    screws = np.concatenate([np.where(revolute, axes, 0.0), along], axis=2)
    velocities = np.zeros((len(robot.joints) + 1, *moved.shape[:2], 6))
    by_joint = moved.transpose(2, 0, 1)[..., None] * screws.swapaxes(0, 1)[:, :, None]
    np.cumsum(by_joint, axis=0, out=velocities[1:])
    return velocities


def compute_jacobian(robot: Robot, joints: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The Jacobian of the flange (N, 6, J), and base_from_flange, see `flange`.

    The rows of the Jacobian are mm and rad of the base frame, its columns are joint values of the
    controller.
    """
    rotations, origins = compute_link_frames(robot, joints)
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
def _split_joints(joints: tuple[Joint, ...]) -> tuple[FloatArray, FloatArray]:
    """The parts of joint rotations that are constant and that go with cosine and sine (J, 3, 9).

    Also the origins of the joints in the frames of the previous ones (J, 3), mm.
    """
    parts = []
    for joint in joints:
        turn = joint.previous_from_joint.rotation
        constant = np.stack([turn, 0 * turn, 0 * turn])
        split = constant if joint.sliding else turn @ compute_rotation_terms(np.asarray(joint.axis))
        parts.append(split.reshape(3, 9))
    return np.stack(parts), np.array([joint.previous_from_joint.origin for joint in joints])
