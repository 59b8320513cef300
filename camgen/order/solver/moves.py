"""The moves at an item in the plane: 2-opt and Or-opt to near items, with the choice of starts.

2-opt reverses a stretch (Croes, 1958), Or-opt relocates up to three items (Or, 1976). The move that
saves most is made. Like ``kernel`` this runs in Python and compiled.
"""

from __future__ import annotations

from camgen.order.solver.kernel import (
    BOTH_WAYS,
    CLOSED,
    EPS,
    Run,
    Scene,
    after,
    ahead,
    carry,
    choose_sample,
    improve_item,
    may_carry,
    may_turn,
    measure_distance,
    push,
    set_point,
    turn,
)

#: Largest number of items that are relocated together.
_LONGEST_RELOCATED = 3


#: The end of an item that a move links to another item: the item, its point at that end, and the
#: point of the item on its other side, which is read of a closed item alone. A plain tuple: a class
#: with names makes a search a twentieth slower.
End = tuple[int, int, int]


def choose_samples(s: Scene, first: End, second: End) -> tuple[float, int, int]:
    """The best samples of linked items: the mm that they save, and the point of each item.

    An open item keeps its point.
    """
    (a, pa, beyond_a), (b, pb, beyond_b) = first, second
    na, nb = pa, pb
    saved = measure_distance(s, pa, pb)
    if s.kind[a] == CLOSED:
        saved += measure_distance(s, beyond_a, pa)
        na = choose_sample(s, a, beyond_a, pb, pa)
    if s.kind[b] == CLOSED:
        saved += measure_distance(s, pb, beyond_b)
        nb = choose_sample(s, b, na, beyond_b, pb)
    saved -= measure_distance(s, na, nb)
    if s.kind[a] == CLOSED:
        saved -= measure_distance(s, beyond_a, na)
    if s.kind[b] == CLOSED:
        saved -= measure_distance(s, nb, beyond_b)
    return saved, na, nb


def relink(s: Scene, r: Run, a: int, forward: bool) -> float:
    """2-opt: links ``a`` to a near item, and reverses the stretch between; the change.

    forward: ``a`` is linked at the end where it is left, else at the end where it is entered.
    """
    ring, place, size = r.ring, r.place, len(r.ring)
    # A negative index counts from the end, in Python and compiled, so the ring has no ends.
    ahead_of, after_of = (-1, 1 - size) if forward else (1 - size, -1)
    leave, enter = (r.leave, r.enter) if forward else (r.enter, r.leave)
    b = ring[place[a] + after_of]
    pa, pb = leave[a], enter[b]
    out_a, out_b = leave[ring[place[a] + ahead_of]], enter[ring[place[b] + after_of]]
    old = measure_distance(s, pa, pb)
    own_a, end_a = (measure_distance(s, out_a, pa), out_a) if s.kind[a] == CLOSED else (0.0, pa)
    own_b, end_b = (measure_distance(s, pb, out_b), out_b) if s.kind[b] == CLOSED else (0.0, pb)
    best, best_c = -EPS, -1
    na, nb, nc, nd = pa, pb, pa, pb
    for k in range(a * s.width, (a + 1) * s.width):
        c = s.near[k]
        if c < 0 or s.min_cost[k] >= old + own_a:
            break
        d = ring[place[c] + after_of]
        if c == b or d == a:
            continue
        pc, pd = leave[c], enter[d]
        ac, bd = measure_distance(s, pa, pc), measure_distance(s, pb, pd)
        change = ac + bd - old - measure_distance(s, pc, pd)
        ma, mb, mc, md = pa, pb, pc, pd
        # Neighbours of a and b choose their samples after the move.
        e, f = ring[place[c] + ahead_of], ring[place[d] + after_of]
        if e not in (a, b) and f not in (a, b):
            out_c, out_d = leave[e], enter[f]
            own_c, end_c = (
                (measure_distance(s, pc, out_c), out_c) if s.kind[c] == CLOSED else (0.0, pc)
            )
            own_d, end_d = (
                (measure_distance(s, pd, out_d), out_d) if s.kind[d] == CLOSED else (0.0, pd)
            )
            # At least as much as ``choose_samples`` saves: nothing is shorter than a straight line.
            first = (
                0.0
                if end_a == pa and end_c == pc
                else own_a + own_c + ac - measure_distance(s, end_a, end_c)
            )
            second = (
                0.0
                if end_b == pb and end_d == pd
                else own_b + own_d + bd - measure_distance(s, end_b, end_d)
            )
            if change - first - second < best:
                saved, ma, mc = choose_samples(s, (a, pa, out_a), (c, pc, out_c))
                change -= saved
                saved, mb, md = choose_samples(s, (b, pb, out_b), (d, pd, out_d))
                change -= saved
        if change < best:
            low, high = (place[b], place[c]) if forward else (place[c], place[b])
            if may_turn(s, r, low, high):
                best, best_c = change, c
                na, nb, nc, nd = ma, mb, mc, md
    if best_c < 0:
        return 0.0
    c = best_c
    d = after(r, c) if forward else ahead(r, c)
    for item, point in ((a, na), (b, nb), (c, nc), (d, nd)):
        begin(s, r, item, point)
        push(r, item)
    low, high = (b, c) if forward else (c, b)
    turn(s, r, place[low], place[high])
    return best


