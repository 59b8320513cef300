"""Values of PacScript expressions in a program of a post. Their grammar is that of the language."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from camgen.lang.pacscript.expressions import Node, arguments, parse
from camgen.lang.pacscript.values import (
    UNDEFINED,
    Figured,
    Unreadable,
    Vector,
    finite,
    homogeneous,
    index,
    joints,
    vector,
)
from camgen.lang.pacscript.values import position as make_position
from camgen.model.pose import Pose
from camgen.model.program import Joints


@dataclass(frozen=True, slots=True)
class Either:
    """A number that depends on the unit of `Mps`.

    values: number for each of `Machine.units`.
    """

    values: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Mps:
    """A speed by `Mps`.

    number: speed in the unit of the controller.
    """

    number: float | Either


Value = float | Either | Pose | Joints | Vector | Mps
#: Function that returns the value of a variable by its name in lower case, or by array letter and
#: index.
Lookup = Callable[[str | tuple[str, int]], Value]

_PLAIN = re.compile(r"P\(([-+.\d\s,]+)\)", re.IGNORECASE)
_WHOLE = re.compile(r"[0-9]{1,9}")
_RATE = re.compile(r"Mps\(\s*(\d+\.?\d*)\s*\)", re.IGNORECASE | re.ASCII)
_SHORT = re.compile(r"([a-z])(\d{1,9})", re.ASCII)
_OPERATIONS = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
}
_CONSTANTS = {"on": 1.0, "off": 0.0, "true": 1.0, "false": 0.0}


def evaluate(text: str, lookup: Lookup) -> Value:
    """The value of an expression. Raises Unreadable if the text alone does not give it."""
    if _WHOLE.fullmatch(text):
        return float(text)
    if plain := _PLAIN.fullmatch(text):
        try:
            return position([float(v) for v in plain[1].split(",")])
        except ValueError:
            pass  # The parser reads omitted numbers and sums.
    if rate := _RATE.fullmatch(text):
        return Mps(finite(float(rate[1])))
    return _value(parse(text), lookup)


def _value(node: Node, lookup: Lookup) -> Value:
    """The value of a part of an expression, 0 for an omitted part."""
    kind, content = node.kind, node.said
    if isinstance(content, float) and kind in ("number", "left out"):
        return content
    if kind == "name":
        name = str(content)
        if name in _CONSTANTS:
            return _CONSTANTS[name]
        short = _SHORT.fullmatch(name)
        return lookup((short[1], int(short[2])) if short and short[1] in "pjtvifds" else name)
    if kind in _OPERATIONS:
        return _chain(node, lookup)
    if kind not in ("tuple", "index", "call", "sign"):
        raise Unreadable(f"{content if kind == 'text' else kind} is not evaluated")
    values = [_value(part, lookup) for part in node.parts]
    if kind == "tuple":
        return _bracket(values)
    if kind == "index":
        return lookup((str(content), index(_float(values[0]))))
    if kind == "call":
        return _call(str(content), values)
    return calculate("*", values[0], float(content))


def _chain(node: Node, lookup: Lookup) -> Value:
    """The value of a sum or a product. It is evaluated from its left end, as it may be long."""
    chain = [node]
    while chain[-1].parts[0].kind in _OPERATIONS:
        chain.append(chain[-1].parts[0])
    value = _value(chain[-1].parts[0], lookup)
    for operation in reversed(chain):
        value = calculate(operation.kind, value, _value(operation.parts[1], lookup))
    return value


def number(text: str, lookup: Lookup) -> float:
    """The value of an expression. Raises Unreadable if it is not a number."""
    value = evaluate(text, lookup)
    if not isinstance(value, float):
        raise Unreadable(f"{text} is not a number")
    return value


def speed(value: Value) -> float | Mps:
    """A value as an internal speed, % or by `Mps`. Raises Unreadable if it is out of range."""
    if not isinstance(value, (float, Mps)):
        raise Unreadable("a speed must be a number")
    if isinstance(value, float) and not 0.1 <= value <= 100:
        raise Unreadable(f"a speed of {value:g} %, the controller takes 0.1 to 100")
    if isinstance(value, Mps):
        numbers = value.number.values if isinstance(value.number, Either) else (value.number,)
        for argument in numbers:
            if argument <= 0:
                raise Unreadable(f"a speed of Mps({argument:g})")
    return value


def position(values: list[float]) -> Pose:
    """The pose of `P(x, y, z, rx, ry, rz, fig)`, mm and deg. A figure of -1 is open."""
    if len(values) > 6 and values[6] != UNDEFINED:
        index(values[6])
    return make_position(values)


def calculate(sign: str, a: Value, b: Value) -> float | Either:
    """The sum, difference, product or quotient of two values.

    Raises Unreadable if one of them is not a number.
    """
    if isinstance(a, Either) or isinstance(b, Either):
        return join([_calculate(sign, x, y) for x, y in zip(*spread(a, b), strict=True)])
    return _calculate(sign, _float(a), _float(b))


def spread(*values: Value) -> list[tuple[float, ...]]:
    """The values of numbers for each unit. At least one number is an `Either`."""
    count = next(len(value.values) for value in values if isinstance(value, Either))
    return [
        value.values if isinstance(value, Either) else (_float(value),) * count for value in values
    ]


def join(values: Sequence[float]) -> float | Either:
    """The values for each unit as a number if they are equal, else as an `Either`."""
    return values[0] if len(set(values)) == 1 else Either(tuple(values))


def _calculate(sign: str, a: float, b: float) -> float:
    if sign == "/" and b == 0:
        raise Unreadable("a division by zero")
    return finite(_OPERATIONS[sign](a, b))


def _bracket(values: list[Value]) -> Value:
    """A value in brackets. Three to seven values are a position like those of `P()`."""
    if len(values) == 1:
        return values[0]
    if len(values) == 2:
        raise Unreadable("two values in brackets are not evaluated")
    return position([_float(v) for v in values])


def _float(value: Value) -> float:
    if not isinstance(value, float):
        raise Unreadable("only numbers can be calculated with")
    return value


def _call(name: str, values: list[Value]) -> Value:
    if name == "mps":
        if len(values) != 1 or not isinstance(values[0], (float, Either)):
            raise Unreadable("Mps needs one number")
        return Mps(values[0])
    if name not in _CONSTRUCTORS:
        raise Unreadable(f"the function {name} is not evaluated")
    return _CONSTRUCTORS[name]([_float(v) for v in values])


_CONSTRUCTORS: dict[str, Callable[[list[float]], Value]] = {
    "p": position,
    "j": joints,
    "v": vector,
    "t": homogeneous,
}

__all__ = [
    "UNDEFINED", "Either", "Figured", "Mps", "Unreadable", "Value", "Vector", "arguments",
    "calculate", "evaluate", "index", "join", "number", "position", "speed", "spread",
]  # fmt: skip
