"""Loops that cross themselves by a slip, as loops that only touch themselves.

Where an arc comes back on the segment before it, the two often cross once more a little later: the tip of the corner is
a loop of its own, as thin as a hair, that runs the other way round. At a crossing the loop is parted in two that meet
there. What lies beside the larger one on the side of the part is no border of it; what lies on the other side is a tip
of the part, and is turned round so that it has the part on the same hand.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from msgspec import Struct

from camgen.geometry.intersect import crossings, near_pairs, only_at_ends
from camgen.geometry.nesting import loop_areas
from camgen.geometry.ragged import ends_run, run_starts
from camgen.geometry.segments import BoolArray, IntArray, Segments, backwards, split, tangents_at
from camgen.geometry.vectors import turns
from camgen.model.pose import FloatArray

#: Nearer than this (mm) to the end of a segment nothing is told from the end.
LEAST_SLIP = 1e-5


class _Pieces(Struct, frozen=True, eq=False):
    """A loop cut at its crossings. following: (N,) the piece that comes after each, at a crossing the other curve's.
    meet: (C, 2) the pieces that arrive at each crossing, of the first curve and of the second.
    """

    segments: Segments
    following: IntArray
    meet: IntArray


def find_slips(segments: Segments, following: IntArray, count: int) -> BoolArray:
    """(count,): which owners have a segment that crosses the one after it again, beside their corner."""
    one = np.flatnonzero(following >= 0)
    two = following[one]
    curved = segments.is_arc[one] | segments.is_arc[two]
    one, two = one[curved], two[curved]
    again = ~only_at_ends(segments, one, two)
    one, two = one[again], two[again]
    k, first, second = crossings(segments, one, two)
    inner = _inner(segments, one[k], first) & _inner(segments, two[k], second)
    result = np.zeros(count, dtype=bool)
    result[segments.owner[one[k[inner]]]] = True
    return result


def _inner(segments: Segments, row: IntArray, fraction: FloatArray) -> BoolArray:
    """(N,): whether a place on a row lies off its ends."""
    length = segments.length[row]
    return np.asarray((fraction * length > LEAST_SLIP) & ((1 - fraction) * length > LEAST_SLIP))


def uncross(
    segments: Segments, following: IntArray, chosen: BoolArray
) -> tuple[Segments, IntArray]:
    """``segments`` with the ``chosen`` loops (per owner) uncrossed, the part on their left, and the following ones.

    The other owners stay as they are, rows and all.
    """
    rows = np.flatnonzero(chosen[segments.owner] & (following >= 0))
    pair, first, second = _slips(segments, rows)
    if not len(pair):
        return segments, following
    crossing = np.unique(segments.owner[pair[:, 0]])
    rest = np.flatnonzero(~np.isin(segments.owner, crossing))
    new = np.full(len(segments), -1)
    new[rest] = np.arange(len(rest))
    after = following[rest]
    tables, links = [segments.take(rest)], [np.where(after >= 0, new[after], -1)]
    size = len(rest)
    for owner in crossing.tolist():
        own = segments.owner[pair[:, 0]] == owner
        pieces = _cut(segments, following, owner, pair[own], first[own], second[own])
        for loop in _loops(pieces):
            tables.append(loop)
            links.append(size + np.roll(np.arange(len(loop)), -1))
            size += len(loop)
    columns = (
        np.concatenate([getattr(t, name) for t in tables]) for name in Segments.__struct_fields__
    )
    return Segments(*columns), np.concatenate(links)


def _slips(segments: Segments, rows: IntArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Crossings of ``rows`` of one owner: pairs of rows (C, 2), and the fraction of each of the two."""
    table = segments.take(rows)
    if not len(rows):
        return np.zeros((0, 2), dtype=np.int64), np.zeros(0), np.zeros(0)
    i, j = near_pairs(table, table.owner)
    k, first, second = crossings(table, i, j)
    inner = _inner(table, i[k], first) & _inner(table, j[k], second)
    # Two that are one are a touch.
    along = first * table.length[i[k]]
    order = np.lexsort((along, k))
    twice = (np.diff(k[order]) == 0) & (np.diff(along[order]) < LEAST_SLIP)
    inner[order[:-1][twice]] = inner[order[1:][twice]] = False
    return rows[np.column_stack([i[k], j[k]])[inner]], first[inner], second[inner]


def _cut(
    segments: Segments,
    following: IntArray,
    owner: int,
    pair: IntArray,
    first: FloatArray,
    second: FloatArray,
) -> _Pieces:
    """The loop of ``owner`` cut at its crossings ``pair`` (C, 2) of rows, led on from one curve to the other there."""
    rows = np.flatnonzero(segments.owner == owner)
    count = len(pair)
    row = np.concatenate([rows, pair[:, 0], pair[:, 1]])
    low = np.concatenate([np.zeros(len(rows)), first, second])
    order = np.lexsort((low, row))
    row, low = row[order], low[order]
    last = ends_run(row)
    high = np.where(last, 1.0, np.append(low[1:], 1.0))
    begin = run_starts(row)
    after = np.where(last, begin[np.searchsorted(rows, following[row])], np.arange(len(row)) + 1)
    leaving = np.empty(len(order), dtype=np.int64)
    leaving[order] = np.arange(len(order))
    out_first, out_second = leaving[len(rows) : len(rows) + count], leaving[len(rows) + count :]
    after[out_first - 1], after[out_second - 1] = out_second, out_first
    return _Pieces(
        split(segments, row, low, high), after, np.column_stack([out_first - 1, out_second - 1])
    )


def _loops(pieces: _Pieces) -> Iterable[Segments]:
    """The loops that a cut one is made of, those left out that lie in the part."""
    rounds = _rounds(pieces.following)
    tables = [pieces.segments.take(np.array(rows)) for rows in rounds]
    areas = [float(np.abs(loop_areas(_alone(table), 1))[0]) for table in tables]
    hand = _hands(pieces, rounds, int(np.argmax(areas)))
    return [
        backwards(table)[0] if hand[n] < 0 else table for n, table in enumerate(tables) if hand[n]
    ]


def _alone(table: Segments) -> Segments:
    return Segments(
        table.start, table.end, table.bulge, table.centre, table.radius, np.zeros_like(table.owner)
    )


def _rounds(following: IntArray) -> list[list[int]]:
    """The pieces of each loop in running order."""
    seen: set[int] = set()
    found = []
    for begin in range(len(following)):
        rows, here = [], begin
        while here not in seen:
            seen.add(here)
            rows.append(here)
            here = int(following[here])
        found += [rows] if rows else []
    return found


def _hands(pieces: _Pieces, rounds: list[list[int]], largest: int) -> list[int]:
    """Of each loop 1 where it stays, -1 where it is turned round, 0 where it is no border; the largest one stays."""
    arrives = tangents_at(pieces.segments, np.ones(len(pieces.segments)))
    leaves = tangents_at(pieces.segments, np.zeros(len(pieces.segments)))
    loop = {row: n for n, rows in enumerate(rounds) for row in rows}
    hand = [0] * len(rounds)
    hand[largest] = 1
    reached = [largest]
    for here in reached:
        for first, second in pieces.meet.tolist():
            for mine, other in ((first, second), (second, first)):
                there = loop[other]
                if loop[mine] != here or there in reached:
                    continue
                # Straight on the way leads into the other loop: on the right where the corner turns left.
                turn = turns(arrives[[mine]], leaves[pieces.following[[mine]]])[0]
                hand[there] = -hand[here] if turn * hand[here] > 0 else 0
                reached.append(there)
    return hand
