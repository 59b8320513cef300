"""The body of a program as routines: one PROC a path, in main what belongs to none, long ones cut."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from msgspec import Struct

from camgen.model.program import Comment, Force, MoveC, MoveJ, MoveL, Output, Program

from .options import legal_name

#: What belongs to a path by itself, not by what is on.
_OF_PATHS = frozenset({MoveJ, MoveL, MoveC, Comment})

#: The lines of one instruction, which stay together.
Printed = Sequence[str]


class Routine(Struct, frozen=True):
    """A PROC: its name and the lines of its instructions."""

    name: str
    items: list[Printed]


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


def owners(program: Program) -> Iterator[int]:
    """For each instruction the path in whose routine it stands, -1: main.

    A remark belongs to the motion after it, the motion that leaves the surface to the path that pressed. What is
    switched on outside a path is also switched off outside, though the motion before it was one of a path.
    """
    following = _next_paths(program)
    here = last = -1
    on: set[str] = set()
    leaving = False
    columns = program.columns
    of_paths, remarks, switches = (columns.are(*kinds) for kinds in (_OF_PATHS, (Comment,), (Force, Output)))
    switched = iter(columns.of(Force, Output))
    each = zip(of_paths.tolist(), remarks.tolist(), switches.tolist(), following, strict=True)
    for of_path, remark, switch, path in each:
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
        yield here


def _next_paths(program: Program) -> list[int]:
    """For each instruction the path of the motion that it is, or of the next one; -1: none."""
    columns = program.columns
    following = np.searchsorted(columns.at, np.arange(len(program.body)))
    paths: list[int] = np.append(columns.path, -1)[following].tolist()
    return paths


def cut(program: Program, printed: Iterable[Printed], most: int, names: Names) -> list[Routine]:
    """Main, then the routines that it calls, each with no more than ``most`` lines (0: as many as there are)."""
    main: list[Printed] = []
    routines: list[Routine] = []
    last = -1
    for lines, path in zip(printed, owners(program), strict=True):
        if path < 0:
            main.append(lines)
        elif path == last:
            routines[-1].items.append(lines)
        else:
            routines.append(Routine(names.give(program.paths[path].id), [lines]))
            main.append(call(routines[-1].name))
        last = path
    short: list[Routine] = []
    for routine in (Routine("part", main), *routines):
        short += _shorten(routine, most, names)
    return short


def call(name: str) -> Printed:
    """The statement that calls a routine."""
    return (f"        {name};",)


def _shorten(routine: Routine, most: int, names: Names) -> list[Routine]:
    """The routine, then what it calls if it is too long: pieces of it, each no longer than ``most`` lines."""
    pieces: list[Routine] = []
    items = routine.items
    while most and sum(map(len, items)) > most and len(items) > 1:
        chunks = list(chunk(items, most))
        if len(chunks) >= len(items):
            break
        new = [Routine(names.give(f"{routine.name}_{k}"), part) for k, part in enumerate(chunks, start=1)]
        items = [call(piece.name) for piece in new]
        pieces = [*new, *pieces]
    return [Routine(routine.name, items), *pieces]


def chunk(items: Sequence[Printed], most: int) -> Iterator[list[Printed]]:
    """The items in order, in as few lists of at most ``most`` lines as that takes; a longer item has one of its own."""
    chosen: list[Printed] = []
    size = 0
    for lines in items:
        if chosen and size + len(lines) > most:
            yield chosen
            chosen, size = [], 0
        chosen.append(lines)
        size += len(lines)
    if chosen:
        yield chosen
