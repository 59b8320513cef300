"""The shortest order of a few hundred items by a table of costs: edges of a 3-D part, any links.

Item i is run from its end 0 to its end 1, or reversed. Costs may differ by direction and may be
infinite. Up to `EXACT` items the result is the best order (Held and Karp's dynamic program over
sets). For more items sections are moved and reversed, and the search starts again from small
perturbations of the best order.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from operator import itemgetter

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import count_rows
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray

# Pseudo-random numbers that are the same on every machine and with every library.

_MASK = 0xFFFFFFFF


class Dice:
    """A stream of whole numbers; equal seeds, 0 or more, give equal streams."""

    def __init__(self, seed: int) -> None:
        self.state = (seed * 0x9E3779B1 + 0x7F4A7C15) & _MASK

    def below(self, bound: int) -> int:
        """The next number, 0 to `bound` - 1."""
        self.state = (self.state + 0x9E3779B9) & _MASK
        word = self.state
        word = ((word ^ (word >> 16)) * 0x85EBCA6B) & _MASK
        word = ((word ^ (word >> 13)) * 0xC2B2AE35) & _MASK
        return (word ^ (word >> 16)) % bound


#: The items in the order in which they are run, and whether each of these is reversed.
Order = tuple[list[int], list[bool]]
#: First and last position that change, first position and length of the section that moves to the
#: other end, whether that is reversed, and the change of the cost.
_Move = tuple[int, int, int, int, bool, float]
#: Sort key of moves: the change of the cost, then the position.
_MOVE_KEY = itemgetter(5, 0)
#: Result of `_find_limits` for each order.
_Limits = list[tuple[IntArray, IntArray]]


class Table(Struct, frozen=True, eq=False):
    """Costs of all links of n items, inf for a link that is not possible.

    between: (n, 2, n, 2) cost `between[i, a, j, b]` from end a of item i, where it is left, to end
        b of item j, where it is entered. The entries of an item to itself are not read.
    first: (n, 2) cost from home to each end of each item; zeros if nothing comes before.
    last: (n, 2) cost from each end of each item to home; zeros if nothing comes after.

    Infinite costs in `first` or `last` fix the first or the last item. The cost of an item that is
    reversed may be added to the links that enter it there.
    """

    between: FloatArray
    first: FloatArray
    last: FloatArray


class Rules(Struct, frozen=True, eq=False):
    """The precedence that an order has to keep.

    parent: (n,) the item that comes later than each item, -1 for none.
    rank: (n,) items of a lower rank come first.
    """

    parent: IntArray
    rank: IntArray


#: Maximum number of items that are ordered exactly: there are 2^n sets.
EXACT = 10
#: Maximum number of items in a section that is moved; longer ones are only reversed.
_LONGEST_MOVED = 3
#: Entries of the table that all perturbations together read; it sets their number.
_WORK = 2_000_000
#: Minimum and maximum number of perturbations.
_MIN_TRIALS, _MAX_TRIALS = 20, 300
#: Entries of the tables of one batch of perturbations.
_BATCH_ENTRIES = 20_000
#: Maximum number of perturbations in a batch.
_MAX_BATCH = 64
#: Fraction of the costs below which an improvement is rounding.
_EPS = 1e-12


def shortest(
    table: Table,
    seed: int = 0,
    effort: float = 1.0,
    start: Order | None = None,
    rules: Rules | None = None,
) -> Order:
    """The order and the directions of n items with the least cost from home through all and back.

    If no order is finite, the result has the fewest infinite links of all orders that were
    evaluated, and its `total` is inf. Raises ValueError for tables of other shapes, for NaN or
    -inf, and for rules without a start.

    seed: seed of the perturbations; equal seeds give equal orders.
    effort: number of perturbations as a fraction of the usual number.
    start: order from which the search starts, None for that of the nearest neighbour.
    rules: precedence that `start` and every order of the search keep.
    """
    if rules is not None and start is None:
        raise ValueError("an order that keeps the rules is needed to start from")
    count = _check_table(table)
    if count == 0:
        return [], []
    steps = _make_steps(table)
    if count <= EXACT and rules is None:
        return _split_states(_order_exactly(steps))
    items, flipped = nearest(table) if start is None else start
    home = 2 * count
    states = np.array([home, *(2 * i + back for i, back in zip(items, flipped, strict=True)), home])
    return _split_states(_search(states, steps, seed, effort, rules)[1:-1])


def nearest(table: Table) -> Order:
    """The order of the nearest neighbour ("Following a continuous path", section 3.1).

    If several items are equally near, the one with the lowest index comes next.
    """
    count = _check_table(table)
    is_pending = np.ones(count, dtype=bool)
    order: list[int] = []
    flipped: list[bool] = []
    costs = table.first
    for _ in range(count):
        options = np.where(is_pending[:, None], np.minimum(costs, np.finfo(float).max), np.inf)
        item, end = divmod(int(np.argmin(options)), 2)
        is_pending[item] = False
        order.append(item)
        flipped.append(end == 1)
        costs = table.between[item, 1 - end]
    return order, flipped


def total(table: Table, order: Sequence[int], flipped: Sequence[bool]) -> float:
    """The cost of the order, from home and back to it."""
    if not order:
        return 0.0
    enter = [int(back) for back in flipped]
    costs = [table.first[order[0], enter[0]], table.last[order[-1], 1 - enter[-1]]]
    for k in range(1, len(order)):
        costs.append(table.between[order[k - 1], 1 - enter[k - 1], order[k], enter[k]])
    return math.fsum(costs)


def _check_table(table: Table) -> int:
    """The number of items. Raises ValueError for tables of other shapes, NaN or -inf."""
    between, first, last = table.between, table.first, table.last
    count = len(first)
    if (
        first.shape != (count, 2)
        or last.shape != (count, 2)
        or between.shape != (count, 2, count, 2)
    ):
        raise ValueError(
            f"tables of shapes {between.shape}, {first.shape}, {last.shape} do not belong together"
        )
    items = np.arange(count)
    others = between.copy()
    others[items, :, items, :] = 0.0
    for costs in (others, first, last):
        if np.isnan(costs).any() or np.isneginf(costs).any():
            raise ValueError("a cost is a number or inf")
    return count


def _make_steps(table: Table) -> FloatArray:
    """Costs (2n + 1, 2n + 1) from state to state.

    State 2 i + o is item i entered at its end o, state 2n is home. An infinite cost becomes a
    number above the cost of any finite order, so that sums and differences stay numbers.
    """
    count = len(table.first)
    home = 2 * count
    steps = np.zeros((home + 1, home + 1))
    # An item that is entered at end o is left at end 1 - o.
    steps[:home, :home] = table.between[:, ::-1].reshape(home, home)
    steps[home, :home] = table.first.reshape(home)
    steps[:home, home] = table.last[:, ::-1].reshape(home)
    own_states = np.arange(home).reshape(-1, 2)
    steps[own_states[:, :, None], own_states[:, None, :]] = 0.0
    finite = np.isfinite(steps)
    steps[~finite] = (2 * float(np.abs(steps[finite]).max()) + 1) * (count + 2)
    return steps


def _split_states(states: IntArray) -> Order:
    return (states >> 1).tolist(), (states & 1).astype(bool).tolist()


def _order_exactly(steps: FloatArray) -> IntArray:
    """The best order by dynamic programming over the sets of items that have been run."""
    home = len(steps) - 1
    count = home // 2
    item = np.arange(home) >> 1
    cost = np.full((1 << count, home), np.inf)
    before = np.full((1 << count, home), -1)
    cost[1 << item, np.arange(home)] = steps[home, :home]
    inner = steps[:home, :home]
    for done in range(1, 1 << count):
        ready = np.flatnonzero(np.isfinite(cost[done]))
        goals = np.flatnonzero((done >> item) & 1 == 0)
        if not len(goals):
            continue
        options = cost[done, ready, None] + inner[np.ix_(ready, goals)]
        best = options.argmin(axis=0)
        after = done | (1 << item[goals])
        # Every (set, state) is entered from one set only: the set without the state's item.
        cost[after, goals] = options[best, np.arange(len(goals))]
        before[after, goals] = ready[best]
    done = (1 << count) - 1
    state = int(np.argmin(cost[done] + steps[:home, home]))
    states = []
    while state >= 0:
        states.append(state)
        done, state = done & ~(1 << (state >> 1)), int(before[done, state])
    return np.array(states[::-1])


def _search(
    states: IntArray, steps: FloatArray, seed: int, effort: float, rules: Rules | None
) -> IntArray:
    """Local search from an order, then from perturbations of the best order, many at once."""
    count = len(states) - 2
    dice = Dice(seed)
    best: IntArray = _improve_orders(states[None], steps, rules)[0]
    if count < 2:
        return best
    least = _sum_costs(best, steps)
    trials = math.ceil(effort * min(max(_WORK // count**2, _MIN_TRIALS), _MAX_TRIALS))
    while trials > 0:
        batch = min(trials, max(_BATCH_ENTRIES // count**2, 1), _MAX_BATCH)
        trials -= batch
        perturbed = np.stack([_perturb(best, dice) for _ in range(batch)])
        if rules is not None:
            perturbed = perturbed[[_keeps_rules(order, rules) for order in perturbed]]
        for trial in _improve_orders(perturbed, steps, rules):
            cost = _sum_costs(trial, steps)
            if cost < least - _EPS * abs(least):
                best, least = trial, cost
    return best


def _perturb(states: IntArray, dice: Dice) -> IntArray:
    """Exchange two neighbouring sections and reverse one item."""
    count = len(states) - 2
    reach = max(1, min(count // 2, 30))
    a, b = 1 + dice.below(reach), 1 + dice.below(reach)
    low = 1 + dice.below(count - a - b + 1)
    trial = states.copy()
    trial[low : low + a + b] = np.roll(states[low : low + a + b], -a)
    trial[1 + dice.below(count)] ^= 1
    return trial


def _sum_costs(states: IntArray, steps: FloatArray) -> float:
    return math.fsum(steps[states[:-1], states[1:]].tolist())


def _find_limits(states: IntArray, rules: Rules) -> tuple[IntArray, IntArray]:
    """For each position of an order (n + 2,), the last one before and the first one after by rule.

    Both are (n,), for the positions 1..n; 0 and n + 1 if no item must come before or after.
    """
    items = states[1:-1] >> 1
    place = np.argsort(items) + 1
    parent, rank = rules.parent[items], rules.rank[items]
    # Ranks increase along an order that keeps the rules.
    before = np.searchsorted(rank, rank, side="left")
    after = np.searchsorted(rank, rank, side="right") + 1
    has_parent = parent >= 0
    after[has_parent] = np.minimum(after[has_parent], place[parent[has_parent]])
    np.maximum.at(before, place[parent[has_parent]] - 1, np.flatnonzero(has_parent) + 1)
    return before, after


def _keeps_rules(states: IntArray, rules: Rules) -> bool:
    items = states[1:-1] >> 1
    place = np.argsort(items)
    has_parent = rules.parent >= 0
    return bool(
        (np.diff(rules.rank[items]) >= 0).all()
        and (place[rules.parent[has_parent]] > place[has_parent]).all()
    )


def _improve_orders(states: IntArray, steps: FloatArray, rules: Rules | None = None) -> IntArray:
    """The orders (B, n + 2) after all moves that shorten them.

    The best moves come first, several at a time if they do not overlap.
    """
    states = states.copy()
    eps = _EPS * float(np.abs(steps).max())
    active = np.arange(len(states))
    while len(active):
        moves: list[list[_Move]] = [[] for _ in active]
        limits = None if rules is None else [_find_limits(states[k], rules) for k in active]
        _add_reversals(states[active], steps, eps, moves, limits)
        _add_relocations(states[active], steps, eps, moves, limits)
        for k, of_order in zip(active.tolist(), moves, strict=True):
            of_order.sort(key=_MOVE_KEY)
            # With rules the limits of a move may change by another one: one move at a time.
            _make_moves(states[k], of_order if rules is None else of_order[:1])
        active = active[count_rows(moves) > 0]
    return states


def _make_moves(states: IntArray, moves: list[_Move]) -> None:
    """Make the sorted moves of one order, except those that overlap with an earlier one."""
    taken = bytearray(len(states))
    for low, high, begin, size, is_reversed, _ in moves:
        # A move depends on the links into and out of its range, which must be unchanged.
        if 1 not in taken[low - 1 : high + 2]:
            taken[low - 1 : high + 2] = b"\1" * (high + 3 - low)
            section = states[begin : begin + size]
            section = _reverse_states(section[::-1]) if is_reversed else section
            before, after = states[low:begin], states[begin + size : high + 1]
            states[low : high + 1] = np.concatenate([after, section, before])


def _reverse_states(states: IntArray) -> IntArray:
    """The items in the other direction. Home, the last state, is never inside a range."""
    return states ^ 1


def _sum_along(states: IntArray, steps: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(B, n) costs from position 1 to each position 1..n, forwards and for the reversed section."""
    inner = states[:, 1:-1]
    back_states = _reverse_states(inner)
    ahead, back = np.zeros(inner.shape), np.zeros(inner.shape)
    np.cumsum(steps[inner[:, :-1], inner[:, 1:]], axis=1, out=ahead[:, 1:])
    np.cumsum(steps[back_states[:, 1:], back_states[:, :-1]], axis=1, out=back[:, 1:])
    return ahead, back


