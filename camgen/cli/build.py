"""The command `build`: reads, plans and proves, and only then writes all files at once."""

from __future__ import annotations

import gc
import math
import os
from argparse import Namespace
from collections.abc import Iterator, Sequence
from itertools import accumulate, pairwise
from pathlib import Path
from time import perf_counter

import msgspec
import numpy as np
from msgspec import Struct, field
from msgspec.structs import replace

from camgen.batch.writing import (
    HEADER_BYTES,
    check_edits,
    check_foreign,
    check_programs,
    check_targets,
    list_paths,
    write_all,
)
from camgen.check.executed import UNLIMITED
from camgen.check.report import clean, path_sums
from camgen.cli.inputs import open_inputs, to_path
from camgen.cli.motion_file import encode
from camgen.cli.say import (
    Row,
    Terminal,
    format_length,
    format_size,
    join_names,
    label_rows,
    rows_of_notes,
)
from camgen.lang.recorded import Recorded
from camgen.model.errors import JobError, rename_errors
from camgen.model.job import CameraTable, ImageTable, Job, Step
from camgen.model.part import GRAVEST, Note, NoteKind, Part, describe_bodies
from camgen.model.path import PLAIN, Tour
from camgen.model.pose import Pose
from camgen.model.program import Joints, ToolChange
from camgen.model.text import counted, duration, grouped, join_short, short
from camgen.pipeline import ProgramFile, Result, build, list_program_files
from camgen.pipeline.memory import pause_collector
from camgen.pipeline.motion import format_motions, list_reasons
from camgen.pipeline.stock import explain_unproven
from camgen.plan.steps import format_step
from camgen.post.verify import list_uncompared
from camgen.preview.drawings import check_preview, draw_preview
from camgen.read.files import Files
from camgen.read.job_file import find_job_file, load_job

# The summary of a build: lines on the input, the notes, the plan, the proofs and the files.

#: Kinds of notes that need no attention of the user.
_PLAIN: tuple[NoteKind, ...] = ("joined", "repaired")
#: Maximum number of notes of a kind in the summary without -v.
_NOTES = 8


def list_rows(
    result: Result,
    job: Path | None,
    inputs: Sequence[Path],
    programs: Sequence[tuple[Path, ProgramFile]],
    verbose: int,
) -> list[Row]:
    """Label, text and tone of each line of the summary."""
    part = result.part
    return [
        ("input", f"{part.source}: {part.units}, {_describe_content(part)}", "plain"),
        *_job(job, inputs),
        *_located(result),
        *list_notes(result.notes, verbose),
        *_list_plan_rows(result),
        *_operations(result),
        *_coverage(result),
        ("cell", result.cell.name, "plain"),
        (
            "time",
            f"about {duration(result.cycle.total)}, {duration(result.cycle.travel)} of it travel",
            "plain",
        ),
        *_programs(result, programs),
        # Drawing to motion, motion to text, stock, reach and collision.
        _motion(result),
        _text(result),
        _rounded(result),
        *_stock(result),
        *_fixtures(result),
        *_reach(result),
    ]


def _located(result: Result) -> list[Row]:
    """The pose of the part by a photo, and the deviation of the photo from the drawing there."""
    located = result.located
    if located is None:
        return []
    x, y = located.place
    what = (
        f"by {located.inspection.photo.source}: {located.pose}; "
        f"{100 * located.share:.1f} % of the outline fits, "
        f"{short(located.inspection.fit.rms, 4)} mm rms, "
        f"largest deviation {short(located.deviation, 3)} mm at {x:.2f}, {y:.2f} mm"
    )
    return [("located", what, "look" if located.inspection.differences else "plain")]


# Proofs: a line for each step, whether it ran or not.


def _fixtures(result: Result) -> list[Row]:
    """The distances between the tool of a mill and the fixtures."""
    if result.fixtures is None:
        return []
    from camgen.cli.stock import rows_of_fixtures  # noqa: PLC0415 (shapely, only with fixtures)

    rows = rows_of_fixtures(result.fixtures, result.job)
    if result.proof is None:
        rows += label_rows("fixtures", result.fixtures.notes, "look")
    return rows


