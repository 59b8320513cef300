"""``camgen place``: how a 3-D part should stand before an arm, as a job file with its cell.

If a second set-up works more, both are written as whole jobs with program and picture.
"""

from __future__ import annotations

import math
from argparse import Namespace
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import SupportsBytes

import numpy as np

from camgen.batch.writing import (
    HEADER_BYTES,
    check_programs,
    check_targets,
    is_edited,
    list_paths,
    write_all,
)
from camgen.cli.build import describe_collision, list_notes
from camgen.cli.job_text import write_table, write_tables
from camgen.cli.say import Row, Terminal, join_rows, label_rows
from camgen.model.errors import JobError, make_one_line, rename_errors
from camgen.model.text import counted, duration, grouped, harmless, short, short_each
from camgen.model.version import __version__
from camgen.pipeline import list_program_files, make_job_post
from camgen.pipeline.inputs import read_inputs
from camgen.pipeline.memory import pause_collector
from camgen.pipeline.place import (
    SET_UPS,
    Request,
    RestingPose,
    Search,
    Trial,
    measure_worked,
    name_set_up,
    search_place,
)
from camgen.preview.drawings import draw_preview
from camgen.read.files import Files
from camgen.read.job_file import find_job_file, load_job

#: Edges that the summary lists.
_LISTED = 12


def run(arguments: Namespace, terminal: Terminal) -> None:
    """Searches, writes the cell and the set-ups, and sums up."""
    source, target = Path(arguments.input), Path(arguments.output)
    if arguments.height is not None and not math.isfinite(arguments.height):
        raise JobError(
            "--height",
            f"{arguments.height} is not a height",
            remedy="give mm above the base of the robot",
        )
    job_file = find_job_file(arguments.job, source)
    read_files = [source, job_file]
    possible = [target]
    for number in range(1, SET_UPS + 1):
        job_target = _name_job(target, number)
        possible += [job_target, job_target.with_suffix(".svg")]
    check_targets(possible, read_files)
    files = Files()
    with pause_collector(), rename_errors("job", str(job_file or "job")):
        job = load_job(job_file, arguments.sets, files)
        poster = make_job_post(arguments.post, job, str(job_file or "job"))
        terminal.stage("reading")
        read = read_inputs([source], job, poster.cell(), files.within(job.limits))
        request = Request(source, arguments.post, target.stem)
        result = search_place(read.part, job, read.cell, request, arguments.height, terminal.stage)
        terminal.stage("writing")
        written: list[tuple[Path, SupportsBytes]] = [
            (target, _write_cell(result, source.name, target.parent).encode())
        ]
        if len(result.set_ups) > 1:
            for number in range(1, SET_UPS + 1):
                written += _write_set_up(result, number, source.name, target)
    targets = list_paths(written)
    check_targets(targets, read_files)
    write_all(written, files.opened)
    if not terminal.quiet:
        terminal.out(f"base_from_work = {list(result.best[0].base_from_work)}\n")
    terminal.rows([*_describe(result), *_list_edges(result, _LISTED)])
    terminal.rows(label_rows("written", targets, "good"))


def _name_job(target: Path, number: int) -> Path:
    """The job file of a set-up, beside the file of the cell."""
    return target.with_name(f"{name_set_up(target.stem, number)}.toml")


def _write_cell(result: Search, part: str, folder: Path) -> str:
    """The file of the cell of the best set-up."""
    head = [f"camgen {__version__}: where {harmless(part)} should stand"]
    head += join_rows([*_describe(result), *_list_edges(result)])
    return _join(head, write_table("cell", result.best[0].job.cell, folder))


def _write_set_up(
    result: Search, number: int, part: str, target: Path
) -> Iterator[tuple[Path, SupportsBytes]]:
    """The files of a set-up: job, program and picture.

    Raises JobError if a program would replace that of another part, or one that was edited.
    """
    trial = result.set_ups[number - 1]
    assert trial.result is not None
    job = _name_job(target, number)
    suffix = Path(trial.result.files[0].name).suffix
    programs = list_program_files(trial.result, job.parent, job.with_suffix(suffix))
    check_programs([(path, file.head(HEADER_BYTES)) for path, file in programs])
    targets = list_paths(programs)
    for path in targets:
        if is_edited(path):
            raise JobError(
                str(path), "was edited since camgen wrote it", remedy="give another name with -o"
            )
    picture = job.with_suffix(".svg")
    names = ", ".join(path.name for path in targets)
    head = [
        f"camgen {__version__}: set-up {number} of {len(result.set_ups)} of {harmless(part)}",
        f"program: {harmless(names)}, picture: {harmless(picture.name)}",
        f"set-up {number}: {_describe_trial(result, trial)}",
        *_describe_frame(trial),
        *join_rows([*_list_findings(trial), *_list_edges(result)]),
    ]
    yield job, _join(head, write_tables(trial.job, job.parent)).encode()
    yield from programs
    yield picture, draw_preview(trial.result, picture)


def _join(head: list[str], lines: list[str]) -> str:
    return "\n".join([*(f"# {make_one_line(line)}" for line in head), *lines, ""])


