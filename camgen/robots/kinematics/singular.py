"""Distances of joint values from singularities, where an arm loses a direction of motion."""

from __future__ import annotations

import numpy as np

from camgen.model.pose import FloatArray
from camgen.robots.kinematics import spherical, three_parallel
from camgen.robots.kinematics.arms import Gantry, Scara
from camgen.robots.kinematics.forward import compute_jacobian
from camgen.robots.kinematics.joint_limits import compute_theta
from camgen.robots.kinematics.three_parallel import ThreeParallel
from camgen.robots.models import Kind, Robot

#: Names of the columns of `measure_singularity_distance`, by the kind of the robot.
SINGULARITIES: dict[Kind, tuple[str, ...]] = {
    "spherical-wrist": ("wrist above axis 1", "elbow straight", "wrist straight"),
    "three-parallel": ("wrist beside axis 1", "elbow straight", "axes 4 and 6 parallel"),
    "scara": ("elbow straight",),
    "cartesian": (),
    "serial": ("arm stretched or axes in line",),
}


def measure_singularity_distance(robot: Robot, joints: FloatArray) -> FloatArray:
    """Distances of joint values (..., J) from each kind of singularity, rad (..., K); nan for nan.

    For an arm without a closed form it is the smallest singular value of its Jacobian, with lengths
    divided by the mean lever.
    """
    if isinstance(robot.arm, Gantry):
        return np.empty((*joints.shape[:-1], 0))
    if isinstance(robot.arm, Scara):
        return np.asarray(
            np.arcsin(np.abs(np.sin(compute_theta(robot, robot.arm, joints)[..., 1:2])))
        )
    if isinstance(robot.arm, ThreeParallel):
        theta = compute_theta(robot, robot.arm, joints)
        return three_parallel.measure_singularities(robot.arm, theta)
    if robot.arm:
        return spherical.measure_singularities(robot.arm, compute_theta(robot, robot.arm, joints))
    flat = joints.reshape(-1, joints.shape[-1])
    is_finite = np.isfinite(flat).all(axis=1)
    smallest = np.full(len(flat), np.nan)
    moved, _, _ = compute_jacobian(robot, flat[is_finite])
    moved[:, :3] /= robot.lever
    smallest[is_finite] = np.linalg.svd(moved, compute_uv=False)[:, -1]
    return smallest.reshape(*joints.shape[:-1], 1)
