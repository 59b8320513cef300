"""Parts that come loose: when what is cut through goes all round, and whether the tool comes back to them then."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
from msgspec import Struct

from camgen.check.stock.cells import Shapes
from camgen.check.stock.clear import Gone
from camgen.check.stock.design import Design
from camgen.check.stock.moves import TOLERANCE_MM, Moves
from camgen.check.stock.sweep import sweep, unite
from camgen.geometry.segments import IntArray, points_at

#: So far beyond the kerf, mm, what is still joined to the part holds it.
_BEYOND_MM = 0.5


class Loose(Struct, frozen=True):
    """A part that is cut free. contour: its outline's id. row: the motion that frees it, or with which the way around
    it ends. again: the first motion after which works on it then, -1: none does, it was its last cut. tabs: bridges
    should hold it.
    """

    contour: str
    row: int
    again: int
    tabs: bool = False


def find_loose(gone: Gone, design: Design) -> list[Loose]:
    """Parts within followed contours that are cut free at the bottom of the stock; none where that is not known."""
    if design.thickness is None or design.free:
        return []
    bottom = design.thickness - TOLERANCE_MM
    stays = design.depth < bottom
    walls = design.cells.walls(stays)
    outlines = [k for k in walls.tolist() if stays[k]]
    found = []
    for k in outlines:
        loose = _frees(gone, design, k, bottom)
        if loose is not None:
            found.append(loose)
    return sorted(found, key=lambda one: one.row)


def _frees(gone: Gone, design: Design, cell: int, bottom: float) -> Loose | None:
    moves, part = gone.moves, design.cells.rings[cell]
    wide = max((cut.tool.diameter for cut in gone.cuts), default=0.0)
    around = shapely.buffer(part, wide + _BEYOND_MM, quad_segs=4)
    near = np.sort(gone.rows[gone.tree.query(around)])
    through = near[(moves.deepest[near] > bottom) & ~moves.rapid[near]]
    through = through[
        shapely.distance(_chords(moves, through), shapely.boundary(part)) <= wide + _BEYOND_MM
    ]
    if not len(through) or not _is_free(
        _cut_away(gone, through, bottom), part, around, design.outline
    ):
        return None
    # Most are cut free by the last way around them, which is told as its end.
    last = int(np.searchsorted(moves.stroke[through], moves.stroke[through[-1]]))
    if last == 0 or not _is_free(
        _cut_away(gone, through[:last], bottom), part, around, design.outline
    ):
        low = high = len(through)
    else:
        low, high = 0, last
    while high - low > 1:
        middle = (low + high) // 2
        free = _is_free(_cut_away(gone, through[:middle], bottom), part, around, design.outline)
        low, high = (low, middle) if free else (middle, high)
    row = int(through[high - 1])
    name = design.cells.ids[cell]
    return Loose(name, row, _comes_back(gone, moves, near, row, part), name in design.held)


def _cut_away(gone: Gone, rows: IntArray, bottom: float) -> Any:
    return unite(sweep(gone.moves, gone.cuts, bottom, rows))


def _is_free(cut: Any, part: Any, around: Any, outline: Any) -> bool:
    """Whether nothing that hangs together with the part reaches the rim of what is around it."""
    rim = shapely.intersection(shapely.boundary(around), outline)
    left = shapely.get_parts(shapely.difference(shapely.intersection(around, outline), cut))
    # Threads thinner than the chords of the polygons hold nothing.
    left = shapely.get_parts(shapely.buffer(left, -0.01, quad_segs=1))
    held = left[shapely.intersects(left, shapely.buffer(rim, 0.02, quad_segs=1))]
    inside = shapely.buffer(part, -0.02, quad_segs=1)
    return bool(not shapely.intersects(held, inside).any())


def _comes_back(gone: Gone, moves: Moves, near: IntArray, row: int, part: Any) -> int:
    """The first motion at feed after ``row`` that goes down again and cuts at the part; -1: none."""
    later = near[(near > row) & (moves.stroke[near] > moves.stroke[row]) & ~moves.rapid[near]]
    later = later[~moves.rising[later]]
    if not len(later):
        return -1
    radius = np.array([cut.tool.radius for cut in gone.cuts])[moves.cut[later]]
    touching = later[shapely.distance(_chords(moves, later), part) <= radius + TOLERANCE_MM]
    return int(touching[0]) if len(touching) else -1


def _chords(moves: Moves, rows: IntArray) -> Shapes:
    """Motions as lines through five places of theirs; an arc leaves them by a fiftieth of its chord at most."""
    plane = moves.plane.take(rows)
    places = [points_at(plane, np.full(len(rows), share)) for share in (0.0, 0.25, 0.5, 0.75, 1.0)]
    return np.asarray(shapely.linestrings(np.stack(places, axis=1)))
