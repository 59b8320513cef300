"""The page of an SVG document: the size of its units in mm, and its place in the work frame."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from msgspec import Struct

from camgen.model.errors import InputError
from camgen.model.limits import Limits, format_limit
from camgen.model.part import Note
from camgen.model.pose import FloatArray
from camgen.model.text import short
from camgen.read import units
from camgen.read.svg.style import Style
from camgen.read.svg.transforms import find_matrix
from camgen.read.svg.values import (
    MM_PER_PX,
    Malformed,
    ViewBox,
    combine,
    fit_viewport,
    length,
    view_box,
)
from camgen.read.svg.vocabulary import PAGE_LIMITS

#: Units that only `input.units` of an SVG takes, mm.
_MORE = {"px": MM_PER_PX, "pt": 25.4 / 72, "pc": 25.4 / 6}
_OVERRIDE = "set input.units if that is not meant"
#: Inkscape before 0.92 took 90 px for an inch.
_OLD_INKSCAPE = ("0.4", "0.91")
_VERSION = "{http://www.inkscape.org/namespaces/inkscape}version"


class SvgPage(Struct, frozen=True, eq=False):
    """The page of a document.

    matrix: (2, 3), mm in the work frame of the user units of the document.
    view: width and height of the viewport, user units.
    frames: (F, 4, 2), mm, the corners of the page and of its view box.
    units: size of a user unit, as a text.
    size: size of the page, as a text.
    is_open: whether the page has no stated height, so that its lower left corner is not known.
    notes: assumptions.
    """

    matrix: FloatArray
    view: tuple[float, float]
    frames: FloatArray
    units: str
    size: str
    is_open: bool
    notes: tuple[Note, ...]


class _Layout(Struct, frozen=True, eq=False):
    """A page before it is turned up and moved.

    fit: (2, 3), mm of user units, y down from the upper left corner of the page.
    box: the part of the plane that the page shows, user units.
    width: page width, mm; 0 if it is not known.
    height: page height, mm; 0 if it is not known.
    px: page width, px; 0 if it is not known.
    """

    fit: FloatArray
    box: ViewBox
    width: float
    height: float
    px: float


def find_page(
    file: str,
    attributes: Mapping[str, str],
    style: Style,
    requested_units: str,
    limits: Limits,
) -> SvgPage:
    """The page by width, height, viewBox and preserveAspectRatio, or by `input.units`.

    style: style of the outermost element; its width and height replace the attributes.
    Raises InputError for a page that cannot be read.
    """
    words = dict(attributes)
    words.update((key, style[key]) for key in ("width", "height") if key in style)
    try:
        box = view_box(words.get("viewBox"))
        sizes = _find_size(words, box, limits.svg_page)
        requested = requested_units.strip().lower()
        notes = list[Note]()
        limited = sorted(PAGE_LIMITS & style.keys())
        if limited:
            notes.append(
                Note(
                    "assumed",
                    f"limits of the page in CSS: {', '.join(limited)}",
                    "its width and height are used; set input.units if the size is wrong",
                )
            )
        scale, name = MM_PER_PX, f"{short(MM_PER_PX, 9)} mm/unit"
        if requested in _MORE:
            scale, name = _MORE[requested], requested
        elif requested != "auto":
            scale, name = units.resolve(file, requested_units, 0, None)[1], requested
        elif sizes is None:
            what = f"1 unit = {short(MM_PER_PX, 6)} mm (96 DPI)"
            notes.append(Note("assumed", what, f"the file states no size; {_OVERRIDE}"))
        else:
            notes += _note_pixels(words)
        if requested == "auto" and box is not None and sizes is not None:
            layout, name = _fit_page(words, box, sizes)
        else:
            layout = _scale_page(scale, box, sizes)
        return _make_page(layout, words, style, name, tuple(notes))
    except Malformed as error:
        raise InputError(
            file, str(error), "the svg element", "correct it, or save the drawing again"
        ) from error


def _find_size(
    attributes: Mapping[str, str], box: ViewBox | None, limit_mm: float
) -> tuple[float, float] | None:
    """Width and height in px, where one follows from the other; None if the file states none."""
    sizes: list[float | None] = []
    for name in ("width", "height"):
        text = attributes.get(name, "").strip()
        if not text or text == "auto" or text.endswith("%"):
            sizes.append(None)
            continue
        value = length(text, name, (0.0, 0.0))
        if value <= 0:
            raise Malformed(f"{name} is not above 0")
        if value * MM_PER_PX > limit_mm:
            raise Malformed(f"{name} is beyond {format_limit(limit_mm)} mm (limits.svg_page)")
        sizes.append(value)
    width, height = sizes
    if width is not None and height is not None:
        return width, height
    if box is None:
        return None
    if width is not None:
        return width, width * box.height / box.width
    return None if height is None else (height * box.width / box.height, height)


def _note_pixels(attributes: Mapping[str, str]) -> tuple[Note, ...]:
    """Notes on a size in px: an inch was not always 96 of them."""
    for name in ("width", "height"):
        text = attributes.get(name, "").strip()
        if text and not text[-1].isdigit() and not text.endswith("px"):
            return ()
    version = attributes.get(_VERSION, "").split(" ")[0]
    if version.startswith("0.") and _OLD_INKSCAPE[0] <= version <= _OLD_INKSCAPE[1] + ".9":
        return (
            Note(
                "warning",
                f"written by Inkscape {version[:8]}, which took 90 px for an inch",
                "96 are assumed; set input.units or page.scale if the size is wrong",
            ),
        )
    return (Note("assumed", "96 px = 1 inch", f"the file's size is in px; {_OVERRIDE}"),)


def _scale_page(scale: float, box: ViewBox | None, sizes: tuple[float, float] | None) -> _Layout:
    """A page on which one unit is `scale` mm."""
    if box is None:
        width, height = sizes or (0.0, 0.0)
        box = ViewBox(0.0, 0.0, width, height)
    fit = np.array([[scale, 0.0, -box.x * scale], [0.0, scale, -box.y * scale]])
    px = sizes[0] if sizes else box.width
    return _Layout(fit, box, box.width * scale, box.height * scale, px)


def _fit_page(
    attributes: Mapping[str, str],
    box: ViewBox,
    sizes: tuple[float, float],
) -> tuple[_Layout, str]:
    """A page whose box is laid into its size, and the size of its units."""
    width, height = sizes[0] * MM_PER_PX, sizes[1] * MM_PER_PX
    fit = fit_viewport(box, width, height, attributes.get("preserveAspectRatio", ""))
    sx, sy = float(fit[0, 0]), float(fit[1, 1])
    name = f"{short(sx, 9)} mm/unit"
    if abs(sx - sy) > 1e-9 * sx:
        name = f"{short(sx, 6)} and {short(sy, 6)} mm/unit"
    if abs(sx - 1) <= 1e-6 and abs(sy - 1) <= 1e-6:
        name = "mm"
    return _Layout(fit, box, width, height, sizes[0]), name


def _make_page(
    layout: _Layout,
    attributes: Mapping[str, str],
    style: Style,
    name: str,
    notes: tuple[Note, ...],
) -> SvgPage:
    """The page with y up from its lower edge, and with the transform of the outermost element."""
    page, box = ViewBox(0.0, 0.0, layout.width, layout.height), layout.box
    up = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, layout.height]])
    moved = combine(up, _find_root_matrix(layout, attributes, style))
    frames = np.stack([_list_corners(page, moved), _list_corners(box, combine(moved, layout.fit))])
    is_known = layout.height > 0
    size = f"{short(layout.width, 3)} x {short(layout.height, 3)} mm"
    return SvgPage(
        combine(moved, layout.fit),
        (box.width, box.height),
        frames,
        name,
        size if is_known else "of no stated size",
        not is_known,
        notes,
    )


def _find_root_matrix(layout: _Layout, attributes: Mapping[str, str], style: Style) -> FloatArray:
    """The transform of the outermost element (2, 3), mm, y down.

    It counts in px of the page, about the middle of the page if no origin is set.
    """
    mm_per_px = layout.width / layout.px if layout.px else MM_PER_PX
    words = {"transform-origin": "50% 50%", **attributes}
    page = ViewBox(0.0, 0.0, layout.width / mm_per_px, layout.height / mm_per_px)
    own_style = {name: value for name, value in style.items() if name != "transform-box"}
    matrix = find_matrix(words, own_style, page, lambda: page)
    if matrix is None:
        return np.eye(3)[:2]
    return np.column_stack([matrix[:, :2], matrix[:, 2] * mm_per_px])


def _list_corners(box: ViewBox, matrix: FloatArray) -> FloatArray:
    """The corners (4, 2) of a box under a matrix."""
    right, lower = box.x + box.width, box.y + box.height
    corners = np.array([[box.x, box.y], [right, box.y], [right, lower], [box.x, lower]])
    return np.asarray(corners @ matrix[:, :2].T + matrix[:, 2])