def _rounded(result: Result) -> Row:
    """The largest distance between the executed and the programmed path, by the model."""
    rounded = result.rounded
    if rounded is None:
        what = f"not modelled: the post {result.post.name} does not state how its controller rounds"
        return ("rounded", what, "look")
    if not rounded.transitions:
        return ("rounded", "0 mm: the tool stops at each corner", "good")
    if not rounded.mm:
        return ("rounded", "0 mm: the controller stays on the path", "good")
    limit = f"{short(rounded.allowed, 4)} mm are allowed"
    if rounded.allowed >= UNLIMITED:
        limit = "as in the program that was read"
    what = f"{rounded.mm:.4f} mm by the model of the controller, {limit}; "
    what += f"at {join_short(rounded.place, 3)} mm, line {rounded.line}"
    if rounded.largest > rounded.mm:
        what += f"; {short(rounded.largest, 4)} mm between chords of an arc"
    return ("rounded", what, "good")


#: Properties that matter only in some programs, with the column of motions that shows them.
_ONLY_WITH = {
    "directions of forces": "force",
    "speeds of reorientations": "turn",
    "orientations half-way along arcs": "arcs",
}


def _text(result: Result) -> Row:
    """The comparison of the text with the program, and what the text does not carry."""
    compared = counted(result.deviation.instructions, "instruction")
    equal = f"read back, {compared} equal, largest deviation {result.deviation.max_mm:.6f} mm"
    missing = []
    for aspect in list_uncompared(result.post):
        column = _ONLY_WITH.get(aspect)
        if column is None or np.any(getattr(result.program.columns, column)):
            missing.append(aspect)
    if missing:
        return ("text", f"{equal}; not in the text: {', '.join(missing)}", "look")
    return ("text", f"verified: {equal}", "good")


def _motion(result: Result) -> Row:
    """The proof that the motions of the text work the contours of the drawing."""
    proof = result.motion
    if proof is None:
        return ("motion", "not proven: it was not examined", "look")
    if not proof.motions:
        return ("motion", f"not proven: {'; '.join(proof.unproven)}", "look")
    contours = counted(proof.contours, "contour")
    what = f"{contours}, {format_length(proof.length)}, in {format_motions(proof)}"
    if gaps := list_reasons(proof):
        return ("motion", f"{what}; not proven: {'; '.join(gaps)}", "look")
    return ("motion", f"verified: {what}", "good")


_NO_ROBOT: Row = ("collision", "not proven: no robot model", "look")


def _reach(result: Result) -> list[Row]:
    """Whether the arm reaches all poses, and whether it collides."""
    if result.travel is not None:
        tone = "good" if result.travel.placed else "look"
        return [("reach", str(result.travel), tone), _NO_ROBOT]
    if result.reach is None:
        usual = result.post.cell().robot
        hint = f'; cell.robot = "{usual}" checks it, camgen robots lists others' if usual else ""
        return [("reach", f"not proven: no robot model{hint}", "look"), _NO_ROBOT]
    bounds, tone = "travel", "good"
    if isinstance(result.cell.home, Joints):
        bounds = f"limits, {_posture(result)}"
    robot = f"{result.reach.robot} reaches all of it within its {bounds}"
    if result.slow:
        tone = "look"
        robot += f", not at its feed on {counted(len(result.slow), 'path')}"
    robot += f" ({counted(len(result.reach.joints), 'pose')})"
    return [("reach", robot, tone), describe_collision(result)]


def describe_collision(result: Result) -> Row:
    """The proof that the arm, its tool and its cell do not meet."""
    if result.where is None or not result.where.untested:
        return ("collision", f"no collision, {_clearance(result)}", "good")
    pairs = ", ".join(map(str, result.where.untested))
    what = f"not proven: {pairs}; the others do not meet, {_clearance(result)}"
    return ("collision", what, "look")


#: Names of bodies that are intended to meet.
_MEETING = {("tool", "part"): "the tool at the part"}


