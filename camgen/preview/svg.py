"""A flat picture of a build as one SVG file: part, tool paths in order, travel, starts, faults."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from itertools import chain, pairwise

import numpy as np
from msgspec import Struct

from camgen.geometry.arcs import measure_path
from camgen.model.errors import make_one_line
from camgen.model.part import Contour, Note, Part
from camgen.model.path import ToolPath, Tour
from camgen.model.pose import FloatArray
from camgen.model.text import counted, short
from camgen.preview.aside import project_aside
from camgen.preview.draw import (
    PageChains,
    Paper,
    choose_colour,
    draw_places,
    escape_line,
    format_bar,
    format_path_data,
    join_path_data,
    list_faults,
    make_contour_chains,
    make_line_chains,
    make_path_chains,
    measure_bounds,
    place_arrows,
)
from camgen.preview.fixtures import FixtureView

#: Maximum width and height of the drawing, the margin around it, and the title above it, page mm.
_WIDE, _HIGH, _MARGIN, _TITLE = 277.0, 200.0, 10.0, 16.0
#: Minimum width of the page, for the legend, page mm.
_LEAST_PAGE_MM = 170.0
#: Maximum number of paths with numbers, and with arrows and hover texts.
_NUMBERS, _ARROWS = 200, 1500
#: Number of colours of a picture without arrows.
_BINS = 32

#: The outline in a photo of the part, legible on light and dark.
_SEEN = 'stroke="#2f9e5b" stroke-width=".2"'
_STYLE = """\
.bg{fill:#fff}.part{stroke:#9aa0a6;stroke-width:.35}\
.unused{stroke:#d0103a;stroke-width:.35;stroke-dasharray:1.6 .8}
.travel{stroke:#5f6368;stroke-width:.18;stroke-dasharray:1.2 1}.path{stroke-width:.45}
text{font-family:system-ui,Helvetica,Arial,sans-serif;font-size:3.4px;fill:#202124}\
.big{font-size:4.6px;font-weight:600}
.n{fill:#fff;text-anchor:middle;font-weight:600}.bar{stroke:#202124;stroke-width:.4}\
.warn{fill:#d0103a}
path,line{fill:none;stroke-linecap:round;stroke-linejoin:round}.arrow{stroke:none}
@media (prefers-color-scheme:dark){.bg{fill:#17181b}text{fill:#e8eaed}.n{fill:#fff}\
.part{stroke:#80868b}
.travel{stroke:#9aa0a6}.bar{stroke:#e8eaed}.unused{stroke:#ff6b81}.warn{fill:#ff6b81}}"""

#: Added where fixtures are drawn.
_FIXTURES = """\
.blocked{stroke:#d0103a;stroke-width:.7;stroke-dasharray:1.6 1.2}
.top{text-anchor:middle;font-size:3px}
.fixture{stroke:#a06a00;stroke-width:.35}"""


class DrawnFixtures(Struct, frozen=True, eq=False):
    """The fixtures of a mill, and the paths and stretches of paths that they block."""

    fixtures: tuple[FixtureView, ...] = ()
    blocked: tuple[ToolPath, ...] = ()


class _Sheet(Struct, frozen=True):
    """A sheet.

    page: transform to the page.
    width: width of the page, mm.
    bottom: y at which the legend starts, page mm.
    """

    page: Paper
    width: float
    bottom: float


def format_svg(
    part: Part,
    tour: Tour,
    notes: Sequence[Note],
    title: str,
    seen: Sequence[FloatArray] = (),
    standing: DrawnFixtures = DrawnFixtures(),  # noqa: B008 (frozen)
) -> str:
    """The picture as SVG text, sized in mm, to scale, legible on light and dark.

    Curves in space are seen from the side and above.

    seen: outlines (N, 2) in a photo of the part, mm.
    standing: fixtures of a mill.
    """
    lengths = list(map(measure_path, tour.paths))
    if part.curves:
        part, tour = project_aside(part, tour)
    followed = set(chain.from_iterable(path.contours for path in tour.paths))
    used = [c for c in part.contours if c.id in followed]
    unused = [c for c in part.contours if c.id not in followed]
    photo = make_line_chains(seen)
    loops: list[FloatArray] = []
    for fixture in standing.fixtures:
        loops += fixture.loops
    sheet = _fit_sheet(
        part, tour, [photo, make_line_chains(loops), make_path_chains(standing.blocked)]
    )
    # A letter is about 1.9 page mm wide.
    letters = int((sheet.width - 2 * _MARGIN) / 1.9)
    warnings = format_warnings(list_faults(notes), letters, _MARGIN, sheet.bottom + 12)
    height = sheet.bottom + 14 + 5 * len(warnings)
    facts = f"drawing in {part.units}, {counted(len(tour.paths), 'path')}, {tour.method}, "
    facts += f"travel {tour.travel:.1f} mm"
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{sheet.width:.2f}mm" '
            f'height="{height:.2f}mm" viewBox="0 0 {sheet.width:.2f} {height:.2f}">',
            f"<title>{escape_line(title)}</title>",
            f"<style>{_STYLE}{_FIXTURES if standing.fixtures else ''}</style>",
            '<rect class="bg" width="100%" height="100%"/>',
            f'<text class="big" x="{_MARGIN}" y="9">{escape_line(title)}</text>',
            f'<text x="{_MARGIN}" y="14">{escape_line(facts)}</text>',
            *_contours(used, sheet.page, "part"),
            *_contours(unused, sheet.page, "unused"),
            *_fixtures(standing.fixtures, sheet.page),
            *(f'<path {_SEEN} d="{line}"/>' for line in format_path_data(photo, sheet.page)),
            *_travel(tour, sheet.page),
            *_paths(tour, sheet.page, lengths),
            *_blocked(standing.blocked, sheet.page),
            *draw_places(notes, sheet.page, 0.0),
            *_legend(sheet, tour, bool(unused), bool(seen), standing),
            *warnings,
            "</svg>\n",
        ]
    )


def _fit_sheet(part: Part, tour: Tour, others: Sequence[PageChains]) -> _Sheet:
    low, high = measure_bounds(
        [make_contour_chains(part.contours), make_path_chains(tour.paths), *others]
    )
    wide, high_mm = np.maximum(high - low, 1e-6).tolist()
    scale = min(_WIDE / wide, _HIGH / high_mm)
    width = max(wide * scale, _LEAST_PAGE_MM) + 2 * _MARGIN
    left = (width - wide * scale) / 2
    top = _TITLE + 6
    page = Paper(scale, left - float(low[0]) * scale, top + float(high[1]) * scale)
    return _Sheet(page, width, top + high_mm * scale + 8)


def _contours(contours: Sequence[Contour], page: Paper, kind: str) -> Iterator[str]:
    if contours:
        yield f'<path class="{kind}" d="{join_path_data(make_contour_chains(contours), page)}"/>'


def _fixtures(fixtures: Sequence[FixtureView], page: Paper) -> Iterator[str]:
    for fixture in fixtures:
        data = join_path_data(make_line_chains(fixture.loops), page)
        top = f"z {short(fixture.top, 2)}"
        yield (
            f'<path style="fill:#f2b134;fill-opacity:.35" class="fixture" d="{data}">'
            f"<title>fixture {fixture.number}, top at {top} mm</title></path>"
        )
        places = page.place(fixture.loops[0])
        x, y = ((places.min(axis=0) + places.max(axis=0)) / 2).tolist()
        yield f'<text class="top" x="{x:.2f}" y="{y + 1:.2f}">{fixture.number}: {top}</text>'


def _blocked(paths: Sequence[ToolPath], page: Paper) -> Iterator[str]:
    if paths:
        yield f'<path class="blocked" d="{join_path_data(make_path_chains(paths), page)}"/>'


def _travel(tour: Tour, page: Paper) -> Iterator[str]:
    if len(tour.paths) > 1:
        ends = page.place(np.array([path.position[-1] for path in tour.paths[:-1]]))
        starts = page.place(np.array([path.position[0] for path in tour.paths[1:]]))
        rows = np.column_stack([ends, starts]).tolist()
        data = "".join(f"M{a:.2f} {b:.2f}L{c:.2f} {d:.2f}" for a, b, c, d in rows)
        yield f'<path class="travel" d="{data}"/>'


def _paths(tour: Tour, page: Paper, lengths: Sequence[float]) -> Iterator[str]:
    """The tool paths, one element per path, or one per colour for many paths.

    lengths: length of each path, mm.
    """
    paths = tour.paths
    data = format_path_data(make_path_chains(paths), page)
    if len(paths) <= _ARROWS:
        for k, (path, line) in enumerate(zip(paths, data, strict=True)):
            hint = escape_line(f"{k + 1}: {path.id}, layer {path.layer}, {lengths[k]:.1f} mm")
            colour = choose_colour(k, len(paths))
            yield f'<path class="path" stroke="{colour}" d="{line}"><title>{hint}</title></path>'
            yield from _arrows(path, page, colour)
        yield from _starts(paths, page)
        return
    edges = np.round(np.arange(_BINS + 1) * len(paths) / _BINS).astype(int)
    for a, b in pairwise(edges.tolist()):
        colour = choose_colour(a, len(paths))
        yield f'<path class="path" stroke="{colour}" d="{"".join(data[a:b])}"/>'


def _arrows(path: ToolPath, page: Paper, colour: str) -> Iterator[str]:
    size = min(1.0, measure_path(path) * page.scale / 12)
    if size < 0.3:
        return
    for x, y, turn in place_arrows(path, page, 90.0):
        place = f"translate({x:.2f} {y:.2f}) rotate({turn:.1f}) scale({size:.2f})"
        style = f'class="arrow" style="fill:{colour}" transform="{place}"'
        yield f'<path {style} d="M1.5 0L-1 -1.1L-.4 0L-1 1.1Z"/>'


def _starts(paths: Sequence[ToolPath], page: Paper) -> Iterator[str]:
    """A dot at the start of each path, with the number of the path if there are not too many."""
    is_numbered = len(paths) <= _NUMBERS
    largest = 2.0 if len(paths) <= 60 else 1.5
    places = page.place(np.array([path.position[0] for path in paths]).reshape(-1, 3))
    for k, (x, y) in enumerate(places.tolist()):
        radius = 0.6
        if is_numbered:
            radius = min(largest, max(1.0, measure_path(paths[k]) * page.scale / 14))
        fill = choose_colour(k, len(paths))
        yield f'<circle cx="{x:.2f}" cy="{y:.2f}" r="{radius:.2f}" fill="{fill}"/>'
        if is_numbered:
            size = radius * (1.25 if k < 99 else 0.95)
            place = f'x="{x:.2f}" y="{y + 0.36 * size:.2f}"'
            yield f'<text class="n" style="font-size:{size:.2f}px" {place}>{k + 1}</text>'


def _legend(
    sheet: _Sheet, tour: Tour, unused: bool, seen: bool, standing: DrawnFixtures
) -> Iterator[str]:
    y = sheet.bottom + 5
    x = _MARGIN
    for style, label, is_drawn in (
        ('class="part"', "part", True),
        (_SEEN, "photo", seen),
        ('class="travel"', "travel", True),
        ('class="unused"', "no path of its own", unused),
        ('class="fixture"', "fixture", bool(standing.fixtures)),
        ('class="blocked"', "left out for it", bool(standing.blocked)),
    ):
        if is_drawn:
            yield f'<line {style} x1="{x}" y1="{y - 1.2}" x2="{x + 9}" y2="{y - 1.2}"/>'
            yield f'<text x="{x + 11}" y="{y}">{label}</text>'
            x += 16 + 1.9 * len(label)
    if tour.paths:
        for k in range(12):
            size = f'x="{x + k:.2f}" y="{y - 2}" width="1.05" height="1.6"'
            yield f'<rect {size} fill="{choose_colour(k, 12)}"/>'
        label = "first to last" if standing.fixtures else "tool centre, first to last; dot: start"
        yield f'<text x="{x + 14}" y="{y}">{label}</text>'
    yield from format_bar(sheet.width - _MARGIN, y, sheet.page.scale, y + 3.6)


def format_warnings(
    faults: Sequence[tuple[str, str]], letters: int, x: float, y: float
) -> list[str]:
    """Faults and their reasons as red lines of `letters` letters, from the page position x, y."""
    texts = [what + (f" ({why})" if why else "") for what, why in faults]
    if len(texts) > 6:
        texts = [*texts[:5], f"left out: and {len(texts) - 5} more"]
    lines: list[str] = []
    for text in texts:
        lines += textwrap.wrap(make_one_line(text), letters, subsequent_indent="    ")
    start = f'<text class="warn" xml:space="preserve" x="{x}"'
    return [f'{start} y="{y + 5 * k:.2f}">{escape_line(row)}</text>' for k, row in enumerate(lines)]
