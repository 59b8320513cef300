"""The modal state of V+, as far as straight programs need it."""

from __future__ import annotations

import re
from collections.abc import Callable

from bench.reliability.modal.machine import Event, Machine, Number, arguments, as_number, atom, split, turn, turned

_WORD = re.compile(r'"[^"]*"|\d+\.?\d*(?:e[+-]?\d+)?|\.\d+|[.$#]?[a-z][a-z0-9_.]*|==|<>|<=|>=|\S')
#: So much of a name counts.
_COUNTS = 15
_POSTURE = {
    "lefty": "arm", "righty": "arm", "above": "elbow", "below": "elbow", "flip": "wrist", "noflip": "wrist",
    "single": "turns", "multiple": "turns",
}  # fmt: skip
_SETTINGS = {"accel": "accel", "coarse": "settling", "fine": "settling", "null": "nulling", "nonull": "nulling"}

_KEYWORDS = """
    pi base frame time state here dest trans break auto local global real call return pause stop halt attach detach
    select robot enable disable always mmps ips monitor appro appros depart departs drive ready align delay duration
    if then else end for while do until case goto and or not mod true false on off cp sig wait type execute abort
    inverse shift dx dy dz rx ry rz""".split()  # noqa: SIM905


def trace(text: str) -> list[Event]:
    """The trace of one file."""
    task = _Task(re.findall(r"[a-z][a-z0-9_.]*", re.sub(";[^\n]*", "", text.lower())))
    for line in text.split("\n"):
        words = _WORD.findall(line.split(";")[0].lower())
        if words:
            task.read([word[:_COUNTS] if word[:1].isalpha() and word != "wait.event" else word for word in words])
    return task.machine.end()


class _Task:
    """A program that runs. text: its words, without comments. known: the variables by name. moving: whether a motion
    has begun since the last BREAK. begun: whether an executable line has come. opened: whether a program has.
    """

    def __init__(self, text: list[str]) -> None:
        self.text, self.opened = text, False
        self.machine = Machine()
        self.known: dict[str, Event] = {}
        self.moving = False
        self.begun = False

    def read(self, words: list[str]) -> None:
        """One line."""
        name, machine = words[0], self.machine
        handler = _STATEMENTS.get(name)
        if name == "auto":
            machine.say("auto", "late" if self.begun else "first", *sorted(words[1:]))
            return
        if name == ".program":
            machine.leave()
            first, self.begun, self.opened = not self.opened, False, True
            # The first program is the one that is started: it is no matter what it is called.
            free = first and _is_free(words[1:2]) and self.text.count(words[1]) == 1
            machine.tell([name, *words[2:]] if free else words)
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
        elif words == ["return"] and machine.trace[-1:] == [("says", "return")]:
            return  # Nothing comes to it.
        elif handler is None or not handler(self, words[1:]):
            machine.tell(words)

    def set(self, words: list[str]) -> bool:
        """``name = location``."""
        if len(words) < 3 or words[1] != "=":
            return False
        self.known[words[0]] = self.value(words[2:])
        return True

    def tool(self, words: list[str]) -> bool:
        """``TOOL`` and its location."""
        self.machine.hold("tool", *self.value(words))
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
                found.append(("trans", *place, *turned(turn(2, yaw), turn(1, pitch), turn(2, roll))))
            elif joints:
                found.append(("#ppoint", *(Number(value, "deg") for value in joints)))
            else:
                known = self.known.get(part[0]) if len(part) == 1 else None
                found.append(known or ("?", *map(atom, part)))
        return tuple(each for event in found for each in (":", *event))

    def move(self, words: list[str], name: str) -> bool:
        """A motion to a location; a speed for the next motion is used up."""
        self.machine.move(name, *self.value(words))
        self.machine.state.pop("next speed", None)
        self.moving = True
        return bool(words)

    def speed(self, words: list[str]) -> bool:
        """``SPEED s [,r] [unit] [ALWAYS]``."""
        always = words[-1:] == ["always"]
        rest = words[:-1] if always else words
        unit = rest[-1] if rest and rest[-1] in ("mmps", "ips", "monitor") else "%"
        values = [as_number(part) for part in split(rest[:-1] if unit != "%" else rest)]
        known = [value for value in values if value is not None]
        if len(known) < len(values) or len(known) > 2:
            return False
        kind = {"mmps": "mm/s", "%": "%"}.get(unit, "")
        numbers = [Number(value, kind if k == 0 else "%") for k, value in enumerate(known)]
        key = "monitor" if unit == "monitor" else "speed" if always else "next speed"
        if len(numbers) == 1:
            numbers += [one for one in self.machine.state.get(key, ())[2:3] if isinstance(one, Number)]
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
    "set": _Task.set, "tool": _Task.tool, "speed": _Task.speed, "signal": _Task.signal, "wait.event": _Task.dwell,
    "move": lambda task, words: task.move(words, "move"), "moves": lambda task, words: task.move(words, "moves"),
}  # fmt: skip


def _is_free(name: list[str]) -> bool:
    """Whether a program may be called that."""
    keyword = " ".join(name) in {*_STATEMENTS, *_SETTINGS, *_POSTURE, *_KEYWORDS}
    return re.fullmatch(r"[a-z][a-z0-9_.]*", " ".join(name)) is not None and not keyword
