"""Where plane segments meet: crossings of lines and arcs, many pairs at once, touching ends included."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from camgen.geometry.ragged import PAIRS, matches, run_starts, stretches
from camgen.geometry.segments import (
    BoolArray,
    IntArray,
    Segments,
    arc_fraction,
    bounds,
    passes,
    points_at,
)
from camgen.model.pose import FloatArray
from camgen.model.tolerance import NONZERO

# Boxes for a tree that finds what is near.


def box(boxes: FloatArray) -> NDArray[Any]:
    """Geometries (N,) with the boxes (N, 4) of xmin, ymin, xmax, ymax: their diagonals.

    A tree that is asked without a predicate looks at boxes alone, and a diagonal is made in half a rectangle's time.
    """
    return np.asarray(shapely.linestrings(boxes.reshape(-1, 2, 2)))


#: Ends nearer than this (mm) to another segment touch it; crossings so near to an end are taken as the end.
TOUCH = 1e-7
#: What two boxes have in common at a corner is no larger, mm.
_CORNER = 5e-8
#: Of groups with no more rows all pairs are looked at, which takes less time than a tree.
FEW = 16
#: Most points of a run that a tree is asked for at once, and the length of the run in reaches.
#: Points beside a contour have the same segments near.
_RUN, _REACHES = 16, 4


def near_pairs(
    segments: Segments, group: IntArray, reach: float = TOUCH
) -> tuple[IntArray, IntArray]:
    """Pairs i < j of segments of one group (N,), from 0, whose boxes are nearer than ``reach``, mm."""
    boxes = bounds(segments)
    grown = boxes + np.array([-reach, -reach, reach, reach])
    few, many = matches(group, group, FEW)
    found = [(many[:0], many[:0])]
    for one, two in few:
        i, j = one[one < two], two[one < two]
        near = boxes_meet(grown, i, boxes, j)
        found.append((i[near], j[near]))
    if len(many):
        i, j = shapely.STRtree(box(boxes[many])).query(box(grown[many]))
        i, j = many[i], many[j]
        near = (i < j) & (group[i] == group[j])
        found.append((i[near], j[near]))
    return np.concatenate([i for i, _ in found]), np.concatenate([j for _, j in found])


def boxes_meet(one: FloatArray, i: IntArray, two: FloatArray, j: IntArray) -> BoolArray:
    """(K,) whether boxes i of ``one`` (N, 4) and j of ``two`` (M, 4) have a point in common."""
    a, b = one.take(i, axis=0), two.take(j, axis=0)
    met = (a[:, 0] <= b[:, 2]) & (a[:, 2] >= b[:, 0])
    met &= (a[:, 1] <= b[:, 3]) & (a[:, 3] >= b[:, 1])
    return np.asarray(met)


def cuts(segments: Segments, i: IntArray, j: IntArray) -> tuple[IntArray, FloatArray]:
    """Where the pairs (i, j) cut each other: rows of ``segments`` and the fraction 0..1 at which each is cut."""
    parts = [
        _cuts(segments, i[k : k + PAIRS], j[k : k + PAIRS]) for k in range(0, max(len(i), 1), PAIRS)
    ]
    rows = np.concatenate([rows for rows, _ in parts])
    return rows, np.clip(np.concatenate([fraction for _, fraction in parts]), 0.0, 1.0)


def only_at_ends(segments: Segments, i: IntArray, j: IntArray) -> BoolArray:
    """(K,) of which pairs an end of the one may meet an end of the other and nothing else: what their boxes have in
    common is there. What ``cuts`` and ``crossings`` find of them is less than 1e-6 mm from an end of both.

    A place that they find is within ``TOUCH`` of both boxes, hence within 3e-7 mm of each of these ends; along an arc
    of not much more than half a circle that is no more than twice as far.
    """
    boxes = bounds(segments)
    a, b = boxes.take(i, axis=0), boxes.take(j, axis=0)
    x, y = (np.maximum(a[:, axis], b[:, axis]) for axis in (0, 1))
    rows = np.flatnonzero(
        (np.minimum(a[:, 2], b[:, 2]) - x <= _CORNER)
        & (np.minimum(a[:, 3], b[:, 3]) - y <= _CORNER)
    )
    x, y = x[rows], y[rows]
    good = np.ones(len(rows), dtype=bool)
    for k in (i[rows], j[rows]):
        ends = (end.take(k, axis=0) for end in (segments.start, segments.end))
        off = (np.maximum(np.abs(end[:, 0] - x), np.abs(end[:, 1] - y)) for end in ends)
        good &= (np.minimum(*off) <= _CORNER) & (np.abs(segments.bulge[k]) <= 1.2)
    result = np.zeros(len(i), dtype=bool)
    result[rows[good]] = True
    return result


def crossings(
    segments: Segments, i: IntArray, j: IntArray
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Where the pairs (i, j) cross: which pair, and the fractions of the first and of the second segment there.

    A fraction may be off 0..1 by rounding. Segments that only touch, or run on one another, may be left out.
    """
    return _crossed(segments.take(i), segments.take(j))


