"""The whole search: every item looked at until no move is left, then small shuffles, each repaired or undone.

Written like ``kernel``: the same lines run in Python and compiled. A shuffle exchanges two neighbouring stretches (the
double bridge of Martin, Otto and Felten, 1991, kept local) and is undone unless the repaired tour is shorter.
"""

from __future__ import annotations

from camgen.tours.kernel import (
    DICE,
    EPS,
    IDLE,
    LOGGED,
    LOGS,
    QUEUED,
    WORK,
    Run,
    Scene,
    carry,
    may_carry,
    pop,
    push,
    undo,
    way,
)
from camgen.tours.moves import improve

#: Longest stretch of a shuffle. Measured at 1,000 items: 8 and 15 leave 1 to 2 % more travel, 50 as much.
_SHUFFLE = 30
#: Entries of the log; a repair that needs more is broken off.
LOG = 2000
#: So many shuffles in a row that no rule allows end the search.
_IDLE = 1000
_MASK = 0xFFFFFFFF


def dice(r: Run, bound: int) -> int:
    """A whole number from 0 to ``bound`` - 1 (SplitMix's mixing of a counter, cut to 32 bits)."""
    word = (r.marks[DICE] + 0x9E3779B9) & _MASK
    r.marks[DICE] = word
    word = ((word ^ (word >> 16)) * 0x85EBCA6B) & _MASK
    word = ((word ^ (word >> 13)) * 0xC2B2AE35) & _MASK
    return (word ^ (word >> 16)) % bound


def repair(s: Scene, r: Run) -> float:
    """Moves until none is left at the items that wait; the change."""
    total = 0.0
    while r.marks[QUEUED] > 0:
        if r.marks[LOGGED] > LOG - 20:
            while r.marks[QUEUED] > 0:
                pop(r)
            break
        a = pop(r)
        r.marks[WORK] += 1
        total += improve(s, r, a)
    return total


def shuffle(s: Scene, r: Run) -> float:
    """Two neighbouring stretches exchanged; the change, 0 where the place drawn does not allow it."""
    size = len(r.ring)
    reach = min(_SHUFFLE, (size - 1) // 2)
    if reach < 1:
        return 0.0
    one, two = 1 + dice(r, reach), 1 + dice(r, reach)
    low = 1 + dice(r, size - one - two) if one + two < size else 1
    high = low + one + two - 1
    if high >= size or not may_carry(s, r, low, one, two, 0):
        return 0.0
    a, b = r.ring[low - 1], r.ring[low]
    c, d = r.ring[low + one - 1], r.ring[low + one]
    e, f = r.ring[high], r.ring[(high + 1) % size]
    old = way(s, r.leave[a], r.enter[b]) + way(s, r.leave[c], r.enter[d]) + way(s, r.leave[e], r.enter[f])
    new = way(s, r.leave[a], r.enter[d]) + way(s, r.leave[e], r.enter[b]) + way(s, r.leave[c], r.enter[f])
    carry(r, low, one, two, 0)
    push(r, a)
    push(r, b)
    push(r, c)
    push(r, d)
    push(r, e)
    push(r, f)
    return new - old


def search(s: Scene, r: Run, budget: int, pause: int) -> float:
    """The tour shortened as far as ``budget`` looks at an item go; the change. All items must wait in the queue.

    It comes back after about ``pause`` looks, 1 or more, and goes on when it is called again: in how many calls the
    budget is used up makes no difference. ``done`` tells when it is.
    """
    stop = min(budget, r.marks[WORK] + pause)
    total = 0.0
    while not r.marks[LOGS] and r.marks[QUEUED] > 0 and r.marks[WORK] < stop:
        a = pop(r)
        r.marks[WORK] += 1
        total += improve(s, r, a)
    if not r.marks[LOGS] and (r.marks[QUEUED] == 0 or r.marks[WORK] >= budget):
        while r.marks[QUEUED] > 0:
            pop(r)
        r.marks[LOGS] = 1
    while r.marks[LOGS] and r.marks[WORK] < stop and r.marks[IDLE] < _IDLE:
        r.marks[LOGGED] = 0
        change = shuffle(s, r)
        if r.marks[LOGGED] == 0:
            r.marks[IDLE] += 1
            continue
        r.marks[IDLE] = 0
        change += repair(s, r)
        if change < -EPS:
            total += change
        else:
            undo(s, r)
    return total


def done(r: Run, budget: int) -> bool:
    """Whether ``search`` has nothing left to do."""
    return r.marks[WORK] >= budget or r.marks[IDLE] >= _IDLE
