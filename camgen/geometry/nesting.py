"""Nesting of closed loops: which loop lies inside which, and which loops cross.

It decides on which side of a loop the part is.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from camgen.geometry.apart import find_box_pairs, merge_boxes
from camgen.geometry.ragged import find_following_rows, number_rows, select_distinct
from camgen.geometry.segments import (
    BoolArray,
    IntArray,
    Segments,
    compute_bounds,
    find_following,
    flatten,
    measure_triangles,
    tangents_at,
)
from camgen.geometry.vectors import measure_signed_angles
from camgen.model.pose import FloatArray

# Plain loops, which need no test against others: convex, and alone in their box. Most holes of a
# plate are plain.

#: rad: a corner that turns against the sense of its loop by up to this is straight within rounding.
_STRAIGHT_TURN = 1e-9
#: rad: a corner that turns by more than this is a reversal, not a convex corner.
_BACK_TURN = 3.0
#: rad: rounding of the total turn of a loop, which is 2 pi.
_TURN_ROUNDING = 1e-6


def find_plain(segments: Segments, count: int) -> BoolArray:
    """(count,) whether each closed loop is convex and alone in its box.

    segments: the loops, sorted by owner.
    count: number of loops.
    """
    result = _convex(segments, count)
    loops = np.flatnonzero(result)
    result[loops] = _are_alone(segments, loops)
    return result


def measure_loop_areas(segments: Segments, count: int) -> FloatArray:
    """(count,) signed areas of closed loops, mm2, counter-clockwise positive, arcs exact.

    They are the areas of the polygons of the ends, plus the circle segments. `segments` is sorted
    by owner.
    """
    area = measure_triangles(segments.start, segments.end, segments.owner, count) / 2
    rows = np.flatnonzero(segments.is_arc)
    sweep = segments.sweep[rows]
    area[rows] += segments.radius[rows] ** 2 * (sweep - np.sin(sweep)) / 2
    return np.asarray(np.bincount(segments.owner, area, count))


def _convex(segments: Segments, count: int) -> BoolArray:
    """(count,) whether each loop turns in one sense only, and once."""
    size = len(segments)
    following = find_following(segments, np.ones(count, dtype=np.bool_))
    leaves, arrives = tangents_at(segments, np.zeros(size)), tangents_at(segments, np.ones(size))
    corner = measure_signed_angles(arrives, leaves[following])
    turn = np.bincount(segments.owner, segments.sweep + corner, count)
    sense = np.sign(turn)[segments.owner]
    wrong = (
        (segments.sweep * sense < 0)
        | (corner * sense < -_STRAIGHT_TURN)
        | (np.abs(corner) > _BACK_TURN)
    )
    has_several = np.bincount(segments.owner, minlength=count) >= 2
    turns_once = np.abs(np.abs(turn) - 2 * np.pi) < _TURN_ROUNDING
    return np.asarray(has_several & turns_once & (np.bincount(segments.owner, wrong, count) == 0))


def _are_alone(segments: Segments, loops: IntArray) -> BoolArray:
    """(M,) whether no segment of another loop is in the box of each of `loops` (M,)."""
    boxes, owner = compute_bounds(segments), segments.owner
    result = np.ones(len(loops), dtype=np.bool_)
    if not len(loops):
        return result
    loop_boxes = merge_boxes(boxes, owner, int(owner[-1]) + 1)[loops]
    for which, row in find_box_pairs(loop_boxes, boxes, owner):
        result[which[owner[row] != loops[which]]] = False
    return result


#: mm: deviation of the chords that replace arcs in the tests of inside and outside.
#: Loops nearer to each other than this touch.
_CHORD = 0.02
#: The same as a share of the size of a loop, at most.
_CHORD_SHARE = 0.002
#: How two loops whose borders meet lie: not compared yet, beside each other, one inside the other,
#: or partly over each other.
_UNKNOWN, _BESIDE, _INSIDE, _PARTLY = -1, 0, 1, 2
#: mm: length by which two loops may cross and still count as touching.
_CROSSING_MM = 0.004
#: Factor on the number of neighbours of a loop that are compared, from round to round.
_BATCH_GROWTH = 4
#: mm: ratio of area to length below which a loop has no inside.
_EMPTY_WIDTH_MM = 1e-6
#: Fraction by which an outer loop is larger at least. Loops on top of each other, equal within
#: rounding, would enclose each other otherwise.
_LARGER = 1e-9


class Nesting(Struct, frozen=True, eq=False):
    """How N loops lie in each other.

    depth: (N,) number of loops around each one.
    parent: (N,) the smallest loop around each one, or -1.
    area: (N,) mm2, positive counter-clockwise.
    crossed: (N,) another loop that each one crosses, itself if it crosses itself, -1 if none.
    empty: (N,) whether a loop has no inside, such as a line there and back.
    touching: (M, 2) pairs of loops that touch from within, the inner one first.
    neighbours: (K, 2) pairs of loops beside each other that touch.
    """

    depth: IntArray
    parent: IntArray
    area: FloatArray
    crossed: IntArray
    empty: BoolArray
    touching: IntArray
    neighbours: IntArray


def find_nesting(segments: Segments, count: int) -> Nesting:
    """Nesting of the closed loops 0 to count - 1. `segments` is sorted by owner."""
    area = measure_loop_areas(segments, count)
    # Most loops of a large drawing are plain.
    tested = segments.take(~find_plain(segments, count)[segments.owner])
    chord = _choose_chords(tested, count)
    points, owner = flatten(tested, chord[tested.owner])
    is_ring = np.bincount(owner, minlength=count) >= 3
    rings = np.flatnonzero(is_ring)
    chosen = is_ring[owner]
    polygons = shapely.polygons(
        shapely.linearrings(points[chosen], indices=np.cumsum(is_ring)[owner[chosen]] - 1)
    )
    crossed = np.full(count, -1)
    slack = chord[rings] * shapely.length(polygons)
    area_of_chords = _polygon_areas(points, owner, count)[rings]
    crossed[rings] = np.where(_cross_themselves(polygons, area_of_chords, slack), rings, -1)
    touching, neighbours = _mark_crossings(polygons, rings, slack, crossed)
    depth, parent = _find_parents(segments, polygons, rings, area, touching, neighbours)
    length = np.bincount(segments.owner, segments.length, count)
    empty = np.abs(area) <= _EMPTY_WIDTH_MM * length
    return Nesting(depth, parent, area, crossed, empty, touching, neighbours)


def find_enclosing(parent: IntArray, chosen: BoolArray) -> IntArray:
    """(N,) the smallest of the loops `chosen` (N,) around each of N loops, or -1.

    parent: (N,) the smallest loop around each one, or -1.
    """
    around = parent.copy()
    while (is_other := (around >= 0) & ~chosen[around]).any():
        around[is_other] = parent[around[is_other]]
    return around


def _choose_chords(segments: Segments, count: int) -> FloatArray:
    """(count,) deviation of the chords that replace arcs, mm: less for small loops."""
    boxes = merge_boxes(compute_bounds(segments), segments.owner, count)
    size = np.linalg.norm(boxes[:, 2:] - boxes[:, :2], axis=1)
    return np.asarray(np.fmin(_CHORD, _CHORD_SHARE * size))


def _polygon_areas(points: FloatArray, owner: IntArray, count: int) -> FloatArray:
    """(count,) signed areas of polygons, mm2."""
    ends = points[find_following_rows(np.bincount(owner))]
    return np.asarray(np.bincount(owner, measure_triangles(points, ends, owner, count), count) / 2)


def _cross_themselves(polygons: object, area: FloatArray, slack: FloatArray) -> BoolArray:
    """(R,) whether loops cross or retrace themselves.

    A loop crosses itself if its enclosed area is not that of the shoelace formula, because parts of
    it have the opposite sense.

    polygons: (R,) loops as polygons.
    area: (R,) mm2, by the shoelace formula.
    slack: (R,) rounding of an area, mm2.
    """
    wrong = ~shapely.is_valid(polygons)
    suspects = np.asarray(polygons)[wrong]
    areas = shapely.make_valid(suspects)
    crosses = np.abs(shapely.area(areas) - np.abs(area[wrong])) > slack[wrong]
    # The buffer of 0 mm drops the lines.
    retraces = _are_retraced(shapely.get_exterior_ring(suspects), shapely.buffer(areas, 0.0))
    wrong[wrong] = crosses | retraces
    return np.asarray(wrong)


def _are_retraced(rings: NDArray[Any], areas: NDArray[Any]) -> BoolArray:
    """(N,) whether loops run back over themselves, so that a line has no side of its own.

    A bridge between an outline and its hole is run there and back too. Both of its sides are the
    part, so it counts only if an end of it is free, or if it leaves the area.

    rings: (N,) the loops as lines.
    areas: (N,) the areas that they enclose.
    """
    lines = shapely.node(rings)
    outside = shapely.length(shapely.difference(lines, shapely.buffer(areas, _CHORD)))
    # All but the borders of the area is run twice.
    again = 2 * shapely.length(lines) - shapely.length(areas) - shapely.length(rings)
    free = np.zeros(len(rings))
    for index, line in enumerate(lines):
        free[index] = shapely.length(shapely.polygonize_full(shapely.get_parts(line))[2])
    return np.asarray(np.maximum(np.maximum(outside, free), np.abs(again)) > _CHORD)


def _mark_crossings(
    polygons: object, rings: IntArray, slack: FloatArray, crossed: IntArray
) -> tuple[IntArray, IntArray]:
    """Sets `crossed` of loops that partly cover another loop, and finds the loops that touch.

    Returns pairs (M, 2) of loops that touch from within, the inner one first, and pairs (K, 2) of
    loops beside each other that touch. To compute what two loops have in common takes many times as
    long as to find whether they meet. So of the loops that a loop meets, the first ones are
    compared, then more, until one crosses it. Two loops that both cross others are not compared any
    more.
    """
    shapes = np.asarray(polygons)
    lines = shapely.get_exterior_ring(shapes)
    first, second = shapely.STRtree(lines).query(lines, predicate="intersects")
    first, second = first[first < second], second[first < second]
    if len(first):
        shapes = np.where(shapely.is_valid(shapes), shapes, shapely.make_valid(shapes))
    kind = np.full(len(first), _UNKNOWN)
    # Each pair from both sides; for each loop those that it meets in order.
    pair = np.tile(np.arange(len(first)), 2)
    loop, other = np.concatenate([first, second]), np.concatenate([second, first])
    order = np.lexsort((other, loop))
    pair, loop, other = pair[order], loop[order], other[order]
    place = number_rows(np.bincount(loop, minlength=len(rings)))
    none = len(rings)
    first_crossed = np.full(len(rings), none)
    low, high = 0, 1
    while True:
        batch = np.flatnonzero((place >= low) & (place < high) & (first_crossed[loop] == none))
        if not len(batch):
            break
        new = np.unique(pair[batch])
        new = new[kind[new] == _UNKNOWN]
        least = np.minimum(slack[first[new]], slack[second[new]])
        kind[new] = _compare(shapes[first[new]], shapes[second[new]], least)
        partly = batch[kind[pair[batch]] == _PARTLY]
        np.minimum.at(first_crossed, loop[partly], other[partly])
        low, high = high, _BATCH_GROWTH * high
    crossing = np.flatnonzero((first_crossed < none) & (crossed[rings] < 0))
    crossed[rings[crossing]] = rings[first_crossed[crossing]]
    loops = np.column_stack([rings[first], rings[second]])
    inside = np.flatnonzero(kind == _INSIDE)
    is_swapped = shapely.area(shapes[first[inside]]) > shapely.area(shapes[second[inside]])
    within = np.where(is_swapped[:, None], loops[inside, ::-1], loops[inside])
    return np.asarray(within), np.asarray(loops[kind == _BESIDE])


def mark_small_crossings(segments: Segments, nesting: Nesting, islands: bool = True) -> Nesting:
    """The nesting, with loops marked as crossing that cross by more than `_CROSSING_MM`.

    The areas of `find_nesting` do not show that: a corner that reaches into another loop, or out of
    the one around it, has a small area. A tool beside one of the loops would cut the other one.

    islands: whether a loop crosses the one around it if it reaches out of it.
    """
    within, neighbours = nesting.touching, nesting.neighbours
    if not islands:
        within = within[:0]
    protrudes, overlaps = _measure_crossings(segments, within, neighbours)
    crossed = nesting.crossed.copy()
    for loop, other in np.concatenate([within[protrudes], neighbours[overlaps]]).tolist():
        crossed[loop] = other if crossed[loop] < 0 else crossed[loop]
        crossed[other] = loop if crossed[other] < 0 else crossed[other]
    return replace(nesting, crossed=crossed)


def _measure_crossings(
    segments: Segments, within: IntArray, neighbours: IntArray
) -> tuple[BoolArray, BoolArray]:
    """Whether loops that touch cross by more than `_CROSSING_MM`, however small the area is.

    within: (N, 2) pairs of loops, the inner one first. It may be in part outside of the other.
    neighbours: (M, 2) pairs of loops beside each other. They may overlap.
    """
    names, place = np.unique(np.concatenate([within, neighbours]), return_inverse=True)
    if not len(names):
        return np.zeros(0, dtype=np.bool_), np.zeros(0, dtype=np.bool_)
    points, owner = flatten(segments.take(np.isin(segments.owner, names)), _CROSSING_MM / 8)
    loops = shapely.linearrings(points, indices=np.searchsorted(names, owner))
    areas = shapely.make_valid(shapely.polygons(loops))
    first, second = place.reshape(-1, 2).T
    grown = _buffer_once(areas, second[: len(within)], _CROSSING_MM)
    smaller = _buffer_once(areas, second[len(within) :], -_CROSSING_MM)
    return (
        np.asarray(~shapely.covers(grown, areas[first[: len(within)]])),
        np.asarray(shapely.intersects(smaller, areas[first[len(within) :]])),
    )


def _buffer_once(areas: NDArray[Any], rows: IntArray, distance: float) -> NDArray[Any]:
    """(N,) the areas `rows` (N,) with their borders moved outwards by `distance` mm."""
    names, place = np.unique(rows, return_inverse=True)
    return np.asarray(shapely.buffer(areas[names], distance)[place])


def _compare(first: NDArray[Any], second: NDArray[Any], slack: FloatArray) -> IntArray:
    """(N,) how pairs of polygons lie: `_BESIDE`, `_INSIDE` or `_PARTLY`.

    slack: (N,) rounding of an area, mm2.
    """
    common = shapely.area(shapely.intersection(first, second))
    smaller = np.minimum(shapely.area(first), shapely.area(second))
    return np.where(common > slack, np.where(smaller - common > slack, _PARTLY, _INSIDE), _BESIDE)


def _find_parents(
    segments: Segments,
    polygons: object,
    rings: IntArray,
    area: FloatArray,
    touching: IntArray,
    neighbours: IntArray,
) -> tuple[IntArray, IntArray]:
    """Depth and parent of each loop, as in `Nesting`.

    Loop A is inside loop B if A touches B from within, or if a point of A is properly inside B.
    Such a point says nothing if A and B are beside each other and share an edge within rounding.

    polygons: (R,) loops that are not plain.
    rings: (R,) their numbers.
    touching: (M, 2) pairs of loops that touch, the inner one first.
    neighbours: (K, 2) pairs of loops beside each other that touch.
    """
    count = len(area)
    first = np.searchsorted(segments.owner, np.arange(count))
    # They are corners of the polygons, so polygons that do not meet agree with them.
    probes = segments.start[first]
    outer, probe = shapely.STRtree(shapely.points(probes)).query(
        polygons, predicate="contains_properly"
    )
    key = np.array([count, 1])
    inside = probe * count + rings[outer]
    inside = inside[~np.isin(inside, np.concatenate([neighbours @ key, neighbours @ key[::-1]]))]
    pairs = select_distinct(np.concatenate([inside, touching @ key]))
    pair = np.column_stack(np.divmod(pairs, count))
    pair = pair[np.abs(area[pair[:, 0]]) < np.abs(area[pair[:, 1]]) * (1 - _LARGER)]
    depth = np.bincount(pair[:, 0], minlength=count)
    parent = np.full(count, -1)
    order = np.argsort(-np.abs(area[pair[:, 1]]), kind="stable")
    # Parents are written from the largest to the smallest, so the smallest remains.
    parent[pair[order, 0]] = pair[order, 1]
    return depth, parent