def _describe(result: Search) -> list[Row]:
    """The places that were built, the set-ups, and the size of the search."""
    best, *others = result.best
    remark = ", where the job has it" if best is result.as_given else ""
    rows: list[Row] = [("place", _describe_trial(result, best) + remark, "plain")]
    for trial in others:
        if trial is not result.as_given:
            rows.append(("next best", _describe_trial(result, trial), "plain"))
    if best is not result.as_given:
        rows.append(("the job's", _describe_trial(result, result.as_given), "plain"))
    if len(result.set_ups) > 1:
        for number, trial in enumerate(result.set_ups, 1):
            rows.append((f"set-up {number}", _describe_trial(result, trial), "plain"))
            rows += label_rows("", _describe_frame(trial))
            rows += _list_findings(trial)
        rows.append(("together", _format_worked(result, result.set_ups), "plain"))
    rows.append(("searched", _describe_search(result), "plain"))
    return rows


def _describe_search(result: Search) -> str:
    grid, near = result.places
    searched = sum(resting_pose.face is not None for resting_pose in result.case.resting_poses)
    faces = counted(result.case.faces, "resting face")
    if searched < result.case.faces:
        faces = f"the {searched} largest of {faces}"
    return f"{faces}, {counted(grid, 'place')} by the joints alone, {near} with collisions"


def _describe_trial(result: Search, trial: Trial) -> str:
    """The place of the part, and the edges that are worked there."""
    spot = trial.spot
    time = f", about {duration(trial.seconds)}" if trial.worked else ""
    return (
        f"{_describe_resting_pose(trial.resting_pose)}, {short(spot.distance, 1)} mm from axis 1, "
        f"{short(spot.height, 1)} mm up, turned by {short(spot.turn, 2)} deg: "
        f"{_format_worked(result, [trial])}{time}"
    )


def _format_worked(result: Search, trials: Sequence[Trial]) -> str:
    worked = measure_worked(result.case.edges, trials)
    length, total = short_each((sum(worked.values()), result.length), 1)
    edges = counted(len(result.case.edges), "edge")
    return f"{grouped(len(worked))} of {edges}, {length} of {total} mm"


def _describe_resting_pose(resting_pose: RestingPose) -> str:
    if resting_pose.is_own:
        return "as the job has it"
    axis, angle = resting_pose.turned
    return f"turned over by {short(math.degrees(angle), 2)} deg about {_format_vector(axis)}"


def _describe_frame(trial: Trial) -> list[str]:
    """The face, the rotation and the frame, for the operator."""
    resting_pose, lines = trial.resting_pose, []
    if resting_pose.face is not None:
        face = resting_pose.face
        lines.append(
            f"rests on the face of {' x '.join(short_each(face.size, 1))} mm with the middle "
            f"{_format_vector(face.middle)} mm and the normal {_format_vector(face.normal)}, "
            "in the frame of the part"
        )
    if not resting_pose.is_own:
        axis, angle = resting_pose.turned
        turned = f"{short(math.degrees(angle), 2)} deg about {_format_vector(axis)} of the part"
        lines.append(
            f"turned from how the file has it by {turned}; a table is assumed under it, "
            "fixtures of the job do not stand there"
        )
    return [*lines, f"base_from_work = {list(trial.base_from_work)}"]


def _list_findings(trial: Trial) -> list[Row]:
    """The proof of a set-up, and its notes without those on edges, which are listed by edge."""
    assert trial.result is not None
    notes = [note for note in trial.result.notes if note.kind != "skipped" or not note.ids]
    return [describe_collision(trial.result), *list_notes(notes, verbose=1)]


def _format_vector(values: np.ndarray) -> str:
    return f"[{', '.join(short_each(values.tolist(), 3))}]"


def _list_edges(result: Search, limit: int | None = None) -> list[Row]:
    """A line for each edge: in which set-up it is worked, or why in none.

    limit: number of edges that are listed, those first of which something is left.
    """
    names = list(result.case.edges)
    if limit is not None:
        names.sort(key=lambda name: _order_edge(result, name))
    rows = [_row_of_edge(result, name) for name in names[:limit]]
    if len(rows) < len(names):
        more = f"and {grouped(len(names) - len(rows))} more, listed in the job file"
        rows.append(("edges", more, "plain"))
    return rows


def _order_edge(result: Search, name: str) -> int:
    """0 for an edge that is not worked, 1 for one in pieces, 2 for a whole one."""
    if any(name in trial.whole for trial in result.set_ups):
        return 2
    return int(any(name in trial.worked for trial in result.set_ups))


def _row_of_edge(result: Search, name: str) -> Row:
    length = result.case.edges[name].length
    parts = []
    for number, trial in enumerate(result.set_ups, 1):
        if name in trial.whole:
            parts.append(f"whole in set-up {number}")
        elif name in trial.worked:
            worked = short(length * float(trial.worked[name].mean()), 1)
            parts.append(f"{worked} of {short(length, 1)} mm in set-up {number}")
    state = _order_edge(result, name)
    if state == 2:
        return (name, ", ".join(parts), "plain")
    parts += _list_reasons(result.set_ups, name)
    if state == 0:
        parts.insert(0, f"{short(length, 1)} mm not worked")
    return (name, "; ".join(parts), "look")


def _list_reasons(set_ups: Sequence[Trial], name: str) -> list[str]:
    """Why the set-ups do not work an edge, or all of it."""
    reasons = [trial.reasons.get(name, "") for trial in set_ups]
    if len(set(reasons)) == 1:
        return [reasons[0]]
    return [f"set-up {number}: {reason}" for number, reason in enumerate(reasons, 1) if reason]
