"""Finds the pixels of a rectified view that show the part, and the threshold at its boundary.

The bench is the background of the part: what touches the border of the picture. Light and tones
change slowly, so they are measured in cells of several pixels (`cells`). `level` measures the
threshold, and describes how the tones of the camera are assumed to be. `channel` makes one channel
of a picture in colour, or of two pictures. The method is that of PIST, section 3.2.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Literal

import cv2
import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.model.errors import InputError, JobError
from camgen.model.job import ImageTable
from camgen.model.part import Note
from camgen.model.text import counted, short
from camgen.vision.mask.cells import (
    Bools,
    Bytes,
    Cells,
    Floats,
    fit_bench,
    make_cells,
    select_inner_cells,
)
from camgen.vision.mask.channel import (
    Channel,
    Colour,
    Segmentation,
    compute_otsu_threshold,
    find_beside_shadow,
    find_by_background,
    find_by_colour,
    find_differing_cells,
    is_same_part,
    measure_part,
    redraw_part,
    select_part_cells,
    smooth_noise,
    split_at_threshold,
)
from camgen.vision.mask.clean import clean_mask
from camgen.vision.mask.doubt import (
    UncertainRegions,
    draw_uncertain_regions,
    find_main_tone,
    find_uncertain_regions,
    shift_threshold,
)
from camgen.vision.mask.level import interpolate_tiles, select_part_pixels
from camgen.vision.mask.shadow import find_part_beside_shadow
from camgen.vision.mask.touching import TouchingPlace, find_touching_places
from camgen.vision.to_scale import ScaledView

# The methods by name, and how `auto` chooses among them.

Method = Literal["auto", "otsu", "threshold", "color", "background", "adaptive", "alpha"]

#: A part is clear if its contrast is this many standard deviations of the bench.
_MIN_CLARITY = 6.0
#: The light is even if the bench varies by at most this fraction over the picture.
_EVEN_LIGHT = 0.15
#: Colour shows more than grey if this fraction of the part by colour is missing in grey.
_MIN_MISSING = 0.05
#: Cells that are enough to choose between colour and grey.
_CHOICE_CELLS = 30_000
#: Grey values: a picture has colour if its channels differ by more than this somewhere.
_MIN_COLOUR = 8.0
#: A note warns of a given threshold that is off the middle by more than this fraction of the
#: contrast: that moves the outline by a quarter of the sigma of the blur.
_MAX_OFF_MIDDLE = 0.1
#: A note names things on the other side of the bench's grey value from this fraction of the part's
#: area on.
_MIN_OTHER_SIDE = 0.05
#: An area that is left out as a shadow has at most this fraction of the part's area, else it may be
#: a part.
_MAX_SHADOW = 0.4
#: A note names a shadow that is left out from this fraction of the part's area on.
_MIN_SHADOW = 0.01
#: Smallest opacity of a part, of 255.
HALF_OPAQUE = 127.5
#: Places that a note lists, the largest ones.
_MAX_PLACES = 20


class MaskOptions(Struct, frozen=True, eq=False):
    """The settings of the segmentation.

    method: the method, or auto.
    threshold: given grey value between part and bench, None for none.
    color: given colour of bench or part, None for none.
    invert: the part is on the other side of the bench than where it would be found.
    name: file of the picture, for errors.
    """

    method: Method
    threshold: float | None
    color: Colour | None
    invert: bool
    name: str


class MaskChoice(Struct, frozen=True, eq=False):
    """A segmentation and the method that made it.

    method: the method.
    why: reason for the method, a sentence.
    segmentation: part and bench.
    level: given threshold; None for the measured thresholds of the segmentation.
    notes: notes to the user.
    others: parts (h, w) that other methods found, by name, if `auto` has tried these.
    """

    method: Method
    why: str
    segmentation: Segmentation
    level: float | None = None
    notes: tuple[Note, ...] = ()
    others: dict[str, Bools] = {}


def choose_mask(
    pixels: Bytes, empty: Bytes | None, cells: Cells, options: MaskOptions
) -> MaskChoice:
    """Segment a picture by the method of the options.

    pixels: (H, W) or (H, W, 3).
    empty: view of the empty bench, for the method background; its shape is that of `pixels`.
    cells: `pixels` in cells.

    Raises InputError if the method finds no part.
    """
    if options.method == "background" and empty is not None:
        choice = _segment_by_background(pixels, empty, cells, options)
    else:
        choice = _METHODS[options.method](pixels, cells, options)
    if choice is not None:
        return choice
    what = "shows no part: nothing in it stands out from the bench along its border"
    if options.method != "auto":
        what = f'shows no part that [image] mask = "{options.method}" can separate from the bench'
    raise InputError(
        options.name,
        what,
        remedy="put the part on a bench of another colour, in even light, "
        "or choose another [image] mask",
    )


def _make_choice(
    method: Method, why: str, segmentation: Segmentation | None, level: float | None = None
) -> MaskChoice | None:
    """The choice of a segmentation; None without one."""
    if segmentation is None:
        return None
    return MaskChoice(method, why, segmentation, level)


def _make_grey_channel(pixels: Bytes, cells: Cells) -> Channel:
    if pixels.ndim == 2:
        return Channel(lambda: pixels, cells.values)
    grey = cv2.cvtColor(cells.values, cv2.COLOR_BGR2GRAY)
    return Channel(
        lambda: np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY), np.uint8),
        np.asarray(grey, np.float32),
    )


def _split_by_otsu(values: Floats, cells: Cells, invert: bool) -> tuple[float, Bools]:
    """Otsu's threshold of `values` (h, w), and the part (h, w) at it."""
    level = compute_otsu_threshold(values[cells.valid])
    return level, split_at_threshold(values, cells, level, invert)


