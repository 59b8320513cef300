"""A grid over a mesh that knows through which cells the surface passes.

Most boxes are tested by the grid alone, without any triangle.
"""

from __future__ import annotations

import itertools

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.ragged import list_owners, number_rows
from camgen.geometry.vectors import add_coordinates, measure_lengths
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray
from camgen.model.tolerance import NONZERO

#: Cells along the longest side of the box around a mesh of fewer than `_FEW_TRIANGLES` triangles,
#: where more cells take longer than they save, and around any other mesh.
_CELLS, _MANY_CELLS, _FEW_TRIANGLES = 24, 64, 5000
#: Rounding: distance from a box at which the surface counts as within, mm and as a fraction of a
#: cell.
_SLACK = 1e-6
#: States of a cell: unknown, outside the part, within the part, or passed by the surface.
UNKNOWN, OUTSIDE, WITHIN, PASSED = -1, 0, 1, 2


class Cells(Struct, frozen=True, eq=False):
    """A grid of X x Y x Z cells over a mesh.

    low: (3,) lower corner of the grid, mm.
    size: edge of a cell, mm.
    sums: (X + 1, Y + 1, Z + 1) number of cells before each corner that the surface passes.
    state: (X, Y, Z) state of each cell. The callers replace `UNKNOWN` when a cell is tested.
    """

    low: FloatArray
    size: float
    sums: NDArray[np.int32]
    state: NDArray[np.int8]

    def locate(self, points: FloatArray) -> tuple[IntArray, IntArray]:
        """Rows (n,) of the points (N, 3) that are in the grid, and the index (n,) of their cells.

        An index counts the cells of the flattened array `state`.
        """
        scaled = [(points[:, axis] - self.low[axis]) / self.size for axis in range(3)]
        is_in_grid = np.ones(len(points), dtype=np.bool_)
        for coordinate, count in zip(scaled, self.state.shape, strict=True):
            is_in_grid &= (coordinate >= 0) & (coordinate < count)
        rows = np.flatnonzero(is_in_grid)
        x, y, z = (coordinate[rows].astype(np.int64) for coordinate in scaled)
        _, height, depth = self.state.shape
        return rows, (x * height + y) * depth + z

    def middles(self, cell: IntArray) -> FloatArray:
        """Middles (N, 3) of the cells with these indices (N,)."""
        place = np.column_stack(np.unravel_index(cell, self.state.shape))
        return self.low + (place + 0.5) * self.size

    def near(self, centres: FloatArray, half: FloatArray) -> BoolArray:
        """Whether boxes may meet the surface (N,).

        centres, half: (N, 3) of boxes with edges along x, y and z, mm.
        """
        slack = _SLACK * (1 + self.size)
        ends: list[tuple[IntArray, IntArray]] = []
        for axis, count in enumerate(self.state.shape):
            middle = (centres[:, axis] - self.low[axis]) / self.size
            extent = (half[:, axis] + slack) / self.size
            # np.clip takes three times as long for the few boxes of most calls.
            first = np.maximum(np.minimum(np.floor(middle - extent), count), 0)
            last = np.maximum(np.minimum(np.floor(middle + extent + 1), count), 0)
            ends.append((first.astype(np.int64), last.astype(np.int64)))
        # Passed cells within a box, from the sums at its eight corners. They cancel for a box
        # outside the grid.
        total = np.zeros(len(centres), dtype=np.int64)
        sums = self.sums.ravel()
        _, height, depth = self.sums.shape
        for (i, x), (j, y) in itertools.product(enumerate(ends[0]), enumerate(ends[1])):
            column = (x * height + y) * depth
            part = sums[column + ends[2][1]] - sums[column + ends[2][0]]
            total += part if i == j else -part
        return total > 0


