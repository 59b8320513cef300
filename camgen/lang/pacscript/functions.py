"""The operators of PacScript, and its functions without external values."""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from camgen.lang.pacscript.values import (
    Array,
    ExternalPose,
    Unreadable,
    Value,
    Vector,
    Wrong,
    base_of,
    components,
    describe_value,
    figure_of,
    finite,
    homogeneous,
    joints,
    keep_frame,
    number,
    position,
    vector,
    with_figure,
)
from camgen.lang.values import Unknown, find_first_unknown
from camgen.model.pose import Pose, Vec3, frozen, rotation_from_fixed_xyz, to_vec3
from camgen.model.program import Joints

#: Maximum length of a text: stops programs that build one in a loop.
_MAX_TEXT = 100_000


def numbers(values: list[Value], maximum: int | None = None) -> list[float]:
    """Convert values to numbers. Raises Unreadable, also for more than `maximum` values."""
    if maximum is not None and len(values) > maximum:
        raise Unreadable("too many values")
    return [number(value) for value in values]


def get_value(values: Sequence[Value], at: int, default: Value) -> Value:
    """Return the value at an index from 0, `default` without one."""
    if at < len(values):
        return values[at]
    return default


def place(value: Value) -> Pose:
    """Convert a value to a position. Raises Unreadable if it is not one."""
    if isinstance(value, tuple):
        return position(numbers(list(value)))
    if isinstance(value, Vector):
        return position(value.values)
    if not isinstance(value, Pose):
        raise Unreadable(f"{describe_value(value)} is not a position")
    return value


def text_of(value: Value) -> str:
    """Convert a value to a text. Raises Unreadable if it is not a number or a text."""
    if isinstance(value, str):
        return value
    if isinstance(value, (float, bool)):
        return f"{float(value):.9g}"
    raise Unreadable(f"{describe_value(value)} is not text")


def _position(values: list[Value]) -> Value:
    """`P(x, y, z, rx, ry, rz, fig)`, where vectors may stand for the first and next three."""
    if values and isinstance(values[0], Vector):
        rest = values[1:]
        if rest and isinstance(rest[0], Vector):
            rest = [*rest[0].values, *rest[1:]]
        values = [*values[0].values, *rest]
    return position(numbers(values))


def _component(at: int) -> Callable[[list[Value]], Value]:
    def take(values: list[Value]) -> Value:
        (value,) = values
        if isinstance(value, Vector) and at < 3:
            return value.values[at]
        return components(place(value))[at]

    return take


# `Dev` moves along and about the axes of the work frame, `DevH` along and about those of the tool.


def _shift(values: list[Value]) -> Value:
    base, offset = place(values[0]), place(values[1])
    x, y, z = (a + b for a, b in zip(base.origin, offset.origin, strict=True))
    return with_figure(Pose(frozen(offset.rotation @ base.rotation), (x, y, z)), figure_of(base))


def _shift_hand(values: list[Value]) -> Value:
    base, offset = place(values[0]), place(values[1])
    if isinstance(offset, ExternalPose):
        return Unknown(f"a place by {offset.base}")
    return keep_frame(with_figure(base @ offset, figure_of(base)), base)


def _joint(values: list[Value]) -> Value:
    at, arm_joints = int(number(values[0])), values[1]
    if not isinstance(arm_joints, Joints):
        raise Unreadable(f"{describe_value(arm_joints)} is not a joint value")
    if not 1 <= at <= 8:
        raise Wrong(f"there is no axis {at}")
    return math.degrees(arm_joints.values[at - 1]) if at <= len(arm_joints.values) else 0.0


def _column(at: int) -> Callable[[list[Value]], Value]:
    def take(values: list[Value]) -> Value:
        return Vector(to_vec3(place(values[0]).rotation[:, at]))

    return take


def _vector(value: Value) -> Vec3:
    if isinstance(value, Pose):
        return value.origin
    if isinstance(value, tuple):
        return vector(numbers(list(value))).values
    if not isinstance(value, Vector):
        raise Unreadable(f"{describe_value(value)} is not a vector")
    return value.values


def _cross(values: list[Value]) -> Value:
    return Vector(to_vec3(np.cross(_vector(values[0]), _vector(values[1]))))


def _array(values: list[Value]) -> Value:
    return (
        Array((len(values) - 1,), 0.0, {(k,): value for k, value in enumerate(values)})
        if values
        else Array((), 0.0)
    )


