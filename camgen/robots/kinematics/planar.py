"""Inverse kinematics of SCARA arms and of three slides in closed form."""

from __future__ import annotations

import numpy as np

from camgen.geometry.rotations import measure_rolls
from camgen.model.pose import FloatArray
from camgen.robots.kinematics.arms import Gantry, Scara
from camgen.robots.kinematics.wrists import bend_elbow, measure_beyond

#: rad that a tool may lean from the orientation of the robot: the digits of quaternions and joint
#: values in programs.
LEAN = 1e-5


def scara_angles(arm: Scara, rotations: FloatArray, origins: FloatArray) -> FloatArray:
    """Theta (N, 2, 4) for poses of the flange (N, 3, 3), (N, 3), rad and mm.

    The first branch has the elbow to the right of the arm (axis 2 > 0, seen from above), the second
    one to the left. They are nan out of reach, or if the flange does not point along axis 4.
    """
    yaw, x, y, z = _axis_four(arm, rotations, origins)
    bend = bend_elbow(x, y, arm.l1, arm.l2)
    bend[measure_lean(arm, rotations) > LEAN] = np.nan
    elbow = bend[:, None] * np.array([1.0, -1.0])
    lead = np.arctan2(arm.l2 * np.sin(elbow), arm.l1 + arm.l2 * np.cos(elbow))
    theta1 = np.arctan2(y, x)[:, None] - lead
    height = np.broadcast_to(z[:, None], elbow.shape)
    return np.stack([theta1, elbow, height, yaw[:, None] - theta1 - elbow], axis=2)


def _axis_four(arm: Scara, rotations: FloatArray, origins: FloatArray) -> tuple[FloatArray, ...]:
    """The angle of the flange about axis 4, rad, and x, y of axis 4 and z of the flange, mm.

    They are in the frame of the arm, (N,) each.
    """
    yaw = measure_rolls(arm.base_from_arm.rotation.T @ rotations @ arm.arm_from_flange.rotation.T)
    x, y, z = ((origins - arm.base_from_arm.origin) @ arm.base_from_arm.rotation).T
    ahead, side, _ = arm.arm_from_flange.origin
    c, s = np.cos(yaw), np.sin(yaw)
    return yaw, x - c * ahead + s * side, y - s * ahead - c * side, z


def scara_shortfall(arm: Scara, rotations: FloatArray, origins: FloatArray) -> FloatArray:
    """Distance (N,) by which poses are out of reach sideways, mm; 0 within reach.

    Joint limits are ignored.
    """
    _, x, y, _ = _axis_four(arm, rotations, origins)
    return measure_beyond(np.hypot(x, y), arm.l1, arm.l2).clip(0.0)


def gantry_values(arm: Gantry, rotations: FloatArray, origins: FloatArray) -> FloatArray:
    """Slide values (N, 1, 3), mm; nan if the spindle does not point along its axis.

    The rotation of the spindle is free.
    """
    slides = np.linalg.solve(arm.directions, (origins - arm.base_from_flange.origin).T).T
    return np.where((measure_lean(arm, rotations) > LEAN)[:, None], np.nan, slides)[:, None]


def measure_lean(arm: Scara | Gantry, rotations: FloatArray) -> FloatArray:
    """Angle (N,) between the flange and axis 4, or between the spindle and its axis, rad."""
    if isinstance(arm, Gantry):
        held = arm.base_from_flange.rotation
    else:
        held = arm.base_from_arm.rotation @ arm.arm_from_flange.rotation
    z, goal = held[:, 2], rotations[:, :, 2]
    return np.asarray(np.arctan2(np.linalg.norm(np.cross(goal, z), axis=1), goal @ z))
