"""PLY files, with polygons and with the triangle strips of older scanners.

The format is Turk's "The PLY Polygon File Format" (1994). A header lists the elements and their
numbers of rows. The rows with numbers and lists follow.
"""

from __future__ import annotations

import re

import numpy as np
from msgspec import Struct, field

from camgen.model.part import IntArray
from camgen.model.pose import FloatArray
from camgen.read.solid.polygons import triangulate_polygons
from camgen.read.solid.soup import MeshSoup

_END = re.compile(rb"^end_header[ \t]*\r?\n", re.MULTILINE)
_NUMBERS = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2",
    "ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
#: Some rows of a column: the lengths of its lists (rows, 1), (rows, 0) for numbers, and the values
#: (rows, size).
_Table = tuple[FloatArray, FloatArray]
#: Names of the list of vertices of a face or a strip.
_VERTICES = ("vertex_indices", "vertex_index")


class _Property(Struct):
    """A column of numbers.

    kind: type of the numbers.
    count: type of the length, for a column of lists.
    """

    name: str
    kind: str
    count: str = ""


class _Element(Struct):
    name: str
    rows: int
    properties: list[_Property] = field(default_factory=list)


class _Text:
    """The rows of a file in text, read one table after the other.

    at: index of the next number.
    """

    def __init__(self, body: bytes) -> None:
        self._numbers = np.array(body.split(), dtype=np.float64)
        self.at = 0

    def peek(self, columns: list[_Property]) -> list[int]:
        """The length of each column in the next row, 1 for a number."""
        at, sizes = self.at, list[int]()
        for column in columns:
            size = int(self._numbers[at : at + 1].sum()) if column.count else 1
            at += size + bool(column.count)
            sizes.append(size)
        return sizes

    def table(self, columns: list[_Property], sizes: list[int], rows: int) -> list[_Table]:
        """The next rows as a table per column of the given sizes.

        Raises ValueError if the file has fewer rows.
        """
        width = sum(sizes) + sum(bool(column.count) for column in columns)
        part = self._numbers[self.at : self.at + width * rows]
        if len(part) < width * rows:
            raise ValueError("it ends before its last row")
        self.at += width * rows
        part = part.reshape(rows, width)
        tables, at = list[_Table](), 0
        for column, size in zip(columns, sizes, strict=True):
            begin = at + bool(column.count)
            tables.append((part[:, at:begin], part[:, begin : begin + size]))
            at = begin + size
        return tables


class _Binary:
    """The rows of a binary file, with the methods of `_Text`.

    order: byte order, "<" or ">".
    at: offset of the next row.
    """

    def __init__(self, data: bytes, at: int, order: str) -> None:
        self._data, self._order = data, order
        self.at = at

    def peek(self, columns: list[_Property]) -> list[int]:
        at, sizes = self.at, list[int]()
        for column in columns:
            size = 1
            if column.count:
                length = np.frombuffer(self._data, self._order + column.count, 1, at)
                size, at = int(length[0]), at + length.nbytes
            at += size * np.dtype(column.kind).itemsize
            sizes.append(size)
        return sizes

    def table(self, columns: list[_Property], sizes: list[int], rows: int) -> list[_Table]:
        fields: list[tuple[str, str, tuple[int]]] = []
        for column, size in zip(columns, sizes, strict=True):
            lengths = self._order + (column.count or column.kind)
            fields.append((f"f{len(fields)}", lengths, (1 if column.count else 0,)))
            fields.append((f"f{len(fields)}", self._order + column.kind, (size,)))
        table = np.frombuffer(self._data, np.dtype(fields), rows, self.at)
        self.at += table.nbytes
        arrays = [table[name].astype(np.float64) for name, *_ in fields]
        return list(zip(arrays[::2], arrays[1::2], strict=True))


