"""The proof of the contours of a drawing, operation by operation."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from itertools import chain, compress

import numpy as np
from msgspec.structs import replace

from camgen.check.proof.along import ContourProver
from camgen.check.proof.corners import check_corners
from camgen.check.proof.descents import DescentChecker
from camgen.check.proof.earlier import EarlierCut, EarlierCuts, cuts_before
from camgen.check.proof.findings import Finding, Findings, MotionProof
from camgen.check.proof.heights import check_heights, find_levels
from camgen.check.proof.hints import Named, Program
from camgen.check.proof.holes import check_bored, check_drilled, find_plunged, select_holes
from camgen.check.proof.motions import Controller, Motions, Rounding
from camgen.check.proof.outputs import (
    check_joint_motions,
    check_outputs,
    check_switches,
    process_signal,
)
from camgen.check.proof.passes import check_path_order
from camgen.check.proof.pieces import BoolArray
from camgen.check.proof.process import check_orientation
from camgen.check.proof.slopes import SlopeChecker
from camgen.check.proof.subject import Context, Subject, are_named
from camgen.check.proof.tasks import BESIDE, Drawing, Task, make_drawing, make_tasks
from camgen.check.proof.travel import (
    check_rest,
    check_travel,
    cut_at_clearance,
    split_phases,
)
from camgen.check.proof.visits import find_reached, number_visits
from camgen.model.job import Job
from camgen.model.part import Note, Part, list_ids
from camgen.model.program import Origin
from camgen.model.sequences import take_rows

#: The start of a note on one of several operations.
_OF_OPERATION = re.compile(r"operation (\d+) \(")
#: Kinds of operations that have a row in the table of docs/proof.md.
PROVEN = ("follow", "trace", "chamfer", "drill", "bore", "pocket", "fill")


def prove_flat(
    part: Part,
    job: Job,
    programs: Sequence[Program],
    notes: Sequence[Note],
    rounding: Rounding,
    controller: Controller | None,
) -> MotionProof:
    """The proof of `prove_motion`, without the motions that are not placed.

    notes: all notes of the build.
    """
    drawing = make_drawing(part, job)
    context = Context(drawing, Named.from_notes(notes), rounding, controller, {})
    totals = _Count(drawing)
    findings: list[tuple[str, Finding]] = []
    unproven: list[str] = []
    tasks = make_tasks(drawing, job, bool(job.page.size))
    for task in tasks:
        if (reason := _why_not(task, part, drawing.slack)) != "":
            unproven.append(f"{task.kind}: {reason}")
            continue
        differences = Findings()
        # An operation runs in one program; if all its contours are left out, it runs in none.
        runs = [each for each in programs if _of_task(each, task)[each.path].any()] or programs[:1]
        earlier = _find_earlier(task, tasks, programs, context)
        of_task = context._replace(named=Named.from_notes(_select_notes(notes, task.number)))
        for program in runs:
            _prove_task(task, program, of_task, totals, differences, earlier)
        findings += [(runs[0].file, item) for item in differences.items]
        unproven += differences.unproven
    for program in programs:
        differences = Findings()
        _check_whole(program, job, context, differences)
        findings += [(program.file, item) for item in differences.items]
    findings.sort(key=lambda pair: (pair[1].line == 0, pair[1].line))
    done = totals.done
    return MotionProof(
        contours=int(done.sum()),
        length=float(drawing.length[done].sum()),
        motions=totals.motions,
        findings=tuple(findings),
        unproven=tuple(dict.fromkeys(unproven)),
    )


class _Count:
    """The contours that are worked, and the number of motions examined, over all tasks."""

    def __init__(self, drawing: Drawing) -> None:
        self.done = np.zeros(len(drawing.contours), np.bool_)
        self.motions = 0


def _number_of(origin: Origin) -> int:
    """The operation of a path: the number before the colon of its id, -1 in a job with one."""
    number, colon, _ = origin.id.partition(":")
    return int(number) if colon and number.isdigit() else -1


def _select_notes(notes: Sequence[Note], number: int) -> list[Note]:
    """The notes on an operation and those on the whole job: others begin with their number."""
    chosen = []
    for note in notes:
        begin = _OF_OPERATION.match(note.what)
        if begin is None or int(begin[1]) == number:
            chosen.append(note)
    return chosen


def _of_task(program: Program, task: Task) -> BoolArray:
    """(P + 1,) which paths belong to a task; the last place stands for motions without a path."""
    if task.number < 0:
        return np.ones(len(program.origins) + 1, np.bool_)
    numbers = np.array([_number_of(origin) for origin in program.origins], np.intp)
    return np.append(numbers == task.number, False)


def _find_earlier(
    task: Task, tasks: Sequence[Task], programs: Sequence[Program], context: Context
) -> EarlierCuts | None:
    """The motions of earlier operations, None if the task does not depend on them."""
    if not task.operation.rest:
        return None
    cuts: list[EarlierCut] = []
    for other in cuts_before(task, tasks):
        for program in programs:
            motions = context.tabulate(program, other.job.process)
            of_task = _of_task(program, other)[motions.path]
            works = split_phases(motions, other.job.process, 2 * context.rounding.mm).works
            cuts.append(EarlierCut(other, motions, works & of_task))
    limit = context.rounding.slack + context.drawing.slack
    return EarlierCuts(cuts, limit, task.job.tool.radius)


def _prove_task(
    task: Task,
    program: Program,
    context: Context,
    totals: _Count,
    findings: Findings,
    earlier: EarlierCuts | None,
) -> None:
    drawing, process = context.drawing, task.job.process
    motions = context.tabulate(program, process)
    of_task = _of_task(program, task)[motions.path]
    slack = context.rounding.slack
    check_switches(task.job, program.body, of_task, findings)
    stretches = [(0, len(motions))]
    prover: ContourProver | _Once
    if task.kind in _PROVERS:
        prover = _Once(_PROVERS[task.kind])
    else:
        prover = ContourProver(task, program, context, slack, earlier)
        stretches = cut_at_clearance(motions, process, slack)
    for low, high in stretches:
        stretch, mine = motions.stretch(low, high), of_task[low:high]
        phases = split_phases(stretch, process, slack, task.kind == "pocket")
        subject = Subject(task, context, program, stretch, phases, mine, slack, earlier)
        _check_motions(subject, totals, findings)
        contact = prover.examine(subject, low, findings)
        task_phases = replace(
            phases,
            known=phases.known & mine,
            upright=phases.upright & mine,
            works=phases.works & mine,
        )
        check_travel(stretch, task_phases, process_signal(process), contact, findings)
    done = prover.finish(motions, findings)
    named = context.named.skipped | context.named.cleared
    for index in np.flatnonzero(task.worked & ~done).tolist():
        contour = drawing.contours[index]
        names = {contour.id, *contour.sources}
        if names.isdisjoint(named) and drawing.length[index] >= task.job.input.min_length:
            findings.miss(f"contour {contour.id} is not worked, and no note says so")
            break
    totals.done |= done


def _check_motions(subject: Subject, totals: _Count, findings: Findings) -> None:
    """Checks that are the same for all kinds of operations."""
    task, context, slack = subject.task, subject.context, subject.slack
    motions, phases, of_task = subject.motions, subject.phases, subject.of_task
    totals.motions += int((phases.known & of_task).sum())
    check_joint_motions(task.job, motions, ~phases.known & of_task, findings)
    if not task.job.process.stay_down:
        check_outputs(task, motions, subject.works, findings)
    check_orientation(task.job, motions, subject.works, findings)
    DescentChecker(task, motions, phases, of_task, slack, context.rounding).check(findings)
    if context.controller is not None:
        goes_on = (np.diff(phases.chain) == 0) & (phases.works & of_task)[:-1]
        pace = context.controller.pace
        check_corners(task, motions, np.flatnonzero(goes_on), pace, slack, findings)


def _check_whole(program: Program, job: Job, context: Context, findings: Findings) -> None:
    slack = context.rounding.slack
    processes = [step.process for step in job.operations] or [job.process]
    lowest = min(processes, key=lambda process: process.clearance)
    motions = context.tabulate(program, lowest)
    if job.operations:
        works = split_phases(motions, lowest, slack).works
        for row in np.flatnonzero(works & (program.path < 0))[:1].tolist():
            findings.add(motions, row, "works, and belongs to no path")
    check_rest(motions, lowest.clearance - slack, findings)


def _why_not(task: Task, part: Part, slack: float) -> str:
    """Why the motions of a task are not proven, empty if they are.

    slack: deviation from the drawing that the job allows, mm.
    """
    if task.kind not in PROVEN:
        return "this operation has no proof"
    if task.kind in BESIDE and slack > min(task.distances) / 2:
        return "the tolerances of the job are larger than half of the distance from the contour"
    if task.operation.planner == "image":
        return "the image planner follows pixels, and not the contours"
    if task.kind == "drill" and part.raster is not None:
        return "marks and rings are found in the pixels of a picture"
    return ""


_Result = tuple[BoolArray, BoolArray]
_Prover = Callable[[Subject, Findings], _Result]


class _Once:
    """Examines all motions of a task at once."""

    def __init__(self, prover: _Prover) -> None:
        self._prover = prover
        self._done = np.zeros(0, np.bool_)

    def examine(self, subject: Subject, _first: int, findings: Findings) -> BoolArray:
        """(M,) the motions in contact."""
        self._done, contact = self._prover(subject, findings)
        return contact

    def finish(self, _motions: Motions, _findings: Findings) -> BoolArray:
        """(C,) the contours that are worked."""
        return self._done


def _start_at_joints(motions: Motions) -> BoolArray:
    """(M,) straight motions after joint values: their start is not known, but their end is."""
    unknown = np.isnan(motions.start[:, 0]) & ~np.isnan(motions.end[:, 0])
    return np.asarray(unknown & ~motions.joint)


def _prove_drilled(subject: Subject, findings: Findings) -> _Result:
    strokes = subject.phases.upright | _start_at_joints(subject.motions)
    upright = np.flatnonzero(strokes & subject.of_task)
    contact, done = check_drilled(
        subject.task, subject.drawing, subject.motions, upright, subject.context.rounding, findings
    )
    findings.add_first(subject.motions, subject.works, "moves across in a hole")
    done = _without_others(subject, done)
    by_joints = _are_reached_by_joints(subject) & subject.task.worked & ~done
    if by_joints.any():
        findings.leave(f"{int(by_joints.sum())} of the holes", "joint values lead the tool to them")
    return done | by_joints, contact


def _are_reached_by_joints(subject: Subject) -> BoolArray:
    """(C,) contours with a path that has motions to joint values, which give no place."""
    motions = subject.motions
    paths = np.unique(motions.path[np.isnan(motions.end[:, 0]) & (motions.path >= 0)])
    origins = take_rows(subject.program.origins, paths.tolist())
    names = frozenset(chain.from_iterable(origin.contours for origin in origins))
    return are_named(subject.drawing, names)


def _prove_bored(subject: Subject, findings: Findings) -> _Result:
    task, drawing, motions = subject.task, subject.drawing, subject.motions
    done = check_bored(task, drawing, motions, subject.works, subject.limit, findings)
    upright = np.flatnonzero((subject.phases.upright | _start_at_joints(motions)) & subject.of_task)
    plunged, strokes = find_plunged(task, drawing, motions, upright, subject.limit)
    return _without_others(subject, done | plunged), subject.phases.works | strokes


def _without_others(subject: Subject, done: BoolArray) -> BoolArray:
    """Counts contours that are not a hole of the task as done: nothing is to be worked there."""
    wanted = np.zeros(len(done), np.bool_)
    wanted[select_holes(subject.task, subject.drawing).contour] = True
    return np.asarray(done | (subject.task.worked & ~wanted))


def _prove_area(subject: Subject, findings: Findings) -> _Result:
    from camgen.check.proof.areas import AreaChecker, make_region  # noqa: PLC0415 (only for areas)

    task, motions, phases = subject.task, subject.motions, subject.phases
    rows = subject.works
    region = make_region(task, subject.drawing)
    checker = AreaChecker(task, subject.drawing, region, motions, subject.limit)
    checker.check_inside(rows, findings)
    levels = find_levels(task, motions, rows, subject.slack)
    check_heights(task, motions, rows, levels, subject.slack, findings)
    checker.check_hops(phases, subject.of_task, subject.slack, findings)
    visit = number_visits(motions, phases, task.job.process.clearance, subject.slack)[rows]
    reached = find_reached(task, motions, rows, visit)
    SlopeChecker(task, motions, rows, reached, subject.slack).check(visit, levels, findings)
    check_path_order(task, motions, rows, levels, subject.slack, findings)
    checker.check_speeds(rows[levels >= 0], subject.context.rounding.speed, findings)
    worked = set(list_ids(compress(subject.drawing.contours, task.worked)))
    if not worked.isdisjoint(subject.context.named.skipped):
        findings.leave(
            "that the area is cleared", "a note says that paths or contours are left out"
        )
        task = replace(task, depths=())
    # A dot, or the place of a helix, is reached from above only.
    strokes = phases.upright | _start_at_joints(motions)
    dots = strokes & subject.of_task & (motions.end[:, 2] <= subject.slack)
    dots[dots] = checker.are_inside(np.flatnonzero(dots), findings)
    ends = np.where(dots, motions.end[:, 2], np.inf)
    last = len(task.depths) - 1
    depths = np.array(subject.task.depths)
    for number, depth in enumerate(task.depths):
        # Passes that the digits of the text do not distinguish are one.
        at_level = rows[(levels >= 0) & (np.abs(depths[levels] - depth) <= subject.slack)]
        below = np.flatnonzero(np.abs(ends + depth) <= subject.slack)
        if not len(at_level) and not len(below) and subject.earlier is None:
            findings.miss(f"no motion at the depth of pass {number + 1}")
            continue
        left = task.operation.finish if number < last else 0.0
        if not left:
            checker.check_direction(at_level, findings)
        places = checker.list_places(depth, subject)
        checker.check_covered(np.concatenate([at_level, below]), places, left, findings)
    return task.worked & subject.drawing.closed, phases.works | dots


#: How the kinds of operations are examined that do not run along contours.
_PROVERS: dict[str, _Prover] = {
    "drill": _prove_drilled,
    "bore": _prove_bored,
    "pocket": _prove_area,
    "fill": _prove_area,
}
