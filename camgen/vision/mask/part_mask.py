"""Which pixels of a to-scale view show the part (PIST, section 3.2), and the grey value of its boundary.

The bench is what touches the border of the picture. What is slow in the picture (light, tones) is learned in cells of
some pixels, ``cells``; ``level`` has the grey value of the boundary and what is assumed of the camera's
tones; ``channel`` makes one channel of a coloured picture, or of two.
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
from camgen.vision.mask.cells import Bools, Bytes, Cells, Floats, bench_of, cells_of, inner_cells
from camgen.vision.mask.channel import (
    Channel,
    Colour,
    Found,
    as_it_is,
    beyond_level,
    differing,
    find_beside_shadow,
    find_by_background,
    find_by_colour,
    otsu,
    quiet,
    same,
    settle,
    split_at,
)
from camgen.vision.mask.clean import clean
from camgen.vision.mask.doubt import Doubt, find_doubt, first_tone, other_levels, show_doubt
from camgen.vision.mask.level import beyond, spread_out
from camgen.vision.mask.shadow import find_part_beside_shadow
from camgen.vision.mask.touching import Meeting, meetings
from camgen.vision.to_scale import ScaledView

# The methods by name, and how ``auto`` chooses among them.

Method = Literal["auto", "otsu", "threshold", "color", "background", "adaptive", "alpha"]

#: A part is clear if its contrast is so many times the spread of the bench.
_CLEAR_CONTRAST = 6.0
#: The light is even if the bench varies by less than this over the picture.
_EVEN = 0.15
#: Colour shows more than grey if so much of what it finds is missing there.
_MORE = 0.05
#: So many cells are enough to choose.
_ENOUGH = 30_000
#: A picture has colour if its channels differ by so much somewhere.
_COLOURED = 8.0
#: A given threshold that is off the middle by so much of the contrast is worth a note: a quarter of the blur.
_OFF_MIDDLE = 0.1
#: What differs from the bench the other way is worth a note from so much of the part on.
_OTHER_SIDE = 0.05
#: An area that is left out as a shadow has at most this share of the part's, else it may be a part.
#: From this share on there is a note.
_MOST_SHADOW, _LEAST_SHADOW = 0.4, 0.01
#: The opacity of the part, of 255, is at least this.
HALF_OPAQUE = 127.5
#: Places of a note that are shown, the largest ones.
_MOST_PLACES = 20


class Asked(Struct, frozen=True, eq=False):
    """The settings. name: of the file, for errors."""

    method: Method
    threshold: float | None
    color: Colour | None
    invert: bool
    name: str


class MaskChoice(Struct, frozen=True, eq=False):
    """What was found and how. level: a given one, instead of halfway. others: what other ways found, by name, where
    ``auto`` has looked at them.
    """

    method: Method
    why: str
    found: Found
    level: float | None = None
    notes: tuple[Note, ...] = ()
    others: dict[str, Bools] = {}


def choose_mask(pixels: Bytes, empty: Bytes | None, cells: Cells, asked: Asked) -> MaskChoice:
    """The part by the method asked for. InputError where it shows none."""
    if asked.method == "background" and empty is not None:
        choice = _background(pixels, empty, cells, asked)
    else:
        choice = _METHODS[asked.method](pixels, cells, asked)
    if choice is not None:
        return choice
    what = "shows no part: nothing in it stands out from the bench along its border"
    if asked.method != "auto":
        what = f'shows no part that [image] mask = "{asked.method}" tells from the bench'
    remedy = (
        "put the part on a bench of another colour, in even light, or choose another [image] mask"
    )
    raise InputError(asked.name, what, remedy=remedy)


def _grey(pixels: Bytes, cells: Cells) -> Channel:
    if pixels.ndim == 2:
        return Channel(lambda: pixels, cells.values)
    grey = cv2.cvtColor(cells.values, cv2.COLOR_BGR2GRAY)
    return Channel(
        lambda: np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY), np.uint8),
        np.asarray(grey, np.float32),
    )


def _otsu(pixels: Bytes, cells: Cells, asked: Asked) -> MaskChoice | None:
    channel = _grey(pixels, cells)
    level = otsu(channel.cells, cells)
    found = settle(channel, split_at(channel.cells, cells, level, asked.invert), cells)
    return (
        MaskChoice("otsu", f"Otsu's threshold, {short(level, 1)}, finds the part", found)
        if found
        else None
    )


def _threshold(pixels: Bytes, cells: Cells, asked: Asked) -> MaskChoice | None:
    channel = _grey(pixels, cells)
    level = asked.threshold if asked.threshold is not None else otsu(channel.cells, cells)
    found = as_it_is(channel, split_at(channel.cells, cells, level, asked.invert), cells)
    if found is None:
        return None
    notes: tuple[Note, ...] = ()
    middle, contrast = found.levels.middle, abs(found.levels.contrast)
    if abs(level - middle) > _OFF_MIDDLE * contrast:
        what = f"the threshold {short(level, 1)} is not halfway between part and bench ({short(middle, 1)})"
        notes = (Note("warning", what, "the outline lies beside the edge, by a part of its blur"),)
    return MaskChoice("threshold", f"the threshold {short(level, 1)} is given", found, level, notes)


def _adaptive(pixels: Bytes, cells: Cells, asked: Asked) -> MaskChoice | None:
    channel = _grey(pixels, cells)
    bench = bench_of(channel.cells, cells.valid)
    found = settle(channel, differing(channel.cells, cells, bench, asked.invert), cells, bench)
    if found is None:
        return None
    return MaskChoice(
        "adaptive",
        "the threshold follows the light on the bench",
        found,
        notes=_other_side(found, cells),
    )


def _other_side(found: Found, cells: Cells) -> tuple[Note, ...]:
    """A note on what differs from the bench the other way, if that is more than glare or dirt."""
    dark = found.levels.contrast < 0
    off = (found.channel.cells - found.bench.values) * (1 if dark else -1)
    other = (off > abs(found.levels.contrast) / 2) & cells.valid
    part = np.count_nonzero(inner_cells(other)) / np.count_nonzero(found.part)
    if part < _OTHER_SIDE:
        return ()
    what = f"what is {'lighter' if dark else 'darker'} than the bench is not taken for the part"
    why = f"it is {100 * part:.0f} % as large; set [image] invert to take it instead, or give background for both"
    return (Note("warning", what, why),)


def _color(pixels: Bytes, cells: Cells, asked: Asked) -> MaskChoice | None:
    if pixels.ndim == 2:
        raise InputError(
            asked.name, "is grey", remedy='[image] mask = "color" needs a picture in colour'
        )
    found = find_by_colour(pixels, cells, asked.color)
    why = (
        "the bench's colour is measured along the border"
        if asked.color is None
        else "a colour is given"
    )
    return MaskChoice("color", why, found) if found else None


def _background(pixels: Bytes, empty: Bytes, cells: Cells, asked: Asked) -> MaskChoice | None:
    found = find_by_background(pixels, cells, empty, asked.name)
    return MaskChoice("background", "a photo of the empty bench is given", found) if found else None


def _auto(pixels: Bytes, cells: Cells, asked: Asked) -> MaskChoice | None:
    """Grey, if it shows the part clearly and all of it, else colour: grey is nearer to what a lens and a blur do."""
    grey = _adaptive(pixels, cells, asked)
    few = _few_coloured(pixels, cells, asked) if _find_coloured(cells) else None
    choice = _choose(pixels, cells, asked, grey, few)
    if choice is None:
        return None
    others: dict[str, Bools] = {}
    # A method has a say where it tells the part clearly, one threshold where the light is even.
    if grey is not None and grey.found.clear >= _CLEAR_CONTRAST:
        others["adaptive"] = grey.found.part
        if _variation_of_light(grey.found, cells) <= _EVEN:
            values = grey.found.channel.cells
            others["otsu"] = split_at(values, cells, otsu(values, cells), asked.invert)
    if few is not None and few.found.clear >= _CLEAR_CONTRAST and choice.method != "color":
        others["color"] = _as_many(few.found.part, cells.valid.shape)
    choice = replace(choice, others=others)
    if _find_coloured(cells) and _doubt(choice, cells, 0.0) is not None:
        return _without_shadow(pixels, cells, choice)
    return choice if choice.method == "color" else _without_moved_outline(choice, cells)


def _without_moved_outline(choice: MaskChoice, cells: Cells) -> MaskChoice:
    """The part without a shadow that is its own outline, moved; else ``choice``."""
    bare = find_part_beside_shadow(choice.found, cells)
    if bare is None:
        return choice
    what = "a shadow or a wall is left out: it is the outline of the part, moved"
    why = f"by {bare.shift * cells.size:.0f} px of the view; if it is part, give image.threshold"
    note = Note("warning", what, f"{why}; look at the preview")
    others = {"with its shadow": choice.found.part}
    notes = (*choice.notes, note)
    return replace(choice, found=bare.segmentation, notes=notes, others=others)


def _without_shadow(pixels: Bytes, cells: Cells, choice: MaskChoice) -> MaskChoice:
    """The part without its shadow, if the colour of the bench shows one; else ``choice``."""
    beside = find_beside_shadow(pixels, cells)
    if beside is None or beside.clear < _CLEAR_CONTRAST or first_tone(beside) is not None:
        return choice
    if choice.method == "color" and same(beside.part, choice.found.part):
        return replace(choice, others={})
    area = np.count_nonzero(beside.part)
    left_out = np.count_nonzero(choice.found.part & ~beside.part)
    if _more(beside.part, choice.found.part) or left_out > _MOST_SHADOW * area:
        return choice
    notes: tuple[Note, ...] = ()
    if left_out > _LEAST_SHADOW * area:
        what = "a shadow beside the part is left out: it has the colour of the bench in less light"
        why = "if it is part, choose another image.mask; look at the preview"
        notes = (Note("warning", what, why),)
    return MaskChoice(
        "color", f"a shadow does not show in it; {_apart(beside)}", beside, notes=notes
    )


def _doubt(choice: MaskChoice, cells: Cells, least: float) -> Doubt | None:
    """The places that other methods, levels or tones see differently.

    least: area of a place, px2.
    """
    if choice.method == "alpha":
        return None
    others = {**other_levels(choice.found, cells), **choice.others}
    tone = first_tone(choice.found)
    if tone is not None:
        others["one tone of it"] = tone
    return find_doubt(choice.found.part, others, cells, least)


def _choose(
    pixels: Bytes, cells: Cells, asked: Asked, grey: MaskChoice | None, few: MaskChoice | None
) -> MaskChoice | None:
    reason = _for_colour(few, grey)
    colour = _color(pixels, cells, asked) if reason else None
    if colour is not None:
        return _because(colour, reason)
    if grey is None:
        return None
    if grey.found.clear < _CLEAR_CONTRAST:
        note = Note(
            "warning",
            "part and bench hardly differ",
            "look at the mask, or give [image] background",
        )
        return MaskChoice(
            grey.method, f"{grey.why}; {_apart(grey.found)}", grey.found, notes=(*grey.notes, note)
        )
    return _by_light(cells, asked, grey)


def is_cut_out(alpha: Bytes) -> bool:
    """Whether a picture shows a cut-out part: most of its border is transparent, and not all of it.

    Round corners and holes do not make a cut-out.
    alpha: (H, W), 0 transparent to 255 opaque.
    """
    rows = (alpha[0], alpha[-1], alpha[1:-1, 0], alpha[1:-1, -1])
    border = np.concatenate(rows) < HALF_OPAQUE
    return bool(2 * np.count_nonzero(border) > len(border) and alpha.max() > HALF_OPAQUE)


def _alpha(pixels: Bytes, cells: Cells, options: Asked) -> MaskChoice | None:
    """The opaque area of a view of the transparency. Half-covered pixels are half opaque."""
    channel = _grey(pixels, cells)
    part = ((channel.cells > HALF_OPAQUE) ^ options.invert) & cells.valid
    outline = as_it_is(channel, np.asarray(part, np.bool_), cells)
    why = "the picture is transparent around it; image.mask chooses by grey or color"
    return MaskChoice("alpha", why, outline, HALF_OPAQUE) if outline else None


def _few_coloured(pixels: Bytes, cells: Cells, asked: Asked) -> MaskChoice | None:
    """The part by its colour in some of the cells, evenly spread."""
    step = _step(cells.valid.shape)
    few = Cells(
        np.ascontiguousarray(cells.values[::step, ::step]),
        cells.valid[::step, ::step].copy(),
        cells.size * step,
    )
    return _color(pixels, few, asked)


def _step(shape: tuple[int, ...]) -> int:
    return max(1, math.isqrt(shape[0] * shape[1] // _ENOUGH))


def _as_many(few: Bools, shape: tuple[int, ...]) -> Bools:
    """Some of the cells spread to all of ``shape``."""
    step = _step(shape)
    return np.asarray(
        few.repeat(step, axis=0).repeat(step, axis=1)[: shape[0], : shape[1]], np.bool_
    )


def _for_colour(colour: MaskChoice | None, grey: MaskChoice | None) -> str:
    """Why colour is better than grey; empty if it is not. Judged by some of the cells."""
    if colour is None or colour.found.clear < _CLEAR_CONTRAST:
        return ""
    if grey is None or grey.found.clear < _CLEAR_CONTRAST:
        return "part and bench differ in colour more clearly than in grey"
    step = _step(grey.found.part.shape)
    more = _more(colour.found.part, grey.found.part[::step, ::step].copy())
    return "colour shows more of the part than grey does" if more else ""


def _by_light(cells: Cells, asked: Asked, grey: MaskChoice) -> MaskChoice:
    """Otsu's threshold, the simpler method, if the light is even and it finds the same."""
    varies = _variation_of_light(grey.found, cells)
    if varies > _EVEN:
        return _because(grey, f"the light varies by {100 * varies:.0f} % over the picture")
    channel = grey.found.channel
    plain = split_at(channel.cells, cells, otsu(channel.cells, cells), asked.invert)
    if not same(plain, grey.found.part):
        return _because(
            grey,
            "one threshold for the whole picture finds something else than the bench's rim says",
        )
    return _because(MaskChoice("otsu", "", grey.found, notes=grey.notes), "the light is even")


