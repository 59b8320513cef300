"""Pairs points so that the distances within the pairs are short.

It decides between which odd nodes of a network a pen is lifted.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from camgen.geometry.nearest import Discs, IntArray, find_nearest_items
from camgen.model.pose import FloatArray

#: Points up to which the shortest pairing is computed. Its time doubles with each point.
_MOST_EXACT = 12
#: Nearest points of each point that are tried as its partner.
_NEAR_POINTS = 8
#: mm: an exchange must shorten the pairs by more than this, so that rounding cannot repeat it.
_LEAST_GAIN_MM = 1e-9


def pair_points(points: FloatArray) -> IntArray:
    """(N,) the partner of each of an even number of points (N, 2), mm.

    For up to 12 points the sum of the distances is the smallest possible. Beyond that the nearest
    two points are paired first, and then two pairs exchange points as long as that is shorter.
    """
    if len(points) <= _MOST_EXACT:
        return _pair_exactly(points)
    partner = _pair_nearest(points)
    _exchange_partners(points, partner)
    return partner


def _pair_exactly(points: FloatArray) -> IntArray:
    xy = points.tolist()

    @cache
    def pair_set(points_left: int) -> tuple[float, tuple[tuple[int, int], ...]]:
        """Length and pairs of the shortest pairing of the points whose bits are set."""
        if not points_left:
            return 0.0, ()
        a = (points_left & -points_left).bit_length() - 1
        others = points_left ^ (1 << a)
        options = []
        for b in range(a + 1, len(xy)):
            if others >> b & 1:
                length = math.dist(xy[a], xy[b]) + pair_set(others ^ (1 << b))[0]
                options.append((length, b))
        length, b = min(options)
        return length, ((a, b), *pair_set(others ^ (1 << b))[1])

    partner = np.full(len(xy), -1, dtype=np.int64)
    for a, b in pair_set((1 << len(xy)) - 1)[1]:
        partner[a], partner[b] = b, a
    return partner


def _pair_nearest(points: FloatArray) -> IntArray:
    """A pairing in which the nearest two unpaired points are paired first."""
    partner = np.full(len(points), -1, dtype=np.int64)
    unpaired = np.arange(len(points))
    # Each round pairs at least the nearest two of the unpaired points, and usually most of them.
    while len(unpaired):
        count = len(unpaired)
        discs = Discs(np.arange(count), points[unpaired], np.zeros(count))
        near = find_nearest_items(discs, count, _NEAR_POINTS)
        once = near.item < near.other
        a, b = unpaired[near.item[once]], unpaired[near.other[once]]
        order = np.lexsort((b, a, near.distance[once]))
        partners = partner.tolist()
        for i, j in zip(a[order].tolist(), b[order].tolist(), strict=True):
            if partners[i] < 0 and partners[j] < 0:
                partners[i], partners[j] = j, i
        partner = np.array(partners, dtype=np.int64)
        unpaired = unpaired[partner[unpaired] < 0]
    return partner


def _exchange_partners(points: FloatArray, partner: IntArray) -> None:
    """Replaces two pairs by two others as long as that is shorter. Changes `partner`.

    A point whose partner has changed is tried again.
    """
    count = len(points)
    near = find_nearest_items(Discs(np.arange(count), points, np.zeros(count)), count, _NEAR_POINTS)
    table = near.table(count, _NEAR_POINTS)[0].tolist()
    xy, mate = points.tolist(), partner.tolist()
    pending = list(range(count))
    while pending:
        a = pending.pop()
        b = mate[a]
        length = math.dist(xy[a], xy[b])
        for c in table[a]:
            if c < 0 or math.dist(xy[a], xy[c]) >= length:
                break
            d = mate[c]
            if c == b:
                continue
            old = length + math.dist(xy[c], xy[d])
            if math.dist(xy[a], xy[c]) + math.dist(xy[b], xy[d]) < old - _LEAST_GAIN_MM:
                mate[a], mate[c], mate[b], mate[d] = c, a, d, b
                pending += [d, c, b, a]
                break
    partner[:] = mate
