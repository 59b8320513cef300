"""The shortest order of a few hundred items whose costs are a table: edges of a 3-D part, links of any kind.

Item i is run from its end 0 to its end 1, or backwards. Costs may differ by direction and may be infinite. Up to
``EXACT`` items the result is the best there is (Held and Karp's dynamic program over sets); above it is found by moving
and reversing stretches, and by starting again from small shuffles of the best order.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from operator import itemgetter

import numpy as np
from msgspec import Struct

from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray

# Numbers that only look random: the same seed gives the same ones on every machine and with every library.

_MASK = 0xFFFFFFFF


class Dice:
    """A stream of whole numbers. seed: 0 or more; equal seeds give equal streams."""

    def __init__(self, seed: int) -> None:
        self.state = (seed * 0x9E3779B1 + 0x7F4A7C15) & _MASK

    def below(self, bound: int) -> int:
        """The next number, 0 to ``bound`` - 1."""
        self.state = (self.state + 0x9E3779B9) & _MASK
        word = self.state
        word = ((word ^ (word >> 16)) * 0x85EBCA6B) & _MASK
        word = ((word ^ (word >> 13)) * 0xC2B2AE35) & _MASK
        return (word ^ (word >> 16)) % bound


#: The items in the order in which they are run, and of each of these, whether it is run backwards.
Order = tuple[list[int], list[bool]]
#: position from and to (inclusive) of what changes; where in it a stretch begins that goes to the other end, how long
#: that is, and whether it is turned round; what it gains.
_Move = tuple[int, int, int, int, bool, float]
#: The order in which moves are made.
_GAIN = itemgetter(5, 0)
#: Of each order what ``_room`` says.
_Rooms = list[tuple[IntArray, IntArray]]


class Table(Struct, frozen=True, eq=False):
    """Costs of all links of n items, inf for a link that is not possible.

    between: (n, 2, n, 2) from end a of item i, where it is left, to end b of item j, where it is
        entered; ``between[i, a, j, b]``. The entries of an item to itself are not read.
    first: (n, 2) from home to each end of each item; zeros where nothing comes before.
    last: (n, 2) from each end of each item to home; zeros where nothing comes after.

    Infinite costs in ``first`` or ``last`` fix the first or the last item. What an item costs when it
    is run backwards may be added to the links that enter it there.
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


#: So many items are ordered exactly: 2^n sets.
EXACT = 10
#: Longest stretch that is moved elsewhere; longer ones are only reversed.
_LONGEST_MOVED = 3
#: Work spent on shuffles, in entries of the table looked at, and the bounds on their number.
_WORK, _LEAST_SHUFFLES, _MOST_SHUFFLES = 2_000_000, 20, 300
#: Entries of the tables of one batch of shuffles, and the most shuffles in it.
_BATCH, _WIDEST = 20_000, 64
#: Share of the costs below which a gain is rounding.
_EPS = 1e-12


def shortest(
    table: Table,
    seed: int = 0,
    effort: float = 1.0,
    start: Order | None = None,
    rules: Rules | None = None,
) -> Order:
    """The order and the directions of n items that cost least, from home through all items and back.

    seed: seed of the shuffles; equal seeds give equal orders.
    effort: number of shuffles as a fraction of the usual number.
    start: order from which the search goes on, None for that of the nearest neighbour.
    rules: precedence that ``start`` keeps, and so does every order of the search.

    If no order is finite, the result has the fewest infinite links of all orders that were
    evaluated, and its ``total`` is inf. ValueError for tables of other shapes, for NaN or -inf, and
    for rules without a start.
    """
    if rules is not None and start is None:
        raise ValueError("an order that keeps the rules is needed to start from")
    count = _check(table)
    if count == 0:
        return [], []
    steps = _steps(table)
    if count <= EXACT and rules is None:
        return _items(_exact(steps))
    items, flipped = nearest(table) if start is None else start
    home = 2 * count
    states = np.array([home, *(2 * i + back for i, back in zip(items, flipped, strict=True)), home])
    return _items(_iterate(states, steps, seed, effort, rules)[1:-1])


def nearest(table: Table) -> Order:
    """The order of the nearest neighbour ("Following a continuous path", section 3.1).

    Of equally near items the one with the lowest index comes next.
    """
    count = _check(table)
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


def _check(table: Table) -> int:
    """The number of items. ValueError for tables of other shapes, NaN or -inf."""
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


