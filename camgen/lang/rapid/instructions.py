"""RAPID's instructions that do not move: signals, waits, displacements, speeds, questions (technical reference manual).

What moves nothing and changes nothing that is shown is nothing. What reads from a controller or its surroundings
leaves data that are not known.
"""

from __future__ import annotations

from collections.abc import Callable

from msgspec.structs import replace

from camgen.lang.run import Ended
from camgen.lang.values import Unknown
from camgen.model.instructions import Force, MoveC, MoveJ, MoveL, Output, Stop, Wait
from camgen.model.pose import IDENTITY, Pose

from .effects import ALONE, GIVES, LOST, OMITTED, SILENT, UNSEEN
from .functions import name_of
from .machine import Machine, RobotPosition
from .motions import Trigger
from .places import pose_of, see_here
from .tree import Calling, Component, Element, Expr, Ref, find_root
from .values import find_unknown

#: s: how long PulseDO switches on where it does not say.
_PULSE = 0.2


class CycleEnded(Ended):
    """The program begins anew, with the data that it has."""


# Outputs --------------------------------------------------------------------------------------------------------


def _set_to(machine: Machine, name: str, value: float, group: bool = False) -> None:
    """Sets an output. One that has the value already changes nothing in a corner; a group tells somebody a number."""
    if machine.blending and machine.outputs.get(name.lower()) != value:
        what = f"{name} is switched while the robot is still in a corner: the motion in line {machine.blending} blends"
        machine.log.find("unusual" if group else "dangerous", what)
        machine.blending = 0
    machine.add(Output(name, value))
    machine.outputs[name.lower()] = value


def _signal_of(machine: Machine, call: Calling, count: int) -> str:
    if len(call.args) != count:
        raise machine.wrong(
            f"{call.name} has {count} argument{'s' * (count > 1)}, not {len(call.args)}"
        )
    return name_of(machine, call.args[0])


def _set_output(machine: Machine, call: Calling) -> None:
    """SetDO, SetAO, SetGO."""
    options = dict(call.options)
    given = options.get("dvalue")
    if "sdelay" in options:
        machine.log.fact("delays", "SetDO with SDelay is shown without it")
    name = _signal_of(machine, call, 1 if given is not None else 2)
    value = machine.number(given if given is not None else call.args[1])
    if isinstance(value, Unknown):
        machine.log.assume(f"what {name} is set to is not known: 1 is taken", name.lower(), 1.0)
        value = machine.given(name) or 1.0
    if call.name == "setdo" and value not in (0, 1, 2):
        raise machine.wrong(f"{name} is set to {value:g}; a digital output is 0 or 1")
    _set_to(
        machine, name, float(value == 1) if call.name == "setdo" else value, call.name == "setgo"
    )


def _set_one(machine: Machine, call: Calling) -> None:
    """Set, Reset."""
    _set_to(machine, _signal_of(machine, call, 1), float(call.name == "set"))


def _invert(machine: Machine, call: Calling) -> None:
    name = _signal_of(machine, call, 1)
    now = machine.outputs.get(name.lower())
    if now is None:
        machine.log.assume(f"{name} is inverted: it is taken to be off before", name.lower(), 0.0)
        now = machine.given(name) or 0.0
    _set_to(machine, name, float(now == 0))


def _pulse(machine: Machine, call: Calling) -> None:
    """PulseDO: on, and off again while the program goes on."""
    name = _signal_of(machine, call, 1)
    options = dict(call.options)
    length = machine.number(options["plength"]) if options.get("plength") is not None else _PULSE
    _set_to(machine, name, 1.0)
    if "high" not in options:
        machine.add(Output(name, 0.0))
        machine.outputs[name.lower()] = 0.0
    machine.log.fact("pulses", f"{name}, {length:g} s" if type(length) is float else name)


# Waits ----------------------------------------------------------------------------------------------------------


def _wait(machine: Machine, call: Calling) -> None:
    """WaitTime; with InPos it waits for standstill first."""
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
    machine.blending = 0  # by the end of the wait the arm has come to its point


def _wait_signal(machine: Machine, call: Calling) -> None:
    """WaitDI, WaitDO, WaitGI, WaitAI ...: over at once."""
    name = name_of(machine, call.args[0] if call.args else None)
    value = machine.number(call.args[1]) if len(call.args) > 1 else 1.0
    wanted = f"{value:g}" if type(value) is float else "a value"
    machine.log.assume(f"{name}: the wait for {wanted} is over at once")
    _no_timeout(machine, call)