def _clearance(result: Result) -> str:
    """The smallest distance between robot, holder, fixtures and part."""
    if result.clear is None:
        return "clearance not known"
    # Pairs that have to be in contact, and bodies that are always near each other.
    bodies = "all"
    if result.where and result.where.work.pairs:
        names = [_MEETING.get(pair, " at ".join(pair)) for pair in result.where.work.pairs]
        bodies = f"all but {', '.join(names)}"
    distance = f"{bodies} {short(result.clear.clearance, 2)} mm apart or more"
    return f"{distance}, least {result.clear.nearest}" if result.clear.nearest else distance


def _posture(result: Result) -> str:
    """Whether the text states the posture in which the arm was checked."""
    moves = [move for move in result.program.columns.moves if isinstance(move.target, Pose)]
    words = result.post.list_verified() & {"confdata", "figure", "switches"}
    stated = 0
    for move in moves:
        stated += any(getattr(move.posture, word, None) not in (None, ()) for word in words)
    if stated == len(moves):
        return "in the posture that the text states"
    if stated:
        poses = f"{grouped(stated)} of {counted(len(moves), 'pose')}"
        return f"in a posture that the text states at {poses}"
    return "in a posture that the text does not state"


def _describe_content(part: Part) -> str:
    """The number of instructions, curves, edges or contours of the input."""
    if isinstance(part, Recorded):
        kind = "a robot program" if part.run.whole else "G-code"
        return f"{kind} that gives {counted(len(part.run.body), 'instruction')}"
    if part.curves:
        total = len(part.curves)
        flat = sum(curve.level is not None for curve in part.curves)
        return f"{counted(total, 'curve')} ({grouped(total - flat)} in space, {grouped(flat)} flat)"
    if part.solid is not None:
        edges = part.solid.edges
        convex = grouped(sum(edge.convex for edge in edges))
        edge_text = f"{counted(len(edges), 'edge')}, {convex} convex"
        return f"{edge_text}, bodies: {describe_bodies(part.solid.bodies)}"
    total = len(part.contours)
    closed = sum(contour.closed for contour in part.contours)
    layers = sorted({contour.layer for contour in part.contours})
    kinds = f"{grouped(closed)} closed, {grouped(total - closed)} open"
    noun = "layer" if len(layers) == 1 else "layers"
    return f"{counted(total, 'contour')} ({kinds}), {noun} {join_names(layers)}"


def _job(job: Path | None, inputs: Sequence[Path]) -> list[Row]:
    """The job file that was used, and warnings of job files beside other inputs that were not."""
    rows: list[Row] = [("job", f"{job}", "plain")] if job else []
    for source in inputs[1:]:
        other = source.with_suffix(".toml")
        if other.is_file() and other != job:
            rows.append(("warning", f"{other} is not used: one job is for all inputs", "look"))
    return rows


def list_notes(notes: Sequence[Note], verbose: int) -> list[Row]:
    """A row for each note, the most severe kinds first.

    verbose: 0 for the first notes of each kind alone, with the number of the others.
    """
    rows: list[Row] = []
    for kind in GRAVEST:
        tone = "plain" if kind in _PLAIN else "look"
        of_kind = rows_of_notes((note for note in notes if note.kind == kind), tone)
        more = len(of_kind) - _NOTES
        if more > 0 and not verbose:
            count = f"and {grouped(more)} more (-v shows all, --report lists them)"
            of_kind[_NOTES:] = [(kind, count, tone)]
        rows += of_kind
    return rows


def _list_plan_rows(result: Result) -> list[Row]:
    work = math.fsum(path_sums(result.tour.paths)[0].tolist())
    tour = result.tour
    what = f"{tour.method}: work {format_length(work)}, "
    what += f"travel {format_length(tour.travel)}{_above(tour)}"
    if PLAIN in tour.method:
        what += "; the extra fast (pip install '.[fast]' in the folder of camgen) "
        what += "searches farther in this time"
    paths = counted(len(tour.paths), "path")
    return [("plan", f"{paths}, work {format_length(work)}", "plain"), ("tour", what, "plain")]


