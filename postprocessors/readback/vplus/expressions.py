"""V+ expressions: reals, locations and precision points. For the read-back ``vplus``.

Sources: V+ Language Reference and User's Guide as docs/posts/vplus.md quotes them: ``TRANS`` is x, y, z, yaw, pitch,
roll with R = Rz(yaw) Ry(pitch) Rz(roll), missing arguments are 0; ``a:b`` multiplies left to right; SIN and COS take
degrees.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Protocol

from camgen.model.pose import Pose, rotation_about
from camgen.model.program import Joints
from camgen.model.text import counted

from .names import TAKEN, canonical
from .text import BASE, NULL, Frame, Location, Unreadable, rotation_zyz

#: Brackets deeper than this are no program that somebody wrote.
_DEPTH = 40
_LARGEST = 1e9
#: A number, a name, or any other sign; blanks are nowhere needed.
_TOKEN = re.compile(r"(?:\d+\.?\d*|\.\d+)(?:E[-+]?\d+)?|[#$]?[A-Z][A-Z0-9._]*|\S", re.ASCII)
_DIGITS = frozenset("0123456789.")
_CONSTANTS = {"TRUE": -1.0, "ON": -1.0, "FALSE": 0.0, "OFF": 0.0, "PI": math.pi}
_FUNCTIONS: dict[str, Callable[[float], float]] = {
    "SIN": lambda deg: math.sin(math.radians(deg)),
    "COS": lambda deg: math.cos(math.radians(deg)),
    "ABS": abs,
    "SQRT": math.sqrt,
}
_TURNS = {"RX": 0, "RY": 1, "RZ": 2}
_PARTS = {"DX": 0, "DY": 1, "DZ": 2}


class Scope(Protocol):
    """Where names get their values."""

    def real(self, name: str) -> float:
        """The value of a real variable."""

    def location(self, name: str) -> Location:
        """The value of a location variable."""

    def point(self, name: str) -> Joints:
        """The value of a precision point."""

    def here(self, word: str) -> Location:
        """HERE or DEST."""


class Expression:
    """One text, read from left to right. Every method raises Unreadable where the text does not fit. constant: no name
    had a say in what was read so far. omitted: a number between commas was left out.
    """

    def __init__(self, text: str, scope: Scope) -> None:
        self._scope = scope
        self.constant = True
        self.omitted = False
        # An empty token closes the list, so that there is always a next one.
        self._tokens: list[str] = [*_TOKEN.findall(text.upper()), ""]
        self._at = 0
        self._depth = 0

    def _named(self) -> Scope:
        self.constant = False
        return self._scope

    # -- tokens --------------------------------------------------------------------------------------------------

    def peek(self) -> str:
        """The next token in capitals, empty at the end."""
        return self._tokens[self._at]

    def take(self) -> str:
        """The next token in capitals."""
        token = self._tokens[self._at]
        if not token:
            raise Unreadable("something is missing at the end of the line")
        self._at += 1
        return token

    def accept(self, token: str) -> bool:
        """Whether the next token is ``token``; then it is taken."""
        if self._tokens[self._at] != token:
            return False
        self._at += 1
        return True

    def expect(self, token: str) -> None:
        """Takes ``token``."""
        if not self.accept(token):
            raise Unreadable(f"{token} expected before {self.peek() or 'the end of the line'}")

    def finish(self) -> None:
        """Nothing may be left."""
        if self._tokens[self._at]:
            raise Unreadable(f"{self._tokens[self._at][:20]!r} is not expected here")

    def _deeper(self) -> None:
        self._depth += 1
        if self._depth > _DEPTH:
            raise Unreadable("brackets are nested too deeply")

    # -- reals ---------------------------------------------------------------------------------------------------

    def real(self) -> float:
        """A sum, finite."""
        value = self._product()
        while self.peek() in ("+", "-"):
            value += self._product() if self.take() == "+" else -self._product()
        if not abs(value) <= _LARGEST:
            raise Unreadable("a number is not finite or beyond any machine")
        return value

    def _product(self) -> float:
        value = self._factor()
        while self.peek() in ("*", "/"):
            if self.take() == "*":
                value *= self._factor()
            else:
                divisor = self._factor()
                if divisor == 0:
                    raise Unreadable("a division by zero")
                value /= divisor
        return value

    def _factor(self) -> float:
        sign = 1.0
        while self.peek() in ("+", "-"):
            sign = sign if self.take() == "+" else -sign
        token = self.take()
        if token == "(":
            value = self._bracketed()
        elif token[0] in _DIGITS and token != ".":
            value = float(token)
        elif token in _CONSTANTS:
            value = _CONSTANTS[token]
        elif token in _FUNCTIONS:
            self.expect("(")
            value = self._function(token)
        elif token in _PARTS:
            self.expect("(")
            value = self._inner().in_base().origin[_PARTS[token]]
        elif token[0].isalpha():
            value = self._named().real(token)
        else:
            raise Unreadable(f"a number expected instead of {token!r}")
        return sign * value

    def _bracketed(self) -> float:
        self._deeper()
        value = self.real()
        self.expect(")")
        self._depth -= 1
        return value

    def _function(self, word: str) -> float:
        value = self._bracketed()
        if word == "SQRT" and value < 0:
            raise Unreadable("the root of a negative number")
        return _FUNCTIONS[word](value)

    def reals(self) -> list[float]:
        """Numbers with commas between them; one that is missing is 0."""
        values = [self._real_or_zero()]
        while self.accept(","):
            values.append(self._real_or_zero())
        return values

    def _real_or_zero(self) -> float:
        if self.peek() not in (",", ")", ""):
            return self.real()
        self.omitted = True
        return 0.0

    # -- locations -----------------------------------------------------------------------------------------------

    def location(self) -> Location:
        """A location or a compound ``a:b:c``."""
        first = self._primary()
        while self.accept(":"):
            second = self._primary().in_base()
            if first.frame.compound or first.frame.external:
                first = first.moved(second)
            else:
                first = Location(second, Frame(first.local, compound=True))
        return first

    def _primary(self) -> Location:
        token = self.take()
        if token == "TRANS":
            return self._trans()
        if token == "SHIFT":
            return self._shift()
        if token == "INVERSE":
            self.expect("(")
            return Location(self._inner().in_base().inverse())
        if token in _TURNS:
            self.expect("(")
            return Location(Pose(rotation_about(_TURNS[token], math.radians(self._bracketed())), (0.0, 0.0, 0.0)))
        if token == "NULL":
            return Location(NULL)
        if token in ("HERE", "DEST"):
            return self._named().here(token)
        if token in ("FRAME", "TRANSB"):
            raise Unreadable(f"{token} is not evaluated")
        if not token[0].isalpha():
            raise Unreadable(f"a location expected instead of {token!r}")
        return self._named().location(token)

    def _inner(self) -> Location:
        """A location up to the closing bracket."""
        self._deeper()
        value = self.location()
        self.expect(")")
        self._depth -= 1
        return value

    def _trans(self) -> Location:
        self.expect("(")
        self._deeper()
        values = self.reals()
        self.expect(")")
        self._depth -= 1
        if len(values) > 6:
            raise Unreadable(f"TRANS has {len(values)} arguments")
        x, y, z, yaw, pitch, roll = values + [0.0] * (6 - len(values))
        return Location(Pose(rotation_zyz(yaw, pitch, roll), (x, y, z)))

    def _shift(self) -> Location:
        self.expect("(")
        self._deeper()
        pose = self.location().in_base()
        self.expect("BY")
        values = self.reals()
        self.expect(")")
        self._depth -= 1
        if len(values) > 3:
            raise Unreadable(f"SHIFT by {len(values)} values")
        dx, dy, dz = values + [0.0] * (3 - len(values))
        x, y, z = pose.origin
        return Location(Pose(pose.rotation, (x + dx, y + dy, z + dz)))

    # -- precision points ----------------------------------------------------------------------------------------

    def point(self) -> Joints:
        """``#PPOINT(..)`` or the name of a precision point. Degrees; mm for joint 3 of four (a SCARA)."""
        token = self.take()
        if token != "#PPOINT":
            return self._named().point(token)
        self.expect("(")
        values = self.reals()
        self.expect(")")
        if len(values) not in (4, 6):
            raise Unreadable(f"#PPOINT has {counted(len(values), 'value')}, not 4 or 6")
        slide = 2 if len(values) == 4 else None
        return Joints(tuple(v if k == slide else math.radians(v) for k, v in enumerate(values)))


