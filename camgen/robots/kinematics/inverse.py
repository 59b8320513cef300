"""Inverse kinematics: joint values of all branches for poses of the flange."""

from __future__ import annotations

import math

import numpy as np

from camgen.model.pose import FloatArray
from camgen.robots.kinematics import iterative as damped
from camgen.robots.kinematics import planar as flat
from camgen.robots.kinematics import spherical, three_parallel
from camgen.robots.kinematics.arms import Gantry, Scara
from camgen.robots.kinematics.joint_limits import (
    compute_joints,
    compute_theta,
    invert_coupling,
    wrap_joints,
)
from camgen.robots.kinematics.three_parallel import ThreeParallel
from camgen.robots.models import Robot


def compute_solutions(
    robot: Robot, rotations: FloatArray, origins: FloatArray, near: FloatArray | None = None
) -> FloatArray:
    """The joint values (N, B, J) of all branches for poses of the flange, nan for no solution.

    rotations, origins: base_from_flange, (N, 3, 3) and (N, 3), mm.
    near: (J,) to (N, B, J) joint values from which a joint is kept that a pose leaves free: axis 4
        with axis 5 straight, axis 1 with the wrist above it. Without it the angle of axis 4 is 0,
        and axis 1 is 0 facing the wrist and half a turn with the back to it.

    The number of branches B is 8 for spherical wrists, in the order of `spherical.BRANCHES`, and
    for three parallel axes (`three_parallel.BRANCHES`), 2 for SCARA and 1 for slides. For other
    arms the first `damped.SEEDS` solutions are returned. Only the reach counts, and
    `joint_limits.are_within_limits` tests the limits. A revolute joint is given within half a turn
    of the middle of its limits, and `joint_limits.list_turn_counts` has the other turn counts.
    """
    rotations = np.asarray(rotations, dtype=np.float64)
    origins = np.asarray(origins, dtype=np.float64)
    arm = robot.arm
    if isinstance(arm, Gantry):
        return flat.gantry_values(arm, rotations, origins)
    if arm is None:
        return wrap_joints(robot, damped.solve(robot, rotations, origins))
    if isinstance(arm, Scara):
        return compute_joints(robot, arm, flat.scara_angles(arm, rotations, origins))
    kept = np.full(len(robot.joints), np.nan) if near is None else near
    theta = compute_theta(robot, arm, kept)
    if isinstance(arm, ThreeParallel):
        return compute_joints(
            robot, arm, three_parallel.compute_angles(arm, rotations, origins, theta)
        )
    return compute_joints(robot, arm, spherical.compute_angles(arm, rotations, origins, theta))


def find_nearest(
    robot: Robot, rotations: FloatArray, origins: FloatArray, guess: FloatArray
) -> FloatArray:
    """The joint values for each pose that are nearest to `guess` (N, J); nan for no solution.

    The joint that differs most counts. Whole turns are included, and limits are ignored.
    """
    if robot.arm is None:
        return damped.refine(robot, rotations, origins, guess)
    solutions = compute_solutions(robot, rotations, origins, guess[:, None])
    change = (solutions - guess[:, None]) @ robot.coupling.T
    change -= np.where(robot.revolute, np.rint(change / math.tau) * math.tau, 0.0)
    largest = np.abs(change).max(axis=2)
    best = np.where(np.isnan(largest), math.inf, largest).argmin(axis=1)
    return np.asarray(guess + change[np.arange(len(guess)), best] @ invert_coupling(robot).T)
