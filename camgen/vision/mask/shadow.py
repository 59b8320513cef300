"""The shadow of a part in a grey picture: the part's own outline, moved.

A part of two tones may have a dark area, or a shadow beside it. A lamp moves the outline of a part
by one vector: the shadow is what the moved part covers beside the part. No dark area within a part
has that shape on all sides and in all holes. The vector is found by correlation: with the larger
tone A and the other tone B, it makes the overlap of B with the moved A, less A, the largest share
of both together.
"""

from __future__ import annotations

import cv2
import numpy as np
from msgspec.structs import replace

from camgen.vision.mask.cells import Bools, Cells
from camgen.vision.mask.channel import Segmentation
from camgen.vision.mask.doubt import find_main_tone
from camgen.vision.mask.level import average_tiles, measure_thresholds

#: A shadow and the moved part agree in this share of both together, at least.
_AGREES = 0.8
#: The shadow has this share of the part, at least and at most. Its vector has this many cells.
_LEAST_SHARE, _MOST_SHARE, _LEAST_SHIFT = 0.01, 0.6, 2.0
#: The tone of a shadow is this share of the way from the part's to the bench's, at least.
_LEAST_GAP = 0.2
#: The vector has at most this share of the longer side of the part.
_MOST_SHIFT = 0.25


def find_part_beside_shadow(grey: Segmentation, cells: Cells) -> tuple[Segmentation, float] | None:
    """The part without the shadow that is joined to it, and the length of the vector, cells.

    None if it has no shadow.

    grey: the part with its shadow, in the grey picture. A shadow that differs more from the bench
        than the part does is not found.
    """
    tone = find_main_tone(grey)
    if tone is None:
        return None
    whole = _largest(grey.part)
    part = _largest(tone & whole)
    rest = _opened(whole & ~part)
    if not part.any():
        return None
    if not _LEAST_SHARE < np.count_nonzero(rest) / np.count_nonzero(part) < _MOST_SHARE:
        return None
    shift = _find_shift(part, rest)
    length = float(np.hypot(*shift))
    if length < _LEAST_SHIFT:
        return None
    covered = _opened(_moved(part, shift) & ~part)
    if np.count_nonzero(covered & rest) < _AGREES * np.count_nonzero(covered | rest):
        return None
    segmentation = _between(grey, part, rest, cells)
    return None if segmentation is None else (segmentation, length)


def _between(grey: Segmentation, part: Bools, shadow: Bools, cells: Cells) -> Segmentation | None:
    """The part at levels halfway between its tone and that of the shadow, in the bench's light.

    None if no such level has the shadow on the side of the bench.
    """
    values, light = grey.channel.cells, np.maximum(grey.bench.values, np.float32(1))
    tone = float(np.median((values / light)[part]))
    shadow_tone = float(np.median((values / light)[shadow]))
    if not _LEAST_GAP < (shadow_tone - tone) / (1 - tone) < 1:
        return None
    level = np.asarray(light * np.float32((tone + shadow_tone) / 2), np.float32)
    side = np.less if grey.thresholds.contrast < 0 else np.greater
    redrawn = np.asarray(side(values, level) & cells.valid, np.bool_)
    thresholds = measure_thresholds(values, redrawn, cells, grey.bench, grey.channel.black)
    if not thresholds.contrast:
        return None
    # The contrast of the part is that to its shadow: no threshold beyond that has a say.
    inside, outside = float(np.median(values[part])), float(np.median(values[shadow]))
    tiles = average_tiles(level, thresholds.tile)
    thresholds = replace(thresholds, tiles=tiles, even=False, inside=inside, outside=outside)
    return Segmentation(grey.channel, redrawn, thresholds, grey.bench)


def _find_shift(part: Bools, rest: Bools) -> tuple[int, int]:
    """The vector (rows, columns), cells, that makes the moved part agree best with `rest`."""
    rows, columns = np.flatnonzero(part.any(axis=1)), np.flatnonzero(part.any(axis=0))
    reach = int(_MOST_SHIFT * max(np.ptp(rows), np.ptp(columns))) + 1
    shape = [cv2.getOptimalDFTSize(side + reach) for side in part.shape]
    of_part = np.fft.rfft2(part.astype(np.float32), shape)
    overlap = np.fft.irfft2(np.fft.rfft2(rest.astype(np.float32), shape) * np.conj(of_part), shape)
    stays = np.fft.irfft2(of_part * np.conj(of_part), shape)
    size = np.count_nonzero(part) + np.count_nonzero(rest)
    score = overlap / np.maximum(size - stays - overlap, 1.0)
    near = np.zeros(score.shape, np.bool_)
    steps = np.arange(-reach, reach + 1)
    near[np.ix_(steps % shape[0], steps % shape[1])] = True
    row, column = np.unravel_index(int(np.argmax(np.where(near, score, -1.0))), score.shape)
    return (int(row) + reach) % shape[0] - reach, (int(column) + reach) % shape[1] - reach


def _moved(area: Bools, shift: tuple[int, int]) -> Bools:
    matrix = np.array([[1.0, 0.0, shift[1]], [0.0, 1.0, shift[0]]])
    size = (area.shape[1], area.shape[0])
    moved = cv2.warpAffine(area.view(np.uint8), matrix, size, flags=cv2.INTER_NEAREST)
    return np.asarray(moved, np.uint8).view(np.bool_)


def _opened(area: Bools) -> Bools:
    """`area` without strips of two cells or fewer: blurred borders."""
    opened = cv2.morphologyEx(area.view(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    return np.asarray(opened, np.uint8).view(np.bool_)


def _largest(area: Bools) -> Bools:
    if not area.any():
        return area
    _, owners, stats, _ = cv2.connectedComponentsWithStats(area.view(np.uint8), connectivity=4)
    return np.asarray(owners == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA])), np.bool_)