def _bound(values: list[Value]) -> Value:
    array = values[0]
    if not isinstance(array, Array):
        raise Unreadable(f"{describe_value(array)} is not an array")
    at = int(number(get_value(values, 1, 1.0))) - 1
    return float(array.tops[at]) if 0 <= at < len(array.tops) else 0.0


def _math(function: Callable[..., float], count: int = 1) -> Callable[[list[Value]], Value]:
    def take(values: list[Value]) -> Value:
        if len(values) != count:
            raise Unreadable(f"{count} values are expected, not {len(values)}")
        try:
            return finite(float(function(*numbers(values))))
        except (ValueError, OverflowError, ZeroDivisionError):
            raise Wrong("a function of a number that it does not take") from None

    return take


def _degrees(function: Callable[..., float], count: int = 1) -> Callable[[list[Value]], Value]:
    inner = _math(function, count)
    return lambda values: math.degrees(number(inner(values)))


def _of_degrees(function: Callable[[float], float]) -> Callable[[list[Value]], Value]:
    return _math(lambda angle: function(math.radians(angle)))


# Texts.

_FORMAT = re.compile(r"%([-+ 0#]*)(\d{0,3})(\.\d{1,3})?([diufFeEgGsxXcoS%])")


def _sprintf(values: list[Value]) -> Value:
    rest = iter(values[1:])

    def format_value(match: re.Match[str]) -> str:
        flags, width, precision, kind = match.groups("")
        if kind == "%":
            return "%"
        value = next(rest, "")
        if kind in "sSc":
            return f"%{flags}{width}{precision}s" % text_of(value)
        amount = number(value)
        if kind in "diuxXo":
            amount = int(amount)
        return f"%{flags}{width}{precision}{kind.replace('u', 'd')}" % amount

    return _FORMAT.sub(format_value, text_of(values[0]))


def _split(values: list[Value]) -> Value:
    return _array(list(text_of(values[0]).split(text_of(values[1]) or None)[:_MAX_TEXT]))


def _value(values: list[Value]) -> Value:
    match = re.match(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,3})?)", text_of(values[0]))
    return finite(float(match[1])) if match else 0.0


def _middle(values: list[Value]) -> Value:
    text, start = text_of(values[0]), max(0, int(number(values[1])) - 1)
    return text[start : start + int(number(get_value(values, 2, float(len(text)))))]


def _right(values: list[Value]) -> Value:
    count = max(0, int(number(values[1])))
    return text_of(values[0])[-count:] if count else ""


def _find(values: list[Value]) -> Value:
    if isinstance(values[0], str):
        values = [1.0, *values]
    start = int(number(values[0])) - 1
    return float(text_of(values[1]).find(text_of(values[2]), max(0, start)) + 1)


def _text(function: Callable[[str], str]) -> Callable[[list[Value]], Value]:
    return lambda values: function(text_of(values[0]))


def _extreme(function: Callable[..., float]) -> Callable[[list[Value]], Value]:
    return lambda values: float(function(*numbers(values))) if values else 0.0


