"""Material that must stay and is cut: distances from the way of the tool's axis to the walls, against its radius.

A cell that may be cut down to D mm stays below that. So for every such depth D, what of the motions runs deeper than D
is measured against the walls around all cells that may be cut no deeper. A tool is widest there at D: the radius at the
height of the tip's depth less D. How far it is in the material is the least way out: sideways, or up.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from msgspec import Struct
from msgspec.structs import replace

from camgen.check.stock.cells import CHORD_MM
from camgen.check.stock.design import Bevel, Design, Lines
from camgen.check.stock.moves import TOLERANCE_MM, Cut, Moves, Portions
from camgen.check.stock.profile import reach
from camgen.check.stock.sweep import QUARTER, same_ways
from camgen.geometry.intersect import make_boxes, measure_distances, measure_gaps
from camgen.geometry.segments import (
    BoolArray,
    IntArray,
    Segments,
    compute_bounds,
    flatten,
    make,
    points_at,
    tangents_at,
)
from camgen.model.pose import FloatArray, to_vec3

#: A traced line is drawn within the chord tolerance and the rounding of its corners, mm.
_TRACED_MM = 0.015
#: Motions on lines are looked at in these places of their length.
_PLACES = np.linspace(0.0, 1.0, 9)
#: So many gouges at each depth are measured; of the others the least is told.
_MEASURED = 2000
#: Places of a motion in the material that are measured, to tell how deep it is in it.
_SAMPLES = 33


class Gouge(Struct, frozen=True):
    """A motion that cuts material that must stay.

    row: row of the motion.
    place: x, y, z of the tip, mm.
    mm: depth of the tool in the material.
    below: whether it is too deep rather than too far aside.
    """

    row: int
    place: tuple[float, float, float]
    mm: float
    below: bool


class _Stays(Struct, frozen=True, eq=False):
    """Material of a design that stays below a depth.

    limit: the depth, mm below the top face.
    cells: (C,) whether a cell stays.
    walls: segments around the cells that stay.
    """

    design: Design
    limit: float
    cells: BoolArray
    walls: IntArray

    def contains(self, points: FloatArray) -> BoolArray:
        """(N,) whether points (N, 2) lie in a cell that stays."""
        return self.cells[self.design.cells.find(points)]


def find_gouges(moves: Moves, cuts: Sequence[Cut], design: Design) -> list[Gouge]:
    """The worst gouge of every motion that has one, in order."""
    rows = _find_judged(moves, cuts, design, np.zeros(len(moves)))
    worst: dict[int, Gouge] = {}
    if not len(rows):
        return []
    for limit in _limits(design):
        for gouge in _beyond(moves, cuts, design, rows, limit):
            if gouge.row not in worst or gouge.mm > worst[gouge.row].mm:
                worst[gouge.row] = gouge
    return [worst[row] for row in sorted(worst)]


def measure_bites(moves: Moves, cuts: Sequence[Cut], design: Design) -> FloatArray:
    """(N,) depth, mm, to which each motion cuts material that must stay; 0 for none.

    A motion leaves a programmed one, which cuts nothing that must stay, by `moves.chord`. So far it
    may also leave the lines of the drawing on which the programmed one runs.
    """
    bites = np.zeros(len(moves))
    rows = _find_judged(moves, cuts, design, moves.chord)
    if not len(rows):
        return bites
    for limit in _limits(design):
        stays = _find_stays(design, limit)
        deep = moves.below(limit + TOLERANCE_MM, rows)
        if not len(deep.row) or not stays.cells.any():
            continue
        radius = _radius(moves, cuts, deep, limit)
        allowed = _allowed(moves, cuts, deep, design, limit)
        each = np.arange(len(deep.row))
        aside = radius - _gaps(deep.plane, each, stays, float(radius.max()), allowed)
        # A tool that leaves the path by its radius may have its middle in material that stays.
        far = np.flatnonzero(moves.chord[deep.row] >= radius)
        middles = points_at(deep.plane.take(far), np.full(len(far), 0.5))
        within = far[stays.contains(middles)]
        aside[within] = 2 * radius[within]
        cutting = np.flatnonzero(aside > 0)
        portions = Portions(
            deep.row[cutting], deep.low[cutting], deep.high[cutting], deep.plane.take(cutting)
        )
        cutting = cutting[~_off_stock(portions, radius[cutting], design)]
        depth = np.minimum(aside[cutting], moves.deepest[deep.row[cutting]] - limit)
        np.maximum.at(bites, deep.row[cutting], depth)
    return bites


def _find_judged(moves: Moves, cuts: Sequence[Cut], design: Design, slack: FloatArray) -> IntArray:
    """The motions that cut and have no line of the drawing to run on.

    slack: (N,) distance, mm, by which each may leave such a line.
    """
    if design.free or not len(moves):
        return np.zeros(0, dtype=np.intp)
    cutting = (moves.deepest > TOLERANCE_MM) & ~moves.rising
    return np.flatnonzero(cutting & ~_explained(moves, cuts, design, slack))


def _limits(design: Design) -> list[float]:
    """The depths below which cells stay."""
    depths = np.append(design.depth, [0.0, *(bevel.depth for bevel in design.bevels)])
    return [float(depth) for depth in np.unique(depths[np.isfinite(depths)])]


def _beyond(
    moves: Moves, cuts: Sequence[Cut], design: Design, rows: IntArray, limit: float
) -> list[Gouge]:
    """Gouges of what may be cut down to ``limit`` mm and no deeper."""
    deep = moves.below(limit + TOLERANCE_MM, rows)
    stays = _find_stays(design, limit)
    if not len(deep.row) or not stays.cells.any():
        return []
    radius = _radius(moves, cuts, deep, limit)
    allowed = _allowed(moves, cuts, deep, design, limit)
    apart, within = _apart(deep.plane, stays, float(radius.max()), allowed)
    within &= ~_off_stock(deep, radius, design)
    chord = moves.chord[deep.row]
    near = apart < radius - TOLERANCE_MM
    # A straight motion in the place of an arc leaves it between its ends; at its ends it does not.
    doubtful = np.flatnonzero(
        near & ~within & (chord > 0) & (apart >= radius - TOLERANCE_MM - chord)
    )
    near[doubtful] = _at_ends(deep, doubtful, stays, radius, allowed)
    hit = np.flatnonzero(within | near)
    for _, chosen, more in allowed:
        radius = np.where(chosen, radius - more, radius)
    found = (_measure(moves, stays, deep, k, float(radius[k])) for k in hit[:_MEASURED].tolist())
    aside = np.where(within, radius, radius - apart)
    rest = (_estimate(moves, deep, k, float(aside[k]), limit) for k in hit[_MEASURED:].tolist())
    return [gouge for gouge in (*found, *rest) if gouge]


def _find_stays(design: Design, limit: float) -> _Stays:
    cells = design.cells
    kept = design.depth <= limit + TOLERANCE_MM / 2
    walls = np.flatnonzero(np.isin(cells.segments.owner, cells.walls(kept)))
    return _Stays(design, limit, kept, walls)


def _at_ends(
    deep: Portions,
    rows: IntArray,
    stays: _Stays,
    radius: FloatArray,
    allowed: list[tuple[Bevel, BoolArray, float]],
) -> BoolArray:
    """(R,) which of the portions ``rows`` are too near to the walls at an end of their motion."""
    found = np.zeros(len(rows), dtype=np.bool_)
    own = [(bevel, chosen[rows], more) for bevel, chosen, more in allowed]
    for whole, place in (
        (deep.low[rows] == 0.0, deep.plane.start),
        (deep.high[rows] == 1.0, deep.plane.end),
    ):
        points = place[rows]
        tips = make(points, points, np.zeros(len(rows)), rows)
        apart, _ = _apart(tips, stays, float(radius.max()), own)
        found |= whole & (apart < radius[rows] - TOLERANCE_MM)
    return found


def _estimate(moves: Moves, deep: Portions, k: int, aside: float, limit: float) -> Gouge:
    """A gouge of at least so much ``aside``, where so many are found that their worst places are not looked for."""
    row = int(deep.row[k])
    up = float(moves.deepest[row]) - limit
    return Gouge(row, to_vec3(moves.end[row]), min(aside, up), up < aside)


def _radius(moves: Moves, cuts: Sequence[Cut], deep: Portions, limit: float) -> FloatArray:
    """(K,) the radius of each tool where it comes into what stays below ``limit``, mm."""
    height = moves.deepest[deep.row] - limit
    radius = np.empty(len(deep.row))
    for number, cut in enumerate(cuts):
        own = moves.cut[deep.row] == number
        radius[own] = reach(cut.tool, height[own])
    return radius


def _allowed(
    moves: Moves, cuts: Sequence[Cut], deep: Portions, design: Design, limit: float
) -> list[tuple[Bevel, BoolArray, float]]:
    """For each chamfer, which portions are of its tool, and how far those may go into its contours at ``limit``, mm."""
    found = []
    for bevel in design.bevels:
        own = [
            cut.tool.kind == "v" and abs(cut.tool.diameter - bevel.diameter) < TOLERANCE_MM
            for cut in cuts
        ]
        chosen = np.array(own)[moves.cut[deep.row]]
        found.append((bevel, chosen, max(bevel.width - limit * bevel.slope, 0.0)))
    return found


def _apart(
    plane: Segments,
    stays: _Stays,
    most: float,
    allowed: list[tuple[Bevel, BoolArray, float]],
) -> tuple[FloatArray, BoolArray]:
    """(K,) how far each way keeps from the walls, and whether it begins in what stays."""
    first, same = same_ways(plane)
    unique = plane.take(first)
    apart = _gaps(unique, same, stays, most, allowed)
    within = stays.contains(points_at(unique, np.full(len(unique), 0.5)))[same]
    for _, chosen, more in allowed:
        within &= ~(chosen & (more > 0))
    return apart, within


def _gaps(
    unique: Segments,
    same: IntArray,
    stays: _Stays,
    reach: float,
    allowed: list[tuple[Bevel, BoolArray, float]],
) -> FloatArray:
    """(K,) distance, mm, of motions from the walls; infinite beyond `reach`.

    unique: the U motions that differ, seen from above.
    same: (K,) row of each motion in them.
    """
    segments, walls = stays.design.cells.segments, stays.walls
    distance = np.full(len(same), np.inf)
    bevelled = np.zeros(len(segments), dtype=np.bool_)
    for bevel, chosen, more in allowed:
        edges = walls[np.isin(segments.owner[walls], bevel.loops)]
        bevelled[edges] = True
        gap = measure_gaps(unique, segments.take(edges), reach + more)[same]
        distance = np.minimum(distance, np.where(chosen, gap + more, gap))
    others = measure_gaps(unique, segments.take(walls[~bevelled[walls]]), reach)[same]
    return np.asarray(np.minimum(distance, others))


def _off_stock(deep: Portions, radius: FloatArray, design: Design) -> BoolArray:
    """(K,) which ways keep off the stock: boxes first, since most do not."""
    middle = shapely.points(points_at(deep.plane, np.full(len(deep.plane), 0.5)))
    far = shapely.distance(middle, design.outline)
    return np.asarray(far - deep.plane.length / 2 > radius)


def _measure(moves: Moves, stays: _Stays, deep: Portions, k: int, radius: float) -> Gouge | None:
    """How far portion ``k`` is in material that stays, and where most; none where that is only beside the stock."""
    share = np.linspace(0.0, 1.0, _SAMPLES)
    way = deep.plane.take(np.full(_SAMPLES, k))
    points = points_at(way, share)
    signed = _signed(points, stays)
    signed[shapely.distance(shapely.points(points), stays.design.outline) > radius] = -np.inf
    best = int(np.argmax(signed))
    row = int(deep.row[k])
    at = deep.low[k] + share[best] * (deep.high[k] - deep.low[k])
    tip = moves.start[row] + at * (moves.end[row] - moves.start[row])
    aside = radius + float(signed[best])
    if signed[best] < 0:
        walls = stays.design.cells.segments.take(stays.walls)
        gap = measure_gaps(way.take(np.array([0])), walls, radius)[0]
        aside = max(aside, radius - float(gap)) if np.isfinite(gap) else aside
    up = float(moves.deepest[row]) - stays.limit
    mm = min(aside, up)
    if not mm > TOLERANCE_MM:
        return None
    return Gouge(
        row,
        (float(points[best, 0]), float(points[best, 1]), float(tip[2])),
        float(mm),
        bool(up < aside),
    )


def _signed(points: FloatArray, stays: _Stays) -> FloatArray:
    """(N,) how far points lie within what stays, mm; negative outside of it."""
    segments, walls = stays.design.cells.segments, stays.walls
    inside = stays.contains(points)
    if not len(walls):
        return np.where(inside, np.inf, -np.inf)
    near = np.full(len(points), np.inf)
    for row in walls.tolist() if len(walls) < 64 else _nearest_walls(points, segments, walls):
        near = np.minimum(near, measure_distances(points, segments, np.full(len(points), row)))
    return np.where(inside, near, -near)


def _nearest_walls(points: FloatArray, segments: Segments, walls: IntArray) -> list[int]:
    """Of many walls those that may be the nearest of one of ``points``."""
    own = segments.take(walls)
    chosen = np.minimum(np.hypot(*(own.start - points[0]).T), np.hypot(*(own.end - points[0]).T))
    spread = float(np.hypot(*np.ptp(points, axis=0)))
    most = float(chosen.min()) + 2 * spread
    return [int(wall) for wall in walls[chosen - own.length <= most]]


# Motions along lines.


def _explained(moves: Moves, cuts: Sequence[Cut], design: Design, slack: FloatArray) -> BoolArray:
    """(N,) whether motions run along lines of an operation, no deeper than they may.

    slack: (N,) distance, mm, by which each may leave such a line.
    """
    found = np.zeros(len(moves), dtype=np.bool_)
    for lines in design.lines:
        own = np.array([abs(cut.tool.diameter - lines.diameter) < TOLERANCE_MM for cut in cuts])
        rows = np.flatnonzero(
            own[moves.cut]
            & (moves.deepest > TOLERANCE_MM)
            & (moves.deepest <= lines.depth + TOLERANCE_MM)
        )
        rows = rows[~found[rows]]
        found[rows[_along(moves.plane.take(rows), lines, slack[rows])]] = True
    for recess in design.recesses:
        deep = (moves.deepest > TOLERANCE_MM) & (moves.deepest <= recess.depth + TOLERANCE_MM)
        for number, cut in enumerate(cuts):
            rows = np.flatnonzero(deep & (moves.cut == number) & ~found)
            centres = shapely.buffer(
                recess.shape, TOLERANCE_MM - cut.tool.radius, quad_segs=QUARTER
            )
            found[rows[_are_within(moves.plane.take(rows), centres)]] = True
    return found


def _are_within(plane: Segments, area: Any) -> BoolArray:
    """(K,) whether motions run in an area, seen from above."""
    within = np.zeros(len(plane), np.bool_)
    if shapely.is_empty(area) or not len(plane):
        return within
    low_x, low_y, high_x, high_y = shapely.bounds(area).tolist()
    boxes = compute_bounds(plane)
    within[:] = (boxes[:, 0] >= low_x) & (boxes[:, 1] >= low_y)
    within &= (boxes[:, 2] <= high_x) & (boxes[:, 3] <= high_y)
    rows = np.flatnonzero(within)
    if not len(rows):
        return within
    near = plane.take(rows)
    points, owner = flatten(replace(near, owner=np.arange(len(near))), CHORD_MM)
    points = np.vstack([points, near.end])
    owner = np.append(owner, np.arange(len(near)))
    order = np.argsort(owner, kind="stable")
    shapely.prepare(area)
    within[rows] = shapely.covers(area, shapely.linestrings(points[order], indices=owner[order]))
    return within


def _along(plane: Segments, lines: Lines, slack: FloatArray) -> BoolArray:
    """(K,) whether motions keep to the distance of `lines` and to their side in all `_PLACES`.

    slack: (K,) distance, mm, by which each may leave a line.
    """
    count = len(plane)
    if not count:
        return np.zeros(0, dtype=np.bool_)
    which = np.repeat(np.arange(count), len(_PLACES))
    points = points_at(plane.take(which), np.tile(_PLACES, count))
    low, high = lines.apart
    more = np.repeat(slack, len(_PLACES))
    near, side = _nearest(points, lines.segments, high + _TRACED_MM + float(slack.max()))
    good = (near >= low - TOLERANCE_MM - more) & (near <= high + _TRACED_MM + more)
    good &= (lines.side == 0) | (side == lines.side)
    return np.asarray(good.reshape(count, -1).all(axis=1))


def _nearest(points: FloatArray, segments: Segments, most: float) -> tuple[FloatArray, FloatArray]:
    """(N,) the distance of the nearest of ``segments`` within ``most`` mm, else inf; on its left 1, right -1."""
    near, side = np.full(len(points), np.inf), np.zeros(len(points))
    tree = shapely.STRtree(make_boxes(compute_bounds(segments)))
    point, row = tree.query(make_boxes(np.column_stack([points - most, points + most])))
    apart = measure_distances(points[point], segments, row)
    order = np.argsort(-apart, kind="stable")
    near[point[order]] = apart[order]
    side[point[order]] = _sides(points[point], segments.take(row))[order]
    near[near > most] = np.inf
    return near, side


def _sides(points: FloatArray, segments: Segments) -> FloatArray:
    """(N,) the side of each segment on which each point lies: left 1, right -1.

    The left side of an arc that turns left is its inside.
    """
    tangent = tangents_at(segments, np.full(len(segments), 0.5))
    offset = points - segments.start
    left = np.sign(tangent[:, 0] * offset[:, 1] - tangent[:, 1] * offset[:, 0])
    inside = np.sign(segments.radius - np.hypot(*(points - segments.centre).T))
    return np.asarray(np.where(segments.is_arc, np.sign(segments.bulge) * inside, left))
