"""Joins pieces of curves end to end into chains."""

from __future__ import annotations

import itertools
from collections import deque

import numpy as np
import shapely
from msgspec import Struct

from camgen.geometry.intersect import FEW
from camgen.geometry.ragged import (
    compute_offsets,
    concatenate_columns,
    count_rows,
    find_equal_pairs,
    list_chains,
    list_owners,
    number_rows,
)
from camgen.geometry.segments import BoolArray, IntArray, Segments, measure_triangles, points_at
from camgen.model.pose import FloatArray

#: mm: ends nearer than this meet. It is ten times the error of cuts of nearly tangent curves.
_MEET = 2e-4
#: mm: where curves are nearly tangent, their crossing leaves pieces shorter than this. Some of them
#: lead nowhere.
_TAIL = 0.05
#: Short pieces that are searched for a connection to a long one, at most.
_MAX_SEARCHED = 64
#: mm: a chain shorter than this, or a short loop thinner than a thousandth of it, is the sliver
#: between two curves that touch.
_SLIVER = 2e-3
#: mm: length up to which a thin loop is a sliver.
_SLIVER_LENGTH = 1.0
#: Fraction of a segment below which pieces of it follow each other without a gap.
_SAME_FRACTION = 1e-12


class Chains(Struct, frozen=True, eq=False):
    """Pieces in running order; neighbouring pieces of one candidate are one piece.

    row: (N,) the candidate of each piece.
    low, high: (N,) fractions of the candidate at which the piece begins and ends.
    owner: (N,) the chain.
    closed: (chains,) whether the last piece of the chain is followed by its first.
    """

    row: IntArray
    low: FloatArray
    high: FloatArray
    owner: IntArray
    closed: BoolArray


def stitch_pieces(
    candidates: Segments, row: IntArray, low: FloatArray, high: FloatArray, label: IntArray
) -> Chains:
    """Chains of the pieces of `candidates[row]` from fraction `low` to `high`, each (N,).

    Only pieces with the same `label` (N,) are joined.
    """
    chosen = candidates.take(row)
    start, end = points_at(chosen, low), points_at(chosen, high)
    length = chosen.length * (high - low)
    ends, starts = _find_meetings(start, end, label)
    alive, ends, starts = _remove_tails(length, ends, starts)
    following = _find_following(start, end, row, length, ends, starts)
    order, owner, closed = _order_chains(following, alive)
    sweep = chosen.sweep * (high - low)
    keep = ~_find_slivers(start[order], end[order], length[order], sweep[order], owner, closed)
    order, owner = order[keep[owner]], np.cumsum(keep)[owner[keep[owner]]] - 1
    return _merge_pieces(row[order], low[order], high[order], owner, closed[keep])


def _find_meetings(
    start: FloatArray, end: FloatArray, label: IntArray
) -> tuple[IntArray, IntArray]:
    """Pairs of pieces of one label of which the second begins where the first ends."""
    small_groups, large = find_equal_pairs(label, label, FEW)
    meetings = [(large[:0], large[:0])]
    for ends, starts in small_groups:
        gap = end.take(ends, axis=0) - start.take(starts, axis=0)
        near = np.hypot(gap[:, 0], gap[:, 1]) <= _MEET
        meetings.append((ends[near], starts[near]))
    if len(large):
        tree = shapely.STRtree(shapely.points(start[large]))
        ends, starts = tree.query(shapely.points(end[large]), predicate="dwithin", distance=_MEET)
        ends, starts = large[ends], large[starts]
        near = label[ends] == label[starts]
        meetings.append((ends[near], starts[near]))
    ends, starts = concatenate_columns(meetings)
    return ends, starts


def _remove_tails(
    length: FloatArray, ends: IntArray, starts: IntArray
) -> tuple[BoolArray, IntArray, IntArray]:
    """Removes short pieces that have a free end, until no such piece is left.

    Returns whether each piece remains (N,), and the meetings that remain.
    """
    count = len(length)
    alive = np.ones(count, dtype=bool)
    while True:
        has_next = np.bincount(ends, minlength=count) > 0
        has_previous = np.bincount(starts, minlength=count) > 0
        tails = alive & ~(has_next & has_previous) & (length < _TAIL)
        if not tails.any():
            return alive, ends, starts
        alive &= ~tails
        kept = alive[ends] & alive[starts]
        ends, starts = ends[kept], starts[kept]


