"""Tool paths on the drawn lines."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain

import numpy as np
from msgspec.structs import replace

from camgen.geometry.nesting import find_nesting
from camgen.geometry.overlap import (
    SAME_CURVE_MM,
    Chain,
    Parts,
    cut_chain,
    find_covered,
    measure_covered,
)
from camgen.geometry.ragged import number_kept
from camgen.geometry.segments import make_contour_segments
from camgen.model.job import Job
from camgen.model.part import Contour, Note, Part, list_closed_rows, list_ids
from camgen.model.path import ToolPath
from camgen.model.pose import frozen
from camgen.model.sequences import take_rows
from camgen.model.text import counted, short
from camgen.model.tolerance import SAME_POINT_MM
from camgen.plan.columns import (
    Label,
    SegmentWork,
    compute_depths,
    compute_sideways,
    make_tool_paths,
)
from camgen.plan.merge import merge


def trace(part: Part, job: Job) -> tuple[ToolPath, ...]:
    """The tool centre on every contour, open or closed.

    A force presses along the tool axis, down on the part.
    """
    # Nesting depends on all contours; only those of the operation get a path.
    mine = part.list_worked_rows()
    contours = take_rows(part.contours, mine)
    segments = make_contour_segments(contours)
    labels = [
        Label(c.id, c.layer, c.closed, True, around, c.sources or (c.id,))
        for c, around in zip(contours, _parents_of(part, mine), strict=True)
    ]
    press = compute_sideways(segments, 0)
    if job.process.force:
        press[:, :, 2] = -1.0
    force = np.full(len(segments), job.process.force)
    feed = np.full(len(segments), job.process.feed)
    depths = compute_depths(job.operation.depth, job.operation.passes)
    return make_tool_paths(segments, labels, SegmentWork(press, force, feed), depths, "trace")


def share_edges(part: Part, job: Job) -> tuple[Part, tuple[Note, ...]]:
    """The part with every length that several contours share in the first of them only, and a note.

    The rest of another contour is open; `operation.shared = "each"` keeps all contours as drawn.
    """
    if job.operation.shared == "each":
        return part, ()
    traced = part.list_worked_rows()
    contours = take_rows(part.contours, traced)
    segments = make_contour_segments(contours)
    tolerance = max(min(job.input.join, SAME_CURVE_MM), 4 * SAME_POINT_MM)
    covered = find_covered(segments, segments.owner, np.zeros(len(segments), np.int64), tolerance)
    if not covered:
        return part, ()
    parts_of: dict[int, dict[int, Parts]] = {}
    for row, parts in covered.items():
        parts_of.setdefault(int(segments.owner[row]), {})[row] = parts
    result = [[contour] for contour in part.contours]
    for number, rows in parts_of.items():
        contour = contours[number]
        head = int(np.searchsorted(segments.owner, number))
        local = {row - head: parts for row, parts in rows.items()}
        chains = cut_chain(contour.points, contour.bulges, contour.closed, local)
        result[traced[number]] = list(_name_rests(contour, chains))
    total = measure_covered(segments, covered)
    ids = list_ids(take_rows(contours, sorted(parts_of)))
    note = Note(
        "joined",
        f"{short(total, 2)} mm of {counted(len(ids), 'contour')} lie on others and are run once",
        'operation.shared = "each" runs them for each contour',
        ids,
    )
    return replace(part, contours=tuple(chain.from_iterable(result))), (note,)


def _name_rests(contour: Contour, chains: list[Chain]) -> Iterator[Contour]:
    sources = contour.sources or (contour.id,)
    for number, (points, bulges) in enumerate(chains, 1):
        name = contour.id if number == 1 else f"{contour.id}.{number}"
        yield replace(
            contour,
            points=frozen(points),
            bulges=frozen(bulges),
            closed=False,
            id=name,
            sources=sources,
        )


def with_few_lifts(part: Part, job: Job) -> tuple[Part, tuple[Note, ...]]:
    """The part with its networks of lines as few trails, and notes.

    A tool that turns with the contour is not led round a sharp corner, and
    `tour.method = "as-drawn"` keeps all contours. With `operation.inside_first`, a loop with
    another one around it or in it is cut out by itself.
    """
    if job.tool.orient == "follow" or job.tour.method == "as-drawn":
        return part, ()
    fixed = np.ones(len(part.contours), dtype=bool)
    fixed[part.list_worked_rows()] = False
    contours, notes = merge(part.contours, fixed, job.input.join)
    if notes and job.operation.inside_first:
        for row, parent in enumerate(_parents(part)):
            if parent >= 0:
                fixed[[row, parent]] = True
        contours, notes = merge(part.contours, fixed, job.input.join)
    return (replace(part, contours=contours) if notes else part), notes


def _parents_of(part: Part, mine: list[int]) -> Iterator[int]:
    parents, index = _parents(part), number_kept(mine)
    for k in mine:
        around = parents[k]
        while around >= 0 and around not in index:
            around = parents[around]
        yield index.get(around, -1)


def _parents(part: Part) -> list[int]:
    closed = list_closed_rows(part.contours)
    parent = [-1] * len(part.contours)
    nesting = find_nesting(make_contour_segments(take_rows(part.contours, closed)), len(closed))
    for k, enclosing in zip(closed, nesting.parent.tolist(), strict=True):
        parent[k] = closed[enclosing] if enclosing >= 0 else -1
    return parent
