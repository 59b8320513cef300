"""Exact distances from points to lines and arcs, with a box tree in front so that only near pairs are looked at."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import shapely

from camgen.geometry.boxes import boxed
from camgen.geometry.intersect import cuts
from camgen.geometry.segments import BoolArray, IntArray, Segments, bounds, passes
from camgen.pose import FloatArray

#: Point-segment pairs that are looked at together: bounds the memory of a query.
_CHUNK = 500_000


def distances(points: FloatArray, segments: Segments, rows: IntArray) -> FloatArray:
    """(N,) distance of point k (N, 2) from segment ``rows[k]``: pairs, not all against all."""
    arc = segments.is_arc[rows]
    result = np.empty(len(rows))
    for chosen, measure in ((~arc, _from_lines), (arc, _from_arcs)):
        which = np.flatnonzero(chosen)
        if len(which):
            result[which] = measure(points[which], segments, rows[which])
    return result


def _from_lines(points: FloatArray, segments: Segments, rows: IntArray) -> FloatArray:
    start = segments.start[rows]
    chord = segments.end[rows] - start
    rel = points - start
    square = np.maximum(chord[:, 0] ** 2 + chord[:, 1] ** 2, 1e-300)
    along = np.clip((rel[:, 0] * chord[:, 0] + rel[:, 1] * chord[:, 1]) / square, 0.0, 1.0)
    return np.hypot(rel[:, 0] - along * chord[:, 0], rel[:, 1] - along * chord[:, 1])


def _from_arcs(points: FloatArray, segments: Segments, rows: IntArray) -> FloatArray:
    arcs = segments.take(rows)
    arm = points - arcs.centre
    beside = passes(arcs, np.arctan2(arm[:, 1], arm[:, 0]))
    radial = np.abs(np.hypot(arm[:, 0], arm[:, 1]) - arcs.radius)
    to_start = np.hypot(points[:, 0] - arcs.start[:, 0], points[:, 1] - arcs.start[:, 1])
    to_end = np.hypot(points[:, 0] - arcs.end[:, 0], points[:, 1] - arcs.end[:, 1])
    return np.where(beside, radial, np.minimum(to_start, to_end))


class Obstacles:
    """Segments that a point must keep away from. group: (N,) labels; a point sees only its own group's segments."""

    def __init__(self, segments: Segments, group: IntArray) -> None:
        self.segments = segments
        self.group = group
        self._tree = shapely.STRtree(boxed(bounds(segments)))

    def _pairs(self, points: FloatArray, group: IntArray, reach: float) -> Iterator[tuple[IntArray, IntArray]]:
        """Pairs (point, segment) whose boxes are nearer than ``reach``, in chunks of whole points."""
        step, first = 256, 0
        while first < len(points):
            near = points[first : first + step]
            point, segment = self._tree.query(boxed(np.column_stack([near - reach, near + reach])))
            point = point + first
            first += step
            # As many points at a time as the last ones let expect: the drawing decides how many segments are near.
            step = int(np.clip(_CHUNK * step / max(len(point), 1), 16, 4 * step))
            same = group[point] == self.group[segment]
            yield point[same], segment[same]

    def nearer_than(self, points: FloatArray, group: IntArray, limit: FloatArray) -> BoolArray:
        """(N,) true where a point (N, 2) of a group (N,) lies nearer than its limit (N,) to a segment of that group."""
        hit = np.zeros(len(points), dtype=bool)
        for point, segment in self._pairs(points, group, float(limit.max(initial=0.0))):
            gap = distances(points[point], self.segments, segment)
            hit[point[gap < limit[point]]] = True
        return hit

    def nearest(self, points: FloatArray, group: IntArray, reach: float) -> FloatArray:
        """(N,) distance to the nearest segment of the group, inf when none is nearer than ``reach`` mm."""
        best = np.full(len(points), np.inf)
        for point, segment in self._pairs(points, group, reach):
            np.minimum.at(best, point, distances(points[point], self.segments, segment))
        best[best > reach] = np.inf
        return best


def gaps(lines: Segments, segments: Segments, reach: float) -> FloatArray:
    """(L,) distance of each straight line to the nearest of ``segments``, inf when none is nearer than ``reach`` mm.

    Two segments that do not cross are nearest at an end of one of them, or where the line passes an arc's centre.
    """
    best = np.full(len(lines), np.inf)
    if not len(lines) or not len(segments):
        return best
    tree = shapely.STRtree(boxed(bounds(segments)))
    boxes = bounds(lines) + np.array([-reach, -reach, reach, reach])
    step, first = 256, 0
    while first < len(lines):
        line, other = tree.query(boxed(boxes[first : first + step]))
        line, other = line + first, other.astype(np.int64)
        first += step
        step = int(np.clip(_CHUNK * step / max(len(line), 1), 1, 4 * step))
        np.minimum.at(best, line, _apart(lines.take(line), segments.take(other)))
    best[best > reach] = np.inf
    return best


def _apart(line: Segments, other: Segments) -> FloatArray:
    """(K,) distance of each straight line from the line or arc beside it in the list."""
    own = np.arange(len(line))
    gap = np.minimum(distances(line.start, other, own), distances(line.end, other, own))
    for end in (other.start, other.end):
        np.minimum(gap, _from_lines(end, line, own), out=gap)
    chord = line.end - line.start
    square = np.maximum((chord**2).sum(axis=1), 1e-300)
    foot = line.start + np.clip(((other.centre - line.start) * chord).sum(axis=1) / square, 0.0, 1.0)[:, None] * chord
    np.minimum(gap, np.where(other.is_arc, distances(foot, other, own), np.inf), out=gap)
    rows, _ = cuts(_both(line, other), own, own + len(line))
    gap[rows[rows < len(line)]] = 0.0
    return gap


def _both(one: Segments, two: Segments) -> Segments:
    return Segments(*(np.concatenate([getattr(one, name), getattr(two, name)]) for name in Segments.__struct_fields__))
