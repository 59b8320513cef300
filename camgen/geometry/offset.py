"""The exact offset of lines and arcs: all points at one distance from a drawing, and none nearer.

A point of the offset curve is on the perpendicular to a segment of the source, or on a circle about
one of its corners. So the curve is part of a known set, the candidates:

- each segment moved sideways: a line stays a line, an arc of radius r gets the radius r +- d,
- an arc of radius d about each outer corner.

The candidates are cut wherever they meet. The pieces that are too near to any part of the source
are dropped, and the others are joined end to end. Islands, splits, holes that close and parts that
come too near to each other need no special case, and no arc is ever flattened.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.geometry.apart import set_apart
from camgen.geometry.intersect import (
    Obstacles,
    find_cuts,
    find_fractions,
    find_near_pairs,
    measure_distances,
    only_at_ends,
)
from camgen.geometry.nesting import measure_loop_areas
from camgen.geometry.ragged import (
    find_equal_pairs,
    mark_run_ends,
    mark_run_starts,
    select_distinct,
)
from camgen.geometry.segments import (
    BoolArray,
    IntArray,
    Segments,
    concatenate,
    make_segments,
    points_at,
    split_segments,
    tangents_at,
)
from camgen.geometry.stitch import stitch_pieces
from camgen.geometry.uncross import LEAST_SLIP
from camgen.geometry.vectors import measure_signed_angles, turn_right
from camgen.model.pose import FloatArray

#: A piece is kept if there is free space beyond its middle: a thousandth of its length, within
#: these bounds, mm. A slot exactly as wide as the tool has none. It counts as too narrow, so no
#: paths are left on top of each other.
_BEYOND = (1e-6, 1e-4)
#: Fraction of a piece of the step beyond its middle.
_BEYOND_FRACTION = 0.001
#: mm: rounding of a distance. A point is too near only if it is nearer than the offset by more.
_ROUNDING_MM = 2e-7
#: mm: cuts nearer to each other than this are one.
_SAME_CUT = 1e-6
#: 1/mm: curvatures that differ by less are equal: lines, and arcs on one circle.
_STRAIGHT = 1e-9
#: mm: extended neighbours of a flat corner may miss each other by this and are still joined.
_MISS = 5e-5
#: rad: corners that turn by more are never plain.
_PLAIN_TURN = 0.5
#: mm: edges of two loops that are nearer to each other than this are one.
_SHARED_MM = 5e-3
#: Cosine of the angle between the directions of two loops along a common edge, at most.
_OPPOSITE = -0.9
#: mm: a moved arc with a smaller radius has vanished.
_LEAST_RADIUS_MM = 1e-9


class Offset(Struct, frozen=True, eq=False):
    """Chains of segments at a distance from a source, which is on their left.

    segments: N segments in running order; `owner` counts the chains.
    closed: (chains,) whether the last segment of a chain is followed by its first.
    source: (N,) the source segment to which a segment belongs; of an arc about a corner the segment
        before the corner.
    corner: (N,) whether a segment is such an arc.
    turn: (N,) angle by which the source turns at that corner, rad, 0 elsewhere.
    open_ends: pieces without a successor although their source is closed. It is 0 unless rounding
        prevented a join.
    shared: (K,) source segments with an edge that another outer loop has too. There is no curve
        beside it.
    """

    segments: Segments
    closed: BoolArray
    source: IntArray
    corner: BoolArray
    turn: FloatArray
    open_ends: int
    shared: IntArray


def make_offset(
    source: Segments, following: IntArray, group: IntArray, distance: float, mitre: float
) -> Offset:
    """The curve at `distance` mm on the right of `source`, and no nearer to its group than that.

    following: (N,) the segment after each one, -1 at the end of an open chain.
    group: (N,) labels. Segments with different labels do not influence each other.
    mitre: distance by which a corner may be exceeded to remain a plain corner, mm.
    """
    candidates, origin, corner, turn = _make_candidates(source, following, distance, mitre)
    group = set_apart(source, group, candidates, origin, distance)
    obstacles, label = Obstacles(source, group), group[origin]
    kept = _may_have_room(candidates, label, obstacles, distance)
    candidates, origin, corner, turn, label = (
        candidates.take(kept), origin[kept], corner[kept], turn[kept], label[kept],
    )  # fmt: skip
    if (following < 0).any():
        cutters = _round_open_ends(source, following, distance)
        row, low, high = _cut_candidates(candidates, label, cutters, group[cutters.owner])
    else:
        row, low, high = _cut_candidates(candidates, label)
    pieces, middle = candidates.take(row), (low + high) / 2
    is_shared = ~corner[row] & _have_shared_edge(
        pieces, middle, origin[row], source, group, distance
    )
    shared = select_distinct(origin[row[is_shared]])
    row, low, high = row[~is_shared], low[~is_shared], high[~is_shared]
    free = _have_room(candidates.take(row), low, high, label[row], obstacles, distance)
    row, low, high = row[free], low[free], high[free]
    chain = stitch_pieces(candidates, row, low, high, label[row])
    row, low, high = chain.row, chain.low, chain.high
    segments = split_segments(candidates, row, low, high)
    segments = make_segments(segments.start, segments.end, segments.bulge, chain.owner)
    is_open_end = mark_run_ends(chain.owner) & ~chain.closed[chain.owner]
    open_ends = int(np.count_nonzero(is_open_end & (following[origin[row]] >= 0)))
    return Offset(segments, chain.closed, origin[row], corner[row], turn[row], open_ends, shared)


def _find_edge_pairs(source: Segments, group: IntArray) -> IntArray:
    """(K, 2) pairs of segments of different outer loops of a group that may have an edge in common.

    A tool beside such an edge would be in the part of the other loop, however far from its edges.
    Each pair is there in both orders.
    """
    owner = source.owner
    count = int(owner.max(initial=0)) + 1
    is_outer = (measure_loop_areas(source, count) > 0)[owner]
    labels = select_distinct(group[is_outer] * count + owner[is_outer]) // count
    has_several = np.bincount(labels, minlength=int(group.max(initial=0)) + 1) > 1
    rows = np.flatnonzero(is_outer & has_several[group])
    first, second = (rows[k] for k in find_near_pairs(source.take(rows), group[rows], _SHARED_MM))
    pairs = np.column_stack([first, second])[owner[first] != owner[second]]
    return np.concatenate([pairs, pairs[:, ::-1]])


def _have_shared_edge(
    moved: Segments,
    middle: FloatArray,
    row: IntArray,
    source: Segments,
    group: IntArray,
    distance: float,
) -> BoolArray:
    """(N,) whether moved segments are beside an edge that another outer loop has too.

    middle: (N,) the fraction of each at which that is tested.
    row: (N,) the segment of `source` that was moved by `distance` mm.
    """
    is_shared = np.zeros(len(row), dtype=bool)
    pairs = _find_edge_pairs(source, group)
    if not len(pairs):
        return is_shared
    tangent = tangents_at(moved, middle)
    touched = points_at(moved, middle) - distance * turn_right(tangent)
    both, _ = find_equal_pairs(row, pairs[:, 0], int(np.bincount(pairs[:, 0]).max()))
    for piece, pair in both:
        others = pairs[pair, 1]
        is_near = measure_distances(touched[piece], source, others) <= _SHARED_MM
        near, others = piece[is_near], source.take(others[is_near])
        other_tangent = tangents_at(others, find_fractions(others, touched[near]))
        is_shared[near[(tangent[near] * other_tangent).sum(axis=1) < _OPPOSITE]] = True
    return is_shared


def _make_candidates(
    source: Segments, following: IntArray, distance: float, mitre: float
) -> tuple[Segments, IntArray, BoolArray, FloatArray]:
    """All curves that can be part of the offset: moved segments, then arcs about outer corners.

    Returns C candidates, the source segment of each (C,), whether it is an arc about a corner (C,),
    and the angle of that corner (C,), rad.
    """
    at_start, at_end = np.zeros(len(source)), np.ones(len(source))
    before = np.flatnonzero(following >= 0)
    after = following[before]
    first, second = tangents_at(source, at_end)[before], tangents_at(source, at_start)[after]
    bend = np.sign(source.bulge) / source.radius
    turn = _corner_turns(first, second, bend[before] + bend[after])
    radius = source.radius + np.sign(source.bulge) * distance
    plain = _plain_corners(turn, radius[before], radius[after], distance, mitre)
    # At a plain corner both neighbours are extended until they meet.
    extra = np.where(plain, distance * np.tan(turn / 2), 0.0)
    early, late = np.zeros(len(source)), np.zeros(len(source))
    late[before], early[after] = extra, extra
    moved = _move_sideways(source, distance, radius, early, late)
    alive = np.flatnonzero(~source.is_arc | (radius > _LEAST_RADIUS_MM))
    outer = np.flatnonzero((turn > 0) & ~plain)
    centre = source.end[before[outer]]
    start, end, bulge = (column[alive] for column in moved)
    candidates = make_segments(
        np.concatenate([start, centre + distance * turn_right(first[outer])]),
        np.concatenate([end, centre + distance * turn_right(second[outer])]),
        np.concatenate([bulge, np.tan(turn[outer] / 4)]),
        np.concatenate([source.owner[alive], source.owner[before[outer]]]),
    )
    origin = np.concatenate([alive, before[outer]])
    corner = np.arange(len(origin)) >= len(alive)
    return candidates, origin, corner, np.concatenate([np.zeros(len(alive)), turn[outer]])


def _corner_turns(first: FloatArray, second: FloatArray, bends: FloatArray) -> FloatArray:
    """(N,) angles from the directions `first` to `second`, rad, positive at an outer corner.

    An outer corner is one around which a tool on the right side moves on an arc.

    bends: (N,) sum of the curvatures of both segments, 1/mm, counter-clockwise positive. At a
        reversal they decide whether the part is between the two sides of the tip (a turn of pi) or
        around them (-pi).
    """
    turn = measure_signed_angles(first, second)
    back = np.pi - np.abs(turn) <= np.maximum(LEAST_SLIP / 2 * np.abs(bends), 1e-9)
    is_around = bends > _STRAIGHT
    turn = np.where(back & is_around & (turn > 0), turn - 2 * np.pi, turn)
    return np.where(back & ~is_around & (turn < 0), turn + 2 * np.pi, turn)


def _move_sideways(
    source: Segments, distance: float, radius: FloatArray, early: FloatArray, late: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Start, end and bulge of the segments moved sideways by `distance` mm, and extended.

    radius: (N,) radius of the moved arcs, mm.
    early, late: (N,) lengths by which they are extended before the start and beyond the end, mm.
    """
    at_start, at_end = np.zeros(len(source)), np.ones(len(source))
    sweep = source.sweep
    # Lines are extended below. An arc that shrinks to a point is left out.
    lasting = np.where(source.is_arc & (radius > _LEAST_RADIUS_MM), radius, np.inf)
    before, beyond = early / lasting * np.sign(sweep), late / lasting * np.sign(sweep)
    safe_sweep = np.where(sweep == 0, 1.0, sweep)
    begin, finish = before / safe_sweep, beyond / safe_sweep
    # An arc is extended by fractions below 0 and above 1, a line along its tangent.
    tangent = tangents_at(source, at_start), tangents_at(source, at_end)
    start, end = points_at(source, -begin), points_at(source, 1 + finish)
    start = start + distance * turn_right(tangents_at(source, -begin))
    end = end + distance * turn_right(tangents_at(source, 1 + finish))
    line = ~source.is_arc
    start[line] -= early[line, None] * tangent[0][line]
    end[line] += late[line, None] * tangent[1][line]
    return start, end, np.tan((sweep + before + beyond) / 4)


