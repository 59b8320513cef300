"""The notes of a build as a preview has them: with the lines, the paths and the places that each is about."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from msgspec import Struct

from camgen.check.report import clean
from camgen.model.part import Note
from camgen.model.pose import Vec3


class ViewNote(Struct, frozen=True):
    """kind: that of a note, or the level of a finding. lines, paths: rows of the view that it is about. places: work
    frame, mm. strict: --strict makes it an error. text: the line of the program that it is about, counted from 1
    through all files, 0: none.
    """

    kind: str
    what: str
    why: str
    strict: bool
    lines: tuple[int, ...] = ()
    paths: tuple[int, ...] = ()
    places: tuple[Vec3, ...] = ()
    text: int = 0


class _Line(Protocol):
    """What is needed of a line of a view."""

    @property
    def id(self) -> str: ...
    @property
    def state(self) -> str: ...


def see_notes(
    notes: Sequence[Note], lines: Sequence[_Line], paths: Sequence[str]
) -> tuple[ViewNote, ...]:
    """``notes`` in their order. lines: of the view, the rings around places of notes among them, in the order of those.

    paths: their ids. A note on what was left out is about the parts of a line that were left out, where it was run in
    part.
    """
    by_id: dict[str, list[int]] = {}
    for k, line in enumerate(lines):
        by_id.setdefault(line.id, []).append(k)
    rings = iter([k for k, line in enumerate(lines) if line.state in ("wrong", "noted")])
    path_of = {ident: k for k, ident in enumerate(paths)}
    found = []
    for note in notes:
        own = [k for ident in note.ids for k in by_id.get(clean(ident), ())]
        left = [k for k in own if lines[k].state == "skipped"]
        if note.kind == "skipped" and left:
            own = left
        own += [ring for _, ring in zip(note.places, rings, strict=False)]
        found.append(
            ViewNote(
                note.kind,
                clean(note.what),
                clean(note.why),
                note.fails_strict,
                tuple(own),
                tuple(path_of[clean(ident)] for ident in note.ids if clean(ident) in path_of),
                tuple((x, y, 0.0) for x, y in note.places),
            )
        )
    return tuple(found)
