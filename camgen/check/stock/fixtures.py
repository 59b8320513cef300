"""Motions of tool and holder against the fixtures of a mill: every motion, at every height.

A body of radius r fills the space above its lower end. It meets a layer of a fixture where this end
is below the top of the layer and the axis comes nearer to the outline than r. Tool and holder keep
`Fixtures.margin` aside. Rapid travel keeps it above a fixture too. A cut may graze a top, such as
that of the jaws of a vice, and so may the motions straight down to the cut and up from it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import shapely
from msgspec import Struct

from camgen.check.stock.moves import TOLERANCE_MM, Cut, Moves, Portions
from camgen.check.stock.profile import compute_radius
from camgen.geometry.fixtures import Body, Fixture, Fixtures, Layer, list_bodies
from camgen.geometry.intersect import measure_gaps
from camgen.geometry.segments import (
    BoolArray,
    IntArray,
    Segments,
    compute_bounds,
    make_segments,
    points_at,
    split_segments,
)
from camgen.model.pose import FloatArray

#: Places of a motion that are measured, to find the worst one.
_SAMPLES = 33
#: Distance between bodies that never come near, mm.
_FAR = float("inf")


class Hit(Struct, frozen=True):
    """A motion that meets a fixture, or comes too near to it.

    row: row of the motion.
    fixture: number of the fixture, from 1.
    body: "tool" or "holder".
    place: x, y, z of the tip, mm.
    mm: depth of the body in the fixture; 0 where it only passes too near.
    gap: distance from the fixture, mm; 0 where it meets it.
    """

    row: int
    fixture: int
    body: str
    place: tuple[float, float, float]
    mm: float
    gap: float


class Clearance(Struct, frozen=True):
    """Distances between the motions and the fixtures.

    fixtures: number of fixtures that were examined.
    margin: distance that the job asks for, mm.
    hits: the worst place of every motion with each fixture and body, in order of the motions.
    aside: smallest distance aside from a fixture below its top, mm; infinite without such a motion.
    above: smallest height over a fixture, mm; infinite without such a motion.
    notes: parts that are not judged, with the reasons.
    """

    fixtures: int
    margin: float
    hits: tuple[Hit, ...]
    aside: float
    above: float
    notes: tuple[str, ...] = ()


class _Case(Struct, frozen=True, eq=False):
    """A body of a tool and a layer of a fixture, with the motions of the tool.

    rows: (K,) motions.
    first, last: (K,) z of the lower end of the body at the start and the end of each, mm.
    around: (K,) distance of the box around each motion, seen from above, from that of the layer.
    walls: outline of the layer as segments.
    """

    moves: Moves
    fixture: Fixture
    layer: Layer
    cut: Cut
    body: Body
    rows: IntArray
    first: FloatArray
    last: FloatArray
    around: FloatArray
    walls: Segments

    @property
    def lowest(self) -> FloatArray:
        """(K,) lowest z of the body during each motion, mm."""
        return np.minimum(self.first, self.last)


def examine(moves: Moves, cuts: Sequence[Cut], fixtures: Fixtures) -> Clearance:
    """The motions of `cuts` against all fixtures."""
    worst: dict[tuple[int, int, str], Hit] = {}
    aside = above = _FAR
    for case in _list_cases(moves, cuts, fixtures):
        for hit in _find_hits(case, fixtures.margin):
            key = hit.row, hit.fixture, hit.body
            if key not in worst or (hit.mm, -hit.gap) > (worst[key].mm, -worst[key].gap):
                worst[key] = hit
        aside = min(aside, _measure_aside(case, aside))
        above = min(above, _measure_above(case))
    hits = sorted(worst.values(), key=lambda hit: (hit.row, -hit.mm))
    notes = tuple(_list_unjudged(moves, cuts, fixtures))
    return Clearance(
        len(fixtures.listed), fixtures.margin, tuple(hits), max(aside, 0.0), max(above, 0.0), notes
    )


def _list_cases(moves: Moves, cuts: Sequence[Cut], fixtures: Fixtures) -> Iterator[_Case]:
    boxes = compute_bounds(moves.plane)
    layers: list[tuple[Fixture, Layer, Segments]] = []
    for fixture in fixtures.listed:
        layers += [(fixture, layer, _list_walls(layer.outline)) for layer in fixture.layers]
    for number, cut in enumerate(cuts):
        rows = np.flatnonzero(moves.cut == number)
        if not len(rows):
            continue
        for fixture, layer, walls in layers:
            around = _measure_around(boxes[rows], layer.outline.bounds)
            for body in list_bodies(cut.tool):
                first, last = (ends[rows, 2] + body.height for ends in (moves.start, moves.end))
                yield _Case(moves, fixture, layer, cut, body, rows, first, last, around, walls)


def _list_walls(outline: Any) -> Segments:
    rings = shapely.get_rings(shapely.get_parts(outline))
    points, ring = shapely.get_coordinates(rings, return_index=True)
    is_side = ring[1:] == ring[:-1]
    start, end = points[:-1][is_side], points[1:][is_side]
    count = len(start)
    return make_segments(start, end, np.zeros(count), np.arange(count))


def _measure_around(boxes: FloatArray, outline: tuple[float, float, float, float]) -> FloatArray:
    """(K,) distances of boxes (K, 4) from the box of an outline, mm."""
    x1, y1, x2, y2 = outline
    x = np.maximum(np.maximum(x1 - boxes[:, 2], boxes[:, 0] - x2), 0.0)
    y = np.maximum(np.maximum(y1 - boxes[:, 3], boxes[:, 1] - y2), 0.0)
    return np.asarray(np.hypot(x, y))


def _take(case: _Case, which: IntArray, height: FloatArray, below: bool) -> Portions:
    """The portions of the motions `which` of a case below `height` (K,), mm, or above it.

    Their rows count within the rows of the case.
    """
    first, last = case.first[which], case.last[which]
    if not below:
        first, last, height = -first, -last, -height
    with np.errstate(invalid="ignore", divide="ignore"):
        at = np.clip((height - first) / (last - first), 0.0, 1.0)
    low, high = np.where(first < height, 0.0, at), np.where(last < height, 1.0, at)
    return Portions(which, low, high, split_segments(case.moves.plane, case.rows[which], low, high))


def _find_hits(case: _Case, margin: float) -> Iterator[Hit]:
    travels = (case.moves.rapid & ~case.moves.upright)[case.rows]
    height = case.layer.top + np.where(travels, margin, 0.0)
    radius = case.body.radius + margin
    which = np.flatnonzero(
        (case.lowest < height - TOLERANCE_MM) & (case.around < radius - TOLERANCE_MM)
    )
    if not len(which):
        return
    portions = _take(case, which, height[which], below=True)
    gap = measure_gaps(portions.plane, case.walls, radius)
    gap[_is_within(portions, case)] = 0.0
    for k in np.flatnonzero(gap < radius - TOLERANCE_MM).tolist():
        hit = _measure(case, portions, k, margin)
        if hit is not None:
            yield hit


def _is_within(portions: Portions, case: _Case) -> BoolArray:
    """(P,) whether parts begin inside of the outline."""
    return np.asarray(shapely.contains_xy(case.layer.outline, portions.plane.start))


def _radius_at(case: _Case, z: FloatArray) -> FloatArray:
    """(K,) radius, mm, of the body at the layer's top where its lower end is at z (K,), mm."""
    if case.body.height:
        return np.full(len(z), case.body.radius)
    return compute_radius(case.cut.tool, np.maximum(case.layer.top - z, 0.0))


