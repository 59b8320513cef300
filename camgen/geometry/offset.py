"""The exact offset of lines and arcs: everything at one distance from a drawing, and nothing nearer.

A point of the offset curve lies square to a segment of the source or on a circle about one of its corners. So the
curve is part of a known set: each segment moved sideways (a line stays a line, an arc of radius r becomes r +- d) and
an arc of radius d about each outer corner. These candidates are cut wherever they meet, the pieces that lie too near to
any part of the source are dropped, and the rest is joined end to end. Islands, splits, holes that close and parts
that come too near to each other need no case of their own, and no arc is ever flattened.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.geometry.apart import set_apart
from camgen.geometry.intersect import Obstacles, cuts, near_pairs, only_at_ends
from camgen.geometry.ragged import starts_run
from camgen.geometry.segments import (
    BoolArray,
    IntArray,
    Segments,
    make,
    points_at,
    split,
    tangents_at,
)
from camgen.geometry.stitch import stitch
from camgen.geometry.uncross import LEAST_SLIP
from camgen.geometry.vectors import turns
from camgen.model.pose import FloatArray

#: A kept piece must have room beyond its middle: a thousandth of its length, within these bounds (mm). A slot exactly
#: as wide as the tool has none, so it counts as too narrow instead of leaving two paths on top of each other.
_BEYOND = (1e-6, 1e-4)
#: Rounding of a distance (mm): what is nearer than the offset by more than this is too near.
_NOISE = 2e-7
#: Cuts nearer than this (mm) to each other are one.
_SAME_CUT = 1e-6
#: Bends that differ by less (1/mm) are one: lines, and arcs on one circle.
_STRAIGHT = 1e-9
#: Neighbours that run on past a flat corner may miss each other by this (mm) and still be joined.
_MISS = 5e-5


class Offset(Struct, frozen=True, eq=False):
    """Chains of segments beside a source, the source on their left.

    segments: ordered, ``owner`` counts the chains. closed: (chains,). source: (N,) the source segment beside which a
    segment runs; for an arc about a corner the one before the corner. corner: (N,) true for those arcs. turn: (N,)
    rad by which the source turns at that corner, 0 elsewhere. open_ends: pieces that found no successor though their
    source is closed; 0 unless the numbers were against it.
    """

    segments: Segments
    closed: BoolArray
    source: IntArray
    corner: BoolArray
    turn: FloatArray
    open_ends: int


def offset(
    source: Segments, following: IntArray, group: IntArray, distance: float, mitre: float
) -> Offset:
    """The curve at ``distance`` mm on the right of ``source`` and no nearer to any segment of the same group.

    following: (N,) next segment of each, -1 at the end of an open chain. group: (N,) labels; segments of different
    groups do not see each other. mitre: mm by which a corner may be left to stay a plain corner.
    """
    candidates, origin, corner, turn = _candidates(source, following, distance, mitre)
    group = set_apart(source, group, candidates, origin, distance)
    obstacles, label = Obstacles(source, group), group[origin]
    kept = _hopeful(candidates, label, obstacles, distance)
    candidates, origin, corner, turn, label = (
        candidates.take(kept), origin[kept], corner[kept], turn[kept], label[kept],
    )  # fmt: skip
    if (following < 0).any():
        cutters = _round_open_ends(source, following, distance)
        row, low, high = _pieces(candidates, label, cutters, group[cutters.owner])
    else:
        row, low, high = _pieces(candidates, label)
    free = _has_room(candidates.take(row), low, high, label[row], obstacles, distance)
    row, low, high = row[free], low[free], high[free]
    chain = stitch(candidates, row, low, high, label[row])
    row, low, high = chain.row, chain.low, chain.high
    segments = split(candidates, row, low, high)
    segments = make(segments.start, segments.end, segments.bulge, chain.owner)
    loose = ~chain.closed
    loops = following >= 0
    broken = int(np.count_nonzero(loops[origin[row[chain.last_of[loose]]]])) if loose.any() else 0
    return Offset(segments, chain.closed, origin[row], corner[row], turn[row], broken)


def _candidates(
    source: Segments, following: IntArray, distance: float, mitre: float
) -> tuple[Segments, IntArray, BoolArray, FloatArray]:
    """All curves that can be part of the offset: moved segments, then arcs about outer corners; with their origin."""
    zero, one = np.zeros(len(source)), np.ones(len(source))
    before = np.flatnonzero(following >= 0)
    after = following[before]
    first, second = tangents_at(source, one)[before], tangents_at(source, zero)[after]
    bend = np.sign(source.bulge) / source.radius
    turn = _corner_turns(first, second, bend[before] + bend[after])
    radius = source.radius + np.sign(source.bulge) * distance
    plain = _plain_corners(turn, radius[before], radius[after], distance, mitre)
    # At a plain corner both neighbours run on along themselves until they meet.
    extra = np.where(plain, distance * np.tan(turn / 2), 0.0)
    early, late = np.zeros(len(source)), np.zeros(len(source))
    late[before], early[after] = extra, extra
    moved = _move_sideways(source, distance, radius, early, late)
    alive = np.flatnonzero(~source.is_arc | (radius > 1e-9))
    outer = np.flatnonzero((turn > 0) & ~plain)
    about = source.end[before[outer]]
    start, end, bulge = (column[alive] for column in moved)
    candidates = make(
        np.concatenate([start, about + distance * _right(first[outer])]),
        np.concatenate([end, about + distance * _right(second[outer])]),
        np.concatenate([bulge, np.tan(turn[outer] / 4)]),
        np.concatenate([source.owner[alive], source.owner[before[outer]]]),
    )
    origin = np.concatenate([alive, before[outer]])
    corner = np.arange(len(origin)) >= len(alive)
    return candidates, origin, corner, np.concatenate([np.zeros(len(alive)), turn[outer]])


def _corner_turns(first: FloatArray, second: FloatArray, bends: FloatArray) -> FloatArray:
    """(N,) rad from the directions ``first`` to ``second``, positive where a tool on the right goes round the corner.

    bends: (N,) 1/mm, the curvatures of both segments added, counter-clockwise positive. Where a curve goes straight
    back they say whether the part is between the two sides of the tip (a turn of pi) or around them (-pi).
    """
    turn = turns(first, second)
    back = np.pi - np.abs(turn) <= np.maximum(LEAST_SLIP / 2 * np.abs(bends), 1e-9)
    beside = bends > _STRAIGHT
    turn = np.where(back & beside & (turn > 0), turn - 2 * np.pi, turn)
    return np.where(back & ~beside & (turn < 0), turn + 2 * np.pi, turn)


def _move_sideways(
    source: Segments, distance: float, radius: FloatArray, early: FloatArray, late: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Start, end and bulge of the segments moved sideways, begun ``early`` mm before their start and run on ``late`` mm
    beyond their end; ``radius`` is that of the moved arcs.
    """
    zero, one = np.zeros(len(source)), np.ones(len(source))
    with np.errstate(divide="ignore", invalid="ignore"):
        sweep = source.sweep
        before, beyond = (
            np.where(source.is_arc, x / radius * np.sign(sweep), 0.0) for x in (early, late)
        )
        begin, finish = (
            np.where(source.is_arc, x / np.where(sweep == 0, 1.0, sweep), 0.0)
            for x in (before, beyond)
        )
    # Beyond its ends an arc goes on with the fractions below 0 and above 1; a line along its tangent.
    tangent = tangents_at(source, zero), tangents_at(source, one)
    start, end = points_at(source, -begin), points_at(source, 1 + finish)
    start = start + distance * _right(tangents_at(source, -begin))
    end = end + distance * _right(tangents_at(source, 1 + finish))
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
    """Outer corners so flat that the moved neighbours may simply run on until they meet."""
    overshoot = distance * turn**2 / 8
    # Along a curve they miss each other by the square of how far they run on.
    run_on = distance * np.abs(turn) / 2
    miss = (
        run_on**2 / 2 * (1 / np.maximum(radius_before, 1e-9) + 1 / np.maximum(radius_after, 1e-9))
    )
    return np.asarray((turn > 0) & (turn < 0.5) & (overshoot <= mitre) & (miss <= _MISS))


