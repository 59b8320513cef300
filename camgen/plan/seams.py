"""Applies settings of single contours: start points (`tour.seams`), first ones (`tour.order`).

A point belongs to the nearest closed path. The distance is measured to the path and to the
contours that it works on. So a point on a path is for that path, and a point on a contour is for
all paths of the contour.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from msgspec.structs import replace

from camgen.geometry.intersect import find_fractions, make_boxes, measure_distances
from camgen.geometry.ragged import count_rows, list_owners
from camgen.geometry.segments import Segments, compute_bounds, make_contour_segments
from camgen.model.errors import JobError
from camgen.model.job import Job
from camgen.model.part import Note, Part, list_ids
from camgen.model.path import ToolPath
from camgen.model.pose import FloatArray
from camgen.model.sequences import take_rows
from camgen.model.text import short
from camgen.plan.columns import make_path_segments
from camgen.plan.starting import SEAM, move_each_start
from camgen.plan.unused import check_rules

#: Maximum distance of a point from its path or contour, mm. Paths whose distances differ by at
#: most `SAME_MM` all get the point.
NEAR_MM, SAME_MM = 2.0, 0.01


def pin_seams(
    plans: Sequence[Sequence[ToolPath]], part: Part, job: Job
) -> tuple[list[tuple[ToolPath, ...]], tuple[Note, ...]]:
    """Rotate closed paths to start at the points of `tour.seams`.

    plans: paths of each operation on the flat `part`.
    Returns the paths of each operation, and a note on each point without effect. Raises JobError
    for an invalid point and for one that is not near any closed path.
    """
    points = read_points(job)
    places = []
    for operation, paths in enumerate(plans):
        places += [(operation, k) for k, path in enumerate(paths) if has_seam(path)]
    closed = [plans[operation][k] for operation, k in places]
    chosen, far = choose_points(points, closed, [operation for operation, _ in places], part)
    if far:
        point = _format_point(points[far[0]])
        raise JobError(
            "job",
            f"{point} is farther than {NEAR_MM:g} mm from every closed path and its contour",
            "tour.seams",
            "give a point on a closed contour that is worked on",
        )
    pinned = sorted(chosen)
    rotated = _rotate_paths(take_rows(closed, pinned), points[take_rows(chosen, pinned)])
    results = [list(paths) for paths in plans]
    for i, path in zip(pinned, rotated, strict=True):
        operation, k = places[i]
        results[operation][k] = path

    notes = []
    why = "another one is nearer to the paths that it is for"
    for number in sorted(set(range(len(points))) - set(chosen.values())):
        notes.append(
            Note("warning", f"tour.seams: {_format_point(points[number])} has no effect", why)
        )
    return [tuple(paths) for paths in results], tuple(notes)


def has_seam(path: ToolPath) -> bool:
    """True if the start point of a path may be moved along it."""
    return path.closed and len(path.position) > 1 and path.entry_radius == 0


def choose_points(
    points: FloatArray, closed: Sequence[ToolPath], operations: Sequence[int], part: Part
) -> tuple[dict[int, int], list[int]]:
    """Assign `points` (K, 2), mm, to the `closed` paths.

    operations: index of the operation of each path.
    Returns the index of the point for each path that has one, and the indices of the points that
    are farther than `NEAR_MM` from all paths.
    """
    chosen: dict[int, tuple[float, int]] = {}
    far: list[int] = []
    for number, near in enumerate(_find_near(points, closed, part)):
        if not near:
            far.append(number)
            continue
        limit = min(near.values()) + SAME_MM
        paths = [path for path, distance in near.items() if distance <= limit]
        distances = {path: project_point(closed[path], points[number])[2] for path in paths}
        for path, distance in distances.items():
            # A pass elsewhere on the contour, as around an island of a pocket, is farther away than
            # the nearest path of its operation, by more than `NEAR_MM`.
            nearest = min(distances[k] for k in distances if operations[k] == operations[path])
            # If several points are on a contour, the nearest to the path counts, or the last one.
            is_nearest = path not in chosen or distance <= chosen[path][0]
            if distance <= nearest + NEAR_MM and is_nearest:
                chosen[path] = distance, number
    return {path: number for path, (_, number) in chosen.items()}, far


def check_order(part: Part, job: Job) -> None:
    """Raise JobError for an id in `tour.order` that the part does not have or that is repeated."""
    known = {*list_ids(part.contours), *list_ids(part.curves)}
    named = set[str]()
    for name in job.tour.order:
        check_rules(
            [
                (
                    name not in known,
                    f"there is no contour {name!r} in {part.source}",
                    "tour.order",
                    "camgen inspect -v shows their ids",
                ),
                (
                    name in named,
                    f"contour {name!r} is listed twice",
                    "tour.order",
                    "name it once",
                ),
            ]
        )
        named.add(name)


def read_points(job: Job) -> FloatArray:
    """The points of `tour.seams` as (K, 2), mm. Raises JobError for a point without two numbers."""
    for point in job.tour.seams:
        if len(point) != 2:
            raise JobError(
                "job",
                f"{point} is not a point of the work plane",
                "tour.seams",
                "write [[x, y], ...], mm",
            )
    return np.array(job.tour.seams, dtype=np.float64).reshape(-1, 2)


def _format_point(point: Sequence[float] | FloatArray) -> str:
    return f"[{', '.join(short(float(value), 3) for value in point)}]"


def _find_near(
    points: FloatArray, closed: Sequence[ToolPath], part: Part
) -> list[dict[int, float]]:
    """For each point the closed paths near it, each with the distance of path or contour, mm."""
    near: list[dict[int, float]] = [{} for _ in points]
    if not closed:
        return near
    path_rows = list_owners(count_rows(closed) - 1)
    paths_by_contour: dict[str, list[int]] = {}
    for k, path in enumerate(closed):
        for name in path.contours:
            paths_by_contour.setdefault(name, []).append(k)
    contours = [c for c in part.contours if c.id in paths_by_contour and len(c.points) > 1]
    drawn = make_contour_segments(contours)
    for number, row, distance in _find_pairs(points, make_path_segments(closed)):
        _note_nearer(near[number], [int(path_rows[row])], distance)
    for number, row, distance in _find_pairs(points, drawn):
        _note_nearer(near[number], paths_by_contour[contours[drawn.owner[row]].id], distance)
    return near


def _note_nearer(near: dict[int, float], paths: Sequence[int], distance: float) -> None:
    for k in paths:
        near[k] = min(near.get(k, distance), distance)


def _find_pairs(points: FloatArray, segments: Segments) -> list[tuple[int, int, float]]:
    """Index of a point, index of a segment within `NEAR_MM` of it, and their distance, mm."""
    if not len(segments):
        return []
    around = make_boxes(np.hstack([points - NEAR_MM, points + NEAR_MM]))
    number, row = shapely.STRtree(make_boxes(compute_bounds(segments))).query(around)
    distance = measure_distances(points[number], segments, row)
    near = distance <= NEAR_MM
    columns = number[near].tolist(), row[near].tolist(), distance[near].tolist()
    return list(zip(*columns, strict=True))


def _rotate_paths(paths: Sequence[ToolPath], points: FloatArray) -> list[ToolPath]:
    starts = [project_point(path, point) for path, point in zip(paths, points, strict=True)]
    segments, fractions, _ = zip(*starts, strict=True) if starts else ((), (), ())
    return [replace(path, pinned=True) for path in move_each_start(paths, segments, fractions)]


def project_point(path: ToolPath, point: FloatArray) -> tuple[int, float, float]:
    """The nearest point on `path` to `point` (2,).

    Returns its segment, counted from 1 as by `move_start`, the fraction 0 to 1 along it, and the
    distance in mm. It is a vertex if the shorter part of the segment would be less than `SEAM`.
    """
    segments = make_path_segments([path])
    rows = np.arange(len(segments))
    distances = measure_distances(np.tile(point, (len(segments), 1)), segments, rows)
    best = int(np.argmin(distances))
    nearest = segments.take(rows[best : best + 1])
    fraction = float(np.clip(find_fractions(nearest, point[None]), 0.0, 1.0)[0])
    if min(fraction, 1 - fraction) * float(nearest.length[0]) < SEAM:
        fraction = float(round(fraction))
    return best + 1, fraction, float(distances[best])
