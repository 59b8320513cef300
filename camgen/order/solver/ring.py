"""The shortest ring through places whose costs are a table, the same both ways: points that an arm goes to.

Moves that reverse a stretch (2-opt) or carry a short one elsewhere (Or-opt) are tried from one place to its nearest
ones, and again where two neighbouring stretches were exchanged; what is longer after that is undone.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from camgen.model.pose import FloatArray
from camgen.order.solver.matrix import Dice

#: Near places that are tried, the longest stretch that is carried elsewhere, and the longest that are exchanged.
_NEAR, _CARRIED, _EXCHANGED = 10, 3, 30
#: A gain below is rounding.
_EPS = 1e-9


def shorten_ring(table: FloatArray, start: Sequence[int], kicks: int, seed: int = 0) -> list[int]:
    """A ring no longer than ``start``, which holds each of n places once, by ``kicks`` exchanges. table: (n, n) costs.

    The first place stays the first. Equal seeds, equal rings. ValueError for a table that is not the same both ways.
    """
    if not np.array_equal(table, table.T):
        raise ValueError("the costs of a ring are the same both ways")
    count = len(start)
    if count < 5:
        return list(start)
    near = np.argsort(table + np.diag(np.full(count, np.inf)), axis=1, kind="stable")[:, :_NEAR].tolist()
    ring = _Ring(table.tolist(), near, list(start))
    ring.improve(list(start))
    dice = Dice(seed)
    for _ in range(kicks):
        ring.kick(dice)
    at = ring.places.index(start[0])
    return ring.places[at:] + ring.places[:at]


class _Ring:
    """places: the ring. where: by place, its index. cost, near: of the table."""

    def __init__(self, cost: list[list[float]], near: list[list[int]], places: list[int]) -> None:
        self.cost, self.near, self.places = cost, near, places
        self.where = [0] * len(places)
        self._renumber(0, len(places))

    def _renumber(self, low: int, high: int) -> None:
        for k in range(low, high):
            self.where[self.places[k]] = k

    def kick(self, dice: Dice) -> None:
        """Exchange two neighbouring stretches, shorten what is around, and undo it where the ring is longer then."""
        count, cost, places = len(self.places), self.cost, self.places
        most = min(_EXCHANGED, (count - 2) // 2)
        one, two = 1 + dice.below(most), 1 + dice.below(most)
        low = 1 + dice.below(count - one - two)
        middle, high = low + one, low + one + two
        a, b, c, d = places[low - 1], places[low], places[middle - 1], places[middle]
        e, f = places[high - 1], places[high % count]
        gained = cost[a][b] + cost[c][d] + cost[e][f] - cost[a][d] - cost[e][b] - cost[c][f]
        before = places[:]
        places[low:high] = places[middle:high] + places[low:middle]
        self._renumber(low, high)
        gained += self.improve([a, b, c, d, e, f])
        if gained < _EPS:
            self.places = before
            self._renumber(0, count)

    def improve(self, queue: list[int]) -> float:
        """What moves from the places of ``queue``, and of all whose neighbours change, gain in all."""
        waits = set(queue)
        total = 0.0
        while queue:
            place = queue.pop()
            waits.discard(place)
            gained, touched = self._reverse(place)
            if not gained:
                gained, touched = self._carry(place)
            if gained:
                total += gained
                for one in (place, *touched):
                    if one not in waits:
                        waits.add(one)
                        queue.append(one)
        return total

    def _reverse(self, a: int) -> tuple[float, tuple[int, ...]]:
        """The first 2-opt move that puts a place near to ``a`` beside it."""
        cost, places, where, count = self.cost, self.places, self.where, len(self.places)
        for step in (1, -1):
            b = places[(where[a] + step) % count]
            own = cost[a][b]
            for c in self.near[a]:
                near = cost[a][c]
                if near >= own - _EPS:
                    break
                d = places[(where[c] + step) % count]
                gain = own + cost[c][d] - near - cost[b][d]
                if gain > _EPS:
                    # After a comes c: what is between them, or all the rest, is turned round.
                    if step > 0:
                        self._turn(where[b], where[c])
                    else:
                        self._turn(where[c], where[b])
                    return gain, (b, c, d)
        return 0.0, ()

    def _turn(self, first: int, last: int) -> None:
        """Reverse the stretch from index ``first`` to ``last``; or the rest, if that is shorter."""
        places, count = self.places, len(self.places)
        length = (last - first) % count + 1
        if 2 * length > count:
            first, last, length = (last + 1) % count, (first - 1) % count, count - length
        if first <= last:
            places[first : last + 1] = places[first : last + 1][::-1]
            self._renumber(first, last + 1)
            return
        stretch = [places[(first + k) % count] for k in range(length)]
        for k, place in enumerate(reversed(stretch)):
            at = (first + k) % count
            places[at] = place
            self.where[place] = at

    def _carry(self, a: int) -> tuple[float, tuple[int, ...]]:
        """The first Or-opt move that carries a stretch that begins at ``a`` to beside a place near to ``a``."""
        cost, places, where, count = self.cost, self.places, self.where, len(self.places)
        at = where[a]
        for step in (1, -1):
            for size in range(1, _CARRIED + 1):
                end = places[(at + step * (size - 1)) % count]
                before, after = places[(at - step) % count], places[(at + step * size) % count]
                saved = cost[before][a] + cost[end][after] - cost[before][after]
                for c in self.near[a]:
                    if cost[a][c] >= saved - _EPS:
                        break
                    if (where[c] - at) * step % count < size:
                        continue
                    for side in (1, -1):
                        d = places[(where[c] + side) % count]
                        if (where[d] - at) * step % count < size:
                            continue
                        gain = saved + cost[c][d] - cost[c][a] - cost[end][d]
                        if gain > _EPS:
                            self._put(at, step, size, c, d)
                            return gain, (before, after, c, d, end)
        return 0.0, ()

    def _put(self, at: int, step: int, size: int, c: int, d: int) -> None:
        """Take the stretch of ``size`` from index ``at`` and put it between ``c``, where it begins, and ``d``."""
        places, count = self.places, len(self.places)
        stretch = [places[(at + step * k) % count] for k in range(size)]
        taken = set(stretch)
        rest = [place for place in places if place not in taken]
        i, j = rest.index(c), rest.index(d)
        forward = (j - i) % len(rest) == 1
        low = i if forward else j
        rest[low + 1 : low + 1] = stretch if forward else stretch[::-1]
        self.places = rest
        self._renumber(0, count)
