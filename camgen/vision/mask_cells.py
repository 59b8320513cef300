"""The picture in cells, means of n x n pixels: where bench and light are learned, at a small part of the cost.

What is slow in the picture (light, tones, which side is the bench) is found here; only the last comparison is made at
every pixel.
"""

from __future__ import annotations

import cv2
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.vision.mask_fit import quadratic, quartic, robust, some, surface

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
    noise = 1.4826 * float(np.median(np.abs(off[::2]))) / 6**0.5 if off.size else 0.0
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
