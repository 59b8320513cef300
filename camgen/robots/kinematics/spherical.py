"""Inverse kinematics of an arm with a spherical wrist in closed form, all eight branches.

The wrist centre fixes axes 1 to 3: it can be faced in two ways (shoulder), and the arm can bend in
two ways (elbow). The rest of the orientation is axes 4 to 6, in two ways (wrist). The formulas were
derived from the geometry in `Spherical`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from camgen.model.pose import FloatArray
from camgen.robots.kinematics.arms import Spherical
from camgen.robots.kinematics.wrists import (
    REACH,
    STRAIGHT_SINE,
    Wrists,
    bend_elbow,
    find_wrists,
    measure_beyond,
)

#: Branch: 4 with the wrist centre behind axis 1, + 2 with the elbow bent back (towards -x), + 1
#: with axis 5 < 0.
BRANCHES = 8


def measure_shortfall(arm: Spherical, rotations: FloatArray, origins: FloatArray) -> FloatArray:
    """Distance (N,) by which poses are out of reach, mm, at most 0 within; limits are ignored."""
    seen, x, z = _see(arm, rotations, origins)
    beyond = measure_beyond(np.hypot(x, z), arm.c2, math.hypot(arm.a2, arm.c3))
    return np.asarray(np.maximum(beyond.min(axis=1).clip(0.0), seen.too_near))


def _see(
    arm: Spherical, rotations: FloatArray, origins: FloatArray
) -> tuple[Wrists, FloatArray, FloatArray]:
    """The wrists for poses of the flange, and x (N, 2) and z (N, 1) of their centres at axis 2."""
    centres = origins + rotations @ np.asarray(arm.flange_from_wrist.origin)
    seen = find_wrists(arm.base_from_arm, arm.b, centres)
    return seen, seen.ahead - arm.a1, seen.height - arm.c1


def compute_angles(
    arm: Spherical, rotations: FloatArray, origins: FloatArray, near: FloatArray
) -> FloatArray:
    """Theta (N, 8, 6) for poses of the flange (N, 3, 3), (N, 3), rad; nan out of reach.

    near: theta (N, 8, 6), or broadcastable to it, from which axis 1 is kept if the wrist centre is
        above it, and axis 4 if axis 5 is straight.
    """
    count = len(origins)
    near = np.broadcast_to(near, (count, BRANCHES, 6))
    seen, x, z = _see(arm, rotations, origins)
    theta = np.empty((count, 2, 2, 2, 6))  # shoulder, elbow, wrist
    free = np.where(np.isfinite(near[:, ::4, 0]), near[:, ::4, 0], [0.0, math.pi])
    theta1 = np.where(seen.on_axis[:, None], free, seen.theta1)
    psi, fore = math.atan2(arm.a2, arm.c3), math.hypot(arm.a2, arm.c3)
    bend = bend_elbow(x, z, arm.c2, fore)
    bend[seen.too_near > REACH] = np.nan
    elbow = np.stack([bend, -bend], axis=2)
    tilt = np.arctan2(x, z)[:, :, None]
    theta2 = tilt - np.arctan2(fore * np.sin(elbow), arm.c2 + fore * np.cos(elbow))
    theta[..., 0] = theta1[:, :, None, None]
    theta[..., 1] = theta2[..., None]
    theta[..., 2] = (elbow - psi)[..., None]
    turn = arm.base_from_arm.rotation.T @ rotations @ arm.flange_from_wrist.rotation
    _wrist(theta, turn, near[:, ::2, 3].reshape(count, 2, 2))
    return theta.reshape(count, BRANCHES, 6)


def _wrist(theta: FloatArray, turn: FloatArray, keep: FloatArray) -> None:
    """Set axes 4 to 6 in `theta` (N, 2, 2, 2, 6).

    turn: arm_from_wrist (N, 3, 3).
    keep: (N, 2, 2) theta 4 for a straight axis 5.
    """
    # The columns are x, y and z of the wrist.
    (ux, uy, uz), (vx, vy, vz), (wx, wy, wz) = turn.transpose(2, 1, 0)[..., None, None]
    c1, s1 = np.cos(theta[:, :, :, 0, 0]), np.sin(theta[:, :, :, 0, 0])
    at23 = theta[:, :, :, 0, 1] + theta[:, :, :, 0, 2]
    c, s = np.cos(at23), np.sin(at23)
    # z of the wrist in the frame of the forearm, whose axes are x (c1 c, s1 c, -s), y (-s1, c1, 0)
    # and z (c1 s, s1 s, c).
    ahead, side = c1 * wx + s1 * wy, c1 * wy - s1 * wx
    x, z = c * ahead - s * wz, s * ahead + c * wz
    straight = np.hypot(x, side) < STRAIGHT_SINE
    theta4 = np.where(straight, np.where(np.isfinite(keep), keep, 0.0), np.arctan2(side, x))
    c4, s4 = np.cos(theta4), np.sin(theta4)
    # Axis 6 is computed together with axis 4, so that their sum is exact for a nearly straight axis
    # 5.
    across_u = c4 * (c1 * uy - s1 * ux) - s4 * (c * (c1 * ux + s1 * uy) - s * uz)
    across_v = c4 * (c1 * vy - s1 * vx) - s4 * (c * (c1 * vx + s1 * vy) - s * vz)
    theta5, theta6 = np.arctan2(c4 * x + s4 * side, z), np.arctan2(across_u, across_v)
    theta[:, :, :, 0, 3:] = np.stack([theta4, theta5, theta6], axis=-1)
    theta[:, :, :, 1, 3:] = np.stack([theta4 + math.pi, -theta5, theta6 + math.pi], axis=-1)


def find_branch(arm: Spherical, theta: FloatArray) -> NDArray[np.int64]:
    """The branch of theta (..., 6), see `BRANCHES`."""
    fore, psi = math.hypot(arm.a2, arm.c3), math.atan2(arm.a2, arm.c3)
    elbow = theta[..., 2] + psi
    ahead = arm.a1 + arm.c2 * np.sin(theta[..., 1]) + fore * np.sin(theta[..., 1] + elbow)
    flags = 4 * (ahead < 0) + 2 * (np.sin(elbow) < 0) + (np.sin(theta[..., 4]) < 0)
    return np.asarray(flags, dtype=np.int64)


def measure_singularities(arm: Spherical, theta: FloatArray) -> FloatArray:
    """Distances of theta (..., 6) from the three singularities, rad (..., 3).

    Shoulder: wrist centre above axis 1, as the angle under which the straight arm would see it.
    Elbow: straight or folded. Wrist: axis 5 straight.
    """
    fore, psi = math.hypot(arm.a2, arm.c3), math.atan2(arm.a2, arm.c3)
    elbow = theta[..., 2] + psi
    ahead = arm.a1 + arm.c2 * np.sin(theta[..., 1]) + fore * np.sin(theta[..., 1] + elbow)
    # Stored one after the other, the smallest of the three is found in a fraction of the time.
    sines = np.stack([ahead / (arm.c2 + fore), np.sin(elbow), np.sin(theta[..., 4])])
    return np.moveaxis(np.arcsin(np.clip(np.abs(sines), 0.0, 1.0)), 0, -1)
