"""A grid of heights, for programs with too many levels for polygons, such as a relief."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from msgspec import Struct

from camgen.check.stock.moves import TOLERANCE_MM, Cut, Moves
from camgen.check.stock.profile import compute_full_height, compute_radius
from camgen.geometry.ragged import list_owners, number_rows
from camgen.geometry.segments import IntArray, points_at
from camgen.model.pose import FloatArray
from camgen.model.text import short

#: Number of cells across the radius of the narrowest tool.
_ACROSS = 6
#: Maximum number of cells of the grid.
_MAX_CELLS = 1_000_000
#: Number of heights that are written at a time.
_CHUNK = 2_000_000


class Grid(Struct, frozen=True, eq=False):
    """The depths to which a stock is cut.

    depth: (H, W) depth of each cell below the top face, mm; 0 if it is not cut.
    corner: x and y of the middle of cell (0, 0), mm.
    pitch: size of a cell, mm.
    volumes: volume that each cut removes, mm3.
    """

    depth: FloatArray
    corner: tuple[float, float]
    pitch: float
    volumes: tuple[float, ...]

    @property
    def note(self) -> str:
        """A note about the resolution of the grid."""
        return (
            "the program has many levels: "
            f"rest material is a grid of heights with cells of {short(self.pitch, 3)} mm"
        )


def carve_grid(moves: Moves, cuts: Sequence[Cut], outline: Any) -> Grid:
    """Compute the grid after all motions, in order of the cuts."""
    deep = np.flatnonzero((moves.deepest > TOLERANCE_MM) & np.isfinite(moves.deepest))
    wide = max((cut.tool.radius for cut in cuts), default=1.0)
    narrow = min((cut.tool.radius for cut in cuts), default=1.0)
    ends = np.concatenate([moves.start[deep, :2], moves.end[deep, :2], np.zeros((0, 2))])
    low, high = ends.min(axis=0) - wide, ends.max(axis=0) + wide
    pitch = max(narrow / _ACROSS, float(np.sqrt(np.prod(high - low) / _MAX_CELLS)))
    # So that no cell has its middle on the rim of a straight slot.
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
    """Cut `depth` to the shape of the tool at steps of one cell along every motion."""
    count = np.maximum(np.ceil(moves.plane.length[rows] / pitch), 1).astype(np.int64) + 1
    which = list_owners(count)
    fraction = number_rows(count) / np.maximum(count - 1, 1)[which]
    points = points_at(moves.plane.take(rows[which]), fraction)
    first, last = moves.down[rows[which]].T
    tip = first + fraction * (last - first)
    points, tip = _keep_deepest(points, tip)
    around = int(np.ceil(cut.tool.radius / pitch))
    offsets = np.arange(-around, around + 1)
    step = max(_CHUNK // len(offsets) ** 2, 1)
    for begin in range(0, len(points), step):
        position = (points[begin : begin + step] - low) / pitch
        cell = np.rint(position).astype(np.int64)
        square = ((cell - position)[:, :, None] + offsets) ** 2
        distance = np.sqrt(square[:, 1, :, None] + square[:, 0, None, :]) * pitch
        below = tip[begin : begin + step, None, None] - _compute_rise(cut, distance)
        below[distance > cut.tool.radius] = 0.0
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
    order = np.lexsort((tip, points[:, 1], points[:, 0]))
    points = points[order]
    changes = (points[1:] != points[:-1]).any(axis=1)
    last = np.append(changes, np.ones(min(len(points), 1), np.bool_))
    return points[last], tip[order][last]


def _compute_rise(cut: Cut, distance: FloatArray) -> FloatArray:
    """Compute the height of the tool's surface above its tip, at a distance from its axis, mm."""
    heights = np.linspace(0.0, compute_full_height(cut.tool), 512)
    radius = compute_radius(cut.tool, heights)
    if not radius[0] < radius[-1]:
        return np.zeros(distance.shape)
    return np.asarray(np.interp(distance.ravel(), radius, heights).reshape(distance.shape))
