"""RAPID statements of a post: signals, waits, supervision, the force sensor, and motions."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import cast

import numpy as np

from camgen.lang.rapid.machine import RobotPosition
from camgen.lang.rapid.motions import find_direction
from camgen.lang.rapid.places import pose_of
from camgen.lang.rapid.tree import Calling, Expr, Inline, Ref, name_reference
from camgen.lang.rapid.types import Value
from camgen.lang.rapid.ways import (
    find_arc_faults,
    find_joints_fault,
    find_joints_remark,
    find_posture_fault,
    find_posture_remark,
    is_half_turn,
)
from camgen.model.pose import Pose, Vec3
from camgen.model.program import (
    Force,
    Joints,
    Motion,
    MoveC,
    MoveJ,
    MoveL,
    Output,
    Posture,
    Stop,
    Wait,
)
from camgen.model.text import counted

from .expected import (
    check_calibration,
    check_external_speed,
    check_name,
    check_pressing,
    is_same,
)
from .state import Bound, State, numbers
from .syntax import DEACT_WHERE_ON

_SUPERVISION = {"confj": "ConfJ", "confl": "ConfL"}
#: The signal of an analog output. All others are digital (docs/posts/rapid.md, options).
_ANALOG = "spindle"
#: Speed of reorientation of all predefined speeds, rad/s, and the difference of two equal ones.
_USUAL_TURN, _SAME_TURN = math.radians(500.0), 1e-9
#: Length above which a motion travels, mm: more than its printed digits lose.
_TRAVELS = 0.01
#: Distance from the surface above which the tool is in the air, mm: 1 mm (docs/posts/rapid.md) and
#: its printed digits.
_AIR = 1.01


def _signal(state: State, call: Calling) -> str:
    if call.options:
        raise state.wrong(f"\\{call.options[0][0][:40]} of {call.name} is not read")
    if not call.args or not isinstance(call.args[0], Ref):
        raise state.wrong(f"{call.name} needs the name of a signal")
    name = call.args[0].name
    if len(name) > state.settings.longest_name:
        raise state.wrong(f"{name[:40]} is longer than {state.settings.longest_name} characters")
    return state.settings.signals.get(name.lower(), name)


def switch(state: State, call: Calling) -> Output:
    """The output of SetDO or SetAO (a signal and its value), Set or Reset (a signal).

    Raises Wrong for arguments that do not fit the signal.
    """
    signal = _signal(state, call)
    analog = signal == _ANALOG
    if analog != (call.name == "setao") and (analog or signal in state.settings.signals.values()):
        raise state.wrong(
            f"{call.name} of {signal}, which is {'an analog' if analog else 'a digital'} output"
        )
    count = 2 if call.name in ("setdo", "setao") else 1
    if len(call.args) != count:
        raise state.wrong(f"{call.name} has {counted(count, 'argument')}, not {len(call.args)}")
    if count == 1:
        return Output(signal, float(call.name == "set"))
    value = cast(float, state.typed(call.args[1], "num"))
    if call.name == "setdo" and value not in (0, 1):
        raise state.wrong("a digital output is 0 or 1")
    return Output(signal, value)


def switch_signal(state: State, call: Calling) -> None:
    """Runs SetDO, SetAO, Set or Reset."""
    item = switch(state, call)
    state.stopped(call.name)
    state.is_settled = False
    state.add(item)


def _wait(state: State, call: Calling) -> None:
    """Runs WaitTime.

    With InPos it waits for standstill first. A wait of 0 s then adds nothing to the stop before it.
    """
    switches = [name for name, _ in call.options]
    if switches not in ([], ["inpos"]) or any(value is not None for _, value in call.options):
        raise state.wrong(f"\\{switches[0][:40]} of waittime is not read")
    if len(call.args) != 1:
        raise state.wrong(f"waittime has 1 argument, not {len(call.args)}")
    seconds = cast(float, state.typed(call.args[0], "num"))
    if seconds < 0:
        raise state.wrong("a wait must not be negative")
    state.stopped(call.name)
    state.is_settled = state.is_settled or bool(switches)
    if seconds > 0 or not switches:
        state.add(Wait(seconds))


def _stop(state: State, call: Calling) -> None:
    if call.args or call.options:
        raise state.wrong("stop is read without arguments")
    state.stopped("stop")
    state.is_settled = False
    state.add(Stop())


def _configuration(state: State, call: Calling) -> None:
    """Runs ConfL or ConfJ. The supervision of the posture is not part of an instruction."""
    if call.args or call.options not in ((("on", None),), (("off", None),)):
        raise state.wrong(f"{call.name} needs \\On or \\Off")
    on = call.options[0][0] == "on"
    if state.moved and state.supervised.get(call.name, (None, 0))[0] != on:
        state.remark(f"{_SUPERVISION[call.name]} changes after the first motion")
    state.supervised[call.name] = on, state.line
    if on and state.settings.conf != "auto":
        conf = state.settings.conf
        state.remark(f"{_SUPERVISION[call.name]} is on, though post.conf is {conf}")


def _singularity(state: State, call: Calling) -> None:
    """Runs SingArea. The behaviour near a singularity is not part of an instruction."""
    if call.args or call.options not in ((("wrist", None),), (("off", None),)):
        raise state.wrong("singarea needs \\Wrist or \\Off")
    state.singularity = call.options[0][0]
    if state.moved:
        state.remark("SingArea after the first motion")


def _acceleration(state: State, call: Calling) -> None:
    """Runs AccSet. Acceleration and ramp, in %, are not part of an instruction."""
    if len(call.args) != 2 or call.options:
        raise state.wrong("accset needs acceleration and ramp")
    values = tuple(cast(float, state.typed(value, "num")) for value in call.args)
    if not all(0 < value <= 100 for value in values):
        raise state.wrong("accset is in %, up to 100")
    state.acceleration = values
    if state.moved:
        state.remark("AccSet after the first motion")


def _calibrate(state: State, call: Calling) -> None:
    """Runs FCCalib, which sets the force sensor to zero with the load of the tool."""
    if len(call.args) != 1 or call.options:
        raise state.wrong("fccalib needs one loaddata")
    argument = call.args[0]
    load: str | Value = name_reference(argument).lower()
    if load != state.settings.calibration.lower() or state.known(argument):
        value = state.typed(argument, "loaddata")
        load = load or value
    if state.pressing is not None:
        raise state.wrong("fccalib while pressing")
    state.remark(check_calibration(state.settings, load))
    if not state.is_settled:
        state.remark("FCCalib without WaitTime\\InPos right before it: the arm may still swing")
    state.calibrated, state.is_settled = True, False
    state.stopped(call.name)


def _deactivate(state: State, call: Calling) -> None:
    check_deactivation(state, call)
    if state.pressing is not None:
        raise state.wrong("fcdeact while pressing, before FCPressEnd")
    state.stopped("fcdeact")
    state.add(Force(0.0))


def check_deactivation(state: State, call: Calling) -> None:
    """Checks FCDeact. It is unusual without a test whether force control is on.

    Raises Wrong if it has arguments.
    """
    if call.args or call.options:
        raise state.wrong("fcdeact has no arguments")
    if call.name != DEACT_WHERE_ON:
        what = "fcdeact without IF FCIsForceMode(): it may be an error where force control is off"
        state.log.find("unusual", what)


SWITCHES = ("setdo", "setao", "set", "reset")
#: The end of force control, always and with a test whether force control is on.
DEACTIVATIONS = ("fcdeact", DEACT_WHERE_ON)


# RAPID motions as instructions (RAPID reference manual: MoveAbsJ, MoveJ, MoveL, MoveC; manual of
# Machining FC: FCPress...).

_MOVE = {"wobj": "wobjdata", "v": "num", "z": "num"}
#: Positional arguments of each motion in order, and types of its optional arguments. A type "" is
#: a switch.
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
    "to": "robtarget", "via": "robtarget", "joints": "jointtarget", "speed": "speeddata",
    "zone": "zonedata", "tool": "tooldata", "force": "num", "threshold": "num",
}  # fmt: skip
_WORLD = Ref("wobj0")
_PRESSING = frozenset(name for name in MOTIONS if name.startswith("fc"))


def motion(state: State, call: Calling) -> None:
    """Runs a motion. Raises Wrong if it cannot be read."""
    bound = _read_bound(state, call)
    values = bound.values
    if call.name == "moveabsj":
        axes = numbers(cast(tuple[Value, ...], values["joints"])[0])
        if what := find_joints_fault(axes):
            raise state.wrong(what)
        state.remark(find_joints_remark(axes))
        _move(state, bound, None, Joints(tuple(math.radians(v) for v in axes)))
    else:
        via = pose_of(state, values["via"]) if "via" in values else None
        _move(state, bound, via, pose_of(state, values["to"]))


def _read_bound(state: State, call: Calling) -> Bound:
    """Reads a motion. Raises Wrong if it cannot be read, or for a configuration that no arm has.

    The controller does not use the configuration of a circle point. Posts write that of the end.
    """
    values = _bind(state, call)
    speeds = numbers(values["speed"])
    state.remark(check_external_speed(speeds))
    posture = None
    configurations = [_confdata(values[name]) for name in ("via", "to") if name in values]
    for configuration in configurations:
        if what := find_posture_fault(configuration):
            raise state.wrong(what)
        state.remark(find_posture_remark(configuration))
        posture = Posture(configuration) if any(configuration) else None
    if configurations and configurations[0] != configurations[-1]:
        state.remark("the circle point of an arc has another configuration than its end")
    speed = cast(float, values.get("v", speeds[0]))
    return Bound(call.name, speed, _blend(values), values, posture, math.radians(speeds[1]))


def find_bound(state: State, move: Inline) -> Bound:
    """Reads a motion without its points, or takes it from the cache.

    Raises Wrong if it cannot be read.
    """
    key = state.scope, move.shape
    bound: Bound | None = state.bound.get(key)
    if bound is None:
        bound = _read_bound(state, move.call())
        if has_all_points(bound, move):
            state.bound[key] = bound
    return bound


def has_all_points(bound: Bound, move: Inline) -> bool:
    """Whether all points of a motion are written out. Else one of an arc has a name."""
    return ("via" in bound.values) == (move.via is not None)


def is_usual(bound: Bound, move: Inline) -> bool:
    """Whether a motion without force has no posture and the usual speed of reorientation.

    All its points are written out.
    """
    is_usual_turn = abs(bound.turn - _USUAL_TURN) <= _SAME_TURN
    return bound.posture is None and is_usual_turn and has_all_points(bound, move)


def _confdata(target: Value) -> tuple[int, int, int, int]:
    cf1, cf4, cf6, cfx = map(int, numbers(cast(tuple[Value, ...], target)[2]))
    return cf1, cf4, cf6, cfx


def inline(state: State, move: Inline) -> None:
    """Runs a motion to points that are written out. The rest of the motion is cached."""
    bound = find_bound(state, move)
    rotation = state.turned(move.turn)
    via_rotation = None if move.via is None else state.turned(move.via_turn)
    is_turned = (via_rotation is None) == (move.via is None)
    if rotation is None or not is_turned or not has_all_points(bound, move):
        motion(state, move.call())
    else:
        via = None if move.via is None or via_rotation is None else Pose(via_rotation, move.via)
        _move(state, bound, via, Pose(rotation, move.to))


def _move(state: State, bound: Bound, via: Pose | None, target: Pose | Joints) -> None:
    """Adds a motion through `via`, if there is one, to `target`."""
    if not state.moved and bound.name != "moveabsj":
        state.log.find("unusual", f"the first motion is {bound.name}, not MoveAbsJ")
    state.moved = True
    if isinstance(target, Pose):
        check_supervision(state, bound)
    if isinstance(target, Pose) and state.position.pose is not None:
        _check_motion(state, bound, state.position.pose, via, target)
    if bound.name in _PRESSING and isinstance(target, Pose):
        _press(state, bound, via, target)
    else:
        if state.pressing is not None:
            state.log.find("refused", f"{bound.name} while pressing, before FCPressEnd")
        state.add(_make_motion(state, bound, via, target))
    state.position = RobotPosition(target if isinstance(target, Pose) else None)
    state.note_target(target)
    state.is_settled = False
    state.blending = state.line if bound.blend > 0 else 0


def _make_motion(
    state: State,
    bound: Bound,
    via: Pose | None,
    target: Pose | Joints,
    contact: tuple[float, Vec3] = (0.0, (0.0, 0.0, 0.0)),
) -> Motion:
    """A motion.

    A joint motion has the speed of reorientation if it is not the usual one. A linear motion to the
    position of the TCP is a reorientation, even if the printed digits show no rotation.

    contact: force, N, and the direction in which it presses.
    """
    speed, blend, posture, turn = bound.speed, bound.blend, bound.posture, bound.turn
    if via is not None and isinstance(target, Pose):
        return MoveC(via, target, speed, blend, *contact, posture=posture)
    if isinstance(target, Joints) or bound.name == "movej":
        if abs(turn - _USUAL_TURN) <= _SAME_TURN:
            turn = 0.0
        return MoveJ(target, speed, blend, posture=posture, turn=turn)
    start = state.position.pose
    if start is None or start.origin != target.origin:
        turn = 0.0
    return MoveL(target, speed, blend, *contact, posture=posture, turn=turn)


def _bind(state: State, call: Calling) -> dict[str, Value]:
    """The values of the arguments of a motion by name. Sets the tool and the work object.

    Raises Wrong for an argument that is missing, unknown or of another type.
    """
    positional, optional = MOTIONS[call.name]
    if len(call.args) != len(positional):
        raise state.wrong(f"{call.name} has {len(positional)} arguments, not {len(call.args)}")
    values: dict[str, Value] = {}
    for name, expr in zip(positional, call.args, strict=True):
        if name == "tool":
            _frame_argument(state, "tool", "tooldata", expr)
        else:
            values[name] = state.typed(expr, _TYPES[name])
    work: Expr | None = _WORLD
    for name, option in call.options:
        if name not in optional:
            raise state.wrong(f"\\{name[:40]} of {call.name} is not read")
        if name == "wobj":
            work = option
        elif name in values or (option is None) != (optional[name] == ""):
            raise state.wrong(f"\\{name} of {call.name} is given twice or has no value")
        else:
            values[name] = True if option is None else state.typed(option, optional[name])
    if call.name != "moveabsj":
        _frame_argument(state, "work", "wobjdata", work)
    if cast(float, values.get("v", 1.0)) <= 0 or cast(float, values.get("z", 1.0)) <= 0:
        raise state.wrong("a speed or a zone that is not positive")
    return values


def _frame_argument(state: State, kind: str, data_type: str, expr: Expr | None) -> None:
    """Sets the tool or the work object of a motion.

    Raises Wrong unless it is a whole persistent (manual, tooldata).
    """
    if not isinstance(expr, Ref):
        raise state.wrong(f"{data_type} must be the name of a persistent")
    variable = state.variable(expr.name)
    data = None if variable is None else variable.declaration
    if data is not None and data.storage != "pers":
        raise state.wrong(f"{expr.name} must be PERS, not {data.storage.upper()}")
    if data is not None and not data.local and data.task != state.settings.task:
        what = "is TASK PERS, which S4 has not"
        if not data.task:
            what = "is PERS, one for all tasks, not TASK PERS"
        state.remark(f"{data.name} {what}", line=data.line)
    unknown = state.settings.external and not state.known(expr)
    value = None if unknown else state.typed(expr, data_type)
    state.remark(check_name(state.settings, kind, expr.name, unknown))
    state.set_frame(kind, expr, value)


def check_supervision(state: State, bound: Bound) -> None:
    """Adds a finding for a configuration that does not fit the supervision, once per kind.

    Supervision is on by default (manual, ConfL) and may stop the arm at a configuration of zeros.
    """
    word, stated = "confj" if bound.name == "movej" else "confl", bound.posture is not None
    if (word, stated) in state.postures:
        return
    state.postures.add((word, stated))
    if not stated and word not in state.supervised:
        state.remark(f"a configuration of zeros, and {_SUPERVISION[word]} is not off")
    if stated and state.settings.conf == "off":
        state.remark("a configuration, though post.conf is off")


def check_settings(state: State) -> None:
    """Adds findings, at the end of the program, for settings that are not those of the options."""
    settings = state.settings
    for word, (is_on, line) in state.supervised.items():
        all_stated = (word, True) in state.postures and (word, False) not in state.postures
        if not is_on and settings.conf == "auto" and all_stated:
            what = "is off, though each of its motions states a configuration"
            state.remark(f"{_SUPERVISION[word]} {what}", line=line)
    if state.singularity != settings.singularity:
        wanted = settings.singularity or "none"
        state.remark(f"SingArea is not what post.sing_area asks for, {wanted}")
    if not is_same(state.acceleration, settings.acceleration):
        wanted = ", ".join(f"{value:g}" for value in settings.acceleration) or "none"
        state.remark(f"AccSet is not what post.acc_set asks for, {wanted}")


def _check_motion(state: State, bound: Bound, start: Pose, via: Pose | None, target: Pose) -> None:
    """Adds findings for the path of a linear or circular motion that is not valid or ambiguous."""
    if bound.name == "movej":
        return
    if via is None:
        if is_half_turn(start, target):
            state.remark("the tool turns by 180 deg in one straight motion; its sense is open")
    else:
        fault, remark = find_arc_faults(start.origin, via.origin, target.origin)
        if fault:
            state.log.find("refused", fault)
        state.remark(remark)
    travels = math.dist(start.origin, target.origin) > _TRAVELS
    if travels and abs(bound.turn - _USUAL_TURN) > _SAME_TURN:
        speed = f"{math.degrees(bound.turn):g} deg/s"
        state.remark(f"a speed of {speed} limits a motion that travels")


def _blend(values: Mapping[str, Value]) -> float:
    if "zone" not in values:  # FCPressEnd, which ends the contact
        return 0.0
    zone = cast(tuple[float, ...], values["zone"])
    if zone[0]:
        return 0.0
    return cast(float, values.get("z", zone[1]))


def _press(state: State, bound: Bound, via: Pose | None, target: Pose) -> None:
    """Adds a motion that starts, keeps or ends the contact. Raises Wrong if it cannot be run."""
    name = bound.name
    if name == "fcpress1lstart":
        force = _begin_pressing(state, bound.values)
    elif state.pressing is None:
        raise state.wrong(f"{name} without FCPress1LStart")
    elif name == "fcpressend":
        state.stopped(name)
        state.pressing, state.calibrated = None, False
        state.free_targets.clear()
        state.add(Force(0.0))
        state.add(_make_motion(state, bound, via, target))
        return
    else:
        force = cast(float, bound.values["force"]) * state.settings.sign * state.pressing[1]
        if force <= 0:
            raise state.wrong(f"{name} does not press in the direction of FCPress1LStart")
    assert state.pressing is not None
    contact = force, find_direction(target, state.pressing)
    state.add(_make_motion(state, bound, via, target, contact))


def _begin_pressing(state: State, values: Mapping[str, Value]) -> float:
    """Adds the force of FCPress1LStart along a tool axis at its start. Returns it, N.

    Raises Wrong if its arguments are not valid.
    """
    names = [name for name in ("fx", "fy", "fz") if name in values]
    force = cast(float, values[names[0]]) if len(names) == 1 else 0.0
    if force == 0:
        raise state.wrong("FCPress1LStart needs a force along one axis of the tool")
    if state.pressing is not None or state.position.pose is None:
        raise state.wrong(f"FCPress1LStart {'twice' if state.pressing else 'from an unknown pose'}")
    if not 0 <= cast(float, values["threshold"]) <= 100:
        raise state.wrong("the threshold of FCPress1LStart is 0 to 100 %")
    for what in check_pressing(state.settings, values):
        state.remark(what)
    axis = ("fx", "fy", "fz").index(names[0])
    state.stopped("fcpress1lstart")
    state.pressing = (axis, state.settings.sign if force > 0 else -state.settings.sign)
    needs_calibration = state.settings.calibration and not state.calibrated
    if needs_calibration and _was_in_the_air(state, state.position.pose, state.pressing):
        state.remark("no FCCalib before pressing, though post.force_load asks for it")
    state.pressed = True
    state.add(Force(abs(force), find_direction(state.position.pose, state.pressing)))
    return abs(force)


def _was_in_the_air(state: State, start: Pose, pressing: tuple[int, int]) -> bool:
    """Whether the sensor could be calibrated since the last section with force.

    The tool was above the start of the next section, or at joint values. Between sections on one
    surface it stays down.
    start: start of the next section.
    pressing: tool axis and direction of its force.
    """
    if not state.pressed:
        return True
    towards_part = np.stack([start.rotation[:, 2], find_direction(start, pressing)])
    poses = [target for target in state.free_targets if not isinstance(target, Joints)]
    if len(poses) < len(state.free_targets):
        return True
    if not poses:
        return False
    positions = [pose.origin if isinstance(pose, Pose) else pose for pose in poses]
    heights = np.subtract(start.origin, np.vstack(positions)) @ towards_part.T
    return float(heights.max()) > _AIR


#: The function of each statement that is read.
STATEMENTS: dict[str, Callable[[State, Calling], None]] = {
    **dict.fromkeys(MOTIONS, motion),
    **dict.fromkeys(SWITCHES, switch_signal),
    "waittime": _wait,
    "stop": _stop,
    "confl": _configuration,
    "confj": _configuration,
    "fccalib": _calibrate,
    **dict.fromkeys(DEACTIVATIONS, _deactivate),
    "singarea": _singularity,
    "accset": _acceleration,
}
