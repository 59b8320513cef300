"""The proof of motion: a text works the contours of the drawing, all of them, and nothing else.

`prove_motion` takes the drawing as it was read, the job, and the motions that were read back from
the text. It knows no plan, no tour and no post. Program and path are used as hints about where to
look first; a wrong hint makes a proof fail, it never makes it pass. The table in docs/proof.md
lists the facts that are proven for each operation.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import chain, compress, count, repeat
from operator import attrgetter
from typing import NamedTuple

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.check.proof.contours import ContourChecker, Matched
from camgen.check.proof.corners import check_corners
from camgen.check.proof.descents import DescentChecker
from camgen.check.proof.findings import Finding, Findings
from camgen.check.proof.heights import check_heights, find_levels, tab_top
from camgen.check.proof.holes import check_bored, check_drilled, select_holes
from camgen.check.proof.leads import LeadChecker
from camgen.check.proof.matching import Ragged, list_pieces
from camgen.check.proof.motions import Controller, Motions, Rounding, tabulate
from camgen.check.proof.nesting import find_unclear
from camgen.check.proof.passes import (
    check_inside_first,
    check_pass_order,
    check_path_order,
    check_repeats,
)
from camgen.check.proof.pieces import BoolArray, IntArray
from camgen.check.proof.process import (
    check_feeds,
    check_force_directions,
    check_forces,
    check_joint_motions,
    check_orientation,
    check_outputs,
    check_switches,
    check_tool_turns,
    find_directions,
    process_signal,
)
from camgen.check.proof.slopes import SlopeChecker, TabChecker
from camgen.check.proof.tasks import BESIDE, Drawing, Task, lay_drawing, make_tasks
from camgen.check.proof.travel import Phases, check_rest, check_travel, split_phases
from camgen.check.proof.visits import Laps, find_laps, find_reached, number_visits
from camgen.model.job import Job, ProcessTable
from camgen.model.part import Note, Part
from camgen.model.program import Instruction, Origin

__all__ = [
    "Controller",
    "Finding",
    "MotionProof",
    "Program",
    "Rounding",
    "process_signal",
    "prove_motion",
]

#: Kinds of operations that have a row in the table of docs/proof.md.
PROVEN = ("follow", "trace", "chamfer", "drill", "bore", "pocket", "fill")
#: Added to every limit, mm: rounding of binary numbers, and of the points of an arc.
_SLACK_MM = 1e-3


class Program(NamedTuple):
    """One text as it was read back, with the hints of the program.

    body: instructions without comments.
    lines: number of the line of each instruction in the text, from 1.
    path: (M,) index of the path of each motion, -1 for no path.
    origins: contours and operation of each path.
    file: name of the text.
    """

    body: Sequence[Instruction]
    lines: Sequence[int]
    path: IntArray
    origins: Sequence[Origin]
    file: str


class MotionProof(Struct, frozen=True):
    """The result of the proof.

    contours: number of contours that are worked as the job asks for.
    length: their length, mm.
    motions: number of motions that were examined.
    joints: number of motions to or from joint values, of which only the outputs were examined.
    findings: differences in order of line, each with the name of its file.
    unproven: steps that were not examined, each with its reason.
    """

    contours: int
    length: float
    motions: int
    joints: int
    findings: tuple[tuple[str, Finding], ...]
    unproven: tuple[str, ...]


def prove_motion(
    part: Part,
    job: Job,
    programs: Sequence[Program],
    notes: Sequence[Note],
    rounding: Rounding,
    controller: Controller | None = None,
) -> MotionProof:
    """Compares the motions of `programs` with the drawing of `part` and the settings of `job`.

    notes: all notes of the build; a contour that a note names as skipped may be left out.
    rounding: rounding of the numbers of the text.
    controller: the controller of the text. None: rounded corners and turns of the tool are not
        examined.
    """
    if part.solid is not None or part.curves:
        return _prove_space(part, job, programs, Named.of(notes), rounding)
    drawing = lay_drawing(part, job)
    context = _Context(drawing, Named.of(notes), rounding, controller, {})
    totals = _Count(drawing)
    findings: list[tuple[str, Finding]] = []
    unproven: list[str] = []
    for task in make_tasks(drawing, job, bool(job.page.size)):
        if (reason := _why_not(task, part, drawing.slack)) != "":
            unproven.append(f"{task.kind}: {reason}")
            continue
        differences = Findings()
        # An operation runs in one program; if all its contours are left out, it runs in none.
        runs = [program for program in programs if _has_task(program, task)] or programs[:1]
        for program in runs:
            _prove_task(task, program, context, totals, differences)
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
        joints=totals.joints,
        findings=tuple(findings),
        unproven=tuple(dict.fromkeys(unproven)),
    )


def _prove_space(
    part: Part, job: Job, programs: Sequence[Program], named: Named, rounding: Rounding
) -> MotionProof:
    """The proof for edges of a 3-D part, or for curves in space."""
    from camgen.check.proof.space import (  # noqa: PLC0415 (only for these)
        SpaceChecker,
        select_lines,
    )

    if job.operation.depth:
        reason = "curves in space with a depth are not examined"
        return MotionProof(0, 0.0, 0, 0, (), (reason,))
    findings = Findings()
    signal = process_signal(job.process)
    program = programs[0]
    motions = tabulate(program.body, program.lines, program.path, signal)
    distance = 0.0 if part.curves else job.operation.offset
    limit = 2 * rounding.mm + _SLACK_MM + job.tolerance.chord + job.tolerance.arc_fit
    lines = select_lines(part, job, program.origins, findings)
    checker = SpaceChecker(job, motions, distance, limit)
    done = checker.check(lines, program.origins, findings)
    for line in lines:
        if line.id not in done and line.id not in named.skipped:
            findings.miss(f"{line.id} is not worked, and no note says so")
            break
    unknown = np.isnan(motions.start[:, 0]) | np.isnan(motions.end[:, 0])
    check_joint_motions(job, motions, unknown, findings)
    return MotionProof(
        contours=len(done),
        length=float(sum(line.length for line in lines if line.id in done)),
        motions=int((~unknown).sum()),
        joints=int(unknown.sum()),
        findings=tuple((program.file, item) for item in findings.items),
        unproven=tuple(findings.unproven),
    )


class Named(NamedTuple):
    """Ids of contours that notes are about.

    skipped: ids in notes on contours that are left out.
    leads: ids in notes on shorter leads.
    tabs: ids in notes on fewer tabs.
    others: ids in all other notes, and in those on contours that are left out.
    """

    skipped: frozenset[str]
    leads: frozenset[str]
    tabs: frozenset[str]
    others: frozenset[str]

    @classmethod
    def of(cls, notes: Sequence[Note]) -> Named:
        """The ids that `notes` name."""
        skipped = [note.ids for note in notes if note.kind == "skipped"]
        leads = [note.ids for note in notes if note.lacks == "leads"]
        tabs = [note.ids for note in notes if note.lacks == "tabs"]
        others = [note.ids for note in notes if not note.lacks]
        groups = (skipped, leads, tabs, others)
        return cls(*(frozenset(chain.from_iterable(ids)) for ids in groups))


class _Context(NamedTuple):
    """Values that all tasks share.

    drawing: the contours of the part.
    named: ids in notes.
    rounding: rounding of the numbers of the texts.
    controller: the controller of the texts, if it is known.
    tables: the motions of each program by its name and by the output that is the signal.
    """

    drawing: Drawing
    named: Named
    rounding: Rounding
    controller: Controller | None
    tables: dict[tuple[str, str], Motions]

    def tabulate(self, program: Program, process: ProcessTable) -> Motions:
        """The motions of a program, with the output of `process` as the signal."""
        signal = process_signal(process)
        key = program.file, signal
        if key not in self.tables:
            self.tables[key] = tabulate(program.body, program.lines, program.path, signal)
        return self.tables[key]


class _Count:
    """The contours that are worked, and the number of motions examined, over all tasks."""

    def __init__(self, drawing: Drawing) -> None:
        self.done = np.zeros(len(drawing.contours), np.bool_)
        self.motions = 0
        self.joints = 0


def _number_of(origin: Origin) -> int:
    """The operation of a path: the number before the colon of its id, -1 in a job with one."""
    number, colon, _ = origin.id.partition(":")
    return int(number) if colon and number.isdigit() else -1


def _of_task(program: Program, task: Task) -> BoolArray:
    """(P + 1,) which paths belong to a task; the last place stands for motions without a path."""
    if task.number < 0:
        return np.ones(len(program.origins) + 1, np.bool_)
    numbers = np.array([_number_of(origin) for origin in program.origins], np.intp)
    return np.append(numbers == task.number, False)


def _has_task(program: Program, task: Task) -> bool:
    return bool(_of_task(program, task)[program.path].any())


def _prove_task(
    task: Task, program: Program, context: _Context, totals: _Count, findings: Findings
) -> None:
    drawing = context.drawing
    signal = process_signal(task.job.process)
    motions = context.tabulate(program, task.job.process)
    of_task = _of_task(program, task)[motions.path]
    slack = 2 * context.rounding.mm + _SLACK_MM
    phases = split_phases(motions, task.job.process, slack)
    totals.motions += int((phases.known & of_task).sum())
    unknown = ~phases.known & of_task
    totals.joints += int(unknown.sum())
    check_joint_motions(task.job, motions, unknown, findings)
    subject = _Subject(task, context, program, motions, phases, of_task, slack)
    rows = np.flatnonzero(phases.works & of_task)
    if not task.job.process.stay_down:
        check_outputs(task, motions, rows, findings)
    check_orientation(task.job, motions, rows, findings)
    check_switches(task.job, program.body, of_task, findings)
    DescentChecker(task, motions, phases, of_task, slack, context.rounding).check(findings)
    if context.controller is not None:
        goes_on = (np.diff(phases.chain) == 0) & (phases.works & of_task)[:-1]
        pace = context.controller.pace
        check_corners(task, motions, np.flatnonzero(goes_on), pace, slack, findings)
    done, contact = _PROVERS[task.kind](subject, findings)
    check_travel(motions, _only(phases, of_task), signal, contact, findings)
    for index in np.flatnonzero(task.worked & ~done).tolist():
        contour = drawing.contours[index]
        names = {contour.id, *contour.sources}
        if (
            names.isdisjoint(context.named.skipped)
            and drawing.length[index] >= task.job.input.min_length
        ):
            findings.miss(f"contour {contour.id} is not worked, and no note says so")
            break
    totals.done |= done


def _check_whole(program: Program, job: Job, context: _Context, findings: Findings) -> None:
    """Finds motions that belong to no path and work, or go to or from the rest position low."""
    slack = 2 * context.rounding.mm + _SLACK_MM
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


def _only(phases: Phases, rows: BoolArray) -> Phases:
    return Phases(
        phases.known & rows,
        phases.upright & rows,
        phases.works & rows,
        phases.chain,
        phases.first,
        phases.last,
    )


class _Subject(NamedTuple):
    """The motions of one task in one program, M in all."""

    task: Task
    context: _Context
    program: Program
    motions: Motions
    phases: Phases
    of_task: BoolArray
    slack: float

    @property
    def drawing(self) -> Drawing:
        """The contours of the part."""
        return self.context.drawing

    @property
    def limit(self) -> float:
        """Distance, mm, that a motion may have from its place in the drawing."""
        return self.slack + self.drawing.slack

    @property
    def works(self) -> IntArray:
        """The motions in contact."""
        return np.flatnonzero(self.phases.works & self.of_task)


_Result = tuple[BoolArray, BoolArray]


def _prove_contours(subject: _Subject, findings: Findings) -> _Result:
    task, drawing, motions = subject.task, subject.drawing, subject.motions
    phases, rows = subject.phases, subject.works
    if task.kind in BESIDE and task.operation.side not in ("left", "right"):
        # An open contour has no outside: a note has to say that it is left out.
        task = replace(task, worked=task.worked & drawing.closed)
    if task.kept_clear.any():
        suspects = task.kept_clear & _are_named(drawing, subject.context.named.others)
        unclear = find_unclear(drawing.pieces, suspects, task.near)
        task = replace(task, kept_clear=task.kept_clear & ~unclear, worked=task.worked & ~unclear)
    subject = subject._replace(task=task)
    lists = _hint(drawing, subject.program.origins)
    checker = ContourChecker(task, drawing, motions, lists, subject.limit)
    matched = checker.match(rows, findings)
    if task.job.process.stay_down:
        # Links at working height may have the process off.
        check_outputs(task, motions, rows[matched.follows], findings)
    levels = find_levels(task, motions, rows, subject.slack)
    leads = LeadChecker(checker, matched)
    leading = leads.find(phases.chain[rows], levels >= 0)
    strange = ~matched.follows & ~leading & ~matched.rounds
    for index in np.flatnonzero(strange)[:1].tolist():
        findings.add(motions, int(rows[index]), "works where nothing is drawn to be worked")
    laps, directed = _check_laps(subject, leads, levels, findings)
    checker.check_direction(matched, directed, findings)
    check_pass_order(checker, matched, levels, findings)
    check_inside_first(checker, matched, findings)
    checker.check_clear(matched, findings)
    check_feeds(task, drawing, motions, matched, subject.context.rounding, findings)
    check_forces(task, motions, matched, findings)
    _check_directions(subject, matched, findings)
    check_heights(task, motions, rows, levels, subject.slack, findings)
    done = _check_passes(subject, checker, matched, laps, levels, findings)
    return done, phases.works


def _check_laps(
    subject: _Subject, leads: LeadChecker, levels: IntArray, findings: Findings
) -> tuple[Laps | None, BoolArray]:
    """Checks leads, overlaps, slopes and tabs.

    Returns the laps, or None if the job asks for nothing of these, and (W,) motions that have the
    direction of their path: level ones, and ramps around it.
    """
    task, drawing, motions = subject.task, subject.drawing, subject.motions
    operation, matched = task.operation, leads.matched
    has_ends = operation.lead_in or operation.lead_out or operation.overlap
    has_slopes = operation.entry != "plunge" or np.isfinite(tab_top(task))
    if not has_ends and not has_slopes and operation.passes == 1:
        return None, levels >= 0
    clearance = task.job.process.clearance
    visit = number_visits(motions, subject.phases, clearance, subject.slack)[matched.rows]
    laps = find_laps(task, motions, matched, visit, drawing.pieces.owner, subject.limit)
    names = subject.context.named
    leads.check(laps, _laps_named(subject, matched, laps, names.leads), findings)
    leads.check_overlap(laps, levels, findings)
    leads.check_feeds(laps, subject.context.rounding.speed, findings)
    slopes = SlopeChecker(task, motions, matched.rows, laps.reached, subject.slack)
    slopes.check(visit, levels, findings)
    slopes.check_linked(laps, visit, findings)
    fewer = _laps_named(subject, matched, laps, names.tabs)
    TabChecker(task, drawing, motions, subject.slack).check(matched, laps, fewer, findings)
    return laps, (levels >= 0) | slopes.goes_round(laps)


def _check_directions(subject: _Subject, matched: Matched, findings: Findings) -> None:
    """Compares tool x and the direction of the force with the way to the contour."""
    task, controller = subject.task, subject.context.controller
    if controller is None or task.kind not in BESIDE:
        return
    tool, force = task.job.tool, task.job.process.force
    follows = tool.orient == "follow" and not tool.symmetric and tool.turn is None
    if not follows and not force:
        return
    motions = subject.motions
    towards = find_directions(subject.drawing, motions, matched, subject.limit)
    if force and "force-direction" in controller.stated:
        check_force_directions(motions, towards, findings)
    elif motions.force.any():
        findings.leave("the direction of the force", "the text does not state it")
    if follows and "orientation" in controller.stated:
        check_tool_turns(motions, towards, findings)
    elif tool.orient == "follow":
        why = "the text states no orientation" if follows else "the tool may turn about its axis"
        findings.leave("that tool x points at the contour", why)


def _hint(drawing: Drawing, origins: Sequence[Origin]) -> Ragged:
    """For each path the pieces of the drawing at which to look first."""
    place = dict(zip(map(attrgetter("id"), drawing.contours), count(), strict=False))
    names = list(map(attrgetter("contours"), origins))
    path = np.repeat(np.arange(len(names)), list(map(len, names)))
    flat = map(place.get, chain.from_iterable(names), repeat(-1))
    contour = np.fromiter(flat, np.intp, len(path))
    known = contour >= 0
    return list_pieces(drawing.pieces, len(names), path[known], contour[known])


def _are_named(drawing: Drawing, names: frozenset[str]) -> BoolArray:
    """(C,) contours that are among `names`, by their ids or by those that they were made of."""
    if not names:
        return np.zeros(len(drawing.contours), np.bool_)
    listed = [
        contour.id in names or not names.isdisjoint(contour.sources) for contour in drawing.contours
    ]
    return np.array(listed, np.bool_)


def _laps_named(
    subject: _Subject, matched: Matched, laps: Laps, names: frozenset[str]
) -> BoolArray:
    """(L,) laps along a contour that is among `names`, or on a path beside one."""
    if not names:
        return np.zeros(len(laps.first), np.bool_)
    on_path = [not names.isdisjoint(origin.contours) for origin in subject.program.origins]
    path = subject.motions.path[matched.rows[laps.first]]
    by_path = np.array([*on_path, False], np.bool_)[path]
    return np.asarray(by_path | _are_named(subject.drawing, names)[laps.contour])


def _check_passes(
    subject: _Subject,
    checker: ContourChecker,
    matched: Matched,
    laps: Laps | None,
    levels: IntArray,
    findings: Findings,
) -> BoolArray:
    """(C,) contours that are covered at each depth; a finding for the first that is not."""
    task, drawing, motions = subject.task, subject.drawing, subject.motions
    owner = drawing.pieces.owner
    done = task.worked.copy()
    place = np.searchsorted(matched.rows, matched.covered.motion)
    depths = np.array(task.depths)
    in_lap = levels >= 0
    lap_depth = depths[levels]
    if laps is not None:
        # Over a tab a lap is as high as the tab, which may be the depth of an earlier pass.
        in_lap |= motions.end[matched.rows, 2] <= tab_top(task) + subject.slack
        lap_depth = np.append(depths[laps.depth], np.inf)[laps.lap]
    touched = np.zeros(len(done), np.bool_)
    touched[owner[matched.piece[matched.follows]]] = True
    for number, depth in enumerate(task.depths):
        # Passes that the digits of the text do not distinguish are covered together.
        at_depth = in_lap & (np.abs(lap_depth - depth) <= subject.slack)
        last = number == len(task.depths) - 1
        distance = task.distances[-1] if last else task.distances[0]
        chosen = at_depth[place]
        at_distance = chosen & (np.abs(matched.distance[place] - distance) < 1e-9)
        check_repeats(checker, matched.covered.take(at_distance), depth, findings)
        if last:
            chosen = at_distance
        rows = matched.rows[at_depth]
        gaps = checker.find_uncovered(matched, np.flatnonzero(chosen), rows, distance, findings)
        for index in range(len(gaps.piece)):
            contour = drawing.contours[int(owner[gaps.piece[index]])]
            done[owner[gaps.piece[index]]] = False
            if not subject.context.named.skipped.isdisjoint({contour.id, *contour.sources}):
                continue
            if not touched[owner[gaps.piece[index]]]:
                continue
            x, y = _place_of_gap(subject, gaps.piece[index], gaps.low[index], gaps.high[index])
            what = f"contour {contour.id} is not worked at {x:.3f} {y:.3f} mm, depth {depth:g} mm"
            findings.miss(what)
            return done
    # A contour without a gap is worked, unless a note says that the tool does not fit beside it.
    skipped = _are_named(drawing, subject.context.named.skipped)
    return np.asarray(done & (touched | ~skipped))


def _place_of_gap(subject: _Subject, piece: int, low: float, high: float) -> tuple[float, float]:
    from camgen.check.proof.pieces import points_along  # noqa: PLC0415 (only for a message)

    share = np.array([(low + high) / 2])
    point = points_along(subject.drawing.pieces, np.array([piece]), share)[0]
    return float(point[0]), float(point[1])


def _start_at_joints(motions: Motions) -> BoolArray:
    """(M,) straight motions after joint values: their start is not known, but their end is."""
    unknown = np.isnan(motions.start[:, 0]) & ~np.isnan(motions.end[:, 0])
    return np.asarray(unknown & ~motions.joint)


def _prove_drilled(subject: _Subject, findings: Findings) -> _Result:
    motions = subject.motions
    strokes = subject.phases.upright | _start_at_joints(motions)
    upright = np.flatnonzero(strokes & subject.of_task)
    contact, done = check_drilled(
        subject.task, subject.drawing, subject.motions, upright, subject.context.rounding, findings
    )
    for row in subject.works[:1].tolist():
        findings.add(subject.motions, row, "moves across in a hole")
    done = _without_others(subject, done)
    by_joints = _are_reached_by_joints(subject) & subject.task.worked & ~done
    if by_joints.any():
        findings.leave(f"{int(by_joints.sum())} of the holes", "joint values lead the tool to them")
    return done | by_joints, contact


def _are_reached_by_joints(subject: _Subject) -> BoolArray:
    """(C,) contours with a path that has motions to joint values, which give no place."""
    motions = subject.motions
    paths = np.unique(motions.path[np.isnan(motions.end[:, 0]) & (motions.path >= 0)])
    origins = [subject.program.origins[path] for path in paths.tolist()]
    names = frozenset(chain.from_iterable(origin.contours for origin in origins))
    return _are_named(subject.drawing, names)


def _prove_bored(subject: _Subject, findings: Findings) -> _Result:
    done = check_bored(
        subject.task, subject.drawing, subject.motions, subject.works, subject.limit, findings
    )
    return _without_others(subject, done), subject.phases.works


def _without_others(subject: _Subject, done: BoolArray) -> BoolArray:
    """Counts contours that are not a hole of the task as done: nothing is to be worked there."""
    holes = select_holes(subject.task, subject.drawing)
    wanted = np.zeros(len(done), np.bool_)
    wanted[holes.contour] = True
    return np.asarray(done | (subject.task.worked & ~wanted))


def _prove_area(subject: _Subject, findings: Findings) -> _Result:
    from camgen.check.proof.areas import AreaChecker, make_region  # noqa: PLC0415 (only for areas)

    task, motions, phases = subject.task, subject.motions, subject.phases
    rows = subject.works
    region = make_region(task, subject.drawing)
    checker = AreaChecker(task, subject.drawing, region, motions, subject.limit)
    checker.check_inside(rows, findings)
    levels = find_levels(task, motions, rows, subject.slack)
    check_heights(task, motions, rows, levels, subject.slack, findings)
    visit = number_visits(motions, phases, task.job.process.clearance, subject.slack)[rows]
    reached = find_reached(task, motions, rows, visit)
    SlopeChecker(task, motions, rows, reached, subject.slack).check(visit, levels, findings)
    check_path_order(task, motions, rows, levels, subject.slack, findings)
    level_rows = rows[levels >= 0]
    checker.check_speeds(level_rows, subject.context.rounding.speed, findings)
    worked = {contour.id for contour in compress(subject.drawing.contours, task.worked)}
    if not worked.isdisjoint(subject.context.named.skipped):
        findings.leave(
            "that the area is cleared", "a note says that paths or contours are left out"
        )
        task = replace(task, depths=())
    last = len(task.depths) - 1
    depths = np.array(subject.task.depths)
    for number, depth in enumerate(task.depths):
        # Passes that the digits of the text do not distinguish are one.
        at_level = rows[(levels >= 0) & (np.abs(depths[levels] - depth) <= subject.slack)]
        if not len(at_level):
            findings.miss(f"no motion at the depth of pass {number + 1}")
            continue
        left = task.operation.finish if number < last else 0.0
        if not left:
            checker.check_direction(at_level, findings)
        checker.check_covered(at_level, left, findings)
    # A dot, or the place of a helix, is reached from above only.
    strokes = phases.upright | _start_at_joints(motions)
    dots = strokes & subject.of_task & (motions.end[:, 2] <= subject.slack)
    dots[dots] = checker.are_inside(np.flatnonzero(dots), findings)
    return task.worked & subject.drawing.closed, phases.works | dots


_Prover = Callable[[_Subject, Findings], _Result]
_PROVERS: dict[str, _Prover] = {
    "follow": _prove_contours,
    "trace": _prove_contours,
    "chamfer": _prove_contours,
    "drill": _prove_drilled,
    "bore": _prove_bored,
    "pocket": _prove_area,
    "fill": _prove_area,
}
