"""Joining pieces of curves end to end into chains."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from camgen.geometry.segments import BoolArray, IntArray, Segments, points_at
from camgen.pose import FloatArray

#: Ends nearer than this (mm) meet: ten times what the cuts of nearly tangent curves can be off.
_MEET = 2e-4
#: A loop shorter than this (mm), or thinner than a thousandth of it, is the sliver between two curves that touch.
_SLIVER = 2e-3


@dataclass(frozen=True, slots=True, eq=False)
class Chains:
    """Pieces in running order. row, low, high: (N,) as given, pieces of one candidate that follow each other united.

    owner: (N,) the chain. closed: (chains,). last_of: (chains,) the last piece of each.
    """

    row: IntArray
    low: FloatArray
    high: FloatArray
    owner: IntArray
    closed: BoolArray
    last_of: IntArray


def stitch(candidates: Segments, row: IntArray, low: FloatArray, high: FloatArray, label: IntArray) -> Chains:
    """Chains of the pieces ``candidates[row]`` from fraction low to high; only pieces of one label are joined."""
    chosen = candidates.take(row)
    start, end = points_at(chosen, low), points_at(chosen, high)
    following = _following(start, end, row, label)
    order, first, closed = _runs(following)
    owner = np.repeat(np.arange(len(first)), np.diff(np.append(first, len(order))))
    keep = ~_slivers(start[order], end[order], chosen.take(order).length * (high - low)[order], owner, closed)
    order, owner = order[keep[owner]], np.cumsum(keep)[owner[keep[owner]]] - 1
    return _united(row[order], low[order], high[order], owner, closed[keep])


def _following(start: FloatArray, end: FloatArray, row: IntArray, label: IntArray) -> IntArray:
    """(N,) the piece that begins where each ends, -1 if none. A start is used once; the nearest has precedence."""
    following = np.full(len(start), -1)
    if not len(start):
        return following
    tree = shapely.STRtree(shapely.points(start))
    ends, starts = tree.query(shapely.points(end), predicate="dwithin", distance=_MEET)
    same = label[ends] == label[starts]
    ends, starts = ends[same], starts[same]
    gap = np.hypot(*(end[ends] - start[starts]).T)
    # Of several at one place the piece that continues the same curve comes first, then the nearest.
    order = np.lexsort((starts, np.round(gap, 9), row[ends] != row[starts]))
    ends, starts = ends[order], starts[order]
    lonely = (np.bincount(ends, minlength=len(end)) == 1)[ends] & (np.bincount(starts, minlength=len(start)) == 1)[
        starts
    ]
    following[ends[lonely]] = starts[lonely]
    taken = np.zeros(len(start), dtype=bool)
    for e, s in zip(ends[~lonely].tolist(), starts[~lonely].tolist(), strict=True):
        if following[e] < 0 and not taken[s]:
            following[e] = s
            taken[s] = True
    return following


def _runs(following: IntArray) -> tuple[IntArray, IntArray, BoolArray]:
    """Pieces in running order, where each chain begins in it, and whether it is closed."""
    successor = following.tolist()
    begins = np.ones(len(following), dtype=bool)
    begins[following[following >= 0]] = False
    seen = [False] * len(successor)
    order: list[int] = []
    first: list[int] = []
    closed: list[bool] = []
    for begin in np.flatnonzero(begins).tolist() + list(range(len(successor))):
        if seen[begin]:
            continue
        first.append(len(order))
        here = begin
        while here >= 0 and not seen[here]:
            seen[here] = True
            order.append(here)
            here = successor[here]
        closed.append(here == begin)
    return np.array(order, dtype=np.int64), np.array(first, dtype=np.int64), np.array(closed, dtype=bool)


def _slivers(start: FloatArray, end: FloatArray, length: FloatArray, owner: IntArray, closed: BoolArray) -> BoolArray:
    """(chains,) true for chains that are no more than rounding."""
    count = len(closed)
    total = np.bincount(owner, length, count)
    # Twice the area of the polygon of the ends, about each chain's first point.
    origin = start[np.searchsorted(owner, np.arange(count))] if count else start
    a, b = start - origin[owner], end - origin[owner]
    area = np.abs(np.bincount(owner, a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], count))
    few = np.bincount(owner, minlength=count) <= 3
    thin = closed & few & (area < 1e-3 * _SLIVER * total) & (total < 1.0)
    return np.asarray((total < _SLIVER) | thin)


def _united(row: IntArray, low: FloatArray, high: FloatArray, owner: IntArray, closed: BoolArray) -> Chains:
    """Neighbouring pieces of one candidate as one; a closed chain is turned so that none is cut at its seam."""
    count = len(row)
    if not count:
        return Chains(row, low, high, owner, closed, np.zeros(0, dtype=np.int64))
    begin = np.searchsorted(owner, np.arange(len(closed)))
    last = np.append(begin[1:], count) - 1
    previous = np.arange(-1, count - 1)
    previous[begin] = np.where(closed, last, -1)
    joined = (
        (previous >= 0)
        & (row == row[previous])
        & (np.abs(low - high[previous]) < 1e-12)
        & (previous != np.arange(count))
    )
    # Turn each closed chain so that it begins where nothing is joined.
    place = np.arange(count) - begin[owner]
    size = (last - begin + 1)[owner]
    free = np.where(joined, count, place)
    turn = np.minimum.reduceat(free, begin)
    turn = np.where((turn < count) & closed, turn, 0)
    order = begin[owner] + (place + turn[owner]) % size
    row, low, high, joined = row[order], low[order], high[order], joined[order]
    joined[begin] = False
    head = np.flatnonzero(~joined)
    tail = np.append(head[1:], count) - 1
    owner = owner[head]
    last_of = np.append(np.flatnonzero(owner[1:] != owner[:-1]), len(owner) - 1)
    return Chains(row[head], low[head], high[tail], owner, closed, last_of)
