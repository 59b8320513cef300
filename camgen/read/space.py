"""From pieces in space to curves: ends that meet are joined, what is drawn twice is kept once.

As ``read.join`` in the plane: each end meets at most one other, nearest first, on one layer before different ones, and
where three or more coincide the chain goes straight on.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from typing import Literal

import numpy as np
from msgspec import Struct

from camgen.geometry.arcs import chain as spans_of
from camgen.geometry.arcs import measure_spans
from camgen.model.part import Curve, Note
from camgen.model.pose import FloatArray, frozen
from camgen.model.text import counted, short
from camgen.model.tolerance import OFF_GRID, SAME_POINT_MM
from camgen.read import join
from camgen.read.pieces import FARTHEST, tally

#: A cell of the grid and those around it; of the ends in one so many are looked at.
_AROUND, _CROWD = tuple(product((-1, 0, 1), repeat=3)), 32
#: A chain is not closed on itself across more than this part of its own length.
_OWN_GAP = 0.25
#: So many ids are named in a note.
_NAMED = 8


class Piece(Struct, frozen=True, eq=False):
    """What was drawn as one: points (N, 3) and via (N - 1, 3), NaN for lines, mm; kind and layer of its entity."""

    kind: str
    layer: str
    points: FloatArray
    via: FloatArray


def curves(pieces: Sequence[Piece], tolerance: float) -> tuple[tuple[Curve, ...], tuple[Note, ...]]:
    """The curves that ``pieces`` make, in order of their first pieces, and notes. tolerance: mm between ends."""
    notes: list[Note] = []
    pieces = _keep(pieces, [_credible(one) for one in pieces], "skipped", "damaged numbers", notes)
    pieces = [_without_repeats(one) for one in pieces]
    pieces = _keep(
        pieces, [len(one.points) > 1 for one in pieces], "repaired", "without length", notes
    )
    pieces = _keep(pieces, _are_first(pieces), "repaired", "drawn twice; each is used once", notes)
    if not pieces:
        return (), tuple(notes)
    chains, loops = join.chain(_partners(pieces, tolerance), [_is_closed(one) for one in pieces])
    gaps: list[float] = []
    made = [_assemble(pieces, ends, loop, gaps) for ends, loop in zip(chains, loops, strict=True)]
    if gaps:
        what = f"{counted(len(gaps), 'gap')} between ends, up to {short(max(gaps), 4)} mm"
        notes.append(Note("joined", what, "input.join"))
    found = tuple(
        make_curve(f"c{k}", layer, points, via, loop)
        for k, ((points, via, layer), loop) in enumerate(zip(made, loops, strict=True), 1)
    )
    return found, tuple(notes)


def make_curve(
    name: str,
    layer: str,
    points: FloatArray,
    via: FloatArray,
    closed: bool,
    rotations: FloatArray | None = None,
) -> Curve:
    """A curve through ``points`` (N, 3), over ``via`` (N - 1, 3), NaN for lines."""
    curved = ~np.isnan(via[:, 0])
    middles = np.where(curved[:, None], via, (points[:-1] + points[1:]) / 2)
    length = float(measure_spans(points, via).sum())
    return Curve(name, layer, frozen(points), frozen(middles), curved, closed, length, rotations)


def tell_which(found: Sequence[Curve]) -> Note:
    """The note on which curves are in space and which are flat, and where."""
    level = {one.id: one.level for one in found}
    space = [name for name, height in level.items() if height is None]
    what = (
        f"{counted(len(space), 'curve')} in space: {_names(space)}"
        if space
        else "no curve leaves its plane"
    )
    flat = [
        f"{name} at z = {short(height, 3)}" for name, height in level.items() if height is not None
    ]
    if flat:
        what += f"; {counted(len(flat), 'flat one')}: {_names(flat)} mm"
    return Note("assumed", what, "all are followed at the heights they are drawn at", tuple(level))


def _names(names: Sequence[str]) -> str:
    more = len(names) - _NAMED
    return ", ".join(names[:_NAMED]) + (f" and {more} more" if more > 0 else "")


def _keep(
    pieces: Sequence[Piece],
    good: Sequence[bool],
    kind: Literal["skipped", "repaired"],
    why: str,
    notes: list[Note],
) -> list[Piece]:
    """The good ones, and a note on the others."""
    lost = [one for one, fine in zip(pieces, good, strict=True) if not fine]
    if lost:
        what = tally([one.kind for one in lost], [one.layer for one in lost])
        notes.append(Note(kind, what if kind == "skipped" else f"dropped: {what}", why))
    return [one for one, fine in zip(pieces, good, strict=True) if fine]


def _credible(piece: Piece) -> bool:
    with np.errstate(invalid="ignore"):
        rows = np.concatenate([piece.points, piece.via[~np.isnan(piece.via[:, 0])]])
        return len(rows) > 0 and bool((np.abs(rows) <= FARTHEST).all())


def _without_repeats(piece: Piece) -> Piece:
    """Without spans that have no length."""
    spans = np.flatnonzero(measure_spans(piece.points, piece.via) > SAME_POINT_MM)
    kept = np.concatenate([[0], spans + 1]) if len(spans) else np.zeros(0, dtype=np.int64)
    return Piece(piece.kind, piece.layer, piece.points[kept], piece.via[spans])


def _are_first(pieces: Sequence[Piece]) -> list[bool]:
    """Which are the first of those that run along the same points, in either direction."""
    seen: set[bytes] = set()
    first = []
    for one in pieces:
        points, via = (np.round(column / SAME_POINT_MM) + 0.0 for column in (one.points, one.via))
        key = min(points.tobytes() + via.tobytes(), points[::-1].tobytes() + via[::-1].tobytes())
        first.append(key not in seen)
        seen.add(key)
    return first


def _is_closed(piece: Piece) -> bool:
    return (
        len(piece.points) > 2
        and float(np.linalg.norm(piece.points[-1] - piece.points[0])) <= SAME_POINT_MM
    )


def _partners(pieces: Sequence[Piece], tolerance: float) -> list[int]:
    """For each end (2 i the start of piece i, 2 i + 1 its end) the one that it meets, -1 if none."""
    partner = [-1] * (2 * len(pieces))
    places = np.concatenate([one.points[[0, -1]] for one in pieces])
    tangents = [spans_of(one.points, one.via).tangents() for one in pieces]
    out = np.concatenate([np.stack([-begins[0], ends[-1]]) for begins, ends in tangents])
    lengths = [float(measure_spans(one.points, one.via).sum()) for one in pieces]
    layers = [one.layer for one in pieces]
    free = [end for end in range(len(partner)) if not _is_closed(pieces[end >> 1])]
    options = []
    for a, b in _near_pairs(places, free, max(tolerance, SAME_POINT_MM)):
        one, two = a >> 1, b >> 1
        gap = float(np.linalg.norm(places[a] - places[b]))
        if one != two or gap <= _OWN_GAP * lengths[one]:
            # Rounded, so that equal turns tie and do not hang on the last bit.
            turn = round(float(out[a] @ out[b]), 9)
            options.append(
                (gap if gap > SAME_POINT_MM else 0.0, layers[one] != layers[two], turn, a, b)
            )
    for *_, a, b in sorted(options):
        if partner[a] < 0 and partner[b] < 0:
            partner[a], partner[b] = b, a
    return partner


def _near_pairs(places: FloatArray, free: Sequence[int], reach: float) -> Iterator[tuple[int, int]]:
    """Pairs of the ``free`` ends at ``places`` (E, 3) that are no more than ``reach`` apart, the lower one first. Of a
    crowd in one cell of the grid the first ones alone are looked at by the others.
    """
    cells: dict[tuple[int, ...], list[int]] = {}
    keys = np.floor(places / reach + OFF_GRID).astype(np.int64)
    for end in free:
        cells.setdefault(tuple(keys[end].tolist()), []).append(end)
    for end in free:
        x, y, z = keys[end].tolist()
        for dx, dy, dz in _AROUND:
            for other in cells.get((x + dx, y + dy, z + dz), ())[:_CROWD]:
                if other < end and float(np.linalg.norm(places[other] - places[end])) <= reach * (
                    1 + 1e-9
                ):
                    yield other, end


def _assemble(
    pieces: Sequence[Piece], ends: Sequence[int], loop: bool, gaps: list[float]
) -> tuple[FloatArray, FloatArray, str]:
    """One chain of the pieces that are entered at ``ends``, and its layer; lengths of the gaps go to ``gaps``.

    A gap is closed by a short line, so that every piece stays where it was drawn.
    """
    line = np.full((1, 3), np.nan)
    points, via = [np.zeros((0, 3))], [np.zeros((0, 3))]
    for end in ends:
        piece = pieces[end >> 1]
        step = -1 if end & 1 else 1
        own, middles = piece.points[::step], piece.via[::step]
        before = points[-1][-1:]
        apart = float(np.linalg.norm(own[0] - before[0])) if len(before) else 0.0
        if apart > SAME_POINT_MM:
            gaps.append(apart)
            via.append(line)
        points.append(own[1:] if len(before) and apart <= SAME_POINT_MM else own)
        via.append(middles)
    first, last = points[1][0], points[-1][-1]
    apart = float(np.linalg.norm(last - first))
    if loop and apart > SAME_POINT_MM:
        gaps.append(apart)
        points.append(first[None])
        via.append(line)
    whole = np.concatenate(points)
    if loop:
        whole[-1] = whole[0]
    return whole, np.concatenate(via), pieces[ends[0] >> 1].layer
