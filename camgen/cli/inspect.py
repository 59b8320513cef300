"""``camgen inspect``: what is in a drawing."""

from __future__ import annotations

from argparse import Namespace

from camgen.cli.inputs import open_inputs
from camgen.cli.say import Voice
from camgen.model.errors import JobError
from camgen.model.files import Source
from camgen.model.job import Job
from camgen.read import find_reader, is_drawing
from camgen.read.contours import ContourFacts, list_contours
from camgen.read.files import Files
from camgen.read.job_file import beside, load


def run(arguments: Namespace, says: Voice) -> int:
    """Prints the summary of a drawing, read with the ``[input]`` of the job; ``--against``: what of a photo differs."""
    if arguments.against:
        from camgen.cli.against import run as run_against  # noqa: PLC0415 (OpenCV and shapely, only for photos)

        return run_against(arguments, says)
    for option in ("least", "preview", "removal", "rework", "strict"):
        if getattr(arguments, option):
            raise JobError(
                f"--{option}",
                "has no effect without --against",
                remedy="give the drawing of the part",
            )
    with open_inputs([arguments.input], arguments.format) as (paths, opened):
        job = load(
            beside(arguments.job, None if arguments.input == "-" else paths[0]),
            arguments.sets,
            opened,
        )
        files = opened.within(job.limits)
        source = files.read(paths[0])
        says.stage("reading")
        found = _inspect(source, job, files)
        contours = _list_contours(source, job, files) if says.verbose else []
    says.clear()
    if arguments.json:
        says.data(
            {"source": source.name, "facts": found} | ({"contours": contours} if contours else {})
        )
    else:
        says.out(str(found).rstrip("\n") + "\n" + "".join(f"{one}\n" for one in contours))
    return 0


def _list_contours(source: Source, job: Job, files: Files) -> list[ContourFacts]:
    """The contours of what is a drawing, by the ids of ``operations.ids`` and ``tour.order``."""
    reader = find_reader(source)
    return list_contours(reader.read(source, job, files)) if reader.makes == "drawing" else []


def _inspect(source: Source, job: Job, files: Files) -> object:
    """What is in the file, or what the job makes of a picture that it takes for a drawing."""
    reader = find_reader(source)
    if reader.makes == "picture" and is_drawing(job):
        from camgen.plan.page import inspect as inspect_drawing  # noqa: PLC0415 (only for pictures)

        return inspect_drawing(reader.read(source, job, files), job)
    return reader.inspect(source, job, files)
