"""A picture of a 3-D part and its build as one SVG file: the part shaded, its edges numbered in their order (RFA paper,
figures 16 and 18), those that are left out in red.
"""

from __future__ import annotations

import base64
import textwrap
from collections.abc import Iterator

import cv2
import numpy as np
from msgspec import Struct

from camgen.model.errors import one_line
from camgen.model.part import Solid
from camgen.model.pose import FloatArray
from camgen.model.text import escape
from camgen.preview.draw import by_order
from camgen.preview.figure import (
    FigureEdge,
    Look,
    Shaded,
    figure_edges,
    label_places,
    oblique,
    runs,
    shade,
)
from camgen.preview.view import View

#: The part is made as large as fits in here, page mm; around it a margin, above it the title.
_WIDE, _HIGH, _MARGIN, _TITLE = 180.0, 130.0, 12.0, 18.0
#: Page mm: radius of a number.
_RADIUS = 3.2

_STYLE = """\
.bg{fill:#fff}.unused{stroke:#9aa0a6;stroke-width:.3}.done{stroke-width:.9}.skipped{stroke:#d0103a;stroke-width:.9}
.hidden{stroke-dasharray:1.3 1.1;stroke-width:.45}.travel{stroke:#5f6368;stroke-width:.15;stroke-dasharray:1.2 1}
text{font-family:system-ui,Helvetica,Arial,sans-serif;font-size:3.4px;fill:#202124}.big{font-size:4.6px;font-weight:600}
.n{text-anchor:middle;font-weight:600;fill:#fff}.warn{fill:#d0103a}
path,line{fill:none;stroke-linecap:round;stroke-linejoin:round}.arrow{stroke:none}
@media (prefers-color-scheme:dark){.bg{fill:#17181b}text{fill:#e8eaed}.n{fill:#fff}.warn{fill:#ff6b81}}"""


class _Sheet(Struct, frozen=True, eq=False):
    """From the work frame to the page, mm, y down: as it is looked at, then scale, then where the sheet's origin is."""

    look: Look
    scale: float
    x: float
    y: float
    width: float
    bottom: float

    def put(self, at: FloatArray) -> FloatArray:
        """Page places (N, 2) of places on the sheet."""
        return np.asarray(at * (self.scale, -self.scale) + (self.x, self.y))


def svg(view: View, solid: Solid) -> str:
    """The picture as SVG text, sized in mm, legible on light and dark."""
    look = oblique(view.upright)
    shaded = shade(solid, look)
    edges = figure_edges(view, solid, look, shaded)
    sheet = _fit(solid, look)
    told = _left_out(view, sheet)
    height = sheet.bottom + 12 + 5 * len(told)
    facts = dict(view.facts)
    line = ", ".join(
        f"{name.lower()} {facts[name]}" for name in ("Paths", "Work", "Travel", "Time")
    )
    size = f'width="{sheet.width:.2f}mm" height="{height:.2f}mm" viewBox="0 0 {sheet.width:.2f} {height:.2f}"'
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" {size}>',
            f"<title>{_text(view.title)}</title>",
            f"<style>{_STYLE}</style>",
            '<rect class="bg" width="100%" height="100%"/>',
            f'<text class="big" x="{_MARGIN}" y="9">{_text(view.title)}</text>',
            f'<text x="{_MARGIN}" y="14">{_text(line)}</text>',
            _faces(shaded, sheet),
            *_edges(edges, sheet, len(view.rows)),
            *_numbers(edges, sheet, len(view.rows)),
            *_legend(sheet, view),
            *told,
            "</svg>\n",
        ]
    )


def _fit(solid: Solid, look: Look) -> _Sheet:
    at = look.place(solid.vertices)
    low, size = at.min(axis=0), np.maximum(np.ptp(at, axis=0), 1e-6)
    scale = float(min(_WIDE / size[0], _HIGH / size[1]))
    width = _WIDE + 2 * _MARGIN
    left, top = (width - scale * float(size[0])) / 2, _TITLE + _RADIUS
    bottom = top + scale * float(size[1]) + _RADIUS + 2
    return _Sheet(
        look,
        scale,
        left - scale * float(low[0]),
        top + scale * float(low[1] + size[1]),
        width,
        bottom,
    )