def _wait_until(machine: Machine, call: Calling) -> None:
    """WaitUntil: over at once."""
    if call.args and not isinstance(call.args[-1], bool):
        held = machine.value(call.args[-1])
        if held is not True:
            what = held.what if isinstance(held, Unknown) else "a condition"
            machine.log.assume(f"{what[:60] or 'a condition'}: the wait for it is over at once")
    _no_timeout(machine, call)


def _wait_for_rest(machine: Machine, _call: Calling) -> None:
    """WaitRob: until the arm has come to its point."""
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


# Displacements and speeds ---------------------------------------------------------------------------------------


def _displace_off(machine: Machine, _call: Calling) -> None:
    machine.displaced = None
    machine.version += 1


def _displace_set(machine: Machine, call: Calling) -> None:
    """PDispSet: the frame that it says, in the work object."""
    value = machine.value(call.args[0] if call.args else None)
    machine.fit("pose", value)
    unknown = find_unknown(value)
    if unknown is not None:
        machine.log.assume(
            f"a displacement is not known ({unknown.what}): none is taken", unknown.key
        )
        value = None
    machine.displaced = pose_of(machine, value) if isinstance(value, tuple) else None
    machine.log.fact("displacement", "of the program, PDispSet")


def _displace_on(machine: Machine, call: Calling) -> None:
    """PDispOn: from the point that the program names to where the arm is, or to ExeP."""
    options = dict(call.options)
    if len(call.args) < 2:
        raise machine.wrong("PDispOn has a point and a tool")
    machine.displaced = None
    point = machine.value(call.args[0])
    there = options.get("exep")
    at = (
        machine.value(there)
        if there is not None
        else see_here(machine, Calling(machine.line, "crobt"))
    )
    machine.fit("robtarget", point)
    machine.fit("robtarget", at)
    if find_unknown(point) is not None or find_unknown(at) is not None:
        machine.log.assume("a displacement is not known (PDispOn where the arm is): none is taken")
        return
    planned, real = pose_of(machine, point), pose_of(machine, at)
    if "rot" in options:
        machine.displaced = real @ planned.inverse()
    else:
        x, y, z = (a - b for a, b in zip(real.origin, planned.origin, strict=True))
        machine.displaced = Pose(IDENTITY, (x, y, z))
    machine.log.fact("displacement", "of the program, PDispOn")


def _limit_speed(machine: Machine, call: Calling) -> None:
    """VelSet: % of every speed, and mm/s at most."""
    values = [machine.number(arg) for arg in call.args]
    if len(values) != 2:
        raise machine.wrong("VelSet has a percentage and a speed")
    unknown = find_unknown(values)
    if unknown is not None:
        machine.log.omit(
            f"velset: a value that is not known ({unknown.what[:60]}): the speeds stay"
        )
        return
    percent, most = values
    if not (percent > 0 and most > 0):
        raise machine.wrong(f"VelSet {percent:g}, {most:g}: both must be positive")
    machine.speed_override, machine.speed_most = percent / 100, most


def _describe(machine: Machine, call: Calling) -> str:
    """The instruction with its numbers and the names of its options."""
    values = [machine.value(arg) for arg in call.args if isinstance(arg, (float, Ref))]
    text = ", ".join(f"{value:g}" for value in values if type(value) is float)
    text += "".join(f"\\{name}" for name, _ in call.options)
    return f"{call.name} {text}".rstrip()


def _supervise(machine: Machine, call: Calling) -> None:
    """ConfJ, ConfL, SingArea: each with its switch."""
    if call.args or len(call.options) > 1:
        raise machine.wrong(f"{call.name} has one switch")
    if call.name == "confl":
        machine.has_conf_l = not any(name.lower() == "off" for name, _ in call.options)
    _omit(machine, call)


#: Modes of CirPathMode that are read, with the way in which the orientation of a circle point counts.
_CIRCLE_MODES = {"pathframe": "", "objectframe": "", "cirpointori": "circle point"}


def _set_circle_mode(machine: Machine, call: Calling) -> None:
    """CirPathMode: how the tool turns along an arc. Modes of the wrist are lost; without one it is PathFrame."""
    mode = call.options[0][0] if call.options else "pathframe"
    if mode not in _CIRCLE_MODES:
        machine.log.leave_out(
            f"{call.name} \\{mode}: the tool turns as the wrist does; split the arc at taught points"
        )
        return
    machine.passes_circle_point = _CIRCLE_MODES[mode] == "circle point"
    machine.log.fact("settings", f"{call.name} \\{mode}")


