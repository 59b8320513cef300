"""Joining pieces of curves end to end into chains."""

from __future__ import annotations

from collections import deque
from itertools import pairwise

import numpy as np
import shapely
from msgspec import Struct

from camgen.geometry.intersect import FEW
from camgen.geometry.ragged import matches, ramp
from camgen.geometry.segments import BoolArray, IntArray, Segments, points_at
from camgen.model.pose import FloatArray

#: Ends nearer than this (mm) meet: ten times what the cuts of nearly tangent curves can be off.
_MEET = 2e-4
#: Where curves are nearly tangent, their crossing leaves pieces shorter than this (mm), of which some lead nowhere.
_TAIL = 0.05
#: So many short pieces are looked through for the way to a long one.
_WIDEST = 64
#: A loop shorter than this (mm), or thinner than a thousandth of it, is the sliver between two curves that touch.
_SLIVER = 2e-3


class Chains(Struct, frozen=True, eq=False):
    """Pieces in running order. row, low, high: (N,) as given, pieces of one candidate that follow each other united.

    owner: (N,) the chain. closed: (chains,). last_of: (chains,) the last piece of each.
    """

    row: IntArray
    low: FloatArray
    high: FloatArray
    owner: IntArray
    closed: BoolArray
    last_of: IntArray


def stitch(
    candidates: Segments, row: IntArray, low: FloatArray, high: FloatArray, label: IntArray
) -> Chains:
    """Chains of the pieces ``candidates[row]`` from fraction low to high; only pieces of one label are joined."""
    chosen = candidates.take(row)
    start, end = points_at(chosen, low), points_at(chosen, high)
    length = chosen.length * (high - low)
    ends, starts = _meetings(start, end, label)
    alive, ends, starts = _without_tails(length, ends, starts)
    following = _following(start, end, row, length, ends, starts)
    order, first, closed = _runs(following, alive)
    owner = np.repeat(np.arange(len(first)), np.diff(np.append(first, len(order))))
    sweep = chosen.sweep * (high - low)
    keep = ~_slivers(start[order], end[order], length[order], sweep[order], owner, closed)
    order, owner = order[keep[owner]], np.cumsum(keep)[owner[keep[owner]]] - 1
    return _unite(row[order], low[order], high[order], owner, closed[keep])


def _meetings(start: FloatArray, end: FloatArray, label: IntArray) -> tuple[IntArray, IntArray]:
    """Pairs of pieces of one label, the second of which begins where the first ends."""
    few, many = matches(label, label, FEW)
    found = [(many[:0], many[:0])]
    for ends, starts in few:
        gap = end.take(ends, axis=0) - start.take(starts, axis=0)
        near = np.hypot(gap[:, 0], gap[:, 1]) <= _MEET
        found.append((ends[near], starts[near]))
    if len(many):
        tree = shapely.STRtree(shapely.points(start[many]))
        ends, starts = tree.query(shapely.points(end[many]), predicate="dwithin", distance=_MEET)
        ends, starts = many[ends], many[starts]
        near = label[ends] == label[starts]
        found.append((ends[near], starts[near]))
    return np.concatenate([one for one, _ in found]), np.concatenate([two for _, two in found])


def _without_tails(
    length: FloatArray, ends: IntArray, starts: IntArray
) -> tuple[BoolArray, IntArray, IntArray]:
    """Which pieces remain, and their meetings, without short ones that come from nowhere or lead nowhere."""
    count = len(length)
    alive = np.ones(count, dtype=bool)
    while True:
        linked = (np.bincount(ends, minlength=count) > 0) & (
            np.bincount(starts, minlength=count) > 0
        )
        tails = alive & ~linked & (length < _TAIL)
        if not tails.any():
            return alive, ends, starts
        alive &= ~tails
        kept = alive[ends] & alive[starts]
        ends, starts = ends[kept], starts[kept]


