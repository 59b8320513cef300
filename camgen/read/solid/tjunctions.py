"""Vertices on the sides of triangles that do not have them: T-junctions, closed by splitting."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import each_once, starts_run
from camgen.model.part import IntArray
from camgen.model.pose import FloatArray
from camgen.read.solid.topology import WELD, ends, pair

#: A triangle has three sides, and each pass splits one side of it.
_PASSES = 3
#: Directions of the plane on which sides are searched. No side of a usual part is at right angles
#: to both, so that none falls to a point.
_PLANE = np.array([[0.8165, 0.1234], [-0.3141, 0.8660], [0.4845, 0.4844]])


class _Junctions(Struct, frozen=True, eq=False):
    """J vertices on open sides, ordered by the side and along it.

    half: (J,) half-edge of the side.
    vertex: (J,) number of the vertex.
    """

    half: IntArray
    vertex: IntArray

    def __len__(self) -> int:
        return len(self.half)


def split_at_junctions(vertices: FloatArray, faces: IntArray) -> tuple[IntArray, int]:
    """The faces with open sides split at the vertices that lie on them, and the number of these.

    vertices: (V, 3) mm.
    faces: (F, 3), no face with a vertex twice.
    """
    count = 0
    for _ in range(_PASSES):
        junctions = _find(vertices, faces)
        if not len(junctions):
            break
        faces, split = _split(faces, junctions)
        count += split
    return faces, count


def _find(vertices: FloatArray, faces: IntArray) -> _Junctions:
    """The vertices of open rims that lie on open sides."""
    none = _Junctions(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64))
    half = pair(faces).open
    if not len(half):
        return none
    import shapely  # noqa: PLC0415 (only for a mesh that is not closed)

    start, end = ends(faces, half)
    limit = WELD * float(np.linalg.norm(np.ptp(vertices, axis=0)))
    flat = vertices @ _PLANE
    lines = shapely.linestrings(np.stack([flat[start], flat[end]], axis=1))
    rim = each_once(np.concatenate([start, end]))
    points = shapely.points(flat[rim])
    tree = shapely.STRtree(lines)
    point, side = tree.query(points, predicate="dwithin", distance=limit)
    vertex = rim[point]
    span = vertices[end[side]] - vertices[start[side]]
    length = np.linalg.norm(span, axis=1)
    offset = vertices[vertex] - vertices[start[side]]
    with np.errstate(divide="ignore", invalid="ignore"):
        along = (offset * span).sum(axis=1) / length
        distance = np.linalg.norm(offset - along[:, None] * span / length[:, None], axis=1)
    inside = (distance <= limit) & (along > limit) & (along < length - limit)
    order = np.lexsort((along[inside], side[inside]))
    return _Junctions(half[side[inside][order]], vertex[inside][order])


def _split(faces: IntArray, junctions: _Junctions) -> tuple[IntArray, int]:
    """The faces with one side of each split, and the number of vertices on these sides."""
    owner = junctions.half // 3
    # The first side of each face; the others wait for the next pass.
    begins = starts_run(junctions.half)
    first_half = junctions.half[begins][starts_run(owner[begins])]
    used = np.isin(junctions.half, first_half)
    half, vertex = junctions.half[used], junctions.vertex[used]
    sizes = np.bincount(np.searchsorted(first_half, half), minlength=len(first_half)) + 1
    first = np.cumsum(sizes) - sizes
    last = first + sizes - 1
    start, end = ends(faces, first_half)
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
