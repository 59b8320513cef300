"""Readers: a file's bytes to a Part, with notes on all that was skipped, mended or assumed."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

from camgen.errors import InputError
from camgen.settings import Input
from camgen.shapes import Part


def read(path: Path, settings: Input, chord: float) -> Part:
    """The part in the file ``path``, in mm; ``chord`` mm is what curves may be left by. InputError if it has none."""
    part: Part = _reader(path).read(path, settings, chord)
    return part


def inspect(path: Path, settings: Input) -> object:
    """What is in the file ``path``; its ``str`` is the page that ``camgen inspect`` prints."""
    found: object = _reader(path).inspect(path, settings)
    return found


def _reader(path: Path) -> ModuleType:
    """The module that reads this kind of file: by its name first, then by how it begins."""
    from camgen.readers import dxf  # noqa: PLC0415 (ezdxf is loaded only by what needs it)

    if path.suffix.lower() not in ("", ".dxf") and not _looks_like_dxf(path):
        raise InputError(path.name, "is not a kind of file that camgen reads", remedy="give a DXF drawing")
    return dxf


def _looks_like_dxf(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            head = file.read(64)
    except OSError:
        return True  # the reader says what is wrong with it
    return head.startswith(b"AutoCAD Binary DXF") or head.split()[:2] == [b"0", b"SECTION"]
