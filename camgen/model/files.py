"""An input file as a value: the path that the user gave, and the bytes."""

from __future__ import annotations

from pathlib import Path

from msgspec import Struct

from camgen.model.limits import Limits
from camgen.model.part import Note

#: End of the message about a point cloud that is given where a part is needed.
SCAN = "of a scan: camgen localize MODEL SCAN -o FILE.toml finds where the part stands in it"


class Source(Struct, frozen=True, eq=False):
    """An input file.

    path: path as the user gave it, for messages; the file is not opened again.
    data: all bytes of the file.
    limits: limits that its content must keep.
    notes: notes on how a camera took it.
    """

    path: Path
    data: bytes
    limits: Limits = Limits()
    notes: tuple[Note, ...] = ()

    @property
    def name(self) -> str:
        """Name of the file without its folder."""
        return self.path.name

    @property
    def stem(self) -> str:
        """Name of the file without its suffix, which becomes the name of the part."""
        return self.path.stem

    @property
    def suffix(self) -> str:
        """Suffix in lower case, with its dot; "" without one."""
        return self.path.suffix.lower()

    def __repr__(self) -> str:
        return f"Source({str(self.path)!r}, {len(self.data)} bytes)"