def _add_reversals(
    states: IntArray,
    steps: FloatArray,
    eps: float,
    moves: list[list[_Move]],
    limits: _Limits | None,
) -> None:
    """Add the best section to reverse from each position of each order to `moves` (2-opt).

    The costs in the other direction count for the section.
    """
    inner, before, after = states[:, 1:-1], states[:, :-2], states[:, 2:]
    back_states = _reverse_states(inner)
    ahead, back = _sum_along(states, steps)
    extra = back - ahead
    change = steps[before[:, :, None], back_states[:, None, :]]
    change = change + steps[back_states[:, :, None], after[:, None, :]]
    change -= steps[before, inner][:, :, None] + steps[inner, after][:, None, :]
    change += extra[:, None, :] - extra[:, :, None]
    change[:, np.tri(inner.shape[1], k=-1, dtype=bool)] = 0.0
    for k, (_, latest) in enumerate(limits or ()):
        # A section with an item and one that must come after it is not reversed.
        first = np.minimum.accumulate(latest[::-1])[::-1]
        change[k][np.arange(1, inner.shape[1] + 1) >= first[:, None]] = 0.0
    ends = change.argmin(axis=2)
    least = np.take_along_axis(change, ends[:, :, None], axis=2)[:, :, 0]
    for k, i in np.argwhere(least < -eps).tolist():
        j = int(ends[k, i])
        moves[k].append((i + 1, j + 1, i + 1, j + 1 - i, True, float(least[k, i])))


