"""The picture in cells, means of n x n pixels: where bench and light are learned, at a small part of the cost.

What is slow in the picture (light, tones, which side is the bench) is found here; only the last comparison is made at
every pixel.
"""

from __future__ import annotations

import cv2
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.model.tolerance import SIGMAS_OF_MEDIAN

# Smooth surfaces through a picture's cells, blind to what does not belong to them.

Doubles = NDArray[np.float64]
Places = tuple[NDArray[np.intp], NDArray[np.intp]]

_MOST_SAMPLES = 4_000
#: Tukey's biweight: 95 % efficient for normal noise, blind to what is farther out (Beaton and Tukey 1974).
_TUKEY = 4.685
_LEAST_SIGMA = 0.4
_SECOND, _FOURTH = (tuple((m, n) for n in range(d + 1) for m in range(d + 1 - n)) for d in (2, 4))
#: Turns of least absolute values, which bear a third of outliers without a start, and of the biweight after them.
_ABSOLUTE, _BIWEIGHT = 10, 6


def some(where: NDArray[np.bool_]) -> Places:
    """Rows and columns of at most ``_MOST_SAMPLES`` true cells, evenly spread."""
    places = np.flatnonzero(where)
    rows, columns = np.divmod(places[:: len(places) // _MOST_SAMPLES + 1], where.shape[1])
    return rows, columns


def quadratic(shape: tuple[int, ...], at: Places) -> Doubles:
    """(N, 6): the products of x and y up to the second power at the places; x and y run from -1 to 1."""
    return _products(shape, at, _SECOND)


def quartic(shape: tuple[int, ...], at: Places) -> Doubles:
    """(N, 15): the same up to the fourth power, as the light of a lens falls off."""
    return _products(shape, at, _FOURTH)


def _products(shape: tuple[int, ...], at: Places, powers: tuple[tuple[int, int], ...]) -> Doubles:
    x, y = _axes(shape)
    u, v = ([np.ones_like(c[k])] for c, k in ((x, at[1]), (y, at[0])))
    for _ in range(max(max(powers))):
        u.append(u[-1] * x[at[1]])
        v.append(v[-1] * y[at[0]])
    return np.column_stack([u[m] * v[n] for m, n in powers])


def surface(shape: tuple[int, ...], c: Doubles) -> NDArray[np.float32]:
    """(h, w): the surface of the 6 or 15 coefficients."""
    powers = _SECOND if len(c) == len(_SECOND) else _FOURTH
    degree = max(max(powers))
    table = np.zeros((degree + 1, degree + 1))
    for (m, n), factor in zip(powers, c.tolist(), strict=True):
        table[n, m] = factor
    x, y = _axes(shape)
    rows, columns = (
        np.vander(axis, degree + 1, increasing=True).astype(np.float32) for axis in (y, x)
    )
    # Not by @: BLAS starts its threads for it, and waits for them on a busy machine.
    return np.asarray(np.einsum("im,jm->ij", rows @ table.astype(np.float32), columns), np.float32)


def _axes(shape: tuple[int, ...]) -> tuple[Doubles, Doubles]:
    x, y = ((np.arange(n) * 2 + 1) / n - 1 for n in (shape[1], shape[0]))
    return x, y


def robust(basis: Doubles, wanted: Doubles, turns: int = _ABSOLUTE) -> tuple[Doubles, float]:
    """Coefficients and spread by re-weighted least squares, ``turns`` of them least absolute values."""
    weights = np.ones_like(wanted)
    # A little on the diagonal: three columns of cells, or a bench of one tone, do not settle all coefficients.
    ridge = 1e-7 * np.eye(basis.shape[1]) * float(np.square(basis).sum(axis=0).max())
    for turn in range(turns + _BIWEIGHT):
        scaled = basis * weights[:, None]
        c = np.asarray(np.linalg.solve(scaled.T @ basis + ridge, scaled.T @ wanted), np.float64)
        off = np.asarray(wanted - basis @ c, np.float64)
        sigma = spread(off)
        weights = (
            np.asarray(1 / np.maximum(np.abs(off), sigma / 4))
            if turn < turns
            else biweight(off, sigma)
        )
    return c, sigma


def spread(off: NDArray[np.floating]) -> float:
    """Standard deviation of most of the values, from their median distance to 0; never 0."""
    return (
        max(_LEAST_SIGMA, SIGMAS_OF_MEDIAN * float(np.median(np.abs(off))))
        if off.size
        else _LEAST_SIGMA
    )


def biweight(off: Doubles, sigma: float) -> Doubles:
    """What each value counts: 1 to 0."""
    return np.asarray(
        np.square(np.clip(1 - np.square(off / (_TUKEY * sigma)), 0, None)), np.float64
    )


def covariance(values: Doubles) -> Doubles:
    """(c, c) of (N, c)."""
    off = values - values.mean(axis=0)
    return np.asarray(off.T @ off / len(off), np.float64)


Floats = NDArray[np.float32]
Bools = NDArray[np.bool_]
Bytes = NDArray[np.uint8]

#: So many cells at most, about: enough for parts of 1/500 of the picture's width, and for 3 ms per step.
_CELLS = 200_000
#: More noise than this in a cell, of 255, is smoothed away.
_NOISE = 1.0
#: The rim is so wide, of the shorter side. It should be bench.
_RIM = 0.03


class Cells(Struct, frozen=True, eq=False):
    """values: (h, w) or (h, w, 3) float32 means. valid: (h, w), all their pixels are. size: px along a cell's side.

    Cell (i, j) covers the pixels from size * i to size * i + size - 1; a rest at the right and at the bottom has none.
    """

    values: Floats
    valid: Bools
    size: int


class Bench(Struct, frozen=True, eq=False):
    """The bench as it would be without the part. values: (h, w) float32, smooth. sigma: spread of bench cells."""

    values: Floats
    sigma: float


def cells_of(pixels: Bytes, valid: Bools | None) -> Cells:
    """``pixels``, (H, W) or (H, W, 3), in cells."""
    height, width = pixels.shape[:2]
    size = max(1, min(round(np.sqrt(height * width / _CELLS)), height, width))
    values = _calm(shrunk(pixels, size).astype(np.float32))
    if valid is None:
        return Cells(values, np.ones(values.shape[:2], np.bool_), size)
    return Cells(values, shrunk(valid.view(np.uint8) * np.uint8(255), size) == 255, size)


def _calm(values: Floats) -> Floats:
    """Smoothed where cells of a pixel or two leave too much of the noise."""
    off = 2 * values[:, 2:-2] - values[:, :-4] - values[:, 4:]
    noise = SIGMAS_OF_MEDIAN * float(np.median(np.abs(off[::2]))) / 6**0.5 if off.size else 0.0
    if noise <= _NOISE:
        return values
    sigma = min(max(noise / _NOISE / (2 * np.pi**0.5), 0.6), 1.5)
    return np.asarray(cv2.GaussianBlur(values, (0, 0), sigma), np.float32)


def shrunk(pixels: Bytes, size: int) -> Bytes:
    """Means of ``size`` x ``size`` pixels, rounded: the cells need no fractions, they are averaged again."""
    rows, columns = pixels.shape[0] // size, pixels.shape[1] // size
    whole = pixels[: rows * size, : columns * size]
    return np.asarray(cv2.resize(whole, (columns, rows), interpolation=cv2.INTER_AREA), np.uint8)


def depth(inside: Bools) -> Floats:
    """Distance of each cell of ``inside`` to the nearest cell that is not, the picture's border not counted; cells."""
    return np.asarray(cv2.distanceTransform(inside.view(np.uint8), cv2.DIST_L2, 5), np.float32)


def inner_cells(inside: Bools) -> Bools:
    """The cells of ``inside`` whose eight neighbours are in it too: those on a boundary are not."""
    eroded = cv2.erode(inside.view(np.uint8), np.ones((3, 3), np.uint8))
    return np.asarray(eroded.view(np.bool_))


def rim(valid: Bools) -> Bools:
    """The cells along the border of the valid ones."""
    framed = cv2.copyMakeBorder(valid.view(np.uint8), 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0)
    deep = cv2.distanceTransform(framed, cv2.DIST_L2, 5)[1:-1, 1:-1]
    return np.asarray(valid & (deep <= max(2.0, _RIM * min(valid.shape))), np.bool_)


def bench_of(values: Floats, valid: Bools) -> Bench:
    """The bench in one channel: a smooth surface, first through the rim, then through all that agrees with it as well.

    Robust: the part, and what else is no bench, may cover a third of the rim.
    """
    edge = rim(valid)
    at = some(edge)
    c, sigma = robust(quadratic(valid.shape, at), values[at].astype(np.float64))
    near = edge | (valid & (np.abs(values - surface(valid.shape, c)) < 4 * sigma))
    at = some(near)
    c, sigma = robust(quartic(valid.shape, at), values[at].astype(np.float64), turns=4)
    return Bench(surface(valid.shape, c), sigma)
