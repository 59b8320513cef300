"""Bores circles larger than the tool: down on a helix, one turn at the bottom, back to the middle.

In a circle as wide as the tool the tool goes straight down, if it cuts over its centre. In a
larger one the centre of the tool runs at the radius of the circle less that of the tool. With
`operation.finish` the helix leaves that allowance at the wall, and a last circle at the full depth
takes it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from camgen.geometry.ragged import concatenate_columns
from camgen.model.errors import InputError
from camgen.model.job import Job
from camgen.model.part import Note, Part
from camgen.model.path import ToolPath, make_waypoints
from camgen.model.pose import FloatArray
from camgen.model.text import counted, short
from camgen.plan.beside import NO_HELIX
from camgen.plan.columns import SLOWEST, plunge_path
from camgen.plan.drill import (
    Hole,
    find_circles,
    note_left_holes,
    read_diameters,
    select_innermost,
)
from camgen.plan.unused import check_rules

#: Largest difference of two diameters that count as equal, mm.
_SAME_MM = 0.01
#: Minimum number of chords of one turn of the helix, so that the tool goes down evenly.
_MIN_CHORDS = 12


def bore(part: Part, job: Job) -> tuple[tuple[ToolPath, ...], tuple[Note, ...]]:
    """Plan a path for every worked circle that the tool can bore, with notes on the others.

    Raises InputError without any circle, and JobError for settings that do not suit a bore.
    """
    check_rules(
        [
            (
                job.process.force != 0,
                "a bore goes to a depth, not to a force",
                "process.force",
                "set process.force to 0",
            ),
            (
                job.tool.kind in ("drill", "v"),
                f'a tool of kind "{job.tool.kind}" cuts no straight wall',
                "tool.kind",
                "choose a mill",
            ),
        ]
    )
    smallest, largest = limits = read_diameters(job)
    circles = list(find_circles(part))
    in_range = [hole for hole in circles if smallest <= hole.diameter <= largest]
    if not in_range:
        what = f"no circle to bore among {len(circles)} found" if circles else "no circle to bore"
        raise InputError(
            part.source,
            what,
            remedy="camgen inspect shows what the file holds; see operation.holes",
        )
    chosen = select_innermost(in_range)
    notes = [*_note_others(part, len(circles), len(in_range), len(chosen), limits)]
    narrow, same, wide, full, good = _sort_by_width(chosen, job)
    tool = f"{short(job.tool.diameter, 3)} mm"
    core = f"a core would stay in the middle; use a pocket, or a tool over {tool}"
    remedies = (
        (narrow, "smaller than the tool", f"the tool is {tool}; drill them"),
        ([] if job.tool.center_cutting else same, "as wide as the tool", NO_HELIX),
        (wide, "too wide", core),
        (full, "without room for a helix", "operation.finish leaves none; leave less at the wall"),
    )
    notes += [note_left_holes(holes, f"bored, {how}", why) for holes, how, why in remedies if holes]
    paths = [_make_path(hole, job) for hole in good]
    if job.tool.center_cutting:
        for hole in same:
            paths.append(
                plunge_path(hole.id, hole.layer, (hole.x, hole.y), job, "bore", hole.contours)
            )
    return tuple(paths), tuple(notes)


def _sort_by_width(holes: Sequence[Hole], job: Job) -> tuple[list[Hole], ...]:
    """Sort holes into five lists.

    Smaller than the tool, as wide as the tool, so wide that a core would stay, too narrow for a
    helix beside the allowance of `operation.finish`, and good ones.
    """
    lists: tuple[list[Hole], ...] = ([], [], [], [], [])
    for hole in holes:
        radius = (hole.diameter - job.tool.diameter) / 2
        helix_radius = radius - job.operation.finish
        tests = (
            radius < -_SAME_MM / 2,
            radius <= _SAME_MM / 2,
            helix_radius > job.tool.radius,
            helix_radius <= _SAME_MM / 2,
            True,
        )
        lists[tests.index(True)].append(hole)
    return lists


def _note_others(
    part: Part, circles: int, in_range: int, chosen: int, limits: tuple[float, float]
) -> Iterator[Note]:
    """Notes on contours that are not circles, and on circles that are not chosen.

    circles, in_range, chosen: number of all circles, of those in the range of diameters, and of
        those of them without a smaller one around the same centre.
    limits: smallest and largest diameter, mm.
    """
    others = len(part.list_worked_rows()) - circles
    if others:
        what = counted(others, "contour is not a circle and is", "contours are not circles and are")
        yield Note("assumed", f"{what} not bored")
    if in_range < circles:
        what = counted(
            circles - in_range, "circle of another diameter", "circles of other diameters"
        )
        why = f"operation.holes is {short(limits[0], 3)} to {short(limits[1], 3)} mm"
        yield Note("assumed", f"{what} not bored", why)
    if chosen < in_range:
        what = counted(
            in_range - chosen, "circle around a smaller one", "circles around smaller ones"
        )
        why = "the smallest of a centre is; see operation.holes"
        yield Note("assumed", f"{what} not bored", why)


def _make_path(hole: Hole, job: Job) -> ToolPath:
    """Down on the helix, one turn at the bottom, a finishing turn if requested, to the middle."""
    depth, radius = job.operation.depth, (hole.diameter - job.tool.diameter) / 2
    helix_radius = radius - job.operation.finish
    sense = -1.0 if job.operation.direction == "conventional" else 1.0
    helix = _make_helix(helix_radius, depth, sense, job)
    ends, vias = _make_circle(helix_radius, -depth, sense)
    # The helix ends at the start of the circle at the bottom.
    columns = [(helix, np.full_like(helix, np.nan)), (ends[1:], vias[1:])]
    if job.operation.finish:
        columns.append(_make_circle(radius, -depth, sense))
    columns.append((np.array([[0.0, 0.0, -depth]]), np.full((1, 3), np.nan)))
    position, via = concatenate_columns(columns)
    centre = np.array([hole.x, hole.y, 0.0])
    # The feed holds at the wall; the centre of the tool runs on a smaller circle.
    centre_radius = np.hypot(*position[:, :2].T)
    fraction = np.maximum(centre_radius / (centre_radius + job.tool.radius), SLOWEST)
    fraction[-1] = 1.0
    return ToolPath(
        id=hole.id,
        layer=hole.layer,
        table=make_waypoints(
            position=position + centre,
            via=via + centre,
            feed=job.process.feed * fraction,
        ),
        closed=False,
        reversible=False,
        contours=hole.contours,
        operation="bore",
    )


def _make_helix(radius: float, depth: float, sense: float, job: Job) -> FloatArray:
    """(N, 3) points from the top face to the depth, in whole turns of one pitch.

    The pitch is limited by `entry_angle`, and by the depth of a pass if there are several.
    """
    pitch = 2 * math.pi * radius * math.tan(math.radians(job.operation.entry_angle))
    if job.operation.passes > 1 and depth:
        pitch = min(pitch, depth / job.operation.passes)
    turns = math.ceil(depth / pitch - 1e-9) if depth else 0
    step = 2 * math.acos(max(1 - job.tolerance.chord / radius, -0.5))
    chords = max(_MIN_CHORDS, math.ceil(2 * math.pi / step))
    place = np.arange(turns * chords + 1)
    angle = sense * 2 * math.pi * place / chords
    z = -depth * place / max(turns * chords, 1)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), z])


def _make_circle(radius: float, z: float, sense: float) -> tuple[FloatArray, FloatArray]:
    ends = np.array([[radius, 0.0, z], [-radius, 0.0, z], [radius, 0.0, z]])
    return ends, np.array([[np.nan] * 3, [0.0, sense * radius, z], [0.0, -sense * radius, z]])