# Triggers -------------------------------------------------------------------------------------------------------


def _define_trigger(machine: Machine, call: Calling) -> None:
    """TriggIO, TriggEquip: what is switched at which distance."""
    options = dict(call.options)
    name, value = "", None
    signal = next((options[k] for k in ("dop", "gop", "aop") if options.get(k) is not None), None)
    if signal is not None:
        name = name_of(machine, signal)
    values = [machine.number(arg) for arg in call.args[1:]]
    numbers = [v for v in values if type(v) is float]
    if "setvalue" in options or "setdvalue" in options:
        value = machine.number(options.get("setvalue") or options.get("setdvalue"))
    elif len(values) > 1:
        value = values[-1]
    distance = numbers[0] if numbers and "time" not in options else 0.0
    done = ((name, value),) if name and type(value) is float else ()
    if not done:
        machine.log.leave_out(f"{call.name}: its signal or its value is not known")
    if "time" in options:
        machine.log.omit(f"{call.name} \\time: the time before the end; here it acts at the end")
    if call.name == "triggequip" and len(numbers) > 1 and numbers[1]:
        machine.log.omit(f"triggequip: the lag of its equipment, {numbers[1]:g} s")
    if call.args:
        machine.assign(call.args[0], Trigger(distance, "start" in options, done))


# The operator, and data from elsewhere --------------------------------------------------------------------------


def _stop(machine: Machine, _call: Calling) -> None:
    machine.add(Stop())
    machine.blending = 0


def _end(_machine: Machine, _call: Calling) -> None:
    raise Ended


def _end_cycle(_machine: Machine, _call: Calling) -> None:
    raise CycleEnded


def _ask_operator(machine: Machine, call: Calling) -> None:
    """TPReadNum, TPReadFK, TPReadDnum, UIMsgBox: the answer is not known unless the user gives it."""
    _receive(machine, call)
    if call.name == "uimsgbox":
        machine.log.assume("uimsgbox: the operator answers at once")
        return
    if call.args and isinstance(call.args[0], (Ref, Component, Element)):
        name = _key_of(call.args[0])
        if machine.given(name) is None:
            machine.log.assume(f"{name}: the operator's answer is not known", name)


def _receive(machine: Machine, call: Calling) -> None:
    """An instruction that gives data a value from outside."""
    places = _RECEIVES.get(call.name, ())
    targets = [call.args[k] for k in places if k < len(call.args)]
    targets += [value for name, value in call.options if name in _RECEIVED_BY and value is not None]
    for target in targets:
        if isinstance(target, (Ref, Component, Element)):
            key = _key_of(target)
            machine.assign(target, machine.ask_for(f"{key}, from {call.name}", key))


def _key_of(target: Expr) -> str:
    root = find_root(target)
    return root.name.lower() if isinstance(root, Ref) else ""


#: Which arguments of an instruction get a value from outside, and which optional ones.
_RECEIVES: dict[str, tuple[int, ...]] = {
    "tpreadfk": (0,), "tpreadnum": (0,), "tpreaddnum": (0,), "uimsgbox": (), "socketreceive": (), "readanybin": (1,),
    "readrawbytes": (1,), "unpackrawbytes": (2,), "getdataval": (1,), "readcfgdata": (2,), "getsysdata": (0,),
    "readblock": (1,), "rmqgetmsgdata": (1,), "rmqreadwait": (0,), "rmqgetmessage": (0,), "rmqgetmsgheader": (0,),
    "gettrapdata": (0,), "camgetresult": (1,), "search_1d": (0,), "search_groove": (0,), "search_part": (0,),
    "getnextsym": (0,), "mtooltcpcalib": (4, 5, 6), "mtoolrotcalib": (1,), "stooltcpcalib": (4, 5, 6),
    "stoolrotcalib": (4,), "getjointdata": (), "socketreceivefrom": (),
}  # fmt: skip
_RECEIVED_BY = frozenset(
    ("position", "speed", "torque", "exttorque", "result", "str", "rawdata", "data", "message", "buttons", "timeflag",
     "readnoofbytes")
)  # fmt: skip


