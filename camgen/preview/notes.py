"""The notes of a build, with the lines, paths and places of the preview that each is about."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain
from typing import Protocol

from msgspec import Struct

from camgen.check.report import clean
from camgen.model.part import Note
from camgen.model.pose import Vec3


class ViewNote(Struct, frozen=True):
    """A note of a build, or a finding of a program.

    kind: kind of the note, or level of the finding.
    what: its text.
    why: its reason or remedy.
    strict: whether --strict makes it an error.
    lines: indices of the lines of the view that it is about.
    paths: indices of the paths that it is about.
    places: places in the work frame, mm.
    text: line of the program that it is about, from 1 through all files; 0 for none.
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
    """The fields of `ViewLine` that are used here."""

    @property
    def id(self) -> str: ...
    @property
    def state(self) -> str: ...


def link_notes(
    notes: Sequence[Note], lines: Sequence[_Line], paths: Sequence[str]
) -> tuple[ViewNote, ...]:
    """Link notes to the lines and paths that they are about; their order is kept.

    lines: lines of the view. They include the rings around the places of the notes, in the order of
        the notes.
    paths: ids of the paths.

    A note on a line of which a part is left out is linked to that part alone.
    """
    by_id: dict[str, list[int]] = {}
    for k, line in enumerate(lines):
        by_id.setdefault(line.id, []).append(k)
    rings = iter([k for k, line in enumerate(lines) if line.state in ("wrong", "noted")])
    path_of = {ident: k for k, ident in enumerate(paths)}
    linked = []
    for note in notes:
        ids = [clean(ident) for ident in note.ids]
        rows = list(chain.from_iterable(by_id.get(ident, ()) for ident in ids))
        skipped = [k for k in rows if lines[k].state == "skipped"]
        if note.kind == "skipped" and skipped:
            rows = skipped
        # The number of rings that are taken is the number of places of the note.
        rows += [ring for _, ring in zip(note.places, rings, strict=False)]
        view_note = ViewNote(
            note.kind,
            clean(note.what),
            clean(note.why),
            note.fails_strict,
            tuple(rows),
            tuple(path_of[ident] for ident in ids if ident in path_of),
            tuple((x, y, 0.0) for x, y in note.places),
        )
        linked.append(view_note)
    return tuple(linked)
