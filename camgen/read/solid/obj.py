"""OBJ files (Wavefront): vertices and polygons; normals, textures and materials are not needed."""

from __future__ import annotations

import re
from collections import Counter

import numpy as np

from camgen.model.part import IntArray, Note
from camgen.model.pose import FloatArray
from camgen.model.text import counted
from camgen.read.solid.polygons import Triangles, check_numbers, cut_polygons

_CONTINUED = re.compile(r"\\[ \t]*\r?\n")
#: Statements of free-form curves and surfaces, which hold a shape that is not read.
_FREE_FORM = ("curv", "curv2", "surf")
_TRIANGLE = 3


def read_obj(data: bytes) -> tuple[FloatArray, Triangles]:
    """Vertices (V, 3) and triangles of an OBJ.

    Raises ValueError for a statement that is damaged.
    """
    places: list[list[str]] = []
    faces: dict[int, list[list[int]]] = {}
    others: Counter[str] = Counter()
    for row in _CONTINUED.sub(" ", data.decode("latin-1")).split("\n"):
        words = row.partition("#")[0].split()
        if not words:
            continue
        word = words[0]
        if word == "v":
            places.append(words[1:4])
        elif word in ("f", "fo"):
            face = _number(words[1:], len(places))
            faces.setdefault(len(face), []).append(face)
        else:
            others[word] += 1
    if any(len(place) < 3 for place in places):
        raise ValueError("a vertex has less than three coordinates")
    vertices = np.array(places, dtype=np.float64).reshape(-1, 3)
    polygons: list[IntArray] = [np.array(rows) for size, rows in faces.items() if size >= _TRIANGLE]
    check_numbers(polygons, len(vertices))
    triangles = cut_polygons(vertices, polygons)
    return vertices, Triangles(triangles.faces, (*triangles.notes, *_note_free_forms(others)))


def _number(words: list[str], count: int) -> list[int]:
    """The vertices of a face, from 0; a negative one counts back from the vertices so far."""
    numbers = [int(word.partition("/")[0]) for word in words]
    if 0 in numbers:
        raise ValueError("a face names vertex 0; they count from 1")
    return [number - 1 if number > 0 else count + number for number in numbers]


def _note_free_forms(others: Counter[str]) -> list[Note]:
    count = sum(others[word] for word in _FREE_FORM)
    if not count:
        return []
    what = (
        f"{counted(count, 'free-form curve or surface', 'free-form curves and surfaces')} left out"
    )
    return [Note("skipped", what, "export the part as polygons, or as STEP")]
