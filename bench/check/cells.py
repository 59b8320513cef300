"""The stock in cells of depths, for judges of milling programs. It imports no part of camgen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from bench.support.gcode_text import Move, sample_move
from bench.support.motions import Array

_MOST_CELLS = 50_000_000


@dataclass
class Grid:
    """Depths to which cells of the stock are cut.

    depth: (rows, columns) mm.
    low: x and y of the first cell, mm.
    pitch: size of a cell, mm.
    """

    depth: Array
    low: Array
    pitch: float

    @classmethod
    def around(cls, moves: Sequence[Move], radius: float, pitch: float) -> Grid:
        """Uncut stock for all motions of a tool with a radius, mm.

        ValueError for too many cells.
        """
        points = np.concatenate([move.points for move in moves])[:, :2]
        margin = radius + 2 * pitch
        low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
        columns, rows = np.ceil((high - low) / pitch).astype(int) + 1
        if columns * rows > _MOST_CELLS:
            raise ValueError("too large for a grid")
        return cls(np.zeros((rows, columns)), low, pitch)

    def at(self, x: float, y: float) -> float:
        """The depth of the cell at a place, mm."""
        column, row = np.rint((np.array([x, y]) - self.low) / self.pitch).astype(int)
        return float(self.depth[row, column])

    def stamp(self, x: float, y: float, radius: float, depth: float) -> None:
        """A disc of the tool at a place."""
        part = self.cut_out(x, y, radius)
        np.maximum(part, depth, out=part, where=make_disc(radius, self.pitch))

    def cut_out(self, x: float, y: float, radius: float) -> Array:
        """The square of cells about a place, as a view."""
        across = int(radius / self.pitch)
        column = round((x - self.low[0]) / self.pitch)
        row = round((y - self.low[1]) / self.pitch)
        return self.depth[row - across : row + across + 1, column - across : column + across + 1]


@cache
def make_disc(radius: float, pitch: float) -> Array:
    """Which cells of the square about a disc lie in it."""
    across = int(radius / pitch)
    offsets = np.arange(-across, across + 1) * pitch
    return np.hypot(*np.meshgrid(offsets, offsets)) <= radius


def carve(moves: list[Move], radii: Mapping[int, float], pitch: float) -> tuple[Grid, list[float]]:
    """The stock after all motions, and for each motion the depth below the axis half-way before it.

    radii: radius of each tool, mm.

    ValueError for a program with too many cells.
    """
    grid = Grid.around(moves, max(radii.values()), pitch)
    before = []
    for move in moves:
        middle = move.points[len(move.points) // 2] if len(move.points) > 2 else move.points.mean(0)
        before.append(grid.at(middle[0], middle[1]))
        if move.rapid or move.deepest <= 0:
            continue
        for x, y, z in sample_move(move, pitch):
            grid.stamp(x, y, radii[move.tool], -z)
    return grid, before