#: Functions by name in lower case. An IndexError of one means that there are too few values.
FUNCTIONS: dict[str, Callable[[list[Value]], Value]] = {
    "p": _position,
    "j": lambda values: joints(numbers(values)),
    "v": lambda values: vector(numbers(values, 3)),
    "t": lambda values: homogeneous(numbers(values)),
    "posx": _component(0),
    "posy": _component(1),
    "posz": _component(2),
    "posrx": _component(3),
    "posry": _component(4),
    "posrz": _component(5),
    **dict.fromkeys(("fig", "posf", "posfig"), lambda values: float(figure_of(place(values[0])))),
    "dev": _shift,
    "devh": _shift_hand,
    "joint": _joint,
    "pvec": lambda values: Vector(place(values[0]).origin),
    "rvec": _column(0),
    "ovec": _column(1),
    "avec": _column(2),
    **dict.fromkeys(
        ("dist", "distance"), lambda values: math.dist(_vector(values[0]), _vector(values[1]))
    ),
    "magnitude": lambda values: math.hypot(*_vector(values[0])),
    "dot": lambda values: sum(
        a * b for a, b in zip(_vector(values[0]), _vector(values[1]), strict=True)
    ),
    "cross": _cross,
    **dict.fromkeys(("p2t", "t2p", "tnorm"), lambda values: values[0]),
    "cint": _math(round),
    "csng": _math(float),
    "cdbl": _math(float),
    "tinv": lambda values: place(values[0]).inverse(),
    "tmul": lambda values: place(values[0]) @ place(values[1]),
    "array": _array,
    "createarray": lambda values: Array((max(0, int(number(values[0]))),), 0.0),
    "ubound": _bound,
    "lbound": lambda _: 0.0,
    "abs": _math(abs),
    "sqr": _math(math.sqrt),
    "sqrt": _math(math.sqrt),
    "exp": _math(math.exp),
    "log": _math(math.log),
    "log10": _math(math.log10),
    "pow": _math(math.pow, 2),
    "int": _math(math.floor),
    "fix": _math(math.trunc),
    "ceil": _math(math.ceil),
    "sgn": _math(lambda x: (x > 0) - (x < 0)),
    "sin": _of_degrees(math.sin),
    "cos": _of_degrees(math.cos),
    "tan": _of_degrees(math.tan),
    "asin": _degrees(math.asin),
    "asc": lambda values: float(ord(text_of(values[0])[0])) if text_of(values[0]) else 0.0,
    "acos": _degrees(math.acos),
    "atan": _degrees(math.atan),
    "atn": _degrees(math.atan),
    "atan2": _degrees(math.atan2, 2),
    "atn2": _degrees(math.atan2, 2),
    "raddeg": _math(math.degrees),
    "degrad": _math(math.radians),
    "rad": _math(math.radians),
    "deg": _math(math.degrees),
    "max": _extreme(max),
    "min": _extreme(min),
    "str": lambda values: text_of(values[0]),
    "sprintf": _sprintf,
    "split": _split,
    "val": _value,
    "chr": lambda values: chr(int(number(values[0])) % 256),
    "len": lambda values: float(len(text_of(values[0]))),
    "lenb": lambda values: float(len(text_of(values[0]))),
    "left": lambda values: text_of(values[0])[: max(0, int(number(values[1])))],
    "right": _right,
    "mid": _middle,
    "instr": _find,
    "strpos": _find,
    "ucase": _text(str.upper),
    "lcase": _text(str.lower),
    "trim": _text(str.strip),
    "ltrim": _text(str.lstrip),
    "rtrim": _text(str.rstrip),
    "hex": lambda values: f"{int(number(values[0])):X}",
    "bin": lambda values: f"{int(number(values[0])):b}",
}

#: Functions with external values: time, state of the controller, kinematics, other tasks.
_ASKED = """
    area areapos areasize calcworkpos com_state comm createmultiarray createmutex curacc
    curcpmode curdec curerr curexj curextacc curextdec curfig curforcesensorpayload curlmt
    curoptmode curpathpoint curpayload curspeedmode curtrn date deadmanstate desttrn detectoff
    detecton dps err errlvl errmsg forcevalue format getareadetected getcollisionstatus
    gethandio getlanguage getpathpoint getpathpointcount getpriority getsrvdata getsrvjntdata
    hand inrange instrrev j2p j2t lockstate motioncomplete motorstate msgbox mutexid mutexstate
    normalvector now outrange p2j pallet realpath rnd robinfo rpm sprintfs status statusbyname
    statustime synctime sysinfo syslog sysstate t2j takearmstate takemutex time timer timetotick
    toolpos varchangetype vartype ver virtualfence vis waitmotion workattribute workpos"""
ASKED = frozenset(_ASKED.split())


def call(name: str, values: list[Value]) -> Value:
    """Call a function without external values. Raises Unreadable. Unknown if an argument is."""
    for value in values:
        if isinstance(value, Unknown):
            return Unknown(value.what, value.key)
        if isinstance(value, ExternalPose) and name not in _TAKING_EXTERNAL:
            return Unknown(f"{name} of {value.base}")
    try:
        return FUNCTIONS[name](values)
    except (IndexError, TypeError):
        raise Unreadable(f"{name} with {len(values)} values is not evaluated") from None
    except (ValueError, OverflowError) as error:
        if isinstance(error, Unreadable):
            raise
        raise Unreadable(f"{name} of these values is not evaluated") from None


#: Functions that accept an external pose.
_TAKING_EXTERNAL = frozenset(("devh", "p2t", "t2p", "tnorm", "array"))


