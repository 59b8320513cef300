"""A reader of milling programs for the judges of the set-up. It imports no part of camgen.

It knows the words that `--post gcode` writes: G0 to G3, G81 and G83, F, S, M3 to M5 and T.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np

Array = np.ndarray
_WORD = re.compile(r"([A-Z])(-?[0-9.]+)")
_COMMENT = re.compile(r"\([^)]*\)|;.*")
_MOST_CELLS = 50_000_000
#: Length of the chords of arcs, mm.
_CHORD_MM = 0.2


@dataclass(frozen=True)
class Move:
    """A motion.

    line: line of the text, from 1.
    points: (N, 3) places on it with both ends, mm.
    rapid: whether it is rapid.
    feed: mm/min.
    speed: rpm, negative to the left, 0 at rest.
    tool: number of the tool.
    """

    line: int
    points: Array
    rapid: bool
    feed: float
    speed: float
    tool: int

    @property
    def is_straight_down(self) -> bool:
        """True for a motion down the axis of the tool."""
        step = self.points[-1] - self.points[0]
        return bool(np.hypot(step[0], step[1]) < 1e-6 and step[2] < 0)

    @property
    def deepest(self) -> float:
        """Depth of its lowest place below the top face, mm."""
        return float(-self.points[:, 2].min())


def read_moves(text: str) -> Iterator[Move]:
    """The motions of a program, from where all axes are known."""
    place = np.full(3, np.nan)
    feed, rpm, direction, tool, mode, back = 0.0, 0.0, 0, 0, 0, np.nan
    for line, row in enumerate(text.split("\n"), 1):
        words = [(key, float(value)) for key, value in _WORD.findall(_COMMENT.sub("", row))]
        values = dict(words)
        codes = [value for key, value in words if key == "G"]
        feed, rpm = values.get("F", feed), values.get("S", rpm)
        tool = int(values.get("T", tool))
        direction = {3: 1, 4: -1, 5: 0}.get(int(values.get("M", -1)), direction)
        for code in codes:
            mode = int(code) if code in (0, 1, 2, 3, 80, 81, 83) else mode
        if 53 in codes or mode == 80 or not {"X", "Y", "Z"} & values.keys():
            continue
        target = np.array([values.get(axis, now) for axis, now in zip("XYZ", place, strict=True)])
        speed = direction * rpm
        if mode in (81, 83):
            top = values.get("R", back)
            stops = [(target[0], target[1], top), tuple(target), (target[0], target[1], top)]
            for number, stop in enumerate(stops):
                points = np.array([place, stop])
                yield Move(line, points, number != 1, feed, speed, tool)
                place = np.array(stop)
            continue
        points = np.array([place, target])
        if mode in (2, 3):
            centre = np.add(place[:2], (values.get("I", 0.0), values.get("J", 0.0)))
            points = _arc(place, target, centre, mode == 3)
        if not np.isnan(points).any():
            yield Move(line, points, mode == 0, feed, speed, tool)
        place, back = target, target[2]


def _arc(start: Array, end: Array, centre: Array, left: bool) -> Array:
    """Places on an arc or a helix about a centre."""
    first, last = start[:2] - centre, end[:2] - centre
    begin, finish = math.atan2(first[1], first[0]), math.atan2(last[1], last[0])
    turn = (finish - begin) % math.tau if left else -((begin - finish) % math.tau)
    if abs(turn) < 1e-9:
        turn = math.tau if left else -math.tau
    radius = math.hypot(*first)
    share = np.linspace(0, 1, max(2, math.ceil(abs(turn) * radius / _CHORD_MM)) + 1)
    angle = begin + turn * share
    xy = centre + radius * np.column_stack([np.cos(angle), np.sin(angle)])
    return np.column_stack([xy, start[2] + share * (end[2] - start[2])])


@dataclass
class Grid:
    """Depths to which cells of the stock are cut.

    depth: (rows, columns) mm.
    low: x and y of the first cell, mm.
    pitch: size of a cell, mm.
    """

    depth: Array
    low: Array
    pitch: float

    def at(self, x: float, y: float) -> float:
        """The depth of the cell at a place, mm."""
        column, row = np.rint((np.array([x, y]) - self.low) / self.pitch).astype(int)
        return float(self.depth[row, column])

    def stamp(self, x: float, y: float, radius: float, depth: float) -> None:
        """A disc of the tool at a place."""
        part = self.cut_out(x, y, radius)
        np.maximum(part, depth, out=part, where=make_disc(radius, self.pitch))

    def cut_out(self, x: float, y: float, radius: float) -> Array:
        """The square of cells about a place, as a view."""
        across = int(radius / self.pitch)
        column = round((x - self.low[0]) / self.pitch)
        row = round((y - self.low[1]) / self.pitch)
        return self.depth[row - across : row + across + 1, column - across : column + across + 1]


@cache
def make_disc(radius: float, pitch: float) -> Array:
    """Which cells of the square about a disc lie in it."""
    across = int(radius / pitch)
    offsets = np.arange(-across, across + 1) * pitch
    return np.hypot(*np.meshgrid(offsets, offsets)) <= radius


def carve(moves: list[Move], radii: Mapping[int, float], pitch: float) -> tuple[Grid, list[float]]:
    """The stock after all motions, and for each motion the depth below the axis half-way before it.

    radii: radius of each tool, mm.

    ValueError for a program with too many cells.
    """
    points = np.concatenate([move.points for move in moves])[:, :2]
    margin = max(radii.values()) + 2 * pitch
    low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
    columns, rows = np.ceil((high - low) / pitch).astype(int) + 1
    if columns * rows > _MOST_CELLS:
        raise ValueError("too large for a grid")
    grid = Grid(np.zeros((rows, columns)), low, pitch)
    before = []
    for move in moves:
        middle = move.points[len(move.points) // 2] if len(move.points) > 2 else move.points.mean(0)
        before.append(grid.at(middle[0], middle[1]))
        if move.rapid or move.deepest <= 0:
            continue
        for start, end in zip(move.points[:-1], move.points[1:], strict=True):
            steps = max(1, math.ceil(np.hypot(*(end - start)[:2]) / pitch))
            for share in np.linspace(0, 1, steps + 1):
                x, y, z = start + share * (end - start)
                grid.stamp(x, y, radii[move.tool], -z)
    return grid, before


def sample_move(move: Move, step: float) -> Array:
    """(N, 3) places on a motion, no farther apart than `step` mm."""
    rows = [move.points[:1]]
    for start, end in zip(move.points[:-1], move.points[1:], strict=True):
        steps = max(1, int(np.ceil(np.linalg.norm(end - start) / step)))
        rows.append(start + np.linspace(0, 1, steps + 1)[1:, None] * (end - start))
    return np.concatenate(rows)
