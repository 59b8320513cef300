"""Makes tool paths from segments in the plane, all chains of a drawing at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.ragged import compute_first_rows, count_rows
from camgen.geometry.segments import Segments, make_segments, points_at, tangents_at
from camgen.model.job import Job
from camgen.model.path import ToolPath, make_waypoints
from camgen.model.pose import FloatArray
from camgen.model.tolerance import NONZERO

#: Minimum speed of the tool centre on a tight inner curve, as a fraction of the feed.
SLOWEST = 0.02


class Label(Struct, frozen=True):
    """The name of a path and the way in which it may run.

    id: name of the path.
    layer: layer of its contours.
    closed: the path ends at its start.
    reversible: the path may run in either direction.
    parent: index of the path around it, or -1.
    contours: ids of the contours that it works on.
    """

    id: str
    layer: str
    closed: bool
    reversible: bool
    parent: int
    contours: tuple[str, ...]


class SegmentWork(Struct, frozen=True, eq=False):
    """Force and feed along each of N segments.

    press: (N, 2, 3) unit direction of the force at the start and the end.
    force: (N,) N.
    feed: (N,) mm/s.
    """

    press: FloatArray
    force: FloatArray
    feed: FloatArray


def make_tool_paths(
    segments: Segments,
    labels: Sequence[Label],
    work: SegmentWork,
    depths: tuple[float, ...],
    operation: str,
) -> tuple[ToolPath, ...]:
    """A path for each owner of `segments`, in order, with the tool straight down.

    The top face is z = 0.
    """
    count = len(labels)
    sizes = np.bincount(segments.owner, minlength=count)
    first = compute_first_rows(sizes)
    # A chain of n segments has n + 1 rows: its start, then the end of every segment.
    begin = first + np.arange(count)
    row_of = np.arange(len(segments)) + segments.owner + 1
    total = len(segments) + count
    source = np.zeros(total, dtype=np.int64)
    source[row_of] = np.arange(len(segments))
    source[begin] = first
    position = np.zeros((total, 3))
    position[row_of, :2] = segments.end
    position[begin, :2] = segments.start[first]
    via = np.full((total, 3), np.nan)
    arc = np.flatnonzero(segments.is_arc)
    via[row_of[arc], :2] = points_at(segments.take(arc), np.full(len(arc), 0.5))
    via[row_of[arc], 2] = 0.0
    table = make_waypoints(
        position,
        via,
        work.feed[source],
        force_direction=work.press[source],
        force=work.force[source],
    )
    paths = []
    for low, size, label in zip(begin.tolist(), sizes.tolist(), labels, strict=True):
        paths.append(
            ToolPath(
                id=label.id,
                layer=label.layer,
                table=table[low : low + size + 1],
                closed=label.closed,
                reversible=label.reversible,
                parent=label.parent,
                depths=depths,
                contours=label.contours,
                operation=operation,
            )
        )
    return tuple(paths)


def straight_path(
    ident: str,
    points: FloatArray,
    job: Job,
    operation: str,
    layer: str = "0",
    contours: tuple[str, ...] = (),
) -> ToolPath:
    """A path of straight lines through `points` (N, 2), the tool straight down.

    Feed, force and depths are those of `job`.
    ident: name of the path.
    operation: name of the operation.
    contours: ids of the contours that it works on.
    """
    return ToolPath(
        id=ident,
        layer=layer,
        table=make_waypoints(
            position=np.column_stack([points, np.zeros(len(points))]),
            via=np.nan,
            force_direction=[0.0, 0.0, -1.0 if job.process.force else 0.0],
            force=job.process.force,
            feed=job.process.feed,
        ),
        closed=bool((points[0] == points[-1]).all()),
        depths=compute_depths(job.operation.depth, job.operation.passes),
        contours=contours,
        operation=operation,
    )


def plunge_path(
    ident: str,
    layer: str,
    middle: tuple[float, float],
    job: Job,
    operation: str,
    contours: tuple[str, ...],
) -> ToolPath:
    """A path straight down to the depth of `job` at `middle`, x y in mm, and up again.

    contours: ids of the contours that it works on.
    operation: name of the operation.
    """
    x, y = middle
    return ToolPath(
        id=ident,
        layer=layer,
        table=make_waypoints(position=np.array([[x, y, 0.0]]), via=np.nan, feed=job.process.feed),
        closed=False,
        depths=compute_depths(job.operation.depth, job.operation.passes),
        contours=contours,
        operation=operation,
    )


def compute_sideways(segments: Segments, side: int) -> FloatArray:
    """(N, 2, 3) unit vectors perpendicular to the travel, at start and end of each segment.

    side: 1 for the left side, -1 for the right side, 0 for zero vectors.
    """
    press = np.zeros((len(segments), 2, 3))
    for k, fraction in enumerate((0.0, 1.0)):
        direction = tangents_at(segments, np.full(len(segments), fraction))
        press[:, k, 0] = -side * direction[:, 1]
        press[:, k, 1] = side * direction[:, 0]
    return press


def compute_depths(depth: float, passes: int) -> tuple[float, ...]:
    """Depths of equal passes down to `depth`, mm below the top face."""
    return tuple(depth * (k + 1) / passes for k in range(passes))


def join_tables(paths: Sequence[ToolPath]) -> ToolPath:
    """One path with the rows of all of them, for its columns."""
    return replace(paths[0], table=np.concatenate([path.table for path in paths]))


def make_path_segments(paths: Sequence[ToolPath]) -> Segments:
    """The lines and arcs of plane paths, seen from above."""
    drawn = join_tables(paths)
    rows = np.delete(np.arange(len(drawn)), compute_first_rows(count_rows(paths)))
    start, end, via = drawn.position[rows - 1, :2], drawn.position[rows, :2], drawn.via[rows, :2]
    chord, arm = end - start, via - (start + end) / 2
    square = np.maximum((chord**2).sum(axis=1), NONZERO)
    # The via point of an arc is on the right of its chord, by half the chord times the bulge.
    bulge = 2 * (arm[:, 0] * chord[:, 1] - arm[:, 1] * chord[:, 0]) / square
    return make_segments(
        start, end, np.where(np.isnan(bulge), 0.0, bulge), np.zeros(len(start), dtype=np.int64)
    )
