"""V+ variables: reals, locations and precision points, global or of one program. For the read-back ``vplus``."""

from __future__ import annotations

import re

from camgen.ir import Joints

from .vplus_places import BASE, NULL, Frame, Location, Unreadable
from .vplus_text import canonical

_NAME = re.compile(r"[#$]?[A-Za-z][A-Za-z0-9._]*")
_TAKEN = frozenset(
    """ABS ACCEL ALIGN ALWAYS APPRO APPROS ATTACH AUTO BASE BREAK CALL COS DEPART DEPARTS DEST DETACH DX DY DZ END FALSE
    FOR FRAME GLOBAL GOTO HERE IF INVERSE LOCAL MOVE MOVES NULL OFF ON PI RETURN RX RY RZ SELECT SET SHIFT SIGNAL SIN
    SPEED SQRT STATE TIME TOOL TRANS TRANSB TRUE TYPE WAIT WHILE
    """.split()  # noqa: SIM905 (a table)
)

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
            if local:
                self._locals[-1][key] = None

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
    if name.upper() in _TAKEN:
        raise Unreadable(f"{name} is a word of V+")
    return name
