"""Builds one part of a batch, in any process."""

from __future__ import annotations

import gc
import traceback
from collections import Counter
from pathlib import Path
from typing import Any

from camgen.batch.state import BuildSums, Outcome, Task, make_fault
from camgen.model.errors import CamgenError, rename_errors
from camgen.model.files import Source
from camgen.model.job import Job
from camgen.model.version import __version__
from camgen.pipeline import Result, build, list_program_files
from camgen.pipeline.memory import pause_collector
from camgen.read.files import Files


def build_task(task: Task) -> Outcome:
    """The program of a part, or the reason why it cannot be built. Nothing is written."""
    if task.version != __version__:
        what = f"the worker runs camgen {__version__}, the batch {task.version}"
        return make_fault(f"{task.source}: {what}")
    with pause_collector():
        outcome = _build(task)
        # A drawing is full of reference cycles. Objects from before this part are frozen.
        gc.collect()
    return outcome


def _build(task: Task) -> Outcome:
    files = Files(Source(Path(name), data) for name, data in task.carried)
    try:
        with rename_errors("job", task.job_file):
            result = build(
                task.source, post=task.post, job=task.job, strict=task.strict, files=files
            )
            program = list_program_files(result, Path(), None)
            files_written = tuple((path.name, bytes(file)) for path, file in program)
            return Outcome(0, files=files_written, sums=_sum_report(result))
    except CamgenError as error:
        return Outcome(error.exit_code, str(error))
    except Exception as error:  # any fault is the line of this part, as in cli.main
        what = f"{task.source}: fault: {type(error).__name__}: {error}"
        return make_fault(what, traceback.format_exc())


def _sum_report(result: Result) -> BuildSums:
    report: Any = result.report
    tour = report["tour"]
    notes = dict(sorted(Counter[str](note.kind for note in result.notes).items()))
    return BuildSums(
        len(result.tour.paths), tour["work_mm"], tour["travel_mm"], report["time_s"], notes
    )


def list_carried(job: Job) -> list[str]:
    """The files that a job names and that can be sent to a cluster."""
    names = [job.image.background, job.image.lamp_moved, job.camera.file, job.cell.machine]
    names += [fixture for fixture in job.cell.fixtures or () if isinstance(fixture, str)]
    return list(filter(None, dict.fromkeys(names)))
