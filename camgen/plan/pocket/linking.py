"""Links the passes of pockets, from the innermost region outwards, so that few retracts are needed.

A trochoidal channel comes first. The passes of a region come after all passes inside it. From the
last of these, a straight link leads to the next pass. On the link the tool keeps the distance of
that pass from the walls. If there is no such link from the end of the last pass, the tool first
moves along that pass to a point that has one. If no point has one, the tool retracts, and the next
passes become a path of their own.

If engagement is limited, links lead over the cleared area, or approach the next pass at an angle so
small that they keep the limit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import shapely
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from camgen.geometry.arcs import compute_bulges
from camgen.geometry.intersect import measure_gaps
from camgen.geometry.ragged import list_owners, number_rows
from camgen.geometry.segments import IntArray, Segments, make_segments, points_at, tangents_at
from camgen.model.pose import FloatArray
from camgen.model.sequences import take_rows
from camgen.plan.pocket.chains import (
    cut_out,
    find_nearest,
    join_chains,
    locate,
    make_lines,
    make_polyline,
    sample_chain,
    start_at,
    tangents_along,
)
from camgen.plan.pocket.channel import Channel, tabulate_discs
from camgen.plan.pocket.engagement_limit import EngagementLimit
from camgen.plan.pocket.regions import OffsetRegion, group_by_pocket

#: mm: rounding of lengths. A link may come nearer to the walls than the outermost pass by this.
_TOLERANCE_MM = 1e-4
#: Fraction of the stepover by which a link between inner passes may come nearer to the walls than
#: these passes.
_INNER_WALL_SLACK = 0.05
#: Stepovers by which the end of a link to the next pass is ahead of the nearest point, in the order
#: in which they are tried. A slanting link cuts little more than the pass itself.
_AHEAD = (3.0, 2.0, 1.0, 0.5, 0.0)
#: Points along a pass at which a link is tried.
_TRIED_POINTS = 48
#: Maximum length of a link in uncut material, in stepovers.
_MAX_UNCUT = 4.0
#: mm: a link with no more than this in uncut material leads over the cleared area. The polygons of
#: that area deviate from it by as much.
_CLEAR_MM = 0.005
#: Spacing of points along a pass that may lie in a channel, as a fraction of the tool radius.
_CHANNEL_SPACING_FRACTION = 0.2
#: Spacing of samples on a link, as a fraction of the minimum distance from the walls.
_SAMPLE_FRACTION = 0.1
#: Maximum number of samples on a link.
_MAX_SAMPLES = 64
#: Factors on the length of the shortest link that keeps the engagement limit, in the order in which
#: they are tried.
_LEAN_FACTORS = (2.0, 1.4, 1.0)
#: Links that are tested together.
_BATCH = 16
#: Digits of a size in mm or mm2. Sizes that agree in them are equal, and their order in the array
#: decides, not the last bit of a sine, which differs between processors.
_EQUAL_DIGITS = 6
#: mm: a region whose largest inscribed circle has a smaller radius is entered on its pass.
_MIN_INSCRIBED_MM = 0.01


class LinkedPasses(Struct, frozen=True, eq=False):
    """Passes of one pocket that are cut without a retract, with the links between them.

    pocket: index of the pocket.
    chain: N segments of passes and links in the order of cutting.
    pass_count: number of passes.
    entry_radius: distance around the first point in which the tool centre comes no nearer to the
        walls than on the outermost pass, mm; space for the helix of the entry.
    successor: index of the linked passes that must come after these, -1 without any.
    channel_segments: number of segments at the start of `chain` that are a trochoidal channel.
    steep_links: number of links that may exceed the engagement of a pass.
    is_hop: (N,) whether a segment is part of a hop; empty without hops.
    """

    pocket: int
    chain: Segments
    pass_count: int
    entry_radius: float
    successor: int
    channel_segments: int = 0
    steep_links: int = 0
    is_hop: NDArray[np.bool_] = np.zeros(0, dtype=np.bool_)


class _LinkLimits(Struct, frozen=True, eq=False):
    """Limits of the links to the passes of a region.

    walls: walls of the pocket.
    min_distance: minimum distance of a link from the walls, mm.
    cut: polygons of tool-centre positions in which the tool cuts nothing.
    max_uncut: maximum length of a link outside of `cut`, mm; there the tool cuts a slot.
    lean_length: length along a pass that a link to it needs to keep the engagement limit, mm; 0 if
        engagement is not limited.
    lean_angle: maximum angle between such a link and the pass, rad.
    channels: channels of the region, which are cut before all passes.
    """

    walls: Segments
    min_distance: float
    cut: tuple[Any, ...]
    max_uncut: float
    lean_length: float
    lean_angle: float
    channels: Sequence[Channel]

    def in_cleared_area(self) -> _LinkLimits:
        """These limits, for links that lead over the cleared area only."""
        return replace(self, max_uncut=_CLEAR_MM)


class _PassBuilder(Struct, eq=False):
    """Linked passes while they are collected.

    Most attributes are those of `LinkedPasses`.

    parts: passes and links so far. A gap between two of them becomes a straight link.
    last_ring: the last closed pass, None before the first one.
    successor: the linked passes that must come after these, if any.
    """

    pocket: int
    entry_radius: float
    parts: list[Segments] = []
    pass_count: int = 0
    channel_segments: int = 0
    steep_links: int = 0
    last_ring: Segments | None = None
    successor: _PassBuilder | None = None

    @property
    def position(self) -> FloatArray:
        """The current position of the tool centre (2,), mm."""
        return np.asarray(self.parts[-1].end[-1])

    def add_pass(self, chain: Segments, is_closed: bool) -> None:
        """Add a pass."""
        self.parts.append(chain)
        self.pass_count += 1
        self.last_ring = chain if is_closed else self.last_ring


def link_passes(
    regions: Sequence[OffsetRegion],
    walls: Sequence[Segments],
    first: float,
    stepover: float,
    channels: Sequence[Sequence[Channel]],
    limit: EngagementLimit | None,
) -> list[LinkedPasses]:
    """Link all passes, and the channels before them.

    regions: offset regions, each after its parent.
    walls: walls of each pocket.
    first: distance of the outermost passes from the walls, mm.
    stepover: mm.
    channels: channels of each region; only outermost regions have any.
    limit: engagement limit, None without one.
    """
    children: list[list[int]] = [[] for _ in regions]
    for k, region in enumerate(regions):
        if region.parent >= 0:
            children[region.parent].append(k)
    outermost = find_outermost(regions)
    finished: list[_PassBuilder] = []
    # The passes after the first channel of an outermost region. From them, links lead over the
    # channel to all regions around it.
    after_channel: dict[int, _PassBuilder] = {}
    cleared: dict[int, tuple[Any, ...]] = {}
    roots = sorted(set(outermost))
    for root in roots:
        cleared[root] = tuple(channel.make_polygon(_CLEAR_MM) for channel in channels[root])
        builders = [_start_with_channel(regions[root], channel) for channel in channels[root]]
        if builders:
            after_channel[root] = builders[0]
        finished += builders[1:]
    current: dict[int, _PassBuilder] = {}
    lean_angle = 0.0 if limit is None else limit.max_turn
    lean_length = stepover / math.tan(lean_angle) if lean_angle else 0.0
    for k in _order_inside_first(children, roots):
        region, root = regions[k], outermost[k]
        polygons = [regions[child].polygon for child in children[k]]
        by_area = _sort_ascending(shapely.area(polygons))
        inner = take_rows(children[k], by_area)
        builder, others = after_channel.get(root), list[_PassBuilder]()
        if root not in after_channel and inner:
            # The passes of the largest inner region are continued here.
            *others, builder = (current.pop(child) for child in inner)
        min_distance = max(first, region.distance - _INNER_WALL_SLACK * stepover) - _TOLERANCE_MM
        cut = (*cleared[root], *take_rows(polygons, by_area))
        shapely.prepare(cut)
        limits = _LinkLimits(
            walls[region.pocket],
            min_distance,
            cut,
            _MAX_UNCUT * stepover,
            lean_length,
            lean_angle,
            channels[root],
        )
        ended: list[_PassBuilder] = []
        last = _add_region(region, builder, limits, first, stepover, ended)
        for other in others:
            other.successor = last
        for earlier, later in pairwise([*ended, last]):
            earlier.successor = later
        finished += (*others, *ended)
        if root in after_channel:
            after_channel[root] = last
        else:
            current[k] = last
    finished += (*after_channel.values(), *current.values())
    _set_channel_successors(finished)
    return _freeze_all(finished)


def _freeze_all(builders: Sequence[_PassBuilder]) -> list[LinkedPasses]:
    index = {id(builder): k for k, builder in enumerate(builders)}
    return [
        LinkedPasses(
            builder.pocket,
            join_chains(builder.parts),
            builder.pass_count,
            builder.entry_radius,
            index[id(builder.successor)] if builder.successor is not None else -1,
            builder.channel_segments,
            builder.steep_links,
        )
        for builder in builders
    ]


def _order_inside_first(children: Sequence[Sequence[int]], roots: Sequence[int]) -> list[int]:
    order, stack = [], list(roots)
    while stack:
        order.append(stack.pop())
        stack += children[order[-1]]
    return order[::-1]


def group_channels(
    regions: Sequence[OffsetRegion], channels: Sequence[Sequence[Channel]]
) -> dict[int, list[Channel]]:
    """The channels by pocket, without pockets that have none.

    channels: channels of each region.
    """
    groups: dict[int, list[Channel]] = {}
    for region, region_channels in zip(regions, channels, strict=True):
        if region_channels:
            groups.setdefault(region.pocket, []).extend(region_channels)
    return groups


def find_outermost(regions: Sequence[OffsetRegion]) -> list[int]:
    """For each region the index of the outermost region around it, or its own index.

    regions: offset regions, each after its parent.
    """
    roots: list[int] = []
    for k, region in enumerate(regions):
        roots.append(roots[region.parent] if region.parent >= 0 else k)
    return roots


def _start_with_channel(region: OffsetRegion, channel: Channel) -> _PassBuilder:
    builder = _PassBuilder(region.pocket, channel.entry_radius)
    builder.parts.append(channel.chain)
    builder.channel_segments = len(channel.chain)
    builder.last_ring = channel.rim
    return builder


def _set_channel_successors(builders: list[_PassBuilder]) -> None:
    """Set successors in the pockets of which a channel is a path of its own.

    There all linked passes come one after the other, with such channels first.
    """
    for of_pocket in group_by_pocket(builders).values():
        of_pocket.sort(key=lambda builder: builder.pass_count > 0)
        if of_pocket[0].pass_count:
            continue
        for earlier, later in pairwise(of_pocket):
            earlier.successor = later
        of_pocket[-1].successor = None


def _add_region(
    region: OffsetRegion,
    builder: _PassBuilder | None,
    limits: _LinkLimits,
    first: float,
    stepover: float,
    ended: list[_PassBuilder],
) -> _PassBuilder:
    """Add all passes of a region.

    builder: the linked passes to continue, None to start new ones.
    first, stepover: mm, as in `link_passes`.
    ended: gets the linked passes that end in this region because no link leads on.

    Returns the linked passes that end with the last pass of the region.
    """
    pending = list(region.passes)
    while pending:
        if builder is None:
            builder = _enter_region(region, pending, first)
            continue
        for k in _sort_ascending(_find_feet(pending, builder.position)[1]).tolist():
            if _add_linked(builder, pending[k], limits, stepover):
                pending.pop(k)
                break
        else:
            ended.append(builder)
            builder = None
    assert builder is not None
    return builder


def _enter_region(region: OffsetRegion, pending: list[Segments], first: float) -> _PassBuilder:
    """Start new linked passes in a region.

    They start in the middle of its largest inscribed circle if all of its border is to be cut.
    Otherwise they start on the longest pass.

    pending: passes of the region; the first one to be cut is removed.
    first: distance of the outermost passes from the walls, mm.
    """
    margin = region.distance - first
    if region.is_whole and len(pending) == len(region.passes):
        # A symmetric region has several such circles. Rounded corners make the choice repeatable.
        polygon = shapely.transform(region.polygon, lambda points: np.round(points, _EQUAL_DIGITS))
        middle, edge = shapely.get_coordinates(shapely.maximum_inscribed_circle(polygon, 0.01))
        inscribed = float(np.hypot(*(edge - middle)))
        if inscribed > _MIN_INSCRIBED_MM:
            feet, distances = _find_feet(pending, middle)
            k = int(_sort_ascending(distances)[0])
            builder = _PassBuilder(region.pocket, margin + inscribed)
            ring = start_at(pending.pop(k), float(feet[k]))
            builder.parts.append(make_lines(middle, ring.start[:1]))
            builder.add_pass(ring, True)
            return builder
    builder = _PassBuilder(region.pocket, margin)
    lengths = np.array([chain.length.sum() for chain in pending])
    builder.add_pass(pending.pop(int(_sort_ascending(-lengths)[0])), region.is_whole)
    return builder


def _find_feet(chains: Sequence[Segments], point: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The nearest point (K,) of each chain, mm from its start, and its distance (K,), mm."""
    feet, distances = np.transpose([find_nearest(chain, point) for chain in chains])
    return feet, distances


