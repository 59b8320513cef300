"""Finds the part in one channel of a picture: grey, a colour, or the difference from another photo.

Bench is the background of the part. A channel is one number per pixel in which part and bench
differ. The part is found in cells of the channel, and its border is then drawn again at local
thresholds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import cv2
import numpy as np
from msgspec import Struct

from camgen.model.errors import InputError
from camgen.model.part import Note
from camgen.model.text import short
from camgen.model.tolerance import SIGMAS_OF_MEDIAN
from camgen.vision.mask.cells import (
    Bench,
    Bools,
    Bytes,
    Cells,
    Floats,
    compute_covariance,
    compute_terms,
    evaluate_surface,
    fit_bench,
    fit_robustly,
    make_cells,
    measure_depth,
    sample_cells,
    select_inner_cells,
    select_rim,
)
from camgen.vision.mask.level import (
    BAND_BEGIN_PX,
    Thresholds,
    interpolate_tiles,
    measure_thresholds,
)

#: Smallest difference of the part from the bench, in standard deviations of the bench.
_MIN_SIGMAS = 6.0
#: Smallest difference of the part from the bench, grey values.
_MIN_CONTRAST = 5.0
#: Percent of the part that is nearer to the bench than the tone next to the bench. A soft shadow is
#: a smaller share, and weaker.
_NEAR_TONE_PERCENT = 15
#: Grey values: the bench is rough if its texture may differ by more than this.
_ROUGH = 12.0
#: Standard deviations of the Gaussians with which a rough bench is averaged, cells.
_SMOOTHING_SCALES = (3.0, 8.0)
#: A cell deep in the part belongs to it if it has this fraction of the usual difference.
_CORE_FRACTION = 0.75
#: A hole is filled if its mean difference has this fraction of the usual one.
_HOLE_FRACTION = 0.5
#: Fraction of the cells of a piece of the part that are seeds, at least.
_MIN_SEED_FRACTION = 0.05
#: Cells: depth up to which a cell may be a mixture of part and bench. A cell on the boundary has 1.
_MIXED_DEPTH = 1.5
#: Cells of a part, at least.
_MIN_PART_CELLS = 4
#: Times that a border is drawn again, and that a fit is repeated.
_ITERATIONS = 2
#: Rows of cells that are interpolated at a time.
_STRIP_ROWS = 64


class Channel(Struct, frozen=True, eq=False):
    """One number per pixel.

    pixels: makes the channel, (H, W) uint8 or float32, when it is called.
    cells: (h, w), the channel in cells.
    black: value of a pixel without light. None for a difference, on which light has no influence.
    """

    pixels: Callable[[], Bytes | Floats]
    cells: Floats
    black: float | None = 0.0


class Segmentation(Struct, frozen=True, eq=False):
    """Part and bench, distinguished in one channel.

    channel: the channel.
    part: (h, w), True in the cells of the part.
    thresholds: local thresholds between part and bench.
    bench: the bench in this channel.
    """

    channel: Channel
    part: Bools
    thresholds: Thresholds
    bench: Bench

    @property
    def clarity(self) -> float:
        """Contrast in standard deviations of the bench."""
        return abs(self.thresholds.contrast) / max(self.thresholds.outside_sigma, self.bench.sigma)


def find_differing_cells(
    values: Floats, cells: Cells, bench: Bench, invert: bool = False
) -> Bools | None:
    """Find the cells (h, w) that are lighter, or those that are darker, than the bench.

    The side with the larger sum of differences is the part, with `invert` the other side. Returns
    None if no part stands out.

    The threshold is halfway to the tone of the part next to that of the bench, if the part has
    several. The texture of a bench may reach it. Cells above it belong to the part only in one
    piece with cells that no texture reaches (hysteresis, Canny 1986).
    """
    difference = np.where(cells.valid, values - bench.values, np.float32(0))
    minimum = max(_MIN_SIGMAS * bench.sigma, _MIN_CONTRAST)
    seeds = [side * difference > minimum for side in (-1, 1)]
    side = _choose_side(difference, seeds, invert)
    part = seeds[(side + 1) // 2]
    threshold = _compute_threshold(side * difference, part, select_inner_cells(part))
    if threshold >= minimum:
        return np.asarray(side * difference > threshold, np.bool_)
    if minimum > _ROUGH:
        rough = [
            _find_seeds(side * difference, strong, cells)
            for side, strong in zip((-1, 1), seeds, strict=True)
        ]
        side = _choose_side(difference, [strong for strong, _ in rough], invert)
        part, inner = rough[(side + 1) // 2]
        threshold = _compute_threshold(side * difference, part, inner)
    if not threshold:
        return None
    above = np.asarray(side * difference > max(threshold, _MIN_CONTRAST), np.bool_)
    return _select_seeded_pieces(above, part, _MIN_PART_CELLS)


def _choose_side(difference: Floats, seeds: list[Bools], invert: bool) -> int:
    """-1 if the darker `seeds` (first) have the larger sum of differences, else 1."""
    darker, lighter = np.abs(difference[seeds[0]]).sum(), np.abs(difference[seeds[1]]).sum()
    return (-1, 1)[bool(lighter > darker) ^ invert]


def _compute_threshold(difference: Floats, part: Bools, inner: Bools) -> float:
    """Half the difference of the part's tone next to that of the bench; 0 without a part.

    At least a quarter of the median difference of the part.

    inner: the cells of the part without its boundary, which is a mixture.
    """
    tones = difference[inner if np.count_nonzero(inner) >= _MIN_PART_CELLS else part]
    if tones.size < _MIN_PART_CELLS:
        return 0.0
    near, median = np.percentile(tones, [_NEAR_TONE_PERCENT, 50]).tolist()
    return float(max(near / 2, median / 4))


def _find_seeds(difference: Floats, part: Bools, cells: Cells) -> tuple[Bools, Bools]:
    """The cells that no texture of a rough bench reaches, and those that lie deep among them.

    Texture averages out over several cells, and the part does not.

    difference: (h, w), the difference from the bench.
    part: (h, w), the cells that no texture of a single cell reaches.
    """
    seeds, inner = part.copy(), select_inner_cells(part)
    rim = cells.rim
    for scale in _SMOOTHING_SCALES:
        smooth = np.asarray(cv2.GaussianBlur(difference, (0, 0), scale), np.float32)
        sigma = SIGMAS_OF_MEDIAN * float(np.median(np.abs(smooth[rim])))
        strong = smooth > max(_MIN_SIGMAS * sigma, _MIN_CONTRAST)
        seeds |= strong & (difference > 0)
        inner |= measure_depth(strong) > _MIXED_DEPTH + 2 * scale
    return seeds, np.asarray(inner & seeds, np.bool_)


def _select_seeded_pieces(part: Bools, seeds: Bools, min_seeds: int = 1) -> Bools:
    """The connected pieces of `part` (h, w) with enough cells that are `seeds` (h, w).

    Enough are `min_seeds` cells and `_MIN_SEED_FRACTION` of the piece.
    """
    count, owners = cv2.connectedComponents(part.view(np.uint8), connectivity=4)
    sizes = np.bincount(owners.ravel(), minlength=count)
    seed_counts = np.bincount(owners[seeds], minlength=count)
    selected = seed_counts >= np.maximum(min_seeds, _MIN_SEED_FRACTION * sizes)
    selected[0] = False
    return np.asarray(selected[owners], np.bool_)


def split_at_threshold(
    values: Floats, cells: Cells, threshold: float, invert: bool = False
) -> Bools:
    """The cells (h, w) on the other side of the threshold than most of the rim.

    With `invert`, those on the side of the rim.
    """
    above = values > threshold
    bench_above = float(np.mean(above[cells.rim])) > 0.5
    return np.asarray((above ^ bench_above ^ invert) & cells.valid, np.bool_)


def compute_otsu_threshold(values: Floats) -> float:
    """Otsu's threshold of values (N,), between two whole grey values (Otsu 1979)."""
    rounded = np.clip(np.rint(values), 0, 255).astype(np.uint8)
    threshold = cv2.threshold(rounded, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)[0]
    return float(threshold) + 0.5


