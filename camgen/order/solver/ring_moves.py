"""The moves of the search for a short ring, one place after another.

As in ``kernel``: plain arithmetic over sequences, so that the same lines run in Python over lists and, compiled by
``speed``, over arrays, with the same results.
"""

from __future__ import annotations

from typing import NamedTuple

Ints = list[int]
Floats = list[float]

#: The longest stretch that is carried elsewhere, and the longest that are exchanged.
CARRIED, EXCHANGED = 3, 30
#: A gain below is rounding.
EPS = 1e-9
#: Entries of ``Ring.marks``: the places that wait, those whose neighbours a move changed, and the state of the dice.
WAITING, TOUCHED, DICE = 0, 1, 2
_MASK = 0xFFFFFFFF


class Ring(NamedTuple):
    """n places. cost: (n * n,) of going from each to each, the same both ways. near: (n * width,) the nearest places.

    places: (n,) the ring. where: (n,) by place, its index. before, where_before: (n,) what to go back to. spare: (n,).
    queue: (n + 6,) places to look at, ``waits`` (n,) tells which. touched: (6,). marks: counters, see above.
    """

    cost: Floats
    near: Ints
    width: int
    places: Ints
    where: Ints
    before: Ints
    where_before: Ints
    spare: Ints
    queue: Ints
    waits: Ints
    touched: Ints
    marks: Ints


def throw(r: Ring, bound: int) -> int:
    """The next number of the dice, 0 to ``bound`` - 1, as ``matrix.Dice`` has them."""
    word = (r.marks[DICE] + 0x9E3779B9) & _MASK
    r.marks[DICE] = word
    word = ((word ^ (word >> 16)) * 0x85EBCA6B) & _MASK
    word = ((word ^ (word >> 13)) * 0xC2B2AE35) & _MASK
    return (word ^ (word >> 16)) % bound


def push(r: Ring, place: int) -> None:
    """The place is to be looked at."""
    if not r.waits[place]:
        r.waits[place] = 1
        r.queue[r.marks[WAITING]] = place
        r.marks[WAITING] += 1


def touch(r: Ring, place: int) -> None:
    """The place has another neighbour."""
    r.touched[r.marks[TOUCHED]] = place
    r.marks[TOUCHED] += 1


def renumber(r: Ring, low: int, high: int) -> None:
    """The places from index ``low`` to before ``high`` know where they are."""
    for k in range(low, high):
        r.where[r.places[k]] = k


