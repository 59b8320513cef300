"""The nearest items of every item, exact, with numpy alone: a k-d tree of blocks, searched for all blocks at once."""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.ragged import ramp
from camgen.geometry.vectors import plane_lengths
from camgen.model.pose import FloatArray

__all__ = ["Discs", "Near", "nearest_items"]

IntArray = NDArray[np.int64]

#: Discs in a leaf; blocks of so many leaves give the first bound on how far to look.
_LEAF, _BLOCK = 8, 4
#: Pairs of discs looked at in one go.
_PAIRS = 500_000


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
        step = ramp(np.bincount(self.item, minlength=count))
        kept = step < width
        near = np.full((count, width), -1)
        apart = np.full((count, width), np.inf)
        near[self.item[kept], step[kept]] = self.other[kept]
        apart[self.item[kept], step[kept]] = self.apart[kept]
        return near, apart


def nearest_items(discs: Discs, count: int, wanted: int) -> Near:
    """About ``wanted`` nearest items of each of the ``count`` items: fewer only where ``sure`` says so.

    The distance of two items is that of their discs, 0 where these overlap. Where more than that many items are at the
    same distance, as at one point, some of them are listed: never all pairs of a crowd.
    """
    leaves = _leaves(discs.centre)
    reach = _first_bound(discs, leaves, wanted)
    one, two = _pairs_of_leaves(*_boxes(discs, leaves), reach)
    rows = []
    for begin in range(0, max(len(one), 1), _PAIRS // _LEAF**2):
        end = begin + _PAIRS // _LEAF**2
        rows.append(_pairs_of_items(discs, leaves, one[begin:end], two[begin:end], reach, count))
    key = np.concatenate([row[0] for row in rows])
    apart = np.concatenate([row[1] for row in rows])
    order = np.argsort(key)
    key, apart = key[order], apart[order]
    first = np.flatnonzero(np.concatenate([[True], key[1:] != key[:-1]])) if len(key) else np.zeros(0, dtype=np.int64)
    key, apart = key[first], np.minimum.reduceat(apart, first) if len(key) else apart
    item, other = key // count, key % count
    # By item, then by distance, then by the other one, as which they come.
    order = np.argsort(apart, kind="stable")
    order = order[_sort_stable(item[order])]
    sure = np.full(count, np.inf)
    shown = leaves >= 0
    np.minimum.at(sure, discs.owner[leaves[shown]], np.repeat(reach[:, None], _LEAF, axis=1)[shown])
    return Near(item[order], other[order], np.maximum(apart[order], 0.0), np.maximum(sure, 0.0))


def _sort_stable(number: IntArray) -> IntArray:
    """The stable order of whole numbers below 2^32, by 16 bits at a time, which numpy sorts by counting."""
    order = np.argsort((number & 0xFFFF).astype(np.uint16), kind="stable")
    return order[np.argsort((number[order] >> 16).astype(np.uint16), kind="stable")]


def _leaves(points: FloatArray) -> IntArray:
    """(M, _LEAF): the points in blocks that are halved along their longer side; M a power of two, -1 for no point."""
    count = len(points)
    levels = max(0, int(np.ceil(np.log2(max(count, 1) / _LEAF))))
    order = np.full((1, _LEAF << levels), -1)
    order[0, :count] = np.arange(count)
    padded = np.concatenate([points, [[np.nan, np.nan]]])
    for _ in range(levels):
        block = padded[order]
        with np.errstate(invalid="ignore"):
            # Each coordinate by itself: along an axis before one of two numbers numpy takes four times as long.
            x, y = np.ascontiguousarray(block[..., 0]), np.ascontiguousarray(block[..., 1])
            side = np.column_stack([np.fmax.reduce(c, axis=1) - np.fmin.reduce(c, axis=1) for c in (x, y)])
        wide = np.nan_to_num(side).argmax(axis=1)
        along = np.where(wide[:, None] == 0, x, y)
        rank = np.argsort(along, axis=1, kind="stable")
        order = np.take_along_axis(order, rank, axis=1)
        order = _halves(order)
    return order


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


def _first_bound(discs: Discs, leaves: IntArray, wanted: int) -> FloatArray:
    """(M,): so far at least must be looked from each leaf; the wanted-th distance within a block of leaves, NaN for
    an empty leaf.
    """
    blocks = leaves.reshape(-1, min(_BLOCK, len(leaves)) * _LEAF)
    reach = np.empty(blocks.shape)
    for begin in range(0, len(blocks), 256):
        part = blocks[begin : begin + 256]
        centre, radius, owner = discs.centre[part], discs.radius[part], discs.owner[part]
        apart = plane_lengths(centre[:, :, None] - centre[:, None])
        gap = apart - radius[:, :, None] - radius[:, None]
        none = (part < 0)[:, None, :] | (owner[:, :, None] == owner[:, None])
        gap[none] = np.inf
        place = min(wanted, gap.shape[2]) - 1
        kth = np.partition(gap, place, axis=2)[:, :, place]
        # Too few other items in the block: as far as the block is wide.
        wide = np.where((part >= 0)[:, None, :], apart, 0.0).max(axis=2)
        kth = np.where(np.isfinite(kth), kth, wide)
        reach[begin : begin + 256] = np.where(part >= 0, kth, np.nan)
    # A little more, so that on a grid all that are equally far are listed.
    found: FloatArray = np.fmax.reduce(reach.reshape(leaves.shape), axis=1)
    return found + 1e-9 * np.abs(found)


def _boxes(discs: Discs, leaves: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Corners (M, 2) of the boxes around the centres of each leaf, and its largest radius; an empty leaf is nowhere."""
    none = leaves < 0
    low = np.where(none[:, :, None], np.inf, discs.centre[leaves]).min(axis=1)
    high = np.where(none[:, :, None], -np.inf, discs.centre[leaves]).max(axis=1)
    return low, high, np.where(none, 0.0, discs.radius[leaves]).max(axis=1)


def _pairs_of_leaves(
    low: FloatArray, high: FloatArray, radius: FloatArray, reach: FloatArray
) -> tuple[IntArray, IntArray]:
    """All pairs of a leaf and a leaf within its reach, by descending the tree for all leaves at once."""
    lows, highs, radii = [low], [high], [radius]
    while len(lows[-1]) > 1:
        lows.append(lows[-1].reshape(-1, 2, 2).min(axis=1))
        highs.append(highs[-1].reshape(-1, 2, 2).max(axis=1))
        radii.append(radii[-1].reshape(-1, 2).max(axis=1))
    one = np.flatnonzero(~np.isnan(reach))
    two = np.zeros(len(one), dtype=np.int64)
    for level in reversed(range(len(lows))):
        gap = np.maximum(np.maximum(lows[level][two] - high[one], low[one] - highs[level][two]), 0.0)
        close = plane_lengths(gap) - radius[one] - radii[level][two] < reach[one]
        # A leaf is always compared with itself: of a crowd at one point some are near each other.
        close |= two == one >> level
        one, two = one[close], two[close]
        if level:
            one = np.repeat(one, 2)
            two = np.stack([2 * two, 2 * two + 1], axis=1).reshape(-1)
    return one, two


def _pairs_of_items(
    discs: Discs, leaves: IntArray, one: IntArray, two: IntArray, reach: FloatArray, count: int
) -> tuple[IntArray, FloatArray]:
    """Keys item * count + other and distances of the pairs within reach in these pairs of leaves."""
    # What is missing is nowhere: all comparisons with it fail.
    centre = np.where((leaves >= 0)[..., None], discs.centre[leaves], np.nan)
    radius = discs.radius[leaves]
    x, y = np.ascontiguousarray(centre[..., 0]), np.ascontiguousarray(centre[..., 1])
    apart, dy = (axis[one][:, :, None] - axis[two][:, None, :] for axis in (x, y))
    apart *= apart
    dy *= dy
    apart += dy
    np.sqrt(apart, out=apart)
    apart -= radius[one][:, :, None]
    apart -= radius[two][:, None, :]
    close = np.flatnonzero(apart < np.where(one == two, np.inf, reach[one])[:, None, None])
    pair, row = np.divmod(close, _LEAF**2)
    a, b = (discs.owner[leaves[of[pair], at]] for of, at in ((one, row // _LEAF), (two, row % _LEAF)))
    other = a != b
    return (a * count + b)[other], apart.reshape(-1)[close[other]]
