"""The modal state of V+, as far as straight programs need it."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import NamedTuple

from bench.reliability.modal.machine import (
    Event,
    Machine,
    Number,
    arguments,
    as_number,
    atom,
    rename,
    split,
    turn,
    turned,
    unbracket,
    work_out,
)

_WORD = re.compile(r'"[^"]*"|\d+\.?\d*(?:e[+-]?\d+)?|\.\d+|[.$#]?[a-z][a-z0-9_.]*|==|<>|<=|>=|\S')
#: So much of a name counts.
_COUNTS = 15
#: More programs than any text calls.
_CALLS = 100
_POSTURE = {
    "lefty": "arm", "righty": "arm", "above": "elbow", "below": "elbow", "flip": "wrist", "noflip": "wrist",
    "single": "turns", "multiple": "turns",
}  # fmt: skip
_SETTINGS = {
    "accel": "accel",
    "coarse": "settling",
    "fine": "settling",
    "null": "nulling",
    "nonull": "nulling",
}

_KEYWORDS = """
    pi base frame time state here dest trans break auto local global real call return pause stop halt attach detach
    select robot enable disable always mmps ips monitor appro appros depart departs drive ready align delay duration
    if then else end for while do until case goto and or not mod true false on off cp sig wait type execute abort
    inverse shift dx dy dz rx ry rz""".split()  # noqa: SIM905


class _Program(NamedTuple):
    """Its name, and its lines in words."""

    name: str
    lines: list[list[str]]


def trace(text: str) -> list[Event]:
    """The trace of one file: of its first program, and of what that calls."""
    lines = [_WORD.findall(line.split(";")[0].lower()) for line in text.split("\n")]
    lines = [
        [word if word == "wait.event" else _cut(word) for word in words] for words in lines if words
    ]
    called = [words[1] for words in lines if words[0] == ".program" and len(words) > 1][1:]
    lines = [unbracket(words) for words in rename(lines, called, _is_free)]
    programs = _part(lines)
    if not programs:
        machine = Machine()
        machine.say("no programs")
        for words in lines:
            machine.tell(words)
        return machine.end()
    task = _Task(programs)
    first = programs[0].name
    # The first program is the one that is started: it is no matter what it is called.
    names = re.findall(r"[a-z][a-z0-9_.]*", re.sub(";[^\n]*", "", text.lower()))
    task.run(first, "" if _is_free(first) and names.count(first) == 1 else first)
    for program in programs:
        if program.name not in task.reached:
            task.leave_out(program.name, program.lines)
    return task.end()


def _cut(word: str) -> str:
    return word[:_COUNTS] if word[:1].isalpha() else word


def _part(lines: list[list[str]]) -> list[_Program]:
    """The programs, none where a line is in none, one has arguments or no end, or two have one name."""
    programs: list[_Program] = []
    within = False
    for words in lines:
        if words[0] == ".program" and not within and words[2:] == ["(", ")"]:
            programs.append(_Program(words[1], []))
            within = True
        elif words == [".end"] and within:
            within = False
        elif within and words[0][0] != ".":
            programs[-1].lines.append(words)
        else:
            return []
    return programs if not within and len({one.name for one in programs}) == len(programs) else []


class _Task:
    """A program that runs. programs: by name. known: the variables by name. reached: the programs that ran. at: where
    the last motion went. moving: whether a motion has begun since the last BREAK. begun: whether an executable line
    has come. own: the variables of the program that runs. robot: the one that is selected, if any.
    """

    def __init__(self, programs: list[_Program]) -> None:
        self.programs = {program.name: program.lines for program in programs}
        self.machine = Machine()
        self.known: dict[str, Event] = {}
        self.own: set[str] = set()
        self.reached: list[str] = []
        self.at: Event = ()
        self.moving = self.begun = self.attached = False
        self.robot = ""

    def end(self) -> list[Event]:
        """The whole trace. SPEED 100,100 ALWAYS is assumed whenever program execution starts (Language Reference,
        SPEED): no speed is left behind.
        """
        for name in ("speed", "next speed"):
            self.machine.state.pop(name, None)
        return self.machine.end()

    def run(self, name: str, called: str) -> None:
        """A program from its first line to its RETURN, or to ``.END``, which is one: programs that ran on real robots
        (adept_experimental, ``ros.read.4bytes``) are called, have no RETURN, and their callers go on.
        """
        known, own, begun = dict(self.known), self.own, self.begun
        self.own, self.begun = set(), False
        self.reached.append(name)
        self.machine.say("enters", called)
        self.cross()
        lines = self.programs[name]
        count = lines.index(["return"]) if ["return"] in lines else len(lines)
        for words in lines[:count]:
            self.read(words)
        self.leave_out(called, [words for words in lines[count:] if words != ["return"]])
        self.machine.say("leaves", called)
        for each in self.own:
            self.known.pop(each, None)
            if each in known:
                self.known[each] = known[each]
        self.own, self.begun = own, begun
        self.cross()

    def leave_out(self, name: str, lines: list[list[str]]) -> None:
        """Lines that are not reached."""
        for words in lines:
            self.machine.say("not reached", name)
            self.machine.tell(words)

    def cross(self) -> None:
        """From one program to another: whether that keeps what was set, is not known."""
        state = self.machine.state
        for name, value in state.items():
            state[name] = value if value[:1] == ("kept?",) else ("kept?", *value)

    def read(self, words: list[str]) -> None:
        """One line."""
        name, machine = words[0], self.machine
        handler = _STATEMENTS.get(name)
        if name == "auto":
            machine.say("auto", "late" if self.begun else "first", *sorted(words[1:]))
            self.own |= {word for word in words[1:] if word != ","}
            for each in self.own:
                self.known.pop(each, None)
            return
        self.begun = True
        if name in _POSTURE and len(words) == 1:
            machine.hold(_POSTURE[name], name)
        elif name in _SETTINGS:
            machine.hold(_SETTINGS[name], *map(atom, words))
        elif name in ("enable", "disable") and len(words) == 2:
            machine.hold(words[1], name)
        elif name == "break" and len(words) == 1:
            if self.moving:
                machine.say(name)
            self.moving = False
        elif handler is None or not handler(self, words[1:]):
            machine.tell(words)

    def call(self, words: list[str]) -> bool:
        """``CALL name()``."""
        if words[1:] != ["(", ")"] or words[0] not in self.programs or len(self.reached) > _CALLS:
            return False
        self.run(words[0], words[0])
        return True

    def select(self, words: list[str]) -> bool:
        """``SELECT ROBOT = n``: which robot ATTACH takes. Selected again before that, it is the same."""
        again = words == ["robot", "=", self.robot] and not self.attached
        self.robot = words[2] if words[:2] == ["robot", "="] and len(words) == 3 else ""
        return again

    def attach(self, words: list[str]) -> bool:
        """``ATTACH ()``. To a task that has the robot it says nothing: task 0 has it from its start (User's Guide,
        robot control programs), and programs that ran on real robots (adept_experimental, ``ros.srv.cmd``) attach it
        there all the same.
        """
        again = words == ["(", ")"] and self.attached
        self.attached = self.attached or words == ["(", ")"]
        return again

    def detach(self, words: list[str]) -> bool:
        """``DETACH ()``."""
        self.attached = self.attached and words != ["(", ")"]
        return False

    def set(self, words: list[str]) -> bool:
        """``name = location``."""
        if len(words) < 3 or words[1] != "=":
            return False
        self.known[words[0]] = self.value(words[2:])
        return True

    def tool(self, words: list[str]) -> bool:
        """``TOOL`` and its location."""
        self.machine.hold("tool", *self.value(words))
        self.at = ()
        return bool(words)

    def value(self, words: list[str]) -> Event:
        """A compound of locations: of each the numbers, or its name where it is not known."""
        found: list[Event] = []
        for part in split(words, ":"):
            numbers = arguments(part, "trans", 6, omitted=True)
            joints = arguments(part, "#ppoint", 6)
            if numbers:
                x, y, z, yaw, pitch, roll = [*numbers, *[0.0] * (6 - len(numbers))]
                place = tuple(Number(value, "mm") for value in (x, y, z))
                found.append(
                    ("trans", *place, *turned(turn(2, yaw), turn(1, pitch), turn(2, roll)))
                )
            elif joints:
                found.append(("#ppoint", *(Number(value, "deg") for value in joints)))
            else:
                known = self.known.get(part[0]) if len(part) == 1 else None
                found.append(known or ("?", *map(atom, part)))
        return tuple(each for event in found for each in (":", *event))

    def move(self, words: list[str], name: str) -> bool:
        """A motion to a location; a speed for the next motion is used up.

        With MMPS the first number is the linear speed of the tool tip, the second the rotational one of straight
        motions (Language Reference, SPEED): a straight motion whose target only turns has none of the first.
        """
        state, target = self.machine.state, self.value(words)
        key = "next speed" if "next speed" in state else "speed"
        pace = state.get(key, ())
        if name == "moves" and pace[:1] == ("mmps",) and len(pace) == 3 and self.is_turn(target):
            state[key] = ("turns", pace[2])
        self.machine.move(name, *target)
        state.update({key: pace} if pace else {})
        state.pop("next speed", None)
        self.moving, self.at = True, target
        return bool(words)

    def is_turn(self, target: Event) -> bool:
        """Whether ``target`` differs from where the last motion went in the rotation of its last ``TRANS`` alone."""
        found = [value.unit for value in target[-9:] if isinstance(value, Number)]
        return found == ["turn"] * 9 and self.at[:-9] == target[:-9] and self.at[-9:] != target[-9:]

    def speed(self, words: list[str]) -> bool:
        """``SPEED s [,r] [unit] [ALWAYS]``."""
        always = words[-1:] == ["always"]
        rest = words[:-1] if always else words
        unit = rest[-1] if rest and rest[-1] in ("mmps", "ips", "monitor") else "%"
        values = [work_out(part) for part in split(rest[:-1] if unit != "%" else rest)]
        known = [value for value in values if value is not None]
        if len(known) < len(values) or len(known) > 2:
            return False
        kind = {"mmps": "mm/s", "%": "%"}.get(unit, "")
        numbers = [Number(value, kind if k == 0 else "%") for k, value in enumerate(known)]
        key = "monitor" if unit == "monitor" else "speed" if always else "next speed"
        if len(numbers) == 1:
            before = self.machine.state.get(key, ())
            numbers += [
                one for one in before[2:3] if isinstance(one, Number) and before[0] != "kept?"
            ]
        self.machine.hold(key, unit, *numbers)
        return True

    def signal(self, words: list[str]) -> bool:
        """``SIGNAL n, ...``, off with a minus."""
        values = [as_number([word for word in part if word not in "()"]) for part in split(words)]
        known = [value for value in values if value is not None]
        if len(known) < len(values):
            return False
        for value in known:
            self.machine.switch(f"signal {abs(value):g}", "on" if value > 0 else "off")
        return True

    def dwell(self, words: list[str]) -> bool:
        """``WAIT.EVENT , s``."""
        seconds = as_number(words[1:])
        if words[:1] != [","] or seconds is None:
            return False
        self.machine.say("wait", Number(seconds, "s"))
        return True


_STATEMENTS: dict[str, Callable[[_Task, list[str]], bool]] = {
    "attach": _Task.attach, "call": _Task.call, "detach": _Task.detach, "select": _Task.select,
    "set": _Task.set, "tool": _Task.tool, "speed": _Task.speed, "signal": _Task.signal, "wait.event": _Task.dwell,
    "move": lambda task, words: task.move(words, "move"), "moves": lambda task, words: task.move(words, "moves"),
}  # fmt: skip


def _is_free(name: str) -> bool:
    """Whether a program may be called that."""
    keyword = name in {*_STATEMENTS, *_SETTINGS, *_POSTURE, *_KEYWORDS}
    return re.fullmatch(r"[a-z][a-z0-9_.]*", name) is not None and not keyword
