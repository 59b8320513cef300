"""Finds and loads plug-ins by their entry points: operations, posts, readers and languages.

The plug-ins of camgen and of other packages are treated alike.
"""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import TypeVar

from camgen.model.errors import JobError, make_one_line
from camgen.model.text import suggest

#: Entry point group of the operations. A reader of jobs needs their names, the planner loads them.
OPERATIONS = "camgen.operations"
#: s: time in which a plug-in must be imported, and a reader must recognise a file. It cannot be set
#: in a job, because posts and operations are needed to read a job.
SECONDS = 30
_T = TypeVar("_T")


def list_entries(group: str) -> list[EntryPoint]:
    """The entry points of `group`, by name."""
    return [entry for entry in _find_all(tuple(sys.path)) if entry.group == group]


@cache
def _find_all(_path: tuple[str, ...]) -> list[EntryPoint]:
    """The entry points of all groups of camgen, by name.

    The result is cached: a search through all installed packages takes 2 to 5 ms, and a build needs
    three groups.

    _path: folders in which packages are searched, as the key of the cache.
    """
    installed = entry_points()
    entries: list[EntryPoint] = []
    for group in installed.groups:
        if group.startswith("camgen."):
            entries += installed.select(group=group)
    return sorted(entries, key=lambda entry: entry.name)


def find(listed: Sequence[EntryPoint], name: str, kind: str, lists: str) -> EntryPoint:
    """The entry point `name`. Raises JobError with the nearest name if it is missing.

    kind: noun for the message, such as "post".
    lists: remedy that shows the user all names.
    """
    for entry in listed:
        if entry.name == name:
            return entry
    near = suggest(name, [entry.name for entry in listed])
    remedy = f"{near}; {lists}" if near else lists
    raise JobError(f"{kind} {name}", "is not installed", remedy=remedy)


def load(entry: EntryPoint) -> object:
    """The object of an entry point. Raises JobError with the reason if it cannot be imported."""
    return run_plugin(entry, "be loaded", entry.load)


def run_plugin(entry: EntryPoint, what: str, answer: Callable[[], _T]) -> _T:
    """The result of `answer`, which runs code of the package of `entry`.

    Raises JobError if it fails. The package may be one that the user has not chosen and that fails
    in any way, ends the process or does not end. That must not affect other packages.

    what: the verb phrase for "cannot ..." in the message.
    """
    try:
        with _limit_time(SECONDS):
            return answer()
    except (Exception, SystemExit, _TooLong) as error:
        kind = type(error).__name__.lstrip("_")
        raise JobError(
            f"plug-in {entry.name}",
            f"cannot {what}: {kind}: {make_one_line(str(error))}",
            entry.value,
            "correct or remove its package",
        ) from error


class _TooLong(BaseException):
    """The time is over. A package that catches Exception does not catch this."""


@contextmanager
def _limit_time(limit: int) -> Iterator[None]:
    """Raises _TooLong in the body after `limit` seconds.

    Signals are needed for it, so there is no limit outside the main thread and on Windows.
    """
    is_main = threading.current_thread() is threading.main_thread()
    if not is_main or not hasattr(signal, "setitimer"):
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


def find_origin(entry: EntryPoint) -> str:
    """Name and version of the package of an entry point, "unknown" if it is unknown."""
    return f"{entry.dist.name} {entry.dist.version}" if entry.dist else "unknown"
