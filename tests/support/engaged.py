"""The engagement of a tool along its paths, counted in cells of a plate. Independent of camgen."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely

from camgen.model.path import ToolPath
from tests.support.swept import centre_line

#: Cells of the plate and steps of the tool per tool diameter, and steps over which a width is the
#: mean.
CELLS, STEPS, WINDOW = 40, 20, 2


def engaged(paths: Sequence[ToolPath], radius: float) -> np.ndarray:
    """Rows (M, 4) along the paths in their order: x, y, engagement, and length of the step, mm.

    The engagement is the area that the tool cuts on a short distance, divided by this distance and
    by the tool diameter. At the start of each path the disc of the tool is removed before.
    """
    lines = [centre_line(path) for path in paths]
    cell = 2 * radius / CELLS
    low = np.min([line.bounds[:2] for line in lines], axis=0) - 2 * radius
    high = np.max([line.bounds[2:] for line in lines], axis=0) + 2 * radius
    plate = np.ones(np.ceil((high - low) / cell).astype(int)[::-1], dtype=bool)
    side = np.arange(-CELLS // 2 - 2, CELLS // 2 + 3)
    rows = []
    for line in lines:
        count = max(int(line.length / (2 * radius / STEPS)), 1)
        ends = shapely.get_coordinates(line)
        along = np.append(0.0, np.cumsum(np.hypot(*np.diff(ends, axis=0).T)))
        lengths = np.linspace(0, along[-1], count + 1)
        places = np.column_stack([np.interp(lengths, along, column) for column in ends.T])
        cut = [_take(plate, (place - low) / cell, side, radius / cell) for place in places]
        area = np.convolve(np.array(cut[1:]) * cell**2, np.ones(WINDOW), "same")
        step = line.length / count
        spread = np.convolve(np.ones(count), np.ones(WINDOW), "same") * step
        rows.append(
            np.column_stack([places[1:], area / spread / (2 * radius), np.full(count, step)])
        )
    return np.concatenate(rows)


def _take(plate: np.ndarray, position: np.ndarray, side: np.ndarray, radius: float) -> int:
    """Removes the cells in a disc, and returns their number."""
    column, row = np.round(position).astype(int)
    window = plate[row + side[0] : row + side[-1] + 1, column + side[0] : column + side[-1] + 1]
    squares = (column + side - position[0]) ** 2, (row + side - position[1]) ** 2
    taken = window & (squares[0] + squares[1][:, None] <= radius**2)
    window ^= taken
    return int(np.count_nonzero(taken))
