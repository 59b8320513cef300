"""Point clouds from files: PLY, PCD, text (XYZ, TXT, CSV, ASC), and scans that are meshes (STL, OBJ, OFF, PLY)."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
from msgspec import Struct

from camgen.localize.model import spread
from camgen.model.errors import InputError, one_line
from camgen.model.files import Source
from camgen.model.part import Note
from camgen.model.pose import FloatArray
from camgen.model.text import counted
from camgen.read.files import Files, reason
from camgen.read.solid.mesh_file import load

# Points of PLY and PCD files: a head that says what a record holds, then records as text or as bytes.

_PLY = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
_PCD = {
    kind + size: kind.lower() + size
    for kind, sizes in (("F", "48"), ("I", "1248"), ("U", "1248"))
    for size in sizes
}
_ORDER = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
#: A file cannot say more than this of one number of itself; a point cannot have more numbers (descriptors have 1,344).
_MOST_ENTRIES, _MOST_COLUMNS = 10**9, 10_000
AGAIN = "export it again from the scanner's program"


class _Head(Struct, frozen=True):
    """columns: name and numpy type of each number of a record. way: "ascii", "records" or "columns" (compressed)."""

    columns: tuple[tuple[str, str], ...]
    count: int
    way: str
    body: int


def has_faces(data: bytes) -> bool:
    """Whether a PLY file says that it has faces."""
    head = [line.split() for line in data[: max(data.find(b"end_header"), 0)].splitlines()]
    return any(words[:2] == [b"element", b"face"] and words[2:] != [b"0"] for words in head)


def ply(name: str, data: bytes) -> FloatArray:
    """The vertices (N, 3) of a PLY file, in its unit. ``InputError`` if it is damaged."""
    return _points(name, "PLY", data, _ply_head)


def pcd(name: str, data: bytes) -> FloatArray:
    """The points (N, 3) of a PCD file, in its unit. ``InputError`` if it is damaged."""
    return _points(name, "PCD", data, _pcd_head)


def _points(name: str, kind: str, data: bytes, parse: Callable[[bytes], _Head]) -> FloatArray:
    try:
        head = parse(data)
        names = [column for column, _ in head.columns]
        places = [names.index(axis) for axis in "xyz"]
        if not 0 <= head.count < _MOST_ENTRIES:
            raise ValueError("the number of points cannot be")
        body = data[head.body :]
        found = {"ascii": _parse_text, "records": _unpack_columns, "columns": _columns}[head.way](
            head, body, places
        )
    except (ValueError, LookupError, OverflowError) as error:
        raise InputError(
            name, f"is damaged or no {kind} point cloud: {error}", "", AGAIN
        ) from error
    return found


def _ply_head(data: bytes) -> _Head:
    """The vertices must come first, as they do in what scanners write."""
    end = data.find(b"end_header")
    if not data.startswith(b"ply") or end < 0:
        raise ValueError("its head has no beginning or no end")
    body = data.index(b"\n", end) + 1
    lines = [line.split() for line in data[:end].decode("ascii", "replace").splitlines()]
    ways = [words[1] for words in lines if words[:1] == ["format"]]
    if not ways:
        raise ValueError("its head has no format")
    order = _ORDER[ways[0]]
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
    said = {words[0]: words[1:] for words in lines if words and not words[0].startswith("#")}
    counts = [int(count) for count in said.get("COUNT", ["1"] * len(said["SIZE"]))]
    if min(counts, default=0) < 0 or sum(counts) > _MOST_COLUMNS:
        raise ValueError(f"its COUNT is beyond the {_MOST_COLUMNS:,} numbers that a point may have")
    sizes = zip(said["FIELDS"], said["TYPE"], said["SIZE"], counts, strict=True)
    columns = [(n, "<" + _PCD[t + s]) for n, t, s, count in sizes for _ in range(count)]
    way = {"ascii": "ascii", "binary": "records", "binary_compressed": "columns"}[said["DATA"][0]]
    return _Head(tuple(columns), int(said["POINTS"][0]), way, body)


def _missing(there: int, wanted: int) -> str:
    return counted(there, f"of {wanted} points is there", f"of {wanted} points are there")


def _parse_text(head: _Head, body: bytes, places: list[int]) -> FloatArray:
    lines = [line.split() for line in body.splitlines() if line.strip()][: head.count]
    if len(lines) < head.count:
        raise ValueError(_missing(len(lines), head.count))
    return np.array(
        [[float(words[k]) for k in places] for words in lines], dtype=np.float64
    ).reshape(-1, 3)


def _unpack_columns(head: _Head, body: bytes, places: list[int]) -> FloatArray:
    record = np.dtype([(f"{i}", kind) for i, (_, kind) in enumerate(head.columns)])
    there = len(body) // record.itemsize
    if there < head.count:
        raise ValueError(_missing(there, head.count))
    rows = np.frombuffer(body, record, head.count)
    return np.column_stack([rows[f"{k}"].astype(np.float64) for k in places])


def _columns(head: _Head, body: bytes, places: list[int]) -> FloatArray:
    """All x, then all y, ..., packed together."""
    packed, size = (int(v) for v in np.frombuffer(body, "<u4", 2))
    begins = np.cumsum(
        [0, *(np.dtype(kind).itemsize * head.count for _, kind in head.columns)]
    ).tolist()
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
    """What LZF packed: runs of bytes as they are, and copies of what came before (liblzf, lzf_d.c, is the format)."""
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


_TEXTS = (".xyz", ".txt", ".csv", ".asc", ".pts")
_MESHES = (".stl", ".obj", ".off")
SUFFIXES = (".ply", ".pcd", *_MESHES, *_TEXTS)

#: Fewer points than this do not hold a pose.
LEAST = 100
#: Points that are spread over the faces of a scan that is a mesh.
_SPREAD = 100_000
_FARTHEST_COORDINATE = 1e9
_SEPARATORS = re.compile(rb"[,;\t ]+")
_FACE = re.compile(rb"^f ", re.MULTILINE)
_NUMBER = re.compile(rb"[+-]?(\d|\.\d|nan|inf)", re.IGNORECASE)


class Scan(Struct, frozen=True, eq=False):
    """points: (N, 3) mm, finite, N at least ``LEAST``. notes: what was left out or assumed. viewpoint: (3,) mm, where
    the file says that the scanner stood.
    """

    points: FloatArray
    notes: tuple[Note, ...]
    viewpoint: FloatArray | None = None


def open_scan(path: Path, files: Files) -> Source:
    """The file of a scan. ``InputError`` where there is none."""
    try:
        return files.open(path)
    except IsADirectoryError:
        raise InputError(path.name, "is a folder", "", "name a point cloud in it") from None
    except FileNotFoundError:
        raise InputError(path.name, "there is no such file") from None
    except (OSError, ValueError) as error:  # ValueError: a zero byte in the name
        raise InputError(path.name, f"cannot be read: {one_line(reason(error))}") from error


def read(source: Source, mm: float = 1.0) -> Scan:
    """The points in ``source``; one unit of the file is ``mm``. ``InputError`` if there are none that could be used."""
    name, kind = source.name, source.suffix
    if kind not in SUFFIXES:
        raise InputError(
            name,
            "is no kind of point cloud that camgen reads",
            "",
            f"give one of {', '.join(SUFFIXES)}",
        )
    data = source.data
    if not data.strip():
        raise InputError(name, "the file is empty")
    notes: list[Note] = []
    viewpoint = None
    if kind == ".pcd":
        points, viewpoint = pcd(name, data), _viewpoint(name, data)
    elif kind in _TEXTS:
        points = _text(name, data)
    elif kind == ".ply" and not has_faces(data):
        points = ply(name, data)
    elif kind == ".obj" and not _FACE.search(data):
        points = _text(
            name, b"\n".join(line[2:] for line in data.splitlines() if line.startswith(b"v "))
        )
    else:
        points = _spread_over_mesh(source, notes)
    usable = _usable(name, points * mm, notes)
    return Scan(usable, tuple(notes), None if viewpoint is None else viewpoint * mm)


def _viewpoint(name: str, data: bytes) -> FloatArray | None:
    """Where the scanner stood, (3,), as VIEWPOINT of a PCD file says: its place, then its turn as a quaternion. 0, 0, 0
    without a turn is what programs write that do not know, and says nothing.
    """
    words = next(
        (line.split()[1:] for line in data.splitlines() if line.startswith(b"VIEWPOINT")), None
    )
    if words is None:
        return None
    try:
        values = np.array([float(word) for word in words])
    except ValueError:
        values = np.zeros(0)
    if len(values) != 7 or not (np.abs(values) < _FARTHEST_COORDINATE).all():
        raise InputError(
            name, "is damaged or no PCD point cloud: its VIEWPOINT is no seven numbers", "", AGAIN
        )
    if values.tolist() == [0, 0, 0, 1, 0, 0, 0]:
        return None
    return values[:3]


def _usable(name: str, points: FloatArray, notes: list[Note]) -> FloatArray:
    """The finite points. Scanners write NaN, or a point at the origin of the sensor, where they saw nothing."""
    finite = (np.abs(points) < _FARTHEST_COORDINATE).all(axis=1)
    if not finite.all():
        count = int(np.count_nonzero(~finite))
        which = "whose coordinates are no numbers, or beyond all measure,"
        what = counted(count, f"point {which} was left out", f"points {which} were left out")
        notes.append(Note("repaired", what))
        points = points[finite]
    void = (points == 0).all(axis=1)
    if np.count_nonzero(void) > 1:
        what = f"{int(np.count_nonzero(void))} points at exactly 0, 0, 0 were left out"
        notes.append(Note("repaired", what, "scanners write that where they saw nothing"))
        points = points[~void]
    if len(points) < LEAST:
        raise InputError(
            name, f"has {counted(len(points), 'usable point')}", "", f"a scan needs {LEAST} or more"
        )
    return points


def _text(name: str, data: bytes) -> FloatArray:
    """x, y, z in the first three columns of each line, whatever follows; a head without numbers, and # comments."""
    if b"\x00" in data[:4096]:
        raise InputError(name, "is no text", "", AGAIN)
    lines = data.replace(b"\r", b"\n").split(b"\n")
    begin = next((i for i, line in enumerate(lines) if _is_row(line)), None)
    if begin is None:
        raise InputError(
            name, "has no line of three numbers", "", "a line is x y z, in mm; --units for others"
        )
    rows = []
    for number, line in enumerate(lines[begin:], begin + 1):
        text = line.split(b"#")[0].split(b"//")[0].strip()
        if not text:
            continue
        try:
            x, y, z, *_ = _SEPARATORS.split(text)
            rows.append((float(x), float(y), float(z)))
        except ValueError:
            said = one_line(text[:40].decode("ascii", "replace"))
            raise InputError(
                name, f"{said!r} is no point", f"line {number}", "a line is x y z"
            ) from None
    return np.array(rows, dtype=np.float64)


def _is_row(line: bytes) -> bool:
    """Whether a line holds a point: three words that are numbers."""
    words = _SEPARATORS.split(line.strip())
    return len(words) >= 3 and all(_NUMBER.match(word) for word in words[:3])


def _spread_over_mesh(source: Source, notes: list[Note]) -> FloatArray:
    """Points spread over the faces of a mesh, which weighs each place alike, however coarse the triangles are."""
    soup = load(source)
    notes.extend(soup.notes)
    corners = soup.vertices[soup.faces]
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    if not area.any():
        raise InputError(source.name, "has no face with an area", "", AGAIN)
    notes.append(
        Note(
            "assumed",
            f"{_SPREAD} points were spread over the {counted(len(corners), 'face')} of the scan",
        )
    )
    return spread(corners, _SPREAD)[0]
