"""First guesses for six axes whose wrist is not quite spherical: axis 6 passes the point where axes 4 and 5 meet.

For a given angle of axis 6 that point is known, and with it axes 1 to 5 in closed form, as if the wrist were spherical;
only axis 5 then asks for some other angle of axis 6. Where the difference changes sign there is a solution.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from camgen.model.pose import FloatArray
from camgen.robots.chain import at_zero
from camgen.robots.kinematics import spherical
from camgen.robots.kinematics.arms import Spherical, resembling
from camgen.robots.kinematics.joint_limits import joints_of
from camgen.robots.models import Robot

#: Angles of axis 6 that are tried: two solutions within 3 deg of each other can be missed.
_STEPS = 120


def guesses(robot: Robot, rotations: FloatArray, origins: FloatArray, most: int) -> FloatArray:
    """Joint values (N, most, J) near solutions for base_from_flange (N, 3, 3), (N, 3); nan where there are fewer, and
    altogether for an arm of another build.
    """
    arm = resembling(robot.joints, robot.flange)
    if arm is None:
        return np.full((len(origins), most, len(robot.joints)), np.nan)
    steps = np.linspace(-math.pi, math.pi, _STEPS + 1)
    theta = _at(robot, arm, rotations, origins, steps)
    # The two ways to turn the wrist ask for angles half a turn apart: where one asks for 0, modulo half a turn, the one
    # that asks for 0 indeed is a solution.
    asked = np.remainder(theta[..., 5] + math.pi, math.tau) - math.pi
    theta[..., 5] = steps[:, None]
    own = np.where(
        (np.abs(asked[..., ::2]) < math.pi / 2)[..., None], theta[:, :, ::2], theta[:, :, 1::2]
    )
    asked = np.remainder(asked[..., ::2] + math.pi / 2, math.pi) - math.pi / 2
    own = np.where(_near(asked)[..., None], own, np.nan).reshape(len(origins), -1, 6)
    order = np.argsort(np.isnan(own[:, :, 0]), axis=1, kind="stable")[:, :most]
    return joints_of(robot, arm, np.take_along_axis(own, order[..., None], axis=1))


def _near(asked: FloatArray) -> NDArray[np.bool_]:
    """Of the angles asked for (N, K, 4) those on the nearer side of a change of sign."""
    found = np.zeros(asked.shape, dtype=bool)
    before, after = asked[:, :-1], asked[:, 1:]
    crosses = (before * after <= 0) & (np.abs(before - after) < math.pi / 2)
    nearer = np.abs(before) <= np.abs(after)
    found[:, :-1] |= crosses & nearer
    found[:, 1:] |= crosses & ~nearer
    return found


def _at(
    robot: Robot, arm: Spherical, rotations: FloatArray, origins: FloatArray, steps: FloatArray
) -> FloatArray:
    """Angles (N, K, 8, 6) of the arm for K of axis 6; the last column is what axis 5 asks for beyond it."""
    zero = at_zero(robot.joints, robot.flange)
    flange_from_wrist = arm.flange_from_wrist
    x, y, _ = (zero.base_from_flange @ flange_from_wrist).inverse().apply(zero.points[5])
    c, s = np.cos(steps), np.sin(steps)
    back = np.zeros((len(steps), 3, 3))  # axis 6, which passes through x, y, turned back
    back[:, 0, 0] = back[:, 1, 1] = c
    back[:, 0, 1], back[:, 1, 0], back[:, 2, 2] = s, -s, 1.0
    passes = np.array([x, y, 0.0])
    frame, centre = flange_from_wrist.rotation, np.asarray(flange_from_wrist.origin)
    turn = frame @ back @ frame.T
    shift = centre + (passes - back @ passes) @ frame.T - turn @ centre
    every = rotations[:, None] @ turn
    places = origins[:, None] + (rotations[:, None] @ shift[..., None])[..., 0]
    theta = spherical.angles(arm, every.reshape(-1, 3, 3), places.reshape(-1, 3), np.zeros(6))
    return theta.reshape(len(origins), len(steps), spherical.BRANCHES, 6)