def _steps(table: Table) -> FloatArray:
    """Costs (2n + 1, 2n + 1) from state to state.

    State 2 i + o is item i entered at its end o, state 2n is home. An infinite cost becomes a number
    above the cost of any finite order, so that sums and differences stay numbers.
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


def _items(states: IntArray) -> Order:
    return (states >> 1).tolist(), (states & 1).astype(bool).tolist()


def _exact(steps: FloatArray) -> IntArray:
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


def _iterate(
    states: IntArray, steps: FloatArray, seed: int, effort: float, rules: Rules | None
) -> IntArray:
    """Local search, then again and again from the best order with two neighbouring stretches exchanged and one item
    turned round; so many at once that the work is done in large arrays.
    """
    count = len(states) - 2
    dice = Dice(seed)
    best: IntArray = _improve(states[None], steps, rules)[0]
    if count < 2:
        return best
    least = _cost(best, steps)
    trials = math.ceil(effort * min(max(_WORK // count**2, _LEAST_SHUFFLES), _MOST_SHUFFLES))
    while trials > 0:
        batch = min(trials, max(_BATCH // count**2, 1), _WIDEST)
        trials -= batch
        shuffled = np.stack([_shuffle(best, dice) for _ in range(batch)])
        if rules is not None:
            shuffled = shuffled[[_keeps(one, rules) for one in shuffled]]
        for trial in _improve(shuffled, steps, rules):
            cost = _cost(trial, steps)
            if cost < least - _EPS * abs(least):
                best, least = trial, cost
    return best


def _shuffle(states: IntArray, dice: Dice) -> IntArray:
    count = len(states) - 2
    reach = max(1, min(count // 2, 30))
    a, b = 1 + dice.below(reach), 1 + dice.below(reach)
    low = 1 + dice.below(count - a - b + 1)
    trial = states.copy()
    trial[low : low + a + b] = np.roll(states[low : low + a + b], -a)
    trial[1 + dice.below(count)] ^= 1
    return trial


def _cost(states: IntArray, steps: FloatArray) -> float:
    return math.fsum(steps[states[:-1], states[1:]].tolist())


def _room(states: IntArray, rules: Rules) -> tuple[IntArray, IntArray]:
    """Of an order (n + 2,), for each position 1..n the last one that must come before it, 0: none, and the first one
    that must come after it, n + 1: none; (n,) each.
    """
    items = states[1:-1] >> 1
    count = len(items)
    place = np.empty(count, dtype=np.int64)
    place[items] = np.arange(1, count + 1)
    parent, rank = rules.parent[items], rules.rank[items]
    # Ranks rise along an order that keeps the rules.
    low = np.searchsorted(rank, rank, side="left")
    high = np.searchsorted(rank, rank, side="right") + 1
    below = parent >= 0
    high[below] = np.minimum(high[below], place[parent[below]])
    np.maximum.at(low, place[parent[below]] - 1, np.flatnonzero(below) + 1)
    return low, high


def _keeps(states: IntArray, rules: Rules) -> bool:
    """Whether an order (n + 2,) keeps the rules."""
    items = states[1:-1] >> 1
    place = np.empty(len(items), dtype=np.int64)
    place[items] = np.arange(len(items))
    below = rules.parent >= 0
    return bool(
        (np.diff(rules.rank[items]) >= 0).all()
        and (place[rules.parent[below]] > place[below]).all()
    )


def _improve(states: IntArray, steps: FloatArray, rules: Rules | None = None) -> IntArray:
    """The orders (B, n + 2), each after all moves that shorten it: the best ones first, many at a time where they do
    not overlap.
    """
    states = states.copy()
    eps = _EPS * float(np.abs(steps).max())
    active = np.arange(len(states))
    while len(active):
        moves: list[list[_Move]] = [[] for _ in active]
        rooms = None if rules is None else [_room(states[k], rules) for k in active]
        _reversals(states[active], steps, eps, moves, rooms)
        _transfers(states[active], steps, eps, moves, rooms)
        for k, found in zip(active.tolist(), moves, strict=True):
            # With rules a move may ask for the places of what another one moved: one at a time.
            _apply(states[k], found if rules is None else sorted(found, key=_GAIN)[:1])
        active = active[[bool(found) for found in moves]]
    return states


def _apply(states: IntArray, moves: list[_Move]) -> None:
    """Carry out the moves of one order, but for those that meet a better one."""
    moves.sort(key=_GAIN)
    taken = bytearray(len(states))
    for low, high, begin, size, turned, _ in moves:
        # A move speaks of the steps into and out of its range; those of another one must be left as they were.
        if 1 not in taken[low - 1 : high + 2]:
            taken[low - 1 : high + 2] = b"\1" * (high + 3 - low)
            stretch = states[begin : begin + size]
            stretch = _flip(stretch[::-1]) if turned else stretch
            rest = states[low:begin], states[begin + size : high + 1]
            states[low : high + 1] = np.concatenate([rest[1], stretch, rest[0]])


def _flip(states: IntArray) -> IntArray:
    """The items of ``states`` in the other direction; home, the last state, never stands inside a range."""
    return states ^ 1


def _sums(states: IntArray, steps: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Costs from position 1 up to each position 1..n, as it stands, and the same stretch run backwards; (B, n) each."""
    inner = states[:, 1:-1]
    there, back = np.zeros(inner.shape), np.zeros(inner.shape)
    np.cumsum(steps[inner[:, :-1], inner[:, 1:]], axis=1, out=there[:, 1:])
    np.cumsum(steps[_flip(inner[:, 1:]), _flip(inner[:, :-1])], axis=1, out=back[:, 1:])
    return there, back


