"""Point clouds from files: PLY, PCD, text (XYZ, TXT, CSV, ASC), and scans that are meshes (STL, OBJ, OFF, PLY)."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from msgspec import Struct

from camgen.errors import InputError, one_line
from camgen.localize.model import spread
from camgen.localize.records import AGAIN, has_faces, pcd, ply
from camgen.note import Note
from camgen.pose import FloatArray
from camgen.solids.mesh_load import load

_TEXTS = (".xyz", ".txt", ".csv", ".asc", ".pts")
_MESHES = (".stl", ".obj", ".off")
SUFFIXES = (".ply", ".pcd", *_MESHES, *_TEXTS)

#: Fewer points than this do not hold a pose.
LEAST = 100
#: Points that are spread over the faces of a scan that is a mesh.
_SPREAD = 100_000
_FARTHEST = 1e9
_SEPARATORS = re.compile(rb"[,;\t ]+")
_FACE = re.compile(rb"^f ", re.MULTILINE)
_NUMBER = re.compile(rb"[+-]?(\d|\.\d|nan|inf)", re.IGNORECASE)


class Scan(Struct, frozen=True, eq=False):
    """points: (N, 3) mm, finite, N at least ``LEAST``. notes: what was left out or assumed."""

    points: FloatArray
    notes: tuple[Note, ...]


def read(path: Path, mm: float = 1.0) -> Scan:
    """The points in ``path``; one unit of the file is ``mm``. ``InputError`` if there are none that could be used."""
    name, kind = path.name, path.suffix.lower()
    if kind not in SUFFIXES:
        raise InputError(name, "is no kind of point cloud that camgen reads", "", f"give one of {', '.join(SUFFIXES)}")
    data = _content(path)
    notes: list[Note] = []
    if kind == ".pcd":
        points = pcd(name, data)
    elif kind in _TEXTS:
        points = _text(name, data)
    elif kind == ".ply" and not has_faces(data):
        points = ply(name, data)
    elif kind == ".obj" and not _FACE.search(data):
        points = _text(name, b"\n".join(line[2:] for line in data.splitlines() if line.startswith(b"v ")))
    else:
        points = _meshed(path, notes)
    return Scan(_usable(name, points * mm, notes), tuple(notes))


def _content(path: Path) -> bytes:
    try:
        data = path.read_bytes()
    except IsADirectoryError:
        raise InputError(path.name, "is a folder", "", "name a point cloud in it") from None
    except FileNotFoundError:
        raise InputError(path.name, "there is no such file") from None
    except OSError as error:
        raise InputError(path.name, f"cannot be read: {one_line(error.strerror or str(error))}") from error
    if not data.strip():
        raise InputError(path.name, "the file is empty")
    return data


def _usable(name: str, points: FloatArray, notes: list[Note]) -> FloatArray:
    """The finite points. Scanners write NaN, or a point at the origin of the sensor, where they saw nothing."""
    finite = (np.abs(points) < _FARTHEST).all(axis=1)
    if not finite.all():
        count = int(np.count_nonzero(~finite))
        what = f"{count} points whose coordinates are no numbers, or beyond all measure, were left out"
        notes.append(Note("repaired", what))
        points = points[finite]
    void = (points == 0).all(axis=1)
    if np.count_nonzero(void) > 1:
        what = f"{int(np.count_nonzero(void))} points at exactly 0, 0, 0 were left out"
        notes.append(Note("repaired", what, "scanners write that where they saw nothing"))
        points = points[~void]
    if len(points) < LEAST:
        raise InputError(name, f"has {len(points)} usable points", "", f"a scan needs {LEAST} or more")
    return points


def _text(name: str, data: bytes) -> FloatArray:
    """x, y, z in the first three columns of each line, whatever follows; a head without numbers, and # comments."""
    if b"\x00" in data[:4096]:
        raise InputError(name, "is no text", "", AGAIN)
    lines = data.replace(b"\r", b"\n").split(b"\n")
    begin = next((i for i, line in enumerate(lines) if _is_row(line)), None)
    if begin is None:
        raise InputError(name, "has no line of three numbers", "", "a line is x y z, in mm; --units for others")
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
            raise InputError(name, f"{said!r} is no point", f"line {number}", "a line is x y z") from None
    return np.array(rows, dtype=np.float64)


def _is_row(line: bytes) -> bool:
    """Whether a line holds a point: three words that are numbers."""
    words = _SEPARATORS.split(line.strip())
    return len(words) >= 3 and all(_NUMBER.match(word) for word in words[:3])


def _meshed(path: Path, notes: list[Note]) -> FloatArray:
    """Points spread over the faces of a mesh, which weighs each place alike, however coarse the triangles are."""
    soup = load(path)
    notes.extend(soup.notes)
    corners = soup.vertices[soup.faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    if not area.any():
        raise InputError(path.name, "has no face with an area", "", AGAIN)
    notes.append(Note("assumed", f"{_SPREAD} points were spread over the {len(corners)} faces of the scan"))
    return spread(corners, _SPREAD)[0]
