"""Divides the body of a program into routines: one PROC per path, the rest in main.

Routines that are too long are divided again.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain
from typing import TypeVar

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import find_run_starts
from camgen.model.program import Comment, Force, Indices, MoveC, MoveJ, MoveL, Output, Program
from camgen.post.printed import Lines, Printed

from .options import legal_name

#: Instructions that belong to a path by themselves. The others belong to the state of an output.
_OF_PATHS = frozenset({MoveJ, MoveL, MoveC, Comment})


class Routine(Struct, frozen=True, eq=False):
    """A PROC: its name and its lines."""

    name: str
    lines: Lines


class Names:
    """Names for routines, each given once.

    longest: maximum length of a name on the controller.
    taken: names that are in use, in lower case.
    """

    def __init__(self, longest: int, taken: Iterable[str]) -> None:
        self._longest, self._taken = longest, set(taken)
        self._counts: dict[str, int] = {}

    def give(self, text: str) -> str:
        """Return a legal new name that is like `text`."""
        name = legal_name(text, self._longest, "p")
        base, key = name[: self._longest - len("_99999")], name.lower()
        while key in self._taken:
            count = self._counts[base.lower()] = self._counts.get(base.lower(), 1) + 1
            name = f"{base}_{count}"
            key = name.lower()
        self._taken.add(key)
        return name


def assign_paths(program: Program) -> Indices:
    """Return the path in whose routine each instruction (N,) is, -1 for main.

    A comment belongs to the motion after it, and the motion that leaves the surface to the path
    that pressed. An output that is set on outside a path is also set off outside, even if the
    motion before was on a path.
    """
    columns = program.columns
    next_motion = np.searchsorted(columns.at, np.arange(len(program.body)))
    following = np.append(columns.path, -1)[next_motion]
    of_paths, remarks = columns.are(*_OF_PATHS), columns.are(Comment)
    switches = columns.are(Force, Output)
    # Instructions that continue the one before, which are most of a long program, are skipped. The
    # first one after a switch may be in another routine than its path.
    continues = np.zeros(len(following), np.bool_)
    continues[1:] = of_paths[1:] & of_paths[:-1] & (following[1:] == following[:-1])
    continues[1:] &= remarks[1:] | ~remarks[:-1]
    continues[2:] &= of_paths[:-2]
    events = np.flatnonzero(~continues)
    routines: list[int] = []
    current = last = -1
    on: set[str] = set()
    leaving = False
    switched = iter(columns.list_kinds(Force, Output))
    each = (mask[events].tolist() for mask in (of_paths, remarks, switches, following))
    for of_path, remark, switch, path in zip(*each, strict=True):
        item = next(switched) if switch else None
        if of_path:
            wanted = last if leaving else path
            if wanted != current:
                on.clear()
                current = wanted
            leaving = False
            last = last if remark else current
        elif isinstance(item, Force):
            leaving = item.newtons == 0
        elif isinstance(item, Output):
            if path != current and not (item.value == 0 and item.signal in on):
                current = -1
            elif item.value:
                on.add(item.signal)
        routines.append(current)
    return np.repeat(np.array(routines, np.intp), np.diff(np.append(events, len(following))))


def divide_body(program: Program, printed: Printed, max_lines: int, names: Names) -> list[Routine]:
    """Divide a program into main and the routines that it calls.

    max_lines: maximum number of lines of each; 0: no limit.
    """
    main: list[str | range] = []
    routines: list[Routine] = []
    owner = assign_paths(program)
    starts = find_run_starts(owner)
    ends = np.append(starts, len(owner))[1:]
    sizes = printed.lines_before(ends) - printed.lines_before(starts)
    columns = (column.tolist() for column in (starts, ends, owner[starts], sizes))
    for start, end, path, size in zip(*columns, strict=True):
        span = range(start, end)
        if path < 0:
            main.append(span)
            continue
        routines.append(Routine(names.give(program.paths[path].id), Lines([span], printed, size)))
        main += call(routines[-1].name)
    short: list[Routine] = []
    for routine in (Routine("part", Lines(main, printed)), *routines):
        short += _shorten(routine, max_lines, names)
    return short


def call(name: str) -> Sequence[str]:
    """Return the statement that calls a routine."""
    return (f"        {name};",)


_Part = TypeVar("_Part", bound=Sequence[str])


def _shorten(routine: Routine, max_lines: int, names: Names) -> list[Routine]:
    lines = routine.lines
    if not max_lines or len(lines) <= max_lines:
        return [routine]
    pieces: list[Routine] = []
    items = lines.items()
    while sum(map(len, items)) > max_lines and len(items) > 1:
        chunks = list(divide_items(items, max_lines))
        if len(chunks) >= len(items):
            break
        new: list[Routine] = []
        for k, part in enumerate(chunks, start=1):
            new.append(Routine(names.give(f"{routine.name}_{k}"), _join(part)))
        items = [Lines(call(piece.name), lines.printed) for piece in new]
        pieces = [*new, *pieces]
    return [Routine(routine.name, _join(items)), *pieces]


def _join(items: Sequence[Lines]) -> Lines:
    return Lines([*chain.from_iterable(item.pieces for item in items)], items[0].printed)


def divide_items(items: Sequence[_Part], max_lines: int) -> Iterator[list[_Part]]:
    """Divide items in order into as few lists of at most `max_lines` lines as possible.

    A longer item gets its own list.
    """
    chosen: list[_Part] = []
    size = 0
    for lines in items:
        if chosen and size + len(lines) > max_lines:
            yield chosen
            chosen, size = [], 0
        chosen.append(lines)
        size += len(lines)
    if chosen:
        yield chosen
