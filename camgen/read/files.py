"""The one door for input files: each is opened once, as bytes, however many ask for it."""

from __future__ import annotations

import difflib
import os
import stat
from collections.abc import Iterable
from pathlib import Path
from typing import BinaryIO

from camgen.model.errors import InputError
from camgen.model.files import Source
from camgen.model.limits import most


class Files:
    """The input files of one build. given: what need not be opened, since its bytes are here: standard input, and
    what travelled to another machine.
    """

    def __init__(self, given: Iterable[Source] = ()) -> None:
        self._data = {identity(source.path): source.data for source in given}
        #: What was opened, by its ``identity``: nothing of it may be written over.
        self.opened: dict[str, Path] = {}

    def read(self, path: str | Path) -> Source:
        """An input. InputError where there is none: missing, a folder, not to be read."""
        path = Path(path)
        try:
            if identity(path) not in self._data:
                _insist_on_file(path)
            return self.open(path)
        except FileNotFoundError as error:
            raise InputError(str(path), "no such file", remedy=_nearest(path)) from error
        except (OSError, ValueError) as error:  # ValueError: a zero byte in the name
            raise InputError(str(path), f"cannot be read: {reason(error)}") from error

    def open(self, path: str | Path) -> Source:
        """As the system gives it. OSError, ValueError for a name that no file can have, InputError for what is no
        regular file: a device has no end, and who opens a pipe waits for its writer.
        """
        path = Path(path)
        same = identity(path)
        if same not in self._data:
            _insist_on_regular(path)
            with path.open("rb") as stream:
                self._data[same] = bounded(str(path), stream)
            self.opened[same] = path
        return Source(path, self._data[same])


def identity(path: str | Path) -> str:
    """The same text for two names of one file, as far as links and (on such systems) case go. ValueError for a name
    that no file can have.
    """
    return os.path.normcase(os.path.realpath(path))


def reason(error: OSError | ValueError) -> str:
    """Why a file cannot be opened, as the system says it."""
    return getattr(error, "strerror", None) or str(error)


def _insist_on_file(path: Path) -> None:
    mode = path.stat().st_mode
    if stat.S_ISDIR(mode):
        raise InputError(str(path), "is a folder", remedy="name the files in it")
    if not stat.S_ISREG(mode):
        raise InputError(str(path), "is not a regular file", remedy="copy it to a file, or use - with --format")


def _insist_on_regular(path: Path) -> None:
    mode = path.stat().st_mode
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):  # of a folder the system itself says it
        raise InputError(str(path), "is not a regular file", remedy="copy it to a file")


def bounded(name: str, stream: BinaryIO) -> bytes:
    """All of a stream. InputError where it is longer than any input may be."""
    data = stream.read(most("file_bytes") + 1)
    if len(data) > most("file_bytes"):
        raise InputError(name, f"has more than {most('file_bytes'):,} bytes", remedy="split it")
    return data


def _nearest(path: Path) -> str:
    try:
        stems = {Path(name).stem: name for name in sorted(os.listdir(path.parent))}
    except OSError:
        return "its folder does not exist"
    near = difflib.get_close_matches(path.stem, stems, 1)
    return f"nearest is {path.parent / stems[near[0]]}" if near else ""
