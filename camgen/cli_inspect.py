"""``camgen inspect``: what is in a drawing."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

from camgen.cli_job import beside, load
from camgen.cli_say import Voice, out
from camgen.content import readable
from camgen.readers import inspect


def run(arguments: Namespace, says: Voice) -> int:
    """Prints the summary of a drawing, read with the ``[input]`` of the job."""
    path = Path(arguments.input)
    readable(path)
    job = load(beside(arguments.job, path), arguments.sets)
    says.stage("reading")
    found = str(inspect(path, job))
    says.clear()
    out(found.rstrip("\n") + "\n")
    return 0
