"""Numbers, parameters and expressions of LinuxCNC, as its manual's overview defines them. Angles in degrees."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field

from camgen.gcode.wrong import Wrong

_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)")
_OPERATOR = re.compile(r"\*\*|[*/+-]|mod|eq|ne|gt|ge|lt|le|and|or|xor")
_FUNCTION = re.compile(r"abs|acos|asin|atan|cos|exists|exp|fix|fup|ln|round|sin|sqrt|tan")
_NAME = re.compile(r"#<([^<>]*)>")
#: Numbers that differ by less are equal to EQ and NE, as in LinuxCNC.
_EQUAL = 1e-4
#: Deeper nesting is not meant.
_DEEP = 60
#: #1 to #30 belong to a subroutine, up to #5000 to the program, beyond to the machine.
LOCALS, GLOBALS = 30, 5000
_MOST_GLOBALS = 100_000


@dataclass(slots=True)
class Parameters:
    """Values by number and by name. machine: tells those that the state of the machine decides, by number or name."""

    machine: Callable[[str], float | None]
    numbered: dict[int, float] = field(default_factory=dict)
    shared: dict[str, float] = field(default_factory=dict)
    own: dict[int, float] = field(default_factory=dict)
    named: dict[str, float] = field(default_factory=dict)

    def get(self, key: int | str) -> float:
        """The value; Wrong for one that only a machine has, or that no line has set."""
        if isinstance(key, str):
            value = (self.shared if key.startswith("_") else self.named).get(key)
            value = self.machine(key) if value is None else value
            if value is None:
                raise Wrong(f"#<{key}> is used before it is set")
            return value
        if key < 1:
            raise Wrong(f"#{key} is no parameter")
        if key <= LOCALS:
            return self.own.get(key, 0.0)
        if key <= GLOBALS:
            return self.numbered.get(key, 0.0)
        value = self.machine(str(key))
        if value is None:
            raise Wrong(f"#{key} is a value of the machine, which is not known here")
        return value

    def put(self, key: int | str, value: float) -> None:
        """Sets a value; Wrong for one of the machine's."""
        if isinstance(key, str):
            if self.machine(key) is not None:
                raise Wrong(f"#<{key}> cannot be set")
            (self.shared if key.startswith("_") else self.named)[key] = value
        elif key < 1 or key > GLOBALS:
            raise Wrong(f"#{key} is a value of the machine and is not set here")
        else:
            (self.own if key <= LOCALS else self.numbered)[key] = value

    def has(self, key: int | str) -> bool:
        """Whether a parameter is set."""
        if isinstance(key, str):
            known = key in (self.shared if key.startswith("_") else self.named)
            return known or self.machine(key) is not None
        return 1 <= key <= GLOBALS


def key_at(text: str, at: int, known: Parameters, depth: int = 0) -> tuple[int | str, int]:
    """The parameter whose # stands at ``at``, and where its name ends."""
    named = _NAME.match(text, at)
    if named:
        return named[1], named.end()
    value, end = value_at(text, at + 1, known, depth + 1)
    if abs(value - round(value)) > _EQUAL:
        raise Wrong(f"#{value:g} is no parameter: its number must be whole")
    return round(value), end


def value_at(text: str, at: int, known: Parameters, depth: int = 0) -> tuple[float, int]:
    """The value that stands at ``at`` of ``text`` (small letters, no blanks), and where it ends. Raises Wrong."""
    if depth > _DEEP:
        raise Wrong("an expression that is nested too deeply")
    number = _NUMBER.match(text, at)
    if number:
        return float(number[0]), number.end()
    sign = text[at : at + 1]
    if sign == "[":
        return _bracket(text, at + 1, known, depth + 1)
    if sign == "#":
        key, end = key_at(text, at, known, depth)
        return known.get(key), end
    if sign in ("-", "+") and sign:
        value, end = value_at(text, at + 1, known, depth + 1)
        return (-value if sign == "-" else value), end
    function = _FUNCTION.match(text, at)
    if function:
        return _function(function[0], text, function.end(), known, depth + 1)
    raise Wrong(f"cannot read {text[at : at + 12]!r}: a number or an expression is expected")


