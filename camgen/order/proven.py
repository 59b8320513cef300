"""Proves that the tour of a few paths is the shortest one, or shortens it, and gives a lower bound.

A closed path is divided into sections, in any point of which the tool may enter. The shortest tour
over sections (dynamic programming over sets of paths), with each link as short as its two sections
allow, is a lower bound for all tours. Sections that no tour shorter than the known one can use are
dropped, the others are halved. The search ends when tour and bound differ by at most 0.001 mm or
0.04 % of the travel, or when its budget is used up.

The cost of a link includes a charge for each section (Lagrange): how far along a direction the path
is left there. It is paid back where the section is entered. The direction is the mean of those in
which the known tour enters and leaves the section. So near the best tour, which cannot gain by
moving a start along its path, a link loses only a part of second order in the length of a section.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import list_owners, number_rows
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray
from camgen.model.tolerance import NONZERO
from camgen.order.search import (
    Choices,
    Sampled,
    compute_ends,
    compute_points,
    make_choices,
    measure_sections,
    measure_starts,
    polish_starts,
)
from camgen.order.solver.exact import StepCosts, find_best_through, find_steps, list_first_sets
from camgen.order.solver.kernel import BOTH_WAYS, CLOSED, ONE_WAY
from camgen.order.solver.plane import Start

#: Maximum number of paths: the proof needs up to 2^n sets.
MAX_PROVEN_PATHS = 12
#: Sections of a closed path at first.
_FIRST_SECTIONS = 8
#: Sections into which a section is divided.
_PARTS = 2
#: Maximum number of rounds of division.
_ROUNDS = 16
#: Budget: sums of costs over all sets of paths, about 0.25 s.
_BUDGET = 1_000_000_000
#: Minimum number of sets that a round counts for.
_MIN_SETS = 40
#: Maximum number of orders that are examined one by one.
_MAX_ORDERS = 6
#: Number of times that the starts of a tour are moved to their best points.
_POLISH_ROUNDS = 3
#: mm: gap between tour and bound at which the search ends; also the least gain of a new tour.
_GAP_MM = 1e-3
#: The same as a fraction of the travel.
_GAP_FRACTION = 4e-4
#: Fraction of the travel up to which a tour counts as proven.
_PROVEN_FRACTION = 5e-4
#: Fraction of the length of a section by which rounding may enlarge it.
_ROUNDING = 1e-7


class _Sections(Struct, frozen=True, eq=False):
    """Ways to run the items, P in all: sections of closed paths, directions of open ones.

    item: (P,) item of each.
    low: (P,) position along a closed path at which the section begins, mm; 1 for a reversed open
        path, else 0.
    size: (P,) length of the section along the starts, mm; 0 for an open path.
    """

    item: IntArray
    low: FloatArray
    size: FloatArray

    def middle(self) -> FloatArray:
        return self.low + self.size / 2


class _Tour(Struct, frozen=True, eq=False):
    """A tour.

    order: order of the items.
    along: result of `measure_starts`, position at which each item is entered.
    length: length of its links, mm.
    """

    order: IntArray
    along: FloatArray
    length: float


class _Subproblem(Struct, frozen=True, eq=False):
    """One branch of the proof: the tours that begin with some sets and use some sections.

    sets: sets of items (bits) with which the tours begin.
    sections: sections that the tours use.
    guide: a short tour of the branch.
    bound: lower bound of all tours, mm; for a branch of a single order the bound of that order.
    """

    sets: IntArray
    sections: _Sections
    guide: _Tour
    bound: float


class _Ellipses(Struct, frozen=True, eq=False):
    """The ellipse about its middle that encloses each of P sections.

    enter, leave: (P, 2) points, mm; for a closed path both are the middle.
    axis: (P, 2) unit vector of the first axis.
    half, width: (P,) half of the first and of the second axis, mm.
    """

    enter: FloatArray
    leave: FloatArray
    axis: FloatArray
    half: FloatArray
    width: FloatArray

    def charge(self, towards: FloatArray) -> tuple[FloatArray, ...]:
        """Both axes of the ellipses, and how far the ellipses extend in a direction.

        towards: (P, 2) the direction.

        Returns x, y and the component along `towards` of the first and of the second axis, and
        last the distance from the centre to the edge along `towards`.
        """
        t, half, width = self.axis, self.half, self.width
        x, y = towards[:, 0], towards[:, 1]
        along, across = (half * t[:, 0], half * t[:, 1]), (-width * t[:, 1], width * t[:, 0])
        first, second = along[0] * x + along[1] * y, across[0] * x + across[1] * y
        edge = np.sqrt(first * first + second * second)
        return (*along, first, *across, second, edge)


def improve_few(
    known: Sampled, start: Choices, home: tuple[float, float] | None
) -> tuple[Choices, float]:
    """The tour `start` or a shorter one, and a lower bound of all tours, mm.

    home: x, y where tours begin and end; None for nowhere. There are 1 to `MAX_PROVEN_PATHS` paths.
    """
    point = None if home is None else np.array(home)
    order, along = np.array(start.order), measure_starts(known, start)
    first = _Tour(order, along, _measure_travel(known, order, along, point))
    sets, sections = list_first_sets(_find_precedence(known, order)), _make_first_sections(known)
    whole = _Subproblem(sets, sections, first, 0.0)
    best, whole, budget = _narrow(known, whole, first, point, _BUDGET)
    bound, orders = whole.bound, _list_orders(whole.sets, len(order))
    if not _is_closed(best, bound) and len(orders) > 1:
        bounds = []
        for rank, items in enumerate(orders):
            # The charges suit one order, so other orders that are as good are examined alone.
            guide = _polish_tour(known, np.array(items), best.along, point)
            share = budget // (len(orders) - rank)
            best = _choose_shorter(best, guide)
            branch = _Subproblem(np.cumsum(1 << guide.order), whole.sections, guide, whole.bound)
            best, branch, unused = _narrow(known, branch, best, point, share)
            budget -= share - unused
            bounds.append(branch.bound)
        bound = min(bounds)
    # Rounding of the sums must not lift the bound above the best tour.
    bound = max(0.0, min(bound, best.length) * (1 - 1e-12) - 1e-9)
    if best is first:
        return start, bound
    return make_choices(known, best.order, best.along, _find_loops(known)), bound


def _narrow(
    known: Sampled, branch: _Subproblem, best: _Tour, home: FloatArray | None, budget: int
) -> tuple[_Tour, _Subproblem, int]:
    """Divide and drop the sections of a branch until it is closed or has a few orders.

    Returns the best tour, the rest of the branch, and the rest of the budget. The bound of a branch
    whose tours are all longer than the best one is the length of that one.
    """
    sets, sections, guide, bound = branch.sets, branch.sections, branch.guide, branch.bound
    loop, is_first = _find_loops(known), len(sets) > len(guide.order)
    limit = best.length + _GAP_MM
    for _ in range(_ROUNDS):
        ellipses = _make_ellipses(known, sections)
        towards = _compute_directions(known, ellipses, sections.item, guide, home)
        steps = find_steps(sets, len(loop))
        costs = _compute_step_costs(ellipses, sections.item, steps, towards, home)
        if is_first:
            sets, is_first = find_best_through(_merge_sections(costs), sets, limit)[2], False
        through, tour, sets = find_best_through(costs, sets, limit)
        bound = max(bound, min(float(through.min()), best.length))
        if not len(sets):
            break
        guide = _improve_guide(known, sections, tour, guide, home)
        best = _choose_shorter(best, guide)
        limit = best.length + _GAP_MM
        divided = _divide(sections, through <= limit, loop)
        budget -= max(len(sets), _MIN_SETS) * len(divided.item) ** 2
        if _is_closed(best, bound) or not loop.any() or budget < 0:
            break
        sections = divided
        if len(_list_orders(sets, len(loop))) > 1:
            break
    return best, _Subproblem(sets, sections, guide, bound), max(budget, 0)


def _improve_guide(
    known: Sampled, sections: _Sections, tour: list[int], guide: _Tour, home: FloatArray | None
) -> _Tour:
    """The tour through these sections with its best starts, if that is shorter than `guide`."""
    item, loop = sections.item[tour], _find_loops(known)
    along = guide.along.copy()
    along[item] = np.where(loop[item], sections.middle()[tour], sections.low[tour])
    distance = np.abs(along - guide.along)
    distance = np.where(loop, np.minimum(distance, known.whole - distance), distance)[item]
    if (item == guide.order).all() and (distance <= sections.size[tour]).all():
        return guide
    return _choose_shorter(guide, _polish_tour(known, item, along, home))


def _choose_shorter(first: _Tour, second: _Tour) -> _Tour:
    return second if second.length < first.length - _GAP_MM else first


def _list_orders(sets: IntArray, count: int) -> list[list[int]]:
    """The orders whose beginnings are all among the sets; none if more than `_MAX_ORDERS`."""
    allowed = set(sets.tolist())
    orders: list[list[int]] = [[]]
    for _ in range(count):
        longer = []
        for order in orders:
            used = sum(1 << k for k in order)
            for item in range(count):
                if item not in order and used | 1 << item in allowed:
                    longer.append([*order, item])
        orders = longer
        if len(orders) > _MAX_ORDERS:
            return []
    return orders


def _is_closed(best: _Tour, bound: float) -> bool:
    return best.length - bound <= max(_GAP_MM, _GAP_FRACTION * best.length)


def is_proven(travel: float, bound: float) -> bool:
    """Whether no tour is shorter by more than 0.05 % or 0.002 mm."""
    return travel - bound <= max(2 * _GAP_MM, _PROVEN_FRACTION * travel)


def _find_loops(known: Sampled) -> BoolArray:
    """Which paths may be entered anywhere."""
    return np.asarray((known.items.kind == CLOSED) & (np.diff(known.items.first) > 1))


def _find_precedence(known: Sampled, order: IntArray) -> list[int]:
    """For each item, the set of items that come before it: those inside, and all of a lower rank.

    If every tour may be reversed, the first item of `order` comes before its last one.
    """
    items = known.items
    needs = []
    for item in range(len(order)):
        before = (items.parent == item) | (items.rank < items.rank[item])
        needs.append(sum(1 << int(k) for k in np.flatnonzero(before)))
    if not any(needs) and (items.kind != ONE_WAY).all() and len(order) > 1:
        needs[int(order[-1])] |= 1 << int(order[0])
    return needs


def _make_first_sections(known: Sampled) -> _Sections:
    loop = _find_loops(known)
    count = np.where(loop, _FIRST_SECTIONS, np.where(known.items.kind == BOTH_WAYS, 2, 1))
    item, number = list_owners(count), number_rows(count)
    size = np.where(loop, known.whole / _FIRST_SECTIONS, 0.0)[item]
    return _Sections(item, np.where(loop[item], number * size, number), size)


def _divide(sections: _Sections, kept: BoolArray, loop: BoolArray) -> _Sections:
    count = np.where(loop[sections.item[kept]], _PARTS, 1)
    owner, number = np.flatnonzero(kept)[list_owners(count)], number_rows(count)
    size = np.where(loop[sections.item[owner]], sections.size[owner] / _PARTS, 0.0)
    return _Sections(sections.item[owner], sections.low[owner] + number * size, size)


def _make_ellipses(known: Sampled, sections: _Sections) -> _Ellipses:
    """The ellipses around sections.

    A curve stays inside the ellipse about its two ends whose first axis is as long as the curve.
    """
    items, item, loop = known.items, sections.item, _find_loops(known)
    back = (~loop[item] & (sections.low > 0))[:, None]
    first, last = items.points[items.first[:-1][item]], items.points[items.first[1:][item] - 1]
    enter, leave = np.where(back, last, first), np.where(back, first, last)
    half, width = np.zeros(len(item)), np.zeros(len(item))
    axis = np.tile([1.0, 0.0], (len(item), 1))
    rows = np.flatnonzero(loop[item])
    low, high = sections.low[rows], sections.low[rows] + sections.size[rows]
    start, end = compute_points(known, item[rows], low), compute_points(known, item[rows], high)
    chord = end - start
    distance = np.sqrt((chord**2).sum(axis=1))
    half[rows] = measure_sections(known, item[rows], low, high) * (0.5 + _ROUNDING)
    width[rows] = np.sqrt(np.maximum(half[rows] ** 2 - (distance / 2) ** 2, 0.0))
    has_chord = distance > 0
    axis[rows[has_chord]] = chord[has_chord] / distance[has_chord, None]
    enter[rows] = leave[rows] = (start + end) / 2
    return _Ellipses(enter, leave, axis, half, width)


def _compute_directions(
    known: Sampled, ellipses: _Ellipses, item: IntArray, tour: _Tour, home: FloatArray | None
) -> FloatArray:
    """(P, 2) mean of the directions in which a tour enters and leaves each section; 0 if open."""
    enter, leave = compute_ends(known, tour.along)
    order, place = tour.order, np.argsort(tour.order)[item]
    home_point = np.full((1, 2), np.nan) if home is None else home[None]
    before = np.concatenate([home_point, leave[order]])[place]
    after = np.concatenate([enter[order], home_point])[place + 1]
    into, out = _normalize(ellipses.enter - before), _normalize(after - ellipses.leave)
    towards: FloatArray = (into + out) / 2
    towards[ellipses.half == 0] = 0.0
    return towards


def _normalize(vectors: FloatArray) -> FloatArray:
    """The vectors with length 1; 0 for 0 and for nan."""
    length = np.sqrt((vectors**2).sum(axis=-1, keepdims=True))
    return np.asarray(np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0))


def _compute_step_costs(
    ellipses: _Ellipses,
    item: IntArray,
    steps: BoolArray,
    towards: FloatArray,
    home: FloatArray | None,
) -> StepCosts:
    """The least costs of all steps, with the charges for `towards`."""
    charges = ellipses.charge(towards)
    enter, leave = ellipses.enter.T.copy(), ellipses.leave.T.copy()
    cost = np.zeros((len(item), len(item)))
    for number in range(len(steps)):
        others = np.flatnonzero(steps[number][item])
        if not len(others):
            continue
        rows = slice(*np.searchsorted(item, (number, number + 1)).tolist())
        of_rows = tuple(charge[rows, None] for charge in charges)
        of_others = tuple(charge[others] for charge in charges)
        # Axis by axis, which numpy does in half the time.
        x = enter[0, others] - leave[0, rows, None]
        y = enter[1, others] - leave[1, rows, None]
        cost[rows, others] = _compute_least_costs(x, y, [of_rows, of_others])
    if home is None:
        edge = charges[-1]
        return StepCosts(item, cost, -edge, -edge)
    out, back = enter - home[:, None], home[:, None] - leave
    out_cost = _compute_least_costs(out[0], out[1], [charges])
    return StepCosts(item, cost, out_cost, _compute_least_costs(back[0], back[1], [charges]))


def _compute_least_costs(
    x: FloatArray, y: FloatArray, charges: list[tuple[FloatArray, ...]]
) -> FloatArray:
    """The least costs of steps between ellipses whose middles are x, y apart, mm."""
    cost: FloatArray = np.sqrt(x * x + y * y)
    distance = np.maximum(cost, NONZERO)
    x, y = x / distance, y / distance
    floor = np.zeros(())
    for along_x, along_y, along_charged, across_x, across_y, across_charged, edge in charges:
        along = x * along_x
        along += y * along_y
        along -= along_charged
        across = x * across_x
        across += y * across_y
        across -= across_charged
        along *= along
        across *= across
        along += across
        cost -= np.sqrt(along, out=along)
        floor = floor - edge
    np.maximum(cost, floor, out=cost)
    return cost


def _merge_sections(costs: StepCosts) -> StepCosts:
    """One way to run each item, with the cheapest step of all its sections."""
    first = np.searchsorted(costs.item, np.arange(int(costs.item[-1]) + 1))
    cost = np.minimum.reduceat(np.minimum.reduceat(costs.cost, first, axis=0), first, axis=1)
    out, back = np.minimum.reduceat(costs.out, first), np.minimum.reduceat(costs.back, first)
    return StepCosts(np.arange(len(first)), cost, out, back)


def _measure_travel(
    known: Sampled, order: IntArray, along: FloatArray, home: FloatArray | None
) -> float:
    enter, leave = compute_ends(known, along)
    gaps = enter[order[1:]] - leave[order[:-1]]
    if home is not None:
        gaps = np.concatenate([gaps, [enter[order[0]] - home, leave[order[-1]] - home]])
    return float(np.sqrt((gaps**2).sum(axis=1)).sum())


def _polish_tour(
    known: Sampled, order: IntArray, along: FloatArray, home: FloatArray | None
) -> _Tour:
    """The tour in this order, with the starts of closed paths at their best points near `along`."""
    loop, items = _find_loops(known), known.items
    enter = np.where(~loop & (along > 0), items.first[1:] - 1, items.first[:-1])
    length = np.where(loop, along, 0.0)
    for _ in range(_POLISH_ROUNDS):
        length = polish_starts(known, Start(order, enter), home, length)
    along = np.where(loop, length, along)
    return _Tour(order, along, _measure_travel(known, order, along, home))
