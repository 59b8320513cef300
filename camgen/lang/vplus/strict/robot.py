"""The robot of a V+ program: position, speed, path, tool, signals. For the read-back ``vplus``.

Sources: V+ Language Reference and User's Guide as docs/posts/vplus.md quotes them. Motions do not block and run into
each other unless BREAK stands between them; SPEED without ALWAYS is for one motion; 100 % at the start.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import numpy as np

from camgen.lang.vplus import words
from camgen.lang.vplus.arm import PAIRS, ROUNDED, Arm
from camgen.lang.vplus.locations import Expression
from camgen.lang.vplus.names import canonical
from camgen.lang.vplus.text import (
    Location,
    Pace,
    Report,
    Statement,
    Stretch,
    Unreadable,
    pace,
)
from camgen.lang.vplus.variables import Table, variable
from camgen.model.pose import Pose, translation
from camgen.model.program import Joints, Output, Stop, Wait

#: So many texts are kept with what they say.
_KEPT = 4096
T = TypeVar("T")
POSTURES = frozenset(word for pair in PAIRS for word in pair)
_PROFILE = re.compile(r"\(\s*(\d{1,9})\s*\)\s*(?=[\d.])")
#: Postures of the elbow and the wrist: a SCARA has neither.
_SIX_AXIS_ONLY = frozenset(PAIRS[1] + PAIRS[2])
#: What stands before the first motion of a program that leaves nothing to the one before.
_SETTINGS = ("SELECT ROBOT", "ATTACH", "ENABLE CP", "ACCEL", "TOOL")
#: Percentages are printed with 4 digits.
_SAME_SHARE = 5e-5
_ROBOT = re.compile(r"ROBOT\s*=\s*1", re.IGNORECASE)
#: The manual has ALWAYS last.
_DISORDERED = re.compile(r"\bALWAYS\s+\w", re.IGNORECASE)
#: After COARSE, FINE, NULL and NONULL.
_SETTLING = re.compile(r"(\d+(?:\.\d*)?)?\s*(ALWAYS)?", re.IGNORECASE)


class RobotState(Arm):
    """The robot while a text is carried out, and what is to be said of it. tool: None while it is the controller's.
    axes: how many joints the arm has, 0 while no precision point says. bent: the postures that only six axes have, by
    line. asked: the words of ``post.posture``. tool_name: of a tool that only the controller has. stated: the locations
    that ``SET`` gave. accel: profile and % that the options ask for.

    Methods with a ``Statement`` carry it out; Unreadable when they cannot.
    """

    def __init__(
        self,
        report: Report,
        remark: Report,
        rated: float,
        signals: Mapping[int, str],
        known: frozenset[str],
        accel: tuple[int, float],
    ) -> None:
        super().__init__(known, rated)
        self._accel = accel
        self.report, self.remark = report, remark
        self.tool: Pose | None = None
        self.axes = 0
        self.bent: dict[int, str] = {}
        self.asked: frozenset[str] = frozenset()
        self.names: frozenset[str] = frozenset()
        self.tool_name = ""
        self.stated: dict[str, Pose] = {}
        self._signals = signals
        self._constants: dict[tuple[object, str], Any] = {}
        #: Whether a motion has come, whether the robot is another task's, and which of the settings were said.
        self._begun = False
        self._detached = False
        self._said: set[str] = set()
        #: Whether no SPEED has come since a CALL or its RETURN, and the posture words that have, None once told.
        self._crossed = False
        self._restated: set[str] | None = None
        #: The posture words that no motion has come after, by line, and the SPEED of the last straight motion.
        self._unused: dict[int, str] = {}
        self._straight: Pace | None = None
        self._shares = False

    def enter(self, kept: Table | None = None) -> None:
        """A program starts."""
        super().enter(kept)
        if self.depth > 1:
            self._cross()

    def leave(self) -> None:
        """The program ends."""
        super().leave()
        if self.depth:
            self._cross()

    def _cross(self) -> None:
        """From one program to another: which settings that keeps, is not confirmed."""
        self._crossed, self._restated = True, set()

    def finish(self, line: int) -> None:
        """What the text leaves behind. line: the last one that was carried out."""
        for place, word in self._unused.items():
            self.remark(
                place, f"{word} after the last motion stays in force for the program after this one"
            )
        if "ATTACH" in self._said and not self._detached:
            self.remark(line, "the program ends without DETACH: the robot stays attached")

    def here(self, word: str) -> Location:
        """Where the last motion went."""
        if not isinstance(self._at, Location):
            raise Unreadable(f"{word} is not known here")
        if word == "HERE" and self._moving:
            raise Unreadable("HERE while the robot may still move: BREAK is missing before it")
        return self._at

    # -- variables -----------------------------------------------------------------------------------------------

    def let(self, statement: Statement) -> None:
        """``name = number``."""
        name, _, text = statement.rest.partition("=")
        value = self._read(text, words.real)
        self.store(statement.line, variable(name.strip()), value)

    def set(self, statement: Statement) -> None:
        """``SET name = location`` or ``SET #name = precision point``."""
        name, sign, text = statement.rest.partition("=")
        name = variable(name.strip())
        if not sign:
            raise Unreadable("SET wants name = location")
        expression = Expression(text, self)
        value = self._point(expression, statement) if name[0] == "#" else expression.location()
        expression.finish()
        if isinstance(value, Joints):
            self._count_axes(statement.line, value)
        elif not value.frame.external:
            self.stated[canonical(name)] = value.in_base()
        self.store(statement.line, name, value)

    def store(self, line: int, name: str, value: float | Location | Joints) -> None:
        """``assign``, with a remark on the first variable that is not the program's own."""
        self.assign(name, value)
        if canonical(name) not in self.names:
            self.remark(line, f"{name} gets a value: programs of the post set tool and work alone")
        if not self._shares and not self.is_own(name):
            self._shares = True
            what = "a global variable, which other programs share and which outlives this one"
            self.remark(line, f"{name} is not declared by AUTO: {what}")

    def _point(self, text: Expression, statement: Statement) -> Joints:
        point = text.point()
        if text.omitted:
            self.remark(
                statement.line,
                "a joint of #PPOINT left out, read as 0: what it means is not confirmed",
            )
        return point

    def _read(self, text: str, what: Callable[[Expression], T]) -> T:
        """``what`` of a text; kept, if no name has a say in it."""
        key = (what, text)
        if key in self._constants:
            value: T = self._constants[key]
            return value
        expression = Expression(text, self)
        value = what(expression)
        if expression.constant and len(self._constants) < _KEPT:
            self._constants[key] = value
        return value

    # -- motion --------------------------------------------------------------------------------------------------

    def stretch(self, plain: Stretch) -> bool:
        """The motions of a stretch at once, if the state is the usual one; else nothing is done."""
        frame = self.frame(plain.name)
        first, others = self._once or self._always, self._always
        straight = plain.word == "MOVES"
        if frame is None or not (straight or first[1] == others[1] == "%"):
            return False
        self._begin(plain.line, straight)
        self.follow(plain, frame)
        if len(plain.poses) > 1:
            self._check_speed(plain.line + 1, straight)
        return True

    def move(self, statement: Statement) -> None:
        """``MOVE`` or ``MOVES`` with any target."""
        text = Expression(statement.rest, self)
        target = self._point(text, statement) if text.peek()[:1] == "#" else text.location()
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
        distance = self._read(statement.rest, words.real)
        self._go(statement, self.here("DEST").moved(translation(0, 0, -distance)))

    def lost(self) -> None:
        """A motion that is not evaluated: nobody knows where the robot is."""
        self._at, self._moving = None, True

    def _go(self, statement: Statement, target: Location | Joints) -> None:
        straight = statement.word.endswith("S")
        self._begin(statement.line, straight, isinstance(target, Location))
        if isinstance(target, Joints) and straight:
            self._once = None
            raise Unreadable("a straight motion to joint values is not evaluated")
        if (self._once or self._always)[1] != "%" and not straight:
            self.report(statement.line, "a joint motion wants its SPEED in percent")
        if isinstance(target, Joints):
            self._count_axes(statement.line, target)
        self.travel(statement.line, target, straight, ROUNDED if self._path else 0.0)

    def _begin(self, line: int, straight: bool, posed: bool = True) -> None:
        """What must hold before a motion. posed: whether its target is a pose."""
        if self._detached:
            self.report(line, "a motion after DETACH: the robot is not attached to this program")
            self._detached = False  # told once
        self._check_speed(line, straight)
        self._check_posture(line, straight, posed)
        if self._begun:
            return
        self._begun = True
        missing = [setting for setting in _SETTINGS if setting not in self._said]
        if missing:
            what = f"{', '.join(missing)} not said before the first motion"
            self.remark(line, f"{what}: the program before may have left it otherwise")

    def _check_speed(self, line: int, straight: bool) -> None:
        """Remarks on a speed that the text leaves open."""
        if self._crossed and self._once is None:
            self._crossed = False
            self.remark(
                line,
                "no SPEED since a CALL or its RETURN: whether that keeps the speed is not confirmed",
            )
        setting = self._once or self._always
        if straight and setting != self._straight:
            self._straight = setting
            if setting[1] == "%":
                self.remark(line, "a straight motion with its SPEED in percent: mm/s by post.rated")

    def _check_posture(self, line: int, straight: bool, posed: bool) -> None:
        """Remarks on a posture that the text leaves open, or that the options do not ask for."""
        self._unused.clear()
        if self.asked:
            if not straight and "MOVE" not in self._said:
                self._compare_posture(line)
        elif posed and self._restated is not None:
            kept = {*(self._posture.switches if self._posture else ())} - self._restated
            self._restated = None
            if kept:
                what = f"{', '.join(sorted(kept))} not said since a CALL or its RETURN"
                self.remark(line, f"{what}: whether that keeps the posture is not confirmed")
        if not straight:
            self._said.add("MOVE")

    def _compare_posture(self, line: int) -> None:
        if {*(self._posture.switches if self._posture else ())} != self.asked:
            self.remark(
                line, f"post.posture asks for {', '.join(sorted(self.asked))} before the first MOVE"
            )

    def _count_axes(self, line: int, point: Joints) -> None:
        """A report on a precision point of another arm than the ones before."""
        count = len(point.values)
        if self.axes and count != self.axes:
            self.report(line, f"a precision point of {count} axes, others have {self.axes}")
        self.axes = self.axes or count

    def brake(self, statement: Statement) -> None:
        """``BREAK``: the motion comes to its end."""
        if statement.rest:
            raise Unreadable("BREAK stands alone")
        self.rest()

    def speed(self, statement: Statement) -> None:
        """All forms of ``SPEED``."""
        value, unit, turning, always = pace(statement.rest) or self._read(
            statement.rest, words.speed
        )
        if turning > 100 or (value > 100 and unit != "mm/s"):
            self.remark(
                statement.line, "SPEED above 100 %: the controller takes the most that it has"
            )
        if not always and unit != "MONITOR":
            self.remark(statement.line, "SPEED without ALWAYS holds for one motion")
        if _DISORDERED.search(statement.rest):
            self.remark(
                statement.line, "ALWAYS stands last in a SPEED: another order is not confirmed"
            )
        self._crossed = self._crossed and not (always and unit != "MONITOR")
        if unit == "MONITOR":
            self.remark(
                statement.line, "SPEED MONITOR sets the operator's speed, for other programs too"
            )
        self.set_pace(value, unit, turning, always)

    def configure(self, statement: Statement) -> None:
        """A posture word: in force from the next motion on, and instead of the one that it excludes."""
        if statement.rest:
            raise Unreadable(f"{statement.word} {statement.rest[:30]} is not evaluated")
        if statement.word in _SIX_AXIS_ONLY:
            self.bent[statement.line] = statement.word
        self.set_posture(statement.word)
        self._unused[statement.line] = statement.word
        if self._restated is not None:
            self._restated.add(statement.word)
        if self.asked and "MOVE" in self._said:
            self._compare_posture(statement.line)

    def accel(self, statement: Statement) -> None:
        """``ACCEL``: not in the instructions, and so a remark where it is not what the options ask for."""
        profile = _PROFILE.match(statement.rest)
        if profile and int(profile[1]) > 8:
            raise Unreadable(f"ACCEL has profiles 0 to 8, not {profile[1]}")
        values = self._read(statement.rest[profile.end() if profile else 0 :], words.reals)
        if len(values) > 2:
            raise Unreadable("ACCEL has two percentages")
        self._said.add("ACCEL")
        wanted, share = self._accel
        if profile is None:
            self.remark(statement.line, "ACCEL without a profile keeps that of the program before")
        shares = len(values) == 2 and max(abs(value - share) for value in values) <= _SAME_SHARE
        if (profile and int(profile[1]) != wanted) or not shares:
            what = f"ACCEL other than ({wanted}) {share:g}, {share:g}: corners and the time of the program are others"
            self.remark(statement.line, what)

    def switch(self, statement: Statement) -> None:
        """``ENABLE CP`` and ``DISABLE CP``."""
        if statement.rest.upper() != "CP":
            raise Unreadable(f"{statement.word} {statement.rest[:20]} is not evaluated")
        self._path = statement.word == "ENABLE"
        if not self._path:
            self.remark(
                statement.line,
                "DISABLE CP: every motion stops, those of the programs after this one too",
            )
        self._said.add("ENABLE CP")

    def settle(self, statement: Statement) -> None:
        """``COARSE``, ``FINE``, ``NULL``, ``NONULL``: how exactly a motion stops. No instruction tells that."""
        form = _SETTLING.fullmatch(statement.rest)
        numbered = statement.word in ("COARSE", "FINE")
        if form is None or (form[1] and not (numbered and float(form[1]) > 0)):
            raise Unreadable(f"{statement.word} {statement.rest[:30]} is not evaluated")
        self.remark(
            statement.line,
            f"{statement.word} sets how exactly the robot stops, which camgen never writes",
        )

    def select(self, statement: Statement) -> None:
        """``SELECT ROBOT = 1``: the one that a program has anyway."""
        if not _ROBOT.fullmatch(statement.rest):
            raise Unreadable(f"SELECT {statement.rest[:30]} is not evaluated")
        if "ATTACH" in self._said and not self._detached:
            self.remark(
                statement.line,
                "SELECT ROBOT after ATTACH, which took the robot that was selected before",
            )
        self._said.add("SELECT ROBOT")

    def set_tool(self, statement: Statement) -> None:
        """``TOOL``: one for the whole program."""
        self._said.add("TOOL")
        text = Expression(statement.rest, self)
        location = text.location()
        text.finish()
        external = location.frame.external
        tool = None if external else location.in_base()
        changed = external != self.tool_name or not same(tool, self.tool)
        self.tool, self.tool_name = tool, external
        if changed and self._last is not None:
            self._at = None
            raise Unreadable("the tool changes between motions")

    def base(self, statement: Statement) -> None:
        """``BASE``: only one that moves nothing; it stops the path."""
        values = self._read(statement.rest, words.reals)
        self.rest()
        self.remark(statement.line, "BASE sets the world frame, for other programs too")
        if any(values):
            raise Unreadable("BASE moves the world frame, which is not evaluated")

    # -- signals and robot ---------------------------------------------------------------------------------------

    def signal(self, statement: Statement) -> None:
        """``SIGNAL``: each number one output."""
        values = self._read(statement.rest, words.outputs)
        self._standing(statement, "an output")
        for value in values:
            name = self._signals.get(int(abs(value)), f"signal {abs(value):g}")
            self.add(statement.line, Output(name, 1.0 if value > 0 else 0.0))

    def wait_event(self, statement: Statement) -> None:
        """``WAIT.EVENT , s``: a dwell."""
        self._pause(statement, words.event)

    def stop(self, statement: Statement) -> None:
        """``PAUSE``: until the operator lets the program proceed."""
        if statement.rest:
            raise Unreadable("PAUSE stands alone")
        self._standing(statement, "PAUSE")
        self.add(statement.line, Stop())

    def delay(self, statement: Statement) -> None:
        """``DELAY``: read as a dwell and reported."""
        self.report(
            statement.line,
            "DELAY is uncertain: it delays the next motion; WAIT.EVENT , s is a dwell",
        )
        self._pause(statement, words.dwell)

    def _pause(self, statement: Statement, what: Callable[[Expression], float]) -> None:
        seconds = self._read(statement.rest, what)
        self._standing(statement, "a dwell")
        self.add(statement.line, Wait(seconds))

    def _standing(self, statement: Statement, what: str) -> None:
        if self._moving:
            self.report(
                statement.line, f"{what} while the robot may still move: BREAK is missing before it"
            )
        if self._detached:
            self.remark(
                statement.line, f"{what} after DETACH: the robot may be another program's by then"
            )

    def attach(self, statement: Statement) -> None:
        """``ATTACH``: the robot is this program's."""
        if "".join(statement.rest.split()) not in ("", "()"):
            raise Unreadable(f"ATTACH {statement.rest[:30]} is not evaluated")
        self._check_brackets(statement)
        self._said.add("ATTACH")
        self._detached = False

    def detach(self, statement: Statement) -> None:
        """``DETACH``: not while the robot moves, and nothing moves it after that."""
        if statement.rest.replace(" ", "") not in ("", "()"):
            raise Unreadable("DETACH of a device is not evaluated")
        self._check_brackets(statement)
        self._standing(statement, "DETACH")
        self._detached = True

    def _check_brackets(self, statement: Statement) -> None:
        if not statement.rest:
            self.remark(
                statement.line, f"{statement.word} without (): what that means is not confirmed"
            )


def same(a: Pose | None, b: Pose | None) -> bool:
    """Whether two poses are equal to the last bit, or both missing."""
    if a is None or b is None:
        return a is b
    return a.origin == b.origin and bool(np.array_equal(a.rotation, b.rotation))
