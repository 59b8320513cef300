"""The nearest items of every item, exact, with numpy alone: a k-d tree of blocks, searched for all blocks at once."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.ragged import begins, each_once, ramp, run_lengths, run_starts, starts_run
from camgen.model.pose import FloatArray

__all__ = ["Discs", "Near", "nearest_items"]

IntArray = NDArray[np.int64]

#: Discs in a leaf; blocks of so many leaves give the first bound on how far to look.
_LEAF, _BLOCK = 8, 4
#: Leaves, pairs of leaves, and pairs of items looked at in one go: so many that they stay in the cache.
_LEAVES, _PAIRS, _ROWS = 256, 1_000, 20_000
#: More than roundings change a distance, as a part of the lengths that it is worked out from.
_ROUNDED = 1e-9


class Discs(Struct, frozen=True, eq=False):
    """Items covered by discs. owner: (D,) the item. centre: (D, 2) mm. radius: (D,) mm."""

    owner: IntArray
    centre: FloatArray
    radius: FloatArray


class Near(Struct, frozen=True, eq=False):
    """Pairs of near items. item, other: (E,), sorted by item and distance. apart: (E,) mm, the least distance of
    their discs. sure: (N,) mm, every other item nearer than this is listed and its distance is exact; beyond it a pair
    may be missing, or two of its discs be nearer than it says.
    """

    item: IntArray
    other: IntArray
    apart: FloatArray
    sure: FloatArray

    def table(self, count: int, width: int) -> tuple[IntArray, FloatArray]:
        """(count, width): the nearest items of each, -1 where there are fewer, and how far they are (inf)."""
        counts, step = np.bincount(self.item, minlength=count)[:, None], np.arange(width)
        listed = step < counts
        row = (begins(counts[:, 0])[:, None] + step)[listed]
        near, apart = np.full((count, width), -1), np.full((count, width), np.inf)
        near[listed], apart[listed] = self.other[row], self.apart[row]
        return near, apart


class _Leaves(Struct, frozen=True, eq=False):
    """The discs in M leaves, (M, _LEAF) each: x, y mm, owner, radius mm; NaN, -1 and 0 for no disc."""

    x: FloatArray
    y: FloatArray
    owner: IntArray
    radius: FloatArray


def nearest_items(discs: Discs, count: int, wanted: int) -> Near:
    """About ``wanted`` nearest items of each of the ``count`` items: fewer only where ``sure`` says so.

    The distance of two items is that of their discs, 0 where these overlap. Where more than that many items are at the
    same distance, as at one point, some of them are listed: never all pairs of a crowd.
    """
    leaves = _leaves(discs)
    reach = _first_bound(leaves, wanted)
    rows = _pairs_of_items(leaves, *_pairs_of_leaves(leaves, reach), reach, count)
    key = np.concatenate([row[0] for row in rows])
    apart = np.concatenate([row[1] for row in rows])
    order = np.argsort(key)
    key, apart = key[order], apart[order]
    first = run_starts(key)
    key, apart = key[first], np.minimum.reduceat(apart, first) if len(key) else apart
    item, other = key // count, key % count
    order = _by_distance(item, apart)
    sure = np.full(count, np.inf)
    shown = leaves.owner >= 0
    np.minimum.at(sure, leaves.owner[shown], np.repeat(reach[:, None], _LEAF, axis=1)[shown])
    return Near(item, other[order], np.maximum(apart[order], 0.0), np.maximum(sure, 0.0))


def _by_distance(item: IntArray, apart: FloatArray) -> IntArray:
    """The order of pairs, sorted by ``item``, that sorts those of each item by distance; equal ones stay as they are.

    One number holds the item, the rank of the distance and the place: numpy sorts such numbers faster than it finds
    a stable order.
    """
    order = np.arange(len(item))
    # Some at a time, of whole items.
    cuts = each_once(np.searchsorted(item, item[::_ROWS])).tolist()
    for begin, end in pairwise([*cuts, len(item)]):
        rising = np.argsort(apart[begin:end])
        distances = apart[begin:end][rising]
        rank = np.empty(end - begin, dtype=np.int64)
        rank[rising] = np.cumsum(starts_run(distances)) - 1
        counts = run_lengths(item[begin:end])
        first, most = np.repeat(begins(counts), counts), int(counts.max())
        number = (first * len(rank) + rank) * most + ramp(counts)
        number.sort()
        order[begin:end] = begin + first + number % most
    return order


def _leaves(discs: Discs) -> _Leaves:
    """The discs in blocks that are halved along their longer side; M is a power of two."""
    count = len(discs.owner)
    levels = max(0, int(np.ceil(np.log2(max(count, 1) / _LEAF))))
    order = np.full((1, _LEAF << levels), -1)
    order[0, :count] = np.arange(count)
    # Each coordinate by itself: along an axis before one of two numbers numpy takes four times as long.
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
        order = _halves(order)
    return _Leaves(
        x[order], y[order], np.append(discs.owner, -1)[order], np.append(discs.radius, 0.0)[order]
    )


def _halves(order: IntArray) -> IntArray:
    """Sorted rows (B, W), the missing ones last, as (2 B, W / 2) with the same number of points in both halves."""
    blocks, width = order.shape
    there = (order >= 0).sum(axis=1)
    left = (there + 1) // 2
    place = np.arange(width // 2)
    first = np.where(place < left[:, None], place, width - 1)
    second = np.where(place < (there - left)[:, None], left[:, None] + place, width - 1)
    halves = np.take_along_axis(order, np.concatenate([first, second], axis=1), axis=1)
    # The last column holds a point only where the row is full, and then nothing is filled up with it.
    return halves.reshape(2 * blocks, width // 2)


def _first_bound(leaves: _Leaves, wanted: int) -> FloatArray:
    """(M,): so far at least must be looked from each leaf; the wanted-th distance within a block of leaves, NaN for
    an empty leaf.
    """
    width = min(_BLOCK, len(leaves.x)) * _LEAF
    place = min(wanted, width) - 1
    found = []
    for begin in range(0, len(leaves.x), _LEAVES):
        part = slice(begin, begin + _LEAVES)
        x, y, radius = (
            column[part].reshape(-1, width) for column in (leaves.x, leaves.y, leaves.radius)
        )
        owner = leaves.owner[part].reshape(-1, width)
        apart = np.sqrt(_squares(x, x, y, y))
        gap = apart - radius[:, :, None] - radius[:, None]
        gap[(owner < 0)[:, None] | (owner[:, :, None] == owner[:, None])] = np.inf
        kth = np.partition(gap, place, axis=2)[:, :, place]
        alone = (kth == np.inf) & (owner >= 0)
        if alone.any():
            # Too few other items in the block: as far as the block is wide.
            kth[alone] = np.where((owner >= 0)[:, None], apart, 0.0).max(axis=2)[alone]
        found.append(np.where(owner >= 0, kth, np.nan).reshape(-1, _LEAF))
    # A little more, so that on a grid all that are equally far are listed.
    reach: FloatArray = np.fmax.reduce(np.concatenate(found), axis=1)
    return reach + 1e-9 * np.abs(reach)


def _squares(x: FloatArray, to_x: FloatArray, y: FloatArray, to_y: FloatArray) -> FloatArray:
    """(B, N, M) the squared distances of points x, y, (B, N) each, from points to_x, to_y, (B, M) each."""
    across, up = x[:, :, None] - to_x[:, None], y[:, :, None] - to_y[:, None]
    across *= across
    up *= up
    across += up
    return across


def _pairs_of_leaves(leaves: _Leaves, reach: FloatArray) -> tuple[IntArray, IntArray]:
    """All pairs of a leaf and a leaf within its reach, by descending the tree for all leaves at once."""
    # An empty leaf is nowhere.
    none, axes = leaves.owner < 0, (leaves.x, leaves.y)
    low = [np.where(none, np.inf, axis).min(axis=1) for axis in axes]
    high = [np.where(none, -np.inf, axis).max(axis=1) for axis in axes]
    radius = leaves.radius.max(axis=1)
    boxes = [(low, high, radius)]
    while len(boxes[-1][2]) > 1:
        lows, highs, radii = boxes[-1]
        lows = [np.minimum(axis[::2], axis[1::2]) for axis in lows]
        highs = [np.maximum(axis[::2], axis[1::2]) for axis in highs]
        boxes.append((lows, highs, np.maximum(radii[::2], radii[1::2])))
    one = np.flatnonzero(~np.isnan(reach))
    two = np.zeros(len(one), dtype=np.int64)
    for level in reversed(range(len(boxes))):
        lows, highs, radii = boxes[level]
        across, up = (
            np.maximum(
                np.maximum(lows[axis][two] - high[axis][one], low[axis][one] - highs[axis][two]),
                0.0,
            )
            for axis in (0, 1)
        )
        close = np.sqrt(across * across + up * up) - radius[one] - radii[two] < reach[one]
        # A leaf is always compared with itself: of a crowd at one point some are near each other.
        close |= two == one >> level
        one, two = one[close], two[close]
        if level:
            one = np.repeat(one, 2)
            two = np.repeat(2 * two, 2)
            two[1::2] += 1
    return one, two


def _pairs_of_items(
    leaves: _Leaves, ones: IntArray, twos: IntArray, reach: FloatArray, count: int
) -> list[tuple[IntArray, FloatArray]]:
    """Keys item * count + other and distances of the pairs within reach in these pairs of leaves, in some parts."""
    radius = leaves.radius.max(axis=1)
    found = []
    for begin in range(0, max(len(ones), 1), _PAIRS):
        one, two = ones[begin : begin + _PAIRS], twos[begin : begin + _PAIRS]
        square = _squares(leaves.x[one], leaves.x[two], leaves.y[one], leaves.y[two])
        # First all that may be within reach, by the largest discs of both; comparisons with what is missing fail.
        wide, limit = radius[one] + radius[two], np.where(one == two, np.inf, reach[one])
        far = np.maximum(limit + wide, 0.0) + _ROUNDED * (np.abs(limit) + wide)
        close = np.flatnonzero(square <= (far * far)[:, None, None])
        pair, row = close // _LEAF**2, close // _LEAF
        first, second = (
            one[pair] * _LEAF + (row - pair * _LEAF),
            two[pair] * _LEAF + (close - row * _LEAF),
        )
        apart = np.sqrt(square.reshape(-1)[close])
        apart -= leaves.radius.reshape(-1)[first]
        apart -= leaves.radius.reshape(-1)[second]
        a, b = leaves.owner.reshape(-1)[first], leaves.owner.reshape(-1)[second]
        kept = np.flatnonzero((apart < limit[pair]) & (a != b))
        found.append((a[kept] * count + b[kept], apart[kept]))
    return found
