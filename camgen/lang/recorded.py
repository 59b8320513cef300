"""A program that was read, as a part with motions instead of contours."""

from __future__ import annotations

from collections.abc import Sequence

from msgspec import Struct

from camgen.model.part import Note, Part
from camgen.model.program import Instruction
from camgen.model.text import short


class ProgramRun(Struct, frozen=True, eq=False):
    """The effect of a program.

    body: (N) motions, outputs and waits. The tool of G-code points straight down. Its rapid motions
        are MoveJ, and motions that may round their corner have a blend of 1.
    lines: (N) line of each instruction, from 1.
    remarks: assumptions, warnings and skipped words, each with its first line.
    held: number of rapid motions before the position is known in all axes. They are not in `body`.
    entry: feed at which an assumed start is reached, mm/s. 0 if the text states the start.
    stopped: line and reason if the rest of the program cannot be read, None otherwise.
    ended: whether the text states its end (M2, M30, a second per cent sign).
    units: "mm" or "inch".
    whole: whether it is a program of a robot, which has the links between its paths.
    """

    body: tuple[Instruction, ...]
    lines: Sequence[int]
    remarks: tuple[tuple[int, Note], ...]
    held: int
    entry: float
    stopped: tuple[int, str] | None
    ended: bool
    units: str
    whole: bool = False


class Recorded(Part, frozen=True, eq=False, kw_only=True):
    """A part with the motions of an old program, for ``operation.kind = "replay"``.

    run: effect of the program.
    """

    run: ProgramRun


def format_box(low: Sequence[float], high: Sequence[float]) -> str:
    """The corners of a box, mm, such as "x 0 to 20, y 5 to 8, z -1 to 3 mm"."""
    corners = zip("xyz", low, high, strict=True)
    return ", ".join(f"{axis} {short(a, 3)} to {short(b, 3)}" for axis, a, b in corners) + " mm"