def _plain_corners(
    turn: FloatArray,
    radius_before: FloatArray,
    radius_after: FloatArray,
    distance: float,
    mitre: float,
) -> BoolArray:
    """(N,) whether a corner is so flat that its moved neighbours are extended until they meet.

    turn: (N,) rad, positive at outer corners.
    radius_before, radius_after: (N,) radii of the moved neighbours, mm, inf for lines.
    """
    overshoot = distance * turn**2 / 8
    # Extended arcs miss each other by the square of the extension.
    extension = distance * np.abs(turn) / 2
    before, after = (np.maximum(r, _LEAST_RADIUS_MM) for r in (radius_before, radius_after))
    miss = extension**2 / 2 * (1 / before + 1 / after)
    return np.asarray((turn > 0) & (turn < _PLAIN_TURN) & (overshoot <= mitre) & (miss <= _MISS))


def _may_have_room(
    candidates: Segments, label: IntArray, obstacles: Obstacles, distance: float
) -> BoolArray:
    """(C,) whether some point of a candidate may be `distance` mm away from the source.

    That is known from its middle alone: along a curve the distance from the source changes by no
    more than the length of the curve.
    """
    middle = points_at(candidates, np.full(len(candidates), 0.5))
    half = candidates.length / 2
    short = np.flatnonzero(half < distance / 2)
    may_have_room = np.ones(len(candidates), dtype=bool)
    nearest = obstacles.nearest(middle[short], label[short], distance)
    may_have_room[short] = nearest + half[short] > distance - _BEYOND[1]
    return may_have_room


