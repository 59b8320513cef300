"""The body of a program as routines: one PROC a path, in main what belongs to none, long ones cut."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TypeVar

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import run_starts
from camgen.model.program import Comment, Force, Indices, MoveC, MoveJ, MoveL, Output, Program
from camgen.post.printed import Lines, Printed

from .options import legal_name

#: What belongs to a path by itself, not by what is on.
_OF_PATHS = frozenset({MoveJ, MoveL, MoveC, Comment})


class Routine(Struct, frozen=True, eq=False):
    """A PROC: its name and its lines."""

    name: str
    lines: Lines


class Names:
    """Names for routines, each given once. longest: what the controller takes; taken: in lower case."""

    def __init__(self, longest: int, taken: Iterable[str]) -> None:
        self._longest, self._taken = longest, set(taken)
        self._counts: dict[str, int] = {}

    def give(self, text: str) -> str:
        """The name nearest to ``text`` that is legal and new."""
        name = legal_name(text, self._longest, "p")
        base, key = name[: self._longest - len("_99999")], name.lower()
        while key in self._taken:
            count = self._counts[base.lower()] = self._counts.get(base.lower(), 1) + 1
            name = f"{base}_{count}"
            key = name.lower()
        self._taken.add(key)
        return name


def owners(program: Program) -> Indices:
    """(N,) of the instructions: the path in whose routine each stands, -1: main.

    A remark belongs to the motion after it, the motion that leaves the surface to the path that pressed. What is
    switched on outside a path is also switched off outside, though the motion before it was one of a path.
    """
    columns = program.columns
    following = np.append(columns.path, -1)[
        np.searchsorted(columns.at, np.arange(len(program.body)))
    ]
    of_paths, remarks, switches = (
        columns.are(*kinds) for kinds in (_OF_PATHS, (Comment,), (Force, Output))
    )
    # What goes on as the instruction before it does is not looked at: that is most of a long program. The first one
    # behind a switch may stand elsewhere than where it belongs.
    goes_on = np.zeros(len(following), np.bool_)
    goes_on[1:] = (
        of_paths[1:]
        & of_paths[:-1]
        & (following[1:] == following[:-1])
        & (remarks[1:] | ~remarks[:-1])
    )
    goes_on[2:] &= of_paths[:-2]
    events = np.flatnonzero(~goes_on)
    found: list[int] = []
    here = last = -1
    on: set[str] = set()
    leaving = False
    switched = iter(columns.of(Force, Output))
    each = (mask[events].tolist() for mask in (of_paths, remarks, switches, following))
    for of_path, remark, switch, path in zip(*each, strict=True):
        item = next(switched) if switch else None
        if of_path:
            wanted = last if leaving else path
            if wanted != here:
                on.clear()
                here = wanted
            leaving = False
            last = last if remark else here
        elif isinstance(item, Force):
            leaving = item.newtons == 0
        elif isinstance(item, Output):
            if path != here and not (item.value == 0 and item.signal in on):
                here = -1
            elif item.value:
                on.add(item.signal)
        found.append(here)
    return np.repeat(np.array(found, np.intp), np.diff(np.append(events, len(following))))


def cut(program: Program, printed: Printed, most: int, names: Names) -> list[Routine]:
    """Main, then the routines that it calls, each with no more than ``most`` lines (0: as many as there are)."""
    main: list[str | range] = []
    routines: list[Routine] = []
    owner = owners(program)
    starts = run_starts(owner)
    ends = np.append(starts, len(owner))[1:]
    sizes = printed.lines_before(ends) - printed.lines_before(starts)
    for start, end, path, size in zip(
        *(one.tolist() for one in (starts, ends, owner[starts], sizes)), strict=True
    ):
        span = range(start, end)
        if path < 0:
            main.append(span)
            continue
        routines.append(Routine(names.give(program.paths[path].id), Lines([span], printed, size)))
        main += call(routines[-1].name)
    short: list[Routine] = []
    for routine in (Routine("part", Lines(main, printed)), *routines):
        short += _shorten(routine, most, names)
    return short


def call(name: str) -> Sequence[str]:
    """The statement that calls a routine."""
    return (f"        {name};",)


_Part = TypeVar("_Part", bound=Sequence[str])


def _shorten(routine: Routine, most: int, names: Names) -> list[Routine]:
    """The routine, then what it calls if it is too long: pieces of it, each no longer than ``most`` lines."""
    lines = routine.lines
    if not most or len(lines) <= most:
        return [routine]
    pieces: list[Routine] = []
    items = lines.items()
    while sum(map(len, items)) > most and len(items) > 1:
        chunks = list(chunk(items, most))
        if len(chunks) >= len(items):
            break
        new = [
            Routine(names.give(f"{routine.name}_{k}"), _join(part))
            for k, part in enumerate(chunks, start=1)
        ]
        items = [Lines(call(piece.name), lines.printed) for piece in new]
        pieces = [*new, *pieces]
    return [Routine(routine.name, _join(items)), *pieces]


def _join(items: Sequence[Lines]) -> Lines:
    return Lines([piece for item in items for piece in item.pieces], items[0].printed)


def chunk(items: Sequence[_Part], most: int) -> Iterator[list[_Part]]:
    """The items in order, in as few lists of at most ``most`` lines as that takes; a longer item has one of its own."""
    chosen: list[_Part] = []
    size = 0
    for lines in items:
        if chosen and size + len(lines) > most:
            yield chosen
            chosen, size = [], 0
        chosen.append(lines)
        size += len(lines)
    if chosen:
        yield chosen
