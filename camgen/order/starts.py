"""The points at which paths may begin: anywhere on closed paths or off their corners, or ends."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from camgen.geometry.arcs import Spans, make_spans
from camgen.geometry.ragged import (
    compute_first_rows,
    compute_offsets,
    count_rows,
    list_owners,
    number_rows,
)
from camgen.model.part import BoolArray, IntArray
from camgen.model.path import ToolPath
from camgen.model.pose import FloatArray
from camgen.model.tolerance import NONZERO
from camgen.plan.columns import join_tables
from camgen.plan.starting import SEAM

#: rad: change of the direction of travel from which a vertex is a corner.
_CORNER = math.radians(10)
#: mm: distance of a smooth start from a corner; a third of the segment if that is shorter.
_CORNER_DISTANCE_MM = 1.0


class Starts(Struct, frozen=True, eq=False):
    """The S starts of paths, in the order of paths and of rows.

    path: (S,) index of the path.
    row: (S,) row at which the segment of the start ends; for an open path its first or last row,
        for a pinned one its first.
    shape: the S segments; one without length for an open or pinned path.
    first: (paths + 1,) first start of each path.
    low, span: (S,) start and length of `shape` on the segment of its row, as fractions of that.
    begin, end: (paths, 2) x, y of the first and the last row of each path, mm.
    """

    path: IntArray
    row: IntArray
    shape: Spans
    first: IntArray
    low: FloatArray
    span: FloatArray
    begin: FloatArray
    end: FloatArray

    def other_end(self, number: int) -> int:
        """The start at the other end of an open path; `number` itself if that is its only one."""
        path = self.path[number]
        return int(self.first[path] + self.first[path + 1]) - 1 - number

    def leftmost(self, allowed: BoolArray) -> tuple[int, float, float]:
        """The leftmost start of the allowed paths, the first of equal ones, with its point x, y.

        Its index is -1 if no path is allowed.
        """
        shape = self.shape
        x = np.minimum(shape.start[:, 0], shape.end[:, 0])
        y = np.where(shape.end[:, 0] < shape.start[:, 0], shape.end[:, 1], shape.start[:, 1])
        has_left_point = shape.curved & (-shape.towards[:, 0] >= np.cos(shape.sweep / 2))
        radius = shape.radius[has_left_point]
        centre = shape.via[has_left_point] - radius[:, None] * shape.towards[has_left_point]
        x[has_left_point], y[has_left_point] = centre[:, 0] - radius, centre[:, 1]
        is_allowed = allowed[self.path]
        number = int(np.argmin(np.where(is_allowed, x, np.inf)))
        return number if is_allowed[number] else -1, float(x[number]), float(y[number])


def make_starts(paths: Sequence[ToolPath], seam: str = "any") -> Starts:
    """All starts of `paths`; a pinned path has its own alone.

    seam: "smooth" excludes the corners of closed paths.
    """
    rows = count_rows(paths)
    closed = np.array([path.closed for path in paths]) & (rows > 1)
    loop = closed & ~np.array([path.pinned for path in paths])
    both = np.array([path.reversible for path in paths]) & (rows > 1) & ~closed
    count = np.where(loop, rows - 1, 1 + both)
    first, owner, step = compute_offsets(count), list_owners(count), number_rows(count)
    row = np.where(loop[owner], step + 1, step * (rows[owner] - 1))
    drawn = join_tables(paths)
    top = compute_first_rows(rows)
    end = top[owner] + row
    inside = loop[owner]
    via = np.where(inside[:, None], drawn.via[end], np.nan)
    shape = make_spans(drawn.position[end - inside], via, drawn.position[end])
    low, span = np.zeros(len(owner)), np.ones(len(owner))
    if seam == "smooth":
        low, span = _exclude_corners(shape, inside, first)
        via = np.where(shape.curved[:, None], shape.point(low + span / 2), np.nan)
        shape = make_spans(shape.point(low), via, shape.point(low + span))
    first_point, last_point = drawn.position[top, :2], drawn.position[top + rows - 1, :2]
    return Starts(owner, row, shape, first, low, span, first_point, last_point)


def _exclude_corners(
    shape: Spans, closed: BoolArray, first: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Start and length of the part of each segment that is off the corners, as fractions (S,)."""
    at_start, at_end = shape.tangents()
    before = np.arange(-1, len(closed) - 1)
    before[first[:-1]] = first[1:] - 1
    has_corner = closed & ((at_end[before] * at_start).sum(axis=1) < np.cos(_CORNER))
    has_corner_at_end = np.zeros(len(closed), dtype=bool)
    has_corner_at_end[before[has_corner]] = True
    # A segment that is too short to be divided in three may begin anywhere.
    is_long = shape.length > 3 * SEAM
    part = np.minimum(_CORNER_DISTANCE_MM / np.maximum(shape.length, NONZERO), 1 / 3) * is_long
    low = np.where(has_corner, part, 0.0)
    return low, 1.0 - low - np.where(has_corner_at_end, part, 0.0)
