"""PTX, the text of Leica Cyclone: scans one after the other, each with its own frame.

A scan has ten lines of head: its columns and rows, the place and the three axes of the scanner, and
four rows of a matrix. A point p of the scan stands at [p 1] times the matrix. Points follow column
by column, `0 0 0` where nothing was seen. The format is described by
http://paulbourke.net/dataformats/ptx/ and by https://pdal.io/en/2.8.1/stages/readers.ptx.html; the
product of row and matrix by the worked example of
https://rapidlasso.de/matrix-transformation-in-lastools/. None of them states a unit.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from camgen.localize.clouds.cloud import (
    AGAIN,
    FileCloud,
    StationScan,
    join_scans,
    parse_numbers,
)
from camgen.model.errors import InputError, make_one_line
from camgen.model.pose import FloatArray
from camgen.model.text import counted

#: Numbers in each line of the head: columns, rows, the scanner's place and axes, the matrix.
_HEAD = (1, 1, 3, 3, 3, 3, 4, 4, 4, 4)
#: A matrix turns and moves if its axes are perpendicular and of length one to this.
_RIGID = 1e-3
#: The scanner's two places in the head are one if they differ by less, in units of the file.
_SAME_PLACE = 1e-3


def read_ptx(name: str, data: bytes) -> FileCloud:
    """The points of all scans in their common frame. Raises InputError if the file is damaged."""
    lines = data.decode("ascii", "replace").splitlines()
    scans, begin = [], 0
    while begin < len(lines):
        if lines[begin].strip():
            scan, begin = _read_scan(name, lines, begin)
            scans.append(scan)
        else:
            begin += 1
    return join_scans(
        scans,
        ("row without a point was", "rows without a point were"),
        ("the scanner saw nothing there", "each by its own matrix"),
        "Leica Cyclone writes PTX in m",
    )


def _read_scan(name: str, lines: Sequence[str], begin: int) -> tuple[StationScan, int]:
    """The scan that begins in a line, from 0, and the index of the line after it."""
    columns, rows, place, *axes = _read_head(name, lines, begin)
    count = _count(name, columns, rows, begin)
    first = begin + len(_HEAD)
    if len(lines) < first + count:
        left = counted(len(lines) - first, f"of {count} points is", f"of {count} points are")
        raise InputError(
            name, f"the file is cut off, {left} there", f"the scan from line {begin + 1} on", AGAIN
        )
    points = _read_points(name, lines[first : first + count], first + 1)
    matrix = np.array(axes[3:])
    turn = matrix[:3, :3]
    rigid = np.allclose(turn @ turn.T, np.eye(3), atol=_RIGID)
    if not rigid or matrix[:, 3].tolist() != [0, 0, 0, 1]:
        raise InputError(
            name,
            "its matrix does more than turn and move",
            f"lines {begin + 7} to {begin + 10}",
            AGAIN,
        )
    seen = points.any(axis=1)
    moved = points[seen] @ turn + matrix[3, :3]
    scanner = _find_scanner(np.array(place), np.array(axes[:3]), matrix)
    return StationScan(moved, int(np.count_nonzero(~seen)), scanner), first + count


def _find_scanner(place: FloatArray, axes: FloatArray, matrix: FloatArray) -> FloatArray | None:
    """(3,) where the scanner stands in the common frame: at the origin of its points.

    None if the head says another place, and for 0, 0, 0 without a turn: programs that do not know
    it write that.
    """
    origin = matrix[3, :3]
    known = place.any() or not np.array_equal(axes, np.eye(3))
    if not known or np.abs(place - origin).max() > _SAME_PLACE:
        return None
    return origin


def _read_head(name: str, lines: Sequence[str], begin: int) -> list[list[float]]:
    rows = []
    for k, wanted in enumerate(_HEAD):
        line = lines[begin + k] if begin + k < len(lines) else ""
        numbers = parse_numbers(line.split())
        if len(numbers) != wanted:
            raise InputError(
                name,
                f"{make_one_line(line[:40])!r} is not in the head of a scan: "
                f"that has {counted(wanted, 'number')}",
                f"line {begin + k + 1}",
                AGAIN,
            )
        rows.append(numbers)
    return rows


def _count(name: str, columns: Sequence[float], rows: Sequence[float], begin: int) -> int:
    count = columns[0] * rows[0]
    if count != int(count) or count <= 0 or columns[0] != int(columns[0]):
        raise InputError(
            name,
            "its columns and rows are not whole numbers",
            f"lines {begin + 1} and {begin + 2}",
            AGAIN,
        )
    return int(count)


def _read_points(name: str, lines: Sequence[str], first: int) -> FloatArray:
    """(N, 3) x, y and z of each line, whatever follows. `first`: number of the first line."""
    values = []
    for number, line in enumerate(lines, first):
        try:
            x, y, z = map(float, line.split(None, 3)[:3])
        except ValueError as error:
            raise InputError(
                name,
                f"{make_one_line(line[:40])!r} is not a point",
                f"line {number}",
                "a line is x y z intensity",
            ) from error
        values.append((x, y, z))
    return np.array(values)
