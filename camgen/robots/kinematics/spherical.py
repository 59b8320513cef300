"""Joints of an arm with a spherical wrist in closed form, all eight branches.

The wrist centre fixes axes 1 to 3: two ways to face it (shoulder), two to bend (elbow). What is left of the orientation
is axes 4 to 6, in two ways (wrist). Derived anew from the geometry in ``Spherical``.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.model.pose import FloatArray
from camgen.robots.kinematics.arms import Spherical

#: Branch index: 4 with the wrist centre behind axis 1, + 2 with the elbow bent back (towards -x), + 1 with axis 5 < 0.
BRANCHES = 8
#: mm: so much beyond its reach the arm counts as straight. Sine of axis 5, and mm of the wrist centre beside axis 1,
#: below which axes 4 and 1 are free.
_REACH, _STRAIGHT_SINE, _OVER = 1e-9, 1e-9, 1e-9


class Wrists(Struct, frozen=True, eq=False):
    """N wrist centres seen from the arm. x, z: from axis 2, (N, 2) for facing it and for the back to it. theta1: (N,
    2). beside: mm by which it is too near axis 1 for the arm's side offset (N,). over: where it is on axis 1 and theta1
    is free (N,).
    """

    x: FloatArray
    z: FloatArray
    theta1: FloatArray
    beside: FloatArray
    over: NDArray[np.bool_]


def wrists(arm: Spherical, rotations: FloatArray, origins: FloatArray) -> Wrists:
    """The wrist centres of base_from_flange (N, 3, 3), (N, 3)."""
    place = np.asarray(arm.flange_from_wrist.origin)
    centre = (origins + rotations @ place - arm.base_from_arm.origin) @ arm.base_from_arm.rotation
    x, y, z = centre.T
    distance = np.hypot(x, y)
    ahead = np.sqrt(np.maximum(distance**2 - arm.b**2, 0.0))
    towards, lead = np.arctan2(y, x), np.arctan2(arm.b, ahead)
    return Wrists(
        x=np.stack([ahead - arm.a1, -ahead - arm.a1], axis=1),
        z=np.stack([z - arm.c1] * 2, axis=1),
        theta1=np.stack([towards - lead, towards + lead - math.pi], axis=1),
        beside=np.maximum(abs(arm.b) - distance, 0.0),
        over=distance < _OVER,
    )


def shortfall(arm: Spherical, rotations: FloatArray, origins: FloatArray) -> FloatArray:
    """Mm by which N poses are out of reach (N,), joint limits aside; 0 or less: within reach."""
    seen = wrists(arm, rotations, origins)
    return np.asarray(np.maximum(_beyond(arm, seen).min(axis=1).clip(0.0), seen.beside))


def _beyond(arm: Spherical, seen: Wrists) -> FloatArray:
    """Mm by which the wrist centre is too far or too near for the elbow, (N, 2) as in ``Wrists``."""
    distance, fore = np.hypot(seen.x, seen.z), math.hypot(arm.a2, arm.c3)
    return np.asarray(np.maximum(distance - (arm.c2 + fore), abs(arm.c2 - fore) - distance))


def angles(
    arm: Spherical, rotations: FloatArray, origins: FloatArray, near: FloatArray
) -> FloatArray:
    """Theta (N, 8, 6) of base_from_flange (N, 3, 3), (N, 3); nan where out of reach.

    near: theta (N, 8, 6) or broadcastable to it; axis 1 is kept from it where the wrist centre is above axis 1, and
    axis 4 where axis 5 is straight.
    """
    count = len(origins)
    near = np.broadcast_to(near, (count, BRANCHES, 6))
    seen = wrists(arm, rotations, origins)
    theta = np.empty((count, 2, 2, 2, 6))  # shoulder, elbow, wrist
    free = np.where(np.isfinite(near[:, ::4, 0]), near[:, ::4, 0], [0.0, math.pi])
    theta1 = np.where(seen.over[:, None], free, seen.theta1)
    psi, fore = math.atan2(arm.a2, arm.c3), math.hypot(arm.a2, arm.c3)
    square = seen.x**2 + seen.z**2
    bend = np.arccos(np.clip((square - arm.c2**2 - fore**2) / (2 * arm.c2 * fore), -1.0, 1.0))
    bend = np.where((_beyond(arm, seen) > _REACH) | (seen.beside > _REACH)[:, None], np.nan, bend)
    elbow = np.stack([bend, -bend], axis=2)
    tilt = np.arctan2(seen.x, seen.z)[:, :, None]
    theta2 = tilt - np.arctan2(fore * np.sin(elbow), arm.c2 + fore * np.cos(elbow))
    theta[..., 0] = theta1[:, :, None, None]
    theta[..., 1] = theta2[..., None]
    theta[..., 2] = (elbow - psi)[..., None]
    turn = arm.base_from_arm.rotation.T @ rotations @ arm.flange_from_wrist.rotation
    _wrist(theta, turn, near[:, ::2, 3].reshape(count, 2, 2))
    return theta.reshape(count, BRANCHES, 6)


def _wrist(theta: FloatArray, turn: FloatArray, keep: FloatArray) -> None:
    """Fills in axes 4 to 6. theta: (N, 2, 2, 2, 6). turn: arm_from_wrist (N, 3, 3). keep: theta 4 (N, 2, 2)."""
    (ux, uy, uz), (vx, vy, vz), (wx, wy, wz) = turn.transpose(2, 1, 0)[
        ..., None, None
    ]  # the columns: x, y and z of it
    c1, s1 = np.cos(theta[:, :, :, 0, 0]), np.sin(theta[:, :, :, 0, 0])
    at23 = theta[:, :, :, 0, 1] + theta[:, :, :, 0, 2]
    c, s = np.cos(at23), np.sin(at23)
    # z of the wrist in the forearm's frame, whose x is (c1 c, s1 c, -s), y (-s1, c1, 0) and z (c1 s, s1 s, c).
    ahead, side = c1 * wx + s1 * wy, c1 * wy - s1 * wx
    x, z = c * ahead - s * wz, s * ahead + c * wz
    straight = np.hypot(x, side) < _STRAIGHT_SINE
    theta4 = np.where(straight, np.where(np.isfinite(keep), keep, 0.0), np.arctan2(side, x))
    c4, s4 = np.cos(theta4), np.sin(theta4)
    # Axis 6 is read beside axis 4, not on its own: their sum stays exact where axis 5 is all but straight.
    across_u = c4 * (c1 * uy - s1 * ux) - s4 * (c * (c1 * ux + s1 * uy) - s * uz)
    across_v = c4 * (c1 * vy - s1 * vx) - s4 * (c * (c1 * vx + s1 * vy) - s * vz)
    theta5, theta6 = np.arctan2(c4 * x + s4 * side, z), np.arctan2(across_u, across_v)
    for k, values in ((3, theta4), (4, theta5), (5, theta6)):
        theta[:, :, :, 0, k] = values
    theta[:, :, :, 1, 3], theta[:, :, :, 1, 4], theta[:, :, :, 1, 5] = (
        theta4 + math.pi,
        -theta5,
        theta6 + math.pi,
    )


def branch(arm: Spherical, theta: FloatArray) -> NDArray[np.int64]:
    """The branch index of theta (..., 6)."""
    fore, psi = math.hypot(arm.a2, arm.c3), math.atan2(arm.a2, arm.c3)
    elbow = theta[..., 2] + psi
    ahead = arm.a1 + arm.c2 * np.sin(theta[..., 1]) + fore * np.sin(theta[..., 1] + elbow)
    flags = 4 * (ahead < 0) + 2 * (np.sin(elbow) < 0) + (np.sin(theta[..., 4]) < 0)
    return np.asarray(flags, dtype=np.int64)


def singularities(arm: Spherical, theta: FloatArray) -> FloatArray:
    """How far theta (..., 6) is from the three singularities, rad (..., 3): shoulder (wrist centre above axis 1, as the
    angle under which the straight arm would see it), elbow (straight or folded) and wrist (axis 5 straight).
    """
    fore, psi = math.hypot(arm.a2, arm.c3), math.atan2(arm.a2, arm.c3)
    elbow = theta[..., 2] + psi
    ahead = arm.a1 + arm.c2 * np.sin(theta[..., 1]) + fore * np.sin(theta[..., 1] + elbow)
    # One after the other in memory: the least of the three is found in a fraction of the time.
    sines = np.stack([ahead / (arm.c2 + fore), np.sin(elbow), np.sin(theta[..., 4])])
    return np.moveaxis(np.arcsin(np.clip(np.abs(sines), 0.0, 1.0)), 0, -1)
