"""Which motions of a program work on which path: those between the first and the last point of the path."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from camgen.paths import ToolPath, Tour
from camgen.pose import FloatArray

#: Nearer than this two points are one, mm.
_SAME = 1e-5
#: From so many points on a path is compared as an array; below, that takes longer than a loop.
_MANY = 64


def worked(tour: Tour, ends: FloatArray) -> NDArray[np.int64]:
    """(M,) the index in ``tour.paths`` of the path that each motion works on, -1 for the way between paths.

    ends: (M, 3), where the motions end, in order. They go through the points of the paths in the order of the tour,
    pass by pass, and may have points in between. A pass that is not found so is left as -1.
    """
    path = np.full(len(ends), -1)
    rows = ends.tolist()
    here = 0
    for index, points in _passes(tour.paths):
        first = _next(rows, here, points[0].tolist())
        last = first + len(points) - 1
        if len(points) < _MANY or last >= len(ends) or not _same(ends[first + 1 : last + 1], points[1:]):
            first, last = _with_more(rows, first, points.tolist())
        if last < len(ends):
            path[first + 1 : last + 1] = index
            here = last
    return path


def _with_more(rows: list[list[float]], first: int, points: list[list[float]]) -> tuple[int, int]:
    """The first and last of the motions through ``points``, with others in between; the last is their number if there
    are none.
    """
    last, begun = first, False
    for point in points[1:]:
        if last == len(rows):
            break
        found = _next(rows, last, point)
        if found > last:
            # The way there may have touched the start before, as a link from a neighbour does.
            while not begun and found < len(rows) and (again := _next(rows, first + 1, points[0], found)) < found:
                first = again
            begun = True
        last = found
    return first, last


def _passes(paths: tuple[ToolPath, ...]) -> Iterator[tuple[int, FloatArray]]:
    """The points of every pass; passes of an open path that may run backwards go to and fro, as ``lower`` has them."""
    for index, path in enumerate(paths):
        to_and_fro = len(path.depths) > 1 and path.reversible and not _same(path.position[0], path.position[-1])
        for number, depth in enumerate(path.depths):
            rows = path.position - (0.0, 0.0, depth) if depth else path.position
            yield index, rows[::-1] if to_and_fro and number % 2 else rows


def _next(rows: list[list[float]], begin: int, point: list[float], end: int | None = None) -> int:
    """The first of ``rows`` from ``begin`` to ``end`` that is ``point``, their number if none is."""
    x, y, z = point
    for k in range(begin, len(rows) if end is None else end):
        row = rows[k]
        if abs(row[0] - x) < _SAME and abs(row[1] - y) < _SAME and abs(row[2] - z) < _SAME:
            return k
    return len(rows)


def _same(a: FloatArray, b: FloatArray) -> bool:
    return bool((np.abs(a - b) < _SAME).all())
