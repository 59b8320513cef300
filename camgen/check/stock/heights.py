"""A grid of heights: what is left where a program has too many levels for polygons, such as a relief."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from msgspec import Struct

from camgen.check.stock.moves import TOLERANCE_MM, Cut, Moves
from camgen.check.stock.profile import height_of_widest, reach
from camgen.geometry.ragged import owners, ramp
from camgen.geometry.segments import IntArray, points_at
from camgen.model.pose import FloatArray
from camgen.model.text import short

#: Cells across the radius of the narrowest tool, and cells of the grid at most.
_ACROSS, _MOST_CELLS = 6, 1_000_000
#: Heights that are written in one go.
_CHUNK = 2_000_000


class Grid(Struct, frozen=True, eq=False):
    """depth: (H, W) mm below the top face to which each cell is cut, 0 where it is not. corner: x and y of the middle
    of cell (0, 0), mm. pitch: mm. volumes: mm3 by cut.
    """

    depth: FloatArray
    corner: tuple[float, float]
    pitch: float
    volumes: tuple[float, ...]

    @property
    def note(self) -> str:
        """What is to be told of it."""
        return f"many levels: what is left is a grid of heights, {short(self.pitch, 3)} mm a cell"


def carve(moves: Moves, cuts: Sequence[Cut], outline: Any) -> Grid:
    """The grid after all motions, in order of the cuts."""
    deep = np.flatnonzero((moves.deepest > TOLERANCE_MM) & np.isfinite(moves.deepest))
    wide = max((cut.tool.radius for cut in cuts), default=1.0)
    narrow = min((cut.tool.radius for cut in cuts), default=1.0)
    ends = np.concatenate([moves.start[deep, :2], moves.end[deep, :2], np.zeros((0, 2))])
    low, high = ends.min(axis=0) - wide, ends.max(axis=0) + wide
    pitch = max(narrow / _ACROSS, float(np.sqrt(np.prod(high - low) / _MOST_CELLS)))
    # No cell has its middle on the rim of a straight slot.
    low = low - 0.37 * pitch
    columns, lines = (int(n) for n in np.ceil((high - low) / pitch) + 1)
    depth = np.zeros((lines, columns))
    x, y = low[0] + pitch * np.arange(columns), low[1] + pitch * np.arange(lines)
    stock = shapely.contains_xy(outline, *np.meshgrid(x, y))
    volumes, before = [], 0.0
    for number, cut in enumerate(cuts):
        _stamp(depth, low, pitch, cut, moves, deep[moves.cut[deep] == number])
        total = float(depth[stock].sum()) * pitch**2
        volumes.append(total - before)
        before = total
    return Grid(depth, (float(low[0]), float(low[1])), pitch, tuple(volumes))


def _stamp(
    depth: FloatArray, low: FloatArray, pitch: float, cut: Cut, moves: Moves, rows: IntArray
) -> None:
    """Every motion in steps of a cell, in each of which the tool leaves its shape."""
    count = np.maximum(np.ceil(moves.plane.length[rows] / pitch), 1).astype(np.int64) + 1
    which, share = owners(count), ramp(count) / np.maximum(count - 1, 1)[owners(count)]
    points = points_at(moves.plane.take(rows[which]), share)
    first, last = moves.down[rows[which]].T
    tip = first + share * (last - first)
    points, tip = _keep_deepest(points, tip)
    around = int(np.ceil(cut.tool.radius / pitch))
    offsets = np.arange(-around, around + 1)
    step = max(_CHUNK // len(offsets) ** 2, 1)
    for begin in range(0, len(points), step):
        place = (points[begin : begin + step] - low) / pitch
        cell = np.rint(place).astype(np.int64)
        square = ((cell - place)[:, :, None] + offsets) ** 2
        apart = np.sqrt(square[:, 1, :, None] + square[:, 0, None, :]) * pitch
        below = tip[begin : begin + step, None, None] - _rise(cut, apart)
        below[apart > cut.tool.radius] = 0.0
        for (column, line), shape in zip((cell - around).tolist(), below, strict=True):
            _lower(depth, line, column, shape)


def _lower(depth: FloatArray, line: int, column: int, shape: FloatArray) -> None:
    """Cuts `depth` (H, W) to a shape (h, w) whose first cell is at a line and column.

    The shape may reach beyond the grid.
    """
    top, left = max(line, 0), max(column, 0)
    block = depth[top : max(line + len(shape), 0), left : max(column + shape.shape[1], 0)]
    shape = shape[top - line :, left - column :]
    np.maximum(block, shape[: block.shape[0], : block.shape[1]], out=block)


def _keep_deepest(points: FloatArray, tip: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Each of the places (N, 2) once, with the greatest of its depths (N,)."""
    order = np.lexsort((tip, points[:, 1], points[:, 0]))
    points = points[order]
    last = np.append(
        (points[1:] != points[:-1]).any(axis=1), np.ones(min(len(points), 1), np.bool_)
    )
    return points[last], tip[order][last]


def _rise(cut: Cut, apart: FloatArray) -> FloatArray:
    """How much higher than its tip the tool is at ``apart`` mm from its axis: its profile the other way round."""
    heights = np.linspace(0.0, height_of_widest(cut.tool), 512)
    radius = reach(cut.tool, heights)
    return (
        np.asarray(np.interp(apart.ravel(), radius, heights).reshape(apart.shape))
        if radius[0] < radius[-1]
        else np.zeros(apart.shape)
    )
