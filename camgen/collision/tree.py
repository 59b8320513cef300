"""A tree of boxes over triangles that answers many questions at once, level by level."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from msgspec import Struct

from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray

#: Children of a node.
_FAN = 8
_CELLS = 1023.0


class BoxTree(Struct, frozen=True, eq=False):
    """corners: (F, 3, 3) the triangles in the tree's order. lows, highs: (K, 3) per level, from the top to the
    triangles; the children of node i are the nodes 8 i to 8 i + 7 below it.
    """

    corners: FloatArray
    lows: tuple[FloatArray, ...]
    highs: tuple[FloatArray, ...]


def grow(corners: FloatArray) -> BoxTree:
    """The tree over triangles (F, 3, 3), F > 0: neighbours along Morton's curve through the middles are siblings."""
    middles = corners.mean(axis=1)
    span = np.maximum(np.ptp(middles, axis=0).max(), 1e-9)
    cells = ((middles - middles.min(axis=0)) / span * _CELLS).astype(np.int64)
    corners = corners[np.argsort(_spread(cells) @ np.array([1, 2, 4]), kind="stable")]
    lows, highs = [corners.min(axis=1)], [corners.max(axis=1)]
    while len(lows[-1]) > _FAN:
        begins = np.arange(0, len(lows[-1]), _FAN)
        lows.append(np.minimum.reduceat(lows[-1], begins))
        highs.append(np.maximum.reduceat(highs[-1], begins))
    return BoxTree(corners, tuple(lows[::-1]), tuple(highs[::-1]))


def _spread(values: IntArray) -> IntArray:
    """Ten bits of each value with two zeros after each."""
    for shift, mask in ((16, 0x30000FF), (8, 0x300F00F), (4, 0x30C30C3), (2, 0x9249249)):
        values = (values | values << shift) & mask
    return values


#: Questions (n,) and nodes' low and high corners (n, 3), to which of these a question goes on (n,).
Meets = Callable[[IntArray, FloatArray, FloatArray], BoolArray]
#: Questions (n,) and a corner of a triangle in each node (n, 3), to which questions need no further answer (n,).
Known = Callable[[IntArray, FloatArray], BoolArray]


def ask(tree: BoxTree, count: int, meets: Meets, known: Known | None = None) -> tuple[IntArray, IntArray, BoolArray]:
    """Which questions 0 to ``count`` - 1 meet the boxes of which triangles, and which were known on the way and need no
    triangles (``count``,).
    """
    top = len(tree.lows[0])
    question, node = np.repeat(np.arange(count), top), np.tile(np.arange(top), count)
    answered = np.zeros(count, dtype=bool)
    for level, (low, high) in enumerate(zip(tree.lows, tree.highs, strict=True)):
        if level:
            question = np.repeat(question, _FAN)
            node = (node[:, None] * _FAN + np.arange(_FAN)).ravel()
            question, node = question[node < len(low)], node[node < len(low)]
        kept = meets(question, low[node], high[node])
        question, node = question[kept], node[kept]
        if known:
            first = node * _FAN ** (len(tree.lows) - 1 - level)
            answered[question[known(question, tree.corners[first, 0])]] = True
            question, node = question[~answered[question]], node[~answered[question]]
    return question, node, answered
