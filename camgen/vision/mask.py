"""Which pixels of a to-scale view show the part (PIST, section 3.2), and the grey value of its boundary.

The bench is what touches the border of the picture. What is slow in the picture (light, tones) is learned in cells of
some pixels, ``mask_cells``; ``mask_level`` has the grey value of the boundary and what is assumed of the camera's
tones; ``mask_colour`` and ``mask_background`` make one channel of a coloured picture, or of two.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.errors import InputError, JobError
from camgen.settings import Image
from camgen.shapes import Note
from camgen.vision.mask_cells import Bytes, Floats, cells_of
from camgen.vision.mask_choice import Asked, Method, chosen
from camgen.vision.mask_clean import cleaned
from camgen.vision.mask_colour import Colour
from camgen.vision.mask_level import beyond, spread_out
from camgen.vision.mask_noise import quiet
from camgen.vision.rectify import View

_DEFAULTS = Image()


class Mask(Struct, frozen=True, eq=False):
    """The part in a view. pixels: (H, W) uint8, 255 part and 0 bench, read-only.

    method: the one used. why: a sentence. grey: (H, W) uint8 or float32, in which the boundary is where ``level`` is, a
    number or (H, W) float32; the part is below it if ``dark``, else above. Beside dropped specks and filled holes, and
    where the photo shows nothing, ``pixels`` is exactly that side.
    """

    pixels: Bytes
    method: Method
    why: str
    grey: Bytes | Floats
    level: float | Floats
    dark: bool
    notes: tuple[Note, ...] = ()


def part_mask(view: View, settings: Image = _DEFAULTS, background: View | None = None, name: str = "picture") -> Mask:
    """The mask of the part, or parts, in ``view``. ``name`` is the file's, for errors.

    background: the same view of the empty bench. A setting of one method chooses it where ``mask`` is auto. threshold:
    grey value. color: of the bench or of the part, [red, green, blue]. invert: the part is on the other side of the
    threshold, or of the bench's grey, than where it was found. min_area: mm2; smaller pieces and holes are noise.
    JobError: settings that do not fit together. InputError: no part, or one that touches the border of what the photo
    shows.
    """
    _checked(view, background)
    asked = Asked(_method(settings, background), settings.threshold, _colour(settings), settings.invert, name)
    cells = cells_of(view.pixels, view.valid)
    if not cells.valid.any():
        raise InputError(name, "shows nothing of the work plane", remedy="check the work plane and the region")
    choice = chosen(view.pixels, None if background is None else background.pixels, cells, asked)
    channel, levels = choice.found.channel, choice.found.levels
    grey, notes = quiet(channel.pixels(), choice.found, cells)
    level: float | Floats = levels.middle if choice.level is None else float(choice.level)
    if choice.level is None and not levels.even:
        level = spread_out(levels.tiles, levels.tile * cells.size, grey.shape)
    dark = levels.contrast < 0
    pixels = beyond(grey, level, dark)
    if view.valid is not None:
        pixels[~view.valid] = 0
    notes += cleaned(pixels, view, settings.min_area, name)
    # Views, since the grey picture may be the caller's own.
    pixels, grey = pixels.view(), grey.view()
    for array in (pixels, grey, level):
        if isinstance(array, np.ndarray):
            array.flags.writeable = False
    return Mask(pixels, choice.method, choice.why, grey, level, dark, choice.notes + notes)


def _method(settings: Image, background: View | None) -> Method:
    """The method meant: one that needs a setting must have it, and a setting alone is enough."""
    given: dict[Method, bool] = {
        "background": background is not None,
        "threshold": settings.threshold is not None,
        "color": settings.color is not None,
    }
    method = settings.mask
    if method in ("background", "threshold") and not given[method]:
        raise JobError("[image] mask", f'"{method}" needs [image] {method}', remedy="give it, or choose another")
    if method == "auto":
        return next((one for one, is_given in given.items() if is_given), method)
    return method


def _colour(settings: Image) -> Colour | None:
    if settings.color is None:
        return None
    if not (len(settings.color) == 3 and all(0 <= c <= 255 for c in settings.color)):
        what = f"{settings.color} is no colour"
        raise JobError("[image] color", what, remedy="give [red, green, blue], each 0 to 255")
    red, green, blue = settings.color
    return red, green, blue


def _checked(view: View, background: View | None) -> None:
    if background is not None and background.pixels.shape != view.pixels.shape:
        shapes = " and ".join(_told(one) for one in (background, view))
        remedy = "take both with the same camera and settings, and treat both alike"
        raise JobError("[image] background", f"its picture and the photo differ: {shapes}", remedy=remedy)


def _told(view: View) -> str:
    height, width = view.pixels.shape[:2]
    return f"{width} x {height} px in {'grey' if view.pixels.ndim == 2 else 'colour'}"
