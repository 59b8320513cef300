"""The bytes of a mesh file as vertices and triangles, as they are in the file.

trimesh reads glTF and text STL. Loading it takes longer than most builds from other files need.
"""

from __future__ import annotations

import json
import re
import struct
import zlib
from collections.abc import Callable
from collections.abc import Set as AbstractSet
from io import BytesIO
from typing import Any, NamedTuple
from xml.etree.ElementTree import ParseError
from zipfile import BadZipFile

import numpy as np
from msgspec import Struct

from camgen.model.errors import InputError, one_line
from camgen.model.files import SCAN, Source
from camgen.model.limits import Limits, format_limit
from camgen.model.part import IntArray, Note
from camgen.model.pose import FloatArray
from camgen.model.text import counted
from camgen.read.quiet import silence
from camgen.read.solid.bodies import NamedVertices
from camgen.read.solid.glb import list_names, prepare_glb
from camgen.read.solid.obj import read_obj
from camgen.read.solid.off import read_off
from camgen.read.solid.ply import read_ply
from camgen.read.solid.polygons import Triangles
from camgen.read.solid.threemf import read_3mf
from camgen.read.solid.unread import UnreadShape

SUFFIXES = (".stl", ".obj", ".ply", ".off", ".3mf", ".glb")

#: mm per unit, by name: 3MF states its own, glTF 2.0 (section 3.4) is in metres.
_MM = {
    "microns": 1e-3, "micron": 1e-3, "millimeters": 1.0, "millimeter": 1.0, "mm": 1.0,
    "centimeters": 10.0, "centimeter": 10.0, "cm": 10.0, "inches": 25.4, "inch": 25.4, "in": 25.4,
    "feet": 304.8, "foot": 304.8, "meters": 1000.0, "meter": 1000.0, "m": 1000.0,
}  # fmt: skip

#: The errors of readers in a damaged file. trimesh parses any bytes and fails in many ways.
#: ImportError: it needs a package for the format, or one that guesses the encoding of a text.
_STUMBLES = (
    ValueError, TypeError, LookupError, NameError, AttributeError, ArithmeticError, AssertionError,
    OSError, EOFError, ImportError, NotImplementedError, RuntimeError, StopIteration, ParseError,
    BadZipFile, struct.error, zlib.error,
)  # fmt: skip
_GUESSER = "charset_normalizer"
_SAVE_AGAIN = "export it again from the CAD program"


class MeshSoup(Struct, frozen=True, eq=False):
    """A mesh as it is in its file.

    vertices: (V, 3) in units of the file.
    faces: (F, 3) numbers of vertices.
    unit: name of the unit, "" if the format has none.
    mm: length of the unit, mm.
    named: names of bodies by vertex, None if the file has none.
    """

    vertices: FloatArray
    faces: IntArray
    unit: str
    mm: float
    notes: tuple[Note, ...]
    named: NamedVertices | None = None


def load(source: Source) -> MeshSoup:
    """The triangles in ``source``.

    Raises InputError for a file that is damaged, has no faces, or has numbers beyond all measure.
    """
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
    if kind == ".glb":
        _insist_on_accessors(name, data, source.limits.accessor)
    if kind == ".stl" and not _is_text(data):
        vertices, faces, unit, _, named = _Parsed(*_read_triangles(data))
    else:
        vertices, faces, unit, more, named = _parse(name, data, kind, source.limits)
        notes += more
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
    return MeshSoup(vertices, faces, unit, _MM.get(unit, 1.0), notes, named)


def _stl(name: str, data: bytes) -> tuple[bytes, tuple[Note, ...]]:
    """A binary STL cut to what its count says; text as it is."""
    if _is_text(data):
        return _close_text(name, data)
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


#: The words of a text STL that begin or end something, each in a line of its own.
_WORDS = re.compile(rb"^[ \t]*(solid|endsolid|facet|endfacet)\b", re.MULTILINE | re.IGNORECASE)


def _close_text(name: str, data: bytes) -> tuple[bytes, tuple[Note, ...]]:
    """A text STL in ASCII, closed if its last word is missing. InputError if it is cut off."""
    words = [word.lower() for word in _WORDS.findall(data)]
    solids, facets = words.count(b"solid"), words.count(b"facet")
    if facets != words.count(b"endfacet"):
        place = f"facet {facets} of all, in solid {solids}"
        raise InputError(name, "the file is cut off", place, _SAVE_AGAIN)
    # The names of solids may be in any encoding.
    data = data.translate(_ASCII)
    if solids == words.count(b"endsolid"):
        return data, ()
    if words[-1] == b"endsolid" or solids != words.count(b"endsolid") + 1:
        raise InputError(name, "a solid has no endsolid", "", _SAVE_AGAIN)
    note = Note("repaired", f"endsolid is missing behind solid {solids}, the last one", "added")
    return data.rstrip() + b"\nendsolid\n", (note,)


