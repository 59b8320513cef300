"""The programs of a build, checked, printed and read back: one, or one a tool where the controller changes none."""

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
from camgen.check.time import cycle
from camgen.lang.programs import Executed
from camgen.lower.runs import plunge
from camgen.lower.steps import split_tools
from camgen.model.errors import Blocked, JobError
from camgen.model.job import Job, ToolTable
from camgen.model.part import IntArray, Note
from camgen.model.path import Tour
from camgen.model.pose import Pose, format_frame
from camgen.model.program import Comment, Instruction, Program, ToolChange, switch_off_first
from camgen.model.signature import sign
from camgen.model.text import counted
from camgen.motion.corners import Flow
from camgen.order import ArmTour, JobTour, ReplayTour
from camgen.pipeline.memory import give_back
from camgen.plan import Watch
from camgen.post import OutputFile, Post, Tolerance
from camgen.post.contract import prepare_program, render_program
from camgen.post.limits import limit_tolerance
from camgen.post.plugins import Readback, make_post
from camgen.post.verify import Deviation, compare
from camgen.robots.workcell import Workcell

if TYPE_CHECKING:
    from camgen.check.collide import Clear
    from camgen.check.reach import Reach
    from camgen.collision.cell import Surroundings


#: Lines of a text with a note of their own, at most.
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


class Checked(Struct, frozen=True, eq=False):
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


class Posted(Struct, frozen=True, eq=False):
    """The texts of all programs, one after the other.

    files: of all programs.
    counts: number of files of each program.
    executed: the strict run of the text of each program.
    deviation: the largest of all, from the programs.
    tolerance: of the texts.
    """

    files: tuple[OutputFile, ...]
    counts: tuple[int, ...]
    executed: tuple[Executed, ...]
    deviation: Deviation
    tolerance: Tolerance


def check_programs(
    lowered: Program, tour: Tour, request: Request, where: Surroundings | None, source: str
) -> Checked:
    """The programs of ``lowered`` in instructions that the controller has, with what the checks of the arm found.

    Refused for an instruction that it has not, Blocked where the arm cannot run one. source: the input, for messages.
    """
    poster, job, cell = request.post, request.job, request.cell
    whole_program = poster.changes_tools or not lowered.columns.are(ToolChange).any()
    parts = (lowered,) if whole_program else split_tools(lowered)
    tools = _tools(tour)
    if tools:
        job = replace(job, tool=tools[0])  # whose holder is there; with several each is told below
    flow = _flow_of(tour, job)
    if not whole_program:
        posters = _name_tools(poster, tools, parts, job)
    if len(parts) == 1:
        own = poster if whole_program else posters[0]
        program = prepare_program(own, parts[0], job.tolerance.chord)
        give_back()
        whole = check(program, job, cell, where, source, flow)
        return _add_up(((own, whole.program),), whole, request)
    found: list[Checks] = []
    blocked: list[Blocked] = []
    for part, tool, own in zip(parts, tools, posters, strict=True):
        try:
            prepared = prepare_program(own, part, job.tolerance.chord)
            found.append(check(prepared, replace(job, tool=tool), cell, where, source, flow))
        except Blocked as error:
            blocked.append(error)
    if blocked:
        # What is lost of the others is told with the first.
        one = blocked[0]
        lost = tuple(loss for error in blocked for loss in error.lost)
        raise Blocked(one.file, one.what, one.where, one.remedy, lost)
    programs = tuple((own, checks.program) for own, checks in zip(posters, found, strict=True))
    return _add_up(programs, _join(lowered, found), request)


def _name_tools(
    post: Post, tools: Sequence[ToolTable], programs: Sequence[Program], job: Job
) -> list[Post]:
    """The posts of the programs, a tool each, with the tool of the controller that each selects.

    Raises JobError for two frames under one number or name that the controller holds.
    """
    posters: list[Post] = []
    frames: dict[str, tuple[str, Pose]] = {}
    for tool, program in zip(tools, programs, strict=True):
        options: dict[str, Any] = {}
        if "tool" not in job.post:
            options |= post.name_tool(tool.number, tool.name)
        if len(programs) > 1:
            # A post prints one program; its name is in what it prints.
            options["program"] = ""
        poster = dataclasses.replace(post, **options)
        posters.append(poster)
        held, frame = poster.held_tool(), program.flange_from_tool
        name, before = frames.setdefault(held, (tool.name or "a tool", frame))
        if held and format_frame(before) != format_frame(frame):
            what = (
                f"{held} of the controller has two frames: {format_frame(before)} for {name}, "
                f"{format_frame(frame)} for {tool.name or 'another tool'}"
            )
            remedy = "give each tool its own number and name, and leave out post.tool"
            raise JobError("job", what, "[[tools]]", remedy)
    return posters


def _add_up(programs: tuple[tuple[Post, Program], ...], whole: Checks, request: Request) -> Checked:
    spent = cycle(whole.program, request.cell.pace, whole.reach, request.cell.arm)
    return Checked(programs, whole, sum_up(whole.program.columns), spent)


def _flow_of(tour: Tour, job: Job) -> Flow | None:
    """What is rounded between the paths where an arm has chosen all its ways: nothing of what is run at a feed, of
    lines the upper half of the height of travel, and nothing that leads the tip lower than the ways may.
    """
    if isinstance(tour, JobTour):
        every = [
            (one, step.process)
            for one, step in zip(tour.tours, tour.steps, strict=True)
            if one.paths
        ]
    else:
        every = [(tour, job.process)]
    if not all(isinstance(one, ArmTour) for one, _ in every):
        return None
    slow = max(max(process.feed, plunge(process)) for _, process in every)
    room = min(process.clearance for _, process in every) / 2
    return Flow(slow, room, max(process.least_height for _, process in every))


