"""The model as the search uses it: triangles in a tree, samples, and exact closest points."""

from __future__ import annotations

import cv2
import numpy as np
from msgspec import Struct

from camgen.collision.tree import BoxTree, make_tree, search_tree
from camgen.geometry.ragged import (
    compute_first_rows,
    find_run_starts,
    list_owners,
    list_range_numbers,
    mark_run_starts,
    measure_runs,
)
from camgen.geometry.vectors import compute_in_blocks, measure_lengths, normalize
from camgen.localize.groups import pack_cells
from camgen.model.part import IntArray
from camgen.model.pose import FloatArray

#: Steps of the R2 sequence (Roberts, The unreasonable effectiveness of quasirandom sequences,
#: 2018).
_R2 = (0.7548776662466927, 0.5698402909980532)
#: FLANN's single k-d tree. It is exact and always the same; the default is a random forest.
_EXACT_TREE: dict[str, bool | int | float | str] = {"algorithm": 4, "leaf_max_size": 10}
#: Cells along the diagonal of the model, of grids from fine to coarse. A grid is not used if it
#: does not halve the number of questions.
_CELLS = (128, 64, 32, 16)


class Cloud:
    """Points (N, 3) with a tree that finds the nearest of them.

    The tree is in single precision: it is used to choose points, not to measure distances.
    """

    def __init__(self, points: FloatArray) -> None:
        # FLANN keeps no copy, so the array has to live as long as the tree.
        self._points = np.ascontiguousarray(points, dtype=np.float32)
        self._tree = cv2.flann.Index(self._points, _EXACT_TREE)

    def find_nearest(self, points: FloatArray) -> tuple[IntArray, FloatArray]:
        """Index (n,) and distance (n,), mm, of the nearest to each of `points` (n, 3)."""
        indices, distances = self.find_neighbours(points, 1)
        return indices[:, 0], distances[:, 0]

    def find_neighbours(self, points: FloatArray, count: int) -> tuple[IntArray, FloatArray]:
        """Indices and distances (mm) of the `count` nearest to each of `points` (n, 3).

        Both are (n, count).
        """
        if not len(points):
            return np.zeros((0, count), dtype=np.int64), np.zeros((0, count))
        indices, squares = self._tree.knnSearch(
            np.ascontiguousarray(points, dtype=np.float32), count, params={"checks": -1}
        )
        return np.asarray(indices, dtype=np.int64), np.sqrt(np.asarray(squares, dtype=np.float64))


class Model(Struct, frozen=True, eq=False):
    """The surface of a part in its own frame, mm.

    tree: its triangles.
    normals: (F, 3), unit normals outward, in the order of the tree.
    samples: (S, 3), points spread evenly over the surface.
    sample_normals: (S, 3), unit normals at the samples.
    cloud: the samples, to find the nearest of them.
    low, high: (3,), corners of the box around the surface.
    """

    tree: BoxTree
    normals: FloatArray
    samples: FloatArray
    sample_normals: FloatArray
    cloud: Cloud
    low: FloatArray
    high: FloatArray

    @property
    def area(self) -> float:
        """Area of the surface, mm2."""
        return float(np.linalg.norm(cross_edges(self.tree.corners), axis=1).sum() / 2)

    @property
    def volume(self) -> float:
        """Volume inside the surface, mm3, as far as it is closed."""
        a, b, c = (self.tree.corners[:, k] - self.low for k in range(3))
        return float(abs((a * np.cross(b, c)).sum()) / 6)

    @property
    def size(self) -> float:
        """Diagonal of the box around the surface, mm."""
        return float(np.linalg.norm(self.high - self.low))


def make_model(vertices: FloatArray, faces: IntArray, count: int = 20_000) -> Model:
    """The model of the triangles `faces` (F, 3) of `vertices` (V, 3), mm, with `count` samples.

    Triangles without an area are left out. At least one triangle needs an area.
    """
    corners = vertices[faces]
    tree = make_tree(corners[(cross_edges(corners) != 0).any(axis=1)])
    normals = normalize(cross_edges(tree.corners))
    samples, triangle = spread_points(tree.corners, count)
    ends = tree.corners.reshape(-1, 3)
    low, high = ends.min(axis=0), ends.max(axis=0)
    return Model(tree, normals, samples, normals[triangle], Cloud(samples), low, high)


def cross_edges(corners: FloatArray) -> FloatArray:
    """(F, 3) normals of triangles (F, 3, 3), each as long as twice the area of the triangle."""
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def spread_points(corners: FloatArray, count: int) -> tuple[FloatArray, IntArray]:
    """Points (count, 3) spread evenly over triangles (F, 3, 3), and the triangle of each (count,).

    The points are the same for each call.
    """
    ends = np.cumsum(np.linalg.norm(cross_edges(corners), axis=1))
    wanted = (np.arange(count) + 0.5) / count * ends[-1]
    triangle = np.searchsorted(ends, wanted).clip(max=len(corners) - 1)
    u, v = np.outer(_R2, np.arange(1, count + 1)) % 1.0
    beyond = u + v > 1
    u, v = np.where(beyond, 1 - u, u), np.where(beyond, 1 - v, v)
    a, b, c = corners[triangle].swapaxes(0, 1)
    return a + (b - a) * u[:, None] + (c - a) * v[:, None], triangle


