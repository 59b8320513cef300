"""Values of names and aggregates in RAPID programs of a post.

The types are those of the RAPID system data types manual, the predefined data those of its chapters
speeddata and zonedata. Units: mm, deg, mm/s, kg.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import cast

from camgen.lang.rapid.types import LITERAL, PREDEFINED, TYPES, UNUSED, Value
from camgen.model.pose import (
    IDENTITY,
    Pose,
    Vec3,
    frozen,
    quaternion,
    rotation_about,
    rotation_from_quaternion,
)
from camgen.model.text import counted

from .syntax import Calling, Data, Expr, Point, Ref, Wrong

#: Data of the system whose values depend on the robot. They are not read.
_OF_THE_ROBOT = {"vmax": "speeddata", "load0": "loaddata"}
#: Longest chain of constants that are defined by each other.
_CHAIN = 50


@dataclass(eq=False)
class Scope:
    """The data that a routine sees.

    levels: data of the routine, of its module, and global data, by name in lower case.
    values: values of declarations. All scopes share them.
    errors: errors of declarations without a value. All scopes share them.
    pending: declarations that are being evaluated.
    named_values: values of names that were used, by name and type.
    """

    levels: tuple[Mapping[str, Data], ...]
    values: dict[Data, Value]
    errors: dict[Data, Wrong]
    pending: list[Data] = field(default_factory=list)
    named_values: dict[tuple[str, str], Value] = field(default_factory=dict)

    def find(self, name: str) -> Data | None:
        """The declaration of a name, None without one."""
        key = name.lower()
        return next((level[key] for level in self.levels if key in level), None)

    def known(self, expr: Expr | None) -> bool:
        """Whether an expression is a name that is declared or predefined."""
        if not isinstance(expr, Ref):
            return False
        return self.find(expr.name) is not None or expr.name.lower() in PREDEFINED

    def value(self, expr: Expr | None, want: str, line: int) -> Value:
        """The value of an expression of the type `want`. Raises Wrong if it is of another type."""
        if isinstance(expr, Ref):
            key = expr.name, want
            if key not in self.named_values:
                self.named_values[key] = self._named(expr.name, want, line)
            return self.named_values[key]
        if isinstance(expr, Calling):
            return self._function(expr, want)
        if isinstance(expr, Point):
            if want != "robtarget":
                raise Wrong(line, f"a robtarget stands where {want} is needed")
            what = orient_fault(expr.value[1]) or _posture_fault(expr.value[2:])
            if what:
                raise Wrong(line, what)
            return expr.value
        if want in TYPES:
            return self._record(expr, want, line)
        if isinstance(expr, (float, bool, str)) and type(expr) is LITERAL.get(want):
            return expr
        raise Wrong(line, f"a value of type {want} is needed")

    def _record(self, expr: Expr | None, want: str, line: int) -> Value:
        components = TYPES[want]
        if not isinstance(expr, tuple):
            raise Wrong(line, f"a value of type {want} is needed")
        if len(expr) != len(components):
            raise Wrong(
                line, f"{want} has {counted(len(components), 'component')}, not {len(expr)}"
            )
        value = tuple(
            self.value(item, part, line) for item, (_, part) in zip(expr, components, strict=True)
        )
        _check_record(want, value, line)
        return value

    def _named(self, name: str, want: str, line: int) -> Value:
        data = self.find(name)
        if data is not None:
            if data.type != want:
                raise Wrong(line, f"{name} is {data.type}, not {want}")
            return self.value_of(data)
        if name.lower() in _OF_THE_ROBOT:
            raise Wrong(line, f"{name} depends on the robot and is not read")
        data_type, value = PREDEFINED.get(name.lower(), ("", 0.0))
        if not data_type:
            raise Wrong(line, f"{name[:40]} is not declared")
        if data_type != want:
            raise Wrong(line, f"{name} is {data_type}, not {want}")
        return value

    def value_of(self, data: Data) -> Value:
        """The initial value of a declaration. Raises Wrong if it has none."""
        if data in self.errors:
            raise self.errors[data]
        if data not in self.values:
            try:
                self.values[data] = self._initial(data)
            except Wrong as wrong:
                self.errors[data] = wrong
                raise
        return self.values[data]

    def _initial(self, data: Data) -> Value:
        if data.type not in TYPES and data.type not in LITERAL:
            raise Wrong(data.line, f"the data type {data.type[:40]} is not read")
        if data.value is None:
            raise Wrong(data.line, f"{data.name} has no value")
        if data in self.pending or len(self.pending) > _CHAIN:
            raise Wrong(data.line, f"{data.name} is defined by itself or through too many others")
        self.pending.append(data)
        try:
            return self.value(data.value, data.type, data.line)
        finally:
            self.pending.pop()

    def _function(self, call: Calling, want: str) -> Value:
        if call.name not in ("offs", "reltool") or want != "robtarget":
            raise Wrong(call.line, f"the function {call.name[:40]} is not read here")
        if len(call.args) != 4:
            raise Wrong(call.line, f"{call.name} has 4 arguments, not {len(call.args)}")
        point = cast(tuple[Value, ...], self.value(call.args[0], "robtarget", call.line))
        x, y, z = (cast(float, self.value(arg, "num", call.line)) for arg in call.args[1:])
        turns = {name: cast(float, self.value(arg, "num", call.line)) for name, arg in call.options}
        return (_offs if call.name == "offs" else _reltool)(call.line, point, (x, y, z), turns)


def numbers(value: Value) -> tuple[float, ...]:
    """A value whose type was checked to be numbers only."""
    return cast(tuple[float, ...], value)


def pose(value: Value) -> Pose:
    """A pose record as a frame."""
    trans, rot = cast(tuple[Value, Value], value)
    x, y, z = numbers(trans)
    return Pose(rotation_from_quaternion(numbers(rot)), (x, y, z))


def _offs(line: int, point: tuple[Value, ...], shift: Vec3, turns: Mapping[str, float]) -> Value:
    """The point moved along the axes of the work object."""
    if turns:
        raise Wrong(line, "Offs has no optional argument")
    moved = tuple(a + b for a, b in zip(numbers(point[0]), shift, strict=True))
    return (moved, *point[1:])


def _reltool(line: int, point: tuple[Value, ...], shift: Vec3, turns: Mapping[str, float]) -> Value:
    """The point moved along the axes of the tool and turned about one of them."""
    axes = {"rx": 0, "ry": 1, "rz": 2}
    if len(turns) > 1 or any(name not in axes for name in turns):
        raise Wrong(line, "RelTool is read with one of Rx, Ry, Rz only")
    moved = pose(point[:2]) @ Pose(IDENTITY, shift)
    rotation = moved.rotation
    for name, angle in turns.items():
        rotation = frozen(rotation @ rotation_about(axes[name], math.radians(angle)))
    return (moved.origin, quaternion(rotation), *point[2:])


def _check_record(kind: str, value: Value, line: int) -> None:
    """Raises Wrong for a record whose numbers are not valid."""
    check = _CHECKS.get(kind)
    what = check(numbers(value)) if check else ""
    if what:
        raise Wrong(line, what)


@lru_cache(maxsize=1000)
def _posture_fault(parts: tuple[tuple[float, ...], ...]) -> str:
    """The fault of the configuration or the external axes of a robtarget, empty without one."""
    conf, external = parts
    return _quarters(conf) or _external(external)


def orient_fault(q: tuple[float, ...]) -> str:
    """The fault of a quaternion, empty without one."""
    w, x, y, z = q
    deviation = abs(w * w + x * x + y * y + z * z - 1)
    if deviation <= 1e-5:
        return ""
    return f"a quaternion is not normalised (its square differs from 1 by {deviation:.2g})"


def _external(axes: tuple[float, ...]) -> str:
    return "external axes are not read" if any(v != UNUSED for v in axes) else ""


def _quarters(conf: tuple[float, ...]) -> str:
    return "confdata must be whole numbers" if any(v != int(v) for v in conf) else ""


def _speed(speed: tuple[float, ...]) -> str:
    return "a speed that is not positive" if min(speed[:2]) <= 0 or min(speed) < 0 else ""


def _zone(zone: tuple[float, ...]) -> str:
    return "a zone that is no stop point must have a radius" if not zone[0] and zone[1] <= 0 else ""


_CHECKS: dict[str, Callable[[tuple[float, ...]], str]] = {
    "orient": orient_fault,
    "extjoint": _external,
    "confdata": _quarters,
    "speeddata": _speed,
    "zonedata": _zone,
}
