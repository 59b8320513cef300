"""The page of an SVG document: mm of its units, and where the work frame lies on it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from msgspec import Struct

from camgen.errors import InputError
from camgen.pose import FloatArray
from camgen.readers import units
from camgen.readers.svg_values import MM_PER_PX, Box, Malformed, combined, fitted, length, view_box
from camgen.shapes import Note
from camgen.text import short

#: Units that only ``input.units`` of an SVG takes, mm.
_MORE = {"px": MM_PER_PX, "pt": 25.4 / 72, "pc": 25.4 / 6}
_OVERRIDE = "set input.units if that is not meant"
#: Inkscape before 0.92 took 90 px for an inch.
_OLD_INKSCAPE = ("0.4", "0.91")
_VERSION = "{http://www.inkscape.org/namespaces/inkscape}version"


class Page(Struct, frozen=True, eq=False):
    """matrix: (2, 3), mm in the work frame of the document's user units. view: of the viewport in user units.

    open: the document states no height, so that its lower left corner is not known.
    """

    matrix: FloatArray
    view: tuple[float, float]
    units: str
    told: str
    open: bool
    notes: tuple[Note, ...]


def page_of(file: str, attributes: Mapping[str, str], wanted: str) -> Page:
    """The page by width, height, viewBox and preserveAspectRatio, or by ``input.units`` where it is given."""
    try:
        box = view_box(attributes.get("viewBox"))
        sizes = _sizes(attributes, box)
        asked = wanted.strip().lower()
        if asked != "auto":
            scale = _MORE[asked] if asked in _MORE else units.resolve(file, wanted, 0, None)[1]
            return _even(asked, scale, box, sizes, ())
        if sizes is None:
            why = f"the file states no size; {_OVERRIDE}"
            note = Note("assumed", f"1 unit = {short(MM_PER_PX, 6)} mm (96 DPI)", why)
            return _even(f"{short(MM_PER_PX, 9)} mm/unit", MM_PER_PX, box, None, (note,))
        notes = _pixels(attributes)
        if box is None:
            return _even(f"{short(MM_PER_PX, 9)} mm/unit", MM_PER_PX, None, sizes, notes)
        aspect = attributes.get("preserveAspectRatio", "")
        matrix = fitted(box, sizes[0] * MM_PER_PX, sizes[1] * MM_PER_PX, aspect)
        return _page(matrix, sizes[1] * MM_PER_PX, box, sizes, notes)
    except Malformed as error:
        raise InputError(file, str(error), "the svg element", "mend it, or save the drawing again") from error


def _sizes(attributes: Mapping[str, str], box: Box | None) -> tuple[float, float] | None:
    """Width and height in px; None where the file leaves them to whoever shows it. One follows from the other."""
    given: list[float | None] = []
    for name in ("width", "height"):
        text = attributes.get(name, "").strip()
        if not text or text == "auto" or text.endswith("%"):
            given.append(None)
            continue
        value = length(text, name, (0.0, 0.0))
        if value <= 0:
            raise Malformed(f"{name} is not above 0")
        given.append(value)
    width, height = given
    if width is not None and height is not None:
        return width, height
    if box is None:
        return None
    if width is not None:
        return width, width * box.height / box.width
    return None if height is None else (height * box.width / box.height, height)


def _pixels(attributes: Mapping[str, str]) -> tuple[Note, ...]:
    """Notes on a size in px: what an inch is in them was not always the same."""
    if not all(
        attributes.get(name, "0")[-1].isdigit() or attributes[name].endswith("px") for name in ("width", "height")
    ):
        return ()
    version = attributes.get(_VERSION, "").split(" ")[0]
    if version.startswith("0.") and _OLD_INKSCAPE[0] <= version <= _OLD_INKSCAPE[1] + ".9":
        what = f"written by Inkscape {version[:8]}, which took 90 px for an inch"
        return (Note("warning", what, "96 are assumed; set input.units or page.scale if the size is wrong"),)
    return (Note("assumed", "96 px = 1 inch", f"the file's size is in px; {_OVERRIDE}"),)


def _even(name: str, scale: float, box: Box | None, sizes: tuple[float, float] | None, notes: tuple[Note, ...]) -> Page:
    """A page on which one unit is ``scale`` mm."""
    if box is None:
        width, height = sizes or (0.0, 0.0)
        box = Box(0.0, 0.0, width, height)
    matrix = np.array([[scale, 0.0, -box.x * scale], [0.0, scale, -box.y * scale]])
    return _made(matrix, box.height * scale, (box.width, box.height), name, notes)


def _page(matrix: FloatArray, height: float, box: Box, sizes: tuple[float, float], notes: tuple[Note, ...]) -> Page:
    """A page whose box is laid into its size."""
    sx, sy = float(matrix[0, 0]), float(matrix[1, 1])
    name = f"{short(sx, 9)} mm/unit" if abs(sx - sy) <= 1e-9 * sx else f"{short(sx, 6)} and {short(sy, 6)} mm/unit"
    if abs(sx - 1) <= 1e-6 and abs(sy - 1) <= 1e-6:
        name = "mm"
    page = _made(matrix, height, (box.width, box.height), name, notes)
    told = " x ".join(short(v * MM_PER_PX, 3) for v in sizes) + " mm"
    return Page(page.matrix, page.view, page.units, told, page.open, page.notes)


def _made(matrix: FloatArray, height: float, view: tuple[float, float], name: str, notes: tuple[Note, ...]) -> Page:
    """With y turned up, from the lower edge of the page."""
    up = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, height]])
    known = height > 0
    told = f"{short(view[0] * float(matrix[0, 0]), 3)} x {short(height, 3)} mm" if known else "of no stated size"
    return Page(combined(up, matrix), view, name, told, not known, notes)
