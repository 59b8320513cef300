"""The moves at an item whose links cost an entry of a table: 2-opt and Or-opt to its nearest ones.

The first move that improves the tour is made. Like ``kernel`` this runs in Python and compiled.
"""

from __future__ import annotations

from camgen.order.solver.kernel import Run, Scene, carry, push, turn

#: Largest number of items that are relocated together.
_LONGEST_RELOCATED = 3
#: A smaller improvement is rounding, in the unit of the costs.
EPS = 1e-9


def improve_by_table(s: Scene, r: Run, a: int) -> float:
    """Makes the first move at item ``a`` that improves the tour; the change, 0 for no move."""
    change = join_near(s, r, a)
    if change < 0.0:
        return change
    return relocate(s, r, a)


def join_near(s: Scene, r: Run, a: int) -> float:
    """2-opt: links ``a`` to a nearer item, and reverses the stretch between; the change."""
    ring, place, table = r.ring, r.place, s.table
    count, row = len(ring), a * len(ring)
    nearest = s.near[a * s.width : (a + 1) * s.width]
    for step in (1, -1):
        b = ring[(place[a] + step) % count]
        old = table[row + b]
        for c in nearest:
            cost = table[row + c]
            if cost >= old - EPS:
                break
            d = ring[(place[c] + step) % count]
            improvement = old + table[c * count + d] - cost - table[b * count + d]
            if improvement > EPS:
                # Item c follows a now: the stretch between them is reversed, or all the others.
                if step > 0:
                    turn(s, r, place[b], place[c])
                else:
                    turn(s, r, place[c], place[b])
                for item in (a, b, c, d):
                    push(r, item)
                return -improvement
    return 0.0


def relocate(s: Scene, r: Run, a: int) -> float:
    """Or-opt: relocates a stretch that begins at ``a`` so that ``a`` is beside a nearer item.

    Returns the change.
    """
    ring, place, table = r.ring, r.place, s.table
    count, row, start = len(ring), a * len(ring), place[a]
    nearest = s.near[a * s.width : (a + 1) * s.width]
    for step in (1, -1):
        before = ring[(start - step) % count]
        for size in range(1, _LONGEST_RELOCATED + 1):
            end = ring[(start + step * (size - 1)) % count]
            following = ring[(start + step * size) % count]
            saved = table[before * count + a] + table[end * count + following]
            saved -= table[before * count + following]
            for c in nearest:
                if table[row + c] >= saved - EPS:
                    break
                if (place[c] - start) * step % count < size:
                    continue
                for side in (1, -1):
                    d = ring[(place[c] + side) % count]
                    if (place[d] - start) * step % count < size:
                        continue
                    improvement = saved + table[c * count + d]
                    improvement = improvement - table[c * count + a] - table[end * count + d]
                    if improvement > EPS:
                        move_between(r, start, step * size, c, d)
                        for item in (a, before, following, c, d, end):
                            push(r, item)
                        return -improvement
    return 0.0


def move_between(r: Run, start: int, extent: int, c: int, d: int) -> None:
    """Moves a stretch between the neighbours ``c`` and ``d``, so that its first item follows ``c``.

    start: index of the first item of the stretch.
    extent: number of its items, negative where the stretch runs backwards along the ring.
    """
    place, count = r.place, len(r.ring)
    size = extent if extent > 0 else -extent
    begin = (start if extent > 0 else start + extent + 1) % count
    excess = begin + size - count
    if excess > 0:
        # The stretch lies over the end of the ring: it comes to the end as a whole.
        carry(r, 0, excess, count - excess, 0)
        begin = count - size
    # The indices of c and d among the other items.
    i = place[c] if place[c] < begin else place[c] - size
    j = place[d] if place[d] < begin else place[d] - size
    is_forward = (j - i) % (count - size) == 1
    goal = (i if is_forward else j) + 1
    carry(r, begin, size, goal - begin, 0 if is_forward == (extent > 0) else 1)
