"""Vectors in the plane and in space, a row each (N, D)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from camgen.model.pose import FloatArray

#: So many rows are worked out together: what comes in between stays in the processor's cache.
_SOME = 8192
_Value = TypeVar("_Value", bound=np.generic)


def in_blocks(function: Callable[..., NDArray[_Value]], *columns: NDArray[Any]) -> NDArray[_Value]:
    """What ``function`` makes of columns (N, ...), row by row (N, ...), some thousands of rows at a time."""
    size = len(columns[0])
    found = [
        function(*(one[low : low + _SOME] for one in columns))
        for low in range(0, max(size, 1), _SOME)
    ]
    return found[0] if len(found) == 1 else np.concatenate(found)


def nearest_row(values: FloatArray | NDArray[np.complex128], wanted: complex) -> int:
    """The row of `values` (N,), numbers or complex points, that is nearest to `wanted`."""
    return int(np.argmin(np.abs(values - wanted)))


def dots(a: FloatArray, b: FloatArray) -> FloatArray:
    """(...,) scalar products of vectors (..., D)."""
    return np.asarray(np.einsum("...d,...d->...", a, b))


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """The cross product of vectors (..., 3): what ``np.cross`` gives, twice as fast."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


def add_coordinates(vectors: FloatArray) -> FloatArray:
    """The sums (...,) of the coordinates of vectors (..., 3).

    They are those of ``sum(axis=-1)`` to the last bit, in a third of its time.
    """
    return np.asarray(vectors[..., 0] + vectors[..., 1] + vectors[..., 2])


def plane_lengths(vectors: FloatArray) -> FloatArray:
    """(...,) lengths of vectors (..., 2): what ``np.linalg.norm`` gives, three times as fast."""
    x, y = vectors[..., 0], vectors[..., 1]
    return np.asarray(np.sqrt(x * x + y * y))


def within(vectors: FloatArray, most: float) -> NDArray[np.bool_]:
    """(...,) whether no number of vectors (..., 3) is farther from 0 than ``most``; NaN is."""
    near = np.abs(vectors) <= most
    return np.asarray(near[..., 0] & near[..., 1] & near[..., 2])


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