def _increase(machine: Machine, call: Calling) -> None:
    """Incr, Decr, Add, Clear."""
    if not call.args or not isinstance(call.args[0], (Ref, Component, Element)):
        raise machine.wrong(f"{call.name} needs data")
    now = machine.number(call.args[0])
    if call.name == "clear":
        machine.assign(call.args[0], 0.0)
        return
    step = machine.number(call.args[1]) if call.name == "add" and len(call.args) > 1 else 1.0
    if type(now) is not float or type(step) is not float:
        machine.assign(call.args[0], now if isinstance(now, Unknown) else step)
        return
    machine.assign(call.args[0], now + step if call.name in ("incr", "add") else now - step)


def _force_off(machine: Machine, _call: Calling) -> None:
    machine.pressing = None
    machine.add(Force(0.0))


def _book_error(machine: Machine, call: Calling) -> None:
    """BookErrNo: the number of an error of the program's own."""
    if call.args:
        machine.assign(call.args[0], machine.error_number())


def _bit(machine: Machine, call: Calling) -> None:
    """BitSet, BitClear."""
    if len(call.args) != 2:
        raise machine.wrong(f"{call.name} has data and a place")
    now, place = machine.number(call.args[0]), machine.number(call.args[1])
    if type(now) is float and type(place) is float and 1 <= place <= 52 and 0 <= now < 2**52:
        mask = 1 << (int(place) - 1)
        machine.assign(
            call.args[0],
            float(int(now) | mask if call.name.startswith("bitset") else int(now) & ~mask),
        )


def _move_alone(machine: Machine, _call: Calling) -> None:
    """IndAMove and its like: an axis beside the arm."""
    machine.log.lose_axes("move on their own and are not shown")


def _move_unseen(machine: Machine, call: Calling) -> None:
    """A motion that no text tells: where the arm is is not known after it."""
    machine.log.leave_out(f"{call.name} moves the arm as no text says: it is not shown")
    machine.position = RobotPosition(None, machine.frame)
    machine.blending = 0


def _move_nothing(_machine: Machine, _call: Calling) -> None:
    pass


def _omit(machine: Machine, call: Calling) -> None:
    """An effect that another machine does without."""
    machine.log.omit(f"{_describe(machine, call)}: {OMITTED[call.name]}")


def _lose(machine: Machine, call: Calling) -> None:
    """An effect without which another machine would move differently."""
    machine.log.leave_out(f"{call.name}: {LOST[call.name]}")


def _forget_arguments(machine: Machine, call: Calling) -> None:
    """An instruction that gives several of its arguments values from outside."""
    given = [*call.args, *(value for _, value in call.options)]
    for target in given:
        if not isinstance(target, (Ref, Component, Element)):
            continue
        place = machine.place(target)
        if place is not None and place[0].storage != "const":
            key = _key_of(target)
            machine.assign(target, machine.ask_for(f"{key}, from {call.name}", key))


Effect = Callable[[Machine, Calling], None]


EFFECTS: dict[str, Effect] = {
    **dict.fromkeys(SILENT, _move_nothing),
    **dict.fromkeys(OMITTED, _omit),
    **dict.fromkeys(LOST, _lose),
    **dict.fromkeys(UNSEEN, _move_unseen),
    **dict.fromkeys(ALONE, _move_alone),
    **dict.fromkeys(GIVES, _forget_arguments),
    **dict.fromkeys(("setdo", "setao", "setgo"), _set_output), "set": _set_one, "reset": _set_one, "invertdo": _invert,
    "pulsedo": _pulse, "waittime": _wait,
    **dict.fromkeys(
        ("waitdi", "waitdo", "waitgi", "waitgo", "waitai", "waitao"), _wait_signal
    ),
    "waitrob": _wait_for_rest,
    "waituntil": _wait_until, "pdispoff": _displace_off, "pdispset": _displace_set, "pdispon": _displace_on,
    "velset": _limit_speed, "confj": _supervise, "confl": _supervise, "singarea": _supervise,
    **dict.fromkeys(("cirpathmode", "circlepathmode"), _set_circle_mode),
    "triggio": _define_trigger, "triggequip": _define_trigger,
    **dict.fromkeys(("stop", "break", "systemstopaction"), _stop), "warmstart": _end,
    "uimsgbox": _ask_operator, "exitcycle": _end_cycle, "exit": _end,
    **dict.fromkeys(("tpreadfk", "tpreadnum", "tpreaddnum"), _ask_operator),
    **dict.fromkeys((name for name in _RECEIVES if not name.startswith(("tpread", "uimsgbox"))), _receive),
    **dict.fromkeys(("incr", "decr", "add", "clear"), _increase),
    "bookerrno": _book_error, "fcdeact": _force_off,
    **dict.fromkeys(("bitset", "bitclear"), _bit),
}  # fmt: skip
