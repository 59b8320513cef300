"""The model as the search sees it: triangles with normals in a tree, and points spread evenly over them."""

from __future__ import annotations

import cv2
import numpy as np
from msgspec import Struct

from camgen.collision.tree import BoxTree, make_tree, search_tree
from camgen.geometry.ragged import begins, owners, run_lengths, run_starts, starts_run, stretches
from camgen.geometry.vectors import dots, in_blocks, lengths, unit
from camgen.model.part import IntArray
from camgen.model.pose import FloatArray

#: Steps of the R2 sequence (Roberts, The unreasonable effectiveness of quasirandom sequences, 2018).
_R2 = (0.7548776662466927, 0.5698402909980532)


class Model(Struct, frozen=True, eq=False):
    """A part's surface in its own frame, mm.

    tree: its triangles. normals: (F, 3) unit, outward, in the tree's order. samples, sample_normals: (S, 3), spread
    evenly. low, high: (3,), corners of the box around it. size: its diagonal.
    """

    tree: BoxTree
    normals: FloatArray
    samples: FloatArray
    sample_normals: FloatArray
    low: FloatArray
    high: FloatArray

    @property
    def area(self) -> float:
        """Of the surface, mm2."""
        a, b, c = (self.tree.corners[:, k] for k in range(3))
        return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)

    @property
    def volume(self) -> float:
        """mm3, as far as the surface is closed."""
        a, b, c = (self.tree.corners[:, k] - self.low for k in range(3))
        return float(abs((a * np.cross(b, c)).sum()) / 6)

    @property
    def size(self) -> float:
        """Diagonal of the box around it, mm."""
        return float(np.linalg.norm(self.high - self.low))


