"""Joins drawn pieces in space to curves: ends that meet are joined, repeated pieces are dropped.

The rules are those of `read.join` in the plane. Each end meets at most one other, the nearest ones
first, and ends on one layer before ends on different layers. Where three or more ends coincide, the
chain goes straight on.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import compress, product
from typing import Literal

import numpy as np
from msgspec import Struct

from camgen.geometry.arcs import make_span_chain as chain_spans
from camgen.geometry.arcs import measure_spans
from camgen.model.part import Curve, Note
from camgen.model.pose import FloatArray, frozen
from camgen.model.text import counted, short
from camgen.model.tolerance import OFF_GRID, SAME_POINT_MM
from camgen.read import join
from camgen.read.pieces import FARTHEST, describe_elements, list_first

#: Offsets from a cell of the grid of ends to itself and to the cells around it.
_AROUND = tuple(product((-1, 0, 1), repeat=3))
#: Ends in one cell that are compared with the ends around. It bounds the time for damaged drawings.
_MAX_COMPARED = 32
#: Largest gap across which a piece is closed on itself, as a fraction of its length.
_OWN_GAP_SHARE = 0.25
#: Ids that a note lists.
_MAX_LISTED = 8


class Piece(Struct, frozen=True, eq=False):
    """A drawn chain of lines and arcs.

    kind: kind of the entity that was drawn.
    layer: layer of the entity.
    points: (N, 3) ends of the lines and arcs, mm.
    via: (N - 1, 3) a point of each arc, NaN for a line, mm.
    """

    kind: str
    layer: str
    points: FloatArray
    via: FloatArray


def join_pieces(
    pieces: Sequence[Piece], tolerance: float
) -> tuple[tuple[Curve, ...], tuple[Note, ...]]:
    """The curves that the pieces make, in the order of their first pieces, and notes.

    tolerance: largest gap between ends that are joined, mm.
    """
    notes: list[Note] = []
    pieces = _keep(pieces, list(map(_is_credible, pieces)), "skipped", "damaged numbers", notes)
    pieces = list(map(_drop_repeats, pieces))
    has_length = [len(piece.points) > 1 for piece in pieces]
    pieces = _keep(pieces, has_length, "repaired", "without length", notes)
    pieces = _keep(
        pieces, list(_are_first(pieces)), "repaired", "drawn twice; each is used once", notes
    )
    if not pieces:
        return (), tuple(notes)
    closed = list(map(_is_closed, pieces))
    chains, loops = join.chain(_find_partners(pieces, closed, tolerance), closed)
    joined: list[Curve] = []
    gaps: list[float] = []
    for ends, loop in zip(chains, loops, strict=True):
        points, via = _assemble(pieces, ends, loop, gaps)
        layer = pieces[ends[0] >> 1].layer
        joined.append(make_curve(f"c{len(joined) + 1}", layer, points, via, loop))
    if gaps:
        notes.append(
            Note(
                "joined",
                f"{counted(len(gaps), 'gap')} between ends, up to {short(max(gaps), 4)} mm",
                "input.join",
            )
        )
    return tuple(joined), tuple(notes)


def make_curve(
    name: str,
    layer: str,
    points: FloatArray,
    via: FloatArray,
    closed: bool,
    rotations: FloatArray | None = None,
) -> Curve:
    """A curve of lines and arcs.

    points: (N, 3) ends of the lines and arcs, mm.
    via: (N - 1, 3) a point of each arc, NaN for a line, mm.
    rotations: (N, 3, 3) orientation of the tool at each point, None without one.
    """
    curved = ~np.isnan(via[:, 0])
    middles = np.where(curved[:, None], via, (points[:-1] + points[1:]) / 2)
    length = float(measure_spans(points, via).sum())
    return Curve(name, layer, frozen(points), frozen(middles), curved, closed, length, rotations)


def note_heights(drawn: Sequence[Curve]) -> Note:
    """The note that lists the curves in space, and the flat ones with their heights."""
    level = {curve.id: curve.level for curve in drawn}
    in_space = [name for name, height in level.items() if height is None]
    flat = [f"{name} at z = {short(z, 3)}" for name, z in level.items() if z is not None]
    what = "no curve leaves its plane"
    if in_space:
        what = f"{counted(len(in_space), 'curve')} in space: {list_first(in_space, _MAX_LISTED)}"
    if flat:
        what += f"; {counted(len(flat), 'flat one')}: {list_first(flat, _MAX_LISTED)} mm"
    return Note("assumed", what, "all are followed at the heights they are drawn at", tuple(level))


def _keep(
    pieces: Sequence[Piece],
    is_kept: Sequence[bool],
    kind: Literal["skipped", "repaired"],
    why: str,
    notes: list[Note],
) -> list[Piece]:
    """The pieces that are kept. `notes` gets a note on the others."""
    dropped = [piece for piece, fine in zip(pieces, is_kept, strict=True) if not fine]
    if dropped:
        what = describe_elements(
            [piece.kind for piece in dropped], [piece.layer for piece in dropped]
        )
        notes.append(Note(kind, what if kind == "skipped" else f"dropped: {what}", why))
    return list(compress(pieces, is_kept))


def _is_credible(piece: Piece) -> bool:
    """Whether a piece has points, and no coordinate beyond `FARTHEST`."""
    with np.errstate(invalid="ignore"):
        rows = np.concatenate([piece.points, piece.via[~np.isnan(piece.via[:, 0])]])
        return len(rows) > 0 and bool((np.abs(rows) <= FARTHEST).all())


def _drop_repeats(piece: Piece) -> Piece:
    """The piece without lines and arcs that have no length."""
    spans = np.flatnonzero(measure_spans(piece.points, piece.via) > SAME_POINT_MM)
    kept = np.concatenate([[0], spans + 1]) if len(spans) else np.zeros(0, dtype=np.int64)
    return Piece(piece.kind, piece.layer, piece.points[kept], piece.via[spans])


def _are_first(pieces: Sequence[Piece]) -> Iterator[bool]:
    """Whether each piece differs from all before it, in both directions."""
    seen: set[bytes] = set()
    for piece in pieces:
        points = np.round(piece.points / SAME_POINT_MM) + 0.0
        via = np.round(piece.via / SAME_POINT_MM) + 0.0
        key = min(points.tobytes() + via.tobytes(), points[::-1].tobytes() + via[::-1].tobytes())
        yield key not in seen
        seen.add(key)


def _is_closed(piece: Piece) -> bool:
    return (
        len(piece.points) > 2
        and float(np.linalg.norm(piece.points[-1] - piece.points[0])) <= SAME_POINT_MM
    )


def _find_partners(pieces: Sequence[Piece], closed: list[bool], tolerance: float) -> list[int]:
    """The end that meets each end, -1 for an end that stays open.

    End 2 i is the start of piece i, end 2 i + 1 is its end.
    """
    places, directions, lengths = [], [], []
    for piece in pieces:
        starts, ends = chain_spans(piece.points, piece.via).tangents()
        places.append(piece.points[[0, -1]])
        directions.append(np.stack([-starts[0], ends[-1]]))
        lengths.append(float(measure_spans(piece.points, piece.via).sum()))
    place, outward = np.concatenate(places), np.concatenate(directions)
    free = [end for end in range(2 * len(pieces)) if not closed[end >> 1]]
    options = []
    for a, b in _find_near_pairs(place, free, max(tolerance, SAME_POINT_MM)):
        first, second = a >> 1, b >> 1
        gap = float(np.linalg.norm(place[a] - place[b]))
        if first != second or gap <= _OWN_GAP_SHARE * lengths[first]:
            # Rounded, so that equal turns tie and do not differ in their last bit.
            turn = round(float(outward[a] @ outward[b]), 9)
            is_foreign = pieces[first].layer != pieces[second].layer
            options.append((gap if gap > SAME_POINT_MM else 0.0, is_foreign, turn, a, b))
    partner = [-1] * (2 * len(pieces))
    for *_, a, b in sorted(options):
        if partner[a] < 0 and partner[b] < 0:
            partner[a], partner[b] = b, a
    return partner


def _find_near_pairs(
    place: FloatArray, free: Sequence[int], tolerance: float
) -> Iterator[tuple[int, int]]:
    """Pairs of ends that are at most `tolerance` apart, each with the lower end first.

    place: (E, 3) positions of all ends, mm.
    free: ends that are compared. In each cell of the grid only the first `_MAX_COMPARED` of them
        are compared with the ends around.
    """
    cells: dict[tuple[int, ...], list[int]] = {}
    keys = np.floor(place / tolerance + OFF_GRID).astype(np.int64)
    for end in free:
        cells.setdefault(tuple(keys[end].tolist()), []).append(end)
    limit = tolerance * (1 + 1e-9)
    for end in free:
        x, y, z = keys[end].tolist()
        for dx, dy, dz in _AROUND:
            for other in cells.get((x + dx, y + dy, z + dz), ())[:_MAX_COMPARED]:
                if other < end and float(np.linalg.norm(place[other] - place[end])) <= limit:
                    yield other, end


def _assemble(
    pieces: Sequence[Piece], ends: Sequence[int], loop: bool, gaps: list[float]
) -> tuple[FloatArray, FloatArray]:
    """The points and via points of one chain.

    A gap is closed by a short line, so that every piece stays where it was drawn.

    ends: ends at which the pieces are entered.
    gaps: gets the widths of the gaps, mm.
    """
    line = np.full((1, 3), np.nan)
    points, via = [np.zeros((0, 3))], [np.zeros((0, 3))]
    for end in ends:
        piece = pieces[end >> 1]
        step = -1 if end & 1 else 1
        drawn, before = piece.points[::step], points[-1][-1:]
        gap = float(np.linalg.norm(drawn[0] - before[0])) if len(before) else 0.0
        if gap > SAME_POINT_MM:
            gaps.append(gap)
            via.append(line)
        points.append(drawn[1:] if len(before) and gap <= SAME_POINT_MM else drawn)
        via.append(piece.via[::step])
    first, last = points[1][0], points[-1][-1]
    gap = float(np.linalg.norm(last - first))
    if loop and gap > SAME_POINT_MM:
        gaps.append(gap)
        points.append(first[None])
        via.append(line)
    whole = np.concatenate(points)
    if loop:
        whole[-1] = whole[0]
    return whole, np.concatenate(via)
