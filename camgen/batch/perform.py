"""Builds one part of a batch, in whatever process it is called."""

from __future__ import annotations

import gc
import tempfile
import traceback
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import msgspec
from msgspec import Struct
from msgspec.structs import replace

from camgen.batch.state import Outcome, Sums, Task, fault
from camgen.build import Result, build, no_collector, program_files
from camgen.model.errors import CamgenError, told_as
from camgen.model.job import Job
from camgen.model.version import __version__


class _Lengths(Struct):
    work_mm: float
    travel_mm: float


class _Told(Struct):
    """What is taken from the report of a build."""

    tour: _Lengths
    time_s: float


def perform(task: Task) -> Outcome:
    """The program of a part, or the reason why there is none. Nothing is written but what travelled with the task."""
    if task.version != __version__:
        return fault(f"{task.source}: the worker runs camgen {__version__}, the batch {task.version}")
    with no_collector():
        outcome = _outcome(task)
        gc.collect()  # the drawing is a heap of cycles; what was there before this part is not looked at
    return outcome


def _outcome(task: Task) -> Outcome:
    names: dict[str, str] = {}
    try:
        with _at_hand(task, names) as (source, job), told_as("job", task.job_file):
            result = build(source, post=task.post, job=job, strict=task.strict)
            files = tuple((path.name, data) for path, data in program_files(result, Path(), None))
            return Outcome(0, files=files, sums=_sums(result))
    except CamgenError as error:
        return Outcome(error.exit_code, _as_given(str(error), names))
    except Exception as error:  # whatever it is, it is this part's line and the others go on, as in cli.main
        what = f"{task.source}: fault: {type(error).__name__}: {error}"
        return fault(_as_given(what, names), traceback.format_exc())


def _sums(result: Result) -> Sums:
    told = msgspec.convert(result.report, _Told)  # the numbers are those of build's report
    notes = dict(sorted(Counter[str](note.kind for note in result.notes).items()))
    return Sums(len(result.tour.paths), told.tour.work_mm, told.tour.travel_mm, told.time_s, notes)


@contextmanager
def _at_hand(task: Task, names: dict[str, str]) -> Iterator[tuple[Path, Job]]:
    """The input and the job. What travelled becomes files for as long as this lasts; ``names`` gets, for each, what
    the user calls it.
    """
    if not task.carried:
        yield task.source, task.job
        return
    with tempfile.TemporaryDirectory(prefix="camgen-") as folder:
        here: dict[str, str] = {}
        for k, (name, data) in enumerate(task.carried):
            file = (
                Path(folder) / str(k) / Path(name).name
            )  # reports and headers have the name of a file, not its folder
            file.parent.mkdir()
            file.write_bytes(data)
            here[name] = str(file)
            names[str(file)] = name
        yield Path(here[str(task.source)]), _moved(task.job, here)


def carried_names(job: Job) -> list[str]:
    """The files that a job names and that can travel."""
    meshes = [one for one in job.cell.fixtures or () if isinstance(one, str)]
    return [name for name in dict.fromkeys([job.image.background, job.camera.file, *meshes]) if name]


def _moved(job: Job, here: Mapping[str, str]) -> Job:
    image = replace(job.image, background=here.get(job.image.background, ""))
    camera = replace(job.camera, file=here.get(job.camera.file, ""))
    cell = job.cell
    if cell.fixtures:
        cell = replace(cell, fixtures=[here[one] if isinstance(one, str) else one for one in cell.fixtures])
    return replace(job, image=image, camera=camera, cell=cell)


def _as_given(text: str, names: Mapping[str, str]) -> str:
    for here, name in names.items():
        text = text.replace(here, name)
    return text