_SOLID_NAME = re.compile(rb"^[ \t]*solid[ \t]+(.*?)\s*$", re.MULTILINE | re.IGNORECASE)
_ASCII = bytes(k if k < 128 else ord("_") for k in range(256))


def _read_triangles(data: bytes) -> tuple[FloatArray, IntArray, str]:
    """Vertices and faces of a binary STL: 80 bytes, the number of facets, and the facets."""
    rows = np.frombuffer(
        data,
        np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")]),
        offset=84,
    )
    vertices = rows["corners"].reshape(-1, 3).astype(np.float64)
    return vertices, np.arange(len(vertices), dtype=np.int64).reshape(-1, 3), ""


def _insist_on_accessors(name: str, data: bytes, most: float) -> None:
    """InputError for an accessor of a GLB file that claims more elements than the file can have.

    An accessor may state any number (glTF 2.0, section 3.6.2). Other damage is left to the reader.
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


class _Parsed(NamedTuple):
    """A mesh as its reader has it. unit: "" if the format has none."""

    vertices: FloatArray
    faces: IntArray
    unit: str = ""
    notes: tuple[Note, ...] = ()
    named: NamedVertices | None = None


def _parse(name: str, data: bytes, kind: str, limits: Limits) -> _Parsed:
    """The mesh in a file. Raises InputError for one that is damaged."""
    try:
        return _read(data, kind, limits)
    except UnreadShape as error:
        raise InputError(name, str(error), "", _SAVE_AGAIN) from error
    except OverflowError as error:
        what = f"its model unpacks to more than {format_limit(limits.model_bytes)} {error}"
        remedy = "export it with fewer triangles, or raise limits.model_bytes"
        raise InputError(name, what, "", remedy) from error
    except _STUMBLES as error:
        package = error.name or "" if isinstance(error, ImportError) else ""
        if package and package != _GUESSER:
            missing = f"reading this {kind[1:].upper()} needs the package {package}"
            raise InputError(name, missing, "", f"install {package}, or {_SAVE_AGAIN}") from error
        raise InputError(
            name, f"is damaged or no {kind[1:].upper()} mesh: {_plain(error)}", "", _SAVE_AGAIN
        ) from error


def _read(data: bytes, kind: str, limits: Limits) -> _Parsed:
    """The mesh in a file. Raises one of `_STUMBLES` for one that is damaged."""
    with np.errstate(all="ignore"):
        if kind in _READERS:
            vertices, triangles = _READERS[kind](data)
            return _Parsed(vertices, triangles.faces, "", triangles.notes, triangles.named)
        if kind == ".3mf":
            bodies = read_3mf(data, limits.model_bytes)
            return _Parsed(
                bodies.vertices, bodies.faces, bodies.unit.lower(), bodies.notes, bodies.named
            )
        if kind == ".glb":
            return _load(prepare_glb(data), kind, list_names(data))
        return _load(data, kind, {name.decode() for name in _SOLID_NAME.findall(data)})


_READERS: dict[str, Callable[[bytes], tuple[FloatArray, Triangles]]] = {
    ".obj": read_obj,
    ".ply": read_ply,
    ".off": read_off,
}


def _load(data: bytes, kind: str, stated: AbstractSet[str]) -> _Parsed:
    """The mesh as trimesh reads it: glTF and STL in text.

    stated: names of bodies in the file.
    """
    import trimesh  # noqa: PLC0415 (heavy, and needed by what reads a mesh only)

    silence("trimesh")
    scene = trimesh.load_scene(BytesIO(data), file_type=kind[1:], process=False)
    for shape in scene.geometry.values():
        # Materials are of no use here, and trimesh needs one more package to copy them.
        if isinstance(shape, trimesh.Trimesh):
            shape.visual = trimesh.visual.ColorVisuals()
    meshes = [mesh for mesh in scene.dump() if isinstance(mesh, trimesh.Trimesh)]
    first = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    vertices = np.concatenate([np.zeros((0, 3)), *(mesh.vertices for mesh in meshes)])
    faces = [mesh.faces + before for mesh, before in zip(meshes, first, strict=False)]
    table = np.concatenate([np.zeros((0, 3), dtype=np.int64), *faces])
    unit = "m" if kind == ".glb" else ""
    return _Parsed(vertices, table, unit, (), _name_vertices(meshes, stated))


#: A name that trimesh makes of one that is there already.
_REPEATED = re.compile(r"_\d+$")


def _name_vertices(meshes: list[Any], stated: AbstractSet[str]) -> NamedVertices:
    """The names of the meshes of a scene. stated: names in the file; trimesh invents others."""
    names = []
    for mesh in meshes:
        given = [str(mesh.metadata.get(key, "")) for key in ("node", "name")]
        given += [_REPEATED.sub("", name) for name in given]
        names.append(next((name for name in given if name in stated), ""))
    sizes = [len(mesh.vertices) for mesh in meshes]
    return NamedVertices(names, np.repeat(np.arange(len(names)), sizes))


def _plain(error: Exception) -> str:
    text = one_line(str(error)).strip().rstrip(".")
    return text[:120] if text else type(error).__name__
