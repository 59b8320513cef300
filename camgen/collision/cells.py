"""A grid over a mesh: which of its cells the surface passes, so that most boxes need no look at any triangle."""

from __future__ import annotations

import itertools

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.ragged import owners, ramp
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray
from camgen.model.tolerance import NONZERO

#: Cells along the longest side of the mesh's box: of one of few triangles, where to make more takes longer than they
#: save, and of others.
_CELLS, _MANY_CELLS, _FEW = 24, 64, 5000
#: mm beside a box, and as a share of a cell, at which the surface counts as within: rounding.
_SLACK = 1e-6
#: Of a cell: it is not known, it is outside, it is within, the surface passes it.
UNKNOWN, OUTSIDE, WITHIN, PASSED = -1, 0, 1, 2


class Cells(Struct, frozen=True, eq=False):
    """low: (3,) the corner of the grid, size: mm of a cell. sums: (X + 1, Y + 1, Z + 1) how many cells before each
    corner the surface passes. state: (X, Y, Z) what is known of each cell; those that the surface does not pass are
    filled in as they are asked for.
    """

    low: FloatArray
    size: float
    sums: NDArray[np.int32]
    state: NDArray[np.int8]

    def of(self, points: FloatArray) -> tuple[IntArray, IntArray]:
        """Which of ``points`` (N, 3) are in the grid (n,), and in which of its cells, counted along it (n,)."""
        at = [(points[:, axis] - self.low[axis]) / self.size for axis in range(3)]
        there = np.ones(len(points), dtype=np.bool_)
        for own, count in zip(at, self.state.shape, strict=True):
            there &= (own >= 0) & (own < count)
        rows = np.flatnonzero(there)
        x, y, z = (own[rows].astype(np.int64) for own in at)
        _, height, depth = self.state.shape
        return rows, (x * height + y) * depth + z

    def middles(self, cell: IntArray) -> FloatArray:
        """The middles (N, 3) of cells (N,), counted along the grid."""
        return (
            self.low + (np.column_stack(np.unravel_index(cell, self.state.shape)) + 0.5) * self.size
        )

    def near(self, centres: FloatArray, reach: FloatArray) -> BoolArray:
        """Which boxes around ``centres`` (N, 3), half as wide as ``reach`` (N, 3), may meet the surface (N,)."""
        slack = _SLACK * (1 + self.size)
        ends: list[tuple[IntArray, IntArray]] = []
        for axis, count in enumerate(self.state.shape):
            at, room = (
                (centres[:, axis] - self.low[axis]) / self.size,
                (reach[:, axis] + slack) / self.size,
            )
            # np.clip takes three times as long for the few boxes of most questions.
            first, last = (
                np.maximum(np.minimum(np.floor(end), count), 0)
                for end in (at - room, at + room + 1)
            )
            ends.append((first.astype(np.int64), last.astype(np.int64)))
        # Of the sums at the eight corners; a box beside the grid has no room in it, and they cancel.
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
    cells = _CELLS if len(corners) < _FEW else _MANY_CELLS
    size = max(float((high - low).max()) / cells, 1e-3)
    low = low - size / 2
    shape = np.ceil((high - low) / size + 0.5).astype(np.int64)
    middles, room = _tile(corners, size)
    room += _SLACK * (1 + size)
    passed = np.zeros(shape, dtype=np.bool_)
    begin, end = (
        _cells_of(middles - room, low, size, shape),
        _cells_of(middles + room, low, size, shape),
    )
    # Column by column: a rectangle lies in one cell, or in a few beside each other.
    first = (begin[0] * shape[1] + begin[1]) * shape[2] + begin[2]
    more = [last - one for one, last in zip(begin, end, strict=True)]
    marked = passed.reshape(-1)
    for x in range(int(more[0].max()) + 1):
        in_x = np.flatnonzero(more[0] >= x)
        for y in range(int(more[1][in_x].max()) + 1):
            in_y = in_x[more[1][in_x] >= y]
            for z in range(int(more[2][in_y].max(initial=0)) + 1):
                marked[first[in_y[more[2][in_y] >= z]] + (x * shape[1] + y) * shape[2] + z] = True
    sums = np.zeros(shape + 1, dtype=np.int32)
    sums[1:, 1:, 1:] = passed.cumsum(axis=0).cumsum(axis=1).cumsum(axis=2)
    return Cells(low, size, sums, np.where(passed, PASSED, UNKNOWN).astype(np.int8))


def _cells_of(corners: FloatArray, low: FloatArray, size: float, shape: IntArray) -> list[IntArray]:
    """By axis the cells (N,) of points (N, 3), those beside the grid as the nearest in it."""
    scaled = (corners - low) / size
    return [
        np.clip(np.floor(column).astype(np.int64), 0, count - 1)
        for column, count in zip(scaled.T, shape.tolist(), strict=True)
    ]


def _tile(corners: FloatArray, size: float) -> tuple[FloatArray, FloatArray]:
    """Middles (N, 3), and half the edges (N, 3) of the boxes around them, of rectangles no wider than ``size`` that
    cover the triangles: in rows along the longest side, each of which ends where its triangle does.
    """
    a, b, c = np.ascontiguousarray(corners.transpose(1, 0, 2))
    ab, bc, ca = _squares(b - a), _squares(c - b), _squares(a - c)
    longest = np.maximum(np.maximum(ab, bc), ca)
    # Turned so that the longest side is the first one: the third corner is above it.
    first, second = (ab == longest)[:, None], (bc == longest)[:, None]
    a, b, c = (
        np.where(first, x, np.where(second, y, z)) for x, y, z in ((a, b, c), (b, c, a), (c, a, b))
    )
    wide = np.sqrt(longest)
    along = (b - a) / np.maximum(wide, NONZERO)[:, None]
    foot = ((c - a) * along).sum(axis=1)
    up = c - a - foot[:, None] * along
    rows = _count(np.sqrt(_squares(up)), size)
    own = owners(rows)
    share = ramp(rows) / rows[own]
    left, span = foot[own] * share, wide[own] * (1 - share)
    parts = _count(span, size)
    row = owners(parts)
    half = span / parts / 2
    tall = up[own] / rows[own, None] / 2
    places = left[row] + (2 * ramp(parts) + 1) * half[row]
    middles = (a[own] + 2 * (ramp(rows) + 0.5)[:, None] * tall)[row] + places[:, None] * along[own][
        row
    ]
    return middles, (half[:, None] * np.abs(along[own]) + np.abs(tall))[row]


def _count(lengths: FloatArray, size: float) -> IntArray:
    """Into how many parts no longer than ``size`` each of ``lengths`` (N,) is cut."""
    return np.asarray(np.maximum(np.ceil(lengths / size), 1), dtype=np.int64)


def _squares(vectors: FloatArray) -> FloatArray:
    """The squared lengths (N,) of vectors (N, 3)."""
    x, y, z = vectors.T
    return np.asarray(x * x + y * y + z * z)
