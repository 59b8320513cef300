"""What the user should know about what was read or planned."""

from __future__ import annotations

from typing import Literal

from msgspec import Struct

#: ``skipped`` is what --strict turns into an error: something of the input that the program will not do.
NoteKind = Literal["assumed", "repaired", "joined", "skipped", "warning"]


class Note(Struct, frozen=True):
    """One thing the user should know. ``what`` names and counts it, ``why`` gives the reason and the remedy.

    ids: of the contours and edges that it is about, all of them.
    """

    kind: NoteKind
    what: str
    why: str = ""
    ids: tuple[str, ...] = ()

    def __str__(self) -> str:
        return f"{self.kind}: {self.what}" + (f" ({self.why})" if self.why else "")
