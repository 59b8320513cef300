"""The best tour of a few items that may each be run in several ways, by dynamic programming over sets of items.

After M. Held and R. Karp ("A dynamic programming approach to sequencing problems", 1962), once from the end and once
from the beginning, so that for each way of each item the best tour through it is known.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from msgspec import Struct

from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray

__all__ = ["Ways", "best_through", "find_steps", "first_sets"]


class Ways(Struct, frozen=True, eq=False):
    """The ways to run N items, P in all, and what each step between them costs.

    item: (P,) rising, each of 0 to N - 1. cost: (P, P) from the end of each way to the beginning of each other one;
    only that of steps that the sets allow, see ``find_steps``, is looked at.
    out, back: (P,) from home to the beginning of each, and from its end home.
    """

    item: IntArray
    cost: FloatArray
    out: FloatArray
    back: FloatArray


class _Table(Struct, frozen=True, eq=False):
    """sets: (S,) smaller ones first. place: by set, its row among these, -1 for none. sizes: where each size begins.

    has: (S, P) whether the item of the way is in the set.
    """

    sets: IntArray
    place: IntArray
    sizes: list[int]
    columns: list[slice]
    last: BoolArray


def best_through(ways: Ways, sets: IntArray, most: float) -> tuple[FloatArray, list[int], IntArray]:
    """(P,) what no tour that runs an item this way costs less than, inf for above ``most``; the ways of a tour that
    costs the least, in order; and the ``sets`` that tours not above ``most`` begin with.

    sets: those that tours may begin with, see ``first_sets``. Some tour must not be above ``most``.
    """
    table = _table(ways, sets)
    rest = _rest(ways, table)
    begun = np.full(rest.shape, np.inf)
    for one, own in enumerate(table.columns):
        alone = table.place[1 << one]
        if alone >= 0:
            begun[alone, own] = np.where(
                ways.out[own] + rest[alone, own] <= most, ways.out[own], np.inf
            )
    for size in range(2, len(table.sizes)):
        low, high = table.sizes[size - 1], table.sizes[size]
        for one, own in enumerate(table.columns):
            before = np.where(
                table.sets[low:high] >> one & 1, table.place[table.sets[low:high] & ~(1 << one)], -1
            )
            rows, before = low + np.flatnonzero(before >= 0), before[before >= 0]
            last = np.flatnonzero(np.isfinite(begun[before]).any(axis=0))
            if not len(last):
                continue
            begun[rows, own] = _least_sums(
                begun[np.ix_(before, last)], ways.cost[last, own].T.copy()
            )
        begun[low:high][begun[low:high] + rest[low:high] > most] = np.inf
    through = (begun + rest).min(axis=0)
    return through, _follow(ways, table, rest), table.sets[np.isfinite(begun).any(axis=1)]


def first_sets(needs: list[int]) -> IntArray:
    """All sets of items (bits) that may be run before the others. needs: by item, the set that must come before it."""
    sets = np.arange(1, 1 << len(needs))
    for one, need in enumerate(needs):
        sets = sets[(sets >> one & 1 == 0) | (need & ~sets == 0)]
    return sets


def find_steps(sets: IntArray, count: int) -> BoolArray:
    """(count, count) from which item a tour that begins with these sets may go on to which other one."""
    steps = np.zeros((count, count), dtype=np.bool_)
    held = np.zeros(1 << count, dtype=np.bool_)
    held[[0, *sets.tolist()]] = True
    for one in range(count):
        last = sets[(sets >> one & 1 == 1) & held[sets & ~(1 << one)]]
        for other in range(count):
            free = last[last >> other & 1 == 0]
            steps[one, other] = held[free | 1 << other].any()
    return steps


def _table(ways: Ways, sets: IntArray) -> _Table:
    count = int(ways.item[-1]) + 1
    size = sum((sets >> one & 1 for one in range(count)), np.zeros(len(sets), dtype=np.int64))
    sets = sets[np.lexsort((sets, size))]
    place = np.full(1 << count, -1)
    place[sets] = np.arange(len(sets))
    sizes = np.searchsorted(np.sort(size), np.arange(1, count + 2)).tolist()
    first = np.searchsorted(ways.item, np.arange(count + 1)).tolist()
    columns = [slice(a, b) for a, b in pairwise(first)]
    held = np.append(place, 0) >= 0
    before = sets[:, None] & ~(1 << np.arange(count))
    last = (sets[:, None] >> np.arange(count) & 1 == 1) & ((before == 0) | held[before])
    return _Table(sets, place, sizes, columns, last[:, ways.item])


def _rest(ways: Ways, table: _Table) -> FloatArray:
    """(S, P) the least cost from each way that may be the last one in the set over all others and home, else inf."""
    rest = np.full(table.last.shape, np.inf)
    rest[-1] = np.where(table.last[-1], ways.back, np.inf)
    for size in range(len(table.sizes) - 2, 0, -1):
        low, high = table.sizes[size - 1], table.sizes[size]
        for one, own in enumerate(table.columns):
            after = np.where(
                table.sets[low:high] >> one & 1, -1, table.place[table.sets[low:high] | 1 << one]
            )
            rows, after = low + np.flatnonzero(after >= 0), after[after >= 0]
            if not len(rows):
                continue
            here = np.flatnonzero(table.last[rows].any(axis=0))
            found = np.ix_(rows, here)
            rest[found] = np.minimum(
                rest[found], _least_sums(rest[after, own], ways.cost[here, own])
            )
        rest[low:high][~table.last[low:high]] = np.inf
    return rest


def _least_sums(one: FloatArray, two: FloatArray) -> FloatArray:
    """(R, W) the least of the sums of each row of ``one`` (R, V) and each of ``two`` (W, V)."""
    shortest = min(one.shape[1], len(one), len(two))
    if shortest == len(one):
        return np.stack([(row + two).min(axis=1) for row in one])
    if shortest == len(two):
        return np.stack([(one + row).min(axis=1) for row in two], axis=1)
    found = np.full((len(one), len(two)), np.inf)
    for left, right in zip(one.T, two.T.copy(), strict=True):
        np.minimum(found, left[:, None] + right, out=found)
    return found


def _follow(ways: Ways, table: _Table, rest: FloatArray) -> list[int]:
    """The ways of the best tour, in order."""
    tour: list[int] = []
    done, steps = 0, ways.out
    for _ in range(len(table.sizes) - 1):
        after = table.place[done | 1 << ways.item]
        cost = np.where(
            (after >= 0) & (done >> ways.item & 1 == 0),
            steps + rest[after, np.arange(len(after))],
            np.inf,
        )
        tour.append(int(cost.argmin()))
        done |= 1 << int(ways.item[tour[-1]])
        steps = ways.cost[tour[-1]]
    return tour