def _right(direction: FloatArray) -> FloatArray:
    return np.column_stack([direction[:, 1], -direction[:, 0]])


def _hopeful(
    candidates: Segments, label: IntArray, obstacles: Obstacles, distance: float
) -> BoolArray:
    """Candidates that may have room somewhere: along a curve the distance changes no faster than one moves."""
    middle = points_at(candidates, np.full(len(candidates), 0.5))
    half = candidates.length / 2
    short = np.flatnonzero(half < distance / 2)
    hopeful = np.ones(len(candidates), dtype=bool)
    if len(short):
        nearest = obstacles.nearest(middle[short], label[short], distance)
        hopeful[short] = nearest + half[short] > distance - _BEYOND[1]
    return hopeful


def _round_open_ends(source: Segments, following: IntArray, distance: float) -> Segments:
    """The circles about the ends of open chains, each as two arcs; ``owner`` is the source segment.

    The offset runs beside no circle, but it ends where it meets one.
    """
    last = np.flatnonzero(following < 0)
    begins = np.ones(len(source), dtype=bool)
    begins[following[following >= 0]] = False
    first = np.flatnonzero(begins)
    centre = np.concatenate([source.start[first], source.end[last]])
    owner = np.concatenate([first, last])
    across = np.array([distance, 0.0])
    right, left = centre + across, centre - across
    return make(
        np.concatenate([right, left]),
        np.concatenate([left, right]),
        np.ones(2 * len(centre)),
        np.concatenate([owner, owner]),
    )