def _operations(result: Result) -> list[Row]:
    """A row for each of several operations: its tool, paths, time and removed volume."""
    rows: list[Row] = []
    for sums in result.operations:
        name = format_step(result.job, sums.number).removeprefix("operation ")
        what = f"{name}, {counted(sums.paths, 'path')}, about {duration(sums.seconds)}"
        if sums.removed is not None:
            from camgen.cli.stock import volume  # noqa: PLC0415 (shapely, only for cuts)

            what += f", {volume(sums.removed)} removed"
        rows.append(("operation", what, "plain"))
    return rows


def _programs(result: Result, programs: Sequence[tuple[Path, ProgramFile]]) -> list[Row]:
    """A row for each file. The first row of each of several programs names its tool."""
    rows: list[Row] = []
    for path, file in programs:
        size = f"{counted(file.lines, 'line')}, {format_size(len(file))}"
        rows.append(("program", f"{path}, {size}", "plain"))
    if len(result.counts) == 1:
        return rows
    changes = result.program.columns.list_kinds(ToolChange)
    for first, change in zip(accumulate((0, *result.counts)), changes, strict=False):
        label, text, tone = rows[first]
        size = f", diameter {change.diameter:g} mm" if change.diameter else ""
        rows[first] = (label, f"{text}: {change.name or 'tool'}{size}", tone)
    what = (
        f"{len(result.counts)}: a program of {result.post.name} cannot change tools; "
        "run them in this order, each with its tool"
    )
    return [*rows, ("programs", what, "look")]


def _stock(result: Result) -> list[Row]:
    """The proof of the material that the program removes."""
    if result.proof is None:
        why = "nothing is cut below the top face"
        steps: Sequence[Step | Job] = result.job.operations or [result.job]
        if any(step.operation.depth or step.operation.width for step in steps):
            why = explain_unproven(result.job) or "the part is not flat"
        return [("stock", f"not proven: {why}", "look")]
    from camgen.cli.stock import rows_of_build  # noqa: PLC0415 (shapely, only for cuts)

    return rows_of_build(result.proof)


def _coverage(result: Result) -> list[Row]:
    if result.coverage is None:
        return []
    if result.coverage.enough:
        return [("coverage", str(result.coverage), "plain")]
    return [("coverage", f"{result.coverage}; use a finer tool", "look")]


#: Gap between travel and lower bound that the digits of the summary do not show, in mm and as a
#: fraction of the travel. Such a travel is called the best possible.
_SAME_MM, _SAME_FRACTION = 0.002, 5e-4


def _above(tour: Tour) -> str:
    """The gap between the travel and its lower bound, empty if it is as long as the bound."""
    if tour.bound is None:
        return ""
    if tour.travel - tour.bound <= max(_SAME_MM, _SAME_FRACTION * tour.travel):
        return ", the best possible"
    if tour.bound == 0 or tour.travel >= 2 * tour.bound:
        return ""
    return f", at most {100 * (tour.travel / tour.bound - 1):.1f} % above the best possible"


class _Stages(Struct):
    """Shows the current stage on the terminal, and measures the time of each stage.

    terminal: output of the command.
    files: cache of the inputs, which is emptied after they are read.
    starts: name of each stage so far, and its start on the clock `perf_counter`, s.
    """

    terminal: Terminal
    files: Files
    starts: list[tuple[str, float]] = field(default_factory=list)

    def __call__(self, name: str) -> None:
        if name == "planning":
            self.files.release()
            gc.collect()  # The inputs are full of reference cycles.
        self.terminal.stage(name)
        if self.starts and name.startswith(f"{self.starts[-1][0]} "):
            return  # progress of the same stage
        self.starts.append((name, perf_counter()))

    def spent(self) -> str:
        """The time of each stage, that of the last one up to now."""
        stages = pairwise([*self.starts, ("", perf_counter())])
        return ", ".join(f"{name} {end - start:.2f} s" for (name, start), (_, end) in stages)