def divide_space(corners: FloatArray) -> Cells:
    """The grid over triangles (F, 3, 3)."""
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    cells = _CELLS if len(corners) < _FEW_TRIANGLES else _MANY_CELLS
    size = max(float((high - low).max()) / cells, 1e-3)
    low = low - size / 2
    shape = np.ceil((high - low) / size + 0.5).astype(np.int64)
    middles, half = _tile(corners, size)
    half += _SLACK * (1 + size)
    first = _find_cells(middles - half, low, size, shape)
    extra = _find_cells(middles + half, low, size, shape) - first
    passed = np.zeros(shape, dtype=np.bool_)
    # A rectangle is in one cell, or in a few neighbours of its first one.
    index = (first[0] * shape[1] + first[1]) * shape[2] + first[2]
    marked = passed.reshape(-1)
    for x in range(int(extra[0].max()) + 1):
        in_x = np.flatnonzero(extra[0] >= x)
        for y in range(int(extra[1][in_x].max()) + 1):
            in_y = in_x[extra[1][in_x] >= y]
            for z in range(int(extra[2][in_y].max(initial=0)) + 1):
                marked[index[in_y[extra[2][in_y] >= z]] + (x * shape[1] + y) * shape[2] + z] = True
    sums = np.zeros(shape + 1, dtype=np.int32)
    sums[1:, 1:, 1:] = passed.cumsum(axis=0).cumsum(axis=1).cumsum(axis=2)
    return Cells(low, size, sums, np.where(passed, PASSED, UNKNOWN).astype(np.int8))


def _find_cells(points: FloatArray, low: FloatArray, size: float, shape: IntArray) -> IntArray:
    """Numbers (3, N) along x, y and z of the cells nearest to points (N, 3)."""
    scaled = np.ascontiguousarray(((points - low) / size).T)
    return np.clip(np.floor(scaled).astype(np.int64), 0, shape[:, None] - 1)


def _tile(corners: FloatArray, size: float) -> tuple[FloatArray, FloatArray]:
    """Cover triangles (F, 3, 3) with N rectangles no wider than `size`.

    Returns the middles (N, 3) of the rectangles, and half the edges (N, 3) of the boxes around
    them. The rectangles are in rows along the longest side. A row ends where its triangle ends.
    """
    a, b, c = np.ascontiguousarray(corners.transpose(1, 0, 2))
    ab, bc, ca = (add_coordinates(side * side) for side in (b - a, c - b, a - c))
    longest = np.maximum(np.maximum(ab, bc), ca)
    # The corners are renamed so that ab is the longest side and c is above it.
    ab_is_longest = (ab == longest)[:, None]
    bc_is_longest = (bc == longest)[:, None]
    a, b, c = np.where(ab_is_longest, (a, b, c), np.where(bc_is_longest, (b, c, a), (c, a, b)))
    width = np.sqrt(longest)
    along = (b - a) / np.maximum(width, NONZERO)[:, None]
    foot = ((c - a) * along).sum(axis=1)
    up = c - a - foot[:, None] * along
    rows = _count_parts(measure_lengths(up), size)
    triangle = list_owners(rows)
    fraction = number_rows(rows) / rows[triangle]
    left, span = foot[triangle] * fraction, width[triangle] * (1 - fraction)
    parts = _count_parts(span, size)
    row = list_owners(parts)
    half = span / parts / 2
    half_up = up[triangle] / rows[triangle, None] / 2
    places = left[row] + (2 * number_rows(parts) + 1) * half[row]
    row_middles = a[triangle] + 2 * (number_rows(rows) + 0.5)[:, None] * half_up
    middles = row_middles[row] + places[:, None] * along[triangle][row]
    return middles, (half[:, None] * np.abs(along[triangle]) + np.abs(half_up))[row]


def _count_parts(length: FloatArray, size: float) -> IntArray:
    """Numbers (N,) of parts no longer than `size` into which lengths (N,) are divided."""
    return np.asarray(np.maximum(np.ceil(length / size), 1), dtype=np.int64)