def _crossed(a: Segments, b: Segments) -> tuple[IntArray, FloatArray, FloatArray]:
    """Where segments cross those beside them in the other list."""
    arc_a, arc_b = a.is_arc, b.is_arc
    slack_a, slack_b = (TOUCH / np.maximum(one.length, TOUCH) for one in (a, b))
    none = np.zeros(0)
    found: list[tuple[IntArray, FloatArray, FloatArray]] = [(none.astype(np.int64), none, none)]
    for kind_a, kind_b in ((False, False), (False, True), (True, False), (True, True)):
        rows = np.flatnonzero((arc_a == kind_a) & (arc_b == kind_b))
        if len(rows):
            one, two = a.take(rows), b.take(rows)
            for points in _crossings(one, two, kind_a, kind_b):
                fa, fb = fractions(one, points), fractions(two, points)
                hit = _on(slack_a[rows], fa) & _on(slack_b[rows], fb) & np.isfinite(points[:, 0])
                found.append((rows[hit], fa[hit], fb[hit]))
    which, first, second = zip(*found, strict=True)
    return np.concatenate(which), np.concatenate(first), np.concatenate(second)


def _cuts(segments: Segments, i: IntArray, j: IntArray) -> tuple[IntArray, FloatArray]:
    a, b = segments.take(i), segments.take(j)
    pair, first, second = _crossed(a, b)
    found = [(i[pair], first), (j[pair], second)]
    for one, two, row in ((a, b, i), (b, a, j)):
        for end in (two.start, two.end):
            fraction = fractions(one, end)
            foot = points_at(one, np.clip(fraction, 0.0, 1.0))
            hit = np.hypot(*(foot - end).T) <= TOUCH
            found.append((row[hit], fraction[hit]))
    return np.concatenate([f[0] for f in found]), np.concatenate([f[1] for f in found])


def _on(slack: FloatArray, fraction: FloatArray) -> BoolArray:
    return np.asarray((fraction >= -slack) & (fraction <= 1 + slack))


def fractions(segments: Segments, points: FloatArray) -> FloatArray:
    """(N,) where on each segment the foot of each point lies, 0 at the start and 1 at the end, beyond them outside."""
    chord = segments.end - segments.start
    square = np.maximum((chord**2).sum(axis=1), NONZERO)
    fraction = ((points - segments.start) * chord).sum(axis=1) / square
    rows = np.flatnonzero(segments.is_arc)
    if len(rows):
        arm = points[rows] - segments.centre[rows]
        fraction[rows] = arc_fraction(segments.take(rows), np.arctan2(arm[:, 1], arm[:, 0]))
    return np.asarray(fraction)


