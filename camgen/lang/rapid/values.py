"""RAPID values at run time: numbers, texts, records as tuples, arrays as lists, and what no text holds.

A value that is not known says where it comes from; what is worked out from it is not known either.
"""

from __future__ import annotations

import math
from typing import Any

from camgen.lang.values import Unknown

from .tokens import LONGEST_STRING, Wrong
from .tree import Data, Expr

#: What an expression is worth: float, bool, str, tuple (record), list (array), Unknown, or what an instruction made.
Value = Any


NOTHING = Unknown("")


class RelativeTarget(Unknown, frozen=True, gc=False, kw_only=True):
    """A robtarget in a frame that no text states, so that its components are unknown.

    point: the robtarget in this frame: position, mm, and orientation.
    frame: name of the frame.
    work: name of the work object along whose axes the frame lies, empty for `wobj0`.
    """

    point: tuple[tuple[float, ...], ...]
    frame: str
    work: str


class UserValue(float):
    """A value that the user gives to what no text holds: a num, or a bool where one is asked for."""

    __slots__ = ()

    def meet(self, other: Value) -> float | bool:
        """The same as what it is held against is."""
        return self != 0.0 if type(other) is bool else float(self)


class Variable:
    """Data with its value.

    name: name as declared.
    base: data of which a parameter is a part, and the path to the part within them.
    start: expression of the first value. It is evaluated when the value is needed.
    fault: reason why there is no value.
    declaration: declaration, None for data of the system and for parameters.
    """

    __slots__ = (
        "base", "declaration", "dims", "fault", "home", "line", "name", "start", "storage", "type",
        "value",
    )  # fmt: skip

    def __init__(
        self, name: str, kind: str, storage: str = "var", value: Value = None, line: int = 0
    ) -> None:
        self.name, self.type, self.storage, self.value, self.line = name, kind, storage, value, line
        self.base: tuple[Variable, tuple[int, ...]] | None = None
        self.start: Expr | None = None
        self.dims: tuple[Expr, ...] = ()
        self.home: object = None
        self.fault: Wrong | None = None
        self.declaration: Data | None = None


def find_unknown(value: Value) -> Unknown | None:
    """The first part of a value that is not known."""
    if type(value) is Unknown:
        return value
    if type(value) is RelativeTarget:
        return Unknown(value.what, value.key)
    if isinstance(value, (tuple, list)):
        for item in value:
            found = find_unknown(item)
            if found is not None:
                return found
    return None


def replace_part(old: Value, path: tuple[int, ...], new: Value) -> Value:
    """``old`` with ``new`` at the places ``path``; arrays change in place."""
    if not path:
        return new
    place, rest = path[0], path[1:]
    if isinstance(old, list):
        old[place] = replace_part(old[place], rest, new)
        return old
    return (*old[:place], replace_part(old[place], rest, new), *old[place + 1 :])


def copy_arrays(value: Value) -> Value:
    """The value with arrays of its own."""
    return [copy_arrays(item) for item in value] if isinstance(value, list) else value


def is_number(value: Value) -> bool:
    """Whether a value is a num."""
    return type(value) is float


def _is_vector(value: Value) -> bool:
    return isinstance(value, tuple) and len(value) == 3 and all(map(is_number, value))


def _is_turn(value: Value) -> bool:
    return isinstance(value, tuple) and len(value) == 4 and all(map(is_number, value))


