"""Closed curves of an image as one table, so that all paths of a part are computed at once.

Points are complex numbers u + iv, in pixels of the view, with v down. A product with i is a quarter
turn from u to v. It is clockwise on the screen, and clockwise in the work plane, whose y points up.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.ragged import compute_first_rows, list_owners, number_rows
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray

ComplexArray = NDArray[np.complex128]
Number = TypeVar("Number", bound=np.inexact)


class Rings(Struct, frozen=True, eq=False):
    """L closed curves with N points in all.

    first: (L,) first row of each curve.
    count: (L,) number of its rows.
    loop: (N,) curve of each row.
    """

    first: IntArray
    count: IntArray
    loop: IntArray

    def __len__(self) -> int:
        return len(self.loop)

    def along(self, rows: IntArray, steps: IntArray | int) -> IntArray:
        """The rows `steps` places after `rows` on the same curve; the two shapes are broadcast."""
        first, count = self.first[self.loop[rows]], self.count[self.loop[rows]]
        return np.asarray(first + (rows - first + steps) % count)

    def shifted(self, steps: int) -> IntArray:
        """(N,) the row `steps` places after each row on its curve."""
        return self.along(np.arange(len(self)), steps)

    def around(self, values: NDArray[Number], half: int) -> NDArray[Number]:
        """Sums of `values` (N, ...) over each row and `half` rows before and after it.

        On a curve with fewer than 2 `half` + 1 rows some are counted more than once.
        """
        size = self.count + 2 * half
        loop = list_owners(size)
        rows = self.first[loop] + (number_rows(size) - half) % self.count[loop]
        begin = np.arange(len(self.loop)) + 2 * half * self.loop
        total = np.zeros((len(rows) + 1, *values.shape[1:]), dtype=values.dtype)
        np.cumsum(values[rows], axis=0, out=total[1:])
        sums: NDArray[Number] = total[begin + 2 * half + 1] - total[begin]
        return sums

    def mean(self, values: NDArray[Number]) -> NDArray[Number]:
        """(L, ...) means of `values` (N, ...) over each curve; no curve may be empty."""
        total = np.add.reduceat(values, self.first, axis=0)
        means: NDArray[Number] = (total.T / self.count).T.astype(values.dtype)
        return means


def make_rings(counts: Sequence[int] | IntArray) -> Rings:
    """The table of curves with `counts` (L,) points each."""
    count = np.asarray(counts, dtype=np.int64)
    return Rings(compute_first_rows(count), count, list_owners(count))


def measure_steps(table: Rings, points: ComplexArray) -> FloatArray:
    """(N,) distance from each point to the next one of its curve, px."""
    return np.asarray(np.abs(points[table.shifted(1)] - points))


def measure_perimeters(table: Rings, points: ComplexArray) -> FloatArray:
    """(L,) lengths of the closed curves, px."""
    sums = np.bincount(table.loop, measure_steps(table, points), len(table.count))
    return np.asarray(sums, dtype=np.float64)


def space_evenly(
    table: Rings, points: ComplexArray, *columns: ComplexArray
) -> tuple[Rings, list[ComplexArray]]:
    """The curves with points at equal distances of about 1 px, at least 8 each.

    Returns the new table, and `points` and `columns`, interpolated linearly between the old points.
    """
    step = measure_steps(table, points)
    run = np.append(0.0, np.cumsum(step))
    begin, end = run[table.first], run[table.first + table.count]
    result = make_rings(np.maximum(np.ceil(end - begin), 8).astype(np.int64))
    place = number_rows(result.count) / result.count[result.loop]
    wanted = begin[result.loop] + place * (end - begin)[result.loop]
    low = np.clip(np.searchsorted(run, wanted, side="right") - 1, 0, len(table) - 1)
    # Rounding could give the last row of a curve a place on the next curve.
    first_row, count = table.first[result.loop], table.count[result.loop]
    low = np.clip(low, first_row, first_row + count - 1)
    part = np.clip((wanted - run[low]) / np.where(step[low] > 0, step[low], 1.0), 0.0, 1.0)
    high = table.along(low, 1)
    columns = points, *columns
    return result, [column[low] + part * (column[high] - column[low]) for column in columns]


def find_latest(table: Rings, known: BoolArray) -> IntArray:
    """(N,) the last row that is `known`, at or before each row on its closed curve.

    It is -1 on a curve without any known row. known: (N,).
    """
    row = np.maximum.accumulate(np.where(known, np.arange(len(table)), -1))
    first = table.first[table.loop]
    row = np.where(row < first, row[(table.first + table.count - 1)[table.loop]], row)
    return np.where(row < first, -1, row)


def apply_hysteresis(table: Rings, is_on: BoolArray, is_off: BoolArray, default: bool) -> BoolArray:
    """A switch with hysteresis along every closed curve, (N,).

    It is true from a row of `is_on` (N,) until one of `is_off` (N,). Rows that are neither keep the
    state of the row before. A curve of such rows alone has the value `default`.
    """
    row = find_latest(table, is_on | is_off)
    return np.where(row >= 0, is_on[row], default)


def normalize(vectors: ComplexArray) -> ComplexArray:
    """`vectors` divided by their lengths; zero stays zero."""
    # Faster than `abs`, which guards against overflow.
    size = np.sqrt(vectors.real**2 + vectors.imag**2)
    return np.asarray(vectors / np.where(size > 0, size, 1.0))
