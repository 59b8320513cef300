"""The lines of a preview, and the notes with the lines, paths and places that each is about."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain, islice

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


class ViewLine(Struct, frozen=True):
    """A contour or an edge, a part of one, a ring around a place, or an outline in a photo.

    id: id of the contour or edge.
    layer: its layer, or the kind of an edge.
    closed: whether it is closed.
    length: length as drawn, mm.
    state: "done", "skipped" or "unused" (no operation applies to it) for contours and edges;
        "wrong" or "noted" for a ring; "seen" for an outline in a photo.
    why: reason why it is skipped, or the note on the place of a ring.
    path: id of the path of a piece of an edge.
    """

    id: str
    layer: str
    closed: bool
    length: float
    state: str
    why: str
    path: str = ""


def link_notes(
    notes: Sequence[Note], lines: Sequence[ViewLine], paths: Sequence[str]
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
        rows += islice(rings, len(note.places))
        linked.append(
            ViewNote(
                note.kind,
                clean(note.what),
                clean(note.why),
                note.fails_strict,
                tuple(rows),
                tuple(path_of[ident] for ident in ids if ident in path_of),
                tuple((x, y, 0.0) for x, y in note.places),
            )
        )
    return tuple(linked)