# V+ variables: reals, locations and precision points, global or of one program. For the read-back ``vplus``.

_NAME = re.compile(r"[#$]?[A-Za-z][A-Za-z0-9._]*")

Value = float | Location | Joints


class Variables:
    """The variables while a program runs. known: locations that only the controller has. All methods: Unreadable for a
    name that is not defined, or defined as something else.
    """

    def __init__(self, known: frozenset[str]) -> None:
        self._known = known
        self._globals: dict[str, Value] = {}
        self._locals: list[dict[str, Value | None]] = [{}]
        self._given = BASE

    @property
    def depth(self) -> int:
        """How many programs have been entered and not left."""
        return len(self._locals) - 1

    def enter(self) -> None:
        """A program starts: its AUTO variables are its own."""
        self._locals.append({})

    def leave(self) -> None:
        """The program ends, and with it its AUTO variables."""
        self._locals.pop()

    def real(self, name: str) -> float:
        """The value of a real variable."""
        value = self._value(canonical(name))
        if not isinstance(value, float):
            raise Unreadable(f"{name} is not defined" if value is None else f"{name} is no real")
        return value

    def location(self, name: str) -> Location:
        """The value of a location variable, or a location that only the controller knows."""
        key = canonical(name)
        if self._external(key):
            return Location(NULL, Frame(external=key))
        value = self._value(key)
        if not isinstance(value, Location):
            raise Unreadable(f"location {name} is not defined" if value is None else f"{name} is no location")
        return value

    def frame(self, name: str) -> Frame | None:
        """What a compound that starts with the location ``name`` is given in; nothing where that takes more to say."""
        key = canonical(name)
        if self._external(key):
            return Frame(external=key)
        value = self._value(key)
        if not isinstance(value, Location) or value.frame.compound or value.frame.external:
            return None
        if self._given.pose is not value.local:
            self._given = Frame(value.local, compound=True)
        return self._given

    def point(self, name: str) -> Joints:
        """The value of a precision point."""
        value = self._value(canonical(name))
        if not isinstance(value, Joints):
            raise Unreadable(f"precision point {name} is not defined")
        return value

    def assign(self, name: str, value: Value) -> None:
        """Gives a variable a value; it keeps its kind."""
        key = canonical(name)
        old = self._value(key)
        if old is not None and type(old) is not type(value):
            raise Unreadable(f"{name} is used as a real and as a location")
        if key in self._locals[-1]:
            self._locals[-1][key] = value
        else:
            self._globals[key] = value

    def declare(self, text: str, local: bool) -> None:
        """The names of an AUTO, LOCAL or GLOBAL line."""
        bare = re.sub(r"^(REAL|DOUBLE)\s+", "", text, flags=re.IGNORECASE)
        for part in bare.split(","):
            key = canonical(variable(re.sub(r"\[[^\]]*\]$", "", part.strip())))
            if key in self._locals[-1]:
                raise Unreadable(f"{part.strip()} is declared twice")
            if local:
                self._locals[-1][key] = None

    def is_own(self, name: str) -> bool:
        """Whether the program that runs has declared ``name`` for itself."""
        return canonical(name) in self._locals[-1]

    def _external(self, key: str) -> bool:
        """Whether the name stands for what the controller has: the text gives it no value and declares no own one."""
        return key in self._known and key not in self._globals and key not in self._locals[-1]

    def _value(self, key: str) -> Value | None:
        scope = self._locals[-1]
        return scope[key] if key in scope else self._globals.get(key)


def variable(name: str) -> str:
    """``name``, which must be one that a variable can have."""
    if not _NAME.fullmatch(name):
        raise Unreadable(f"{name[:20]!r} is no name")
    if name.upper() in TAKEN:
        raise Unreadable(f"{name} is a word of V+")
    return name