def _add_linked(
    builder: _PassBuilder, chain: Segments, limits: _LinkLimits, stepover: float
) -> bool:
    """Add a pass with a link to it; False, without any change, if no link leads to it.

    A link that keeps the engagement limit is preferred. Others are tried in this order: a slanting
    link near the tool, the shortest link, a link from another point of the last closed pass.
    """
    if math.dist(chain.end[-1], chain.start[0]) >= _TOLERANCE_MM:
        return _add_linked_open(builder, chain, limits)
    total = float(chain.length.sum())
    foot = find_nearest(chain, builder.position)[0]
    linked = _find_link_over_channel(builder, chain, limits)
    if linked is None and limits.lean_length:
        linked = _find_gentle_link(builder, chain, foot, limits)
    if linked is not None:
        link, length = linked
        builder.parts.append(link)
        builder.add_pass(start_at(chain, length), True)
        return True
    ahead = (foot + np.array(_AHEAD) * min(stepover, total / 12)) % total
    links = make_lines(builder.position, locate(chain, ahead))
    starts = ahead[_find_first_free(links, limits)]
    if not len(starts):
        lengths = sample_chain(chain, total / _TRIED_POINTS)[0][:-1]
        ends = locate(chain, lengths)
        links = make_lines(builder.position, ends)
        order = _sort_ascending(links.length)
        starts = lengths[order[_find_first_free(links.take(order), limits)]]
        if not len(starts):
            starts = lengths[_advance_on_ring(builder, ends, limits)]
    if not len(starts):
        return False
    builder.steep_links += 1
    builder.add_pass(start_at(chain, float(starts[0])), True)
    return True


