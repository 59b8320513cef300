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

from camgen.batch.values import Sums
from camgen.errors import JobError
from camgen.writing import write_all

NAME = "camgen-batch.jsonl"


class Record(Struct, frozen=True):
    """One program. program: its first file, in the folder. digest: of all that it was made from. files: the hash of
    every file.
    """

    program: str
    digest: str
    files: dict[str, str]
    sums: Sums


def known(folder: Path) -> dict[str, Record]:
    """The records of a folder by program; of several the last."""
    try:
        lines = (folder / NAME).read_bytes().splitlines()
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
    write_all([(folder / NAME, b"".join(lines))])


def hashed(data: bytes) -> str:
    """The hash of a file's bytes."""
    return hashlib.sha256(data).hexdigest()


def unchanged(record: Record | None, digest: str, folder: Path) -> bool:
    """Whether a program was made from the same and is still what was written."""
    if record is None or record.digest != digest:
        return False
    try:
        return all(hashed((folder / name).read_bytes()) == value for name, value in record.files.items())
    except OSError:
        return False