def begin(s: Scene, r: Run, item: int, point: int) -> None:
    """Starts a closed item at ``point``."""
    if s.kind[item] == CLOSED and r.enter[item] != point:
        set_point(r, item, point)


def between(s: Scene, r: Run, head: int, tail: int, p: int, q: int) -> tuple[float, int, int]:
    """The stretch from ``head`` to ``tail`` between the points p and q.

    Returns the mm that it adds, 1 where it is run backwards, else 0, and the point of a single
    closed item, else -1.
    """
    gap = measure_distance(s, p, q)
    if head == tail and s.kind[head] == CLOSED:
        point = choose_sample(s, head, p, q, r.enter[head])
        return measure_distance(s, p, point) + measure_distance(s, point, q) - gap, 0, point
    cost = measure_distance(s, p, r.enter[head]) + measure_distance(s, r.leave[tail], q) - gap
    turned = measure_distance(s, p, r.leave[tail]) + measure_distance(s, r.enter[head], q) - gap
    if turned < cost and (head != tail or s.kind[head] == BOTH_WAYS):
        return turned, 1, -1
    return cost, 0, -1


def insert(s: Scene, r: Run, a: int, count: int, leading: bool) -> float:  # noqa: C901 (a loop)
    """Or-opt: relocates ``count`` items to beside an item that is near ``a``; the change.

    leading: ``a`` is the first of them, else the last.
    """
    size = len(r.ring)
    low = r.place[a] if leading else (r.place[a] - count + 1) % size
    head, tail = r.ring[low], r.ring[(low + count - 1) % size]
    if s.directed and ((low + count - 1) % size < count - 1 or low == 0):
        return 0.0
    p, n = ahead(r, head), after(r, tail)
    lp, en = r.leave[p], r.enter[n]
    saved = (
        measure_distance(s, lp, r.enter[head])
        + measure_distance(s, r.leave[tail], en)
        - measure_distance(s, lp, en)
    )
    if saved < EPS:
        return 0.0
    best, best_past, best_back, best_point = -EPS, 0, 0, -1
    for k in range(a * s.width, (a + 1) * s.width):
        c = s.near[k]
        if c < 0 or s.min_cost[k] >= saved:
            break
        offset = (r.place[c] - low) % size
        if offset < count:
            continue
        for side in range(2):
            # Between c and the item after it, or between the one before it and c.
            past = offset - count + 1 - side
            if past <= 0 or past >= size - count:
                continue
            u, v = (c, after(r, c)) if side == 0 else (ahead(r, c), c)
            cost, back, point = between(s, r, head, tail, r.leave[u], r.enter[v])
            if cost - saved < best:
                steps = shorter(s, low, count, past, size)
                if may_carry(s, r, low, count, steps, back):
                    best, best_past, best_back, best_point = cost - saved, steps, back, point
    if best_past == 0:
        return 0.0
    if best_point >= 0:
        begin(s, r, a, best_point)
    carry(r, low, count, best_past, best_back)
    for item in (p, n, head, tail, ahead(r, head), after(r, head), ahead(r, tail), after(r, tail)):
        push(r, item)
    return best


def shorter(s: Scene, low: int, count: int, past: int, size: int) -> int:
    """The number of items to pass, negative for backwards, where a stretch goes past ``past``
    items.

    Going back past all others leads to the same tour. A directed tour must not pass home; else
    the smaller number is chosen.
    """
    rest = size - count - past
    if s.directed:
        return past if low + count - 1 + past < size else -rest
    return past if past <= rest else -rest


def improve_in_plane(s: Scene, r: Run, a: int) -> float:
    """Makes a move of the first kind that shortens the tour at ``a``; the change, 0 for no move."""
    change = improve_item(s, r, a)
    if change < 0.0:
        for item in (ahead(r, a), after(r, a), a):
            push(r, item)
        return change
    for count in range(1, _LONGEST_RELOCATED + 1):
        change = insert(s, r, a, count, True)
        if change < 0.0:
            return change
        if count > 1:
            change = insert(s, r, a, count, False)
            if change < 0.0:
                return change
    change = relink(s, r, a, True)
    if change < 0.0:
        return change
    return relink(s, r, a, False)
