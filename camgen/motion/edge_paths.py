"""Motions along edges and curves as tool paths, and notes on lines without a motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from camgen.model.errors import NoSafeProgram
from camgen.model.job import Job
from camgen.model.part import Edge, Line, Note, Part
from camgen.model.path import ToolPath, waypoints
from camgen.model.pose import frozen
from camgen.model.text import counted, short
from camgen.motion.setup import EdgeMotion, UnreachableEdge, feed_of


def edge_path(motion: EdgeMotion, edge: Line, job: Job) -> ToolPath:
    """The motion along ``edge`` as a tool path."""
    layer, operation = (edge.kind, "edges") if isinstance(edge, Edge) else (edge.layer, "trace")
    way = motion.way
    axis = frozen(way.rotation[:, :, 2])
    press = np.stack([np.concatenate([axis[:1], axis[:-1]]), axis], axis=1)
    feed = feed_of(motion, edge.length - sum(motion.trimmed), job.process)
    return ToolPath(
        id=motion.id,
        layer=layer,
        table=waypoints(
            position=way.position,
            via=way.via,
            axis=axis,
            force_direction=press,
            force=job.process.force,
            feed=feed,
        ),
        closed=edge.closed,
        contours=(edge.id,),
        operation=operation,
    )


def none_left(part: Part, count: int, first: UnreachableEdge, noun: str = "edge") -> NoSafeProgram:
    """The error if no line of a part can be processed.

    count: number of the lines.
    first: the first line, with its reason.
    noun: "edge" or "curve".
    """
    what = f"none of {counted(count, noun)} can be processed: {first.id}"
    return NoSafeProgram(part.source, what, first.text, first.remedy)


def left_out(lost: Sequence[UnreachableEdge], edges: Mapping[str, Line]) -> list[Note]:
    """Notes on edges and curves without a motion."""
    return [
        Note(
            "skipped",
            _describe(edges[one.id]),
            "; ".join(filter(None, (one.text, one.remedy))),
            (one.id,),
        )
        for one in lost
    ]


def _describe(line: Line) -> str:
    if isinstance(line, Edge):
        return f"edge {line.id}, {line.kind} of {short(line.length, 1)} mm"
    return f"curve {line.id}, {short(line.length, 1)} mm"
