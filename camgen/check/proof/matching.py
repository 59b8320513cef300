"""Which piece of the drawing each motion runs along, and which parts of the drawing are covered.

The path of a motion says at which contours to look first, so that a drawing of a hundred thousand
contours needs no search. A place that is not right beside these is looked up among all pieces, by a
tree of their boxes.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise
from typing import TypeVar

import numpy as np
import shapely
from msgspec import Struct

from camgen.check.proof.pieces import (
    BLOCK,
    BoolArray,
    IntArray,
    Pieces,
    find_all_shares,
    find_feet,
    rows_of,
)
from camgen.model.pose import FloatArray

#: A path with more pairs of a point and a piece uses the tree.
_MOST_PAIRS = 1_000_000


class Nearest(Struct, frozen=True, eq=False):
    """The nearest pieces of N points.

    distance: (N,) mm, infinite if there are no pieces.
    piece: (N,) index of the piece, -1 if there are no pieces.
    side: (N,) 1 if the point is on its left, -1 on its right, 0 beside one of its ends.
    """

    distance: FloatArray
    piece: IntArray
    side: FloatArray

    def replace(self, rows: IntArray, others: Nearest) -> None:
        """Replaces the entries at `rows`; changes this value."""
        for name in self.__struct_fields__:
            getattr(self, name)[rows] = getattr(others, name)


class Ragged(Struct, frozen=True, eq=False):
    """Lists of piece indices, one list per path.

    rows: (L,) all lists, one after the other.
    first: (P,) place in `rows` at which each list begins.
    count: (P,) length of each list.
    """

    rows: IntArray
    first: IntArray
    count: IntArray


def list_pieces(pieces: Pieces, paths: int, path: IntArray, contour: IntArray) -> Ragged:
    """For each of `paths` paths the pieces of its contours.

    path, contour: (L,) pairs of a path and the index of a contour, in order of path.
    """
    sizes = np.bincount(pieces.owner)
    rows = join_ranges((np.cumsum(sizes) - sizes)[contour], sizes[contour])
    count = np.bincount(path, sizes[contour], paths).astype(np.intp)
    return Ragged(rows, np.cumsum(count) - count, count)


def join_ranges(first: IntArray, count: IntArray) -> IntArray:
    """The whole numbers from `first` on, `count` of them, of each range, one after the other."""
    total = np.cumsum(count)
    size = int(total[-1]) if len(total) else 0
    return np.arange(size) + np.repeat(first - total + count, count)


def find_nearest(points: FloatArray, path: IntArray, pieces: Pieces, lists: Ragged) -> Nearest:
    """The nearest piece of each of `points` (N, 2) among those of its `path` (N,)."""
    nearest = Nearest(
        np.full(len(points), np.inf),
        np.full(len(points), -1, np.intp),
        np.zeros(len(points)),
    )
    count = np.where(path >= 0, lists.count[path], 0) if len(lists.count) else 0 * path
    often = np.bincount(np.maximum(path, 0), minlength=max(len(lists.count), 1))
    chosen = np.flatnonzero((count > 0) & (often[np.maximum(path, 0)] * count <= _MOST_PAIRS))
    total = np.cumsum(count[chosen])
    blocks = np.searchsorted(total, np.arange(0, count[chosen].sum(), BLOCK), "right")
    for low, high in pairwise([*blocks.tolist(), len(chosen)]):
        if low < high:
            rows = chosen[low:high]
            nearest.replace(rows, _nearest_of(points, rows, path, pieces, lists))
    return nearest


def _nearest_of(
    points: FloatArray, rows: IntArray, path: IntArray, pieces: Pieces, lists: Ragged
) -> Nearest:
    count = lists.count[path[rows]]
    piece = lists.rows[join_ranges(lists.first[path[rows]], count)]
    return _nearest_pairs(points, np.repeat(rows, count), piece, pieces, np.cumsum(count) - count)


def _nearest_pairs(
    points: FloatArray, row: IntArray, piece: IntArray, pieces: Pieces, first: IntArray
) -> Nearest:
    """The nearest piece of each run of pairs (`row`, `piece`); `first` is where the runs begin."""
    feet = find_feet(rows_of(points, row), pieces, piece)
    least = np.minimum.reduceat(feet.distance, first)
    size = np.diff(np.append(first, len(row)))
    hits = np.flatnonzero(feet.distance == np.repeat(least, size))
    run = np.repeat(np.arange(len(first)), size)[hits]
    best = hits[np.append(True, run[1:] != run[:-1])]
    return Nearest(least, piece[best], feet.side[best])


def measure_ends(points: FloatArray, middles: Nearest, first: IntArray, pieces: Pieces) -> Nearest:
    """Measures the ends of motions beside the piece that is nearest half-way.

    points: (2 N + F, 2) middles and ends of N motions, and starts of the motions `first` (F,).
    middles: nearest pieces of the N middles.
    """
    piece = np.concatenate([middles.piece, middles.piece[first]])
    feet = find_feet(points[len(middles.piece) :], pieces, np.maximum(piece, 0))
    distance = np.where(piece >= 0, feet.distance, np.inf)
    return Nearest(
        np.concatenate([middles.distance, distance]),
        np.concatenate([middles.piece, piece]),
        np.concatenate([middles.side, feet.side]),
    )


Table = TypeVar("Table", bound=Struct)


def join_tables(tables: Sequence[Table]) -> Table:
    """One table of the rows of all `tables`, which may have tables among their columns."""
    columns = []
    for name in tables[0].__struct_fields__:
        parts = [getattr(table, name) for table in tables]
        is_table = isinstance(parts[0], Struct)
        columns.append(join_tables(parts) if is_table else np.concatenate(parts))
    return type(tables[0])(*columns)


class PieceTree:
    """The pieces at the indices `rows`, looked up by place."""

    def __init__(self, pieces: Pieces, rows: IntArray) -> None:
        self._pieces, self._rows = pieces, rows

    @cached_property
    def _tree(self) -> shapely.STRtree:
        return shapely.STRtree(shapely.box(*self._pieces.take(self._rows).boxes.T))

    def find(self, points: FloatArray, distance: float) -> Nearest:
        """The nearest piece of each of `points` (N, 2), if it is within `distance` mm."""
        nearest = Nearest(
            np.full(len(points), np.inf),
            np.full(len(points), -1, np.intp),
            np.zeros(len(points)),
        )
        for low in range(0, len(points), 50_000):
            part = points[low : low + 50_000]
            # The diagonals of squares around the points: a tree compares boxes, and without a
            # predicate nothing else.
            squares = shapely.linestrings(np.stack([part - distance, part + distance], axis=1))
            row, piece = self._tree.query(squares)
            if not len(row):
                continue
            first = np.flatnonzero(np.append(True, row[1:] != row[:-1]))
            rows = row + low
            hits = _nearest_pairs(points, rows, self._rows[piece], self._pieces, first)
            # A box is near to more places than the piece in it.
            within = hits.distance <= distance
            chosen = Nearest(hits.distance[within], hits.piece[within], hits.side[within])
            nearest.replace(rows[first][within], chosen)
        return nearest


class Covered(Struct, frozen=True, eq=False):
    """Stretches of pieces along which motions run.

    piece: (N,) index of the piece.
    low, high: (N,) shares of its length, 0 to 1.
    forward: (N,) whether the motion runs in the direction of the piece.
    motion: (N,) index of the motion.
    length: (N,) length of the motion, mm.
    """

    piece: IntArray
    low: FloatArray
    high: FloatArray
    forward: BoolArray
    motion: IntArray
    length: FloatArray

    def take(self, rows: IntArray | BoolArray) -> Covered:
        """The stretches at the indices or in the mask `rows`."""
        if rows.dtype == np.bool_ and rows.all():
            return self
        return Covered(*(getattr(self, name)[rows] for name in self.__struct_fields__))


def cover(motions: Pieces, rows: IntArray, piece: IntArray, pieces: Pieces) -> Covered:
    """The stretch of `piece` (N,) along which each of the motions `rows` (N,) runs."""
    ends = [rows_of(motions.start, rows), rows_of(motions.end, rows)]
    begin, end = find_all_shares(ends, pieces, piece)
    low, high = np.minimum(begin, end), np.maximum(begin, end)
    low, high = np.clip(low, 0, 1), np.clip(high, 0, 1)
    return Covered(piece, low, high, begin <= end, rows, motions.length[rows])


def find_whole(covered: Covered, slack: FloatArray) -> BoolArray:
    """(K,) pieces that one stretch covers, or two that meet: most of a usual drawing.

    slack: (K,) share of the length of each piece that is not worth a gap.
    """
    rows, low, high = np.arange(len(covered.piece)), covered.low, covered.high
    first, last = np.full(len(slack), -1), np.full(len(slack), -1)
    last[covered.piece] = rows
    first[covered.piece[::-1]] = rows[::-1]
    piece = np.flatnonzero(last >= 0)
    first, last, least = first[piece], last[piece], slack[piece]
    turned = low[last] < low[first]
    first, last = np.where(turned, last, first), np.where(turned, first, last)
    covers = (low[first] <= least) & (low[last] - high[first] <= least)
    covers &= np.maximum(high[first], high[last]) >= 1 - least
    whole = np.zeros(len(slack), np.bool_)
    whole[piece[covers]] = True
    return whole


def find_gaps(covered: Covered, wanted: IntArray, slack: FloatArray) -> Covered:
    """The stretches of the pieces `wanted` that nothing of `covered` runs along.

    covered: stretches of these pieces.
    slack: (K,) share of the length of each piece that is not worth a gap.
    """
    # The end of each piece is a stretch too, so that a gap is always ahead of a stretch.
    names = np.concatenate([covered.piece, wanted])
    low = np.concatenate([covered.low, np.ones(len(wanted))])
    high = np.concatenate([covered.high, np.ones(len(wanted))])
    # Stretches that begin at one place may come in any order.
    order = np.argsort(2.0 * names + low)
    names, low, high = names[order], low[order], high[order]
    # The end of the covered part so far of each piece: the sum keeps the pieces apart.
    reach = np.maximum.accumulate(high + 2.0 * names) - 2.0 * names
    begins = np.where(np.append(False, names[1:] == names[:-1]), np.append(0.0, reach[:-1]), 0.0)
    rows = np.flatnonzero(low - begins > slack[names])
    forward = np.ones(len(rows), np.bool_)
    no_motion, no_length = np.full(len(rows), -1), np.zeros(len(rows))
    return Covered(names[rows], begins[rows], low[rows], forward, no_motion, no_length)
