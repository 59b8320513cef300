"""Opens input files. Each file is read once, as bytes, however often it is used."""

from __future__ import annotations

import os
import stat
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import BinaryIO

from msgspec.structs import replace

from camgen.model.errors import InputError
from camgen.model.files import Source
from camgen.model.limits import Limits, format_limit

_DEFAULTS = Limits()
#: Smallest number of bytes to read at a time. The memory for many more takes 2 ms.
_BLOCK = 1 << 20


class Files:
    """The input files of a build.

    given: files whose bytes are known, such as those sent to another machine; they are not opened.
    streams: streams that are read in place of a path, such as standard input.
    limits: limits of the files that are read.
    """

    def __init__(
        self,
        given: Iterable[Source] = (),
        streams: Mapping[Path, BinaryIO] = MappingProxyType({}),
        limits: Limits = _DEFAULTS,
    ) -> None:
        self.limits = limits
        self._sources = {identity(source.path): source for source in given}
        self._streams = {identity(path): stream for path, stream in streams.items()}
        #: Files that were opened, by `identity`. No output may overwrite them.
        self.opened: dict[str, Path] = {}
        #: Called in a second thread while a picture is decoded, which leaves Python idle.
        self.meanwhile: Callable[[], None] = _do_nothing

    def within(self, limits: Limits) -> Files:
        """These files, with those that were read, under the limits of a job."""
        files = Files(limits=limits)
        files._sources, files._streams, files.opened = self._sources, self._streams, self.opened
        files.meanwhile = self.meanwhile
        return files

    def read(self, path: str | Path) -> Source:
        """An input file. Raises InputError if it is missing, is a folder, or cannot be read."""
        path = Path(path)
        try:
            if identity(path) not in self._sources | self._streams:
                _check_file(path)
            return self.open(path)
        except FileNotFoundError as error:
            raise InputError(str(path), "no such file", remedy=_suggest_file(path)) from error
        except (OSError, ValueError) as error:  # ValueError: a zero byte in the name
            raise InputError(str(path), f"cannot be read: {reason(error)}") from error

    def release(self) -> None:
        """Free the bytes of all files. The names of opened files are kept.

        To be called when the last input was read.
        """
        self._sources.clear()

    def open(self, path: str | Path) -> Source:
        """A file, with the errors of the system.

        Raises OSError, ValueError for an impossible file name, and InputError for a file that is
        too large or not regular: a device has no end, and a pipe waits for its writer.
        """
        path = Path(path)
        key = identity(path)
        limit = self.limits.file_bytes
        if key in self._streams:
            data = _read_bounded(str(path), self._streams.pop(key), limit)
            self._sources[key] = Source(path, data)
        if key not in self._sources:
            mode = path.stat().st_mode
            # A folder is left to the system, which has a message for it.
            if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
                raise InputError(str(path), "is not a regular file", remedy="copy it to a file")
            with path.open("rb") as stream:
                size = os.fstat(stream.fileno()).st_size
                self._sources[key] = Source(path, _read_bounded(str(path), stream, limit, size))
            self.opened[key] = path
        return replace(self._sources[key], path=path, limits=self.limits)


def _do_nothing() -> None:
    pass


def identity(path: str | Path) -> str:
    """A text that is equal for two names of one file: links are followed, case may be ignored.

    Raises ValueError for an impossible file name.
    """
    return os.path.normcase(os.path.realpath(path))


def reason(error: OSError | ValueError) -> str:
    """The message of the system why a file cannot be opened."""
    return getattr(error, "strerror", None) or str(error)


def _check_file(path: Path) -> None:
    mode = path.stat().st_mode
    if stat.S_ISDIR(mode):
        raise InputError(str(path), "is a folder", remedy="name the files in it")
    if not stat.S_ISREG(mode):
        raise InputError(
            str(path), "is not a regular file", remedy="copy it to a file, or use - with --format"
        )


def _read_bounded(name: str, stream: BinaryIO, limit: float, size: int = 0) -> bytes:
    """All bytes of a stream. Raises InputError if there are more than `limit`.

    size: bytes of a file, 0 for a stream of unknown length.
    """
    # Python allocates as much as it is asked to read, and a limit may be larger than the memory.
    block_size = max(_BLOCK, int(min(size, limit)) + 1)
    blocks: list[bytes] = []
    count = 0
    while count <= limit and (block := stream.read(block_size)):
        blocks.append(block)
        count += len(block)
    if count > limit:
        raise InputError(
            name,
            f"has more than {format_limit(limit)} bytes",
            remedy="split it, or raise limits.file_bytes",
        )
    return b"".join(blocks)


def _suggest_file(path: Path) -> str:
    try:
        stems = {Path(name).stem: name for name in sorted(os.listdir(path.parent))}
    except OSError:
        return "its folder does not exist"
    import difflib  # noqa: PLC0415 (1 ms, only for what is not there)

    near = difflib.get_close_matches(path.stem, stems, 1)
    return f"nearest is {path.parent / stems[near[0]]}" if near else ""
