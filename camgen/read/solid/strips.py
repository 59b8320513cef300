"""PLY files with triangle strips, as older scanners write them; trimesh makes no faces of these.

The format is Turk's "The PLY Polygon File Format" (1994): a header of elements, each so many rows of numbers and lists.
"""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
from msgspec import Struct, field

from camgen.model.part import IntArray
from camgen.model.pose import FloatArray

_HAS_STRIPS = re.compile(rb"^element[ \t]+tristrips[ \t]", re.MULTILINE)
_END = re.compile(rb"^end_header[ \t]*\r?\n", re.MULTILINE)
_NUMBERS = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}
#: What the list of the vertices of a face or a strip is called.
_VERTICES = ("vertex_indices", "vertex_index")

#: So many numbers of a type, the next ones of the file.
_Take = Callable[[str, int], FloatArray]


class _Property(Struct):
    """A column of numbers of the type ``kind``; of a list, ``count`` is the type of its length."""

    name: str
    kind: str
    count: str = ""


class _Element(Struct):
    name: str
    rows: int
    properties: list[_Property] = field(default_factory=list)


def has_strips(data: bytes) -> bool:
    """Whether the header of a PLY names strips."""
    end = _END.search(data)
    return end is not None and _HAS_STRIPS.search(data[: end.start()]) is not None


def read_strips(data: bytes) -> tuple[FloatArray, IntArray]:
    """Vertices (V, 3) and triangles (F, 3) of a PLY, of its strips and its faces. ValueError or LookupError where it is
    none, or ends too soon.
    """
    end = _END.search(data)
    if end is None:
        raise ValueError("the header has no end")
    order, elements = _header(data[: end.start()].decode("latin-1"))
    take = _take_binary(data, end.end(), order) if order else _take_text(data[end.end() :])
    vertices, faces = np.zeros((0, 3)), [np.zeros((0, 3), dtype=np.int64)]
    for element in elements:
        columns = _read(element, take)
        if element.name == "vertex":
            vertices = np.column_stack([np.concatenate(columns[axis]) for axis in "xyz"])
        elif element.name in ("face", "tristrips"):
            of = unroll if element.name == "tristrips" else _fan
            lists = next(columns[name] for name in _VERTICES if name in columns)
            faces += [of(row.astype(np.int64)) for row in lists]
    return vertices, np.concatenate(faces)


def _header(text: str) -> tuple[str, list[_Element]]:
    """The order of bytes, empty for text, and the elements."""
    order, elements = "", list[_Element]()
    for words in map(str.split, text.splitlines()):
        match words:
            case ["format", name, _]:
                order = "" if name == "ascii" else _ORDERS[name]
            case ["element", name, count]:
                elements.append(_Element(name, int(count)))
            case ["property", "list", count, kind, name]:
                elements[-1].properties.append(_Property(name, _NUMBERS[kind], _NUMBERS[count]))
            case ["property", kind, name]:
                elements[-1].properties.append(_Property(name, _NUMBERS[kind]))
    return order, elements


def _take_text(body: bytes) -> _Take:
    numbers, at = np.array(body.split(), dtype=np.float64), 0

    def take(_kind: str, count: int) -> FloatArray:
        nonlocal at
        found, at = numbers[at : at + count], at + count
        if len(found) < count:
            raise ValueError("it ends before its last row")
        return found

    return take


def _take_binary(data: bytes, at: int, order: str) -> _Take:
    def take(kind: str, count: int) -> FloatArray:
        nonlocal at
        found = np.frombuffer(data, order + kind, count, at)
        at += found.nbytes
        return found.astype(np.float64)

    return take


def _read(element: _Element, take: _Take) -> dict[str, list[FloatArray]]:
    """The columns of an element by name: for each row its number or its list; of numbers alone all at once."""
    if len({one.kind for one in element.properties}) == 1 and not any(
        one.count for one in element.properties
    ):
        table = take(element.properties[0].kind, element.rows * len(element.properties))
        return {
            one.name: [table[k :: len(element.properties)]]
            for k, one in enumerate(element.properties)
        }
    columns: dict[str, list[FloatArray]] = {one.name: [] for one in element.properties}
    for _ in range(element.rows):
        for one in element.properties:
            count = int(take(one.count, 1)[0]) if one.count else 1
            columns[one.name].append(take(one.kind, count))
    return columns


def unroll(strip: IntArray) -> IntArray:
    """The triangles (F, 3) of strips of vertices (N,) with -1 between them: each vertex from the third on makes one
    with the two before it, every other one turned. Those with a vertex twice only lead the strip on.
    """
    faces = np.column_stack([strip[:-2], strip[1:-1], strip[2:]]).astype(np.int64)
    at = np.arange(len(strip))
    begins = np.maximum.accumulate(np.where(strip == -1, at + 1, 0))[: len(faces)]
    odd = (at[: len(faces)] - begins) % 2 == 1
    faces[odd] = faces[odd][:, [1, 0, 2]]
    a, b, c = faces.T
    return np.asarray(faces[(faces != -1).all(axis=1) & (a != b) & (b != c) & (a != c)])


def _fan(corners: IntArray) -> IntArray:
    """The triangles (F, 3) of a face with the vertices (N,)."""
    return np.column_stack(
        [np.full(max(len(corners) - 2, 0), corners[:1].sum()), corners[1:-1], corners[2:]]
    )