def _round_open_ends(source: Segments, following: IntArray, distance: float) -> Segments:
    """Circles about the ends of open chains, each as two arcs; `owner` is the source segment.

    The offset does not run along them, but it ends where it meets one.
    """
    last = np.flatnonzero(following < 0)
    first = np.flatnonzero(np.bincount(following[following >= 0], minlength=len(source)) == 0)
    centre = np.concatenate([source.start[first], source.end[last]])
    owner = np.concatenate([first, last])
    across = np.array([distance, 0.0])
    right, left = centre + across, centre - across
    return make_segments(
        np.concatenate([right, left]),
        np.concatenate([left, right]),
        np.ones(2 * len(centre)),
        np.concatenate([owner, owner]),
    )


def _cut_candidates(
    candidates: Segments,
    label: IntArray,
    cutters: Segments | None = None,
    cutter_label: IntArray | None = None,
) -> tuple[IntArray, FloatArray, FloatArray]:
    """The pieces of the candidates between their cuts with each other and with `cutters`.

    Returns the candidate of each piece, and the fractions at which it begins and ends, each (P,).

    label, cutter_label: labels; segments with different labels do not cut each other.
    """
    count = len(candidates)
    if cutters is not None and cutter_label is not None:
        label = np.concatenate([label, cutter_label])
        candidates = concatenate([candidates, cutters])
    first, second = find_near_pairs(candidates, label)
    # Candidates that merely follow each other meet at their ends, which are cuts already.
    may_cut = ~only_at_ends(candidates, first, second) & (np.minimum(first, second) < count)
    rows, fractions = find_cuts(candidates, first[may_cut], second[may_cut])
    inside = rows < count
    rows, fractions = rows[inside], fractions[inside]
    all_rows = np.arange(count)
    row = np.concatenate([all_rows, all_rows, rows])
    cut = np.concatenate([np.zeros(count), np.ones(count), fractions])
    same = _SAME_CUT / np.maximum(candidates.length[:count], _SAME_CUT)
    cut = np.where(cut < same[row], 0.0, np.where(cut > 1 - same[row], 1.0, cut))
    order = np.lexsort((cut, row))
    row, cut = row[order], cut[order]
    is_piece = (row[1:] == row[:-1]) & (cut[1:] - cut[:-1] > same[row[1:]])
    # Several cuts that are one count as the first. One piece ends there and the next begins.
    kept = mark_run_starts(row)
    kept[1:] |= is_piece
    row, cut = row[kept], cut[kept]
    has_next = row[1:] == row[:-1]
    return row[:-1][has_next], cut[:-1][has_next], cut[1:][has_next]


def _have_room(
    chosen: Segments,
    low: FloatArray,
    high: FloatArray,
    label: IntArray,
    obstacles: Obstacles,
    distance: float,
) -> BoolArray:
    """(P,) whether each piece is at the distance: a step beyond its middle nothing is nearer.

    chosen: the candidate of each piece.
    low, high: (P,) fractions at which the piece begins and ends.
    """
    middle = (low + high) / 2
    step = np.clip(_BEYOND_FRACTION * chosen.length * (high - low), *_BEYOND)
    points = points_at(chosen, middle)
    beyond = points + step[:, None] * turn_right(tangents_at(chosen, middle))
    limit = np.concatenate([np.full(len(label), distance - _ROUNDING_MM), distance + step / 2])
    near = obstacles.nearer_than(np.concatenate([points, beyond]), np.tile(label, 2), limit)
    return np.asarray(~near.reshape(2, -1).any(axis=0))
