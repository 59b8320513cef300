"""The grey value of the part's boundary, halfway between inside and outside, where the light is uneven: locally.

Inside and outside are measured in two bands beside the boundary, far enough from it that its blur does not reach them.
A level wrong by a tenth of the contrast moves a blurred edge (sigma 1 px) by a quarter of a pixel, so that one number
is used only where the light is really even.

Halfway is meant in the values of the file. The blur of lens and sensor acts on light; where the file's values are
proportional to light (machine cameras, gamma 1) halfway is where the edge is. A photo coded by the sRGB curve
has its edge at a higher value: between 60 and 200 at 151 instead of 130, so that a dark part looks smaller, and a
light one larger, by 0.43 of the blur's sigma on each side. This is not mended: cameras sharpen and bend the tones as
well, and the file does not say how.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from msgspec import Struct

from camgen.model.tolerance import SIGMAS_OF_MEDIAN
from camgen.vision.mask.cells import Bench, Bools, Bytes, Cells, Floats, depth

#: The bands begin so far from the boundary and are so wide, px.
BAND_BEGIN_PX, _BAND_WIDTH_PX = 2.5, 12.0
#: So many tiles along the longer side: the light changes slowly, texture is averaged out.
_TILES = 72
#: What a cell away from the boundary counts: it has a say only where no boundary is near.
_FAR_WEIGHT = np.float32(0.02)
#: What the smooth model counts: all only where nothing else is near.
_DOUBT = np.float32(0.001)
#: One number is enough where the level varies less than this along the boundary, of the contrast.
_EVEN = 0.02


class Levels(Struct, frozen=True, eq=False):
    """tiles: (m, n) float32, halfway at the tile centres. tile: cells along a tile's side. even: one number will do.

    inside, outside: mean value beside the boundary; without: the spread outside.
    """

    tiles: Floats
    tile: int
    middle: float
    even: bool
    inside: float
    outside: float
    without: float

    @property
    def contrast(self) -> float:
        """Inside minus outside: negative for a dark part."""
        return self.inside - self.outside


def halfway(values: Floats, part: Bools, cells: Cells, bench: Bench, black: float | None) -> Levels:
    """The levels of a first mask ``part`` (h, w) in one channel ``values`` (h, w).

    black: the value of a pixel without light. Part and bench are lit by the same light: what it does to the bench it
    does to the part. None: the channel is a difference, light has no say.
    """
    inner, outer = _side(part, cells), _side(~part, cells)
    near = inner == 1, outer == 1
    tile = max(4, math.ceil(max(values.shape) / _TILES))
    outside = bench.values + np.float32(np.median(values[near[1]] - bench.values[near[1]]))
    inside = _inside(values, near[0], outside, black)
    tiles = at_tiles(np.asarray((inside + outside) / 2, np.float32), tile)
    tiles += (_tile(values - inside, inner, tile) + _tile(values - outside, outer, tile)) / 2
    along = spread_out(tiles, tile, values.shape)[near[0] | near[1]]
    low, high = np.percentile(along, [2, 98])
    means = [float(np.mean(values[band])) for band in near]
    even = bool(high - low <= _EVEN * abs(means[0] - means[1]))
    # Against the light, so that it does not count.
    without = SIGMAS_OF_MEDIAN * float(np.median(np.abs(values[near[1]] - outside[near[1]])))
    return Levels(tiles, tile, float(np.mean(along)), even, means[0], means[1], without)


def _inside(values: Floats, inner: Bools, outside: Floats, black: float | None) -> Floats:
    """(h, w): the part's tone in its light, a multiple of the bench's or one tone, whatever is nearer to the truth."""
    tone = np.full_like(values, np.median(values[inner]))
    if black is None:
        return tone
    # Below ten levels a bench says nothing of the light.
    light = np.maximum(np.abs(outside - black), 10.0) * (
        1 if float(np.median(outside)) >= black else -1
    )
    lit = np.asarray(
        light * float(np.median((values[inner] - black) / light[inner])) + black, np.float32
    )
    near = [float(np.median(np.abs(values[inner] - model[inner]))) for model in (lit, tone)]
    return lit if near[0] <= near[1] else tone


def _side(region: Bools, cells: Cells) -> Floats:
    """(h, w): what the cells of ``region`` count: 1 in a band along its boundary, little farther in, 0 elsewhere."""
    # Measured from the other region alone: along what the photo does not show there is no boundary.
    deep = depth(region) * cells.valid
    start = 1 + math.ceil(BAND_BEGIN_PX / cells.size)
    band = (deep >= start) & (deep <= start + math.ceil(_BAND_WIDTH_PX / cells.size))
    if not band.any():  # thinner than the blur: its deepest cells
        band = deep >= max(1.0, 0.9 * float(deep.max()))
    return np.where(band, np.float32(1), np.where(deep > start, _FAR_WEIGHT, np.float32(0)))


def _tile(off: Floats, weight: Floats, tile: int) -> Floats:
    """(m, n): mean of ``off`` near each tile, towards 0 where nothing there counts."""
    sums = [cv2.GaussianBlur(_means(one, tile), (0, 0), 1.2) for one in (weight * off, weight)]
    return np.asarray(sums[0] / (sums[1] + _DOUBT), np.float32)


def _means(values: Floats, tile: int) -> Floats:
    padded = _pad(values, tile, cv2.BORDER_CONSTANT)
    size = (padded.shape[1] // tile, padded.shape[0] // tile)
    return np.asarray(cv2.resize(padded, size, interpolation=cv2.INTER_AREA), np.float32)


def at_tiles(smooth: Floats, tile: int) -> Floats:
    """(m, n): the means of smooth values (h, w) in the tiles."""
    padded = _pad(smooth, tile, cv2.BORDER_REPLICATE)
    size = (padded.shape[1] // tile, padded.shape[0] // tile)
    return np.asarray(cv2.resize(padded, size, interpolation=cv2.INTER_AREA), np.float32)


def _pad(values: Floats, tile: int, how: int) -> Floats:
    """So large that whole tiles cover the cells and the pixels that have no cell."""
    rows, columns = ((n // tile + 1) * tile - n for n in values.shape)
    return np.asarray(cv2.copyMakeBorder(values, 0, rows, 0, columns, how, value=0), np.float32)


def spread_out(tiles: Floats, tile: int, shape: tuple[int, ...]) -> Floats:
    """The tiles, each ``tile`` long, interpolated linearly to ``shape``."""
    rows, columns = tiles.shape
    whole = cv2.resize(tiles, (columns * tile, rows * tile), interpolation=cv2.INTER_LINEAR)
    return np.ascontiguousarray(whole[: shape[0], : shape[1]], np.float32)


def beyond(values: Floats | Bytes, level: float | Floats, dark: bool) -> Bytes:
    """0/255: which pixels are on the part's side of the level. On it is bench, for either kind of part."""
    if isinstance(level, float) and values.dtype == np.uint8:
        # Whole numbers: above 99.4 is above 99, below 99.4 is not above 99.
        least = math.ceil(level) - 1 if dark else math.floor(level)
        kind = cv2.THRESH_BINARY_INV if dark else cv2.THRESH_BINARY
        return np.asarray(cv2.threshold(values, least, 255, kind)[1], np.uint8)
    compare = np.less if dark else np.greater
    return np.asarray(compare(values, level).view(np.uint8) * np.uint8(255), np.uint8)
