"""Where the faces of a mesh meet: half-edges put together two by two, and what hangs together."""

from __future__ import annotations

from itertools import product

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import each_once, run_starts
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray


class Pairs(Struct, frozen=True, eq=False):
    """Half-edge h is side h % 3 of face h // 3: from its vertex h % 3 to the next one.

    first, second: (M,) the half-edges of an edge where two faces meet. turned: (M,) both run the same way, so that one
    of the faces is wound the wrong way. open: half-edges that are alone. crowded: half-edges where more than two meet.
    """

    first: IntArray
    second: IntArray
    turned: BoolArray
    open: IntArray
    crowded: IntArray


def ends(faces: IntArray, half: IntArray) -> tuple[IntArray, IntArray]:
    """The vertices that each of the half-edges ``half`` (N,) runs from and to."""
    corners = faces.reshape(-1)
    return corners[half], corners[half - half % 3 + (half + 1) % 3]


def pair(faces: IntArray) -> Pairs:
    """The half-edges of ``faces`` (F, 3), no face with a vertex twice."""
    start = faces.reshape(-1)
    end = faces[:, [1, 2, 0]].reshape(-1)
    count = int(faces.max()) + 1 if len(faces) else 1
    key = np.minimum(start, end) * count + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    sorted_key = key[order]
    new = run_starts(sorted_key)
    size = np.diff(np.append(new, len(key)))
    first, second = order[new[size == 2]], order[new[size == 2] + 1]
    return Pairs(
        first,
        second,
        start[first] == start[second],
        np.sort(order[new[size == 1]]),
        order[np.repeat(size > 2, size)],
    )


def components(count: int, a: IntArray, b: IntArray) -> IntArray:
    """(count,) the least node that each one hangs together with, by links from ``a`` (M,) to ``b`` (M,)."""
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


# Vertices that are one place become one vertex; faces that are none, or there twice, go.

#: Odd numbers of 64 bits that spread the bits of a coordinate over the whole word.
_SPREAD = (0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9)
#: Rims closer than this part of the size of the mesh meet.
WELD = 1e-5


def merge(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    """The mesh with equal vertices made one, in the order in which they first appear."""
    places = np.ascontiguousarray(vertices) + 0.0  # no -0.0: it would look different
    words = places.view(np.uint64)
    mixed = np.zeros(len(places), dtype=np.uint64)
    for k, factor in enumerate(_SPREAD):
        mixed = (mixed ^ (words[:, k] >> np.uint64(29)) ^ words[:, k]) * np.uint64(factor)
    _, index, inverse = np.unique(mixed, return_index=True, return_inverse=True)
    if not np.array_equal(
        places[index][inverse], places
    ):  # two places with one hash: rare enough for the slow way
        _, index, inverse = np.unique(places, axis=0, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(index))
    return places[np.sort(index)], np.asarray(rank[inverse.reshape(-1)][faces])


def weld(vertices: FloatArray, faces: IntArray) -> tuple[IntArray, int]:
    """The faces with vertices of open rims that lie close together made one, and how many vertices that were.

    Only rims: inside a closed surface nothing needs to be closed, and small faces must not fall flat.
    """
    rim = each_once(np.concatenate(ends(faces, pair(faces).open)))
    if not len(rim):
        return faces, 0
    limit = WELD * float(np.linalg.norm(np.ptp(vertices, axis=0)))
    a, b = find_close(vertices[rim], limit)
    lowest = np.arange(len(vertices))
    lowest[rim] = rim[components(len(rim), a, b)]
    return np.asarray(lowest[faces]), int(np.count_nonzero(lowest != np.arange(len(lowest))))


def find_close(points: FloatArray, limit: float) -> tuple[IntArray, IntArray]:
    """Pairs of ``points`` (N, 3) that are no farther apart than ``limit``, enough of them to link all that are.

    Two such points share a cell of four limits in at least one of eight grids, each shifted by half a cell.
    """
    found = []
    scaled = (points - points.min(axis=0)) / (4 * limit)
    for shift in product((0.0, 0.5), repeat=3):
        cell = np.floor(scaled + shift).astype(np.int64)
        order = np.lexsort(cell.T)
        inside = np.arange(len(order) - 1)
        step = 1
        while len(inside):
            same = (cell[order[inside]] == cell[order[inside + step]]).all(axis=1)
            inside = inside[same]
            found.append(np.stack([order[inside], order[inside + step]]))
            step += 1
            inside = inside[inside + step < len(order)] if step <= 8 else inside[:0]
    a, b = np.concatenate(found, axis=1)
    near = np.linalg.norm(points[a] - points[b], axis=1) <= limit
    return a[near], b[near]


def without_degenerate(faces: IntArray) -> IntArray:
    """The faces that have three different vertices."""
    a, b, c = faces.T
    return np.asarray(faces[(a != b) & (b != c) & (c != a)])


def without_duplicates(faces: IntArray) -> IntArray:
    """Each face once, whichever way round it is; the first of equals stays."""
    if not len(faces):
        return faces
    low, middle, high = np.sort(faces, axis=1).T
    order = np.lexsort((high, middle, low))
    same = (low[order][1:] == low[order][:-1]) & (middle[order][1:] == middle[order][:-1])
    same &= high[order][1:] == high[order][:-1]
    again = order[1:][same]
    kept = np.ones(len(faces), dtype=bool)
    kept[again] = False
    return faces[kept]


def drop_unused(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    """Only the vertices that a face has."""
    kept = np.zeros(len(vertices), dtype=bool)
    kept[faces] = True
    return vertices[kept], (np.cumsum(kept) - 1)[faces]
