"""The local search: moves until none improves the tour, then shuffles, each repaired or undone.

It knows neither a plane nor a table. A link costs ``kernel.link_cost``. The moves at an item are
those of ``moves`` in the plane, where items have two ends or a choice of starts, and those of
``ring_moves`` for a table. Like ``kernel`` it runs in Python and compiled.
"""

from __future__ import annotations

from camgen.order.solver.kernel import (
    DICE,
    IDLE,
    LOGGED,
    LOGS,
    QUEUED,
    SHUFFLED,
    WORK,
    Run,
    Scene,
    carry,
    link_cost,
    may_carry,
    pop,
    push,
    undo,
)
from camgen.order.solver.moves import improve_in_plane
from camgen.order.solver.ring_moves import improve_by_table

#: Largest number of items in a stretch of a shuffle. Measured at 1,000 items in the plane: 8 and 15
#: leave 1 to 2 % more travel, 50 leaves as much.
LONGEST_SHUFFLED = 30
#: Entries of the log. A repair that needs more is broken off.
LOG = 2000
#: Entries of the log that a single move may need.
_LOG_RESERVE = 20
#: More evaluations or shuffles than any search reaches.
ENDLESS = 10**15
#: Shuffles in a row that no rule allows, after which the search ends.
_MOST_IDLE = 1000
_MASK = 0xFFFFFFFF


def roll_dice(r: Run, bound: int) -> int:
    """The next number of ``matrix.Dice``, 0 to ``bound`` - 1."""
    word = (r.marks[DICE] + 0x9E3779B9) & _MASK
    r.marks[DICE] = word
    word = ((word ^ (word >> 16)) * 0x85EBCA6B) & _MASK
    word = ((word ^ (word >> 13)) * 0xC2B2AE35) & _MASK
    return (word ^ (word >> 16)) % bound


def evaluate_next(s: Scene, r: Run) -> float:
    """Makes a move at the next item of the queue, if a move improves the tour; the change."""
    item = pop(s, r)
    r.marks[WORK] += 1
    if len(s.table) > 0:
        return improve_by_table(s, r, item)
    return improve_in_plane(s, r, item)


def repair(s: Scene, r: Run) -> float:
    """Makes moves until the queue is empty; the change."""
    total = 0.0
    while r.marks[QUEUED] > 0:
        if r.marks[LOGGED] > LOG - _LOG_RESERVE:
            clear_queue(s, r)
        else:
            total += evaluate_next(s, r)
    return total


def clear_queue(s: Scene, r: Run) -> None:
    """No item waits any more."""
    while r.marks[QUEUED] > 0:
        pop(s, r)


def shuffle(s: Scene, r: Run) -> float:
    """Exchanges two neighbouring stretches at random; the change, 0 where a rule forbids it."""
    size = len(r.ring)
    if s.longest < 1:
        return 0.0
    first_size, second_size = 1 + roll_dice(r, s.longest), 1 + roll_dice(r, s.longest)
    free = size - first_size - second_size
    low = 1 + roll_dice(r, free) if free > 0 else 1
    middle = low + first_size
    high = middle + second_size - 1
    if high >= size or not may_carry(s, r, low, first_size, second_size, 0):
        return 0.0
    a, b = r.ring[low - 1], r.ring[low]
    c, d = r.ring[middle - 1], r.ring[middle]
    e, f = r.ring[high], r.ring[(high + 1) % size]
    before = link_cost(s, r.leave[a], r.enter[b]) + link_cost(s, r.leave[c], r.enter[d])
    before += link_cost(s, r.leave[e], r.enter[f])
    saved = before - link_cost(s, r.leave[a], r.enter[d]) - link_cost(s, r.leave[e], r.enter[b])
    saved -= link_cost(s, r.leave[c], r.enter[f])
    carry(r, low, first_size, second_size, 0)
    for item in (a, b, c, d, e, f):
        if s.newest_first:
            # An item at both ends of a stretch of one waits twice: it is evaluated again when
            # the moves around it are done.
            r.waits[item] = 0
        push(r, item)
    return -saved


def search(s: Scene, r: Run, budget: int, pause: int) -> float:
    """Shortens the tour within ``budget`` evaluations and ``Scene.shuffles``; the change.

    All items must wait in the queue. The search returns after about ``pause`` evaluations, 1 or
    more, and goes on when it is called again. The number of calls makes no difference to the tour.
    ``is_done`` says whether there is anything left to do.
    """
    stop = min(budget, r.marks[WORK] + pause)
    total = 0.0
    while not r.marks[LOGS] and r.marks[QUEUED] > 0 and r.marks[WORK] < stop:
        total += evaluate_next(s, r)
    if not r.marks[LOGS] and (r.marks[QUEUED] == 0 or r.marks[WORK] >= budget):
        clear_queue(s, r)
        r.marks[LOGS] = 1
    while r.marks[LOGS] and r.marks[WORK] < stop and not has_shuffled_enough(s, r):
        total += try_shuffle(s, r)
    return total


def try_shuffle(s: Scene, r: Run) -> float:
    """Shuffles and repairs the tour, and undoes both unless they improve it; the change."""
    r.marks[LOGGED] = 0
    r.marks[SHUFFLED] += 1
    change = shuffle(s, r)
    if r.marks[LOGGED] == 0:
        r.marks[IDLE] += 1
        return 0.0
    r.marks[IDLE] = 0
    change += repair(s, r)
    if change < -s.least:
        return change
    undo(s, r)
    return 0.0


def has_shuffled_enough(s: Scene, r: Run) -> bool:
    """Whether no more shuffles are wanted, or no rule allows any."""
    return r.marks[SHUFFLED] >= s.shuffles or r.marks[IDLE] >= _MOST_IDLE


def is_done(s: Scene, r: Run, budget: int) -> bool:
    """Whether ``search`` has nothing left to do."""
    return r.marks[WORK] >= budget or has_shuffled_enough(s, r)
