"""What is gone and what is left, level by level: volumes, and the excess with what of it inner corners explain."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import shapely
from msgspec import Struct
from numpy.typing import NDArray

from camgen.check.stock.cells import Shapes
from camgen.check.stock.design import Design, Wanted, lay_out
from camgen.check.stock.moves import TOLERANCE_MM, Cut, Moves
from camgen.check.stock.profile import is_flat
from camgen.check.stock.sweep import QUARTER, distinct, sweep, unite
from camgen.geometry.intersect import measure_nearest
from camgen.geometry.ragged import owners, ramp
from camgen.geometry.segments import points_at

#: Depths nearer than this, mm, are one.
_SAME_MM = 2 * TOLERANCE_MM
#: A tool that is no cylinder is looked at in so many slices of the depth that it reaches.
_SLICES = 8
#: What is left but narrower than this, mm, is the chords of the polygons.
_NARROW_MM = 0.04
#: Polygons on both sides of a line are one when each is wider by this, mm.
_SEAM_MM = 1e-4
#: A contour is cut along where the tool leaves less than this of it, mm.
_TOUCH_MM = 0.01
#: More levels than this are no work in levels: a grid of heights takes over.
MOST_LEVELS = 48


class Excess(Struct, frozen=True, eq=False):
    """Material that should be gone and is not, at one level. area: mm2, all of it. corners: of it, where no tool of
    this radius can reach. tabs: of it, bridges that were asked for. untaken: of it, what paths that are left out would
    take. pieces: polygons of all of it; unexplained: of what is none of these. size: mm, the widest disc in
    that. place: in its middle.
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
    """A slab of the stock. top, bottom: z in mm, 0 and below. gone: polygons of what was taken away, half-way down.
    removed: mm2 of it within the stock.
    """

    top: float
    bottom: float
    gone: Any
    removed: float
    excess: Excess


def find_levels(moves: Moves, cuts: Sequence[Cut], design: Design) -> list[float]:
    """The depths, mm, at which something changes, in order, 0 first: of motions on one level and of operations."""
    down = moves.deepest
    cutting = (down > TOLERANCE_MM) & ~moves.rapid
    depths = [down[cutting & moves.level & ~moves.upright], down[cutting & moves.upright]]
    depths += [
        np.array([wanted.depth for wanted in design.wanted]),
        down[cutting].max(initial=0.0, keepdims=True),
    ]
    every = np.concatenate([np.round(one, 3) for one in depths])
    if design.thickness is not None and cutting.any():
        every = np.append(np.minimum(every, design.thickness), design.thickness)
    elif len(every) and not np.isfinite(every).any():
        every = np.array([1.0])
    every = np.unique(every[np.isfinite(every) & (every > TOLERANCE_MM)])
    if len(every) and not all(is_flat(cut.tool) for cut in cuts):
        every = np.unique(
            np.concatenate([every, np.linspace(0, float(every[-1]), _SLICES + 1)[1:]])
        )
    kept = every[np.diff(every, prepend=-np.inf) > _SAME_MM] if len(every) else every
    return [0.0, *kept.tolist()]


def remove(
    moves: Moves, cuts: Sequence[Cut], design: Design, depths: Sequence[float]
) -> tuple[tuple[Level, ...], tuple[float, ...]]:
    """The slabs between ``depths``, from the top, and the mm3 that each cut takes away that none before it did."""
    volumes = np.zeros(len(cuts))
    slabs: list[Level] = []
    seen: list[set[bytes]] = [set() for _ in cuts]
    gone: list[Any] = [shapely.Polygon() for _ in cuts]
    rows = [
        np.flatnonzero((moves.cut == k) & (moves.deepest > TOLERANCE_MM)) for k in range(len(cuts))
    ]
    excess: _Left | None = None
    # From below, since what is gone at one depth is gone above it too.
    for top, bottom in reversed(list(pairwise(depths))):
        middle = (top + bottom) / 2
        whole = shapely.Polygon()
        before = 0.0
        for k in range(len(cuts)):
            new = sweep(moves, cuts, middle, rows[k], seen[k] if is_flat(cuts[k].tool) else None)
            gone[k] = unite([gone[k], *new]) if len(new) else gone[k]
            whole = gone[k] if len(cuts) == 1 or whole.is_empty else shapely.union(whole, gone[k])
            area = _area_within(whole, design.outline)
            volumes[k] += (area - before) * (bottom - top)
            before = area
        excess = _left(moves, cuts, design, (top, bottom), whole, excess)
        slabs.append(Level(-top, -bottom, whole, before, excess.excess))
    return tuple(reversed(slabs)), tuple(volumes.tolist())


