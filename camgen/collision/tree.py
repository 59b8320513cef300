"""A tree of boxes around triangles, searched level by level for many queries at once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from msgspec import Struct

from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray

#: Children of a node, and the bits of a child's number. A shift divides in a third of the time.
FAN, BITS = 8, 3
#: Largest coordinate along the curve of Morton: ten bits for each axis.
_LARGEST_COORDINATE = 1023.0
#: A search starts at the lowest level with at most this number of pairs of a query and a node.
_PAIRS = 1024
#: Pairs that are tested together: their tables stay in the processor's cache.
_BLOCK = 1024


class BoxTree(Struct, frozen=True, eq=False):
    """Triangles, and the boxes around them.

    corners: (F, 3, 3) the triangles in the order of the tree.
    lows, highs: lower and upper corners of the nodes of each level, from the top to the triangles,
        each (3, K, 8): block i has the eight children of node i of the level above. The end of the
        last block is filled with nan, which is neither above nor below any number.
    """

    corners: FloatArray
    lows: tuple[FloatArray, ...]
    highs: tuple[FloatArray, ...]


def make_tree(corners: FloatArray) -> BoxTree:
    """The tree of triangles (F, 3, 3), F > 0. Neighbours along the curve of Morton are siblings."""
    middles = corners.mean(axis=1)
    span = np.maximum(np.ptp(middles, axis=0).max(), 1e-9)
    cells = ((middles - middles.min(axis=0)) / span * _LARGEST_COORDINATE).astype(np.int64)
    corners = corners[np.argsort(_spread(cells) @ np.array([1, 2, 4]), kind="stable")]
    lows = [np.ascontiguousarray(corners.min(axis=1).T)]
    highs = [np.ascontiguousarray(corners.max(axis=1).T)]
    while lows[-1].shape[1] > FAN:
        begins = np.arange(0, lows[-1].shape[1], FAN)
        lows.append(np.minimum.reduceat(lows[-1], begins, axis=1))
        highs.append(np.maximum.reduceat(highs[-1], begins, axis=1))
    return BoxTree(corners, tuple(map(_block, lows[::-1])), tuple(map(_block, highs[::-1])))


def _block(level: FloatArray) -> FloatArray:
    missing = np.full((3, -level.shape[1] % FAN), np.nan)
    return np.concatenate([level, missing], axis=1).reshape(3, -1, FAN)


def _spread(values: IntArray) -> IntArray:
    """Ten bits of each value, with two zeros after each bit."""
    for shift, mask in ((16, 0x30000FF), (8, 0x300F00F), (4, 0x30C30C3), (2, 0x9249249)):
        values = (values | values << shift) & mask
    return values


#: Gets queries (n, 1), and lower and upper corners of the eight children of a node for each of
#: them, both (3, n, 8). Returns the indices (m,), among these n * 8, of children to be searched.
FindMeeting = Callable[[IntArray, FloatArray, FloatArray], IntArray]
#: Gets queries (n,), and a corner of a triangle in a node for each of them (3, n). Returns (n,)
#: whether that answers the query.
IsAnswered = Callable[[IntArray, FloatArray], BoolArray]


def search_tree(
    tree: BoxTree, count: int, meets: FindMeeting, known: IsAnswered | None = None
) -> tuple[IntArray, IntArray, BoolArray]:
    """Search the tree for the queries 0 to `count` - 1.

    Returns the query and the triangle of each pair whose boxes meet, and (`count`,) whether `known`
    answered a query before its triangles were reached.
    """
    blocks = [level.shape[1] for level in tree.lows]
    # A level takes as long for a hundred pairs as for one, so a few queries skip upper levels. A
    # level of two blocks saves no more than the search of the level above costs.
    limit = max(_PAIRS // (max(count, 1) * FAN), 2)
    top = max((level for level, size in enumerate(blocks) if size <= limit), default=0)
    query = np.repeat(np.arange(count), blocks[top])
    node = np.tile(np.arange(blocks[top]), count)
    is_answered = np.zeros(count, dtype=bool)
    for level in range(top, len(blocks)):
        kept = _meet_in_blocks(tree.lows[level], tree.highs[level], query, node, meets)
        parent = kept >> BITS
        query, node = query.take(parent), node.take(parent) * FAN + (kept & FAN - 1)
        if known:
            first = node * FAN ** (len(blocks) - 1 - level)
            is_answered[query[known(query, tree.corners[:, 0].T.take(first, axis=1))]] = True
            pending = np.flatnonzero(~is_answered.take(query))
            query, node = query.take(pending), node.take(pending)
    return query, node, is_answered


def _meet_in_blocks(
    lows: FloatArray, highs: FloatArray, query: IntArray, node: IntArray, meets: FindMeeting
) -> IntArray:
    """The pairs of a query and a child of its node that meet (m,), tested block by block.

    The data of a query are taken once for eight children, which are next to each other in memory.
    """
    kept = []
    for begin in range(0, max(len(query), 1), _BLOCK):
        block = slice(begin, begin + _BLOCK)
        nodes = node[block]
        pairs = meets(query[block, None], lows.take(nodes, axis=1), highs.take(nodes, axis=1))
        kept.append(pairs + begin * FAN)
    return np.concatenate(kept)