def _reversals(
    states: IntArray, steps: FloatArray, eps: float, moves: list[list[_Move]], rooms: _Rooms | None
) -> None:
    """Of each order, for each first position the best stretch to reverse (2-opt, with the costs of the other
    direction).
    """
    inner, before, after = states[:, 1:-1], states[:, :-2], states[:, 2:]
    there, back = _sums(states, steps)
    turn = back - there
    gain = (
        steps[before[:, :, None], _flip(inner)[:, None, :]]
        + steps[_flip(inner)[:, :, None], after[:, None, :]]
    )
    gain -= steps[before, inner][:, :, None] + steps[inner, after][:, None, :]
    gain += turn[:, None, :] - turn[:, :, None]
    gain[:, np.tri(inner.shape[1], k=-1, dtype=bool)] = 0.0
    for k, (_, high) in enumerate(rooms or ()):
        # A stretch that holds an item and one that must come after it is not turned round.
        first = np.minimum.accumulate(high[::-1])[::-1]
        gain[k][np.arange(1, inner.shape[1] + 1) >= first[:, None]] = 0.0
    ends = gain.argmin(axis=2)
    least = np.take_along_axis(gain, ends[:, :, None], axis=2)[:, :, 0]
    for k, i in np.argwhere(least < -eps).tolist():
        j = int(ends[k, i])
        moves[k].append((i + 1, j + 1, i + 1, j + 1 - i, True, float(least[k, i])))


def _transfers(
    states: IntArray, steps: FloatArray, eps: float, moves: list[list[_Move]], rooms: _Rooms | None
) -> None:
    """Of each order, for each short stretch its best other place, in either direction (Or-opt)."""
    count = states.shape[1] - 2
    there, back = _sums(states, steps)
    gap = steps[states[:, :-1], states[:, 1:]]
    place = np.arange(count + 1)
    for size in range(1, min(_LONGEST_MOVED, count - 1) + 1):
        low = np.arange(1, count - size + 2)
        high = low + size - 1
        saved = gap[:, low - 1] + gap[:, high] - steps[states[:, low - 1], states[:, high + 1]]
        turned = (back[:, high - 1] - back[:, low - 1]) - (there[:, high - 1] - there[:, low - 1])
        own = (place[None, :] >= low[:, None] - 1) & (place[None, :] <= high[:, None])
        for back_to_front in (False, True):
            head, tail = states[:, low, None], states[:, high, None]
            if back_to_front:
                head, tail = _flip(tail), _flip(head)
            cost = (
                steps[states[:, None, :-1], head]
                + steps[tail, states[:, None, 1:]]
                - gap[:, None, :]
            )
            cost += (turned * back_to_front - saved)[:, :, None]
            cost[:, own] = 0.0
            for k, room in enumerate(rooms or ()):
                cost[k][_forbidden(room, low, size, place, back_to_front)] = 0.0
            best = cost.argmin(axis=2)
            least = np.take_along_axis(cost, best[:, :, None], axis=2)[:, :, 0]
            for k, i in np.argwhere(least < -eps).tolist():
                moves[k].append(
                    _move(i + 1, size, int(best[k, i]), back_to_front, float(least[k, i]))
                )


def _forbidden(
    room: tuple[IntArray, IntArray], low: IntArray, size: int, place: IntArray, back_to_front: bool
) -> BoolArray:
    """Which stretches (L,) of ``size`` from ``low`` must not come behind which places (P,): (L, P)."""
    inside = low[:, None] - 1 + np.arange(size)
    before, after = room[0][inside], room[1][inside]
    high = low + size - 1
    # Where what must come before, or after, is within the stretch, more of it may be right before it, or behind it.
    earliest = np.minimum(before, low[:, None] - 1).max(axis=1)
    latest = np.maximum(after, high[:, None] + 1).min(axis=1)
    bad = (place < earliest[:, None]) | (place >= latest[:, None])
    if back_to_front:
        bad |= (after <= high[:, None]).any(axis=1)[:, None]
    return np.asarray(bad)


def _move(low: int, size: int, place: int, turned: bool, gain: float) -> _Move:
    """The stretch of ``size`` from position ``low`` put behind position ``place``."""
    ends = (place + 1, low + size - 1) if place < low else (low, place)
    return *ends, low, size, turned, gain