def _area_within(shape: Any, outline: Any) -> float:
    if shape.is_empty:
        return 0.0
    low_x, low_y, high_x, high_y = shape.bounds
    inside = outline.covers(shapely.box(low_x, low_y, high_x, high_y))
    return float(shape.area if inside else shape.intersection(outline).area)


# Excess.


class _Left(Struct, frozen=True, eq=False):
    """The excess of the level below: that of this one too where neither what is wanted nor what is gone differs."""

    wanted: tuple[int, ...]
    gone: Any
    excess: Excess


def _left(
    moves: Moves,
    cuts: Sequence[Cut],
    design: Design,
    slab: tuple[float, float],
    gone: Any,
    below: _Left | None,
) -> _Left:
    """slab: the depths of its top and bottom, mm."""
    depth = slab[1]
    chosen = tuple(k for k, one in enumerate(design.wanted) if one.depth >= depth - _SAME_MM)
    if (
        below is not None
        and below.wanted == chosen
        and below.gone is gone
        and not any(design.wanted[k].tabs[0] for k in chosen)
    ):
        return below
    wanted = [design.wanted[k] for k in chosen]
    done = _all_along(moves, cuts, design, wanted, sum(slab) / 2)
    open_ = lay_out(
        design, [one for one, all_ in zip(wanted, done.tolist(), strict=True) if not all_]
    )
    return _Left(chosen, gone, _excess(open_, gone, depth, design.untaken))


def _all_along(
    moves: Moves, cuts: Sequence[Cut], design: Design, wanted: Sequence[Wanted], depth: float
) -> NDArray[np.bool_]:
    """(W,) the kerfs along whose contours a tool as wide runs everywhere: nothing is left of them.

    Places on the contours so near to each other that less than ``_TOUCH_MM`` can stand between them.
    """
    loops = np.array([one.loop for one in wanted], dtype=np.int64)
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
    which, share = owners(count), ramp(count) / np.maximum(count, 1)[owners(count)]
    points = points_at(segments.take(which), share)
    touched = np.zeros(len(points), dtype=np.bool_)
    for number, cut in enumerate(cuts):
        if is_flat(cut.tool):
            most = cut.tool.radius
            deep = moves.below(depth, np.flatnonzero(moves.cut == number))
            fits = radius[segments.owner[which]] <= most + TOLERANCE_MM
            gap = measure_nearest(points, distinct(deep.plane), most + _TOUCH_MM)
            touched |= fits & (gap < np.inf)
    bare = np.bincount(segments.owner[which], ~touched, len(design.cells)) > 0
    missed[kerfs] = bare[loops[kerfs]]
    return ~missed


def _excess(wanted: Sequence[Wanted], gone: Any, depth: float, untaken: Any) -> Excess:
    pieces, owner = _pieces(wanted, gone)
    if not len(pieces):
        return Excess(0.0, 0.0, 0.0, 0.0, None, shapely.MultiPolygon(), shapely.MultiPolygon())
    reachable = _reachable(pieces, owner, wanted)
    corners = _without_slivers(shapely.difference(pieces, reachable))
    plain = _without_slivers(shapely.intersection(pieces, reachable))
    bridge = np.array(
        [_is_tab(one, wanted[k], depth) for one, k in zip(plain, owner.tolist(), strict=True)]
    )
    tabs = float(shapely.area(plain[bridge]).sum())
    rest = plain[~bridge & ~shapely.is_empty(plain)]
    whole = float(shapely.area(rest).sum())
    if untaken is not None:
        rest = _without_slivers(shapely.difference(rest, untaken))
        rest = rest[~shapely.is_empty(rest)]
    size, place = _widest(rest)
    return Excess(
        float(shapely.area(pieces).sum()),
        # Two operations may leave the same corner.
        float(shapely.area(unite(corners))),
        tabs,
        size,
        place,
        unite(pieces),
        unite(rest),
        whole - float(shapely.area(rest).sum()) if untaken is not None else 0.0,
    )


