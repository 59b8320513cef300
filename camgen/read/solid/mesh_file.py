"""Reads the vertices and triangles of a mesh file, as they are in the file.

trimesh reads glTF and text STL. Importing it takes longer than most builds from other files, so it
is imported for these formats alone.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Callable
from collections.abc import Set as AbstractSet
from io import BytesIO
from typing import Any
from xml.etree.ElementTree import ParseError
from zipfile import BadZipFile

import numpy as np
from msgspec.structs import replace

from camgen.model.errors import InputError, make_one_line
from camgen.model.files import SCAN, Source
from camgen.model.limits import Limits, format_limit
from camgen.model.part import Note
from camgen.model.text import counted
from camgen.read.quiet import silence
from camgen.read.solid.glb import list_names, prepare_glb, split_glb
from camgen.read.solid.obj import read_obj
from camgen.read.solid.off import read_off
from camgen.read.solid.ply import read_ply
from camgen.read.solid.soup import MeshSoup, NamedVertices, UnreadShape
from camgen.read.solid.threemf import read_3mf

SUFFIXES = (".stl", ".obj", ".ply", ".off", ".3mf", ".glb")

#: Errors that readers raise for a damaged file. trimesh parses any bytes and fails in many ways.
#: ImportError: trimesh needs a package for the format, or one that guesses the encoding of a text.
_READ_ERRORS = (
    ValueError, TypeError, LookupError, NameError, AttributeError, ArithmeticError, AssertionError,
    OSError, EOFError, ImportError, NotImplementedError, RuntimeError, StopIteration, ParseError,
    BadZipFile, struct.error, zlib.error,
)  # fmt: skip
_GUESSER = "charset_normalizer"
_SAVE_AGAIN = "export it again from the CAD program"


def read_mesh(source: Source) -> MeshSoup:
    """The triangles in a mesh file.

    Raises InputError for a file that is damaged, has no faces, or has coordinates beyond
    `limits.mesh_place`.
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
        data, notes = _repair_stl(name, data)
    if kind == ".glb":
        _check_accessors(name, data, source.limits.accessor)
    if kind == ".stl" and not _is_text(data):
        soup = _read_triangles(data)
    else:
        soup = _parse(name, data, kind, source.limits)
    vertices, faces = soup.vertices, soup.faces
    if not len(faces):
        only = f"{counted(len(vertices), 'point')} only" if len(vertices) else ""
        remedy = f"{_SAVE_AGAIN}; {SCAN}" if kind == ".ply" else _SAVE_AGAIN
        raise InputError(name, "has no faces", only, remedy)
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise InputError(name, "a face names a vertex that is not there", "", _SAVE_AGAIN)
    wrong = np.flatnonzero(~(np.abs(vertices[faces]) < source.limits.mesh_place).all(axis=(1, 2)))
    if len(wrong):
        what = counted(
            len(wrong),
            "face has coordinates that are not numbers, or too large",
            "faces have coordinates that are not numbers, or too large",
        )
        raise InputError(
            name,
            what,
            f"the first is face {int(wrong[0]) + 1}",
            f"{_SAVE_AGAIN}, or raise limits.mesh_place",
        )
    return replace(soup, notes=(*notes, *soup.notes))