def _add_linked_open(builder: _PassBuilder, chain: Segments, limits: _LinkLimits) -> bool:
    """Add an open pass with a link to its start; False, without any change, if none is found."""
    start = chain.start[:1]
    keeps_limit = limits.lean_length > 0 and _is_linked(builder, start, limits.in_cleared_area())
    over_channel = None if keeps_limit else _find_way_over_channel(builder, start, limits)
    if over_channel is not None:
        builder.parts.append(over_channel[0])
        keeps_limit = True
    is_linked = keeps_limit or _is_linked(builder, start, limits)
    if not is_linked and not len(_advance_on_ring(builder, start, limits)):
        return False
    builder.steep_links += not keeps_limit
    builder.add_pass(chain, False)
    return True


def _find_link_over_channel(
    builder: _PassBuilder, chain: Segments, limits: _LinkLimits
) -> tuple[Segments, float] | None:
    """A link to a closed pass over the area that a channel has cleared.

    Returns the link and its end on the pass, mm from its start; None if there is no such link.
    """
    if not limits.channels:
        return None
    spacing = _CHANNEL_SPACING_FRACTION * limits.channels[0].tool_radius
    lengths, points = sample_chain(chain, spacing)
    link = _find_way_over_channel(builder, points, limits)
    return None if link is None else (link[0], float(lengths[link[1]]))


