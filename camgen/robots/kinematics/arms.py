"""Chains with joints in closed form: six axes with a spherical wrist or three parallel ones, a SCARA, three slides.

An arm is recognised by where its axes are, not by its name: the shape's parameters are worked out from the chain, so
that there is one set of numbers per robot, and an arm that a user describes gets its closed form as well.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct

from camgen.model.pose import FloatArray, Pose, frozen, to_vec3
from camgen.robots.chain import AtZero, Joint, at_zero
from camgen.robots.kinematics.three_parallel import ThreeParallel, measure

#: Axes are parallel, square or meet to within this much: mm, and sines of angles.
_LENGTH, _ANGLE = 1e-6, 1e-9
#: The same for an arm that is only like one with a spherical wrist.
_ROUNDED = 1e-3


class Spherical(Struct, frozen=True, eq=False):
    """Six axes: upright, two parallel ones square to it, and three that meet in the wrist centre (ortho-parallel arm
    with spherical wrist; Brandstoetter, Angerer, Hofbaur, 2014).

    base_from_arm: z along axis 1, y along axis 2. Where the angles theta are 0, upper arm and forearm point along z.
    a1, c1: x and z of axis 2, mm. c2: upper arm. a2, c3: from axis 3 to the wrist centre along x and z. b: its y.
    theta = signs * serial angle + offsets, (6,). flange_from_wrist: a frame whose z is axis 6, in the wrist centre.
    """

    base_from_arm: Pose
    a1: float
    c1: float
    c2: float
    a2: float
    c3: float
    b: float
    signs: FloatArray
    offsets: FloatArray
    flange_from_wrist: Pose


class Scara(Struct, frozen=True, eq=False):
    """Upright axes 1, 2 and 4 and slide 3.

    base_from_arm: z along axis 1, origin on it. l1, l2: lengths of the arms, mm. theta = signs * joint + offsets, (4,),
    where theta 3 is the height of the flange and theta 4 is not yet turned by theta 1 and 2. arm_from_flange: with
    axis 4 as z, its turn and the height left out.
    """

    base_from_arm: Pose
    l1: float
    l2: float
    signs: FloatArray
    offsets: FloatArray
    arm_from_flange: Pose


class Gantry(Struct, frozen=True, eq=False):
    """Three slides. directions: (3, 3), one per column, base frame. base_from_flange: with all at 0."""

    directions: FloatArray
    base_from_flange: Pose


Arm = Spherical | ThreeParallel | Scara | Gantry


def recognise(joints: tuple[Joint, ...], flange: Pose) -> Arm | None:
    """The closed form of a chain, None if there is none here. flange: last_joint_from_flange."""
    zero = at_zero(joints, flange)
    slides = "".join("-|"[joint.sliding] for joint in joints)
    if slides == "------":
        return _spherical(zero, _LENGTH, _ANGLE) or _three_parallel(zero)
    if slides == "--|-":
        return _scara(zero)
    if slides == "|||" and abs(np.linalg.det(zero.directions)) > _ANGLE:
        return Gantry(frozen(zero.directions.T), zero.base_from_flange)
    return None


def resembling(joints: tuple[Joint, ...], flange: Pose) -> Spherical | None:
    """An arm with a spherical wrist that six turning axes are not far from: a source of first guesses. Axes 5 and 6 may
    pass axis 4 at any distance, and directions are as in a description whose angles are rounded.
    """
    if len(joints) != 6 or any(joint.sliding for joint in joints):
        return None
    return _spherical(at_zero(joints, flange), math.inf, _ROUNDED)


def _square(a: FloatArray, b: FloatArray, slack: float = _ANGLE) -> bool:
    return abs(float(a @ b)) < slack


def _parallel(a: FloatArray, b: FloatArray, slack: float = _ANGLE) -> bool:
    return float(np.linalg.norm(np.cross(a, b))) < slack


def _upright(direction: FloatArray) -> FloatArray:
    """``direction`` or its opposite, whichever points up in the base frame, or ahead where neither does."""
    lead = next(v for v in direction[::-1].tolist() if abs(v) > _ANGLE)
    return direction if lead > 0 else -direction


def _frame(z: FloatArray, y: FloatArray, on_axis: FloatArray) -> Pose:
    """The frame with these axes on axis 1, as high as the base frame's origin."""
    x, y0, z0 = (on_axis - z * float(on_axis @ z)).tolist()
    return Pose(frozen(np.column_stack([np.cross(y, z), y, z])), (x, y0, z0))


def _wrist(zero: AtZero, slack: float) -> FloatArray | None:
    """Where axes 4, 5 and 6 meet (3,), if they do within ``slack`` mm."""
    p4, p5, p6 = zero.points[3:]
    d4, d5, d6 = zero.directions[3:]
    centre = p4 + d4 * float((p5 - p4) @ d4)
    for point, along in ((p5, d5), (p6, d6)):
        if np.linalg.norm(np.cross(centre - point, along)) > slack:
            return None
    return np.asarray(centre)