def _add_relocations(
    states: IntArray,
    steps: FloatArray,
    eps: float,
    moves: list[list[_Move]],
    limits: _Limits | None,
) -> None:
    """Add the best other place of each short section of each order to `moves` (Or-opt)."""
    count = states.shape[1] - 2
    ahead, back = _sum_along(states, steps)
    links = steps[states[:, :-1], states[:, 1:]]
    place = np.arange(count + 1)
    for size in range(1, min(_LONGEST_MOVED, count - 1) + 1):
        low = np.arange(1, count - size + 2)
        high = low + size - 1
        saved = links[:, low - 1] + links[:, high] - steps[states[:, low - 1], states[:, high + 1]]
        extra = (back[:, high - 1] - back[:, low - 1]) - (ahead[:, high - 1] - ahead[:, low - 1])
        inside = (place[None, :] >= low[:, None] - 1) & (place[None, :] <= high[:, None])
        for is_reversed in (False, True):
            head, tail = states[:, low, None], states[:, high, None]
            if is_reversed:
                head, tail = _reverse_states(tail), _reverse_states(head)
            change = steps[states[:, None, :-1], head] + steps[tail, states[:, None, 1:]]
            change -= links[:, None, :]
            change += (extra * is_reversed - saved)[:, :, None]
            change[:, inside] = 0.0
            for k, of_order in enumerate(limits or ()):
                change[k][_find_forbidden(of_order, low, size, place, is_reversed)] = 0.0
            best = change.argmin(axis=2)
            least = np.take_along_axis(change, best[:, :, None], axis=2)[:, :, 0]
            for k, i in np.argwhere(least < -eps).tolist():
                # The section from position i + 1 on comes after position j.
                j = int(best[k, i])
                ends = (j + 1, i + size) if j <= i else (i + 1, j)
                moves[k].append((*ends, i + 1, size, is_reversed, float(least[k, i])))


def _find_forbidden(
    limits: tuple[IntArray, IntArray], low: IntArray, size: int, place: IntArray, is_reversed: bool
) -> BoolArray:
    """Which sections (L,) of `size` from `low` must not come after which places (P,), (L, P)."""
    inside = low[:, None] - 1 + np.arange(size)
    before, after = limits[0][inside], limits[1][inside]
    high = low + size - 1
    # A limit within the section does not count: the section moves as a whole.
    earliest = np.minimum(before, low[:, None] - 1).max(axis=1)
    latest = np.maximum(after, high[:, None] + 1).min(axis=1)
    forbidden = (place < earliest[:, None]) | (place >= latest[:, None])
    if is_reversed:
        forbidden |= (after <= high[:, None]).any(axis=1)[:, None]
    return np.asarray(forbidden)