def _measure(case: _Case, portions: Portions, k: int, margin: float) -> Hit | None:
    share = np.linspace(0.0, 1.0, _SAMPLES)
    points = points_at(portions.plane.take(np.full(_SAMPLES, k)), share)
    row = int(portions.row[k])
    along = portions.low[k] + share * (portions.high[k] - portions.low[k])
    z = case.first[row] + along * (case.last[row] - case.first[row])
    radius = _radius_at(case, z)
    outline = case.layer.outline
    places = shapely.points(points)
    aside = shapely.distance(places, outline)
    inside = shapely.contains_xy(outline, points)
    aside[inside] = -shapely.distance(places[inside], shapely.boundary(outline))
    # Between the samples the exact distance may be less.
    exact = float(
        measure_gaps(portions.plane.take(np.array([k])), case.walls, radius.max() + margin)[0]
    )
    best = int(np.argmin(aside))
    aside[best] = min(float(aside[best]), exact)
    up = case.layer.top - z
    depth = np.minimum(radius - aside, up)
    if depth.max() > TOLERANCE_MM:
        best = int(np.argmax(depth))
        mm, gap = float(depth[best]), 0.0
    else:
        distance = np.hypot(np.maximum(aside - radius, 0.0), np.maximum(-up, 0.0))
        best = int(np.argmin(distance))
        mm, gap = 0.0, float(distance[best])
        if gap >= margin - TOLERANCE_MM:
            return None
    x, y = points[best].tolist()
    place = float(x), float(y), float(z[best] - case.body.height)
    return Hit(int(case.rows[row]), case.fixture.number, case.body.name, place, mm, gap)


def _measure_aside(case: _Case, known: float) -> float:
    """The smallest distance aside of the body below the top, mm, at most `known`."""
    top = case.layer.top - TOLERANCE_MM
    which = np.flatnonzero((case.lowest < top) & (case.around - case.body.radius < known))
    if not len(which):
        return known
    portions = _take(case, which, np.full(len(which), top), below=True)
    if _is_within(portions, case).any():
        return 0.0
    # No part is farther away than its start: motions beyond that need no measurement.
    starts = shapely.distance(shapely.points(portions.plane.start), case.layer.outline)
    bound = float(starts.min()) + TOLERANCE_MM
    near = np.flatnonzero(case.around[which] <= bound)
    gap = measure_gaps(portions.plane.take(near), case.walls, bound)
    lowest = np.minimum(case.first[which], case.last[which])[near]
    return float(np.min(gap - _radius_at(case, lowest), initial=known))


def _measure_above(case: _Case) -> float:
    top = case.layer.top
    highest = np.maximum(case.first, case.last)
    which = np.flatnonzero((highest > top) & (case.around < case.body.radius))
    if not len(which):
        return _FAR
    portions = _take(case, which, np.full(len(which), top), below=False)
    gap = measure_gaps(portions.plane, case.walls, case.body.radius)
    passes_over = (gap < case.body.radius - TOLERANCE_MM) | _is_within(portions, case)
    return float(np.maximum(case.lowest[which][passes_over] - top, 0.0).min(initial=_FAR))


def _list_unjudged(moves: Moves, cuts: Sequence[Cut], fixtures: Fixtures) -> Iterator[str]:
    """A note if the unknown holder of a tool comes lower than a fixture."""
    for number, cut in enumerate(cuts):
        if cut.tool.holder is not None:
            continue
        lowest = float(np.min(moves.end[moves.cut == number, 2], initial=_FAR))
        if lowest + cut.tool.length < fixtures.travel - fixtures.lift:
            yield (
                "fixtures: the flange comes lower than their tops, and the holder of the tool is "
                "not known; set tool.holder"
            )
            return
