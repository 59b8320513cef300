"""A reader of milling programs for judges. It imports no part of camgen.

It knows the words that `--post gcode`, `--post grbl` and FreeCAD write: G0 to G3, G81 and G83, F,
S, M3 to M5 and T.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from bench.support.motions import Array, LevelArc

#: Arcs become chords that leave them by at most this, mm.
SAGITTA = 0.001
_WORD = re.compile(r"([A-Z])\s*([-+]?[0-9.]+)")
_COMMENT = re.compile(r"\([^)]*\)|;.*")


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
    def low(self) -> float:
        """Height of its lowest place, mm."""
        return float(self.points[:, 2].min())

    @property
    def deepest(self) -> float:
        """Depth of its lowest place below the top face, mm."""
        return -self.low

    @property
    def length(self) -> float:
        """Length, mm."""
        return float(np.linalg.norm(np.diff(self.points, axis=0), axis=1).sum())


def read_moves(text: str) -> Iterator[Move]:
    """The motions of a program, from where all axes are known."""
    place = np.full(3, np.nan)
    feed, rpm, direction, tool, mode, back = 0.0, 0.0, 0, 0, 0, np.nan
    for line, row in enumerate(text.upper().split("\n"), 1):
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
            points = LevelArc(place, target, centre, mode == 3).sample(SAGITTA)
        if not np.isnan(points).any():
            yield Move(line, points, mode == 0, feed, speed, tool)
        place, back = target, target[2]


def sample_move(move: Move, step: float) -> Array:
    """(N, 3) places on a motion, no farther apart than `step` mm."""
    strides = np.diff(move.points, axis=0)
    steps = np.ceil(np.linalg.norm(strides, axis=1) / step).astype(int).clip(1)
    piece = np.repeat(np.arange(len(steps)), steps)
    number = np.arange(1, len(piece) + 1) - np.repeat(np.cumsum(steps) - steps, steps)
    share = (number / steps[piece])[:, None]
    return np.concatenate([move.points[:1], move.points[piece] + share * strides[piece]])
