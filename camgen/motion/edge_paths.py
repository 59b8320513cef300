"""Motions along edges and curves as tool paths, and notes on lines without a motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from camgen.model.errors import NoSafeProgram
from camgen.model.job import Job
from camgen.model.part import Edge, Line, Note, Part
from camgen.model.path import ToolPath, make_waypoints
from camgen.model.pose import frozen
from camgen.model.text import counted, short
from camgen.model.tolerance import SAME_POINT_MM
from camgen.motion.setup import EdgeMotion, UnreachableEdge, compute_feed


def make_tool_path(motion: EdgeMotion, edge: Line, job: Job) -> ToolPath:
    """The motion along `edge` as a tool path."""
    layer, operation = (edge.kind, "edges") if isinstance(edge, Edge) else (edge.layer, "trace")
    path = motion.pose_path
    axis = frozen(path.rotation[:, :, 2])
    press = np.stack([np.concatenate([axis[:1], axis[:-1]]), axis], axis=1)
    feed = compute_feed(motion, edge.length - sum(motion.trimmed), job.process)
    return ToolPath(
        id=motion.id,
        layer=layer,
        table=make_waypoints(
            position=path.position,
            via=path.via,
            axis=axis,
            force_direction=press,
            force=job.process.force,
            feed=feed,
        ),
        closed=edge.closed and not motion.part_of,
        contours=(edge.id,),
        operation=operation,
    )


def make_no_edge_error(
    part: Part, count: int, first: UnreachableEdge, noun: str = "edge"
) -> NoSafeProgram:
    """The error if no line of a part can be processed.

    count: number of the lines.
    first: the first line, with its reason.
    noun: "edge" or "curve".
    """
    return NoSafeProgram(
        part.source,
        f"none of {counted(count, noun)} can be processed: {first.id}",
        first.text,
        first.remedy,
    )


def list_pieces(
    motions: Sequence[EdgeMotion], lines: Mapping[str, Line]
) -> dict[str, tuple[Line, float]]:
    """The line of each motion along a piece of it, and the length of the piece, mm, by its id."""
    pieces = {}
    for motion in motions:
        if motion.part_of:
            line = lines[motion.line]
            pieces[motion.id] = (line, line.length - sum(motion.trimmed))
    return pieces


def note_left_out(
    lost: Sequence[UnreachableEdge],
    lines: Mapping[str, Line],
    pieces: Mapping[str, tuple[Line, float]] = MappingProxyType({}),
) -> list[Note]:
    """Notes on edges, curves and pieces of them without a motion.

    pieces: result of `list_pieces`.
    """
    notes = []
    for edge in lost:
        why = edge.reason
        if edge.id in pieces:
            line, length = pieces[edge.id]
            notes.append(_note_piece(line, length, why, (edge.id, line.id)))
        else:
            notes.append(Note("skipped", _describe(lines[edge.id]), why, (edge.id,)))
    return notes


def note_gaps(line: Line, pieces: Sequence[EdgeMotion], why: str, trim: float) -> list[Note]:
    """Notes on the gaps between the pieces of a line.

    why: why the whole line has no motion.
    trim: `operation.trim`, length at either end that the job allows to be left out, mm.
    """
    length = line.length
    missing = length - sum(length - sum(piece.trimmed) for piece in pieces)
    if missing < SAME_POINT_MM:
        return []
    ends = pieces[0].trimmed[0], pieces[-1].trimmed[1]
    if not line.closed and len(pieces) == 1 and max(ends) <= trim:
        trimmed = f"its first {short(ends[0], 1)} and last {short(ends[1], 1)} mm"
        return [Note("assumed", f"{_name(line)} is run without {trimmed}", why, (line.id,))]
    return [_note_piece(line, missing, why, (line.id,))]


def _note_piece(line: Line, length: float, why: str, ids: tuple[str, ...]) -> Note:
    return Note("skipped", f"{short(length, 1)} mm of {_name(line)}", why, ids, length=length)


def _name(line: Line) -> str:
    return f"{'edge' if isinstance(line, Edge) else 'curve'} {line.id}"


def _describe(line: Line) -> str:
    kind = f"{line.kind} of " if isinstance(line, Edge) else ""
    return f"{_name(line)}, {kind}{short(line.length, 1)} mm"
