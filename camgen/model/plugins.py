"""Entry points: how posts, read-backs and readers are found, those of camgen and those of other packages alike."""

from __future__ import annotations

import difflib
import sys
from collections.abc import Sequence
from functools import cache
from importlib.metadata import EntryPoint, entry_points

from camgen.model.errors import JobError

#: The group of the operations: whoever reads a job knows their names, whoever plans loads them.
OPERATIONS = "camgen.operations"


def entries(group: str) -> list[EntryPoint]:
    """What is registered in ``group``, by name."""
    return [entry for entry in _all(tuple(sys.path)) if entry.group == group]


@cache
def _all(_path: tuple[str, ...]) -> list[EntryPoint]:
    """Those of camgen's groups, by name. path: where packages are looked for. To look through all that are installed
    takes 2 to 5 ms, and a build asks for three groups.
    """
    found = entry_points()
    ours = [entry for group in found.groups if group.startswith("camgen.") for entry in found.select(group=group)]
    return sorted(ours, key=lambda entry: entry.name)


def find(listed: Sequence[EntryPoint], name: str, kind: str, lists: str) -> EntryPoint:
    """The entry ``name``. JobError with the nearest one where there is none. lists: where the user sees all of them."""
    for entry in listed:
        if entry.name == name:
            return entry
    near = difflib.get_close_matches(name, [entry.name for entry in listed], 1, 0)
    raise JobError(f"{kind} {name}", "is not installed", remedy=f"nearest is {near[0]}; {lists}" if near else lists)


def load(entry: EntryPoint) -> object:
    """What the entry names. JobError with the reason where its package cannot be imported."""
    # A foreign package may fail in any way at all while it is imported; whatever it is, the user is told its reason.
    try:
        return entry.load()
    except Exception as error:
        what = f"cannot be loaded: {type(error).__name__}: {error}"
        raise JobError(f"plug-in {entry.name}", what, entry.value, "mend or remove its package") from error


def origin(entry: EntryPoint) -> str:
    """The package that an entry comes from, with its version."""
    return f"{entry.dist.name} {entry.dist.version}" if entry.dist else "unknown"
