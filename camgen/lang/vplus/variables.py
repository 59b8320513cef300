"""The variables of V+: numbers, strings, locations and precision points, with subscripts.

An element of an array is a separate variable, `a[1,2]`, since V+ needs no declaration of arrays. An
argument is another name of a variable of the calling program. Sources: V+ User's Guide, program
variables and argument passing.
"""

from __future__ import annotations

import re
from typing import Any, ClassVar, NamedTuple

from camgen.model.program import Joints

from .names import TAKEN, canonical
from .text import BASE, NULL, Frame, Location, Unreadable

#: The spelling of a name, without subscripts.
NAME_PATTERN = re.compile(r"[#$]?[A-Za-z][A-Za-z0-9._]*")

Value = float | str | Location | Joints
#: Values by the name with its subscripts. None for a variable that is declared and has no value.
Table = dict[str, Value | None]


class Cell(NamedTuple):
    """The table of a variable, and its key there."""

    table: Table
    key: str


class _Scope:
    """The names that a program sees in addition to the globals: AUTO, LOCAL and its arguments."""

    __slots__ = ("arguments", "auto", "local")

    def __init__(self, local: Table | None = None) -> None:
        self.auto: Table = {}
        self.local: Table = {} if local is None else local
        self.arguments: dict[str, Cell] = {}


