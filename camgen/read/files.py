"""The one door for input files: each is opened once, as bytes, however many ask for it."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import BinaryIO

from camgen.model.errors import InputError
from camgen.model.files import Source
from camgen.model.limits import Limits, format_limit

_DEFAULTS = Limits()
#: Bytes that are read at a time, at least.
_BLOCK = 1 << 26


class Files:
    """The input files of one build. given: what need not be opened, since its bytes are here: what travelled to another
    machine. streams: what is read from there when it is asked for: standard input. limits: of what is read.
    """

    def __init__(
        self,
        given: Iterable[Source] = (),
        streams: Mapping[Path, BinaryIO] = MappingProxyType({}),
        limits: Limits = _DEFAULTS,
    ) -> None:
        self.limits = limits
        sources = {identity(source.path): source for source in given}
        self._data = {same: source.data for same, source in sources.items()}
        self._notes = {same: source.notes for same, source in sources.items()}
        self._streams = {identity(path): stream for path, stream in streams.items()}
        #: What was opened, by its ``identity``: nothing of it may be written over.
        self.opened: dict[str, Path] = {}

    def within(self, limits: Limits) -> Files:
        """The same files, what was read among them, under the limits of a job."""
        if limits == self.limits:
            return self
        other = Files(limits=limits)
        other._data, other._streams, other.opened = self._data, self._streams, self.opened
        other._notes = self._notes
        return other

    def read(self, path: str | Path) -> Source:
        """An input. InputError where there is none: missing, a folder, not to be read."""
        path = Path(path)
        try:
            if identity(path) not in self._data | self._streams:
                _insist_on_file(path)
            return self.open(path)
        except FileNotFoundError as error:
            raise InputError(str(path), "no such file", remedy=_nearest(path)) from error
        except (OSError, ValueError) as error:  # ValueError: a zero byte in the name
            raise InputError(str(path), f"cannot be read: {reason(error)}") from error

    def let_go(self) -> None:
        """Forgets what was read, but not its names: after the last input is read nothing asks for it again."""
        self._data.clear()

    def open(self, path: str | Path) -> Source:
        """As the system gives it. OSError, ValueError for a name that no file can have, InputError for what is no
        regular file: a device has no end, and who opens a pipe waits for its writer.
        """
        path = Path(path)
        same = identity(path)
        if same in self._streams:
            self._data[same] = _bounded(str(path), self._streams.pop(same), self.limits.file_bytes)
        if same not in self._data:
            _insist_on_regular(path)
            with path.open("rb") as stream:
                size = os.fstat(stream.fileno()).st_size
                self._data[same] = _bounded(str(path), stream, self.limits.file_bytes, size)
            self.opened[same] = path
        return Source(path, self._data[same], self.limits, self._notes.get(same, ()))


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
        raise InputError(
            str(path), "is not a regular file", remedy="copy it to a file, or use - with --format"
        )


def _insist_on_regular(path: Path) -> None:
    mode = path.stat().st_mode
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):  # of a folder the system itself says it
        raise InputError(str(path), "is not a regular file", remedy="copy it to a file")


def _bounded(name: str, stream: BinaryIO, most: float, size: int = 0) -> bytes:
    """All of a stream. InputError where it is longer than ``most`` bytes. size: bytes of a file."""
    block_size = max(_BLOCK, int(min(size, most)) + 1)
    blocks: list[bytes] = []
    read = 0
    # Python allocates the size that is asked for, and a job may raise its limit beyond the memory.
    while read <= most and (block := stream.read(block_size)):
        blocks.append(block)
        read += len(block)
    data = b"".join(blocks)
    if len(data) > most:
        raise InputError(
            name,
            f"has more than {format_limit(most)} bytes",
            remedy="split it, or raise limits.file_bytes",
        )
    return data


def _nearest(path: Path) -> str:
    try:
        stems = {Path(name).stem: name for name in sorted(os.listdir(path.parent))}
    except OSError:
        return "its folder does not exist"
    import difflib  # noqa: PLC0415 (1 ms, only for what is not there)

    near = difflib.get_close_matches(path.stem, stems, 1)
    return f"nearest is {path.parent / stems[near[0]]}" if near else ""