def _segment_by_otsu(pixels: Bytes, cells: Cells, options: MaskOptions) -> MaskChoice | None:
    channel = _make_grey_channel(pixels, cells)
    level, part = _split_by_otsu(channel.cells, cells, options.invert)
    why = f"Otsu's threshold, {short(level, 1)}, finds the part"
    return _make_choice("otsu", why, redraw_part(channel, part, cells))


def _segment_by_threshold(pixels: Bytes, cells: Cells, options: MaskOptions) -> MaskChoice | None:
    """The part at a given threshold, which is used as it is; Otsu's threshold without a given one.

    A note warns of a threshold that is not halfway between part and bench.
    """
    channel = _make_grey_channel(pixels, cells)
    level = options.threshold
    if level is None:
        level = compute_otsu_threshold(channel.cells[cells.valid])
    part = split_at_threshold(channel.cells, cells, level, options.invert)
    segmentation = measure_part(channel, part, cells)
    if segmentation is None:
        return None
    notes: tuple[Note, ...] = ()
    middle = segmentation.thresholds.middle
    if abs(level - middle) > _MAX_OFF_MIDDLE * abs(segmentation.thresholds.contrast):
        notes = (
            Note(
                "warning",
                f"the threshold {short(level, 1)} is not halfway between part and bench "
                f"({short(middle, 1)})",
                "the outline lies beside the edge, by a part of its blur",
            ),
        )
    return MaskChoice(
        "threshold", f"the threshold {short(level, 1)} is given", segmentation, level, notes
    )


def _segment_adaptively(pixels: Bytes, cells: Cells, options: MaskOptions) -> MaskChoice | None:
    channel = _make_grey_channel(pixels, cells)
    bench = fit_bench(channel.cells, cells)
    part = find_differing_cells(channel.cells, cells, bench, options.invert)
    segmentation = redraw_part(channel, part, cells, bench)
    if segmentation is None:
        return None
    return MaskChoice(
        "adaptive",
        "the threshold follows the light on the bench",
        segmentation,
        notes=_note_other_side(segmentation, cells),
    )


