"""Closed curves of an image as one table, so that all paths of a part are worked on at once.

Points are complex numbers u + iv of view pixels, v down. A quarter turn from u to v is then a product with i: seen on
the screen it is clockwise, in the work plane, whose y runs up, it is clockwise as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.ragged import begins, owners, ramp
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray

ComplexArray = NDArray[np.complex128]
Number = TypeVar("Number", bound=np.inexact)


class Rings(Struct, frozen=True, eq=False):
    """L closed curves with N points in all. first, count: (L,) the rows of each. loop: (N,) the curve of each row."""

    first: IntArray
    count: IntArray
    loop: IntArray

    def __len__(self) -> int:
        return len(self.loop)

    def along(self, rows: IntArray, by: IntArray | int) -> IntArray:
        """The rows that lie ``by`` places further on the same curve. rows, by: of shapes that go together."""
        first, count = self.first[self.loop[rows]], self.count[self.loop[rows]]
        return np.asarray(first + (rows - first + by) % count)

    def shifted(self, by: int) -> IntArray:
        """(N,) the row ``by`` places further for every row."""
        return self.along(np.arange(len(self)), by)

    def around(self, values: NDArray[Number], half: int) -> NDArray[Number]:
        """Sums of ``values`` (N, ...) over the rows up to ``half`` before and after each; short curves count twice."""
        size = self.count + 2 * half
        loop = owners(size)
        rows = self.first[loop] + (ramp(size) - half) % self.count[loop]
        begin = np.arange(len(self.loop)) + 2 * half * self.loop
        total = np.zeros((len(rows) + 1, *values.shape[1:]), dtype=values.dtype)
        np.cumsum(values[rows], axis=0, out=total[1:])
        found: NDArray[Number] = total[begin + 2 * half + 1] - total[begin]
        return found

    def mean(self, values: NDArray[Number]) -> NDArray[Number]:
        """(L, ...) means over each curve; none is empty."""
        total = np.add.reduceat(values, self.first, axis=0)
        found: NDArray[Number] = (total.T / self.count).T.astype(values.dtype)
        return found


def rings(counts: Sequence[int] | IntArray) -> Rings:
    """The table of curves with so many points each."""
    count = np.asarray(counts, dtype=np.int64)
    return Rings(begins(count), count, owners(count))


def lengths(table: Rings, points: ComplexArray) -> FloatArray:
    """(N,) distance from each point to the next one of its curve."""
    return np.asarray(np.abs(points[table.shifted(1)] - points))


def perimeters(table: Rings, points: ComplexArray) -> FloatArray:
    """(L,) lengths of the closed curves."""
    return np.asarray(
        np.bincount(table.loop, lengths(table, points), len(table.count)), dtype=np.float64
    )


def evenly(
    table: Rings, points: ComplexArray, *columns: ComplexArray
) -> tuple[Rings, list[ComplexArray]]:
    """The curves with a point every pixel or so of their length, ``columns`` along with them, by straight lines."""
    step = lengths(table, points)
    run = np.append(0.0, np.cumsum(step))
    begin, end = run[table.first], run[table.first + table.count]
    result = rings(np.maximum(np.ceil(end - begin), 8).astype(np.int64))
    place = ramp(result.count) / result.count[result.loop]
    wanted = begin[result.loop] + place * (end - begin)[result.loop]
    low = np.clip(np.searchsorted(run, wanted, side="right") - 1, 0, len(table) - 1)
    # A row of rounding beyond its curve would be read from the next one.
    low = np.clip(
        low, table.first[result.loop], table.first[result.loop] + table.count[result.loop] - 1
    )
    part = np.clip((wanted - run[low]) / np.where(step[low] > 0, step[low], 1.0), 0.0, 1.0)
    high = table.along(low, 1)
    return result, [
        column[low] + part * (column[high] - column[low]) for column in (points, *columns)
    ]


def latest(table: Rings, known: BoolArray) -> IntArray:
    """(N,) the last row that is ``known``, this one or before it on its curve, whose start goes on from its end; -1 on
    curves without any.
    """
    row = np.maximum.accumulate(np.where(known, np.arange(len(table)), -1))
    first = table.first[table.loop]
    wrapped = row[(table.first + table.count - 1)[table.loop]]
    row = np.where(row < first, wrapped, row)
    return np.where(row < first, -1, row)


def hold_switch(table: Rings, on: BoolArray, off: BoolArray, default: bool) -> BoolArray:
    """A switch with hysteresis along every closed curve: true from a row of ``on`` until one of ``off``.

    Rows that are neither keep the state of the row before them; a curve of nothing else is ``default``.
    """
    row = latest(table, on | off)
    return np.where(row >= 0, on[row], default)


def unit(vectors: ComplexArray) -> ComplexArray:
    """``vectors`` at length 1; zero stays zero."""
    # Faster than the absolute value, which guards against overflow.
    size = np.sqrt(vectors.real**2 + vectors.imag**2)
    return np.asarray(vectors / np.where(size > 0, size, 1.0))