def _find_following(
    start: FloatArray,
    end: FloatArray,
    row: IntArray,
    length: FloatArray,
    ends: IntArray,
    starts: IntArray,
) -> IntArray:
    """(N,) the piece that follows each, -1 if none does. A piece follows one other at most.

    If several meet, long pieces are linked to long ones first, through short ones if necessary: the
    short pieces that nearly tangent curves leave at their crossing must not use up the successors
    of others. Then a piece of the same candidate is preferred, then the nearest.

    ends, starts: meetings, as pairs of a piece that ends and one that starts.
    """
    following = np.full(len(start), -1)
    gap = np.hypot(*(end[ends] - start[starts]).T)
    order = np.lexsort((starts, np.round(gap, 9), row[ends] != row[starts]))
    ends, starts = ends[order], starts[order]
    is_only = (np.bincount(ends, minlength=len(end)) == 1)[ends]
    is_only &= (np.bincount(starts, minlength=len(start)) == 1)[starts]
    short = length < _TAIL
    is_clear = is_only & ~short[ends] & ~short[starts]
    following[ends[is_clear]] = starts[is_clear]
    options: dict[int, list[int]] = {}
    for piece, successor in zip(ends[~is_clear].tolist(), starts[~is_clear].tolist(), strict=True):
        options.setdefault(piece, []).append(successor)
    is_short, taken, linked = short.tolist(), set(starts[is_clear].tolist()), set[int]()
    for first in sorted(options, key=lambda piece: (is_short[piece], piece)):
        if first not in linked:
            connection = _find_connection(first, options, is_short, taken)
            for piece, successor in itertools.pairwise([first, *connection]):
                following[piece] = successor
                taken.add(successor)
                linked.add(piece)
    return following


def _find_connection(
    begin: int, options: dict[int, list[int]], is_short: list[bool], taken: set[int]
) -> list[int]:
    """The fewest pieces from the end of `begin` to a long piece, which is the last of them.

    Only pieces that are not in `taken` are used. Without a long piece, the result is the first free
    one, or empty. From a short piece a loop back to itself counts as well.

    options: the pieces that can follow each piece, best first.
    """
    previous_of: dict[int, int] = {}
    queue = deque([begin])
    while queue:
        piece = queue.popleft()
        for successor in options.get(piece, []):
            if successor in previous_of or successor in taken:
                continue
            previous_of[successor] = piece
            if not is_short[successor] or (is_short[begin] and successor == begin):
                connection = [successor]
                while previous_of[connection[0]] != begin:
                    connection.insert(0, previous_of[connection[0]])
                return connection
            if len(previous_of) < _MAX_SEARCHED:
                queue.append(successor)
    return [next(iter(previous_of))] if previous_of else []


def _order_chains(following: IntArray, alive: BoolArray) -> tuple[IntArray, IntArray, BoolArray]:
    """The pieces that are `alive` in running order.

    Returns them, the chain of each, and whether each chain is closed.
    """
    # A piece that is not alive is followed by none, and follows none.
    chains = [chain for chain in list_chains(following) if alive[chain[0]]]
    order = np.array(list(itertools.chain.from_iterable(chains)), dtype=np.int64)
    edges = compute_offsets(count_rows(chains))
    closed = following[order[edges[1:] - 1]] == order[edges[:-1]]
    return order, list_owners(np.diff(edges)), closed


def _find_slivers(
    start: FloatArray,
    end: FloatArray,
    length: FloatArray,
    sweep: FloatArray,
    owner: IntArray,
    closed: BoolArray,
) -> BoolArray:
    """(chains,) whether each chain is a sliver that exists by rounding alone.

    start, end: (N, 2) mm.
    length: (N,) mm.
    sweep: (N,) angle of arcs, rad, 0 for lines.
    owner: (N,) chain of each piece.
    """
    count = len(closed)
    total = np.bincount(owner, length, count)
    # Area of the polygon of the ends, and of the circle segments.
    radius = length / np.where(sweep == 0.0, 1.0, np.abs(sweep))
    doubled = measure_triangles(start, end, owner, count) + radius**2 * (sweep - np.sin(sweep))
    area = np.abs(np.bincount(owner, doubled, count)) / 2
    has_few = np.bincount(owner, minlength=count) <= 3
    is_thin = closed & has_few & (area < 0.5e-3 * _SLIVER * total) & (total < _SLIVER_LENGTH)
    return np.asarray((total < _SLIVER) | is_thin | (~closed & (total < _TAIL)))


def _merge_pieces(
    row: IntArray, low: FloatArray, high: FloatArray, owner: IntArray, closed: BoolArray
) -> Chains:
    """Merges neighbouring pieces of one candidate.

    A closed chain is rotated so that its seam does not divide a piece.
    """
    count = len(row)
    if not count:
        return Chains(row, low, high, owner, closed)
    begin = np.searchsorted(owner, np.arange(len(closed)))
    last = np.append(begin[1:], count) - 1
    previous = np.arange(-1, count - 1)
    previous[begin] = np.where(closed, last, -1)
    joined = (
        (previous >= 0)
        & (row == row[previous])
        & (np.abs(low - high[previous]) < _SAME_FRACTION)
        & (previous != np.arange(count))
    )
    # Rotate each closed chain so that its first piece is not joined to its last one.
    place = number_rows(last - begin + 1)
    size = (last - begin + 1)[owner]
    shift = np.minimum.reduceat(np.where(joined, count, place), begin)
    shift = np.where((shift < count) & closed, shift, 0)
    order = begin[owner] + (place + shift[owner]) % size
    row, low, high, joined = row[order], low[order], high[order], joined[order]
    joined[begin] = False
    head = np.flatnonzero(~joined)
    tail = np.append(head[1:], count) - 1
    return Chains(row[head], low[head], high[tail], owner[head], closed)
