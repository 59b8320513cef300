"""Which motions of a program work on which path: those between the first and the last point of the path."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from camgen.paths import ToolPath, Tour
from camgen.pose import FloatArray, Vec3

#: Nearer than this two points are one, mm.
_SAME = 1e-5


def worked(tour: Tour, ends: FloatArray) -> NDArray[np.int64]:
    """(E,) the index in ``tour.paths`` of the path that each motion works on, -1 for the way between paths.

    ends: (E, 3), where the motions end, in order. They go through the points of the paths in the order of the tour,
    pass by pass, and may have points in between. A pass that is not found so is left as -1.
    """
    path = np.full(len(ends), -1)
    rows: list[Vec3] = [(x, y, z) for x, y, z in ends.tolist()]
    here = 0
    for index, points in _passes(tour.paths):
        first = _next(rows, here, points[0])
        last, begun = first, False
        for point in points[1:]:
            if last < len(rows) and not _same(rows[last], point):
                last = _next(rows, last + 1, point)
                # The way there may have touched the start before, as a link from a neighbour does.
                first = first if begun else max(k for k in range(first, last) if _same(rows[k], points[0]))
                begun = True
        if last < len(rows):
            path[first + 1 : last + 1] = index
            here = last
    return path


def _passes(paths: tuple[ToolPath, ...]) -> Iterator[tuple[int, list[Vec3]]]:
    """The points of every pass; passes of an open path that may run backwards go to and fro, as ``lower`` has them."""
    for index, path in enumerate(paths):
        to_and_fro = path.reversible and not np.allclose(path.position[0], path.position[-1], rtol=0, atol=_SAME)
        for number, depth in enumerate(path.depths):
            rows = path.position - (0.0, 0.0, depth)
            yield index, [(x, y, z) for x, y, z in (rows[::-1] if to_and_fro and number % 2 else rows).tolist()]


def _next(rows: list[Vec3], begin: int, point: Vec3) -> int:
    """The first of ``rows`` from ``begin`` on that is ``point``, the number of rows if none is."""
    return next((k for k in range(begin, len(rows)) if _same(rows[k], point)), len(rows))


def _same(a: Vec3, b: Vec3) -> bool:
    return abs(a[0] - b[0]) < _SAME and abs(a[1] - b[1]) < _SAME and abs(a[2] - b[2]) < _SAME
