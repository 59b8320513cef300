"""The bytes of a mesh file as vertices and triangles, as they are in the file.

trimesh reads them, but for binary STL: loading trimesh takes longer than most builds from such a file need.
"""

from __future__ import annotations

import json
import struct
import zlib
from io import BytesIO
from zipfile import BadZipFile, ZipFile

import numpy as np
from msgspec import Struct

from camgen.model.errors import InputError, one_line
from camgen.model.files import SCAN, Source
from camgen.model.limits import tell
from camgen.model.part import IntArray, Note
from camgen.model.pose import FloatArray
from camgen.model.text import counted
from camgen.read.quiet import silence
from camgen.read.solid.strips import has_strips, read_strips

SUFFIXES = (".stl", ".obj", ".ply", ".off", ".3mf", ".glb")

#: mm per unit, by the names of the formats that have one: 3MF states its own, glTF 2.0 (section 3.4) is in metres.
_MM = {
    "microns": 1e-3, "micron": 1e-3, "millimeters": 1.0, "millimeter": 1.0, "mm": 1.0, "centimeters": 10.0,
    "centimeter": 10.0, "cm": 10.0, "inches": 25.4, "inch": 25.4, "in": 25.4, "feet": 304.8, "foot": 304.8,
    "meters": 1000.0, "meter": 1000.0, "m": 1000.0,
}  # fmt: skip

#: trimesh parses whatever it is given: a damaged file makes it stumble in each of these ways. ImportError: it wants
#: a package for this format, or the one that guesses the encoding of what is no text at all.
_STUMBLES = (
    ValueError, TypeError, LookupError, NameError, AttributeError, ArithmeticError, AssertionError, OSError, EOFError,
    ImportError, NotImplementedError, RuntimeError, StopIteration, SyntaxError, BadZipFile, struct.error, zlib.error,
)  # fmt: skip
_GUESSER = "charset_normalizer"
#: The part of a 3MF archive that trimesh reads.
_MODEL = "3d/3dmodel.model"
_SAVE_AGAIN = "export it again from the CAD program"


class MeshSoup(Struct, frozen=True, eq=False):
    """vertices (V, 3) in units of the file, faces (F, 3). unit: its name, "" if the format has none, mm: its size."""

    vertices: FloatArray
    faces: IntArray
    unit: str
    mm: float
    notes: tuple[Note, ...]


def load(source: Source) -> MeshSoup:
    """The triangles in ``source``. ``InputError`` if it is no mesh, has no faces, or holds numbers that are none."""
    name, kind = source.name, source.suffix
    if kind not in SUFFIXES:
        raise InputError(
            name,
            "is not a kind of mesh that camgen reads",
            "",
            f"give one of {', '.join(SUFFIXES)}",
        )
    data, notes = source.data, tuple[Note, ...]()
    if not data.strip():
        raise InputError(name, "the file is empty")
    if kind == ".stl":
        data, notes = _stl(name, data)
    if kind == ".3mf":
        data = _model_alone(name, data, source.limits.model_bytes)
    if kind == ".glb":
        _insist_on_accessors(name, data, source.limits.accessor)
    vertices, faces, unit = (
        _parse(name, data, kind) if kind != ".stl" or _is_text(data) else _read_triangles(data)
    )
    if not len(faces):
        only = f"{counted(len(vertices), 'point')} only" if len(vertices) else ""
        raise InputError(
            name, "has no faces", only, f"{_SAVE_AGAIN}; {SCAN}" if kind == ".ply" else _SAVE_AGAIN
        )
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise InputError(name, "a face names a vertex that is not there", "", _SAVE_AGAIN)
    wrong = np.flatnonzero(~(np.abs(vertices[faces]) < source.limits.mesh_place).all(axis=(1, 2)))
    if len(wrong):
        what = (
            f"{counted(len(wrong), 'face has', 'faces have')} "
            "coordinates that are not numbers, or beyond all measure"
        )
        remedy = f"{_SAVE_AGAIN}, or raise limits.mesh_place"
        raise InputError(name, what, f"the first is face {int(wrong[0]) + 1}", remedy)
    return MeshSoup(vertices, faces, unit, _MM.get(unit, 1.0), notes)


