"""Notes on pockets: engagement of the passes, and material that is not cleared."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from itertools import chain
from typing import Any

import numpy as np
import shapely

from camgen.geometry.segments import (
    Segments,
    flatten,
)
from camgen.model.job import Job
from camgen.model.part import Note
from camgen.model.pose import FloatArray
from camgen.model.sequences import take_rows
from camgen.model.text import counted, name_ranges, short
from camgen.plan.beside import NO_HELIX, explain_misfit
from camgen.plan.pocket.channel import Channel
from camgen.plan.pocket.contours import Pockets, format_not_cleared
from camgen.plan.pocket.engagement import measure_engagement
from camgen.plan.pocket.linking import LinkedPasses, find_outermost
from camgen.plan.pocket.regions import (
    CHORD_MM,
    QUARTER_CHORDS,
    OffsetRegion,
    group_by_pocket,
    make_pocket_polygon,
)
from camgen.plan.pocket.slots import Slots

#: Minimum area of rest material that is reported as a place, as a fraction of the tool's area.
_PLACE_FRACTION = 0.02
#: Engagement above which a pass is reported as similar to a slot.
_HIGH_ENGAGEMENT = 0.9
#: Maximum number of places in a note.
_MAX_PLACES = 100


def note_failed(
    failed: frozenset[int],
    borders: Sequence[OffsetRegion],
    slots: Slots,
    pockets: Pockets,
    job: Job,
) -> Iterator[Note]:
    """Notes on pockets without a path."""
    round_pockets = [] if job.tool.center_cutting else list(slots.hole_pocket)
    explained = {*group_by_pocket(borders), *slots.pocket, *slots.hole_pocket, *failed}
    narrow = sorted(set(range(len(pockets.names))) - explained)
    why_narrow = "nothing is narrow"
    if narrow:
        regions = [make_pocket_polygon(pockets.walls, k) for k in narrow]
        why_narrow = explain_misfit(regions, job.tool.diameter)
    why_failed = (
        "the border of the tool's way does not close there, as where edges lie on one line: "
        "draw one outline, or take another tool"
    )
    for chosen, problem, why in (
        (narrow, "too narrow", why_narrow),
        (round_pockets, "round and as wide as the tool", NO_HELIX),
        (sorted(failed), "check failed", why_failed),
    ):
        if chosen:
            layers = set(take_rows(pockets.layers, chosen))
            what = format_not_cleared(take_rows(pockets.names, chosen), layers, problem)
            yield Note("skipped", what, why, pockets.list_contours(chosen))


def note_slots(slots: Slots, pockets: Pockets) -> Iterator[Note]:
    """A note on channels as wide as the tool, in which engagement is not limited."""
    if slots.chains:
        names = ", ".join(name_ranges(take_rows(pockets.names, dict.fromkeys(slots.pocket))))
        length = short(sum(float(chain.length.sum()) for chain in slots.chains), 1)
        yield Note(
            "assumed",
            f"{counted(len(slots.chains), 'channel')} as wide as the tool, {length} mm: {names}",
            "along the middle, with all of its width in the material",
        )


def note_passes(
    linked: Sequence[LinkedPasses],
    regions: Sequence[OffsetRegion],
    channels: Sequence[Sequence[Channel]],
    pockets: Pockets,
    job: Job,
) -> list[Note]:
    """A note on the number of passes, the stepover and the engagement."""
    if not linked:
        return []
    stepover, radius = job.operation.stepover * job.tool.diameter, job.tool.radius
    climb = job.operation.direction != "conventional"
    engagement, length = measure_engagement(regions, channels, radius, stepover, climb)
    all_channels = list(chain.from_iterable(channels))
    subject = pockets.names[0]
    if len(pockets.names) > 1:
        noun = "area" if job.operation.rest else "pocket"
        subject = counted(len(group_by_pocket(linked)), noun)
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
    parents = {region.parent for region in regions}
    roots = find_outermost(regions)
    return sum(
        k not in parents and region.is_whole and not channels[roots[k]]
        for k, region in enumerate(regions)
    )


def _percent(fraction: float) -> str:
    return f"{max(np.ceil(100 * fraction - 1e-6), 0.0):.0f}"


def note_rest_material(
    borders: Sequence[OffsetRegion], slots: Slots, pockets: Pockets, job: Job
) -> Iterator[Note]:
    """A note on rest material in the pockets that have paths: in corners and narrow places."""
    radius = job.tool.radius
    rest_area, whole_area = 0.0, 0.0
    places: list[tuple[float, float, float]] = []
    ids: list[str] = []
    centres: dict[int, list[Any]] = defaultdict(list)
    for pocket_index, slot in zip(slots.pocket, slots.chains, strict=True):
        centres[pocket_index].append(_make_line(slot))
    for border in borders:
        centres[border.pocket].append(border.polygon)
    for pocket_index in sorted(centres):
        polygon = make_pocket_polygon(pockets.walls, pocket_index).difference(pockets.cleared)
        swept = shapely.union_all(centres[pocket_index]).buffer(radius, quad_segs=QUARTER_CHORDS)
        whole_area += polygon.area
        # Strips as thin as the deviation of chords do not count.
        parts = shapely.get_parts(polygon.difference(swept))
        parts = parts[~shapely.is_empty(shapely.buffer(parts, -2 * CHORD_MM, quad_segs=16))]
        areas = shapely.area(parts)
        rest_area += sum(areas.tolist())
        large = parts[areas >= _PLACE_FRACTION * np.pi * radius**2]
        places += [(part.area, *part.representative_point().coords[0]) for part in large]
        if len(large):
            ids += pockets.contours[pocket_index]
    if rest_area > max(1e-4 * whole_area, 0.05 * radius**2):
        places.sort(reverse=True)
        what = f"{short(rest_area, 2)} mm2 of {short(whole_area, 2)} mm2 not cleared"
        if places:
            what += f", {counted(len(places), 'place')} of {short(places[0][0], 2)} mm2 or less"
        why = f"inner corners and narrow places that a {job.tool.diameter:g} mm tool does not reach"
        largest = tuple((x, y) for _, x, y in places[:_MAX_PLACES])
        yield Note("warning", what, why, tuple(ids), largest)


def _make_line(chain: Segments) -> Any:
    points, _ = flatten(chain, CHORD_MM)
    return shapely.LineString(np.vstack([points, chain.end[-1:]]))
