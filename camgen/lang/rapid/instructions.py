"""RAPID's instructions other than motions: signals, waits, displacements, speeds, questions.

Source: technical reference manual. An instruction without an effect on the motions is skipped. An
instruction that reads from the controller or its surroundings makes its data unknown.
"""

from __future__ import annotations

from collections.abc import Callable

from msgspec.structs import replace

from camgen.lang.run import Ended
from camgen.lang.values import Unknown
from camgen.model.instructions import Force, MoveC, MoveJ, MoveL, Output, Stop, Wait
from camgen.model.pose import IDENTITY, Pose
from camgen.model.text import counted

from .effects import ALONE, GIVES, LOST, OMITTED, SILENT, UNSEEN
from .functions import name_of
from .machine import Machine, RobotPosition
from .motions import Trigger
from .places import pose_of, see_here
from .tree import Calling, Component, Element, Expr, Ref, find_root, name_reference
from .values import find_unknown

#: s: length of the pulse of PulseDO without PLength.
_PULSE = 0.2


class CycleEnded(Ended):
    """The program starts its next cycle and keeps its data."""


# Outputs -----------------------------------------------------------------------------------------


def _set_to(machine: Machine, name: str, value: float, group: bool = False) -> None:
    """Set an output. A change while the arm is in a corner is dangerous, for a group unusual."""
    if machine.blending and machine.outputs.get(name.lower()) != value:
        corner = f"in a corner: the motion in line {machine.blending} blends"
        what = f"{name} is switched while the robot is still {corner}"
        machine.log.find("unusual" if group else "dangerous", what)
        machine.blending = 0
    machine.add(Output(name, value))
    machine.outputs[name.lower()] = value


def _signal_of(machine: Machine, call: Calling, count: int) -> str:
    if len(call.args) != count:
        raise machine.wrong(f"{call.name} has {counted(count, 'argument')}, not {len(call.args)}")
    return name_of(machine, call.args[0])


def _set_output(machine: Machine, call: Calling) -> None:
    options = dict(call.options)
    dvalue = options.get("dvalue")
    if "sdelay" in options:
        machine.log.fact("delays", "SetDO with SDelay is shown without it")
    name = _signal_of(machine, call, 2 if dvalue is None else 1)
    value = machine.number(call.argument(1, dvalue))
    if isinstance(value, Unknown):
        machine.log.assume(f"what {name} is set to is not known: 1 is taken", name.lower(), 1.0)
        value = machine.given(name) or 1.0
    if call.name == "setdo" and value not in (0, 1, 2):
        raise machine.wrong(f"{name} is set to {value:g}; a digital output is 0 or 1")
    if call.name == "setdo":
        value = float(value == 1)
    _set_to(machine, name, value, call.name == "setgo")


def _set_or_reset(machine: Machine, call: Calling) -> None:
    _set_to(machine, _signal_of(machine, call, 1), float(call.name == "set"))


def _invert(machine: Machine, call: Calling) -> None:
    name = _signal_of(machine, call, 1)
    value = machine.outputs.get(name.lower())
    if value is None:
        machine.log.assume(f"{name} is inverted: it is assumed to be off before", name.lower(), 0.0)
        value = machine.given(name) or 0.0
    _set_to(machine, name, float(value == 0))


def _pulse(machine: Machine, call: Calling) -> None:
    """Set a signal and reset it at once.

    Its value after the pulse is assumed with High, and if it was on before.
    """
    name = _signal_of(machine, call, 1)
    options = dict(call.options)
    length = machine.number(options["plength"]) if options.get("plength") is not None else _PULSE
    after, was_on = float("high" in options), machine.outputs.get(name.lower(), 0.0) != 0
    if after or was_on:
        state = "on" if after else "off"
        machine.log.assume(f"{name} is assumed to be {state} after PulseDO", name.lower(), after)
        given = machine.given(name)
        after = after if given is None else given
    _set_to(machine, name, 1.0)
    if not after:
        machine.add(Output(name, 0.0))
        machine.outputs[name.lower()] = 0.0
    machine.log.fact("pulses", f"{name}, {length:g} s" if type(length) is float else name)


# Waits -------------------------------------------------------------------------------------------


def _wait(machine: Machine, call: Calling) -> None:
    """Wait for a time. 0 s with InPos is a wait for standstill, without an instruction."""
    if not call.args:
        raise machine.wrong("WaitTime has a time")
    seconds = machine.number(call.args[-1])
    if isinstance(seconds, Unknown):
        machine.log.assume(f"a wait is not known ({seconds.what}): 0 s are taken", seconds.key)
        seconds = 0.0
    if seconds < 0:
        raise machine.wrong("a wait must not be negative")
    if seconds > 0 or not call.options:
        machine.add(Wait(seconds))
    machine.blending = 0  # the arm reaches its point during the wait


