"""Bores: circles larger than the tool, down on a helix, once round at the bottom, back to the middle and up.

Into a circle as wide as the tool it goes straight down, if it cuts over its centre. Else its centre
runs at the radius of the circle less its own. With ``operation.finish`` the helix leaves that at
the wall, and a last circle at the whole depth takes it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from camgen.model.errors import InputError, JobError
from camgen.model.job import Job
from camgen.model.part import Note, Part
from camgen.model.path import ToolPath, waypoints
from camgen.model.pose import FloatArray
from camgen.model.text import counted, short
from camgen.plan.beside import NO_HELIX
from camgen.plan.columns import SLOWEST, plunge_path
from camgen.plan.drill import Hole, find_circles, read_diameters, select_innermost

#: A circle that differs from the tool by no more than this, mm, is as wide as it.
_SAME_MM = 0.01
#: Chords of one turn at least, so that the tool goes down evenly.
_LEAST_CHORDS = 12
#: Ids that a note names.
_NAMED = 8


def bore(part: Part, job: Job) -> tuple[tuple[ToolPath, ...], tuple[Note, ...]]:
    """A path for every circle worked on that the tool can bore, and notes on the others.

    Raises InputError where there is no circle, JobError for settings that make no sense.
    """
    if job.process.force:
        raise JobError(
            "job",
            "a bore goes to a depth, not to a force",
            "process.force",
            "set process.force to 0",
        )
    if job.tool.kind in ("drill", "v"):
        raise JobError(
            "job",
            f'a tool of kind "{job.tool.kind}" cuts no straight wall',
            "tool.kind",
            "choose a mill",
        )
    lowest, highest = read_diameters(job)
    every = find_circles(part)
    wanted = [hole for hole in every if lowest <= hole.diameter <= highest]
    if not wanted:
        what = f"no circle to bore among {len(every)} found" if every else "no circle to bore"
        raise InputError(
            part.source,
            what,
            remedy="camgen inspect shows what the file holds; see operation.holes",
        )
    chosen = select_innermost(wanted)
    notes = _tell_others(part, len(every), len(wanted), len(chosen), (lowest, highest))
    narrow, same, wide, whole, good = _sort_out(chosen, job)
    tool = job.tool.diameter
    remedies = (
        (narrow, "smaller than the tool", f"the tool is {short(tool, 3)} mm; drill them"),
        ([] if job.tool.center_cutting else same, "as wide as the tool", NO_HELIX),
        (
            wide,
            "too wide",
            f"a core would stay in the middle; use a pocket, or a tool over {short(tool, 3)} mm",
        ),
        (whole, "without room for a helix", "operation.finish leaves none; leave less at the wall"),
    )
    notes += [_not_bored(holes, how, why) for holes, how, why in remedies if holes]
    paths = [_path(hole, job) for hole in good]
    if job.tool.center_cutting:
        for hole in same:
            at = (hole.x, hole.y)
            paths.append(plunge_path(hole.id, hole.layer, at, job, "bore", hole.contours))
    return tuple(paths), tuple(notes)


def _sort_out(holes: Sequence[Hole], job: Job) -> tuple[list[Hole], ...]:
    """The holes in five lists: smaller than the tool, as wide as it, those in which a core would stay, those without
    room beside what is left at the wall, and the good ones.
    """
    sorted_: tuple[list[Hole], ...] = ([], [], [], [], [])
    for hole in holes:
        arm = (hole.diameter - job.tool.diameter) / 2
        helix = arm - job.operation.finish
        tests = (
            arm < -_SAME_MM / 2,
            arm <= _SAME_MM / 2,
            helix > job.tool.radius,
            helix <= _SAME_MM / 2,
        )
        sorted_[tests.index(True) if any(tests) else 4].append(hole)
    return sorted_


def _tell_others(
    part: Part, found: int, wanted: int, chosen: int, asked: tuple[float, float]
) -> list[Note]:
    """Notes on what is none of the circles asked for."""
    notes = []
    other = sum(part.works_on(c.sources or (c.id,)) for c in part.contours) - found
    if other:
        what = counted(other, "contour is no circle and is", "contours are no circles and are")
        notes.append(Note("assumed", f"{what} not bored"))
    if wanted < found:
        what = counted(found - wanted, "circle of another diameter", "circles of other diameters")
        why = f"operation.holes is {short(asked[0], 3)} to {short(asked[1], 3)} mm"
        notes.append(Note("assumed", f"{what} not bored", why))
    if chosen < wanted:
        what = counted(
            wanted - chosen, "circle around a smaller one", "circles around smaller ones"
        )
        notes.append(
            Note("assumed", f"{what} not bored", "the smallest of a centre is; see operation.holes")
        )
    return notes


def _not_bored(holes: Sequence[Hole], how: str, why: str) -> Note:
    ids = tuple(name for hole in holes for name in hole.contours)
    names = ", ".join(f"{hole.id} of {short(hole.diameter, 3)} mm" for hole in holes[:_NAMED])
    more = " ..." if len(holes) > _NAMED else ""
    places = tuple((hole.x, hole.y) for hole in holes)
    return Note(
        "skipped",
        f"{counted(len(holes), 'circle')} not bored, {how}: {names}{more}",
        why,
        ids,
        places,
    )


def _path(hole: Hole, job: Job) -> ToolPath:
    """Down on the helix, once round at the bottom, with a last circle at the wall if asked for, and to the middle."""
    depth, arm = job.operation.depth, (hole.diameter - job.tool.diameter) / 2
    helix = arm - job.operation.finish
    sense = -1.0 if job.operation.direction == "conventional" else 1.0
    down = _helix(helix, depth, sense, job)
    bottom, wall = _round(helix, sense), _round(arm, sense)
    # The helix ends where its circle begins.
    circles = [(bottom[0][1:], bottom[1][1:])] + ([wall] if job.operation.finish else [])
    rows = [down, *(np.column_stack([ends, np.full(len(ends), -depth)]) for ends, _ in circles)]
    position = np.vstack([*rows, [0.0, 0.0, -depth]])
    via = np.full_like(position, np.nan)
    first = len(down)
    for ends, middles in circles:
        via[first : first + len(ends), :2] = middles
        via[first : first + len(ends), 2] = np.where(np.isnan(middles[:, 0]), np.nan, -depth)
        first += len(ends)
    middle = np.array([hole.x, hole.y, 0.0])
    # The feed is that of the edge on the wall; the centre runs on a smaller circle.
    radius = np.hypot(*position[:, :2].T)
    share = np.maximum(radius / (radius + job.tool.radius), SLOWEST)
    share[-1] = 1.0
    return ToolPath(
        id=hole.id,
        layer=hole.layer,
        table=waypoints(
            position=position + middle,
            via=via + middle,
            feed=job.process.feed * share,
        ),
        closed=False,
        reversible=False,
        contours=hole.contours,
        operation="bore",
    )


def _helix(radius: float, depth: float, sense: float, job: Job) -> FloatArray:
    """(N, 3) from the top face to the depth in whole turns of one pitch: that of ``entry_angle`` at most, and with more
    than one of ``passes`` none deeper than those.
    """
    pitch = 2 * math.pi * radius * math.tan(math.radians(job.operation.entry_angle))
    if job.operation.passes > 1 and depth:
        pitch = min(pitch, depth / job.operation.passes)
    turns = math.ceil(depth / pitch - 1e-9) if depth else 0
    step = 2 * math.acos(max(1 - job.tolerance.chord / radius, -0.5))
    chords = max(_LEAST_CHORDS, math.ceil(2 * math.pi / step))
    share = np.arange(turns * chords + 1)
    angle = sense * 2 * math.pi * share / chords
    z = -depth * share / max(turns * chords, 1)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), z])


def _round(radius: float, sense: float) -> tuple[FloatArray, FloatArray]:
    """Ends (3, 2) of a line to the circle's start and two halves of it, and the middles (3, 2) of these."""
    ends = np.array([[radius, 0.0], [-radius, 0.0], [radius, 0.0]])
    return ends, np.array([[np.nan, np.nan], [0.0, sense * radius], [0.0, -sense * radius]])
