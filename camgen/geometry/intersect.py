"""Where plane segments meet: crossings of lines and arcs, many pairs at once, touching ends included."""

from __future__ import annotations

import numpy as np
import shapely

from camgen.geometry.boxes import boxed
from camgen.geometry.segments import BoolArray, IntArray, Segments, arc_fraction, bounds, points_at
from camgen.pose import FloatArray

#: Ends nearer than this (mm) to another segment touch it; crossings so near to an end are taken as the end.
TOUCH = 1e-7
#: Pairs that are looked at together: bounds the memory.
_CHUNK = 500_000


def near_pairs(segments: Segments, group: IntArray, reach: float = TOUCH) -> tuple[IntArray, IntArray]:
    """Pairs i < j of segments of one group whose boxes are nearer than ``reach``, mm."""
    boxes = bounds(segments)
    tree = shapely.STRtree(boxed(boxes))
    grown = boxed(boxes + np.array([-reach, -reach, reach, reach]))
    i, j = tree.query(grown)
    keep = (i < j) & (group[i] == group[j])
    return i[keep], j[keep]


def cuts(segments: Segments, i: IntArray, j: IntArray) -> tuple[IntArray, FloatArray]:
    """Where the pairs (i, j) cut each other: rows of ``segments`` and the fraction 0..1 at which each is cut."""
    parts = [_cuts(segments, i[k : k + _CHUNK], j[k : k + _CHUNK]) for k in range(0, max(len(i), 1), _CHUNK)]
    rows = np.concatenate([rows for rows, _ in parts])
    return rows, np.clip(np.concatenate([fraction for _, fraction in parts]), 0.0, 1.0)


def _cuts(segments: Segments, i: IntArray, j: IntArray) -> tuple[IntArray, FloatArray]:
    a, b = segments.take(i), segments.take(j)
    arc_a, arc_b = a.is_arc, b.is_arc
    found: list[tuple[IntArray, FloatArray]] = []
    for kind_a, kind_b in ((False, False), (False, True), (True, False), (True, True)):
        rows = np.flatnonzero((arc_a == kind_a) & (arc_b == kind_b))
        if len(rows):
            one, two = a.take(rows), b.take(rows)
            for points in _crossings(one, two, kind_a, kind_b):
                fa, fb = _fractions(one, points), _fractions(two, points)
                hit = _on(one, fa) & _on(two, fb) & np.isfinite(points[:, 0])
                found += [(i[rows[hit]], fa[hit]), (j[rows[hit]], fb[hit])]
    for one, two, row in ((a, b, i), (b, a, j)):
        for end in (two.start, two.end):
            fraction = _fractions(one, end)
            foot = points_at(one, np.clip(fraction, 0.0, 1.0))
            hit = np.hypot(*(foot - end).T) <= TOUCH
            found.append((row[hit], fraction[hit]))
    return np.concatenate([f[0] for f in found]), np.concatenate([f[1] for f in found])


def _on(segments: Segments, fraction: FloatArray) -> BoolArray:
    slack = TOUCH / np.maximum(segments.length, TOUCH)
    return np.asarray((fraction >= -slack) & (fraction <= 1 + slack))


def _fractions(segments: Segments, points: FloatArray) -> FloatArray:
    """(N,) where on each segment the foot of each point lies, 0 at the start and 1 at the end, beyond them outside."""
    chord = segments.end - segments.start
    square = np.maximum((chord**2).sum(axis=1), 1e-300)
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