def _spherical(zero: AtZero, length: float, angle: float) -> Spherical | None:
    d = zero.directions
    square = all(_square(d[i], d[i + 1], angle) for i in (0, 2, 3, 4))
    wrist = _wrist(zero, length) if square and _parallel(d[1], d[2], angle) else None
    if wrist is None:
        return None
    z = _upright(d[0])
    ahead = float((zero.points[1] - zero.points[0]) @ np.cross(d[1], z))
    y = (
        d[1] if ahead > -_LENGTH else -d[1]
    )  # axis 2 lies in front of axis 1 where it is not above it
    base_from_arm = _frame(z, y, zero.points[0])
    points = (np.vstack([zero.points, wrist]) - base_from_arm.origin) @ base_from_arm.rotation
    flange = base_from_arm.inverse() @ zero.base_from_flange
    arm = _measure(base_from_arm, points, d @ base_from_arm.rotation, flange)
    return arm if min(arm.c2, math.hypot(arm.a2, arm.c3)) > _LENGTH else None


def _three_parallel(zero: AtZero) -> ThreeParallel | None:
    d = zero.directions
    parallel = _parallel(d[1], d[2]) and _parallel(d[1], d[3])
    if not (parallel and all(_square(d[i], d[i + 1]) for i in (0, 3, 4))):
        return None
    return measure(zero, _frame(_upright(d[0]), d[1], zero.points[0]), _LENGTH)


def _measure(base_from_arm: Pose, points: FloatArray, d: FloatArray, flange: Pose) -> Spherical:
    """The arm whose axes have these ``points``, the wrist centre last (7, 3), and directions ``d`` (6, 3) at 0."""
    upper, fore = points[2] - points[1], points[6] - points[2]
    # The signs of axes 4 to 6 are those that make the forearm, the turn of axis 5 and the flange point forward.
    d4 = -d[3] if fore @ d[3] < 0 else d[3]
    d5 = -d[4] if d[4][1] < -_ANGLE else d[4]
    out = flange.rotation[:, 2] + (np.asarray(flange.origin) - points[6])
    d6 = -d[5] if out @ d[5] < 0 else d[5]
    at2, at23 = math.atan2(upper[0], upper[2]), math.atan2(d4[0], d4[2])
    across = np.array([math.cos(at23), 0.0, -math.sin(at23)])
    at4 = math.atan2(-float(d5 @ across), d5[1])
    at5 = math.atan2(float(d6 @ np.cross(d5, d4)), float(d6 @ d4))
    wrist_axes = frozen(np.column_stack([np.cross(d5, d6), d5, d6]))
    arm_from_wrist = Pose(wrist_axes, to_vec3(points[6]))
    signs = (d[0][2], d[1][1], d[2][1], d4 @ d[3], d5 @ d[4], d6 @ d[5])
    return Spherical(
        base_from_arm=base_from_arm,
        a1=float(points[1][0]),
        c1=float(points[1][2]),
        c2=math.hypot(upper[0], upper[2]),
        a2=float(fore @ across),
        c3=float(fore @ d4),
        b=float(points[6][1]),
        signs=frozen(np.sign(signs)),
        offsets=frozen([0.0, at2, at23 - at2, at4, at5, 0.0]),
        flange_from_wrist=flange.inverse() @ arm_from_wrist,
    )


def _scara(zero: AtZero) -> Scara | None:
    d = zero.directions
    if not all(_parallel(d[0], other) for other in d[1:]):
        return None
    z = _upright(d[0])
    reach = zero.points[1] - zero.points[0]
    x = reach - z * float(reach @ z)
    l1 = float(np.linalg.norm(x))
    if l1 < _LENGTH:
        return None
    base_from_arm = _frame(z, np.cross(z, x / l1), zero.points[0])
    points = (zero.points - base_from_arm.origin) @ base_from_arm.rotation
    second = points[3] - points[1]
    l2, at2 = math.hypot(second[0], second[1]), math.atan2(second[1], second[0])
    if l2 < _LENGTH:
        return None
    flange = base_from_arm.inverse() @ zero.base_from_flange
    ahead = (flange.origin[0] - float(points[3][0]), flange.origin[1] - float(points[3][1]), 0.0)
    return Scara(
        base_from_arm=base_from_arm,
        l1=l1,
        l2=l2,
        signs=frozen(np.sign(d @ z)),
        offsets=frozen([0.0, at2, flange.origin[2], -at2]),
        arm_from_flange=Pose(flange.rotation, ahead),
    )