def _wait_signal(machine: Machine, call: Calling) -> None:
    name = name_of(machine, call.argument(0))
    value = machine.number(call.argument(1, 1.0))
    wanted = f"{value:g}" if type(value) is float else "a value"
    machine.log.assume(f"{name}: the wait for {wanted} is over at once")
    _no_timeout(machine, call)


def _wait_until(machine: Machine, call: Calling) -> None:
    if call.args and not isinstance(call.args[-1], bool):
        condition = machine.value(call.args[-1])
        if condition is not True:
            what = condition.what if isinstance(condition, Unknown) else ""
            machine.log.assume(f"{what[:60] or 'a condition'}: the wait for it is over at once")
    _no_timeout(machine, call)


def _wait_for_rest(machine: Machine, _call: Calling) -> None:
    """Wait until the arm has reached its point: the last motion stops without a blend."""
    for index in reversed(range(len(machine.body))):
        motion = machine.body[index]
        if isinstance(motion, (MoveJ, MoveL, MoveC)):
            machine.body[index] = replace(motion, blend=0.0)
            break
    machine.blending = 0


def _no_timeout(machine: Machine, call: Calling) -> None:
    machine.blending = 0
    for name, target in call.options:
        if name == "timeflag" and target is not None:
            machine.assign(target, False)


# Displacements and speeds ------------------------------------------------------------------------


def _displace_off(machine: Machine, _call: Calling) -> None:
    machine.displaced = None
    machine.version += 1


def _displace_set(machine: Machine, call: Calling) -> None:
    value = machine.value(call.argument(0))
    machine.fit("pose", value)
    unknown = find_unknown(value)
    if unknown is not None:
        what = f"a displacement is not known ({unknown.what}): none is taken"
        machine.log.assume(what, unknown.key)
        value = None
    machine.displaced = pose_of(machine, value) if isinstance(value, tuple) else None
    machine.log.fact("displacement", "of the program, PDispSet")


def _displace_on(machine: Machine, call: Calling) -> None:
    """Displace the program by the difference from a point to the arm, or to ExeP."""
    options = dict(call.options)
    if len(call.args) < 2:
        raise machine.wrong("PDispOn has a point and a tool")
    machine.displaced = None
    point = machine.value(call.args[0])
    if options.get("exep") is None:
        arm = see_here(machine, Calling(machine.line, "crobt"))
    else:
        arm = machine.value(options["exep"])
    machine.fit("robtarget", point)
    machine.fit("robtarget", arm)
    if find_unknown(point) is not None or find_unknown(arm) is not None:
        machine.log.assume("a displacement is not known (PDispOn where the arm is): none is taken")
        return
    planned, real = pose_of(machine, point), pose_of(machine, arm)
    if "rot" in options:
        machine.displaced = real @ planned.inverse()
    else:
        x, y, z = (a - b for a, b in zip(real.origin, planned.origin, strict=True))
        machine.displaced = Pose(IDENTITY, (x, y, z))
    machine.log.fact("displacement", "of the program, PDispOn")


def _limit_speed(machine: Machine, call: Calling) -> None:
    values = [machine.number(arg) for arg in call.args]
    if len(values) != 2:
        raise machine.wrong("VelSet has a percentage and a speed")
    unknown = find_unknown(values)
    if unknown is not None:
        what = f"a value that is not known ({unknown.what[:60]})"
        machine.log.omit(f"velset: {what}: the speeds stay")
        return
    percent, max_speed = values
    if not (percent > 0 and max_speed > 0):
        raise machine.wrong(f"VelSet {percent:g}, {max_speed:g}: both must be positive")
    machine.speed_override, machine.speed_most = percent / 100, max_speed


def _describe(machine: Machine, call: Calling) -> str:
    """The instruction with its numbers and the names of its options."""
    values = [machine.value(arg) for arg in call.args if isinstance(arg, (float, Ref))]
    text = ", ".join(f"{value:g}" for value in values if type(value) is float)
    text += "".join(f"\\{name}" for name, _ in call.options)
    return f"{call.name} {text}".rstrip()


def _supervise(machine: Machine, call: Calling) -> None:
    if call.args or len(call.options) > 1:
        raise machine.wrong(f"{call.name} has one switch")
    if call.name == "confl":
        machine.has_conf_l = not any(name.lower() == "off" for name, _ in call.options)
    _omit(machine, call)