class Variables:
    """The variables during a run.

    Methods raise Unreadable for a name without a value, or with a value of another kind. A name
    includes its subscripts, as `A[1,2]`.

    strict: an external value raises Unreadable; otherwise it becomes an assumption.
    known: names of locations that are stored on the controller.
    """

    strict: ClassVar[bool] = True

    def __init__(self, known: frozenset[str]) -> None:
        self._known = known
        self._globals: Table = {}
        self._scopes: list[_Scope] = [_Scope()]
        self._last_frame = BASE

    @property
    def depth(self) -> int:
        """Number of programs that were entered and not left."""
        return len(self._scopes) - 1

    def enter(self, local: Table | None = None) -> None:
        """Start a program with new AUTO variables. local: LOCAL ones, which outlive it."""
        self._scopes.append(_Scope(local))

    def leave(self) -> None:
        """End the program, and delete its AUTO variables."""
        self._scopes.pop()

    def cell(self, name: str) -> Cell:
        """Return the cell of a variable, whether or not it has a value yet."""
        key = canonical(name)
        scope = self._scopes[-1]
        if key in scope.auto:
            return Cell(scope.auto, key)
        base, bracket, rest = key.partition("[")
        if base in scope.arguments:
            table, actual = scope.arguments[base]
            return Cell(table, _add_subscripts(actual, bracket + rest))
        for table in (scope.auto, scope.local):
            if base in table:
                return Cell(table, key)
        return Cell(self._globals, key)

    def _value(self, key: str) -> Value | None:
        scope = self._scopes[-1]
        if not scope.arguments and "[" not in key:
            if key in scope.auto:
                return scope.auto[key]
            if key not in scope.local:
                return self._globals.get(key)
        table, table_key = self.cell(key)
        return table.get(table_key)

    def missing(self, name: str, value: Value | None, kind: str) -> Any:
        """Return the value of a variable of a kind that has none, or whose value is of another."""
        if value is not None and kind != "precision point":
            raise Unreadable(f"{name} is not a {kind}")
        noun = "" if kind in ("real", "string") else f"{kind} "
        raise Unreadable(f"{noun}{name} is not defined")

    def real(self, name: str) -> float:
        """The value of a real variable."""
        value = self._value(canonical(name))
        if isinstance(value, float):
            return value
        return self.missing(name, value, "real")  # type: ignore[no-any-return]

    def text(self, name: str) -> str:
        """The value of a string variable."""
        value = self._value(canonical(name))
        if isinstance(value, str):
            return value
        return self.missing(name, value, "string")  # type: ignore[no-any-return]

    def location(self, name: str) -> Location:
        """The value of a location variable; an external location for a name in `known`."""
        key = canonical(name)
        if self._external(key):
            return Location(NULL, Frame(external=key))
        value = self._value(key)
        if isinstance(value, Location):
            return value
        return self.missing(name, value, "location")  # type: ignore[no-any-return]

    def frame(self, name: str) -> Frame | None:
        """Return the frame of compounds that start with the location `name`.

        None if that location is itself a compound, external, or without a value.
        """
        key = canonical(name)
        if self._external(key):
            return Frame(external=key)
        value = self._value(key)
        if not isinstance(value, Location) or value.frame.compound or value.frame.external:
            return None
        if self._last_frame.pose is not value.local:
            self._last_frame = Frame(value.local, compound=True, name=value.name)
        return self._last_frame

    def point(self, name: str) -> Joints | Location:
        """The value of a precision point."""
        value = self._value(canonical(name))
        if isinstance(value, Joints):
            return value
        return self.missing(name, value, "precision point")  # type: ignore[no-any-return]

    def current_location(self, word: str) -> Location:
        """The location HERE, DEST, TOOL or BASE."""
        raise Unreadable(f"{word} is not known here")

    def current_point(self, word: str) -> Joints | Location:
        """HERE or DEST as joint values; a location if these are external."""
        raise Unreadable(f"#{word} is not evaluated")

    def signals(self, numbers: list[float]) -> float:  # noqa: ARG002 (for others)
        """SIG: TRUE if all signals are on, or off if their number is negative."""
        raise Unreadable("SIG is not evaluated")

    def answer(self, word: str, arguments: str, value: float) -> float:  # noqa: ARG002 (for others)
        """The value of an external function; `value` if nothing sets it."""
        raise Unreadable(f"{word} is not evaluated")

    def answer_text(self, word: str) -> str:
        """The value of an external string function."""
        raise Unreadable(f"{word} is not evaluated")

    def last(self, name: str) -> float:
        """Return the largest index of an array with a value, -1 without one."""
        table, key = self.cell(name)
        prefix = f"{key}[" if not key.endswith("]") else f"{key[:-1]},"
        elements = [k for k, v in table.items() if k.startswith(prefix) and v is not None]
        indices = [int(k[len(prefix) :].rstrip("]").split(",")[0]) for k in elements]
        return float(max(indices, default=-1))

    def defined(self, name: str) -> bool:
        """Whether a variable has a value."""
        return self._value(canonical(name)) is not None

    def is_assumed_defined(self, name: str) -> bool:
        """The value of DEFINED, which may rest on an assumption."""
        return self.defined(name)

    def assign(self, name: str, value: Value) -> None:
        """Assign a value, which must be of the kind that the variable has."""
        table, key = self.cell(name)
        old = table.get(key)
        if old is not None and type(old) is not type(value):
            raise Unreadable(f"{name} is used as a real and as a location")
        table[key] = value

    def is_own(self, name: str) -> bool:
        """Whether the running program has declared `name` as AUTO."""
        return canonical(name) in self._scopes[-1].auto

    def _external(self, key: str) -> bool:
        """Whether a location of the controller has no value and no declaration in the text."""
        return key in self._known and key not in self._globals and key not in self._scopes[-1].auto


def _add_subscripts(base: str, subscripts: str) -> str:
    """Return the name of an element of an array argument.

    An argument may be an array from one element on: `[2]` of the argument `a[1]` is `a[3]`.
    """
    if not subscripts or not base.endswith("]"):
        return base + subscripts
    *front, last = base[base.index("[") + 1 : -1].split(",")
    added = subscripts[1:-1].split(",")
    if len(added) == 1 and added[0].isdigit() and last.isdigit():
        numbers = [*front, str(int(last) + int(added[0]))]
        return f"{base[: base.index('[')]}[{','.join(numbers)}]"
    return base + subscripts


def check_name(name: str) -> str:
    """Return `name`. Raises Unreadable if no variable can have that name."""
    if not NAME_PATTERN.fullmatch(name):
        raise Unreadable(f"{name[:20]!r} is not a name")
    if name.upper() in TAKEN:
        raise Unreadable(f"{name} is a word of V+")
    return name