def read_ply(data: bytes) -> MeshSoup:
    """The mesh in a PLY, from its faces and its strips.

    Raises ValueError or LookupError for a file that is damaged or ends too soon.
    """
    end = _END.search(data)
    if end is None:
        raise ValueError("the header has no end")
    order, elements = _header(data[: end.start()].decode("latin-1"))
    source = _Binary(data, end.end(), order) if order else _Text(data[end.end() :])
    vertices, strips = np.zeros((0, 3)), [np.zeros((0, 3), dtype=np.int64)]
    polygons: list[IntArray] = []
    for element in elements:
        numbers, lists = _read(element, source)
        if element.name == "vertex":
            vertices = np.column_stack([numbers[axis] for axis in "xyz"])
        elif element.name in ("face", "tristrips"):
            named = [lists[name] for name in _VERTICES if name in lists]
            if element.rows and not named:
                raise ValueError(f"its {element.name} rows have no list of vertices")
            for table in named[0] if named else []:
                if element.name == "face":
                    polygons.append(table.astype(np.int64))
                else:
                    strips += map(unroll, table.astype(np.int64))
    triangles = triangulate_polygons(vertices, polygons)
    faces = np.concatenate([triangles.faces, *strips])
    return MeshSoup(vertices, faces, notes=triangles.notes)


def _header(text: str) -> tuple[str, list[_Element]]:
    """The byte order, "" for text, and the elements. Raises ValueError without a format."""
    order, elements = "no format", list[_Element]()
    for words in map(str.split, text.splitlines()):
        match words:
            case ["format", name, _]:
                order = _ORDERS[name]
            case ["element", name, count]:
                elements.append(_Element(name, int(count)))
            case ["property", "list", count, kind, name]:
                elements[-1].properties.append(_Property(name, _NUMBERS[kind], _NUMBERS[count]))
            case ["property", kind, name]:
                elements[-1].properties.append(_Property(name, _NUMBERS[kind]))
    if order == "no format":
        raise ValueError("the header has no format")
    return order, elements


def _read(
    element: _Element, source: _Text | _Binary
) -> tuple[dict[str, FloatArray], dict[str, list[FloatArray]]]:
    """The rows of an element, read at once if their lists are equally long, else one by one.

    Returns the columns of numbers (rows,) by name, and the columns of lists by name: tables, each
    (M, N) of the M lists with N numbers.
    """
    numbers: dict[str, FloatArray] = {}
    lists: dict[str, list[FloatArray]] = {}
    if not element.rows:
        return numbers, lists
    names = [column.name for column in element.properties]
    if len(set(names)) < len(names):
        raise ValueError(f"its {element.name} rows have two properties of one name")
    begin, sizes = source.at, source.peek(element.properties)
    try:
        parts = [source.table(element.properties, sizes, element.rows)]
        pairs = zip(parts[0], sizes, strict=True)
        is_even = all((lengths == size).all() for (lengths, _), size in pairs)
    except ValueError:
        if not any(column.count for column in element.properties):
            raise
        is_even = False  # the file may end sooner because its other lists are shorter
    if not is_even:
        source.at, parts = begin, []
        for _ in range(element.rows):
            parts.append(source.table(element.properties, source.peek(element.properties), 1))
    for column, tables in zip(element.properties, zip(*parts, strict=True), strict=True):
        by_size: dict[int, list[FloatArray]] = {}
        for _, values in tables:
            by_size.setdefault(values.shape[1], []).append(values)
        joined = list(map(np.concatenate, by_size.values()))
        if column.count:
            lists[column.name] = joined
        else:
            numbers[column.name] = joined[0][:, 0]
    return numbers, lists


def unroll(strip: IntArray) -> IntArray:
    """The triangles (F, 3) of strips of vertices (N,) with -1 between them.

    Each vertex from the third on makes a triangle with the two before it. Every other triangle is
    turned. A triangle that has one vertex twice has no area and is left out.
    """
    faces = np.column_stack([strip[:-2], strip[1:-1], strip[2:]]).astype(np.int64)
    at = np.arange(len(strip))
    begins = np.maximum.accumulate(np.where(strip == -1, at + 1, 0))[: len(faces)]
    odd = (at[: len(faces)] - begins) % 2 == 1
    faces[odd] = faces[odd][:, [1, 0, 2]]
    a, b, c = faces.T
    return np.asarray(faces[(faces != -1).all(axis=1) & (a != b) & (b != c) & (a != c)])