#: Modes of CirPathMode that are read, and whether the orientation of the circle point counts.
_CIRCLE_MODES = {"pathframe": "", "objectframe": "", "cirpointori": "circle point"}


def _set_circle_mode(machine: Machine, call: Calling) -> None:
    """Set how the tool turns along an arc, PathFrame without a switch. Wrist modes are lost."""
    mode, _ = next(iter(call.options), ("pathframe", None))
    if mode not in _CIRCLE_MODES:
        what = "the tool turns as the wrist does; split the arc at taught points"
        machine.log.leave_out(f"{call.name} \\{mode}: {what}")
    else:
        machine.passes_circle_point = _CIRCLE_MODES[mode] == "circle point"
        machine.log.fact("settings", f"{call.name} \\{mode}")


# Triggers ----------------------------------------------------------------------------------------


def _define_trigger(machine: Machine, call: Calling) -> None:
    options = dict(call.options)
    signal = next((options[k] for k in ("dop", "gop", "aop") if options.get(k) is not None), None)
    name = name_of(machine, signal)
    values = [machine.number(arg) for arg in call.args[1:]]
    numbers = [v for v in values if type(v) is float]
    value = values[-1] if len(values) > 1 else None
    if "setvalue" in options or "setdvalue" in options:
        value = machine.number(options.get("setvalue") or options.get("setdvalue"))
    distance = numbers[0] if numbers and "time" not in options else 0.0
    outputs = ((name, value),) if name and type(value) is float else ()
    if not outputs:
        machine.log.leave_out(f"{call.name}: its signal or its value is not known")
    if "time" in options:
        machine.log.omit(f"{call.name} \\time: the time before the end; here it acts at the end")
    if call.name == "triggequip" and len(numbers) > 1 and numbers[1]:
        machine.log.omit(f"triggequip: the lag of its equipment, {numbers[1]:g} s")
    if call.args:
        machine.assign(call.args[0], Trigger(distance, "start" in options, outputs))


# Stops, the operator, and data from outside ------------------------------------------------------


def _stop(machine: Machine, _call: Calling) -> None:
    machine.add(Stop())
    machine.blending = 0


def _end(_machine: Machine, _call: Calling) -> None:
    raise Ended


def _end_cycle(_machine: Machine, _call: Calling) -> None:
    raise CycleEnded


def _ask_operator(machine: Machine, call: Calling) -> None:
    """Ask the operator. The answer is unknown, unless the user gives it."""
    _receive(machine, call)
    if call.name == "uimsgbox":
        machine.log.assume("uimsgbox: the operator answers at once")
    elif call.args and isinstance(call.args[0], (Ref, Component, Element)):
        name = _key_of(call.args[0])
        if machine.given(name) is None:
            machine.log.assume(f"{name}: the operator's answer is not known", name)


def _receive(machine: Machine, call: Calling) -> None:
    """Give the data that an instruction sets from outside the value that the user gives."""
    targets = [call.args[k] for k in _RECEIVES.get(call.name, ()) if k < len(call.args)]
    targets += [value for name, value in call.options if name in _RECEIVED_BY and value is not None]
    for target in targets:
        if isinstance(target, (Ref, Component, Element)):
            _receive_into(machine, call, target)


def _receive_into(machine: Machine, call: Calling, target: Expr) -> None:
    key = _key_of(target)
    machine.assign(target, machine.ask_for(f"{key}, from {call.name}", key))


def _key_of(target: Expr) -> str:
    return name_reference(find_root(target)).lower()


#: Indices of the arguments of each instruction that get a value from outside.
_RECEIVES: dict[str, tuple[int, ...]] = {
    "tpreadfk": (0,), "tpreadnum": (0,), "tpreaddnum": (0,), "uimsgbox": (), "socketreceive": (),
    "readanybin": (1,), "readrawbytes": (1,), "unpackrawbytes": (2,), "getdataval": (1,),
    "readcfgdata": (2,), "getsysdata": (0,), "readblock": (1,), "rmqgetmsgdata": (1,),
    "rmqreadwait": (0,), "rmqgetmessage": (0,), "rmqgetmsgheader": (0,), "gettrapdata": (0,),
    "camgetresult": (1,), "search_1d": (0,), "search_groove": (0,), "search_part": (0,),
    "getnextsym": (0,), "mtooltcpcalib": (4, 5, 6), "mtoolrotcalib": (1,),
    "stooltcpcalib": (4, 5, 6), "stoolrotcalib": (4,), "getjointdata": (), "socketreceivefrom": (),
}  # fmt: skip
#: Optional arguments that get a value from outside.
_RECEIVED_BY = frozenset(
    """position speed torque exttorque result str rawdata data message buttons timeflag
    readnoofbytes""".split()  # noqa: SIM905 (a table)
)


