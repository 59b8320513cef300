"""Plans the paths that clear pockets, from the middle outwards.

Outermost contours are walls, contours inside them islands, contours inside islands walls again. The
passes are exact offset curves of the walls: arcs stay arcs, and the last pass runs along the walls.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import shapely
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from camgen.geometry.intersect import measure_nearest
from camgen.geometry.ragged import number_kept
from camgen.geometry.segments import Segments, concatenate_chains, points_at
from camgen.model.errors import InputError
from camgen.model.job import Job
from camgen.model.part import Note, Part, list_ids, select_closed
from camgen.model.path import ToolPath
from camgen.model.pose import FloatArray
from camgen.model.sequences import take_rows
from camgen.model.text import counted, name_ranges
from camgen.plan.columns import (
    SLOWEST,
    Label,
    SegmentWork,
    compute_depths,
    compute_sideways,
    make_tool_paths,
)
from camgen.plan.open_outlines import check_outlines
from camgen.plan.pocket.channel import Channel, plan_channels, tabulate_discs, unite_channels
from camgen.plan.pocket.contours import Pockets, find_pockets
from camgen.plan.pocket.engagement_limit import EngagementLimit
from camgen.plan.pocket.hops import Speeds, add_hops, lift_hops, make_cleared_area
from camgen.plan.pocket.linking import LinkedPasses, find_outermost, group_channels, link_passes
from camgen.plan.pocket.medial_axis import compute_medial_axis
from camgen.plan.pocket.notes import note_failed, note_passes, note_rest_material, note_slots
from camgen.plan.pocket.regions import (
    CHORD_MM,
    QUARTER_CHORDS,
    OffsetRegion,
    compute_regions,
    compute_wall_passes,
    group_by_pocket,
    make_pocket_polygon,
    select_outermost,
    select_pockets,
    unite_regions,
)
from camgen.plan.pocket.slots import find_slots, plan_slots
from camgen.plan.unused import check_rules

#: Maximum stepover, as a fraction of the tool diameter. With a larger one, passes leave ridges on a
#: real machine.
_MAX_STEPOVER = 0.95
#: Maximum radius of an entry helix, as a fraction of the tool diameter: a wider one leaves a core.
_HELIX_FRACTION = 0.45
#: Engagement above that of a straight pass that is allowed by default, as a fraction of the
#: diameter.
_DEFAULT_MARGIN = 0.15
#: Minimum of this margin: a smaller one leaves no room for a link from pass to pass.
_MIN_MARGIN = 0.05
#: From this engagement on there is no limit.
_MAX_ENGAGEMENT = 0.995
#: Half the maximum width of material that a pass takes in addition to its own, as a fraction of the
#: tool radius.
_THIN_FRACTION = 0.05
#: Spacing of samples of the walls for the medial axis, as a fraction of the tool radius.
_SPACING_FRACTION = 0.2
#: mm: a pass is along a wall if it is no farther from the wall than the outermost pass by this.
_AT_WALL_MM = 0.05


def pocket(part: Part, job: Job) -> tuple[tuple[ToolPath, ...], tuple[Note, ...]]:
    """Plan paths that clear the pockets of a part.

    Returns the paths, and notes on contours and material that are not cleared.

    Raises InputError if the part has no closed contour, JobError if settings contradict each other.
    """
    _check_settings(job)
    contours = take_rows(part.contours, part.list_worked_rows())
    # In one of several operations a note leaves the contours out, and the others are built.
    if part.worked is None and not select_closed(contours):
        raise InputError(
            part.source,
            "no closed contour to clear",
            remedy="close its outlines, or raise input.join",
        )
    chosen = replace(part, contours=tuple(contours))
    check_outlines(chosen, list_ids(contours), "leave it out of what is cleared")
    pockets, notes = find_pockets(contours)
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
    linked = list(_add_hops_over_channels(_sort_by_pocket(linked), regions, channels, job))
    borders = select_outermost(_leave_out(walls.regions, failed))
    slots = find_slots(walls, pockets.walls, job)
    paths = (
        *_make_paths(linked, borders if finish else [], regions, pockets, job),
        *plan_slots(slots, pockets, job),
    )
    return paths, (
        *notes,
        *note_failed(failed, borders, slots, pockets, job),
        *note_passes(linked, regions, channels, pockets, job),
        *note_slots(slots, pockets),
        *note_rest_material(borders, slots, pockets, job),
    )


def _keep_rest(pockets: Pockets, part: Part, job: Job) -> tuple[Pockets, list[Note]]:
    """The areas of the pockets that earlier operations leave, and a note on pockets without any.

    Raises JobError if no operation with a larger tool comes before.
    """
    from camgen.plan.pocket.rest import find_rest_of_pockets  # noqa: PLC0415 (only where asked for)

    walls, pocket_of, cleared_area = find_rest_of_pockets(pockets.walls, part, job)
    names: list[str] = []
    for n, k in enumerate(pocket_of):
        names.append(f"{pockets.names[k]}.rest{pocket_of[: n + 1].count(k)}")
    layers = take_rows(pockets.layers, pocket_of)
    contours = take_rows(pockets.contours, pocket_of)
    cleared = sorted(set(range(len(pockets.names))) - set(pocket_of))
    notes: list[Note] = []
    if cleared:
        cleared_names = ", ".join(name_ranges(take_rows(pockets.names, cleared)))
        what = f"nothing is left of {counted(len(cleared), 'pocket')}: {cleared_names}"
        why = "earlier operations reach all that this tool does"
        notes.append(Note("assumed", what, why, pockets.list_contours(cleared), lacks="paths"))
    return Pockets(walls, names, layers, contours, cleared_area), notes


def _check_settings(job: Job) -> None:
    operation, tool = job.operation, job.tool
    engagement = math.inf if operation.engagement is None else operation.engagement
    min_engagement = operation.stepover + _MIN_MARGIN
    passes = f"passes {operation.stepover:g} of the diameter apart"
    check_rules(
        [
            (tool.kind == "drill", "a drill does not cut sideways", "tool.kind", "choose a mill"),
            (
                job.process.force != 0,
                "a pocket goes to a depth, not to a force",
                "process.force",
                "set process.force to 0",
            ),
            (
                operation.stepover > _MAX_STEPOVER,
                f"{passes} leave ridges between them",
                "operation.stepover",
                f"{_MAX_STEPOVER:g} at most",
            ),
            (
                engagement < min_engagement,
                f"{passes} engage more of it than {engagement:g}",
                "operation.engagement",
                f"{min_engagement:g} at least, or a smaller operation.stepover",
            ),
            (
                operation.finish > tool.radius,
                f"{operation.finish:g} mm is more than the radius of the tool, "
                "a last pass would leave some of it",
                "operation.finish",
                "leave less at the walls",
            ),
            (
                not operation.inside_first,
                "pockets are cut from the middle outwards",
                "operation.inside_first",
                "leave it out",
            ),
        ]
    )


def _leave_out(regions: Sequence[OffsetRegion], pockets: frozenset[int]) -> list[OffsetRegion]:
    kept = [k for k, region in enumerate(regions) if region.pocket not in pockets]
    return _select_regions(regions, kept)


def _select_regions(regions: Sequence[OffsetRegion], rows: Sequence[int]) -> list[OffsetRegion]:
    new_index = number_kept(rows)
    return [replace(regions[k], parent=new_index.get(regions[k].parent, -1)) for k in rows]


def _make_limit(job: Job) -> EngagementLimit | None:
    operation, radius = job.operation, job.tool.radius
    engagement = operation.engagement
    if engagement is None:
        engagement = min(1.0, operation.stepover + _DEFAULT_MARGIN)
    if engagement >= _MAX_ENGAGEMENT:
        return None
    stepover = operation.stepover * job.tool.diameter
    return EngagementLimit(radius, stepover, engagement, operation.direction != "conventional")


def _plan_channels(
    regions: list[OffsetRegion], pockets: Pockets, limit: EngagementLimit | None, job: Job
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
    for k in sorted(group_by_pocket(regions)):
        walls = select_pockets(pockets.walls, frozenset([k]))
        polygon = make_pocket_polygon(pockets.walls, k)
        axis = compute_medial_axis(
            walls.segments, walls.following, polygon, min_distance, spacing, limit.max_turn
        )
        channels += plan_channels(axis, min_distance, limit, helix_radius)
    if not channels:
        return regions, [()] * len(regions)
    roots = sorted(set(find_outermost(regions)))
    starts = shapely.points(tabulate_discs([channel.discs[0] for channel in channels])[:, :2])
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
    cleared = {k: unite_channels(group, radius) for k, group in enumerate(channels) if group}
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
) -> Iterator[LinkedPasses]:
    """The linked passes with hops over the area that channels clear, if the tool can lift.

    A ramp goes down along the first stretch of a path. This stretch has to be level, so paths that
    are entered on a ramp have no hops.
    """
    process, operation = job.process, job.operation
    lifts = process.spindle and operation.depth and not process.stay_down
    if not lifts or operation.entry == "ramp":
        yield from linked
        return
    cleared = {}
    for pocket_index, pocket_channels in group_channels(regions, channels).items():
        cleared[pocket_index] = make_cleared_area(pocket_channels, job.tool.radius)
    speeds = Speeds(process.feed, process.travel_speed)
    for passes in linked:
        lacks_helix = operation.entry == "helix" and passes.entry_radius <= 0
        if passes.pocket not in cleared or lacks_helix:
            yield passes
        else:
            yield add_hops(passes, cleared[passes.pocket], job.tool.radius, speeds)


def _sort_by_pocket(linked: Sequence[LinkedPasses]) -> list[LinkedPasses]:
    order = sorted(range(len(linked)), key=lambda k: linked[k].pocket)
    new_index = number_kept(order)
    return [replace(linked[k], successor=new_index.get(linked[k].successor, -1)) for k in order]


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
    pockets: Pockets,
    job: Job,
) -> Iterator[ToolPath]:
    """The paths by pocket: first the linked passes, then the finishing passes.

    borders: outermost regions of the finishing passes; empty without finishing passes.
    regions: offset regions of the linked passes.
    """
    outermost = group_by_pocket(select_outermost(regions))
    drafts: list[_PathDraft] = []
    for pocket_index in range(len(pockets.names)):
        finishing: list[tuple[Segments, bool]] = []
        for border in borders:
            if border.pocket == pocket_index:
                full_depth = _can_finish_at_depth(border, outermost[pocket_index], job)
                finishing += [(chain, full_depth) for chain in border.passes]
        drafts += _draft_linked(pocket_index, linked, len(drafts), bool(finishing), pockets, job)
        drafts += _draft_finishing(pocket_index, finishing, len(drafts), pockets)
    if not drafts:
        return
    segments = concatenate_chains([draft.chain for draft in drafts])
    depths = compute_depths(job.operation.depth, job.operation.passes)
    work = SegmentWork(
        compute_sideways(segments, 0),
        np.zeros(len(segments)),
        _compute_feeds(segments, drafts, pockets.walls.segments, job),
    )
    paths = make_tool_paths(segments, [draft.label for draft in drafts], work, depths, "pocket")
    speeds = Speeds(job.process.feed, job.process.travel_speed)
    for path, draft in zip(paths, drafts, strict=True):
        path_depths = depths[-1:] if draft.full_depth else depths
        at_depths = replace(path, entry_radius=draft.entry_radius, depths=path_depths)
        yield lift_hops(at_depths, np.append(False, draft.is_hop), speeds)


def _draft_linked(
    pocket_index: int,
    linked: Sequence[LinkedPasses],
    first: int,
    is_finished: bool,
    pockets: Pockets,
    job: Job,
) -> Iterator[_PathDraft]:
    """The drafts of the linked passes of a pocket.

    first: index of their first path.
    is_finished: whether finishing passes of the pocket follow.
    """
    rows = [k for k, passes in enumerate(linked) if passes.pocket == pocket_index]
    max_radius = _HELIX_FRACTION * job.tool.diameter
    layer, contours = pockets.layers[pocket_index], pockets.contours[pocket_index]
    for number, k in enumerate(rows, 1):
        passes = linked[k]
        successor = first + len(rows) if is_finished else -1
        if passes.successor >= 0:
            successor = first + rows.index(passes.successor)
        name = pockets.names[pocket_index]
        if len(rows) > 1:
            name += f".{number}"
        label = Label(name, layer, False, False, successor, contours)
        yield _PathDraft(
            label,
            passes.chain,
            max(0.0, min(passes.entry_radius, max_radius)),
            passes.channel_segments,
            is_hop=passes.is_hop,
        )


def _draft_finishing(
    pocket_index: int, finishing: Sequence[tuple[Segments, bool]], first: int, pockets: Pockets
) -> Iterator[_PathDraft]:
    """The drafts of the finishing passes of a pocket, each the successor of the one before.

    finishing: each pass, and whether it runs only at the full depth.
    first: index of their first path.
    """
    layer, contours = pockets.layers[pocket_index], pockets.contours[pocket_index]
    for number, (chain, full_depth) in enumerate(finishing, 1):
        name = f"{pockets.names[pocket_index]}.finish"
        if len(finishing) > 1:
            name += f".{number}"
        successor = first + number if number < len(finishing) else -1
        label = Label(name, layer, True, False, successor, contours)
        yield _PathDraft(label, chain, full_depth=full_depth)


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
        is_inner[rows] = np.isfinite(measure_nearest(middles, walls, wall_distance))
    fraction = 1 / (1 + job.tool.radius / segments.radius)
    return np.asarray(job.process.feed * np.maximum(np.where(is_inner, fraction, 1.0), SLOWEST))


def _can_finish_at_depth(border: OffsetRegion, outermost: Sequence[OffsetRegion], job: Job) -> bool:
    """Whether the finishing pass of a border can run at the full depth at once.

    It cannot in places too narrow for the passes before it: there it would cut a slot.

    outermost: the outermost regions of the passes before it.
    """
    max_width = max(job.operation.finish, job.operation.stepover * job.tool.diameter)
    reached = unite_regions(outermost).buffer(max_width + CHORD_MM, quad_segs=QUARTER_CHORDS)
    return bool(border.polygon.difference(reached).is_empty)
