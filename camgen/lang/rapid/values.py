"""RAPID values at run time: numbers, texts, records as tuples, arrays as lists, unknown values.

An unknown value names its source. A result that depends on an unknown value is unknown.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any

from camgen.lang.values import Unknown

from .tokens import LONGEST_STRING, Wrong
from .tree import Data, Expr

#: The value of an expression: float, bool, str, tuple (record), list (array) or Unknown. A
#: trigger is an object that its instruction defines.
Value = Any

#: The value of a missing argument.
NOTHING = Unknown("")
#: Numbers that are not below this are too large for a num (IEEE single precision).
_TOO_LARGE = 3.5e38


class RelativeTarget(Unknown, frozen=True, gc=False, kw_only=True):
    """A robtarget in a frame that is not in the program text, so that its components are unknown.

    point: the robtarget in this frame: position, mm, and orientation.
    frame: name of the frame.
    work: name of the work object along whose axes the frame lies, empty for `wobj0`.
    """

    point: tuple[tuple[float, ...], ...]
    frame: str
    work: str


class UserValue(float):
    """A value that the user gives for an unknown one. It serves as a num or as a bool."""

    __slots__ = ()

    def meet(self, other: Value) -> float | bool:
        """The value as a bool if `other` is a bool, else as a num."""
        return self != 0.0 if type(other) is bool else float(self)


class Variable:
    """Data with its value.

    name: name as declared.
    type: data type as declared.
    storage: const, pers, var, parameter, counter (of a FOR), or absent: a parameter not given.
    value: present value. The variable itself stands for a value that is not evaluated yet.
    line: line of the declaration.
    dims: size of each dimension of an array.
    home: module of the declaration.
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
    """The first unknown part of a value, None if all of it is known."""
    if type(value) is Unknown:
        return value
    if type(value) is RelativeTarget:
        return Unknown(value.what, value.key)
    if isinstance(value, (tuple, list)):
        for item in value:
            unknown = find_unknown(item)
            if unknown is not None:
                return unknown
    return None


def replace_part(old: Value, path: tuple[int, ...], new: Value) -> Value:
    """`old` with `new` at the indices `path`. Arrays change in place, records are copied."""
    if not path:
        return new
    index = path[0]
    part = replace_part(old[index], path[1:], new)
    if isinstance(old, list):
        old[index] = part
        return old
    return (*old[:index], part, *old[index + 1 :])


def copy_arrays(value: Value) -> Value:
    """The value with copies of its arrays; records and other values are shared."""
    return [copy_arrays(item) for item in value] if isinstance(value, list) else value


def _has_numbers(value: Value, count: int) -> bool:
    """Whether a value is a record of `count` nums: 3 make a position, 4 an orientation."""
    return (
        isinstance(value, tuple)
        and len(value) == count
        and all(type(item) is float for item in value)
    )


def operate(sign: str, a: Value, b: Value, line: int) -> Value:
    """The value of `a sign b`. Raises Wrong if there is no such operation, or if it fails."""
    is_logical = sign in ("and", "or", "xor")
    if type(a) is UserValue:
        a = a.meet(is_logical or b)
    if type(b) is UserValue:
        b = b.meet(is_logical or a)
    if is_logical:
        return _combine(sign, a, b, line)
    unknown = find_unknown(a) or find_unknown(b)
    if unknown is not None:
        return unknown
    if sign in ("=", "<>"):
        return (a == b) == (sign == "=")
    if type(a) is float and type(b) is float:
        return _calculate(sign, a, b, line)
    if sign == "+" and isinstance(a, str) and isinstance(b, str):
        if len(a) + len(b) > LONGEST_STRING:
            raise Wrong(line, f"a string becomes longer than {LONGEST_STRING} characters")
        return a + b
    result = _calculate_vectors(sign, a, b)
    if result is None:
        types = f"{format_type(a)} {sign.upper()} {format_type(b)}"
        raise Wrong(line, f"{types}: there is no such operation")
    return result


def _combine(sign: str, a: Value, b: Value, line: int) -> Value:
    """AND, OR and XOR. One operand may decide although the other one is unknown."""
    decisive = sign == "or"
    if sign != "xor" and (a is decisive or b is decisive):
        return decisive
    for operand in (a, b):
        if isinstance(operand, Unknown):
            return operand
        if type(operand) is not bool:
            raise Wrong(line, f"{sign.upper()} of {format_type(operand)}")
    # Otherwise no operand decides: AND has two TRUE, OR has two FALSE.
    return a != b if sign == "xor" else not decisive


_RELATIONS: dict[str, Callable[[float, float], bool]] = {
    "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge,
}  # fmt: skip
#: DIV and MOD are divisions here: the quotient may be too large for a num.
_ARITHMETIC: dict[str, Callable[[float, float], float]] = {
    "+": operator.add, "-": operator.sub, "*": operator.mul,
    "/": operator.truediv, "div": operator.truediv, "mod": operator.truediv,
}  # fmt: skip


def _calculate(sign: str, a: float, b: float, line: int) -> Value:
    if sign in _RELATIONS:
        return _RELATIONS[sign](a, b)
    if sign in ("/", "div", "mod") and b == 0:
        raise Wrong(line, "a division by 0")
    value = _ARITHMETIC[sign](a, b)
    if not abs(value) < _TOO_LARGE:
        raise Wrong(line, "a number becomes larger than a num can be")
    if sign not in ("div", "mod"):
        return value
    whole = float(math.trunc(value))
    return whole if sign == "div" else a - whole * b


def _calculate_vectors(sign: str, a: Value, b: Value) -> Value | None:
    """Sums and products of positions, orientations and nums. None for other operations."""
    if sign == "*" and _has_numbers(a, 4) and _has_numbers(b, 4):
        return multiply_turns(a, b)
    is_position = _has_numbers(a, 3), _has_numbers(b, 3)
    if not any(is_position):
        return None
    if all(is_position):
        if sign in ("+", "-"):
            return tuple(map(_ARITHMETIC[sign], a, b))
        if sign == "*":
            return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
    if sign == "*" and type(a) is float:
        return tuple(a * y for y in b)
    if sign in ("*", "/") and type(b) is float and (b != 0 or sign == "*"):
        return tuple(_ARITHMETIC[sign](x, b) for x in a)
    return None


def multiply_turns(a: tuple[float, ...], b: tuple[float, ...]) -> tuple[float, ...]:
    """The product of two quaternions, each with its real part first."""
    w, x, y, z = a
    p, q, r, s = b
    return (
        w * p - x * q - y * r - z * s,
        w * q + x * p + y * s - z * r,
        w * r - x * s + y * p + z * q,
        w * s + x * r - y * q + z * p,
    )


def negate(sign: str, value: Value, line: int) -> Value:
    """The value of `-value` or `NOT value`. Raises Wrong if there is no such operation."""
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
    if _has_numbers(value, 3):
        return tuple(-x for x in value)
    raise Wrong(line, f"minus {format_type(value)}: there is no such operation")


def format_type(value: Value) -> str:
    """The type of a value for a message."""
    names = {float: "a num", bool: "a bool", str: "a string", list: "an array"}
    return names.get(type(value), "a record")
