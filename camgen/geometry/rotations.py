"""Rotations in batches, matrices (N, 3, 3); ``model.pose`` has those of single ones. Angles in rad."""

from __future__ import annotations

import math

import numpy as np

from camgen.geometry.vectors import cross, dots, unit
from camgen.model.part import IntArray
from camgen.model.pose import FloatArray

#: A turn up to this, rad, has one sense for sure, with room for rounding: half a turn has two. Larger ones are cut.
SURE_TURN = math.radians(120.0)


def angles_between(a: FloatArray, b: FloatArray) -> FloatArray:
    """(N,) the angles of the rotations that take a (N, 3, 3) to b: ``pose.angle_between`` by row."""
    return _angles(*_sines(np.swapaxes(a, -1, -2) @ b))


def vectors_of(rotations: FloatArray) -> FloatArray:
    """(N, 3) axis times angle of rotations (N, 3, 3); of half a turn exactly, which has two axes, zero."""
    doubled, trace = _sines(rotations)
    angle, size = _angles(doubled, trace), np.linalg.norm(doubled, axis=1)
    return np.asarray(
        doubled * np.where(size > 0, angle / np.where(size > 0, size, 1.0), 0.5)[:, None]
    )


def from_vectors(vectors: FloatArray) -> FloatArray:
    """(N, 3, 3) of axis times angle (N, 3) (Rodrigues); exact for small angles too."""
    angle = np.linalg.norm(vectors, axis=1)[:, None, None]
    matrix = cross_matrices(vectors)
    half = np.sinc(angle / (2 * np.pi))
    return np.asarray(np.eye(3) + np.sinc(angle / np.pi) * matrix + half**2 / 2 * (matrix @ matrix))


def from_quaternions(w: FloatArray, x: FloatArray, y: FloatArray, z: FloatArray) -> FloatArray:
    """(N, 3, 3) of unit quaternions, each part (N,)."""
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.array(rows).transpose(2, 0, 1)


def from_axes(z: FloatArray, towards: FloatArray) -> FloatArray:
    """(N, 3, 3) with z along ``z`` and x along ``towards``, made square to it: ``pose.rotation_from_axes`` by row."""
    z = unit(z)
    x = unit(towards - z * dots(z, towards)[:, None])
    return np.stack([x, cross(z, x), z], axis=2)


def sideways(axis: FloatArray) -> FloatArray:
    """The x (N, 3) of a tool with z along ``axis`` that does not turn: the work x, or its y where that is the axis."""
    parallel = np.abs(axis[:, :1]) > 1 - 1e-9
    return np.asarray(np.where(parallel, (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)))


def turned_about_z(angles: FloatArray) -> FloatArray:
    """(..., 3, 3) the turns by ``angles`` (...) about z."""
    c, s, zero, one = np.cos(angles), np.sin(angles), np.zeros_like(angles), np.ones_like(angles)
    rows = [np.stack(row, axis=-1) for row in ((c, -s, zero), (s, c, zero), (zero, zero, one))]
    return np.stack(rows, axis=-2)


def between(a: FloatArray, b: FloatArray, row: IntArray, fraction: FloatArray) -> FloatArray:
    """(M, 3, 3) the rotations at ``fraction`` (M,) of the shortest turns from ``a[row]`` to ``b[row]``, row (M,)."""
    turn = vectors_of(np.swapaxes(a, -1, -2) @ b)
    return np.asarray(a[row] @ from_vectors(turn[row] * fraction[:, None]))


def turns_about_z(rotations: FloatArray) -> FloatArray:
    """(N,) the angles of the part of each rotation that is about z (swing and twist)."""
    r = rotations
    return np.asarray(np.arctan2(r[:, 1, 0] - r[:, 0, 1], r[:, 0, 0] + r[:, 1, 1]))


def turn_vectors(vectors: FloatArray, axes: FloatArray, angles: FloatArray) -> FloatArray:
    """``vectors`` (N, 3) turned by ``angles`` (N,) about the unit vectors ``axes`` (N, 3) (Rodrigues)."""
    c, s = np.cos(angles)[:, None], np.sin(angles)[:, None]
    inline = dots(axes, vectors)[:, None]
    return np.asarray(c * vectors + s * cross(axes, vectors) + (1 - c) * inline * axes)


def about(axis: FloatArray) -> FloatArray:
    """(3, 3, 3) what of a rotation about the unit vector ``axis`` stays, what goes with the cosine of the angle and
    what with its sine: for many angles about one axis (Rodrigues).
    """
    still = np.outer(axis, axis)
    return np.stack([still, np.eye(3) - still, cross_matrices(np.asarray(axis)[None])[0]])


def cross_matrices(vectors: FloatArray) -> FloatArray:
    """(N, 3, 3) the matrices that make the cross product with each of ``vectors`` (N, 3) from the left."""
    x, y, z = vectors.T
    matrix = np.zeros((len(vectors), 3, 3))
    matrix[:, 2, 1], matrix[:, 0, 2], matrix[:, 1, 0] = x, y, z
    matrix[:, 1, 2], matrix[:, 2, 0], matrix[:, 0, 1] = -x, -y, -z
    return matrix


def _sines(r: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Axis times 2 sin(angle) (N, 3), from the skew part, and the trace (N,), 1 + 2 cos(angle)."""
    skew = [r[:, 2, 1] - r[:, 1, 2], r[:, 0, 2] - r[:, 2, 0], r[:, 1, 0] - r[:, 0, 1]]
    return np.stack(skew, axis=1), r[:, 0, 0] + r[:, 1, 1] + r[:, 2, 2]


def _angles(doubled: FloatArray, trace: FloatArray) -> FloatArray:
    """(N,) from both: the trace alone cannot tell 1e-8 rad from 0."""
    return np.asarray(np.arctan2(np.linalg.norm(doubled, axis=1), trace - 1.0))
