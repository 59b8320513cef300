"""Files that appear whole or not at all: each is written beside its target and renamed, several together or none."""

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

#: Ctrl-C and what asks a process to end; Windows has no SIGHUP.
_SIGNALS = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)


#: Where Linux shows the files that a process has open, by their numbers.
_HANDLES = "/proc/self/fd"
#: How names of files on their way begin: with the machine, since a folder may be shared by several.
_MARK = f".camgen-{zlib.crc32(platform.node().encode()):08x}"
_NUMBERS = itertools.count()
_LEFT = re.compile(re.escape(_MARK) + r"-(\d{1,9})-\d+\.(?:new|old)")


class _Staged(Struct, frozen=True):
    """One file on its way. asked: as the user wrote it; target: links followed; handle: the whole new file, open;
    fresh: its name once it has one; old: where the former file is kept meanwhile, if it ``existed``.
    """

    asked: Path
    target: Path
    handle: int
    fresh: Path
    old: Path
    existed: bool


def write_all(files: Sequence[tuple[Path, SupportsBytes]], read: Mapping[str, Path]) -> None:
    """Writes all files or none: whatever goes wrong, the folder is as it was before. JobError names the file.

    files: each with what it will hold, whose bytes are made in its turn.
    read: ``Files.opened`` of all that the command has read; none of it is written over.
    """
    for asked, _ in files:
        with _name_errors(asked):
            same = identity(asked)
        if same in read:
            raise _would_overwrite(asked, read[same])
    with _signals_held() as held:
        _write_all(files, held)


def _write_all(files: Sequence[tuple[Path, SupportsBytes]], held: Sequence[int]) -> None:
    staged: list[_Staged] = []
    try:
        for asked, data in files:
            with _name_errors(asked):
                staged.append(_stage(asked, bytes(data)))
        if held:
            raise KeyboardInterrupt
        for one in staged:
            with _name_errors(one.asked):
                _name(one)
        for one in staged:
            with _name_errors(one.asked):
                os.replace(one.fresh, one.target)
        if held:
            raise KeyboardInterrupt
    except BaseException:
        # Whatever ends this must leave the folder as it was; the error goes on to whoever reports it.
        for one in staged:
            _undo(one)
        raise
    finally:
        for one in staged:
            os.close(one.handle)
    for one in staged:
        one.old.unlink(missing_ok=True)


@contextmanager
def _signals_held() -> Iterator[list[int]]:
    """The signals that have come in here. They act afterwards: between two steps one could leave half of them."""
    if threading.current_thread() is not threading.main_thread():
        yield []  # only the main thread has to do with signals
        return
    held: list[int] = []
    former: dict[int, Callable[[int, FrameType | None], object] | int] = {}
    try:
        for number in _SIGNALS:
            handler = signal.getsignal(number)
            if handler is not None and handler is not signal.SIG_IGN:
                former[number] = handler
                signal.signal(number, lambda got, _frame: held.append(got))
        yield held
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)
        for number in held:
            signal.raise_signal(number)


def check_targets(targets: Iterable[Path], sources: Iterable[Path]) -> None:
    """JobError for a target that cannot be written as a file, is one of the sources, or is named twice."""
    read = {identity(path): path for path in sources}
    taken: set[str] = set()
    for target in targets:
        with _name_errors(target):
            _check_target(target)
        same = identity(target)
        if same in read:
            raise _would_overwrite(target, read[same])
        if same in taken:
            raise JobError(str(target), "is named for two outputs", remedy="give another name")
        taken.add(same)


#: Bytes at the start of a program in which its header stands.
HEADER_BYTES = HEADER_LENGTH
_PART_LINE = re.compile(rb"^[^A-Za-z0-9\r\n]*(part: [^\r\n]*?)\)?\r?$", re.MULTILINE)


def check_programs(programs: Sequence[tuple[Path, bytes]]) -> None:
    """Raises JobError if a program would replace that of another part, by the headers of both.

    programs: paths, each with the first `HEADER_BYTES` of its new file or more.
    """
    for target, data in programs:
        parts = find_parts(_read_head(target))
        if parts and parts != find_parts(data):
            what = "is the program of another part"
            remedy = "give another name or folder with -o, or move that file away"
            raise JobError(str(target), what, b", ".join(parts).decode("ascii", "replace"), remedy)


def check_foreign(target: Path) -> None:
    """Raises JobError if a file is not a program of camgen.

    It may be a program that was taught by hand, of which there is no copy.
    """
    head = _read_head(target)
    if head and b"camgen" not in head:
        what = "is there already, and camgen did not write it"
        raise JobError(str(target), what, remedy="name the program with -o, or move that file away")