def turn(r: Ring, first: int, last: int) -> None:
    """Reverse the stretch from index ``first`` to ``last``; or the rest, if that is shorter."""
    count = len(r.places)
    length = (last - first) % count + 1
    if 2 * length > count:
        first, last, length = (last + 1) % count, (first - 1) % count, count - length
    i, j = first, last
    for _ in range(length // 2):
        a, b = r.places[i], r.places[j]
        r.places[i], r.places[j] = b, a
        r.where[a], r.where[b] = j, i
        i = i + 1 if i + 1 < count else 0
        j = j - 1 if j else count - 1


def reverse(r: Ring, a: int) -> float:
    """The first 2-opt move that puts a place near to ``a`` beside it is made: what it gains, 0 where there is none."""
    count, row, nears = len(r.places), a * len(r.places), a * r.width
    for step in (1, -1):
        b = r.places[(r.where[a] + step) % count]
        own = r.cost[row + b]
        for k in range(nears, nears + r.width):
            c = r.near[k]
            near = r.cost[row + c]
            if near >= own - EPS:
                break
            d = r.places[(r.where[c] + step) % count]
            gain = own + r.cost[c * count + d] - near - r.cost[b * count + d]
            if gain > EPS:
                # After a comes c: what is between them, or all the rest, is turned round.
                if step > 0:
                    turn(r, r.where[b], r.where[c])
                else:
                    turn(r, r.where[c], r.where[b])
                for one in (b, c, d):
                    touch(r, one)
                return gain
    return 0.0


def carry(r: Ring, a: int) -> float:
    """The first Or-opt move that carries a stretch that begins at ``a`` to beside a place near to ``a`` is made: what
    it gains, 0 where there is none.
    """
    count, row, nears, at = len(r.places), a * len(r.places), a * r.width, r.where[a]
    for step in (1, -1):
        before = r.places[(at - step) % count]
        for size in range(1, CARRIED + 1):
            end, after = (
                r.places[(at + step * (size - 1)) % count],
                r.places[(at + step * size) % count],
            )
            saved = (
                r.cost[before * count + a]
                + r.cost[end * count + after]
                - r.cost[before * count + after]
            )
            for k in range(nears, nears + r.width):
                c = r.near[k]
                if r.cost[row + c] >= saved - EPS:
                    break
                if (r.where[c] - at) * step % count < size:
                    continue
                for side in (1, -1):
                    d = r.places[(r.where[c] + side) % count]
                    if (r.where[d] - at) * step % count < size:
                        continue
                    gain = (
                        saved
                        + r.cost[c * count + d]
                        - r.cost[c * count + a]
                        - r.cost[end * count + d]
                    )
                    if gain > EPS:
                        put(r, at, step, size, c, d)
                        for one in (before, after, c, d, end):
                            touch(r, one)
                        return gain
    return 0.0


def put(r: Ring, at: int, step: int, size: int, c: int, d: int) -> None:
    """Take the stretch of ``size`` from index ``at`` and put it between ``c``, where it begins, and ``d``."""
    count, rest = len(r.places), len(r.places) - size
    for k in range(size):
        r.spare[k] = r.places[(at + step * k) % count]
    # Where c and d are among the others, which keep their order.
    i, j = r.where[c], r.where[d]
    for k in range(size):
        index = r.where[r.spare[k]]
        i, j = i - (index < r.where[c]), j - (index < r.where[d])
    forward = (j - i) % rest == 1
    goal = (i if forward else j) + 1
    low, high = close_up(r, size, goal, min(at, at + step * (size - 1)))
    for k in range(size):
        r.places[goal + k] = r.spare[k if forward else size - 1 - k]
    renumber(r, low, high)


def close_up(r: Ring, size: int, goal: int, begin: int) -> tuple[int, int]:
    """Move the others so that the stretch, at ``begin`` so far and in ``spare``, has its room at ``goal``: from which
    index to before which one something changes.
    """
    count = len(r.places)
    if begin >= 0 and begin + size <= count:
        for k in range(begin, goal):
            r.places[k] = r.places[k + size]
        for k in range(begin - 1, goal - 1, -1):
            r.places[k + size] = r.places[k]
        return min(goal, begin), max(goal, begin) + size
    # It lies over the end: the others begin at index 0 from now on.
    first = (begin + size) % count
    for k in range(count - size):
        r.places[k] = r.places[first + k]
    for k in range(count - size - 1, goal - 1, -1):
        r.places[k + size] = r.places[k]
    return 0, count


def improve(r: Ring) -> float:
    """What moves from the places that wait, and of all whose neighbours change, gain in all."""
    total = 0.0
    while r.marks[WAITING]:
        r.marks[WAITING] -= 1
        place = r.queue[r.marks[WAITING]]
        r.waits[place] = 0
        r.marks[TOUCHED] = 0
        gained = reverse(r, place)
        if gained == 0.0:
            gained = carry(r, place)
        if gained > 0.0:
            total += gained
            push(r, place)
            for k in range(r.marks[TOUCHED]):
                push(r, r.touched[k])
    return total


def kick(r: Ring) -> None:
    """Exchange two neighbouring stretches, shorten what is around, and undo it where the ring is longer then."""
    count = len(r.places)
    most = min(EXCHANGED, (count - 2) // 2)
    one = 1 + throw(r, most)
    two = 1 + throw(r, most)
    low = 1 + throw(r, count - one - two)
    middle, high = low + one, low + one + two
    a, b, c, d = r.places[low - 1], r.places[low], r.places[middle - 1], r.places[middle]
    e, f = r.places[high - 1], r.places[high % count]
    gained = r.cost[a * count + b] + r.cost[c * count + d] + r.cost[e * count + f]
    gained = gained - r.cost[a * count + d] - r.cost[e * count + b] - r.cost[c * count + f]
    r.before[:], r.where_before[:] = r.places, r.where
    for k in range(two):
        r.places[low + k] = r.before[middle + k]
    for k in range(one):
        r.places[low + two + k] = r.before[low + k]
    renumber(r, low, high)
    for place in (a, b, c, d, e, f):
        r.waits[place] = 0
        push(r, place)
    gained += improve(r)
    if gained < EPS:
        r.places[:], r.where[:] = r.before, r.where_before


def search(r: Ring, kicks: int) -> None:
    """The ring is shortened as it is, and by so many kicks."""
    for k in range(len(r.places)):
        push(r, r.places[k])
    improve(r)
    for _ in range(kicks):
        kick(r)