def _increase(machine: Machine, call: Calling) -> None:
    if not call.args or not isinstance(call.args[0], (Ref, Component, Element)):
        raise machine.wrong(f"{call.name} needs data")
    value = machine.number(call.args[0])
    step = machine.number(call.args[1]) if call.name == "add" and len(call.args) > 1 else 1.0
    if call.name == "clear":
        machine.assign(call.args[0], 0.0)
    elif type(value) is not float or type(step) is not float:
        machine.assign(call.args[0], value if isinstance(value, Unknown) else step)
    else:
        machine.assign(call.args[0], value - step if call.name == "decr" else value + step)


def _force_off(machine: Machine, _call: Calling) -> None:
    machine.pressing = None
    machine.add(Force(0.0))


def _book_error(machine: Machine, call: Calling) -> None:
    if call.args:
        machine.assign(call.args[0], float(next(machine.errors)))


def _bit(machine: Machine, call: Calling) -> None:
    if len(call.args) != 2:
        raise machine.wrong(f"{call.name} has data and a place")
    value, place = machine.number(call.args[0]), machine.number(call.args[1])
    if type(value) is float and type(place) is float and 1 <= place <= 52 and 0 <= value < 2**52:
        mask = 1 << (int(place) - 1)
        is_set = call.name.startswith("bitset")
        machine.assign(call.args[0], float(int(value) | mask if is_set else int(value) & ~mask))


def _move_external_axis(machine: Machine, _call: Calling) -> None:
    machine.log.lose_axes("move on their own and are not shown")


def _move_unseen(machine: Machine, call: Calling) -> None:
    """Leave out a motion that only the controller knows. The arm's position is unknown then."""
    machine.log.leave_out(
        f"{call.name} moves the arm on a path that is not in the text: it is not shown"
    )
    machine.position = RobotPosition(None, machine.frame)
    machine.blending = 0


def _omit(machine: Machine, call: Calling) -> None:
    machine.log.omit(f"{_describe(machine, call)}: {OMITTED[call.name]}")


def _lose(machine: Machine, call: Calling) -> None:
    machine.log.leave_out(f"{call.name}: {LOST[call.name]}")


def _forget_arguments(machine: Machine, call: Calling) -> None:
    for target in call.values:
        if isinstance(target, (Ref, Component, Element)):
            place = machine.place(target)
            if place is not None and place[0].storage != "const":
                _receive_into(machine, call, target)


Effect = Callable[[Machine, Calling], None]


EFFECTS: dict[str, Effect] = {
    **dict.fromkeys(SILENT, lambda _machine, _call: None),
    **dict.fromkeys(OMITTED, _omit),
    **dict.fromkeys(LOST, _lose),
    **dict.fromkeys(UNSEEN, _move_unseen),
    **dict.fromkeys(ALONE, _move_external_axis),
    **dict.fromkeys(GIVES, _forget_arguments),
    **dict.fromkeys(("setdo", "setao", "setgo"), _set_output),
    "set": _set_or_reset, "reset": _set_or_reset, "invertdo": _invert,
    "pulsedo": _pulse, "waittime": _wait,
    **dict.fromkeys(
        ("waitdi", "waitdo", "waitgi", "waitgo", "waitai", "waitao"), _wait_signal
    ),
    "waitrob": _wait_for_rest,
    "waituntil": _wait_until,
    "pdispoff": _displace_off, "pdispset": _displace_set, "pdispon": _displace_on,
    "velset": _limit_speed, "confj": _supervise, "confl": _supervise, "singarea": _supervise,
    **dict.fromkeys(("cirpathmode", "circlepathmode"), _set_circle_mode),
    "triggio": _define_trigger, "triggequip": _define_trigger,
    **dict.fromkeys(("stop", "break", "systemstopaction"), _stop), "warmstart": _end,
    # The last entry of an instruction counts.
    **dict.fromkeys(_RECEIVES, _receive),
    "uimsgbox": _ask_operator, "exitcycle": _end_cycle, "exit": _end,
    **dict.fromkeys(("tpreadfk", "tpreadnum", "tpreaddnum"), _ask_operator),
    **dict.fromkeys(("incr", "decr", "add", "clear"), _increase),
    "bookerrno": _book_error, "fcdeact": _force_off,
    **dict.fromkeys(("bitset", "bitclear"), _bit),
}  # fmt: skip
