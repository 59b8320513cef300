"""Adds lead-ins, lead-outs and overlaps to followed contours, when the start of each path is known.

A closed path is entered on a quarter of a circle from the free side and left on another. An open
path has leads along its own tangent. A lead is used only where the tool keeps its distance from all
drawn contours. Otherwise a shorter one is tried, then another start of a closed path, then none,
with a note.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain
from typing import Any

import numpy as np
import shapely
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.arcs import measure_spans
from camgen.geometry.fixtures import Fixtures
from camgen.geometry.intersect import Obstacles
from camgen.geometry.segments import make_contour_segments
from camgen.model.job import Job
from camgen.model.part import Note, Part, list_ids
from camgen.model.path import ToolPath, join_paths, make_waypoints
from camgen.model.pose import FloatArray
from camgen.model.text import counted, name_first
from camgen.order.stay_down import CLEARANCE_SLACK_MM
from camgen.plan.clear_fixtures import find_blocked
from camgen.plan.starting import move_start

#: Fractions of the requested length that are tried, the longest first.
_SCALES = (1.0, 0.5, 0.25)
#: Points of a lead at which distances are measured.
_LEAD_SAMPLES = 65
#: Other starts of a closed path that are tried: the middles of its longest segments.
_MAX_OTHER_STARTS = 16


class _Lead(Struct, frozen=True, eq=False):
    """A lead-in or lead-out.

    path: path of one segment.
    samples: (M, 2) points along it, mm.
    """

    path: ToolPath
    samples: FloatArray


def add_leads(
    paths: Sequence[ToolPath], part: Part, job: Job, fixtures: Fixtures | None = None
) -> tuple[list[ToolPath], list[Note]]:
    """The paths with the leads and the overlap of `job`, and notes on short and missing leads.

    fixtures: fixtures of a mill, from which leads keep clear too.
    """
    operation = job.operation
    if not (operation.lead_in or operation.lead_out or operation.overlap):
        return list(paths), []
    drawn = make_contour_segments(part.contours)
    obstacles = Obstacles(drawn, np.zeros(len(drawn), dtype=np.int64))
    lowest = min((-max(path.depths) for path in paths), default=0.0)
    blocked = find_blocked(job.tool, lowest, fixtures)
    result: list[ToolPath] = []
    short: list[ToolPath] = []
    without: list[ToolPath] = []
    for path in paths:
        # Only a path beside a contour has a free side for a lead.
        followed = bool(path.force_direction[:, :, :2].any())
        led, scale = _with_leads(path, job, obstacles, blocked) if followed else (path, 1.0)
        result.append(led)
        if scale < 1.0:
            (short if scale else without).append(path)
    all_bodies = "the part and the fixtures" if fixtures else "the part"
    near = f"the part{', a fixture' if fixtures else ''} or a neighbour is too near"
    nowhere = f"there is no place where it would keep clear of {all_bodies}"
    notes = [
        *_note_leads(short, "with a shorter lead", near),
        *_note_leads(without, "without a lead", nowhere),
    ]
    return result, notes


def _note_leads(paths: Sequence[ToolPath], how: str, why: str) -> Iterator[Note]:
    if paths:
        ids = tuple(chain.from_iterable(path.contours for path in paths))
        what = f"{counted(len(paths), 'path')} {how}: {name_first(list_ids(paths))}"
        yield Note("warning", what, why, ids, lacks="leads")


def _with_leads(
    path: ToolPath, job: Job, obstacles: Obstacles, blocked: Any
) -> tuple[ToolPath, float]:
    """The path with the longest leads that fit, and their fraction of the requested length.

    blocked: area in which the tool axis would come too near to a fixture.
    """
    operation, feed = job.operation, job.process.feed
    ends = ((operation.lead_in, -1), (operation.lead_out, 1))
    for scale in _SCALES:
        for start in _list_starts(path):
            overlapped = _add_overlap(start, operation.overlap)
            leads = [
                _make_lead(overlapped, length * scale, side, path.closed, feed)
                for length, side in ends
            ]
            if all(
                lead is None or _is_clear(lead, obstacles, job.tool.diameter / 2, blocked)
                for lead in leads
            ):
                before, after = ([] if lead is None else [lead.path] for lead in leads)
                pieces = [*before, overlapped, *after]
                return (join_paths(pieces) if len(pieces) > 1 else overlapped), scale
    return _add_overlap(path, operation.overlap), 0.0


def _list_starts(path: ToolPath) -> list[ToolPath]:
    """The path, and a closed one that is not pinned also started in its longest segments."""
    if not path.closed or path.pinned:
        return [path]
    longest = np.argsort(-measure_spans(path.position, path.via[1:]), kind="stable")[
        :_MAX_OTHER_STARTS
    ]
    return [path, *(move_start(path, int(k) + 1, 0.5) for k in longest)]


def _add_overlap(path: ToolPath, overlap: float) -> ToolPath:
    """A closed path that continues for `overlap` mm beyond its start, at most once around."""
    if overlap == 0.0 or not path.closed:
        return path
    ends = np.cumsum(measure_spans(path.position, path.via[1:]))
    if overlap >= ends[-1]:
        return join_paths([path, path])
    row = int(np.searchsorted(ends, overlap, side="right"))
    before = ends[row - 1] if row else 0.0
    restarted = move_start(path, row + 1, float((overlap - before) / (ends[row] - before)))
    # Started there, the path ends with what we want: the stretch from the old start.
    old_start = int(np.argmin(np.abs(restarted.position - path.position[0]).sum(axis=1)))
    return join_paths([path, restarted.rows(old_start, len(restarted.position))])


def _make_lead(path: ToolPath, length: float, side: int, closed: bool, feed: float) -> _Lead | None:
    """The lead-in (side -1) or lead-out (+1); None without a length.

    It is a quarter of a circle for a closed path, and along the tangent of an open one. It is never
    faster than `feed`: a path may be, but only where the tool rolls about an outer corner.
    """
    if length == 0.0:
        return None
    row, end, point = (1, 0, path.position[0]) if side < 0 else (-1, 1, path.position[-1])
    press, axis = path.force_direction[row, end], path.axis[row]
    direction = side * _travel_sign(path) * np.cross(press, axis)
    t = np.linspace(0.0, 1.0, _LEAD_SAMPLES)[:, None]
    if closed:
        radius = length / (np.pi / 2)
        angle = t * np.pi / 2
        points = point + radius * ((np.cos(angle) - 1) * press + np.sin(angle) * direction)
        turned = direction
    else:
        points = point + t * length * direction
        turned = press
    rows = points[[0, -1]][::side]
    middle = points[_LEAD_SAMPLES // 2] if closed else np.full(3, np.nan)
    press_directions = np.array([press, turned])[::side]
    lead = replace(
        path,
        table=make_waypoints(
            rows,
            [np.full(3, np.nan), middle],
            min(path.feed[row], feed),
            axis=axis,
            force_direction=press_directions,
        ),
        closed=False,
    )
    return _Lead(lead, points[:, :2])


def _travel_sign(path: ToolPath) -> float:
    """+1 if press x axis points along the travel, else -1; the same all along a path."""
    ahead = (path.position[1] if np.isnan(path.via[1, 0]) else path.via[1]) - path.position[0]
    return float(np.sign(np.cross(path.force_direction[1, 0], path.axis[0]) @ ahead))


def _is_clear(lead: _Lead, obstacles: Obstacles, radius: float, blocked: Any) -> bool:
    """Whether the tool keeps its radius from all drawn contours, and its axis out of `blocked`."""
    gap = obstacles.nearest(lead.samples, np.zeros(len(lead.samples), dtype=np.int64), radius)
    is_clear = (gap >= radius - CLEARANCE_SLACK_MM) & ~shapely.contains_xy(blocked, lead.samples)
    return bool(is_clear.all())
