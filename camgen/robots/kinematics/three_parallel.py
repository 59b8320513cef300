"""Joints in closed form of an arm whose axes 2, 3 and 4 are parallel, all eight branches.

Such are the arms of Universal Robots. Axis 6 meets axis 5, and axis 5 meets axis 4. The point where
axes 5 and 6 meet keeps its distance from the plane of the upper arm: this gives axis 1, in two ways
(shoulder). The direction of axis 6 then gives axis 5, in two ways (wrist), and axis 6. Axes 2, 3
and 4 are left as a chain in a plane, in two ways (elbow). The geometry is that of
K. P. Hawkins, Analytic inverse kinematics for the Universal Robots UR-5/UR-10 arms, 2013.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct

from camgen.model.pose import FloatArray, Pose, frozen
from camgen.robots.chain import AtZero
from camgen.robots.kinematics.wrists import (
    REACH,
    STRAIGHT_SINE,
    bend_elbow,
    find_wrists,
    measure_beyond,
)

#: Branch: 4 with the wrist behind axis 1, + 2 with axis 3 < 0, + 1 with axis 5 < 0.
BRANCHES = 8


class ThreeParallel(Struct, frozen=True, eq=False):
    """The geometry of such an arm.

    base_from_arm: frame with z along axis 1 and y along axis 2.
    a1, c1: x and z of axis 2, mm.
    c2, c3: distances of axes 2 and 3, and of axes 3 and 4, mm.
    c5: distance from axis 4 to axis 6 along axis 5, mm.
    b: y of the point where axes 5 and 6 meet, mm.
    signs, offsets: (6,) theta = signs * serial angle + offsets, rad.
    axis5, axis6: (3,) directions of axes 5 and 6 in the frame of the flange with joint 6 at 0.
    wrist: (3,) point where axes 5 and 6 meet, in the frame of the flange, mm.

    Angles theta 1 to 4 turn about axes 1 to 4, from z, so that upper arm, forearm and axis 5 point
    along z where they are 0. Theta 5 is the angle from axis 4 to axis 6.
    """

    base_from_arm: Pose
    a1: float
    c1: float
    c2: float
    c3: float
    c5: float
    b: float
    signs: FloatArray
    offsets: FloatArray
    axis5: FloatArray
    axis6: FloatArray
    wrist: FloatArray


def measure(zero: AtZero, base_from_arm: Pose, slack: float) -> ThreeParallel | None:
    """The geometry of a chain whose axes 2, 3 and 4 are parallel; None if axes 4, 5, 6 do not meet.

    base_from_arm: frame with z along axis 1 and y along axis 2.
    slack: largest distance of axes that meet, mm.
    """
    frame = base_from_arm.rotation
    points = (zero.points - np.asarray(base_from_arm.origin)) @ frame
    axes = zero.directions @ frame
    wrist = _meet(points[4], axes[4], points[5], axes[5], slack)
    hand = _meet(points[4], axes[4], points[3], axes[3], slack)
    if wrist is None or hand is None:
        return None
    upper, fore = (points[2] - points[1])[[0, 2]], (hand - points[2])[[0, 2]]
    lengths = np.hypot(*upper), np.hypot(*fore)
    if min(lengths) <= slack:
        return None
    angles = [math.atan2(*part) for part in (upper, fore, axes[4][[0, 2]])]
    along, sideways = np.array([0.0, 1.0, 0.0]), np.cross(axes[4], [0.0, 1.0, 0.0])
    theta5 = math.atan2(float(axes[5] @ sideways), float(axes[5] @ along))
    flange = base_from_arm.inverse() @ zero.base_from_flange
    signs = np.sign([axes[0][2], axes[1][1], axes[2][1], axes[3][1], 1.0, 1.0])
    offsets = [0.0, angles[0], angles[1] - angles[0], angles[2] - angles[1], theta5, 0.0]
    return ThreeParallel(
        base_from_arm=base_from_arm,
        a1=float(points[1][0]),
        c1=float(points[1][2]),
        c2=float(lengths[0]),
        c3=float(lengths[1]),
        c5=float((wrist - hand) @ axes[4]),
        b=float(wrist[1]),
        signs=frozen(signs),
        offsets=frozen(offsets),
        axis5=frozen(flange.rotation.T @ axes[4]),
        axis6=frozen(flange.rotation.T @ axes[5]),
        wrist=frozen(flange.rotation.T @ (wrist - np.asarray(flange.origin))),
    )


def _meet(
    first: FloatArray, along: FloatArray, second: FloatArray, other: FloatArray, slack: float
) -> FloatArray | None:
    """The point of two lines at right angles where they meet, None for lines that do not.

    first, along: a point of the one line and its direction.
    second, other: a point of the other line and its direction.
    """
    offset = second - first
    point = first + along * float(offset @ along)
    nearest = second - other * float(offset @ other)
    return point if np.linalg.norm(point - nearest) <= slack else None


def compute_angles(
    arm: ThreeParallel, rotations: FloatArray, origins: FloatArray, near: FloatArray
) -> FloatArray:
    """Theta (N, 8, 6) of flange poses (N, 3, 3), (N, 3); nan for a pose out of reach.

    near: theta (N, 8, 6) or broadcastable to it, from which axis 6 is kept if axis 5 is straight.
    """
    count = len(origins)
    kept = np.broadcast_to(near, (count, BRANCHES, 6))[:, :, 5].reshape(count, 2, 2, 2)
    seen = find_wrists(arm.base_from_arm, arm.b, origins + rotations @ arm.wrist)
    theta = np.full((count, 2, 2, 2, 6), np.nan)  # shoulder, elbow, wrist
    cos1, sin1 = np.cos(seen.theta1), np.sin(seen.theta1)
    nothing = np.zeros_like(cos1)
    ahead = np.stack([cos1, sin1, nothing], axis=-1) @ arm.base_from_arm.rotation.T
    axis4 = np.stack([-sin1, cos1, nothing], axis=-1) @ arm.base_from_arm.rotation.T
    up = arm.base_from_arm.rotation[:, 2]
    axis6 = (rotations @ arm.axis6)[:, None]
    normal = np.cross(axis4, np.broadcast_to(axis6, axis4.shape))
    sine = np.linalg.norm(normal, axis=-1)
    cosine = (axis4 * axis6).sum(axis=-1)
    for wrist, sign in enumerate((1.0, -1.0)):
        axis5 = sign * normal / np.maximum(sine, STRAIGHT_SINE)[..., None]
        straight = sine < STRAIGHT_SINE
        if straight.any():
            free = np.where(np.isfinite(kept[:, :, 0, wrist]), kept[:, :, 0, wrist], 0.0)
            axis5[straight] = _turn_axis5(arm, rotations, free)[straight]
        at_flange = np.einsum("nji,nsj->nsi", rotations, axis5)
        theta6 = -np.arctan2(np.cross(arm.axis5, at_flange) @ arm.axis6, at_flange @ arm.axis5)
        sum4 = np.arctan2((axis5 * ahead).sum(axis=-1), axis5 @ up)
        x = seen.ahead - arm.c5 * np.sin(sum4) - arm.a1
        z = seen.height - arm.c5 * np.cos(sum4) - arm.c1
        theta3 = bend_elbow(x, z, arm.c2, arm.c3)
        theta3[seen.too_near > REACH] = np.nan
        for elbow, turned in enumerate((theta3, -theta3)):
            across = arm.c3 * np.sin(turned)
            theta2 = np.arctan2(x, z) - np.arctan2(across, arm.c2 + arm.c3 * np.cos(turned))
            solution = theta[:, :, elbow, wrist]
            solution[..., 0], solution[..., 1], solution[..., 2] = seen.theta1, theta2, turned
            solution[..., 3] = sum4 - theta2 - turned
            solution[..., 4] = sign * np.arctan2(sine, cosine)
            solution[..., 5] = theta6
            solution[np.isnan(turned)] = np.nan
    return theta.reshape(count, BRANCHES, 6)


def _turn_axis5(arm: ThreeParallel, rotations: FloatArray, theta6: FloatArray) -> FloatArray:
    """Direction of axis 5 (N, S, 3), in the base, for given angles of axis 6 (N, S)."""
    cos, sin = np.cos(-theta6)[..., None], np.sin(-theta6)[..., None]
    at_flange = cos * arm.axis5 + sin * np.cross(arm.axis6, arm.axis5)
    return np.asarray(np.einsum("nij,nsj->nsi", rotations, at_flange))


def measure_shortfall(arm: ThreeParallel, rotations: FloatArray, origins: FloatArray) -> FloatArray:
    """The distance by which N poses are out of reach at least (N,), mm; 0 or less within reach.

    Joint limits are left aside. The hand may stand anywhere around the wrist.
    """
    seen = find_wrists(arm.base_from_arm, arm.b, origins + rotations @ arm.wrist)
    distance = np.hypot(seen.ahead - arm.a1, seen.height - arm.c1)
    least = (measure_beyond(distance, arm.c2, arm.c3) - abs(arm.c5)).min(axis=1)
    return np.asarray(np.maximum(least, seen.too_near))


def measure_singularities(arm: ThreeParallel, theta: FloatArray) -> FloatArray:
    """Distances of theta (..., 6) from the three singularities, rad (..., 3).

    They are the wrist beside axis 1, the elbow straight or folded, and axes 4 and 6 parallel.
    """
    reach = arm.c2 + arm.c3 + abs(arm.c5)
    sines = [_measure_ahead(arm, theta) / reach, np.sin(theta[..., 2]), np.sin(theta[..., 4])]
    return np.asarray(np.arcsin(np.clip(np.abs(np.stack(sines, axis=-1)), 0.0, 1.0)))


def _measure_ahead(arm: ThreeParallel, theta: FloatArray) -> FloatArray:
    """Distance of the wrist before axis 1 (...), mm."""
    upper = theta[..., 1]
    fore = upper + theta[..., 2]
    hand = fore + theta[..., 3]
    ahead = arm.a1 + arm.c2 * np.sin(upper) + arm.c3 * np.sin(fore) + arm.c5 * np.sin(hand)
    return np.asarray(ahead)
