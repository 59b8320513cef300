"""Where the faces of a mesh meet: half-edges put together two by two, and what hangs together."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.solid import BoolArray, IntArray


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


def paired(faces: IntArray) -> Pairs:
    """The half-edges of ``faces`` (F, 3), no face with a vertex twice."""
    start = faces.reshape(-1)
    end = faces[:, [1, 2, 0]].reshape(-1)
    count = int(faces.max()) + 1 if len(faces) else 1
    key = np.minimum(start, end) * count + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    sorted_key = key[order]
    new = np.flatnonzero(np.append(True, sorted_key[1:] != sorted_key[:-1])) if len(key) else np.zeros(0, np.int64)
    size = np.diff(np.append(new, len(key)))
    first, second = order[new[size == 2]], order[new[size == 2] + 1]
    return Pairs(
        first, second, start[first] == start[second], np.sort(order[new[size == 1]]), order[np.repeat(size > 2, size)]
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
