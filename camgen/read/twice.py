"""Drops drawn pieces, and parts of pieces, that lie on others: each length is used once."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.overlap import (
    SAME_CURVE_MM,
    Chain,
    Parts,
    cut_chain,
    find_covered,
    find_equal_loops,
    measure_covered,
)
from camgen.geometry.ragged import compute_offsets, list_owners
from camgen.geometry.segments import Segments, make_segments, points_at
from camgen.model.job import Step
from camgen.model.part import Note
from camgen.model.text import short
from camgen.model.tolerance import SAME_POINT_MM
from camgen.read.layers import is_chosen
from camgen.read.pieces import BoolArray, DrawnPieces, IntArray, describe_elements, find_next_rows

#: Maximum number of places of a note that the preview shows.
_MAX_PLACES = 50
_WHY = "drawn twice; each is used once"


class _Cut(Struct, frozen=True, eq=False):
    """A piece that is covered by others.

    piece: index of the piece.
    chains: open chains that remain of it, none if all of it is covered.
    length: covered length, mm.
    place: middle of its first covered part, mm.
    """

    piece: int
    chains: list[Chain]
    length: float
    place: tuple[float, float]


def label_selections(soup: DrawnPieces, operations: Sequence[Step]) -> IntArray:
    """(P,) number of the set of operations that choose each piece by its layer and color.

    Pieces of different sets are not compared: an outline and a pocket may have the same contour.
    """
    if not operations:
        return np.zeros(len(soup), dtype=np.intp)
    pairs = soup.layer * len(soup.colors) + soup.color
    numbers: dict[tuple[bool, ...], int] = {}
    label = np.zeros(len(soup), dtype=np.intp)
    for pair in np.unique(pairs).tolist():
        layer, color = divmod(pair, len(soup.colors))
        names = soup.layers[layer], soup.colors[color]
        selection = tuple(is_chosen(*names, step.choice) for step in operations)
        label[pairs == pair] = numbers.setdefault(selection, len(numbers))
    return label


def cut_repeated(
    soup: DrawnPieces,
    label: IntArray,
    tolerance: float,
    among: BoolArray,
    fixed: BoolArray,
    noun: str = "",
) -> tuple[DrawnPieces, list[Note]]:
    """The pieces without the parts that lie on others, and notes on these parts.

    label: (P,) pieces of different labels are not compared.
    tolerance: largest distance between pieces that lie on each other, mm.
    among: (P,) pieces that are compared.
    fixed: (P,) pieces that stay whole and cover others. Each other piece covers those after it.
    noun: name of the pieces in notes, "" for their kinds.
    """
    tolerance = _limit(tolerance)
    segments = _list_segments(soup, among)
    if not len(segments):
        return soup, []
    piece = segments.owner
    rank = np.where(fixed[piece], 0, piece + 1)
    covered = find_covered(segments, rank, label[piece], tolerance)
    if not covered:
        return soup, []
    cuts = _list_cuts(soup, segments, covered)
    return _replace_pieces(soup, cuts), list(_note_cuts(soup, cuts, noun))


def drop_repeated_loops(
    soup: DrawnPieces, label: IntArray, tolerance: float
) -> tuple[DrawnPieces, list[Note]]:
    """The pieces without closed ones that have the shape of an earlier one, and notes on these.

    The other parameters are those of `cut_repeated`.
    """
    loops = np.flatnonzero(soup.closed)
    segments = _list_segments(soup, soup.closed)
    numbered = replace(segments, owner=np.searchsorted(loops, segments.owner))
    repeated = find_equal_loops(numbered, len(loops), label[loops], _limit(tolerance))
    if not repeated:
        return soup, []
    pieces = loops[repeated]
    places = [(float(x), float(y)) for x, y in soup.points[soup.first[pieces]].tolist()]
    keep = np.ones(len(soup), dtype=np.bool_)
    keep[pieces] = False
    return soup.take(keep), [_note(_count(soup, pieces.tolist(), "contour"), places)]


def _limit(tolerance: float) -> float:
    return max(min(tolerance, SAME_CURVE_MM), 4 * SAME_POINT_MM)


def _list_segments(soup: DrawnPieces, among: BoolArray) -> Segments:
    """Lines and arcs of the pieces of `among`; their `owner` is the index among all pieces."""
    piece = list_owners(np.diff(soup.first))
    used = among[piece]
    used[(soup.first[1:] - 1)[~soup.closed]] = False
    rows = np.flatnonzero(used)
    after = find_next_rows(soup)[rows]
    return make_segments(soup.points[rows], soup.points[after], soup.bulges[rows], piece[rows])


def _list_cuts(soup: DrawnPieces, segments: Segments, covered: dict[int, Parts]) -> list[_Cut]:
    """The cut of each covered piece, in order.

    covered: covered parts of the segments, by the index of the segment.
    """
    by_piece: dict[int, dict[int, Parts]] = {}
    for row, parts in covered.items():
        by_piece.setdefault(int(segments.owner[row]), {})[row] = parts
    cuts = []
    for piece, rows in sorted(by_piece.items()):
        head = int(np.searchsorted(segments.owner, piece))
        span = slice(int(soup.first[piece]), int(soup.first[piece + 1]))
        chains = cut_chain(
            soup.points[span],
            soup.bulges[span],
            bool(soup.closed[piece]),
            {row - head: parts for row, parts in rows.items()},
        )
        first, parts = next(iter(rows.items()))
        middle = np.array([sum(parts[0]) / 2])
        ((x, y),) = points_at(segments.take(np.array([first])), middle).tolist()
        cuts.append(_Cut(piece, chains, measure_covered(segments, rows), (x, y)))
    return cuts


def _replace_pieces(soup: DrawnPieces, cuts: list[_Cut]) -> DrawnPieces:
    """The soup with the rest of each covered piece in its place."""
    is_whole = np.ones(len(soup), dtype=np.bool_)
    is_whole[[cut.piece for cut in cuts]] = False
    whole = soup.take(is_whole)
    chains, owners = [(whole.points, whole.bulges)], np.flatnonzero(is_whole).tolist()
    for cut in cuts:
        chains += cut.chains
        owners += [cut.piece] * len(cut.chains)
    points, bulges = zip(*chains, strict=True)
    index = np.array(owners, dtype=np.intp)
    pieces = replace(
        soup,
        points=np.concatenate(points),
        bulges=np.concatenate(bulges),
        first=compute_offsets([*np.diff(whole.first), *map(len, points[1:])]),
        closed=np.append(whole.closed, np.zeros(len(chains) - 1, dtype=np.bool_)),
        layer=soup.layer[index],
        kind=soup.kind[index],
        color=soup.color[index],
    )
    return pieces.take(np.argsort(index, kind="stable"))


def _note_cuts(soup: DrawnPieces, cuts: list[_Cut], noun: str) -> Iterator[Note]:
    for is_whole in (True, False):
        group = [cut for cut in cuts if is_whole == (not cut.chains)]
        if not group:
            continue
        what = _count(soup, [cut.piece for cut in group], noun)
        if not is_whole:
            what = f"{short(sum(cut.length for cut in group), 2)} mm of {what}"
        yield _note(what, [cut.place for cut in group])


def _count(soup: DrawnPieces, pieces: list[int], noun: str) -> str:
    plural = f"{noun}s" if noun and len(pieces) > 1 else noun
    kinds = [plural or soup.kinds[soup.kind[piece]] for piece in pieces]
    return describe_elements(kinds, [soup.layers[soup.layer[piece]] for piece in pieces])


def _note(what: str, places: list[tuple[float, float]]) -> Note:
    x, y = places[0]
    place = f"near x {short(x, 2)}, y {short(y, 2)}"
    if len(places) > 1:
        place = f"the first {place}"
    return Note("repaired", f"dropped: {what}, {place}", _WHY, (), tuple(places[:_MAX_PLACES]))