def _variation_of_light(found: Found, cells: Cells) -> float:
    """By how much the bench varies over the picture, of its value in the middle."""
    low, middle, high = np.percentile(found.bench.values[cells.valid], [1, 50, 99]).tolist()
    return float((high - low) / max(middle, 1.0))


def _because(choice: MaskChoice, reason: str) -> MaskChoice:
    return MaskChoice(
        choice.method, f"{reason}; {_apart(choice.found)}", choice.found, notes=choice.notes
    )


def _apart(found: Found) -> str:
    levels = found.levels
    side = "darker" if levels.contrast < 0 else "lighter"
    what = "grey levels " + side if found.channel.black == 0 else "levels of colour apart"
    return f"the part is {abs(levels.contrast):.0f} {what}, the bench varies by {_variation(found)}"


def _variation(found: Found) -> str:
    return short(max(found.levels.without, found.bench.sigma), 1)


def _find_coloured(cells: Cells) -> bool:
    if cells.values.ndim == 2:
        return False
    blue, green, red = (cells.values[::2, ::2, k] for k in range(3))
    return bool(
        (np.abs(red - green) + np.abs(blue - green))[cells.valid[::2, ::2]].max(initial=0)
        > _COLOURED
    )


def _more(colour: Bools, grey: Bools) -> bool:
    """Does the one have a good deal that the other has not, boundaries aside?"""
    around = cv2.dilate(grey.view(np.uint8), np.ones((5, 5), np.uint8)).view(np.bool_)
    return bool(np.count_nonzero(colour & ~around) > _MORE * np.count_nonzero(colour))


