"""Points in pairs with little way between the two of each: where a pen is lifted between the odd ends of a network."""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from camgen.geometry.nearest import Discs, IntArray, nearest_items
from camgen.model.pose import FloatArray

__all__ = ["pair"]

#: Up to so many points the shortest pairing is found, beyond it a short one.
_MOST_EXACT = 12
#: Near points that are looked at.
_NEAR_POINTS = 8


def pair(points: FloatArray) -> IntArray:
    """(N,) the partner of each of an even number of points (N, 2): the sum of the distances is the least for up to 12.

    Beyond that the nearest two are taken first, then two pairs exchange their points as long as that is shorter.
    """
    if len(points) <= _MOST_EXACT:
        return _exact(points)
    partner = _greedy(points)
    _exchange(points, partner)
    return partner


def _exact(points: FloatArray) -> IntArray:
    xy = points.tolist()

    @cache
    def best(left: int) -> tuple[float, tuple[tuple[int, int], ...]]:
        """Of the points whose bits are set: the first one with each of the others."""
        if not left:
            return 0.0, ()
        a = (left & -left).bit_length() - 1
        rest = left ^ (1 << a)
        others = [b for b in range(a + 1, len(xy)) if rest >> b & 1]
        found = [(math.dist(xy[a], xy[b]) + best(rest ^ (1 << b))[0], b) for b in others]
        length, b = min(found)
        return length, ((a, b), *best(rest ^ (1 << b))[1])

    partner = np.full(len(xy), -1, dtype=np.int64)
    for a, b in best((1 << len(xy)) - 1)[1]:
        partner[a], partner[b] = b, a
    return partner


def _greedy(points: FloatArray) -> IntArray:
    partner = np.full(len(points), -1, dtype=np.int64)
    left = np.arange(len(points))
    # Each round pairs at least the nearest two of all that are left, usually most of them.
    while len(left):
        near = nearest_items(
            Discs(np.arange(len(left)), points[left], np.zeros(len(left))), len(left), _NEAR_POINTS
        )
        once = near.item < near.other
        a, b, apart = left[near.item[once]], left[near.other[once]], near.apart[once]
        order = np.lexsort((b, a, apart))
        taken = partner.tolist()
        for i, j in zip(a[order].tolist(), b[order].tolist(), strict=True):
            if taken[i] < 0 and taken[j] < 0:
                taken[i], taken[j] = j, i
        partner = np.array(taken, dtype=np.int64)
        left = left[partner[left] < 0]
    return partner


def _exchange(points: FloatArray, partner: IntArray) -> None:
    """Two pairs become two others while that is shorter, each point looked at again when its partner has changed."""
    count = len(points)
    near = nearest_items(Discs(np.arange(count), points, np.zeros(count)), count, _NEAR_POINTS)
    table = near.table(count, _NEAR_POINTS)[0].tolist()
    xy, mate = points.tolist(), partner.tolist()
    waits = list(range(count))
    while waits:
        a = waits.pop()
        b = mate[a]
        own = math.dist(xy[a], xy[b])
        for c in table[a]:
            if c < 0 or math.dist(xy[a], xy[c]) >= own:
                break
            d = mate[c]
            if c == b:
                continue
            old = own + math.dist(xy[c], xy[d])
            if math.dist(xy[a], xy[c]) + math.dist(xy[b], xy[d]) < old - 1e-9:
                mate[a], mate[c], mate[b], mate[d] = c, a, d, b
                waits += [d, c, b, a]
                break
    partner[:] = mate
