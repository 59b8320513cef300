"""The readers of drawings, pictures, solids and points, as the entry points name them.

All readers are asked about each input. ezdxf, OpenCV and trimesh load slowly, so this module names
the modules that read and imports them when they are needed.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from importlib import import_module
from typing import Any

from camgen.model.files import Source
from camgen.model.job import Job
from camgen.read import Reader, is_drawing
from camgen.read.files import Files

#: A PGM begins with a letter and a digit, and then a number.
_PGM = re.compile(rb"P[25](?:\s|#[^\n\r]*[\n\r])+[0-9]")
_PICTURES = (b"\x89PNG", b"\xff\xd8\xff", b"II*\x00", b"MM\x00*", b"BM")


def _is_dxf(head: bytes) -> bool:
    return head.startswith(b"AutoCAD Binary DXF") or head.split()[:2] == [b"0", b"SECTION"]


def _is_picture(head: bytes) -> bool:
    return head.startswith(_PICTURES) or _PGM.match(head) is not None


def _is_svg(head: bytes) -> bool:
    return head.removeprefix(b"\xef\xbb\xbf").lstrip().startswith((b"<?xml", b"<svg"))


def call_late(module: str, function: str) -> Callable[[Source, Job, Files], Any]:
    """A function that calls one of a module, which is imported at the first call."""

    def call(source: Source, job: Job, files: Files) -> Any:
        return getattr(import_module(module), function)(source, job, files)

    return call


def _read_picture(source: Source, job: Job, files: Files) -> Any:
    module = "camgen.read.artwork" if is_drawing(job) else "camgen.read.image"
    return call_late(module, "read")(source, job, files)


DXF = Reader(
    name="dxf",
    about="a DXF drawing",
    suffixes=(".dxf", ""),
    makes="drawing",
    read=call_late("camgen.read.dxf", "read"),
    inspect=call_late("camgen.read.dxf", "inspect"),
    recognise=_is_dxf,
)
SVG = Reader(
    name="svg",
    about="an SVG drawing",
    suffixes=(".svg",),
    makes="drawing",
    read=call_late("camgen.read.svg", "read"),
    inspect=call_late("camgen.read.svg", "inspect"),
    recognise=_is_svg,
)
IMAGE = Reader(
    name="image",
    about="a PNG, JPEG, TIFF, BMP or PGM picture",
    suffixes=(".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".pgm"),
    makes="picture",
    read=_read_picture,
    inspect=call_late("camgen.read.image", "inspect"),
    recognise=_is_picture,
)
SOLID = Reader(
    name="solid",
    about="a 3-D part",
    suffixes=(".stl", ".obj", ".ply", ".off", ".3mf", ".glb", ".step", ".stp"),
    makes="solid",
    read=call_late("camgen.read.solid", "read"),
    inspect=call_late("camgen.read.solid", "inspect"),
)
POINTS = Reader(
    name="xyz",
    about="a list of points in space",
    suffixes=(".xyz", ".pts", ".csv", ".txt"),
    makes="curves",
    read=call_late("camgen.read.points", "read"),
    inspect=call_late("camgen.read.points", "inspect"),
)
