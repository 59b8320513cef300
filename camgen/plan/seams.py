"""What the job says of single contours: where closed paths begin (tour.seams), and which run first (tour.order).

A point is for the closed path that it is nearest to, measured to the path and to the contours that it works on: one on
a path is for that path, one on a contour for all paths of it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from msgspec.structs import replace

from camgen.geometry.intersect import find_fractions, make_boxes, measure_distances
from camgen.geometry.segments import Segments, compute_bounds, from_contours
from camgen.model.errors import JobError
from camgen.model.job import Job
from camgen.model.part import Note, Part
from camgen.model.path import ToolPath
from camgen.model.pose import FloatArray
from camgen.model.text import short
from camgen.plan.columns import path_segments
from camgen.plan.starting import SEAM, starting_each

#: A point may be so far from the path or contour that it is for, mm. Paths that are as near to it, within ``SAME_MM``,
#: are all meant.
NEAR_MM, SAME_MM = 2.0, 0.01


def pin_seams(
    plans: Sequence[Sequence[ToolPath]], part: Part, job: Job
) -> tuple[list[tuple[ToolPath, ...]], tuple[Note, ...]]:
    """The paths of each of several operations on the flat ``part``, the closed ones begun where ``tour.seams`` says,
    and a note on each point that has no effect. JobError for what is no point, and for one that is near no closed path.
    """
    points = read_points(job)
    places = [
        (k, n) for k, paths in enumerate(plans) for n, path in enumerate(paths) if has_seam(path)
    ]
    closed = [plans[k][n] for k, n in places]
    chosen, far = choose_points(points, closed, [k for k, _ in places], part)
    if far:
        what = f"{_tell(points[far[0]])} is farther than {NEAR_MM:g} mm from every closed path and its contour"
        raise JobError(
            "job", what, "tour.seams", "give a point on a closed contour that is worked on"
        )
    given = sorted(chosen)
    begun = _begin([closed[i] for i in given], points[[chosen[i] for i in given]])
    own = [list(paths) for paths in plans]
    for i, path in zip(given, begun, strict=True):
        k, n = places[i]
        own[k][n] = path
    used = set(chosen.values())
    idle = [point for number, point in enumerate(points) if number not in used]
    why = "another one is nearer to the paths that it is for"
    notes = tuple(
        Note("warning", f"tour.seams: {_tell(point)} has no effect", why) for point in idle
    )
    return [tuple(paths) for paths in own], notes


def has_seam(path: ToolPath) -> bool:
    """Whether a path may begin elsewhere than it does."""
    return path.closed and len(path.position) > 1 and path.entry_radius == 0


def choose_points(
    points: FloatArray, closed: Sequence[ToolPath], operations: Sequence[int], part: Part
) -> tuple[dict[int, int], list[int]]:
    """The point (K, 2) that each of the ``closed`` paths begins at, by their numbers, for those that have one; and the
    points that are farther than ``NEAR_MM`` from all of them. operations: by path.
    """
    chosen: dict[int, tuple[float, int]] = {}
    far: list[int] = []
    for number, near in enumerate(_find_near(points, closed, part)):
        if not near:
            far.append(number)
            continue
        least = min(near.values())
        away = {
            path: project(closed[path], points[number])[2]
            for path, apart in near.items()
            if apart <= least + SAME_MM
        }
        for path, own in away.items():
            # What goes along the contour elsewhere, as the passes about the islands of a pocket do, is not meant.
            beside = min(away[other] for other in away if operations[other] == operations[path])
            # Of several points on one contour the one on the path itself; the last of those that are as near.
            if own <= beside + NEAR_MM and (path not in chosen or own <= chosen[path][0]):
                chosen[path] = own, number
    return {path: number for path, (_, number) in chosen.items()}, far


def insist_on_order(part: Part, job: Job) -> None:
    """JobError for an id of ``tour.order`` that the part has not, and for one that stands there twice."""
    known, named = {one.id for one in part.contours} | {one.id for one in part.curves}, set[str]()
    for name in job.tour.order:
        if name not in known:
            what = f"there is no contour {name!r} in {part.source}"
            raise JobError("job", what, "tour.order", "camgen inspect -v shows their ids")
        if name in named:
            raise JobError(
                "job", f"contour {name!r} stands there twice", "tour.order", "name it once"
            )
        named.add(name)


def read_points(job: Job) -> FloatArray:
    """(K, 2) mm. JobError for what is no point."""
    for point in job.tour.seams:
        if len(point) != 2:
            what = f"{point} is no point of the work plane"
            raise JobError("job", what, "tour.seams", "write [[x, y], ...], mm")
    return np.array(job.tour.seams, dtype=np.float64).reshape(-1, 2)


def _tell(point: Sequence[float] | FloatArray) -> str:
    return f"[{', '.join(short(float(value), 3) for value in point)}]"


def _find_near(
    points: FloatArray, closed: Sequence[ToolPath], part: Part
) -> list[dict[int, float]]:
    """By point the closed paths that it is near to, with how far away it is from them or their contours, mm."""
    found: list[dict[int, float]] = [{} for _ in points]
    if not closed:
        return found
    of_paths = np.repeat(np.arange(len(closed)), [len(path.position) - 1 for path in closed])
    works: dict[str, list[int]] = {}
    for k, path in enumerate(closed):
        for name in path.contours:
            works.setdefault(name, []).append(k)
    contours = [one for one in part.contours if one.id in works and len(one.points) > 1]
    drawn = from_contours(contours)
    for number, row, apart in _pairs(points, path_segments(closed)):
        _note_nearer(found[number], [int(of_paths[row])], apart)
    for number, row, apart in _pairs(points, drawn):
        _note_nearer(found[number], works[contours[drawn.owner[row]].id], apart)
    return found


def _note_nearer(found: dict[int, float], paths: Sequence[int], apart: float) -> None:
    for k in paths:
        found[k] = min(found.get(k, apart), apart)


def _pairs(points: FloatArray, segments: Segments) -> list[tuple[int, int, float]]:
    """Points and the segments within ``NEAR_MM`` of them: their numbers, and how far apart, mm."""
    if not len(segments):
        return []
    around = make_boxes(np.hstack([points - NEAR_MM, points + NEAR_MM]))
    number, row = shapely.STRtree(make_boxes(compute_bounds(segments))).query(around)
    apart = measure_distances(points[number], segments, row)
    near = apart <= NEAR_MM
    return list(zip(number[near].tolist(), row[near].tolist(), apart[near].tolist(), strict=True))


def _begin(paths: Sequence[ToolPath], points: FloatArray) -> list[ToolPath]:
    """Each of the closed paths begun at its point of them that is nearest, and kept there."""
    at = [project(path, point) for path, point in zip(paths, points, strict=True)]
    made = starting_each(
        paths, [segment for segment, _, _ in at], [fraction for _, fraction, _ in at]
    )
    return [replace(path, pinned=True) for path in made]


def project(path: ToolPath, point: FloatArray) -> tuple[int, float, float]:
    """Where on ``path`` is nearest to ``point`` (2,): the segment as ``starting_at`` counts, the fraction 0..1 of it,
    and how far away, mm. At a vertex where less than ``SEAM`` would be cut off the segment.
    """
    segments = path_segments([path])
    every = np.arange(len(segments))
    away = measure_distances(np.tile(point, (len(segments), 1)), segments, every)
    best = int(np.argmin(away))
    own = segments.take(every[best : best + 1])
    fraction = float(np.clip(find_fractions(own, point[None]), 0.0, 1.0)[0])
    if min(fraction, 1 - fraction) * float(own.length[0]) < SEAM:
        fraction = float(round(fraction))
    return best + 1, fraction, float(away[best])
