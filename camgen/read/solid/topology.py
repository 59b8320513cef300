"""Connectivity of a triangle mesh: paired half-edges, connected components, and its clean-up.

Half-edge h is side h % 3 of face h // 3. It runs from vertex h % 3 of that face to the next one.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import find_run_starts, mark_run_starts, select_distinct
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray


class Pairs(Struct, frozen=True, eq=False):
    """Half-edges of a mesh, matched with those that run between the same two vertices.

    first, second: (M,) the two half-edges of each side where exactly two faces meet.
    turned: (M,) whether both run in the same direction, which means that one face is wound wrongly.
    open: half-edges without a match.
    crowded: half-edges of sides where more than two faces meet.
    """

    first: IntArray
    second: IntArray
    turned: BoolArray
    open: IntArray
    crowded: IntArray


def list_ends(faces: IntArray, half_edges: IntArray) -> tuple[IntArray, IntArray]:
    """The start vertex and the end vertex of each half-edge (N,)."""
    corners = faces.reshape(-1)
    return corners[half_edges], corners[half_edges - half_edges % 3 + (half_edges + 1) % 3]


def pair_half_edges(faces: IntArray) -> Pairs:
    """Match the half-edges of `faces` (F, 3), each of which has three different vertices."""
    start = faces.reshape(-1)
    end = faces[:, [1, 2, 0]].reshape(-1)
    count = int(faces.max()) + 1 if len(faces) else 1
    key = np.minimum(start, end) * count + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    groups = find_run_starts(key[order])
    size = np.diff(np.append(groups, len(key)))
    first, second = order[groups[size == 2]], order[groups[size == 2] + 1]
    return Pairs(
        first,
        second,
        start[first] == start[second],
        np.sort(order[groups[size == 1]]),
        order[np.repeat(size > 2, size)],
    )


def label_components(count: int, a: IntArray, b: IntArray) -> IntArray:
    """Label the connected components of a graph.

    count: number of nodes.
    a, b: (M,) the two nodes of each link.

    Returns (count,) the lowest node of the component of each node.
    """
    label = np.arange(count)
    while True:
        lower = np.minimum(label[a], label[b])
        roots = label.copy()
        np.minimum.at(roots, label[a], lower)
        np.minimum.at(roots, label[b], lower)
        while not np.array_equal(roots, roots[roots]):
            roots = roots[roots]
        label_next = roots[label]
        if np.array_equal(label_next, label):
            return label
        label = label_next


# Clean-up: vertices at the same position become one, degenerate and repeated faces are dropped.

#: Odd 64-bit factors of a hash. They spread the bits of a coordinate over the whole word.
_SPREAD = (0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9)
#: Distance below which open rims are welded, as a fraction of the diagonal of the mesh.
WELD = 1e-5


def merge_equal_vertices(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    """The mesh with equal vertices merged, in the order in which they first appear."""
    positions = np.ascontiguousarray(vertices) + 0.0  # -0.0 becomes 0.0, which has other bits
    words = positions.view(np.uint64)
    hashes = np.zeros(len(positions), dtype=np.uint64)
    for k, factor in enumerate(_SPREAD):
        hashes = (hashes ^ (words[:, k] >> np.uint64(29)) ^ words[:, k]) * np.uint64(factor)
    _, index, inverse = np.unique(hashes, return_index=True, return_inverse=True)
    if not np.array_equal(positions[index][inverse], positions):
        # Two positions have the same hash. That is rare, so the slow search will do.
        _, index, inverse = np.unique(positions, axis=0, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(index))
    return positions[np.sort(index)], np.asarray(rank[inverse.reshape(-1)][faces])


def weld_rims(vertices: FloatArray, faces: IntArray) -> tuple[IntArray, int]:
    """The faces with close vertices of open rims merged, and the number of vertices merged.

    Vertices inside a closed surface stay: there is no gap to close, and merging them would flatten
    small faces.
    """
    rim = select_distinct(np.concatenate(list_ends(faces, pair_half_edges(faces).open)))
    if not len(rim):
        return faces, 0
    limit = WELD * float(np.linalg.norm(np.ptp(vertices, axis=0)))
    a, b = find_close_pairs(vertices[rim], limit)
    lowest = np.arange(len(vertices))
    lowest[rim] = rim[label_components(len(rim), a, b)]
    return np.asarray(lowest[faces]), int(np.count_nonzero(lowest != np.arange(len(lowest))))


def find_close_pairs(points: FloatArray, limit: float) -> tuple[IntArray, IntArray]:
    """Pairs of `points` (N, 3) that are at most `limit` apart.

    There are enough pairs to connect all such points. Two such points share a cell of four limits
    in at least one of eight grids, each shifted by half a cell along some of the axes.
    """
    candidates = []
    scaled = (points - points.min(axis=0)) / (4 * limit)
    for shift in product((0.0, 0.5), repeat=3):
        cell = np.floor(scaled + shift).astype(np.int64)
        order = np.lexsort(cell.T)
        inside = np.arange(len(order) - 1)
        step = 1
        while len(inside):
            inside = inside[(cell[order[inside]] == cell[order[inside + step]]).all(axis=1)]
            candidates.append(np.stack([order[inside], order[inside + step]]))
            step += 1
            inside = inside[inside + step < len(order)] if step <= 8 else inside[:0]
    a, b = np.concatenate(candidates, axis=1)
    near = np.linalg.norm(points[a] - points[b], axis=1) <= limit
    return a[near], b[near]


def drop_degenerate(faces: IntArray) -> IntArray:
    """The faces that have three different vertices."""
    a, b, c = faces.T
    return np.asarray(faces[(a != b) & (b != c) & (c != a)])


def drop_duplicates(faces: IntArray) -> IntArray:
    """The faces without those that have the same vertices as an earlier one, in any order."""
    low, middle, high = np.sort(faces, axis=1).T
    order = np.lexsort((high, middle, low))
    same = (low[order][1:] == low[order][:-1]) & (middle[order][1:] == middle[order][:-1])
    same &= high[order][1:] == high[order][:-1]
    kept = np.ones(len(faces), dtype=bool)
    kept[order[1:][same]] = False
    return faces[kept]


def drop_unused(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    """The mesh without vertices that no face has."""
    kept = np.zeros(len(vertices), dtype=bool)
    kept[faces] = True
    return vertices[kept], (np.cumsum(kept) - 1)[faces]


# T-junctions: sides of triangles are split at vertices that lie on them.

#: A triangle has three sides, and each pass splits one side of it.
_PASSES = 3
#: Directions of the plane on which sides are searched. No side of a usual part is at right angles
#: to both, so that none falls to a point.
_PLANE = np.array([[0.8165, 0.1234], [-0.3141, 0.8660], [0.4845, 0.4844]])


def split_at_junctions(vertices: FloatArray, faces: IntArray) -> tuple[IntArray, int]:
    """Split open sides at the vertices on them. Returns the faces and the number of splits.

    vertices: (V, 3) mm.
    faces: (F, 3), each with three different vertices.
    """
    count = 0
    for _ in range(_PASSES):
        half, vertex = _find_junctions(vertices, faces)
        if not len(half):
            break
        faces, splits = _split(faces, half, vertex)
        count += splits
    return faces, count


def _find_junctions(vertices: FloatArray, faces: IntArray) -> tuple[IntArray, IntArray]:
    """The open half-edges (J,) with a vertex of an open rim on them, and these vertices (J,).

    They are in order of the half-edge, then along it.
    """
    half = pair_half_edges(faces).open
    if not len(half):
        return half, half
    import shapely  # noqa: PLC0415 (only for a mesh that is not closed)

    start, end = list_ends(faces, half)
    limit = WELD * float(np.linalg.norm(np.ptp(vertices, axis=0)))
    flat = vertices @ _PLANE
    lines = shapely.linestrings(np.stack([flat[start], flat[end]], axis=1))
    rim = select_distinct(np.concatenate([start, end]))
    points = shapely.points(flat[rim])
    point, side = shapely.STRtree(lines).query(points, predicate="dwithin", distance=limit)
    vertex = rim[point]
    span = vertices[end[side]] - vertices[start[side]]
    length = np.linalg.norm(span, axis=1)
    offset = vertices[vertex] - vertices[start[side]]
    with np.errstate(divide="ignore", invalid="ignore"):
        along = (offset * span).sum(axis=1) / length
        distance = np.linalg.norm(offset - along[:, None] * span / length[:, None], axis=1)
    inside = (distance <= limit) & (along > limit) & (along < length - limit)
    order = np.lexsort((along[inside], side[inside]))
    return half[side[inside][order]], vertex[inside][order]


def _split(faces: IntArray, half: IntArray, vertex: IntArray) -> tuple[IntArray, int]:
    """The faces with one side of each split, and the number of vertices on these sides.

    half, vertex: junctions as from `_find_junctions`.
    """
    # The first side of each face is split. Others wait for the next pass.
    sides = half[mark_run_starts(half)]
    first_half = sides[mark_run_starts(sides // 3)]
    used = np.isin(half, first_half)
    half, vertex = half[used], vertex[used]
    sizes = np.bincount(np.searchsorted(first_half, half), minlength=len(first_half)) + 1
    first = np.cumsum(sizes) - sizes
    last = first + sizes - 1
    start, end = list_ends(faces, first_half)
    tip = faces.reshape(-1)[first_half - first_half % 3 + (first_half + 2) % 3]
    total = int(sizes.sum())
    begin, finish = np.empty(total, dtype=np.int64), np.empty(total, dtype=np.int64)
    begin[first], finish[last] = start, end
    begin[np.setdiff1d(np.arange(total), first)] = vertex
    finish[np.setdiff1d(np.arange(total), last)] = vertex
    pieces = np.column_stack([begin, finish, np.repeat(tip, sizes)])
    kept = np.ones(len(faces), dtype=bool)
    kept[first_half // 3] = False
    return np.concatenate([faces[kept], pieces]), len(vertex)