# Closest points on the triangles, for many points at once.


class TouchPairs(Struct, frozen=True, eq=False):
    """Pairs of a point and a triangle that may be the closest one to it.

    point, triangle: (K,), indices, sorted by point.
    """

    point: IntArray
    triangle: IntArray


class Touch(Struct, frozen=True, eq=False):
    """The closest points on the model, for K of the points that were given.

    point: (K,), index of the given point, in increasing order.
    at: (K, 3), the place on the model, mm.
    triangle: (K,), index of the triangle.
    distance: (K,), mm.
    """

    point: IntArray
    at: FloatArray
    triangle: IntArray
    distance: FloatArray


class _Level(Struct, frozen=True, eq=False):
    """Points, or the cells of a grid that hold points.

    places: (N, 3), the points or the middles of the cells, mm.
    reach: (N,), distance from the model up to which a place counts, mm.
    slack: (N,), a triangle that is farther than the closest one by more than this is left out, mm.
    radius: distance from the middle of a cell to its corners, 0 for points, mm.
    """

    places: FloatArray
    reach: FloatArray
    slack: FloatArray
    radius: float


def find_candidates(
    model: Model, points: FloatArray, reach: float | FloatArray, slack: float | FloatArray
) -> TouchPairs:
    """The triangles that may be closest to each of `points` (N, 3).

    The tree is searched for the cells of a coarse grid that hold points. Finer cells, and at last
    the points, choose from the triangles of the cell in which they are.

    reach: number or (N,), mm. Points farther from the model are in no pair.
    slack: number or (N,), mm. The pairs hold until a point has moved by this.
    """
    gap = np.linalg.norm(np.maximum(np.maximum(model.low - points, points - model.high), 0), axis=1)
    limit = np.broadcast_to(np.asarray(reach + slack, dtype=np.float64), len(points))
    near = np.flatnonzero(gap <= limit)
    both = np.broadcast_to(np.asarray(2 * slack, dtype=np.float64), len(points))[near]
    # A cell has the largest limits of all points: it may hold the point that has them.
    widest_reach = float(limit[near].max(initial=0.0))
    widest_slack = float(both.max(initial=0.0))
    levels, parents = [_Level(points[near], limit[near], both, 0.0)], []
    for count in _CELLS:
        size = model.size / count
        middles, parent = _find_cells(levels[-1].places, model.low - widest_reach, size)
        if 2 * len(middles) > len(parent):
            break
        reach, slack = np.full(len(middles), widest_reach), np.full(len(middles), widest_slack)
        levels.append(_Level(middles, reach, slack, size * float(np.sqrt(0.75))))
        parents.append(parent)
    pairs = _search_tree(model, levels[-1])
    for level, parent in zip(levels[-2::-1], parents[::-1], strict=True):
        pairs = _prune_pairs(model, level, _join_cells(parent, pairs))
    return TouchPairs(near[pairs.point], pairs.triangle)


def narrow_candidates(
    model: Model, pairs: TouchPairs, points: FloatArray, reach: float, slack: float
) -> TouchPairs:
    """The candidates as by `find_candidates`, chosen from `pairs` that hold them all."""
    widest = np.full(len(points), reach + slack)
    return _prune_pairs(model, _Level(points, widest, np.full(len(points), 2 * slack), 0.0), pairs)


def _find_cells(points: FloatArray, low: FloatArray, size: float) -> tuple[FloatArray, IntArray]:
    """Middles (M, 3) of the cells that hold `points` (N, 3), and the cell of each point (N,)."""
    cells = np.floor((points - low) / size).astype(np.int64)
    _, first, cell = np.unique(pack_cells(cells), return_index=True, return_inverse=True)
    return low + size * (cells[first] + 0.5), cell.reshape(-1)


def _search_tree(model: Model, level: _Level) -> TouchPairs:
    # A sample is at most as close as the surface. So its distance is an upper bound.
    _, distance = model.cloud.find_nearest(level.places)
    bound = distance * (1 + 1e-5) + level.slack + 2 * level.radius
    bound = np.minimum(bound, level.reach + level.slack + 3 * level.radius) ** 2
    columns = np.ascontiguousarray(level.places.T)

    def meets(which: IntArray, low: FloatArray, high: FloatArray) -> IntArray:
        at = columns.take(which, axis=1)
        gap = np.minimum(np.maximum(low, at), high)
        gap -= at
        gap *= gap
        return np.flatnonzero(gap.sum(axis=0) <= bound.take(which))

    which, triangle, _ = search_tree(model.tree, len(level.places), meets)
    order = np.argsort(which, kind="stable")
    return _prune_pairs(model, level, TouchPairs(which[order], triangle[order]))


