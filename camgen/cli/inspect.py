"""``camgen inspect``: the contents of a drawing."""

from __future__ import annotations

from argparse import Namespace

from camgen.cli.inputs import open_inputs
from camgen.cli.say import Terminal
from camgen.model.errors import JobError
from camgen.model.files import Source
from camgen.model.job import Job
from camgen.model.part import Part
from camgen.model.text import short_each
from camgen.read import find_reader, is_drawing
from camgen.read.clamps import set_clamps_aside
from camgen.read.extent import list_contours
from camgen.read.files import Files
from camgen.read.job_file import find_job_file, load_job
from camgen.read.move import move_part


def run(arguments: Namespace, terminal: Terminal) -> None:
    """Prints the summary of a drawing, read with the `[input]` of the job.

    With `--against`, prints the differences of a photo.
    """
    if arguments.against:
        # OpenCV and shapely, which only photos need.
        from camgen.cli.against import run as run_against  # noqa: PLC0415

        run_against(arguments, terminal)
        return
    for option in ("least", "preview", "removal", "rework", "strict"):
        if getattr(arguments, option):
            raise JobError(
                f"--{option}",
                "has no effect without --against",
                remedy="give the drawing of the part",
            )
    with open_inputs([arguments.input], arguments.format) as (paths, opened):
        job = load_job(
            find_job_file(arguments.job, None if arguments.input == "-" else paths[0]),
            arguments.sets,
            opened,
        )
        files = opened.within(job.limits)
        source = files.read(paths[0])
        terminal.stage("reading")
        facts = _inspect(source, job, files)
        part = _read_drawing(source, job, files) if terminal.verbose or job.input.origin else None
    contours = list_contours(part) if part is not None and terminal.verbose else []
    moved = part.moved if part is not None else None
    if arguments.json:
        data: dict[str, object] = {"source": source.name, "facts": facts}
        if contours:
            data["contours"] = contours
        if moved:
            data["moved"] = moved
        terminal.data(data)
        return
    lines = [str(facts).rstrip("\n"), *map(str, contours), ""]
    if moved:
        x, y = short_each(moved, 6)
        lines.insert(1, f"moved by x {x}, y {y} mm: input.origin is x 0, y 0")
    terminal.out("\n".join(lines))


def _read_drawing(source: Source, job: Job, files: Files) -> Part | None:
    """The part in a drawing, None for other inputs. Its ids are those of `operations.ids`."""
    reader = find_reader(source)
    if reader.makes != "drawing":
        return None
    return move_part(set_clamps_aside(reader.read(source, job, files), job), job)


def _inspect(source: Source, job: Job, files: Files) -> object:
    """The facts of a file, or of the drawing that the job makes of a picture."""
    reader = find_reader(source)
    if reader.makes == "picture" and is_drawing(job):
        from camgen.plan.page import inspect as inspect_drawing  # noqa: PLC0415 (only for pictures)

        return inspect_drawing(reader.read(source, job, files), job)
    return reader.inspect(source, job, files)