def _find_way_over_channel(
    builder: _PassBuilder, ends: FloatArray, limits: _LinkLimits
) -> tuple[Segments, int] | None:
    """A link over the area that a channel has cleared to one of `ends` (M, 2).

    Returns the link and the row of its end. None if material separates the tool, or the nearest
    end, from all channels.
    """
    for channel in limits.channels:
        first = _find_access(builder.position, channel, limits)
        if first is None:
            continue
        inside = np.flatnonzero(channel.contains(ends))
        rows = inside if len(inside) else np.arange(len(ends))
        row = int(rows[_sort_ascending(np.hypot(*(ends[rows] - builder.position).T))[0]])
        last = _find_access(ends[row], channel, limits)
        if last is not None:
            return make_polyline(
                np.vstack([builder.position, channel.find_link(first, last), ends[row]])
            ), row
    return None


def _find_access(point: FloatArray, channel: Channel, limits: _LinkLimits) -> FloatArray | None:
    """The point (2,) of a channel to which a line leads from `point` (2,) over the cleared area.

    This is `point` itself if a disc contains it, otherwise the centre of a disc nearby. None if
    there is material between.
    """
    if channel.contains(point[None])[0]:
        return point
    links = make_lines(point, tabulate_discs(channel.discs)[:, :2])
    links = links.take(_sort_ascending(links.length)[:_BATCH])
    rows = _find_first_free(links, limits.in_cleared_area())
    return np.asarray(links.end[rows[0]]) if len(rows) else None


