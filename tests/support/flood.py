"""Pieces that a program cuts free, by a flood fill over the cells that its text cuts through.

It reads the words of the text itself and imports no part of camgen.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import cv2
import numpy as np

from bench.support.gcode_text import read_moves, sample_move

Array = np.ndarray
#: Distance of the discs that stand for a motion, mm.
_STEP_MM = 0.1
#: A motion that ends higher than this above the bottom face does not cut through, mm.
_THROUGH_MM = 0.005
#: Binary digits of the places of discs after the point.
_SHIFT = 4


class Region(NamedTuple):
    """A connected region of cells.

    area: mm2.
    x, y: its middle, mm.
    """

    area: float
    x: float
    y: float


def find_loose(
    text: str,
    radii: Mapping[int, float],
    thickness: float,
    box: tuple[float, float, float, float],
    pitch: float = 0.1,
) -> list[Region]:
    """The regions of uncut cells that do not reach the rim of the stock, the largest first.

    radii: radius of each tool by its number, mm.
    box: x and y of the lower and of the upper corner of the stock, mm.
    pitch: size of a cell, mm.
    """
    low, high = np.array(box[:2]), np.array(box[2:])
    columns, rows = np.ceil((high - low) / pitch).astype(int).tolist()
    cells = np.ones((rows, columns), np.uint8)
    for move in read_moves(text):
        if not move.rapid and move.deepest >= thickness - _THROUGH_MM:
            points = sample_move(move, _STEP_MM)
            through = points[points[:, 2] <= _THROUGH_MM - thickness]
            _stamp(cells, (through[:, :2] - low) / pitch - 0.5, radii[move.tool] / pitch)
    count, labels, stats, middles = cv2.connectedComponentsWithStats(cells, connectivity=4)
    rim = np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]])
    loose = np.setdiff1d(np.arange(1, count), rim).tolist()
    regions = [
        Region(stats[k, cv2.CC_STAT_AREA] * pitch**2, *((middles[k] + 0.5) * pitch + low))
        for k in loose
    ]
    return sorted(regions, reverse=True)


def _stamp(cells: Array, places: Array, radius: float) -> None:
    """Discs of a radius about places, all in cells."""
    scale = 1 << _SHIFT
    for x, y in np.rint(places * scale).astype(int).tolist():
        cv2.circle(cells, (x, y), round(radius * scale), 0, -1, cv2.LINE_8, _SHIFT)
