"""The values of PacScript expressions that a program of the post may hold; their grammar is that of the language."""

from __future__ import annotations

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
    """A number that depends on the unit in which the controller reads ``Mps``: one for each of ``Machine.units``."""

    values: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Mps:
    """A speed by ``Mps``, in the unit that the controller reads it in."""

    said: float | Either


Value = float | Either | Pose | Joints | Vector | Mps
#: The value of a variable: lower-case name, or array letter and index.
Lookup = Callable[[str | tuple[str, int]], Value]

_PLAIN = re.compile(r"P\(([-+.\d\s,]+)\)", re.IGNORECASE)
_WHOLE = re.compile(r"[0-9]{1,9}")
_RATE = re.compile(r"Mps\(\s*(\d+\.?\d*)\s*\)", re.IGNORECASE | re.ASCII)
_SHORT = re.compile(r"([a-z])(\d{1,9})", re.ASCII)
_SIGNS = frozenset("+-*/")
_CONSTANTS = {"on": 1.0, "off": 0.0, "true": 1.0, "false": 0.0}


def evaluate(text: str, lookup: Lookup) -> Value:
    """The value of an expression. Unreadable when it has none that the text alone gives."""
    if _WHOLE.fullmatch(text):
        return float(text)
    if plain := _PLAIN.fullmatch(text):
        try:
            return position([float(v) for v in plain[1].split(",")])
        except ValueError:
            pass  # Left-out numbers and sums are for the parser.
    if rate := _RATE.fullmatch(text):
        return Mps(finite(float(rate[1])))
    return _value(parse(text), lookup)


def _value(node: Node, lookup: Lookup) -> Value:
    """The value of a part of an expression; one that is left out is 0."""
    kind, said = node.kind, node.said
    if isinstance(said, float) and kind in ("number", "left out"):
        return said
    if kind == "name":
        name = str(said)
        if name in _CONSTANTS:
            return _CONSTANTS[name]
        short = _SHORT.fullmatch(name)
        return lookup((short[1], int(short[2])) if short and short[1] in "pjtvifds" else name)
    if kind in _SIGNS:
        return _chain(node, lookup)
    if kind not in ("tuple", "index", "call", "sign"):
        raise Unreadable(f"{said if kind == 'text' else kind} is not evaluated")
    values = [_value(part, lookup) for part in node.parts]
    if kind == "tuple":
        return _bracket(values)
    if kind == "index":
        return lookup((str(said), index(_float(values[0]))))
    if kind == "call":
        return _call(str(said), values)
    return calculate("*", values[0], float(said))


def _chain(node: Node, lookup: Lookup) -> Value:
    """The value of a sum or a product, from its left end: it may be long."""
    chain = [node]
    while chain[-1].parts[0].kind in _SIGNS:
        chain.append(chain[-1].parts[0])
    value = _value(chain[-1].parts[0], lookup)
    for one in reversed(chain):
        value = calculate(one.kind, value, _value(one.parts[1], lookup))
    return value


def number(text: str, lookup: Lookup) -> float:
    """The value of an expression that must be a number."""
    value = evaluate(text, lookup)
    if not isinstance(value, float):
        raise Unreadable(f"{text} is not a number")
    return value


def speed(value: Value) -> float | Mps:
    """``value`` as an internal speed: percent, or by ``Mps``."""
    if not isinstance(value, (float, Mps)):
        raise Unreadable("a speed must be a number")
    if isinstance(value, float) and not 0.1 <= value <= 100:
        raise Unreadable(f"a speed of {value:g} %, the controller takes 0.1 to 100")
    if isinstance(value, Mps):
        for said in value.said.values if isinstance(value.said, Either) else (value.said,):
            if said <= 0:
                raise Unreadable(f"a speed of Mps({said:g})")
    return value


def position(values: list[float]) -> Pose:
    """``P(x, y, z, rx, ry, rz, fig)`` in mm and degrees; a figure is a number, or -1: open."""
    if len(values) > 6 and values[6] != UNDEFINED:
        index(values[6])
    return make_position(values)


def calculate(sign: str, a: Value, b: Value) -> float | Either:
    """``a`` and ``b`` added, subtracted, multiplied or divided; Unreadable for what is no number."""
    if isinstance(a, Either) or isinstance(b, Either):
        return join([_calculate(sign, x, y) for x, y in zip(*spread(a, b), strict=True)])
    return _calculate(sign, _float(a), _float(b))


def spread(*values: Value) -> list[tuple[float, ...]]:
    """Numbers, at least one of them an ``Either``, as so many values each."""
    count = next(len(value.values) for value in values if isinstance(value, Either))
    return [
        value.values if isinstance(value, Either) else (_float(value),) * count for value in values
    ]


def join(values: Sequence[float]) -> float | Either:
    """Values by unit as one number where they are the same."""
    return values[0] if len(set(values)) == 1 else Either(tuple(values))


def _calculate(sign: str, a: float, b: float) -> float:
    if sign == "/" and b == 0:
        raise Unreadable("a division by zero")
    return finite({"+": a + b, "-": a - b, "*": a * b}[sign] if sign != "/" else a / b)


def _bracket(values: list[Value]) -> Value:
    """A value in brackets; three to seven are a position as ``P()`` has it."""
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
    "UNDEFINED", "Either", "Figured", "Mps", "Unreadable", "Value", "Vector", "arguments", "calculate", "evaluate",
    "index", "join", "number", "position", "speed", "spread",
]  # fmt: skip
