"""Writes all of several files or none: each is written beside its target and then renamed."""

from __future__ import annotations

import itertools
import os
import platform
import re
import shutil
import signal
import stat
import threading
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from types import FrameType
from typing import SupportsBytes

from msgspec import Struct

from camgen.model.errors import JobError
from camgen.model.signature import HEADER_LENGTH, read_signature
from camgen.read.files import identity

#: Signals that ask a process to end; Windows has no SIGHUP.
_SIGNALS = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)


#: Folder in which Linux lists the open files of a process, by their numbers.
_HANDLES = "/proc/self/fd"
#: Prefix of the names of temporary files, with the machine: several may share a folder.
_MARK = f".camgen-{zlib.crc32(platform.node().encode()):08x}"
_NUMBERS = itertools.count()
_LEFT = re.compile(re.escape(_MARK) + r"-(\d{1,9})-\d+\.(?:new|old)")


class _Staged(Struct, frozen=True):
    """A file that is written and not yet in its place.

    path: path as the user wrote it.
    target: path with links followed.
    handle: handle of the whole new file.
    fresh: temporary name of the new file.
    old: temporary name of the former file.
    existed: whether there was a former file.
    """

    path: Path
    target: Path
    handle: int
    fresh: Path
    old: Path
    existed: bool


def write_all(files: Sequence[tuple[Path, SupportsBytes]], read: Mapping[str, Path]) -> None:
    """Write all files or none: after any error the folder is as it was before.

    files: path and content of each file. The bytes of a content are made when it is written.
    read: `Files.opened` of the command. None of these files is overwritten.

    Raises JobError with the name of the file.
    """
    for path, _ in files:
        with _name_errors(path):
            same = identity(path)
        if same in read:
            raise _make_overwrite_error(path, read[same])
    with _delay_signals() as held:
        _write_all(files, held)


def _write_all(files: Sequence[tuple[Path, SupportsBytes]], held: Sequence[int]) -> None:
    staged: list[_Staged] = []
    try:
        for path, data in files:
            with _name_errors(path):
                staged.append(_stage(path, bytes(data)))
        if held:
            raise KeyboardInterrupt
        for file in staged:
            with _name_errors(file.path):
                _name_file(file)
        for file in staged:
            with _name_errors(file.path):
                os.replace(file.fresh, file.target)
        if held:
            raise KeyboardInterrupt
    except BaseException:
        # After any exception the folder must be as it was before.
        for file in staged:
            _undo(file)
        raise
    finally:
        for file in staged:
            os.close(file.handle)
    for file in staged:
        file.old.unlink(missing_ok=True)


@contextmanager
def _delay_signals() -> Iterator[list[int]]:
    """Hold back signals, and raise them afterwards. Yields those that have arrived.

    A signal between two steps could leave some of the files.
    """
    if threading.current_thread() is not threading.main_thread():
        yield []  # Only the main thread handles signals.
        return
    held: list[int] = []
    former: dict[int, Callable[[int, FrameType | None], object] | int] = {}
    try:
        for number in _SIGNALS:
            handler = signal.getsignal(number)
            if handler is not None and handler is not signal.SIG_IGN:
                former[number] = handler
                signal.signal(number, lambda received, _frame: held.append(received))
        yield held
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)
        for number in held:
            signal.raise_signal(number)


def list_paths(files: Iterable[tuple[Path, object]]) -> list[Path]:
    """The paths of files that are given with their contents."""
    return [path for path, _ in files]


def check_targets(targets: Iterable[Path | None], sources: Iterable[Path | None]) -> None:
    """Raise JobError for a target that cannot be written, is a source, or is named twice.

    None stands for a file that the user does not name.
    """
    read = {identity(path): path for path in sources if path}
    named: set[str] = set()
    for target in targets:
        if target is None:
            continue
        with _name_errors(target):
            _check_target(target)
        same = identity(target)
        if same in read:
            raise _make_overwrite_error(target, read[same])
        if same in named:
            raise JobError(str(target), "is named for two outputs", remedy="give another name")
        named.add(same)


#: Maximum length of the header of a program, bytes.
HEADER_BYTES = HEADER_LENGTH
_PART_LINE = re.compile(rb"^[^A-Za-z0-9\r\n]*(part: [^\r\n]*?)\)?\r?$", re.MULTILINE)


def check_programs(programs: Sequence[tuple[Path, bytes]]) -> None:
    """Raises JobError if a program would replace that of another part, by the headers of both.

    programs: paths, each with the first `HEADER_BYTES` of its new file or more.
    """
    for target, data in programs:
        parts = find_parts(_read_head(target))
        if parts and parts != find_parts(data):
            raise JobError(
                str(target),
                "is the program of another part",
                b", ".join(parts).decode("ascii", "replace"),
                "give another name or folder with -o, or move that file away",
            )


def check_foreign(target: Path) -> None:
    """Raises JobError if a file is not a program of camgen.

    It may be a program that was taught by hand, of which there is no copy.
    """
    head = _read_head(target)
    if head and b"camgen" not in head:
        raise JobError(
            str(target),
            "is there already, and camgen did not write it",
            remedy="name the program with -o, or move that file away",
        )


def check_edits(targets: Iterable[Path]) -> None:
    """Raises JobError if a program that would be replaced was edited since camgen wrote it.

    Programs without a digest are replaced.
    """
    for target in targets:
        if is_edited(target):
            raise JobError(
                str(target),
                "was edited since camgen wrote it",
                remedy="--force replaces it, -o gives the new program another place",
            )


