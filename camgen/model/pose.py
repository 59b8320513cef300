"""Rotations and frames: the only module that knows a quaternion from an Euler angle.

A transform is named `a_from_b`: it takes coordinates in b to coordinates in a, so that
`base_from_work @ work_from_tool` reads correctly or visibly not. mm and rad throughout.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.model.text import short

FloatArray = NDArray[np.float64]
Vec3 = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

#: Sine of the middle angle of an Euler triple, below which only the sum of the others is known.
_DEGENERATE = 1e-9


def frozen(values: object) -> FloatArray:
    """`values` as a read-only float array of its own."""
    array = np.array(values, dtype=np.float64)
    array.flags.writeable = False
    return array


def to_vec3(values: FloatArray) -> Vec3:
    """A row of an array (3,) as a tuple of plain floats."""
    x, y, z = values.tolist()
    return (x, y, z)


IDENTITY = frozen(np.eye(3))
#: Tool z towards the part, tool x along the work x: the tool straight down (contract, frames).
TOOL_DOWN = frozen(np.diag([1.0, -1.0, -1.0]))


class Pose(Struct, frozen=True, eq=False, gc=False):
    """A rigid transform.

    rotation: (3, 3), read-only and orthonormal.
    origin: x, y, z, mm.
    """

    rotation: FloatArray
    origin: Vec3

    def __matmul__(self, other: Pose) -> Pose:
        return Pose(frozen(self.rotation @ other.rotation), self.apply(other.origin))

    def apply(self, point: Sequence[float]) -> Vec3:
        """`point` (mm, frame b) in frame a."""
        x, y, z = (self.rotation @ np.asarray(point, dtype=np.float64)).tolist()
        return (x + self.origin[0], y + self.origin[1], z + self.origin[2])

    def inverse(self) -> Pose:
        """b_from_a."""
        back = self.rotation.T
        return Pose(frozen(back), to_vec3(-(back @ np.asarray(self.origin))))


class PlanePose(Struct, frozen=True):
    """A turn about z and then a shift, in the work plane.

    turn: rad.
    x, y: shift, mm.
    """

    turn: float
    x: float
    y: float

    def apply(self, points: FloatArray) -> FloatArray:
        """The points (N, 2), mm, turned and shifted."""
        if self.turn:
            c, s = math.cos(self.turn), math.sin(self.turn)
            points = points @ np.array([[c, s], [-s, c]])
        return np.asarray(points + np.array([self.x, self.y]))

    def inverse(self) -> PlanePose:
        """The pose that undoes it."""
        ((x, y),) = PlanePose(-self.turn, 0.0, 0.0).apply(np.array([[-self.x, -self.y]])).tolist()
        return PlanePose(-self.turn, x, y)

    def __str__(self) -> str:
        turn = short(math.degrees(self.turn), 3)
        return f"x {short(self.x, 3)} y {short(self.y, 3)} mm turned {turn} deg"


def translation(x: float, y: float, z: float) -> Pose:
    """A frame with the same axes, its origin at x, y, z (mm)."""
    return Pose(IDENTITY, (float(x), float(y), float(z)))


def pose_from_values(values: Sequence[float]) -> Pose:
    """Pose from `[x, y, z, rx, ry, rz]`: mm and degrees, R = Rz Ry Rx (contract, section 3)."""
    x, y, z, rx, ry, rz = (float(v) for v in values)
    rotation = rotation_from_fixed_xyz(math.radians(rx), math.radians(ry), math.radians(rz))
    return Pose(rotation, (x, y, z))


def format_frame(pose: Pose) -> str:
    """The origin x y z in mm and rx ry rz in deg (contract, section 3)."""
    angles = (math.degrees(angle) for angle in compute_fixed_xyz(pose.rotation))
    return " ".join([*(short(v, 3) for v in pose.origin), *(short(a, 4) for a in angles)])


def rotation_about(axis: int, angle: float) -> FloatArray:
    """Rotation about coordinate axis 0, 1 or 2 by `angle` rad."""
    c, s = math.cos(angle), math.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    matrix[i, i] = matrix[j, j] = c
    matrix[i, j], matrix[j, i] = -s, s
    return frozen(matrix)


def rotation_about_axis(axis: FloatArray, angle: float) -> FloatArray:
    """Rotation about the unit vector `axis` (3,) by `angle` rad (Rodrigues)."""
    x, y, z = axis.tolist()
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return frozen(np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * (cross @ cross))


def rotation_between(a: FloatArray, b: FloatArray, fraction: float) -> FloatArray:
    """The rotation at `fraction` 0..1 of the shortest turn from `a` to `b`."""
    w, x, y, z = compute_quaternion(frozen(a.T @ b))
    half = math.atan2(math.sqrt(x * x + y * y + z * z), w)
    if half < 1e-12:
        return a
    axis = np.array([x, y, z]) / math.sin(half)
    return frozen(a @ rotation_about_axis(axis, 2 * half * fraction))


def compute_quaternion(rotation: FloatArray) -> Quaternion:
    """Unit quaternion (w, x, y, z). The first component that is not zero is positive (Shepperd)."""
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
    candidates = (a + e + i, a, e, i)
    q = (
        (1 + a + e + i, h - f, c - g, d - b),
        (h - f, 1 + a - e - i, b + d, c + g),
        (c - g, b + d, 1 - a + e - i, f + h),
        (d - b, c + g, f + h, 1 - a - e + i),
    )[candidates.index(max(candidates))]
    norm = math.sqrt(sum(v * v for v in q))
    lead = next(v for v in q if abs(v) > 1e-12 * norm)
    if lead < 0:
        norm = -norm
    return (q[0] / norm + 0.0, q[1] / norm + 0.0, q[2] / norm + 0.0, q[3] / norm + 0.0)


def rotation_from_quaternion(q: Sequence[float]) -> FloatArray:
    """Rotation of the quaternion (w, x, y, z); it is normalised first."""
    w, x, y, z = (float(v) for v in q)
    n = 2.0 / (w * w + x * x + y * y + z * z)
    return frozen(
        [
            [1 - n * (y * y + z * z), n * (x * y - w * z), n * (x * z + w * y)],
            [n * (x * y + w * z), 1 - n * (x * x + z * z), n * (y * z - w * x)],
            [n * (x * z - w * y), n * (y * z + w * x), 1 - n * (x * x + y * y)],
        ]
    )


def compute_fixed_xyz(rotation: FloatArray) -> Vec3:
    """(rx, ry, rz) rad with R = Rz(rz) Ry(ry) Rx(rx); rx = 0 if ry = +-90 deg (DENSO, contract)."""
    r = rotation
    s = math.hypot(r[0, 0], r[1, 0])
    if s < _DEGENERATE:
        return (0.0, math.copysign(math.pi / 2, -r[2, 0]), math.atan2(-r[0, 1], r[1, 1]))
    return (math.atan2(r[2, 1], r[2, 2]), math.atan2(-r[2, 0], s), math.atan2(r[1, 0], r[0, 0]))


def rotation_from_fixed_xyz(rx: float, ry: float, rz: float) -> FloatArray:
    """R = Rz(rz) Ry(ry) Rx(rx), angles in rad."""
    return frozen(rotation_about(2, rz) @ rotation_about(1, ry) @ rotation_about(0, rx))


def compute_zyz(rotation: FloatArray) -> Vec3:
    """(yaw, pitch, roll), rad, with R = Rz(yaw) Ry(pitch) Rz(roll), as TRANS of V+.

    yaw is 0 if pitch is 0 or pi.
    """
    r = rotation
    s = math.hypot(r[0, 2], r[1, 2])
    if s < _DEGENERATE:
        if r[2, 2] > 0:
            return (0.0, 0.0, math.atan2(r[1, 0], r[0, 0]))
        return (0.0, math.pi, math.atan2(r[1, 0], r[1, 1]))
    return (math.atan2(r[1, 2], r[0, 2]), math.atan2(s, r[2, 2]), math.atan2(r[2, 1], -r[2, 0]))


def rotation_vector(rotation: FloatArray) -> Vec3:
    """The axis of a rotation times its angle, rad, 0 to pi (Universal Robots: end of `p[]`).

    A rotation by pi has two axes. The result is the one whose first nonzero component is positive.
    """
    w, *axis = compute_quaternion(rotation)
    sine = math.hypot(*axis)
    scale = 2 * math.atan2(sine, w) / sine if sine else 2.0
    x, y, z = (scale * component for component in axis)
    return (x, y, z)


def rotation_from_vector(vector: Sequence[float]) -> FloatArray:
    """The rotation about the axis `vector` (3,) by its length, rad, of any size."""
    angle = math.hypot(*vector)
    if angle == 0:
        return IDENTITY
    return rotation_about_axis(np.asarray(vector, dtype=np.float64) / angle, angle)


def angle_between(a: FloatArray, b: FloatArray) -> float:
    """The angle (rad) of the rotation that takes `a` to `b`; exact for small angles too."""
    skew = a.T @ b
    sine = math.hypot(skew[2, 1] - skew[1, 2], skew[0, 2] - skew[2, 0], skew[1, 0] - skew[0, 1])
    return math.atan2(sine, float(np.trace(skew)) - 1.0)
