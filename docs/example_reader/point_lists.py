"""Lists of points: `x,y` or `x,y,z` per line. An empty line ends a contour, # begins a remark."""

import math

from camgen.model.errors import InputError
from camgen.model.files import Source
from camgen.model.job import Job
from camgen.model.part import Contour, Note, Part
from camgen.model.pose import frozen
from camgen.read import Reader, units
from camgen.read.files import Files

#: Largest difference in height within a contour, mm.
FLAT = 0.01


def read(source: Source, job: Job, _files: Files) -> Part:
    """The contours of the list, mm. Equal end points close a contour."""
    unit, mm, notes = units.resolve(source.name, job.input.units, 0, None)
    contours, skipped = [], []
    for line, points in chains(source):
        heights = [mm * z for _, _, z in points]
        if len(points) < 2 or max(heights) - min(heights) > FLAT:
            why = (
                "a contour needs two points"
                if len(points) < 2
                else "its points differ in z: contours are flat"
            )
            skipped.append(Note("skipped", f"the contour in line {line}", why))
            continue
        closed = len(points) > 3 and points[0] == points[-1]
        flat = frozen([[mm * x, mm * y] for x, y, _ in points[: -1 if closed else None]])
        contours.append(
            Contour(flat, frozen([0.0] * len(flat)), closed, "0", f"c{len(contours) + 1}")
        )
    if not contours:
        raise InputError(source.name, "nothing to machine", remedy="give two or more lines x,y")
    return Part(source.stem, source.name, unit, tuple(contours), (*notes, *skipped))


def chains(source: Source) -> list[tuple[int, list[tuple[float, float, float]]]]:
    """The first line and the points of each contour."""
    contours: list[tuple[int, list[tuple[float, float, float]]]] = []
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
            contours.append((number, []))
        contours[-1][1].append((x, y, z))
        fresh = False
    return contours


def inspect(source: Source, job: Job, files: Files) -> str:
    """The page of `camgen inspect`."""
    part = read(source, job, files)
    rows = [
        f"{contour.id}: {len(contour.points)} points, {'closed' if contour.closed else 'open'}"
        for contour in part.contours
    ]
    return "\n".join([f"list of points, units {part.units}", *rows, *map(str, part.notes)])


POINTS = Reader("points", "a list of points", (".xy",), "drawing", read, inspect)
