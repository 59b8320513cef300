"""OBJ files (Wavefront): vertices and polygons; normals, textures and materials are not needed."""

from __future__ import annotations

import re

import numpy as np

from camgen.model.part import IntArray, Note
from camgen.model.pose import FloatArray
from camgen.model.text import counted
from camgen.read.solid.polygons import Triangles, check_numbers, cut_polygons
from camgen.read.solid.rows import read_equal_rows, read_table

_CONTINUED = re.compile(r"\\[ \t]*\r?\n")
#: The word of a face in old files.
_OLD_FACE = re.compile(r"^[ \t]*fo(?=[ \t])", re.MULTILINE)
#: Statements of free-form curves and surfaces, which hold a shape that is not read.
_FREE_FORM = ("curv ", "curv2 ", "surf ")
#: The numbers of texture and normal after the number of a vertex.
_SLASHED = re.compile(r"/\S*")
_TRIANGLE = 3


def read_obj(data: bytes) -> tuple[FloatArray, Triangles]:
    """Vertices (V, 3) and triangles of an OBJ.

    Raises ValueError for a statement that is damaged.
    """
    text = _OLD_FACE.sub("f", _CONTINUED.sub(" ", data.decode("latin-1")))
    rows = list(filter(None, map(str.strip, text.split("\n"))))
    words = [row[:2].rstrip() for row in rows]
    places = [row[1:] for row, word in zip(rows, words, strict=True) if word == "v"]
    vertices = read_table(places, 3)[:, :3]
    polygons = _read_faces(rows, words)
    check_numbers(polygons, len(vertices))
    triangles = cut_polygons(vertices, polygons)
    return vertices, Triangles(triangles.faces, (*triangles.notes, *_note_free_forms(rows)))


def _read_faces(rows: list[str], words: list[str]) -> list[IntArray]:
    """The faces as tables of vertices, by their number of corners."""
    faces = [row[1:] for row, word in zip(rows, words, strict=True) if word == "f"]
    numbers = _SLASHED.sub("", "\n".join(faces))
    if not faces:
        return []
    if "-" not in numbers:
        table = read_equal_rows(numbers.split("\n"))
        if table is not None:
            return [table - 1]
    by_size: dict[int, list[list[int]]] = {}
    count = 0
    for row, word in zip(rows, words, strict=True):
        count += word == "v"
        if word == "f":
            face = _number(row.partition("#")[0].split()[1:], count)
            by_size.setdefault(len(face), []).append(face)
    return [np.array(table) for size, table in by_size.items() if size >= _TRIANGLE]


def _number(words: list[str], count: int) -> list[int]:
    """The vertices of a face, from 0; a negative one counts back from the vertices so far."""
    numbers = [int(word.partition("/")[0]) for word in words]
    return [number - 1 if number >= 0 else count + number for number in numbers]


def _note_free_forms(rows: list[str]) -> list[Note]:
    count = sum(row.startswith(_FREE_FORM) for row in rows)
    if not count:
        return []
    what = (
        f"{counted(count, 'free-form curve or surface', 'free-form curves and surfaces')} left out"
    )
    return [Note("skipped", what, "export the part as polygons, or as STEP")]
