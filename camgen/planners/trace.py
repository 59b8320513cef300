"""Tool paths on the drawn lines."""

from __future__ import annotations

import numpy as np

from camgen.geometry.nesting import nest
from camgen.geometry.segments import from_contours
from camgen.paths import ToolPath
from camgen.planners.columns import Label, pass_depths, sideways, tool_paths
from camgen.settings import Job
from camgen.shapes import Part


def trace(part: Part, job: Job) -> tuple[ToolPath, ...]:
    """The tool centre on every contour, open or closed. A force presses along the tool axis, down on the part."""
    contours = part.contours
    segments = from_contours(contours)
    parent = _parents(part)
    labels = [Label(c.id, c.layer, c.closed, True, parent[k]) for k, c in enumerate(contours)]
    press = sideways(segments, 0)
    if job.process.force:
        press[:, :, 2] = -1.0
    force = np.full(len(segments), job.process.force)
    feed = np.full(len(segments), job.process.feed)
    depths = pass_depths(job.operation.depth, job.operation.passes)
    return tool_paths(segments, labels, press, force, feed, depths)


def _parents(part: Part) -> list[int]:
    """For each contour the closed contour around it, -1 if none: what is inside is done first."""
    closed = [k for k, c in enumerate(part.contours) if c.closed]
    parent = [-1] * len(part.contours)
    if closed:
        nesting = nest(from_contours([part.contours[k] for k in closed]), len(closed))
        for k, enclosing in zip(closed, nesting.parent.tolist(), strict=True):
            parent[k] = closed[enclosing] if enclosing >= 0 else -1
    return parent
