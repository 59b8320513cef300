"""Crossings and distances of plane lines and arcs, many pairs at once.

Crossings include ends that touch another segment. Distances are exact; a tree of boxes is searched
first, so that only near pairs are computed.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from camgen.geometry.ragged import (
    PAIRS,
    concatenate_columns,
    find_equal_pairs,
    find_run_starts,
    list_range_numbers,
)
from camgen.geometry.segments import (
    BoolArray,
    IntArray,
    Segments,
    compute_arc_fraction,
    compute_bounds,
    concatenate,
    passes,
    points_at,
)
from camgen.model.pose import FloatArray
from camgen.model.tolerance import NONZERO

# Boxes for a tree that finds near pairs.


def make_boxes(boxes: FloatArray) -> NDArray[Any]:
    """Geometries (N,) with the bounding boxes `boxes` (N, 4): xmin, ymin, xmax, ymax.

    They are the diagonals. A query of a tree without a predicate compares boxes alone, and a
    diagonal is made in half the time of a rectangle.
    """
    return np.asarray(shapely.linestrings(boxes.reshape(-1, 2, 2)))


#: mm: an end nearer than this to another segment touches it. A crossing so near to an end counts as
#: that end.
TOUCH = 1e-7
#: mm: two boxes meet at a corner only if their intersection is no larger.
_CORNER = 5e-8
#: Bulge up to which an arc is not much more than half a circle, see `only_at_ends`.
_HALF_CIRCLE_BULGE = 1.2
#: Sine of the angle up to which two lines are parallel.
_PARALLEL_SINE = 1e-12
#: mm: circles whose centres are nearer than this have one centre.
_SAME_CENTRE_MM = 1e-9
#: Rows of a group up to which all pairs are compared, which takes less time than a tree.
FEW = 16
#: Most points of a run that a tree is asked for at once: points next to a contour have the same
#: segments near.
_RUN_POINTS = 16
#: Length of such a run, as a factor on the reach.
_RUN_REACHES = 4
#: Boxes in the first query of a tree, and pairs in any other query, about: each may stand for up to
#: `FEW` pairs of segments.
_FIRST_BATCH, _PAIR_BATCH = 256, PAIRS // FEW


def query_tree(tree: Any, boxes: FloatArray) -> Iterator[tuple[IntArray, IntArray]]:
    """Yield pairs of a row of `boxes` (N, 4) and an item of a tree whose boxes meet, in batches.

    All pairs of a row are in the same batch.
    """
    step, first = _FIRST_BATCH, 0
    while first < len(boxes):
        row, item = tree.query(make_boxes(boxes[first : first + step]))
        yield row + first, item
        first += step
        # The next batch is as large as the pairs of this one suggest.
        step = int(np.clip(_PAIR_BATCH * step / max(len(row), 1), 1, 4 * step))


def find_near_pairs(
    segments: Segments, group: IntArray, reach: float = TOUCH
) -> tuple[IntArray, IntArray]:
    """Pairs i < j of segments of one group whose boxes are nearer than `reach`, mm.

    group: (N,) labels from 0. Returns i and j, both (K,).
    """
    boxes = compute_bounds(segments)
    grown = boxes + np.array([-reach, -reach, reach, reach])
    small_groups, large = find_equal_pairs(group, group, FEW)
    pairs = [(large[:0], large[:0])]
    for first, second in small_groups:
        i, j = first[first < second], second[first < second]
        near = boxes_meet(grown, i, boxes, j)
        pairs.append((i[near], j[near]))
    if len(large):
        i, j = shapely.STRtree(make_boxes(boxes[large])).query(make_boxes(grown[large]))
        i, j = large[i], large[j]
        near = (i < j) & (group[i] == group[j])
        pairs.append((i[near], j[near]))
    first, second = concatenate_columns(pairs)
    return first, second


def boxes_meet(first: FloatArray, i: IntArray, second: FloatArray, j: IntArray) -> BoolArray:
    """(K,) whether boxes i of `first` (N, 4) and j of `second` (M, 4) have a point in common."""
    a, b = first.take(i, axis=0), second.take(j, axis=0)
    meets = (a[:, 0] <= b[:, 2]) & (a[:, 2] >= b[:, 0])
    meets &= (a[:, 1] <= b[:, 3]) & (a[:, 3] >= b[:, 1])
    return np.asarray(meets)


def find_cuts(segments: Segments, i: IntArray, j: IntArray) -> tuple[IntArray, FloatArray]:
    """The points at which the segments of pairs (i, j) cut or touch each other.

    Returns the cut rows of `segments` and the fraction, 0 to 1, at which each one is cut.
    """
    parts = [
        _cut_pairs(segments, i[k : k + PAIRS], j[k : k + PAIRS])
        for k in range(0, max(len(i), 1), PAIRS)
    ]
    rows, fractions = concatenate_columns(parts)
    return rows, np.clip(fractions, 0.0, 1.0)


def only_at_ends(segments: Segments, i: IntArray, j: IntArray) -> BoolArray:
    """(K,) whether a pair (i, j) can have nothing in common but an end of each.

    That is known if their boxes meet at a corner only, and both have an end there. All that
    `find_cuts` and `find_crossings` find for such a pair is less than 1e-6 mm from an end of
    both: it is within `TOUCH` of both boxes, so within 3e-7 mm of these ends. Along an arc of
    not much more than half a circle that is no more than twice as far.
    """
    boxes = compute_bounds(segments)
    a, b = boxes.take(i, axis=0), boxes.take(j, axis=0)
    x, y = (np.maximum(a[:, axis], b[:, axis]) for axis in (0, 1))
    rows = np.flatnonzero(
        (np.minimum(a[:, 2], b[:, 2]) - x <= _CORNER)
        & (np.minimum(a[:, 3], b[:, 3]) - y <= _CORNER)
    )
    x, y = x[rows], y[rows]
    at_end = np.ones(len(rows), dtype=bool)
    for k in (i[rows], j[rows]):
        ends = segments.start.take(k, axis=0), segments.end.take(k, axis=0)
        offsets = [np.maximum(np.abs(end[:, 0] - x), np.abs(end[:, 1] - y)) for end in ends]
        at_end &= np.minimum(*offsets) <= _CORNER
        at_end &= np.abs(segments.bulge[k]) <= _HALF_CIRCLE_BULGE
    result = np.zeros(len(i), dtype=bool)
    result[rows[at_end]] = True
    return result


def find_crossings(a: Segments, b: Segments) -> tuple[IntArray, FloatArray, FloatArray]:
    """The crossings of segment k of `a` with segment k of `b`.

    Returns k, and the fractions of both segments, each (C,). A fraction may be outside 0 to 1 by
    rounding. Segments that only touch, or run along each other, may be left out.
    """
    arc_a, arc_b = a.is_arc, b.is_arc
    slack_a = TOUCH / np.maximum(a.length, TOUCH)
    slack_b = TOUCH / np.maximum(b.length, TOUCH)
    crossings = [(np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0))]
    for is_kind, cross_carriers in (
        (~arc_a & ~arc_b, _line_line),
        (~arc_a & arc_b, _line_circle),
        (arc_a & ~arc_b, _circle_line),
        (arc_a & arc_b, _circle_circle),
    ):
        rows = np.flatnonzero(is_kind)
        if not len(rows):
            continue
        a_rows, b_rows = a.take(rows), b.take(rows)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            places = cross_carriers(a_rows, b_rows)
        for points in places:
            on_a, on_b = find_fractions(a_rows, points), find_fractions(b_rows, points)
            is_crossing = _are_on(slack_a[rows], on_a) & _are_on(slack_b[rows], on_b)
            crossings.append((rows[is_crossing], on_a[is_crossing], on_b[is_crossing]))
    pair, first, second = concatenate_columns(crossings)
    return pair, first, second


def _cut_pairs(segments: Segments, i: IntArray, j: IntArray) -> tuple[IntArray, FloatArray]:
    """Crossings of pairs (i, j), and the ends of one segment that touch the other.

    Returns the cut rows and the fractions, which may be outside 0 to 1 by rounding.
    """
    a, b = segments.take(i), segments.take(j)
    pair, first, second = find_crossings(a, b)
    rows = np.concatenate([i, i, j, j])
    ends = np.concatenate([b.start, b.end, a.start, a.end])
    cut = segments.take(rows)
    fraction = find_fractions(cut, ends)
    foot = points_at(cut, np.clip(fraction, 0.0, 1.0))
    touches = np.hypot(*(foot - ends).T) <= TOUCH
    cut_rows = np.concatenate([i[pair], j[pair], rows[touches]])
    return cut_rows, np.concatenate([first, second, fraction[touches]])


def _are_on(slack: FloatArray, fraction: FloatArray) -> BoolArray:
    """(N,) whether fractions are from 0 to 1, give or take `slack`."""
    return np.asarray((fraction >= -slack) & (fraction <= 1 + slack))


def find_fractions(segments: Segments, points: FloatArray) -> FloatArray:
    """(N,) fraction of each segment at which the foot of point k (N, 2) lies on segment k.

    0 is the start and 1 the end; a foot beyond them is below 0 or above 1.
    """
    chord = segments.end - segments.start
    square = np.maximum((chord**2).sum(axis=1), NONZERO)
    fraction = ((points - segments.start) * chord).sum(axis=1) / square
    rows = np.flatnonzero(segments.is_arc)
    if len(rows):
        arm = points[rows] - segments.centre[rows]
        fraction[rows] = compute_arc_fraction(segments.take(rows), np.arctan2(arm[:, 1], arm[:, 0]))
    return np.asarray(fraction)


# Crossing points of the lines and circles that carry the segments of each pair: one or two arrays
# (N, 2), NaN where there is no crossing.


def _line_line(a: Segments, b: Segments) -> list[FloatArray]:
    u, v, w = a.end - a.start, b.end - b.start, b.start - a.start
    cross = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    size = np.hypot(u[:, 0], u[:, 1]) * np.hypot(v[:, 0], v[:, 1])
    # Parallel lines touch along a stretch or not at all. `_cut_pairs` finds that from their ends.
    cross = np.where(np.abs(cross) <= _PARALLEL_SINE * size, np.nan, cross)
    t = (w[:, 0] * v[:, 1] - w[:, 1] * v[:, 0]) / cross
    return [a.start + t[:, None] * u]


def _line_circle(line: Segments, arc: Segments) -> list[FloatArray]:
    u = line.end - line.start
    u = u / np.hypot(u[:, 0], u[:, 1])[:, None]
    w = arc.centre - line.start
    foot = (w * u).sum(axis=1)
    half = _half_chord(arc.radius, np.abs(w[:, 0] * u[:, 1] - w[:, 1] * u[:, 0]))
    return [line.start + (foot + sign * half)[:, None] * u for sign in (-1, 1)]


def _circle_line(arc: Segments, line: Segments) -> list[FloatArray]:
    return _line_circle(line, arc)


def _circle_circle(a: Segments, b: Segments) -> list[FloatArray]:
    w = b.centre - a.centre
    distance = np.hypot(w[:, 0], w[:, 1])
    distance = np.where(distance <= _SAME_CENTRE_MM, np.nan, distance)
    u = w / distance[:, None]
    foot = (distance + (a.radius - b.radius) * (a.radius + b.radius) / distance) / 2
    half = _half_chord(a.radius, np.abs(foot))
    left = np.column_stack([-u[:, 1], u[:, 0]])
    return [a.centre + foot[:, None] * u + (sign * half)[:, None] * left for sign in (-1, 1)]


def _half_chord(radius: FloatArray, distance: FloatArray) -> FloatArray:
    """Half the chord at `distance` from the centre: 0 for a tangent, NaN if the line misses."""
    square = (radius - distance) * (radius + distance)
    return np.where(distance <= radius + TOUCH, np.sqrt(np.maximum(square, 0.0)), np.nan)


# Distances from points to lines and arcs.


def measure_distances(points: FloatArray, segments: Segments, rows: IntArray) -> FloatArray:
    """(N,) distance of point k (N, 2) from segment `rows[k]`, mm."""
    arc = segments.is_arc[rows]
    result = np.empty(len(rows))
    for is_kind, measure in ((~arc, _measure_from_lines), (arc, _measure_from_arcs)):
        which = np.flatnonzero(is_kind)
        if len(which):
            result[which] = measure(points[which], segments, rows[which])
    return result


def _measure_from_lines(points: FloatArray, segments: Segments, rows: IntArray) -> FloatArray:
    start = segments.start[rows]
    chord = segments.end[rows] - start
    rel = points - start
    square = np.maximum(chord[:, 0] ** 2 + chord[:, 1] ** 2, NONZERO)
    along = np.clip((rel[:, 0] * chord[:, 0] + rel[:, 1] * chord[:, 1]) / square, 0.0, 1.0)
    return np.hypot(rel[:, 0] - along * chord[:, 0], rel[:, 1] - along * chord[:, 1])


def _measure_from_arcs(points: FloatArray, segments: Segments, rows: IntArray) -> FloatArray:
    arcs = segments.take(rows)
    arm = points - arcs.centre
    faces_arc = passes(arcs, np.arctan2(arm[:, 1], arm[:, 0]))
    radial = np.abs(np.hypot(arm[:, 0], arm[:, 1]) - arcs.radius)
    to_start = np.hypot(points[:, 0] - arcs.start[:, 0], points[:, 1] - arcs.start[:, 1])
    to_end = np.hypot(points[:, 0] - arcs.end[:, 0], points[:, 1] - arcs.end[:, 1])
    return np.where(faces_arc, radial, np.minimum(to_start, to_end))


def _begin_runs(points: FloatArray, length: float) -> IntArray:
    """First rows of runs of points (N, 2) that follow each other within about `length` mm."""
    steps = np.abs(np.diff(points, axis=0)).max(axis=1)
    along = np.append(0.0, np.cumsum(steps))
    begins_new = np.diff(np.floor(along / max(length, NONZERO)), prepend=-1.0) != 0
    begins_new[::_RUN_POINTS] = True
    return np.flatnonzero(begins_new)


class Obstacles:
    """Segments from which points keep a distance.

    segments: N lines and arcs.
    group: (N,) labels from 0. A point is compared with the segments of its own group.
    """

    def __init__(self, segments: Segments, group: IntArray) -> None:
        self.segments = segments
        self.group = group
        self._boxes = compute_bounds(segments)

    @cached_property
    def _large(self) -> tuple[IntArray, shapely.STRtree]:
        """The segments in groups of more than `FEW`, and a tree of their boxes."""
        rows = np.flatnonzero(np.bincount(self.group)[self.group] > FEW)
        return rows, shapely.STRtree(make_boxes(self._boxes[rows]))

    def _pairs(
        self, points: FloatArray, group: IntArray, reach: float
    ) -> Iterator[tuple[IntArray, IntArray]]:
        """Yield pairs (point, segment) of one group whose boxes are nearer than `reach` mm.

        They come in chunks, all pairs of a point in the same chunk.
        """
        around = np.column_stack([points - reach, points + reach])
        small_groups, large = find_equal_pairs(group, self.group, FEW)
        for point, segment in small_groups:
            near = boxes_meet(around, point, self._boxes, segment)
            yield point[near], segment[near]
        if not len(large):
            return
        rows, tree = self._large
        begin = _begin_runs(points[large], _RUN_REACHES * reach)
        counts = np.diff(begin, append=len(large))
        low, high = around[large, :2], around[large, 2:]
        boxes = np.column_stack([np.minimum.reduceat(low, begin), np.maximum.reduceat(high, begin)])
        for run, item in query_tree(tree, boxes):
            segment = np.repeat(rows[item], counts[run])
            point = large[list_range_numbers(begin[run], counts[run])]
            near = boxes_meet(around, point, self._boxes, segment)
            near &= group[point] == self.group[segment]
            yield point[near], segment[near]

    def nearer_than(self, points: FloatArray, group: IntArray, limit: FloatArray) -> BoolArray:
        """(N,) whether a point is nearer than its limit to a segment of its group.

        points: (N, 2) mm.
        group: (N,) labels.
        limit: (N,) mm.
        """
        is_near = np.zeros(len(points), dtype=bool)
        for point, segment in self._pairs(points, group, float(limit.max(initial=0.0))):
            distance = measure_distances(points[point], self.segments, segment)
            is_near[point[distance < limit[point]]] = True
        return is_near

    def nearest(self, points: FloatArray, group: IntArray, reach: float) -> FloatArray:
        """(N,) distance to the nearest segment of the group, mm, inf beyond `reach` mm."""
        best = np.full(len(points), np.inf)
        for point, segment in self._pairs(points, group, reach):
            np.minimum.at(best, point, measure_distances(points[point], self.segments, segment))
        best[best > reach] = np.inf
        return best

    def nearest_rows(self, points: FloatArray, group: IntArray, reach: float) -> IntArray:
        """(N,) row of the nearest segment of the group, -1 beyond `reach` mm."""
        best, rows = np.full(len(points), reach), np.full(len(points), -1)
        for point, segment in self._pairs(points, group, reach):
            distance = measure_distances(points[point], self.segments, segment)
            order = np.lexsort((distance, point))
            order = order[find_run_starts(point[order])]
            order = order[distance[order] <= best[point[order]]]
            best[point[order]], rows[point[order]] = distance[order], segment[order]
        return rows


def measure_nearest(points: FloatArray, segments: Segments, reach: float) -> FloatArray:
    """(N,) distance of points (N, 2) from the nearest of `segments`, mm, inf beyond `reach` mm."""
    obstacles = Obstacles(segments, np.zeros(len(segments), dtype=np.int64))
    return obstacles.nearest(points, np.zeros(len(points), dtype=np.int64), reach)


def measure_gaps(lines: Segments, segments: Segments, reach: float) -> FloatArray:
    """(L,) distance of each of L lines and arcs from the nearest of `segments`, mm.

    It is inf beyond `reach` mm. Two segments that do not cross are nearest at an end of one of
    them, on the line through the centres of two arcs, or on the perpendicular from the centre of
    an arc to a line.
    """
    best = np.full(len(lines), np.inf)
    tree = shapely.STRtree(make_boxes(compute_bounds(segments)))
    boxes = compute_bounds(lines) + np.array([-reach, -reach, reach, reach])
    for row, other in query_tree(tree, boxes):
        np.minimum.at(best, row, _measure_pairs(lines.take(row), segments.take(other)))
    best[best > reach] = np.inf
    return best


def _measure_pairs(a: Segments, b: Segments) -> FloatArray:
    """(K,) distance of segment k of `a` from segment k of `b`, mm."""
    both, rows = concatenate([a, b]), np.arange(len(a))
    ends = np.concatenate([b.start, b.end, a.start, a.end])
    others = np.concatenate([rows, rows, rows + len(a), rows + len(a)])
    distance = np.asarray(measure_distances(ends, both, others).reshape(4, -1).min(axis=0))
    for lines, arcs in ((a, b), (b, a)):
        mixed = np.flatnonzero(~lines.is_arc & arcs.is_arc)
        perpendicular = _measure_perpendiculars(lines.take(mixed), arcs.take(mixed))
        np.minimum.at(distance, mixed, perpendicular)
    arcs_only = np.flatnonzero(a.is_arc & b.is_arc)
    between_arcs = _measure_along_centres(a.take(arcs_only), b.take(arcs_only))
    np.minimum.at(distance, arcs_only, between_arcs)
    cut_rows, _ = find_cuts(both, rows, rows + len(a))
    distance[cut_rows[cut_rows < len(a)]] = 0.0
    return distance


def _measure_perpendiculars(line: Segments, arc: Segments) -> FloatArray:
    """(K,) distance of each arc from the foot of its centre on the line, mm."""
    foot = points_at(line, np.clip(find_fractions(line, arc.centre), 0.0, 1.0))
    return measure_distances(foot, arc, np.arange(len(arc)))


def _measure_along_centres(a: Segments, b: Segments) -> FloatArray:
    """(K,) distance of two arcs on the line through their centres, mm.

    It is inf if the first arc does not meet that line, and for arcs about one centre, of which
    always an end is nearest.
    """
    best = np.full(len(a), np.inf)
    between = b.centre - a.centre
    distance = np.hypot(between[:, 0], between[:, 1])
    rows = np.flatnonzero(distance > TOUCH)
    unit, index = between[rows] / distance[rows, None], np.arange(len(rows))
    first, second = a.take(rows), b.take(rows)
    for sign in (-1.0, 1.0):
        meets = passes(first, np.arctan2(sign * unit[:, 1], sign * unit[:, 0]))
        point = first.centre + sign * first.radius[:, None] * unit
        along = np.where(meets, measure_distances(point, second, index), np.inf)
        best[rows] = np.minimum(best[rows], along)
    return best
