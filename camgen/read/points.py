"""Reads lists of points in space: one x,y,z or x,y,z,rx,ry,rz per line; a blank line ends a curve.

A curve goes in straight lines from point to point. Angles are those of poses in the work frame:
deg, about fixed x, y and z. docs/inputs/points.md describes the format.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

import numpy as np
from msgspec import Struct

from camgen.geometry.rotations import measure_angles_between
from camgen.model.errors import InputError, JobError
from camgen.model.files import Source
from camgen.model.job import InputTable, Job
from camgen.model.limits import format_limit
from camgen.model.part import Curve, Note, Part
from camgen.model.pose import FloatArray, frozen, rotation_from_fixed_xyz
from camgen.model.text import counted, short
from camgen.model.tolerance import SAME_POINT_MM
from camgen.read import units
from camgen.read.files import Files
from camgen.read.space import make_curve

_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_NAMES = ("x", "y", "z", "rx", "ry", "rz")
_REMEDY = "give x,y,z or x,y,z,rx,ry,rz by line, decimals with a point"
#: Largest coordinate, mm, and largest angle, deg. Larger numbers are damage.
_FARTHEST = 1e9
#: Settings of [input] that have no effect on a list of points.
_UNUSED_SETTINGS = ("layers", "join")


class PointsFacts(Struct, frozen=True):
    """The content of a list of points. Its `str` is a page to print.

    units: unit of the coordinates.
    angles: whether the list has the angles of the tool.
    curves: curves in the order of the file.
    size: extent along x, y and z, mm.
    notes: everything that was assumed, repaired or left out.
    """

    units: str
    angles: bool
    curves: tuple[Curve, ...]
    size: tuple[float, ...]
    notes: tuple[Note, ...]

    def __str__(self) -> str:
        size = units.format_size(self.size)
        angles = "with the angles of the tool" if self.angles else "without angles"
        lines = [f"list of points, units {self.units}, {size} mm, {angles}"]
        for curve in self.curves:
            line = f"{curve.id}: {counted(len(curve.points), 'point')}, {short(curve.length, 3)} mm"
            lines.append(line + (", closed" if curve.closed else ""))
        return "\n".join([*lines, *map(str, self.notes)])


def read(source: Source, job: Job, _files: Files) -> Part:
    """The curves in a list of points.

    Raises InputError for a line without a point, and if no curve has two points. Raises JobError
    for a setting that has no effect on a list of points.
    """
    for key in _UNUSED_SETTINGS:
        if getattr(job.input, key) != getattr(InputTable(), key):
            raise JobError(
                "job", "has no effect on a list of points", f"input.{key}", "leave it out"
            )
    unit, mm, assumed = units.resolve(source.name, job.input.units, 0, None)
    curves: list[Curve] = []
    notes = list(assumed)
    for line, rows in _read_rows(source):
        curve = _make_curve(f"c{len(curves) + 1}", np.array(rows), mm)
        if curve is None:
            notes.append(
                Note("skipped", f"the curve in line {line}", "it has no two points that differ")
            )
            continue
        curves.append(curve)
        dropped = len(rows) - len(curve.points)
        if dropped:
            notes.append(
                Note(
                    "repaired",
                    f"dropped: {counted(dropped, 'point')} of {curve.id}",
                    "the same as the one before",
                )
            )
    if not curves:
        raise InputError(
            source.name, "nothing to machine", remedy=f"{_REMEDY}, two or more of them"
        )
    if job.input.units.strip().lower() == "auto":
        notes += units.note_doubtful_size(_measure_size(curves), unit, source.name)
    return Part(source.stem, source.name, unit, (), tuple(notes), curves=tuple(curves))


def inspect(source: Source, job: Job, files: Files) -> PointsFacts:
    """The content of a list of points. Raises the errors of `read`."""
    part = read(source, job, files)
    angles = part.curves[0].rotations is not None
    return PointsFacts(part.units, angles, part.curves, _measure_size(part.curves), part.notes)


def _measure_size(curves: Sequence[Curve]) -> tuple[float, ...]:
    return tuple(np.ptp(np.concatenate([curve.points for curve in curves]), axis=0).tolist())


def _make_curve(name: str, rows: FloatArray, mm: float) -> Curve | None:
    """The curve through all points that differ from their predecessor, None if it has no length.

    rows: (N, 3 or 6) coordinates in the unit of the file, and angles in deg.
    mm: length of that unit, mm.
    """
    rotations = None
    if rows.shape[1] == len(_NAMES):
        angles = np.radians(rows[:, 3:]).tolist()
        rotations = np.stack([rotation_from_fixed_xyz(*row) for row in angles])
    points = rows[:, :3] * mm
    moves = np.linalg.norm(np.diff(points, axis=0), axis=1) > SAME_POINT_MM
    if rotations is not None:
        moves = moves | (measure_angles_between(rotations[:-1], rotations[1:]) > SAME_POINT_MM)
    kept = np.concatenate([[True], moves])
    points = points[kept]
    length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    if len(points) < 2 or length <= SAME_POINT_MM:
        return None
    closed = len(points) > 3 and float(np.linalg.norm(points[-1] - points[0])) <= SAME_POINT_MM
    turned = None if rotations is None else frozen(rotations[kept])
    return make_curve(name, "0", points, np.full((len(points) - 1, 3), np.nan), closed, turned)


def _read_rows(source: Source) -> list[tuple[int, list[list[float]]]]:
    """The line in which each curve starts, from 1, and its rows of numbers.

    Raises InputError for a row without 3 or 6 numbers, for rows of different lengths and for too
    many points.
    """
    curves: list[tuple[int, list[list[float]]]] = []
    starts_curve, width, count = True, 0, 0
    for number, words in _split_lines(source):
        if not words:
            starts_curve = True
            continue
        row = [_read_number(source, number, word) for word in words]
        width = width or len(row)
        if len(row) not in (3, 6) or len(row) != width:
            before = f", the lines before it {width}" if len(row) != width else ""
            raise InputError(
                source.name, f"has {counted(len(row), 'number')}{before}", f"line {number}", _REMEDY
            )
        count += 1
        if count > source.limits.points:
            raise InputError(
                source.name,
                f"has more than {format_limit(source.limits.points)} points",
                f"line {number}",
                "split it, or raise limits.points",
            )
        if starts_curve:
            curves.append((number, []))
        curves[-1][1].append(row)
        starts_curve = False
    return curves


def _split_lines(source: Source) -> Iterator[tuple[int, list[str]]]:
    """The number and the words of each line, no words for a blank line.

    Remarks (from # on), lines with a remark alone, and a first line with the names of the columns
    are left out.
    """
    try:
        text = source.data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(source.name, "is not a text", f"byte {error.start}", _REMEDY) from error
    is_first = True
    for number, line in enumerate(re.split(r"\r\n|\r|\n", text), 1):
        content = line.partition("#")[0].strip()
        if not content:
            if not line.strip():
                yield number, []
            continue
        words = _split(content)
        if not is_first or tuple(map(str.lower, words)) not in (_NAMES, _NAMES[:3]):
            yield number, words
        is_first = False


def _split(line: str) -> list[str]:
    """The words of a line, between semicolons, or else between commas, or else between blanks.

    A comma between semicolons may be a decimal sign. It stays in its word, which is not a number
    then.
    """
    for mark in ";,":
        if mark in line:
            return list(map(str.strip, line.split(mark)))
    return line.split()


def _read_number(source: Source, line: int, word: str) -> float:
    place = f"line {line}"
    if not _NUMBER.fullmatch(word):
        raise InputError(source.name, f"{word[:24]!a} is not a number", place, _REMEDY)
    value = float(word)
    if abs(value) > _FARTHEST:
        raise InputError(source.name, f"{word[:24]} is too large", place, _REMEDY)
    return value
