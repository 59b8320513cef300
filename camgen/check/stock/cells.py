"""The plane divided by closed contours: the cell of a contour is what it encloses and no contour within it does."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.nesting import find_nesting
from camgen.geometry.segments import BoolArray, IntArray, Segments, flatten, from_contours
from camgen.model.part import Contour
from camgen.model.pose import FloatArray

#: Curves as chords that leave them by at most this, mm, for areas; distances are measured to the curves themselves.
CHORD_MM = 0.002

Shapes = NDArray[Any]


class Cells(Struct, frozen=True, eq=False):
    """C cells of as many closed contours, and a last one, C, of all that is outside of them.

    ids: of the contours. segments: their lines and arcs, ``owner`` the cell. parent: (C,) the cell around each. depth:
    (C,) how many contours lie around, those that divide nothing too, since sides are chosen by it. rings: (C,) what
    each contour encloses, all of it. area: (C,) mm2 of that. left: contours that divide nothing: open ones, and those
    that cross others or themselves.
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
        """The cell around all."""
        return len(self.ids)

    def find(self, points: FloatArray) -> IntArray:
        """(N,) the cell in which each point (N, 2) lies."""
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
        """(C + 1,) the cells ``roots`` and all within them."""
        inside = np.zeros(len(self) + 1, dtype=np.bool_)
        inside[list(roots)] = True
        for k in np.argsort(self.depth, kind="stable").tolist():
            inside[k] |= bool(inside[self.parent[k]])
        return inside

    def walls(self, chosen: BoolArray) -> IntArray:
        """The contours between ``chosen`` cells (C + 1,) and others."""
        return np.flatnonzero(chosen[:-1] != chosen[self.parent])

    def shape(self, cell: int) -> Any:
        """One cell as a polygon; the one outside has none."""
        children = np.flatnonzero(self.parent == cell)
        return (
            self.rings[cell]
            if not len(children)
            else self.rings[cell] - shapely.union_all(self.rings[children])
        )

    def shapes(self, cells: IntArray) -> Shapes:
        """Several cells, none of them the outside, as polygons."""
        found = self.rings[cells].copy()
        parents = np.zeros(len(self) + 1, dtype=np.bool_)
        parents[self.parent] = True
        for k in np.flatnonzero(parents[cells]).tolist():
            found[k] = self.shape(int(cells[k]))
        return found


def divide(contours: Sequence[Contour]) -> Cells:
    """The cells of ``contours``."""
    closed = [contour for contour in contours if contour.closed]
    left = [contour for contour in contours if not contour.closed]
    nesting = find_nesting(from_contours(closed), len(closed)) if closed else None
    sound = (
        [] if nesting is None else np.flatnonzero((nesting.crossed < 0) & ~nesting.empty).tolist()
    )
    if nesting is None or not sound:
        none = np.zeros(0, dtype=np.int64)
        return Cells(
            (), from_contours([]), none, none, np.zeros(0, object), np.zeros(0), tuple(contours)
        )
    left += [closed[k] for k in sorted(set(range(len(closed))) - set(sound))]
    new = np.full(len(closed) + 1, len(sound))
    new[sound] = np.arange(len(sound))
    segments = from_contours([closed[k] for k in sound])
    lost = (nesting.crossed >= 0) | nesting.empty
    parent, depth = _above(nesting.parent, lost, sound), nesting.depth[sound]
    points, owner = flatten(segments, CHORD_MM)
    rings = shapely.make_valid(shapely.polygons(shapely.linearrings(points, indices=owner)))
    ids = tuple(closed[k].id for k in sound)
    return Cells(ids, segments, new[parent], depth, rings, np.abs(nesting.area[sound]), tuple(left))


def _above(parent: IntArray, lost: BoolArray, sound: list[int]) -> IntArray:
    """The nearest contour around each of ``sound`` that is no ``lost`` one, -1 if none."""
    found = parent[sound].copy()
    while (skipped := (found >= 0) & lost[found]).any():
        found[skipped] = parent[found[skipped]]
    return found
