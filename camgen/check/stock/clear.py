"""Finds rapid motions through material, and holders in material.

The material that they sweep must have been removed by the motions before.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from msgspec import Struct

from camgen.check.stock.design import Design
from camgen.check.stock.moves import TOLERANCE_MM, Cut, Moves
from camgen.check.stock.profile import compute_radius, is_flat
from camgen.check.stock.sweep import QUARTER, sweep_each
from camgen.geometry.fixtures import list_bodies
from camgen.geometry.intersect import make_boxes
from camgen.geometry.ragged import mark_run_starts
from camgen.geometry.segments import BoolArray, IntArray, compute_bounds, points_at

#: mm: swept areas are narrowed by this on each side, since polygons deviate from arcs. Narrower
#: material counts as removed.
_SLACK_MM = 0.02
#: Parts into which a sloping motion is divided.
_PARTS = 8
#: Motions that are swept in one call.
_BLOCK = 64
#: Maximum number of reported motions with the holder in material. A program that is too deep has
#: one at each motion.
MAX_LISTED = 20


class Struck(Struct, frozen=True):
    """A motion through material.

    row: number of the motion.
    place: x, y, z of the material, mm.
    mm: width of the material, mm.
    depth: depth of the motion there below the top face, mm.
    """

    row: int
    place: tuple[float, float, float]
    mm: float
    depth: float


class SweptAreas(Struct, frozen=True, eq=False):
    """The areas that motions in material sweep, found by position.

    rows: numbers of the motions.
    tree: boxes of the motions, inflated by the radii of their tools.
    swept: areas by depth and block of `rows`; only those of the last depth are kept.
    """

    moves: Moves
    cuts: tuple[Cut, ...]
    rows: IntArray
    tree: Any
    swept: dict[float, dict[int, list[list[Any]]]]

    def take_from(self, area: Any, row: int, depth: float, with_itself: bool = False) -> Any:
        """Return the polygons that remain of `area` at `depth` after the motions before `row`.

        with_itself: whether the motion `row` itself removes material too.
        """
        last = int(np.searchsorted(self.rows, row, "right" if with_itself else "left"))
        near = np.sort(self.tree.query(area))
        # The latest first: most rapid motions cross an area that was cut just before.
        for index in near[near < last][::-1].tolist():
            for shape in self._sweep(depth, index // _BLOCK)[index % _BLOCK]:
                area = area - shape
            if area.is_empty:
                break
        return area

    def _sweep(self, depth: float, block: int) -> list[list[Any]]:
        if depth not in self.swept:
            self.swept.clear()
        known = self.swept.setdefault(depth, {})
        if block not in known:
            rows = self.rows[block * _BLOCK : (block + 1) * _BLOCK]
            shapes: dict[int, list[Any]] = {row: [] for row in rows.tolist()}
            for row, shape in zip(*sweep_each(self.moves, self.cuts, depth, rows), strict=True):
                shapes[row].append(shape)
            known[block] = list(shapes.values())
        return known[block]


def index_motions(moves: Moves, cuts: Sequence[Cut]) -> SweptAreas:
    """Index the motions in material by their boxes."""
    rows = np.flatnonzero(moves.deepest > TOLERANCE_MM)
    radius = np.array([cut.tool.radius for cut in cuts] or [0.0])[moves.cut[rows]]
    boxes = compute_bounds(moves.plane.take(rows)) + radius[:, None] * np.array([-1, -1, 1, 1])
    return SweptAreas(moves, tuple(cuts), rows, shapely.STRtree(make_boxes(boxes)), {})


def find_rapids(gone: SweptAreas, design: Design) -> list[Struck]:
    """Find the rapid motions through material that no motion before them has removed."""
    moves = gone.moves
    rows = np.flatnonzero(moves.rapid & (moves.deepest > TOLERANCE_MM) & ~moves.rising)
    rows = rows[~find_in_own_hole(moves, rows)]
    widest: list[Struck] = []
    for row in rows.tolist():
        tool = gone.cuts[int(moves.cut[row])].tool
        hits = []
        # A tool that is not a cylinder is wider half-way up.
        for fraction in (0.0,) if is_flat(tool) else (0.0, 0.5):
            for part in _divide(moves, row):
                disc = _Part(part.line, part.depth * (1 - fraction))
                radius = float(compute_radius(tool, np.array([part.depth * fraction]))[0])
                hits.append(_meet(gone, design, row, disc, radius, with_itself=False))
        widest += _select_widest(hits)
    return widest


def _select_widest(hits: Sequence[Struck | None]) -> list[Struck]:
    return sorted([hit for hit in hits if hit is not None], key=lambda hit: -hit.mm)[:1]


def find_in_own_hole(moves: Moves, rows: IntArray) -> BoolArray:
    """Whether motions (K,) go straight down to a depth that the same cut has reached there.

    Pecks do so, and consecutive passes.
    """
    if not len(rows):
        return np.zeros(0, dtype=np.bool_)
    keys = np.column_stack([np.round(moves.end[:, :2], 4), moves.cut])
    _, position = np.unique(keys, axis=0, return_inverse=True)
    position = position.reshape(-1)
    order = np.argsort(position, kind="stable")
    reached = np.where(moves.rapid, -np.inf, moves.down[:, 1])[order]
    first = mark_run_starts(position[order])
    deepest = np.full(len(moves), -np.inf)
    so_far = -np.inf
    for k, (is_new, value) in enumerate(zip(first.tolist(), reached.tolist(), strict=True)):
        so_far = -np.inf if is_new else so_far
        deepest[order[k]] = so_far
        so_far = max(so_far, value)
    return np.asarray(moves.upright[rows] & (moves.down[rows, 1] <= deepest[rows] + TOLERANCE_MM))


class _Part(Struct, frozen=True, eq=False):
    """A part of a motion.

    line: the part seen from above.
    depth: depth of its deepest place, mm.
    """

    line: Any
    depth: float


def _divide(moves: Moves, row: int) -> list[_Part]:
    first, last = moves.down[row].tolist()
    count = 1 if abs(last - first) <= TOLERANCE_MM or moves.upright[row] else _PARTS
    fraction = np.linspace(0.0, 1.0, 8 * count + 1)
    points = points_at(moves.plane.take(np.full(len(fraction), row)), fraction)
    depth = np.full(len(fraction), last)
    if np.isfinite(first):
        depth = first + fraction * (last - first)
    parts = []
    for k in range(count):
        samples = slice(8 * k, 8 * k + 9)
        deepest = float(depth[samples].max())
        if deepest > TOLERANCE_MM:
            line = shapely.LineString(points[samples][depth[samples] >= -1e9])
            parts.append(_Part(line, deepest))
    return parts


def _meet(
    gone: SweptAreas,
    design: Design,
    row: int,
    part: _Part,
    radius: float,
    *,
    with_itself: bool,
) -> Struck | None:
    """Find the material that a disc meets at the depth of a part; None if all is removed."""
    depth = part.depth
    if radius <= _SLACK_MM:
        return None
    swept = shapely.buffer(part.line, radius - _SLACK_MM, quad_segs=QUARTER) & design.outline
    if design.thickness is not None and depth > design.thickness:
        depth = design.thickness
    left = gone.take_from(swept, row, max(depth - 2 * _SLACK_MM, TOLERANCE_MM), with_itself)
    left = shapely.buffer(left, -_SLACK_MM / 2, quad_segs=2)
    if left.is_empty:
        return None
    circle = shapely.maximum_inscribed_circle(left, tolerance=0.01)
    x, y = circle.coords[0]
    return Struck(row, (float(x), float(y), -depth), 2 * float(circle.length) + _SLACK_MM, depth)


def find_holders(gone: SweptAreas, design: Design) -> tuple[list[Struck], int]:
    """Find motions with a holder in material, at most `MAX_LISTED`.

    Also returns the number of further motions that are as deep. These are not examined.
    """
    moves = gone.moves
    widest: list[Struck] = []
    unseen = 0
    for number, cut in enumerate(gone.cuts):
        for body in list_bodies(cut.tool)[1:]:
            is_deep = (moves.deepest > body.height + TOLERANCE_MM) & np.isfinite(moves.deepest)
            for row in np.flatnonzero((moves.cut == number) & is_deep).tolist():
                if len(widest) >= MAX_LISTED:
                    unseen += 1
                    continue
                hits = []
                for part in _divide(moves, row):
                    above = _Part(part.line, part.depth - body.height)
                    if above.depth > TOLERANCE_MM:
                        hits.append(_meet(gone, design, row, above, body.radius, with_itself=True))
                widest += _select_widest(hits)
    return sorted(widest, key=lambda hit: hit.row), unseen
