"""Makes one program from a tour over several operations, with a tool change for each other tool."""

from __future__ import annotations

from itertools import dropwhile, pairwise

from msgspec.structs import replace

from camgen.lower.contours import TourEnds, add_paths, finish_program, start_spindle
from camgen.lower.draft import Draft
from camgen.model.cell import Cell
from camgen.model.errors import JobError, NoSafeProgram
from camgen.model.job import Job, ToolTable
from camgen.model.pose import Pose, format_frame, translation
from camgen.model.program import (
    Comment,
    Force,
    Instruction,
    Joints,
    MoveJ,
    Output,
    Program,
    ToolChange,
    switch_off_first,
)
from camgen.model.text import short
from camgen.order.tours import JobTour
from camgen.plan.steps import format_step, make_step_job

#: Start of the line of a header that states a tool.
_TOOL = "tool: "


def lower_steps(tour: JobTour, cell: Cell, job: Job, name: str, header: tuple[str, ...]) -> Program:
    """The program of all operations.

    For a tool change the spindle stops and the tool is at home. With the same tool it goes from
    operation to operation at the clearance height.

    cell: its tool frame applies to every tool if the job sets it; otherwise each tool is as long as
        its `length`.
    """
    if not tour.paths:
        raise NoSafeProgram(name, "no path to run")
    if job.cell.flange_from_tool is not None and isinstance(cell.home, Joints):
        _check_lengths(tour)
    draft = Draft()
    tool: ToolTable | None = None
    spindle = 0.0
    before = 0
    # One tool that has no number is in the spindle already.
    first = tour.steps[0].tool
    changes = first.number > 0 or any(step.tool != first for step in tour.steps)
    tour_ends = [TourEnds(link, after is not None) for link, after in pairwise((*tour.links, None))]
    for step, number, part, ends in zip(
        tour.steps, tour.numbers, tour.tours, tour_ends, strict=True
    ):
        if not part.paths:
            continue
        step_job = make_step_job(job, step)
        home = MoveJ(cell.home, step.process.travel_speed)
        changes_tool = step.tool != tool
        if before and (changes_tool or step.process.spindle != spindle):
            draft.add(*_stop_spindle(spindle))
        if changes_tool and before:
            draft.add(home)
        if changes_tool and changes:
            draft.add(_make_tool_change(step.tool, frame_of(step_job, cell)))
        draft.add(Comment(format_step(job, number)))
        if changes_tool:
            draft.add(home)
        if changes_tool or step.process.spindle != spindle or not spindle:
            draft.add(*start_spindle(step_job, cell))
        tool, spindle = step.tool, step.process.spindle
        add_paths(draft, part, cell, step_job, before, ends)
        before += len(part.paths)
    draft.add(*_stop_spindle(spindle), MoveJ(cell.home, job.process.travel_speed))
    framed = replace(cell, flange_from_tool=frame_of(make_step_job(job, tour.steps[0]), cell))
    return finish_program(draft.body(), tour.paths, framed, job, name, header)


def _check_lengths(tour: JobTour) -> None:
    if len({step.tool.length for step in tour.steps}) > 1:
        what = "is one frame, and the tools have several lengths"
        raise JobError(
            "job", what, "cell.flange_from_tool", "leave it out: each tool is as long as its length"
        )


def _make_tool_change(tool: ToolTable, frame: Pose) -> ToolChange:
    return ToolChange(tool.number, tool.name, tool.diameter, tool.length, frame)


def _stop_spindle(spindle: float) -> list[Instruction]:
    return [Output("spindle", 0.0)] if spindle else []


def frame_of(job: Job, cell: Cell) -> Pose:
    """The tool frame of a job at the flange."""
    if job.cell.flange_from_tool is not None:
        return cell.flange_from_tool
    return translation(0.0, 0.0, job.tool.length)


def _is_off(item: Instruction) -> bool:
    return (isinstance(item, Output) and item.value == 0) or (
        isinstance(item, Force) and item.newtons == 0
    )


def format_tool(name: str, diameter: float, frame: Pose) -> str:
    """The line of a header that states a tool."""
    named = f"{name} - " if name else ""
    return f"{_TOOL}{named}diameter {short(diameter, 3)} mm - frame {format_frame(frame)}"


def _make_header(program: Program, change: ToolChange, frame: Pose, place: str) -> tuple[str, ...]:
    """The header of the program of one tool: without the lines of other tools.

    place: text for the place of the program among all programs.
    """
    tool = format_tool(change.name, change.diameter, frame)
    return (*[line for line in program.header if line == tool or not line.startswith(_TOOL)], place)


def split_tools(program: Program) -> tuple[Program, ...]:
    """One program per tool, for controllers whose programs have no tool change.

    They are called `NAME_1`, `NAME_2`, and have the frame of their tool. A program without a tool
    change is returned unchanged.
    """
    changes = [k for k, item in enumerate(program.body) if isinstance(item, ToolChange)]
    if not changes:
        return (program,)
    programs = []
    for k, (start, end) in enumerate(pairwise([*changes, len(program.body)]), start=1):
        change = program.body[start]
        assert isinstance(change, ToolChange)
        body = switch_off_first(tuple(dropwhile(_is_off, program.body[start + 1 : end])))
        frame = change.flange_from_tool or program.flange_from_tool
        header = _make_header(program, change, frame, f"program {k} of {len(changes)}")
        of_tool = replace(program, body=body, flange_from_tool=frame, header=header)
        programs.append(
            of_tool if len(changes) == 1 else replace(of_tool, name=f"{program.name}_{k}")
        )
    return tuple(programs)
