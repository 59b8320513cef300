"""Which loop lies inside which, and which loops cross: decides on what side of a loop the part is."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.apart import around, box_pairs
from camgen.geometry.ragged import each_once, following, ramp
from camgen.geometry.segments import (
    BoolArray,
    IntArray,
    Segments,
    bounds,
    flatten,
    neighbours,
    points_at,
    tangents_at,
)
from camgen.geometry.vectors import turns
from camgen.model.pose import FloatArray

# Loops that can be taken as they are: convex, and nothing else within their box. Most holes of a plate are.

#: Turning against the sense of the loop by up to this is rounding, rad; a sharper corner than the other is none.
_STRAIGHT_TURN, _BACK_TURN = 1e-9, 3.0


def plain(segments: Segments, count: int) -> BoolArray:
    """(count,): which of the closed loops that own ``segments``, in order, are convex and alone in their box."""
    result = _convex(segments, count)
    loops = np.flatnonzero(result)
    result[loops] = _alone(segments, loops)
    return result


def loop_areas(segments: Segments, count: int) -> FloatArray:
    """Signed areas (count,), mm2, of closed loops, arcs exact: shoelace about each loop's first point, and segments."""
    first = np.searchsorted(segments.owner, np.arange(count))
    origin = segments.start[np.minimum(first, len(segments) - 1)][segments.owner]
    a, b = segments.start - origin, segments.end - origin
    area = (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2
    rows = np.flatnonzero(segments.is_arc)
    sweep = segments.sweep[rows]
    area[rows] += segments.radius[rows] ** 2 * (sweep - np.sin(sweep)) / 2
    return np.asarray(np.bincount(segments.owner, area, count))


def _convex(segments: Segments, count: int) -> BoolArray:
    """Loops that turn one way only, and once round."""
    size = len(segments)
    following = neighbours(segments, np.ones(count, dtype=np.bool_))
    leaves, arrives = tangents_at(segments, np.zeros(size)), tangents_at(segments, np.ones(size))
    corner = turns(arrives, leaves[following])
    turn = np.bincount(segments.owner, segments.sweep + corner, count)
    sense = np.sign(turn)[segments.owner]
    wrong = (
        (segments.sweep * sense < 0)
        | (corner * sense < -_STRAIGHT_TURN)
        | (np.abs(corner) > _BACK_TURN)
    )
    many = np.bincount(segments.owner, minlength=count) >= 2
    return np.asarray(
        many
        & (np.abs(np.abs(turn) - 2 * np.pi) < 1e-6)
        & (np.bincount(segments.owner, wrong, count) == 0)
    )


def _alone(segments: Segments, loops: IntArray) -> BoolArray:
    """(M,): which of ``loops`` have no segment of another loop in their box."""
    boxes, owner = bounds(segments), segments.owner
    result = np.ones(len(loops), dtype=np.bool_)
    if len(loops):
        for which, row in box_pairs(around(boxes, owner, int(owner[-1]) + 1)[loops], boxes, owner):
            result[which[owner[row] != loops[which]]] = False
    return result


#: Arcs are flattened to this (mm) for the test of inside and outside; loops nearer than that are one another's touch.
_CHORD = 0.02
#: How two loops lie that meet.
_UNKNOWN, _BESIDE, _INSIDE, _PARTLY = -1, 0, 1, 2
#: So many times as many of those that a loop meets are looked at in each round.
_FURTHER = 4


class Nesting(Struct, frozen=True, eq=False):
    """For N loops: depth (N,) = how many loops lie around each; parent (N,) the tightest of them, -1 if none.

    area: (N,) mm2, positive counter-clockwise. crossed: (N,) another loop that each crosses, itself if it crosses
    itself, -1 if none. empty: (N,) true for loops without an inside, such as a line there and back.
    """

    depth: IntArray
    parent: IntArray
    area: FloatArray
    crossed: IntArray
    empty: BoolArray


def nest(segments: Segments, count: int) -> Nesting:
    """Nesting of the closed loops 0..count-1 that own ``segments``."""
    area = loop_areas(segments, count)
    # Most loops of a large drawing need no test against others.
    points, owner = flatten(segments.take(~plain(segments, count)[segments.owner]), _CHORD)
    many = np.bincount(owner, minlength=count) >= 3
    rings = np.flatnonzero(many)
    chosen = many[owner]
    polygons = shapely.polygons(
        shapely.linearrings(points[chosen], indices=np.cumsum(many)[owner[chosen]] - 1)
    )
    crossed = np.full(count, -1)
    _cross_themselves(polygons, rings, _areas(points, owner, count), crossed)
    touching = _cross_others(polygons, rings, crossed)
    depth, parent = _around(segments, polygons, rings, area, touching)
    length = np.bincount(segments.owner, segments.length, count)
    return Nesting(depth, parent, area, crossed, np.abs(area) <= 1e-6 * length)


def _areas(points: FloatArray, owner: IntArray, count: int) -> FloatArray:
    """Signed areas by the shoelace formula about each loop's first point."""
    if not len(owner):
        return np.zeros(count)
    first = np.searchsorted(owner, np.arange(count))
    a = points - points[np.minimum(first, len(owner) - 1)][owner]
    b = a[following(np.bincount(owner))]
    return np.asarray(np.bincount(owner, a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], count) / 2)


