"""A picture of an inspection: the photo of a part laid on its drawing.

Burrs are red, other places with too much material are amber, and places with too little are blue.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from camgen.check.photo import Difference, Inspection
from camgen.model.pose import FloatArray
from camgen.model.text import counted
from camgen.preview.draw import choose_bar, escape_line, format_bar
from camgen.preview.panels import Pixels, format_image, format_line

#: Maximum width and height of the picture, its margin, the title above, the legend below, page mm.
_WIDE, _HIGH, _MARGIN, _TITLE, _FOOT = 260.0, 190.0, 12.0, 16.0, 14.0
#: Pixels of a page mm.
_PX = 6.0
#: Radius of the ring around a place, page mm, and the maximum number of rings.
_RING, _MAX_RINGS = 3.2, 60
#: Width of a letter of a label, page mm.
_LETTER = 2.0
#: Colours as red, green, blue.
_LINE, _MISSING, _INK = (95, 99, 104), (31, 98, 220), (32, 33, 36)
_BURR, _OTHER = (208, 16, 58), (190, 100, 0)
_COLOURS = {"burr": _BURR, "much": _OTHER, "less": _MISSING}
_COLOUR_SEEN = (11, 122, 59)
#: Fraction of its darkness that the photo loses in the background.
_PALE = 0.55


class _Page(NamedTuple):
    """The transform from the drawing (mm, y up) to the page, and the size of the page.

    scale: page mm per mm.
    x, y: page position of the origin of the drawing, mm.
    wide, high: size of the page, mm.
    """

    scale: float
    x: float
    y: float
    wide: float
    high: float

    def place(self, points: FloatArray) -> FloatArray:
        """Page positions (N, 2) of points (N, 2)."""
        return np.asarray(points * (self.scale, -self.scale) + (self.x, self.y))


def draw(inspection: Inspection, suffix: str) -> bytes:
    """The picture as the bytes of a file, for the suffix ".svg" or ".png"."""
    return _png(inspection) if suffix == ".png" else _svg(inspection).encode("utf-8")


def _fit_page(inspection: Inspection) -> _Page:
    shapes = shapely.union_all([inspection.expected.region, inspection.seen])
    left, low, right, high = shapes.bounds
    scale = min(_WIDE / (right - left), _HIGH / (high - low))
    width = max((right - left) * scale + 2 * _MARGIN, 170.0)
    return _Page(
        scale,
        (width - (right - left) * scale) / 2 - left * scale,
        _TITLE + _MARGIN + high * scale,
        width,
        (high - low) * scale + _TITLE + _FOOT + 2 * _MARGIN,
    )


def _compute_view_map(page: _Page, inspection: Inspection) -> FloatArray:
    """The transform (2, 3) from a pixel centre (u, v) of the view to page mm."""
    raster = inspection.photo.raster
    assert raster is not None
    c, s = math.cos(inspection.fit.turn), math.sin(inspection.fit.turn)
    turned = np.array([[c, -s], [s, c]]) @ raster.work_from_view
    turned[:, 2] += inspection.fit.shift
    return np.asarray(
        np.diag([page.scale, -page.scale]) @ turned + np.array([[0, 0, page.x], [0, 0, page.y]])
    )


def _list_words(inspection: Inspection) -> tuple[str, str]:
    """The title and the sums of the inspection."""
    surplus = sum(difference.surplus for difference in inspection.differences)
    missing = len(inspection.differences) - surplus
    sums = (
        f"from {inspection.least:.2f} mm on: "
        f"{counted(surplus, 'place')} with too much, {inspection.area(True):.2f} mm2, "
        f"{counted(missing, 'place')} with too little, {inspection.area(False):.2f} mm2; "
        f"{counted(len(inspection.burrs), 'burr')}"
    )
    return f"{inspection.photo.source} against {inspection.expected.source}", sums


def _find_class(difference: Difference) -> str:
    """The class of a place, which gives its colour."""
    if not difference.surplus:
        return "less"
    return "burr" if difference.kind == "burr" else "much"


def _format_label(number: int, difference: Difference) -> str:
    return f"{number} {difference.kind}"


# SVG.

_STYLE = """\
text{font-family:system-ui,Helvetica,Arial,sans-serif;font-size:3.4px;fill:#202124}\
.big{font-size:4.6px;font-weight:600}
path,circle{fill:none}.line{stroke:#5f6368;stroke-width:.35}.seen{stroke:#0b7a3b;stroke-width:.2}\
.bar{stroke:#202124;stroke-width:.4}
.burr{fill:#d0103a;fill-opacity:.75;stroke:#d0103a}\
.much{fill:#be6400;fill-opacity:.75;stroke:#be6400}\
.less{fill:#1f62dc;fill-opacity:.75;stroke:#1f62dc}
.burr,.much,.less{stroke-width:.15}.ring{fill:none;stroke-width:.4}\
.tag{font-weight:600;paint-order:stroke;stroke:#fff;stroke-width:1}"""


def _svg(inspection: Inspection) -> str:
    page = _fit_page(inspection)
    title, facts = _list_words(inspection)
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{page.wide:.2f}mm" '
            f'height="{page.high:.2f}mm" viewBox="0 0 {page.wide:.2f} {page.high:.2f}">',
            f"<title>{escape_line(title)}</title>",
            f"<style>{_STYLE}</style>",
            '<rect fill="#fff" width="100%" height="100%"/>',
            _format_photo(page, inspection),
            f'<rect fill="#fff" width="100%" height="{_TITLE}"/>',
            f'<text class="big" x="{_MARGIN}" y="8">{escape_line(title)}</text>',
            f'<text x="{_MARGIN}" y="13.5">{escape_line(facts)}</text>',
            f'<path class="line" d="{_format_data(page, inspection.expected.region)}"/>',
            f'<path class="seen" d="{_format_data(page, inspection.seen)}"/>',
            *_format_places(page, inspection),
            *_format_legend(page),
            "</svg>\n",
        ]
    )


def _format_photo(page: _Page, inspection: Inspection) -> str:
    raster = inspection.photo.raster
    assert raster is not None
    pale = (255 - (255 - raster.view.astype(np.float32)) * (1 - _PALE)).astype(np.uint8)
    height, width = pale.shape[:2]
    from_corner = np.array([[1, 0, -0.5], [0, 1, -0.5], [0, 0, 1.0]])
    (a, c, e), (b, d, f) = _compute_view_map(page, inspection) @ from_corner
    matrix = " ".join(f"{v:.8g}" for v in (a, b, c, d, e, f))
    return f'<g transform="matrix({matrix})">{format_image(pale, width, height)}</g>'


def _format_data(page: _Page, shape: shapely.Geometry) -> str:
    return "".join(format_line(page.place(ring)[:-1]) + "Z" for ring in _list_rings(shape))


def _list_rings(shape: shapely.Geometry) -> Iterator[FloatArray]:
    for part in shapely.get_parts(shape):
        if part.geom_type == "Polygon":
            for ring in (part.exterior, *part.interiors):
                yield shapely.get_coordinates(ring)


def _format_places(page: _Page, inspection: Inspection) -> Iterator[str]:
    for number, difference in enumerate(inspection.differences, 1):
        kind, label = _find_class(difference), _format_label(number, difference)
        size = f"{difference.height:.2f} mm, {difference.length:.2f} mm long"
        title = f"<title>{escape_line(f'{label}: {size}, {difference.contour}')}</title>"
        data = _format_data(page, difference.shape)
        yield f'<path class="{kind}" fill-rule="evenodd" d="{data}">{title}</path>'
        if number <= _MAX_RINGS:
            colour = "#{:02x}{:02x}{:02x}".format(*_COLOURS[kind])
            x, y = page.place(np.array([difference.place]))[0].tolist()
            yield f'<circle class="ring" stroke="{colour}" cx="{x:.2f}" cy="{y:.2f}" r="{_RING}"/>'
            left, anchor = x + _RING, ""
            if left + _LETTER * len(label) > page.wide:
                left, anchor = x - _RING, ' text-anchor="end"'
            style = f'{anchor} class="tag" style="fill:{colour}"'
            yield f'<text x="{left:.2f}" y="{y - _RING:.2f}"{style}>{label}</text>'


def _format_legend(page: _Page) -> Iterator[str]:
    y, x = page.high - 6, _MARGIN
    for kind, label in (
        ("line", "expected"),
        ("seen", "seen"),
        ("burr", "burr"),
        ("much", "other too much"),
        ("less", "missing"),
    ):
        text = f'<text x="{x + 10}" y="{y}">{label}</text>'
        yield f'<path class="{kind}" d="M{x} {y - 2}h8v1.6h-8Z"/>{text}'
        x += 16 + 1.9 * len(label)
    yield from format_bar(page.wide - _MARGIN, y, page.scale, y + 3.4)


# PNG.

_SHIFT = 4


def _png(inspection: Inspection) -> bytes:
    import cv2  # noqa: PLC0415 (slow, only for pictures)

    page = _fit_page(inspection)
    size = (round(page.wide * _PX), round(page.high * _PX))
    sheet = _draw_photo(page, inspection, size)

    def scale_rings(shape: shapely.Geometry) -> list[NDArray[np.int32]]:
        scale = _PX * 2**_SHIFT
        return [np.round(page.place(r) * scale).astype(np.int32) for r in _list_rings(shape)]

    for difference in inspection.differences:
        rings = scale_rings(difference.shape)
        if rings:
            cv2.fillPoly(sheet, rings, _find_colour(difference), cv2.LINE_AA, _SHIFT)
    for shape, colour in ((inspection.expected.region, _LINE), (inspection.seen, _COLOUR_SEEN)):
        cv2.polylines(sheet, scale_rings(shape), True, colour[::-1], 1, cv2.LINE_AA, _SHIFT)
    radius = round(_RING * _PX)
    for number, difference in enumerate(inspection.differences[:_MAX_RINGS], 1):
        u, v = (page.place(np.array([difference.place]))[0] * _PX).round().astype(int).tolist()
        colour, label = _find_colour(difference), _format_label(number, difference)
        cv2.circle(sheet, (u, v), radius, colour, 2, cv2.LINE_AA)
        _write_label(sheet, label, (u + radius, v - radius), colour)
    _write_words(sheet, page, inspection)
    return bytes(cv2.imencode(".png", sheet)[1])


def _write_label(
    sheet: Pixels, label: str, place: tuple[int, int], colour: tuple[int, int, int]
) -> None:
    """Write a label on white, moved to the left at the right border of the sheet."""
    import cv2  # noqa: PLC0415 (slow, only for pictures)

    face = cv2.FONT_HERSHEY_SIMPLEX
    (width, height), below = cv2.getTextSize(label, face, 0.6, 2)
    u, v = min(place[0], sheet.shape[1] - width - 4), place[1]
    cv2.rectangle(sheet, (u - 3, v - height - 3), (u + width + 3, v + below), (255, 255, 255), -1)
    cv2.putText(sheet, label, (u, v), face, 0.6, colour, 2, cv2.LINE_AA)


def _draw_photo(page: _Page, inspection: Inspection, size: tuple[int, int]) -> Pixels:
    """The photo, paler, at its place on the page; blue, green, red."""
    import cv2  # noqa: PLC0415 (slow, only for pictures)

    raster = inspection.photo.raster
    assert raster is not None
    view = raster.view if raster.view.ndim == 3 else cv2.cvtColor(raster.view, cv2.COLOR_GRAY2BGR)
    matrix = _compute_view_map(page, inspection) * _PX
    photo = cv2.warpAffine(view, matrix, size, flags=cv2.INTER_AREA, borderValue=(255, 255, 255))
    pale = 255 - (255 - photo.astype(np.float32)) * (1 - _PALE)
    pale[: round(_TITLE * _PX)] = 255
    return np.asarray(pale, dtype=np.uint8)


def _write_words(sheet: Pixels, page: _Page, inspection: Inspection) -> None:
    import cv2  # noqa: PLC0415 (slow, only for pictures)

    title, facts = (text.encode("ascii", "replace").decode() for text in _list_words(inspection))
    face, ink = cv2.FONT_HERSHEY_SIMPLEX, _INK[::-1]
    left, height = round(_MARGIN * _PX), sheet.shape[0]
    cv2.putText(sheet, title, (left, 45), face, 0.9, ink, 2, cv2.LINE_AA)
    cv2.putText(sheet, facts, (left, 80), face, 0.6, ink, 1, cv2.LINE_AA)
    x = left
    for colour, label in (
        (_LINE, "expected"),
        (_COLOUR_SEEN, "seen"),
        (_BURR, "burr"),
        (_OTHER, "other too much"),
        (_MISSING, "missing"),
    ):
        cv2.rectangle(sheet, (x, height - 40), (x + 45, height - 32), colour[::-1], -1)
        cv2.putText(sheet, label, (x + 55, height - 30), face, 0.6, ink, 1, cv2.LINE_AA)
        x += 80 + 12 * len(label)
    bar = choose_bar(45 / page.scale)
    right, y = sheet.shape[1] - left, height - 36
    cv2.line(sheet, (right - round(bar * page.scale * _PX), y), (right, y), ink, 3)
    cv2.putText(sheet, f"{bar:g} mm", (right - 80, height - 14), face, 0.6, ink, 1, cv2.LINE_AA)


def _find_colour(difference: Difference) -> tuple[int, int, int]:
    """Blue, green, red."""
    return _COLOURS[_find_class(difference)][::-1]
