"""RAPID motions as instructions (RAPID reference manual: MoveAbsJ, MoveJ, MoveL, MoveC; Machining FC: FCPress...)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import cast

from camgen.ir import Force, Joints, Motion, MoveC, MoveJ, MoveL
from camgen.pose import Pose, Vec3
from camgen.post import Fault

from .rapid_data import Value, numbers
from .rapid_lexis import Wrong
from .rapid_state import State
from .rapid_tree import Call, Expr, Ref

_MOVE = {"wobj": "wobjdata", "v": "num", "z": "num"}
#: Positional arguments of each motion, in order, and its optional ones. A type "" is a switch.
MOTIONS: dict[str, tuple[tuple[str, ...], dict[str, str]]] = {
    "moveabsj": (("joints", "speed", "zone", "tool"), _MOVE),
    "movej": (("to", "speed", "zone", "tool"), _MOVE),
    "movel": (("to", "speed", "zone", "tool"), _MOVE),
    "movec": (("via", "to", "speed", "zone", "tool"), _MOVE),
    "fcpress1lstart": (
        ("to", "speed", "threshold", "zone", "tool"),
        {"wobj": "wobjdata", "fx": "num", "fy": "num", "fz": "num"}
        | {"forcechange": "num", "possupvdist": "num", "usespdffw": ""},
    ),
    "fcpressl": (("to", "speed", "force", "zone", "tool"), {"wobj": "wobjdata"}),
    "fcpressc": (("via", "to", "speed", "force", "zone", "tool"), {"wobj": "wobjdata"}),
    "fcpressend": (("to", "speed", "tool"), {"wobj": "wobjdata"}),
}
_TYPES = {
    "to": "robtarget", "via": "robtarget", "joints": "jointtarget", "speed": "speeddata", "zone": "zonedata",
    "tool": "tooldata", "force": "num", "threshold": "num",
}  # fmt: skip
_WORLD = Ref("wobj0")


def motion(state: State, call: Call) -> None:
    """One motion statement. Wrong when it cannot be read; the state then stays as it is."""
    values = _bound(state, call)
    speed = cast(float, values["v"] if "v" in values else numbers(values["speed"])[0])
    blend = _blend(values)
    if not state.moved and call.name != "moveabsj":
        state.faults.append(Fault(call.line, f"the first motion is {call.name}, not MoveAbsJ"))
    state.moved = True
    _check_arc(state, call.line, values)
    if call.name.startswith("fc"):
        _press(state, call, values, speed, blend)
    else:
        if state.pressing is not None:
            state.faults.append(Fault(call.line, f"{call.name} while pressing, before FCPressEnd"))
        state.add(_free(state, call.name, values, speed, blend), call.line)
    target = state.body[-1].target  # type: ignore[union-attr]  # what was added last is a motion
    state.here = target if isinstance(target, Pose) else None
    state.blending = call.line if blend > 0 else 0


def _free(state: State, name: str, values: Mapping[str, Value], speed: float, blend: float) -> Motion:
    """A motion without force."""
    if name == "moveabsj":
        axes = numbers(cast(tuple[Value, ...], values["joints"])[0])
        return MoveJ(Joints(tuple(math.radians(v) for v in axes)), speed, blend)
    target = state.pose(values["to"])
    if name == "movec":
        return MoveC(state.pose(values["via"]), target, speed, blend)
    return (MoveJ if name == "movej" else MoveL)(target, speed, blend)


def _bound(state: State, call: Call) -> dict[str, Value]:
    """The arguments of a motion by name, their types checked; notes tool and work object."""
    positional, optional = MOTIONS[call.name]
    if len(call.args) != len(positional):
        raise Wrong(call.line, f"{call.name} has {len(positional)} arguments, not {len(call.args)}")
    line, scope = call.line, state.scope
    values: dict[str, Value] = {}
    for name, expr in zip(positional, call.args, strict=True):
        if name == "tool":
            _frame_argument(state, "tool", "tooldata", expr, line)
        else:
            values[name] = scope.value(expr, _TYPES[name], line)
    work: Expr | None = _WORLD
    for name, option in call.options:
        if name not in optional:
            raise Wrong(line, f"\\{name[:40]} of {call.name} is not read")
        if name == "wobj":
            work = option
        elif name in values or (option is None) != (optional[name] == ""):
            raise Wrong(line, f"\\{name} of {call.name} is given twice or has no value")
        else:
            values[name] = True if option is None else scope.value(option, optional[name], line)
    if call.name != "moveabsj":
        _frame_argument(state, "work", "wobjdata", work, line)
    if cast(float, values.get("v", 1.0)) <= 0 or cast(float, values.get("z", 1.0)) <= 0:
        raise Wrong(line, "a speed or a zone that is not positive")
    return values


def _frame_argument(state: State, kind: str, data_type: str, expr: Expr | None, line: int) -> None:
    """Checks the tool or the work object of a motion, which must be a whole persistent (manual, tooldata)."""
    if isinstance(expr, Ref) and state.frame_of.get(kind) == (expr.name, state.scope):
        return
    if not isinstance(expr, Ref):
        raise Wrong(line, f"{data_type} must be the name of a persistent")
    data = state.scope.find(expr.name)
    if data is not None and data.storage != "pers":
        raise Wrong(line, f"{expr.name} must be PERS, not {data.storage.upper()}")
    unknown = state.known.external and not state.scope.known(expr)
    state.frame(kind, expr, None if unknown else state.scope.value(expr, data_type, line), line)
    state.frame_of[kind] = (expr.name, state.scope)


def _check_arc(state: State, line: int, values: Mapping[str, Value]) -> None:
    """Notes an arc whose three points are on one line."""
    if "via" not in values or state.here is None:
        return
    a, b, c = state.here.origin, state.pose(values["via"]).origin, state.pose(values["to"]).origin
    u, w = [q - p for p, q in zip(a, b, strict=True)], [q - p for p, q in zip(a, c, strict=True)]
    cross = (u[1] * w[2] - u[2] * w[1], u[2] * w[0] - u[0] * w[2], u[0] * w[1] - u[1] * w[0])
    if sum(v * v for v in cross) <= 1e-18 * sum(v * v for v in u) * sum(v * v for v in w):
        state.faults.append(Fault(line, "the points of an arc are on one line"))


def _blend(values: Mapping[str, Value]) -> float:
    if "zone" not in values:  # FCPressEnd has none: it ends the contact
        return 0.0
    zone = cast(tuple[float, ...], values["zone"])
    if zone[0]:
        return 0.0
    return cast(float, values.get("z", zone[1]))


def _press(state: State, call: Call, values: Mapping[str, Value], speed: float, blend: float) -> None:
    target = state.pose(values["to"])
    if call.name == "fcpress1lstart":
        force = _begin_pressing(state, call, values)
    elif state.pressing is None:
        raise Wrong(call.line, f"{call.name} without FCPress1LStart")
    elif call.name == "fcpressend":
        state.stopped(call.name)
        state.pressing = None
        state.add(Force(0.0), call.line)
        state.add(MoveL(target, speed, blend), call.line)
        return
    else:
        force = cast(float, values["force"]) * state.known.sign * state.pressing[1]
        if force <= 0:
            raise Wrong(call.line, f"{call.name} does not press in the direction of FCPress1LStart")
    assert state.pressing is not None
    press = _direction(target, state.pressing)
    if call.name == "fcpressc":
        state.add(MoveC(state.pose(values["via"]), target, speed, blend, force, press), call.line)
    else:
        state.add(MoveL(target, speed, blend, force, press), call.line)


def _begin_pressing(state: State, call: Call, values: Mapping[str, Value]) -> float:
    """Adds the Force that FCPress1LStart implies: along a tool axis at the point where it starts."""
    given = [(axis, cast(float, values[name])) for axis, name in enumerate(("fx", "fy", "fz")) if name in values]
    if len(given) != 1 or given[0][1] == 0:
        raise Wrong(call.line, "FCPress1LStart needs a force along one axis of the tool")
    if state.pressing is not None or state.here is None:
        raise Wrong(call.line, "FCPress1LStart " + ("twice" if state.pressing else "from an unknown pose"))
    if not 0 <= cast(float, values["threshold"]) <= 100:
        raise Wrong(call.line, "the threshold of FCPress1LStart is 0 to 100 %")
    axis, force = given[0]
    state.stopped(call.name)
    state.pressing = (axis, state.known.sign if force > 0 else -state.known.sign)
    state.add(Force(abs(force), _direction(state.here, state.pressing)), call.line)
    return abs(force)


def _direction(at: Pose, pressing: tuple[int, int]) -> Vec3:
    """The signed tool axis in the work frame."""
    axis, sign = pressing
    x, y, z = (at.rotation[:, axis] * sign).tolist()
    return (x, y, z)