_METHODS: dict[Method, Callable[[Bytes, Cells, Asked], MaskChoice | None]] = {
    "auto": _auto,
    "otsu": _otsu,
    "threshold": _threshold,
    "color": _color,
    "adaptive": _adaptive,
    "alpha": _alpha,
}


_DEFAULTS = ImageTable()


class Mask(Struct, frozen=True, eq=False):
    """The part in a view. pixels: (H, W) uint8, 255 part and 0 bench, read-only.

    method: the one used. why: a sentence. grey: (H, W) uint8 or float32, in which the boundary is where ``level`` is, a
    number or (H, W) float32; the part is below it if ``dark``, else above. Beside dropped specks and filled holes, and
    where the photo shows nothing, ``pixels`` is exactly that side. doubt: (H, W), 255 where other methods than the one
    that ``auto`` chose see it differently by more than a border; None where none does.
    """

    pixels: Bytes
    method: Method
    why: str
    grey: Bytes | Floats
    level: float | Floats
    dark: bool
    notes: tuple[Note, ...] = ()
    doubt: Bytes | None = None


def part_mask(
    view: ScaledView,
    settings: ImageTable = _DEFAULTS,
    background: ScaledView | None = None,
    name: str = "picture",
) -> Mask:
    """The mask of the part, or parts, in ``view``. ``name`` is the file's, for errors.

    background: the same view of the empty bench. A setting of one method chooses it where ``mask`` is auto. threshold:
    grey value. color: of the bench or of the part, [red, green, blue]. invert: the part is on the other side of the
    threshold, or of the bench's grey, than where it was found. min_area: mm2; smaller pieces and holes are noise.
    JobError: settings that do not fit together. InputError: no part, or one that touches the border of what the photo
    shows.
    """
    _check(view, background)
    asked = Asked(
        _method(settings, background), settings.threshold, _colour(settings), settings.invert, name
    )
    cells = cells_of(view.pixels, view.valid)
    if not cells.valid.any():
        raise InputError(
            name, "shows nothing of the work plane", remedy="check the work plane and the region"
        )
    choice = choose_mask(
        view.pixels, None if background is None else background.pixels, cells, asked
    )
    channel, levels = choice.found.channel, choice.found.levels
    grey, notes = quiet(channel.pixels(), choice.found, cells)
    level: float | Floats = levels.middle if choice.level is None else float(choice.level)
    if choice.level is None and not levels.even:
        level = spread_out(levels.tiles, levels.tile * cells.size, grey.shape)
    dark = levels.contrast < 0
    pixels = beyond(grey, level, dark)
    if choice.level is None:
        _keep_found(pixels, choice.found, cells)
    if view.valid is not None:
        pixels[~view.valid] = 0
    accepts_specks = "specks" in settings.accept
    notes += clean(pixels, view, settings.min_area, name, accepts_specks=accepts_specks)
    doubt = _doubt(choice, cells, settings.min_area / view.mm_per_px**2)
    if doubt is not None:
        notes += (_note_doubt(doubt, cells, view),)
    # Views, since the grey picture may be the caller's own.
    pixels, grey = pixels.view(), grey.view()
    for array in (pixels, grey, level):
        if isinstance(array, np.ndarray):
            array.flags.writeable = False
    notes += _note_meetings(meetings(pixels, cells), cells, view)
    in_doubt = None if doubt is None else show_doubt(doubt, cells, pixels.shape)
    return Mask(
        pixels, choice.method, choice.why, grey, level, dark, choice.notes + notes, in_doubt
    )


