"""From a tour over several operations to one program, with a tool change wherever the tool is another one."""

from __future__ import annotations

from itertools import dropwhile, pairwise

from msgspec.structs import replace

from camgen.lower.contours import TourEnds, finish, run_paths, turn_on
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
from camgen.plan.steps import job_of, name_of

#: The beginning of the line of a header that states a tool.
_TOOL = "tool: "


def lower_steps(tour: JobTour, cell: Cell, job: Job, name: str, header: tuple[str, ...]) -> Program:
    """The program of all operations. The spindle rests and the tool is at home where it is changed, and goes from
    operation to operation at the height of travel where it stays.

    cell: whose tool frame holds for every tool where the job says it; else each is as long as its ``length``.
    """
    if not tour.paths:
        raise NoSafeProgram(name, "no path to run")
    if job.cell.flange_from_tool is not None and isinstance(cell.home, Joints):
        _insist_on_one_length(tour)
    draft = Draft()
    tool: ToolTable | None = None
    spindle = 0.0
    before = 0
    # One tool that has no number is in the spindle already.
    first = tour.steps[0].tool
    changes = first.number > 0 or any(step.tool != first for step in tour.steps)
    links = (*tour.links, None)
    tour_ends = [TourEnds(link, after is not None) for link, after in pairwise(links)]
    for step, number, part, ends in zip(
        tour.steps, tour.numbers, tour.tours, tour_ends, strict=True
    ):
        if not part.paths:
            continue
        own = job_of(job, step)
        home = MoveJ(cell.home, step.process.travel_speed)
        other = step.tool != tool
        if before and (other or step.process.spindle != spindle):
            draft.add(*_rest(spindle))
        if other:
            draft.add(*([home] if before else []))
            draft.add(*([_change(step.tool, frame_of(own, cell))] if changes else []))
        draft.add(Comment(name_of(job, number)), *([home] if other else []))
        if other or step.process.spindle != spindle or not spindle:
            draft.add(*turn_on(own, cell))
        tool, spindle = step.tool, step.process.spindle
        run_paths(draft, part, cell, own, before, ends)
        before += len(part.paths)
    draft.add(*_rest(spindle), MoveJ(cell.home, job.process.travel_speed))
    framed = replace(cell, flange_from_tool=frame_of(job_of(job, tour.steps[0]), cell))
    return finish(draft.body(), tour.paths, framed, job, name, header)


def _insist_on_one_length(tour: JobTour) -> None:
    """JobError for tools of several lengths that would all have the one frame that the job gives."""
    if len({step.tool.length for step in tour.steps}) > 1:
        what = "is one frame, and the tools have several lengths"
        raise JobError(
            "job", what, "cell.flange_from_tool", "leave it out: each tool is as long as its length"
        )


def _change(tool: ToolTable, frame: Pose) -> ToolChange:
    return ToolChange(tool.number, tool.name, tool.diameter, tool.length, frame)


def _rest(spindle: float) -> list[Instruction]:
    return [Output("spindle", 0.0)] if spindle else []


def frame_of(job: Job, cell: Cell) -> Pose:
    """The frame of the tool of ``job`` at the flange."""
    return (
        cell.flange_from_tool
        if job.cell.flange_from_tool is not None
        else translation(0.0, 0.0, job.tool.length)
    )


def _is_off(item: Instruction) -> bool:
    return (isinstance(item, Output) and item.value == 0) or (
        isinstance(item, Force) and item.newtons == 0
    )


def tell_tool(name: str, diameter: float, frame: Pose) -> str:
    """The line of a header that states a tool."""
    named = f"{name} - " if name else ""
    return f"{_TOOL}{named}diameter {short(diameter, 3)} mm - frame {format_frame(frame)}"


def _head(program: Program, change: ToolChange, frame: Pose, place: str) -> tuple[str, ...]:
    """The header of the program of one tool: without the lines of other tools.

    place: the place of the program among all programs.
    """
    tool = tell_tool(change.name, change.diameter, frame)
    lines = [line for line in program.header if line == tool or not line.startswith(_TOOL)]
    return (*lines, place)


def split_tools(program: Program) -> tuple[Program, ...]:
    """A program a tool, to be run one after the other: for controllers whose programs change none.

    They are called ``NAME_1`` and on, and have the frame of their tool. One without a tool change is what it was.
    """
    changes = [k for k, item in enumerate(program.body) if isinstance(item, ToolChange)]
    if not changes:
        return (program,)
    programs = []
    for k, (start, end) in enumerate(
        zip(changes, [*changes[1:], len(program.body)], strict=True), start=1
    ):
        change = program.body[start]
        assert isinstance(change, ToolChange)
        body = switch_off_first(tuple(dropwhile(_is_off, program.body[start + 1 : end])))
        frame = change.flange_from_tool or program.flange_from_tool
        header = _head(program, change, frame, f"program {k} of {len(changes)}")
        own = replace(program, body=body, flange_from_tool=frame, header=header)
        programs.append(own if len(changes) == 1 else replace(own, name=f"{program.name}_{k}"))
    return tuple(programs)
