"""Offset regions of pockets, their exact passes, and which region lies inside which.

The tool centre may be where the distance from the walls is at least that of the outermost pass. The
positions at a distance of at least d form connected offset regions, whose borders are passes. Each
region of the next larger distance lies inside a region of this one. So all regions form a forest.
Its leaves are the innermost regions, in which the tool enters.

If the stepover is at most the tool radius, no rest material stays between passes: on the line from
any point to its nearest wall, a pass comes within a stepover. With a larger stepover, material may
stay in corners and in the middle, between the area that one pass cuts and that of the next ones.
The offset curve one tool radius further inside reaches all of this material. The stretches of it
near such material are additional passes.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from operator import attrgetter
from typing import Any, TypeVar

import numpy as np
import shapely
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.nesting import measure_loop_areas
from camgen.geometry.segments import (
    IntArray,
    Segments,
    concatenate,
    find_following,
    flatten,
    make_contour_segments,
    reverse_segments,
)
from camgen.model.sequences import take_rows
from camgen.plan.beside import OffsetCurve, make_offset_curve
from camgen.plan.pocket.chains import cut_out, sample_chain

_Item = TypeVar("_Item")
_get_pocket = attrgetter("pocket")

#: mm: maximum deviation of polygons from passes and walls. Polygons decide which region lies inside
#: which, and where rest material is.
CHORD_MM = 0.002
#: mm: areas that are nowhere wider than twice this need not be cut.
_THIN_MM = 0.002
#: Minimum number of corners of a polygon.
MIN_CORNERS = 3
#: Chords of a quarter circle in areas that the tool sweeps. They deviate from it by less than a
#: ten-thousandth of the radius.
QUARTER_CHORDS = 48
#: Factors on the distance of a pass, less 1, that are tried one after the other if the offset curve
#: fails its check.
_NUDGES = (0.0, -0.003, -0.007, -0.02)
#: mm: the same for the pass along the walls, added to its distance. The amounts are smaller than
#: the tolerance of the stock proof.
_WALL_NUDGES_MM = (0.0, 1e-3, 2e-3, 4e-3)
#: Spacing of samples along a pass, at which is tested whether rest material is near, as a fraction
#: of the tool radius.
_SPACING_FRACTION = 0.1


class PocketWalls(Struct, frozen=True, eq=False):
    """The walls of pockets or of offset regions in them, with the material on their left.

    segments: N segments of closed loops, in any order.
    following: (N,) row of the segment after each one, along its loop.
    pocket: (N,) index of the pocket of each segment.
    pocket_count: number of pockets.
    distance: distance of the segments from the walls of the pockets, mm.
    """

    segments: Segments
    following: IntArray
    pocket: IntArray
    pocket_count: int
    distance: float = 0.0


class OffsetRegion(Struct, frozen=True, eq=False):
    """A connected region of tool-centre positions at a minimum distance from the walls.

    pocket: index of the pocket.
    distance: minimum distance from the walls, mm.
    passes: chains that are cut there, in the direction of travel.
    is_whole: whether the passes are the whole border of the region, as closed chains. Otherwise
        they are stretches of it.
    polygon: the region.
    parent: index of the region around it, -1 for an outermost one.
    """

    pocket: int
    distance: float
    passes: tuple[Segments, ...]
    is_whole: bool
    polygon: Any
    parent: int = -1


def select_outermost(regions: Iterable[OffsetRegion]) -> list[OffsetRegion]:
    """The regions without a region around them."""
    return [region for region in regions if region.parent < 0]


def unite_regions(regions: Iterable[OffsetRegion]) -> Any:
    """The union of the polygons of `regions`."""
    return shapely.union_all([region.polygon for region in regions])


def group_by_pocket(items: Iterable[_Item]) -> dict[int, list[_Item]]:
    """Lists of `items` by their attribute `pocket`, in order."""
    groups: dict[int, list[_Item]] = defaultdict(list)
    for item in items:
        groups[_get_pocket(item)].append(item)
    return groups


class RegionForest(Struct, frozen=True, eq=False):
    """Offset regions of all pockets.

    regions: all of them, each after its parent.
    failed: indices of pockets of which an offset curve failed its check.
    """

    regions: tuple[OffsetRegion, ...]
    failed: frozenset[int]


class _Layer(Struct, frozen=True, eq=False):
    """The offset regions of all pockets at one distance.

    regions: without parents.
    borders: the borders of the regions, as walls for the next layer.
    failed: indices of pockets of which the offset curve failed its check.
    """

    regions: list[OffsetRegion]
    borders: PocketWalls
    failed: frozenset[int]


def compute_regions(
    walls: PocketWalls, first: float, stepover: float, radius: float, climb: bool
) -> RegionForest:
    """The offset regions of all pockets, with all passes that clear them.

    Each pass is the exact offset of the one before. A point at least one stepover away from that
    pass is farther from the walls than it by at least the stepover.

    first: distance of the outermost passes from the walls, mm.
    stepover: mm.
    radius: tool radius, mm.
    climb: whether the material is on the right of the direction of travel.
    """
    layer = _compute_layer(walls, first, climb)
    failed = layer.failed
    regions: list[OffsetRegion] = []
    outside = _append_regions(regions, layer.regions, [])
    while layer.regions:
        inner = _compute_layer(layer.borders, stepover, climb, walls)
        failed |= inner.failed
        if stepover > radius:
            between = _compute_layer(layer.borders, radius, climb, walls)
            failed |= between.failed
            needed = _select_needed(between.regions, inner.regions, stepover, radius)
            outside += _append_regions(regions, needed, outside)
        outside = _append_regions(regions, inner.regions, outside)
        layer = inner
    return RegionForest(tuple(regions), failed)


def compute_wall_passes(walls: PocketWalls, distance: float, climb: bool) -> RegionForest:
    """The outermost offset regions alone, with one pass at `distance` mm from all walls."""
    layer = _compute_layer(walls, distance, climb)
    return RegionForest(tuple(layer.regions), layer.failed)


def _append_regions(
    regions: list[OffsetRegion], added: Iterable[OffsetRegion], outside: list[int]
) -> list[int]:
    """Append regions and set their parents.

    regions: is extended.
    added: regions without parents.
    outside: indices of the regions that may be parents.

    Returns the indices of the added regions.
    """
    candidates: dict[int, list[int]] = {}
    for k in outside:
        candidates.setdefault(regions[k].pocket, []).append(k)
    first = len(regions)
    for region in added:
        parents = candidates.get(region.pocket, [])
        parent = _find_enclosing(region, take_rows(regions, parents))
        regions.append(replace(region, parent=parents[parent] if parent >= 0 else -1))
    return list(range(first, len(regions)))


def _find_enclosing(region: OffsetRegion, candidates: Sequence[OffsetRegion]) -> int:
    """Index of the innermost candidate around a region, -1 if there are no candidates."""
    if len(candidates) < 2:
        return len(candidates) - 1
    inside = region.polygon.representative_point()
    gaps = shapely.distance(inside, np.array([candidate.polygon for candidate in candidates]))
    distance = np.array([candidate.distance for candidate in candidates])
    enclosing = np.flatnonzero(gaps <= gaps.min() + CHORD_MM)
    return int(enclosing[np.argmax(distance[enclosing])])


def _compute_layer(
    borders: PocketWalls, distance: float, climb: bool, walls: PocketWalls | None = None
) -> _Layer:
    """The offset regions at `distance` mm from `borders`.

    If the offset curve of a pocket fails its check, other distances nearby are tried.

    walls: walls of the pockets. With them, slightly smaller distances are tried, and offsets of
        the walls instead of `borders`. Without them `borders` are the walls: slightly larger
        distances are tried, which leave that much rest material at the walls.
    """
    if walls is None:
        attempts = [(borders, distance + nudge) for nudge in _WALL_NUDGES_MM]
    else:
        attempts = [(borders, distance * (1 + nudge)) for nudge in _NUDGES]
        attempts += [(walls, borders.distance + distance * (1 + nudge)) for nudge in _NUDGES]
    pending = frozenset(np.unique(borders.pocket).tolist())
    regions: list[OffsetRegion] = []
    parts: list[PocketWalls] = []
    for source, offset in attempts:
        if not pending:
            break
        chosen = select_pockets(source, pending)
        closed = np.ones(int(chosen.segments.owner.max(initial=-1)) + 1, dtype=bool)
        curve = make_offset_curve(
            chosen.segments, chosen.following, closed, chosen.pocket, offset, 0.0
        )
        layer = _make_layer(curve, chosen, offset, climb)
        regions += layer.regions
        parts.append(layer.borders)
        pending = layer.failed
    return _Layer(regions, _join_walls(parts, borders.pocket_count), pending)


def select_pockets(walls: PocketWalls, pockets: frozenset[int]) -> PocketWalls:
    """The walls of some pockets alone; the indices of pockets stay the same."""
    rows = np.flatnonzero(np.isin(walls.pocket, list(pockets)))
    new_row = np.full(len(walls.segments), -1)
    new_row[rows] = np.arange(len(rows))
    return PocketWalls(
        walls.segments.take(rows),
        new_row[walls.following[rows]],
        walls.pocket[rows],
        walls.pocket_count,
        walls.distance,
    )


def make_pocket_polygon(walls: PocketWalls, pocket: int) -> Any:
    """The area inside the walls of a pocket: its clockwise loops less the others.

    The segments are in any order, so each loop is followed from segment to segment.
    """
    chosen = select_pockets(walls, frozenset([pocket]))
    pending = set(range(len(chosen.segments)))
    outer: list[Any] = []
    islands: list[Any] = []
    while pending:
        loop = [min(pending)]
        while (following := int(chosen.following[loop[-1]])) != loop[0]:
            loop.append(following)
        pending -= set(loop)
        points, _ = flatten(chosen.segments.take(np.array(loop)), CHORD_MM)
        if len(points) >= MIN_CORNERS:
            outline = shapely.LinearRing(points)
            area = shapely.make_valid(shapely.Polygon(outline))
            (islands if outline.is_ccw else outer).append(area)
    return shapely.difference(shapely.union_all(outer), shapely.union_all(islands))


def _join_walls(parts: Sequence[PocketWalls], pocket_count: int) -> PocketWalls:
    if not parts:
        empty = np.zeros(0, dtype=np.int64)
        return PocketWalls(make_contour_segments([]), empty, empty, pocket_count)
    row_count, owner_count = 0, 0
    following, owner = [], []
    for part in parts:
        following.append(part.following + row_count)
        owner.append(part.segments.owner + owner_count)
        row_count += len(part.segments)
        owner_count += int(part.segments.owner.max(initial=-1)) + 1
    segments = replace(concatenate([part.segments for part in parts]), owner=np.concatenate(owner))
    pocket = np.concatenate([part.pocket for part in parts])
    return PocketWalls(segments, np.concatenate(following), pocket, pocket_count, parts[0].distance)


def _lacks_border(
    curve: OffsetCurve, chain_pocket: IntArray, pocket: int, borders: PocketWalls, distance: float
) -> bool:
    """Whether the closed chains of an offset curve are not the whole border of a pocket's regions.

    An open chain is either a border that was not closed because of rounding, or a stray section of
    the raw curve. The enclosed area decides.

    chain_pocket: pocket of each chain of `curve`.
    distance: mm, from `borders` to `curve`.
    """
    chains = chain_pocket == pocket
    if not curve.sound[chains & curve.closed].all():
        return True
    area = -measure_loop_areas(curve.segments, len(chains))[chains & curve.closed].sum()
    inside = make_pocket_polygon(borders, pocket).buffer(-distance, quad_segs=QUARTER_CHORDS)
    return bool(abs(area - inside.area) > 2 * CHORD_MM * inside.length)


def _make_layer(curve: OffsetCurve, borders: PocketWalls, offset: float, climb: bool) -> _Layer:
    """The offset regions that `curve` encloses, `offset` mm from `borders`."""
    distance = borders.distance + offset
    count = len(curve.closed)
    if not count:
        empty = replace(select_pockets(borders, frozenset()), distance=distance)
        return _Layer([], empty, frozenset())
    first = np.searchsorted(curve.segments.owner, np.arange(count))
    pocket = borders.pocket[curve.source[first]]
    failed = np.unique(pocket[~(curve.sound & curve.closed)])
    failed = failed[[_lacks_border(curve, pocket, k, borders, offset) for k in failed.tolist()]]
    points, owner = flatten(curve.segments, CHORD_MM)
    sizes = np.bincount(owner, minlength=count)
    area = measure_loop_areas(curve.segments, count)
    length = np.bincount(curve.segments.owner, curve.segments.length, count)
    is_pass = curve.closed & (sizes >= MIN_CORNERS) & (np.abs(area) > _THIN_MM * length / 2)
    is_pass &= ~np.isin(pocket, failed)
    travelled = reverse_segments(curve.segments)[0] if climb else curve.segments
    chains = split_by_owner(travelled, count)
    loops = np.split(points, np.cumsum(sizes)[:-1])
    regions = []
    # The material is on the left: the outer border of a region runs clockwise, and the border
    # around an island in it counter-clockwise.
    for k in np.unique(pocket[is_pass]).tolist():
        rows = np.flatnonzero(is_pass & (pocket == k))
        for members in _group_loops(rows[area[rows] < 0], rows[area[rows] > 0], loops):
            outer, *holes = take_rows(loops, members)
            polygon = shapely.Polygon(outer, holes)
            # Chords of two arcs that nearly touch may cross.
            if not polygon.is_valid:
                polygon = shapely.make_valid(polygon)
            passes = tuple(take_rows(chains, members))
            regions.append(OffsetRegion(k, distance, passes, True, polygon))
    segments = curve.segments.take(is_pass[curve.segments.owner])
    following = find_following(segments, curve.closed)
    inner = PocketWalls(segments, following, pocket[segments.owner], borders.pocket_count, distance)
    return _Layer(regions, inner, frozenset(failed.tolist()))


def split_by_owner(segments: Segments, count: int) -> list[Segments]:
    """The segments of each of `count` owners; they have to be sorted by owner."""
    edges = np.searchsorted(segments.owner, np.arange(count + 1))
    return [segments.take(np.arange(start, end)) for start, end in pairwise(edges.tolist())]


def _group_loops(outer: IntArray, holes: IntArray, loops: Sequence[Any]) -> list[list[int]]:
    """Group holes by the outer loop around them, the smallest one if there are several.

    outer, holes: indices of `loops`.
    loops: corners of each loop, (K, 2).

    Returns for each outer loop its index, followed by those of its holes.
    """
    members = {k: [k] for k in outer.tolist()}
    if len(outer) == 1:
        members[int(outer[0])] += holes.tolist()
    elif len(outer) and len(holes):
        polygons = [shapely.Polygon(loops[k]) for k in outer]
        size = shapely.area(polygons)
        for hole in holes.tolist():
            gap = shapely.distance(shapely.Point(loops[hole][0]), polygons)
            enclosing = np.flatnonzero(gap <= CHORD_MM)
            if len(enclosing):
                smallest = enclosing[np.argmin(size[enclosing])]
                members[int(outer[smallest])].append(hole)
    return list(members.values())


def _select_needed(
    between: Sequence[OffsetRegion], inner: Sequence[OffsetRegion], stepover: float, radius: float
) -> Iterator[OffsetRegion]:
    """The regions between two passes that are needed, each with the stretches near rest material.

    between: regions one tool radius inside the outer pass.
    inner: regions one stepover inside the outer pass.
    stepover, radius: mm.
    """
    inside = group_by_pocket(inner)
    for region in between:
        cut = unite_regions(inside[region.pocket]).intersection(region.polygon)
        if cut.is_empty:
            yield region
            continue
        swept = cut.buffer(radius - _THIN_MM, quad_segs=QUARTER_CHORDS)
        rest = region.polygon.difference(swept).buffer(-_THIN_MM)
        if not rest.is_empty:
            stretches = tuple(_select_stretches(region.passes, rest, stepover - radius, radius))
            yield replace(region, passes=stretches, is_whole=False)


def _select_stretches(
    chains: Sequence[Segments], rest: Any, distance: float, radius: float
) -> Iterator[Segments]:
    """The stretches of closed chains that come within `distance` mm of rest material.

    rest: polygons.
    radius: tool radius, mm.
    """
    for chain in chains:
        spacing = min(_SPACING_FRACTION * radius, float(chain.length.sum()) / 8)
        lengths, points = sample_chain(chain, spacing)
        # The last sample equals the first one.
        search = distance + spacing + 2 * _THIN_MM
        is_near = shapely.dwithin(shapely.points(points), rest, search)[:-1]
        if is_near.all():
            yield chain
        elif is_near.any():
            begin = np.flatnonzero(is_near & ~np.roll(is_near, 1))
            end = np.flatnonzero(is_near & ~np.roll(is_near, -1))
            if end[0] < begin[0]:
                end = np.roll(end, -1)
            total, count = lengths[-1], len(is_near)
            for first, last in zip(begin.tolist(), end.tolist(), strict=True):
                low, high = lengths[(first - 1) % count], lengths[(last + 1) % count]
                yield cut_out(chain, low, high if high > low else high + total)
