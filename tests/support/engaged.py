"""How much of a tool is in the material along its paths: counted in cells of a plate, with nothing of the planner."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely

from camgen.model.path import ToolPath
from tests.support.swept import centre_line

#: Cells of a plate in a diameter of the tool, steps in it, and steps over which a width is taken.
CELLS, STEPS, WINDOW = 60, 30, 3


def engaged(paths: Sequence[ToolPath], radius: float) -> np.ndarray:
    """(M, 4) x, y, share of the diameter that is cut, and mm of way, along ``paths`` one after the other.

    What is cut on a short way, by the way: the mean width there. Where the tool goes in a disc of it is gone before.
    """
    lines = [centre_line(path) for path in paths]
    cell = 2 * radius / CELLS
    low = np.min([line.bounds[:2] for line in lines], axis=0) - 2 * radius
    high = np.max([line.bounds[2:] for line in lines], axis=0) + 2 * radius
    plate = np.ones(np.ceil((high - low) / cell).astype(int)[::-1], dtype=bool)
    side = np.arange(-CELLS // 2 - 2, CELLS // 2 + 3)
    found = []
    for line in lines:
        count = max(int(line.length / (2 * radius / STEPS)), 1)
        ends = shapely.get_coordinates(line)
        along = np.append(0.0, np.cumsum(np.hypot(*np.diff(ends, axis=0).T)))
        shares = np.linspace(0, along[-1], count + 1)
        places = np.column_stack([np.interp(shares, along, one) for one in ends.T])
        cut = [_take(plate, (place - low) / cell, side, radius / cell) for place in places]
        area = np.convolve(np.array(cut[1:]) * cell**2, np.ones(WINDOW), "same")
        way = line.length / count
        spread = np.convolve(np.ones(count), np.ones(WINDOW), "same") * way
        found.append(
            np.column_stack([places[1:], area / spread / (2 * radius), np.full(count, way)])
        )
    return np.concatenate(found)


def _take(plate: np.ndarray, place: np.ndarray, side: np.ndarray, radius: float) -> int:
    """Cells that a disc takes away."""
    column, row = np.round(place).astype(int)
    window = plate[row + side[0] : row + side[-1] + 1, column + side[0] : column + side[-1] + 1]
    off = (column + side - place[0]) ** 2, (row + side - place[1]) ** 2
    taken = window & (off[0] + off[1][:, None] <= radius**2)
    window ^= taken
    return int(np.count_nonzero(taken))
