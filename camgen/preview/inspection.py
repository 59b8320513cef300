"""A photo against what was expected of it, as a picture: the photo laid on the drawing.

Burrs are red, other places with too much are amber, and missing ones blue.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import shapely

from camgen.check.photo import Difference, Inspection
from camgen.model.pose import FloatArray
from camgen.model.text import counted
from camgen.preview.panels import Pixels, image, xml

#: The picture fits in here, page mm, with a margin and room for the title and the legend; pixels of a page mm.
_WIDE, _HIGH, _MARGIN, _TITLE, _FOOT = 260.0, 190.0, 12.0, 16.0, 14.0
_PX = 6.0
#: Rings around places, page mm, and how many are drawn at most: the greatest.
_RING, _MOST = 3.2, 60
#: Width of a letter of a label, page mm.
_LETTER = 2.0
#: Colours as red, green, blue.
_LINE, _MISSING, _INK = (95, 99, 104), (31, 98, 220), (32, 33, 36)
_BURR, _OTHER = (208, 16, 58), (190, 100, 0)
_COLOURS = {"burr": _BURR, "much": _OTHER, "less": _MISSING}
#: The photo behind is made so much paler.
_PALE = 0.55


class _Page(NamedTuple):
    """From the drawing (mm, y up) to the page: scale, origin, and the size of the page, page mm."""

    scale: float
    x: float
    y: float
    wide: float
    high: float

    def place(self, points: FloatArray) -> FloatArray:
        """Page mm (N, 2)."""
        return np.asarray(points * (self.scale, -self.scale) + (self.x, self.y))


def draw(found: Inspection, suffix: str) -> bytes:
    """The picture as the bytes of an ``.svg`` or a ``.png``."""
    return _png(found) if suffix == ".png" else _svg(found).encode("utf-8")


def _page(found: Inspection) -> _Page:
    left, low, right, high = shapely.union_all([found.expected.region, found.seen]).bounds
    scale = min(_WIDE / (right - left), _HIGH / (high - low))
    wide, tall = (
        (right - left) * scale + 2 * _MARGIN,
        (high - low) * scale + _TITLE + _FOOT + 2 * _MARGIN,
    )
    width = max(wide, 170.0)
    return _Page(
        scale,
        (width - (right - left) * scale) / 2 - left * scale,
        _TITLE + _MARGIN + high * scale,
        width,
        tall,
    )


def _view_on(page: _Page, found: Inspection) -> FloatArray:
    """(2, 3): page mm of a pixel centre (u, v) of the view."""
    raster = found.photo.raster
    assert raster is not None
    c, s = math.cos(found.fit.turn), math.sin(found.fit.turn)
    turned = np.array([[c, -s], [s, c]]) @ raster.work_from_view
    turned[:, 2] += found.fit.shift
    return np.asarray(
        np.diag([page.scale, -page.scale]) @ turned + np.array([[0, 0, page.x], [0, 0, page.y]])
    )


def _words(found: Inspection) -> tuple[str, str]:
    much = sum(difference.surplus for difference in found.differences)
    title = f"{found.photo.source} against {found.expected.source}"
    told = f"from {found.least:.2f} mm on: {counted(much, 'place')} with too much, {found.area(True):.2f} mm2, "
    less = len(found.differences) - much
    told += f"{counted(less, 'place')} with too little, {found.area(False):.2f} mm2"
    return title, f"{told}; {counted(len(found.burrs), 'burr')}"


def _class(difference: Difference) -> str:
    """Which of the three colours a place has."""
    if not difference.surplus:
        return "less"
    return "burr" if difference.kind == "burr" else "much"


def _label(number: int, difference: Difference) -> str:
    return f"{number} {difference.kind}"


# SVG.

_STYLE = """\
text{font-family:system-ui,Helvetica,Arial,sans-serif;font-size:3.4px;fill:#202124}.big{font-size:4.6px;font-weight:600}
path,circle{fill:none}.line{stroke:#5f6368;stroke-width:.35}.seen{stroke:#0b7a3b;stroke-width:.2}.bar{stroke:#202124;stroke-width:.4}
.burr{fill:#d0103a;fill-opacity:.75;stroke:#d0103a}.much{fill:#be6400;fill-opacity:.75;stroke:#be6400}.less{fill:#1f62dc;fill-opacity:.75;stroke:#1f62dc}
.burr,.much,.less{stroke-width:.15}.ring{fill:none;stroke-width:.4}.tag{font-weight:600;paint-order:stroke;stroke:#fff;stroke-width:1}"""


def _svg(found: Inspection) -> str:
    page = _page(found)
    title, facts = _words(found)
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{page.wide:.2f}mm" height="{page.high:.2f}mm" '
            f'viewBox="0 0 {page.wide:.2f} {page.high:.2f}">',
            f"<title>{xml(title)}</title>",
            f"<style>{_STYLE}</style>",
            '<rect fill="#fff" width="100%" height="100%"/>',
            _photo(page, found),
            f'<rect fill="#fff" width="100%" height="{_TITLE}"/>',
            f'<text class="big" x="{_MARGIN}" y="8">{xml(title)}</text>',
            f'<text x="{_MARGIN}" y="13.5">{xml(facts)}</text>',
            f'<path class="line" d="{_data(page, found.expected.region)}"/>',
            f'<path class="seen" d="{_data(page, found.seen)}"/>',
            *_places(page, found),
            *_legend(page),
            "</svg>\n",
        ]
    )


def _photo(page: _Page, found: Inspection) -> str:
    raster = found.photo.raster
    assert raster is not None
    pale = (255 - (255 - raster.view.astype(np.float32)) * (1 - _PALE)).astype(np.uint8)
    height, width = pale.shape[:2]
    (a, c, e), (b, d, f) = _view_on(page, found) @ np.array(
        [[1, 0, -0.5], [0, 1, -0.5], [0, 0, 1.0]]
    )
    matrix = " ".join(f"{v:.8g}" for v in (a, b, c, d, e, f))
    return f'<g transform="matrix({matrix})">{image(pale, width, height)}</g>'


def _data(page: _Page, shape: shapely.Geometry) -> str:
    return "".join(
        "M" + "L".join(f"{x:.2f} {y:.2f}" for x, y in page.place(ring)[:-1].tolist()) + "Z"
        for ring in _rings(shape)
    )


def _rings(shape: shapely.Geometry) -> Iterator[FloatArray]:
    for part in shapely.get_parts(shape):
        if part.geom_type == "Polygon":
            for ring in (part.exterior, *part.interiors):
                yield shapely.get_coordinates(ring)


def _places(page: _Page, found: Inspection) -> Iterator[str]:
    for number, one in enumerate(found.differences, 1):
        kind, colour = _class(one), "#{:02x}{:02x}{:02x}".format(*_COLOURS[_class(one)])
        hint = (
            f"{_label(number, one)}: {one.height:.2f} mm, {one.length:.2f} mm long, {one.contour}"
        )
        yield f'<path class="{kind}" fill-rule="evenodd" d="{_data(page, one.shape)}"><title>{xml(hint)}</title></path>'
        if number <= _MOST:
            x, y = page.place(np.array([one.place]))[0].tolist()
            yield f'<circle class="ring" stroke="{colour}" cx="{x:.2f}" cy="{y:.2f}" r="{_RING}"/>'
            beyond = x + _RING + _LETTER * len(_label(number, one)) > page.wide
            anchor = ' text-anchor="end"' if beyond else ""
            x = x - _RING if beyond else x + _RING
            style = f'{anchor} class="tag" style="fill:{colour}"'
            yield f'<text x="{x:.2f}" y="{y - _RING:.2f}"{style}>{_label(number, one)}</text>'


def _legend(page: _Page) -> Iterator[str]:
    y, x = page.high - 6, _MARGIN
    for kind, label in (
        ("line", "expected"),
        ("seen", "seen"),
        ("burr", "burr"),
        ("much", "other too much"),
        ("less", "missing"),
    ):
        yield f'<path class="{kind}" d="M{x} {y - 2}h8v1.6h-8Z"/><text x="{x + 10}" y="{y}">{label}</text>'
        x += 16 + 1.9 * len(label)
    bar = _round_length(45 / page.scale)
    right = page.wide - _MARGIN
    yield f'<path class="bar" d="M{right - bar * page.scale:.2f} {y - 2.4:.2f}v1.6H{right:.2f}v-1.6"/>'
    yield f'<text x="{right:.2f}" y="{y + 3.4:.2f}" text-anchor="end">{bar:g} mm</text>'


def _round_length(limit: float) -> float:
    power = 10.0 ** math.floor(math.log10(limit))
    return float(max(m * power for m in (1, 2, 5) if m * power <= limit * (1 + 1e-12)))


# PNG.

_SHIFT = 4


def _png(found: Inspection) -> bytes:
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    page = _page(found)
    size = (round(page.wide * _PX), round(page.high * _PX))
    sheet = _paper(page, found, size)

    def at(points: FloatArray) -> np.ndarray[tuple[int, ...], np.dtype[np.int32]]:
        return np.asarray(np.round(page.place(points) * (_PX * 2**_SHIFT)), dtype=np.int32)

    for one in found.differences:
        rings = [at(ring) for ring in _rings(one.shape)]
        if rings:
            cv2.fillPoly(sheet, rings, _colour(one), cv2.LINE_AA, _SHIFT)
    for shape, colour in ((found.expected.region, _LINE), (found.seen, (11, 122, 59))):
        cv2.polylines(
            sheet, [at(ring) for ring in _rings(shape)], True, colour[::-1], 1, cv2.LINE_AA, _SHIFT
        )
    for number, one in enumerate(found.differences[:_MOST], 1):
        u, v = (page.place(np.array([one.place]))[0] * _PX).round().astype(int).tolist()
        radius = round(_RING * _PX)
        cv2.circle(sheet, (u, v), radius, _colour(one), 2, cv2.LINE_AA)
        _write_label(sheet, _label(number, one), (u + radius, v - radius), _colour(one))
    _write_words(sheet, page, found)
    return bytes(cv2.imencode(".png", sheet)[1])


def _write_label(
    sheet: Pixels, label: str, place: tuple[int, int], colour: tuple[int, int, int]
) -> None:
    """A label on white, moved to the left where the sheet ends."""
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    face = cv2.FONT_HERSHEY_SIMPLEX
    (wide, high), below = cv2.getTextSize(label, face, 0.6, 2)
    u, v = min(place[0], sheet.shape[1] - wide - 4), place[1]
    cv2.rectangle(sheet, (u - 3, v - high - 3), (u + wide + 3, v + below), (255, 255, 255), -1)
    cv2.putText(sheet, label, (u, v), face, 0.6, colour, 2, cv2.LINE_AA)


def _paper(page: _Page, found: Inspection, size: tuple[int, int]) -> Pixels:
    """The photo, paler, where it lies on the page; blue, green, red."""
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    raster = found.photo.raster
    assert raster is not None
    view = raster.view if raster.view.ndim == 3 else cv2.cvtColor(raster.view, cv2.COLOR_GRAY2BGR)
    laid = cv2.warpAffine(
        view, _view_on(page, found) * _PX, size, flags=cv2.INTER_AREA, borderValue=(255, 255, 255)
    )
    pale = 255 - (255 - laid.astype(np.float32)) * (1 - _PALE)
    pale[: round(_TITLE * _PX)] = 255
    return np.asarray(pale, dtype=np.uint8)


def _write_words(sheet: Pixels, page: _Page, found: Inspection) -> None:
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    title, facts = (text.encode("ascii", "replace").decode() for text in _words(found))
    face, ink = cv2.FONT_HERSHEY_SIMPLEX, _INK[::-1]
    left, height = round(_MARGIN * _PX), sheet.shape[0]
    cv2.putText(sheet, title, (left, 45), face, 0.9, ink, 2, cv2.LINE_AA)
    cv2.putText(sheet, facts, (left, 80), face, 0.6, ink, 1, cv2.LINE_AA)
    x = left
    for colour, label in (
        (_LINE, "expected"),
        ((11, 122, 59), "seen"),
        (_BURR, "burr"),
        (_OTHER, "other too much"),
        (_MISSING, "missing"),
    ):
        cv2.rectangle(sheet, (x, height - 40), (x + 45, height - 32), colour[::-1], -1)
        cv2.putText(sheet, label, (x + 55, height - 30), face, 0.6, ink, 1, cv2.LINE_AA)
        x += 80 + 12 * len(label)
    bar = _round_length(45 / page.scale)
    right = sheet.shape[1] - left
    cv2.line(
        sheet, (right - round(bar * page.scale * _PX), height - 36), (right, height - 36), ink, 3
    )
    cv2.putText(sheet, f"{bar:g} mm", (right - 80, height - 14), face, 0.6, ink, 1, cv2.LINE_AA)


def _colour(difference: Difference) -> tuple[int, int, int]:
    red, green, blue = _COLOURS[_class(difference)]
    return blue, green, red
