"""A program that was read, as a part: it has no contours, but motions of its own."""

from __future__ import annotations

from collections.abc import Sequence

from msgspec import Struct

from camgen.model.part import Note, Part
from camgen.model.program import Instruction


class ProgramRun(Struct, frozen=True, eq=False):
    """What a program does.

    body: motions with the tool straight down, rapid ones as MoveJ, those that may round their corner with a blend of 1;
    outputs and waits. lines: of each, 1-based. remarks: what was assumed or left out, with its first line. held: rapid
    motions at the start whose position is not known in all axes, not in the body. entry: mm/s at which an assumed start
    is reached, 0 where the text says it. stopped: the line and the reason where it cannot be read on.
    ended: whether the text says so (M2, M30, a second per cent sign). units: "mm" or "inch".
    whole: it is a robot's, and brings its ways from path to path.
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
    """A part whose motions were written down before: what ``operation.kind = "replay"`` runs again."""

    run: ProgramRun
