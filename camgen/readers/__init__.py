"""Readers: a file's bytes to a Part, with notes on all that was skipped, mended or assumed."""

from __future__ import annotations

from pathlib import Path

from camgen.errors import InputError
from camgen.settings import Job
from camgen.shapes import Part

_IMAGES = (b"\x89PNG", b"\xff\xd8\xff", b"II*\x00", b"MM\x00*", b"BM")
_SUFFIXES = {".dxf": "dxf"} | dict.fromkeys((".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp"), "image")


def read(path: Path, job: Job) -> Part:
    """The part in the file ``path``, in mm, read as ``job`` asks. InputError if it has none."""
    if kind_of(path) == "image":
        from camgen.readers import image  # noqa: PLC0415 (OpenCV is loaded only by what needs it)

        return image.read(path, job)
    from camgen.readers import dxf  # noqa: PLC0415 (as is ezdxf)

    return dxf.read(path, job.input, job.tolerance.chord)


def inspect(path: Path, job: Job) -> object:
    """What is in the file ``path``; its ``str`` is the page that ``camgen inspect`` prints."""
    if kind_of(path) == "image":
        from camgen.readers import image  # noqa: PLC0415 (as above)

        return image.inspect(path, job)
    from camgen.readers import dxf  # noqa: PLC0415 (as above)

    return dxf.inspect(path, job.input)


def kind_of(path: Path) -> str:
    """Which kind of file this is, "dxf" or "image": by how it begins first, then by its name. InputError for others."""
    try:
        with path.open("rb") as file:
            head = file.read(64)
    except OSError:
        head = b""  # the reader says what is wrong with it
    if head.startswith(_IMAGES):
        return "image"
    if head.startswith(b"AutoCAD Binary DXF") or head.split()[:2] == [b"0", b"SECTION"]:
        return "dxf"
    kind = _SUFFIXES.get(path.suffix.lower() or ".dxf")
    if kind is None:
        what = "is not a kind of file that camgen reads"
        raise InputError(path.name, what, remedy="give a DXF drawing or a PNG, JPEG, TIFF or BMP picture")
    return kind
