"""Chains of joints with an inverse in closed form, recognised by their geometry.

They are six axes with a spherical wrist or with three parallel axes, a SCARA, and three slides. An
arm is recognised by the lines of its axes, not by its name, and the parameters of its shape are
computed from the chain. So each robot has one set of numbers, and an arm that a user describes gets
its closed form as well.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct

from camgen.model.pose import FloatArray, Pose, frozen, to_vec3
from camgen.robots.chain import AtZero, Joint, make_zero_chain
from camgen.robots.kinematics.three_parallel import ThreeParallel, measure

#: Tolerance within which axes are parallel or square or meet: mm, and sine of an angle.
_LENGTH, _ANGLE = 1e-6, 1e-9
#: Sine of the angle for an arm that only resembles one with a spherical wrist.
_ROUNDED = 1e-3


class Spherical(Struct, frozen=True, eq=False):
    """Six axes: an upright one, two parallel ones square to it, and three through the wrist centre.

    This is the ortho-parallel arm with spherical wrist (Brandstoetter, Angerer, Hofbaur, 2014).
    Upper arm and forearm point along z if the angles theta are 0.

    base_from_arm: frame with z along axis 1 and y along axis 2.
    a1, c1: x and z of axis 2, mm.
    c2: length of the upper arm, mm.
    a2, c3: x and z from axis 3 to the wrist centre, mm.
    b: y of the wrist centre, mm.
    signs, offsets: (6,) theta = signs * serial angle + offsets, rad.
    flange_from_wrist: frame in the wrist centre with z along axis 6.
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
    """Upright axes 1, 2 and 4, and slide 3.

    Theta 3 is the height of the flange. Theta 4 is the angle of axis 4 before it is turned by theta
    1 and 2.

    base_from_arm: frame with z along axis 1 and the origin on it.
    l1, l2: lengths of the arms, mm.
    signs, offsets: (4,) theta = signs * joint value + offsets, rad or mm.
    arm_from_flange: frame of the flange with axis 4 as z, without its turn and its height.
    """

    base_from_arm: Pose
    l1: float
    l2: float
    signs: FloatArray
    offsets: FloatArray
    arm_from_flange: Pose


class Gantry(Struct, frozen=True, eq=False):
    """Three slides.

    directions: (3, 3) directions of the slides in the base frame, one per column.
    base_from_flange: pose of the flange with all slides at 0.
    """

    directions: FloatArray
    base_from_flange: Pose


Arm = Spherical | ThreeParallel | Scara | Gantry


def recognise_arm(joints: tuple[Joint, ...], flange: Pose) -> Arm | None:
    """The closed form of a chain, None if it has none. flange: last_joint_from_flange."""
    zero = make_zero_chain(joints, flange)
    slides = _list_slides(joints)
    if slides == "------":
        return _spherical(zero, _LENGTH, _ANGLE) or _three_parallel(zero)
    if slides == "--|-":
        return _scara(zero)
    if slides == "|||" and abs(np.linalg.det(zero.directions)) > _ANGLE:
        return Gantry(frozen(zero.directions.T), zero.base_from_flange)
    return None


def find_resembling_arm(joints: tuple[Joint, ...], flange: Pose) -> Spherical | None:
    """The arm with a spherical wrist that six revolute axes resemble, None if they do not.

    It gives first guesses. Axes 5 and 6 may pass axis 4 at any distance, and directions may be from
    a description whose angles are rounded.
    """
    if _list_slides(joints) != "------":
        return None
    return _spherical(make_zero_chain(joints, flange), math.inf, _ROUNDED)


def _list_slides(joints: tuple[Joint, ...]) -> str:
    """A letter for each joint: - for a revolute one, | for a slide."""
    return "".join("-|"[joint.sliding] for joint in joints)


def _square(a: FloatArray, b: FloatArray, slack: float = _ANGLE) -> bool:
    return abs(float(a @ b)) < slack


def _parallel(a: FloatArray, b: FloatArray, slack: float = _ANGLE) -> bool:
    return float(np.linalg.norm(np.cross(a, b))) < slack


def _upright(direction: FloatArray) -> FloatArray:
    """`direction` or its opposite, with a positive z, or y if z is 0, or x if both are 0."""
    last = np.flatnonzero(np.abs(direction) > _ANGLE)[-1]
    return direction if direction[last] > 0 else -direction


def _frame(z: FloatArray, y: FloatArray, on_axis: FloatArray) -> Pose:
    """The frame with these axes on axis 1, at the height of the origin of the base frame."""
    x, y0, z0 = (on_axis - z * float(on_axis @ z)).tolist()
    return Pose(frozen(np.column_stack([np.cross(y, z), y, z])), (x, y0, z0))


def _wrist(zero: AtZero, slack: float) -> FloatArray | None:
    """The point (3,) where axes 4, 5 and 6 meet within `slack` mm, None if they do not."""
    p4, p5, p6 = zero.points[3:]
    d4, d5, d6 = zero.directions[3:]
    centre = p4 + d4 * float((p5 - p4) @ d4)
    for point, along in ((p5, d5), (p6, d6)):
        if np.linalg.norm(np.cross(centre - point, along)) > slack:
            return None
    return np.asarray(centre)


def _spherical(zero: AtZero, length: float, angle: float) -> Spherical | None:
    d = zero.directions
    is_square = all(_square(d[i], d[i + 1], angle) for i in (0, 2, 3, 4))
    wrist = _wrist(zero, length) if is_square and _parallel(d[1], d[2], angle) else None
    if wrist is None:
        return None
    z = _upright(d[0])
    ahead = float((zero.points[1] - zero.points[0]) @ np.cross(d[1], z))
    # Axis 2 is in front of axis 1, or above it.
    y = d[1] if ahead > -_LENGTH else -d[1]
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
    """The arm whose axes have these points and directions at 0.

    points: (7, 3) a point on each axis, and the wrist centre.
    d: (6, 3) directions.
    flange: pose of the flange.
    """
    upper, fore = points[2] - points[1], points[6] - points[2]
    # Axes 4 to 6 get the signs with which forearm, rotation of axis 5 and flange point forward.
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