def _join_cells(parent: IntArray, pairs: TouchPairs) -> TouchPairs:
    """Each place with all triangles of its cell `parent` (N,)."""
    count = np.bincount(pairs.point, minlength=int(parent.max(initial=-1)) + 1)
    triangle = pairs.triangle[list_range_numbers(compute_first_rows(count)[parent], count[parent])]
    return TouchPairs(list_owners(count[parent]), triangle)


def _prune_pairs(model: Model, level: _Level, pairs: TouchPairs) -> TouchPairs:
    """The pairs whose cell is within its reach of the model, and whose triangle may be closest.

    A triangle is left out if it is nowhere in the cell within the slack of the closest triangle.
    """
    place, triangle = pairs.point, pairs.triangle
    if not len(place):
        return pairs
    points = level.places.take(place, axis=0)
    at = compute_in_blocks(compute_closest, model.tree.corners.take(triangle, axis=0), points)
    distance = measure_lengths(points - at)
    least = np.repeat(np.minimum.reduceat(distance, find_run_starts(place)), measure_runs(place))
    kept = distance <= least + level.slack[place] + 2 * level.radius
    kept &= least <= level.reach[place] + level.radius
    return TouchPairs(place[kept], triangle[kept])


def find_touched(model: Model, pairs: TouchPairs, points: FloatArray) -> Touch:
    """The closest of the candidates, for each of `points` (N, 3) that has any."""
    places = points.take(pairs.point, axis=0)
    at = compute_in_blocks(compute_closest, model.tree.corners.take(pairs.triangle, axis=0), places)
    distance = measure_lengths(places - at)
    least = distance
    if len(distance):
        nearest = np.minimum.reduceat(distance, find_run_starts(pairs.point))
        least = np.repeat(nearest, measure_runs(pairs.point))
    best = np.flatnonzero(distance == least)
    first = best[mark_run_starts(pairs.point[best])]
    return Touch(pairs.point[first], at[first], pairs.triangle[first], distance[first])


def find_touched_within(model: Model, points: FloatArray, reach: float) -> Touch:
    """The closest points on the model for those of `points` (N, 3) within `reach` (mm) of it."""
    touch = find_touched(model, find_candidates(model, points, reach, 0.0), points)
    near = touch.distance <= reach
    return Touch(touch.point[near], touch.at[near], touch.triangle[near], touch.distance[near])


def compute_closest(corners: FloatArray, points: FloatArray) -> FloatArray:
    """The closest point (n, 3) on each of the triangles (n, 3, 3) to each of `points` (n, 3).

    It is found by the regions of Ericson, Real-Time Collision Detection, section 5.1.5.
    """
    a, b, c = corners.transpose(1, 2, 0)
    # Coordinates are rows, one after the other in memory: that takes half the time.
    ab, ac, ap = (np.subtract(end, a, order="C") for end in (b, c, points.T))
    d1, d2, across = _multiply_columns(ab, ap), _multiply_columns(ac, ap), _multiply_columns(ab, ac)
    d3, d4 = d1 - _multiply_columns(ab, ab), d2 - across
    d5, d6 = d1 - across, d2 - _multiply_columns(ac, ac)
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    total = va + vb + vc
    total[total == 0] = 1.0
    v, w = vb / total, vc / total
    # The regions go from the inside outward: a later one replaces an earlier one.
    at_bc = (va <= 0) & (d4 - d3 >= 0) & (d5 - d6 >= 0)
    along = _divide(d4 - d3, (d4 - d3) + (d5 - d6))
    v, w = np.where(at_bc, 1 - along, v), np.where(at_bc, along, w)
    at_ac = (vb <= 0) & (d2 >= 0) & (d6 <= 0)
    v, w = np.where(at_ac, 0.0, v), np.where(at_ac, _divide(d2, d2 - d6), w)
    at_ab = (vc <= 0) & (d1 >= 0) & (d3 <= 0)
    v, w = np.where(at_ab, _divide(d1, d1 - d3), v), np.where(at_ab, 0.0, w)
    at_c, at_b, at_a = (d6 >= 0) & (d5 <= d6), (d3 >= 0) & (d4 <= d3), (d1 <= 0) & (d2 <= 0)
    for at_corner, corner_v, corner_w in ((at_c, 0.0, 1.0), (at_b, 1.0, 0.0), (at_a, 0.0, 0.0)):
        v, w = np.where(at_corner, corner_v, v), np.where(at_corner, corner_w, w)
    return np.ascontiguousarray((a + ab * v + ac * w).T)


def _multiply_columns(a: FloatArray, b: FloatArray) -> FloatArray:
    """(n,) scalar products of vectors (3, n), as by `vectors.multiply_rows` to the last bit."""
    products = a * b
    return np.asarray(products[0] + products[2] + products[1])


def _divide(a: FloatArray, b: FloatArray) -> FloatArray:
    """The quotient a / b, and 0 if b is 0."""
    return np.asarray(np.divide(a, b, out=np.zeros_like(a), where=b != 0))
