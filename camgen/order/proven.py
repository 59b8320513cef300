"""Tours of a few paths that are proven to be the best: what no order, direction and start can undercut, closed in on.

Closed paths are cut into stretches that may be entered anywhere. The best tour over stretches, each way as short as two
stretches allow, is below every tour; stretches through which no tour can be better than the known one are dropped,
the others cut finer, until what is left between the two is nothing that can be told.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from camgen.model.pose import FloatArray
from camgen.order.search import Choices, Sampled, place_starts, point_at, polish_starts
from camgen.order.solver.exact import Ways, best_through, first_sets
from camgen.order.solver.kernel import BOTH_WAYS, CLOSED
from camgen.order.solver.plane import Start
from camgen.order.starts import IntArray

BoolArray = NDArray[np.bool_]

__all__ = ["FEW", "improve_few", "is_proven", "solve_samples"]

#: So many paths are solved: 2^n sets.
FEW = 12
#: Stretches of a closed path at first, into how many each is cut, how often, and the most pairs of them
#: in all sets of paths, about 0.5 s.
_STRETCHES, _CUT, _ROUNDS, _MOST = 10, 3, 12, 150_000_000
#: Starts of a closed path where that proves too much.
_STARTS = 16
#: So often the starts of what was found are moved to their best places.
_POLISH = 3
#: The bound is near enough: so many mm, and such a part of the travel.
_NEAR, _NEAR_PART, _PROVEN = 1e-3, 4e-4, 5e-4


def improve_few(known: Sampled, home: tuple[float, float] | None, travel: float) -> tuple[Choices | None, float]:
    """A tour shorter than ``travel``, mm, None if none is found; and what no tour is below, mm.

    home: x, y where it begins and ends, None: nowhere. 1 to FEW paths.
    """
    items, place = known.items, None if home is None else np.array(home)
    needs = _needs(items.parent, items.rank)
    loop = (items.kind == CLOSED) & (np.diff(items.first) > 1)
    # Between two starts may lie a corner that is none.
    skipped = np.where(loop, (items.step - known.step) / 2, 0.0)
    item = np.repeat(np.arange(len(loop)), np.where(loop, _STRETCHES, np.where(items.kind == BOTH_WAYS, 2, 1)))
    number = np.arange(len(item)) - np.searchsorted(item, item)
    wide = np.where(loop, known.whole / _STRETCHES, 0.0)
    middle = np.where(loop[item], (number + 0.5) * wide[item], number)
    sets = first_sets(needs)
    best: Choices | None = None
    bound, least = 0.0, travel
    for _ in range(_ROUNDS):
        ways = _ways(known, item, middle, loop, np.where(loop, wide / 2 + skipped, 0.0))
        through, tour, sets = best_through(ways, needs, sets, place, least + _NEAR)
        length = _length(ways, tour, place)
        if length < least - _NEAR:
            least, best = length, _choose(known, place, item[tour], middle[tour])
        bound = max(bound, min(float(through.min()), least))
        kept = through <= least + _NEAR
        more = np.where(loop[item[kept]], _CUT, 1)
        if (
            least - bound <= max(_NEAR, _NEAR_PART * least)
            or len(sets) * int(more.sum()) ** 2 > _MOST
            or not loop.any()
        ):
            break
        step = np.tile(np.arange(_CUT), int(kept.sum()))
        inside = step < np.repeat(more, _CUT)
        owner, step = np.repeat(item[kept], _CUT)[inside], step[inside]
        centre = np.repeat(middle[kept], _CUT)[inside]
        wide = wide / _CUT
        middle = np.where(loop[owner], centre + (step - (_CUT - 1) / 2) * wide[owner], centre)
        item = owner
    return best, max(0.0, bound * (1 - 1e-12) - 1e-9)


def is_proven(travel: float, bound: float) -> bool:
    """Whether a tour is the best there is, to 0.05 % or 0.002 mm."""
    return travel - bound <= max(2 * _NEAR, _PROVEN * travel)


def solve_samples(known: Sampled, home: tuple[float, float] | None) -> tuple[Choices, int]:
    """The best of all tours that enter closed paths at one of so many starts, evenly along each; how many these are."""
    items, place = known.items, None if home is None else np.array(home)
    needs = _needs(items.parent, items.rank)
    loop = (items.kind == CLOSED) & (np.diff(items.first) > 1)
    item = np.repeat(np.arange(len(loop)), np.where(loop, _STARTS, np.where(items.kind == BOTH_WAYS, 2, 1)))
    number = np.arange(len(item)) - np.searchsorted(item, item)
    middle = np.where(loop[item], number * known.whole[item] / _STARTS, number)
    ways = _ways(known, item, middle, loop, np.zeros(len(loop)))
    _, tour, _ = best_through(ways, needs, first_sets(needs), place, -np.inf)
    return _choose(known, place, item[tour], middle[tour]), _STARTS


def _needs(parent: IntArray, rank: IntArray) -> list[int]:
    """By item, the set of items that come before it: those inside, and all of a lower rank."""
    return [
        sum(1 << int(k) for k in np.flatnonzero((parent == one) | (rank < rank[one]))) for one in range(len(parent))
    ]


def _ways(known: Sampled, item: IntArray, middle: FloatArray, loop: BoolArray, slack: FloatArray) -> Ways:
    """middle: of a closed path mm along it, of others 1 for backwards."""
    items = known.items
    first, last = items.first[:-1][item], items.first[1:][item] - 1
    back = middle > 0.5
    enter = items.points[np.where(back & ~loop[item], last, first)]
    leave = items.points[np.where(back & ~loop[item], first, last)]
    inside = loop[item]
    enter[inside] = leave[inside] = point_at(known, item[inside], middle[inside])
    return Ways(item, enter, leave, slack[item])


def _length(ways: Ways, tour: list[int], home: FloatArray | None) -> float:
    """Of the tour through the points of the ways, mm."""
    enter, leave = ways.enter[tour], ways.leave[tour]
    gaps = enter[1:] - leave[:-1]
    if home is not None:
        gaps = np.concatenate([gaps, enter[:1] - home, leave[-1:] - home])
    return float(np.sqrt((gaps**2).sum(axis=1)).sum())


def _choose(known: Sampled, home: FloatArray | None, order: IntArray, middle: FloatArray) -> Choices:
    """The tour of these ways, the starts of closed paths moved to their best places."""
    items = known.items
    loop = (items.kind == CLOSED) & (np.diff(items.first) > 1)
    along = np.zeros(len(order))
    along[order] = middle
    length = np.where(loop, along, 0.0)
    back = ~loop & (along > 0)
    enter = np.where(back, items.first[1:] - 1, items.first[:-1])
    for _ in range(_POLISH):
        length = polish_starts(known, Start(order, enter), home, length)
    row, fraction = place_starts(known, length)
    last = known.where.row[known.where.first[1:] - 1]
    row = np.where(loop, row, np.where(back, last, 0))
    return Choices(order.tolist(), row.tolist(), np.where(loop, fraction, 0.0).tolist())