def _note_other_side(segmentation: Segmentation, cells: Cells) -> tuple[Note, ...]:
    """A note if much is lighter than the bench beside a dark part, or darker beside a light one.

    Glare and dirt are too small for a note.
    """
    contrast = segmentation.thresholds.contrast
    is_dark = contrast < 0
    difference = segmentation.channel.cells - segmentation.bench.values
    other_side = (difference * (1 if is_dark else -1) > abs(contrast) / 2) & cells.valid
    area = np.count_nonzero(select_inner_cells(other_side))
    fraction = area / np.count_nonzero(segmentation.part)
    if fraction < _MIN_OTHER_SIDE:
        return ()
    tone = "lighter" if is_dark else "darker"
    return (
        Note(
            "warning",
            f"what is {tone} than the bench is not taken for the part",
            f"it is {100 * fraction:.0f} % as large; set [image] invert to take it instead, "
            "or give background for both",
        ),
    )


def _segment_by_colour(pixels: Bytes, cells: Cells, options: MaskOptions) -> MaskChoice | None:
    if pixels.ndim == 2:
        raise InputError(
            options.name, "is grey", remedy='[image] mask = "color" needs a picture in colour'
        )
    is_given = options.color is not None
    why = "a colour is given" if is_given else "the bench's colour is measured along the border"
    return _make_choice("color", why, find_by_colour(pixels, cells, options.color))


def _segment_by_background(
    pixels: Bytes, empty: Bytes, cells: Cells, options: MaskOptions
) -> MaskChoice | None:
    segmentation = find_by_background(pixels, cells, empty, options.name)
    return _make_choice("background", "a photo of the empty bench is given", segmentation)


def _segment_automatically(pixels: Bytes, cells: Cells, options: MaskOptions) -> MaskChoice | None:
    """Grey, if it shows the part clearly and all of it, else colour.

    Grey is preferred because lens and blur act on it most directly.
    """
    grey = _segment_adaptively(pixels, cells, options)
    has_colour = _has_colour(cells)
    sampled = _sample_by_colour(pixels, cells, options) if has_colour else None
    choice = _choose_grey_or_colour(pixels, cells, options, grey, sampled)
    if choice is None:
        return None
    choice = replace(choice, others=_list_others(cells, options, choice, grey, sampled))
    if has_colour and _find_uncertain(choice, cells, 0.0) is not None:
        return _leave_out_shadow(pixels, cells, choice)
    return choice if choice.method == "color" else _leave_out_moved_outline(choice, cells)


def _list_others(
    cells: Cells,
    options: MaskOptions,
    choice: MaskChoice,
    grey: MaskChoice | None,
    sampled: MaskChoice | None,
) -> dict[str, Bools]:
    """Parts (h, w) of other methods by name, to be compared with the chosen one.

    A method counts if it shows the part clearly, one threshold only in even light.

    grey: the part in grey.
    sampled: the part by its colour, in a sample of the cells.
    """
    others: dict[str, Bools] = {}
    if grey is not None and grey.segmentation.clarity >= _MIN_CLARITY:
        others["adaptive"] = grey.segmentation.part
        if _measure_light_variation(grey.segmentation, cells) <= _EVEN_LIGHT:
            values = grey.segmentation.channel.cells
            _, others["otsu"] = _split_by_otsu(values, cells, options.invert)
    if sampled is None or choice.method == "color":
        return others
    if sampled.segmentation.clarity >= _MIN_CLARITY:
        others["color"] = _expand_sample(sampled.segmentation.part, cells.valid.shape)
    return others


def _leave_out_moved_outline(choice: MaskChoice, cells: Cells) -> MaskChoice:
    """The part without a shadow that is its own outline, moved; `choice` itself without one."""
    beside_shadow = find_part_beside_shadow(choice.segmentation, cells)
    if beside_shadow is None:
        return choice
    bare, shift = beside_shadow
    note = Note(
        "warning",
        "a shadow or a wall is left out: it is the outline of the part, moved",
        f"by {shift * cells.size:.0f} px of the view; if it is part, give image.threshold; "
        "look at the preview",
    )
    others = {"with its shadow": choice.segmentation.part}
    return replace(choice, segmentation=bare, notes=(*choice.notes, note), others=others)