def redraw_part(
    channel: Channel, part: Bools | None, cells: Cells, bench: Bench | None = None
) -> Segmentation | None:
    """Draw the border of `part` (h, w) again at local thresholds, until it stays or twice.

    Only the border moves. A tone of the part may cross the threshold inside the part, and so may
    the texture of the bench outside of it.

    Returns None if there is no part, no bench, or no contrast.
    """
    bench = bench or fit_bench(channel.cells, cells)
    if part is None:
        return None
    first_part = part
    inner = measure_depth(part) > _MIXED_DEPTH + BAND_BEGIN_PX / cells.size
    difference = np.where(cells.valid, np.abs(channel.cells - bench.values), np.float32(0))
    usual = float(np.median(difference[inner])) if inner.any() else np.inf
    core = inner & (difference > _CORE_FRACTION * usual)
    for _ in range(_ITERATIONS):
        thresholds = _measure_part(channel, part, cells, bench)
        if thresholds is None:
            return None
        beyond = select_part_cells(channel, thresholds, cells) | core
        previous = part
        part = _fill_holes(
            _select_seeded_pieces(beyond, first_part), difference, _HOLE_FRACTION * usual
        )
        if is_same_part(part, previous):
            return Segmentation(channel, part, thresholds, bench)
    thresholds = _measure_part(channel, part, cells, bench)
    return None if thresholds is None else Segmentation(channel, part, thresholds, bench)