def calculate(sign: str, a: Value, b: Value) -> Value:
    """Apply an operator to two values. Raises Unreadable. Unknown if one of them is."""
    unknown = find_first_unknown((a, b))
    if unknown is not None:
        return Unknown(unknown.what, unknown.key)
    base = base_of(a) or base_of(b)
    if base:
        return Unknown(base)
    if sign in COMPARISONS:
        return _compare(sign, a, b)
    if sign == "&" or (sign == "+" and isinstance(a, str)):
        joined = text_of(a) + text_of(b)
        if len(joined) > _MAX_TEXT:
            raise Unreadable("a text grows without end")
        return joined
    if sign in ("<<", ">>"):
        value, bits = int(number(a)), max(0, min(32, int(number(b))))
        return float((value << bits) & 0xFFFFFFFF if sign == "<<" else value >> bits)
    if sign in ("and", "or", "xor"):
        if isinstance(a, bool) and isinstance(b, bool):
            return {"and": a and b, "or": a or b, "xor": a != b}[sign]
        x, y = (int(number(operand)) for operand in (a, b))
        return float({"and": x & y, "or": x | y, "xor": x ^ y}[sign])
    if isinstance(a, (float, bool)) and isinstance(b, (float, bool)):
        return _arithmetic(sign, float(a), float(b))
    return _with_places(sign, a, b)


COMPARISONS: dict[str, Callable[[Any, Any], bool]] = {
    "=": operator.eq,
    "<>": operator.ne,
    "<": operator.lt,
    ">": operator.gt,
    "<=": operator.le,
    ">=": operator.ge,
}


def _compare(sign: str, a: Value, b: Value) -> bool:
    compare = COMPARISONS[sign]
    if isinstance(a, str) and isinstance(b, str):
        return compare(a, b)
    if isinstance(a, str):
        return compare(_value([a]), number(b))
    if isinstance(b, str):
        return compare(number(a), _value([b]))
    if isinstance(a, (Pose, Joints, Vector)) and sign in ("=", "<>"):
        same = type(a) is type(b) and _flat(a) == _flat(b)
        return same == (sign == "=")
    return compare(number(a), number(b))


def _flat(value: Pose | Joints | Vector) -> list[float]:
    return components(value) if isinstance(value, Pose) else list(value.values)


_ARITHMETIC: dict[str, Callable[[float, float], float]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "^": math.pow,
}


def _arithmetic(sign: str, a: float, b: float) -> float:
    try:
        if sign in _ARITHMETIC:
            return finite(_ARITHMETIC[sign](a, b))
        whole, part = round(a), round(b)
        if sign != "\\":
            return math.fmod(whole, part)
        return float(abs(whole) // abs(part) * (1 if whole * part >= 0 else -1))
    except ZeroDivisionError:
        raise Wrong("a division by zero") from None
    except (OverflowError, ValueError):
        raise Unreadable("a number is too large") from None


def _with_places(sign: str, a: Value, b: Value) -> Value:
    """Apply an operator to vectors, joint values and, in the older dialect, positions."""
    if isinstance(a, tuple) and isinstance(b, (Pose, tuple)):
        a = place(a)
    if isinstance(a, Pose) and sign in ("+", "-") and isinstance(b, (Pose, tuple, Vector)):
        offset = place(b)
        return _shift([a, offset if sign == "+" else offset.inverse()])
    if isinstance(a, Pose) and isinstance(b, Pose) and sign == "*":
        return a @ b
    if isinstance(a, (Vector, Joints)) and isinstance(b, (float, bool)) and sign in ("*", "/"):
        return _make_like(a, [_arithmetic(sign, item, float(b)) for item in a.values])
    if isinstance(b, Vector) and isinstance(a, (float, bool)) and sign == "*":
        return vector([_arithmetic(sign, item, float(a)) for item in b.values])
    if isinstance(a, Joints) and isinstance(b, tuple):
        b = joints(numbers(list(b)))
    if isinstance(a, Vector) and isinstance(b, tuple):
        b = vector(numbers(list(b)))
    if (
        type(a) is type(b)
        and isinstance(a, (Vector, Joints))
        and isinstance(b, (Vector, Joints))
        and sign in ("+", "-")
    ):
        return _make_like(a, list(map(_ARITHMETIC[sign], a.values, b.values)))
    raise Unreadable(f"{describe_value(a)} {sign} {describe_value(b)} is not evaluated")


def _make_like(old: Joints | Vector, values: list[float]) -> Value:
    if isinstance(old, Joints):
        return Joints(tuple(values))
    return vector(values)


def turned(pose: Pose, at: int, degrees: float) -> Pose:
    """Return a pose whose rx, ry or rz (`at` is 0, 1 or 2) is set to `degrees`."""
    values = components(pose)
    values[3 + at] = degrees
    rotation = rotation_from_fixed_xyz(*map(math.radians, values[3:]))
    return with_figure(Pose(rotation, pose.origin), figure_of(pose))
