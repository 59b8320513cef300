"""RAPID text as a tree: modules, data, routines, statements and values. Lines are 1-based."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache


@dataclass(frozen=True, slots=True)
class Ref:
    """A name used as a value."""

    name: str


@dataclass(frozen=True, slots=True)
class Point:
    """A robtarget written out: its numbers, grouped as the manual groups them."""

    value: tuple[tuple[float, ...], ...]


@dataclass(frozen=True, slots=True, eq=False)
class Call:
    """A statement, or a function inside one: name in lower case, arguments in order, optional arguments by name."""

    line: int
    name: str
    args: tuple[Expr, ...] = ()
    options: tuple[tuple[str, Expr | None], ...] = ()


Expr = float | bool | str | tuple["Expr", ...] | Ref | Point | Call


@dataclass(frozen=True, slots=True, eq=False)
class Data:
    """A declaration. storage: const, pers or var."""

    line: int
    storage: str
    type: str
    name: str
    local: bool
    value: Expr | None


@dataclass(frozen=True, slots=True, eq=False)
class Routine:
    """A PROC without parameters."""

    line: int
    name: str
    local: bool
    data: tuple[Data, ...]
    body: tuple[Call, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Module:
    """A module with what it declares."""

    line: int
    name: str
    data: tuple[Data, ...]
    routines: tuple[Routine, ...]


@lru_cache(maxsize=1000)
def refs(*names: str) -> tuple[Ref, ...]:
    """Names as arguments; the same ones are shared by the many motions that have them."""
    return tuple(Ref(name) for name in names)


@lru_cache(maxsize=1000)
def work_object(name: str) -> tuple[tuple[str, Expr | None], ...]:
    """The optional argument WObj, shared in the same way."""
    return (("wobj", Ref(name)),)