def select_part_cells(channel: Channel, thresholds: Thresholds, cells: Cells) -> Bools:
    """The cells (h, w) on the part's side of the local thresholds."""
    level = interpolate_tiles(thresholds.tiles, thresholds.tile, cells.valid.shape)
    compare = np.less if thresholds.contrast < 0 else np.greater
    return np.asarray(compare(channel.cells, level) & cells.valid, np.bool_)


def _fill_holes(part: Bools, difference: Floats, limit: float) -> Bools:
    """`part` with the holes whose mean difference from the bench is above `limit`.

    difference: (h, w), the difference of each cell.
    """
    if not (difference[~part] > limit).any():
        return part
    count, owners = cv2.connectedComponents((~part).view(np.uint8), connectivity=4)
    owner = owners.ravel()
    sizes = np.bincount(owner, minlength=count)
    means = np.bincount(owner, difference.ravel(), minlength=count) / np.maximum(sizes, 1)
    return np.asarray((means > limit)[owners] | part, np.bool_)


def measure_part(channel: Channel, part: Bools, cells: Cells) -> Segmentation | None:
    """A segmentation with `part` (h, w) as it is; only thresholds and bench are measured.

    Returns None if there is no part, no bench, or no contrast.
    """
    bench = fit_bench(channel.cells, cells)
    thresholds = _measure_part(channel, part, cells, bench)
    return Segmentation(channel, part, thresholds, bench) if thresholds is not None else None


def _measure_part(channel: Channel, part: Bools, cells: Cells, bench: Bench) -> Thresholds | None:
    """The thresholds between `part` (h, w) and the bench, or None if they cannot be measured."""
    if not part.any() or not (cells.valid & ~part).any():
        return None
    thresholds = measure_thresholds(channel.cells, part, cells, bench, channel.black)
    return thresholds if thresholds.contrast else None


def is_same_part(first: Bools, second: Bools) -> bool:
    """Whether two masks (h, w) differ only along their boundaries, or by 0.2 % of the smaller."""
    count = np.count_nonzero(select_inner_cells(first ^ second))
    smaller = min(np.count_nonzero(first), np.count_nonzero(second))
    return bool(count <= max(2, 0.002 * smaller))


