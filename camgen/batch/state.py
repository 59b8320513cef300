"""What a folder of programs was made from: one file of JSON lines, so that a batch can go on where it stopped.

A line is added after the program's files are there, so whatever kills the batch, a line that can be read is true. A
line that was cut off is as if it were not there: its part is built again.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path

import msgspec
from msgspec import Struct

from camgen.batch.writing import write_all
from camgen.model.errors import InputError, JobError
from camgen.model.job import Job
from camgen.read.files import Files

# What travels between the batch and whoever builds a part: a task there, an outcome back.


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


class BuildSums(Struct, frozen=True):
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
    sums: BuildSums | None = None


def fault(what: str, trace: str = "") -> Outcome:
    """The outcome of a task whose builder failed instead of the part."""
    return Outcome(1, what, trace)


NAME = "camgen-batch.jsonl"


class Record(Struct, frozen=True):
    """One program. program: its first file, in the folder. digest: of all that it was made from. files: the hash of
    every file.
    """

    program: str
    digest: str
    files: dict[str, str]
    sums: BuildSums


def load_records(folder: Path) -> dict[str, Record]:
    """The records of a folder by program; of several the last."""
    try:
        lines = Files().open(folder / NAME).data.splitlines()
    except FileNotFoundError:
        return {}
    except OSError as error:
        raise JobError(str(folder / NAME), f"cannot be read: {error.strerror}") from error
    found: dict[str, Record] = {}
    for line in lines:
        try:
            record = msgspec.json.decode(line, type=Record)
        except (msgspec.MsgspecError, UnicodeDecodeError):
            continue
        found[record.program] = record
    return found


def add(folder: Path, record: Record) -> None:
    """One more line, after a line end in case that the last one was cut off."""
    try:
        with (folder / NAME).open("ab") as stream:
            stream.write(b"\n" + msgspec.json.encode(record))
    except OSError as error:
        raise JobError(str(folder / NAME), f"cannot be written: {error.strerror}") from error


def tidy(folder: Path, records: Mapping[str, Record]) -> None:
    """One line for each program, in order."""
    lines = [msgspec.json.encode(records[name]) + b"\n" for name in sorted(records)]
    write_all([(folder / NAME, b"".join(lines))], {})


def hash_bytes(data: bytes) -> str:
    """The hash of a file's bytes."""
    return hashlib.sha256(data).hexdigest()


def is_unchanged(record: Record | None, digest: str, folder: Path) -> bool:
    """Whether a program was made from the same and is still what was written."""
    if record is None or record.digest != digest:
        return False
    try:
        return all(
            hash_bytes(Files().open(folder / name).data) == value
            for name, value in record.files.items()
        )
    except (OSError, ValueError, InputError):
        return False