def check_edits(targets: Iterable[Path]) -> None:
    """Raises JobError if a program that would be replaced was edited since camgen wrote it.

    Programs without a digest are replaced.
    """
    for target in targets:
        if is_edited(target):
            what = "was edited since camgen wrote it"
            remedy = "--force replaces it, -o gives the new program another place"
            raise JobError(str(target), what, remedy=remedy)


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


def _would_overwrite(target: Path, read: Path) -> JobError:
    return JobError(
        str(target), f"would overwrite {read}, which is read", remedy="give another name"
    )


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


def _stage(asked: Path, data: bytes) -> _Staged:
    """The new file, whole and on the disk, with the access rights of the old one. Where the system can it has no name
    yet: a process that is killed here, or by a loss of power, leaves nothing behind.
    """
    target = Path(os.path.realpath(asked))
    _clear(target.parent)
    existed, fresh = target.exists(), _free(target, "new")
    handle = _open_unnamed(target.parent)
    if handle is None:
        # Exclusive creation: never through a link that somebody else put there.
        handle = os.open(
            fresh, os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0), 0o666
        )
    one = _Staged(asked, target, handle, fresh, _free(target, "old"), existed)
    try:
        with open(handle, "wb", closefd=False) as stream:
            stream.write(data)
        os.fsync(handle)
        if existed:
            os.chmod(
                handle if os.chmod in os.supports_fd else fresh, stat.S_IMODE(target.stat().st_mode)
            )
    except BaseException:
        os.close(handle)
        fresh.unlink(missing_ok=True)
        raise
    return one


def _open_unnamed(folder: Path) -> int | None:
    """A new file in ``folder`` that has no name yet and is gone with its process. None where there is no such thing:
    it takes Linux, a file system that can, and /proc to give the file a name (open(2), O_TMPFILE).
    """
    if not hasattr(os, "O_TMPFILE") or not os.path.isdir(_HANDLES):
        return None
    try:
        return os.open(folder, os.O_WRONLY | os.O_TMPFILE, 0o666)
    except OSError:
        return None


def _name(one: _Staged) -> None:
    """Names for the new file and a second one for the former. All names stand for no longer than it takes to move them
    into place.
    """
    if not one.fresh.exists():
        # Of a link in /proc, link(2) would give a name to the link itself: a folder's handle makes it follow.
        folder = os.open(one.target.parent, os.O_PATH)
        try:
            os.link(
                f"{_HANDLES}/{one.handle}", one.fresh.name, src_dir_fd=folder, dst_dir_fd=folder
            )
        finally:
            os.close(folder)
    if one.existed:
        try:
            os.link(one.target, one.old)
        except OSError:  # a file system without hard links
            shutil.copy2(one.target, one.old)


def _free(target: Path, use: str) -> Path:
    """A name in the target's folder that nothing has; short, since the target's own may be as long as allowed."""
    names = (target.parent / f"{_MARK}-{os.getpid()}-{i}.{use}" for i in _NUMBERS)
    return next(name for name in names if not os.path.lexists(name))


@cache
def _clear(folder: Path) -> None:
    """Removes what processes of this machine left behind in ``folder`` when they were killed between two names; once,
    since a batch writes many files into one folder.
    """
    for path in folder.glob(f"{_MARK}-*"):
        found = _LEFT.fullmatch(path.name)
        if found and not _is_running(int(found[1])):
            with suppress(OSError):  # another process was faster, or it is not ours to remove
                path.unlink()


def _is_running(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:  # it is somebody else's
        return True
    return True


def _undo(one: _Staged) -> None:
    """Back to how it was. What happened is read from the folder, since an interrupt may fall between any two steps."""
    if one.existed and one.old.exists() and not one.fresh.exists():
        os.replace(one.old, one.target)
    for path in (one.old, one.fresh) if one.existed else (one.target, one.fresh):
        with suppress(OSError):  # it was never made, or its folder is no folder
            if path != one.target or os.path.samestat(path.stat(), os.fstat(one.handle)):
                path.unlink()


@contextmanager
def _name_errors(path: Path) -> Iterator[None]:
    """Turns an error of the system into one that names ``path``."""
    try:
        yield
    except (OSError, ValueError) as error:  # ValueError: a zero byte in a name
        reason = getattr(error, "strerror", None) or str(error)
        raise JobError(str(path), f"cannot be written: {reason}") from error
