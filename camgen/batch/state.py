"""The state of a batch in the folder of its programs: a file of JSON lines, one per program.

With it a batch continues after a stop. A line is added after the files of the program are written,
so each readable line is true, even if the batch is killed. A line that was cut off is ignored, and
its part is built again.
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

# The messages between the batch and a process that builds: a task, and its outcome.


class Task(Struct, frozen=True):
    """One part to build.

    place: index of its input in the batch.
    source: its input.
    post: name of the controller.
    job: its job.
    job_file: name of the job file in errors.
    strict: whether anything left out is an error.
    version: version of camgen of the batch.
    carried: name, as in the job or the command, and bytes of each file that is sent with the task,
        the input first; empty for a builder with the same disk.
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
    """The sums of a program.

    paths: number of its paths.
    work_mm, travel_mm: length of its paths and of its links, mm.
    time_s: its time, s.
    notes: number of notes, by kind.
    """

    paths: int
    work_mm: float
    travel_mm: float
    time_s: float
    notes: dict[str, int]


class Outcome(Struct, frozen=True):
    """The outcome of a task.

    code: exit code of `camgen build`.
    error: its line without `camgen: error:`.
    trace: traceback of a fault.
    files: name and bytes of each file of the program.
    sums: sums of the program, None without one.
    """

    code: int
    error: str = ""
    trace: str = ""
    files: tuple[tuple[str, bytes], ...] = ()
    sums: BuildSums | None = None


def make_fault(what: str, trace: str = "") -> Outcome:
    """The outcome of a task that failed by a fault of its builder, not of its part."""
    return Outcome(1, what, trace)


#: Name of the file with the state of a batch.
NAME = "camgen-batch.jsonl"


class Record(Struct, frozen=True):
    """One program.

    program: its first file, relative to the folder.
    digest: digest of everything from which it was made.
    files: hash of each of its files, by name.
    sums: its sums.
    """

    program: str
    digest: str
    files: dict[str, str]
    sums: BuildSums


def load_records(folder: Path) -> dict[str, Record]:
    """The last record of each program in a folder."""
    try:
        lines = Files().open(folder / NAME).data.splitlines()
    except FileNotFoundError:
        return {}
    except OSError as error:
        raise JobError(str(folder / NAME), f"cannot be read: {error.strerror}") from error
    records: dict[str, Record] = {}
    for line in lines:
        try:
            record = msgspec.json.decode(line, type=Record)
        except (msgspec.MsgspecError, UnicodeDecodeError):
            continue
        records[record.program] = record
    return records


def add_record(folder: Path, record: Record) -> None:
    """Add a line. It starts with a line end, in case the last line was cut off."""
    try:
        with (folder / NAME).open("ab") as stream:
            stream.write(b"\n" + msgspec.json.encode(record))
    except OSError as error:
        raise JobError(str(folder / NAME), f"cannot be written: {error.strerror}") from error


def write_records(folder: Path, records: Mapping[str, Record]) -> None:
    """Replace the file by one line per program, sorted by name."""
    lines = [msgspec.json.encode(records[name]) + b"\n" for name in sorted(records)]
    write_all([(folder / NAME, b"".join(lines))], {})


def hash_bytes(data: bytes) -> str:
    """The hash of a file's bytes."""
    return hashlib.sha256(data).hexdigest()


def is_unchanged(record: Record | None, digest: str, folder: Path) -> bool:
    """Whether a program has the same sources as before, and its files are as they were written."""
    if record is None or record.digest != digest:
        return False
    try:
        for name, value in record.files.items():
            if hash_bytes(Files().open(folder / name).data) != value:
                return False
    except (OSError, ValueError, InputError):
        return False
    return True
