"""Plans the paths that clear pockets, from the middle outwards.

Outermost contours are walls, contours inside them islands, contours inside islands walls again. The
passes are exact offset curves of the walls: arcs stay arcs, and the last pass runs along the walls.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from camgen.geometry.intersect import nearest_distances
from camgen.geometry.nesting import Nesting, nest
from camgen.geometry.segments import (
    Segments,
    concatenate,
    flatten,
    from_contours,
    neighbours,
    points_at,
)
from camgen.geometry.uncross import find_slips, uncross
from camgen.model.errors import InputError, JobError
from camgen.model.job import Job
from camgen.model.part import Contour, Note, Part
from camgen.model.path import ToolPath
from camgen.model.pose import FloatArray
from camgen.model.text import counted, name_ranges, short
from camgen.plan.beside import NO_HELIX, centre_lines, does_not_fit
from camgen.plan.columns import (
    SLOWEST,
    Label,
    SegmentWork,
    pass_depths,
    plunge_path,
    sideways,
    tool_paths,
)
from camgen.plan.follow import turn_round
from camgen.plan.open_outlines import check_outlines
from camgen.plan.pocket.channel import Channel, plan_channels
from camgen.plan.pocket.engagement import measure_engagement
from camgen.plan.pocket.engagement_limit import EngagementLimit
from camgen.plan.pocket.hops import Speeds, add_hops, lift_hops, make_cleared_area
from camgen.plan.pocket.linking import LinkedPasses, find_outermost, link_passes
from camgen.plan.pocket.medial_axis import compute_medial_axis
from camgen.plan.pocket.regions import (
    CHORD_MM,
    MIN_CORNERS,
    QUARTER_CHORDS,
    OffsetRegion,
    PocketWalls,
    RegionForest,
    compute_regions,
    compute_wall_passes,
    make_pocket_polygon,
    select_pockets,
)

#: Maximum stepover, as a fraction of the tool diameter. With a larger one, passes leave ridges on a
#: real machine.
_MAX_STEPOVER = 0.95
#: Maximum radius of an entry helix, as a fraction of the tool diameter: a wider one leaves a core.
_HELIX_FRACTION = 0.45
#: Minimum area of rest material that is reported as a place, as a fraction of the tool's area.
_PLACE_FRACTION = 0.02
#: Engagement above that of a straight pass that is allowed by default, as a fraction of the
#: diameter.
_DEFAULT_MARGIN = 0.15
#: Minimum of this margin: a smaller one leaves no room for a link from pass to pass.
_MIN_MARGIN = 0.05
#: Engagement above which a pass is reported as similar to a slot.
_HIGH_ENGAGEMENT = 0.9
#: From this engagement on there is no limit.
_MAX_ENGAGEMENT = 0.995
#: Half the maximum width of material that a pass takes in addition to its own, as a fraction of the
#: tool radius.
_THIN_FRACTION = 0.05
#: Spacing of samples of the walls for the medial axis, as a fraction of the tool radius.
_SPACING_FRACTION = 0.2
#: Maximum number of places in a note.
_MAX_PLACES = 100
#: Maximum number of places that are listed in the text of a note.
_NAMED_PLACES = 4
#: mm: a pass is along a wall if it is no farther from the wall than the outermost pass by this.
_AT_WALL_MM = 0.05
#: mm: a loop that crosses itself is repaired if no wider disc fits into the part that crosses.
_SLIP_MM = 0.02
_EMPTY = shapely.Polygon()


class _Pockets(Struct, frozen=True, eq=False):
    """The P pockets of a part.

    walls: their walls and islands.
    names: id of the outer wall of each pocket.
    layers: layer of the outer wall of each pocket.
    contours: ids of all walls of each pocket.
    cleared: polygons that earlier operations clear, for `operation.rest`; empty without it.
    """

    walls: PocketWalls
    names: list[str]
    layers: list[str]
    contours: list[tuple[str, ...]]
    cleared: Any = _EMPTY


def pocket(part: Part, job: Job) -> tuple[tuple[ToolPath, ...], tuple[Note, ...]]:
    """Plan paths that clear the pockets of a part.

    Returns the paths, and notes on contours and material that are not cleared.

    Raises InputError if no contour is closed, JobError if settings contradict each other.
    """
    _check_settings(job)
    contours = [contour for contour in part.contours if part.works_on((contour.id,))]
    if not any(contour.closed for contour in contours):
        raise InputError(
            part.source,
            "no closed contour to clear",
            remedy="close its outlines, or raise input.join",
        )
    chosen_ids = {contour.id for contour in contours}
    check_outlines(
        replace(part, contours=tuple(contours)), chosen_ids, "leave it out of what is cleared"
    )
    pockets, notes = _find_pockets(contours)
    if not pockets.names:
        return (), tuple(notes)
    if job.operation.rest:
        pockets, rest_notes = _keep_rest(pockets, part, job)
        notes += rest_notes
    radius, finish = job.tool.radius, job.operation.finish
    stepover = job.operation.stepover * job.tool.diameter
    climb = job.operation.direction != "conventional"
    rough = compute_regions(pockets.walls, radius + finish, stepover, radius, climb)
    walls = compute_wall_passes(pockets.walls, radius, climb) if finish else rough
    failed = rough.failed | walls.failed
    limit = _make_limit(job)
    regions = _leave_out(rough.regions, failed)
    regions, channels = _plan_channels(regions, pockets, limit, job)
    pocket_walls = [
        pockets.walls.segments.take(pockets.walls.pocket == k) for k in range(len(pockets.names))
    ]
    linked = link_passes(regions, pocket_walls, radius + finish, stepover, channels, limit)
    linked = _add_hops_over_channels(_sort_by_pocket(linked), regions, channels, job)
    borders = [region for region in _leave_out(walls.regions, failed) if region.parent < 0]
    slots = _find_slots(walls, pockets.walls, job)
    paths = _make_paths(linked, borders if finish else [], regions, pockets, job)
    paths = (*paths, *_plan_slots(slots, pockets, job))
    notes += _note_failed(failed, borders, slots, pockets, job)
    notes += _note_passes(linked, regions, channels, pockets, job)
    notes += _note_slots(slots, pockets)
    return paths, (*notes, *_note_rest_material(borders, slots, pockets, job))


def _keep_rest(pockets: _Pockets, part: Part, job: Job) -> tuple[_Pockets, list[Note]]:
    """The areas of the pockets that earlier operations leave, and a note on pockets without any.

    Raises JobError if no operation with a larger tool comes before.
    """
    from camgen.plan.pocket.rest import find_rest_of_pockets  # noqa: PLC0415 (only where asked for)

    rest = find_rest_of_pockets(pockets.walls, part, job)
    names: list[str] = []
    for n, k in enumerate(rest.pocket):
        number = rest.pocket[: n + 1].count(k)
        names.append(f"{pockets.names[k]}.rest{number}")
    layers = [pockets.layers[k] for k in rest.pocket]
    contours = [pockets.contours[k] for k in rest.pocket]
    cleared = [k for k in range(len(pockets.names)) if k not in rest.pocket]
    notes: list[Note] = []
    if cleared:
        walls = [pockets.names[k] for k in cleared]
        count = counted(len(walls), "pocket")
        what = f"nothing is left of {count}: {', '.join(name_ranges(walls))}"
        why = "earlier operations reach all that this tool does"
        ids: list[str] = []
        for k in cleared:
            ids += pockets.contours[k]
        notes.append(Note("assumed", what, why, tuple(ids)))
    return _Pockets(rest.walls, names, layers, contours, rest.cleared), notes


class _Slots(Struct, frozen=True, eq=False):
    """Channels as wide as the tool, and round holes as wide as the tool.

    pocket: (S,) pocket of each channel.
    chains: centre line of each channel, in the order of the pockets.
    holes: (H, 2) centres of the holes, mm.
    hole_pocket: (H,) index of the pocket that is each hole.
    """

    pocket: list[int]
    chains: list[Segments]
    holes: FloatArray
    hole_pocket: list[int]


def _find_slots(wall_passes: RegionForest, walls: PocketWalls, job: Job) -> _Slots:
    """Find the channels and holes that the passes along the walls do not enter."""
    passes = [from_contours([])]
    for region in wall_passes.regions:
        if region.parent < 0:
            passes += region.passes
    lines = centre_lines(
        concatenate(passes),
        walls.segments,
        walls.following,
        walls.pocket,
        job.tool.radius,
        job.tolerance.arc_fit,
    )
    rows = np.searchsorted(lines.segments.owner, np.arange(len(lines.closed)))
    pocket = walls.pocket[lines.source[rows]]
    order = np.argsort(pocket, kind="stable")
    chains = [lines.segments.take(lines.segments.owner == k) for k in order.tolist()]
    hole_pocket = walls.pocket[lines.hole_source].tolist()
    return _Slots(pocket[order].tolist(), chains, lines.holes, hole_pocket)


def _check_settings(job: Job) -> None:
    """Raises JobError for settings with which a pocket cannot be cleared."""
    operation, tool = job.operation, job.tool
    if tool.kind == "drill":
        raise JobError("job", "a drill does not cut sideways", "tool.kind", "choose a mill")
    if job.process.force:
        raise JobError(
            "job",
            "a pocket goes to a depth, not to a force",
            "process.force",
            "set process.force to 0",
        )
    if operation.stepover > _MAX_STEPOVER:
        what = f"passes {operation.stepover:g} of the diameter apart leave ridges between them"
        raise JobError("job", what, "operation.stepover", f"{_MAX_STEPOVER:g} at most")
    min_engagement = operation.stepover + _MIN_MARGIN
    if operation.engagement is not None and operation.engagement < min_engagement:
        what = (
            f"passes {operation.stepover:g} of the diameter apart engage more of it than "
            f"{operation.engagement:g}"
        )
        remedy = f"{min_engagement:g} at least, or a smaller operation.stepover"
        raise JobError("job", what, "operation.engagement", remedy)
    if operation.finish > tool.radius:
        what = (
            f"{operation.finish:g} mm is more than the radius of the tool, "
            "a last pass would leave some of it"
        )
        raise JobError("job", what, "operation.finish", "leave less at the walls")
    if not operation.inside_first:
        what = "pockets are cut from the middle outwards"
        raise JobError("job", what, "operation.inside_first", "leave it out")


def _leave_out(regions: Sequence[OffsetRegion], pockets: frozenset[int]) -> list[OffsetRegion]:
    """The regions outside of some pockets."""
    kept = [k for k, region in enumerate(regions) if region.pocket not in pockets]
    return _select_regions(regions, kept)


def _select_regions(regions: Sequence[OffsetRegion], rows: Sequence[int]) -> list[OffsetRegion]:
    """The regions of some rows, with their parents renumbered; `rows` has all their parents."""
    new_index = {k: n for n, k in enumerate(rows)}
    return [replace(regions[k], parent=new_index.get(regions[k].parent, -1)) for k in rows]


def _make_limit(job: Job) -> EngagementLimit | None:
    """The engagement limit of a job; None if there is no limit."""
    operation, radius = job.operation, job.tool.radius
    engagement = operation.engagement
    if engagement is None:
        engagement = min(1.0, operation.stepover + _DEFAULT_MARGIN)
    if engagement >= _MAX_ENGAGEMENT:
        return None
    stepover = operation.stepover * job.tool.diameter
    return EngagementLimit(radius, stepover, engagement, operation.direction != "conventional")


def _plan_channels(
    regions: list[OffsetRegion], pockets: _Pockets, limit: EngagementLimit | None, job: Job
) -> tuple[list[OffsetRegion], list[tuple[Channel, ...]]]:
    """Plan the channels that are cut before the passes.

    Returns the regions that still need passes, and the channels of each. Only outermost regions
    have channels.
    """
    if limit is None:
        return regions, [()] * len(regions)
    min_distance = limit.tool_radius + job.operation.finish
    spacing = _SPACING_FRACTION * limit.tool_radius
    has_helix = job.operation.entry == "helix"
    helix_radius = _HELIX_FRACTION * job.tool.diameter if has_helix else 0.0
    channels: list[Channel] = []
    for k in sorted({region.pocket for region in regions}):
        walls = select_pockets(pockets.walls, frozenset([k]))
        polygon = make_pocket_polygon(pockets.walls, k)
        axis = compute_medial_axis(
            walls.segments, walls.following, polygon, min_distance, spacing, limit.max_turn
        )
        channels += plan_channels(axis, min_distance, limit, helix_radius)
    if not channels:
        return regions, [()] * len(regions)
    roots = [k for k, region in enumerate(regions) if region.parent < 0]
    starts = shapely.points([(channel.discs[0].x, channel.discs[0].y) for channel in channels])
    tree = shapely.STRtree([regions[k].polygon for k in roots])
    rows, nearest = tree.query_nearest(starts, all_matches=False)
    channels_of: list[list[Channel]] = [[] for _ in regions]
    for row, root in zip(rows.tolist(), nearest.tolist(), strict=True):
        channels_of[roots[root]].append(channels[row])
    kept = _find_needed(regions, channels_of, limit.tool_radius)
    return _select_regions(regions, kept), [tuple(channels_of[k]) for k in kept]


def _find_needed(
    regions: Sequence[OffsetRegion], channels: Sequence[Sequence[Channel]], radius: float
) -> list[int]:
    """Indices of the regions that need passes after the channels.

    These are regions in which the channels leave material, with all regions around them. Material
    so thin that the pass around takes it along does not count.

    radius: tool radius, mm.
    """
    roots = find_outermost(regions)
    cleared: dict[int, Any] = {}
    for k, region_channels in enumerate(channels):
        if region_channels:
            polygons = [channel.make_polygon(radius) for channel in region_channels]
            cleared[k] = shapely.union_all(polygons)
    needed: set[int] = set()
    # Children come after their parents.
    for k in range(len(regions) - 1, -1, -1):
        region = regions[k]
        may_be_done = region.parent >= 0 and region.is_whole and roots[k] in cleared
        if k not in needed and may_be_done:
            border = regions[region.parent].polygon.boundary
            if _is_cleared(region.polygon, border, cleared[roots[k]], radius):
                continue
        needed.add(k)
        if region.parent >= 0:
            needed.add(region.parent)
    return sorted(needed)


def _is_cleared(polygon: Any, border: Any, cleared: Any, radius: float) -> bool:
    """Whether the pass around a region takes all material that channels leave in it.

    polygon: the region.
    border: border of the region around it, along which the pass runs.
    cleared: area that channels clear.
    radius: tool radius, mm.
    """
    left = polygon.buffer(radius, quad_segs=QUARTER_CHORDS).difference(cleared)
    swept = border.buffer(radius - CHORD_MM, quad_segs=QUARTER_CHORDS)
    is_thin = left.buffer(-_THIN_FRACTION * radius).is_empty
    return bool(is_thin and left.buffer(-CHORD_MM).difference(swept).is_empty)


def _add_hops_over_channels(
    linked: Sequence[LinkedPasses],
    regions: Sequence[OffsetRegion],
    channels: Sequence[Sequence[Channel]],
    job: Job,
) -> list[LinkedPasses]:
    """The linked passes with hops over the area that channels clear, if the tool can lift.

    A ramp goes down along the first stretch of a path. This stretch has to be level, so paths that
    are entered on a ramp have no hops.
    """
    process, operation = job.process, job.operation
    if not (process.spindle and operation.depth) or process.stay_down:
        return list(linked)
    channels_of: dict[int, list[Channel]] = {}
    for region, region_channels in zip(regions, channels, strict=True):
        channels_of.setdefault(region.pocket, []).extend(region_channels)
    cleared = {
        pocket: make_cleared_area(pocket_channels, job.tool.radius)
        for pocket, pocket_channels in channels_of.items()
        if pocket_channels
    }
    speeds = _get_speeds(job)
    result = []
    for passes in linked:
        lacks_helix = operation.entry == "helix" and passes.entry_radius <= 0
        if passes.pocket not in cleared or operation.entry == "ramp" or lacks_helix:
            result.append(passes)
            continue
        area, segments = cleared[passes.pocket], passes.channel_segments
        path = add_hops(passes.chain, segments, area, job.tool.radius, speeds)
        result.append(
            replace(
                passes,
                chain=path.chain,
                is_hop=path.is_hop,
                channel_segments=path.channel_segments,
            )
        )
    return result


def _get_speeds(job: Job) -> Speeds:
    return Speeds(job.process.feed, job.process.travel_speed)


def _sort_by_pocket(linked: Sequence[LinkedPasses]) -> list[LinkedPasses]:
    """The linked passes by pocket, with their successors renumbered."""
    order = sorted(range(len(linked)), key=lambda k: linked[k].pocket)
    new_index = {k: n for n, k in enumerate(order)}
    return [replace(linked[k], successor=new_index.get(linked[k].successor, -1)) for k in order]


# Walls, islands, and contours that are left out.


def _find_pockets(contours: Sequence[Contour]) -> tuple[_Pockets, list[Note]]:
    """The pockets that the contours enclose, and notes on contours that are left out."""
    closed = [contour for contour in contours if contour.closed]
    nesting = _find_overlaps(closed, nest(from_contours(closed), len(closed)))
    crossings = _find_crossings(closed)
    for k in crossings:
        nesting.crossed[k] = k
    unfit: list[tuple[list[Contour], str, str]] = []
    for is_unfit, problem, why in _find_unfit(nesting, crossings):
        unfit.append((_select_contours(closed, is_unfit), problem, why))
    loose = [contour for contour in contours if not contour.closed]
    if loose:
        why = "only what is closed has an inside; raise input.join to close gaps"
        unfit.append((loose, "open", why))
    notes = [_note_not_cleared(chosen, problem, why) for chosen, problem, why in unfit if chosen]
    is_valid = (nesting.crossed < 0) & ~nesting.empty
    outer = np.flatnonzero(is_valid & (nesting.depth % 2 == 0))
    unfit_contours: list[Contour] = []
    for chosen, _, _ in unfit:
        unfit_contours += chosen
    unclear = _find_unclear(closed, outer.tolist(), unfit_contours)
    if unclear:
        why = (
            "what they are there for is not clear: as islands they would be cut away; "
            "repair them or leave them out"
        )
        problem = "with contours in them that are open or cross others"
        notes.append(_note_not_cleared([closed[k] for k in unclear], problem, why))
    members: list[list[int]] = []
    for k in outer.tolist():
        if k not in unclear:
            is_island = is_valid & (nesting.parent == k) & (nesting.depth % 2 == 1)
            members.append([k, *np.flatnonzero(is_island).tolist()])
    return _make_pockets(closed, nesting, members), notes


def _make_pockets(
    closed: Sequence[Contour], nesting: Nesting, members: Sequence[Sequence[int]]
) -> _Pockets:
    """The pockets, with the material on the left of their walls.

    Outer walls run clockwise, islands counter-clockwise.

    closed: closed contours.
    nesting: depth and signed area of each of them.
    members: indices of the outer wall and of the islands of each pocket.
    """
    chosen: list[int] = []
    for pocket_members in members:
        chosen += pocket_members
    is_reversed = (nesting.area[chosen] > 0) == (nesting.depth[chosen] % 2 == 0)
    segments = turn_round(from_contours([closed[k] for k in chosen]), is_reversed)
    following = neighbours(segments, np.ones(len(chosen), dtype=bool))
    slips = find_slips(segments, following, len(chosen)) | _are_crossed(segments, len(chosen))
    segments, following = uncross(segments, following, slips)
    sizes = [len(pocket_members) for pocket_members in members]
    pocket = np.repeat(np.arange(len(members)), sizes)
    walls = PocketWalls(segments, following, pocket[segments.owner], len(members))
    outer = [closed[pocket_members[0]] for pocket_members in members]
    names = [wall.id for wall in outer]
    layers = [wall.layer for wall in outer]
    contours = []
    for pocket_members in members:
        contours.append(_list_ids([closed[k] for k in pocket_members]))
    return _Pockets(walls, names, layers, contours)


def _list_ids(contours: Sequence[Contour]) -> tuple[str, ...]:
    return tuple(contour.id for contour in contours)


def _find_overlaps(closed: Sequence[Contour], nesting: Nesting) -> Nesting:
    """The nesting, with contours marked as crossing that overlap others in a thin sliver.

    Between two such contours material would be cut away.
    """
    points, owner = flatten(from_contours(closed), CHORD_MM)
    has_area = np.bincount(owner, minlength=len(closed)) >= MIN_CORNERS
    tested = np.flatnonzero(has_area & (nesting.crossed < 0))
    rows = np.isin(owner, tested)
    indices = np.searchsorted(tested, owner[rows])
    polygons = shapely.polygons(shapely.linearrings(points[rows], indices=indices))
    edges = shapely.boundary(polygons)
    first, second = shapely.STRtree(edges).query(edges, predicate="intersects")
    first, second = first[first < second], second[first < second]
    touching = np.unique([first, second])
    polygons[touching] = shapely.make_valid(polygons[touching])
    common = shapely.area(shapely.intersection(polygons[first], polygons[second]))
    smaller = np.minimum(shapely.area(polygons[first]), shapely.area(polygons[second]))
    shorter = np.minimum(shapely.length(edges[first]), shapely.length(edges[second]))
    slack = 2 * CHORD_MM * shorter
    overlaps = (common > slack) & (smaller - common > slack)
    first, second = tested[first[overlaps]], tested[second[overlaps]]
    crossed = nesting.crossed.copy()
    crossed[first], crossed[second] = second, first
    return replace(nesting, crossed=crossed)


def _select_contours(closed: Sequence[Contour], is_chosen: Any) -> list[Contour]:
    """The contours for which `is_chosen` (C,) is true."""
    return [closed[k] for k in np.flatnonzero(is_chosen).tolist()]


def _are_crossed(loops: Segments, count: int) -> NDArray[np.bool_]:
    """(count,) whether each closed loop, an owner of `loops`, crosses itself."""
    points, owner = flatten(loops, CHORD_MM)
    crossed = np.zeros(count, dtype=np.bool_)
    polygons = np.flatnonzero(np.bincount(owner, minlength=count) >= MIN_CORNERS)
    rows = np.isin(owner, polygons)
    rings = shapely.linearrings(points[rows], indices=np.searchsorted(polygons, owner[rows]))
    crossed[polygons] = ~shapely.is_valid(shapely.polygons(rings))
    return crossed


def _find_crossings(closed: Sequence[Contour]) -> dict[int, tuple[float, float]]:
    """The contours that cross themselves in a loop wider than `_SLIP_MM`, with a point of it, mm.

    Inside such a loop it is not clear on which side the pocket lies.
    """
    places: dict[int, tuple[float, float]] = {}
    crossed = _are_crossed(from_contours(closed), len(closed))
    for k in np.flatnonzero(crossed).tolist():
        points, _ = flatten(from_contours([closed[k]]), CHORD_MM)
        parts = shapely.get_parts(shapely.make_valid(shapely.Polygon(points)))
        parts = parts[np.argsort(-shapely.area(parts), kind="stable")]
        loops = parts[1:][~shapely.is_empty(shapely.buffer(parts[1:], -_SLIP_MM / 2))]
        if len(loops):
            places[k] = loops[0].representative_point().coords[0]
    return places


def _find_unfit(
    nesting: Nesting, crossings: dict[int, tuple[float, float]]
) -> list[tuple[Any, str, str]]:
    """Contours that cannot be walls: a mask (C,), the problem, and the reason with a remedy."""
    crosses_itself = nesting.crossed == np.arange(len(nesting.crossed))
    crosses_other = (nesting.crossed >= 0) & ~crosses_itself
    why = "no clear inside; draw one outline"
    points = list(crossings.values())[:_NAMED_PLACES]
    places = ", ".join(f"near {short(x, 2)} {short(y, 2)} mm" for x, y in points)
    why_itself = f"{why}, see {places}" if places else why
    return [
        (crosses_itself & ~nesting.empty, "crossing themselves", why_itself),
        (crosses_other, "crossing each other", why),
        (nesting.empty & ~crosses_other, "without an inside", why),
    ]


def _find_unclear(
    closed: Sequence[Contour], outer: Sequence[int], unfit: Sequence[Contour]
) -> list[int]:
    """Indices of the outer walls that an unfit contour touches, or inside which it lies.

    closed: closed contours.
    outer: indices of those that are outer walls.
    unfit: contours that cannot be walls.
    """
    if not unfit or not outer:
        return []
    points, owner = flatten(from_contours([closed[k] for k in outer]), CHORD_MM)
    rings = [points[owner == k] for k in range(len(outer))]
    polygons = [shapely.make_valid(shapely.Polygon(ring)) for ring in rings]
    chords, chord_owner = flatten(from_contours(unfit), CHORD_MM)
    ends = np.array([contour.points[0 if contour.closed else -1] for contour in unfit])
    lines = []
    for k, end in enumerate(ends):
        lines.append(shapely.LineString(np.vstack([chords[chord_owner == k], end])))
    touched = shapely.STRtree(polygons).query(lines, predicate="intersects")[1]
    return [outer[k] for k in np.unique(touched).tolist()]


def _note_not_cleared(contours: Sequence[Contour], problem: str, why: str) -> Note:
    ids = _list_ids(contours)
    layers = {contour.layer for contour in contours}
    return Note("skipped", _format_not_cleared(ids, layers, problem), why, ids)


def _format_not_cleared(names: Sequence[str], layers: set[str], problem: str) -> str:
    count, ranges = counted(len(names), "contour"), ", ".join(name_ranges(list(names)))
    return f"{count} not cleared, {problem}: {ranges} on layer {', '.join(sorted(layers))}"


# Paths.


class _PathDraft(Struct, frozen=True, eq=False):
    """The data of one path.

    label: name, layer, successor and contours.
    chain: N segments of passes and links.
    entry_radius: maximum radius of the helix of the entry, mm.
    channel_segments: number of segments at the start that are a trochoidal channel.
    full_depth: whether the path runs only once, at the full depth.
    is_hop: (N,) whether a segment is part of a hop; empty without hops.
    """

    label: Label
    chain: Segments
    entry_radius: float = 0.0
    channel_segments: int = 0
    full_depth: bool = False
    is_hop: NDArray[np.bool_] = np.zeros(0, dtype=np.bool_)


def _make_paths(
    linked: Sequence[LinkedPasses],
    borders: Sequence[OffsetRegion],
    regions: Sequence[OffsetRegion],
    pockets: _Pockets,
    job: Job,
) -> tuple[ToolPath, ...]:
    """The paths by pocket: first the linked passes, then the finishing passes.

    borders: outermost regions of the finishing passes; empty without finishing passes.
    regions: offset regions of the linked passes.
    """
    can_finish = _can_finish_at_depth(borders, regions, job)
    drafts: list[_PathDraft] = []
    for pocket_index in range(len(pockets.names)):
        finishing: list[tuple[Segments, bool]] = []
        for border, full_depth in zip(borders, can_finish, strict=True):
            if border.pocket == pocket_index:
                finishing += [(chain, full_depth) for chain in border.passes]
        is_finished = bool(finishing)
        drafts += _draft_linked(pocket_index, linked, len(drafts), is_finished, pockets, job)
        drafts += _draft_finishing(pocket_index, finishing, len(drafts), pockets)
    if not drafts:
        return ()
    segments = concatenate([draft.chain for draft in drafts])
    sizes = [len(draft.chain) for draft in drafts]
    segments = replace(segments, owner=np.repeat(np.arange(len(drafts)), sizes))
    depths = pass_depths(job.operation.depth, job.operation.passes)
    feeds = _compute_feeds(segments, drafts, pockets.walls.segments, job)
    work = SegmentWork(sideways(segments, 0), np.zeros(len(segments)), feeds)
    paths = tool_paths(segments, [draft.label for draft in drafts], work, depths, "pocket")
    planned = []
    for path, draft in zip(paths, drafts, strict=True):
        path_depths = depths[-1:] if draft.full_depth else depths
        at_depths = replace(path, entry_radius=draft.entry_radius, depths=path_depths)
        planned.append(lift_hops(at_depths, np.append(False, draft.is_hop), _get_speeds(job)))
    return tuple(planned)


def _draft_linked(
    pocket_index: int,
    linked: Sequence[LinkedPasses],
    first: int,
    is_finished: bool,
    pockets: _Pockets,
    job: Job,
) -> list[_PathDraft]:
    """The drafts of the linked passes of a pocket.

    first: index of their first path.
    is_finished: whether finishing passes of the pocket follow.
    """
    rows = [k for k, passes in enumerate(linked) if passes.pocket == pocket_index]
    max_radius = _HELIX_FRACTION * job.tool.diameter
    layer, contours = pockets.layers[pocket_index], pockets.contours[pocket_index]
    drafts = []
    for number, k in enumerate(rows, 1):
        passes = linked[k]
        successor = first + len(rows) if is_finished else -1
        if passes.successor >= 0:
            successor = first + rows.index(passes.successor)
        name = pockets.names[pocket_index]
        if len(rows) > 1:
            name += f".{number}"
        label = Label(name, layer, False, False, successor, contours)
        drafts.append(
            _PathDraft(
                label,
                passes.chain,
                max(0.0, min(passes.entry_radius, max_radius)),
                passes.channel_segments,
                is_hop=passes.is_hop,
            )
        )
    return drafts


def _draft_finishing(
    pocket_index: int, finishing: Sequence[tuple[Segments, bool]], first: int, pockets: _Pockets
) -> list[_PathDraft]:
    """The drafts of the finishing passes of a pocket, each the successor of the one before.

    finishing: each pass, and whether it runs only at the full depth.
    first: index of their first path.
    """
    layer, contours = pockets.layers[pocket_index], pockets.contours[pocket_index]
    drafts = []
    for number, (chain, full_depth) in enumerate(finishing, 1):
        name = f"{pockets.names[pocket_index]}.finish"
        if len(finishing) > 1:
            name += f".{number}"
        successor = first + number if number < len(finishing) else -1
        label = Label(name, layer, True, False, successor, contours)
        drafts.append(_PathDraft(label, chain, full_depth=full_depth))
    return drafts


def _plan_slots(slots: _Slots, pockets: _Pockets, job: Job) -> list[ToolPath]:
    """A path along each channel as wide as the tool, and a plunge into each hole.

    There are no plunges without `tool.center_cutting`.
    """
    depths = pass_depths(job.operation.depth, job.operation.passes)
    labels: list[Label] = []
    for k, pocket_index in enumerate(slots.pocket):
        name = f"{pockets.names[pocket_index]}.slot"
        if slots.pocket.count(pocket_index) > 1:
            name += f".{slots.pocket[: k + 1].count(pocket_index)}"
        chain = slots.chains[k]
        is_closed = bool((chain.start[0] == chain.end[-1]).all())
        is_reversible = job.operation.direction == "any" and not is_closed
        layer, contours = pockets.layers[pocket_index], pockets.contours[pocket_index]
        labels.append(Label(name, layer, is_closed, is_reversible, -1, contours))
    paths: list[ToolPath] = []
    if labels:
        segments = concatenate(slots.chains)
        sizes = [len(chain) for chain in slots.chains]
        segments = replace(segments, owner=np.repeat(np.arange(len(sizes)), sizes))
        zeros = np.zeros(len(segments))
        work = SegmentWork(sideways(segments, 0), zeros, zeros + job.process.feed)
        paths += tool_paths(segments, labels, work, depths, "pocket")
    if job.tool.center_cutting:
        for (x, y), pocket_index in zip(slots.holes.tolist(), slots.hole_pocket, strict=True):
            name, layer = pockets.names[pocket_index], pockets.layers[pocket_index]
            contours = pockets.contours[pocket_index]
            paths.append(plunge_path(name, layer, (x, y), job, "pocket", contours))
    return paths


def _compute_feeds(
    segments: Segments, drafts: Sequence[_PathDraft], walls: Segments, job: Job
) -> FloatArray:
    """Feed (N,) of the tool centre on each segment, mm/s.

    On an inner curve along a wall the tool centre runs on a smaller circle than the cutting edge.
    So its feed is lowered until the edge has the feed of the job there. Other curves form no wall.
    With an engagement limit, the tool takes no more on them than on straight passes, so they have
    the full feed.
    """
    wall_side = 1 if job.operation.direction == "conventional" else -1
    is_channel = [np.arange(len(draft.chain)) < draft.channel_segments for draft in drafts]
    is_inner = segments.is_arc & (np.sign(segments.bulge) == -wall_side)
    is_inner &= ~np.concatenate(is_channel)
    if _make_limit(job) is not None:
        rows = np.flatnonzero(is_inner)
        middles = points_at(segments.take(rows), np.full(len(rows), 0.5))
        wall_distance = job.tool.radius + job.operation.finish + _AT_WALL_MM
        is_inner[rows] = np.isfinite(nearest_distances(middles, walls, wall_distance))
    fraction = 1 / (1 + job.tool.radius / segments.radius)
    return np.asarray(job.process.feed * np.maximum(np.where(is_inner, fraction, 1.0), SLOWEST))


def _can_finish_at_depth(
    borders: Sequence[OffsetRegion], regions: Sequence[OffsetRegion], job: Job
) -> list[bool]:
    """Whether the finishing pass of each border can run at the full depth at once.

    It cannot in places too narrow for the passes before it: there it would cut a slot.
    """
    max_width = max(job.operation.finish, job.operation.stepover * job.tool.diameter)
    result = []
    for border in borders:
        inside = [
            region.polygon
            for region in regions
            if region.parent < 0 and region.pocket == border.pocket
        ]
        rough = shapely.union_all(inside)
        reached = rough.buffer(max_width + CHORD_MM, quad_segs=QUARTER_CHORDS)
        result.append(bool(border.polygon.difference(reached).is_empty))
    return result


# Notes.


def _note_failed(
    failed: frozenset[int],
    borders: Sequence[OffsetRegion],
    slots: _Slots,
    pockets: _Pockets,
    job: Job,
) -> list[Note]:
    """Notes on pockets without a path."""
    round_pockets = [] if job.tool.center_cutting else list(slots.hole_pocket)
    has_path = {border.pocket for border in borders} | set(slots.pocket)
    has_path |= set(slots.hole_pocket) - set(round_pockets)
    explained = {*has_path, *failed, *round_pockets}
    narrow = [k for k in range(len(pockets.names)) if k not in explained]
    why_narrow = "nothing is narrow"
    if narrow:
        regions = [make_pocket_polygon(pockets.walls, k) for k in narrow]
        why_narrow = does_not_fit(regions, job.tool.diameter)
    why_failed = (
        "the border of the tool's way does not close there, as where edges lie on one line: "
        "draw one outline, or take another tool"
    )
    notes = []
    for chosen, problem, why in (
        (narrow, "too narrow", why_narrow),
        (round_pockets, "round and as wide as the tool", NO_HELIX),
        (sorted(failed), "check failed", why_failed),
    ):
        if chosen:
            layers = {pockets.layers[k] for k in chosen}
            what = _format_not_cleared([pockets.names[k] for k in chosen], layers, problem)
            ids: list[str] = []
            for k in chosen:
                ids += pockets.contours[k]
            notes.append(Note("skipped", what, why, tuple(ids)))
    return notes


def _note_slots(slots: _Slots, pockets: _Pockets) -> list[Note]:
    """A note on channels as wide as the tool, in which engagement is not limited."""
    if not slots.chains:
        return []
    names = ", ".join(name_ranges([pockets.names[k] for k in dict.fromkeys(slots.pocket)]))
    length = short(sum(float(chain.length.sum()) for chain in slots.chains), 1)
    what = f"{counted(len(slots.chains), 'channel')} as wide as the tool, {length} mm: {names}"
    return [Note("assumed", what, "along the middle, with all of its width in the material")]


def _note_passes(
    linked: Sequence[LinkedPasses],
    regions: Sequence[OffsetRegion],
    channels: Sequence[Sequence[Channel]],
    pockets: _Pockets,
    job: Job,
) -> list[Note]:
    """A note on the number of passes, the stepover and the engagement."""
    if not linked:
        return []
    stepover, radius = job.operation.stepover * job.tool.diameter, job.tool.radius
    climb = job.operation.direction != "conventional"
    engagement, length = measure_engagement(regions, channels, radius, stepover, climb)
    all_channels: list[Channel] = []
    for region_channels in channels:
        all_channels += region_channels
    subject = pockets.names[0]
    if len(pockets.names) > 1:
        noun = "area" if job.operation.rest else "pocket"
        subject = counted(len({passes.pocket for passes in linked}), noun)
    pass_count = counted(sum(passes.pass_count for passes in linked), "pass", "passes")
    path_count = counted(len(linked), "path")
    what = f"{subject}: {pass_count} in {path_count}, {short(stepover, 3)} mm apart"
    if all_channels:
        loop_count = counted(sum(len(channel.discs) for channel in all_channels), "loop")
        metres = sum(float(channel.chain.length.sum()) for channel in all_channels) / 1000
        what += f", {loop_count} of {short(metres, 2)} m before them"
        what += " (none with operation.engagement = 1)"
    if len(engagement):
        what += f", {_format_engagement(engagement, length)}"
    entered = _count_slot_entries(regions, channels)
    why = "not counted: the first turns where the tool goes in"
    if entered:
        places = counted(entered, "place")
        why = f"not counted: the first pass in the middle of {places}, which is a slot"
    steep_links = sum(passes.steep_links for passes in linked)
    if all_channels and steep_links:
        why += f", and {counted(steep_links, 'link')} for which there was no room to lean"
    return [Note("assumed", what, why)]


def _format_engagement(engagement: FloatArray, length: FloatArray) -> str:
    """Median, maximum and fraction of high values of engagements (M,), weighted by length (M,)."""
    order = np.argsort(engagement)
    middle = np.searchsorted(np.cumsum(length[order]), length.sum() / 2)
    median = _percent(engagement[order[middle]])
    high_percent = 100 * length[engagement > _HIGH_ENGAGEMENT].sum() / length.sum()
    return (
        f"engagement {median} % of the diameter or less on half of the way, "
        f"{_percent(engagement.max())} % at most, "
        f"over {100 * _HIGH_ENGAGEMENT:.0f} % on {short(high_percent, 1)} % of it"
    )


def _count_slot_entries(
    regions: Sequence[OffsetRegion], channels: Sequence[Sequence[Channel]]
) -> int:
    """Number of innermost regions without a channel: their first pass is a slot."""
    parents = {region.parent for region in regions}
    roots = find_outermost(regions)
    count = 0
    for k, region in enumerate(regions):
        count += k not in parents and region.is_whole and not channels[roots[k]]
    return count


def _percent(fraction: float) -> str:
    """A fraction in whole percent, rounded up."""
    return f"{max(np.ceil(100 * fraction - 1e-6), 0.0):.0f}"


def _note_rest_material(
    borders: Sequence[OffsetRegion], slots: _Slots, pockets: _Pockets, job: Job
) -> list[Note]:
    """A note on rest material in the pockets that have paths: in corners and narrow places."""
    radius = job.tool.radius
    rest_area, whole_area = 0.0, 0.0
    places: list[tuple[float, float, float]] = []
    ids: list[str] = []
    for pocket_index in sorted({border.pocket for border in borders} | set(slots.pocket)):
        polygon = make_pocket_polygon(pockets.walls, pocket_index).difference(pockets.cleared)
        slot_rows = [k for k, pocket in enumerate(slots.pocket) if pocket == pocket_index]
        centres = [_make_line(slots.chains[k]) for k in slot_rows]
        centres += [border.polygon for border in borders if border.pocket == pocket_index]
        swept = shapely.union_all(centres).buffer(radius, quad_segs=QUARTER_CHORDS)
        whole_area += polygon.area
        # Strips as thin as the deviation of chords do not count.
        parts = shapely.get_parts(polygon.difference(swept))
        parts = [part for part in parts if not part.buffer(-2 * CHORD_MM).is_empty]
        rest_area += sum(part.area for part in parts)
        large = [part for part in parts if part.area >= _PLACE_FRACTION * np.pi * radius**2]
        places += [(part.area, *part.representative_point().coords[0]) for part in large]
        ids += pockets.contours[pocket_index] if large else []
    if rest_area <= max(1e-4 * whole_area, 0.05 * radius**2):
        return []
    places.sort(reverse=True)
    what = f"{short(rest_area, 2)} mm2 of {short(whole_area, 2)} mm2 not cleared"
    if places:
        what += f", {counted(len(places), 'place')} of {short(places[0][0], 2)} mm2 or less"
    why = f"inner corners and narrow places that a {job.tool.diameter:g} mm tool does not reach"
    points = tuple((x, y) for _, x, y in places[:_MAX_PLACES])
    return [Note("warning", what, why, tuple(ids), points)]


def _make_line(chain: Segments) -> Any:
    """A chain as a shapely line of chords."""
    points, _ = flatten(chain, CHORD_MM)
    return shapely.LineString(np.vstack([points, chain.end[-1:]]))