def _pieces(wanted: Sequence[Wanted], gone: Any) -> tuple[Shapes, Any]:
    """What is left of each, without slivers, and of which it is."""
    shapes = np.array([one.shape for one in wanted], dtype=object)
    if not len(shapes):
        return shapes, np.zeros(0, np.int64)
    parts = shapely.get_parts(gone)
    tree = shapely.STRtree(parts)
    left = shapes.copy()
    which, part = tree.query(shapes, predicate="intersects")
    order = np.argsort(which, kind="stable")
    chosen, first = np.unique(which[order], return_index=True)
    covers = np.split(parts[part[order]], first[1:]) if len(chosen) else []
    whole = np.array([near[0] if len(near) == 1 else unite(near) for near in covers], dtype=object)
    left[chosen] = shapely.difference(shapes[chosen], whole)
    left = _without_slivers(left)
    pieces, owner = shapely.get_parts(left, return_index=True)
    filled = ~shapely.is_empty(pieces)
    return pieces[filled], owner[filled]


def _without_slivers(shapes: Shapes) -> Shapes:
    half = _NARROW_MM / 2
    # An intersection may have lines and points beside polygons, which GEOS does not overlay.
    mixed = shapely.get_type_id(shapes) == shapely.GeometryType.GEOMETRYCOLLECTION
    shapes = np.where(mixed, shapely.buffer(shapes, 0.0), shapes) if mixed.any() else shapes
    thin = shapely.buffer(shapes, -half, quad_segs=2)
    return np.asarray(shapely.intersection(shapes, shapely.buffer(thin, 2 * half, quad_segs=2)))


def _reachable(pieces: Shapes, owner: Any, wanted: Sequence[Wanted]) -> Shapes:
    """Where around each piece a disc of the tool fits into its room, touching the contour if it runs beside one."""
    found = np.empty(len(pieces), dtype=object)
    for k, (piece, one) in enumerate(zip(pieces, owner.tolist(), strict=True)):
        want = wanted[one]
        if not want.radius:
            found[k] = piece
            continue
        around = _grown(piece.bounds, 4 * want.radius)
        room = shapely.clip_by_rect(want.room, *around)
        # A slot as wide as the tool is reached: the centre may be that much nearer to a wall.
        radius = want.radius - TOLERANCE_MM / 2
        free = want.ring is None
        centres = (
            shapely.buffer(room, -radius, quad_segs=QUARTER)
            if free
            else _beside(room, want, around)
        )
        found[k] = shapely.buffer(centres, want.radius, quad_segs=QUARTER)
    return found


def _beside(room: Any, want: Wanted, around: tuple[float, float, float, float]) -> Any:
    """Where in ``room`` the centre of a tool runs that touches the contour and keeps off all others."""
    radius = want.radius - TOLERANCE_MM / 2
    own = shapely.clip_by_rect(want.ring, *around)
    inside = want.cell == want.loop
    way = shapely.boundary(shapely.buffer(own, -radius if inside else radius, quad_segs=QUARTER))
    behind = shapely.box(*around) - own if inside else own
    others = shapely.union(
        shapely.buffer(room, _SEAM_MM, quad_segs=1), shapely.buffer(behind, _SEAM_MM, quad_segs=1)
    )
    # A little more than from the contour itself: a wall that goes on in its line ends the way.
    return shapely.intersection(
        way, shapely.buffer(others, -want.radius - 2 * TOLERANCE_MM, quad_segs=QUARTER)
    )


def _grown(bounds: Any, by: float) -> tuple[float, float, float, float]:
    low_x, low_y, high_x, high_y = bounds
    return low_x - by, low_y - by, high_x + by, high_y + by


def _is_tab(piece: Any, wanted: Wanted, depth: float) -> bool:
    """Whether a piece is no larger than a bridge across the kerf.

    The bridge has the slopes of its two ends, and what the round tool leaves there.
    """
    height, width, slopes = wanted.tabs
    if not height or depth <= wanted.depth - height + TOLERANCE_MM or piece.is_empty:
        return False
    share = min(1.0, (depth - wanted.depth + height) / height)
    longest = width + 2 * wanted.radius + share * slopes
    return bool(piece.area <= 1.1 * longest * 2 * wanted.radius)


def _widest(shapes: Shapes) -> tuple[float, tuple[float, float] | None]:
    """The diameter of the widest disc in any of ``shapes``, mm, and where it is."""
    if not len(shapes):
        return 0.0, None
    largest = shapes[np.argsort(-shapely.area(shapes), kind="stable")[:8]]
    circles = [shapely.maximum_inscribed_circle(one, tolerance=0.005) for one in largest]
    best = max(circles, key=lambda one: one.length)
    return 2 * float(best.length), (float(best.coords[0][0]), float(best.coords[0][1]))