def model_part(vertices: FloatArray, faces: IntArray, count: int = 20_000) -> Model:
    """The model with ``count`` samples of the triangles ``faces`` (F, 3) of ``vertices`` (V, 3); faces have an area."""
    corners = vertices[faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    tree = make_tree(corners[(cross != 0).any(axis=1)])
    cross = np.cross(
        tree.corners[:, 1] - tree.corners[:, 0], tree.corners[:, 2] - tree.corners[:, 0]
    )
    normals = unit(cross)
    samples, of = spread(tree.corners, count)
    ends = tree.corners.reshape(-1, 3)
    return Model(tree, normals, samples, normals[of], ends.min(axis=0), ends.max(axis=0))


def spread(corners: FloatArray, count: int) -> tuple[FloatArray, IntArray]:
    """``count`` points (count, 3) evenly over triangles (F, 3, 3), and the triangle of each. The same every time."""
    areas = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    ends = np.cumsum(areas)
    of = np.searchsorted(ends, (np.arange(count) + 0.5) / count * ends[-1]).clip(
        max=len(corners) - 1
    )
    u, v = (np.arange(1, count + 1) * step % 1.0 for step in _R2)
    beyond = u + v > 1
    u, v = np.where(beyond, 1 - u, u), np.where(beyond, 1 - v, v)
    a, b, c = (corners[of, k] for k in range(3))
    return a + (b - a) * u[:, None] + (c - a) * v[:, None], of


# Exact closest points on triangles, for many points at once.

#: FLANN's single k-d tree: exact, and the same every time (its default is a random forest).
_EXACT_TREE: dict[str, bool | int | float | str] = {"algorithm": 4, "leaf_max_size": 10}
#: Cells of the grids along the diagonal of the model, each a half of the one before. They end where a grid would not
#: halve the number of questions.
_CELLS = (128, 64, 32, 16)


class Cloud:
    """Points (N, 3) that can be asked which of them is nearest. Single precision: to choose, not to measure."""

    def __init__(self, points: FloatArray) -> None:
        # FLANN keeps no copy: the array lives as long as the tree.
        self._points = np.ascontiguousarray(points, dtype=np.float32)
        self._tree = cv2.flann.Index(self._points, _EXACT_TREE)

    def nearest(self, points: FloatArray, count: int = 1) -> tuple[IntArray, FloatArray]:
        """Indices and distances (mm) of the ``count`` nearest to each of ``points`` (n, 3): (n, count) each."""
        if not len(points):
            return np.zeros((0, count), dtype=np.int64), np.zeros((0, count))
        found, square = self._tree.knnSearch(
            np.ascontiguousarray(points, dtype=np.float32), count, params={"checks": -1}
        )
        return np.asarray(found, dtype=np.int64), np.sqrt(np.asarray(square, dtype=np.float64))


class TouchPairs(Struct, frozen=True, eq=False):
    """Which triangles may be the closest to which points: (K,) each, sorted by point."""

    point: IntArray
    triangle: IntArray


class Touch(Struct, frozen=True, eq=False):
    """Closest points: ``point`` (K,) index, ``at`` (K, 3) on the model, ``triangle`` (K,), ``distance`` (K,) mm."""

    point: IntArray
    at: FloatArray
    triangle: IntArray
    distance: FloatArray


#: Of each place (N,), mm: how far from the model it may be, and by how much a triangle farther than the closest one.
Limits = tuple[FloatArray, FloatArray]


def candidates(
    model: Model,
    samples: Cloud,
    points: FloatArray,
    reach: float | FloatArray,
    slack: float | FloatArray,
) -> TouchPairs:
    """The triangles that may be closest to ``points`` (N, 3) which are within ``reach`` of the model, also after they
    have moved by ``slack`` (both mm, or (N,), mm). Points farther away are in no pair.

    The tree is asked for the large cells of a grid that hold points; smaller cells choose from what it found.
    """
    gap = np.linalg.norm(np.maximum(np.maximum(model.low - points, points - model.high), 0), axis=1)
    away = np.broadcast_to(np.asarray(reach + slack, dtype=np.float64), len(points))
    near = np.flatnonzero(gap <= away)
    own = (away[near], np.broadcast_to(np.asarray(2 * slack, dtype=np.float64), len(points))[near])
    # A cell has no limits of its own: what is too far for one of its points is not too far for each.
    widest = tuple(float(limit.max(initial=0.0)) for limit in own)
    places, wholes, sizes = [points[near]], [], [0.0]
    for count in _CELLS:
        size = model.size / count
        middles, of = _cells(places[-1], model.low - widest[0], size)
        if 2 * len(middles) > len(of):
            break
        places.append(middles)
        wholes.append(of)
        sizes.append(size)
    limits = [
        own,
        *((np.full(len(some), widest[0]), np.full(len(some), widest[1])) for some in places[1:]),
    ]
    pairs = _box(model, samples, places[-1], limits[-1], sizes[-1])
    for some, of, limit, size in zip(
        places[-2::-1], wholes[::-1], limits[-2::-1], sizes[-2::-1], strict=True
    ):
        pairs = _prune(model, some, *_join(of, pairs), limit, size)
    return TouchPairs(near[pairs.point], pairs.triangle)


def _cells(points: FloatArray, low: FloatArray, cell: float) -> tuple[FloatArray, IntArray]:
    """Middles (M, 3) of the cells that hold points, and the cell of each point."""
    cells = np.floor((points - low) / cell).astype(np.int64)
    _, first, of = np.unique(
        (cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2],
        return_index=True,
        return_inverse=True,
    )
    return low + cell * (cells[first] + 0.5), of.reshape(-1)


def _box(
    model: Model, samples: Cloud, middles: FloatArray, limits: Limits, cell: float
) -> TouchPairs:
    """The pairs of cells, as ``_prune`` leaves them, from the tree."""
    radius = cell * np.sqrt(0.75)
    # A sample is at most as close as the surface: its distance bounds that of the closest triangle from above.
    bound = samples.nearest(middles)[1][:, 0] * (1 + 1e-5) + limits[1] + 2 * radius
    bound = np.minimum(bound, limits[0] + limits[1] + 3 * radius) ** 2

    columns = np.ascontiguousarray(middles.T)

    def meets(which: IntArray, low: FloatArray, high: FloatArray) -> IntArray:
        at = columns.take(which, axis=1)
        off = np.maximum(low - at, at - high)
        np.maximum(off, 0, out=off)
        return np.flatnonzero((off * off).sum(axis=0) <= bound.take(which))

    which, triangle, _ = search_tree(model.tree, len(middles), meets)
    order = np.argsort(which, kind="stable")
    return _prune(model, middles, which[order], triangle[order], limits, cell)


def _join(of: IntArray, pairs: TouchPairs) -> tuple[IntArray, IntArray]:
    """Each place with all triangles of the cell that it is in, ``of`` (N,): places and triangles (K,), by place."""
    count = np.bincount(pairs.point, minlength=int(of.max(initial=-1)) + 1)
    return owners(count[of]), pairs.triangle[stretches(begins(count)[of], count[of])]


def _prune(
    model: Model,
    places: FloatArray,
    place: IntArray,
    triangle: IntArray,
    limits: Limits,
    cell: float,
) -> TouchPairs:
    """The pairs, sorted by place, of cells (mm, 0 for points) that reach within the first of their limits of the model,
    without triangles that nowhere in the cell come within the second of the closest.
    """
    if not len(place):
        return TouchPairs(place, triangle)
    radius = cell * np.sqrt(0.75)
    points = places.take(place, axis=0)
    off = points - in_blocks(closest, model.tree.corners.take(triangle, axis=0), points)
    away = np.sqrt(dots(off, off))
    least = np.repeat(np.minimum.reduceat(away, run_starts(place)), run_lengths(place))
    kept = (away <= least + limits[1][place] + 2 * radius) & (least <= limits[0][place] + radius)
    return TouchPairs(place[kept], triangle[kept])


def find_touched(model: Model, pairs: TouchPairs, points: FloatArray) -> Touch:
    """The closest of the candidates for each point that has any."""
    rows = points.take(pairs.point, axis=0)
    at = in_blocks(closest, model.tree.corners.take(pairs.triangle, axis=0), rows)
    away = lengths(rows - at)
    least = away
    if len(away):
        nearest = np.minimum.reduceat(away, run_starts(pairs.point))
        least = np.repeat(nearest, run_lengths(pairs.point))
    best = np.flatnonzero(away == least)
    first = best[starts_run(pairs.point[best])]
    return Touch(pairs.point[first], at[first], pairs.triangle[first], away[first])


def closest(corners: FloatArray, points: FloatArray) -> FloatArray:
    """The closest point (n, 3) to ``points`` (n, 3) on each of the triangles (n, 3, 3), by the regions of Ericson,
    Real-Time Collision Detection, section 5.1.5.
    """
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    ab, ac, ap = b - a, c - a, points - a
    d1, d2 = dots(ab, ap), dots(ac, ap)
    d3, d4 = d1 - dots(ab, ab), d2 - dots(ab, ac)
    d5, d6 = d1 - dots(ac, ab), d2 - dots(ac, ac)
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    whole = va + vb + vc
    whole[whole == 0] = 1.0
    v, w = vb / whole, vc / whole
    # From the inner region outward: what is set later wins.
    side = (va <= 0) & (d4 - d3 >= 0) & (d5 - d6 >= 0)
    along = _part(d4 - d3, (d4 - d3) + (d5 - d6))
    v, w = np.where(side, 1 - along, v), np.where(side, along, w)
    side = (vb <= 0) & (d2 >= 0) & (d6 <= 0)
    v, w = np.where(side, 0.0, v), np.where(side, _part(d2, d2 - d6), w)
    side = (vc <= 0) & (d1 >= 0) & (d3 <= 0)
    v, w = np.where(side, _part(d1, d1 - d3), v), np.where(side, 0.0, w)
    for corner, vw in (((d6 >= 0) & (d5 <= d6), (0.0, 1.0)), ((d3 >= 0) & (d4 <= d3), (1.0, 0.0))):
        v, w = np.where(corner, vw[0], v), np.where(corner, vw[1], w)
    corner = (d1 <= 0) & (d2 <= 0)
    v, w = np.where(corner, 0.0, v), np.where(corner, 0.0, w)
    return np.asarray(a + ab * v[:, None] + ac * w[:, None])


def _part(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.divide(a, b, out=np.zeros_like(a), where=b != 0))
