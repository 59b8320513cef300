"""PacScript expressions: numbers, positions, joints and vectors (RC8 manual 450, 456, 458)."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from camgen.model.pose import FloatArray, Pose, Vec3, frozen, rotation_from_fixed_xyz
from camgen.model.program import Joints


class Unreadable(ValueError):
    """A statement that cannot be evaluated; its text is the fault."""


@dataclass(frozen=True, slots=True)
class Either:
    """A number that depends on the unit in which the controller reads ``Mps``: one for each of ``Machine.units``."""

    values: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Mps:
    """A speed by ``Mps``, in the unit that the controller reads it in."""

    said: float | Either


@dataclass(frozen=True, slots=True)
class Vector:
    """``V(x, y, z)``, mm."""

    values: Vec3


class Figured(Pose, frozen=True, eq=False, gc=False):
    """A position with a figure that is not -1."""

    figure: int


Value = float | Either | Pose | Joints | Vector | Mps
#: The value of a variable: lower-case name, or array letter and index.
Lookup = Callable[[str | tuple[str, int]], Value]

#: The figure of a position that leaves it open (RC8 manual 456).
UNDEFINED = -1
_DEPTH = 40
_PLAIN = re.compile(r"P\(([-+.\d\s,]+)\)", re.IGNORECASE)
_WHOLE = re.compile(r"[0-9]{1,9}")
_RATE = re.compile(r"Mps\(\s*(\d+\.?\d*)\s*\)", re.IGNORECASE | re.ASCII)
#: One part of a list whose brackets do not nest, and the comma after it.
_PART = re.compile(r'((?:[^,()\[\]"]|\([^()\[\]"]*+\)|\[[^()\[\]"]*+\])*+)(,|$)')
_SEPARATOR = re.compile(r'"[^"]*"|[(),\[\]]')
_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?)|&b(?P<binary>[01]+)|&h(?P<hex>[\da-f]+)"
    r"|(?P<name>[a-z_]\w*)|(?P<sign>[-+*/(),\[\]]))",
    re.IGNORECASE | re.ASCII,
)
_SHORT = re.compile(r"([a-z])(\d{1,9})", re.ASCII)
_CONSTANTS = {"on": 1.0, "off": 0.0, "true": 1.0, "false": 0.0}
_rotations: dict[tuple[float, float, float], FloatArray] = {}


def arguments(text: str) -> list[str]:
    """``text`` cut at the commas outside brackets and quotes, each part stripped."""
    flat = _PART.findall(text)
    if sum(map(len, map("".join, flat))) == len(text) and flat[-1][1] == "":
        # The usual case; an empty match after a last comma is its empty part.
        return [part.strip() for part, _ in flat[: len(flat) if len(flat) == 1 or flat[-2][1] else -1]]
    parts, depth, start = [], 0, 0
    for match in _SEPARATOR.finditer(text):
        sign = match.group()
        if sign in "([":
            depth += 1
        elif sign in ")]":
            depth -= 1
        elif sign == "," and depth == 0:
            parts.append(text[start : match.start()].strip())
            start = match.end()
    return [*parts, text[start:].strip()]


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
        return Mps(_finite(float(rate[1])))
    parser = _Parser(_tokens(text), lookup)
    value = parser.sum()
    if parser.at < len(parser.tokens):
        raise Unreadable(f"{parser.tokens[parser.at]} is not understood in {text}")
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
    """``P(x, y, z, rx, ry, rz, fig)`` in mm and degrees, what is left out 0, and -1 for the figure."""
    if len(values) > 7:
        raise Unreadable("P() has more than seven values")
    x, y, z, rx, ry, rz = values[:6] if len(values) > 5 else values + [0.0] * (6 - len(values))
    if not math.isfinite(x + y + z + rx + ry + rz):
        raise Unreadable("a number is too large")
    key = (rx, ry, rz)
    if key not in _rotations:
        if len(_rotations) > 100_000:
            _rotations.clear()
        _rotations[key] = rotation_from_fixed_xyz(math.radians(rx), math.radians(ry), math.radians(rz))
    if len(values) < 7 or values[6] == UNDEFINED:
        return Pose(_rotations[key], (x, y, z))
    return Figured(_rotations[key], (x, y, z), index(values[6]))


def _tokens(text: str) -> list[str]:
    tokens, at = [], 0
    text = text.strip()
    while at < len(text):
        match = _TOKEN.match(text, at)
        if match is None:
            raise Unreadable(f"{text} is not understood")
        tokens.append(match.group().strip())
        at = match.end()
    return tokens


class _Parser:
    """Recursive descent over tokens; depth is limited because text may nest without end."""

    def __init__(self, tokens: list[str], lookup: Lookup) -> None:
        self.tokens, self.lookup, self.at, self.depth = tokens, lookup, 0, 0

    def take(self, *signs: str) -> str:
        """The next token if it is one of ``signs``, else empty."""
        if self.at < len(self.tokens) and self.tokens[self.at] in signs:
            self.at += 1
            return self.tokens[self.at - 1]
        return ""

    def sum(self) -> Value:
        value = self.product()
        while sign := self.take("+", "-"):
            value = calculate(sign, value, self.product())
        return value

    def product(self) -> Value:
        value = self.signed()
        while sign := self.take("*", "/"):
            value = calculate(sign, value, self.signed())
        return value

    def signed(self) -> Value:
        negative, any_sign = False, False
        while sign := self.take("+", "-"):
            negative, any_sign = negative != (sign == "-"), True
        value = self.atom()
        if not any_sign:
            return value
        return calculate("*", value, -1.0 if negative else 1.0)

    def atom(self) -> Value:
        if self.at >= len(self.tokens):
            raise Unreadable("a value is missing")
        token = self.tokens[self.at].lower()
        self.at += 1
        if token[0].isdigit() or token[0] in ".&":
            return _literal(token)
        if token == "(":
            return _bracket(self.inside(")"))
        if not (token[0].isalpha() or token[0] == "_"):
            raise Unreadable(f"{token} is not understood")
        if self.take("("):
            return _call(token, self.inside(")"))
        if self.take("["):
            return self.lookup((token, index(_float(self.inside("]")[0]))))
        if token in _CONSTANTS:
            return _CONSTANTS[token]
        short = _SHORT.fullmatch(token)
        return self.lookup((short[1], int(short[2])) if short and short[1] in "pjtvifds" else token)

    def inside(self, closing: str) -> list[Value]:
        """The values up to ``closing``; a left-out one is 0."""
        self.depth += 1
        if self.depth > _DEPTH:
            raise Unreadable("brackets nested too deep")
        values: list[Value] = []
        while True:
            empty = self.at < len(self.tokens) and self.tokens[self.at] in (",", closing)
            values.append(0.0 if empty else self.sum())
            if self.take(closing):
                break
            if not self.take(","):
                raise Unreadable(f"{closing} is missing")
        self.depth -= 1
        return values


def index(value: float) -> int:
    """``value`` as an array index or number of a thing."""
    if not 0 <= value <= 1e9 or value != int(value):
        raise Unreadable(f"{value:g} is not an index")
    return int(value)


def _literal(token: str) -> float:
    try:
        if token[0] == "&":
            return float(int(token[2:], 2 if token[1] == "b" else 16))
        return _finite(float(token))
    except OverflowError:
        raise Unreadable("a number is too large") from None


#: No number of a program is larger: delays are in ms.
_LARGEST = 1e10


def _finite(value: float) -> float:
    if not abs(value) <= _LARGEST:
        raise Unreadable("a number is too large")
    return value


def calculate(sign: str, a: Value, b: Value) -> float | Either:
    """``a`` and ``b`` added, subtracted, multiplied or divided; Unreadable for what is no number."""
    if isinstance(a, Either) or isinstance(b, Either):
        return join([_calculate(sign, x, y) for x, y in zip(*spread(a, b), strict=True)])
    return _calculate(sign, _float(a), _float(b))


def spread(*values: Value) -> list[tuple[float, ...]]:
    """Numbers, at least one of them an ``Either``, as so many values each."""
    count = next(len(value.values) for value in values if isinstance(value, Either))
    return [value.values if isinstance(value, Either) else (_float(value),) * count for value in values]


def join(values: Sequence[float]) -> float | Either:
    """Values by unit as one number where they are the same."""
    return values[0] if len(set(values)) == 1 else Either(tuple(values))


def _calculate(sign: str, a: float, b: float) -> float:
    if sign == "/" and b == 0:
        raise Unreadable("a division by zero")
    return _finite({"+": a + b, "-": a - b, "*": a * b}[sign] if sign != "/" else a / b)


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


def _joints(values: list[float]) -> Joints:
    if len(values) > 8:
        raise Unreadable("J() has more than eight values")
    return Joints(tuple(math.radians(v) for v in values))


def _vector(values: list[float]) -> Vector:
    x, y, z = (values + [0.0] * 3)[:3]
    return Vector((x, y, z))


def _homogeneous(values: list[float]) -> Pose:
    """``T(p, orient, approach, fig)``: orient is the y axis, approach the z axis (RC8 manual 458)."""
    if len(values) < 9:
        raise Unreadable("T() has fewer than nine values")
    y, z = np.array(values[3:6]), np.array(values[6:9])
    if max(abs(float(y @ y) - 1), abs(float(z @ z) - 1), abs(float(y @ z))) > 1e-3:
        raise Unreadable("the axes of T() are not unit vectors at right angles")
    z = z / np.linalg.norm(z)
    y = y - z * float(y @ z)
    y = y / np.linalg.norm(y)
    return Pose(frozen(np.column_stack([np.cross(y, z), y, z])), (values[0], values[1], values[2]))


_CONSTRUCTORS: dict[str, Callable[[list[float]], Value]] = {
    "p": position,
    "j": _joints,
    "v": _vector,
    "t": _homogeneous,
}