def run(arguments: Namespace, terminal: Terminal) -> None:
    """Build a program, write it and print the summary."""
    start = _start(arguments.start)
    names = [*arguments.inputs, *([arguments.locate] if arguments.locate is not None else [])]
    with pause_collector(), open_inputs(names, arguments.format) as (paths, files):
        inputs = paths[: len(arguments.inputs)]
        photo = paths[-1] if arguments.locate is not None else None
        stages = _Stages(terminal, files)
        job_file = find_job_file(arguments.job, None if arguments.inputs[0] == "-" else inputs[0])
        read = [*paths, job_file]
        aloud = arguments.output == "-"
        folder, program = _place(arguments.output)
        extra = list(map(to_path, (arguments.plan, arguments.report, arguments.preview)))
        check_targets([program, *extra], read)
        check_preview(arguments.preview)
        if arguments.post.endswith(".py"):
            files.read(arguments.post)  # Registers the file, which Python imports by itself.
        job = load_job(job_file, arguments.sets, files)
        job, photo_rows = _take_photo_settings(job, photo, job_file, files)
        with rename_errors("job", str(job_file or "job")):
            result = build(
                inputs,
                post=arguments.post,
                job=job,
                name=program.stem if program else "",
                strict=arguments.strict,
                watch=stages,
                files=files,
                locate=photo,
                start=start,
            )
        stages("writing")
        programs = list_program_files(result, folder, program)
        if aloud and len(programs) > 1:
            raise JobError(
                "-o -",
                f"the program takes {len(programs)} files, and standard output is one",
                remedy="give a folder with -o",
            )
        written = [] if aloud else programs
        targets = list_paths(written)
        check_targets([*targets, *extra], read)
        if program is None and targets:
            check_foreign(targets[0])
        check_programs([(path, file.head(HEADER_BYTES)) for path, file in written])
        if not arguments.force:
            check_edits(targets)
        write_all([*written, *_extras(arguments, result, list_paths(programs))], files.opened)
    if aloud:
        terminal.out(bytes(programs[0][1]).decode("ascii"))
        programs = [(Path("-"), programs[0][1])]
    summary = list_rows(result, job_file, inputs, programs, terminal.verbose)
    terminal.rows([*summary[:1], *photo_rows, *summary[1:]])
    if terminal.verbose:
        terminal.rows([("timing", stages.spent(), "plain")])


def _start(text: str | None) -> list[float] | None:
    """The approximate pose of the part: x, y (mm) and turn (deg)."""
    if text is None:
        return None
    try:
        return [float(word) for word in text.split(",")]
    except ValueError:
        raise JobError(
            "--start", f"{text!r} is not a pose", remedy="give X,Y,TURN in mm and deg"
        ) from None


def _take_photo_settings(
    job: Job, photo: Path | None, job_file: Path | None, files: Files
) -> tuple[Job, list[Row]]:
    """The job with [camera] and [image] of the photo's job file, if the job has neither."""
    photo_file = find_job_file(None, photo)
    if photo_file is None or photo_file == job_file:
        return job, []
    if job.camera != CameraTable() or job.image != ImageTable():
        what = f"{photo_file} is not used: [camera] and [image] are those of the job"
        return job, [("warning", what, "look")]
    tables = load_job(photo_file, [], files)
    rows: list[Row] = [("photo", f"[camera] and [image] of {photo_file}", "plain")]
    return replace(job, camera=tables.camera, image=tables.image), rows


def _place(output: str | None) -> tuple[Path, Path | None]:
    """The folder of the program, and its file; None unless `-o` names a file."""
    if output is None or output == "-":
        return Path(), None
    if os.path.isdir(output):  # Path.is_dir raises for a name that is too long.
        return Path(output), None
    if output.endswith(("/", os.sep)):
        raise JobError(output, "no such folder", remedy="make it first")
    return Path(output).parent, Path(output)


def _extras(
    arguments: Namespace, result: Result, programs: Sequence[Path]
) -> Iterator[tuple[Path, bytes]]:
    """The requested files of plan, report and preview, with their bytes."""
    if arguments.plan:
        data = encode(result.program, result.post.name, result.job.post, result.job.tolerance.chord)
        yield Path(arguments.plan), data
    if arguments.report:
        report = result.report | {"files": [clean(path.name) for path in programs]}
        text = msgspec.json.format(msgspec.json.encode(report), indent=2) + b"\n"
        yield Path(arguments.report), text
    if arguments.preview:
        target = Path(arguments.preview)
        yield target, draw_preview(result, target)
