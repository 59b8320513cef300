"""Readers: a file's bytes to a Part, with notes on all that was skipped, mended or assumed."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from types import ModuleType

from camgen.model.errors import InputError
from camgen.model.job import Camera, Job
from camgen.model.part import Part

# Whether a picture is a drawing, or a photo of a part: the settings of the job tell.

_KINDS = ("trace", "fill", "drill")


def meant(job: Job) -> bool:
    """Whether a picture is a drawing: to be traced, filled, drilled or laid on a page, and no photo."""
    kind = job.operation.kind
    drawing = kind in _KINDS or (kind == "auto" and bool(job.page.size))
    return drawing and job.camera == Camera() and job.image.mask in ("auto", "otsu", "threshold")


_IMAGES = (b"\x89PNG", b"\xff\xd8\xff", b"II*\x00", b"MM\x00*", b"BM")
_SUFFIXES = {
    "": "dxf", ".dxf": "dxf", ".svg": "svg",
    ".png": "image", ".jpg": "image", ".jpeg": "image", ".tif": "image", ".tiff": "image", ".bmp": "image",
    ".stl": "solid", ".obj": "solid", ".ply": "solid", ".off": "solid", ".3mf": "solid", ".glb": "solid",
    ".step": "solid", ".stp": "solid",
    ".nc": "gcode", ".ngc": "gcode", ".gcode": "gcode", ".tap": "gcode",
}  # fmt: skip


def read(path: Path, job: Job) -> Part:
    """The part in the file ``path``, in mm, read as ``job`` asks. InputError if it has none."""
    part: Part = _reader(path, job).read(path, job)
    return part


def inspect(path: Path, job: Job) -> object:
    """What is in the file ``path``; its ``str`` is the page that ``camgen inspect`` prints."""
    found: object = _reader(path).inspect(path, job)
    return found


def _reader(path: Path, job: Job | None = None) -> ModuleType:
    """The module for this kind of file: ezdxf, OpenCV and trimesh are loaded only by what needs them."""
    kind = kind_of(path)
    if kind == "image" and job is not None and meant(job):
        kind = "artwork"
    return import_module(f"camgen.read.{kind}")


def kind_of(path: Path) -> str:
    """Which reader is for this file: by how it begins first, then by its name. InputError for others."""
    try:
        with path.open("rb") as file:
            head = file.read(64)
    except OSError:
        head = b""  # the reader says what is wrong with it
    if head.startswith(_IMAGES):
        return "image"
    if head.startswith(b"AutoCAD Binary DXF") or head.split()[:2] == [b"0", b"SECTION"]:
        return "dxf"
    if head.removeprefix(b"\xef\xbb\xbf").lstrip().startswith((b"<?xml", b"<svg")):
        return "svg"
    kind = _SUFFIXES.get(path.suffix.lower())
    if kind is None:
        what = "is not a kind of file that camgen reads"
        remedy = "give a DXF or SVG drawing, a PNG, JPEG, TIFF or BMP picture, a 3-D part, or G-code"
        raise InputError(path.name, what, remedy=remedy)
    return kind
