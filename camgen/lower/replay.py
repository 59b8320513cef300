"""A recorded program for another machine, from the home position of that machine and back.

A rapid motion becomes travel at ``process.travel`` along the straight line. It stays a rapid
motion if the axes of the machine are the coordinates. Feeds are those of the program. Corners are
rounded within ``tolerance.corner``, unless the program asks for an exact path (G61, G61.1).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import takewhile

import numpy as np
from msgspec.structs import replace

from camgen.geometry.arcs import make_span_chain
from camgen.lower.contours import finish_program
from camgen.lower.steps import frame_of
from camgen.model.cell import Cell, Dynamics
from camgen.model.job import Job
from camgen.model.pose import TOOL_DOWN, FloatArray, Pose
from camgen.model.program import (
    Columns,
    Force,
    Instruction,
    MoveC,
    MoveJ,
    MoveL,
    Output,
    Program,
    ToolChange,
)
from camgen.model.program import motions as list_motions
from camgen.model.tolerance import SAME_POINT_MM
from camgen.motion.corners import blend_corners, compute_corner_tolerance
from camgen.order import ReplayTour
from camgen.plan.replay import drop_still_motions, find_owners
from camgen.plan.taught import find_stretches
from camgen.plan.tool_parts import ToolPart

#: Kinds of tools that turn. They are switched on above the part, the others on it.
_TURNING = ("end mill", "ball mill", "bull nose", "drill", "v")


def lower_replay(
    tour: ReplayTour, cell: Cell, job: Job, name: str = "part", header: tuple[str, ...] = ()
) -> Program:
    """The program of the machine in the cell, with the frames and the home of the cell.

    With each tool it approaches the first position from the clearance height and leaves the last
    one upwards. Tools are changed at home, with all outputs off. An output that was on before the
    change is switched on again at the first position after it.

    name: name of the program.
    header: lines of its header.
    """
    home = MoveJ(cell.home, job.process.travel_speed)
    out: list[Instruction] = []
    before = 0
    for k, part in enumerate(tour.parts):
        on = _find_on(out)
        if k:
            out += [*_switch_off(on), home]
        if part.tool is not None:
            out.append(_make_tool_change(part, job, cell))
        body = [*on, *drop_still_motions(part.body)]
        out.append(home)
        out += _run_tool(body, part, before, cell, job)
        before += 1 + max(find_owners(Columns(body)))
    out += [*_switch_off_rest(out), home]
    if tour.parts[0].tool is not None:
        change = _make_tool_change(tour.parts[0], job, cell)
        cell = replace(cell, flange_from_tool=change.flange_from_tool)
    return finish_program(out, tour.paths, cell, job, name, header)


def _make_tool_change(part: ToolPart, job: Job, cell: Cell) -> ToolChange:
    """The change to a tool; for a tool that only the machine knows it has the number alone."""
    tool = part.tool
    assert tool is not None
    if not part.known:
        return ToolChange(tool.number, tool.name, flange_from_tool=cell.flange_from_tool)
    return ToolChange(
        tool.number, tool.name, tool.diameter, tool.length, frame_of(replace(job, tool=tool), cell)
    )


def _find_on(body: Sequence[Instruction]) -> list[Output]:
    """The outputs that are on after these instructions, with their last values."""
    last = {item.signal: item for item in body if isinstance(item, Output)}
    return [item for item in last.values() if item.value]


def _run_tool(
    body: list[Instruction], part: ToolPart, before: int, cell: Cell, job: Job
) -> list[Instruction]:
    """The motions of one tool, from above its first position to above its last.

    body: the instructions of the part, after the outputs that were on before it.
    before: number of paths of the program that come before its own.
    """
    cartesian, travel = isinstance(cell.home, Pose), job.process.travel_speed
    first = next(k for k, item in enumerate(body) if isinstance(item, MoveJ))
    columns = Columns(body)
    owner = np.array(find_owners(columns))
    path, *following = np.where(owner >= 0, owner + before, -1).tolist()
    arrival = _plan_arrival(body[first], cartesian, job, part.entry)  # type: ignore[arg-type]
    motions = [replace(item, path=path) for item in arrival]
    tool = job.tool if part.tool is None else part.tool
    above = 1 if tool.kind in _TURNING else len(motions)
    out = [*_switch_on_after(body[:first], motions[:above]), *motions[above:]]
    blends_and_paths = zip(
        _compute_blends(columns, compute_corner_tolerance(job, "replay"), cell.pace).tolist()[1:],
        following,
        strict=True,
    )
    last: MoveJ | MoveL | MoveC = body[first]  # type: ignore[assignment]
    for item in body[first + 1 :]:
        if not isinstance(item, (MoveJ, MoveL, MoveC)):
            out.append(item)
            continue
        blend, path = next(blends_and_paths)
        last = item
        if isinstance(item, MoveJ):
            rapid = _make_rapid(item.target, cartesian, travel)  # type: ignore[arg-type]
            out.append(replace(rapid, path=path))
        elif isinstance(item, MoveL):
            out.append(MoveL(item.target, item.speed, blend, path=path, work=True))
        else:
            out.append(MoveC(item.via, item.target, item.speed, blend, path=path, work=True))
    out += _plan_departure(last.target, cartesian, job)  # type: ignore[arg-type]
    return out


def lower_taught(
    tour: ReplayTour, cell: Cell, job: Job, name: str = "part", header: tuple[str, ...] = ()
) -> Program:
    """The program of a robot for the machine in the cell: from home to the first motion, then as it
    is.

    Outputs that it leaves on are switched off at its end.
    """
    body = tour.run.body
    motion_at = dict(list_motions(body))
    moves = list(motion_at.values())
    last = [high for _, high in find_stretches(moves)]
    owner = np.append(np.arange(len(last)), -1)[
        np.searchsorted(last, np.arange(len(moves)), side="right")
    ]
    following = iter(zip(moves, owner.tolist(), strict=True))
    first = next(iter(motion_at), 0)
    ordered = [*_switch_on_after(body[:first], body[first : first + 1]), *body[first + 1 :]]
    first_outputs = list(takewhile(_is_off, ordered))
    out: list[Instruction] = [*first_outputs, MoveJ(cell.home, job.process.travel_speed)]
    for item in ordered[len(first_outputs) :]:
        if isinstance(item, MoveJ | MoveL | MoveC):
            _, path = next(following)
            out.append(replace(item, path=path, work=path >= 0 and not isinstance(item, MoveJ)))
        else:
            out.append(item)
    return finish_program([*out, *_switch_off_rest(out)], tour.paths, cell, job, name, header)


def _switch_on_after(
    leading: Sequence[Instruction], motions: Sequence[Instruction]
) -> list[Instruction]:
    """Instructions before the first place and the motions to it, in the order in which they run.

    The first output that is switched on waits for the motions, and so does each instruction after
    it: the position of the tool before the first motion is unknown.
    """
    before_first_on = list(takewhile(lambda item: not _is_on(item), leading))
    return [*before_first_on, *motions, *leading[len(before_first_on) :]]


def _is_on(item: Instruction) -> bool:
    return isinstance(item, Output) and item.value != 0


def _is_off(item: Instruction) -> bool:
    return isinstance(item, Output) and item.value == 0


def _switch_off(outputs: Sequence[Output]) -> list[Output]:
    return [Output(output.signal, 0.0) for output in outputs]


def _switch_off_rest(body: list[Instruction]) -> list[Instruction]:
    """Instructions that switch off what a program leaves on, as its own machine did at the end."""
    rest: list[Instruction] = [*_switch_off(_find_on(body))]
    if next((item.newtons for item in reversed(body) if isinstance(item, Force)), 0.0):
        rest.append(Force(0.0))
    return rest


def _make_rapid(target: Pose, cartesian: bool, speed: float) -> MoveJ | MoveL:
    return MoveJ(target, speed) if cartesian else MoveL(target, speed)


def _plan_arrival(first: MoveJ, cartesian: bool, job: Job, entry: float) -> list[MoveJ | MoveL]:
    """Motions from home to the start of the program.

    entry: feed of the last plunge, mm/s, if the start was assumed; otherwise 0.
    """
    x, y, z = first.target.origin  # type: ignore[union-attr]  # recorded in poses
    speed, high = job.process.travel_speed, job.process.clearance
    arrival: list[MoveJ | MoveL] = [MoveJ(Pose(TOOL_DOWN, (x, y, max(z, high))), speed)]
    if z < high - SAME_POINT_MM:
        down = Pose(TOOL_DOWN, (x, y, z))
        arrival.append(
            MoveL(down, min(entry, speed)) if entry else _make_rapid(down, cartesian, speed)
        )
    return arrival


def _plan_departure(last: Pose, cartesian: bool, job: Job) -> list[Instruction]:
    x, y, z = last.origin
    high = job.process.clearance
    if z >= high - SAME_POINT_MM:
        return []
    return [_make_rapid(Pose(TOOL_DOWN, (x, y, high)), cartesian, job.process.travel_speed)]


def _compute_blends(columns: Columns, tolerance: float, pace: Dynamics) -> FloatArray:
    """Blend radius (M,) at the end of each motion, mm, as `columns.compute_blends`.

    It is 0 unless both motions are at feed, nothing is switched between them, and the program
    allows it by a recorded blend above 0.
    """
    ends, vias = columns.ends, columns.vias
    blend = np.zeros(len(ends))
    if len(ends) < 3:
        return blend
    rounded = blend_corners(make_span_chain(ends, vias[1:]), columns.speed[1:], tolerance, pace)
    working = ~columns.moves_are(MoveJ)
    allowed = (
        working[1:-1] & working[2:] & (columns.blend[1:-1] > 0) & (np.diff(columns.at)[1:] == 1)
    )
    blend[1:-1] = np.where(allowed, rounded, 0.0)
    return blend
