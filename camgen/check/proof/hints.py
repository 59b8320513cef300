"""The texts of a proof with the hints of their programs, and the ids that notes name."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain
from typing import NamedTuple

from camgen.check.proof.pieces import IntArray
from camgen.model.part import Note
from camgen.model.program import Instruction, Origin


class Program(NamedTuple):
    """One text as it was read back, with the hints of the program.

    body: instructions without comments.
    lines: number of the line of each instruction in the text, from 1.
    path: (M,) index of the path of each motion, -1 for no path.
    origins: contours and operation of each path.
    file: name of the text.
    """

    body: Sequence[Instruction]
    lines: Sequence[int]
    path: IntArray
    origins: Sequence[Origin]
    file: str


class Named(NamedTuple):
    """Ids of contours that notes are about.

    skipped: ids in notes on contours that are left out.
    leads: ids in notes on shorter leads.
    tabs: ids in notes on fewer tabs.
    cleared: ids in notes on contours at which earlier operations leave nothing.
    others: ids in all other notes, and in those on contours that are left out.
    gaps: length, mm, that notes leave out of an edge, by its id.
    """

    skipped: frozenset[str]
    leads: frozenset[str]
    tabs: frozenset[str]
    cleared: frozenset[str]
    others: frozenset[str]
    gaps: dict[str, float]

    @classmethod
    def from_notes(cls, notes: Sequence[Note]) -> Named:
        """The ids that `notes` name."""
        skipped = [note.ids for note in notes if note.kind == "skipped"]
        leads = [note.ids for note in notes if note.lacks == "leads"]
        tabs = [note.ids for note in notes if note.lacks == "tabs"]
        cleared = [note.ids for note in notes if note.lacks == "paths"]
        others = [note.ids for note in notes if not note.lacks]
        lists = (skipped, leads, tabs, cleared, others)
        groups = [frozenset(chain.from_iterable(ids)) for ids in lists]
        gaps: dict[str, float] = {}
        for note in notes:
            if note.kind == "skipped" and note.length > 0:
                for name in note.ids:
                    gaps[name] = gaps.get(name, 0.0) + note.length
        return cls(groups[0], groups[1], groups[2], groups[3], groups[4], gaps)
