"""The best tour of a few items that may each be run in several ways, by dynamic programming over sets of items.

After M. Held and R. Karp ("A dynamic programming approach to sequencing problems", 1962), once from the end and once
from the beginning, so that for each way of each item the best tour through it is known.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct

from camgen.geometry.nearest import IntArray
from camgen.model.pose import FloatArray

__all__ = ["Ways", "best_through", "first_sets"]


class Ways(Struct, frozen=True, eq=False):
    """The ways to run N items. item: (P,) rising. enter, leave: (P, 2) mm. slack: (P,) mm, a way stands for all that
    begin and end no farther than that from its points.
    """

    item: IntArray
    enter: FloatArray
    leave: FloatArray
    slack: FloatArray


def best_through(
    ways: Ways, needs: list[int], sets: list[int], home: FloatArray | None, most: float
) -> tuple[FloatArray, list[int], list[int]]:
    """(P,) what no tour that runs an item this way is below, mm, inf for above ``most``; the ways of a tour that is as
    long as the least of these, but for the slack, in order; and the ``sets`` that tours not above ``most`` begin with.

    needs: by item, the set of items (bits) that must be run before it. sets: those that tours begin with, see
    ``first_sets``. home: x, y where it begins and ends, None: nowhere. most: -inf where the tour alone is asked
    for; else some tour must not be above it.
    """
    count = int(ways.item[-1]) + 1
    out, back = np.zeros(len(ways.item)), np.zeros(len(ways.item))
    if home is not None:
        out = np.maximum(np.sqrt(((ways.enter - home) ** 2).sum(axis=1)) - ways.slack, 0.0)
        back = np.maximum(np.sqrt(((ways.leave - home) ** 2).sum(axis=1)) - ways.slack, 0.0)
    own = [np.flatnonzero(ways.item == one) for one in range(count)]
    rest = _rest(ways, own, sets, back)
    through = np.full(len(ways.item), np.inf)
    begun: dict[int, FloatArray] = {}
    for done in sets:
        for one in range(count) if done in rest else ():
            before = done & ~(1 << one)
            if not done >> one & 1 or needs[one] & ~before or (before and before not in begun):
                continue
            here = own[one]
            cost = out[here]
            if before:
                left = np.flatnonzero(np.isfinite(begun[before]))
                cost = (begun[before][left, None] + _apart(ways, left, here)).min(axis=0)
            total = cost + rest[done][here]
            if total.min() <= most:
                begun.setdefault(done, np.full(len(ways.item), np.inf))[here] = np.where(total > most, np.inf, cost)
                through[here] = np.minimum(through[here], np.where(total > most, np.inf, total))
    return through, _follow(ways, own, rest, out), [one for one in sets if one in begun]


def _apart(ways: Ways, one: IntArray, two: IntArray) -> FloatArray:
    """(len(one), len(two)): from the end of each way to the beginning of each other, mm, no more than it may be."""
    dx = ways.leave[one, 0][:, None] - ways.enter[two, 0]
    dy = ways.leave[one, 1][:, None] - ways.enter[two, 1]
    least: FloatArray = np.sqrt(dx * dx + dy * dy) - ways.slack[one][:, None] - ways.slack[two]
    return np.maximum(least, 0.0, out=least)


def first_sets(needs: list[int]) -> list[int]:
    """All sets of items that may be run before the others, smaller numbers first: a set comes after its parts."""
    whole = 1 << len(needs)
    return [one for one in range(1, whole) if not any(one >> k & 1 and need & ~one for k, need in enumerate(needs))]


def _rest(ways: Ways, own: list[IntArray], sets: list[int], back: FloatArray) -> dict[int, FloatArray]:
    """By set of items that are run, (P,) the shortest way from each way of these over all others and home, else inf."""
    count, whole = len(own), (1 << len(own)) - 1
    rest: dict[int, FloatArray] = {whole: back}
    for done in reversed(sets[:-1]):
        following = [one for one in range(count) if not done >> one & 1 and done | 1 << one in rest]
        if not following:
            continue
        goals = np.concatenate([own[one] for one in following])
        ahead = np.concatenate([rest[done | 1 << one][own[one]] for one in following])
        here = np.flatnonzero(done >> ways.item & 1)
        found = np.full(len(ways.item), np.inf)
        found[here] = (_apart(ways, here, goals) + ahead).min(axis=1)
        rest[done] = found
    return rest


def _follow(ways: Ways, own: list[IntArray], rest: dict[int, FloatArray], out: FloatArray) -> list[int]:
    """The ways of the best tour, in order."""
    tour: list[int] = []
    done, steps = 0, out
    for _ in own:
        best, choice, chosen = math.inf, -1, -1
        for one, these in enumerate(own):
            if not done >> one & 1 and done | 1 << one in rest:
                cost = steps[these] + rest[done | 1 << one][these]
                least = int(cost.argmin())
                if float(cost[least]) < best:
                    best, choice, chosen = float(cost[least]), int(these[least]), one
        tour.append(choice)
        done |= 1 << chosen
        steps = _apart(ways, np.array([choice]), np.arange(len(ways.item)))[0]
    return tour
