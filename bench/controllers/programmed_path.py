"""The path that a program of `--post gcode` describes, in a reading of its own.

It knows the words of that post alone, and refuses all others. Nothing here imports camgen.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

Array = np.ndarray

_WORD = re.compile(r"([A-Z])(-?[\d.]+)")
_COMMENT = re.compile(r"\([^)]*\)")
#: G codes of the post that are not motions.
_SETTINGS = frozenset(re.findall(r"\S+", "4 17 21 40 43 49 53 54 61 64 80 90 91.1 94 98"))
_MOTIONS = frozenset({"0", "1", "2", "3", "81", "83"})
#: Letters of a line that moves nothing.
_OTHER_LETTERS = frozenset("MSTE")
#: mm: LinuxCNC goes down this far above the last peck at rapid speed.
_PECK_CLEARANCE = 0.254


class Span(NamedTuple):
    """A line, or a level arc.

    line: line number of its text, from 1.
    start: (3,) mm, machine.
    end: (3,) mm, machine.
    centre: (2,) mm. NaN for a line.
    sweep: rad, counterclockwise positive. 0 for a line.
    """

    line: int
    start: Array
    end: Array
    centre: Array
    sweep: float


class ProgrammedPath(NamedTuple):
    """The motions of a program.

    spans: motions in their order.
    home: (3,) mm, machine: the end of the third motion, where camgen's time begins.
    tolerance: mm, the P of its G64. 0 for G61.
    dwell: s, the sum of its waits.
    """

    spans: list[Span]
    home: Array
    tolerance: float
    dwell: float


class _Reader:
    """The position and the modes of a program while it is read."""

    def __init__(self, offset: Array, tool_lengths: dict[int, float]) -> None:
        self.offset = offset.copy()
        self.work_z = float(offset[2])
        self.tool_lengths = tool_lengths
        self.position = np.zeros(3)
        self.mode = ""
        self.cycle: dict[str, float] = {}
        self.spans: list[Span] = []
        self.tolerance = 0.0
        self.dwell = 0.0

    def read_line(self, number: int, text: str) -> None:
        pairs = _WORD.findall(_COMMENT.sub("", text))
        codes = [value for letter, value in pairs if letter == "G"]
        words = {letter: float(value) for letter, value in pairs if letter != "G"}
        unknown = [f"G{code}" for code in codes if code not in _SETTINGS | _MOTIONS]
        if unknown:
            raise ValueError(f"line {number}: {unknown[0]} is not known")
        self.mode = next((code for code in codes if code in _MOTIONS), self.mode)
        if "64" in codes:
            self.tolerance = words["P"]
        elif "4" in codes:
            self.dwell += words["P"]
        elif "43" in codes:
            self.offset[2] = self.work_z + self.tool_lengths[int(words["H"])]
        elif "49" in codes:
            self.offset[2] = self.work_z
        elif "53" in codes:
            self._go(number, np.append(self.position[:2], words["Z"]))
        elif words.keys() & set("XYZ"):
            self._move(number, words)
        elif not words.keys() <= _OTHER_LETTERS | {"P", "Q", "H"}:
            raise ValueError(f"line {number}: {text}")

    def _move(self, number: int, words: dict[str, float]) -> None:
        target = self.position.copy()
        for axis, letter in enumerate("XYZ"):
            if letter in words:
                target[axis] = words[letter] + self.offset[axis]
        if self.mode in ("81", "83"):
            self.cycle |= words
            self._drill(number, target)
        elif self.mode in ("2", "3"):
            arm = np.array([words.get("I", 0.0), words.get("J", 0.0)])
            self._turn(number, target, self.position[:2] + arm)
        else:
            self._go(number, target)

    def _go(self, number: int, target: Array) -> None:
        if (target != self.position).any():
            self._add(Span(number, self.position, target, np.full(2, np.nan), 0.0))

    def _turn(self, number: int, target: Array, centre: Array) -> None:
        arms = [complex(*(place[:2] - centre)) for place in (self.position, target)]
        sweep = math.remainder(np.angle(arms[1] / arms[0]), math.tau)
        if self.mode == "3" and sweep <= 0:
            sweep += math.tau
        elif self.mode == "2" and sweep >= 0:
            sweep -= math.tau
        self._add(Span(number, self.position, target, centre, sweep))

    def _add(self, span: Span) -> None:
        self.spans.append(span)
        self.position = span.end

    def _drill(self, number: int, target: Array) -> None:
        top = float(self.position[2])
        for z in self._heights(top):
            self._go(number, np.append(target[:2], z))

    def _heights(self, top: float) -> Iterator[float]:
        """Heights between which a cycle moves up and down, mm, machine."""
        retract = self.cycle["R"] + self.offset[2]
        bottom = self.cycle["Z"] + self.offset[2]
        yield from (top, retract)
        peck = self.cycle["Q"] if self.mode == "83" else retract - bottom
        depth = retract - peck
        while depth > bottom:
            yield from (depth, retract, depth + _PECK_CLEARANCE)
            depth -= peck
        yield from (bottom, top)


def read_path(text: str, folder: Path) -> ProgrammedPath:
    """The path of a program on a machine that starts at its zero.

    folder: holds the files of the machine with its work offset and tool lengths.
    """
    parameters = dict(line.split() for line in (folder / "mill.var").read_text().splitlines())
    offset = np.array([float(parameters[str(number)]) for number in (5221, 5222, 5223)])
    tools = re.findall(r"T(\d+) .*?Z([\d.]+)", (folder / "tool.tbl").read_text())
    reader = _Reader(offset, {int(number): float(length) for number, length in tools})
    for number, line in enumerate(text.splitlines(), 1):
        reader.read_line(number, line)
    # A machine at its zero does not move for `G53 G0 Z0`: home is where `G0 X Y` and `G0 Z` lead.
    home = reader.spans[1].end
    return ProgrammedPath(reader.spans, home, reader.tolerance, reader.dwell)