def _repair_stl(name: str, data: bytes) -> tuple[bytes, tuple[Note, ...]]:
    """An STL with small faults corrected, and notes on these.

    A binary one loses the bytes after its last face. Raises InputError for one that is cut off.
    """
    if _is_text(data):
        return _close_text(name, data)
    if len(data) < 84 or b"\x00" not in data:
        raise InputError(name, "is not an STL mesh", "", _SAVE_AGAIN)
    size = 84 + 50 * int(struct.unpack_from("<I", data, 80)[0])
    if len(data) < size:
        whole = (size - 84) // 50
        rest = counted((len(data) - 84) // 50, f"of {whole} is there", f"of {whole} are there")
        raise InputError(name, f"the file ends before its last face, {rest}", "", _SAVE_AGAIN)
    if len(data) == size:
        return data, ()
    after = "after the last face"
    what = counted(len(data) - size, f"byte {after} was left out", f"bytes {after} were left out")
    return data[:size], (Note("repaired", what),)


#: Words of a text STL that start or end a solid or a facet, at the start of a line.
_WORDS = re.compile(rb"^[ \t]*(solid|endsolid|facet|endfacet)\b", re.MULTILINE | re.IGNORECASE)


def _close_text(name: str, data: bytes) -> tuple[bytes, tuple[Note, ...]]:
    """A text STL in ASCII, with its last `endsolid` added if only that is missing.

    Raises InputError for one that is cut off.
    """
    words = [word.lower() for word in _WORDS.findall(data)]
    solids, facets = words.count(b"solid"), words.count(b"facet")
    if facets != words.count(b"endfacet"):
        place = f"facet {facets} of all, in solid {solids}"
        raise InputError(name, "the file is cut off", place, _SAVE_AGAIN)
    # Names of solids may be in any encoding. Their other characters are replaced.
    data = data.translate(_ASCII)
    if solids == words.count(b"endsolid"):
        return data, ()
    if words[-1] == b"endsolid" or solids != words.count(b"endsolid") + 1:
        raise InputError(name, "a solid has no endsolid", "", _SAVE_AGAIN)
    note = Note("repaired", f"endsolid is missing after solid {solids}, the last one", "added")
    return data.rstrip() + b"\nendsolid\n", (note,)


_SOLID_NAME = re.compile(rb"^[ \t]*solid[ \t]+(.*?)\s*$", re.MULTILINE | re.IGNORECASE)
_ASCII = bytes(k if k < 128 else ord("_") for k in range(256))


def _read_triangles(data: bytes) -> MeshSoup:
    """The mesh of a binary STL: 80 bytes, the number of facets, and the facets."""
    rows = np.frombuffer(
        data,
        np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")]),
        offset=84,
    )
    vertices = rows["corners"].reshape(-1, 3).astype(np.float64)
    return MeshSoup(vertices, np.arange(len(vertices), dtype=np.int64).reshape(-1, 3))


def _check_accessors(name: str, data: bytes, limit: float) -> None:
    """Raise InputError for an accessor of a GLB file with more elements than the file can have.

    An accessor may state any number (glTF 2.0, section 3.6.2). The reader finds other damage.

    limit: maximum number of elements per byte of the file.
    """
    try:
        document, _ = split_glb(data)
        counts = [int(accessor["count"]) for accessor in document.get("accessors", ())]
    except _READ_ERRORS:
        return
    if max(counts, default=0) > limit * len(data):
        raise InputError(
            name,
            f"an accessor of {max(counts):,} elements in a file of {len(data):,} bytes",
            "",
            f"{_SAVE_AGAIN}, or raise limits.accessor",
        )


def _is_text(data: bytes) -> bool:
    """Whether an STL is text: it starts with "solid", and has no zero byte near its start."""
    return data.lstrip()[:5].lower() == b"solid" and b"\x00" not in data[:2048]


def _parse(name: str, data: bytes, kind: str, limits: Limits) -> MeshSoup:
    try:
        return _read(data, kind, limits)
    except UnreadShape as error:
        raise InputError(name, str(error), "", _SAVE_AGAIN) from error
    except OverflowError as error:
        raise InputError(
            name,
            f"its model unpacks to more than {format_limit(limits.model_bytes)} {error}",
            "",
            "export it with fewer triangles, or raise limits.model_bytes",
        ) from error
    except _READ_ERRORS as error:
        package = error.name or "" if isinstance(error, ImportError) else ""
        if package and package != _GUESSER:
            missing = f"reading this {kind[1:].upper()} needs the package {package}"
            raise InputError(name, missing, "", f"install {package}, or {_SAVE_AGAIN}") from error
        text = make_one_line(str(error)).strip().rstrip(".")
        raise InputError(
            name,
            f"is damaged or no {kind[1:].upper()} mesh: {text[:120] or type(error).__name__}",
            "",
            _SAVE_AGAIN,
        ) from error


def _read(data: bytes, kind: str, limits: Limits) -> MeshSoup:
    with np.errstate(all="ignore"):
        if kind in _READERS:
            return _READERS[kind](data)
        if kind == ".3mf":
            return read_3mf(data, limits.model_bytes)
        if kind == ".glb":
            return _read_with_trimesh(prepare_glb(data), kind, list_names(data))
        return _read_with_trimesh(data, kind, {name.decode() for name in _SOLID_NAME.findall(data)})


_READERS: dict[str, Callable[[bytes], MeshSoup]] = {
    ".obj": read_obj,
    ".ply": read_ply,
    ".off": read_off,
}


def _read_with_trimesh(data: bytes, kind: str, stated: AbstractSet[str]) -> MeshSoup:
    """The mesh of a glTF or of an STL in text.

    stated: names of bodies in the file.
    """
    import trimesh  # noqa: PLC0415 (heavy, and needed for these formats only)

    silence("trimesh")
    scene = trimesh.load_scene(BytesIO(data), file_type=kind[1:], process=False)
    for shape in scene.geometry.values():
        # Materials are not used, and trimesh would need one more package to copy them.
        if isinstance(shape, trimesh.Trimesh):
            shape.visual = trimesh.visual.ColorVisuals()
    meshes = [mesh for mesh in scene.dump() if isinstance(mesh, trimesh.Trimesh)]
    vertices, faces = [np.zeros((0, 3))], [np.zeros((0, 3), dtype=np.int64)]
    count = 0
    for mesh in meshes:
        vertices.append(mesh.vertices)
        faces.append(mesh.faces + count)
        count += len(mesh.vertices)
    unit, named = "m" if kind == ".glb" else "", _name_vertices(meshes, stated)
    return MeshSoup(np.concatenate(vertices), np.concatenate(faces), unit, (), named)


#: The ending that trimesh adds to a name that another mesh has too.
_REPEATED = re.compile(r"_\d+$")


def _name_vertices(meshes: list[Any], stated: AbstractSet[str]) -> NamedVertices:
    """The names of the meshes of a scene.

    stated: names in the file. trimesh invents others, which are not used.
    """
    names = []
    for mesh in meshes:
        node, name = str(mesh.metadata.get("node", "")), str(mesh.metadata.get("name", ""))
        candidates = [node, name, _REPEATED.sub("", node), _REPEATED.sub("", name)]
        names.append(next(filter(stated.__contains__, candidates), ""))
    sizes = [len(mesh.vertices) for mesh in meshes]
    return NamedVertices(names, np.repeat(np.arange(len(names)), sizes))