def _pieces(
    candidates: Segments,
    label: IntArray,
    cutters: Segments | None = None,
    cutter_label: IntArray | None = None,
) -> tuple[IntArray, FloatArray, FloatArray]:
    """The candidates cut at each other and at the cutters.

    Returns the row of each piece, and the fractions at which it begins and ends.
    """
    count = len(candidates)
    if cutters is not None and cutter_label is not None:
        label = np.concatenate([label, cutter_label])
        fields = Segments.__struct_fields__
        columns = [(getattr(candidates, name), getattr(cutters, name)) for name in fields]
        candidates = Segments(*map(np.concatenate, columns))
    one, two = near_pairs(candidates, label)
    # Where they merely follow each other they have both ends already.
    apart = ~only_at_ends(candidates, one, two) & (np.minimum(one, two) < count)
    rows, fractions = cuts(candidates, one[apart], two[apart])
    inside = rows < count
    rows, fractions = rows[inside], fractions[inside]
    every = np.arange(count)
    row = np.concatenate([every, every, rows])
    at = np.concatenate([np.zeros(count), np.ones(count), fractions])
    same = _SAME_CUT / np.maximum(candidates.length[:count], _SAME_CUT)
    at = np.where(at < same[row], 0.0, np.where(at > 1 - same[row], 1.0, at))
    order = np.lexsort((at, row))
    row, at = row[order], at[order]
    piece = (row[1:] == row[:-1]) & (at[1:] - at[:-1] > same[row[1:]])
    # Where cuts lie closer than one, the piece before them must still end where the next begins.
    first = starts_run(row)
    first[1:] |= piece
    row, at = row[first], at[first]
    inner = row[1:] == row[:-1]
    return row[:-1][inner], at[:-1][inner], at[1:][inner]


def _has_room(
    chosen: Segments,
    low: FloatArray,
    high: FloatArray,
    label: IntArray,
    obstacles: Obstacles,
    distance: float,
) -> BoolArray:
    """Pieces that lie at the distance: a step beyond their middle nothing of the source is nearer than that."""
    middle = (low + high) / 2
    step = np.clip(0.001 * chosen.length * (high - low), *_BEYOND)
    points = points_at(chosen, middle)
    beyond = points + step[:, None] * _right(tangents_at(chosen, middle))
    near = obstacles.nearer_than(points, label, np.full(len(label), distance - _NOISE))
    return ~(near | obstacles.nearer_than(beyond, label, distance + step / 2))