def interpolate_strips(
    values: Floats, size: int, shape: tuple[int, ...]
) -> Iterator[tuple[slice, Floats]]:
    """Interpolate cells to the pixels of a picture of `shape`, a few rows at a time.

    The whole picture at once would need ten times the memory.

    values: (h, w) or (h, w, c).
    size: side of a cell, px.

    Yields the pixel rows of each strip and their values.
    """
    rows = values.shape[0]
    for first in range(0, rows, _STRIP_ROWS):
        last = min(first + _STRIP_ROWS, rows)
        # One row of cells more on both sides, so that strips agree where they meet.
        low, high = max(0, first - 1), min(rows, last + 1)
        top, bottom = first * size, shape[0] if last == rows else last * size
        strip = cv2.resize(values[low:high], (values.shape[1] * size, (high - low) * size))
        right, below = shape[1] - strip.shape[1], max(0, bottom - low * size - strip.shape[0])
        strip = cv2.copyMakeBorder(strip, 0, below, 0, right, cv2.BORDER_REPLICATE)
        inside = strip[top - low * size : bottom - low * size]
        yield slice(top, bottom), np.asarray(inside, np.float32)


# The part as the difference from a photo of the empty bench.


class _Light(Struct, frozen=True, eq=False):
    """Change of the light between two photos: photo = gain * other photo + offset.

    gains: (h, w, c), in cells.
    offsets: (c,), grey values.
    """

    gains: Floats
    offsets: Floats


#: Grey values: standard deviation with which a cell of the other photo's bench has to fit.
_MAX_FIT_SIGMA = 10.0
#: Grey values: a cell that differs less from a fit agrees with it.
_AGREEMENT = 6.0
#: Pairs of cells that are tried for a fit.
_PAIRS = 400
#: Smallest gain. Light changes by less; a gain near 0 would turn any bench into one of one tone.
_MIN_GAIN = 0.2


def find_by_background(pixels: Bytes, cells: Cells, empty: Bytes, name: str) -> Segmentation | None:
    """Find the part in the channel of the difference from a photo of the empty bench.

    empty: the photo, of the shape of `pixels`.
    name: file of the picture, for errors.

    Returns None if nothing differs. Raises InputError if the other photo shows another bench.
    """
    now, before = np.atleast_3d(cells.values), np.atleast_3d(make_cells(empty, None).values)
    light = _fit_light(before, now, cells.valid, name, "of the empty bench")
    difference = np.asarray(now - light.gains * before - light.offsets, np.float32)
    size = _project_difference(None, difference)
    part = find_differing_cells(size, cells, fit_bench(size, cells))
    if part is None or not (cells.valid & ~part).any():
        return None
    tone = np.median(now[part], axis=0).astype(np.float32)
    for axis in (_find_axis(difference, part, cells), None):
        expected = _project_difference(axis, tone - now + difference)
        even = _EvenDifference(axis, tone, float(np.median(expected[part])))
        compute_pixels = partial(_compute_difference, pixels, empty, light, even, cells.size)
        channel = Channel(compute_pixels, even.apply(now, difference), black=None)
        segmentation = redraw_part(channel, part, cells)
        # A part that is lighter than the bench here and darker there shows in the size alone.
        if segmentation is not None and (axis is None or is_same_part(segmentation.part, part)):
            return segmentation
    return None


class _EvenDifference(Struct, frozen=True, eq=False):
    """A difference that is the same wherever the part covers the bench, whatever texture it covers.

    axis: (1, c), direction in colours; None for the size of the difference.
    tone: (c,), colour of the part.
    usual: median difference of the part from the bench, along `axis`.
    """

    axis: Floats | None
    tone: Floats
    usual: float

    def apply(self, now: Floats, difference: Floats) -> Floats:
        """Even out the difference (h, w, c) of a picture `now` (h, w, c) from the bench.

        It is scaled by the difference that the tone of the part has at each place, at most
        threefold. Returns (h, w).
        """
        usual = abs(self.usual)
        at_tone = np.abs(_project_difference(self.axis, self.tone - now + difference))
        expected = np.maximum(at_tone, max(usual / 3, 1e-3))
        scaled = _project_difference(self.axis, difference) * (usual / expected)
        return np.asarray(scaled, np.float32)


