"""Computes removed volumes and rest material, level by level.

Rest material that no tool of this radius can reach, such as in inner corners, counts apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import compress, pairwise
from typing import Any

import numpy as np
import shapely
from msgspec import Struct
from numpy.typing import NDArray

from camgen.check.stock.cells import Shapes
from camgen.check.stock.design import Design, Wanted, make_kerfs
from camgen.check.stock.moves import TOLERANCE_MM, Cut, Moves
from camgen.check.stock.profile import is_flat
from camgen.check.stock.sweep import QUARTER, merge_shapes, select_distinct, sweep
from camgen.geometry.intersect import measure_nearest
from camgen.geometry.ragged import list_owners, number_rows
from camgen.geometry.segments import points_at
from camgen.model.sequences import take_rows

#: mm: depths that differ by less are one.
_SAME_MM = 2 * TOLERANCE_MM
#: Slices into which the depth of a tool is divided that is not a cylinder.
_SLICES = 8
#: mm: narrower rest material comes from the chords of the polygons.
_NARROW_MM = 0.04
#: mm: polygons on both sides of a line are widened by this, so that they become one.
_SEAM_MM = 1e-4
#: mm: a contour counts as cut where the tool leaves less than this.
_TOUCH_MM = 0.01
#: Maximum number of levels. For a program with more, a grid of heights is used instead.
MAX_LEVELS = 48


class Excess(Struct, frozen=True, eq=False):
    """Rest material of one level.

    area: all rest material, mm2.
    corners: part of it that no tool of this radius can reach, mm2.
    tabs: part of it that is tabs of the job, mm2.
    size: diameter of the largest disc in the unexplained part, mm.
    place: centre of that disc, mm.
    pieces: polygons of all rest material.
    unexplained: polygons of the part that is none of corners, tabs and `untaken`.
    untaken: part of it that paths would remove which are left out, mm2.
    """

    area: float
    corners: float
    tabs: float
    size: float
    place: tuple[float, float] | None
    pieces: Any
    unexplained: Any
    untaken: float = 0.0


class Level(Struct, frozen=True, eq=False):
    """A slab of the stock.

    top: z of its top, mm, 0 or negative.
    bottom: z of its bottom, mm.
    gone: polygons of the removed material half-way down.
    excess: rest material.
    """

    top: float
    bottom: float
    gone: Any
    excess: Excess


def find_levels(moves: Moves, cuts: Sequence[Cut], design: Design) -> list[float]:
    """List the depths at which the motions or the operations change, mm, from 0 downwards."""
    down = moves.deepest
    cutting = (down > TOLERANCE_MM) & ~moves.rapid
    changes = [
        down[cutting & moves.level & ~moves.upright],
        down[cutting & moves.upright],
        np.array([wanted.depth for wanted in design.wanted]),
        down[cutting].max(initial=0.0, keepdims=True),
    ]
    depths = np.concatenate([np.round(each, 3) for each in changes])
    if design.thickness is not None and cutting.any():
        depths = np.append(np.minimum(depths, design.thickness), design.thickness)
    elif len(depths) and not np.isfinite(depths).any():
        depths = np.array([1.0])
    depths = np.unique(depths[np.isfinite(depths) & (depths > TOLERANCE_MM)])
    if len(depths) and not all(is_flat(cut.tool) for cut in cuts):
        slices = np.linspace(0, float(depths[-1]), _SLICES + 1)[1:]
        depths = np.unique(np.concatenate([depths, slices]))
    if len(depths):
        depths = depths[np.diff(depths, prepend=-np.inf) > _SAME_MM]
    return [0.0, *depths.tolist()]


def remove_material(
    moves: Moves, cuts: Sequence[Cut], design: Design, depths: Sequence[float]
) -> tuple[tuple[Level, ...], tuple[float, ...]]:
    """Compute the slabs between `depths`, from the top, and the volumes that the cuts remove, mm3.

    The volume of a cut is the material that no cut before it removed.
    """
    volumes = np.zeros(len(cuts))
    slabs: list[Level] = []
    seen: list[set[bytes]] = [set() for _ in cuts]
    gone: list[Any] = [shapely.Polygon()] * len(cuts)
    deep = moves.deepest > TOLERANCE_MM
    rows = [np.flatnonzero((moves.cut == k) & deep) for k in range(len(cuts))]
    excess: _RestMaterial | None = None
    # From below, since material that is removed at one depth is removed above it too.
    for top, bottom in reversed(list(pairwise(depths))):
        middle = (top + bottom) / 2
        whole = shapely.Polygon()
        before = 0.0
        for k in range(len(cuts)):
            new = sweep(moves, cuts, middle, rows[k], seen[k] if is_flat(cuts[k].tool) else None)
            gone[k] = merge_shapes([gone[k], *new]) if len(new) else gone[k]
            whole = gone[k] if len(cuts) == 1 or whole.is_empty else shapely.union(whole, gone[k])
            area = _area_within(whole, design.outline)
            volumes[k] += (area - before) * (bottom - top)
            before = area
        excess = _find_rest(moves, cuts, design, (top, bottom), whole, excess)
        slabs.append(Level(-top, -bottom, whole, excess.excess))
    return tuple(reversed(slabs)), tuple(volumes.tolist())


def _area_within(shape: Any, outline: Any) -> float:
    if shape.is_empty:
        return 0.0
    inside = outline.covers(shapely.box(*shape.bounds))
    return float(shape.area if inside else shape.intersection(outline).area)


class _RestMaterial(Struct, frozen=True, eq=False):
    """The rest material of a level, and the shapes from which it was computed.

    The next level has the same rest material if these shapes are the same.
    """

    wanted: tuple[int, ...]
    gone: Any
    excess: Excess


def _find_rest(
    moves: Moves,
    cuts: Sequence[Cut],
    design: Design,
    slab: tuple[float, float],
    gone: Any,
    below: _RestMaterial | None,
) -> _RestMaterial:
    """Find the rest material of a slab from depth `slab[0]` to `slab[1]`, mm."""
    depth = slab[1]
    chosen = tuple(k for k, want in enumerate(design.wanted) if want.depth >= depth - _SAME_MM)
    wanted = take_rows(design.wanted, chosen)
    is_same = below is not None and below.wanted == chosen and below.gone is gone
    if below is not None and is_same and not any(want.tabs[0] for want in wanted):
        return below
    rest = list(compress(wanted, ~_find_cleared_kerfs(moves, cuts, design, wanted, sum(slab) / 2)))
    excess = _make_excess(make_kerfs(design, rest), gone, depth, design.untaken)
    return _RestMaterial(chosen, gone, excess)


def _find_cleared_kerfs(
    moves: Moves, cuts: Sequence[Cut], design: Design, wanted: Sequence[Wanted], depth: float
) -> NDArray[np.bool_]:
    """Return (W,) True for kerfs along whose whole contour a tool of their width runs.

    The contours are sampled so densely that less than `_TOUCH_MM` can be left between two samples.
    """
    loops = np.array([want.loop for want in wanted], dtype=np.int64)
    missed = loops < 0
    kerfs = np.flatnonzero(~missed)
    if not len(kerfs):
        return ~missed
    radius = np.zeros(len(design.cells))
    radius[loops[kerfs]] = [wanted[k].radius for k in kerfs.tolist()]
    segments = design.cells.segments
    segments = segments.take(radius[segments.owner] > 0)
    step = np.sqrt(8 * _TOUCH_MM * radius[segments.owner])
    count = np.maximum(np.ceil(segments.length / step), 1).astype(np.int64)
    which, share = list_owners(count), number_rows(count) / np.maximum(count, 1)[list_owners(count)]
    points = points_at(segments.take(which), share)
    touched = np.zeros(len(points), dtype=np.bool_)
    for number, cut in enumerate(cuts):
        if is_flat(cut.tool):
            tool_radius = cut.tool.radius
            deep = moves.below(depth, np.flatnonzero(moves.cut == number))
            fits = radius[segments.owner[which]] <= tool_radius + TOLERANCE_MM
            gap = measure_nearest(points, select_distinct(deep.plane), tool_radius + _TOUCH_MM)
            touched |= fits & (gap < np.inf)
    bare = np.bincount(segments.owner[which], ~touched, len(design.cells)) > 0
    missed[kerfs] = bare[loops[kerfs]]
    return ~missed


def _make_excess(wanted: Sequence[Wanted], gone: Any, depth: float, untaken: Any) -> Excess:
    pieces, owner = _find_pieces(wanted, gone)
    if not len(pieces):
        return Excess(0.0, 0.0, 0.0, 0.0, None, shapely.MultiPolygon(), shapely.MultiPolygon())
    reachable = _find_reachable(pieces, owner, wanted)
    corners = _remove_slivers(shapely.difference(pieces, reachable))
    plain = _remove_slivers(shapely.intersection(pieces, reachable))
    tab = np.array(
        [_is_tab(piece, wanted[k], depth) for piece, k in zip(plain, owner.tolist(), strict=True)]
    )
    rest = plain[~tab & ~shapely.is_empty(plain)]
    untaken_mm2 = 0.0
    if untaken is not None:
        whole = float(shapely.area(rest).sum())
        rest = _remove_slivers(shapely.difference(rest, untaken))
        rest = rest[~shapely.is_empty(rest)]
        untaken_mm2 = whole - float(shapely.area(rest).sum())
    size, place = _find_largest_disc(rest)
    return Excess(
        area=float(shapely.area(pieces).sum()),
        # Two operations may leave the same corner.
        corners=float(shapely.area(merge_shapes(corners))),
        tabs=float(shapely.area(plain[tab]).sum()),
        size=size,
        place=place,
        pieces=merge_shapes(pieces),
        unexplained=merge_shapes(rest),
        untaken=untaken_mm2,
    )


def _find_pieces(wanted: Sequence[Wanted], gone: Any) -> tuple[Shapes, Any]:
    """Return the rest material without slivers, and the index in `wanted` of each piece."""
    shapes = np.array([want.shape for want in wanted], dtype=object)
    if not len(shapes):
        return shapes, np.zeros(0, np.int64)
    parts = shapely.get_parts(gone)
    left = shapes.copy()
    which, part = shapely.STRtree(parts).query(shapes, predicate="intersects")
    order = np.argsort(which, kind="stable")
    chosen, first = np.unique(which[order], return_index=True)
    covers = np.split(parts[part[order]], first[1:]) if len(chosen) else []
    whole = [near[0] if len(near) == 1 else merge_shapes(near) for near in covers]
    left[chosen] = shapely.difference(shapes[chosen], np.array(whole, dtype=object))
    left = _remove_slivers(left)
    pieces, owner = shapely.get_parts(left, return_index=True)
    filled = ~shapely.is_empty(pieces)
    return pieces[filled], owner[filled]


def _remove_slivers(shapes: Shapes) -> Shapes:
    half = _NARROW_MM / 2
    # An intersection may have lines and points besides polygons, which GEOS does not overlay.
    mixed = shapely.get_type_id(shapes) == shapely.GeometryType.GEOMETRYCOLLECTION
    shapes = np.where(mixed, shapely.buffer(shapes, 0.0), shapes) if mixed.any() else shapes
    thin = shapely.buffer(shapes, -half, quad_segs=2)
    return np.asarray(shapely.intersection(shapes, shapely.buffer(thin, 2 * half, quad_segs=2)))


def _find_reachable(pieces: Shapes, owner: Any, wanted: Sequence[Wanted]) -> Shapes:
    """Compute the area around each piece that the tool can reach within its room.

    In a kerf the tool must touch the contour.
    """
    reachable = np.empty(len(pieces), dtype=object)
    for k, (piece, index) in enumerate(zip(pieces, owner.tolist(), strict=True)):
        want = wanted[index]
        if not want.radius:
            reachable[k] = piece
            continue
        low_x, low_y, high_x, high_y = piece.bounds
        width = 4 * want.radius
        around = low_x - width, low_y - width, high_x + width, high_y + width
        room = shapely.clip_by_rect(want.room, *around)
        if want.ring is None:
            # A slot as wide as the tool is reached: its centre may be nearer to a wall by this.
            centres = shapely.buffer(room, -(want.radius - TOLERANCE_MM / 2), quad_segs=QUARTER)
        else:
            centres = _find_kerf_centres(room, want, around)
        reachable[k] = shapely.buffer(centres, want.radius, quad_segs=QUARTER)
    return reachable


def _find_kerf_centres(room: Any, want: Wanted, around: tuple[float, float, float, float]) -> Any:
    """Return the offset curve on which the tool touches its contour and no other wall."""
    radius = want.radius - TOLERANCE_MM / 2
    ring = shapely.clip_by_rect(want.ring, *around)
    inside = want.cell == want.loop
    curve = shapely.boundary(shapely.buffer(ring, -radius if inside else radius, quad_segs=QUARTER))
    material = shapely.box(*around) - ring if inside else ring
    # The material on the other side of the contour itself is not another wall.
    free = shapely.union(
        shapely.buffer(room, _SEAM_MM, quad_segs=1), shapely.buffer(material, _SEAM_MM, quad_segs=1)
    )
    # A little farther than from the contour itself: a wall in line with it ends the curve.
    allowed = shapely.buffer(free, -want.radius - 2 * TOLERANCE_MM, quad_segs=QUARTER)
    return shapely.intersection(curve, allowed)


def _is_tab(piece: Any, wanted: Wanted, depth: float) -> bool:
    """Whether a piece is at most as large as a tab across the kerf.

    The tab includes the slopes of its ends, and the material that the round tool leaves there.
    """
    height, width, slopes = wanted.tabs
    if not height or depth <= wanted.depth - height + TOLERANCE_MM or piece.is_empty:
        return False
    share = min(1.0, (depth - wanted.depth + height) / height)
    longest = width + 2 * wanted.radius + share * slopes
    return bool(piece.area <= 1.1 * longest * 2 * wanted.radius)


def _find_largest_disc(shapes: Shapes) -> tuple[float, tuple[float, float] | None]:
    if not len(shapes):
        return 0.0, None
    largest = shapes[np.argsort(-shapely.area(shapes), kind="stable")[:8]]
    circles = [shapely.maximum_inscribed_circle(shape, tolerance=0.005) for shape in largest]
    best = max(circles, key=lambda circle: circle.length)
    return 2 * float(best.length), (float(best.coords[0][0]), float(best.coords[0][1]))
