"""A tour as a ring of items, what its links cost, and the two changes that a local search makes.

This is plain arithmetic over sequences of numbers. The same lines run in Python over lists and,
compiled by ``order.solver.speed``, over arrays, with the same results to the last bit. So there is
no hypot, no power and no sum of an array.

A link costs the distance of two points in the plane, or an entry of a table (``link_cost``). An
open item is entered at one end and left at the other. A closed item is entered and left at the
same point, which is any of its samples. An item of a table has a single point.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

Ints = list[int]
Floats = list[float]

#: Kinds of items.
BOTH_WAYS, ONE_WAY, CLOSED = 0, 1, 2
#: Entries of `Run.marks`: number of items in the queue and its first entry, entries of the log,
#: whether changes are logged, work so far, state of the random numbers, perturbations in a row that
#: no rule allowed, and all perturbations that were tried.
QUEUED, HEAD, LOGGED, LOGS, WORK, DICE, IDLE, SHUFFLED = 0, 1, 2, 3, 4, 5, 6, 7
#: Kinds of entries of ``Run.log``, each five numbers.
_TURN, _CARRY, _POINT = 0, 1, 2
#: mm: a move in the plane that saves less is rounding, and is not made.
EPS = 1e-7
#: Moving this many items in the ring is as much work as evaluating one item.
_BULK = 64


class Scene(NamedTuple):
    """The problem, which does not change: N items with P points.

    x, y: (P,) coordinates of the points, mm; empty for a table.
    first: (N + 1,) index of the first point of each item.
    kind: (N,) BOTH_WAYS, ONE_WAY or CLOSED.
    step: (N,) largest distance of neighbouring samples of a closed item, mm.
    near: (N * width,) nearest items of each item, -1 after the last of them.
    min_cost: (N * width,) least cost of a link to each of `near`, in increasing order.
    width: length of a row of `near` and `min_cost`.
    parent: (N,) item that has to come later, -1 for none.
    children: (N + 1,) index into ``child`` where the children of each item begin.
    child: items by parent.
    rank: (N,) items of a lower rank come first.
    nowhere: point of a home that costs no distance, -1 where home has a place.
    directed: whether a rule forbids moves, so that the tour may not be reversed as a whole.
    table: (N * N,) cost from item to item, the same in both directions; empty in the plane.
    least: smallest improvement for which the shuffled tour replaces the one before.
    longest: largest number of items in each of the two stretches that a shuffle exchanges.
    shuffles: largest number of shuffles.
    newest_first: whether the item that was queued last is evaluated first.
    """

    x: Floats
    y: Floats
    first: Ints
    kind: Ints
    step: Floats
    near: Ints
    min_cost: Floats
    width: int
    parent: Ints
    children: Ints
    child: Ints
    rank: Ints
    nowhere: int
    directed: bool
    table: Floats
    least: float
    longest: int
    shuffles: int
    newest_first: bool


class Run(NamedTuple):
    """The tour and the state of the search, which change.

    ring: (N,) items in order.
    place: (N,) index of each item in ``ring``.
    enter, leave: (N,) points at which each item is entered and left.
    queue: items that wait for an evaluation, from ``marks[HEAD]`` on.
    waits: (N,) 1 for an item in the queue, else 0.
    log: changes for ``undo``, five numbers each.
    marks: counters, see ``QUEUED`` and the others.
    """

    ring: Ints
    place: Ints
    enter: Ints
    leave: Ints
    queue: Ints
    waits: Ints
    log: Ints
    marks: Ints


def measure_distance(s: Scene, p: int, q: int) -> float:
    """Distance of two points in the plane, mm."""
    x, y, nowhere = s.x, s.y, s.nowhere
    if nowhere >= 0 and nowhere in (p, q):
        return 0.0
    dx, dy = x[p] - x[q], y[p] - y[q]
    return sqrt(dx * dx + dy * dy)


def link_cost(s: Scene, p: int, q: int) -> float:
    """Cost of the link from point ``p`` to point ``q``, by the table or in the plane."""
    if len(s.table) > 0:
        return s.table[p * len(s.kind) + q]
    return measure_distance(s, p, q)


def after(r: Run, item: int) -> int:
    """The next item."""
    k = r.place[item] + 1
    return r.ring[k] if k < len(r.ring) else r.ring[0]


def ahead(r: Run, item: int) -> int:
    """The item before."""
    return r.ring[r.place[item] - 1] if r.place[item] else r.ring[len(r.ring) - 1]


def push(r: Run, item: int) -> None:
    """Queues the item for an evaluation, unless it waits already."""
    if not r.waits[item]:
        r.waits[item] = 1
        r.queue[(r.marks[HEAD] + r.marks[QUEUED]) % len(r.queue)] = item
        r.marks[QUEUED] += 1


def pop(s: Scene, r: Run) -> int:
    """The item that waits longest, or shortest with ``Scene.newest_first``."""
    r.marks[QUEUED] -= 1
    size = len(r.queue)
    if s.newest_first:
        item = r.queue[(r.marks[HEAD] + r.marks[QUEUED]) % size]
    else:
        item = r.queue[r.marks[HEAD]]
        r.marks[HEAD] = (r.marks[HEAD] + 1) % size
    r.waits[item] = 0
    return item


def note(r: Run, kind: int, a: int, b: int, c: int, d: int) -> None:
    """Logs a change for ``undo``."""
    if r.marks[LOGS]:
        k = 5 * r.marks[LOGGED]
        r.log[k : k + 5] = (kind, a, b, c, d)
        r.marks[LOGGED] += 1


def turn(s: Scene, r: Run, low: int, high: int) -> None:
    """Reverses the stretch from index ``low`` to ``high``, or the others: the tour is the same."""
    size = len(r.ring)
    count = (high - low) % size + 1
    other = low > high or low == 0 if s.directed else 2 * count > size
    if other:
        low, high, count = (high + 1) % size, (low - 1) % size, size - count
    note(r, _TURN, low, high, 0, 0)
    r.marks[WORK] += count // _BULK
    ring, place, enter, leave = r.ring, r.place, r.enter, r.leave
    i, j = low, high
    for _ in range((count + 1) // 2):
        a, b = ring[i], ring[j]
        ring[i], ring[j] = b, a
        place[a], place[b] = j, i
        enter[a], leave[a] = leave[a], enter[a]
        if a != b:
            enter[b], leave[b] = leave[b], enter[b]
        i = i + 1 if i + 1 < size else 0
        j = j - 1 if j else size - 1


def carry(r: Run, low: int, count: int, past: int, back: int) -> None:
    """Moves ``count`` items from index ``low`` on past the next ``past`` items.

    past: number of items, negative for the items before the stretch.
    back: 1 where the stretch is reversed, else 0.
    """
    size = len(r.ring)
    note(r, _CARRY, (low + past) % size, count, -past, back)
    steps = past if past > 0 else -past
    r.marks[WORK] += (steps + count) // _BULK
    ring, place = r.ring, r.place
    held = [ring[(low + k) % size] for k in range(count)]
    # Slices that do not run over the end of the ring: this is most of the work in Python.
    done = 0
    while done < steps:
        if past > 0:
            goal, source = (low + done) % size, (low + count + done) % size
            size_of_slice = min(steps - done, size - max(goal, source))
        else:
            goal, source = (low + count - done) % size or size, (low - done) % size or size
            size_of_slice = min(steps - done, goal, source)
            goal, source = goal - size_of_slice, source - size_of_slice
        ring[goal : goal + size_of_slice] = ring[source : source + size_of_slice]
        for k, item in enumerate(ring[goal : goal + size_of_slice], goal):
            place[item] = k
        done += size_of_slice
    for k in range(count):
        item = held[count - 1 - k] if back else held[k]
        goal = (low + past + k) % size
        ring[goal] = item
        place[item] = goal
        if back:
            r.enter[item], r.leave[item] = r.leave[item], r.enter[item]


def set_point(r: Run, item: int, point: int) -> None:
    """A closed item is entered and left at ``point``."""
    note(r, _POINT, item, r.enter[item], 0, 0)
    r.enter[item] = point
    r.leave[item] = point


def undo(s: Scene, r: Run) -> None:
    """Everything since the log was emptied."""
    r.marks[LOGS] = 0
    while r.marks[LOGGED]:
        r.marks[LOGGED] -= 1
        k = 5 * r.marks[LOGGED]
        if r.log[k] == _TURN:
            turn(s, r, r.log[k + 1], r.log[k + 2])
        elif r.log[k] == _CARRY:
            carry(r, r.log[k + 1], r.log[k + 2], r.log[k + 3], r.log[k + 4])
        else:
            set_point(r, r.log[k + 1], r.log[k + 2])
    r.marks[LOGS] = 1


def choose_sample(s: Scene, item: int, p: int, q: int, now: int) -> int:
    """The sample of a closed item with the shortest path from point p over it to point q.

    now: the current sample, which stays unless another is shorter.

    The paths over neighbouring samples differ dy_q at most twice the distance of the samples. So a
    longer path says how many samples can be skipped.
    """
    if p == s.nowhere:
        p = q
    if q == s.nowhere:
        q = p
    if p == s.nowhere:
        return now
    # Written out, without calls: most of the time of the search in Python is here.
    x, y = s.x, s.y
    px, py, qx, qy = x[p], y[p], x[q], y[q]
    dx_p, dy_p, dx_q, dy_q = px - x[now], py - y[now], qx - x[now], qy - y[now]
    best = sqrt(dx_p * dx_p + dy_p * dy_p) + sqrt(dx_q * dx_q + dy_q * dy_q) - EPS
    if best <= measure_distance(s, p, q):
        return now
    choice = now
    k = s.first[item]
    stop = s.first[item + 1]
    step = 2.0 * s.step[item]
    while k < stop:
        dx_p, dy_p, dx_q, dy_q = px - x[k], py - y[k], qx - x[k], qy - y[k]
        cost = sqrt(dx_p * dx_p + dy_p * dy_p) + sqrt(dx_q * dx_q + dy_q * dy_q)
        if cost < best:
            best = cost
            choice = k
            k += 1
        else:
            k += 1 + int((cost - best) / step)
    return choice


def improve_item(s: Scene, r: Run, item: int) -> float:
    """Starts a closed item at its best point, or reverses an open item in its place; the change."""
    p, q, now, end = r.leave[ahead(r, item)], r.enter[after(r, item)], r.enter[item], r.leave[item]
    if s.kind[item] == BOTH_WAYS:
        change = (
            measure_distance(s, p, end)
            + measure_distance(s, now, q)
            - measure_distance(s, p, now)
            - measure_distance(s, end, q)
        )
        if change > -EPS:
            return 0.0
        turn(s, r, r.place[item], r.place[item])
        return change
    if s.kind[item] == ONE_WAY or s.first[item + 1] - s.first[item] == 1:
        return 0.0
    point = choose_sample(s, item, p, q, now)
    if point == now:
        return 0.0
    set_point(r, item, point)
    return (
        measure_distance(s, p, point)
        + measure_distance(s, point, q)
        - measure_distance(s, p, now)
        - measure_distance(s, now, q)
    )


def may_turn(s: Scene, r: Run, low: int, high: int) -> bool:
    """No rule forbids ``turn``."""
    if not s.directed:
        return True
    size = len(r.ring)
    if low > high or low == 0:
        low, high = (high + 1) % size, (low - 1) % size
    if low > high or low == 0 or s.rank[r.ring[low]] != s.rank[r.ring[high]]:
        return False
    r.marks[WORK] += (high - low) // _BULK
    place, kind, parent = r.place, s.kind, s.parent
    for item in r.ring[low : high + 1]:
        if kind[item] == ONE_WAY:
            return False
        later = parent[item]
        if later >= 0 and low <= place[later] <= high:
            return False
    return True


def may_carry(s: Scene, r: Run, low: int, count: int, past: int, back: int) -> bool:
    """No rule forbids ``carry``, given that the stretch and what it passes do not hold home."""
    if not s.directed:
        return True
    left = low if past > 0 else low + past
    right = low + count - 1 + past if past > 0 else low + count - 1
    if left < 1 or right >= len(r.ring) or s.rank[r.ring[left]] != s.rank[r.ring[right]]:
        return False
    for k in range(low, low + count):
        item = r.ring[k]
        if back and s.kind[item] == ONE_WAY:
            return False
        later = s.parent[item]
        if later >= 0:
            inside = low <= r.place[later] < low + count
            if (back and inside) or (past > 0 and not inside and low <= r.place[later] <= right):
                return False
        if past < 0:
            for m in range(s.children[item], s.children[item + 1]):
                if left <= r.place[s.child[m]] < low:
                    return False
    return True
