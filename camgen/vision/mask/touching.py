"""Finds parts that touch or overlap in the picture, and so are one piece of the mask.

Where two rounded parts touch, their outlines meet in two sharp notches. The line between the two
notches divides the piece. It separates two parts if it is short, if both sides widen away from it,
and if one side is nearly convex or the line is only a thin neck.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import cv2
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.vision.mask.cells import Bytes, Cells, shrink

#: Notches of a piece that are tested in pairs, the sharpest ones.
_MAX_NOTCHES = 40
#: deg: opening angle of a notch, at most.
_MAX_NOTCH_ANGLE = 80.0
#: Length over which each side of a notch is measured, as a fraction of the outline.
_REACH_FRACTION = 0.01
#: Shortest and longest such length, cells: a shorter side is a step between two cells.
_REACH_CELLS = (5, 20)
#: Fraction of the area of the piece that each side of the line has at least.
_MIN_SIDE = 0.08
#: Fraction of the area by which both sides together may differ from the piece.
_AREA_TOLERANCE = 0.02
#: Largest length of the line, in diameters of a disc with the area of the smaller side.
_MAX_LENGTH = 0.75
#: Largest length of a neck, in square roots of the area of the smaller side.
_MAX_NECK = 0.15
#: Smallest extent of each side along the line, in lengths of the line.
_MIN_WIDENING = 1.2
#: Smallest fraction of its convex hull that a nearly convex side fills.
_CONVEX = 0.93

Ring = NDArray[np.float64]


class TouchingPlace(Struct, frozen=True):
    """A place where two parts seem to touch.

    middle: (u, v) of the middle of the line between the two notches, cells.
    length: length of that line, cells.
    """

    middle: tuple[float, float]
    length: float


def find_touching_places(mask: Bytes, cells: Cells) -> list[TouchingPlace]:
    """The places where a piece of `mask` (H, W) looks like two parts; empty without any."""
    small = np.asarray(shrink(mask, cells.size) > 127).view(np.uint8)
    rings, _ = cv2.findContours(small, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    places: list[TouchingPlace] = []
    for ring in rings:
        places += _search_piece(np.asarray(ring, np.int32))
    return places


def _search_piece(ring: NDArray[np.int32]) -> Iterator[TouchingPlace]:
    """Yield the lines that divide a piece, the shortest first; no two of them share a notch."""
    if len(ring) < 4 * _REACH_CELLS[0]:
        return
    points = ring[:, 0].astype(np.float64)
    piece_area = abs(_compute_area(points))
    used: set[int] = set()
    pairs = combinations(_find_notches(points), 2)
    lines = [(float(np.hypot(*(points[j] - points[i]))), i, j) for i, j in pairs]
    for length, i, j in sorted(lines):
        if used.isdisjoint((i, j)) and _separates_parts(points, i, j, length, piece_area):
            used |= {i, j}
            u, v = ((points[i] + points[j]) / 2).tolist()
            yield TouchingPlace((u, v), length)


def _find_notches(points: Ring) -> list[int]:
    """Rows of the outline `points` (N, 2) at the tips of its sharpest notches, in order.

    A notch opens outwards, into the bench. Its angle is measured between the points `reach` rows
    before and after its tip, and is the smallest one within `reach` rows.
    """
    reach = int(np.clip(_REACH_FRACTION * len(points), *_REACH_CELLS))
    px, py = (np.roll(points, reach, axis=0) - points).T
    qx, qy = (np.roll(points, -reach, axis=0) - points).T
    cross = (px * qy - py * qx) * np.sign(_compute_area(points))
    angle = np.degrees(np.arctan2(cross, px * qx + py * qy))
    opening = np.where(angle > 0, angle, 360.0)
    near = [np.roll(opening, shift) for shift in range(-reach, reach + 1)]
    smallest_near = np.min(near, axis=0)
    rows = np.flatnonzero((opening == smallest_near) & (opening <= _MAX_NOTCH_ANGLE))
    # The first of several equal angles side by side counts.
    tips = rows[np.diff(rows, prepend=-reach - 1) > reach]
    return sorted(tips[np.argsort(opening[tips], kind="stable")][:_MAX_NOTCHES].tolist())


def _separates_parts(points: Ring, i: int, j: int, length: float, piece_area: float) -> bool:
    """Whether the line from row `i` to row `j` of the outline has a part on either side."""
    sides = points[i : j + 1], np.concatenate([points[j:], points[: i + 1]])
    areas = [abs(_compute_area(side)) for side in sides]
    smaller = min(areas)
    # A line that crosses the bench adds to the sides the area that it cuts off.
    crosses_bench = abs(sum(areas) - piece_area) > _AREA_TOLERANCE * piece_area
    is_long = length > _MAX_LENGTH * (4 * smaller / np.pi) ** 0.5
    if smaller < _MIN_SIDE * piece_area or crosses_bench or is_long:
        return False
    # The point of a star narrows away from the line, and a stem keeps its width. A part that
    # touches another one is wider than the line between them.
    direction = (points[j] - points[i]) / max(length, 1e-9)
    if any(np.ptp(side @ direction) < _MIN_WIDENING * length for side in sides):
        return False
    fractions = [_compute_hull_fraction(*side) for side in zip(sides, areas, strict=True)]
    is_convex = any(fraction >= _CONVEX for fraction in fractions)
    return is_convex or length < _MAX_NECK * smaller**0.5


def _compute_hull_fraction(side: Ring, area: float) -> float:
    """Fraction of its convex hull that a side of this area fills."""
    hull = cv2.convexHull(side.astype(np.float32))
    return area / max(float(cv2.contourArea(hull)), 1e-9)


def _compute_area(points: Ring) -> float:
    """Signed area of a closed polygon, cells2; positive if it runs from x towards y."""
    x, y = points.T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2
