"""``camgen inspect``: what is in a drawing."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

from camgen.cli_job import beside, load
from camgen.cli_say import Voice, out
from camgen.content import readable
from camgen.readers import inspect, kind_of
from camgen.settings import Job


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
        from camgen import drawn  # noqa: PLC0415 (only for pictures)

        if drawn.meant(job):
            return drawn.inspect(path, job)
    return inspect(path, job)