def _crossings(a: Segments, b: Segments, a_is_arc: bool, b_is_arc: bool) -> list[FloatArray]:
    """Crossing points of the carriers of each pair, as one or two (N, 2) arrays, NaN where there is none."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        if a_is_arc and b_is_arc:
            return _circle_circle(a, b)
        if a_is_arc:
            return _line_circle(b, a)
        if b_is_arc:
            return _line_circle(a, b)
        return [_line_line(a, b)]


def _line_line(a: Segments, b: Segments) -> FloatArray:
    u, v, w = a.end - a.start, b.end - b.start, b.start - a.start
    cross = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    size = np.hypot(u[:, 0], u[:, 1]) * np.hypot(v[:, 0], v[:, 1])
    # Parallel within a few billionths of a radian: they touch along a stretch or not at all, which the ends tell.
    cross = np.where(np.abs(cross) <= 1e-12 * size, np.nan, cross)
    t = (w[:, 0] * v[:, 1] - w[:, 1] * v[:, 0]) / cross
    return np.asarray(a.start + t[:, None] * u)


def _line_circle(line: Segments, arc: Segments) -> list[FloatArray]:
    u = line.end - line.start
    u = u / np.hypot(u[:, 0], u[:, 1])[:, None]
    w = arc.centre - line.start
    foot = (w * u).sum(axis=1)
    off = w[:, 0] * u[:, 1] - w[:, 1] * u[:, 0]
    half = _half_chord(arc.radius, np.abs(off))
    return [line.start + (foot + sign * half)[:, None] * u for sign in (-1, 1)]


def _circle_circle(a: Segments, b: Segments) -> list[FloatArray]:
    w = b.centre - a.centre
    distance = np.hypot(w[:, 0], w[:, 1])
    distance = np.where(distance <= 1e-9, np.nan, distance)
    u = w / distance[:, None]
    foot = (distance + (a.radius - b.radius) * (a.radius + b.radius) / distance) / 2
    half = _half_chord(a.radius, np.abs(foot))
    left = np.column_stack([-u[:, 1], u[:, 0]])
    return [a.centre + foot[:, None] * u + (sign * half)[:, None] * left for sign in (-1, 1)]


def _half_chord(radius: FloatArray, off: FloatArray) -> FloatArray:
    """Half the chord at distance ``off`` from the centre; 0 where it just touches, NaN where it misses."""
    square = (radius - off) * (radius + off)
    return np.where(off <= radius + TOUCH, np.sqrt(np.maximum(square, 0.0)), np.nan)


# Exact distances from points to lines and arcs, with a box tree in front so that only near pairs are looked at.


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
    square = np.maximum(chord[:, 0] ** 2 + chord[:, 1] ** 2, NONZERO)
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


def _begin_runs(points: FloatArray, length: float) -> IntArray:
    """First rows of runs of points (N, 2) that follow each other within about `length` mm."""
    steps = np.abs(np.diff(points, axis=0)).max(axis=1)
    along = np.append(0.0, np.cumsum(steps))
    begins_new = np.diff(np.floor(along / max(length, NONZERO)), prepend=-1.0) != 0
    begins_new[::_RUN] = True
    return np.flatnonzero(begins_new)


class Obstacles:
    """Segments that a point must keep away from. group: (N,) labels, from 0; a point sees its own group's segments."""

    def __init__(self, segments: Segments, group: IntArray) -> None:
        self.segments = segments
        self.group = group
        self._boxes = bounds(segments)

    @cached_property
    def _large(self) -> tuple[IntArray, shapely.STRtree]:
        """The segments of groups with more than ``FEW`` of them, and a tree of their boxes."""
        rows = np.flatnonzero(np.bincount(self.group)[self.group] > FEW)
        return rows, shapely.STRtree(box(self._boxes[rows]))

    def _pairs(
        self, points: FloatArray, group: IntArray, reach: float
    ) -> Iterator[tuple[IntArray, IntArray]]:
        """Pairs (point, segment) whose boxes are nearer than ``reach``, in chunks of whole points."""
        around = np.column_stack([points - reach, points + reach])
        few, many = matches(group, self.group, FEW)
        for point, segment in few:
            near = boxes_meet(around, point, self._boxes, segment)
            yield point[near], segment[near]
        if not len(many):
            return
        rows, tree = self._large
        begin = _begin_runs(points[many], _REACHES * reach)
        counts = np.diff(begin, append=len(many))
        low, high = around[many, :2], around[many, 2:]
        boxes = np.column_stack([np.minimum.reduceat(low, begin), np.maximum.reduceat(high, begin)])
        step, first = 256, 0
        while first < len(begin):
            run, segment = tree.query(box(boxes[first : first + step]))
            run = run + first
            first += step
            segment = np.repeat(rows[segment], counts[run])
            point = many[stretches(begin[run], counts[run])]
            # As many at a time as the last ones let expect: the drawing decides how many segments are near.
            step = int(np.clip(PAIRS * step / max(len(point), 1), 16, 4 * step))
            near = boxes_meet(around, point, self._boxes, segment)
            near &= group[point] == self.group[segment]
            yield point[near], segment[near]

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

    def nearest_rows(self, points: FloatArray, group: IntArray, reach: float) -> IntArray:
        """(N,) row of the nearest segment of the group, -1 if none is nearer than ``reach`` mm."""
        best, rows = np.full(len(points), reach), np.full(len(points), -1)
        for point, segment in self._pairs(points, group, reach):
            gap = distances(points[point], self.segments, segment)
            order = np.lexsort((gap, point))
            order = order[run_starts(point[order])]
            order = order[gap[order] <= best[point[order]]]
            best[point[order]], rows[point[order]] = gap[order], segment[order]
        return rows


