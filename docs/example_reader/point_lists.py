"""Lists of points: `x,y` or `x,y,z` a line. An empty line ends a contour, # begins a remark."""

import math

from camgen.model.errors import InputError
from camgen.model.files import Source
from camgen.model.job import Job
from camgen.model.part import Contour, Note, Part
from camgen.model.pose import frozen
from camgen.read import Reader, units
from camgen.read.files import Files

#: mm by which the points of one contour may differ in height.
FLAT = 0.01


def read(source: Source, job: Job, _files: Files) -> Part:
    """The contours of the list, mm. One whose last point is its first is closed."""
    unit, mm, notes = units.resolve(source.name, job.input.units, 0, None)
    contours, left = [], []
    for line, points in chains(source):
        heights = [mm * z for _, _, z in points]
        if len(points) < 2 or max(heights) - min(heights) > FLAT:
            why = (
                "a contour needs two points"
                if len(points) < 2
                else "its points differ in z: contours are flat"
            )
            left.append(Note("skipped", f"the contour in line {line}", why))
            continue
        closed = len(points) > 3 and points[0] == points[-1]
        flat = frozen([[mm * x, mm * y] for x, y, _ in points[: -1 if closed else None]])
        contours.append(
            Contour(flat, frozen([0.0] * len(flat)), closed, "0", f"c{len(contours) + 1}")
        )
    if not contours:
        raise InputError(source.name, "nothing to machine", remedy="give two or more lines x,y")
    return Part(source.stem, source.name, unit, tuple(contours), (*notes, *left))


def chains(source: Source) -> list[tuple[int, list[tuple[float, float, float]]]]:
    """The points of each contour, and the line in which it begins."""
    found: list[tuple[int, list[tuple[float, float, float]]]] = []
    fresh = True
    for number, line in enumerate(source.data.decode("utf-8-sig", "replace").splitlines(), 1):
        fresh = fresh or not line.strip()
        words = line.partition("#")[0].replace(",", " ").split()
        if not words:
            continue
        try:
            x, y, z = (float(word) for word in [*words, "0"][: max(3, len(words))])
        except ValueError as error:
            raise InputError(
                source.name, f"{line.strip()[:40]!r} is not a point", f"line {number}"
            ) from error
        if not math.isfinite(x + y + z):
            raise InputError(source.name, "a coordinate is not finite", f"line {number}")
        if fresh:
            found.append((number, []))
        found[-1][1].append((x, y, z))
        fresh = False
    return found


def inspect(source: Source, job: Job, files: Files) -> str:
    """The page of `camgen inspect`."""
    part = read(source, job, files)
    rows = [
        f"{one.id}: {len(one.points)} points, {'closed' if one.closed else 'open'}"
        for one in part.contours
    ]
    return "\n".join([f"list of points, units {part.units}", *rows, *map(str, part.notes)])


POINTS = Reader("points", "a list of points", (".xy",), "drawing", read, inspect)
