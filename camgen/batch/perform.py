"""Builds one part of a batch, in whatever process it is called."""

from __future__ import annotations

import gc
import traceback
from collections import Counter
from pathlib import Path

import msgspec
from msgspec import Struct

from camgen.batch.state import BuildSums, Outcome, Task, fault
from camgen.model.errors import CamgenError, rename_errors
from camgen.model.files import Source
from camgen.model.job import Job
from camgen.model.version import __version__
from camgen.pipeline import Result, build, list_program_files
from camgen.pipeline.memory import no_collector
from camgen.read.files import Files


class _Lengths(Struct):
    work_mm: float
    travel_mm: float


class _Told(Struct):
    """What is taken from the report of a build."""

    tour: _Lengths
    time_s: float


def perform(task: Task) -> Outcome:
    """The program of a part, or the reason why there is none. Nothing is written."""
    if task.version != __version__:
        return fault(
            f"{task.source}: the worker runs camgen {__version__}, the batch {task.version}"
        )
    with no_collector():
        outcome = _outcome(task)
        gc.collect()  # the drawing is a heap of cycles; what was there before this part is not looked at
    return outcome


def _outcome(task: Task) -> Outcome:
    files = Files(Source(Path(name), data) for name, data in task.carried)
    try:
        with rename_errors("job", task.job_file):
            result = build(
                task.source, post=task.post, job=task.job, strict=task.strict, files=files
            )
            made = tuple(
                (path.name, bytes(file)) for path, file in list_program_files(result, Path(), None)
            )
            return Outcome(0, files=made, sums=_sums(result))
    except CamgenError as error:
        return Outcome(error.exit_code, str(error))
    except (
        Exception
    ) as error:  # whatever it is, it is this part's line and the others go on, as in cli.main
        return fault(
            f"{task.source}: fault: {type(error).__name__}: {error}", traceback.format_exc()
        )


def _sums(result: Result) -> BuildSums:
    told = msgspec.convert(result.report, _Told)  # the numbers are those of build's report
    notes = dict(sorted(Counter[str](note.kind for note in result.notes).items()))
    return BuildSums(
        len(result.tour.paths), told.tour.work_mm, told.tour.travel_mm, told.time_s, notes
    )


def list_carried(job: Job) -> list[str]:
    """The files that a job names and that can travel."""
    meshes = [one for one in job.cell.fixtures or () if isinstance(one, str)]
    photos = [job.image.background, job.image.lamp_moved]
    names = [*photos, job.camera.file, job.cell.machine, *meshes]
    return [name for name in dict.fromkeys(names) if name]