def _stl(name: str, data: bytes) -> tuple[bytes, tuple[Note, ...]]:
    """A binary STL cut to what its count says; text as it is."""
    if _is_text(data):
        return data, ()
    if len(data) < 84 or b"\x00" not in data:
        raise InputError(name, "is no STL mesh", "", _SAVE_AGAIN)
    size = 84 + 50 * int(struct.unpack_from("<I", data, 80)[0])
    if len(data) < size:
        whole = (size - 84) // 50
        there = counted((len(data) - 84) // 50, f"of {whole} is there", f"of {whole} are there")
        what = f"the file ends before its last face, {there}"
        raise InputError(name, what, "", _SAVE_AGAIN)
    if len(data) == size:
        return data, ()
    after = "after the last face"
    what = counted(len(data) - size, f"byte {after} was left out", f"bytes {after} were left out")
    return data[:size], (Note("repaired", what),)


def _read_triangles(data: bytes) -> tuple[FloatArray, IntArray, str]:
    """Vertices and faces of a binary STL: 80 bytes, their number, and for each normal, corners and two bytes more."""
    rows = np.frombuffer(
        data,
        np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")]),
        offset=84,
    )
    vertices = rows["corners"].reshape(-1, 3).astype(np.float64)
    return vertices, np.arange(len(vertices), dtype=np.int64).reshape(-1, 3), ""


def _model_alone(name: str, data: bytes, most: float) -> bytes:
    """The archive of a 3MF file with its model alone: pictures and settings are unpacked by nobody."""
    slim = BytesIO()
    try:
        with ZipFile(BytesIO(data)) as archive, ZipFile(slim, "w") as model:
            entries = [one for one in archive.infolist() if one.filename.lower().endswith(".model")]
            if not any(_MODEL in one.filename.lower() for one in entries):
                raise InputError(
                    name, "is no 3MF mesh: 3D/3dmodel.model is not in it", "", _SAVE_AGAIN
                )
            if sum(one.file_size for one in entries) > most:
                what = f"its model unpacks to more than {tell(most)} bytes"
                raise InputError(
                    name, what, "", "export it with fewer triangles, or raise limits.model_bytes"
                )
            for one in entries:
                model.writestr(one.filename, archive.read(one))
    except _STUMBLES as error:
        raise InputError(
            name, f"is damaged or no 3MF mesh: {_plain(error)}", "", _SAVE_AGAIN
        ) from error
    return slim.getvalue()


def _insist_on_accessors(name: str, data: bytes, most: float) -> None:
    """InputError for an accessor of a GLB file (glTF 2.0, section 3.6.2) that claims more than may be: it may say any
    number without a byte behind it. What is damaged otherwise is told by who reads it.
    """
    try:
        (length,) = struct.unpack_from("<I", data, 12)
        counts = [
            int(one["count"]) for one in json.loads(data[20 : 20 + length]).get("accessors", ())
        ]
    except _STUMBLES:
        return
    if max(counts, default=0) > most * len(data):
        what = f"an accessor of {max(counts):,} elements in a file of {len(data):,} bytes"
        raise InputError(name, what, "", f"{_SAVE_AGAIN}, or raise limits.accessor")


def _is_text(data: bytes) -> bool:
    """Whether an STL is text: it begins so, and holds no byte that text does not."""
    return data.lstrip()[:5].lower() == b"solid" and b"\x00" not in data[:2048]


def _parse(name: str, data: bytes, kind: str) -> tuple[FloatArray, IntArray, str]:
    import trimesh  # noqa: PLC0415 (heavy, and needed by what reads a mesh only)

    silence("trimesh")
    try:
        if kind == ".ply" and has_strips(data):
            return *read_strips(data), ""
        with np.errstate(all="ignore"):
            scene = trimesh.load_scene(BytesIO(data), file_type=kind[1:], process=False)
            for shape in scene.geometry.values():
                # Materials are of no use here, and trimesh needs one more package to copy them.
                if isinstance(shape, trimesh.Trimesh):
                    shape.visual = trimesh.visual.ColorVisuals()
            mesh = scene.to_mesh()
        vertices = np.asarray(mesh.vertices, dtype=np.float64).reshape(-1, 3)
        faces = np.asarray(mesh.faces, dtype=np.int64).reshape(-1, 3)
        unit = "m" if kind == ".glb" else str(mesh.units or "").lower()
    except _STUMBLES as error:
        package = error.name or "" if isinstance(error, ImportError) else ""
        # trimesh takes 3MF for no format at all where one of its packages is missing, without an error that names it.
        if kind == ".3mf" and isinstance(error, ImportError):
            what = "reading 3MF needs the packages lxml and networkx"
            raise InputError(
                name, what, "", f"pip install 'camgen[3mf]', or {_SAVE_AGAIN}"
            ) from error
        if package and package != _GUESSER:
            missing = f"reading this {kind[1:].upper()} needs the package {package}"
            raise InputError(name, missing, "", f"install {package}, or {_SAVE_AGAIN}") from error
        raise InputError(
            name, f"is damaged or no {kind[1:].upper()} mesh: {_plain(error)}", "", _SAVE_AGAIN
        ) from error
    return vertices, faces, unit


def _plain(error: Exception) -> str:
    text = one_line(str(error)).strip().rstrip(".")
    return text[:120] if text else type(error).__name__
