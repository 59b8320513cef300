"""Rest machining: an operation takes only what earlier operations of the job leave.

The tool paths of earlier operations are swept at the depth of the operation. A path of the new tool
is kept where its disc meets material that the sweep leaves, and a little before and after that.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
import shapely
from msgspec.structs import replace

from camgen.geometry.ragged import Runs, divide_runs, list_range_numbers
from camgen.geometry.segments import Segments, flatten, make_segments, points_at, split_segments
from camgen.model.errors import JobError
from camgen.model.job import Job, ToolTable
from camgen.model.part import EarlierRun, Part
from camgen.model.path import ToolPath
from camgen.plan.beside import OffsetCurve, select_segments
from camgen.plan.columns import make_path_segments

#: Arcs are swept as chords that leave them by this, mm.
_CHORD_MM = 0.002
#: Number of chords in a quarter of a circle around a swept area.
_QUARTER = 32
#: Material nearer than this to cleared ground, mm, does not count: it is an error of chords, or
#: stands in a shallow corner.
_NARROW_MM = 0.015
#: A path begins and ends outside the rest by this share of the tool's radius.
_MARGIN_SHARE = 0.25
#: Depths that differ by less, mm, are one.
_SAME_DEPTH_MM = 1e-6
#: Tools whose sweep at the depth of the path has their whole diameter.
_FLAT = ("end mill",)


def keep_rest(curve: OffsetCurve, part: Part, job: Job) -> OffsetCurve:
    """The stretches of `curve` on which the tool meets what earlier operations of `part` leave.

    JobError if no operation comes before.
    """
    left = find_rest(_sweep(curve.segments, job.tool.radius), part, job)
    if not len(curve.segments):
        return curve
    margin = _MARGIN_SHARE * job.tool.radius
    zone = shapely.buffer(left, job.tool.radius + margin, quad_segs=_QUARTER)
    shapely.prepare(zone)
    rows, low, high, inside = _divide(curve.segments, zone, margin / 2)
    pieces = OffsetCurve(
        split_segments(curve.segments, rows, low, high),
        curve.closed,
        curve.source[rows],
        curve.turn[rows],
        curve.lost[rows],
        curve.sound,
        curve.other[rows],
        curve.shared,
    )
    return select_segments(pieces, inside)


def find_rest(area: Any, part: Part, job: Job) -> Any:
    """The part of `area`, a shapely geometry, that earlier operations leave at `operation.depth`.

    JobError if no operation comes before.
    """
    if not part.earlier:
        raise JobError(
            "job",
            "no operation before it takes anything",
            "operation.rest",
            "list it after the operations of larger tools",
        )
    cleared = _clear(part.earlier, job.operation.depth)
    return shapely.difference(area, shapely.buffer(cleared, _NARROW_MM, quad_segs=2))


def list_runs(paths: Sequence[ToolPath], tool: ToolTable) -> Iterator[EarlierRun]:
    """The lines and arcs of a tool along `paths`, for operations that take what it leaves.

    A tool that is not flat has none: it clears no whole disc at its depth.
    """
    for path in paths:
        if path.depths and tool.kind in _FLAT:
            lines = make_path_segments((path,))
            yield EarlierRun(lines.start, lines.end, lines.bulge, tool.radius, max(path.depths))


def _clear(earlier: Iterable[EarlierRun], depth: float) -> Any:
    areas = []
    for run in earlier:
        if run.depth >= depth - _SAME_DEPTH_MM:
            owner = np.zeros(len(run.start), np.int64)
            areas.append(_sweep(make_segments(run.start, run.end, run.bulge, owner), run.radius))
    return shapely.union_all(areas)


def _sweep(segments: Segments, radius: float) -> Any:
    each = replace(segments, owner=np.arange(len(segments)))
    points, owner = flatten(each, _CHORD_MM)
    points = np.vstack([points, segments.end])
    owner = np.append(owner, each.owner)
    order = np.argsort(owner, kind="stable")
    lines = shapely.linestrings(points[order], indices=owner[order])
    return shapely.union_all(shapely.buffer(lines, radius, quad_segs=_QUARTER))


def _divide(
    segments: Segments, zone: Any, step: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Pieces of segments that are inside `zone` or outside.

    step: the zone is looked up at places that are this far apart at most, mm.

    Returns the row of each piece, the shares of its segment at which it begins and ends, and
    whether it is inside.
    """
    count = np.maximum(np.ceil(segments.length / step), 1).astype(np.int64)
    border = shapely.boundary(zone)
    shapely.prepare(border)

    def points(runs: Runs, rows: np.ndarray) -> np.ndarray:
        return points_at(segments.take(runs.group), rows / count[runs.group])

    def is_apart(runs: Runs) -> np.ndarray:
        ends = np.stack([points(runs, runs.first), points(runs, runs.end)], axis=1)
        share = (runs.end - runs.first) / count[runs.group]
        bulge = np.tan(np.arctan(np.abs(segments.bulge[runs.group])) * share)
        # An arc is never farther from its chord than in the middle.
        height = bulge * np.hypot(*(ends[:, 1] - ends[:, 0]).T) / 2
        return ~np.asarray(shapely.dwithin(border, shapely.linestrings(ends), height + _NARROW_MM))

    runs = divide_runs(count, is_apart)
    size = np.where(runs.settled, 1, runs.end - runs.first)
    first = list_range_numbers(runs.first, size)
    end = np.where(np.repeat(runs.settled, size), np.repeat(runs.end, size), first + 1)
    row = np.repeat(runs.group, size)
    runs = Runs(row, first, end, np.ones(len(row), dtype=bool))
    inside = shapely.contains_xy(zone, *points(runs, (first + end) / 2).T)
    begins = np.append(True, (row[1:] != row[:-1]) | (inside[1:] != inside[:-1]))[: len(row)]
    begin = np.flatnonzero(begins)
    last = np.append(begin[1:], len(row)) - 1
    low = first[begin] / count[row[begin]]
    return row[begin], low, end[last] / count[row[begin]], inside[begin]