def is_edited(target: Path) -> bool:
    """Whether a file is a program of camgen that was edited since.

    Raises JobError if it cannot be read.
    """
    if not target.is_file():
        return False
    with _name_errors(target):
        text = target.read_bytes().decode("utf-8", "surrogateescape")
    return read_signature(text) == "edited"


def find_parts(program: bytes) -> list[bytes]:
    """The lines of a program's header that name its parts; empty without such a header."""
    head = program[:HEADER_BYTES]
    return _PART_LINE.findall(head) if b"camgen" in head else []


def _read_head(target: Path) -> bytes:
    """The first bytes of a file; empty if there is no file."""
    if not target.is_file():
        return b""
    with _name_errors(target), target.open("rb") as stream:
        return stream.read(HEADER_BYTES)


def _make_overwrite_error(target: Path, read: Path) -> JobError:
    what = f"would overwrite {read}, which is read"
    return JobError(str(target), what, remedy="give another name")


def _check_target(target: Path) -> None:
    if target.name in ("", ".", "..", "-"):
        raise JobError(
            str(target), "is not a file name", remedy="give a file or an existing folder"
        )
    if not target.parent.is_dir():
        raise JobError(
            str(target), "its folder does not exist", str(target.parent), "make the folder first"
        )
    try:
        mode = target.stat().st_mode
    except FileNotFoundError:
        return
    if not stat.S_ISREG(mode):
        kind = "is a folder" if stat.S_ISDIR(mode) else "is not a regular file"
        raise JobError(str(target), kind, remedy="give a file name")


def _stage(path: Path, data: bytes) -> _Staged:
    """Write the new file to the disk, with the access rights of the former one.

    If the system allows it, the file has no name yet. Then a process that is killed here, or a loss
    of power, leaves nothing in the folder.
    """
    target = Path(os.path.realpath(path))
    _remove_leftovers(target.parent)
    existed, fresh = target.exists(), _find_free_name(target, "new")
    handle = _open_unnamed(target.parent)
    if handle is None:
        # Exclusive creation does not follow a link that another program has put there.
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
        handle = os.open(fresh, flags, 0o666)
    try:
        with open(handle, "wb", closefd=False) as stream:
            stream.write(data)
        os.fsync(handle)
        if existed:
            file = handle if os.chmod in os.supports_fd else fresh
            os.chmod(file, stat.S_IMODE(target.stat().st_mode))
    except BaseException:
        os.close(handle)
        fresh.unlink(missing_ok=True)
        raise
    return _Staged(path, target, handle, fresh, _find_free_name(target, "old"), existed)


def _open_unnamed(folder: Path) -> int | None:
    """Open a new file without a name, which disappears with its process (open(2), O_TMPFILE).

    Returns None if that is not possible: it needs Linux, a file system with such files, and /proc
    to name the file later.
    """
    if not hasattr(os, "O_TMPFILE") or not os.path.isdir(_HANDLES):
        return None
    try:
        return os.open(folder, os.O_WRONLY | os.O_TMPFILE, 0o666)
    except OSError:
        return None


def _name_file(file: _Staged) -> None:
    """Name the new file, and give the former one a second name, until both are in their places."""
    if not file.fresh.exists():
        # Without the handle of a folder, link(2) would link the link in /proc, not its file.
        folder = os.open(file.target.parent, os.O_PATH)
        handle = f"{_HANDLES}/{file.handle}"
        try:
            os.link(handle, file.fresh.name, src_dir_fd=folder, dst_dir_fd=folder)
        finally:
            os.close(folder)
    if file.existed:
        try:
            os.link(file.target, file.old)
        except OSError:  # a file system without hard links
            shutil.copy2(file.target, file.old)


def _find_free_name(target: Path, use: str) -> Path:
    """A free name in the folder of the target, short since the target may have the longest one."""
    names = (target.parent / f"{_MARK}-{os.getpid()}-{i}.{use}" for i in _NUMBERS)
    return next(name for name in names if not os.path.lexists(name))


@cache
def _remove_leftovers(folder: Path) -> None:
    """Remove the temporary files of killed processes of this machine from a folder.

    Each folder is searched once, since a batch writes many files into it.
    """
    for path in folder.glob(f"{_MARK}-*"):
        match = _LEFT.fullmatch(path.name)
        if match and not _is_running(int(match[1])):
            with suppress(OSError):  # Another process was faster, or has the file.
                path.unlink()


def _is_running(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:  # A process of another user.
        return True
    return True


def _undo(file: _Staged) -> None:
    """Restore the former state of the folder.

    An interrupt may come between any two steps, so the folder itself shows which steps were done.
    """
    if file.existed and file.old.exists() and not file.fresh.exists():
        os.replace(file.old, file.target)
    for path in (file.old, file.fresh) if file.existed else (file.target, file.fresh):
        with suppress(OSError):  # The file was never made, or its folder does not exist.
            if path != file.target or os.path.samestat(path.stat(), os.fstat(file.handle)):
                path.unlink()


@contextmanager
def _name_errors(path: Path) -> Iterator[None]:
    """Convert an error of the system into a JobError that names `path`."""
    try:
        yield
    except (OSError, ValueError) as error:  # ValueError: a zero byte in a name
        reason = getattr(error, "strerror", None) or str(error)
        raise JobError(str(path), f"cannot be written: {reason}") from error
