"""The modal state of V+, as far as straight programs need it."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import NamedTuple

from bench.reliability.modal.machine import (
    Event,
    Machine,
    Number,
    as_number,
    multiply,
    read_arguments,
    read_atom,
    rename,
    rotate,
    split,
    unbracket,
    work_out,
)

_WORD = re.compile(r'"[^"]*"|\d+\.?\d*(?:e[+-]?\d+)?|\.\d+|[.$#]?[a-z][a-z0-9_.]*|==|<>|<=|>=|\S')
#: Characters of a name that count.
_NAME_LENGTH = 15
#: Limit of programs that run, which no text of the bench reaches.
_MOST_CALLS = 100
#: Statements of one word, and the setting that they make.
_POSTURE = {
    **{"lefty": "arm", "righty": "arm", "above": "elbow", "below": "elbow"},
    **{"flip": "wrist", "noflip": "wrist", "single": "turns", "multiple": "turns"},
}
_SETTINGS = {
    **{"accel": "accel", "coarse": "settling", "fine": "settling"},
    **{"null": "nulling", "nonull": "nulling"},
}
_KEYWORDS = """
    pi base frame time state here dest trans break auto local global real call return pause stop
    halt attach detach select robot enable disable always mmps ips monitor appro appros depart
    departs drive ready align delay duration if then else end for while do until case goto and or
    not mod true false on off cp sig wait type execute abort inverse shift dx dy dz rx ry rz"""


class _Program(NamedTuple):
    """A program: its name, and the words of each line."""

    name: str
    lines: list[list[str]]


def trace(text: str) -> list[Event]:
    """The trace of one file: of its first program, and of the programs that it calls."""
    lines = [_read_words(line) for line in text.split("\n")]
    lines = [words for words in lines if words]
    called = [words[1] for words in lines if words[0] == ".program" and len(words) > 1][1:]
    lines = [unbracket(words) for words in rename(lines, called, _is_free)]
    programs = _split_programs(lines)
    if not programs:
        machine = Machine()
        machine.add("no programs")
        for words in lines:
            machine.add_statement(words)
        return machine.end()
    task = _Task(programs)
    first = programs[0].name
    # The operator starts the first program: its name has no effect if nothing else has it.
    names = re.findall(r"[a-z][a-z0-9_.]*", re.sub(";[^\n]*", "", text.lower()))
    is_unique = _is_free(first) and names.count(first) == 1
    task.run(first, "" if is_unique else first)
    for program in programs:
        if program.name not in task.reached:
            task.leave_out(program.name, program.lines)
    return task.end()


def _read_words(line: str) -> list[str]:
    """The words of a line in lower case without its comment, with names of 15 characters."""
    words = []
    for word in _WORD.findall(line.partition(";")[0].lower()):
        is_name = word[:1].isalpha() and word != "wait.event"
        words.append(word[:_NAME_LENGTH] if is_name else word)
    return words


def _split_programs(lines: list[list[str]]) -> list[_Program]:
    """The programs of a text.

    None if a line is outside of all, one has arguments or no end, or two have one name.
    """
    programs: list[_Program] = []
    is_inside = False
    for words in lines:
        if words[0] == ".program" and not is_inside and words[2:] == ["(", ")"]:
            programs.append(_Program(words[1], []))
            is_inside = True
        elif words == [".end"] and is_inside:
            is_inside = False
        elif is_inside and words[0][0] != ".":
            programs[-1].lines.append(words)
        else:
            return []
    names = {program.name for program in programs}
    return [] if is_inside or len(names) < len(programs) else programs


class _Task:
    """A program that runs.

    programs: lines of each program by name
    locations: values of the variables by name
    local: variables of the running program
    reached: programs that ran
    target: location at which the last motion ends
    is_moving: whether a motion has started since the last BREAK
    has_started: whether the running program has run an executable line
    is_attached: whether the task has the robot
    robot: number of the selected robot, empty without one
    """

    def __init__(self, programs: list[_Program]) -> None:
        self.programs = {program.name: program.lines for program in programs}
        self.machine = Machine()
        self.locations: dict[str, Event] = {}
        self.local: set[str] = set()
        self.reached: list[str] = []
        self.target: Event = ()
        self.is_moving = self.has_started = self.is_attached = False
        self.robot = ""

    def end(self) -> list[Event]:
        """The whole trace without the speed at the end.

        SPEED 100,100 ALWAYS holds whenever a program is started (Language Reference, SPEED).
        """
        for name in ("speed", "next speed"):
            self.machine.state.pop(name, None)
        return self.machine.end()

    def run(self, name: str, shown: str) -> None:
        """Runs a program from its first line to its RETURN, or to `.END`, which acts as one.

        Programs that ran on real robots (adept_experimental, `ros.read.4bytes`) are called, have no
        RETURN, and their callers continue.

        shown: name in the trace
        """
        locations, local, has_started = dict(self.locations), self.local, self.has_started
        self.local, self.has_started = set(), False
        self.reached.append(name)
        self.machine.add("enters", shown)
        self.cross()
        lines = self.programs[name]
        count = lines.index(["return"]) if ["return"] in lines else len(lines)
        for words in lines[:count]:
            self.read(words)
        self.leave_out(shown, [words for words in lines[count:] if words != ["return"]])
        self.machine.add("leaves", shown)
        for variable in self.local:
            self.locations.pop(variable, None)
            if variable in locations:
                self.locations[variable] = locations[variable]
        self.local, self.has_started = local, has_started
        self.cross()

    def leave_out(self, name: str, lines: list[list[str]]) -> None:
        """Adds lines that are not reached."""
        for words in lines:
            self.machine.add("not reached", name)
            self.machine.add_statement(words)

    def cross(self) -> None:
        """Marks all settings at a call or return, where the controller may not keep them."""
        state = self.machine.state
        for name, value in state.items():
            state[name] = value if value[:1] == ("kept?",) else ("kept?", *value)

    def read(self, words: list[str]) -> None:
        """Runs a line."""
        name, machine = words[0], self.machine
        if name == "auto":
            machine.add("auto", "late" if self.has_started else "first", *sorted(words[1:]))
            self.local |= {word for word in words[1:] if word != ","}
            for variable in self.local:
                self.locations.pop(variable, None)
            return
        self.has_started = True
        handler = _STATEMENTS.get(name)
        if name in _POSTURE and len(words) == 1:
            machine.keep(_POSTURE[name], name)
        elif name in _SETTINGS:
            machine.keep(_SETTINGS[name], *map(read_atom, words))
        elif name in ("enable", "disable") and len(words) == 2:
            machine.keep(words[1], name)
        elif name == "break" and len(words) == 1:
            if self.is_moving:
                machine.add(name)
            self.is_moving = False
        elif handler is None or not handler(self, words[1:]):
            machine.add_statement(words)

    # Handlers of a statement: they return whether they have understood its words.

    def call(self, words: list[str]) -> bool:
        """`CALL name()`."""
        is_known = words[1:] == ["(", ")"] and words[0] in self.programs
        if not is_known or len(self.reached) > _MOST_CALLS:
            return False
        self.run(words[0], words[0])
        return True

    def select(self, words: list[str]) -> bool:
        """`SELECT ROBOT = n` for the next ATTACH. Selected twice, it is the same robot."""
        is_repeated = words == ["robot", "=", self.robot] and not self.is_attached
        is_plain = words[:2] == ["robot", "="] and len(words) == 3
        self.robot = words[2] if is_plain else ""
        return is_repeated

    def attach(self, words: list[str]) -> bool:
        """`ATTACH ()`. It has no effect in a task that has the robot.

        Task 0 has it from its start (User's Guide, robot control programs). Programs that ran on
        real robots (adept_experimental, `ros.srv.cmd`) attach it there all the same.
        """
        is_repeated = words == ["(", ")"] and self.is_attached
        self.is_attached = self.is_attached or words == ["(", ")"]
        return is_repeated

    def detach(self, words: list[str]) -> bool:
        """`DETACH ()`."""
        self.is_attached = self.is_attached and words != ["(", ")"]
        return False

    def assign(self, words: list[str]) -> bool:
        """`SET name = location`."""
        if len(words) < 3 or words[1] != "=":
            return False
        self.locations[words[0]] = self.evaluate(words[2:])
        return True

    def set_tool(self, words: list[str]) -> bool:
        """`TOOL location`."""
        self.machine.keep("tool", *self.evaluate(words))
        self.target = ()
        return bool(words)

    def evaluate(self, words: list[str]) -> Event:
        """A compound of locations: the numbers of each, or its name if its value is unknown."""
        compound: list[str | Number] = []
        for part in split(words, ":"):
            compound.append(":")
            numbers = read_arguments(part, "trans", 6, may_omit=True)
            joints = read_arguments(part, "#ppoint", 6)
            if numbers:
                *place, yaw, pitch, roll = [*numbers, *[0.0] * (6 - len(numbers))]
                compound += ["trans", *(Number(value, "mm") for value in place)]
                compound += multiply(rotate(2, yaw), rotate(1, pitch), rotate(2, roll))
            elif joints:
                compound += ["#ppoint", *(Number(value, "deg") for value in joints)]
            elif len(part) == 1 and self.locations.get(part[0]):
                compound += self.locations[part[0]]
            else:
                compound += ["?", *map(read_atom, part)]
        return tuple(compound)

    def move(self, words: list[str], name: str) -> bool:
        """A motion to a location. It uses up a speed for the next motion.

        With MMPS the first number is the linear speed of the tool tip, the second the rotational
        one of straight motions (Language Reference, SPEED). A straight motion that only turns has
        no linear speed.
        """
        state, target = self.machine.state, self.evaluate(words)
        key = "next speed" if "next speed" in state else "speed"
        speed = state.get(key, ())
        has_both = speed[:1] == ("mmps",) and len(speed) == 3
        if name == "moves" and has_both and self.is_reorientation(target):
            state[key] = ("turns", speed[2])
        self.machine.move(name, *target)
        if speed:
            state[key] = speed
        state.pop("next speed", None)
        self.is_moving, self.target = True, target
        return bool(words)

    def is_reorientation(self, target: Event) -> bool:
        """Whether a target differs from the last one in the rotation of its last `TRANS` alone."""
        units = [value.unit for value in target[-9:] if isinstance(value, Number)]
        is_turned = self.target[-9:] != target[-9:]
        return units == ["turn"] * 9 and self.target[:-9] == target[:-9] and is_turned

    def set_speed(self, words: list[str]) -> bool:
        """`SPEED s [,r] [unit] [ALWAYS]`."""
        is_lasting = words[-1:] == ["always"]
        rest = words[:-1] if is_lasting else words
        unit = "%"
        if rest and rest[-1] in ("mmps", "ips", "monitor"):
            *rest, unit = rest
        values = [work_out(part) for part in split(rest)]
        if None in values or len(values) > 2:
            return False
        units = ({"mmps": "mm/s", "%": "%"}.get(unit, ""), "%")
        numbers = [Number(*pair) for pair in zip(values, units, strict=False)]
        key = "speed" if is_lasting else "next speed"
        if unit == "monitor":
            key = "monitor"
        before = self.machine.state.get(key, ())
        if len(numbers) == 1 and before[:1] != ("kept?",):
            numbers += [number for number in before[2:3] if isinstance(number, Number)]
        self.machine.keep(key, unit, *numbers)
        return True

    def set_signals(self, words: list[str]) -> bool:
        """`SIGNAL n, ...`, off with a minus."""
        values = []
        for part in split(words):
            values.append(as_number([word for word in part if word not in "()"]))
        if None in values:
            return False
        for value in values:
            self.machine.switch(f"signal {abs(value):g}", "on" if value > 0 else "off")
        return True

    def wait(self, words: list[str]) -> bool:
        """`WAIT.EVENT , s`."""
        seconds = as_number(words[1:])
        if words[:1] != [","] or seconds is None:
            return False
        self.machine.add("wait", Number(seconds, "s"))
        return True


_STATEMENTS: dict[str, Callable[[_Task, list[str]], bool]] = {
    "attach": _Task.attach,
    "call": _Task.call,
    "detach": _Task.detach,
    "select": _Task.select,
    "set": _Task.assign,
    "tool": _Task.set_tool,
    "speed": _Task.set_speed,
    "signal": _Task.set_signals,
    "wait.event": _Task.wait,
    "move": lambda task, words: task.move(words, "move"),
    "moves": lambda task, words: task.move(words, "moves"),
}
_TAKEN = frozenset((*_STATEMENTS, *_SETTINGS, *_POSTURE, *_KEYWORDS.split()))


def _is_free(name: str) -> bool:
    """Whether a program may have a name."""
    return re.fullmatch(r"[a-z][a-z0-9_.]*", name) is not None and name not in _TAKEN
