"""Rest machining: an operation takes only what earlier operations of the job leave.

The tool paths of earlier operations are swept at the depth of the operation. A path of the new tool
is kept where its disc meets material that the sweep leaves, and a little before and after that.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import shapely
from msgspec.structs import replace

from camgen.geometry.ragged import owners, ramp
from camgen.geometry.segments import Segments, flatten, make, points_at, split
from camgen.model.errors import JobError
from camgen.model.job import Job, ToolTable
from camgen.model.part import EarlierRun, Part
from camgen.model.path import ToolPath
from camgen.plan.beside import Beside, only_along
from camgen.plan.columns import path_segments

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


def keep_rest(curve: Beside, part: Part, job: Job) -> Beside:
    """The stretches of `curve` on which the tool meets what earlier operations of `part` leave.

    JobError if no operation comes before.
    """
    left = find_rest(_sweep(curve.segments, job.tool.radius), part, job)
    margin = _MARGIN_SHARE * job.tool.radius
    zone = shapely.buffer(left, job.tool.radius + margin, quad_segs=_QUARTER)
    shapely.prepare(zone)
    rows, low, high, inside = _divide(curve.segments, zone, margin / 2)
    pieces = Beside(
        split(curve.segments, rows, low, high),
        curve.closed,
        curve.source[rows],
        curve.turn[rows],
        curve.lost[rows],
        curve.sound,
        curve.other[rows],
    )
    return only_along(pieces, inside)


def find_rest(area: Any, part: Part, job: Job) -> Any:
    """The part of `area`, a shapely geometry, that earlier operations leave at `operation.depth`.

    JobError if no operation comes before.
    """
    if not part.earlier:
        what = "no operation before it takes anything"
        raise JobError(
            "job", what, "operation.rest", "list it after the operations of larger tools"
        )
    cleared = _clear(part.earlier, job.operation.depth)
    return shapely.difference(area, shapely.buffer(cleared, _NARROW_MM, quad_segs=2))


def list_runs(paths: Sequence[ToolPath], tool: ToolTable) -> list[EarlierRun]:
    """The lines and arcs of a tool along `paths`, for operations that take what it leaves.

    A tool that is not flat has none: it clears no whole disc at its depth.
    """
    if tool.kind not in _FLAT:
        return []
    runs = []
    for path in paths:
        if path.depths:
            lines = path_segments((path,))
            depth = max(path.depths)
            runs.append(EarlierRun(lines.start, lines.end, lines.bulge, tool.radius, depth))
    return runs


def _clear(earlier: Iterable[EarlierRun], depth: float) -> Any:
    """The area that flat tools clear down to `depth` mm, without their tabs."""
    areas = []
    for run in earlier:
        if run.depth >= depth - _SAME_DEPTH_MM:
            owner = np.zeros(len(run.start), np.int64)
            areas.append(_sweep(make(run.start, run.end, run.bulge, owner), run.radius))
    return shapely.union_all(areas)


def _sweep(segments: Segments, radius: float) -> Any:
    """The area within `radius` mm of lines and arcs."""
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
    row, place = owners(count), ramp(count)
    points = points_at(segments.take(row), (place + 0.5) / count[row])
    inside = shapely.contains_xy(zone, points[:, 0], points[:, 1])
    begins = np.append(True, (row[1:] != row[:-1]) | (inside[1:] != inside[:-1]))[: len(row)]
    first = np.flatnonzero(begins)
    last = np.append(first[1:], len(row)) - 1
    low = place[first] / count[row[first]]
    high = (place[last] + 1) / count[row[first]]
    return row[first], low, high, inside[first]