def _find_gentle_link(
    builder: _PassBuilder, chain: Segments, foot: float, limits: _LinkLimits
) -> tuple[Segments, float] | None:
    """A link to a closed pass that keeps the engagement limit.

    foot: point of the pass that is nearest to the tool, mm from its start.

    Returns the link and its end on the pass, mm from its start; None if there is no such link.
    """
    total = float(chain.length.sum())
    near_foot = foot + limits.lean_length * np.linspace(-1, 1, _TRIED_POINTS)
    all_around = sample_chain(chain, total / _TRIED_POINTS)[0][:-1]
    lengths = np.concatenate([near_foot % total, all_around])
    links = make_lines(builder.position, locate(chain, lengths))
    order = _sort_ascending(links.length)
    rows = order[_find_first_free(links.take(order), limits.in_cleared_area())]
    if len(rows):
        return links.take(rows), float(lengths[rows[0]])
    return _find_leaning_arc(builder, chain, limits)


def _find_leaning_arc(
    builder: _PassBuilder, chain: Segments, limits: _LinkLimits
) -> tuple[Segments, float] | None:
    """A link that leaves the last closed pass and approaches the next one at a small angle.

    Returns the link and its end on `chain`, mm from its start; None if there is no such link.
    """
    total = float(chain.length.sum())
    ring, ahead = builder.last_ring, limits.lean_length * np.array(_LEAN_FACTORS)
    ahead = ahead[ahead < total / 3]
    if ring is None or not len(ahead):
        return None
    start = find_nearest(ring, builder.position)[0]
    start_point = locate(ring, np.array([start]))
    to_ring = make_lines(builder.position, start_point)
    is_on_ring = to_ring.length[0] <= _TOLERANCE_MM
    if not is_on_ring and not len(_find_first_free(to_ring, limits.in_cleared_area())):
        return None
    foot = find_nearest(chain, start_point[0])[0]
    # At half its length the link is in the middle between both passes. Between straight passes it
    # is a line, otherwise an arc.
    on_ring = locate(ring, (start + ahead / 2) % float(ring.length.sum()))
    half = (on_ring + locate(chain, (foot + ahead / 2) % total)) / 2
    ends = (foot + ahead) % total
    lines = make_lines(start_point[0], locate(chain, ends))
    links = make_segments(
        lines.start, lines.end, compute_bulges(lines.start, half, lines.end), lines.owner
    )
    directions = tangents_at(links, np.ones(len(links)))
    cosine = (directions * tangents_along(chain, ends)).sum(axis=1)
    is_free = measure_gaps(links, limits.walls, limits.min_distance) >= limits.min_distance
    rows = np.flatnonzero((cosine >= math.cos(limits.lean_angle)) & is_free)
    return (links.take(rows[:1]), float(ends[rows[0]])) if len(rows) else None