def _bracket(text: str, at: int, known: Parameters, depth: int) -> tuple[float, int]:
    """The expression after its opening bracket, by precedence, equals from left to right."""
    value, at = value_at(text, at, known, depth)
    values, waiting = [value], [""]
    while True:
        operator = "]" if text[at : at + 1] == "]" else ""
        if not operator:
            found = _OPERATOR.match(text, at)
            if not found:
                raise Wrong(f"cannot read {text[at : at + 12]!r} in an expression")
            operator = found[0]
        while waiting[-1] and _BINDS[waiting[-1]] >= _BINDS.get(operator, 0):
            right, left = values.pop(), values.pop()
            values.append(_apply(waiting.pop(), left, right))
        if operator == "]":
            return values[0], at + 1
        value, at = value_at(text, at + len(operator), known, depth)
        values.append(value)
        waiting.append(operator)


_BINDS = {
    "**": 6, "*": 5, "/": 5, "mod": 5, "+": 4, "-": 4,
    "eq": 3, "ne": 3, "gt": 3, "ge": 3, "lt": 3, "le": 3, "and": 2, "or": 2, "xor": 2,
}  # fmt: skip


def _power(a: float, b: float) -> float:
    if a < 0 and b != int(b):
        raise Wrong("a negative number to a power that is not whole")
    return float(a**b)


def _modulo(a: float, b: float) -> float:
    rest = math.fmod(a, b)
    return rest + abs(b) if rest < 0 else rest


_BINARY: dict[str, Callable[[float, float], float]] = {
    "**": _power,
    "*": lambda a, b: a * b,
    "/": lambda a, b: a / b,
    "mod": _modulo,
    "+": lambda a, b: a + b,
    "-": lambda a, b: a - b,
    "eq": lambda a, b: float(abs(a - b) < _EQUAL),
    "ne": lambda a, b: float(abs(a - b) >= _EQUAL),
    "gt": lambda a, b: float(a > b),
    "ge": lambda a, b: float(a >= b),
    "lt": lambda a, b: float(a < b),
    "le": lambda a, b: float(a <= b),
    "and": lambda a, b: float(bool(a) and bool(b)),
    "or": lambda a, b: float(bool(a) or bool(b)),
    "xor": lambda a, b: float(bool(a) != bool(b)),
}
_UNARY: dict[str, Callable[[float], float]] = {
    "abs": abs,
    "acos": lambda v: math.degrees(math.acos(v)),
    "asin": lambda v: math.degrees(math.asin(v)),
    "cos": lambda v: math.cos(math.radians(v)),
    "exp": math.exp,
    "fix": lambda v: float(math.floor(v)),
    "fup": lambda v: float(math.ceil(v)),
    "ln": math.log,
    "round": lambda v: math.copysign(math.floor(abs(v) + 0.5), v),
    "sin": lambda v: math.sin(math.radians(v)),
    "sqrt": math.sqrt,
    "tan": lambda v: math.tan(math.radians(v)),
}


def _apply(operator: str, a: float, b: float) -> float:
    try:
        value = _BINARY[operator](a, b)
    except (ValueError, ZeroDivisionError, OverflowError) as error:
        raise Wrong(f"{a:g} {operator.upper()} {b:g} has no value") from error
    return _finite(value, operator)


def _finite(value: float, what: str) -> float:
    if not math.isfinite(value):
        raise Wrong(f"{what.upper()} gives no finite number")
    return value


def _function(name: str, text: str, at: int, known: Parameters, depth: int) -> tuple[float, int]:
    if text[at : at + 1] != "[":
        raise Wrong(f"{name.upper()} without its bracket")
    if name == "exists":
        key, end = key_at(text, at + 1, known, depth) if text[at + 1 : at + 2] == "#" else ("", at)
        if text[end : end + 1] != "]":
            raise Wrong("EXISTS asks for a parameter, EXISTS[#<name>]")
        return float(known.has(key)), end + 1
    value, at = _bracket(text, at + 1, known, depth)
    if name == "atan":
        if text[at : at + 2] != "/[":
            raise Wrong("ATAN has two arguments, ATAN[y]/[x]")
        other, at = _bracket(text, at + 2, known, depth)
        return math.degrees(math.atan2(value, other)), at
    try:
        return _finite(float(_UNARY[name](value)), name), at
    except (ValueError, OverflowError) as error:
        raise Wrong(f"{name.upper()}[{value:g}] has no value") from error
