"""Many closed loops of points as one table: sums over a window along each loop, and neighbours around its end."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

IntArray = NDArray[np.int64]
ComplexArray = NDArray[np.complex128]
Number = TypeVar("Number", bound=np.inexact)


class Loops(Struct, frozen=True, eq=False):
    """first, count (L,): where each loop's rows begin and how many there are; loop (N,): which loop a row is of."""

    first: IntArray
    count: IntArray
    loop: IntArray

    def __len__(self) -> int:
        return len(self.loop)

    def beside(self, by: int) -> IntArray:
        """(N,) the row that is ``by`` rows further along the same loop."""
        start, size = self.first[self.loop], self.count[self.loop]
        return np.asarray(start + (np.arange(len(self.loop)) - start + by) % size)

    def around(self, values: NDArray[Number], half: int) -> NDArray[Number]:
        """Sums of ``values`` (N, ...) over the rows up to ``half`` before and after each; short loops count twice."""
        size = self.count + 2 * half
        loop = np.repeat(np.arange(len(size)), size)
        place = np.arange(len(loop)) - np.repeat(np.cumsum(size) - size, size)
        rows = self.first[loop] + (place - half) % self.count[loop]
        begin = np.arange(len(self.loop)) + 2 * half * self.loop
        total = np.zeros((len(rows) + 1, *values.shape[1:]), dtype=values.dtype)
        np.cumsum(values[rows], axis=0, out=total[1:])
        found: NDArray[Number] = total[begin + 2 * half + 1] - total[begin]
        return found

    def mean(self, values: NDArray[Number]) -> NDArray[Number]:
        """(L, ...) means over each loop."""
        total = np.add.reduceat(values, self.first, axis=0)
        found: NDArray[Number] = (total.T / self.count).T.astype(values.dtype)
        return found


def loops_of(count: IntArray) -> Loops:
    """Loops of so many rows each, one after the other; none is empty."""
    count = np.asarray(count, dtype=np.int64)
    return Loops(np.cumsum(count) - count, count, np.repeat(np.arange(len(count)), count))


def directions(loops: Loops, points: ComplexArray, half: int = 3) -> ComplexArray:
    """(N,) unit vectors along the loops: from the mean of the rows behind to that of the rows ahead."""
    # Telescoped: the sum of points ahead minus the sum of points behind.
    total = loops.around(points, half)
    ahead, behind = total[loops.beside(half)], total[loops.beside(-half)]
    along = ahead - behind
    size = np.abs(along)
    return np.asarray(np.where(size > 1e-9, along / np.maximum(size, 1e-9), 1.0))