def _keep_found(pixels: Bytes, segmentation: Found, cells: Cells) -> None:
    """Sets the pixels where the level alone contradicts the segmentation.

    These are tones within the part, and the texture of the bench. The border is left as it is.
    """
    part = segmentation.part
    differs = beyond_level(segmentation.channel, segmentation.levels, cells) ^ part
    if not differs.any():
        return
    around = cv2.dilate(differs.view(np.uint8), np.ones((3, 3), np.uint8)).view(np.bool_)
    at = [
        np.minimum(np.arange(count) // cells.size, limit - 1)
        for count, limit in zip(pixels.shape, differs.shape, strict=True)
    ]
    for side, value in ((part, 255), (~part, 0)):
        inner = around & inner_cells(side)
        pixels[inner[np.ix_(*at)]] = value


def _note_doubt(doubt: Doubt, cells: Cells, view: ScaledView) -> Note:
    """What other methods see differently, and where."""
    mm2 = (cells.size * view.mm_per_px) ** 2
    count = len(doubt.places)
    what = f"{counted(count, 'place')}, {short(int(doubt.where.sum()) * mm2, 1)} mm2 in all, "
    what += f"{'are' if count > 1 else 'is'} part or bench by the method: a shadow, a shine, or uneven light?"
    by = ", ".join(f"{name} by {short(size * mm2, 1)} mm2" for name, size in doubt.by)
    why = f"others differ there: {by}; look at the preview, set image.mask or image.threshold, or give image.background"
    return Note(
        "warning",
        what,
        why,
        places=_in_work([(u, v) for v, u in doubt.places[:_MOST_PLACES]], cells, view),
    )


def _note_meetings(found: list[Meeting], cells: Cells, view: ScaledView) -> tuple[Note, ...]:
    if not found:
        return ()
    what = f"parts seem to touch or overlap in {counted(len(found), 'place')}: taken for one, with one outline"
    lengths = ", ".join(
        f"{short(m.length * cells.size * view.mm_per_px, 1)} mm" for m in found[:_MOST_PLACES]
    )
    why = f"two sharp notches face each other there, {lengths} apart; move the parts apart, or crop with image.region"
    return (
        Note(
            "warning",
            what,
            why,
            places=_in_work([m.middle for m in found[:_MOST_PLACES]], cells, view),
        ),
    )


def _in_work(
    places: Sequence[tuple[float, float]], cells: Cells, view: ScaledView
) -> tuple[tuple[float, float], ...]:
    """Places u, v in cells as x, y in mm."""
    at = np.array([[*place, 1.0] for place in places]) * (cells.size, cells.size, 1.0)
    at[:, :2] += (cells.size - 1) / 2
    return tuple((x, y) for x, y in (at @ view.work_from_view.T).tolist())


def _method(settings: ImageTable, background: ScaledView | None) -> Method:
    """The method meant: one that needs a setting must have it, and a setting alone is enough."""
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
    if method == "auto":
        return next((one for one, is_given in given.items() if is_given), method)
    return method


def _colour(settings: ImageTable) -> Colour | None:
    if settings.color is None:
        return None
    if not (len(settings.color) == 3 and all(0 <= c <= 255 for c in settings.color)):
        what = f"{settings.color} is no colour"
        raise JobError("[image] color", what, remedy="give [red, green, blue], each 0 to 255")
    red, green, blue = settings.color
    return red, green, blue


def _check(view: ScaledView, background: ScaledView | None) -> None:
    if background is not None and background.pixels.shape != view.pixels.shape:
        shapes = " and ".join(_describe(one) for one in (background, view))
        remedy = "take both with the same camera and settings, and treat both alike"
        raise JobError(
            "[image] background", f"its picture and the photo differ: {shapes}", remedy=remedy
        )


def _describe(view: ScaledView) -> str:
    height, width = view.pixels.shape[:2]
    return f"{width} x {height} px in {'grey' if view.pixels.ndim == 2 else 'colour'}"
