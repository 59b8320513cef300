"""Joints of SCARA arms and of three slides in closed form."""

from __future__ import annotations

import numpy as np

from camgen.geometry.rotations import turns_about_z
from camgen.model.pose import FloatArray
from camgen.robots.kinematics.arms import Gantry, Scara

#: The tool can lean by so much (rad) against what the robot holds: the digits of a quaternion, or of joint values, that
#: a program states. It can be so far (mm) out of reach: rounding.
LEAN, _REACH = 1e-5, 1e-9


def scara_angles(arm: Scara, rotations: FloatArray, origins: FloatArray) -> FloatArray:
    """Theta (N, 2, 4) of base_from_flange (N, 3, 3), (N, 3): elbow to the right of the arm first (axis 2 > 0, seen from
    above), then to the left. nan where out of reach or where the flange does not point along axis 4.
    """
    yaw, x, y, z = _axis_four(arm, rotations, origins)
    bend = np.arccos(
        np.clip((x**2 + y**2 - arm.l1**2 - arm.l2**2) / (2 * arm.l1 * arm.l2), -1.0, 1.0)
    )
    lost = (scara_shortfall(arm, rotations, origins) > _REACH) | (scara_lean(arm, rotations) > LEAN)
    elbow = np.where(lost, np.nan, bend)[:, None] * np.array([1.0, -1.0])
    theta1 = np.arctan2(y, x)[:, None] - np.arctan2(
        arm.l2 * np.sin(elbow), arm.l1 + arm.l2 * np.cos(elbow)
    )
    height = np.broadcast_to(z[:, None], elbow.shape)
    return np.stack([theta1, elbow, height, yaw[:, None] - theta1 - elbow], axis=2)


def _axis_four(arm: Scara, rotations: FloatArray, origins: FloatArray) -> tuple[FloatArray, ...]:
    """The turn of the flange about axis 4, and where axis 4 and the height of the flange are in the arm's frame."""
    turn = arm.base_from_arm.rotation.T @ rotations @ arm.arm_from_flange.rotation.T
    yaw = turns_about_z(turn)
    x, y, z = ((origins - arm.base_from_arm.origin) @ arm.base_from_arm.rotation).T
    ahead, side, _ = arm.arm_from_flange.origin
    c, s = np.cos(yaw), np.sin(yaw)
    return yaw, x - c * ahead + s * side, y - s * ahead - c * side, z


def scara_shortfall(arm: Scara, rotations: FloatArray, origins: FloatArray) -> FloatArray:
    """Mm by which N poses are out of reach sideways (N,), joint limits aside; 0: within reach."""
    _, x, y, _ = _axis_four(arm, rotations, origins)
    distance = np.hypot(x, y)
    return np.asarray(
        np.maximum(distance - (arm.l1 + arm.l2), abs(arm.l1 - arm.l2) - distance).clip(0.0)
    )


def scara_lean(arm: Scara, rotations: FloatArray) -> FloatArray:
    """Rad by which the flange leans against axis 4 (N,)."""
    return _lean(arm.base_from_arm.rotation @ arm.arm_from_flange.rotation, rotations)


def gantry_values(arm: Gantry, rotations: FloatArray, origins: FloatArray) -> FloatArray:
    """Slides (N, 1, 3), mm; nan where the spindle does not point along its axis. Its own turn is free."""
    slides = np.linalg.solve(arm.directions, (origins - arm.base_from_flange.origin).T).T
    return np.where((gantry_lean(arm, rotations) > LEAN)[:, None], np.nan, slides)[:, None]


def gantry_lean(arm: Gantry, rotations: FloatArray) -> FloatArray:
    """Rad by which the spindle leans against its axis (N,)."""
    return _lean(arm.base_from_flange.rotation, rotations)


def _lean(held: FloatArray, rotations: FloatArray) -> FloatArray:
    """The angle between z of ``held`` and z of the rotations (N, 3, 3)."""
    z, wanted = held[:, 2], rotations[:, :, 2]
    return np.asarray(np.arctan2(np.linalg.norm(np.cross(wanted, z), axis=1), wanted @ z))