def _faces(shaded: Shaded, sheet: _Sheet) -> str:
    """The shaded faces as a picture in the picture."""
    data = base64.b64encode(bytes(cv2.imencode(".png", shaded.pixels())[1])).decode()
    high, wide = (n * shaded.per_px for n in shaded.front.shape)
    half = shaded.per_px / 2
    ((x, y),) = sheet.put((shaded.low + np.array([-half, high - half]))[None]).tolist()
    place = f'x="{x:.2f}" y="{y:.2f}" width="{wide * sheet.scale:.2f}" height="{high * sheet.scale:.2f}"'
    return f'<image {place} preserveAspectRatio="none" href="data:image/png;base64,{data}"/>'


def _edges(edges: list[FigureEdge], sheet: _Sheet, count: int) -> Iterator[str]:
    """Hidden stretches first, then the others; what is left out last."""
    for wanted in (False, True):
        for state in ("unused", "done", "wrong", "skipped"):
            for edge in edges:
                if edge.state == state:
                    yield from _stretches(edge, sheet, wanted, count)


def _stretches(edge: FigureEdge, sheet: _Sheet, wanted: bool, count: int) -> Iterator[str]:
    kind = ("skipped" if edge.state == "wrong" else edge.state) + ("" if wanted else " hidden")
    stroke = f' stroke="{by_order(edge.number, count)}"' if edge.number >= 0 else ""
    for seen, points in runs(edge):
        if seen == wanted:
            rows = sheet.put(sheet.look.place(points)).tolist()
            data = "M" + "L".join(f"{x:.2f} {y:.2f}" for x, y in rows)
            yield f'<path class="{kind}"{stroke} d="{data}"><title>{_text(edge.text)}</title></path>'


def _numbers(edges: list[FigureEdge], sheet: _Sheet, count: int) -> Iterator[str]:
    """A disc with the number on each edge that is run, hollow where the edge is hidden; the id of one that is not."""
    places = label_places(edges, sheet.look, 2.1 * _RADIUS / sheet.scale)
    for edge, (at, seen) in zip(edges, places, strict=True):
        if not edge.text:
            continue
        ((x, y),) = sheet.put(at[None]).tolist()
        colour = by_order(edge.number, count) if edge.number >= 0 else "#d0103a"
        fill, ink = (colour, "#fff") if seen else ("#fff", colour)
        size = 3.6 if len(edge.text) < 3 else 2.6
        shape = f'fill="{fill}" stroke="{colour}" stroke-width=".35"'
        yield f'<circle cx="{x:.2f}" cy="{y:.2f}" r="{_RADIUS}" {shape}/>'
        style = f'style="font-size:{size}px;fill:{ink}"'
        yield f'<text class="n" {style} x="{x:.2f}" y="{y + 0.36 * size:.2f}">{_text(edge.text)}</text>'


def _legend(sheet: _Sheet, view: View) -> Iterator[str]:
    x, y = _MARGIN, sheet.bottom + 4
    for k in range(12):
        yield f'<rect x="{x + k:.2f}" y="{y - 2:.2f}" width="1.05" height="1.6" fill="{by_order(k, 12)}"/>'
    yield f'<text x="{x + 14}" y="{y:.2f}">edges in their order, dashed and hollow where they are behind</text>'
    if any(line.state == "skipped" for line in view.lines):
        x += 130
        yield f'<path class="skipped" d="M{x} {y - 1.2:.2f}h9"/><text x="{x + 11}" y="{y:.2f}">left out</text>'


def _left_out(view: View, sheet: _Sheet) -> list[str]:
    """What was left out, in lines that fit the page."""
    texts = [
        f"left out: {note.what}" + (f" ({note.why})" if note.why else "") for note in view.skipped
    ]
    if len(texts) > 6:
        texts = [*texts[:5], f"left out: and {len(texts) - 5} more"]
    width = int((sheet.width - 2 * _MARGIN) / 1.75)  # a letter is about 1.75 page mm wide
    lines = [
        line
        for text in texts
        for line in textwrap.wrap(one_line(text), width, subsequent_indent="    ")
    ]
    y = sheet.bottom + 11
    return [
        f'<text class="warn" xml:space="preserve" x="{_MARGIN}" y="{y + 5 * k:.2f}">{_text(line)}</text>'
        for k, line in enumerate(lines)
    ]


def _text(text: str) -> str:
    return escape(one_line(text))