def _is_linked(builder: _PassBuilder, end: FloatArray, limits: _LinkLimits) -> bool:
    return len(_find_first_free(make_lines(builder.position, end), limits)) > 0


def _advance_on_ring(builder: _PassBuilder, ends: FloatArray, limits: _LinkLimits) -> IntArray:
    """Move along the last closed pass to a point from which a link leads to one of `ends` (M, 2).

    If the tool is not on that pass, it returns there first. The link itself is not added.

    Returns the row of the end, as an array of one. Without such a link it is empty, and nothing is
    changed.
    """
    nothing = np.zeros(0, dtype=np.int64)
    if builder.last_ring is None:
        return nothing
    ring, total = builder.last_ring, float(builder.last_ring.length.sum())
    lengths, points = sample_chain(ring, total / _TRIED_POINTS)
    start, distance = find_nearest(ring, builder.position)
    if distance > _TOLERANCE_MM:
        # An open pass beside the ring was the last one.
        returns = np.concatenate([[start], lengths])
        lines = make_lines(builder.position, locate(ring, returns))
        order = _sort_ascending(lines.length)
        free = order[_find_first_free(lines.take(order), limits)]
        if not len(free):
            return nothing
        start = float(returns[free[0]])
    distances = np.hypot(*np.moveaxis(points[:, None] - ends[None], 2, 0))
    shortest = _sort_ascending(distances.ravel())[: 2 * _TRIED_POINTS]
    from_row, to_row = np.unravel_index(shortest, distances.shape)
    count = len(shortest)
    lines = make_segments(points[from_row], ends[to_row], np.zeros(count), np.arange(count))
    free = _find_first_free(lines, limits)
    if len(free):
        leave = float(lengths[from_row[free[0]]])
        builder.parts.append(cut_out(ring, start, leave if leave > start else leave + total))
    return np.asarray(to_row[free])


def _sort_ascending(sizes: FloatArray) -> IntArray:
    """The rows (N,) of `sizes` (N,), mm or mm2, smallest first; equal sizes keep their order."""
    return np.argsort(np.round(sizes, _EQUAL_DIGITS), kind="stable")


def _find_first_free(links: Segments, limits: _LinkLimits) -> IntArray:
    """The row of the first link that keeps the limits, as an array of one; empty if none does."""
    for low in range(0, len(links), _BATCH):
        rows = np.arange(low, min(low + _BATCH, len(links)))
        # The test of uncut material is much faster than that of the walls.
        rows = rows[_measure_uncut(links.take(rows), limits) <= limits.max_uncut]
        if len(rows):
            distance = measure_gaps(links.take(rows), limits.walls, limits.min_distance)
            rows = rows[distance >= limits.min_distance]
        if len(rows):
            return np.asarray(rows[:1])
    return np.zeros(0, dtype=np.int64)


def _measure_uncut(links: Segments, limits: _LinkLimits) -> FloatArray:
    """The length (N,) of each straight link in uncut material, mm, from samples along it."""
    spacing = _SAMPLE_FRACTION * limits.min_distance
    count = np.clip(np.ceil(links.length / spacing), 2, _MAX_SAMPLES).astype(np.int64)
    link = list_owners(count)
    points = points_at(links.take(link), (number_rows(count) + 0.5) / count[link])
    is_uncut = np.ones(len(points), dtype=bool)
    for polygon in limits.cut:
        rows = np.flatnonzero(is_uncut)
        is_uncut[rows] = ~shapely.contains_xy(polygon, points[rows])
    return np.asarray(np.bincount(link, is_uncut, len(links)) * links.length / count)
