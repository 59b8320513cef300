"""A judge of milling programs by their G-code text alone: time, cleared area, rapid motions.

It shares no code with camgen: times are without acceleration, and sweeps are made by GEOS.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely

from bench.support.gcode_text import Move, read_moves

#: Heights that differ by less, mm, are one.
_SAME = 1e-6
#: A swept strip that is tested for material is narrower by this on each side, mm.
_SLACK = 0.02
_ROUND = 64


def read_cut(text: str) -> list[Move]:
    """The motions of a text from the first to the last one that cuts, with the travel between."""
    moves = list(read_moves(text))
    cutting = [k for k, move in enumerate(moves) if not move.rapid and move.low < 0]
    return moves[cutting[0] : cutting[-1] + 1] if cutting else []


def seconds(motions: Sequence[Move], travel: float) -> float:
    """Time without acceleration, s. travel: speed of G0, mm/s."""
    return sum(motion.length / (travel if motion.rapid else motion.feed / 60) for motion in motions)


def cleared(motions: Sequence[Move], radius: float, height: float) -> Any:
    """The area, mm2, that a cylinder sweeps at ``height`` mm."""
    lines: list[Any] = []
    for motion in motions:
        lines += [] if motion.rapid else _below(motion, height)
    return shapely.union_all(shapely.buffer(lines, radius, quad_segs=_ROUND))


def _below(motion: Move, height: float) -> list[Any]:
    """The parts of a motion that are not above ``height``: lines, or points."""
    points = motion.points
    deep = points[:, 2] <= height + _SAME
    if deep.all():
        flat = points[:, :2]
        moved = math.dist(flat[0], flat[-1]) > _SAME or len(flat) > 2
        return [shapely.LineString(flat) if moved else shapely.Point(flat[0])]
    return [shapely.Point(place) for place in points[deep, :2]]


def count_struck(motions: Sequence[Move], radius: float) -> int:
    """Rapid motions below the top face that sweep over what no motion before them has cleared."""
    struck = 0
    # A slope clears what it has passed; its deepest place alone is counted here.
    shapes: list[tuple[int, Any]] = []
    for number, motion in enumerate(motions):
        if not motion.rapid and motion.low < 0:
            shapes += [(number, line) for line in _below(motion, motion.low)]
    cleared_areas = shapely.buffer([line for _, line in shapes], radius, quad_segs=_ROUND)
    tree = shapely.STRtree(cleared_areas)
    for number, motion in enumerate(motions):
        flat = motion.points[:, :2]
        if not motion.rapid or motion.low >= 0 or math.dist(flat[0], flat[-1]) < _SAME:
            continue
        left = shapely.LineString(flat).buffer(radius - _SLACK, quad_segs=_ROUND)
        # The latest first: most rapid motions cross an area that was cleared just before.
        for k in sorted(tree.query(left).tolist(), reverse=True):
            before = shapes[k][0]
            if before < number and motions[before].low <= motion.low + _SAME:
                left = left.difference(cleared_areas[k])
            if left.is_empty:
                break
        struck += not left.buffer(-_SLACK / 2).is_empty
    return struck


def feed_in_air(motions: Sequence[Move], radius: float, cell: float) -> float:
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
                x0, y0 = place[:2] - (low + column * cell)
                disc = ((grid - x0) ** 2)[:, None] + (grid - y0) ** 2 <= radius**2
                x, y = column - reach
                window = top[x : x + 2 * reach + 1, y : y + 2 * reach + 1]
                fresh = disc[: window.shape[0], : window.shape[1]] & (window > place[2] + _SAME)
                window[fresh] = place[2]
                whole += length / count
                idle += 0.0 if fresh.any() else length / count
    return idle / whole if whole else 0.0