def nearest_distances(points: FloatArray, segments: Segments, reach: float) -> FloatArray:
    """(N,) distance, mm, of points (N, 2) to the nearest of `segments`, inf beyond `reach`."""
    obstacles = Obstacles(segments, np.zeros(len(segments), dtype=np.int64))
    return obstacles.nearest(points, np.zeros(len(points), dtype=np.int64), reach)


def gaps(ways: Segments, segments: Segments, reach: float) -> FloatArray:
    """(L,) distance of each line or arc to the nearest of ``segments``, inf when none is nearer than ``reach`` mm.

    Two segments that do not cross are nearest at an end of one of them, or where the line through the centres of two
    arcs, or that square to a line through the centre of an arc, meets both.
    """
    best = np.full(len(ways), np.inf)
    if not len(ways) or not len(segments):
        return best
    tree = shapely.STRtree(box(bounds(segments)))
    boxes = bounds(ways) + np.array([-reach, -reach, reach, reach])
    step, first = 256, 0
    while first < len(ways):
        way, other = tree.query(box(boxes[first : first + step]))
        way, other = way + first, other.astype(np.int64)
        first += step
        step = int(np.clip(PAIRS * step / max(len(way), 1), 1, 4 * step))
        np.minimum.at(best, way, _apart(ways.take(way), segments.take(other)))
    best[best > reach] = np.inf
    return best


def _apart(way: Segments, other: Segments) -> FloatArray:
    """(K,) distance of each line or arc from that beside it in the list."""
    own = np.arange(len(way))
    gap = np.minimum(distances(way.start, other, own), distances(way.end, other, own))
    for end in (other.start, other.end):
        np.minimum(gap, distances(end, way, own), out=gap)
    for one, two in ((way, other), (other, way)):
        rows = np.flatnonzero(~one.is_arc & two.is_arc)
        np.minimum.at(gap, rows, _beside_centre(one.take(rows), two.take(rows)))
    rows = np.flatnonzero(way.is_arc & other.is_arc)
    np.minimum.at(gap, rows, _along_centres(way.take(rows), other.take(rows)))
    rows, _ = cuts(_both(way, other), own, own + len(way))
    gap[rows[rows < len(way)]] = 0.0
    return gap


def _beside_centre(line: Segments, arc: Segments) -> FloatArray:
    """(K,) distance from each arc of the foot of its centre on the line."""
    chord = line.end - line.start
    square = np.maximum((chord**2).sum(axis=1), NONZERO)
    foot = (
        line.start
        + np.clip(((arc.centre - line.start) * chord).sum(axis=1) / square, 0.0, 1.0)[:, None]
        * chord
    )
    return distances(foot, arc, np.arange(len(arc)))


def _along_centres(one: Segments, two: Segments) -> FloatArray:
    """(K,) distance of two arcs on the line through their centres; inf where one of them does not meet it."""
    best = np.full(len(one), np.inf)
    way = two.centre - one.centre
    apart = np.hypot(way[:, 0], way[:, 1])
    rows = np.flatnonzero(apart > TOUCH)
    unit, own = way[rows] / apart[rows, None], np.arange(len(rows))
    first, second = one.take(rows), two.take(rows)
    for sign in (-1.0, 1.0):
        met = passes(first, np.arctan2(sign * unit[:, 1], sign * unit[:, 0]))
        place = first.centre + sign * first.radius[:, None] * unit
        best[rows] = np.minimum(best[rows], np.where(met, distances(place, second, own), np.inf))
    # About one centre they are apart by their radii, wherever they pass one direction; else an end is nearest.
    return best


def _both(one: Segments, two: Segments) -> Segments:
    return Segments(
        *(
            np.concatenate([getattr(one, name), getattr(two, name)])
            for name in Segments.__struct_fields__
        )
    )