def _leave_out_shadow(pixels: Bytes, cells: Cells, choice: MaskChoice) -> MaskChoice:
    """The part without its shadow, if the colour of the bench shows one; else `choice` itself."""
    bare = find_beside_shadow(pixels, cells)
    if bare is None or bare.clarity < _MIN_CLARITY or find_main_tone(bare) is not None:
        return choice
    if choice.method == "color" and is_same_part(bare.part, choice.segmentation.part):
        return replace(choice, others={})
    area = np.count_nonzero(bare.part)
    shadow_area = np.count_nonzero(choice.segmentation.part & ~bare.part)
    if _has_more(bare.part, choice.segmentation.part) or shadow_area > _MAX_SHADOW * area:
        return choice
    notes: tuple[Note, ...] = ()
    if shadow_area > _MIN_SHADOW * area:
        notes = (
            Note(
                "warning",
                "a shadow beside the part is left out: "
                "it has the colour of the bench in less light",
                "if it is part, choose another image.mask; look at the preview",
            ),
        )
    return MaskChoice(
        "color", f"a shadow does not show in it; {_describe_contrast(bare)}", bare, notes=notes
    )


def _find_uncertain(choice: MaskChoice, cells: Cells, min_area: float) -> UncertainRegions | None:
    """The regions that other methods, thresholds or tones classify differently; None without any.

    min_area: area of the smallest region, px2.
    """
    if choice.method == "alpha":
        return None
    others = {**shift_threshold(choice.segmentation, cells), **choice.others}
    tone = find_main_tone(choice.segmentation)
    if tone is not None:
        others["one tone of it"] = tone
    return find_uncertain_regions(choice.segmentation.part, others, cells, min_area)


def _choose_grey_or_colour(
    pixels: Bytes,
    cells: Cells,
    options: MaskOptions,
    grey: MaskChoice | None,
    sampled: MaskChoice | None,
) -> MaskChoice | None:
    """Choose the part in grey, or by its colour if there is a reason for that.

    grey: the part in grey.
    sampled: the part by its colour, in a sample of the cells.

    Returns None if neither shows a part.
    """
    reason = _explain_colour(sampled, grey)
    colour = _segment_by_colour(pixels, cells, options) if reason else None
    if colour is not None:
        return _with_reason(colour, reason)
    if grey is None:
        return None
    if grey.segmentation.clarity >= _MIN_CLARITY:
        return _choose_by_light(cells, options, grey)
    note = Note(
        "warning", "part and bench hardly differ", "look at the mask, or give [image] background"
    )
    return replace(_with_reason(grey, grey.why), notes=(*grey.notes, note))


def is_cut_out(alpha: Bytes) -> bool:
    """Whether a picture shows a cut-out part: most of its border is transparent, and not all of it.

    Round corners and holes do not make a cut-out.

    alpha: (H, W), 0 transparent to 255 opaque.
    """
    rows = (alpha[0], alpha[-1], alpha[1:-1, 0], alpha[1:-1, -1])
    border = np.concatenate(rows) < HALF_OPAQUE
    return bool(2 * np.count_nonzero(border) > len(border) and alpha.max() > HALF_OPAQUE)


def _segment_by_alpha(pixels: Bytes, cells: Cells, options: MaskOptions) -> MaskChoice | None:
    """The opaque area of a view of the transparency. Half-covered pixels are half opaque."""
    channel = _make_grey_channel(pixels, cells)
    part = ((channel.cells > HALF_OPAQUE) ^ options.invert) & cells.valid
    return _make_choice(
        "alpha",
        "the picture is transparent around it; image.mask chooses by grey or color",
        measure_part(channel, np.asarray(part, np.bool_), cells),
        HALF_OPAQUE,
    )


def _sample_by_colour(pixels: Bytes, cells: Cells, options: MaskOptions) -> MaskChoice | None:
    """The part by its colour in a sample of the cells, evenly spread."""
    step = _compute_sample_step(cells.valid.shape)
    sample = Cells(
        np.ascontiguousarray(cells.values[::step, ::step]),
        cells.valid[::step, ::step].copy(),
        cells.size * step,
    )
    return _segment_by_colour(pixels, sample, options)


