"""Measures the threshold between part and bench, halfway between their grey values.

In uneven light the threshold is local. Part and bench are measured in two bands beside the boundary
of the part, so far from it that its blur does not reach them. A threshold that is wrong by a tenth
of the contrast moves a blurred edge (sigma 1 px) by a quarter of a pixel. So one number for the
whole picture is used only if the light is really even.

Halfway is meant in the values of the file. The blur of lens and sensor acts on light. If the values
are proportional to light (machine cameras, gamma 1), the edge is exactly halfway. In a photo coded
by the sRGB curve the edge is at a higher value, between 60 and 200 at 151 instead of 130. Then a
dark part looks smaller, and a light one larger, by 0.43 of the blur's sigma on each side. This is
not corrected here: cameras sharpen and bend the tones as well, and the file does not state how.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from msgspec import Struct

from camgen.model.tolerance import SIGMAS_OF_MEDIAN
from camgen.vision.mask.cells import Bench, Bools, Bytes, Cells, Floats, measure_depth

#: px: distance of the bands from the boundary. The blur of the boundary ends there.
BAND_BEGIN_PX = 2.5
#: px: width of the bands.
_BAND_WIDTH_PX = 12.0
#: Tiles along the longer side: light changes slowly over them, and texture averages out in them.
_TILES = 72
#: Weight of a cell farther from the boundary than the bands, which have 1. It matters only where no
#: boundary is near.
_FAR_WEIGHT = np.float32(0.02)
#: Weight of the smooth model of part and bench. It matters only in tiles without any cell nearby.
_MODEL_WEIGHT = np.float32(0.001)
#: One number is enough if the threshold varies less than this along the boundary, as a fraction of
#: the contrast.
_EVEN = 0.02
#: Grey values: with less light than this the bench does not show how light varies.
_MIN_LIGHT = 10.0


class Thresholds(Struct, frozen=True, eq=False):
    """Local thresholds between part and bench in one channel, in its grey values.

    tiles: (m, n) float32, threshold at the centre of each tile.
    tile: side of a tile, cells.
    middle: mean threshold along the boundary.
    even: whether `middle` is exact enough everywhere.
    inside: mean value of the part beside the boundary.
    outside: mean value of the bench beside the boundary.
    outside_sigma: standard deviation of the bench there, uneven light removed.
    """

    tiles: Floats
    tile: int
    middle: float
    even: bool
    inside: float
    outside: float
    outside_sigma: float

    @property
    def contrast(self) -> float:
        """Inside minus outside: negative for a dark part."""
        return self.inside - self.outside


def measure_thresholds(
    values: Floats, part: Bools, cells: Cells, bench: Bench, black: float | None
) -> Thresholds:
    """Measure the thresholds between the part of a first mask and the bench.

    values: (h, w), one channel.
    part: (h, w), the first mask; part and bench both have cells.
    black: value of a cell without light. Part and bench are in the same light, so the part becomes
        darker where the bench does. None for a difference, on which light has no influence.
    """
    inner, outer = _weigh_cells(part, cells), _weigh_cells(~part, cells)
    inner_band, outer_band = inner == 1, outer == 1
    tile = max(4, math.ceil(max(values.shape) / _TILES))
    outside = bench.values + np.float32(np.median(values[outer_band] - bench.values[outer_band]))
    inside = _model_part(values, inner_band, outside, black)
    tiles = average_tiles(np.asarray((inside + outside) / 2, np.float32), tile)
    tiles += (
        _average_nearby(values - inside, inner, tile)
        + _average_nearby(values - outside, outer, tile)
    ) / 2
    along = interpolate_tiles(tiles, tile, values.shape)[inner_band | outer_band]
    low, high = np.percentile(along, [2, 98])
    inside_mean = float(np.mean(values[inner_band]))
    outside_mean = float(np.mean(values[outer_band]))
    even = bool(high - low <= _EVEN * abs(inside_mean - outside_mean))
    # From the bench in its light, so that uneven light does not count.
    deviations = np.abs(values[outer_band] - outside[outer_band])
    sigma = SIGMAS_OF_MEDIAN * float(np.median(deviations))
    return Thresholds(tiles, tile, float(np.mean(along)), even, inside_mean, outside_mean, sigma)


def _model_part(values: Floats, band: Bools, outside: Floats, black: float | None) -> Floats:
    """Values (h, w) of the part in its light: a multiple of the light on the bench, or one tone.

    The model with the smaller median error in `band` is taken.
    """
    tone = np.full_like(values, np.median(values[band]))
    if black is None:
        return tone
    sign = 1 if float(np.median(outside)) >= black else -1
    light = np.maximum(np.abs(outside - black), _MIN_LIGHT) * sign
    factor = float(np.median((values[band] - black) / light[band]))
    lit = np.asarray(light * factor + black, np.float32)
    lit_error = np.median(np.abs(values[band] - lit[band]))
    return lit if lit_error <= np.median(np.abs(values[band] - tone[band])) else tone


def _weigh_cells(region: Bools, cells: Cells) -> Floats:
    """Weights (h, w): 1 in the band along the boundary of `region`, little deeper, 0 elsewhere."""
    # The depth is the distance to the other region: the border of the photo is not a boundary.
    depth = measure_depth(region) * cells.valid
    start = 1 + math.ceil(BAND_BEGIN_PX / cells.size)
    band = (depth >= start) & (depth <= start + math.ceil(_BAND_WIDTH_PX / cells.size))
    if not band.any():  # The region is thinner than the blur: its deepest cells count.
        band = depth >= max(1.0, 0.9 * float(depth.max()))
    return np.where(band, np.float32(1), np.where(depth > start, _FAR_WEIGHT, np.float32(0)))


def _average_nearby(deviations: Floats, weights: Floats, tile: int) -> Floats:
    """Weighted mean (m, n) of the cells near each tile; towards 0 where no weight is near."""
    weighted = average_tiles(weights * deviations, tile, cv2.BORDER_CONSTANT)
    total = average_tiles(weights, tile, cv2.BORDER_CONSTANT)
    blurred = cv2.GaussianBlur(weighted, (0, 0), 1.2)
    return np.asarray(blurred / (cv2.GaussianBlur(total, (0, 0), 1.2) + _MODEL_WEIGHT), np.float32)


def average_tiles(values: Floats, tile: int, border: int = cv2.BORDER_REPLICATE) -> Floats:
    """Means (m, n) in whole tiles that cover all cells, and all pixels that belong to no cell.

    values: (h, w) values of the cells.
    tile: side of a tile, cells.
    border: OpenCV's border type, which continues `values` beyond their border.
    """
    rows, columns = (np.array(values.shape) // tile * tile + tile - values.shape).tolist()
    padded = np.asarray(
        cv2.copyMakeBorder(values, 0, rows, 0, columns, border, value=0), np.float32
    )
    size = (padded.shape[1] // tile, padded.shape[0] // tile)
    return np.asarray(cv2.resize(padded, size, interpolation=cv2.INTER_AREA), np.float32)


def interpolate_tiles(tiles: Floats, tile: int, shape: tuple[int, ...]) -> Floats:
    """Interpolate values at tile centres linearly to an array of `shape`.

    tile: side of a tile in elements of that array.
    """
    rows, columns = tiles.shape
    whole = cv2.resize(tiles, (columns * tile, rows * tile), interpolation=cv2.INTER_LINEAR)
    return np.ascontiguousarray(whole[: shape[0], : shape[1]], np.float32)


def select_part_pixels(values: Floats | Bytes, level: float | Floats, dark: bool) -> Bytes:
    """Mask (H, W), 255 at pixels below `level` for a dark part, above it for a light one, else 0.

    A pixel exactly at the threshold is bench in both cases.
    """
    if isinstance(level, float) and values.dtype == np.uint8:
        # In whole numbers, above 99.4 is above 99, and below 99.4 is not above 99.
        limit = math.ceil(level) - 1 if dark else math.floor(level)
        kind = cv2.THRESH_BINARY_INV if dark else cv2.THRESH_BINARY
        return np.asarray(cv2.threshold(values, limit, 255, kind)[1], np.uint8)
    compare = np.less if dark else np.greater
    return np.asarray(compare(values, level).view(np.uint8) * np.uint8(255), np.uint8)
