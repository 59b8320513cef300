"""Repairs loops that cross themselves slightly, so that they only touch themselves.

Where an arc comes back to the segment before it, the two often cross once more a little later. The
tip of the corner is then a loop of its own, as thin as a hair and with the opposite sense. At a
crossing the loop is split into two loops that meet there. The larger one stays. What happens to the
other one depends on the side on which it lies:

- on the side of the part, it bounds nothing and is removed,
- on the other side, it is a tip of the part and is reversed, so that the part is on its left.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from msgspec import Struct

from camgen.geometry.intersect import find_crossings, find_near_pairs, only_at_ends
from camgen.geometry.nesting import measure_loop_areas
from camgen.geometry.ragged import find_run_starts, list_chains, mark_run_ends
from camgen.geometry.segments import (
    BoolArray,
    IntArray,
    Segments,
    concatenate,
    concatenate_chains,
    find_following,
    make_segments,
    reverse_segments,
    split_segments,
    tangents_at,
)
from camgen.geometry.vectors import measure_signed_angles
from camgen.model.pose import FloatArray

#: mm: a crossing nearer than this to the end of a segment counts as that end.
LEAST_SLIP = 1e-5
#: mm: shorter segments between longer ones are welded.
_SHORT_MM = 0.003


class _Pieces(Struct, frozen=True, eq=False):
    """A loop that is split at its crossings.

    segments: N pieces.
    following: (N,) the piece after each one. At a crossing it is a piece of the other curve.
    meet: (C, 2) the pieces that end at each crossing, of the first and of the second curve.
    """

    segments: Segments
    following: IntArray
    meet: IntArray


def weld_short(segments: Segments, closed: BoolArray) -> Segments:
    """The segments without the short ones that closed loops have alone: the one before is longer.

    Such a segment closes a loop whose last number was rounded, often backwards. An offset has then
    no side there.

    segments: sorted by owner.
    closed: (owners,) whether each one is closed.
    """
    following = find_following(segments, closed)
    is_short = (segments.length < _SHORT_MM) & (following >= 0)
    before = np.flatnonzero(is_short[following] & ~is_short & (following >= 0))
    row = following[before]
    before = before[~is_short[following[row]] & (following[following[row]] != before)]
    if not len(before):
        return segments
    end = segments.end.copy()
    end[before] = segments.end[following[before]]
    welded = make_segments(segments.start, end, segments.bulge, segments.owner)
    return welded.take(np.setdiff1d(np.arange(len(segments)), following[before]))


def find_slips(segments: Segments, following: IntArray, count: int) -> BoolArray:
    """(count,) the loops in which a segment crosses the next one again, apart from their corner.

    following: (N,) the segment after each one, -1 for none.
    count: number of loops.
    """
    first = np.flatnonzero(following >= 0)
    second = following[first]
    curved = segments.is_arc[first] | segments.is_arc[second]
    first, second = first[curved], second[curved]
    may_cross = ~only_at_ends(segments, first, second)
    first, second = first[may_cross], second[may_cross]
    pair, first_fraction, second_fraction = find_crossings(
        segments.take(first), segments.take(second)
    )
    inner = _are_inner(segments, first[pair], first_fraction)
    inner &= _are_inner(segments, second[pair], second_fraction)
    result = np.zeros(count, dtype=bool)
    result[segments.owner[first[pair[inner]]]] = True
    return result


def _are_inner(segments: Segments, row: IntArray, fraction: FloatArray) -> BoolArray:
    """(N,) whether the point at `fraction` of segment `row` is away from its ends."""
    length = segments.length[row]
    return np.asarray((fraction * length > LEAST_SLIP) & ((1 - fraction) * length > LEAST_SLIP))


def uncross_loops(
    segments: Segments, following: IntArray, chosen: BoolArray
) -> tuple[Segments, IntArray]:
    """`segments` with the chosen loops repaired, and the segment that follows each of them.

    segments: sorted by owner, as those that are returned.
    following: (N,) the segment after each one, -1 for none.
    chosen: per owner, whether the loop may be repaired; the part is on its left.
    """
    rows = np.flatnonzero(chosen[segments.owner] & (following >= 0))
    pair, first, second = _find_crossings(segments, rows)
    if not len(pair):
        return segments, following
    crossing = np.unique(segments.owner[pair[:, 0]])
    others = np.flatnonzero(~np.isin(segments.owner, crossing))
    new_row = np.full(len(segments), -1)
    new_row[others] = np.arange(len(others))
    after = following[others]
    tables, links = [segments.take(others)], [np.where(after >= 0, new_row[after], -1)]
    size = len(others)
    for owner in crossing.tolist():
        is_own = segments.owner[pair[:, 0]] == owner
        pieces = _split_loop(
            segments, following, owner, pair[is_own], first[is_own], second[is_own]
        )
        for loop in _make_loops(pieces):
            tables.append(loop)
            links.append(size + np.roll(np.arange(len(loop)), -1))
            size += len(loop)
    table = concatenate(tables)
    order = np.argsort(table.owner, kind="stable")
    place = np.empty(size, dtype=np.int64)
    place[order] = np.arange(size)
    after = np.concatenate(links)[order]
    return table.take(order), np.where(after >= 0, place[after], -1)


def _find_crossings(segments: Segments, rows: IntArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Crossings of `rows` with rows of the same owner.

    Returns pairs of rows (C, 2), and the fraction (C,) at which each of the two is crossed.
    """
    table = segments.take(rows)
    i, j = find_near_pairs(table, table.owner)
    pair, first, second = find_crossings(table.take(i), table.take(j))
    inner = _are_inner(table, i[pair], first) & _are_inner(table, j[pair], second)
    # Two crossings of a pair at one point are a touch.
    along = first * table.length[i[pair]]
    order = np.lexsort((along, pair))
    twice = (np.diff(pair[order]) == 0) & (np.diff(along[order]) < LEAST_SLIP)
    inner[order[:-1][twice]] = inner[order[1:][twice]] = False
    return rows[np.column_stack([i[pair], j[pair]])[inner]], first[inner], second[inner]


