"""A picture of a 3-D part and its build as one SVG file.

The part is shaded, its edges are numbered in their order (RFA paper, figures 16 and 18), and edges
that are left out are red.
"""

from __future__ import annotations

import base64
from collections.abc import Iterator

import cv2
import numpy as np
from msgspec import Struct

from camgen.model.part import Solid
from camgen.model.pose import FloatArray
from camgen.preview.draw import choose_colour, escape_line
from camgen.preview.figure import (
    FigureEdge,
    Projection,
    ShadedFaces,
    list_figure_edges,
    make_oblique,
    place_labels,
    shade,
    split_visibility,
)
from camgen.preview.panels import format_line
from camgen.preview.svg import format_warnings
from camgen.preview.view import View

#: Maximum width and height of the part, the margin around it, and the title above it, page mm.
_WIDE, _HIGH, _MARGIN, _TITLE = 180.0, 130.0, 12.0, 18.0
#: Radius of the disc of a number, page mm.
_RADIUS = 3.2

_STYLE = """\
.bg{fill:#fff}.unused{stroke:#9aa0a6;stroke-width:.3}.done{stroke-width:.9}\
.skipped{stroke:#d0103a;stroke-width:.9}
.hidden{stroke-dasharray:1.3 1.1;stroke-width:.45}\
.travel{stroke:#5f6368;stroke-width:.15;stroke-dasharray:1.2 1}
text{font-family:system-ui,Helvetica,Arial,sans-serif;font-size:3.4px;fill:#202124}\
.big{font-size:4.6px;font-weight:600}
.n{text-anchor:middle;font-weight:600;fill:#fff}.warn{fill:#d0103a}
path,line{fill:none;stroke-linecap:round;stroke-linejoin:round}.arrow{stroke:none}
@media (prefers-color-scheme:dark){.bg{fill:#17181b}text{fill:#e8eaed}.n{fill:#fff}\
.warn{fill:#ff6b81}}"""


class _Sheet(Struct, frozen=True, eq=False):
    """The transform from the work frame to the page, mm, y down.

    projection: projection onto the sheet.
    scale: page mm per mm of the sheet.
    x, y: page position of the origin of the sheet.
    width: width of the page.
    bottom: y at which the legend starts.
    """

    projection: Projection
    scale: float
    x: float
    y: float
    width: float
    bottom: float

    def place(self, places: FloatArray) -> FloatArray:
        """Page positions (N, 2) of places (N, 2) on the sheet."""
        return np.asarray(places * (self.scale, -self.scale) + (self.x, self.y))


def format_solid_svg(view: View, solid: Solid) -> str:
    """The picture as SVG text, sized in mm, legible on light and dark."""
    projection = make_oblique(view.upright)
    shaded = shade(solid, projection)
    edges = list_figure_edges(view, solid, projection, shaded)
    sheet = _fit_sheet(solid, projection)
    faults = [(f"left out: {note.what}", note.why) for note in view.skipped]
    # A letter is about 1.75 page mm wide.
    letters = int((sheet.width - 2 * _MARGIN) / 1.75)
    warnings = format_warnings(faults, letters, _MARGIN, sheet.bottom + 11)
    height = sheet.bottom + 12 + 5 * len(warnings)
    facts = dict(view.facts)
    names = ("Paths", "Work", "Travel", "Time")
    line = ", ".join(f"{name.lower()} {facts[name]}" for name in names)
    size = f'width="{sheet.width:.2f}mm" height="{height:.2f}mm"'
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" {size} '
            f'viewBox="0 0 {sheet.width:.2f} {height:.2f}">',
            f"<title>{escape_line(view.title)}</title>",
            f"<style>{_STYLE}</style>",
            '<rect class="bg" width="100%" height="100%"/>',
            f'<text class="big" x="{_MARGIN}" y="9">{escape_line(view.title)}</text>',
            f'<text x="{_MARGIN}" y="14">{escape_line(line)}</text>',
            _faces(shaded, sheet),
            *_edges(edges, sheet, len(view.rows)),
            *_numbers(edges, sheet, len(view.rows)),
            *_legend(sheet, view),
            *warnings,
            "</svg>\n",
        ]
    )


