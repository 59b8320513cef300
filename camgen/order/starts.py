"""Where paths may begin: all of a closed one, or what of it is off its corners, and the ends of an open one."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from camgen.geometry.arcs import Spans, make_spans
from camgen.geometry.ragged import begins, offsets, owners, ramp
from camgen.model.part import BoolArray, IntArray
from camgen.model.path import ToolPath
from camgen.model.pose import FloatArray
from camgen.model.tolerance import NONZERO
from camgen.plan.starting import SEAM, end_to_end

#: A turn of the travel that makes a vertex a corner, rad, and how far from one a smooth place is at least, mm; a third
#: of the segment where that is shorter.
_CORNER, _AWAY = math.radians(10), 1.0


class Starts(Struct, frozen=True, eq=False):
    """Where paths may begin: S starts in the order of paths and of rows.

    path: (S,) index of the path. row: (S,) the segment that ends at this row, for an open path its first or last row,
    for a pinned one its first. shape: the S segments, of no length for what is no segment. first: (paths + 1,) of each
    path's starts. low, span: (S,) where on the segment of its row ``shape`` begins, and how much of it that is,
    fractions. begin, end: x, y (paths, 2) mm of the first and the last row of each path.
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
        """The start at the other end of the open path of start ``number``, itself if that is its only one."""
        path = self.path[number]
        return int(self.first[path] + self.first[path + 1]) - 1 - number

    def leftmost(self, allowed: Sequence[bool]) -> tuple[int, float, float]:
        """The leftmost start of the allowed paths, the first of equal ones: its number (-1 if none) and point x, y."""
        shape = self.shape
        x = np.minimum(shape.start[:, 0], shape.end[:, 0])
        y = np.where(shape.end[:, 0] < shape.start[:, 0], shape.end[:, 1], shape.start[:, 1])
        over = shape.curved & (-shape.towards[:, 0] >= np.cos(shape.sweep / 2))
        centre = shape.via[over] - shape.radius[over, None] * shape.towards[over]
        x[over], y[over] = centre[:, 0] - shape.radius[over], centre[:, 1]
        open_to = np.array(allowed)[self.path]
        number = int(np.argmin(np.where(open_to, x, np.inf)))
        return number if open_to[number] else -1, float(x[number]), float(y[number])


def starts(paths: Sequence[ToolPath], seam: str = "any") -> Starts:
    """All starts of ``paths``: of one that is pinned its own. seam: "smooth" leaves out what is near a corner of a
    closed path.
    """
    rows = np.array([len(path) for path in paths], dtype=np.int64)
    closed = np.array([path.closed for path in paths]) & (rows > 1)
    loop = closed & ~np.array([path.pinned for path in paths])
    both = np.array([path.reversible for path in paths]) & (rows > 1) & ~closed
    count = np.where(loop, rows - 1, 1 + both)
    first, owner, step = offsets(count), owners(count), ramp(count)
    row = np.where(loop[owner], step + 1, step * (rows[owner] - 1))
    drawn = end_to_end(paths)
    top = begins(rows)
    at = top[owner] + row
    inside = loop[owner]
    shape = make_spans(
        drawn.position[at - inside],
        np.where(inside[:, None], drawn.via[at], np.nan),
        drawn.position[at],
    )
    low, span = np.zeros(len(owner)), np.ones(len(owner))
    if seam == "smooth":
        low, span = _off_corners(shape, inside, first)
        middle = np.where(shape.curved[:, None], shape.point(low + span / 2), np.nan)
        shape = make_spans(shape.point(low), middle, shape.point(low + span))
    return Starts(
        owner,
        row,
        shape,
        first,
        low,
        span,
        drawn.position[top, :2],
        drawn.position[top + rows - 1, :2],
    )


def _off_corners(shape: Spans, closed: BoolArray, first: IntArray) -> tuple[FloatArray, FloatArray]:
    """Where the part of each segment begins that is off the corners, and how long it is, fractions (S,) of it."""
    ahead, behind = shape.tangents()
    before = np.arange(-1, len(closed) - 1)
    before[first[:-1]] = first[1:] - 1
    corner = closed & ((behind[before] * ahead).sum(axis=1) < np.cos(_CORNER))
    after = np.zeros(len(closed), dtype=bool)
    after[before[corner]] = True
    # What is too short to be cut in three may begin anywhere.
    part = np.minimum(_AWAY / np.maximum(shape.length, NONZERO), 1 / 3) * (shape.length > 3 * SEAM)
    low = np.where(corner, part, 0.0)
    return low, 1.0 - low - np.where(after, part, 0.0)
