"""Finds the pieces that a program cuts out of the stock and that nothing holds.

Every tool is as wide above as at its tip, or wider. Material that is gone at one depth is gone
above it too, so two pieces that hang together at any height hang together at the bottom face. The
connected regions of the material at the bottom face are therefore those of the whole stock.
Bridges, onion skins and floors of pockets are material like any other.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
import shapely
from msgspec import Struct

from camgen.check.proof.heights import tab_slopes
from camgen.check.proof.slopes import find_tab_room
from camgen.check.stock.cells import Shapes
from camgen.check.stock.clear import SweptAreas
from camgen.check.stock.design import Design, Tabbed
from camgen.check.stock.moves import TOLERANCE_MM, Moves
from camgen.check.stock.profile import BEAMS
from camgen.check.stock.sweep import QUARTER, merge_shapes, sweep
from camgen.geometry.segments import BoolArray, IntArray, points_at

#: mm: stock that is farther than this from the kerf holds a piece.
_BEYOND_MM = 0.5
#: mm: threads narrower than twice this come from the chords of the polygons and hold nothing.
_THREAD_MM = 0.01
#: mm: a piece that is nearer to the rim of the stock or to a clamp reaches it.
_REACHED_MM = 0.03
#: mm: a piece is a part if it has more than a rim of this width of material that must stay.
_RIM_MM = 0.05
#: Minimum width of a tab, as a fraction of `operation.tab_width`.
_MIN_TAB = 0.5
#: mm: length by which a tab may be longer than its foot.
_LONGER_MM = 1.0

#: Kinds of tools whose pieces may come loose: they fall through a grid, or lie on a mat.
_DROPPING = (*BEAMS, "pen")

PieceKind = Literal["part", "slug"]


class Piece(Struct, frozen=True, eq=False):
    """Connected material that nothing holds: a part, or a slug that is larger than a chip.

    kind: "part" if it contains material that must stay, otherwise "slug".
    contour: id of the outline of the part in it, or of the contour around a slug.
    shape: polygon, mm.
    place: x and y of a point in it, mm.
    row: motion that frees it, or that ends the cut around it.
    again: first motion after that one that works on it; -1 if that one was its last cut.
    tabs: whether tabs should hold it.
    drops: whether the piece may come loose: an arm, a beam, a blade or a pen cuts it free.
    """

    kind: PieceKind
    contour: str
    shape: Any
    place: tuple[float, float]
    row: int
    again: int
    tabs: bool
    drops: bool

    @property
    def size(self) -> tuple[float, float]:
        """Length and width of the box around it, mm."""
        low_x, low_y, high_x, high_y = self.shape.bounds
        return high_x - low_x, high_y - low_y


class MissingTabs(Struct, frozen=True):
    """A contour with fewer tabs than the job asks for, although there is room for one more.

    contour: id of the contour.
    count: number of tabs.
    wanted: number of tabs that the job asks for.
    row: last motion through the stock beside it.
    """

    contour: str
    count: int
    wanted: int
    row: int


class Pieces(Struct, frozen=True, eq=False):
    """The pieces that come loose.

    loose: pieces that nothing holds, in the order in which they are freed.
    missing: contours without all of their tabs.
    has_frame: whether the kerfs leave stock that reaches its rim.
    """

    loose: tuple[Piece, ...] = ()
    missing: tuple[MissingTabs, ...] = ()
    has_frame: bool = True


def find_pieces(
    gone: SweptAreas, design: Design, held: Any = None, *, drops: bool = False
) -> Pieces:
    """Find the pieces that nothing holds; empty if the thickness of the stock is unknown.

    held: polygons under clamps, mm, which hold pieces that reach into them. None: no clamps.
    drops: whether any piece may come loose, as below an arm.
    """
    if design.thickness is None or design.free:
        return Pieces()
    moves = gone.moves
    bottom = design.thickness - TOLERANCE_MM
    through = gone.rows[(moves.deepest[gone.rows] > bottom) & ~moves.rapid[gone.rows]]
    if not len(through):
        return Pieces()
    cut = merge_shapes(sweep(moves, gone.cuts, bottom, through, set()))
    material = shapely.buffer(shapely.difference(design.outline, cut), -_THREAD_MM, quad_segs=1)
    pieces = shapely.get_parts(material)
    pieces = pieces[~shapely.is_empty(pieces)]
    rim = _find_rim(gone, design, cut, through, bottom)
    find = _make_finder(gone, design, bottom, through, drops)
    loose = []
    for shape, is_part in _sort(pieces[~_are_held(pieces, rim, held)], design, bottom):
        piece = find.piece(shape, is_part)
        if piece is not None:
            loose.append(piece)
    missing = _find_missing_tabs(design, cut, find)
    if held is not None:
        rings = dict(zip(design.cells.ids, design.cells.rings, strict=False))
        missing = tuple(
            tabs for tabs in missing if not shapely.intersects(rings[tabs.contour], held)
        )
    loose.sort(key=lambda piece: piece.row)
    return Pieces(tuple(loose), missing, not rim.is_empty)


def _find_rim(gone: SweptAreas, design: Design, cut: Any, through: IntArray, bottom: float) -> Any:
    """Find the rim of the stock that is not cut and not near to a kerf.

    A tab that ends at the rim holds nothing if all stock around the part is kerf.
    """
    rim = shapely.boundary(design.outline)
    wide = _widest(gone, through) + _BEYOND_MM
    kerfs_outside = [kerf for kerf in design.wanted if kerf.loop >= 0 and kerf.cell != kerf.loop]
    outer = [kerf.loop for kerf in kerfs_outside if kerf.depth > bottom]
    outlines = design.cells.rings[np.unique(np.array(outer, dtype=np.int64))]
    near = outlines[shapely.dwithin(outlines, rim, wide)]
    kerfs = shapely.get_parts(cut)
    kerfs = kerfs[shapely.dwithin(kerfs, rim, _REACHED_MM)]
    closed = [
        *shapely.buffer(near, wide, quad_segs=QUARTER),
        *shapely.buffer(kerfs, 2 * _REACHED_MM, quad_segs=2),
    ]
    if not closed:
        return rim
    lines = shapely.get_parts(shapely.line_merge(shapely.difference(rim, merge_shapes(closed))))
    # A corner of the rim that is shorter than the tool is wide holds nothing.
    return shapely.multilinestrings(lines[shapely.length(lines) >= wide])


def _widest(gone: SweptAreas, rows: IntArray) -> float:
    diameters = np.array([cut.tool.diameter for cut in gone.cuts])
    return float(diameters[gone.moves.cut[rows]].max(initial=0.0))


def _are_held(pieces: Shapes, rim: Any, held: Any) -> BoolArray:
    reaches = shapely.dwithin(pieces, rim, _REACHED_MM)
    if held is not None:
        reaches |= shapely.dwithin(pieces, held, _REACHED_MM)
    return np.asarray(reaches)


def _sort(pieces: Shapes, design: Design, bottom: float) -> list[tuple[Any, bool]]:
    cells = design.cells
    stays = design.depth < bottom
    stays[-1] = False
    stays[list(design.waste)] = False
    is_part = stays[cells.find(shapely.get_coordinates(shapely.point_on_surface(pieces)))]
    # Most pieces are in one cell. The others are compared with all cells that stay.
    cores = shapely.buffer(pieces, -_RIM_MM, quad_segs=1)
    cores[is_part] = None
    if shapely.STRtree(cores).query(shapely.boundary(cells.rings), predicate="intersects").size:
        shapes = cells.shapes(np.flatnonzero(stays))
        shapely.prepare(shapes)
        is_part[shapely.STRtree(cores).query(shapes, predicate="intersects")[1]] = True
    return list(zip(pieces, is_part.tolist(), strict=True))


class _Finder(Struct, frozen=True, eq=False):
    """Finds the motions that cut a piece free.

    bottom: depth of the bottom face, mm.
    through: (T,) motions through the stock, in order.
    tree: tree of these motions as lines.
    rings: tree of the areas that the contours enclose.
    wide: diameter of the widest tool among them, mm.
    chip: area of the largest chip of the smallest tool, mm2.
    tabbed: ids of contours with tabs.
    drops: whether any piece may come loose.
    """

    gone: SweptAreas
    design: Design
    bottom: float
    through: IntArray
    tree: Any
    rings: Any
    wide: float
    chip: float
    tabbed: frozenset[str]
    drops: bool

    def near(self, shape: Any, distance: float) -> IntArray:
        """Find the motions through the stock within a distance of a shape, mm, in order."""
        rows = self.tree.query(shape, predicate="dwithin", distance=distance)
        return np.asarray(self.through[np.sort(rows)])

    def piece(self, shape: Any, is_part: bool) -> Piece | None:
        """Make the piece with the motion that frees it; None for a chip."""
        gone = self.gone
        if not is_part and shape.area < self.chip:
            return None
        # Material within a piece does not join it to the frame.
        rim = shapely.get_exterior_ring(shape)
        near = self.near(rim, self.wide / 2 + _BEYOND_MM)
        if not len(near):
            return None
        row = self._find_last(shape, rim, near)
        tool = gone.cuts[int(gone.moves.cut[row])].tool
        if not is_part and shape.area < tool.chip_area:
            return None
        inside = shapely.centroid(shape)
        if not shapely.contains_properly(shape, inside):
            inside = shapely.point_on_surface(shape)
        contours = self._find_contours(shape, inside, is_part)
        return Piece(
            "part" if is_part else "slug",
            contours[0] if contours else "",
            shape,
            (float(inside.x), float(inside.y)),
            row,
            _comes_back(gone, row, shape),
            not self.tabbed.isdisjoint(contours),
            self.drops or tool.kind in _DROPPING,
        )

    def _find_contours(self, shape: Any, inside: Any, is_part: bool) -> list[str]:
        """List the outlines in a part, the largest first; for a slug the contour around it."""
        cells = self.design.cells
        if is_part:
            inner = shapely.buffer(shape, -_RIM_MM, quad_segs=1)
            loops = self.rings.query(shape, predicate="intersects")
            stays = self.design.depth < self.bottom
            loops = [k for k in loops.tolist() if stays[k] and not stays[cells.parent[k]]]
            loops = [k for k in loops if cells.shape(k).intersects(inner)]
            return [cells.ids[k] for k in sorted(loops, key=lambda k: -cells.area[k])]
        around = int(cells.find(np.array([[inside.x, inside.y]]))[0])
        return [] if around == cells.outside else [cells.ids[around]]

    def _find_last(self, shape: Any, rim: Any, near: IntArray) -> int:
        """Find the motion that frees a piece.

        Most pieces are freed by the last cut around them, so by the last motion of that cut.
        """
        gone, moves = self.gone, self.gone.moves
        first = int(np.searchsorted(moves.stroke[near], moves.stroke[near[-1]]))
        if first == 0:
            return int(near[-1])
        around = shapely.buffer(shapely.Polygon(rim), self.wide + _BEYOND_MM, quad_segs=4)

        def is_free(rows: IntArray) -> bool:
            swept = merge_shapes(sweep(gone.moves, gone.cuts, self.bottom, rows))
            return _is_free(swept, shape, around, self.design.outline)

        if not is_free(near[:first]):
            return int(near[-1])
        low, high = 0, first
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if is_free(near[:middle]) else (middle, high)
        return int(near[high - 1])


def _make_finder(
    gone: SweptAreas, design: Design, bottom: float, through: IntArray, drops: bool
) -> _Finder:
    tools = [gone.cuts[k].tool for k in np.unique(gone.moves.cut[through]).tolist()]
    return _Finder(
        gone,
        design,
        bottom,
        through,
        shapely.STRtree(_chords(gone.moves, through)),
        shapely.STRtree(design.cells.rings),
        _widest(gone, through),
        min(tool.chip_area for tool in tools),
        frozenset(design.cells.ids[tabbed.loop] for tabbed in design.tabbed),
        drops,
    )


def _is_free(cut: Any, part: Any, around: Any, outline: Any) -> bool:
    """Whether no material connected with the part reaches the rim of its surroundings."""
    rim = shapely.intersection(shapely.boundary(around), outline)
    left = shapely.get_parts(shapely.difference(shapely.intersection(around, outline), cut))
    left = shapely.get_parts(shapely.buffer(left, -_THREAD_MM, quad_segs=1))
    held = left[shapely.intersects(left, shapely.buffer(rim, 2 * _THREAD_MM, quad_segs=1))]
    inside = shapely.buffer(part, -2 * _THREAD_MM, quad_segs=1)
    return bool(not shapely.intersects(held, inside).any())


def _comes_back(gone: SweptAreas, row: int, shape: Any) -> int:
    """Find the first motion at feed after `row` that cuts at the piece again; -1 for none."""
    moves = gone.moves
    near = np.sort(gone.rows[gone.tree.query(shape)])
    later = near[(near > row) & (moves.stroke[near] > moves.stroke[row]) & ~moves.rapid[near]]
    later = later[~moves.rising[later]]
    if not len(later):
        return -1
    radius = np.array([cut.tool.radius for cut in gone.cuts])[moves.cut[later]]
    # The piece is narrower by half a thread on each side.
    limit = radius + TOLERANCE_MM + _THREAD_MM
    touching = later[shapely.distance(_chords(moves, later), shape) <= limit]
    return int(touching[0]) if len(touching) else -1


def _chords(moves: Moves, rows: IntArray) -> Shapes:
    """Make lines through five samples of each motion.

    An arc deviates from its line by at most a fiftieth of its chord.
    """
    plane = moves.plane.take(rows)
    samples = [points_at(plane, np.full(len(rows), at)) for at in (0.0, 0.25, 0.5, 0.75, 1.0)]
    return np.asarray(shapely.linestrings(np.stack(samples, axis=1)))


class _Loop(Struct, frozen=True, eq=False):
    """A closed kerf with tabs, around one outline or several near to each other.

    line: middle of the kerf.
    tabbed: a contour of the kerf.
    around: middles of the kerfs of the parts within it, which are the reason for its tabs.
    """

    line: Any
    tabbed: Tabbed
    around: tuple[Any, ...] = ()


def _find_missing_tabs(design: Design, cut: Any, find: _Finder) -> tuple[MissingTabs, ...]:
    kerfs = shapely.get_parts(cut)
    tree = shapely.STRtree(kerfs)

    def uncut(line: Any) -> Any:
        near = kerfs[tree.query(line, predicate="intersects")]
        return shapely.difference(line, merge_shapes(near)) if len(near) else line

    missing = []
    for loop in _find_loops(design):
        operation, tool = loop.tabbed.job.operation, loop.tabbed.job.tool
        tabs = uncut(loop.line)
        if tabs.geom_type == "MultiLineString":
            tabs = shapely.line_merge(tabs)
        lengths = shapely.length(shapely.get_parts(tabs))
        longest = operation.tab_width + sum(tab_slopes(operation)) + _LONGER_MM
        # If more is left, the kerf is not closed: other material than tabs holds the part.
        if lengths.max(initial=0.0) > longest:
            continue
        if loop.around and all(uncut(line).equals(line) for line in loop.around):
            continue
        count = int((lengths >= _MIN_TAB * operation.tab_width).sum())
        wanted, length = loop.tabbed.count(loop.line.length), loop.line.length
        # Without any tab the piece itself is loose.
        if not 0 < count < wanted or length <= find_tab_room(operation, tool.diameter, count):
            continue
        rows = find.near(loop.line, operation.finish + _BEYOND_MM)
        name = design.cells.ids[loop.tabbed.loop]
        missing.append(MissingTabs(name, count, wanted, int(rows[-1])))
    return tuple(missing)


def _find_loops(design: Design) -> list[_Loop]:
    loops: list[_Loop] = []
    jobs = {id(tabbed.job): tabbed.job for tabbed in design.tabbed}
    for key, job in jobs.items():
        members = [tabbed for tabbed in design.tabbed if id(tabbed.job) == key]
        kerfs = _widen(design, [tabbed for tabbed in members if not tabbed.inside])
        loops += _find_outer_loops(kerfs)
        for tabbed in members:
            if tabbed.inside:
                loops += _find_inner_loops(design, tabbed, job.tool.radius, kerfs)
    return loops


class _Kerfs(NamedTuple):
    """Outlines in one cell of the drawing.

    tabbed: the outlines.
    shapes: each outline, widened to the middle of the kerf around it.
    """

    tabbed: list[Tabbed]
    shapes: Shapes


def _widen(design: Design, outlines: Sequence[Tabbed]) -> dict[int, _Kerfs]:
    cells = design.cells
    by_cell: dict[int, list[Tabbed]] = {}
    for tabbed in outlines:
        by_cell.setdefault(int(cells.parent[tabbed.loop]), []).append(tabbed)
    kerfs = {}
    for cell, group in by_cell.items():
        rings = cells.rings[[tabbed.loop for tabbed in group]]
        shapes = shapely.buffer(rings, group[0].job.tool.radius, quad_segs=QUARTER)
        kerfs[cell] = _Kerfs(group, np.asarray(shapes))
    return kerfs


def _find_outer_loops(kerfs: dict[int, _Kerfs]) -> Iterator[_Loop]:
    """Find the kerfs around outlines; outlines near to each other have the same kerf."""
    for group, shapes in kerfs.values():
        joined = shapely.get_parts(merge_shapes(shapes))
        member, union = shapely.STRtree(joined).query(shapes, predicate="intersects")
        first = dict(zip(union[::-1].tolist(), member[::-1].tolist(), strict=True))
        for k, shape in enumerate(joined):
            yield _Loop(shapely.get_exterior_ring(shape), group[first[k]])


def _find_inner_loops(
    design: Design, tabbed: Tabbed, radius: float, kerfs: dict[int, _Kerfs]
) -> Iterator[_Loop]:
    """Find the kerfs in a hole that do not come near to a part in it."""
    around: list[Any] = []
    for group, shapes in kerfs.values():
        chosen = [k for k, outline in enumerate(group) if outline.loop in tabbed.around]
        around += shapely.boundary(shapes[chosen]).tolist()
    within = kerfs[tabbed.loop].shapes if tabbed.loop in kerfs else np.zeros(0, object)
    room = shapely.buffer(design.cells.rings[tabbed.loop], -radius, quad_segs=QUARTER)
    for line in shapely.get_exterior_ring(shapely.get_parts(room)):
        if not shapely.intersects(within, line).any():
            yield _Loop(line, tabbed, tuple(around))
