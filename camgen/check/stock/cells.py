"""Divides the plane by closed contours.

The cell of a contour is the area that it encloses, without the areas that contours within it
enclose.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import compress
from typing import Any

import numpy as np
import shapely
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.nesting import find_enclosing, find_nesting, mark_small_crossings
from camgen.geometry.segments import BoolArray, IntArray, Segments, flatten, make_contour_segments
from camgen.model.part import Contour, list_ids, select_closed
from camgen.model.pose import FloatArray

#: mm: maximum deviation of the chords of curves in areas. Distances are measured to the curves.
CHORD_MM = 0.002

Shapes = NDArray[Any]


class Cells(Struct, frozen=True, eq=False):
    """C cells of as many closed contours. The cell C is the outside.

    ids: ids of the contours.
    segments: their lines and arcs; `owner` is the cell.
    parent: (C,) cell around each one.
    depth: (C,) number of contours around each one, those in `left` included, since sides are chosen
        by it.
    rings: (C,) polygons of the whole area that each contour encloses.
    area: (C,) area of the rings, mm2.
    left: contours that divide nothing: open ones, and those that cross others or themselves.
    """

    ids: tuple[str, ...]
    segments: Segments
    parent: IntArray
    depth: IntArray
    rings: Shapes
    area: FloatArray
    left: tuple[Contour, ...]

    def __len__(self) -> int:
        return len(self.ids)

    @property
    def outside(self) -> int:
        """The index of the outside."""
        return len(self.ids)

    def find(self, points: FloatArray) -> IntArray:
        """Find the cell (N,) in which each point (N, 2) lies."""
        cell = np.full(len(points), self.outside)
        if not len(self):
            return cell
        point, ring = shapely.STRtree(self.rings).query(
            shapely.points(points), predicate="intersects"
        )
        large_first = np.argsort(-self.area[ring], kind="stable")
        cell[point[large_first]] = ring[large_first]
        return cell

    def within(self, roots: Sequence[int]) -> BoolArray:
        """Return (C + 1,) True for the cells `roots` and all cells within them."""
        inside = np.zeros(len(self) + 1, dtype=np.bool_)
        inside[list(roots)] = True
        for k in np.argsort(self.depth, kind="stable").tolist():
            inside[k] |= bool(inside[self.parent[k]])
        return inside

    def walls(self, chosen: BoolArray) -> IntArray:
        """Find the contours between `chosen` cells (C + 1,) and others."""
        return np.flatnonzero(chosen[:-1] != chosen[self.parent])

    def shape(self, cell: int) -> Any:
        """Return one cell, which is not the outside, as a polygon."""
        children = np.flatnonzero(self.parent == cell)
        if not len(children):
            return self.rings[cell]
        return self.rings[cell] - shapely.union_all(self.rings[children])

    def shapes(self, cells: IntArray) -> Shapes:
        """Return several cells, without the outside, as polygons."""
        polygons = self.rings[cells].copy()
        is_parent = np.zeros(len(self) + 1, dtype=np.bool_)
        is_parent[self.parent] = True
        for k in np.flatnonzero(is_parent[cells]).tolist():
            polygons[k] = self.shape(int(cells[k]))
        return polygons


def make_cells(contours: Sequence[Contour]) -> Cells:
    """Divide the plane by `contours`."""
    closed = select_closed(contours)
    nesting, is_valid = None, np.zeros(0, np.bool_)
    if closed:
        drawn = make_contour_segments(closed)
        nesting = mark_small_crossings(drawn, find_nesting(drawn, len(closed)))
        is_valid = (nesting.crossed < 0) & ~nesting.empty
    if nesting is None or not is_valid.any():
        empty = np.zeros(0, dtype=np.int64)
        rings, area = np.zeros(0, object), np.zeros(0)
        return Cells((), make_contour_segments([]), empty, empty, rings, area, tuple(contours))
    valid = np.flatnonzero(is_valid)
    left = [contour for contour in contours if not contour.closed]
    left += compress(closed, ~is_valid)
    kept = list(compress(closed, is_valid))
    segments = make_contour_segments(kept)
    points, owner = flatten(segments, CHORD_MM)
    cell = np.full(len(closed) + 1, len(valid))
    cell[valid] = np.arange(len(valid))
    return Cells(
        ids=list_ids(kept),
        segments=segments,
        parent=cell[find_enclosing(nesting.parent, is_valid)[valid]],
        depth=nesting.depth[valid],
        rings=shapely.make_valid(shapely.polygons(shapely.linearrings(points, indices=owner))),
        area=np.abs(nesting.area[valid]),
        left=tuple(left),
    )
