"""Many rotations at once, as matrices (N, 3, 3); `model.pose` has single ones. Unit: rad."""

from __future__ import annotations

import math

import numpy as np

from camgen.geometry.vectors import cross, multiply_rows, normalize
from camgen.model.part import IntArray
from camgen.model.pose import FloatArray

#: rad: a rotation by up to this angle has one sense, in spite of rounding. A rotation by pi has two
#: senses, so larger rotations are divided.
SURE_TURN = math.radians(120.0)


def measure_angles_between(a: FloatArray, b: FloatArray) -> FloatArray:
    """(N,) angles of the rotations from a to b (N, 3, 3), as `pose.angle_between` for each row."""
    return _angles(*_sines(np.swapaxes(a, -1, -2) @ b))


def compute_rotation_vectors(rotations: FloatArray) -> FloatArray:
    """(N, 3) axis times angle of rotations (N, 3, 3).

    It is zero for a rotation by exactly pi, whose axis has two senses.
    """
    doubled, trace = _sines(rotations)
    angle, size = _angles(doubled, trace), np.linalg.norm(doubled, axis=1)
    scale = np.where(size > 0, angle / np.where(size > 0, size, 1.0), 0.5)
    return np.asarray(doubled * scale[:, None])


def make_rotations_from_vectors(vectors: FloatArray) -> FloatArray:
    """(N, 3, 3) rotations of axis times angle (N, 3) (Rodrigues); exact for small angles too."""
    angle = np.linalg.norm(vectors, axis=1)[:, None, None]
    matrix = cross_matrices(vectors)
    half = np.sinc(angle / (2 * np.pi))
    return np.asarray(np.eye(3) + np.sinc(angle / np.pi) * matrix + half**2 / 2 * (matrix @ matrix))


def make_rotations_from_quaternions(
    w: FloatArray, x: FloatArray, y: FloatArray, z: FloatArray
) -> FloatArray:
    """(N, 3, 3) rotations of unit quaternions, each component (N,)."""
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.array(rows).transpose(2, 0, 1)


def make_rotations_from_axes(z: FloatArray, towards: FloatArray) -> FloatArray:
    """(N, 3, 3) rotations with z along `z` (N, 3) and x towards `towards` (N, 3).

    x is the part of `towards` that is perpendicular to z.
    """
    z = normalize(z)
    x = normalize(towards - z * multiply_rows(z, towards)[:, None])
    return np.stack([x, cross(z, x), z], axis=2)


def find_sideways(axis: FloatArray) -> FloatArray:
    """(N, 3) x direction of a tool whose z is along the unit vectors `axis` (N, 3), at roll 0.

    It is x of the work frame, before it is made perpendicular to z, or y if z is along that x.
    """
    return np.where(np.abs(axis[:, :1]) > 1 - 1e-9, (0.0, 1.0, 0.0), (1.0, 0.0, 0.0))


def make_rotations_about_z(angles: FloatArray) -> FloatArray:
    """(..., 3, 3) rotations by `angles` (...) about z."""
    result = np.zeros((*angles.shape, 3, 3))
    result[..., 0, 0] = result[..., 1, 1] = np.cos(angles)
    result[..., 1, 0] = np.sin(angles)
    result[..., 0, 1] = -result[..., 1, 0]
    result[..., 2, 2] = 1.0
    return result


def interpolate_rotations(
    a: FloatArray, b: FloatArray, row: IntArray, fraction: FloatArray
) -> FloatArray:
    """(M, 3, 3) rotations on the shortest way from a[row] to b[row].

    a, b: (N, 3, 3).
    row: (M,) rows of a and b.
    fraction: (M,) 0 at a, 1 at b.
    """
    turn = compute_rotation_vectors(np.swapaxes(a, -1, -2) @ b)
    return np.asarray(a[row] @ make_rotations_from_vectors(turn[row] * fraction[:, None]))


def measure_rolls(rotations: FloatArray) -> FloatArray:
    """(N,) angles of the part of each rotation that is about z (swing-twist decomposition)."""
    r = rotations
    return np.asarray(np.arctan2(r[:, 1, 0] - r[:, 0, 1], r[:, 0, 0] + r[:, 1, 1]))


def turn_vectors(vectors: FloatArray, axes: FloatArray, angles: FloatArray) -> FloatArray:
    """`vectors` (N, 3) rotated by `angles` (N,) about unit vectors `axes` (N, 3) (Rodrigues)."""
    c, s = np.cos(angles)[:, None], np.sin(angles)[:, None]
    inline = multiply_rows(axes, vectors)[:, None]
    return np.asarray(c * vectors + s * cross(axes, vectors) + (1 - c) * inline * axes)


def compute_rotation_terms(axis: FloatArray) -> FloatArray:
    """(3, 3, 3) terms of a rotation about the unit vector `axis` (3,) (Rodrigues).

    The rotation by an angle is the first one, plus the second times its cosine, plus the third
    times its sine. It serves for many angles about one axis.
    """
    still = np.outer(axis, axis)
    return np.stack([still, np.eye(3) - still, cross_matrices(np.asarray(axis)[None])[0]])


def cross_matrices(vectors: FloatArray) -> FloatArray:
    """(N, 3, 3) matrices whose product with v is the cross product of `vectors` (N, 3) and v."""
    x, y, z = vectors.T
    matrix = np.zeros((len(vectors), 3, 3))
    matrix[:, 2, 1], matrix[:, 0, 2], matrix[:, 1, 0] = x, y, z
    matrix[:, 1, 2], matrix[:, 2, 0], matrix[:, 0, 1] = -x, -y, -z
    return matrix


def _sines(r: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Axis times 2 sin(angle) (N, 3), from the skew part, and the trace 1 + 2 cos(angle) (N,)."""
    skew = [r[:, 2, 1] - r[:, 1, 2], r[:, 0, 2] - r[:, 2, 0], r[:, 1, 0] - r[:, 0, 1]]
    return np.stack(skew, axis=1), r[:, 0, 0] + r[:, 1, 1] + r[:, 2, 2]


def _angles(doubled: FloatArray, trace: FloatArray) -> FloatArray:
    """(N,) angles from the results of `_sines`; the trace alone is the same for 1e-8 rad and 0."""
    return np.asarray(np.arctan2(np.linalg.norm(doubled, axis=1), trace - 1.0))
