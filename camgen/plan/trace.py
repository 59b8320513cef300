"""Tool paths on the drawn lines."""

from __future__ import annotations

import numpy as np
from msgspec.structs import replace

from camgen.geometry.nesting import nest
from camgen.geometry.segments import from_contours
from camgen.model.job import Job
from camgen.model.part import Note, Part
from camgen.model.path import ToolPath
from camgen.plan.columns import Label, SegmentWork, pass_depths, sideways, tool_paths
from camgen.plan.merge import merge


def trace(part: Part, job: Job) -> tuple[ToolPath, ...]:
    """The tool centre on every contour, open or closed. A force presses along the tool axis, down on the part."""
    # What is inside of what hangs on all of them; a path has only what is worked on.
    mine = [k for k, c in enumerate(part.contours) if part.works_on(c.sources or (c.id,))]
    contours = [part.contours[k] for k in mine]
    segments = from_contours(contours)
    parent = _parents_of(part, mine)
    labels = [
        Label(c.id, c.layer, c.closed, True, around, c.sources or (c.id,))
        for c, around in zip(contours, parent, strict=True)
    ]
    press = sideways(segments, 0)
    if job.process.force:
        press[:, :, 2] = -1.0
    force = np.full(len(segments), job.process.force)
    feed = np.full(len(segments), job.process.feed)
    depths = pass_depths(job.operation.depth, job.operation.passes)
    return tool_paths(segments, labels, SegmentWork(press, force, feed), depths, "trace")


def with_few_lifts(part: Part, job: Job) -> tuple[Part, tuple[Note, ...]]:
    """The part with its networks of lines as few trails, unless the order or the direction of its contours counts.

    A tool that turns with the contour is not led round a sharp corner; ``tour.method = "as-drawn"`` keeps what was
    drawn; where what is inside is done first, a loop with another one around it or in it is cut out by itself.
    """
    if job.tool.orient == "follow" or job.tour.method == "as-drawn":
        return part, ()
    others = [not part.works_on(c.sources or (c.id,)) for c in part.contours]
    contours, notes = merge(part.contours, others, job.input.join)
    if notes and job.operation.inside_first:
        parents = _parents(part)
        around = set(parents)
        fixed = [others[k] or parent >= 0 or k in around for k, parent in enumerate(parents)]
        contours, notes = merge(part.contours, fixed, job.input.join)
    return (replace(part, contours=contours) if notes else part), notes


def _parents_of(part: Part, mine: list[int]) -> list[int]:
    """For each of the contours ``mine`` the place among them of the nearest one around it, -1 if none."""
    every, place = _parents(part), {k: n for n, k in enumerate(mine)}
    found = []
    for k in mine:
        around = every[k]
        while around >= 0 and around not in place:
            around = every[around]
        found.append(place.get(around, -1))
    return found


def _parents(part: Part) -> list[int]:
    """For each contour the closed contour around it, -1 if none: what is inside is done first."""
    closed = [k for k, c in enumerate(part.contours) if c.closed]
    parent = [-1] * len(part.contours)
    if closed:
        nesting = nest(from_contours([part.contours[k] for k in closed]), len(closed))
        for k, enclosing in zip(closed, nesting.parent.tolist(), strict=True):
            parent[k] = closed[enclosing] if enclosing >= 0 else -1
    return parent
