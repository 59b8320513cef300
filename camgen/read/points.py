"""Lists of points in space: a text with x,y,z or x,y,z,rx,ry,rz by line; a blank line lifts the tool.

A curve goes straight from point to point. Angles are those of the work frame's poses: deg, about fixed x, y and z.
docs/inputs/points.md describes the format.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np
from msgspec import Struct

from camgen.geometry.rotations import angles_between
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
#: A coordinate, mm, or an angle, deg, beyond this is damage.
_FARTHEST = 1e9
#: Settings of [input] that a list of points has no use for.
_IDLE = ("layers", "join")


class PointsFacts(Struct, frozen=True):
    """What is in a list of points; its ``str`` is a page to print. size: mm along x, y and z."""

    units: str
    angles: bool
    curves: tuple[Curve, ...]
    size: tuple[float, ...]
    notes: tuple[Note, ...]

    def __str__(self) -> str:
        size = " x ".join(short(v, 3) for v in self.size)
        with_angles = "with the angles of the tool" if self.angles else "without angles"
        rows = [
            f"{one.id}: {counted(len(one.points), 'point')}, {short(one.length, 3)} mm"
            f"{', closed' if one.closed else ''}"
            for one in self.curves
        ]
        return "\n".join(
            [
                f"list of points, units {self.units}, {size} mm, {with_angles}",
                *rows,
                *map(str, self.notes),
            ]
        )


def read(source: Source, job: Job, _files: Files) -> Part:
    """The curves in the list, mm. InputError for a line that is no point, and where no curve has two points."""
    for key in _IDLE:
        if getattr(job.input, key) != getattr(InputTable(), key):
            raise JobError(
                "job", "has no effect on a list of points", f"input.{key}", "leave it out"
            )
    unit, mm, notes = units.resolve(source.name, job.input.units, 0, None)
    found: list[Curve] = []
    more: list[Note] = []
    for line, rows in _chains(source):
        curve = _curve(f"c{len(found) + 1}", np.array(rows), mm)
        if curve is None:
            more.append(
                Note("skipped", f"the curve in line {line}", "it has no two points that differ")
            )
        else:
            found.append(curve)
            if len(curve.points) < len(rows):
                what = f"dropped: {counted(len(rows) - len(curve.points), 'point')} of {curve.id}"
                more.append(Note("repaired", what, "the same as the one before"))
    if not found:
        raise InputError(
            source.name, "nothing to machine", remedy=f"{_REMEDY}, two or more of them"
        )
    if job.input.units.strip().lower() == "auto":
        more += units.doubts(_size(found), unit, source.name)
    return Part(source.stem, source.name, unit, (), (*notes, *more), curves=tuple(found))


def inspect(source: Source, job: Job, files: Files) -> PointsFacts:
    """What is in the list. Errors as of ``read``."""
    part = read(source, job, files)
    angles = part.curves[0].rotations is not None
    return PointsFacts(part.units, angles, part.curves, _size(part.curves), part.notes)


def _size(curves: list[Curve] | tuple[Curve, ...]) -> tuple[float, ...]:
    return tuple(np.ptp(np.concatenate([one.points for one in curves]), axis=0).tolist())


def _curve(name: str, rows: FloatArray, mm: float) -> Curve | None:
    """The curve through ``rows`` (N, 3 or 6), in the unit of the file and deg; None where no two of them differ."""
    rotations = None
    if rows.shape[1] == len(_NAMES):
        rotations = np.stack(
            [rotation_from_fixed_xyz(*angles) for angles in np.radians(rows[:, 3:]).tolist()]
        )
    points = rows[:, :3] * mm
    moved = np.linalg.norm(np.diff(points, axis=0), axis=1) > SAME_POINT_MM
    if rotations is not None:
        moved = moved | (angles_between(rotations[:-1], rotations[1:]) > SAME_POINT_MM)
    kept = np.concatenate([[True], moved])
    points = points[kept]
    length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    if len(points) < 2 or length <= SAME_POINT_MM:
        return None
    closed = len(points) > 3 and float(np.linalg.norm(points[-1] - points[0])) <= SAME_POINT_MM
    turned = None if rotations is None else frozen(rotations[kept])
    return make_curve(name, "0", points, np.full((len(points) - 1, 3), np.nan), closed, turned)


def _chains(source: Source) -> list[tuple[int, list[list[float]]]]:
    """The rows of each curve, all of one width, and the line in which it begins. InputError."""
    found: list[tuple[int, list[list[float]]]] = []
    fresh, width, count = True, 0, 0
    for number, words in _lines(source):
        if not words:
            fresh = True
            continue
        row = [_number(source, number, word) for word in words]
        width = width or len(row)
        if len(row) not in (3, 6) or len(row) != width:
            before = f", the lines before it {width}" if len(row) != width else ""
            raise InputError(
                source.name, f"has {counted(len(row), 'number')}{before}", f"line {number}", _REMEDY
            )
        count += 1
        if count > source.limits.points:
            what = f"has more than {format_limit(source.limits.points)} points"
            raise InputError(
                source.name, what, f"line {number}", "split it, or raise limits.points"
            )
        if fresh:
            found.append((number, []))
        found[-1][1].append(row)
        fresh = False
    return found


def _lines(source: Source) -> Iterator[tuple[int, list[str]]]:
    """Number and words of each line, none of a blank one. Remarks, from # on, and the names of columns are left out."""
    try:
        text = source.data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(source.name, "is not a text", f"byte {error.start}", _REMEDY) from error
    begun = False
    for number, line in enumerate(re.split(r"\r\n|\r|\n", text), 1):
        told = line.partition("#")[0].strip()
        if not told:
            if not line.strip():
                yield number, []
            continue
        words = _split(told)
        if not begun and tuple(word.lower() for word in words) in (_NAMES, _NAMES[:3]):
            begun = True
            continue
        begun = True
        yield number, words


def _split(line: str) -> list[str]:
    """The words of a line: between semicolons, else between commas, else between blanks. A comma among semicolons
    stays in its word, which is then no number: it may be a decimal sign.
    """
    for mark in ";,":
        if mark in line:
            return [word.strip() for word in line.split(mark)]
    return line.split()


def _number(source: Source, line: int, word: str) -> float:
    value = float(word) if _NUMBER.fullmatch(word) else float("nan")
    if not abs(value) <= _FARTHEST:
        what = (
            f"{word[:24]!a} is no number"
            if np.isnan(value)
            else f"{word[:24]} is beyond all proportion"
        )
        raise InputError(source.name, what, f"line {line}", _REMEDY)
    return value
