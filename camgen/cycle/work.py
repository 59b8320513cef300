"""Which motions of a program work on which path: those between the first and the last point of the path."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from camgen.paths import ToolPath, Tour
from camgen.pose import FloatArray

#: Nearer than this two points are one, mm.
_SAME = 1e-5
#: So many motions are looked at first for the start of the next path; the links between paths are few motions.
_FEW = 16


def worked(tour: Tour, ends: FloatArray) -> NDArray[np.int64]:
    """(M,) the index in ``tour.paths`` of the path that each motion works on, -1 for the way between paths.

    ends: (M, 3), where the motions end, in order. They go through the points of the paths in the order of the tour,
    pass by pass, and may have points in between. A pass that is not found so is left as -1.
    """
    path = np.full(len(ends), -1)
    here = 0
    for index, points in _passes(tour.paths):
        first = _next(ends, here, points[0])
        last = first + len(points) - 1
        if last >= len(ends) or not (np.abs(ends[first + 1 : last + 1] - points[1:]) < _SAME).all():
            first, last = _with_more(ends, first, points)
        if last < len(ends):
            path[first + 1 : last + 1] = index
            here = last
    return path


def _with_more(ends: FloatArray, first: int, points: FloatArray) -> tuple[int, int]:
    """The first and last of the motions through ``points``, with others in between; the last is their number if there
    are none.
    """
    last, begun = first, False
    for point in points[1:]:
        if last < len(ends) and not (np.abs(ends[last] - point) < _SAME).all():
            last = _next(ends, last + 1, point)
            if not begun and last < len(ends):
                # The way there may have touched the start before, as a link from a neighbour does.
                first += int(np.flatnonzero((np.abs(ends[first:last] - points[0]) < _SAME).all(axis=1))[-1])
            begun = True
    return first, last


def _passes(paths: tuple[ToolPath, ...]) -> Iterator[tuple[int, FloatArray]]:
    """The points of every pass; passes of an open path that may run backwards go to and fro, as ``lower`` has them."""
    for index, path in enumerate(paths):
        to_and_fro = path.reversible and not (np.abs(path.position[0] - path.position[-1]) < _SAME).all()
        for number, depth in enumerate(path.depths):
            rows = path.position - (0.0, 0.0, depth)
            yield index, rows[::-1] if to_and_fro and number % 2 else rows


def _next(ends: FloatArray, begin: int, point: FloatArray) -> int:
    """The first of ``ends`` from ``begin`` on that is ``point``, the number of them if none is."""
    size = _FEW
    while begin < len(ends):
        near = np.flatnonzero((np.abs(ends[begin : begin + size] - point) < _SAME).all(axis=1))
        if len(near):
            return begin + int(near[0])
        begin, size = begin + size, 4 * size
    return len(ends)
