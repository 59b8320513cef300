"""Checks, prints and reads back the programs of a build.

A build makes one program, or one for each tool if the controller cannot change tools.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.check import Checks, check
from camgen.check.harm import find_harm
from camgen.check.report import Cycle, Motions, sum_up
from camgen.check.time import compute_cycle
from camgen.lang.programs import Executed
from camgen.lower.runs import plunge
from camgen.lower.steps import split_tools
from camgen.model.errors import Blocked, JobError
from camgen.model.job import Job, ProcessTable, ToolTable
from camgen.model.part import IntArray, Note
from camgen.model.path import Tour
from camgen.model.pose import Pose, format_frame
from camgen.model.program import Comment, Instruction, Program, ToolChange, switch_off_first
from camgen.model.signature import sign
from camgen.model.text import counted
from camgen.motion.corners import Flow
from camgen.order import ArmTour, JobTour, ReplayTour
from camgen.pipeline.memory import release_memory
from camgen.plan import Watch
from camgen.post import OutputFile, Post, Tolerance
from camgen.post.contract import prepare_program, render_program
from camgen.post.limits import limit_tolerance
from camgen.post.plugins import Readback, make_post
from camgen.post.verify import Deviation, compare
from camgen.robots.workcell import Workcell

if TYPE_CHECKING:
    from camgen.collision.cell import CellScene


#: Maximum number of lines of a text with their own note.
_HARM_NOTES = 5


class Request(Struct, frozen=True, eq=False):
    """The program that a build has to make.

    job: settings of the build.
    cell: cell in which the program runs.
    post: post that prints it.
    title: name of the program.
    header: remarks at its beginning.
    strict: whether anything left out is an error.
    watch: called with the name of each stage.
    """

    job: Job
    cell: Workcell
    post: Post
    title: str
    header: tuple[str, ...]
    strict: bool
    watch: Watch


class CheckedPrograms(Struct, frozen=True, eq=False):
    """Programs that have passed the checks.

    programs: programs as their texts will be, each with its post.
    whole: results of the checks, of all programs one after the other with their tool changes.
    motions: sums of `whole`.
    cycle: time of `whole`. It is computed before there is a text, which takes much memory.
    """

    programs: tuple[tuple[Post, Program], ...]
    whole: Checks
    motions: Motions
    cycle: Cycle


class PostedText(Struct, frozen=True, eq=False):
    """The text of one program. The comparison has shown that its instructions are those of the
    program except its comments, one by one.

    post, program: the program with its post.
    files: the files of the text.
    executed: the strict run of the text.
    """

    post: Post
    program: Program
    files: tuple[OutputFile, ...]
    executed: Executed

    @property
    def name(self) -> str:
        """The name of its first file."""
        return self.files[0].name


class PostedPrograms(Struct, frozen=True, eq=False):
    """The texts of all programs.

    texts: the texts in the order of the programs.
    deviation: largest deviation of a text from its program.
    tolerance: tolerance with which the texts were compared.
    """

    texts: tuple[PostedText, ...]
    deviation: Deviation
    tolerance: Tolerance


def check_programs(
    lowered: Program, tour: Tour, request: Request, where: CellScene | None, source: str
) -> CheckedPrograms:
    """Replace the instructions that the controller does not have, and check the programs.

    where: bodies of a 3-D part for the collision tests; None for other parts.
    source: name of the input, for messages.

    Raises Refused for an instruction that the controller cannot run in any form, and Blocked if the
    arm cannot run a motion. The error of several programs holds the losses of all.
    """
    post, job, cell = request.post, request.job, request.cell
    whole_program = post.changes_tools or not lowered.columns.are(ToolChange).any()
    parts = (lowered,) if whole_program else split_tools(lowered)
    tools = _list_tools(tour)
    if tools:
        job = replace(job, tool=tools[0])  # the check of one program uses its holder
    flow = _make_flow(tour, job)
    posts = [post] if whole_program else _make_posts(post, tools, parts, job)
    if len(parts) == 1:
        program = prepare_program(posts[0], parts[0], job.tolerance.chord)
        release_memory()
        whole = check(program, job, cell, where, source, flow)
        return _add_up(((posts[0], whole.program),), whole, request)
    programs: list[tuple[Post, Program]] = []
    results: list[Checks] = []
    blocked: list[Blocked] = []
    for part, tool, part_post in zip(parts, tools, posts, strict=True):
        try:
            prepared = prepare_program(part_post, part, job.tolerance.chord)
            checks = check(prepared, replace(job, tool=tool), cell, where, source, flow)
            programs.append((part_post, checks.program))
            results.append(checks)
        except Blocked as error:
            blocked.append(error)
    if blocked:
        first = blocked[0]
        losses = itertools.chain.from_iterable(error.lost for error in blocked)
        raise Blocked(first.file, first.what, first.where, first.remedy, tuple(losses))
    return _add_up(tuple(programs), _join_checks(lowered, results), request)


def _make_posts(
    post: Post, tools: Sequence[ToolTable], programs: Sequence[Program], job: Job
) -> list[Post]:
    """One post for each program, which selects the controller's tool of that program.

    Raises JobError if two tools with different frames have the same number or name there.
    """
    posts: list[Post] = []
    frames: dict[str, tuple[str, Pose]] = {}
    for tool, program in zip(tools, programs, strict=True):
        options: dict[str, Any] = {}
        if "tool" not in job.post:
            options |= post.name_tool(tool.number, tool.name)
        if len(programs) > 1:
            # A name in the options would be that of all programs.
            options["program"] = ""
        tool_post = dataclasses.replace(post, **options)
        posts.append(tool_post)
        held, frame = tool_post.held_tool(), program.flange_from_tool
        name, first_frame = frames.setdefault(held, (tool.name or "a tool", frame))
        if held and format_frame(first_frame) != format_frame(frame):
            what = (
                f"{held} of the controller has two frames: {format_frame(first_frame)} for {name}, "
                f"{format_frame(frame)} for {tool.name or 'another tool'}"
            )
            raise JobError(
                "job",
                what,
                "[[tools]]",
                "give each tool its own number and name, and leave out post.tool",
            )
    return posts


def _add_up(
    programs: tuple[tuple[Post, Program], ...], whole: Checks, request: Request
) -> CheckedPrograms:
    time = compute_cycle(whole.program, request.cell.pace, whole.reach, request.cell.arm)
    return CheckedPrograms(programs, whole, sum_up(whole.program.columns), time)


def _make_flow(tour: Tour, job: Job) -> Flow | None:
    """The limits for blends on links; None unless the arm has chosen the links of all tours.

    Motions at a feed get no blend. The blend on a vertical line is at most half of the clearance
    height. No blend takes the TCP below the minimum height of the links.
    """
    runs: list[tuple[Tour, ProcessTable]] = [(tour, job.process)]
    if isinstance(tour, JobTour):
        pairs = zip(tour.tours, tour.steps, strict=True)
        runs = [(step_tour, step.process) for step_tour, step in pairs if step_tour.paths]
    if not all(isinstance(step_tour, ArmTour) for step_tour, _ in runs):
        return None
    processes = [process for _, process in runs]
    highest_feed = max(max(process.feed, plunge(process)) for process in processes)
    max_blend = min(process.clearance for process in processes) / 2
    return Flow(highest_feed, max_blend, max(process.least_height for process in processes))


def _list_tools(tour: Tour) -> list[ToolTable]:
    """The tools in the order in which the program changes to them, empty without a change."""
    if isinstance(tour, ReplayTour):
        return [part.tool for part in tour.parts if part.tool is not None]
    if not isinstance(tour, JobTour):
        return []
    tools: list[ToolTable] = []
    for step, part in zip(tour.steps, tour.tours, strict=True):
        if part.paths and (not tools or tools[-1] != step.tool):
            tools.append(step.tool)
    return tools


def _join_checks(lowered: Program, results: Sequence[Checks]) -> Checks:
    """The results of several programs as those of one program that changes the tool."""
    body: list[Instruction] = []
    starts = []
    for change, checks in zip(lowered.columns.list_kinds(ToolChange), results, strict=True):
        body.append(change)
        starts.append(len(body))
        body += checks.program.body
    program = replace(lowered, body=switch_off_first(body))
    traces = [checks.reach for checks in results if checks.reach is not None]
    reports = [checks.clear for checks in results if checks.clear is not None]
    if not traces:
        return Checks(program)
    from camgen.check.collide import join_reports  # noqa: PLC0415 (as in `camgen.check`)
    from camgen.check.reach import join_traces  # noqa: PLC0415

    inserted = len(program.body) - len(body)
    return Checks(
        program,
        join_traces(program, traces, [start + inserted for start in starts]),
        join_reports(reports),
        results[0].where,
        tuple(itertools.chain.from_iterable(checks.slow for checks in results)),
    )


def find_lines(body: Sequence[Instruction], texts: Sequence[PostedText]) -> IntArray:
    """The line from which each instruction of the whole program was read, shape (N,).

    Lines count from 1 through all files. 0 is for comments, and for tool changes between programs.

    body: the N instructions of the whole program.
    """
    several = len(texts) > 1
    lines = np.zeros(len(body), dtype=np.int64)
    first_row = len(body) - sum(len(text.program.body) + several for text in texts)
    lines_above = 0
    for text in texts:
        first_row += several
        rows = first_row + np.flatnonzero(~text.program.columns.are(Comment))
        lines[rows] = lines_above + np.array(text.executed.lines, dtype=np.int64)
        first_row += len(text.program.body)
        if several:
            for file in text.files:
                lines_above += file.text.count("\n")
    return lines


def _list_changed_options(post: Post, options: dict[str, object]) -> dict[str, object]:
    """The options in which a post differs from one that is made with `options`."""
    reference = make_post(type(post), options)
    changed: dict[str, object] = {}
    for option in dataclasses.fields(post):
        if option.init and not option.name.startswith("_"):
            value = getattr(post, option.name)
            if value != getattr(reference, option.name):
                changed[option.name] = value
    return changed


def print_program(post: Post, program: Program) -> tuple[OutputFile, ...]:
    """The files of a prepared program, with their signatures."""
    return tuple(replace(file, text=sign(file.text)) for file in render_program(post, program))


def post_programs(
    checked: CheckedPrograms, read: Readback, options: dict[str, object], chord: float
) -> PostedPrograms:
    """Print the programs, read the texts back and compare them with the prepared programs.

    read: the read-back of the post.
    options: options of the post, for the read-back.
    chord: `tolerance.chord` of the job, mm.

    Raises VerifyError for the first line that differs from its program.
    """
    shared = dict(options)
    if len(checked.programs) > 1:
        shared.pop("program", None)
    texts, worst = [], Deviation(0.0, 0.0, 0)
    for post, program in checked.programs:
        files = print_program(post, program)
        release_memory()
        changed = _list_changed_options(post, shared)
        executed = read({file.name: file.text for file in files}, shared | changed)
        release_memory()
        tolerance = limit_tolerance(post.tolerance(), chord)
        deviation = compare(program, executed, tolerance, post.list_verified(), files[0].name)
        worst = Deviation(
            max(worst.max_mm, deviation.max_mm),
            max(worst.max_angle, deviation.max_angle),
            worst.instructions + deviation.instructions,
        )
        texts.append(PostedText(post, program, files, executed))
    return PostedPrograms(tuple(texts), worst, tolerance)


def note_harm(texts: Sequence[PostedText]) -> tuple[Note, ...]:
    """Warnings of motions in the texts that may do harm.

    A program that camgen plans has no such motions. An old program is repeated as it is.
    """
    notes: list[Note] = []
    for text in texts:
        harm = find_harm(text.executed)
        for finding in harm[:_HARM_NOTES]:
            notes.append(Note("warning", f"{text.name} line {finding.line}: {finding.what}"))
        if len(harm) > _HARM_NOTES:
            more = f"{text.name}: {counted(len(harm) - _HARM_NOTES, 'other line')} may do harm"
            notes.append(Note("warning", more, "camgen verify lists them"))
    return tuple(notes)
