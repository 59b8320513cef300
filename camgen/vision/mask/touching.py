"""Parts that touch or overlap in the picture, and so make one piece of the mask.

Where two rounded parts meet their outlines run into each other in two sharp notches, and the line between the notches
divides the piece into two that are each more whole than it: nearly convex, or joined by next to nothing.
"""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.vision.mask.cells import Bytes, Cells, shrunk

#: So many notches are looked at.
_MOST_NOTCHES = 40
#: A notch is so narrow, deg, seen over so much of the outline to both sides, and so many cells.
_NARROW, _LOOK, _LOOK_CELLS = 80.0, 0.01, (5, 20)
#: Both sides of the line between two notches are so much of the piece at least.
_LEAST = 0.08
#: It is shorter than so much of the smaller side's diameter; one side that is convex, or a neck shorter than that.
_SHORT, _NECK = 0.75, 0.15
#: Both sides are so many times as wide as that line is long.
_WIDER = 1.2
#: What is so much of its convex hull is convex.
_CONVEX = 0.93

Ring = NDArray[np.float64]


class Meeting(Struct, frozen=True):
    """Where two parts may meet: the middle u, v and the length of the line between, cells."""

    middle: tuple[float, float]
    length: float


def meetings(mask: Bytes, cells: Cells) -> list[Meeting]:
    """Where pieces of ``mask`` (H, W) look like two parts, seen in cells."""
    small = np.asarray(shrunk(mask, cells.size) > 127).view(np.uint8)
    rings, _ = cv2.findContours(small, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return [meeting for ring in rings for meeting in _of_piece(np.asarray(ring, np.int32))]


def _of_piece(ring: NDArray[np.int32]) -> Iterator[Meeting]:
    if len(ring) < 4 * _LOOK_CELLS[0]:
        return
    points = ring[:, 0].astype(np.float64)
    whole = abs(_area(points))
    taken: set[int] = set()
    lines = [(float(np.hypot(*(points[j] - points[i]))), i, j) for i, j in _pairs(_notches(points))]
    for length, i, j in sorted(lines):
        if taken & {i, j} or not _divides(points, i, j, length, whole):
            continue
        taken |= {i, j}
        u, v = ((points[i] + points[j]) / 2).tolist()
        yield Meeting((u, v), length)


def _pairs(notches: list[int]) -> Iterator[tuple[int, int]]:
    for k, i in enumerate(notches):
        for j in notches[k + 1 :]:
            yield i, j


def _notches(points: Ring) -> list[int]:
    """The rows of narrow notches, in order: where the bench reaches in between two sides of the outline."""
    reach = int(np.clip(_LOOK * len(points), *_LOOK_CELLS))
    (ax, ay), (bx, by) = ((np.roll(points, shift, axis=0) - points).T for shift in (reach, -reach))
    angle = np.degrees(np.arctan2((ax * by - ay * bx) * np.sign(_area(points)), ax * bx + ay * by))
    wedge = np.where(angle > 0, angle, 360.0)
    around = np.min([np.roll(wedge, row) for row in range(-reach, reach + 1)], axis=0)
    rows = np.flatnonzero((wedge == around) & (wedge <= _NARROW))
    # One row of each notch, the narrowest notches.
    apart = rows[np.diff(rows, prepend=-reach - 1) > reach]
    return sorted(apart[np.argsort(wedge[apart], kind="stable")][:_MOST_NOTCHES].tolist())


def _divides(points: Ring, i: int, j: int, length: float, whole: float) -> bool:
    """Whether the line from row i to row j leaves two parts."""
    sides = points[i : j + 1], np.concatenate([points[j:], points[: i + 1]])
    areas = [abs(_area(side)) for side in sides]
    least = min(areas)
    # A line that runs over the bench would add to the sides what it cuts off.
    if least < _LEAST * whole or abs(sum(areas) - whole) > 0.02 * whole:
        return False
    if length > _SHORT * (4 * least / np.pi) ** 0.5:
        return False
    # A point of a star narrows from there on, a stem stays as it is; a part that touches is wider than where it does.
    along = (points[j] - points[i]) / max(length, 1e-9)
    if any(np.ptp(side @ along) < _WIDER * length for side in sides):
        return False
    convex = [_whole(side, area) >= _CONVEX for side, area in zip(sides, areas, strict=True)]
    return any(convex) or length < _NECK * least**0.5


def _whole(side: Ring, area: float) -> float:
    """What a side is of its convex hull."""
    hull = cv2.convexHull(side.astype(np.float32))
    return area / max(float(cv2.contourArea(hull)), 1e-9)


def _area(points: Ring) -> float:
    x, y = points.T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2
