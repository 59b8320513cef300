"""A tree of boxes over triangles that answers many questions at once, level by level."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from msgspec import Struct

from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray

#: Children of a node, and the bits of a place among them: to shift is to divide in a third of the time.
FAN, BITS = 8, 3
_CELLS = 1023.0
#: The first level that is looked at is the lowest one of no more pairs of a question and a node.
_PAIRS = 1024
#: Questions that are asked together at a level: their tables stay in the processor's cache.
_BLOCK = 1024


class BoxTree(Struct, frozen=True, eq=False):
    """corners: (F, 3, 3) the triangles in the tree's order. lows, highs: (3, K, 8) per level, from the top to the
    triangles: the children of node i are the eight of block i below it. The last block is filled up with nan: nothing
    is less or more than that.
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
    lows, highs = (
        [np.ascontiguousarray(corners.min(axis=1).T)],
        [np.ascontiguousarray(corners.max(axis=1).T)],
    )
    while lows[-1].shape[1] > FAN:
        begins = np.arange(0, lows[-1].shape[1], FAN)
        lows.append(np.minimum.reduceat(lows[-1], begins, axis=1))
        highs.append(np.maximum.reduceat(highs[-1], begins, axis=1))
    return BoxTree(corners, tuple(map(_block, lows[::-1])), tuple(map(_block, highs[::-1])))


def _block(level: FloatArray) -> FloatArray:
    missing = np.full((3, -level.shape[1] % FAN), np.nan)
    return np.concatenate([level, missing], axis=1).reshape(3, -1, FAN)


def _spread(values: IntArray) -> IntArray:
    """Ten bits of each value with two zeros after each."""
    for shift, mask in ((16, 0x30000FF), (8, 0x300F00F), (4, 0x30C30C3), (2, 0x9249249)):
        values = (values | values << shift) & mask
    return values


#: Questions (n, 1) and the low and high corners of eight nodes for each (3, n, 8): to which of these n times 8 they go
#: on (m,).
Meets = Callable[[IntArray, FloatArray, FloatArray], IntArray]
#: Questions (n,) and a corner of a triangle in each node (3, n), to which questions need no further answer (n,).
Known = Callable[[IntArray, FloatArray], BoolArray]


def ask(
    tree: BoxTree, count: int, meets: Meets, known: Known | None = None
) -> tuple[IntArray, IntArray, BoolArray]:
    """Which questions 0 to ``count`` - 1 meet the boxes of which triangles, and which were known on the way and need no
    triangles (``count``,).
    """
    blocks = [level.shape[1] for level in tree.lows]
    # A level takes as long for some hundred pairs as for one: few questions are not asked at the upper ones.
    top = max(
        (level for level, many in enumerate(blocks) if count * many * FAN <= _PAIRS), default=0
    )
    question, node = (
        np.repeat(np.arange(count), blocks[top]),
        np.tile(np.arange(blocks[top]), count),
    )
    answered = np.zeros(count, dtype=bool)
    for level in range(top, len(blocks)):
        kept = _meet_in_blocks(tree.lows[level], tree.highs[level], question, node, meets)
        parent = kept >> BITS
        question, node = question.take(parent), node.take(parent) * FAN + (kept & FAN - 1)
        if known:
            first = node * FAN ** (len(blocks) - 1 - level)
            answered[question[known(question, tree.corners[:, 0].T.take(first, axis=1))]] = True
            left = np.flatnonzero(~answered.take(question))
            question, node = question.take(left), node.take(left)
    return question, node, answered


def _meet_in_blocks(
    lows: FloatArray, highs: FloatArray, question: IntArray, node: IntArray, meets: Meets
) -> IntArray:
    """Which pairs of a question and a child of its node meet (m,), a block of questions at a time.

    What belongs to a question is taken once for eight nodes, and these lie side by side.
    """
    kept = []
    for begin in range(0, max(len(question), 1), _BLOCK):
        block = slice(begin, begin + _BLOCK)
        nodes = node[block]
        pairs = meets(question[block, None], lows.take(nodes, axis=1), highs.take(nodes, axis=1))
        kept.append(pairs + begin * FAN)
    return np.concatenate(kept)