def _compute_sample_step(shape: tuple[int, ...]) -> int:
    """Step in rows and in columns that leaves about `_CHOICE_CELLS` of the cells."""
    return max(1, math.isqrt(shape[0] * shape[1] // _CHOICE_CELLS))


def _expand_sample(sample: Bools, shape: tuple[int, ...]) -> Bools:
    """A sample of the cells, each one repeated, in an array of `shape`."""
    step = _compute_sample_step(shape)
    expanded = sample.repeat(step, axis=0).repeat(step, axis=1)
    return np.asarray(expanded[: shape[0], : shape[1]], np.bool_)


def _explain_colour(sampled: MaskChoice | None, grey: MaskChoice | None) -> str:
    """The reason to prefer colour to grey; empty if there is no reason.

    sampled: the part by its colour, in a sample of the cells.
    """
    if sampled is None or sampled.segmentation.clarity < _MIN_CLARITY:
        return ""
    if grey is None or grey.segmentation.clarity < _MIN_CLARITY:
        return "part and bench differ in colour more clearly than in grey"
    step = _compute_sample_step(grey.segmentation.part.shape)
    if _has_more(sampled.segmentation.part, grey.segmentation.part[::step, ::step].copy()):
        return "colour shows more of the part than grey does"
    return ""


def _choose_by_light(cells: Cells, options: MaskOptions, grey: MaskChoice) -> MaskChoice:
    """Name Otsu's threshold, the simpler method, if the light is even and it finds the same part.

    The segmentation is that of `grey` in any case.
    """
    variation = _measure_light_variation(grey.segmentation, cells)
    if variation > _EVEN_LIGHT:
        return _with_reason(grey, f"the light varies by {100 * variation:.0f} % over the picture")
    _, part = _split_by_otsu(grey.segmentation.channel.cells, cells, options.invert)
    if not is_same_part(part, grey.segmentation.part):
        return _with_reason(
            grey,
            "one threshold for the whole picture finds something else than the bench's rim says",
        )
    return _with_reason(replace(grey, method="otsu"), "the light is even")


def _measure_light_variation(segmentation: Segmentation, cells: Cells) -> float:
    """Variation of the bench over the picture, as a fraction of its median grey value."""
    values = segmentation.bench.values[cells.valid]
    low, median, high = np.percentile(values, [1, 50, 99]).tolist()
    return float((high - low) / max(median, 1.0))


def _with_reason(choice: MaskChoice, reason: str) -> MaskChoice:
    """The choice with a reason and its contrast as `why`, and with the measured thresholds."""
    return MaskChoice(
        choice.method,
        f"{reason}; {_describe_contrast(choice.segmentation)}",
        choice.segmentation,
        notes=choice.notes,
    )


def _describe_contrast(segmentation: Segmentation) -> str:
    contrast = segmentation.thresholds.contrast
    sigma = max(segmentation.thresholds.outside_sigma, segmentation.bench.sigma)
    side = "darker" if contrast < 0 else "lighter"
    is_grey = segmentation.channel.black == 0
    what = "grey levels " + side if is_grey else "levels of colour apart"
    return f"the part is {abs(contrast):.0f} {what}, the bench varies by {short(sigma, 1)}"


def _has_colour(cells: Cells) -> bool:
    if cells.values.ndim == 2:
        return False
    blue, green, red = np.moveaxis(cells.values[::2, ::2], 2, 0)
    differences = (np.abs(red - green) + np.abs(blue - green))[cells.valid[::2, ::2]]
    return bool(differences.max(initial=0) > _MIN_COLOUR)


def _has_more(first: Bools, second: Bools) -> bool:
    """Whether much of the part `first` (h, w) is missing in `second` (h, w), boundaries aside."""
    around = cv2.dilate(second.view(np.uint8), np.ones((5, 5), np.uint8)).view(np.bool_)
    return bool(np.count_nonzero(first & ~around) > _MIN_MISSING * np.count_nonzero(first))


_METHODS: dict[Method, Callable[[Bytes, Cells, MaskOptions], MaskChoice | None]] = {
    "auto": _segment_automatically,
    "otsu": _segment_by_otsu,
    "threshold": _segment_by_threshold,
    "color": _segment_by_colour,
    "adaptive": _segment_adaptively,
    "alpha": _segment_by_alpha,
}


_DEFAULTS = ImageTable()


class Mask(Struct, frozen=True, eq=False):
    """The part in a view.

    pixels: (H, W) uint8, 255 part and 0 bench, read-only. A pixel is part if `grey` is on the
        part's side of `level`, with these exceptions: where the photo shows nothing, dropped
        specks, filled holes, tones within the part and texture of the bench beyond `level`.
    method: the method that was used.
    why: reason for the method, a sentence.
    grey: (H, W) uint8 or float32, channel in which the boundary of the part is at `level`.
    level: threshold of all pixels, or (H, W) float32.
    dark: the part is below `level`, else it is above.
    notes: notes to the user.
    doubt: (H, W) uint8, 255 at pixels that other methods classify differently by more than a
        border; None if there are no such pixels.
    """

    pixels: Bytes
    method: Method
    why: str
    grey: Bytes | Floats
    level: float | Floats
    dark: bool
    notes: tuple[Note, ...] = ()
    doubt: Bytes | None = None


def make_mask(
    view: ScaledView,
    settings: ImageTable = _DEFAULTS,
    background: ScaledView | None = None,
    name: str = "picture",
    *,
    examined: bool = True,
) -> Mask:
    """Make the mask of the part, or of the parts, in a view.

    settings: the table image of the job. Where its `mask` is auto, a threshold or a color chooses
        the method that uses it. Pieces and holes below `min_area` (mm2) are noise.
    background: view of the empty bench at the same scale; it chooses the method background.
    name: file of the picture, for errors.
    examined: whether the mask is compared with those of other methods, and touching parts are
        searched. A coarse view, which only shows where the part is, needs neither.

    Raises JobError for settings that do not fit together; InputError if there is no part, or if it
    touches the border of what the photo shows; NoSafeProgram if no part dominates the mask.
    """
    _check_background(view, background)
    method, colour = _choose_method(settings, background), _check_colour(settings)
    options = MaskOptions(method, settings.threshold, colour, settings.invert, name)
    cells = make_cells(view.pixels, view.valid)
    if not cells.valid.any():
        raise InputError(
            name, "shows nothing of the work plane", remedy="check the work plane and the region"
        )
    empty = None if background is None else background.pixels
    choice = choose_mask(view.pixels, empty, cells, options)
    segmentation, thresholds = choice.segmentation, choice.segmentation.thresholds
    grey, notes = smooth_noise(segmentation.channel.pixels(), segmentation, cells)
    level: float | Floats = thresholds.middle if choice.level is None else float(choice.level)
    if choice.level is None and not thresholds.even:
        level = interpolate_tiles(thresholds.tiles, thresholds.tile * cells.size, grey.shape)
    dark = thresholds.contrast < 0
    pixels = select_part_pixels(grey, level, dark)
    if choice.level is None:
        _restore_segmentation(pixels, segmentation, cells)
    if view.valid is not None:
        pixels[~view.valid] = 0
    notes += clean_mask(
        pixels, view, settings.min_area, name, accepts_specks="specks" in settings.accept
    )
    doubt: Bytes | None = None
    if examined:
        uncertain = _find_uncertain(choice, cells, settings.min_area / view.mm_per_px**2)
        if uncertain is not None:
            notes += (_note_uncertain(uncertain, cells, view),)
            doubt = draw_uncertain_regions(uncertain, cells, pixels.shape)
        notes += _note_touching(find_touching_places(pixels, cells), cells, view)
    # Views, since the grey picture may be the caller's own.
    pixels, grey = pixels.view(), grey.view()
    for array in (pixels, grey, level):
        if isinstance(array, np.ndarray):
            array.flags.writeable = False
    return Mask(pixels, choice.method, choice.why, grey, level, dark, choice.notes + notes, doubt)


def _restore_segmentation(pixels: Bytes, segmentation: Segmentation, cells: Cells) -> None:
    """Set the pixels where the threshold alone contradicts the segmentation, in place.

    These are tones within the part, and the texture of the bench. The border is left as it is.
    """
    part = segmentation.part
    differs = select_part_cells(segmentation.channel, segmentation.thresholds, cells) ^ part
    if not differs.any():
        return
    around = cv2.dilate(differs.view(np.uint8), np.ones((3, 3), np.uint8)).view(np.bool_)
    rows, columns = differs.shape
    cell_of_row = np.minimum(np.arange(pixels.shape[0]) // cells.size, rows - 1)
    cell_of_column = np.minimum(np.arange(pixels.shape[1]) // cells.size, columns - 1)
    for side, value in ((part, 255), (~part, 0)):
        inner = around & select_inner_cells(side)
        pixels[inner[np.ix_(cell_of_row, cell_of_column)]] = value


def _note_uncertain(uncertain: UncertainRegions, cells: Cells, view: ScaledView) -> Note:
    mm2 = (cells.size * view.mm_per_px) ** 2
    count = len(uncertain.places)
    methods = ", ".join(
        f"{name} by {short(size * mm2, 1)} mm2" for name, size in uncertain.by_method
    )
    middles = [(u, v) for v, u in uncertain.places[:_MAX_PLACES]]
    return Note(
        "warning",
        f"{counted(count, 'place')}, {short(int(uncertain.cells.sum()) * mm2, 1)} mm2 in all, "
        f"{'are' if count > 1 else 'is'} part or bench by the method: "
        "a shadow, a shine, or uneven light?",
        f"others differ there: {methods}; look at the preview, set image.mask or image.threshold, "
        "or give image.background",
        places=_convert_to_work(middles, cells, view),
    )


def _note_touching(
    touching: list[TouchingPlace], cells: Cells, view: ScaledView
) -> tuple[Note, ...]:
    if not touching:
        return ()
    listed = touching[:_MAX_PLACES]
    lengths = ", ".join(
        f"{short(place.length * cells.size * view.mm_per_px, 1)} mm" for place in listed
    )
    return (
        Note(
            "warning",
            f"parts seem to touch or overlap in {counted(len(touching), 'place')}: "
            "taken for one, with one outline",
            f"two sharp notches face each other there, {lengths} apart; "
            "move the parts apart, or crop with image.region",
            places=_convert_to_work([place.middle for place in listed], cells, view),
        ),
    )


def _convert_to_work(
    points: Sequence[tuple[float, float]], cells: Cells, view: ScaledView
) -> tuple[tuple[float, float], ...]:
    """Convert points (u, v) in cells to (x, y) in the work frame, mm."""
    return view.convert_to_work(np.array(points) * cells.size + (cells.size - 1) / 2)


def _choose_method(settings: ImageTable, background: ScaledView | None) -> Method:
    """The method of the settings; where that is auto, the one that a given value is for.

    Raises JobError for a method without the value that it needs.
    """
    given: dict[Method, bool] = {
        "background": background is not None,
        "threshold": settings.threshold is not None,
        "color": settings.color is not None,
    }
    method = settings.mask
    if method in ("background", "threshold") and not given[method]:
        raise JobError(
            "[image] mask",
            f'"{method}" needs [image] {method}',
            remedy="give it, or choose another",
        )
    if method != "auto":
        return method
    return next((candidate for candidate, is_given in given.items() if is_given), "auto")


def _check_colour(settings: ImageTable) -> Colour | None:
    if settings.color is None:
        return None
    if len(settings.color) != 3 or not all(0 <= value <= 255 for value in settings.color):
        raise JobError(
            "[image] color",
            f"{settings.color} is not a colour",
            remedy="give [red, green, blue], each 0 to 255",
        )
    red, green, blue = settings.color
    return red, green, blue


def _check_background(view: ScaledView, background: ScaledView | None) -> None:
    if background is None or background.pixels.shape == view.pixels.shape:
        return
    raise JobError(
        "[image] background",
        f"its picture and the photo differ: {_describe_picture(background)} "
        f"and {_describe_picture(view)}",
        remedy="take both with the same camera and settings, and treat both alike",
    )


def _describe_picture(view: ScaledView) -> str:
    height, width = view.pixels.shape[:2]
    return f"{width} x {height} px in {'grey' if view.pixels.ndim == 2 else 'colour'}"
