"""Links at working height: which ways between paths may do without a lift, proven by geometry.

A link is the straight way of the tool's centre from the end of one path to the start of the next. It stays down where
its distance from every line and arc that was drawn is no less than the tool's radius, and from
every fixture beside the tool's edge no less than that and ``cell.margin``.
Both ends are beside contours that were followed, hence outside the material; a way from there that
comes near no contour stays outside. Nothing is proven of stock around the part.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec.structs import replace

from camgen.geometry.intersect import gaps
from camgen.geometry.segments import BoolArray, Segments, from_contours, make
from camgen.model.job import Job
from camgen.model.part import Note, Part
from camgen.model.path import ToolPath, Tour
from camgen.model.pose import FloatArray
from camgen.model.tolerance import SAME_POINT_MM

__all__ = ["CLEARANCE_SLACK_MM", "stay_down"]

#: By how much (mm) a link or a lead may be nearer than the tool's radius: a path keeps its distance within this.
CLEARANCE_SLACK_MM = 0.005


def stay_down(tour: Tour, part: Part, job: Job) -> tuple[Tour, tuple[Note, ...]]:
    """The tour with the paths that are reached without a lift, and a note on how many; nothing unless the job asks.

    Only one pass beside a contour, without force, with the tool straight down and not turned with the contour, is left
    and entered so, at one height. With a mesh or a drawn fixture every link is lifted.
    """
    if not job.process.stay_down or len(tour.paths) < 2:
        return tour, ()
    fixtures = job.cell.fixtures or []
    boxes = np.array([box for box in fixtures if isinstance(box, list)], dtype=np.float64).reshape(
        -1, 6
    )
    fair = _plain(tour.paths, job)
    start = np.array([path.position[-1] for path in tour.paths[:-1]])
    end = np.array([path.position[0] for path in tour.paths[1:]])
    depth = np.array([path.depths[0] for path in tour.paths])
    low = start[:, 2] - depth[:-1]
    level = np.abs(low - (end[:, 2] - depth[1:])) < SAME_POINT_MM
    asked = np.flatnonzero(fair[:-1] & fair[1:] & level)
    if len(boxes) < len(fixtures):
        asked = asked[:0]
    radius = job.tool.diameter / 2 - CLEARANCE_SLACK_MM
    links = make(start[asked, :2], end[asked, :2], np.zeros(len(asked)), asked)
    clear = gaps(links, from_contours(part.contours), radius) >= radius
    clear &= _past(links, low[asked], boxes, radius + job.cell.margin)
    down = frozenset((asked[clear] + 1).tolist())
    why = "these ways keep the tool's radius from all that is drawn and from fixtures; of stock nothing is known"
    if len(boxes) < len(fixtures):
        why = "fixtures other than boxes are not looked at here: every way is lifted over them"
    note = Note(
        "assumed" if down else "warning", f"lifts saved: {len(down)} of {len(tour.paths) - 1}", why
    )
    return replace(tour, down=down), (note,)


def _plain(paths: Sequence[ToolPath], job: Job) -> BoolArray:
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


def _past(links: Segments, low: FloatArray, boxes: FloatArray, radius: float) -> BoolArray:
    """(L,) whether each link keeps clear of every box that reaches above the height ``low`` (L,) of the tool's edge."""
    clear = np.ones(len(links), dtype=bool)
    for box in boxes.reshape(-1, 2, 3):
        (x0, y0, _), (x1, y1, top) = box.min(axis=0), box.max(axis=0)
        corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
        walls = make(
            corners, np.roll(corners, -1, axis=0), np.zeros(4), np.zeros(4, dtype=np.int64)
        )
        inside = ((links.start > (x0, y0)) & (links.start < (x1, y1))).all(axis=1)
        clear &= (top <= low) | (~inside & (gaps(links, walls, radius) >= radius))
    return clear
