"""Finds the nearest items of every item, exactly, with a k-d tree of blocks in numpy alone.

The tree is searched for all blocks at once.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.ragged import (
    compute_first_rows,
    concatenate_columns,
    find_run_starts,
    mark_run_starts,
    measure_runs,
    number_rows,
    select_distinct,
)
from camgen.model.pose import FloatArray

IntArray = NDArray[np.int64]

#: Discs in a leaf of the tree.
_LEAF = 8
#: Leaves in a block, within which the first bound on the search radius is measured.
_BLOCK = 4
#: Leaves, pairs of leaves, and pairs of items in a batch. A batch of these sizes stays in the cache
#: of the processor.
_LEAF_BATCH = 256
_LEAF_PAIR_BATCH = 1_000
_ITEM_PAIR_BATCH = 20_000
#: Fraction of the lengths from which a distance is computed. Rounding changes it by less.
_ROUNDING = 1e-9
#: Fraction by which search radii are enlarged, so that on a grid all items at the same distance
#: are listed.
_SAME_DISTANCE = 1e-9


class Discs(Struct, frozen=True, eq=False):
    """Items that are covered by discs.

    owner: (D,) the item of each disc.
    centre: (D, 2) mm.
    radius: (D,) mm.
    """

    owner: IntArray
    centre: FloatArray
    radius: FloatArray


class NearestItems(Struct, frozen=True, eq=False):
    """Pairs of near items, sorted by item and distance.

    item: (E,) an item.
    other: (E,) an item near it. A pair may be listed from one of its items only.
    distance: (E,) distance of the nearest discs of the two, mm, 0 if they overlap.
    sure: (N,) radius around each item, mm, within which the list is complete and exact. Beyond it
        a pair may be missing, or be nearer than `distance` says.
    """

    item: IntArray
    other: IntArray
    distance: FloatArray
    sure: FloatArray

    def table(self, count: int, width: int) -> tuple[IntArray, FloatArray]:
        """The `width` nearest items of each, and their distances in mm, both (count, width).

        An item with fewer listed pairs has -1 and inf in the remaining columns.
        """
        counts, step = np.bincount(self.item, minlength=count)[:, None], np.arange(width)
        listed = step < counts
        row = (compute_first_rows(counts[:, 0])[:, None] + step)[listed]
        near, distance = np.full((count, width), -1), np.full((count, width), np.inf)
        near[listed], distance[listed] = self.other[row], self.distance[row]
        return near, distance


class _Leaves(Struct, frozen=True, eq=False):
    """The discs in M leaves, each array (M, _LEAF).

    x, y: centre, mm; NaN in an empty place.
    owner: item of the disc; -1 in an empty place.
    radius: mm; 0 in an empty place.
    """

    x: FloatArray
    y: FloatArray
    owner: IntArray
    radius: FloatArray


def find_nearest_items(discs: Discs, count: int, wanted: int) -> NearestItems:
    """About `wanted` nearest items of each of `count` items.

    `NearestItems.sure` says where items may be missing.

    The distance of two items is that of their nearest discs, 0 if these overlap. If more than
    `wanted` items are at the same distance, for example at one point, only some of them are
    listed, so that a crowd does not give all its pairs.
    """
    leaves = _make_leaves(discs)
    reach = _measure_first_bound(leaves, wanted)
    first_leaf, second_leaf = _find_leaf_pairs(leaves, reach)
    parts = _find_item_pairs(leaves, first_leaf, second_leaf, reach, count)
    key, distance = concatenate_columns(parts)
    order = np.argsort(key)
    key, distance = key[order], distance[order]
    first = find_run_starts(key)
    key, distance = key[first], np.minimum.reduceat(distance, first)
    item, other = key // count, key % count
    order = _sort_by_distance(item, distance)
    sure = np.full(count, np.inf)
    is_disc = leaves.owner >= 0
    np.minimum.at(sure, leaves.owner[is_disc], np.repeat(reach[:, None], _LEAF, axis=1)[is_disc])
    return NearestItems(item, other[order], np.maximum(distance[order], 0.0), np.maximum(sure, 0.0))


def _sort_by_distance(item: IntArray, distance: FloatArray) -> IntArray:
    """The order that sorts the pairs of each item by distance, equal distances as they stand.

    `item` is sorted and stays so. One number holds the item, the rank of the distance and the
    place of a pair: numpy sorts such numbers faster than it finds a stable order.
    """
    order = np.arange(len(item))
    # In batches that do not split an item.
    cuts = select_distinct(np.searchsorted(item, item[::_ITEM_PAIR_BATCH])).tolist()
    for begin, end in pairwise([*cuts, len(item)]):
        rising = np.argsort(distance[begin:end])
        distances = distance[begin:end][rising]
        rank = np.empty(end - begin, dtype=np.int64)
        rank[rising] = np.cumsum(mark_run_starts(distances)) - 1
        counts = measure_runs(item[begin:end])
        first, longest = np.repeat(compute_first_rows(counts), counts), int(counts.max())
        number = (first * len(rank) + rank) * longest + number_rows(counts)
        number.sort()
        order[begin:end] = begin + first + number % longest
    return order


def _make_leaves(discs: Discs) -> _Leaves:
    """The discs in leaves, by halving blocks along their longer side; M is a power of two."""
    count = len(discs.owner)
    levels = max(0, int(np.ceil(np.log2(max(count, 1) / _LEAF))))
    order = np.full((1, _LEAF << levels), -1)
    order[0, :count] = np.arange(count)
    # One array per coordinate: numpy reduces along the second-last axis of (..., 2) arrays four
    # times as slowly.
    x, y = (np.append(discs.centre[:, axis], np.nan) for axis in (0, 1))
    for _ in range(levels):
        block = x[order], y[order]
        with np.errstate(invalid="ignore"):
            side = np.column_stack(
                [np.fmax.reduce(c, axis=1) - np.fmin.reduce(c, axis=1) for c in block]
            )
        wide = np.nan_to_num(side).argmax(axis=1)
        rank = np.argsort(np.where(wide[:, None] == 0, *block), axis=1, kind="stable")
        order = np.take_along_axis(order, rank, axis=1)
        order = _split_in_halves(order)
    owner, radius = np.append(discs.owner, -1)[order], np.append(discs.radius, 0.0)[order]
    return _Leaves(x[order], y[order], owner, radius)


def _split_in_halves(order: IntArray) -> IntArray:
    """Rows (B, W) as (2 B, W / 2), with the same number of points in both halves of a row.

    Each row is sorted, with its -1 for missing points last.
    """
    blocks, width = order.shape
    filled = (order >= 0).sum(axis=1)
    left = (filled + 1) // 2
    place = np.arange(width // 2)
    first = np.where(place < left[:, None], place, width - 1)
    second = np.where(place < (filled - left)[:, None], left[:, None] + place, width - 1)
    halves = np.take_along_axis(order, np.concatenate([first, second], axis=1), axis=1)
    # Missing places are filled from the last column. If that holds a point, the row is full and
    # has no missing places.
    return halves.reshape(2 * blocks, width // 2)


def _measure_first_bound(leaves: _Leaves, wanted: int) -> FloatArray:
    """(M,) search radius of each leaf, mm: NaN for an empty leaf.

    It is the distance of the `wanted`-th nearest disc of another item within a block of leaves, or
    the width of the block if it has fewer.
    """
    width = min(_BLOCK, len(leaves.x)) * _LEAF
    place = min(wanted, width) - 1
    parts = []
    for begin in range(0, len(leaves.x), _LEAF_BATCH):
        batch = slice(begin, begin + _LEAF_BATCH)
        x = leaves.x[batch].reshape(-1, width)
        y = leaves.y[batch].reshape(-1, width)
        radius = leaves.radius[batch].reshape(-1, width)
        owner = leaves.owner[batch].reshape(-1, width)
        centres = np.sqrt(_squared_distances(x, x, y, y))
        distance = centres - radius[:, :, None] - radius[:, None]
        distance[(owner < 0)[:, None] | (owner[:, :, None] == owner[:, None])] = np.inf
        kth = np.partition(distance, place, axis=2)[:, :, place]
        is_alone = (kth == np.inf) & (owner >= 0)
        if is_alone.any():
            # The block has too few other items: search as far as the block is wide.
            width_mm = np.where((owner >= 0)[:, None], centres, 0.0).max(axis=2)
            kth[is_alone] = width_mm[is_alone]
        parts.append(np.where(owner >= 0, kth, np.nan).reshape(-1, _LEAF))
    reach: FloatArray = np.fmax.reduce(np.concatenate(parts), axis=1)
    return reach + _SAME_DISTANCE * np.abs(reach)


def _squared_distances(
    x: FloatArray, to_x: FloatArray, y: FloatArray, to_y: FloatArray
) -> FloatArray:
    """(B, N, M) squared distances of points x, y, (B, N) each, from to_x, to_y, (B, M) each."""
    across, up = x[:, :, None] - to_x[:, None], y[:, :, None] - to_y[:, None]
    across *= across
    up *= up
    across += up
    return across


def _find_leaf_pairs(leaves: _Leaves, reach: FloatArray) -> tuple[IntArray, IntArray]:
    """All pairs of a leaf and a leaf within its search radius.

    The tree is descended for all leaves at once.
    """
    # The box of an empty leaf is infinitely far away.
    is_empty, axes = leaves.owner < 0, (leaves.x, leaves.y)
    low = [np.where(is_empty, np.inf, axis).min(axis=1) for axis in axes]
    high = [np.where(is_empty, -np.inf, axis).max(axis=1) for axis in axes]
    radius = leaves.radius.max(axis=1)
    boxes = [(low, high, radius)]
    while len(boxes[-1][2]) > 1:
        lows, highs, radii = boxes[-1]
        lows = [np.minimum(axis[::2], axis[1::2]) for axis in lows]
        highs = [np.maximum(axis[::2], axis[1::2]) for axis in highs]
        boxes.append((lows, highs, np.maximum(radii[::2], radii[1::2])))
    leaf = np.flatnonzero(~np.isnan(reach))
    node = np.zeros(len(leaf), dtype=np.int64)
    for level in reversed(range(len(boxes))):
        lows, highs, radii = boxes[level]
        gaps = []
        for axis in (0, 1):
            node_gap = lows[axis][node] - high[axis][leaf]
            leaf_gap = low[axis][leaf] - highs[axis][node]
            gaps.append(np.maximum(np.maximum(node_gap, leaf_gap), 0.0))
        across, up = gaps
        close = np.sqrt(across * across + up * up) - radius[leaf] - radii[node] < reach[leaf]
        # A leaf is always compared with itself, so that items of a crowd at one point find some of
        # their neighbours.
        close |= node == leaf >> level
        leaf, node = leaf[close], node[close]
        if level:
            leaf = np.repeat(leaf, 2)
            node = np.repeat(2 * node, 2)
            node[1::2] += 1
    return leaf, node


def _find_item_pairs(
    leaves: _Leaves, first_leaf: IntArray, second_leaf: IntArray, reach: FloatArray, count: int
) -> list[tuple[IntArray, FloatArray]]:
    """Pairs of items within the search radius in these pairs of leaves, in batches.

    Each batch has the keys item * count + other, and the distances of their discs, mm.
    """
    radius = leaves.radius.max(axis=1)
    owners, radii = leaves.owner.reshape(-1), leaves.radius.reshape(-1)
    batches = []
    for begin in range(0, max(len(first_leaf), 1), _LEAF_PAIR_BATCH):
        one_leaf = first_leaf[begin : begin + _LEAF_PAIR_BATCH]
        other_leaf = second_leaf[begin : begin + _LEAF_PAIR_BATCH]
        square = _squared_distances(
            leaves.x[one_leaf], leaves.x[other_leaf], leaves.y[one_leaf], leaves.y[other_leaf]
        )
        # First all that may be within the radius, by the largest discs of both leaves. Comparisons
        # with the NaN of an empty place are false.
        wide = radius[one_leaf] + radius[other_leaf]
        limit = np.where(one_leaf == other_leaf, np.inf, reach[one_leaf])
        far = np.maximum(limit + wide, 0.0) + _ROUNDING * (np.abs(limit) + wide)
        close = np.flatnonzero(square <= (far * far)[:, None, None])
        pair, row = close // _LEAF**2, close // _LEAF
        first = one_leaf[pair] * _LEAF + (row - pair * _LEAF)
        second = other_leaf[pair] * _LEAF + (close - row * _LEAF)
        distance = np.sqrt(square.reshape(-1)[close])
        distance -= radii[first]
        distance -= radii[second]
        item, other = owners[first], owners[second]
        kept = np.flatnonzero((distance < limit[pair]) & (item != other))
        batches.append((item[kept] * count + other[kept], distance[kept]))
    return batches
