"""Readers: a file's bytes to a Part, with notes on all that was skipped, mended or assumed.

Which formats there are is an open table: the entry points ``camgen.readers``, of camgen and of other packages alike
(docs/writing-a-reader.md).
"""

from __future__ import annotations

from collections.abc import Callable
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
#: Suffixes of point clouds alone.
_CLOUDS = (".pcd",)

_DEFAULTS = Job()


def recognise_none(_head: bytes) -> bool:
    """For formats that have no mark at their beginning: only the suffix tells."""
    return False


class Reader(Struct, frozen=True):
    """One format. name: that of its entry point. about: what it is, for a sentence: "a DXF drawing". suffixes: in small
    letters with their dot, "" for a name without one. makes: what kind of part.

    read: the part in the bytes of a file, in mm, as the job asks; InputError if it has none. inspect: what is in it,
    as a value whose ``str`` is a page to print. Both open other files that the job or the input names through the
    ``Files`` that they are given. recognise: whether a file that begins like this is of this format.
    """

    name: str
    about: str
    suffixes: tuple[str, ...]
    makes: Literal["drawing", "picture", "solid", "program", "curves"]
    read: Callable[[Source, Job, Files], Part]
    inspect: Callable[[Source, Job, Files], object]
    recognise: Callable[[bytes], bool] = recognise_none


class InstalledReader(Struct, frozen=True):
    """One line of the table. broken: why the reader cannot be used, empty when it can."""

    entry: EntryPoint
    reader: Reader | None
    broken: str

    @property
    def name(self) -> str:
        """As ``--format`` takes it."""
        return self.entry.name

    @property
    def origin(self) -> str:
        """The package that it comes from: looked up only where it is shown, since its metadata are slow to read."""
        return find_origin(self.entry)


def list_installed() -> list[InstalledReader]:
    """All readers by name; a broken one is listed with its reason."""
    found = []
    for entry in list_entries(READERS):
        try:
            reader = load(entry)
        except JobError as error:
            found.append(InstalledReader(entry, None, str(error)))
            continue
        if isinstance(reader, Reader) and reader.name == entry.name:
            found.append(InstalledReader(entry, reader, ""))
        else:
            what = (
                f"is called {reader.name}"
                if isinstance(reader, Reader)
                else "is not a camgen.read.Reader"
            )
            why = JobError(f"reader {entry.name}", what, entry.value, "mend or remove its package")
            found.append(InstalledReader(entry, None, str(why)))
    return found


def find_reader(source: Source) -> Reader:
    """The reader for this input: by how it begins, else by its suffix. InputError where none or more than one is."""
    table = [_recognise(one, source.data[:HEAD]) for one in list_installed()]
    readers = [one.reader for one, _ in table if one.reader is not None]
    fit = [one.reader for one, known in table if one.reader is not None and known]
    fit = fit or [one for one in readers if source.suffix in one.suffixes]
    if len(fit) == 1:
        return fit[0]
    if fit:
        names = " and ".join(one.name for one in fit)
        raise InputError(
            source.name,
            f"is claimed by the readers {names}",
            remedy="remove the package of one of them",
        )
    broken = "".join(f"; {one.broken}" for one, _ in table if one.broken)
    remedy = (
        SCAN
        if source.suffix in _CLOUDS
        else f"give {', '.join(one.about for one in readers)}{broken}"
    )
    raise InputError(source.name, "is not a kind of file that camgen reads", remedy=remedy)


def _recognise(one: InstalledReader, head: bytes) -> tuple[InstalledReader, bool]:
    """Whether a reader knows a file by how it begins; one that fails at it is broken, and the others go on."""
    reader = one.reader
    if reader is None:
        return one, False
    try:
        return one, bool(run_plugin(one.entry, "look at a file", lambda: reader.recognise(head)))
    except JobError as error:
        return InstalledReader(one.entry, None, str(error)), False


def find_suffix(name: str) -> str:
    """The suffix of files of the format ``name``, which is a reader or one of its suffixes. JobError if neither is."""
    table = list_installed()
    for one in table:
        if one.name == name and one.broken:
            raise JobError("--format", one.broken)
        if one.reader is not None and f".{name}" in one.reader.suffixes:
            return f".{name}"
    for one in table:
        if one.reader is not None and one.name == name:
            return next((suffix for suffix in one.reader.suffixes if suffix), "")
    names = ", ".join(one.name for one in table)
    raise JobError(
        "--format", f"no reader is called {name}", remedy=f"give one of {names}, or a suffix"
    )


def read(path: str | Path, job: Job = _DEFAULTS, files: Files | None = None) -> Part:
    """The part in the file ``path``, in mm, read as ``job`` asks. InputError if it has none.

    files: what has been read already.
    """
    files = (files or Files()).within(job.limits)
    source = files.read(path)
    part = find_reader(source).read(source, job, files)
    return move_part(set_clamps_aside(part, job), job)


def inspect(path: str | Path, job: Job = _DEFAULTS, files: Files | None = None) -> object:
    """What is in the file ``path``; its ``str`` is the page that ``camgen inspect`` prints. InputError if nothing is.

    files: what has been read already.
    """
    files = (files or Files()).within(job.limits)
    source = files.read(path)
    return find_reader(source).inspect(source, job, files)


# Whether a picture is a drawing, or a photo of a part: the settings of the job tell.

_KINDS = ("trace", "fill", "drill")


def is_drawing(job: Job) -> bool:
    """Whether a picture is a drawing: to be traced, filled, drilled or laid on a page, and no photo."""
    kind = job.operation.kind
    drawing = kind in _KINDS or (kind == "auto" and bool(job.page.size))
    return (
        drawing and job.camera == CameraTable() and job.image.mask in ("auto", "otsu", "threshold")
    )
