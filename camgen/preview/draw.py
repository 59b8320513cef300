"""Chains of lines and arcs as SVG path data, and the shapes that lie on them. Page coordinates: mm, y down."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from camgen.geometry.arcs import compute_bulges, measure_spans
from camgen.geometry.ragged import begins
from camgen.model.errors import one_line
from camgen.model.part import Contour, IntArray, Note
from camgen.model.path import ToolPath
from camgen.model.pose import FloatArray
from camgen.model.text import escape

#: From the first path to the last: blue, violet, orange; mid lightness, legible on white and on black.
_RAMP = ((31, 111, 235), (163, 59, 196), (235, 94, 40))

#: Digits of page coordinates, mm: more than a picture prints, fewer than differ between processors.
#: A coordinate in the middle of two printed numbers is then printed alike on each of them.
_PLACE_DIGITS = 9
#: Radius of a spot at least, page mm.
_LEAST_SPOT = 1.2


def by_order(k: int, count: int) -> str:
    """The colour of path k of so many."""
    place = k / max(count - 1, 1) * (len(_RAMP) - 1)
    low = min(int(place), len(_RAMP) - 2)
    rgb = (
        round(a + (b - a) * (place - low)) for a, b in zip(_RAMP[low], _RAMP[low + 1], strict=True)
    )
    return "#" + "".join(f"{v:02x}" for v in rgb)


class Paper(Struct, frozen=True, eq=False):
    """From the work frame (mm, y up) to the page: scale, then the page position of the work origin."""

    scale: float
    x: float
    y: float

    def place(self, points: FloatArray) -> FloatArray:
        """Page coordinates (N, 2) of ``points`` (N, 2 or more)."""
        places = points[:, :2] * (self.scale, -self.scale) + (self.x, self.y)
        return np.asarray(np.round(places, _PLACE_DIGITS), dtype=np.float64)


class PageChains(Struct, frozen=True, eq=False):
    """Many chains in one table. points (N, 2); bulge (N,): of the segment that ends at the point; first: (M,) rows
    where a chain begins.
    """

    points: FloatArray
    bulge: FloatArray
    first: IntArray


def of_contours(contours: Sequence[Contour]) -> PageChains:
    """The contours, closed ones with their first point again at the end."""
    rows, bulges = [], []
    for contour in contours:
        back = contour.points[:1] if contour.closed else contour.points[:0]
        rows.append(np.concatenate([contour.points, back]))
        bulges.append(np.concatenate([[0.0], contour.bulges[: len(rows[-1]) - 1]]))
    return _chains(rows, bulges)


def of_points(rows: Sequence[FloatArray]) -> PageChains:
    """Chains (N, 2) of straight lines."""
    return _chains(rows, [np.zeros(len(row)) for row in rows])


def of_paths(paths: Sequence[ToolPath]) -> PageChains:
    """The tool paths."""
    if not paths:
        return _chains([], [])
    points = np.concatenate([path.position for path in paths])[:, :2]
    via = np.concatenate([path.via for path in paths])[:, :2]
    before = np.concatenate([points[:1], points[:-1]])
    return PageChains(
        points, compute_bulges(before, via, points), begins([len(path.position) for path in paths])
    )


def _chains(rows: Sequence[FloatArray], bulges: Sequence[FloatArray]) -> PageChains:
    if not rows:
        return PageChains(np.zeros((0, 2)), np.zeros(0), np.zeros(0, dtype=int))
    return PageChains(np.concatenate(rows), np.concatenate(bulges), begins([len(r) for r in rows]))


def path_data(chains: PageChains, page: Paper) -> list[str]:
    """The ``d`` of every chain, arcs as arcs."""
    if not len(chains.first):
        return []
    at = page.place(chains.points)
    before = np.concatenate([at[:1], at[:-1]])
    chord = np.hypot(*(at - before).T)
    size = np.abs(chains.bulge)
    # Flatter than a hundredth of a page mm is a line.
    curved = size * chord > 0.02
    with np.errstate(divide="ignore", invalid="ignore"):
        radius = np.where(curved, chord * (1 + size**2) / (4 * size), 0.0).round(_PLACE_DIGITS)
    # The page's y points down: counter-clockwise in the drawing is sweep flag 0.
    words = [
        f"A{r:.2f} {r:.2f} 0 0 {flag} {x:.2f} {y:.2f}" if arc else f"L{x:.2f} {y:.2f}"
        for (x, y), arc, r, flag in zip(
            at.tolist(),
            curved.tolist(),
            radius.tolist(),
            (chains.bulge < 0).astype(int).tolist(),
            strict=True,
        )
    ]
    begins = [int(k) for k in chains.first.tolist()]
    for k in begins:
        words[k] = f"M{at[k, 0]:.2f} {at[k, 1]:.2f}"
    return ["".join(words[a:b]) for a, b in zip(begins, [*begins[1:], len(words)], strict=True)]


def bounds(chains: Sequence[PageChains]) -> tuple[FloatArray, FloatArray]:
    """Least and greatest corner, work frame, arcs exact."""
    every = np.concatenate(
        [np.zeros((0, 2)), *(one.points for one in chains), *(_extremes(one) for one in chains)]
    )
    if not len(every):
        return np.zeros(2), np.ones(2)
    return every.min(axis=0), every.max(axis=0)


def _extremes(chains: PageChains) -> FloatArray:
    """The points (N, 2) of the arcs that lie farthest in x and y, where an arc goes so far."""
    inner = chains.bulge != 0
    inner[chains.first] = False
    rows = np.flatnonzero(inner)
    start, end, bulge = chains.points[rows - 1], chains.points[rows], chains.bulge[rows]
    half = (end - start) / 2
    # From the middle of the chord to the centre: to the left for a positive bulge, R - h = half (1 - b^2) / (2 b).
    centre = (
        start
        + half
        + np.column_stack([-half[:, 1], half[:, 0]]) * ((1 - bulge**2) / (2 * bulge))[:, None]
    )
    radius = np.hypot(*(start - centre).T)
    sweep = 4 * np.arctan(bulge)
    first = np.arctan2(start[:, 1] - centre[:, 1], start[:, 0] - centre[:, 0]) + np.minimum(
        sweep, 0
    )
    found = []
    for x, y, angle in ((1, 0, 0.0), (0, 1, np.pi / 2), (-1, 0, np.pi), (0, -1, -np.pi / 2)):
        reached = (angle - first) % (2 * np.pi) <= np.abs(sweep)
        found.append((centre + radius[:, None] * np.array([x, y]))[reached])
    return np.concatenate(found)


def spots(notes: Sequence[Note], page: Paper, radius: float) -> list[str]:
    """A red ring, of ``radius`` mm and legible, at every place that the notes are about."""
    size = max(radius * page.scale, _LEAST_SPOT)
    return [
        f'<circle cx="{x:.2f}" cy="{y:.2f}" r="{size:.2f}" fill="#d0103a" fill-opacity=".35" stroke="#d0103a" '
        f'stroke-width=".5"><title>{escape(one_line(note.what))}</title></circle>'
        for note in notes
        if note.places
        for x, y in page.place(np.array(note.places)).tolist()
    ]


def tell_wrong(notes: Sequence[Note]) -> list[tuple[str, str]]:
    """What was left out or went wrong, as text, and why."""
    return [
        (f"{'left out' if n.kind == 'skipped' else n.kind}: {n.what}", n.why)
        for n in notes
        if n.fails_strict
    ]


def arrows(path: ToolPath, page: Paper, every: float) -> list[tuple[float, float, float]]:
    """Page x, y and direction (deg, clockwise) of arrows, one for about ``every`` page mm, one at least."""
    lengths = measure_spans(path.position, path.via[1:]) * page.scale
    ends = np.cumsum(lengths).round(_PLACE_DIGITS)
    if not len(ends) or ends[-1] <= 0:
        return []
    count = 1 + int(ends[-1] / every)
    # An arrow at the end of a segment belongs to that segment, whatever the last bits are.
    middles = ((np.arange(count) + 0.5) / count * ends[-1]).round(_PLACE_DIGITS)
    rows = np.unique(np.searchsorted(ends, middles)).tolist()
    at = page.place(path.position)
    via = page.place(path.via)
    found = []
    for row in rows:
        start, end = at[row], at[row + 1]
        # On an arc the top is the middle, and there the tangent is parallel to the chord.
        middle = via[row + 1] if not np.isnan(via[row + 1, 0]) else (start + end) / 2
        dx, dy = (end - start).tolist()
        found.append((float(middle[0]), float(middle[1]), float(np.degrees(np.arctan2(dy, dx)))))
    return found