def _fit_sheet(solid: Solid, projection: Projection) -> _Sheet:
    places = projection.place(solid.vertices)
    low, size = places.min(axis=0), np.maximum(np.ptp(places, axis=0), 1e-6)
    scale = float(min(_WIDE / size[0], _HIGH / size[1]))
    width = _WIDE + 2 * _MARGIN
    left, top = (width - scale * float(size[0])) / 2, _TITLE + _RADIUS
    bottom = top + scale * float(size[1]) + _RADIUS + 2
    return _Sheet(
        projection,
        scale,
        left - scale * float(low[0]),
        top + scale * float(low[1] + size[1]),
        width,
        bottom,
    )


def _faces(shaded: ShadedFaces, sheet: _Sheet) -> str:
    """The shaded faces as an embedded picture."""
    data = base64.b64encode(bytes(cv2.imencode(".png", shaded.pixels())[1])).decode()
    height, width = (n * shaded.per_px for n in shaded.front.shape)
    half = shaded.per_px / 2
    ((x, y),) = sheet.place((shaded.low + np.array([-half, height - half]))[None]).tolist()
    size = f'width="{width * sheet.scale:.2f}" height="{height * sheet.scale:.2f}"'
    source = f'preserveAspectRatio="none" href="data:image/png;base64,{data}"'
    return f'<image x="{x:.2f}" y="{y:.2f}" {size} {source}/>'


def _edges(edges: list[FigureEdge], sheet: _Sheet, count: int) -> Iterator[str]:
    """The hidden stretches, then the visible ones; each time those that are left out last."""
    for is_seen in (False, True):
        for state in ("unused", "done", "wrong", "skipped"):
            for edge in edges:
                if edge.state == state:
                    yield from _stretches(edge, sheet, is_seen, count)


def _stretches(edge: FigureEdge, sheet: _Sheet, is_seen: bool, count: int) -> Iterator[str]:
    kind = ("skipped" if edge.state == "wrong" else edge.state) + ("" if is_seen else " hidden")
    stroke = f' stroke="{choose_colour(edge.number, count)}"' if edge.number >= 0 else ""
    title = f"<title>{escape_line(edge.text)}</title>"
    for seen, points in split_visibility(edge):
        if seen == is_seen:
            data = format_line(sheet.place(sheet.projection.place(points)))
            yield f'<path class="{kind}"{stroke} d="{data}">{title}</path>'


def _numbers(edges: list[FigureEdge], sheet: _Sheet, count: int) -> Iterator[str]:
    """The labels of the edges as discs: numbers, and ids of edges that are left out.

    The disc of a hidden edge is hollow.
    """
    for edge, place, seen in place_labels(edges, sheet.projection, 2.1 * _RADIUS / sheet.scale):
        ((x, y),) = sheet.place(place[None]).tolist()
        colour = choose_colour(edge.number, count) if edge.number >= 0 else "#d0103a"
        fill, ink = (colour, "#fff") if seen else ("#fff", colour)
        size = 3.6 if len(edge.text) < 3 else 2.6
        shape = f'fill="{fill}" stroke="{colour}" stroke-width=".35"'
        yield f'<circle cx="{x:.2f}" cy="{y:.2f}" r="{_RADIUS}" {shape}/>'
        style = f'style="font-size:{size}px;fill:{ink}" x="{x:.2f}" y="{y + 0.36 * size:.2f}"'
        yield f'<text class="n" {style}>{escape_line(edge.text)}</text>'


def _legend(sheet: _Sheet, view: View) -> Iterator[str]:
    x, y = _MARGIN, sheet.bottom + 4
    for k in range(12):
        size = f'x="{x + k:.2f}" y="{y - 2:.2f}" width="1.05" height="1.6"'
        yield f'<rect {size} fill="{choose_colour(k, 12)}"/>'
    label = "edges in their order, dashed and hollow where they are behind"
    yield f'<text x="{x + 14}" y="{y:.2f}">{label}</text>'
    if any(line.state == "skipped" for line in view.lines):
        x += 130
        text = f'<text x="{x + 11}" y="{y:.2f}">left out</text>'
        yield f'<path class="skipped" d="M{x} {y - 1.2:.2f}h9"/>{text}'
