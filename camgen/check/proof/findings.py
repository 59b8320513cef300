"""Differences between the drawing and the motions of a text, steps not proven, and the result."""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct, field

from camgen.check.proof.motions import Motions
from camgen.check.proof.pieces import BoolArray, IntArray
from camgen.check.proof.unplaced import Unplaced
from camgen.model.text import join_short


class Finding(Struct, frozen=True):
    """One difference.

    line: number of the line in the text, 0 for a difference that has no line.
    text: the sentence.
    """

    line: int
    text: str


class Findings(Struct):
    """The differences of one text, and the steps that could not be proven.

    items: differences in the order in which they were found.
    unproven: steps that were not examined, each with its reason.
    """

    items: list[Finding] = field(default_factory=list)
    unproven: list[str] = field(default_factory=list)

    def add(self, motions: Motions, row: int, what: str) -> None:
        """Adds a difference of the motion `row`, with its line and the place where it ends."""
        place = motions.end[row].tolist()
        where = ""
        if all(map(math.isfinite, place)):
            where = f", ends at {join_short(place, 3)} mm"
        self.items.append(Finding(int(motions.line[row]), f"the motion {what}{where}"))

    def add_first(self, motions: Motions, rows: IntArray | BoolArray, what: str) -> None:
        """Adds a difference of the first motion at the indices or in the mask `rows`, if any."""
        if rows.dtype == np.bool_:
            rows = np.flatnonzero(rows)
        for row in rows[:1].tolist():
            self.add(motions, row, what)

    def miss(self, what: str) -> None:
        """Adds a difference without a motion: something is missing in the text."""
        self.items.append(Finding(0, what))

    def leave(self, what: str, why: str) -> None:
        """Adds a step that is not proven, with its reason."""
        text = f"{what}: {why}"
        if text not in self.unproven:
            self.unproven.append(text)


class MotionProof(Struct, frozen=True):
    """The result of a proof.

    contours: number of contours that are worked as the job asks for.
    length: their length, mm.
    motions: number of motions that were examined.
    findings: differences in order of line, each with the name of its file.
    unproven: steps that were not examined, each with its reason.
    unplaced: numbers of motions to or from joint values, of which only the outputs are examined.
    """

    contours: int
    length: float
    motions: int
    findings: tuple[tuple[str, Finding], ...]
    unproven: tuple[str, ...]
    unplaced: Unplaced = Unplaced()
