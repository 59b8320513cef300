"""SVG path data of chains of lines and arcs, and shapes on them. Page coordinates: mm, y down."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from msgspec import Struct

from camgen.geometry.arcs import compute_bulges, measure_spans
from camgen.geometry.ragged import compute_first_rows
from camgen.model.errors import make_one_line
from camgen.model.part import Contour, IntArray, Note
from camgen.model.path import ToolPath
from camgen.model.pose import FloatArray
from camgen.model.text import escape

#: Colours from the first path to the last: blue, violet, orange, legible on white and on black.
_RAMP = ((31, 111, 235), (163, 59, 196), (235, 94, 40))

#: Digits of page coordinates, mm: more than a picture prints, fewer than differ between processors.
#: A coordinate in the middle of two printed numbers is then printed alike on all processors.
_PLACE_DIGITS = 9
#: Minimum radius of the ring around a place, page mm.
_LEAST_RING = 1.2


def choose_colour(k: int, count: int) -> str:
    """The colour of path `k` of `count` paths."""
    place = k / max(count - 1, 1) * (len(_RAMP) - 1)
    low = min(int(place), len(_RAMP) - 2)
    ends = zip(_RAMP[low], _RAMP[low + 1], strict=True)
    return "#" + "".join(f"{round(a + (b - a) * (place - low)):02x}" for a, b in ends)


def choose_bar(limit: float) -> float:
    """Length of a scale bar: the largest 1, 2 or 5 times a power of ten up to `limit`."""
    power = 10.0 ** math.floor(math.log10(limit))
    return float(max(m * power for m in (1, 2, 5) if m * power <= limit * (1 + 1e-12)))


def format_bar(right: float, y: float, scale: float, text_y: float) -> Iterator[str]:
    """A scale bar that ends at the page position `right`, `y`, with its length below it.

    scale: page mm per mm.
    text_y: position of the text, page mm.
    """
    bar = choose_bar(45 / scale)
    left = right - bar * scale
    yield f'<path class="bar" d="M{left:.2f} {y - 2.4:.2f}v1.6H{right:.2f}v-1.6"/>'
    yield f'<text x="{right:.2f}" y="{text_y:.2f}" text-anchor="end">{bar:g} mm</text>'


def escape_line(text: str) -> str:
    """Text of any origin as one line of XML, without control characters and markup."""
    return escape(make_one_line(text))


class Paper(Struct, frozen=True, eq=False):
    """The transform from the work frame (mm, y up) to the page.

    scale: page mm per mm.
    x, y: page position of the work origin, mm.
    """

    scale: float
    x: float
    y: float

    def place(self, points: FloatArray) -> FloatArray:
        """Page coordinates (N, 2) of `points` (N, 2 or more)."""
        places = points[:, :2] * (self.scale, -self.scale) + (self.x, self.y)
        return np.asarray(np.round(places, _PLACE_DIGITS), dtype=np.float64)


class PageChains(Struct, frozen=True, eq=False):
    """M chains in one table of N points.

    points: (N, 2) points.
    bulge: (N,) bulge of the segment that ends at the point.
    first: (M,) rows at which the chains start.
    """

    points: FloatArray
    bulge: FloatArray
    first: IntArray


def make_contour_chains(contours: Sequence[Contour]) -> PageChains:
    """The contours, closed ones with their first point again at the end."""
    rows, bulges = [], []
    for contour in contours:
        back = contour.points[:1] if contour.closed else contour.points[:0]
        rows.append(np.concatenate([contour.points, back]))
        bulges.append(np.concatenate([[0.0], contour.bulges[: len(rows[-1]) - 1]]))
    return _join_chains(rows, bulges)


def make_line_chains(rows: Sequence[FloatArray]) -> PageChains:
    """Chains (N, 2) of straight lines."""
    return _join_chains(rows, [np.zeros(len(row)) for row in rows])


def make_path_chains(paths: Sequence[ToolPath]) -> PageChains:
    """The tool paths as chains."""
    if not paths:
        return make_line_chains([])
    points = np.concatenate([path.position for path in paths])[:, :2]
    via = np.concatenate([path.via for path in paths])[:, :2]
    before = np.concatenate([points[:1], points[:-1]])
    return PageChains(
        points,
        compute_bulges(before, via, points),
        compute_first_rows([len(path.position) for path in paths]),
    )


def _join_chains(rows: Sequence[FloatArray], bulges: Sequence[FloatArray]) -> PageChains:
    if not rows:
        return PageChains(np.zeros((0, 2)), np.zeros(0), np.zeros(0, dtype=int))
    return PageChains(
        np.concatenate(rows), np.concatenate(bulges), compute_first_rows(list(map(len, rows)))
    )


def format_path_data(chains: PageChains, page: Paper) -> list[str]:
    """The attribute `d` of each chain, with arcs as arcs."""
    if not len(chains.first):
        return []
    points = page.place(chains.points)
    previous = np.concatenate([points[:1], points[:-1]])
    chord = np.hypot(*(points - previous).T)
    bulge = np.abs(chains.bulge)
    # An arc of less than a hundredth of a page mm above its chord is drawn as a line.
    curved = bulge * chord > 0.02
    with np.errstate(divide="ignore", invalid="ignore"):
        radius = np.where(curved, chord * (1 + bulge**2) / (4 * bulge), 0.0).round(_PLACE_DIGITS)
    # y of the page points down, so counter-clockwise in the drawing is sweep flag 0.
    columns = np.column_stack([points, curved, radius, chains.bulge < 0])
    words = []
    for x, y, is_arc, r, flag in columns.tolist():
        arc = f"A{r:.2f} {r:.2f} 0 0 {flag:.0f} " if is_arc else "L"
        words.append(f"{arc}{x:.2f} {y:.2f}")
    starts = chains.first.tolist()
    for k in starts:
        words[k] = f"M{points[k, 0]:.2f} {points[k, 1]:.2f}"
    return ["".join(words[a:b]) for a, b in pairwise([*starts, len(words)])]


def join_path_data(chains: PageChains, page: Paper) -> str:
    """The attribute `d` of all chains as one path."""
    return "".join(format_path_data(chains, page))


def measure_bounds(chains: Sequence[PageChains]) -> tuple[FloatArray, FloatArray]:
    """Lower and upper corner of chains in the work frame, exact for arcs."""
    corners = np.zeros((0, 2))
    for table in chains:
        corners = np.concatenate([corners, table.points, _find_extremes(table)])
    if not len(corners):
        return np.zeros(2), np.ones(2)
    return corners.min(axis=0), corners.max(axis=0)


def _find_extremes(chains: PageChains) -> FloatArray:
    """The points (N, 2) inside arcs at which x or y is an extreme."""
    inner = chains.bulge != 0
    inner[chains.first] = False
    rows = np.flatnonzero(inner)
    start, end, bulge = chains.points[rows - 1], chains.points[rows], chains.bulge[rows]
    half = (end - start) / 2
    # The centre is beside the middle of the chord, to the left for a positive bulge, by
    # half * (1 - b^2) / (2 b).
    left = np.column_stack([-half[:, 1], half[:, 0]])
    centre = start + half + left * ((1 - bulge**2) / (2 * bulge))[:, None]
    radius = np.hypot(*(start - centre).T)
    sweep = 4 * np.arctan(bulge)
    start_angle = np.arctan2(start[:, 1] - centre[:, 1], start[:, 0] - centre[:, 0])
    first = start_angle + np.minimum(sweep, 0)
    extremes = []
    for x, y, angle in ((1, 0, 0.0), (0, 1, np.pi / 2), (-1, 0, np.pi), (0, -1, -np.pi / 2)):
        reached = (angle - first) % (2 * np.pi) <= np.abs(sweep)
        extremes.append((centre + radius[:, None] * np.array([x, y]))[reached])
    return np.concatenate(extremes)


def draw_places(notes: Sequence[Note], page: Paper, radius: float) -> list[str]:
    """A red ring of `radius` mm, but not too small to be seen, at each place of the notes."""
    size = max(radius * page.scale, _LEAST_RING)
    style = 'fill="#d0103a" fill-opacity=".35" stroke="#d0103a" stroke-width=".5"'
    rings = []
    for note in notes:
        title = f"<title>{escape_line(note.what)}</title>"
        for x, y in page.place(np.array(note.places).reshape(-1, 2)).tolist():
            rings.append(
                f'<circle cx="{x:.2f}" cy="{y:.2f}" r="{size:.2f}" {style}>{title}</circle>'
            )
    return rings


def list_faults(notes: Sequence[Note]) -> list[tuple[str, str]]:
    """The skipped things and the other faults, each with its reason."""
    return [
        (f"{'left out' if n.kind == 'skipped' else n.kind}: {n.what}", n.why)
        for n in notes
        if n.fails_strict
    ]


def place_arrows(path: ToolPath, page: Paper, spacing: float) -> list[tuple[float, float, float]]:
    """Page x, y and direction (deg, clockwise) of arrows, about one per `spacing` page mm."""
    lengths = measure_spans(path.position, path.via[1:]) * page.scale
    ends = np.cumsum(lengths).round(_PLACE_DIGITS)
    if not len(ends) or ends[-1] <= 0:
        return []
    count = 1 + int(ends[-1] / spacing)
    # Both are rounded, so an arrow at the end of a segment belongs to it on every processor.
    middles = ((np.arange(count) + 0.5) / count * ends[-1]).round(_PLACE_DIGITS)
    rows = np.unique(np.searchsorted(ends, middles)).tolist()
    points = page.place(path.position)
    via = page.place(path.via)
    arrows = []
    for row in rows:
        start, end = points[row], points[row + 1]
        # At the middle of an arc the tangent is parallel to its chord.
        middle = via[row + 1] if not np.isnan(via[row + 1, 0]) else (start + end) / 2
        dx, dy = (end - start).tolist()
        arrows.append((float(middle[0]), float(middle[1]), float(np.degrees(np.arctan2(dy, dx)))))
    return arrows
