"""The best tour of a few items, each with several ways to run it, by dynamic programming over sets.

After M. Held and R. Karp ("A dynamic programming approach to sequencing problems", 1962), once from
the end and once from the beginning. So the best tour through each way of each item is known.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from msgspec import Struct

from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray


class StepCosts(Struct, frozen=True, eq=False):
    """The ways to run N items, P in all, and the costs of the steps between them.

    item: (P,) item of each way, 0 to N - 1 in increasing order.
    cost: (P, P) cost from the end of each way to the start of each other one. Only steps that the
        sets allow are read, see `find_steps`.
    out, back: (P,) cost from home to the start of each way, and from its end to home.
    """

    item: IntArray
    cost: FloatArray
    out: FloatArray
    back: FloatArray


class _Table(Struct, frozen=True, eq=False):
    """The sets of items, and which items may be last in each.

    sets: (S,) the sets, smaller ones first.
    place: row of each set, -1 for none.
    sizes: first row of each size.
    columns: ways of each item.
    last: (S, P) whether the item of the way may be the last one in the set.
    """

    sets: IntArray
    place: IntArray
    sizes: list[int]
    columns: list[slice]
    last: BoolArray


def find_best_through(
    costs: StepCosts, sets: IntArray, limit: float
) -> tuple[FloatArray, list[int], IntArray]:
    """Find the least cost of a tour through each way, the best tour, and the sets that remain.

    Returns the costs (P,), inf above `limit`; the ways of the best tour in order; and those of
    `sets` with which tours not above `limit` begin. At least one tour must not be above `limit`.

    sets: sets with which tours may begin, see `list_first_sets`.
    """
    table = _make_table(costs, sets)
    rest = _compute_rest(costs, table)
    begun = np.full(rest.shape, np.inf)
    for item, columns in enumerate(table.columns):
        alone = table.place[1 << item]
        if alone >= 0:
            out = costs.out[columns]
            begun[alone, columns] = np.where(out + rest[alone, columns] <= limit, out, np.inf)
    for low, high in pairwise(table.sizes[1:]):
        of_size = table.sets[low:high]
        for item, columns in enumerate(table.columns):
            before = np.where(of_size >> item & 1, table.place[of_size & ~(1 << item)], -1)
            rows, before = low + np.flatnonzero(before >= 0), before[before >= 0]
            last = np.flatnonzero(np.isfinite(begun[before]).any(axis=0))
            if not len(last):
                continue
            steps = costs.cost[last, columns].T.copy()
            begun[rows, columns] = _compute_least_sums(begun[np.ix_(before, last)], steps)
        begun[low:high][begun[low:high] + rest[low:high] > limit] = np.inf
    through = (begun + rest).min(axis=0)
    return through, _trace(costs, table, rest), table.sets[np.isfinite(begun).any(axis=1)]


def list_first_sets(needs: list[int]) -> IntArray:
    """All sets of items (bits) that may be run before the others.

    needs: set of items that must come before each item.
    """
    sets = np.arange(1, 1 << len(needs))
    for item, need in enumerate(needs):
        sets = sets[(sets >> item & 1 == 0) | (need & ~sets == 0)]
    return sets


def find_steps(sets: IntArray, count: int) -> BoolArray:
    """(count, count) whether tours that begin with these sets may step from one item to another."""
    steps = np.zeros((count, count), dtype=np.bool_)
    allowed = np.zeros(1 << count, dtype=np.bool_)
    allowed[[0, *sets.tolist()]] = True
    for item in range(count):
        ending = sets[(sets >> item & 1 == 1) & allowed[sets & ~(1 << item)]]
        for other in range(count):
            without = ending[ending >> other & 1 == 0]
            steps[item, other] = allowed[without | 1 << other].any()
    return steps


def _make_table(costs: StepCosts, sets: IntArray) -> _Table:
    count = int(costs.item[-1]) + 1
    items = np.arange(count)
    size = (sets[:, None] >> items & 1).sum(axis=1)
    sets = sets[np.lexsort((sets, size))]
    place = np.full(1 << count, -1)
    place[sets] = np.arange(len(sets))
    sizes = np.searchsorted(np.sort(size), np.arange(1, count + 2)).tolist()
    first = np.searchsorted(costs.item, np.arange(count + 1)).tolist()
    columns = list(map(slice, first[:-1], first[1:]))
    allowed = np.append(place, 0) >= 0
    before = sets[:, None] & ~(1 << items)
    last = (sets[:, None] >> items & 1 == 1) & ((before == 0) | allowed[before])
    return _Table(sets, place, sizes, columns, last[:, costs.item])


def _compute_rest(costs: StepCosts, table: _Table) -> FloatArray:
    """(S, P) least cost from each way, as the last one in a set, over all other items to home.

    It is inf if the way cannot be the last one.
    """
    rest = np.full(table.last.shape, np.inf)
    rest[-1] = np.where(table.last[-1], costs.back, np.inf)
    for low, high in reversed(list(pairwise(table.sizes[:-1]))):
        of_size = table.sets[low:high]
        for item, columns in enumerate(table.columns):
            after = np.where(of_size >> item & 1, -1, table.place[of_size | 1 << item])
            rows, after = low + np.flatnonzero(after >= 0), after[after >= 0]
            if not len(rows):
                continue
            last = np.flatnonzero(table.last[rows].any(axis=0))
            entries = np.ix_(rows, last)
            sums = _compute_least_sums(rest[after, columns], costs.cost[last, columns])
            rest[entries] = np.minimum(rest[entries], sums)
        rest[low:high][~table.last[low:high]] = np.inf
    return rest


def _compute_least_sums(first: FloatArray, second: FloatArray) -> FloatArray:
    """(R, W) the least of the sums of each row of `first` (R, V) and each of `second` (W, V)."""
    shortest = min(first.shape[1], len(first), len(second))
    if shortest == len(first):
        return np.stack([(row + second).min(axis=1) for row in first])
    if shortest == len(second):
        return np.stack([(first + row).min(axis=1) for row in second], axis=1)
    sums = np.full((len(first), len(second)), np.inf)
    for left, right in zip(first.T, second.T.copy(), strict=True):
        np.minimum(sums, left[:, None] + right, out=sums)
    return sums


def _trace(costs: StepCosts, table: _Table, rest: FloatArray) -> list[int]:
    """The ways of the best tour, in order."""
    tour: list[int] = []
    done, steps = 0, costs.out
    for _ in range(len(table.sizes) - 1):
        after = table.place[done | 1 << costs.item]
        is_next = (after >= 0) & (done >> costs.item & 1 == 0)
        cost = np.where(is_next, steps + rest[after, np.arange(len(after))], np.inf)
        tour.append(int(cost.argmin()))
        done |= 1 << int(costs.item[tour[-1]])
        steps = costs.cost[tour[-1]]
    return tour
