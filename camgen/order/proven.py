"""Tours of a few paths that are proven to be the best: what no order, direction and start can undercut, closed in on.

Closed paths are cut into stretches that may be entered anywhere. The best tour over stretches, each step as short as
two stretches allow, is below every tour; stretches through which no tour can be better than the known one are dropped,
the others cut finer, until what is left between the two is nothing that can be told.

A step charges each stretch for being left far along a direction and pays that back where the stretch is entered as far
(Lagrange): the direction is the mean of those in which the known tour comes and goes. So near the best tour, where it
cannot gain by moving along a path, a step loses only what is of second order in the length of a stretch.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import owners, ramp
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray
from camgen.model.tolerance import NONZERO
from camgen.order.search import (
    Choices,
    Sampled,
    ends_at,
    lengths,
    place_starts,
    point_at,
    polish_starts,
    real_length,
)
from camgen.order.solver.exact import Ways, best_through, find_steps, first_sets
from camgen.order.solver.kernel import BOTH_WAYS, CLOSED, ONE_WAY
from camgen.order.solver.plane import Start

__all__ = ["FEW", "improve_few", "is_proven"]

#: So many paths are solved: 2^n sets.
FEW = 12
#: Stretches of a closed path at first, into how many each is cut, how often, and the most sums of costs in all
#: sets of paths (as many sets at least), about 0.25 s.
_STRETCHES, _CUT, _ROUNDS, _MOST, _LEAST_WORK = 8, 2, 16, 1_000_000_000, 40
#: Orders that are closed in on one by one.
_ORDERS = 6
#: So often the starts of what was found are moved to their best places.
_POLISH = 3
#: The bound is near enough: so many mm, and such a part of the travel.
_NEAR, _NEAR_PART, _PROVEN = 1e-3, 4e-4, 5e-4
#: What roundings may add to the size of a stretch, of its length.
_ROUNDED = 1e-7


class _Stretches(Struct, frozen=True, eq=False):
    """Ways to run items, P in all: (P,) the item of each; low: mm along a closed path where its stretch begins, of
    others 1 for backwards; (P,) how long it is, mm along the starts.
    """

    item: IntArray
    low: FloatArray
    long: FloatArray

    def middle(self) -> FloatArray:
        return self.low + self.long / 2


class _Tour(Struct, frozen=True, eq=False):
    """order: of the items. along: by item, where it is entered, see ``lengths``. length: mm."""

    order: IntArray
    along: FloatArray
    length: float


class _Subproblem(Struct, frozen=True, eq=False):
    """One branch of the proof: the tours that begin with some sets and run through some stretches.

    sets: sets of items (bits) with which the tours begin.
    pieces: stretches through which the tours run.
    guide: a short tour of the branch.
    bound: lower bound of all tours, mm; of a branch of a single order the bound of that order.
    """

    sets: IntArray
    pieces: _Stretches
    guide: _Tour
    bound: float


class _Ellipses(Struct, frozen=True, eq=False):
    """The ellipse about its middle that encloses each of P stretches.

    enter, leave: (P, 2) points, mm; of a closed path both are the middle.
    along: (P, 2) unit vector of the first axis.
    half, wide: (P,) half of the first and of the second axis, mm.
    """

    enter: FloatArray
    leave: FloatArray
    along: FloatArray
    half: FloatArray
    wide: FloatArray

    def charge(self, rows: IntArray, towards: FloatArray) -> tuple[FloatArray, ...]:
        """Both axes of the ellipses ``rows``, and how far the ellipses reach in a direction.

        towards: (P, 2) the direction.

        Returns x, y and the component along ``towards`` of the first and of the second axis, and
        last the distance from the centre to the edge along ``towards``.
        """
        t, half, wide = self.along[rows], self.half[rows], self.wide[rows]
        x, y = towards[rows, 0], towards[rows, 1]
        along, across = (half * t[..., 0], half * t[..., 1]), (-wide * t[..., 1], wide * t[..., 0])
        one, two = along[0] * x + along[1] * y, across[0] * x + across[1] * y
        return (*along, one, *across, two, np.sqrt(one * one + two * two))


def improve_few(
    known: Sampled, start: Choices, home: tuple[float, float] | None
) -> tuple[Choices, float]:
    """The tour ``start`` or a shorter one; and what no tour is below, mm.

    home: x, y where it begins and ends, None: nowhere. 1 to FEW paths.
    """
    place = None if home is None else np.array(home)
    order, along = np.array(start.order), lengths(known, start)
    first = _Tour(order, along, _travel(known, order, along, place))
    family = _Subproblem(first_sets(_needs(known, order)), _whole(known), first, 0.0)
    best, family, left = _close_in(known, family, first, place, _MOST)
    bound, orders = family.bound, _orders(family.sets, len(order))
    if not _is_closed(best, bound) and len(orders) > 1:
        bounds = []
        for rank, one in enumerate(orders):
            # Prices suit one order: others that are as good are closed in on by themselves.
            own, share = (
                _settle(known, np.array(one), best.along, place),
                left // (len(orders) - rank),
            )
            best = _better(best, own)
            alone = _Subproblem(np.cumsum(1 << own.order), family.pieces, own, family.bound)
            best, alone, rest = _close_in(known, alone, best, place, share)
            left -= share - rest
            bounds.append(alone.bound)
        bound = min(bounds)
    return start if best is first else _choose(known, best), max(
        0.0, min(bound, best.length) * (1 - 1e-12) - 1e-9
    )


def _close_in(
    known: Sampled, family: _Subproblem, best: _Tour, home: FloatArray | None, work: int
) -> tuple[_Tour, _Subproblem, int]:
    """The best tour; what is left of the family, once it is closed in on or of a few orders; what is left of the work.

    A family whose tours all are above the best one has that one's length as its bound.
    """
    sets, pieces, guide, bound = family.sets, family.pieces, family.guide, family.bound
    loop, fresh = _loops(known), len(sets) > len(guide.order)
    for _ in range(_ROUNDS):
        ellipses = _make_ellipses(known, pieces)
        towards = _towards(known, ellipses, pieces.item, guide, home)
        ways = _ways(ellipses, pieces.item, find_steps(sets, len(loop)), towards, home)
        if fresh:
            sets, fresh = best_through(_by_item(ways), sets, best.length + _NEAR)[2], False
        through, tour, sets = best_through(ways, sets, best.length + _NEAR)
        bound = max(bound, min(float(through.min()), best.length))
        if not len(sets):
            break
        guide = _shorter(known, pieces, tour, guide, home)
        best = _better(best, guide)
        cut = _cut(pieces, through <= best.length + _NEAR, loop)
        work -= max(len(sets), _LEAST_WORK) * len(cut.item) ** 2
        if _is_closed(best, bound) or not loop.any() or work < 0:
            break
        pieces = cut
        if len(_orders(sets, len(loop))) > 1:
            break
    return best, _Subproblem(sets, pieces, guide, bound), max(work, 0)


def _shorter(
    known: Sampled, pieces: _Stretches, tour: list[int], guide: _Tour, home: FloatArray | None
) -> _Tour:
    """``guide``, or the ``tour`` through stretches, where that can be made shorter."""
    item, loop = pieces.item[tour], _loops(known)
    along = guide.along.copy()
    along[item] = np.where(loop[item], pieces.middle()[tour], pieces.low[tour])
    away = np.abs(along - guide.along)
    away = np.where(loop, np.minimum(away, known.whole - away), away)[item]
    if (item == guide.order).all() and (away <= pieces.long[tour]).all():
        return guide
    settled = _settle(known, item, along, home)
    return _better(guide, settled)


def _better(one: _Tour, other: _Tour) -> _Tour:
    """The shorter one, the first of those that are as good."""
    return other if other.length < one.length - _NEAR else one


def _orders(sets: IntArray, count: int) -> list[list[int]]:
    """The orders whose beginnings are all among the sets; none for more than ``_ORDERS``."""
    held = set(sets.tolist())
    orders: list[list[int]] = [[]]
    for _ in range(count):
        orders = [
            [*order, one]
            for order in orders
            for one in range(count)
            if one not in order and sum(1 << k for k in order) | 1 << one in held
        ]
        if len(orders) > _ORDERS:
            return []
    return orders


def _is_closed(best: _Tour, bound: float) -> bool:
    return best.length - bound <= max(_NEAR, _NEAR_PART * best.length)


def is_proven(travel: float, bound: float) -> bool:
    """Whether a tour is the best there is, to 0.05 % or 0.002 mm."""
    return travel - bound <= max(2 * _NEAR, _PROVEN * travel)


def _loops(known: Sampled) -> BoolArray:
    """Which paths may be entered anywhere."""
    return np.asarray((known.items.kind == CLOSED) & (np.diff(known.items.first) > 1))


def _needs(known: Sampled, order: IntArray) -> list[int]:
    """By item, the set of items that come before it: those inside, and all of a lower rank.

    Where every tour may be run backwards as well, the first one of ``order`` comes before its last one.
    """
    items = known.items
    needs = [
        sum(
            1 << int(k)
            for k in np.flatnonzero((items.parent == one) | (items.rank < items.rank[one]))
        )
        for one in range(len(order))
    ]
    if not any(needs) and (items.kind != ONE_WAY).all() and len(order) > 1:
        needs[int(order[-1])] |= 1 << int(order[0])
    return needs


def _whole(known: Sampled) -> _Stretches:
    """The first few stretches of closed paths, the directions of others."""
    loop = _loops(known)
    count = np.where(loop, _STRETCHES, np.where(known.items.kind == BOTH_WAYS, 2, 1))
    item, number = owners(count), ramp(count)
    long = np.where(loop, known.whole / _STRETCHES, 0.0)[item]
    return _Stretches(item, np.where(loop[item], number * long, number), long)


def _cut(pieces: _Stretches, kept: BoolArray, loop: BoolArray) -> _Stretches:
    """Those that are kept, of closed paths each in ``_CUT``."""
    count = np.where(loop[pieces.item[kept]], _CUT, 1)
    owner, number = np.flatnonzero(kept)[owners(count)], ramp(count)
    long = np.where(loop[pieces.item[owner]], pieces.long[owner] / _CUT, 0.0)
    return _Stretches(pieces.item[owner], pieces.low[owner] + number * long, long)


def _make_ellipses(known: Sampled, pieces: _Stretches) -> _Ellipses:
    """Of what runs from one end to the other no point is outside the ellipse about both that is as long as the way."""
    items, item, loop = known.items, pieces.item, _loops(known)
    back = ~loop[item] & (pieces.low > 0)
    first, last = items.points[items.first[:-1][item]], items.points[items.first[1:][item] - 1]
    enter, leave = (np.where(back[:, None], b, a) for a, b in ((first, last), (last, first)))
    half, wide, along = (
        np.zeros(len(item)),
        np.zeros(len(item)),
        np.tile([1.0, 0.0], (len(item), 1)),
    )
    own = np.flatnonzero(loop[item])
    low, high = pieces.low[own], pieces.low[own] + pieces.long[own]
    one, two = point_at(known, item[own], low), point_at(known, item[own], high)
    chord = two - one
    apart = np.sqrt((chord**2).sum(axis=1))
    way = real_length(known, item[own], low, high)
    half[own] = way * (0.5 + _ROUNDED)
    wide[own] = np.sqrt(np.maximum(half[own] ** 2 - (apart / 2) ** 2, 0.0))
    straight = apart > 0
    along[own[straight]] = chord[straight] / apart[straight, None]
    enter[own] = leave[own] = (one + two) / 2
    return _Ellipses(enter, leave, along, half, wide)


def _towards(
    known: Sampled, ellipses: _Ellipses, item: IntArray, tour: _Tour, home: FloatArray | None
) -> FloatArray:
    """(P, 2) the mean of the directions in which the tour comes to and leaves each stretch; 0 for open paths."""
    enter, leave = ends_at(known, tour.along)
    order, place = tour.order, np.argsort(tour.order)[item]
    nowhere = np.full((1, 2), np.nan) if home is None else home[None]
    before = np.concatenate([nowhere, leave[order]])[place]
    after = np.concatenate([enter[order], nowhere])[place + 1]
    towards: FloatArray = (_units(ellipses.enter - before) + _units(after - ellipses.leave)) / 2
    towards[ellipses.half == 0] = 0.0
    return towards


def _units(vectors: FloatArray) -> FloatArray:
    """Of length 1; 0 for 0 and for nan."""
    far = np.sqrt((vectors**2).sum(axis=-1, keepdims=True))
    return np.asarray(np.divide(vectors, far, out=np.zeros_like(vectors), where=far > 0))


def _ways(
    ellipses: _Ellipses,
    item: IntArray,
    steps: BoolArray,
    towards: FloatArray,
    home: FloatArray | None,
) -> Ways:
    """What each step costs at least, when every stretch is charged for how far along ``towards`` it is left."""
    charges = ellipses.charge(np.arange(len(item)), towards)
    enter, leave = ellipses.enter.T.copy(), ellipses.leave.T.copy()
    cost = np.zeros((len(item), len(item)))
    for number in range(len(steps)):
        others = np.flatnonzero(steps[number][item])
        if not len(others):
            continue
        first, last = np.searchsorted(item, (number, number + 1)).tolist()
        rows = slice(first, last)
        # Axis by axis, which numpy does in half the time.
        cost[rows, others] = _least(
            enter[0, others] - leave[0, rows, None],
            enter[1, others] - leave[1, rows, None],
            [
                tuple(charge[rows, None] for charge in charges),
                tuple(charge[others] for charge in charges),
            ],
        )
    if home is None:
        free = charges[-1]
        return Ways(item, cost, -free, -free)
    out_x, out_y = enter - home[:, None]
    back_x, back_y = home[:, None] - leave
    return Ways(item, cost, _least(out_x, out_y, [charges]), _least(back_x, back_y, [charges]))


def _least(x: FloatArray, y: FloatArray, charges: list[tuple[FloatArray, ...]]) -> FloatArray:
    """Costs of steps x, y mm between the middles of ellipses, with what both may take off."""
    found: FloatArray = np.sqrt(x * x + y * y)
    far = np.maximum(found, NONZERO)
    x, y = x / far, y / far
    floor = np.zeros(())
    for along_x, along_y, along_charged, across_x, across_y, across_charged, free in charges:
        along = x * along_x
        along += y * along_y
        along -= along_charged
        across = x * across_x
        across += y * across_y
        across -= across_charged
        along *= along
        across *= across
        along += across
        found -= np.sqrt(along, out=along)
        floor = floor - free
    np.maximum(found, floor, out=found)
    return found


def _by_item(ways: Ways) -> Ways:
    """One way for each item, each step as cheap as the cheapest of its ways."""
    first = np.searchsorted(ways.item, np.arange(int(ways.item[-1]) + 1))
    cost = np.minimum.reduceat(np.minimum.reduceat(ways.cost, first, axis=0), first, axis=1)
    return Ways(
        np.arange(len(first)),
        cost,
        np.minimum.reduceat(ways.out, first),
        np.minimum.reduceat(ways.back, first),
    )


def _travel(known: Sampled, order: IntArray, along: FloatArray, home: FloatArray | None) -> float:
    """Between the items, from and to home, mm."""
    enter, leave = ends_at(known, along)
    gaps = enter[order[1:]] - leave[order[:-1]]
    if home is not None:
        gaps = np.concatenate([gaps, [enter[order[0]] - home, leave[order[-1]] - home]])
    return float(np.sqrt((gaps**2).sum(axis=1)).sum())


def _settle(known: Sampled, order: IntArray, along: FloatArray, home: FloatArray | None) -> _Tour:
    """The tour in this order, the starts of closed items moved to their best places near ``along``."""
    loop, items = _loops(known), known.items
    back = ~loop & (along > 0)
    enter = np.where(back, items.first[1:] - 1, items.first[:-1])
    length = np.where(loop, along, 0.0)
    for _ in range(_POLISH):
        length = polish_starts(known, Start(order, enter), home, length)
    along = np.where(loop, length, along)
    return _Tour(order, along, _travel(known, order, along, home))


def _choose(known: Sampled, tour: _Tour) -> Choices:
    loop, along = _loops(known), tour.along
    row, fraction = place_starts(known, np.where(loop, along, 0.0))
    last = known.where.row[known.where.first[1:] - 1]
    row = np.where(loop, row, np.where(along > 0, last, 0))
    return Choices(tour.order.tolist(), row.tolist(), np.where(loop, fraction, 0.0).tolist())
