"""Files that appear whole or not at all: each is written beside its target and renamed, several together or none."""

from __future__ import annotations

import itertools
import os
import shutil
import signal
import stat
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType

from msgspec import Struct

from camgen.model.errors import JobError
from camgen.read.files import identity

#: Ctrl-C and what asks a process to end; Windows has no SIGHUP.
_SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))


class _Staged(Struct, frozen=True):
    """One file on its way. asked: as the user wrote it; target: links followed; fresh: what is written; old: where the
    former file is kept meanwhile, if it ``existed``.
    """

    asked: Path
    target: Path
    fresh: Path
    old: Path
    existed: bool


def write_all(files: Sequence[tuple[Path, bytes]], read: Mapping[str, Path]) -> None:
    """Writes all files or none: whatever goes wrong, the folder is as it was before. JobError names the file.

    read: ``Files.opened`` of all that the command has read; none of it is written over.
    """
    for asked, _ in files:
        with _name_errors(asked):
            same = identity(asked)
        if same in read:
            raise _would_overwrite(asked, read[same])
    with _signals_held() as held:
        _write_all(files, held)


def _write_all(files: Sequence[tuple[Path, bytes]], held: Sequence[int]) -> None:
    staged: list[_Staged] = []
    try:
        for asked, data in files:
            with _name_errors(asked):
                staged.append(_stage(asked))
                _write(staged[-1], data)
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


def _would_overwrite(target: Path, read: Path) -> JobError:
    return JobError(str(target), f"would overwrite {read}, which is read", remedy="give another name")


def _check_target(target: Path) -> None:
    if target.name in ("", ".", "..", "-"):
        raise JobError(str(target), "is not a file name", remedy="give a file or an existing folder")
    if not target.parent.is_dir():
        raise JobError(str(target), "its folder does not exist", str(target.parent), "make the folder first")
    try:
        mode = target.stat().st_mode
    except FileNotFoundError:
        return
    if not stat.S_ISREG(mode):
        kind = "is a folder" if stat.S_ISDIR(mode) else "is not a regular file"
        raise JobError(str(target), kind, remedy="give a file name")


def _stage(asked: Path) -> _Staged:
    target = Path(os.path.realpath(asked))
    return _Staged(asked, target, _free(target, "new"), _free(target, "old"), target.exists())


def _free(target: Path, use: str) -> Path:
    """A name in the target's folder that nothing has; short, since the target's own may be as long as allowed."""
    names = (target.parent / f".camgen-{os.getpid()}-{i}.{use}" for i in itertools.count())
    return next(name for name in names if not os.path.lexists(name))


def _write(one: _Staged, data: bytes) -> None:
    """The new file, on the disk and with the access rights of the old one, which is kept under a second name."""
    # Exclusive creation: never through a link that somebody else put there.
    with one.fresh.open("xb") as stream:
        stream.write(data)
        stream.flush()
        os.fsync(stream.fileno())
    if one.existed:
        shutil.copymode(one.target, one.fresh)
        try:
            os.link(one.target, one.old)
        except OSError:  # a file system without hard links
            shutil.copy2(one.target, one.old)


def _undo(one: _Staged) -> None:
    """Back to how it was. What happened is read from the folder, since an interrupt may fall between any two steps."""
    if one.existed and one.old.exists() and not one.fresh.exists():
        os.replace(one.old, one.target)
    for path in (one.old, one.fresh) if one.existed else (one.target, one.fresh):
        with suppress(OSError):  # it was never made, or its folder is no folder
            path.unlink()


@contextmanager
def _name_errors(path: Path) -> Iterator[None]:
    """Turns an error of the system into one that names ``path``."""
    try:
        yield
    except (OSError, ValueError) as error:  # ValueError: a zero byte in a name
        reason = getattr(error, "strerror", None) or str(error)
        raise JobError(str(path), f"cannot be written: {reason}") from error
