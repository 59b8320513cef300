"""V+ variables: numbers, strings, locations and precision points, global or of one program, with subscripts.

An element of an array is a variable of its own, ``a[1,2]``: V+ needs no declaration of arrays. Arguments are names for
variables of the program that calls. Sources: V+ User's Guide, program variables and argument passing.
"""

from __future__ import annotations

import re
from typing import ClassVar, NamedTuple

from camgen.model.program import Joints

from .names import TAKEN, canonical
from .text import BASE, NULL, Frame, Location, Unreadable

_NAME = re.compile(r"[#$]?[A-Za-z][A-Za-z0-9._]*")

Value = float | str | Location | Joints
#: Values by the name with its subscripts; None: declared, and without a value.
Table = dict[str, Value | None]


class Cell(NamedTuple):
    """Where a variable stands."""

    table: Table
    key: str


class _Scope:
    """What a program sees beside the globals: its own variables, and others by the names of its arguments."""

    __slots__ = ("kept", "others", "own")

    def __init__(self, kept: Table | None = None) -> None:
        self.own: Table = {}
        self.kept: Table = {} if kept is None else kept
        self.others: dict[str, Cell] = {}


class Variables:
    """The variables while a program runs. known: locations that only the controller has. All methods: Unreadable for a
    name that is not defined, or defined as something else.
    """

    strict: ClassVar[bool] = True

    def __init__(self, known: frozenset[str]) -> None:
        self._known = known
        self._globals: Table = {}
        self._scopes: list[_Scope] = [_Scope()]
        self._given = BASE

    @property
    def depth(self) -> int:
        """How many programs have been entered and not left."""
        return len(self._scopes) - 1

    def enter(self, kept: Table | None = None) -> None:
        """A program starts: its AUTO variables are its own. kept: its LOCAL ones, which outlive it."""
        self._scopes.append(_Scope(kept))

    def leave(self) -> None:
        """The program ends, and with it its AUTO variables."""
        self._scopes.pop()

    def alias(self, name: str, cell: Cell) -> None:
        """An argument: another name for a variable of the program that calls."""
        self._scopes[-1].others[canonical(name)] = cell

    def cell(self, name: str) -> Cell:
        """Where the variable ``name`` stands, or will."""
        key = canonical(name)
        scope = self._scopes[-1]
        if key in scope.own:
            return Cell(scope.own, key)
        base, bracket, rest = key.partition("[")
        if base in scope.others:
            table, other = scope.others[base]
            return Cell(table, _index(other, bracket + rest))
        for table in (scope.own, scope.kept):
            if base in table:
                return Cell(table, key)
        return Cell(self._globals, key)

    def _value(self, key: str) -> Value | None:
        """The value of a canonical name."""
        scope = self._scopes[-1]
        if not scope.others and "[" not in key:
            if key in scope.own:
                return scope.own[key]
            if key not in scope.kept:
                return self._globals.get(key)
        table, place = self.cell(key)
        return table.get(place)

    def real(self, name: str) -> float:
        """The value of a real variable."""
        value = self._value(canonical(name))
        if isinstance(value, float):
            return value
        return self.no_real(name, value)

    def no_real(self, name: str, value: Value | None) -> float:
        """What stands for a real that has no value, or another kind of."""
        raise Unreadable(f"{name} is not defined" if value is None else f"{name} is no real")

    def text(self, name: str) -> str:
        """The value of a string variable."""
        value = self._value(canonical(name))
        if isinstance(value, str):
            return value
        return self.no_text(name, value)

    def no_text(self, name: str, value: Value | None) -> str:
        """What stands for a string that has no value."""
        raise Unreadable(f"{name} is not defined" if value is None else f"{name} is no string")

    def set_text(self, name: str, value: str) -> None:
        """Gives a string variable a value."""
        self.assign(name, value)

    def location(self, name: str) -> Location:
        """The value of a location variable, or a location that only the controller knows."""
        key = canonical(name)
        if self._external(key):
            return Location(NULL, Frame(external=key))
        value = self._value(key)
        if isinstance(value, Location):
            return value
        return self.no_location(name, value)

    def no_location(self, name: str, value: Value | None) -> Location:
        """What stands for a location that has no value."""
        raise Unreadable(
            f"location {name} is not defined" if value is None else f"{name} is no location"
        )

    def frame(self, name: str) -> Frame | None:
        """What a compound that starts with the location ``name`` is given in; nothing where that takes more to say."""
        key = canonical(name)
        if self._external(key):
            return Frame(external=key)
        value = self._value(key)
        if not isinstance(value, Location) or value.frame.compound or value.frame.external:
            return None
        if self._given.pose is not value.local:
            self._given = Frame(value.local, compound=True, name=value.name)
        return self._given

    def point(self, name: str) -> Joints | Location:
        """The value of a precision point."""
        value = self._value(canonical(name))
        if isinstance(value, Joints):
            return value
        return self.no_point(name, value)

    def no_point(self, name: str, value: Value | None) -> Joints | Location:  # noqa: ARG002 (for others)
        """What stands for a precision point that has no value."""
        raise Unreadable(f"precision point {name} is not defined")

    def point_here(self, word: str) -> Joints | Location:
        """Where the robot is, as joint values."""
        raise Unreadable(f"#{word} is not evaluated")

    def signals(self, numbers: list[float]) -> float:  # noqa: ARG002 (for others)
        """SIG."""
        raise Unreadable("SIG is not evaluated")

    def answer(self, word: str, arguments: str, value: float) -> float:  # noqa: ARG002 (for others)
        """What a function of the surroundings says."""
        raise Unreadable(f"{word} is not evaluated")

    def answer_text(self, word: str) -> str:
        """The same of a string."""
        raise Unreadable(f"{word} is not evaluated")

    def last(self, name: str) -> float:
        """The last index of an array that has a value, -1 where none has."""
        table, key = self.cell(name)
        prefix = f"{key}[" if not key.endswith("]") else f"{key[:-1]},"
        found = [
            k[len(prefix) :].rstrip("]").split(",")[0]
            for k, v in table.items()
            if k.startswith(prefix) and v is not None
        ]
        return float(max(map(int, found), default=-1))

    def defined(self, name: str) -> bool:
        """Whether a variable has a value."""
        return self._value(canonical(name)) is not None

    def says_defined(self, name: str) -> bool:
        """DEFINED."""
        return self.defined(name)

    def assign(self, name: str, value: Value) -> None:
        """Gives a variable a value; it keeps its kind."""
        table, key = self.cell(name)
        old = table.get(key)
        if old is not None and type(old) is not type(value):
            raise Unreadable(f"{name} is used as a real and as a location")
        table[key] = value

    def declare(self, text: str, local: bool) -> None:
        """The names of an AUTO, LOCAL or GLOBAL line."""
        bare = re.sub(r"^(REAL|DOUBLE)\s+", "", text, flags=re.IGNORECASE)
        for part in bare.split(","):
            key = canonical(variable(re.sub(r"\[[^\]]*\]$", "", part.strip())))
            if key in self._scopes[-1].own:
                raise Unreadable(f"{part.strip()} is declared twice")
            if local:
                self._scopes[-1].own[key] = None

    def is_own(self, name: str) -> bool:
        """Whether the program that runs has declared ``name`` for itself."""
        return canonical(name) in self._scopes[-1].own

    def _external(self, key: str) -> bool:
        """Whether the name stands for what the controller has: the text gives it no value and declares no own one."""
        return key in self._known and key not in self._globals and key not in self._scopes[-1].own


def _index(base: str, subscripts: str) -> str:
    """``a[1]`` with ``[2]`` behind it: an array that an argument names from an element on counts from there."""
    if not subscripts or not base.endswith("]"):
        return base + subscripts
    *front, last = base[base.index("[") + 1 : -1].split(",")
    added = subscripts[1:-1].split(",")
    if len(added) == 1 and added[0].isdigit() and last.isdigit():
        numbers = [*front, str(int(last) + int(added[0]))]
        return f"{base[: base.index('[')]}[{','.join(numbers)}]"
    return base + subscripts


def variable(name: str) -> str:
    """``name``, which must be one that a variable can have."""
    if not _NAME.fullmatch(name):
        raise Unreadable(f"{name[:20]!r} is no name")
    if name.upper() in TAKEN:
        raise Unreadable(f"{name} is a word of V+")
    return name