def operate(sign: str, a: Value, b: Value, line: int) -> Value:
    """``a sign b``. Wrong where no controller has such an operation, or it fails."""
    if type(a) is UserValue or type(b) is UserValue:
        logical = sign in ("and", "or", "xor")
        a, b = (
            one.meet(logical or two) if type(one) is UserValue else one
            for one, two in ((a, b), (b, a))
        )
    if sign in ("and", "or", "xor"):
        return _combine(sign, a, b, line)
    unknown = find_unknown(a) or find_unknown(b)
    if unknown is not None:
        return unknown
    if sign in ("=", "<>"):
        return _equal(a, b) == (sign == "=")
    if type(a) is float and type(b) is float:
        return _calculate(sign, a, b, line)
    if sign == "+" and isinstance(a, str) and isinstance(b, str):
        if len(a) + len(b) > LONGEST_STRING:
            raise Wrong(line, f"a string becomes longer than {LONGEST_STRING} characters")
        return a + b
    if sign == "*" and _is_turn(a) and _is_turn(b):
        return multiply_turns(a, b)
    if _is_vector(a) or _is_vector(b):
        return _vectors(sign, a, b, line)
    raise Wrong(
        line, f"{format_type(a)} {sign.upper()} {format_type(b)}: there is no such operation"
    )


def _combine(sign: str, a: Value, b: Value, line: int) -> Value:
    """AND, OR and XOR of what may not be known."""
    decides = sign == "or"
    if sign != "xor" and (a is decides or b is decides):
        return decides
    for one in (a, b):
        if isinstance(one, Unknown):
            return one
        if type(one) is not bool:
            raise Wrong(line, f"{sign.upper()} of {format_type(one)}")
    if sign == "xor":
        return a != b
    return (a and b) if sign == "and" else (a or b)


def _equal(a: Value, b: Value) -> bool:
    if (type(a) is bool and type(b) is float) or (type(a) is float and type(b) is bool):
        return float(a) == float(b)
    return bool(a == b)


def _calculate(sign: str, a: float, b: float, line: int) -> Value:
    if sign in ("<", "<=", ">", ">="):
        return (
            a < b if sign == "<" else a <= b if sign == "<=" else a > b if sign == ">" else a >= b
        )
    if sign in ("/", "div", "mod") and b == 0:
        raise Wrong(line, "a division by 0")
    if sign in ("div", "mod") and abs(a / b) < 3.5e38:
        whole = float(math.trunc(a / b))
        return whole if sign == "div" else a - whole * b
    value = a + b if sign == "+" else a - b if sign == "-" else a * b if sign == "*" else a / b
    if not abs(value) < 3.5e38:
        raise Wrong(line, "a number becomes larger than a num can be")
    return value


def _vectors(sign: str, a: Value, b: Value, line: int) -> Value:
    """Sums of positions, and products with a number or each other."""
    if _is_vector(a) and _is_vector(b):
        if sign in ("+", "-"):
            return tuple(x + y if sign == "+" else x - y for x, y in zip(a, b, strict=True))
        if sign == "*":
            return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
    if sign == "*" and is_number(a):
        return tuple(a * y for y in b)
    if sign in ("*", "/") and is_number(b) and (b != 0 or sign == "*"):
        return tuple(x * b if sign == "*" else x / b for x in a)
    raise Wrong(
        line, f"{format_type(a)} {sign.upper()} {format_type(b)}: there is no such operation"
    )


def multiply_turns(a: tuple[float, ...], b: tuple[float, ...]) -> tuple[float, ...]:
    """The product of two quaternions."""
    w, x, y, z = a
    p, q, r, s = b
    return (
        w * p - x * q - y * r - z * s,
        w * q + x * p + y * s - z * r,
        w * r - x * s + y * p + z * q,
        w * s + x * r - y * q + z * p,
    )


def negate(sign: str, value: Value, line: int) -> Value:
    """``-value`` or NOT value. Wrong where there is none."""
    if isinstance(value, Unknown):
        return value
    if type(value) is UserValue:
        value = value.meet(sign == "not" or 0.0)
    if sign == "not":
        if type(value) is not bool:
            raise Wrong(line, f"NOT of {format_type(value)}")
        return not value
    if type(value) is float:
        return -value
    if _is_vector(value):
        return tuple(-x for x in value)
    raise Wrong(line, f"minus {format_type(value)}: there is no such operation")


def format_type(value: Value) -> str:
    """What kind of value it is, for a message."""
    if type(value) is float:
        return "a num"
    if type(value) is bool:
        return "a bool"
    if isinstance(value, str):
        return "a string"
    return "an array" if isinstance(value, list) else "a record"
