"""The motion that a program text describes, read by simulations that share nothing with camgen.

G-code is run by LinuxCNC's `rs274`, the other languages by the modal simulations in
`bench.reliability.modal`. All of them give the same steps: motions, switches and pauses.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from trimesh.transformations import quaternion_matrix

from bench.reliability.code_mutants.shapes import Array
from bench.reliability.modal import pacscript, rapid, rs274, vplus
from bench.reliability.modal.machine import Event, Number
from bench.support.motions import LevelArc
from tests.support import canon

JOINTS, FREE, LINE, ARC = "joints", "free", "line", "arc"
#: Blend of a motion that the controller rounds by its acceleration: no radius is in the text.
BY_ACCELERATION = -1.0
_ON_WORDS = {"on": 1.0, "set": 1.0, "off": 0.0, "reset": 0.0}


class Motion(NamedTuple):
    """A motion of the TCP in the work frame.

    kind: `JOINTS` to joint values, `FREE` to a pose on no stated path, `LINE` or `ARC`.
    end: mm; nan for joint values.
    via: a point of an arc between its ends, mm; None for a line.
    speed: mm/s; nan if the text states none.
    rotation: (3, 3) of the tool in the work frame; None if the language has none.
    force: N along tool x; 0 without a force.
    blend: radius of the corner at the end, mm; 0 is a stop, see `BY_ACCELERATION`.
    frames: positions of the tool frame and of the work frame, mm, then all entries of their
        rotations; empty if the text has none.
    setup: other words that hold for the motion.
    """

    kind: str
    end: Array = np.full(3, np.nan)
    via: Array | None = None
    speed: float = math.nan
    rotation: Array | None = None
    force: float = 0.0
    blend: float = 0.0
    frames: tuple[float, ...] = ()
    setup: tuple[str, ...] = ()


class Switch(NamedTuple):
    """An output. value: 0, 1, or rpm of a spindle."""

    name: str
    value: float


class Pause(NamedTuple):
    """A wait, s."""

    seconds: float


class Statement(NamedTuple):
    """A statement that no simulation interprets, as its words."""

    words: str


Step = Motion | Switch | Pause | Statement


class Unreadable(Exception):
    """A text that a simulation refuses, with its message."""


def read_steps(post: str, text: str) -> list[Step]:
    """The steps of a program of one file. Unreadable if the controller would refuse it."""
    steps = _READERS[post](text)
    for step in steps:
        is_placed = isinstance(step, Motion) and step.kind != JOINTS
        if is_placed and not (step.end.shape == (3,) and np.isfinite(step.end).all()):
            raise Unreadable("a motion without an end")
    return steps


def read_events(post: str, text: str) -> list[Event]:
    """The modal trace of a program, for a comparison of two texts."""
    if post in ("gcode", "grbl"):
        return rs274.trace(text, grbl=post == "grbl")
    return {"rapid": rapid.trace, "pacscript": pacscript.trace, "vplus": vplus.trace}[post](text)


def _numbers(event: Sequence[object], unit: str) -> list[float]:
    return [atom.value for atom in event if isinstance(atom, Number) and atom.unit == unit]


def _read_via(atoms: Sequence[object]) -> Array:
    """The via point of an arc, mm: half-way along it, or as it stands if it is near an end."""
    via = _numbers(atoms, "arc") or _numbers(atoms, "mm")[:3]
    if len(via) != 3:
        raise Unreadable("an arc without a via point")
    return np.array(via)


def _spell(event: Event) -> str:
    words = [f"{atom.value:g}" if isinstance(atom, Number) else atom for atom in event]
    return " ".join(words)


def _read_output(event: Event) -> Step:
    """An output event: its name, and a number or a word for its value."""
    *names, value = event[1:]
    name = _spell(tuple(names))
    if isinstance(value, Number):
        return Switch(name, value.value)
    if value in _ON_WORDS:
        return Switch(name, _ON_WORDS[value])
    return Statement(_spell(event))


def _read_other(event: Event, silent: Sequence[str]) -> list[Step]:
    """The step of an event that does not move; none for an event that is silent."""
    if event[0] == "output":
        return [_read_output(event)]
    if event[0] == "wait":
        return [Pause(_numbers(event, "s")[0])]
    return [] if event[0] in silent else [Statement(_spell(event))]


# RAPID

_PRESSING = ("fcpress1lstart", "fcpressl", "fcpressc")


def _read_rapid(text: str) -> list[Step]:
    """The motion of `main` with the routines that it calls; error handlers are not run."""
    routines: dict[str, list[Event]] = {}
    name, handles = "", False
    for event in rapid.trace(text):
        words = _spell(event)
        header = re.match(r"says (?:local )?proc ([\w.]+)", words)
        if header:
            name, handles = header[1], False
            routines[name] = []
        elif words == "says error":
            handles = True
        elif words == "says endproc":
            name = ""
        elif name and not handles:
            routines[name].append(event)
        elif not name and event[0] not in ("says", "leaves", "end", "persistent"):
            raise Unreadable(words[:80])
    if "main" not in routines:
        raise Unreadable("no routine main")
    return _run_rapid("main", routines, 0)


def _run_rapid(name: str, routines: dict[str, list[Event]], depth: int) -> list[Step]:
    if depth > 10:
        raise Unreadable("routines call each other without an end")
    steps: list[Step] = []
    for event in routines[name]:
        words = _spell(event)
        called = re.fullmatch(r"says ([\w.]+) ;", words)
        if called and called[1] in routines:
            steps += _run_rapid(called[1], routines, depth + 1)
        elif "|" in event and event[0] != "output":
            steps.append(_read_rapid_motion(event))
        else:
            steps += _read_other(event, ("calls", "leaves"))
    return steps


def _read_rapid_motion(event: Event) -> Motion:
    groups: list[list[object]] = [[]]
    for atom in event[1:]:
        if atom == "|":
            groups.append([])
        else:
            groups[-1].append(atom)
    name, rest = str(event[0]), groups[1:]
    via = None
    if name in ("movec", "fcpressc"):
        via = _read_via(rest.pop(0))
    pose, speed = rest[0], _numbers(rest[1], "mm/s")
    force = 0.0
    if name in _PRESSING:
        newtons = _numbers(event, "N")
        force = newtons[0] if newtons else math.nan
    zone = next((group for group in rest if group[:1] in (["fine"], ["false"])), ["fine"])
    blend = 0.0 if zone[0] == "fine" else zone[1].value
    frames = (*_numbers(rest[-1], "mm")[:6], *_numbers(rest[-1], "turn"))
    setup = [str(atom) for atom in rest[-1] if isinstance(atom, str)]
    if name == "moveabsj":
        return Motion(JOINTS, speed=speed[0] if speed else math.nan, blend=blend)
    end = np.array(_numbers(pose, "mm"))
    rotation = quaternion_matrix(_numbers(pose, "turn"))[:3, :3]
    kind = {"movej": FREE, "movec": ARC, "fcpressc": ARC}.get(name, LINE)
    rate = speed[0] if speed else math.nan
    return Motion(kind, end, via, rate, rotation, force, blend, frames, tuple(setup))


# V+


def _read_vplus(text: str) -> list[Step]:
    """The motion of a V+ program: a motion stops if BREAK follows it."""
    steps: list[Step] = []
    for event in vplus.trace(text):
        if event[0] in ("move", "moves"):
            steps.append(_read_vplus_motion(event))
        elif event[0] == "break":
            if steps and isinstance(steps[-1], Motion):
                steps[-1] = steps[-1]._replace(blend=0.0)
        else:
            steps += _read_other(event, ("end",))
    return steps


def _read_vplus_motion(event: Event) -> Motion:
    speed, begin = math.nan, event.index("accel") if "accel" in event else len(event)
    target, state = event[:begin], event[begin:]
    if "mmps" in state:
        speed = _numbers(state, "mm/s")[0]
    percent = _numbers(state, "%") if math.isnan(speed) else []
    words = _spell(state[: state.index("speed")] if "speed" in state else state).split()
    setup = (*words, *(f"{value:g} %" for value in percent))
    if "#ppoint" in target:
        return Motion(JOINTS, speed=speed, blend=BY_ACCELERATION, setup=setup)
    places, turns = _numbers(target, "mm"), _numbers(target, "turn")
    if len(places) != 6 or len(turns) != 18:
        raise Unreadable(_spell(target)[:80])
    frames = (*_numbers(state, "mm")[:3], *places[:3], *turns[:9], *_numbers(state, "turn"))
    kind = LINE if event[0] == "moves" else FREE
    rotation = np.array(turns[9:]).reshape(3, 3)
    end = np.array(places[3:])
    return Motion(kind, end, None, speed, rotation, 0.0, BY_ACCELERATION, frames, setup)


# PacScript


def _read_pacscript(text: str) -> list[Step]:
    """The motion of a PacScript program; the branch that checks the unit of speed is not run."""
    steps: list[Step] = []
    for event in pacscript.trace(_inline_subs(text)):
        if event[0] == "move":
            steps.append(_read_pacscript_motion(event))
        else:
            steps += _read_other(event, ("end", "leaves"))
    return steps


def _inline_subs(text: str) -> str:
    """The text with the lines of each `Sub` instead of its one `Call`.

    A `Sub` runs with the tool, the work frame and the speeds of its caller.
    """
    for name, body in re.findall(r"^Sub (\w+)\(.*\)\n((?:    .*\n)*)End Sub\n", text, re.M):
        call = re.compile(rf"^    Call {name}\(.*\)\n", re.M)
        if name != "Main" and len(call.findall(text)) == 1:
            text = re.sub(rf"^Sub {name}\(.*\)\n(?:    .*\n)*End Sub\n", "", text, flags=re.M)
            text = call.sub(lambda _match, lines=body: lines, text)
    return text


def _read_pacscript_motion(event: Event) -> Motion:
    kind = {"p": FREE, "l": LINE, "c": ARC}[str(event[1])]
    blend = 0.0 if event[3] == Number(0.0) else BY_ACCELERATION
    speeds = _numbers(event, "mm/s")
    speed = speeds[0] if speeds else math.nan
    begin = event.index("speed") if "speed" in event else len(event)
    setup = tuple(atom for atom in _spell(event[begin:]).split()[3:])
    places, turns = _numbers(event[:begin], "mm"), _numbers(event[:begin], "turn")
    if "j" in event[:begin]:
        return Motion(JOINTS, speed=speed, blend=blend, setup=setup)
    via = _read_via(event[:begin]) if kind == ARC else None
    if len(places) < 3 or len(turns) != 9:
        raise Unreadable(_spell(event)[:80])
    rotation = np.array(turns).reshape(3, 3)
    return Motion(kind, np.array(places[-3:]), via, speed, rotation, 0.0, blend, (), setup)


# G-code


def _read_gcode(text: str) -> list[Step]:
    """The motion as LinuxCNC's interpreter reports it."""
    result = canon.run(_LIFT.sub(f"G53 G0 Z{_TOP_MM:g}", text), _TOOLS)
    if result.error:
        raise Unreadable(result.error.strip().splitlines()[0][:80])
    tolerance = re.search(r"^G64 P([\d.]+)", text, re.M)
    blend = float(tolerance[1]) if tolerance else BY_ACCELERATION
    steps: list[Step] = []
    position = np.zeros(3)
    for call in result.calls:
        if call.kind in ("STRAIGHT_TRAVERSE", "STRAIGHT_FEED", "ARC_FEED"):
            motion = _read_call(call, position, blend)
            position = motion.end
            is_first = not any(isinstance(step, Motion) for step in steps)
            if is_first or motion.end[2] == _TOP_MM:
                motion = motion._replace(kind=JOINTS)
            steps.append(motion)
        elif call.kind == "DWELL":
            steps.append(Pause(call.value))
        elif call.kind == "START_SPINDLE_CLOCKWISE":
            steps.append(Switch("S", call.value))
        elif call.kind == "STOP_SPINDLE_TURNING":
            steps.append(Switch("S", 0.0))
        else:
            is_off = call.kind == "CLEAR_AUX_OUTPUT_BIT"
            steps.append(Switch(f"{call.kind} {call.value:g}", 0.0 if is_off else 1.0))
    others = [name for name in result.names if name not in _PLAIN_CALLS]
    return [*steps, *(Statement(name) for name in sorted(set(others)))]