def _following(
    start: FloatArray,
    end: FloatArray,
    row: IntArray,
    length: FloatArray,
    ends: IntArray,
    starts: IntArray,
) -> IntArray:
    """(N,) the piece that begins where each ends, -1 if none. A start is used once.

    Where several meet, a long piece is led to a long one first, through short ones if need be: what nearly tangent
    curves leave beside their crossing must not use up the way of the others. Then the same curve is preferred, then
    the nearest.
    """
    following = np.full(len(start), -1)
    gap = np.hypot(*(end[ends] - start[starts]).T)
    order = np.lexsort((starts, np.round(gap, 9), row[ends] != row[starts]))
    ends, starts = ends[order], starts[order]
    lonely = (np.bincount(ends, minlength=len(end)) == 1)[ends]
    lonely &= (np.bincount(starts, minlength=len(start)) == 1)[starts]
    short = length < _TAIL
    sure = lonely & ~short[ends] & ~short[starts]
    following[ends[sure]] = starts[sure]
    options: dict[int, list[int]] = {}
    for e, s in zip(ends[~sure].tolist(), starts[~sure].tolist(), strict=True):
        options.setdefault(e, []).append(s)
    is_short, taken, used = short.tolist(), set(starts[sure].tolist()), set[int]()
    for e in sorted(options, key=lambda piece: (is_short[piece], piece)):
        if e in used:
            continue
        way = _way(e, options, is_short, taken)
        for here, there in pairwise([e, *way]):
            following[here] = there
            taken.add(there)
            used.add(here)
    return following


def _way(
    begin: int, options: dict[int, list[int]], is_short: list[bool], taken: set[int]
) -> list[int]:
    """The fewest pieces from the end of ``begin`` to a long one that is free, or to any that is free; the last of them
    is the one to go on with. Empty if there is none.
    """
    came: dict[int, int] = {}
    queue = deque([begin])
    while queue:
        here = queue.popleft()
        for there in options.get(here, []):
            if there in came or there in taken:
                continue
            came[there] = here
            if not is_short[there] or (is_short[begin] and there == begin):
                way = [there]
                while came[way[0]] != begin:
                    way.insert(0, came[way[0]])
                return way
            if len(came) < _WIDEST:
                queue.append(there)
    return [next(iter(came))] if came else []


def _runs(following: IntArray, alive: BoolArray) -> tuple[IntArray, IntArray, BoolArray]:
    """The pieces that are ``alive`` in running order, where each chain begins in it, and whether it is closed."""
    successor = following.tolist()
    begins = np.ones(len(following), dtype=bool)
    begins[following[following >= 0]] = False
    seen = (~alive).tolist()
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
    return (
        np.array(order, dtype=np.int64),
        np.array(first, dtype=np.int64),
        np.array(closed, dtype=bool),
    )


def _slivers(
    start: FloatArray,
    end: FloatArray,
    length: FloatArray,
    sweep: FloatArray,
    owner: IntArray,
    closed: BoolArray,
) -> BoolArray:
    """(chains,) true for chains that are no more than rounding. sweep: (N,) rad of arcs, 0 for lines."""
    count = len(closed)
    total = np.bincount(owner, length, count)
    # The area of the polygon of the ends, about each chain's first point, and of the segments of circle beside it.
    origin = start[np.searchsorted(owner, np.arange(count))] if count else start
    a, b = start - origin[owner], end - origin[owner]
    radius = length / np.where(sweep == 0.0, 1.0, np.abs(sweep))
    doubled = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] + radius**2 * (sweep - np.sin(sweep))
    area = np.abs(np.bincount(owner, doubled, count)) / 2
    few = np.bincount(owner, minlength=count) <= 3
    thin = closed & few & (area < 0.5e-3 * _SLIVER * total) & (total < 1.0)
    return np.asarray((total < _SLIVER) | thin | (~closed & (total < _TAIL)))


def _unite(
    row: IntArray, low: FloatArray, high: FloatArray, owner: IntArray, closed: BoolArray
) -> Chains:
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
    place = ramp(last - begin + 1)
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
