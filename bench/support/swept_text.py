"""A judge of milling programs by their G-code text alone: time, cleared area, rapid motions.

It shares no code with camgen: a reader of G0 to G3 in mm, times without acceleration, and sweeps by
GEOS.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import shapely

#: Arcs become chords that leave them by at most this, mm.
CHORD = 0.001
#: Heights that differ by less, mm, are one.
_SAME = 1e-6
#: A swept strip is taken narrower by this on each side, mm, where it is asked for material.
_SLACK = 0.02
_WORD = re.compile(r"([A-Z])\s*([-+]?[0-9.]+)")
_COMMENT = re.compile(r"\([^)]*\)|;.*")
_ROUND = 64


class Motion(NamedTuple):
    """A motion of the tool.

    points: (N, 3) places along it, mm.
    rapid: whether it is G0.
    feed: mm/s.
    """

    points: np.ndarray
    rapid: bool
    feed: float

    @property
    def length(self) -> float:
        """Length, mm."""
        return float(np.sqrt((np.diff(self.points, axis=0) ** 2).sum(axis=1)).sum())

    @property
    def low(self) -> float:
        """The lower end, mm."""
        return float(self.points[:, 2].min())


def read(text: str) -> list[Motion]:
    """The motions of a text from the first to the last one that cuts, with the travel between."""
    at: dict[str, float] = {}
    mode, feed = 0, 0.0
    motions: list[Motion] = []
    for line in text.upper().splitlines():
        words = _WORD.findall(_COMMENT.sub("", line))
        if ("G", "53") in words:
            continue
        values = {letter: float(number) for letter, number in words if letter != "G"}
        codes = [float(number) for letter, number in words if letter == "G"]
        mode = next((int(code) for code in codes if code in (0, 1, 2, 3)), mode)
        feed = values.get("F", 60 * feed) / 60
        target = {axis: values.get(axis, at.get(axis, math.nan)) for axis in "XYZ"}
        moved = any(axis in values for axis in "XYZ")
        if moved and not any(math.isnan(at.get(axis, math.nan)) for axis in "XYZ"):
            start, end = [at[axis] for axis in "XYZ"], [target[axis] for axis in "XYZ"]
            centre = (start[0] + values.get("I", 0.0), start[1] + values.get("J", 0.0))
            points = _arc(start, end, centre, mode == 3) if mode > 1 else np.array([start, end])
            motions.append(Motion(points, mode == 0, feed))
        at = target
    cutting = [k for k, motion in enumerate(motions) if not motion.rapid and motion.low < 0]
    return motions[cutting[0] : cutting[-1] + 1] if cutting else []


def _arc(
    start: Sequence[float], end: Sequence[float], centre: tuple[float, float], left: bool
) -> np.ndarray:
    (x, y), radius = centre, math.dist(start[:2], centre)
    first = math.atan2(start[1] - y, start[0] - x)
    sweep = (math.atan2(end[1] - y, end[0] - x) - first) % (2 * math.pi)
    if math.dist(start[:2], end[:2]) < _SAME:
        sweep = 2 * math.pi
    elif not left:
        sweep -= 2 * math.pi
    step = 2 * math.acos(max(1 - CHORD / max(radius, CHORD), 0.0))
    share = np.linspace(0.0, 1.0, max(math.ceil(abs(sweep) / step), 1) + 1)
    angle = first + share * sweep
    z = start[2] + share * (end[2] - start[2])
    points = np.column_stack([x + radius * np.cos(angle), y + radius * np.sin(angle), z])
    points[0], points[-1] = start, end
    return points


def seconds(motions: Sequence[Motion], travel: float) -> float:
    """Time without acceleration, s. travel: speed of G0, mm/s."""
    return sum(motion.length / (travel if motion.rapid else motion.feed) for motion in motions)


def cleared(motions: Sequence[Motion], radius: float, height: float) -> Any:
    """The area, mm2, that a cylinder sweeps at ``height`` mm."""
    lines: list[Any] = []
    for motion in motions:
        lines += [] if motion.rapid else _below(motion, height)
    return shapely.union_all(shapely.buffer(lines, radius, quad_segs=_ROUND))


def _below(motion: Motion, height: float) -> list[Any]:
    """The parts of a motion that are not above ``height``: lines, or points."""
    points = motion.points
    deep = points[:, 2] <= height + _SAME
    if deep.all():
        flat = points[:, :2]
        moved = math.dist(flat[0], flat[-1]) > _SAME or len(flat) > 2
        return [shapely.LineString(flat) if moved else shapely.Point(flat[0])]
    return [shapely.Point(place) for place in points[deep, :2]]


def count_struck(motions: Sequence[Motion], radius: float) -> int:
    """Rapid motions below the top face that sweep over what no motion before them has cleared."""
    struck = 0
    shapes: list[tuple[int, float, Any]] = []
    for number, motion in enumerate(motions):
        if not motion.rapid and motion.low < 0:
            shapes += [(number, motion.low, line) for line in _below(motion, motion.low)]
    tree = shapely.STRtree([shape for _, _, shape in shapes])
    for number, motion in enumerate(motions):
        flat = motion.points[:, :2]
        if not motion.rapid or motion.low >= 0 or math.dist(flat[0], flat[-1]) < _SAME:
            continue
        swept = shapely.LineString(flat).buffer(radius - _SLACK, quad_segs=_ROUND)
        near = [shapes[k] for k in tree.query(swept.buffer(radius)).tolist()]
        # A slope clears what it has passed; its deepest place alone is counted here.
        before = [line for k, low, line in near if k < number and low <= motion.low + _SAME]
        gone = shapely.union_all(shapely.buffer(before, radius, quad_segs=_ROUND))
        struck += not swept.difference(gone).buffer(-_SLACK / 2).is_empty
    return struck


def feed_in_air(motions: Sequence[Motion], radius: float, cell: float) -> float:
    """Share of the way at a feed, on the level and below the top face, that removes nothing.

    cell: mm, side of the cells of a plate in which removal is counted.
    """
    cutting = [motion for motion in motions if not motion.rapid and motion.low < 0]
    places = np.concatenate([motion.points for motion in cutting])
    low = places[:, :2].min(axis=0) - radius - cell
    size = np.ceil((places[:, :2].max(axis=0) + radius + cell - low) / cell).astype(int) + 1
    top = np.zeros(size)
    reach = math.ceil(radius / cell)
    grid = np.arange(-reach, reach + 1) * cell
    idle = whole = 0.0
    for motion in cutting:
        for start, end in zip(motion.points[:-1], motion.points[1:], strict=True):
            length = math.dist(start, end)
            count = max(math.ceil(length / cell), 1)
            for share in (np.arange(count) + 1) / count:
                place = start + share * (end - start)
                column = np.round((place[:2] - low) / cell).astype(int)
                off = place[:2] - (low + column * cell)
                disc = np.hypot(grid[:, None] - off[0], grid[None, :] - off[1]) <= radius
                x, y = column - reach
                window = top[x : x + 2 * reach + 1, y : y + 2 * reach + 1]
                fresh = disc[: window.shape[0], : window.shape[1]] & (window > place[2] + _SAME)
                window[fresh] = place[2]
                whole += length / count
                idle += 0.0 if fresh.any() else length / count
    return idle / whole if whole else 0.0
