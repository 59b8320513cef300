"""Rapid motions through material, and holders in it: what they sweep must be gone before."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from msgspec import Struct

from camgen.check.stock.design import Design
from camgen.check.stock.moves import TOLERANCE_MM, Cut, Moves
from camgen.check.stock.profile import is_flat, reach
from camgen.check.stock.sweep import QUARTER, sweep_each
from camgen.geometry.fixtures import list_bodies
from camgen.geometry.intersect import make_boxes
from camgen.geometry.ragged import starts_run
from camgen.geometry.segments import BoolArray, IntArray, compute_bounds, points_at

#: Swept areas are narrowed by this on each side, mm, since polygons deviate from arcs. Narrower
#: material counts as gone.
_SLACK_MM = 0.02
#: Parts into which a sloping motion is divided.
_PARTS = 8
#: Motions that are swept in one call.
_BLOCK = 64
#: Most holders in material that are reported: a program that is too deep has one at each motion.
MOST_TOLD = 20


class Struck(Struct, frozen=True):
    """A motion through material.

    row: number of the motion.
    place: x, y, z of the material, mm.
    mm: width of the material.
    depth: depth of the motion there below the top face, mm.
    """

    row: int
    place: tuple[float, float, float]
    mm: float
    depth: float


class Gone(Struct, frozen=True, eq=False):
    """The motions in material, to be looked up by place.

    rows: numbers of the motions.
    tree: boxes of the motions, grown by the radii of their tools.
    swept: areas by depth and block of ``rows``. Only the depth of the last question is kept.
    """

    moves: Moves
    cuts: tuple[Cut, ...]
    rows: IntArray
    tree: Any
    swept: dict[float, dict[int, list[list[Any]]]]

    def take_from(self, area: Any, row: int, depth: float, with_itself: bool = False) -> Any:
        """Polygons that remain of ``area`` at ``depth`` after the motions before ``row``."""
        last = int(np.searchsorted(self.rows, row, "right" if with_itself else "left"))
        near = np.sort(self.tree.query(area))
        # The latest first: most rapid motions cross an area that was cut just before.
        for place in near[near < last][::-1].tolist():
            for shape in self._sweep(depth, place // _BLOCK)[place % _BLOCK]:
                area = area - shape
            if area.is_empty:
                break
        return area

    def _sweep(self, depth: float, block: int) -> list[list[Any]]:
        """(_BLOCK,) the polygons of each motion of a block."""
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


def index(moves: Moves, cuts: Sequence[Cut]) -> Gone:
    """The motions in material, to be looked up by place."""
    rows = np.flatnonzero(moves.deepest > TOLERANCE_MM)
    radius = np.array([cut.tool.radius for cut in cuts] or [0.0])[moves.cut[rows]]
    boxes = compute_bounds(moves.plane.take(rows)) + radius[:, None] * np.array([-1, -1, 1, 1])
    return Gone(moves, tuple(cuts), rows, shapely.STRtree(make_boxes(boxes)), {})


def find_rapids(gone: Gone, design: Design) -> list[Struck]:
    """Rapid motions through material that is still there."""
    moves = gone.moves
    rows = np.flatnonzero(moves.rapid & (moves.deepest > TOLERANCE_MM))
    rows = rows[~moves.rising[rows]]
    rows = rows[~find_in_own_hole(moves, rows)]
    found = []
    for row in rows.tolist():
        tool = gone.cuts[int(moves.cut[row])].tool
        depths = [0.0] if is_flat(tool) else [0.0, 0.5]
        struck = [
            one
            for share in depths
            for part in _parts(moves, row)
            if (one := _strike(gone, design, row, part, share))
        ]
        found += sorted(struck, key=lambda one: -one.mm)[:1]
    return found


def find_in_own_hole(moves: Moves, rows: IntArray) -> BoolArray:
    """(K,) whether motions go straight down where the same cut went as deep before.

    Pecks do so, and passes one after the other.
    """
    result = np.zeros(len(rows), dtype=np.bool_)
    if not len(rows):
        return result
    keys = np.round(moves.end[:, :2], 4)
    _, place = np.unique(np.column_stack([keys, moves.cut]), axis=0, return_inverse=True)
    place = place.reshape(-1)
    order = np.argsort(place, kind="stable")
    reached = np.where(moves.rapid, -np.inf, moves.down[:, 1])[order]
    first = starts_run(place[order])
    deepest = np.full(len(moves), -np.inf)
    so_far = -np.inf
    for k, (new, value) in enumerate(zip(first.tolist(), reached.tolist(), strict=True)):
        so_far = -np.inf if new else so_far
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


def _parts(moves: Moves, row: int) -> list[_Part]:
    """A motion in parts that are in material, each as deep as its deepest place."""
    first, last = moves.down[row].tolist()
    count = 1 if abs(last - first) <= TOLERANCE_MM or moves.upright[row] else _PARTS
    share = np.linspace(0.0, 1.0, 8 * count + 1)
    points = points_at(moves.plane.take(np.full(len(share), row)), share)
    depth = first + share * (last - first) if np.isfinite(first) else np.full(len(share), last)
    pieces = []
    for k in range(count):
        own = slice(8 * k, 8 * k + 9)
        deep = float(depth[own].max())
        if deep > TOLERANCE_MM:
            pieces.append(_Part(shapely.LineString(points[own][depth[own] >= -1e9]), deep))
    return pieces


def _strike(gone: Gone, design: Design, row: int, part: _Part, share: float) -> Struck | None:
    """Material that one part of a motion meets at ``share`` of its depth above its tip."""
    tool = gone.cuts[int(gone.moves.cut[row])].tool
    depth = part.depth * (1 - share) if share else part.depth
    radius = float(reach(tool, np.array([part.depth * share]))[0])
    return _meet(gone, design, row, _Part(part.line, depth), radius, with_itself=False)


def _meet(
    gone: Gone,
    design: Design,
    row: int,
    part: _Part,
    radius: float,
    *,
    with_itself: bool,
) -> Struck | None:
    """Material that a disc meets at the depth of a part of a motion, None if all of it is gone."""
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


def find_holders(gone: Gone, design: Design) -> tuple[list[Struck], int]:
    """Motions with a holder in material, the first `MOST_TOLD`, and the number of further motions
    as deep, which are not examined.
    """
    moves = gone.moves
    found: list[Struck] = []
    unseen = 0
    for number, cut in enumerate(gone.cuts):
        for body in list_bodies(cut.tool)[1:]:
            rows = np.flatnonzero(
                (moves.cut == number)
                & (moves.deepest > body.height + TOLERANCE_MM)
                & np.isfinite(moves.deepest)
            )
            for row in rows.tolist():
                if len(found) >= MOST_TOLD:
                    unseen += 1
                    continue
                struck = [
                    one
                    for part in _parts(moves, row)
                    if (one := _hold(gone, design, row, part, body.radius, body.height))
                ]
                found += sorted(struck, key=lambda one: -one.mm)[:1]
    return sorted(found, key=lambda one: one.row), unseen


def _hold(
    gone: Gone, design: Design, row: int, part: _Part, radius: float, height: float
) -> Struck | None:
    if part.depth - height <= TOLERANCE_MM:
        return None
    above = _Part(part.line, part.depth - height)
    return _meet(gone, design, row, above, radius, with_itself=True)
