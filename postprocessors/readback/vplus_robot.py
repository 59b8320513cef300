"""The robot of a V+ program: position, speed, path, tool, signals. For the read-back ``vplus``.

Sources: V+ Language Reference and User's Guide as docs/posts/vplus.md quotes them. Motions do not block and run into
each other unless BREAK stands between them; SPEED without ALWAYS is for one motion; 100 % at the start.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from camgen.ir import Joints, Output, Wait
from camgen.pose import Pose, translation

from .vplus_expr import Expression, Location, Unreadable, rotation_zyz
from .vplus_names import Variables, variable
from .vplus_text import Report, Statement, canonical

#: What a corner without BREAK is read as, mm: V+ says that it is rounded, not by how much.
ROUNDED = 1.0
_INCH = 25.4
_NUMBER = r"-?\d{1,9}(?:\.\d{0,9})?"
_PLAIN = re.compile(
    rf"([A-Z][A-Z0-9._]*):TRANS\(({_NUMBER}),({_NUMBER}),({_NUMBER}),({_NUMBER}),({_NUMBER}),({_NUMBER})\)",
    re.IGNORECASE | re.ASCII,
)
_PROFILE = re.compile(r"\(\s*\d\s*\)\s*(?=[\d.])")


@dataclass(slots=True)
class Step:
    """A motion; its target in the frame that it was written in."""

    line: int
    straight: bool
    target: Location | Joints
    speed: float
    blend: float


#: An instruction that is no motion, and its line.
Other = tuple[int, Output | Wait]


class Robot(Variables):
    """The robot while a text is carried out. steps: what it does, in order. tool: None while it is the controller's.

    Methods with a ``Statement`` carry it out; Unreadable when they cannot.
    """

    def __init__(self, report: Report, rated: float, signals: Mapping[int, str], known: frozenset[str]) -> None:
        super().__init__(known)
        self.report = report
        self.steps: list[Step | Other] = []
        self.tool: Pose | None = None
        self._rated = rated
        self._signals = signals
        self._tool_name = ""
        self._last: Step | None = None
        self._at: Location | None = None
        self._moving = False
        self._path = True
        self._always: tuple[float, str] = (100.0, "%")
        self._once: tuple[float, str] | None = None
        self._monitor = 1.0

    def here(self, word: str) -> Location:
        """Where the last motion went."""
        if self._at is None:
            raise Unreadable(f"{word} is not known here")
        if word == "HERE" and self._moving:
            raise Unreadable("HERE while the robot may still move: BREAK is missing before it")
        return self._at

    # -- variables -----------------------------------------------------------------------------------------------

    def let(self, statement: Statement) -> None:
        """``name = number``."""
        name, _, text = statement.rest.partition("=")
        value = self._only_real(text)
        self.assign(variable(name.strip()), value)

    def set(self, statement: Statement) -> None:
        """``SET name = location`` or ``SET #name = precision point``."""
        name, sign, text = statement.rest.partition("=")
        name = variable(name.strip())
        if not sign:
            raise Unreadable("SET wants name = location")
        expression = Expression(text, self)
        value = expression.point() if name[0] == "#" else expression.location()
        expression.finish()
        self.assign(name, value)

    def _only_real(self, text: str) -> float:
        expression = Expression(text, self)
        value = expression.real()
        expression.finish()
        return value

    # -- motion --------------------------------------------------------------------------------------------------

    def plain(self, statement: Statement) -> bool:
        """The usual target ``frame:TRANS(six numbers)`` without an expression: for speed, and for nothing else."""
        match = _PLAIN.fullmatch(statement.rest)
        if match is None:
            return False
        key = canonical(match[1])
        external = self._external(key)
        frame = self._value(key)
        if not external and not (isinstance(frame, Location) and not frame.compound and not frame.external):
            return False
        rotation = rotation_zyz(float(match[5]), float(match[6]), float(match[7]))
        pose = Pose(rotation, (float(match[2]), float(match[3]), float(match[4])))
        if isinstance(frame, Location):
            target = Location(pose, frame.local, compound=True)
        else:
            target = Location(pose, external=key)
        self._go(statement, target)
        return True

    def move(self, statement: Statement) -> None:
        """``MOVE`` or ``MOVES`` with any target."""
        text = Expression(statement.rest, self)
        target = text.point() if text.peek()[:1] == "#" else text.location()
        text.finish()
        self._go(statement, target)

    def appro(self, statement: Statement) -> None:
        """To the point so many mm back along the tool z of a location."""
        text = Expression(statement.rest, self)
        target = text.location()
        text.expect(",")
        distance = text.real()
        text.finish()
        self._go(statement, target.moved(translation(0, 0, -distance)))

    def depart(self, statement: Statement) -> None:
        """Back along the tool z from where the last motion went."""
        distance = self._only_real(statement.rest)
        self._go(statement, self.here("DEST").moved(translation(0, 0, -distance)))

    def lost(self) -> None:
        """A motion that is not evaluated: nobody knows where the robot is."""
        self._at, self._moving = None, True

    def _go(self, statement: Statement, target: Location | Joints) -> None:
        straight = statement.word.endswith("S")
        speed, unit = self._once or self._always
        self._once = None
        self._at = target if isinstance(target, Location) else None
        self._moving = True
        if unit == "%":
            speed *= self._rated / 100
        elif not straight:
            self.report(statement.line, "a joint motion wants its SPEED in percent")
        if straight and isinstance(target, Joints):
            raise Unreadable("a straight motion to joint values is not evaluated")
        self._last = Step(statement.line, straight, target, speed * self._monitor, ROUNDED if self._path else 0.0)
        self.steps.append(self._last)

    def brake(self, statement: Statement) -> None:
        """``BREAK``: the motion comes to its end."""
        if statement.rest:
            raise Unreadable("BREAK stands alone")
        self._stopped()

    def _stopped(self) -> None:
        if self._last is not None:
            self._last.blend = 0.0
        self._moving = False

    def speed(self, statement: Statement) -> None:
        """All forms of ``SPEED``."""
        text = Expression(statement.rest, self)
        value = text.real()
        if text.accept(",") and text.real() <= 0:
            raise Unreadable("a rotational speed must be positive")
        words = []
        while text.peek():
            words.append(text.take())
        units = [w for w in words if w != "ALWAYS"]
        if len(units) > 1 or len(set(words)) < len(words) or not set(words) <= {"ALWAYS", "MMPS", "IPS", "MONITOR"}:
            raise Unreadable(f"SPEED cannot end with {' '.join(words)[:40]}")
        if value <= 0:
            raise Unreadable("a speed must be positive")
        if "MONITOR" in units:
            self._monitor = min(value, 100.0) / 100
            return
        setting = (value, "%") if not units else (value * (_INCH if "IPS" in units else 1.0), "mm/s")
        if "ALWAYS" in words:
            self._always, self._once = setting, None
        else:
            self._once = setting

    def accel(self, statement: Statement) -> None:
        """``ACCEL``: read, not compared."""
        text = Expression(_PROFILE.sub("", statement.rest, count=1), self)
        if len(text.reals()) > 2:
            raise Unreadable("ACCEL has two percentages")
        text.finish()

    def switch(self, statement: Statement) -> None:
        """``ENABLE CP`` and ``DISABLE CP``."""
        if statement.rest.upper() != "CP":
            raise Unreadable(f"{statement.word} {statement.rest[:20]} is not evaluated")
        self._path = statement.word == "ENABLE"

    def set_tool(self, statement: Statement) -> None:
        """``TOOL``: one for the whole program."""
        text = Expression(statement.rest, self)
        location = text.location()
        text.finish()
        tool = None if location.external else location.in_base()
        changed = location.external != self._tool_name or not same(tool, self.tool)
        self.tool, self._tool_name = tool, location.external
        if changed and self._last is not None:
            self._at = None
            raise Unreadable("the tool changes between motions")

    def base(self, statement: Statement) -> None:
        """``BASE``: only one that moves nothing; it stops the path."""
        text = Expression(statement.rest, self)
        values = text.reals()
        text.finish()
        self._stopped()
        if any(values):
            raise Unreadable("BASE moves the world frame, which is not evaluated")

    # -- signals and robot ---------------------------------------------------------------------------------------

    def signal(self, statement: Statement) -> None:
        """``SIGNAL``: each number one output."""
        text = Expression(statement.rest, self)
        values = text.reals()
        text.finish()
        for value in values:
            number = abs(value)
            if number != int(number) or number == 0 or 1000 < number <= 2000:
                raise Unreadable(f"{value:g} is no output")
        self._standing(statement, "an output")
        for value in values:
            name = self._signals.get(int(abs(value)), f"signal {abs(value):g}")
            self.steps.append((statement.line, Output(name, 1.0 if value > 0 else 0.0)))

    def wait_event(self, statement: Statement) -> None:
        """``WAIT.EVENT , s``: a dwell."""
        text = Expression(statement.rest, self)
        if not text.accept(","):
            raise Unreadable("WAIT.EVENT with an event is not evaluated")
        self._pause(statement, text)

    def delay(self, statement: Statement) -> None:
        """``DELAY``: read as a dwell and reported."""
        self.report(statement.line, "DELAY is uncertain: it delays the next motion; WAIT.EVENT , s is a dwell")
        self._pause(statement, Expression(statement.rest, self))

    def _pause(self, statement: Statement, text: Expression) -> None:
        seconds = text.real()
        text.finish()
        if seconds <= 0:
            raise Unreadable("a dwell must be positive")
        self._standing(statement, "a dwell")
        self.steps.append((statement.line, Wait(seconds)))

    def _standing(self, statement: Statement, what: str) -> None:
        if self._moving:
            self.report(statement.line, f"{what} while the robot may still move: BREAK is missing before it")

    def detach(self, statement: Statement) -> None:
        """``DETACH``: not while the robot moves."""
        if statement.rest.replace(" ", "") not in ("", "()"):
            raise Unreadable("DETACH of a device is not evaluated")
        self._standing(statement, "DETACH")


def same(a: Pose | None, b: Pose | None) -> bool:
    """Whether two poses are equal to the last bit, or both missing."""
    if a is None or b is None:
        return a is b
    return a.origin == b.origin and bool(np.array_equal(a.rotation, b.rotation))
