"""Uncertain regions of a mask: cells that other segmentation methods classify differently.

If the part stands out clearly from the background, all methods agree except along its blurred
border. A cast shadow, a shiny face or uneven light makes them disagree.
"""

from __future__ import annotations

from collections.abc import Mapping

import cv2
import numpy as np
from msgspec import Struct

from camgen.vision.mask.cells import Bools, Bytes, Cells, measure_depth, select_inner_cells
from camgen.vision.mask.channel import Segmentation, compute_otsu_threshold
from camgen.vision.mask.level import interpolate_tiles

#: A part has two tones if the variance between them is at least this fraction of its variance.
#: Evenly spread values have 0.75.
_BETWEEN_VARIANCE = 0.8
#: Grey values, of 255, by which two tones differ at least: less is noise.
_MIN_TONE_DIFFERENCE = 8.0
#: Fraction of the contrast by which the threshold is moved to either side.
_THRESHOLD_SHIFT = 0.25
#: Cells by which a blurred border may move. A difference that reaches deeper is more than that.
_BORDER_DEPTH = 2.5
#: Smallest region that is reported, as a fraction of the area of the part.
_MIN_AREA_FRACTION = 0.002


class UncertainRegions(Struct, frozen=True, eq=False):
    """The uncertain regions of a segmentation.

    cells: (h, w), True in the cells that another method classifies differently.
    by_method: name of each method that differs and the number of its cells, largest number first.
    places: (row, column) of the centroid of each connected region, largest region first.
    """

    cells: Bools
    by_method: tuple[tuple[str, int], ...]
    places: tuple[tuple[int, int], ...]


def shift_threshold(segmentation: Segmentation, cells: Cells) -> dict[str, Bools]:
    """The part at a threshold nearer to the background, and at one nearer to the part.

    Returns two masks (h, w), by the name that a note gives them.
    """
    thresholds = segmentation.thresholds
    level = interpolate_tiles(thresholds.tiles, thresholds.tile, segmentation.part.shape)
    is_part = np.less if thresholds.contrast < 0 else np.greater
    masks: dict[str, Bools] = {}
    for name, fraction in (("the bench", -_THRESHOLD_SHIFT), ("the part", _THRESHOLD_SHIFT)):
        shifted = level + np.float32(fraction * thresholds.contrast)
        part = is_part(segmentation.channel.cells, shifted) & cells.valid
        masks[f"a level nearer to {name}"] = np.asarray(part, np.bool_)
    return masks


def find_main_tone(segmentation: Segmentation) -> Bools | None:
    """The larger area, (h, w), of a part with two tones: the smaller one may be its shadow.

    Returns None if the part has a single tone, or no cell inside its border. The tones are compared
    in the light of the background, as a part in uneven light has many.
    """
    inner = select_inner_cells(segmentation.part)
    bench = np.maximum(segmentation.bench.values, np.float32(1))
    values = segmentation.channel.cells * (
        np.median(bench) / bench if segmentation.channel.black == 0 else np.float32(1)
    )
    tones = values[inner]
    if not len(tones):
        return None
    level = compute_otsu_threshold(tones)
    is_light = tones > level
    light_fraction = float(np.mean(is_light))
    if not 0 < light_fraction < 1:
        return None
    difference = float(tones[is_light].mean() - tones[~is_light].mean())
    between_variance = light_fraction * (1 - light_fraction) * difference**2
    is_single = between_variance < _BETWEEN_VARIANCE * float(tones.var())
    if difference < _MIN_TONE_DIFFERENCE or is_single:
        return None
    return np.asarray(segmentation.part & ((values > level) == (light_fraction > 0.5)), np.bool_)


def find_uncertain_regions(
    part: Bools, others: Mapping[str, Bools], cells: Cells, min_area: float
) -> UncertainRegions | None:
    """Compare the mask `part` (h, w) with the masks of other methods.

    others: masks (h, w) by the name of their method.
    min_area: area of the smallest region that is reported, px2 of the picture.

    Returns None if no method differs by more than borders and small regions.
    """
    uncertain = np.zeros_like(part)
    cell_counts: dict[str, int] = {}
    min_cells = max(min_area / cells.size**2, _MIN_AREA_FRACTION * np.count_nonzero(part))
    for name, other in others.items():
        regions = _select_large_regions(part ^ other, min_cells)
        if regions is not None:
            cell_counts[name] = int(np.count_nonzero(regions))
            uncertain |= regions
    if not cell_counts:
        return None
    by_method = tuple(sorted(cell_counts.items(), key=lambda entry: -entry[1]))
    _, _, stats, centroids = cv2.connectedComponentsWithStats(uncertain.view(np.uint8))
    order = np.argsort(-stats[1:, cv2.CC_STAT_AREA], kind="stable")
    places = tuple((round(float(v)), round(float(u))) for u, v in centroids[1:][order].tolist())
    return UncertainRegions(uncertain, by_method, places)


def _select_large_regions(differs: Bools, min_cells: float) -> Bools | None:
    """The connected regions of `differs` (h, w) that are wide enough and large enough.

    Such a region is deeper than `_BORDER_DEPTH` somewhere. Returns None if there is no such region.
    """
    deep = measure_depth(differs) > _BORDER_DEPTH
    if not deep.any():
        return None
    count, labels, stats, _ = cv2.connectedComponentsWithStats(differs.view(np.uint8))
    selected = np.zeros(count, np.bool_)
    selected[np.unique(labels[deep])] = True
    selected &= stats[:, cv2.CC_STAT_AREA] >= min_cells
    selected[0] = False
    return np.asarray(selected[labels], np.bool_) if selected.any() else None


def draw_uncertain_regions(
    regions: UncertainRegions, cells: Cells, shape: tuple[int, ...]
) -> Bytes:
    """(H, W) picture of `shape`, 255 at the uncertain pixels and 0 elsewhere."""
    rows, columns = regions.cells.shape
    picture = cv2.resize(
        regions.cells.view(np.uint8) * np.uint8(255),
        (columns * cells.size, rows * cells.size),
        interpolation=cv2.INTER_NEAREST,
    )
    # Rows and columns at the end that fill no cell.
    below, right = shape[0] - picture.shape[0], shape[1] - picture.shape[1]
    return np.asarray(
        cv2.copyMakeBorder(picture, 0, below, 0, right, cv2.BORDER_CONSTANT, value=0), np.uint8
    )
