"""What a reader returns: contours, and notes on what was skipped, mended or assumed on the way.

A segment of a contour is a line or an arc of at most half a circle, given by its bulge = tan(sweep / 4), positive
counter-clockwise (the DXF convention; CavalierContours shows that arcs survive an offset this way).
"""

from __future__ import annotations

from typing import Literal

from msgspec import Struct

from camgen.pose import FloatArray

#: ``skipped`` is what --strict turns into an error: something of the input that the program will not do.
NoteKind = Literal["assumed", "repaired", "joined", "skipped", "warning"]


class Note(Struct, frozen=True):
    """One thing the user should know. ``what`` names and counts it, ``why`` gives the reason and the remedy."""

    kind: NoteKind
    what: str
    why: str = ""

    def __str__(self) -> str:
        return f"{self.kind}: {self.what}" + (f" ({self.why})" if self.why else "")


class Contour(Struct, frozen=True, eq=False):
    """A chain of lines and arcs in the plane, work frame, mm.

    points: (N, 2), no point repeated at the end of a closed chain. bulges: (N,); ``bulges[i]`` shapes the segment
    that leaves point i, the last one counts only where ``closed``. |bulge| <= 1. id: the place in ``Part.contours``
    as users see it, e.g. ``c12``.
    """

    points: FloatArray
    bulges: FloatArray
    closed: bool
    layer: str
    id: str = ""


class Part(Struct, frozen=True, eq=False):
    """What was read. ``source`` is the file's name without folder, ``units`` says what one drawing unit was."""

    name: str
    source: str
    units: str
    contours: tuple[Contour, ...]
    notes: tuple[Note, ...]
