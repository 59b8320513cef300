"""Run-in, run-out and overlap of followed contours: a pass over the tour, when it is known where
each path starts.

A closed path is entered on a quarter of a circle from the free side and left on another, an open
one along its own tangent. A lead is used only where the tool keeps its distance from everything
drawn; otherwise a shorter one is tried, then another place of a closed path, then none, with a
note.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain
from typing import Any

import numpy as np
import shapely
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.arcs import measure_spans
from camgen.geometry.fixtures import Fixtures
from camgen.geometry.intersect import Obstacles
from camgen.geometry.segments import from_contours
from camgen.model.job import Job
from camgen.model.part import Note, Part
from camgen.model.path import ToolPath, join_paths, waypoints
from camgen.model.pose import FloatArray
from camgen.model.text import counted, name_first
from camgen.order.stay_down import CLEARANCE_SLACK_MM
from camgen.plan.clear_fixtures import find_blocked
from camgen.plan.starting import starting_at

#: What is tried of the length asked for, the longest first.
_SCALES = (1.0, 0.5, 0.25)
#: Points of a lead that are measured.
_LEAD_SAMPLES = 65
#: Other places of a closed path at which a lead is tried: the middles of its longest segments.
_PLACES = 16


class _Lead(Struct, frozen=True, eq=False):
    """A run-in or run-out. path: of one segment. samples: (M, 2) points along it."""

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
    drawn = from_contours(part.contours)
    obstacles = Obstacles(drawn, np.zeros(len(drawn), dtype=np.int64))
    lowest = min((-max(path.depths) for path in paths), default=0.0)
    blocked = find_blocked(job.tool, lowest, fixtures)
    result: list[ToolPath] = []
    short: list[ToolPath] = []
    without: list[ToolPath] = []
    for path in paths:
        # Only what runs beside a contour has a free side to lead in from.
        followed = bool(path.force_direction[:, :, :2].any())
        led, scale = _with_leads(path, job, obstacles, blocked) if followed else (path, 1.0)
        result.append(led)
        if scale < 1.0:
            (short if scale else without).append(path)
    all_bodies = "the part and the fixtures" if fixtures else "the part"
    near = f"the part{', a fixture' if fixtures else ''} or a neighbour is too near"
    nowhere = f"there is no place where it would keep clear of {all_bodies}"
    notes = []
    for shorter, how, why in (
        (short, "with a shorter lead", near),
        (without, "without a lead", nowhere),
    ):
        if shorter:
            notes.append(_tell(shorter, how, why))
    return result, notes


def _tell(paths: Sequence[ToolPath], how: str, why: str) -> Note:
    ids = tuple(chain.from_iterable(path.contours for path in paths))
    names = name_first([path.id for path in paths])
    return Note("warning", f"{counted(len(paths), 'path')} {how}: {names}", why, ids, lacks="leads")


def _with_leads(
    path: ToolPath, job: Job, obstacles: Obstacles, blocked: Any
) -> tuple[ToolPath, float]:
    """The path with the longest leads that fit, and what part of the wanted length that is.

    blocked: area in which the tool's axis must not be for a fixture.
    """
    operation, feed = job.operation, job.process.feed
    ends = ((operation.lead_in, -1), (operation.lead_out, 1))
    for scale in _SCALES:
        for start in _starts(path):
            run = _overlap(start, operation.overlap)
            leads = [_lead(run, length * scale, way, path.closed, feed) for length, way in ends]
            if all(
                lead is None
                or (_is_clear(lead, obstacles, job.tool.diameter / 2) and _is_off(lead, blocked))
                for lead in leads
            ):
                before, after = ([] if lead is None else [lead.path] for lead in leads)
                pieces = [*before, run, *after]
                return (join_paths(pieces) if len(pieces) > 1 else run), scale
    return _overlap(path, operation.overlap), 0.0


def _is_off(lead: _Lead, blocked: Any) -> bool:
    """Whether a lead keeps out of an area."""
    return not shapely.contains_xy(blocked, lead.samples).any()


def _starts(path: ToolPath) -> list[ToolPath]:
    """The path as it starts now, and a closed one that is not pinned there in the middle of its longer segments."""
    if not path.closed or path.pinned:
        return [path]
    longest = np.argsort(-measure_spans(path.position, path.via[1:]), kind="stable")[:_PLACES]
    return [path, *(starting_at(path, int(k) + 1, 0.5) for k in longest)]


def _overlap(path: ToolPath, overlap: float) -> ToolPath:
    """A closed path that runs on for ``overlap`` mm beyond its start, at most once round."""
    if overlap == 0.0 or not path.closed:
        return path
    ends = np.cumsum(measure_spans(path.position, path.via[1:]))
    if overlap >= ends[-1]:
        return join_paths([path, path])
    k = int(np.searchsorted(ends, overlap, side="right"))
    done = ends[k - 1] if k else 0.0
    cut = starting_at(path, k + 1, float((overlap - done) / (ends[k] - done)))
    # Started there, the path ends with what we want: the stretch from the old start.
    old = int(np.argmin(np.abs(cut.position - path.position[0]).sum(axis=1)))
    return join_paths([path, cut.rows(old, len(cut.position))])


def _lead(path: ToolPath, length: float, way: int, ring: bool, feed: float) -> _Lead | None:
    """The run-in (way -1) or run-out (+1): a quarter of a circle to a ring, along its tangent to an
    open path.

    It never runs faster than ``feed``: a path may, but only where the tool rolls about an outer
    corner.
    """
    if length == 0.0:
        return None
    row, end, at = (1, 0, path.position[0]) if way < 0 else (-1, 1, path.position[-1])
    press, axis = path.force_direction[row, end], path.axis[row]
    away = way * _travel_sign(path) * np.cross(press, axis)
    t = np.linspace(0.0, 1.0, _LEAD_SAMPLES)[:, None]
    if ring:
        size = length / (np.pi / 2)
        angle = t * np.pi / 2
        points = at + size * ((np.cos(angle) - 1) * press + np.sin(angle) * away)
        turned = away
    else:
        points = at + t * length * away
        turned = press
    rows = points[[0, -1]][::way]
    middle = points[_LEAD_SAMPLES // 2] if ring else np.full(3, np.nan)
    presses = np.array([press, turned])[::way]
    lead = replace(
        path,
        table=waypoints(
            rows,
            [np.full(3, np.nan), middle],
            min(path.feed[row], feed),
            axis=axis,
            force_direction=presses,
        ),
        closed=False,
    )
    return _Lead(lead, points[:, :2])


def _travel_sign(path: ToolPath) -> float:
    """+1 where press x axis points along the travel, else -1; the same all along a path beside a contour."""
    ahead = (path.position[1] if np.isnan(path.via[1, 0]) else path.via[1]) - path.position[0]
    return float(np.sign(np.cross(path.force_direction[1, 0], path.axis[0]) @ ahead))


def _is_clear(lead: _Lead, obstacles: Obstacles, radius: float) -> bool:
    """Whether the tool keeps its radius from everything drawn all along the lead."""
    gap = obstacles.nearest(lead.samples, np.zeros(len(lead.samples), dtype=np.int64), radius)
    return bool((gap >= radius - CLEARANCE_SLACK_MM).all())
