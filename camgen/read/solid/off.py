"""OFF files (Geomview): vertices and polygons; normals and colours are not needed."""

from __future__ import annotations

import re

import numpy as np

from camgen.model.part import IntArray
from camgen.model.pose import FloatArray
from camgen.read.solid.polygons import Triangles, check_numbers, cut_polygons
from camgen.read.solid.unread import UnreadShape

#: The head: texture coordinates, colours and normals may stand behind the coordinates of a vertex.
_HEAD = re.compile(r"(ST)?(C)?(N)?(4)?(n)?OFF\b")
_TRIANGLE = 3


def read_off(data: bytes) -> tuple[FloatArray, Triangles]:
    """Vertices (V, 3) and triangles of an OFF.

    Raises ValueError for a file that is damaged, UnreadShape for another dimension.
    """
    text = data.decode("latin-1")
    rows = [row for line in text.split("\n") if (row := line.partition("#")[0].split())]
    head = _HEAD.fullmatch(rows[0][0]) if rows else None
    if head is None:
        raise ValueError("the head OFF is missing")
    if head[4] or head[5] or "BINARY" in rows[0]:
        raise UnreadShape(
            f"is {' '.join(rows[0])}, which is not read: three coordinates in text are"
        )
    rows[0] = rows[0][1:]
    rows = [row for row in rows if row]
    if not rows or len(rows[0]) < 2:
        raise ValueError("the numbers of vertices and faces are missing")
    count, faces = int(rows[0][0]), int(rows[0][1])
    if len(rows) < 1 + count + faces:
        raise ValueError("it ends before its last face")
    vertices = np.array([row[:3] for row in rows[1 : 1 + count]], dtype=np.float64).reshape(-1, 3)
    by_size: dict[int, list[list[int]]] = {}
    for row in rows[1 + count : 1 + count + faces]:
        size = int(row[0])
        if len(row) <= size:
            raise ValueError("a face has fewer vertices than it says")
        by_size.setdefault(size, []).append([int(word) for word in row[1 : 1 + size]])
    polygons: list[IntArray] = [np.array(rows) for n, rows in by_size.items() if n >= _TRIANGLE]
    check_numbers(polygons, len(vertices))
    return vertices, cut_polygons(vertices, polygons)
