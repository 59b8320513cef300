"""OBJ files (Wavefront): vertices and polygons. Normals, textures and materials are not read."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from camgen.model.part import IntArray, Note
from camgen.model.text import counted
from camgen.read.solid.polygons import (
    TRIANGLE,
    read_equal_rows,
    read_table,
    triangulate_polygons,
)
from camgen.read.solid.soup import MeshSoup, NamedVertices

_CONTINUED = re.compile(r"\\[ \t]*\r?\n")
#: The keyword of a face in old files.
_OLD_FACE = re.compile(r"^[ \t]*fo(?=[ \t])", re.MULTILINE)
#: Statements of free-form curves and surfaces, which hold a shape that is not read.
_FREE_FORM = ("curv ", "curv2 ", "surf ")
#: The numbers of the texture and the normal after the number of a vertex.
_SLASHED = re.compile(r"/\S*")


def read_obj(data: bytes) -> MeshSoup:
    """The mesh in an OBJ. Raises ValueError for a damaged statement."""
    text = _OLD_FACE.sub("f", _CONTINUED.sub(" ", data.decode("latin-1")))
    rows = list(filter(None, map(str.strip, text.split("\n"))))
    words = [row[:2].rstrip() for row in rows]
    positions = [row[1:] for row, word in zip(rows, words, strict=True) if word == "v"]
    vertices = read_table(positions, 3)
    groups = _read_faces(rows, words)
    triangles = triangulate_polygons(vertices, [group.corners for group in groups])
    notes = (*triangles.notes, *_note_free_forms(rows))
    named = _read_names(rows, words, groups, len(vertices))
    return MeshSoup(vertices, triangles.faces, notes=notes, named=named)


class _Polygons(NamedTuple):
    """Faces with the same number of corners.

    corners: (F, N) numbers of the vertices, from 0.
    indices: (F,) indices of the faces among all faces of the file.
    """

    corners: IntArray
    indices: IntArray


def _read_faces(rows: list[str], words: list[str]) -> list[_Polygons]:
    """The faces in one table per number of corners.

    rows: rows of the file.
    words: first word of each row.
    """
    faces = [row[1:] for row, word in zip(rows, words, strict=True) if word == "f"]
    numbers = _SLASHED.sub("", "\n".join(faces))
    if not faces:
        return []
    if "-" not in numbers:
        table = read_equal_rows(numbers.split("\n"))
        if table is not None:
            return [_Polygons(table - 1, np.arange(len(table)))]
    corners: dict[int, list[list[int]]] = {}
    indices: dict[int, list[int]] = {}
    vertex_count = face_count = 0
    for row, word in zip(rows, words, strict=True):
        vertex_count += word == "v"
        if word == "f":
            face = _read_face(row.partition("#")[0].split()[1:], vertex_count)
            corners.setdefault(len(face), []).append(face)
            indices.setdefault(len(face), []).append(face_count)
            face_count += 1
    return [
        _Polygons(np.array(table), np.array(indices[size]))
        for size, table in corners.items()
        if size >= TRIANGLE
    ]


def _read_names(
    rows: list[str], words: list[str], groups: Sequence[_Polygons], count: int
) -> NamedVertices | None:
    """The names of objects, or of groups in a file without objects.

    count: number of vertices.
    """
    word = "o" if "o" in words else "g"
    if word not in words:
        return None
    names: list[str] = []
    owner_of_face = []
    for row, first in zip(rows, words, strict=True):
        if first == word:
            names.append(row[1:].strip())
        elif first == "f":
            owner_of_face.append(len(names) - 1)
    owners = np.full(count, -1)
    for group in groups:
        owners[group.corners] = np.array(owner_of_face)[group.indices][:, None]
    return NamedVertices(names, owners)


def _read_face(words: list[str], count: int) -> list[int]:
    """The vertices of a face, from 0. A negative number counts back from the last vertex before it.

    count: number of vertices before the face.
    """
    numbers = [int(word.partition("/")[0]) for word in words]
    return [number - 1 if number >= 0 else count + number for number in numbers]


def _note_free_forms(rows: list[str]) -> Iterator[Note]:
    count = sum(row.startswith(_FREE_FORM) for row in rows)
    if count:
        what = counted(count, "free-form curve or surface", "free-form curves and surfaces")
        yield Note("skipped", f"{what} left out", "export the part as polygons, or as STEP")
