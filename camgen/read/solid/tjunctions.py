"""Closes T-junctions: splits the sides of triangles at vertices that lie on them."""

from __future__ import annotations

import numpy as np

from camgen.geometry.ragged import mark_run_starts, select_distinct
from camgen.model.part import IntArray
from camgen.model.pose import FloatArray
from camgen.read.solid.topology import WELD, list_ends, pair_half_edges

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
