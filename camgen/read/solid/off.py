"""OFF files (Geomview): vertices and polygons. Normals and colours are not read."""

from __future__ import annotations

import re

import numpy as np

from camgen.model.part import IntArray
from camgen.read.solid.polygons import (
    TRIANGLE,
    read_equal_rows,
    read_table,
    triangulate_polygons,
)
from camgen.read.solid.soup import MeshSoup, UnreadShape

#: The head. Its letters say that texture coordinates, colours and normals follow the coordinates.
_HEAD = re.compile(r"(ST)?(C)?(N)?(4)?(n)?OFF\b")


def read_off(data: bytes) -> MeshSoup:
    """The mesh in an OFF.

    Raises ValueError for a damaged file. Raises UnreadShape for another dimension and for a binary
    file.
    """
    lines = (line.partition("#")[0].strip() for line in data.decode("latin-1").split("\n"))
    rows = list(filter(None, lines))
    words = rows[0].split() if rows else [""]
    head = _HEAD.fullmatch(words[0])
    if head is None:
        raise ValueError("the head OFF is missing")
    if head[4] or head[5] or "BINARY" in words:
        raise UnreadShape(f"is {rows[0]}, which is not read: three coordinates in text are")
    # The numbers of vertices and faces may be in the line of the head or in the next one.
    rows = rows[1:] if len(words) == 1 else [" ".join(words[1:]), *rows[1:]]
    counts = rows[0].split() if rows else []
    if len(counts) < 2:
        raise ValueError("the numbers of vertices and faces are missing")
    count, faces = int(counts[0]), int(counts[1])
    if len(rows) < 1 + count + faces:
        raise ValueError("it ends before its last face")
    vertices = read_table(rows[1 : 1 + count], 3)
    polygons = _read_faces(rows[1 + count : 1 + count + faces])
    triangles = triangulate_polygons(vertices, polygons)
    return MeshSoup(vertices, triangles.faces, notes=triangles.notes)


def _read_faces(rows: list[str]) -> list[IntArray]:
    """The faces as one table (F, N) of vertices per number of corners N."""
    table = read_equal_rows(rows) if rows else None
    if table is not None and (table[:, 0] == table.shape[1] - 1).all():
        return [table[:, 1:]]
    by_size: dict[int, list[list[int]]] = {}
    for row in rows:
        size, *numbers = row.split()
        corners = list(map(int, numbers[: int(size)]))
        if len(corners) < int(size):
            raise ValueError("a face has fewer vertices than it says")
        by_size.setdefault(len(corners), []).append(corners)
    return [np.array(table) for size, table in by_size.items() if size >= TRIANGLE]