def _cross_themselves(
    polygons: object, rings: IntArray, area: FloatArray, crossed: IntArray
) -> None:
    """Marks loops whose enclosed area is not what the shoelace says: parts of them run the other way round."""
    bad = np.flatnonzero(~shapely.is_valid(polygons))
    if len(bad):
        suspects = np.asarray(polygons)[bad]
        enclosed = shapely.area(shapely.make_valid(suspects))
        slack = _CHORD * shapely.length(suspects)
        wrong = bad[np.abs(enclosed - np.abs(area[rings[bad]])) > slack]
        crossed[rings[wrong]] = rings[wrong]


def _cross_others(polygons: object, rings: IntArray, crossed: IntArray) -> IntArray:
    """Marks pairs of loops that cover each other in part; pairs (M, 2) of loops that touch, the inner one first.

    What two loops have in common takes many times as long as whether they meet: of those that a loop meets only the
    first ones are looked at, until one crosses it. Of two loops that both cross others nobody asks more.
    """
    sound = np.flatnonzero(crossed[rings] < 0)
    shapes = np.asarray(polygons)[sound]
    lines = shapely.get_exterior_ring(shapes)
    one, two = shapely.STRtree(lines).query(lines, predicate="intersects")
    one, two = one[one < two], two[one < two]
    shapes = (
        np.where(shapely.is_valid(shapes), shapes, shapely.make_valid(shapes))
        if len(one)
        else shapes
    )
    kind = np.full(len(one), _UNKNOWN)
    # Each pair from both sides, for each loop those that it meets in order.
    pair = np.tile(np.arange(len(one)), 2)
    own, other = np.concatenate([one, two]), np.concatenate([two, one])
    order = np.lexsort((other, own))
    pair, own, other = pair[order], own[order], other[order]
    place = ramp(np.bincount(own, minlength=len(sound)))
    first = np.full(len(sound), len(sound))
    low, high = 0, 1
    while len(now := np.flatnonzero((place >= low) & (place < high) & (first[own] == len(sound)))):
        new = np.unique(pair[now])
        new = new[kind[new] == _UNKNOWN]
        kind[new] = _compare(shapes[one[new]], shapes[two[new]])
        met = now[kind[pair[now]] == _PARTLY]
        np.minimum.at(first, own[met], other[met])
        low, high = high, _FURTHER * high
    found = np.flatnonzero(first < len(sound))
    crossed[rings[sound[found]]] = rings[sound[first[found]]]
    inside = np.flatnonzero(kind == _INSIDE)
    loops = np.column_stack([rings[sound[one[inside]]], rings[sound[two[inside]]]])
    swapped = shapely.area(shapes[one[inside]]) > shapely.area(shapes[two[inside]])
    return np.asarray(np.where(swapped[:, None], loops[:, ::-1], loops))


def _compare(one: NDArray[Any], two: NDArray[Any]) -> IntArray:
    """How pairs of polygons (N,) lie: beside each other, one inside the other, or partly over each other."""
    common = shapely.area(shapely.intersection(one, two))
    smaller = np.minimum(shapely.area(one), shapely.area(two))
    slack = _CHORD * np.minimum(shapely.length(one), shapely.length(two))
    over = common > slack
    return np.where(over, np.where(smaller - common > slack, _PARTLY, _INSIDE), _BESIDE)


def _around(
    segments: Segments, polygons: object, rings: IntArray, area: FloatArray, touching: IntArray
) -> tuple[IntArray, IntArray]:
    """Depth and parent: B lies around A when a point of A is properly inside B, or A touches B from within."""
    count = len(area)
    first = np.searchsorted(segments.owner, np.arange(count))
    probes = points_at(segments.take(first), np.full(count, 0.5))
    outer, probe = shapely.STRtree(shapely.points(probes)).query(
        polygons, predicate="contains_properly"
    )
    pairs = each_once(
        np.concatenate([probe * count + rings[outer], touching @ np.array([count, 1])])
    )
    pair = np.column_stack(np.divmod(pairs, count))
    # What lies around is larger; loops on top of each other, equal but for rounding, would else enclose each other.
    pair = pair[np.abs(area[pair[:, 0]]) < np.abs(area[pair[:, 1]]) * (1 - 1e-9)]
    depth = np.bincount(pair[:, 0], minlength=count)
    parent = np.full(count, -1)
    order = np.argsort(-np.abs(area[pair[:, 1]]), kind="stable")
    # Written from the largest to the smallest, the tightest remains.
    parent[pair[order, 0]] = pair[order, 1]
    return depth, parent