def _split_loop(
    segments: Segments,
    following: IntArray,
    owner: int,
    pair: IntArray,
    first: FloatArray,
    second: FloatArray,
) -> _Pieces:
    """The loop of `owner`, split at its crossings, where each curve continues on the other one.

    pair: (C, 2) rows of `segments` that cross.
    first, second: (C,) fraction at which each of the two rows is crossed.
    """
    rows = np.flatnonzero(segments.owner == owner)
    count = len(pair)
    row = np.concatenate([rows, pair[:, 0], pair[:, 1]])
    low = np.concatenate([np.zeros(len(rows)), first, second])
    order = np.lexsort((low, row))
    row, low = row[order], low[order]
    last = mark_run_ends(row)
    high = np.where(last, 1.0, np.append(low[1:], 1.0))
    begin = find_run_starts(row)
    after = np.where(last, begin[np.searchsorted(rows, following[row])], np.arange(len(row)) + 1)
    place_of = np.argsort(order)
    leaving_first = place_of[len(rows) : len(rows) + count]
    leaving_second = place_of[len(rows) + count :]
    after[leaving_first - 1], after[leaving_second - 1] = leaving_second, leaving_first
    meet = np.column_stack([leaving_first - 1, leaving_second - 1])
    return _Pieces(split_segments(segments, row, low, high), after, meet)


def _make_loops(pieces: _Pieces) -> Iterator[Segments]:
    """Yield the loops of which a split loop consists, without those that lie inside the part."""
    loops = list_chains(pieces.following)
    tables = [pieces.segments.take(np.array(rows)) for rows in loops]
    areas = np.abs(measure_loop_areas(concatenate_chains(tables), len(tables)))
    senses = _find_senses(pieces, loops, int(np.argmax(areas)))
    for table, sense in zip(tables, senses, strict=True):
        if sense:
            yield reverse_segments(table)[0] if sense < 0 else table


def _find_senses(pieces: _Pieces, loops: list[list[int]], largest: int) -> list[int]:
    """For each loop 1 if it stays, -1 if it is reversed, and 0 if it is removed.

    The loop `largest` stays. The others follow from it, crossing by crossing.
    """
    arrives = tangents_at(pieces.segments, np.ones(len(pieces.segments)))
    leaves = tangents_at(pieces.segments, np.zeros(len(pieces.segments)))
    loop_of: dict[int, int] = {}
    for number, rows in enumerate(loops):
        loop_of.update(dict.fromkeys(rows, number))
    senses = [0] * len(loops)
    senses[largest] = 1
    reached = [largest]
    for loop in reached:
        for first, second in pieces.meet.tolist():
            for arriving, other in ((first, second), (second, first)):
                neighbour = loop_of[other]
                if loop_of[arriving] != loop or neighbour in reached:
                    continue
                # Straight on, the curve enters the other loop: on the right if the corner turns
                # left.
                corner = arrives[[arriving]], leaves[pieces.following[[arriving]]]
                if measure_signed_angles(*corner)[0] * senses[loop] > 0:
                    senses[neighbour] = -senses[loop]
                reached.append(neighbour)
    return senses
