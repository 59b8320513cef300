"""Trochoidal channels: loops along the medial axis of a pocket that keep the engagement limit.

A pass at a constant distance from the walls has the engagement of its stepover on a straight wall
and more on inner curves. In corners, in necks and on the first pass in the middle of a pocket
nearly the whole tool is engaged. All these places lie on the medial axis, or on curves around
points of it.

So trochoidal loops clear discs along the medial axis before the passes, one after the other. Each
disc extends beyond the previous one only as far as the engagement along its front stays within the
limit. The tool returns in a straight line over the cleared area. A disc is no larger than
necessary: on a curve of its radius a pass keeps the limit without loops. At the walls it leaves as
much material as the pass along them may take.

All discs are areas of the tool centre. The tool clears an area that is larger by its radius.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import shapely
from msgspec import Struct

from camgen.geometry.segments import BoolArray, Segments, make_segments
from camgen.model.pose import FloatArray
from camgen.plan.pocket.engagement_limit import EngagementLimit, compute_disc_radii
from camgen.plan.pocket.fronts import bare_spans, clear_spans, crossings, unrolled
from camgen.plan.pocket.medial_axis import MedialAxis

#: Radius of the smallest disc, as a fraction of the tool radius: a smaller one has no room for a
#: loop.
_MIN_RADIUS_FRACTION = 0.05
#: A disc is needed if it extends beyond the previous one by this fraction of the tool radius.
_MIN_ADVANCE_FRACTION = 0.02
#: Maximum distance between the centres of two successive discs, as a fraction of the smaller
#: radius of both.
_MAX_STEP_FRACTION = 1.4
#: Directions along the front of a disc in which the engagement is computed.
_FRONT_SAMPLES = 13
#: Points of the medial axis that are tested together.
_BATCH = 48
#: Maximum number of intervals between the points of a branch at which is tested whether earlier
#: loops have cleared it.
_BRANCH_TESTS = 16
#: A stretch of a front over cleared area is left out from this length on, as a fraction of the
#: tool radius.
_SKIPPED_FRACTION = 1.0
#: mm: points nearer than this to each other are equal. A disc contains points that are farther than
#: this inside its rim.
_SAME_MM = 1e-6
#: Minimum growth of the radius in half a turn of the first spiral, as a fraction of the tool
#: radius.
_MIN_GROWTH_FRACTION = 0.1


class Disc(Struct, frozen=True):
    """A cleared disc of tool-centre positions.

    x, y: centre, mm.
    radius: mm.
    parent: index of the disc from which this one was cut, -1 for the first.
    """

    x: float
    y: float
    radius: float
    parent: int


def _make_disc(centre: FloatArray, radius: float, parent: int) -> Disc:
    return Disc(float(centre[0]), float(centre[1]), radius, parent)


class Channel(Struct, frozen=True, eq=False):
    """A trochoidal channel, whose path starts and ends at the centre of its first disc.

    discs: all discs, each after the neighbour from which it was cut.
    tool_radius: mm.
    entry_radius: largest distance of the tool centre from the centre of the first disc during the
        entry, mm.
    rim: circle of the first disc, in the direction of travel.
    chain: path of the tool centre.
    engagements: (M,) engagements along the arcs of `chain`.
    lengths: (M,) length of the path with each engagement, mm.
    """

    discs: tuple[Disc, ...]
    tool_radius: float
    entry_radius: float
    rim: Segments
    chain: Segments
    engagements: FloatArray
    lengths: FloatArray

    def contains(self, points: FloatArray) -> BoolArray:
        """(N,) whether each of `points` (N, 2) lies in a disc: there the tool cuts nothing."""
        table = tabulate_discs(self.discs)
        _, inside = shapely.STRtree(shapely.points(points)).query(
            shapely.points(table[:, :2]), predicate="dwithin", distance=table[:, 2] - _SAME_MM
        )
        return np.isin(np.arange(len(points)), inside)

    def find_link(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """Corners (K, 2) of a link over the cleared area from `start` to `end` (2,).

        Both points have to lie in discs.
        """
        table = tabulate_discs(self.discs)
        steps = np.stack([start, end])[:, None] - table[None, :, :2]
        margins = table[:, 2] - np.hypot(*np.moveaxis(steps, 2, 0))
        first, last = np.argmax(margins, axis=1).tolist()
        path = _find_disc_path(self.discs, first, last)
        table = np.vstack([[*start, 0.0], table[path], [*end, 0.0]])
        return np.asarray(table[_shorten_path(table, 0, len(table) - 1), :2])

    def make_polygon(self, growth: float) -> Any:
        """The union of all discs, with radii enlarged by `growth` in mm, as a polygon."""
        table = tabulate_discs(self.discs)
        discs = shapely.buffer(shapely.points(table[:, :2]), table[:, 2] + growth, quad_segs=32)
        return shapely.union_all(discs)


def unite_channels(channels: Sequence[Channel], growth: float) -> Any:
    """The union of the polygons of `channels`; growth: mm, as in `Channel.make_polygon`."""
    return shapely.union_all([channel.make_polygon(growth) for channel in channels])


def plan_channels(
    axis: MedialAxis, min_distance: float, limit: EngagementLimit, helix_radius: float
) -> Iterator[Channel]:
    """Plan one channel for each connected part of a medial axis that has room for loops.

    min_distance: minimum distance of the tool centre from the walls, mm.
    helix_radius: radius of the helix of the entry, mm; 0 without a helix.
    """
    radii = compute_disc_radii(axis, axis.wall_distance - min_distance, limit)
    fits = radii >= _MIN_RADIUS_FRACTION * limit.tool_radius
    neighbours: list[list[int]] = [[] for _ in radii]
    for first, second in axis.links[fits[axis.links].all(axis=1)].tolist():
        neighbours[first].append(second)
        neighbours[second].append(first)
    pending = set(np.flatnonzero(fits).tolist())
    # A channel starts at the point farthest from the walls, in the middle of an open area.
    by_distance = sorted(pending, key=lambda k: (-float(axis.wall_distance[k]), k))
    for root in by_distance:
        if root not in pending:
            continue
        sources = _find_shortest_paths(axis.points, neighbours, root)
        pending -= set(sources)
        builder = _ChannelBuilder(axis.points, radii, limit)
        _cut_channel(builder, root, sources, helix_radius)
        yield builder.make_channel(float(axis.wall_distance[root]) - min_distance)


def _find_shortest_paths(
    points: FloatArray, neighbours: Sequence[Sequence[int]], root: int
) -> dict[int, int]:
    """For each point connected with `root`, the point before it on the shortest path from there.

    -1 for `root` itself.
    """
    sources: dict[int, int] = {}
    queue = [(0.0, root, -1)]
    while queue:
        length, point, source = heapq.heappop(queue)
        if point in sources:
            continue
        sources[point] = source
        for neighbour in neighbours[point]:
            if neighbour not in sources:
                step = math.dist(points[point], points[neighbour])
                heapq.heappush(queue, (length + step, neighbour, point))
    return sources


def _list_ends(sources: dict[int, int], root: int) -> list[int]:
    """The end points of the tree of shortest paths, depth first.

    So branches that separate late follow each other.
    """
    children: dict[int, list[int]] = {}
    for point, source in sources.items():
        children.setdefault(source, []).append(point)
    ends, stack = [], [root]
    while stack:
        point = stack.pop()
        stack += children.get(point, [])
        if point not in children:
            ends.append(point)
    return ends


class _ChannelBuilder(Struct, eq=False):
    """A channel while its loops are added.

    points: (N, 2) points of the medial axis, mm.
    radii: (N,) radius of the disc around each point, mm.
    limit: the engagement limit.
    discs: discs that are cleared.
    current: index of the disc in which the tool is.
    corners: points of the path so far; the tool is at the last one.
    bulges: bulge of each segment of the path.
    engagements, lengths: arrays as in `Channel`, one pair for each arc.
    """

    points: FloatArray
    radii: FloatArray
    limit: EngagementLimit
    discs: list[Disc] = []
    current: int = 0
    corners: list[FloatArray] = []
    bulges: list[float] = []
    engagements: list[FloatArray] = []
    lengths: list[FloatArray] = []

    def move_to(self, point: FloatArray, bulge: float = 0.0) -> None:
        """Add a line or arc to a point (2,); nothing if the tool is there."""
        if math.dist(point, self.corners[-1]) > _SAME_MM:
            self.corners.append(point)
            self.bulges.append(bulge)

    def make_channel(self, entry_radius: float) -> Channel:
        """The finished channel."""
        corners = np.array(self.corners)
        owner = np.zeros(len(corners) - 1, dtype=np.int64)
        chain = make_segments(corners[:-1], corners[1:], np.array(self.bulges), owner)
        empty = np.zeros(0)
        return Channel(
            tuple(self.discs),
            self.limit.tool_radius,
            entry_radius,
            _make_rim(self.discs[0], self.limit.ccw),
            chain,
            np.concatenate([empty, *self.engagements]),
            np.concatenate([empty, *self.lengths]),
        )


def _cut_channel(
    builder: _ChannelBuilder, root: int, sources: dict[int, int], helix_radius: float
) -> None:
    """Clear the discs around all points of a connected part of the medial axis, and return.

    root: the point at which the channel starts and ends.
    sources: point before each point on the shortest path from `root`, -1 for `root`.
    """
    points, radii = builder.points, builder.radii
    radius = float(radii[root])
    builder.corners.append(points[root])
    builder.discs.append(_make_disc(points[root], radius, -1))
    _clear_first_disc(builder, min(helix_radius, radius))
    slack = _MIN_ADVANCE_FRACTION * builder.limit.tool_radius
    # The disc from which the channel continues at each point.
    disc_at = {root: 0}
    for end in _list_ends(sources, root):
        branch = [end]
        while branch[-1] not in disc_at:
            branch.append(sources[branch[-1]])
        branch.reverse()
        fork = disc_at[branch[0]]
        branch = branch[1:]
        tested = branch[:: -max(len(branch) // _BRANCH_TESTS, 1)]
        if branch and not _are_covered(points[tested], radii[tested], builder.discs, slack).all():
            _return_to(builder, fork)
            _follow_branch(builder, branch, disc_at)
        for point in branch:
            disc_at.setdefault(point, fork)
    _return_to(builder, 0)
    builder.move_to(points[root])


def _make_rim(disc: Disc, ccw: bool) -> Segments:
    ends = np.array([[disc.x - disc.radius, disc.y], [disc.x + disc.radius, disc.y]])
    bulges = np.full(2, 1.0 if ccw else -1.0)
    return make_segments(ends, ends[::-1], bulges, np.zeros(2, dtype=np.int64))


def _are_covered(
    points: FloatArray, radii: FloatArray, discs: Sequence[Disc], slack: float
) -> BoolArray:
    """(N,) whether the disc around each of `points` (N, 2) lies in one of `discs`.

    radii: (N,) radii of the discs around `points`, mm.
    slack: overhang that does not count, mm.
    """
    table = tabulate_discs(discs)
    distance = np.hypot(*np.moveaxis(points[:, None] - table[None, :, :2], 2, 0))
    return np.asarray((distance + radii[:, None] <= table[None, :, 2] + slack).any(axis=1))


def _clear_first_disc(builder: _ChannelBuilder, helix_radius: float) -> None:
    limit, radius = builder.limit, builder.discs[0].radius
    centre = builder.corners[0]
    r, rho, side = limit.tool_radius, helix_radius, -1.0
    bulge = 1.0 if limit.ccw else -1.0
    if helix_radius:
        builder.move_to(centre + np.array([side * rho, 0.0]))
    while rho < radius - 1e-9:
        # A whole turn cuts twice the growth g of half a turn. The engagement of a pass with the
        # stepover 2 g on the radius rho + g equals the limit for this growth.
        growth = limit.engagement * r * rho / (rho + (1 - limit.engagement) * r)
        keeps_limit = growth > _MIN_GROWTH_FRACTION * r
        growth = min(max(growth, _MIN_GROWTH_FRACTION * r), radius - rho)
        rho, side = rho + growth, -side
        builder.move_to(centre + np.array([side * rho, 0.0]), bulge)
        # The first turns belong to the entry, as a plunge does, and are not counted.
        if keeps_limit:
            builder.engagements.append(np.array([growth * (rho - growth + r) / (rho * r)]))
            builder.lengths.append(np.array([math.pi * rho]))
    for _ in range(2):
        side = -side
        builder.move_to(centre + np.array([side * radius, 0.0]), bulge)


def _follow_branch(
    builder: _ChannelBuilder, branch: Sequence[int], disc_at: dict[int, int]
) -> None:
    """Clear discs along a branch of the medial axis, from the current disc on.

    branch: successive points of the axis.
    disc_at: gets the disc from which the channel continues at each point of the branch.
    """
    points, radii, limit = builder.points, builder.radii, builder.limit
    start = 0
    while start < len(branch):
        rows = np.array(branch[start : start + _BATCH])
        disc = builder.discs[builder.current]
        distance = np.hypot(*(points[rows] - np.array([disc.x, disc.y])).T)
        min_advance = _MIN_ADVANCE_FRACTION * limit.tool_radius
        advances = distance + radii[rows] > disc.radius + min_advance
        if not advances.any():
            disc_at |= dict.fromkeys(rows.tolist(), builder.current)
            start += len(rows)
            continue
        engagements = _compute_engagements(disc, points[rows], radii[rows], limit)
        smaller = np.minimum(disc.radius, np.maximum(radii[rows], disc.radius / 4))
        is_valid = engagements.max(axis=1) <= limit.engagement
        is_valid &= distance <= _MAX_STEP_FRACTION * smaller
        # The farthest disc is chosen up to which all discs that advance are valid. If not even the
        # first of them is, that one is cut, and its engagement is reported.
        first = int(np.argmax(advances))
        invalid = np.flatnonzero(~is_valid[first:])
        stop = first + int(invalid[0]) if len(invalid) else len(rows)
        chosen = max(stop - 1, first)
        disc_at |= dict.fromkeys(rows[: chosen + 1].tolist(), builder.current)
        front = points[rows[chosen]], float(radii[rows[chosen]])
        _cut_front(builder, *front, engagements[chosen])
        disc_at[int(rows[chosen])] = builder.current
        start += chosen + 1


def _compute_engagements(
    disc: Disc, points: FloatArray, radii: FloatArray, limit: EngagementLimit
) -> FloatArray:
    """Engagements (M, F) along the fronts of M new discs, each cut from the cleared `disc`.

    On a front the tool centre is at an angle phi around the new centre. The part of the tool's rim
    in the material is farther from the centre of `disc` than its cleared radius. The law of cosines
    gives its angle on both sides of the direction away from that centre. The part of it ahead of
    the tool is counted, by the width that it cuts.

    points: (M, 2) centres of the new discs, mm.
    radii: (M,) their radii, mm.
    """
    r, cleared_radius = limit.tool_radius, disc.radius + limit.tool_radius
    distance = np.hypot(*(points - np.array([disc.x, disc.y])).T)
    fractions = np.linspace(-1, 1, _FRONT_SAMPLES)
    phi = _compute_half_fronts(disc.radius, distance, radii)[:, None] * fractions
    x = distance[:, None] + radii[:, None] * np.cos(phi)
    y = radii[:, None] * np.sin(phi)
    from_disc = np.maximum(np.hypot(x, y), 1e-12)
    cosine = (cleared_radius**2 - from_disc**2 - r**2) / (2 * from_disc * r)
    half_span = np.arccos(np.clip(cosine, -1, 1))
    lean = np.arctan2(y, x) - phi
    low, high = np.clip(lean - half_span, 0, np.pi), np.clip(lean + half_span, 0, np.pi)
    return np.asarray((np.cos(low) - np.cos(high)) / 2)


def _compute_half_fronts(radius: float, distance: FloatArray, radii: FloatArray) -> FloatArray:
    """Half the angle (M,) of each new disc's front, around its centre, rad.

    There its circle meets that of the cleared disc.

    radius: radius of the cleared disc, mm.
    distance: (M,) distances of the new centres from that disc's centre, mm.
    radii: (M,) radii of the new discs, mm.
    """
    cosine = (radius**2 - distance**2 - radii**2) / (2 * np.maximum(distance, 1e-12) * radii)
    return np.arccos(np.clip(cosine, -1, 1))


def _cut_front(
    builder: _ChannelBuilder, centre: FloatArray, radius: float, engagements: FloatArray
) -> None:
    """Cut the front of a new disc from the current disc; the new disc becomes the current one.

    Long stretches of the front that lie in other discs are crossed in straight lines.

    centre: (2,) centre of the new disc, mm.
    radius: mm.
    engagements: (F,) along the front.
    """
    disc, limit = builder.discs[builder.current], builder.limit
    sense = 1.0 if limit.ccw else -1.0
    zero = math.atan2(disc.y - centre[1], disc.x - centre[0])

    def on_rim(angle: float) -> FloatArray:
        turned = zero + sense * angle
        return centre + radius * np.array([math.cos(turned), math.sin(turned)])

    spans = clear_spans(np.array([*centre, radius]), tabulate_discs(builder.discs), zero, sense)
    clear = unrolled(spans)
    reached = spans[builder.current][1]
    builder.move_to(on_rim(reached))
    length = 0.0
    for first, last in bare_spans(clear, reached, _SKIPPED_FRACTION * limit.tool_radius / radius):
        for angle in crossings(clear, reached, first):
            builder.move_to(on_rim(angle))
        bulge = sense * math.tan((last - first) / 8)
        builder.move_to(on_rim((first + last) / 2), bulge)
        builder.move_to(on_rim(last), bulge)
        length += radius * (last - first)
        reached = last
    builder.engagements.append(engagements)
    builder.lengths.append(np.full(len(engagements), length / len(engagements)))
    builder.discs.append(_make_disc(centre, radius, builder.current))
    builder.current = len(builder.discs) - 1


def tabulate_discs(discs: Sequence[Disc]) -> FloatArray:
    """Centre and radius of each disc, (D, 3), mm."""
    return np.array([(disc.x, disc.y, disc.radius) for disc in discs])


def _return_to(builder: _ChannelBuilder, target: int) -> None:
    if builder.current == target:
        return
    table = tabulate_discs(builder.discs)[_find_disc_path(builder.discs, builder.current, target)]
    # The path leads first from the end of a front to the centre of its disc. From there on it is
    # known to be clear.
    for k in _shorten_path(table, 0, len(table) - 1):
        builder.move_to(table[k, :2])
    builder.current = target


def _find_disc_path(discs: Sequence[Disc], start: int, end: int) -> list[int]:
    """Indices of the discs from one to another, each of them cut from its neighbour."""
    from_start, from_end = [start], [end]
    while from_start[-1] != from_end[-1]:
        later = from_start if from_start[-1] > from_end[-1] else from_end
        later.append(discs[later[-1]].parent)
    return [*from_start, *from_end[-2::-1]]


def _shorten_path(table: FloatArray, first: int, last: int) -> list[int]:
    """Choose discs whose centres are joined by straight lines that stay in the union of all discs.

    table: (K, 3) centres and radii, mm; neighbouring discs overlap.
    first, last: rows of the first and the last disc, which are always chosen.

    Returns the chosen rows.
    """
    if last - first < 2:
        return [first, last] if last > first else [first]
    if _is_covered(table[first, :2], table[last, :2], table[first : last + 1]):
        return [first, last]
    middle = (first + last) // 2
    return _shorten_path(table, first, middle) + _shorten_path(table, middle, last)[1:]


def _is_covered(start: FloatArray, end: FloatArray, discs: FloatArray) -> bool:
    length = math.dist(start, end)
    direction = (end - start) / max(length, _SAME_MM)
    steps = discs[:, :2] - start
    along = steps @ direction
    square = discs[:, 2] ** 2 - (steps**2).sum(axis=1) + along**2
    half = np.sqrt(np.maximum(square, 0.0))
    chords = np.column_stack([along - half, along + half])[square >= 0]
    reached = 0.0
    for low, high in sorted(chords.tolist()):
        if low > reached + _SAME_MM:
            break
        reached = max(reached, high)
    return reached >= length - _SAME_MM
