"""Which closed contours lie in which others, and which come near to each other."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
from msgspec import Struct

from camgen.check.proof.pieces import BoolArray, IntArray, Pieces, points_along, rows_of
from camgen.model.pose import FloatArray

#: Sagitta of the chords that stand for arcs where inside and outside are decided, mm.
_CHORD_MM = 1e-3
#: Sagitta where it is decided whether a contour crosses itself, mm.
_FINE_CHORD_MM = 1e-6
#: Two contours cross if parts of one are farther inside and outside of the other than this, mm.
_CROSSING_MM = 0.003
#: A contour with more neighbours than these, and no more pieces, is tested piece by piece.
_MANY = 256
#: Places of a contour, as shares of its pieces, at which it is decided whether it lies inside.
_PROBES = (0.0, 0.5)


class Nesting(Struct, frozen=True, eq=False):
    """Contours of a drawing in relation to each other.

    depth: (C,) number of closed contours around each contour.
    enclosed: (E, 2) pairs of a contour and a closed one around it.
    near: (N, 2) pairs of contours whose bounding boxes are within twice the distance that was asked
        for, each pair twice. A contour around many others has only those near to one of its pieces.
    inside_left: (C,) whether the inside of a closed contour is on the left of its direction.
    """

    depth: IntArray
    enclosed: IntArray
    near: IntArray
    inside_left: BoolArray


def nest(
    pieces: Pieces, boxes: FloatArray, shown: BoolArray, closed: BoolArray, distance: float
) -> Nesting:
    """The nesting of contours, and the pairs that come nearer than `distance` mm.

    pieces: lines and arcs of the contours.
    boxes: (C, 4) their bounding boxes.
    shown: (C,) the contours that count.
    closed: (C,) whether each contour is closed.
    """
    count = len(closed)
    # A diagonal has the bounding box that the tree looks at, and is made faster than a polygon.
    names = np.flatnonzero(shown & np.isfinite(boxes[:, 0]))
    wide = rows_of(boxes, names) + np.array([-1, -1, 1, 1]) * distance
    diagonals = shapely.linestrings(wide.reshape(-1, 2, 2))
    first, second = shapely.STRtree(diagonals).query(diagonals)
    others = np.flatnonzero(first != second)
    pairs = np.column_stack([names[first[others]], names[second[others]]])
    around = closed[pairs[:, 1]]
    for side, sense in enumerate((1, 1, -1, -1)):
        around &= sense * boxes[pairs[:, 0], side] >= sense * boxes[pairs[:, 1], side]
    enclosed = _select_enclosed(pieces, pairs[around])
    depth = np.bincount(enclosed[:, 0], minlength=count)
    pairs = _keep_near(pieces, boxes, pairs, 2 * distance)
    return Nesting(depth, enclosed, pairs, enclosed_areas(pieces, count) > 0)


def _keep_near(pieces: Pieces, boxes: FloatArray, pairs: IntArray, distance: float) -> IntArray:
    """The pairs without those of a contour around many others that are far from all its pieces."""
    kept = np.ones(len(pairs), np.bool_)
    left, bottom, right, top = boxes.T.copy()
    for index in np.flatnonzero(np.bincount(pairs[:, 0]) > _MANY).tolist():
        rows = np.flatnonzero(pieces.owner == index)
        if len(rows) > _MANY:
            continue
        near = np.zeros(len(boxes), np.bool_)
        for low_x, low_y, high_x, high_y in pieces.boxes[rows].tolist():
            meets = (left <= high_x + distance) & (right >= low_x - distance)
            near |= meets & (bottom <= high_y + distance) & (top >= low_y - distance)
        kept &= (pairs[:, 0] != index) | near[pairs[:, 1]]
        kept &= (pairs[:, 1] != index) | near[pairs[:, 0]]
    return pairs[kept]


def contour_boxes(pieces: Pieces, count: int) -> FloatArray:
    """(C, 4) bounding boxes of contours: minimum x and y, maximum x and y."""
    boxes = np.tile([np.inf, np.inf, -np.inf, -np.inf], (count, 1))
    if len(pieces):
        first = _first_rows(pieces.owner)
        names = pieces.owner[first]
        for side, extreme in enumerate((np.minimum, np.minimum, np.maximum, np.maximum)):
            boxes[names, side] = extreme.reduceat(pieces.boxes[:, side], first)
    return boxes


def _first_rows(owner: IntArray) -> IntArray:
    return np.flatnonzero(np.append(True, owner[1:] != owner[:-1]))


def enclosed_areas(pieces: Pieces, count: int) -> FloatArray:
    """(C,) enclosed areas, mm2, positive if the contour runs counter-clockwise."""
    start, end = pieces.start, pieces.end
    origin = start[_first_rows(pieces.owner)] if len(pieces) else start
    sizes = np.bincount(pieces.owner, minlength=count)
    origin = np.repeat(origin, sizes[sizes > 0], axis=0)
    a, b = start - origin, end - origin
    area = (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2
    arc = pieces.turn != 0
    half, radius = pieces.half[arc], pieces.radius[arc]
    area[arc] += (radius**2 * (half - np.sin(half) * np.cos(half))) * pieces.turn[arc]
    return np.bincount(pieces.owner, area, count).astype(np.float64)


def _select_enclosed(pieces: Pieces, pairs: IntArray) -> IntArray:
    kept = [np.zeros((0, 2), np.intp)]
    by_owner = pieces.owner
    counts = np.bincount(by_owner, minlength=int(pairs.max(initial=0)) + 1)
    high = np.cumsum(counts)[pairs[:, 0]]
    low = high - counts[pairs[:, 0]]
    for outer in np.unique(pairs[:, 1]).tolist():
        rows = np.flatnonzero(pairs[:, 1] == outer)
        ring = flatten(pieces.take(by_owner == outer))
        if len(ring) < 3:
            continue
        area = shapely.polygons(shapely.linearrings(ring))
        kept.append(pairs[rows[_is_inside(area, pieces, low[rows], high[rows])]])
    return np.concatenate(kept)


def find_unclear(pieces: Pieces, chosen: BoolArray, near: IntArray) -> BoolArray:
    """(C,) contours in the mask `chosen` without a clear inside: they cross themselves or others.

    near: (N, 2) pairs of contours that may cross.
    """
    unclear = np.zeros(len(chosen), np.bool_)
    areas = np.full(len(chosen), shapely.Point())
    for index in np.flatnonzero(chosen).tolist():
        ring = flatten(pieces.take(pieces.owner == index))
        area = shapely.polygons(shapely.linearrings(ring)) if len(ring) > 3 else areas[index]
        thin = shapely.area(area) <= 1e-6 * shapely.length(area)
        unclear[index] = thin or not shapely.is_valid(area)
        areas[index] = shapely.make_valid(area)
    size = shapely.area(areas)
    pairs = near[chosen[near].all(axis=1) & (size[near[:, 0]] <= size[near[:, 1]])]
    small, large = areas[pairs].T
    meets = shapely.intersects(small, large) & ~shapely.contains_properly(large, small)
    pairs, small = pairs[meets], small[meets]
    names, place = np.unique(pairs[:, 1], return_inverse=True)
    inner = shapely.buffer(areas[names], -_CROSSING_MM)[place]
    outer = shapely.buffer(areas[names], _CROSSING_MM)[place]
    unclear[pairs[shapely.intersects(inner, small) & ~shapely.covers(outer, small)]] = True
    return unclear


def count_around(
    pieces: Pieces, boxes: FloatArray, chosen: BoolArray, points: FloatArray
) -> IntArray:
    """(N,) number of the closed contours in the mask `chosen` around each of `points` (N, 2).

    boxes: (C, 4) bounding boxes of the contours.
    """
    names = np.flatnonzero(chosen & np.isfinite(boxes[:, 0]))
    tree = shapely.STRtree(shapely.points(points))
    near, rows = tree.query(shapely.box(*boxes[names].T))
    first = np.searchsorted(pieces.owner, np.arange(len(boxes) + 1))
    around = np.zeros(len(points), np.intp)
    # The pairs come contour by contour.
    ends = np.append(0, np.cumsum(np.bincount(near, minlength=len(names))))
    for index in np.flatnonzero(np.diff(ends)).tolist():
        name, inner = names[index], rows[ends[index] : ends[index + 1]]
        ring = flatten(pieces.take(np.arange(first[name], first[name + 1])))
        if len(ring) > 3:
            area = shapely.polygons(shapely.linearrings(ring))
            around[inner] += shapely.contains_xy(area, points[inner, 0], points[inner, 1])
    return around


def crosses_itself(pieces: Pieces, contour: int) -> bool:
    """Whether a closed contour crosses itself, however little."""
    ring = flatten(pieces.take(pieces.owner == contour), _FINE_CHORD_MM)
    ring[-1] = ring[0]
    return len(ring) > 3 and not shapely.is_valid(shapely.polygons(shapely.linearrings(ring)))


def _is_inside(area: Any, pieces: Pieces, low: IntArray, high: IntArray) -> BoolArray:
    """(N,) whether contours lie inside `area`. low, high: (N,) range of each one's `pieces`."""
    shapely.prepare(area)
    inside, maybe = np.ones(len(low), np.bool_), np.zeros(len(low), np.bool_)
    for share in _PROBES:
        x, y = pieces.middle[low + (share * (high - low)).astype(np.intp)].T
        inside &= shapely.contains_xy(area, x, y)
        maybe |= shapely.intersects_xy(area, x, y)
    # Where not all are inside, some touch the border: the place farthest from it decides.
    for index in np.flatnonzero(maybe & ~inside).tolist():
        points = shapely.points(pieces.middle[low[index] : high[index]])
        distance = shapely.distance(points, area.exterior)
        best = points[np.argmax(distance)]
        if distance.max() < _CROSSING_MM:
            ring = flatten(pieces.take(np.arange(low[index], high[index])))
            if len(ring) > 3:
                best = shapely.point_on_surface(shapely.make_valid(shapely.polygons(ring)))
        inside[index] = shapely.contains_properly(area, best)
    return np.asarray(inside)


def flatten(pieces: Pieces, chord: float = _CHORD_MM) -> FloatArray:
    """(N, 2) the points of one chain of pieces, arcs as chords that leave them by `chord` mm."""
    step = np.full(len(pieces), np.inf)
    arc = pieces.turn != 0
    step[arc] = 2 * np.arccos(np.clip(1 - chord / pieces.radius[arc], -1.0, 1.0))
    counts = np.maximum(np.ceil(2 * pieces.half / np.maximum(step, 1e-4)), 1).astype(np.intp)
    rows = np.repeat(np.arange(len(pieces)), counts)
    place = np.arange(len(rows)) - np.repeat(np.cumsum(counts) - counts, counts)
    points = points_along(pieces, rows, place / counts[rows])
    # The ends of pieces are exact, so that a ring does not cross itself by a rounding.
    points[place == 0] = pieces.start[rows[place == 0]]
    return np.concatenate([points, pieces.end[-1:]])
