"""Entry points: how posts, read-backs and readers are found, those of camgen and those of other packages alike."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import TypeVar

from camgen.model.errors import JobError, one_line
from camgen.model.text import suggest

#: The group of the operations: whoever reads a job knows their names, whoever plans loads them.
OPERATIONS = "camgen.operations"
#: What a plug-in may take to be imported, and a reader to recognise a file. It is no setting of a job: posts and
#: operations are looked up to read one.
SECONDS = 30
_T = TypeVar("_T")


def entries(group: str) -> list[EntryPoint]:
    """What is registered in ``group``, by name."""
    return [entry for entry in _all(tuple(sys.path)) if entry.group == group]


@cache
def _all(_path: tuple[str, ...]) -> list[EntryPoint]:
    """Those of camgen's groups, by name. path: where packages are looked for. To look through all that are installed
    takes 2 to 5 ms, and a build asks for three groups.
    """
    found = entry_points()
    ours = [
        entry
        for group in found.groups
        if group.startswith("camgen.")
        for entry in found.select(group=group)
    ]
    return sorted(ours, key=lambda entry: entry.name)


def find(listed: Sequence[EntryPoint], name: str, kind: str, lists: str) -> EntryPoint:
    """The entry ``name``. JobError with the nearest where there is none. lists: where the user sees all."""
    for entry in listed:
        if entry.name == name:
            return entry
    near = suggest(name, [entry.name for entry in listed])
    raise JobError(
        f"{kind} {name}", "is not installed", remedy=f"{near}; {lists}" if near else lists
    )


def load(entry: EntryPoint) -> object:
    """What the entry names. JobError with the reason where its package cannot be imported."""
    return ask(entry, "be loaded", entry.load)


def ask(entry: EntryPoint, what: str, answer: Callable[[], _T]) -> _T:
    """What ``answer``, code of the package of ``entry``, says before anybody has chosen that package. JobError where it
    cannot ``what``: a foreign package may fail in any way at all, end the process or not end, and spoils no other.
    """
    try:
        with _seconds(SECONDS):
            return answer()
    except (Exception, SystemExit, _TooLong) as error:
        why = f"cannot {what}: {type(error).__name__.lstrip('_')}: {one_line(str(error))}"
        raise JobError(
            f"plug-in {entry.name}", why, entry.value, "mend or remove its package"
        ) from error


class _TooLong(BaseException):
    """Nothing that a package catches as an error of its own."""


@contextmanager
def _seconds(limit: int) -> Iterator[None]:
    """In here, _TooLong after ``limit`` seconds, where signals are heard: in the main thread, and not on Windows."""
    if threading.current_thread() is not threading.main_thread() or not hasattr(
        signal, "setitimer"
    ):
        yield
        return

    def stop(*_: object) -> None:
        raise _TooLong(f"it takes more than {limit} s")

    former = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, limit)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, former)


def origin(entry: EntryPoint) -> str:
    """The package that an entry comes from, with its version."""
    return f"{entry.dist.name} {entry.dist.version}" if entry.dist else "unknown"
