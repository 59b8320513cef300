"""First guesses for six axes with a wrist that is nearly spherical.

Axis 6 passes the point where axes 4 and 5 meet. For a given angle of axis 6 that point is known,
and with it axes 1 to 5 in closed form, as if the wrist were spherical. These need another angle of
axis 6. Where the difference of both angles changes its sign there is a solution.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from camgen.model.pose import FloatArray
from camgen.robots.chain import make_zero_chain
from camgen.robots.kinematics import spherical
from camgen.robots.kinematics.arms import Spherical, find_resembling_arm
from camgen.robots.kinematics.joint_limits import compute_joints
from camgen.robots.models import Robot

#: Angles of axis 6 that are tried: two solutions within 3 deg of each other can be missed.
_STEPS = 120


def find_guesses(
    robot: Robot, rotations: FloatArray, origins: FloatArray, limit: int
) -> FloatArray:
    """Joint values (N, limit, J) near solutions for poses of the flange; nan for no guess.

    An arm of another build has no guesses.

    rotations, origins: base_from_flange, (N, 3, 3) and (N, 3), mm.
    """
    arm = find_resembling_arm(robot.joints, robot.flange)
    if arm is None:
        return np.full((len(origins), limit, len(robot.joints)), np.nan)
    steps = np.linspace(-math.pi, math.pi, _STEPS + 1)
    theta = _compute_angles(robot, arm, rotations, origins, steps)
    # Both postures of the wrist need angles of axis 6 that are half a turn apart. If one needs 0 up
    # to half a turn, the posture that needs exactly 0 is a solution.
    needed = np.remainder(theta[..., 5] + math.pi, math.tau) - math.pi
    theta[..., 5] = steps[:, None]
    is_first = (np.abs(needed[..., ::2]) < math.pi / 2)[..., None]
    chosen = np.where(is_first, theta[:, :, ::2], theta[:, :, 1::2])
    needed = np.remainder(needed[..., ::2] + math.pi / 2, math.pi) - math.pi / 2
    near = np.where(_are_near(needed)[..., None], chosen, np.nan).reshape(len(origins), -1, 6)
    order = np.argsort(np.isnan(near[:, :, 0]), axis=1, kind="stable")[:, :limit]
    return compute_joints(robot, arm, np.take_along_axis(near, order[..., None], axis=1))


def _are_near(needed: FloatArray) -> NDArray[np.bool_]:
    """Whether angles (N, K, 4) are next to a change of sign, on the nearer side of it."""
    is_near = np.zeros(needed.shape, dtype=bool)
    before, after = needed[:, :-1], needed[:, 1:]
    crosses = (before * after <= 0) & (np.abs(before - after) < math.pi / 2)
    is_nearer = np.abs(before) <= np.abs(after)
    is_near[:, :-1] |= crosses & is_nearer
    is_near[:, 1:] |= crosses & ~is_nearer
    return is_near


def _compute_angles(
    robot: Robot, arm: Spherical, rotations: FloatArray, origins: FloatArray, steps: FloatArray
) -> FloatArray:
    """The angles (N, K, 8, 6) of the arm for K angles of axis 6.

    The last column is the further angle of axis 6 that the others need.
    """
    zero = make_zero_chain(robot.joints, robot.flange)
    flange_from_wrist = arm.flange_from_wrist
    x, y, _ = (zero.base_from_flange @ flange_from_wrist).inverse().apply(zero.points[5])
    c, s = np.cos(steps), np.sin(steps)
    # The rotation back about axis 6, which passes through x, y.
    back = np.zeros((len(steps), 3, 3))
    back[:, 0, 0] = back[:, 1, 1] = c
    back[:, 0, 1], back[:, 1, 0], back[:, 2, 2] = s, -s, 1.0
    passes = np.array([x, y, 0.0])
    frame, centre = flange_from_wrist.rotation, np.asarray(flange_from_wrist.origin)
    turn = frame @ back @ frame.T
    shift = centre + (passes - back @ passes) @ frame.T - turn @ centre
    turned = rotations[:, None] @ turn
    places = origins[:, None] + (rotations[:, None] @ shift[..., None])[..., 0]
    theta = spherical.compute_angles(
        arm, turned.reshape(-1, 3, 3), places.reshape(-1, 3), np.zeros(6)
    )
    return theta.reshape(len(origins), len(steps), spherical.BRANCHES, 6)