def remove_shadows(pixels: Bytes, other: Bytes, name: str) -> Bytes:
    """The brighter one of two photos, pixel by pixel, in the light of the first.

    The lamp has another place in each. A shadow that is in one photo only is removed.

    pixels, other: the photos, (H, W) or (H, W, 3).
    name: file of `other`, for errors.

    Raises InputError if `other` shows another place.
    """
    now = np.atleast_3d(make_cells(pixels, None).values)
    before = np.atleast_3d(make_cells(other, None).values)
    light = _fit_light(before, now, np.ones(now.shape[:2], np.bool_), name, "with the lamp moved")
    brighter = np.empty_like(pixels)
    size = max(1, pixels.shape[0] // now.shape[0])
    for rows, gain in interpolate_strips(light.gains, size, pixels.shape):
        lit = gain.reshape(pixels[rows].shape) * other[rows] + light.offsets
        brighter[rows] = np.maximum(pixels[rows], np.rint(lit.clip(0, 255)).astype(np.uint8))
    return brighter


def _fit_light(before: Floats, now: Floats, valid: Bools, name: str, which: str) -> _Light:
    """Fit the light of each channel of the photo `before` (h, w, c) to that of `now` (h, w, c).

    name, which: file and name of the other photo, for errors.

    Raises InputError if the other photo shows another bench.
    """
    fits = [
        _fit_channel_light(before[..., k], now[..., k], valid, name, which)
        for k in range(now.shape[2])
    ]
    gains, offsets = zip(*fits, strict=True)
    return _Light(np.dstack(gains), np.array(offsets, np.float32))


def _fit_channel_light(
    before: Floats, now: Floats, valid: Bools, name: str, which: str
) -> tuple[Floats, float]:
    """Gain (h, w) and offset that turn the bench of the other photo into the bench of the photo.

    Gain and offset of a rim of one tone are ambiguous, and a large part hides the bench. So the
    fit starts from the rim and from lines through pairs of cells. The fit with which more cells
    agree is the result.
    """
    starts = (select_rim(valid), _find_bench_cells(before, now, valid))
    fits = [_fit_agreeing(before, now, start, valid) for start in starts]
    gain, offset, sigma, _ = max(fits, key=lambda fit: fit[3])
    if sigma > _MAX_FIT_SIGMA:
        raise InputError(
            name,
            f"the photo {which} shows another place, or the camera was moved",
            remedy="take both with the camera fixed, or choose another [image] mask",
        )
    return gain, offset


def _find_bench_cells(before: Floats, now: Floats, valid: Bools) -> Bools:
    """The cells (h, w) that agree with the most common gain and offset.

    Lines through random pairs of cells are tried (RANSAC, Fischler and Bolles 1981).
    """
    places = sample_cells(valid)
    b, n = before[places], now[places]
    first, second = np.random.default_rng(0).integers(0, len(b), (2, _PAIRS))
    differs = np.abs(b[second] - b[first]) > _AGREEMENT
    first, second = first[differs], second[differs]
    gains = (n[second] - n[first]) / (b[second] - b[first])
    likely = (gains > _MIN_GAIN) & (gains < 1 / _MIN_GAIN)
    # The last candidate has gain 1, for a bench of one tone.
    gains, first = np.append(gains[likely], np.float32(1)), first[likely]
    offsets = np.append(n[first] - gains[:-1] * b[first], np.median(n - b))
    agrees = np.abs(n - gains[:, None] * b - offsets[:, None]) < _AGREEMENT
    best = int(np.argmax(np.count_nonzero(agrees, axis=1)))
    residuals = np.abs(now - gains[best] * before - offsets[best])
    return np.asarray(valid & (residuals < _AGREEMENT), np.bool_)


def _fit_agreeing(
    before: Floats, now: Floats, start: Bools, valid: Bools
) -> tuple[Floats, float, float, int]:
    """Fit gain and offset to the cells `start` (h, w), then to all cells that agree.

    Returns gain (h, w), offset, standard deviation of the fit, and the number of cells that agree
    at the end; 0 if a gain is too small.
    """
    selected = start
    for _ in range(_ITERATIONS):
        gain, offset, sigma = _fit_gain(before, now, selected)
        residuals = np.abs(now - gain * before - offset)
        selected = np.asarray(valid & (residuals < 4 * sigma), np.bool_)
    count = int(np.count_nonzero(valid & (residuals < _AGREEMENT)))
    return gain, offset, sigma, count if gain.min() > _MIN_GAIN else 0


def _fit_gain(before: Floats, now: Floats, selected: Bools) -> tuple[Floats, float, float]:
    """Fit gain (h, w), a quadratic surface, and offset to the `selected` cells (h, w).

    Returns gain, offset and the standard deviation of the residuals.
    """
    places = sample_cells(selected)
    b, wanted = before[places].astype(np.float64), now[places].astype(np.float64)
    # In hundreds of grey values, so that gain and offset have terms of the same size.
    gain_terms = compute_terms(selected.shape, places) * (b / 100)[:, None]
    terms = np.column_stack([gain_terms, np.ones_like(b)])
    # The fit is to the change. On a bench of one tone gain and offset are ambiguous; then the
    # smallest change is taken.
    c, sigma = fit_robustly(terms, wanted - b)
    return evaluate_surface(selected.shape, c[:6] / 100) + np.float32(1), float(c[6]), sigma


def _find_axis(difference: Floats, part: Bools, cells: Cells) -> Floats:
    """The direction in colours (1, c) in which the part differs most clearly from the bench."""
    inside = difference[part].astype(np.float64)
    outside = difference[~part & cells.valid].astype(np.float64)
    noise = 2 * np.eye(difference.shape[2])
    covariance = compute_covariance(inside) + compute_covariance(outside) + noise
    axis = np.linalg.solve(covariance, np.median(inside, axis=0))
    # Upwards in brightness, so that a dark part is below the threshold here as well.
    length = float(np.abs(axis).sum()) * (1 if axis.sum() >= 0 else -1)
    if not length:
        return np.ones((1, len(axis)), np.float32)
    return np.asarray(axis / length, np.float32)[None, :]


def _compute_difference(
    pixels: Bytes, empty: Bytes, light: _Light, even: _EvenDifference, size: int
) -> Floats:
    """The even difference (H, W) of all pixels from the photo of the empty bench.

    size: side of a cell of `light`, px.
    """
    result = np.empty(pixels.shape[:2], np.float32)
    for rows, gain in interpolate_strips(light.gains, size, result.shape):
        shape = (*result[rows].shape, -1)
        now = pixels[rows].reshape(shape).astype(np.float32)
        before = empty[rows].reshape(shape).astype(np.float32)
        difference = now - gain.reshape(shape) * before - light.offsets
        result[rows] = even.apply(now, np.asarray(difference, np.float32))
    return result


def _project_difference(axis: Floats | None, difference: Floats) -> Floats:
    """Component (h, w) of a difference (h, w, c) along `axis` (1, c).

    None: its size, the root of the mean square.
    """
    if axis is None:
        return np.asarray(np.sqrt(np.square(difference).mean(axis=2)), np.float32)
    return np.asarray(difference @ axis[0], np.float32)


# The part by its colour.

#: Red, green, blue, 0 to 255.
Colour = tuple[float, float, float]

#: Factor on distances in L*a*b*, in which black and white are 100 apart, so that they count as grey
#: values do.
_LAB_SCALE = 2.55


def find_by_colour(pixels: Bytes, cells: Cells, given: Colour | None) -> Segmentation | None:
    """Find the part in the channel in which it stands out by its colour.

    given: the colour of the bench if most of the rim has it, else the colour of the part. None: the
        colour of the bench is measured at the rim.

    Returns None if no part stands out.
    """
    bench = _fit_bench_colours(cells)
    distance = _measure_lab_distance(cells.values, bench)
    if given is None:
        part = find_differing_cells(distance, cells, fit_bench(distance, cells))
    else:
        blue_green_red = np.array(given[::-1], np.float32)
        given_colours = np.broadcast_to(blue_green_red, cells.values.shape)
        from_given = _measure_lab_distance(cells.values, given_colours)
        differs = from_given > compute_otsu_threshold(from_given[cells.valid])
        if float(np.mean(differs[cells.rim])) < 0.5:
            bench, part = given_colours, differs & cells.valid
        else:
            part = (from_given < distance) & cells.valid
    if part is None or not part.any() or not (cells.valid & ~part).any():
        return None
    segmentation = _segment_projection(pixels, cells, part)
    return segmentation or _segment_distance(pixels, cells, bench, part)


def find_beside_shadow(pixels: Bytes, cells: Cells) -> Segmentation | None:
    """Find the part in a channel in which a shadow on the bench does not show.

    A shadow has the colour of the bench in less light: it lies between black and the bench's
    colour. What counts is the distance from that line.

    Returns None if no part stands out.
    """
    bench = _fit_bench_colours(cells)
    # The nearest place on the line, as a fraction of the bench's light.
    light = (cells.values * bench).sum(axis=2) / np.square(bench).sum(axis=2).clip(1)
    nearest = light.clip(0, 1)[..., None] * bench
    distance = np.sqrt(np.square(cells.values - nearest).sum(axis=2)).astype(np.float32)
    part = find_differing_cells(distance, cells, fit_bench(distance, cells))
    if part is None or not part.any() or not (cells.valid & ~part).any():
        return None
    return _segment_projection(pixels, cells, part)


def _fit_bench_colours(cells: Cells) -> Floats:
    """Colours (h, w, 3) of the bench without the part: blue, green, red."""
    return np.dstack([fit_bench(cells.values[..., k], cells).values for k in range(3)])


def _measure_lab_distance(colours: Floats, other: Floats) -> Floats:
    """Distance (h, w) of two pictures (h, w, 3) in L*a*b*, times `_LAB_SCALE`."""
    difference = _convert_to_lab(colours) - _convert_to_lab(other)
    distance = np.sqrt(np.square(difference).sum(axis=2))
    return np.asarray(distance * np.float32(_LAB_SCALE), np.float32)


def _convert_to_lab(colours: Floats) -> Floats:
    scaled = np.clip(colours, 0, 255).astype(np.float32) / np.float32(255)
    return np.asarray(cv2.cvtColor(scaled, cv2.COLOR_BGR2Lab), np.float32)


def _segment_projection(pixels: Bytes, cells: Cells, part: Bools) -> Segmentation | None:
    """Segment the channel of Fisher's linear discriminant between bench and `part` (h, w).

    It separates a part and a bench of one colour each. Returns None if it finds another part.
    """
    inner_part = select_inner_cells(part)
    inner_bench = select_inner_cells(~part) & cells.valid
    if not (inner_part.any() and inner_bench.any()):
        return None
    inside = cells.values[inner_part].astype(np.float64)
    outside = cells.values[inner_bench].astype(np.float64)
    # A little noise, so that the matrix can be inverted.
    covariance = compute_covariance(inside) + compute_covariance(outside) + 2 * np.eye(3)
    axis = np.linalg.solve(covariance, inside.mean(axis=0) - outside.mean(axis=0))
    axis *= 1 if axis.sum() >= 0 else -1  # Upwards in brightness.
    ends = np.percentile(cells.values[cells.valid] @ axis, [0, 100])
    if not np.ptp(ends):
        return None
    # The values run from 20 to 235, so that noise is not cut off and rounding to whole numbers is
    # finer than in the file.
    gain = 215 / np.ptp(ends)
    weights = np.append(axis * gain, 20 - ends[0] * gain)[None, :]
    channel = Channel(
        lambda: np.asarray(cv2.transform(pixels, weights), np.uint8),
        np.asarray(cells.values @ weights[0, :3] + weights[0, 3], np.float32),
        black=float(weights[0, 3]),
    )
    segmentation = redraw_part(channel, part, cells)
    if segmentation is None or not is_same_part(segmentation.part, part):
        return None
    return segmentation


def _segment_distance(
    pixels: Bytes, cells: Cells, bench: Floats, part: Bools
) -> Segmentation | None:
    """Segment the distance in colour from the bench (h, w, 3), for a part of several colours."""

    def compute_pixels() -> Floats:
        distance = np.empty(pixels.shape[:2], np.float32)
        strips = interpolate_strips(np.ascontiguousarray(bench), cells.size, distance.shape)
        for rows, bench_rows in strips:
            distance[rows] = _measure_lab_distance(pixels[rows].astype(np.float32), bench_rows)
        return distance

    in_cells = _measure_lab_distance(cells.values, bench)
    return redraw_part(Channel(compute_pixels, in_cells, black=None), part, cells)


# Noise that would break up the boundary is smoothed away.

#: Half the contrast in sigmas of the noise, at least. At 4.5 one pixel in 150 000 is on the wrong
#: side of the threshold.
_MIN_NOISE_RATIO = 4.5
#: px: sigma of the weakest and of the strongest smoothing.
_MIN_SMOOTHING, _MAX_SMOOTHING = 0.8, 2.5
#: px: distance from the boundary at which noise is measured, out of reach of the blur.
_NOISE_DISTANCE = 5.0


def smooth_noise(
    grey: Bytes | Floats, segmentation: Segmentation, cells: Cells
) -> tuple[Bytes | Floats, tuple[Note, ...]]:
    """Smooth a channel `grey` (H, W) if its noise is too strong for the contrast.

    A smoothed boundary of radius r moves by sigma^2 / 2 r towards its centre.

    Returns `grey` itself without a note, or the smoothed channel (float32) with a note.
    """
    min_depth = 1 + _NOISE_DISTANCE / cells.size
    regions = (segmentation.part, ~segmentation.part & cells.valid)
    noise = max(
        _measure_noise(grey, measure_depth(region) >= min_depth, cells.size) for region in regions
    )
    contrast = abs(segmentation.thresholds.contrast)
    ratio = contrast / 2 / max(noise, 1e-6)
    if ratio >= _MIN_NOISE_RATIO:
        return grey, ()
    # A Gaussian of this sigma divides white noise by sigma * 2 sqrt(pi). A half more is for noise
    # of neighbours that is alike.
    wanted = 1.5 * _MIN_NOISE_RATIO / ratio / (2 * np.sqrt(np.pi))
    sigma = float(np.clip(wanted, _MIN_SMOOTHING, _MAX_SMOOTHING))
    smooth = np.asarray(cv2.GaussianBlur(grey.astype(np.float32), (0, 0), sigma), np.float32)
    note = Note(
        "assumed",
        f"picture smoothed by {short(sigma, 1)} px",
        f"its noise is {short(noise, 1)}, part and bench are {short(contrast, 0)} apart",
    )
    return smooth, (note,)


def _measure_noise(grey: Bytes | Floats, region: Bools, size: int) -> float:
    """Noise of the pixels in the middle of the cells of `region` (h, w), a standard deviation.

    Each pixel is compared with its neighbours two pixels away along the row, as rectifying makes
    next neighbours alike. 0 without such cells, and in a picture of fewer than 5 columns.

    size: side of a cell, px.
    """
    if grey.shape[1] < 5:
        return 0.0
    rows, columns = sample_cells(region)
    v = rows * size + size // 2
    u = np.clip(columns * size + size // 2, 2, max(2, grey.shape[1] - 3))
    left, centre, right = grey[v, u + np.array([[-2], [0], [2]])].astype(np.float32)
    differences = 2 * centre - left - right
    if not differences.size:
        return 0.0
    return float(SIGMAS_OF_MEDIAN * float(np.median(np.abs(differences))) / np.sqrt(6))
