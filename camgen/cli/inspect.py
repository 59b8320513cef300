"""``camgen inspect``: what is in a drawing."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

from camgen.cli.say import Voice, out
from camgen.model.files import readable
from camgen.model.job import Job
from camgen.model.job_tables import beside, load
from camgen.read import inspect, kind_of, meant


def run(arguments: Namespace, says: Voice) -> int:
    """Prints the summary of a drawing, read with the ``[input]`` of the job."""
    path = Path(arguments.input)
    readable(path)
    job = load(beside(arguments.job, path), arguments.sets)
    says.stage("reading")
    found = str(_found(path, job))
    says.clear()
    out(found.rstrip("\n") + "\n")
    return 0


def _found(path: Path, job: Job) -> object:
    """What is in the file, or what the job makes of a picture that it takes for a drawing."""
    if kind_of(path) == "image":
        from camgen.plan.page import inspect as inspect_drawing  # noqa: PLC0415 (only for pictures)

        if meant(job):
            return inspect_drawing(path, job)
    return inspect(path, job)
