"""Chains of drawn pieces: which pieces follow each other, and how their ends are made to meet."""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.pose import FloatArray
from camgen.readers.pieces import BoolArray, IntArray, Soup, ramp


class Joints(Struct, frozen=True):
    """Gaps that were closed, the largest in mm, and contours made of several layers."""

    count: int
    largest: float
    mixed: int


def chained(partner: list[int], closed: list[bool]) -> tuple[list[list[int]], list[bool]]:
    """Chains of the ends at which each piece is entered, and whether they close; in order of their first pieces."""
    count = len(closed)
    seen = [False] * count

    def follow(end: int) -> list[int]:
        chain = []
        while end >= 0 and not seen[end >> 1]:
            seen[end >> 1] = True
            chain.append(end)
            end = partner[end ^ 1]
        return chain

    found: list[tuple[int, list[int], bool]] = []
    for end in range(2 * count):
        if partner[end] < 0 and not seen[end >> 1] and not closed[end >> 1]:
            chain = follow(end)
            first = min(chain, key=lambda e: e >> 1)
            if first & 1:
                chain = [e ^ 1 for e in reversed(chain)]
            found.append((first >> 1, chain, False))
    rest = (piece for piece in range(count) if not seen[piece])
    found += [(piece, [2 * piece] if closed[piece] else follow(2 * piece), True) for piece in rest]
    found.sort(key=lambda item: item[0])
    return [chain for _, chain, _ in found], [loop for _, _, loop in found]


def assembled(soup: Soup, chains: list[list[int]], closed: list[bool], same: float) -> tuple[Soup, Joints]:
    """The chains as pieces; where ends do not coincide a line gives way, two arcs get a short line between them."""
    sizes = np.array([len(c) for c in chains], dtype=np.intp)
    entered = np.array([e for c in chains for e in c], dtype=np.intp)
    piece, backwards = entered >> 1, (entered & 1).astype(np.bool_)
    counts = np.diff(soup.first)[piece]
    step = np.repeat(np.where(backwards, -1, 1), counts)
    base = np.where(backwards, soup.first[1:][piece] - 1, soup.first[:-1][piece])
    rows = np.repeat(base, counts) + step * ramp(counts)
    points = soup.points[rows]
    bulges = np.where(step < 0, -soup.bulges[rows - 1], soup.bulges[rows])
    whole = soup.closed[piece]
    last = np.cumsum(counts) - 1
    bulges[last[~whole]] = 0.0
    start = last - counts + 1
    loop = np.array(closed, dtype=np.bool_)
    ends = np.cumsum(sizes)
    follower = np.arange(1, len(piece) + 1)
    follower[ends - 1] = ends - sizes
    meets = ~whole
    meets[ends - 1] &= loop
    keep, gaps = _meet(points, bulges, last[meets], start[follower[meets]], same)
    chain_of_row = np.repeat(np.repeat(np.arange(len(chains)), sizes), counts)
    heads = piece[ends - sizes]
    layers = soup.layer[piece]
    strange = np.repeat(np.arange(len(chains)), sizes)[layers != np.repeat(soup.layer[heads], sizes)]
    length = np.bincount(chain_of_row[keep], minlength=len(chains))
    made = replace(
        soup,
        points=points[keep],
        bulges=bulges[keep] + 0.0,  # no minus zero
        first=np.concatenate([[0], np.cumsum(length)]),
        closed=loop,
        layer=soup.layer[heads],
        kind=soup.kind[heads],
    )
    wide = gaps[gaps > same]
    return made, Joints(len(wide), float(wide.max(initial=0.0)), len(np.unique(strange)))


def _meet(
    points: FloatArray, bulges: FloatArray, a: IntArray, b: IntArray, same: float
) -> tuple[BoolArray, FloatArray]:
    """Let row ``a``, the end of a piece, meet row ``b``, the start of the next; which rows remain, and the gaps.

    Two lines meet half-way; a line moves to the end of an arc; between two arcs both points stay.
    """
    gaps = np.hypot(*(points[a] - points[b]).T)
    arc_before, arc_after = bulges[a - 1] != 0, bulges[b] != 0
    goal = np.where(arc_before[:, None], points[a], points[b])
    goal = np.where((arc_before == arc_after)[:, None], (points[a] + points[b]) / 2, goal)
    bridged = arc_before & arc_after & (gaps > same)
    exact = gaps <= same
    goal[exact] = points[b][exact]
    points[b[~bridged]] = goal[~bridged]
    keep = np.ones(len(points), dtype=np.bool_)
    keep[a[~bridged]] = False
    return keep, gaps
