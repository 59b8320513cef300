"""Links at working height: links between paths that need no lift, proven by geometry.

A link is the straight line of the tool centre from the end of one path to the start of the next. It
stays down if its distance from every drawn line and arc is at least the tool radius, and from every
fixture beside the tool edge at least that and `cell.margin`. Both ends are beside contours that
were followed, so they are outside the material, and a link from there that comes near no contour
stays outside. Nothing is proven about stock around the part.

Between two operations with one tool the link leads beside the contour just worked: away from it,
back along it, and to it again.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec.structs import replace

from camgen.geometry.intersect import measure_gaps
from camgen.geometry.segments import BoolArray, Segments, make_contour_segments, make_segments
from camgen.model.job import Job
from camgen.model.part import Note, Part
from camgen.model.path import ToolPath, Tour
from camgen.model.pose import FloatArray
from camgen.model.tolerance import BESIDE_WORKED_MM, SAME_POINT_MM
from camgen.plan.starting import find_ends

#: mm: distance by which a link or a lead may be nearer than the tool radius, as a path may.
CLEARANCE_SLACK_MM = 0.005


def stay_down(tour: Tour, part: Part, job: Job) -> tuple[Tour, tuple[Note, ...]]:
    """The tour with the paths that are reached without a lift, and a note on their number.

    It is unchanged unless the job asks for it. Such a link joins single passes beside contours,
    without force, at one height, with the tool straight down and not turned with the contour. With
    a mesh or a drawn fixture every link is lifted.
    """
    if not job.process.stay_down or len(tour.paths) < 2:
        return tour, ()
    level = np.flatnonzero(_are_level(tour.paths, job))
    why = (
        "these links keep the tool's radius from all drawn contours and from fixtures; "
        "the stock is unknown"
    )
    if not _are_boxes(job):
        level = level[:0]
        why = (
            "only fixtures that are boxes are tested here, so every link is lifted over the others"
        )
    begins, ends = find_ends(tour.paths)
    low = np.array([_get_end_height(path) for path in tour.paths[:-1]])
    links = make_segments(ends[level], begins[level + 1], np.zeros(len(level)), level)
    down = frozenset((level[_are_clear(links, low[level], part, job)] + 1).tolist())
    what = f"lifts saved: {len(down)} of {len(tour.paths) - 1}"
    return replace(tour, down=down), (Note("assumed" if down else "warning", what, why),)


def lead_beside(before: ToolPath, path: ToolPath, part: Part, job: Job) -> FloatArray | None:
    """Two points (2, 3) on the link from a path to the next one at working height, mm.

    The tool leaves the contour by `BESIDE_WORKED_MM`, returns beside it, and goes to the start of
    `path`. On its return it keeps that distance from all drawn contours, so that it does not touch
    a burr that is still there. Returns None if the tool has to be lifted.

    job: settings of the operation of `path`.
    """
    if (
        not (job.process.stay_down and job.operation.entry == "plunge" and _are_boxes(job))
        or not _are_level([before, path], job).all()
    ):
        return None
    left, met = before.position[-1], path.position[0]
    out = left - BESIDE_WORKED_MM * before.force_direction[-1, 1]
    back = met - BESIDE_WORKED_MM * path.force_direction[1, 0]
    points = np.array([left, out, back, met])
    points[:, 2] = _get_end_height(path)
    links = make_segments(points[:-1, :2], points[1:, :2], np.zeros(3), np.arange(3))
    low = points[:-1, 2]
    middle = links.take(np.array([1]))
    is_clear = _are_clear(links, low, part, job).all()
    is_clear &= _are_clear(middle, low[:1], part, job, BESIDE_WORKED_MM).all()
    return points[1:3] if is_clear else None


def _are_level(paths: Sequence[ToolPath], job: Job) -> BoolArray:
    """(P - 1,) whether each path and the next one may be linked at their one height."""
    plain = _are_plain(paths, job)
    end_heights = np.array([_get_end_height(path) for path in paths])
    start_heights = np.array([path.position[0, 2] - path.depths[0] for path in paths])
    return np.asarray(
        plain[:-1] & plain[1:] & (np.abs(end_heights[:-1] - start_heights[1:]) < SAME_POINT_MM)
    )


def _get_end_height(path: ToolPath) -> float:
    return float(path.position[-1, 2] - path.depths[0])


def _are_boxes(job: Job) -> bool:
    return all(isinstance(box, list) for box in job.cell.fixtures or [])


def _are_clear(
    links: Segments, low: FloatArray, part: Part, job: Job, extra: float = 0.0
) -> BoolArray:
    """(L,) whether the tool on links at heights `low` (L,) is clear of part and fixtures.

    extra: distance from the part beyond the tool radius, mm.
    """
    radius = job.tool.diameter / 2 - CLEARANCE_SLACK_MM
    reach = radius + extra
    boxes = [box for box in job.cell.fixtures or [] if isinstance(box, list)]
    table = np.array(boxes, dtype=np.float64).reshape(-1, 6)
    clear = measure_gaps(links, make_contour_segments(part.contours), reach) >= reach
    return np.asarray(clear & _are_past_boxes(links, low, table, radius + job.cell.margin))


def _are_plain(paths: Sequence[ToolPath], job: Job) -> BoolArray:
    """(P,) which paths may be left and entered from the side."""
    if job.tool.orient == "follow":
        return np.zeros(len(paths), dtype=bool)
    return np.array(
        [
            len(path.depths) == 1
            and bool(path.force_direction[:, :, :2].any())
            and not path.force.any()
            and bool((path.axis[[0, -1], 2] < -1 + 1e-12).all())
            for path in paths
        ]
    )


def _are_past_boxes(
    links: Segments, low: FloatArray, boxes: FloatArray, radius: float
) -> BoolArray:
    """(L,) whether links keep clear of every box above the height `low` (L,) of the tool edge."""
    clear = np.ones(len(links), dtype=bool)
    for box in boxes.reshape(-1, 2, 3):
        (x0, y0, _), (x1, y1, top) = box.min(axis=0), box.max(axis=0)
        corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
        walls = make_segments(
            corners, np.roll(corners, -1, axis=0), np.zeros(4), np.zeros(4, dtype=np.int64)
        )
        inside = ((links.start > (x0, y0)) & (links.start < (x1, y1))).all(axis=1)
        clear &= (top <= low) | (~inside & (measure_gaps(links, walls, radius) >= radius))
    return clear