def _tools(tour: Tour) -> list[ToolTable]:
    """The tools in the order in which the program changes to them; none where it does not."""
    if isinstance(tour, ReplayTour):
        return [part.tool for part in tour.parts if part.tool is not None]
    if not isinstance(tour, JobTour):
        return []
    tools: list[ToolTable] = []
    for step, part in zip(tour.steps, tour.tours, strict=True):
        if part.paths and (not tools or tools[-1] != step.tool):
            tools.append(step.tool)
    return tools


def _join(lowered: Program, found: Sequence[Checks]) -> Checks:
    """What was found of several programs, as of one that changes the tool."""
    body: list[Instruction] = []
    begins = []
    for change, one in zip(
        (x for x in lowered.body if isinstance(x, ToolChange)), found, strict=True
    ):
        body.append(change)
        begins.append(len(body))
        body += one.program.body
    program = replace(lowered, body=switch_off_first(body))
    before = len(program.body) - len(body)
    reach = [one.reach for one in found if one.reach is not None]
    clear = [one.clear for one in found if one.clear is not None]
    return Checks(
        program,
        _join_reach(program, reach, [before + begin for begin in begins]) if reach else None,
        _join_clear(clear) if clear else None,
        found[0].where,
        tuple(itertools.chain.from_iterable(checks.slow for checks in found)),
    )


def _join_clear(found: Sequence[Clear]) -> Clear:
    """The least of all, with what is told of each."""
    least = min(found, key=lambda one: one.clearance)
    return replace(least, notes=tuple(note for one in found for note in one.notes))


def _join_reach(program: Program, found: Sequence[Reach], begins: Sequence[int]) -> Reach:
    """begins: where the instructions of each begin in ``program``."""
    joints = np.concatenate([one.joints for one in found])
    owner = np.concatenate([one.owner + begin for one, begin in zip(found, begins, strict=True)])
    return replace(found[0], joints=joints, owner=owner, program=program)


def lines_of(checked: Checked, posted: Posted) -> IntArray:
    """(N,) of the instructions of the whole program: the line that each was read from, counted from 1 through all
    files; 0 for comments, and for tool changes between programs.
    """
    body, several = checked.whole.program.body, len(checked.programs) > 1
    lines = np.zeros(len(body), dtype=np.int64)
    at = len(body) - sum(len(program.body) + several for _, program in checked.programs)
    first = above = 0
    for count, executed, (_, program) in zip(
        posted.counts, posted.executed, checked.programs, strict=True
    ):
        at += several
        # What was read back is the program, one by one, but for its comments: the comparison has shown that.
        lines[at + np.flatnonzero(~program.columns.are(Comment))] = above + np.array(
            executed.lines, dtype=np.int64
        )
        at += len(program.body)
        if several:
            above += sum(file.text.count("\n") for file in posted.files[first : first + count])
        first += count
    return lines


def _list_changed_options(post: Post, options: dict[str, object]) -> dict[str, object]:
    """The options in which a post differs from one that is made with `options`."""
    usual = make_post(type(post), options)
    names = [option.name for option in dataclasses.fields(post) if option.init]
    values = {name: getattr(post, name) for name in names if not name.startswith("_")}
    return {name: value for name, value in values.items() if value != getattr(usual, name)}


def post_programs(
    checked: Checked, read: Readback, options: dict[str, object], chord: float
) -> Posted:
    """The texts of the programs, read back and compared with the prepared programs.

    read: the read-back of the post.
    options: of the post, for the read-back.
    chord: `tolerance.chord` of the job, mm.

    Raises VerifyError for the first line that says something else.
    """
    several = len(checked.programs) > 1
    told = {key: value for key, value in options.items() if not (several and key == "program")}
    files: list[OutputFile] = []
    counts, runs, deviations = [], [], []
    for poster, program in checked.programs:
        rendered = render_program(poster, program)
        posted = [replace(file, text=sign(file.text)) for file in rendered]
        give_back()
        changed = _list_changed_options(poster, told)
        executed = read({file.name: file.text for file in posted}, told | changed)
        give_back()
        tolerance = limit_tolerance(poster.tolerance(), chord)
        deviations.append(
            compare(program, executed, tolerance, poster.list_verified(), posted[0].name)
        )
        runs.append(executed)
        counts.append(len(posted))
        files += posted
    worst = Deviation(
        max(one.max_mm for one in deviations),
        max(one.max_angle for one in deviations),
        sum(one.instructions for one in deviations),
    )
    return Posted(tuple(files), tuple(counts), tuple(runs), worst, tolerance)


def note_harm(posted: Posted) -> tuple[Note, ...]:
    """Warnings of what may do harm in the motion of the texts.

    A program that camgen plans has none of it. The motion of an old program is repeated as it is.
    """
    notes: list[Note] = []
    first = 0
    for count, executed in zip(posted.counts, posted.executed, strict=True):
        file = posted.files[first].name
        first += count
        harm = find_harm(executed)
        for finding in harm[:_HARM_NOTES]:
            notes.append(Note("warning", f"{file} line {finding.line}: {finding.what}"))
        if len(harm) > _HARM_NOTES:
            more = counted(len(harm) - _HARM_NOTES, "other line")
            notes.append(Note("warning", f"{file}: {more} may do harm", "camgen verify lists them"))
    return tuple(notes)
