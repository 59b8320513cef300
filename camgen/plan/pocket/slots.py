"""Channels as wide as the tool: one path along the middle of each."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from msgspec import Struct

from camgen.geometry.segments import (
    Segments,
    concatenate,
    concatenate_chains,
    make_contour_segments,
)
from camgen.model.job import Job
from camgen.model.path import ToolPath
from camgen.model.pose import FloatArray
from camgen.model.sequences import take_rows
from camgen.plan.beside import find_channel_lines
from camgen.plan.columns import (
    Label,
    SegmentWork,
    compute_depths,
    compute_sideways,
    make_tool_paths,
    plunge_path,
)
from camgen.plan.pocket.contours import Pockets
from camgen.plan.pocket.regions import PocketWalls, RegionForest, select_outermost, split_by_owner


class Slots(Struct, frozen=True, eq=False):
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


def find_slots(wall_passes: RegionForest, walls: PocketWalls, job: Job) -> Slots:
    """Find the channels and holes that the passes along the walls do not enter."""
    passes = [make_contour_segments([])]
    for region in select_outermost(wall_passes.regions):
        passes += region.passes
    lines = find_channel_lines(
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
    chains = take_rows(split_by_owner(lines.segments, len(lines.closed)), order)
    return Slots(
        pocket[order].tolist(), chains, lines.holes, walls.pocket[lines.hole_source].tolist()
    )


def plan_slots(slots: Slots, pockets: Pockets, job: Job) -> Iterator[ToolPath]:
    """A path along each channel as wide as the tool, and a plunge into each hole.

    There are no plunges without `tool.center_cutting`.
    """
    depths = compute_depths(job.operation.depth, job.operation.passes)
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
    if labels:
        segments = concatenate_chains(slots.chains)
        zeros = np.zeros(len(segments))
        work = SegmentWork(compute_sideways(segments, 0), zeros, zeros + job.process.feed)
        yield from make_tool_paths(segments, labels, work, depths, "pocket")
    if job.tool.center_cutting:
        for (x, y), pocket_index in zip(slots.holes.tolist(), slots.hole_pocket, strict=True):
            name, layer = pockets.names[pocket_index], pockets.layers[pocket_index]
            contours = pockets.contours[pocket_index]
            yield plunge_path(name, layer, (x, y), job, "pocket", contours)
