"""What travels between the batch and whoever builds a part: a task there, an outcome back."""

from __future__ import annotations

from pathlib import Path

from msgspec import Struct

from camgen.settings import Job


class Task(Struct, frozen=True):
    """One part to build.

    place: among the inputs of the batch. job_file: as errors call it. version: of the camgen that asks. carried: files
    that travel with the task, the input first: (name as the job or the user has it, bytes); empty where the builder
    sees the same disk.
    """

    place: int
    source: Path
    post: str
    job: Job
    job_file: str
    strict: bool
    version: str
    carried: tuple[tuple[str, bytes], ...] = ()


class Sums(Struct, frozen=True):
    """What a program amounts to: mm, s; notes: how many of each kind."""

    paths: int
    work_mm: float
    travel_mm: float
    time_s: float
    notes: dict[str, int]


class Outcome(Struct, frozen=True):
    """What became of a task. code: the exit code that ``camgen build`` would return. error: its line without
    ``camgen: error:``. trace: the traceback of a fault. files: the program, name and bytes of every file.
    """

    code: int
    error: str = ""
    trace: str = ""
    files: tuple[tuple[str, bytes], ...] = ()
    sums: Sums | None = None


def fault(what: str, trace: str = "") -> Outcome:
    """The outcome of a task whose builder failed instead of the part."""
    return Outcome(1, what, trace)
