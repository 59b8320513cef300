"""A program as the part that a reader returns: it has no contours, but motions of its own."""

from __future__ import annotations

from typing import TYPE_CHECKING

from camgen.shapes import Part

if TYPE_CHECKING:
    from camgen.gcode.interpreter import Run


class Recorded(Part, frozen=True, eq=False, kw_only=True):
    """A part whose motions were written down before: what ``operation.kind = "replay"`` runs again."""

    run: Run
