"""Point clouds whose head says what a record holds: PLY and PCD, as text or as bytes."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from msgspec import Struct

from camgen.localize.clouds.cloud import AGAIN, FileCloud, parse_numbers
from camgen.model.errors import InputError
from camgen.model.part import Note
from camgen.model.pose import FloatArray
from camgen.model.text import counted

#: Types of numbers in numpy's words.
_PLY = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2",
    "ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
_PCD = {
    "F4": "f4", "F8": "f8", "I1": "i1", "I2": "i2", "I4": "i4", "I8": "i8",
    "U1": "u1", "U2": "u2", "U4": "u4", "U8": "u8",
}  # fmt: skip
_DATA = {"ascii": "ascii", "binary": "records", "binary_compressed": "columns"}
_ORDER = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
#: The most points of a file, and the most numbers of a point (descriptors have 1,344).
_MOST_ENTRIES, _MOST_COLUMNS = 10**9, 10_000


class _Head(Struct, frozen=True):
    """The head of a file.

    columns: name and numpy type of each number of a record.
    count: the number of points.
    layout: "ascii", "records" or "columns" (compressed).
    body: the index of the first byte after the head.
    """

    columns: tuple[tuple[str, str], ...]
    count: int
    layout: str
    body: int


def has_faces(data: bytes) -> bool:
    """Whether a PLY file says that it has faces."""
    head = [line.split() for line in data[: max(data.find(b"end_header"), 0)].splitlines()]
    return any(words[:2] == [b"element", b"face"] and words[2:] != [b"0"] for words in head)


def read_ply(name: str, data: bytes) -> FileCloud:
    """The vertices of a PLY file. Raises InputError if it is damaged."""
    return FileCloud(_points(name, "PLY", data, _ply_head))


def read_pcd(name: str, data: bytes) -> FileCloud:
    """The points of a PCD file, and where the scanner stood. Raises InputError if it is damaged."""
    points = _points(name, "PCD", data, _pcd_head)
    spare = _count_spare(_pcd_head(data), data)
    notes = []
    if spare:
        what = counted(spare, "point was left out", "points were left out")
        notes.append(Note("repaired", what, f"POINTS of the head says {len(points)}"))
    return FileCloud(points, tuple(notes), _viewpoint(name, data))


def _count_spare(head: _Head, data: bytes) -> int:
    """The number of points after the last one that the head counts."""
    body = data[head.body :]
    if head.layout == "ascii":
        return sum(bool(line.strip()) for line in body.splitlines()) - head.count
    if head.layout == "records":
        return len(body) // _record(head).itemsize - head.count
    return 0


def _points(name: str, kind: str, data: bytes, parse: Callable[[bytes], _Head]) -> FloatArray:
    try:
        head = parse(data)
        places = _find_axes([column for column, _ in head.columns])
        if not 0 <= head.count < _MOST_ENTRIES:
            raise ValueError("the number of points cannot be")
        return _LAYOUTS[head.layout](head, data[head.body :], places)
    except (ValueError, LookupError, OverflowError) as error:
        raise InputError(
            name, f"is damaged or no {kind} point cloud: {error}", remedy=AGAIN
        ) from error


def _find_axes(names: Sequence[str]) -> list[int]:
    plain = list(map(str.lower, names))
    for axis in "xyz":
        if plain.count(axis) != 1:
            times = "none" if axis not in plain else "more than one"
            raise ValueError(f"of its fields {', '.join(names)[:60]!r} {times} is {axis}")
    return list(map(plain.index, "xyz"))


def _ply_head(data: bytes) -> _Head:
    """The vertices must come first, as they do in what scanners write."""
    end = data.find(b"end_header")
    if not data.startswith(b"ply") or end < 0:
        raise ValueError("its head has no beginning or no end")
    body = data.index(b"\n", end) + 1
    lines = [line.split() for line in data[:end].decode("ascii", "replace").splitlines()]
    formats = [words[1] for words in lines if words[:1] == ["format"]]
    if not formats:
        raise ValueError("its head has no format")
    order = _ORDER[formats[0]]
    elements = [i for i, words in enumerate(lines) if words[:1] == ["element"]]
    if not elements or lines[elements[0]][1] != "vertex":
        raise ValueError("its first element is not vertex")
    last = elements[1] if len(elements) > 1 else len(lines)
    columns = [words for words in lines[elements[0] : last] if words[:1] == ["property"]]
    typed = tuple((words[2], order + _PLY[words[1]]) for words in columns)
    return _Head(typed, int(lines[elements[0]][2]), "records" if order else "ascii", body)


def _pcd_head(data: bytes) -> _Head:
    at = data.find(b"\nDATA") + 1
    if not at:
        raise ValueError("its head has no DATA")
    body = data.index(b"\n", at) + 1
    lines = [line.split() for line in data[:body].decode("ascii", "replace").splitlines()]
    keys = {words[0]: words[1:] for words in lines if words and not words[0].startswith("#")}
    counts = [int(count) for count in keys.get("COUNT", ["1"] * len(keys["SIZE"]))]
    if min(counts, default=0) < 0 or sum(counts) > _MOST_COLUMNS:
        raise ValueError(f"its COUNT is beyond the {_MOST_COLUMNS:,} numbers that a point may have")
    columns: list[tuple[str, str]] = []
    for field, kind, size, count in zip(
        keys["FIELDS"], keys["TYPE"], keys["SIZE"], counts, strict=True
    ):
        columns += [(field, "<" + _PCD[kind + size])] * count
    return _Head(tuple(columns), int(keys["POINTS"][0]), _DATA[keys["DATA"][0]], body)


def _check_count(present: int, head: _Head) -> None:
    if present < head.count:
        points = f"of {head.count} points"
        raise ValueError(counted(present, f"{points} is there", f"{points} are there"))


def _parse_text(head: _Head, body: bytes, places: list[int]) -> FloatArray:
    rows = [line.split() for line in body.splitlines() if line.strip()][: head.count]
    _check_count(len(rows), head)
    points = np.zeros((len(rows), 3))
    for axis, place in enumerate(places):
        points[:, axis] = [float(words[place]) for words in rows]
    return points


def _record(head: _Head) -> np.dtype[np.void]:
    return np.dtype([(f"{i}", kind) for i, (_, kind) in enumerate(head.columns)])


def _unpack_columns(head: _Head, body: bytes, places: list[int]) -> FloatArray:
    record = _record(head)
    _check_count(len(body) // record.itemsize, head)
    rows = np.frombuffer(body, record, head.count)
    return np.column_stack([rows[f"{k}"].astype(np.float64) for k in places])


def _columns(head: _Head, body: bytes, places: list[int]) -> FloatArray:
    """All x, then all y, ..., packed together."""
    packed, size = np.frombuffer(body, "<u4", 2).tolist()
    sizes = [np.dtype(kind).itemsize * head.count for _, kind in head.columns]
    begins = np.cumsum([0, *sizes]).tolist()
    if size != begins[-1] or len(body) < 8 + packed:
        raise ValueError("its packed part has another size than its head says")
    plain = _unpack(body[8 : 8 + packed], size)
    return np.column_stack(
        [
            np.frombuffer(plain, head.columns[k][1], head.count, begins[k]).astype(np.float64)
            for k in places
        ]
    )


def _unpack(packed: bytes, size: int) -> bytes:
    """The bytes that LZF packed, as runs and as copies of earlier bytes (liblzf, lzf_d.c)."""
    plain, i = bytearray(), 0
    while i < len(packed):
        control = packed[i]
        i += 1
        if control < 32:
            plain += packed[i : i + control + 1]
            i += control + 1
            continue
        length = control >> 5
        if length == 7:
            length += packed[i]
            i += 1
        back = len(plain) - ((control & 31) << 8) - packed[i] - 1
        i += 1
        if back < 0 or len(plain) > size:
            raise ValueError("its packed part is damaged")
        while length + 2 > len(plain) - back:  # a copy that runs into itself repeats
            length -= len(plain) - back
            plain += plain[back:]
        plain += plain[back : back + length + 2]
    if len(plain) != size:
        raise ValueError("its packed part is damaged")
    return bytes(plain)


_LAYOUTS = {"ascii": _parse_text, "records": _unpack_columns, "columns": _columns}


def _viewpoint(name: str, data: bytes) -> FloatArray | None:
    """(3,) where the scanner stood, as VIEWPOINT says: its place, then its turn as a quaternion.

    Programs that do not know it write 0, 0, 0 without a turn, which says nothing.
    """
    lines = [line for line in data.splitlines() if line.startswith(b"VIEWPOINT")]
    if not lines:
        return None
    values = parse_numbers(lines[0].split()[1:])
    if len(values) != 7:
        raise InputError(
            name,
            "is damaged or no PCD point cloud: its VIEWPOINT is not seven numbers",
            remedy=AGAIN,
        )
    return None if values == [0, 0, 0, 1, 0, 0, 0] else np.array(values[:3])
