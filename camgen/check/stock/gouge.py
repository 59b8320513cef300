"""Finds gouges: motions that cut material that must stay.

A cell that may be cut down to a depth D must stay below D. So for every such D, all parts of
motions that run deeper than D are compared with the walls around the cells that may be cut no
deeper: the distance from the tool's axis to the walls, against the radius of the tool. Below D a
tool is widest at D, which is the depth of its tip less D above the tip. The depth of a gouge is the
shorter distance out of the material, sideways or up.
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
from camgen.check.stock.sweep import QUARTER, find_same_curves, measure_radii
from camgen.geometry.intersect import make_boxes, measure_distances, measure_gaps
from camgen.geometry.segments import (
    BoolArray,
    IntArray,
    Segments,
    compute_bounds,
    flatten,
    make_segments,
    points_at,
    tangents_at,
)
from camgen.model.pose import FloatArray, to_vec3

#: mm: chord tolerance along lines and the walls of recesses, and the rounding of corners.
_TRACED_MM = 0.015
#: mm: a point that is nearer to the line of a segment is on neither side of it.
_IN_LINE_MM = 1e-6
#: Digits of mm in which two distances are equal.
_SAME_DIGITS = 6
#: Samples of a motion on a line, as fractions of its length.
_PLACES = np.linspace(0.0, 1.0, 9)
#: Maximum number of gouges that are measured at each depth. For any more, a lower bound is used.
_MEASURED = 2000
#: Samples of a motion in the material, at which its depth in the material is measured.
_SAMPLES = 33
#: From this number of walls on, those that cannot be the nearest are left out first.
_MANY_WALLS = 64


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
        """Whether points (N, 2) lie in a cell that stays, (N,)."""
        return self.cells[self.design.cells.find(points)]


def find_gouges(moves: Moves, cuts: Sequence[Cut], design: Design) -> list[Gouge]:
    """Find the deepest gouge of every motion with gouges, in order of the motions."""
    rows = _find_judged(moves, cuts, design, np.zeros(len(moves)))
    worst: dict[int, Gouge] = {}
    if not len(rows):
        return []
    for limit in _list_limits(design):
        for gouge in _find_below(moves, cuts, design, rows, limit):
            if gouge.row not in worst or gouge.mm > worst[gouge.row].mm:
                worst[gouge.row] = gouge
    return [worst[row] for row in sorted(worst)]


def measure_bites(moves: Moves, cuts: Sequence[Cut], design: Design) -> FloatArray:
    """Measure the depth to which each motion (N,) cuts material that must stay, mm.

    Each motion deviates by up to `moves.chord` from a programmed one without gouges. It may leave
    the lines of the drawing on which the programmed one runs by as much.
    """
    bites = np.zeros(len(moves))
    rows = _find_judged(moves, cuts, design, moves.chord)
    if not len(rows):
        return bites
    for limit in _list_limits(design):
        stays = _find_stays(design, limit)
        deep = moves.below(limit + TOLERANCE_MM, rows)
        if not len(deep.row) or not stays.cells.any():
            continue
        radius = measure_radii(cuts, moves.cut[deep.row], moves.deepest[deep.row] - limit)
        allowed = _list_allowances(moves, cuts, deep, design, limit)
        aside = radius - _measure_gaps(
            deep.plane, np.arange(len(deep.row)), stays, float(radius.max()), allowed
        )
        # A tool that leaves the path by its radius may have its axis in material that stays.
        far = np.flatnonzero(moves.chord[deep.row] >= radius)
        middles = points_at(deep.plane.take(far), np.full(len(far), 0.5))
        within = far[stays.contains(middles)]
        aside[within] = 2 * radius[within]
        cutting = np.flatnonzero(aside > 0)
        middles = points_at(deep.plane.take(cutting), np.full(len(cutting), 0.5))
        cutting = cutting[
            ~_are_off_stock(middles, deep.plane.length[cutting], radius[cutting], design)
        ]
        depth = np.minimum(aside[cutting], moves.deepest[deep.row[cutting]] - limit)
        np.maximum.at(bites, deep.row[cutting], depth)
    return bites


def _find_judged(moves: Moves, cuts: Sequence[Cut], design: Design, slack: FloatArray) -> IntArray:
    """Find the motions that cut, and do not run along a line of the drawing.

    slack: (N,) distance by which each may leave such a line, mm.
    """
    if design.free or not len(moves):
        return np.zeros(0, dtype=np.intp)
    cutting = (moves.deepest > TOLERANCE_MM) & ~moves.rising
    return np.flatnonzero(cutting & ~_are_explained(moves, cuts, design, slack))


def _list_limits(design: Design) -> list[float]:
    depths = np.append(design.depth, [0.0, *(bevel.depth for bevel in design.bevels)])
    return list(np.unique(depths[np.isfinite(depths)]).tolist())


def _find_below(
    moves: Moves, cuts: Sequence[Cut], design: Design, rows: IntArray, limit: float
) -> list[Gouge]:
    deep = moves.below(limit + TOLERANCE_MM, rows)
    stays = _find_stays(design, limit)
    if not len(deep.row) or not stays.cells.any():
        return []
    radius = measure_radii(cuts, moves.cut[deep.row], moves.deepest[deep.row] - limit)
    allowed = _list_allowances(moves, cuts, deep, design, limit)
    gap, within = _compare_with_walls(deep.plane, stays, float(radius.max()), allowed)
    middles = points_at(deep.plane, np.full(len(deep.plane), 0.5))
    within &= ~_are_off_stock(middles, deep.plane.length, radius, design)
    chord = moves.chord[deep.row]
    near = gap < radius - TOLERANCE_MM
    # A line that stands for an arc leaves it between its ends, but not at its ends.
    doubtful = np.flatnonzero(near & ~within & (chord > 0) & (gap >= radius - TOLERANCE_MM - chord))
    near[doubtful] = _are_near_at_ends(deep, doubtful, stays, radius, allowed)
    hit = np.flatnonzero(within | near)
    for _, chosen, allowance in allowed:
        radius = np.where(chosen, radius - allowance, radius)
    gouges: list[Gouge] = []
    for k in hit[:_MEASURED].tolist():
        gouge = _measure(moves, stays, deep, k, float(radius[k]))
        if gouge is not None:
            gouges.append(gouge)
    aside = np.where(within, radius, radius - gap)
    for k in hit[_MEASURED:].tolist():
        row = int(deep.row[k])
        up = float(moves.deepest[row]) - limit
        depth = min(float(aside[k]), up)
        gouges.append(Gouge(row, to_vec3(moves.end[row]), depth, up < float(aside[k])))
    return gouges


def _find_stays(design: Design, limit: float) -> _Stays:
    cells = design.cells
    kept = design.depth <= limit + TOLERANCE_MM / 2
    walls = np.flatnonzero(np.isin(cells.segments.owner, cells.walls(kept)))
    return _Stays(design, limit, kept, walls)


#: A chamfer, the portions of its tool (K,), and how far these may enter its contours, mm.
_Allowance = tuple[Bevel, BoolArray, float]


def _are_near_at_ends(
    deep: Portions,
    rows: IntArray,
    stays: _Stays,
    radius: FloatArray,
    allowed: list[_Allowance],
) -> BoolArray:
    """Whether the portions `rows` (R,) are too near to the walls at an end of their motion."""
    is_near = np.zeros(len(rows), dtype=np.bool_)
    row_allowed = [(bevel, chosen[rows], allowance) for bevel, chosen, allowance in allowed]
    starts = deep.low[rows] == 0.0, deep.plane.start
    for is_end, points in (starts, (deep.high[rows] == 1.0, deep.plane.end)):
        at_rows = points[rows]
        tips = make_segments(at_rows, at_rows, np.zeros(len(rows)), rows)
        gap, _ = _compare_with_walls(tips, stays, float(radius.max()), row_allowed)
        is_near |= is_end & (gap < radius[rows] - TOLERANCE_MM)
    return is_near


def _list_allowances(
    moves: Moves, cuts: Sequence[Cut], deep: Portions, design: Design, limit: float
) -> list[_Allowance]:
    allowed = []
    for bevel in design.bevels:
        cuts_bevel = [
            cut.tool.kind == "v" and abs(cut.tool.diameter - bevel.diameter) < TOLERANCE_MM
            for cut in cuts
        ]
        chosen = np.array(cuts_bevel)[moves.cut[deep.row]]
        allowed.append((bevel, chosen, max(bevel.width - limit * bevel.slope, 0.0)))
    return allowed


def _compare_with_walls(
    plane: Segments, stays: _Stays, reach: float, allowed: list[_Allowance]
) -> tuple[FloatArray, BoolArray]:
    """Measure the distance (K,) of motions from the walls, mm, infinite beyond `reach`.

    Also returns whether the middle of each motion is in material that stays, (K,).
    """
    first, same = find_same_curves(plane)
    unique = plane.take(first)
    within = stays.contains(points_at(unique, np.full(len(unique), 0.5)))[same]
    for _, chosen, allowance in allowed:
        within &= ~(chosen & (allowance > 0))
    return _measure_gaps(unique, same, stays, reach, allowed), within


def _measure_gaps(
    unique: Segments,
    same: IntArray,
    stays: _Stays,
    reach: float,
    allowed: list[_Allowance],
) -> FloatArray:
    """Measure the distance (K,) of motions from the walls, mm, infinite beyond `reach`.

    unique: the U different motions, seen from above.
    same: (K,) index of each motion in them.
    """
    segments, walls = stays.design.cells.segments, stays.walls
    distance = np.full(len(same), np.inf)
    bevelled = np.zeros(len(segments), dtype=np.bool_)
    for bevel, chosen, allowance in allowed:
        edges = walls[np.isin(segments.owner[walls], bevel.loops)]
        bevelled[edges] = True
        gap = measure_gaps(unique, segments.take(edges), reach + allowance)[same]
        distance = np.minimum(distance, np.where(chosen, gap + allowance, gap))
    others = measure_gaps(unique, segments.take(walls[~bevelled[walls]]), reach)[same]
    return np.asarray(np.minimum(distance, others))


def _are_off_stock(
    middles: FloatArray, length: FloatArray, radius: FloatArray, design: Design
) -> BoolArray:
    """Whether motions (K,) with these middles and lengths are certainly beside the stock."""
    distance = shapely.distance(shapely.points(middles), design.outline)
    return np.asarray(distance - length / 2 > radius)


def _measure(moves: Moves, stays: _Stays, deep: Portions, k: int, radius: float) -> Gouge | None:
    """Measure the deepest place of portion `k` in material that stays.

    Returns None if the portion is only beside the stock, or within the tolerance.
    """
    fraction = np.linspace(0.0, 1.0, _SAMPLES)
    curve = deep.plane.take(np.full(_SAMPLES, k))
    points = points_at(curve, fraction)
    signed = _measure_signed(points, stays)
    signed[shapely.distance(shapely.points(points), stays.design.outline) > radius] = -np.inf
    best = int(np.argmax(signed))
    row = int(deep.row[k])
    at = deep.low[k] + fraction[best] * (deep.high[k] - deep.low[k])
    tip = moves.start[row] + at * (moves.end[row] - moves.start[row])
    aside = radius + float(signed[best])
    if signed[best] < 0:
        walls = stays.design.cells.segments.take(stays.walls)
        gap = measure_gaps(curve.take(np.array([0])), walls, radius)[0]
        aside = max(aside, radius - float(gap)) if np.isfinite(gap) else aside
    up = float(moves.deepest[row]) - stays.limit
    mm = min(aside, up)
    if not mm > TOLERANCE_MM:
        return None
    place = float(points[best, 0]), float(points[best, 1]), float(tip[2])
    return Gouge(row, place, float(mm), bool(up < aside))


def _measure_signed(points: FloatArray, stays: _Stays) -> FloatArray:
    """Measure the distance (N,) of points from the walls, mm; negative outside of the material."""
    segments, walls = stays.design.cells.segments, stays.walls
    inside = stays.contains(points)
    if not len(walls):
        return np.where(inside, np.inf, -np.inf)
    near = np.full(len(points), np.inf)
    if len(walls) >= _MANY_WALLS:
        walls = _select_near_walls(points, segments, walls)
    for row in walls.tolist():
        near = np.minimum(near, measure_distances(points, segments, np.full(len(points), row)))
    return np.where(inside, near, -near)


def _select_near_walls(points: FloatArray, segments: Segments, walls: IntArray) -> IntArray:
    edges = segments.take(walls)
    to_start = np.hypot(*(edges.start - points[0]).T)
    distance = np.minimum(to_start, np.hypot(*(edges.end - points[0]).T))
    limit = float(distance.min()) + 2 * float(np.hypot(*np.ptp(points, axis=0)))
    return np.asarray(walls[distance - edges.length <= limit])


def _are_explained(
    moves: Moves, cuts: Sequence[Cut], design: Design, slack: FloatArray
) -> BoolArray:
    """Whether motions (N,) run along lines or in recesses of an operation, no deeper than allowed.

    slack: (N,) distance by which each may leave such a line, mm.
    """
    explained = np.zeros(len(moves), dtype=np.bool_)
    cutting = moves.deepest > TOLERANCE_MM
    for lines in design.lines:
        fits = np.array([abs(cut.tool.diameter - lines.diameter) < TOLERANCE_MM for cut in cuts])
        allowed = cutting & (moves.deepest <= lines.depth + TOLERANCE_MM)
        rows = np.flatnonzero(fits[moves.cut] & allowed & ~explained)
        explained[rows[_are_along(moves.plane.take(rows), lines, slack[rows])]] = True
    radius = measure_radii(cuts, moves.cut, moves.deepest)
    for recess in design.recesses:
        allowed = cutting & (moves.deepest <= recess.depth + TOLERANCE_MM)
        for number in range(len(cuts)):
            rows = np.flatnonzero(allowed & (moves.cut == number) & ~explained)
            inset = _TRACED_MM - radius[rows].max(initial=0.0)
            centres = shapely.buffer(recess.shape, inset, quad_segs=QUARTER)
            explained[rows[_are_within(moves.plane.take(rows), centres)]] = True
    return explained


def _are_within(plane: Segments, area: Any) -> BoolArray:
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


def _are_along(plane: Segments, lines: Lines, slack: FloatArray) -> BoolArray:
    """Whether motions (K,) keep the distances and the side of `lines` at all `_PLACES`.

    slack: (K,) distance by which each may leave a line, mm.
    """
    count = len(plane)
    if not count:
        return np.zeros(0, dtype=np.bool_)
    which = np.repeat(np.arange(count), len(_PLACES))
    points = points_at(plane.take(which), np.tile(_PLACES, count))
    low, high = lines.distances
    slack_at = np.repeat(slack, len(_PLACES))
    near, side = _find_nearest(points, lines.segments, high + _TRACED_MM + float(slack.max()))
    good = (near >= low - _TRACED_MM - slack_at) & (near <= high + _TRACED_MM + slack_at)
    # Around a corner a point may lie in line with a side of the contour.
    good &= (lines.side == 0) | (side != -lines.side)
    return np.asarray(good.reshape(count, -1).all(axis=1))


def _find_nearest(
    points: FloatArray, segments: Segments, reach: float
) -> tuple[FloatArray, FloatArray]:
    """Return distance (N,) of the nearest segment, mm, and its side (N,): 1 for left, -1 for right.

    The distance is infinite beyond `reach` mm.
    """
    near, side = np.full(len(points), np.inf), np.zeros(len(points))
    tree = shapely.STRtree(make_boxes(compute_bounds(segments)))
    point, row = tree.query(make_boxes(np.column_stack([points - reach, points + reach])))
    distance = measure_distances(points[point], segments, row)
    left = _measure_left(points[point], segments.take(row))
    # Both sides of a corner are equally near. The one whose line is farther away decides.
    order = np.lexsort((np.abs(left), -np.round(distance, _SAME_DIGITS)))
    near[point[order]] = distance[order]
    side[point[order]] = np.where(np.abs(left) < _IN_LINE_MM, 0.0, np.sign(left))[order]
    near[near > reach] = np.inf
    return near, side


def _measure_left(points: FloatArray, segments: Segments) -> FloatArray:
    """Measure how far each point (N, 2) is to the left of its line, mm, below 0 to the right.

    The left side of an arc to the left is its inside.
    """
    tangent = tangents_at(segments, np.full(len(segments), 0.5))
    offset = points - segments.start
    left = tangent[:, 0] * offset[:, 1] - tangent[:, 1] * offset[:, 0]
    arc = segments.is_arc
    inside = segments.radius[arc] - np.hypot(*(points - segments.centre)[arc].T)
    left[arc] = np.sign(segments.bulge[arc]) * inside
    return left
