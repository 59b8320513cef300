"""From flange poses to joints: every branch."""

from __future__ import annotations

import math

import numpy as np

from camgen.model.pose import FloatArray
from camgen.robots.kinematics import iterative as damped
from camgen.robots.kinematics import planar as flat
from camgen.robots.kinematics import spherical, three_parallel
from camgen.robots.kinematics.arms import Gantry, Scara
from camgen.robots.kinematics.joint_limits import joints_of, theta_of, uncoupling, wrap
from camgen.robots.kinematics.three_parallel import ThreeParallel
from camgen.robots.models import Robot


def inverse(
    robot: Robot, rotations: FloatArray, origins: FloatArray, near: FloatArray | None = None
) -> FloatArray:
    """The controller's joint values (N, B, J) that bring the flange to base_from_flange (N, 3, 3), (N, 3), mm.

    B: 8 for spherical wrists (``spherical.BRANCHES`` says in which order) and for three parallel
    axes (``three_parallel.BRANCHES``), 2 for SCARA, 1 for slides,
    ``damped.SEEDS`` for others, found first. nan: no solution, by reach alone;
    ``joint_limits.within`` knows the limits. A turning joint is given within half a turn of the
    middle of its limits; ``joint_limits.copies`` adds the rest.
    Where a pose leaves a joint free (axis 5 straight, wrist above axis 1) it is taken from ``near``,
    (J,) to (N, B, J); without it the angle of axis 4 is 0, and
    that of axis 1 is 0 facing the wrist and half a turn with the back to it.
    """
    rotations, origins = (
        np.asarray(rotations, dtype=np.float64),
        np.asarray(origins, dtype=np.float64),
    )
    arm = robot.arm
    if isinstance(arm, Gantry):
        return flat.gantry_values(arm, rotations, origins)
    if arm is None:
        return wrap(robot, damped.solve(robot, rotations, origins))
    if isinstance(arm, Scara):
        return joints_of(robot, arm, flat.scara_angles(arm, rotations, origins))
    kept = np.full(len(robot.joints), np.nan) if near is None else near
    theta = theta_of(robot, arm, kept)
    if isinstance(arm, ThreeParallel):
        return joints_of(robot, arm, three_parallel.angles(arm, rotations, origins, theta))
    return joints_of(robot, arm, spherical.angles(arm, rotations, origins, theta))


def nearest(
    robot: Robot, rotations: FloatArray, origins: FloatArray, guess: FloatArray
) -> FloatArray:
    """Of the joint values for each pose (N, 3, 3), (N, 3), whole turns included, those nearest to ``guess`` (N, J), by
    the joint that differs most: (N, J); nan: none. Limits aside.
    """
    if robot.arm is None:
        return damped.refine(robot, rotations, origins, guess)
    found = inverse(robot, rotations, origins, guess[:, None])
    apart = (found - guess[:, None]) @ robot.coupling.T
    turning = np.array([not joint.sliding for joint in robot.joints])
    apart -= np.where(turning, np.rint(apart / math.tau) * math.tau, 0.0)
    most = np.abs(apart).max(axis=2)
    best = np.where(np.isnan(most), math.inf, most).argmin(axis=1)
    return np.asarray(guess + apart[np.arange(len(guess)), best] @ uncoupling(robot).T)
