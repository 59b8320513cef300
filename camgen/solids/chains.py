"""Sharp sides of triangles put end to end: as long as just two of one kind meet, and turn only a little."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.pose import FloatArray
from camgen.solid import BoolArray, IntArray
from camgen.solids.sharp import Segments

#: A turn above this (rad) is a corner of the part: the sides of a circle drawn with 9 or more turn less.
CORNER = float(np.radians(41.0))


class Chains(Struct, frozen=True, eq=False):
    """segments: in running order, chain after chain. first: (K + 1,) where each chain begins in them. closed: (K,)."""

    segments: Segments
    first: IntArray
    closed: BoolArray


def chained(segments: Segments, vertices: FloatArray) -> Chains:
    """All ``segments`` in chains. Which way a chain runs and where a closed one begins depends on places alone."""
    rank = np.empty(len(vertices), dtype=np.int64)
    rank[np.lexsort(vertices.T[::-1])] = np.arange(len(vertices))
    segments = segments.turned(rank[segments.start] > rank[segments.end])
    order, turned, first, closed = _runs(_mates(segments, vertices), _seeds(segments, rank))
    return Chains(segments.take(order).turned(turned), first, closed)


def _seeds(segments: Segments, rank: IntArray) -> IntArray:
    """(M,) the segments by where they start, then where they end: the order in which chains are begun."""
    return np.lexsort((rank[segments.end], rank[segments.start]))


def _mates(segments: Segments, vertices: FloatArray) -> IntArray:
    """(2 M,) the end that each end of a segment goes on with, -1 if the chain ends there.

    End 2 s is the start of segment s, 2 s + 1 its end.
    """
    count = len(segments)
    mates = np.full(2 * count, -1)
    at = np.column_stack([segments.start, segments.end]).reshape(-1)
    order = np.argsort(at, kind="stable")
    new = np.flatnonzero(np.append(True, at[order][1:] != at[order][:-1])) if count else np.zeros(0, np.int64)
    size = np.diff(np.append(new, 2 * count))
    a, b = order[new[size == 2]], order[new[size == 2] + 1]
    along = vertices[segments.end] - vertices[segments.start]
    along /= np.linalg.norm(along, axis=1)[:, None]
    into = along[a // 2] * np.where(a % 2, 1, -1)[:, None]
    out = along[b // 2] * np.where(b % 2, -1, 1)[:, None]
    smooth = (into * out).sum(axis=1) > np.cos(CORNER)
    smooth &= segments.convex[a // 2] == segments.convex[b // 2]
    mates[a[smooth]], mates[b[smooth]] = b[smooth], a[smooth]
    return mates


def _runs(mates: IntArray, seeds: IntArray) -> tuple[IntArray, BoolArray, IntArray, BoolArray]:
    """The segments in running order, which of them run backwards, where each chain begins, and whether it is closed.

    An open chain is begun at the first of its two ends in the order of ``seeds``, a closed one at its first segment.
    """
    mate, seed = mates.tolist(), seeds.tolist()
    seen = [False] * len(seed)
    order: list[int] = []
    turned: list[bool] = []
    first: list[int] = []
    closed: list[bool] = []
    free = [2 * s + e for s in seed for e in (0, 1) if mate[2 * s + e] < 0]
    for begin in free + [2 * s for s in seed]:
        if seen[begin // 2]:
            continue
        first.append(len(order))
        here = begin
        while here >= 0 and not seen[here // 2]:
            seen[here // 2] = True
            order.append(here // 2)
            turned.append(here % 2 == 1)
            here = mate[here ^ 1]
        closed.append(here == begin)
    first.append(len(order))
    return (
        np.array(order, dtype=np.int64), np.array(turned, dtype=bool), np.array(first, dtype=np.int64),
        np.array(closed, dtype=bool),
    )  # fmt: skip
