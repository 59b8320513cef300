"""An input file as a value: what the user called it, and its bytes."""

from __future__ import annotations

from pathlib import Path

from msgspec import Struct

from camgen.model.limits import Limits
from camgen.model.part import Note

#: What to do with a point cloud where a part is asked for.
SCAN = "of a scan: camgen localize MODEL SCAN -o FILE.toml finds where the part stands in it"


class Source(Struct, frozen=True, eq=False):
    """One input. path: as the user gave it, for messages; nobody opens it again. data: all its bytes.
    limits: what of it is too much. notes: what is known of how it came about, where a camera took it.
    """

    path: Path
    data: bytes
    limits: Limits = Limits()
    notes: tuple[Note, ...] = ()

    @property
    def name(self) -> str:
        """Without its folder."""
        return self.path.name

    @property
    def stem(self) -> str:
        """The name without its suffix: what a part is called."""
        return self.path.stem

    @property
    def suffix(self) -> str:
        """In small letters, with its dot; "" without one."""
        return self.path.suffix.lower()

    def __repr__(self) -> str:
        return f"Source({str(self.path)!r}, {len(self.data)} bytes)"
