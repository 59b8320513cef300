"""A picture of what strokes cover: what is covered, what stays bare, what is inked beside."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from camgen.paths import ToolPath
from camgen.planners.fill_cover import lines_of, painted
from camgen.planners.fill_ground import Pixels, even_odd, outlines
from camgen.planners.image_space_rings import rings
from camgen.pose import FloatArray, frozen
from camgen.shapes import Part

#: Neither, copper covered, copper bare, ink outside: blue, green, red.
COLOURS = ((255, 255, 255), (90, 160, 60), (40, 40, 220), (40, 190, 250))


class Map(Struct, frozen=True, eq=False):
    """pixels: (H, W, 3) in ``COLOURS``. work_from_map: (2, 3), mm of a pixel centre (u, v), v down."""

    pixels: Pixels
    work_from_map: FloatArray


def coverage_map(part: Part, paths: Sequence[ToolPath], diameter: float, most: int = 1600) -> Map:
    """What ``paths`` cover of the closed contours of ``part`` with a tool of ``diameter`` mm, at most ``most`` px."""
    counts, points, work_from_grid, _ = outlines(part, diameter / 2)
    border = np.column_stack([points.real, points.imag]) @ work_from_grid[:, :2].T + work_from_grid[:, 2]
    strokes = [path.position[:, :2] for path in paths]
    everything = np.concatenate([border, *strokes])
    low, high = everything.min(axis=0) - diameter, everything.max(axis=0) + diameter
    pixel = float((high - low).max()) / most
    wide, tall = np.ceil((high - low) / pixel).astype(np.int64).tolist()

    def at(places: FloatArray) -> np.ndarray[tuple[int], np.dtype[np.complex128]]:
        return np.asarray(((places[:, 0] - low[0]) + 1j * (high[1] - places[:, 1])) / pixel)

    shape = (tall, wide)
    copper = even_odd(rings(counts), at(border), shape) > 0
    ink = painted(*lines_of([at(stroke) for stroke in strokes]), diameter / 2 / pixel, shape) > 0
    kind = np.where(copper, np.where(ink, 1, 2), np.where(ink, 3, 0))
    place = frozen([[pixel, 0.0, low[0]], [0.0, -pixel, high[1]]])
    return Map(np.array(COLOURS, dtype=np.uint8)[kind], place)