#: The zero of a machine is its top. Without a machine it is that of the work, so the lift is given
#: a height that no program reaches.
_TOP_MM = 900.0
_LIFT = re.compile(r"\bG53 G0 Z0$", re.M)
_TOOLS = "T1 P1 Z0 D4.0 ;fine\nT2 P2 Z0 D6.0 ;coarse\n"
_PLAIN_CALLS = """
    COMMENT STRAIGHT_TRAVERSE STRAIGHT_FEED ARC_FEED DWELL SET_FEED_RATE SET_SPINDLE_SPEED
    START_SPINDLE_CLOCKWISE STOP_SPINDLE_TURNING""".split()  # noqa: SIM905


def _read_call(call: canon.Call, start: Array, blend: float) -> Motion:
    end = np.array(call.end)
    if call.kind == "STRAIGHT_TRAVERSE":
        return Motion(FREE, end, blend=blend)
    if call.kind == "STRAIGHT_FEED":
        return Motion(LINE, end, speed=call.feed / 60.0, blend=blend)
    if call.axes != (0, 1, 2) or abs(call.turns) != 1:
        raise Unreadable("an arc out of the level plane, or of several turns")
    arc = LevelArc(start, end, np.array(call.centre), call.turns > 0)
    via = arc.place(np.array([0.5]))[0]
    return Motion(ARC, end, via, call.feed / 60.0, blend=blend)


_READERS: dict[str, Callable[[str], list[Step]]] = {
    "rapid": _read_rapid,
    "vplus": _read_vplus,
    "pacscript": _read_pacscript,
    "gcode": _read_gcode,
    "grbl": _read_gcode,
}
