"""Reads input files as parts, with notes on everything that was skipped, repaired or assumed.

The formats are an open table, the entry points `camgen.readers` of camgen and of other packages:
see docs/writing-a-reader.md.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Literal

from msgspec import Struct

from camgen.model.errors import InputError, JobError
from camgen.model.files import SCAN, Source
from camgen.model.job import CameraTable, Job
from camgen.model.part import Part
from camgen.model.plugins import find_origin, list_entries, load, run_plugin
from camgen.read.clamps import set_clamps_aside
from camgen.read.files import Files
from camgen.read.move import move_part

READERS = "camgen.readers"
#: Bytes from the beginning of a file by which a format is recognised.
HEAD = 256
#: Suffixes of point clouds that no other format has.
_CLOUDS = (".pcd",)

_DEFAULTS = Job()


def recognise_none(_head: bytes) -> bool:
    """False: for a format that is recognised by its suffix alone."""
    return False


class Reader(Struct, frozen=True):
    """The reader of a format.

    name: name of its entry point.
    about: noun for a sentence, such as "a DXF drawing".
    suffixes: suffixes in lower case with their dot; "" is for files without a suffix.
    makes: kind of part that it makes.
    read: returns the part in a file, mm. Raises InputError for a file without one.
    inspect: returns the content of a file as a value. Its `str` is a page to print.
    recognise: whether the first `HEAD` bytes of a file are those of this format.

    `read` and `inspect` get a `Files`, with which they open other files that the job or the input
    names.
    """

    name: str
    about: str
    suffixes: tuple[str, ...]
    makes: Literal["drawing", "picture", "solid", "program", "curves"]
    read: Callable[[Source, Job, Files], Part]
    inspect: Callable[[Source, Job, Files], object]
    recognise: Callable[[bytes], bool] = recognise_none


class InstalledReader(Struct, frozen=True):
    """A row of the table of readers.

    entry: its entry point.
    reader: None if it cannot be used.
    broken: the reason why it cannot be used, otherwise "".
    """

    entry: EntryPoint
    reader: Reader | None
    broken: str

    @property
    def name(self) -> str:
        """Name for the option `--format`."""
        return self.entry.name

    @property
    def origin(self) -> str:
        """Name of its package. It is found on access, because metadata are slow to read."""
        return find_origin(self.entry)


def list_installed() -> list[InstalledReader]:
    """All readers by name, and for each one that cannot be used the reason."""
    rows = []
    for entry in list_entries(READERS):
        try:
            rows.append(InstalledReader(entry, _load(entry), ""))
        except JobError as error:
            rows.append(InstalledReader(entry, None, str(error)))
    return rows


def _load(entry: EntryPoint) -> Reader:
    reader = load(entry)
    if isinstance(reader, Reader) and reader.name == entry.name:
        return reader
    what = "is not a camgen.read.Reader"
    if isinstance(reader, Reader):
        what = f"is called {reader.name}"
    raise JobError(f"reader {entry.name}", what, entry.value, "repair or remove its package")


def find_reader(source: Source) -> Reader:
    """The reader that recognises the first bytes of an input, or else the one with its suffix.

    A reader that fails is left out and named in the message if no other one is found.

    Raises InputError if there is no such reader, or more than one.
    """
    readers: list[Reader] = []
    matching: list[Reader] = []
    broken = ""
    for installed in list_installed():
        reader = installed.reader
        if reader is None:
            broken += f"; {installed.broken}"
            continue
        recognise = partial(reader.recognise, source.data[:HEAD])
        try:
            is_recognised = run_plugin(installed.entry, "look at a file", recognise)
        except JobError as error:
            broken += f"; {error}"
            continue
        readers.append(reader)
        if is_recognised:
            matching.append(reader)
    matching = matching or [reader for reader in readers if source.suffix in reader.suffixes]
    if len(matching) == 1:
        return matching[0]
    if matching:
        raise InputError(
            source.name,
            f"is claimed by the readers {' and '.join(reader.name for reader in matching)}",
            remedy="remove the package of one of them",
        )
    remedy = f"give {', '.join(reader.about for reader in readers)}{broken}"
    if source.suffix in _CLOUDS:
        remedy = SCAN
    raise InputError(source.name, "is not a kind of file that camgen reads", remedy=remedy)


def find_suffix(name: str) -> str:
    """The suffix of files of a format.

    name: name of its reader, or one of its suffixes without the dot.

    Raises JobError for another name.
    """
    table = list_installed()
    for installed in table:
        if installed.name == name and installed.broken:
            raise JobError("--format", installed.broken)
        if installed.reader is not None and f".{name}" in installed.reader.suffixes:
            return f".{name}"
    for installed in table:
        if installed.reader is not None and installed.name == name:
            return next((suffix for suffix in installed.reader.suffixes if suffix), "")
    names = ", ".join(installed.name for installed in table)
    raise JobError(
        "--format", f"no reader is called {name}", remedy=f"give one of {names}, or a suffix"
    )


def read(path: str | Path, job: Job = _DEFAULTS, files: Files | None = None) -> Part:
    """The part in the file `path`, mm. Raises InputError if it has none.

    files: files that were read before and are not read again.
    """
    files = (files or Files()).within(job.limits)
    source = files.read(path)
    part = find_reader(source).read(source, job, files)
    return move_part(set_clamps_aside(part, job), job)


def inspect(path: str | Path, job: Job = _DEFAULTS, files: Files | None = None) -> object:
    """The content of the file `path`. Its `str` is the page that `camgen inspect` prints.

    Raises InputError if the file cannot be read.

    files: files that were read before and are not read again.
    """
    files = (files or Files()).within(job.limits)
    source = files.read(path)
    return find_reader(source).inspect(source, job, files)


def is_drawing(job: Job) -> bool:
    """Whether the settings of a job treat a picture as a drawing, not as a photo of a part.

    A drawing is traced, filled, drilled or put on a page.
    """
    kind = job.operation.kind
    if kind not in ("trace", "fill", "drill") and not (kind == "auto" and job.page.size):
        return False
    return job.camera == CameraTable() and job.image.mask in ("auto", "otsu", "threshold")
