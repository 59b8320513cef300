"""The robot of a V+ program: position, speed, path, tool, signals.

Sources: V+ Language Reference and User's Guide, quoted in docs/posts/vplus.md. Motions do not block
and blend into each other unless BREAK is between them. SPEED without ALWAYS is for one motion. The
speed at the start is 100 %.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from msgspec import Struct

from camgen.lang.log import Log
from camgen.lang.vplus.arm import PAIRS, ROUNDED, Arm, is_same
from camgen.lang.vplus.locations import Expression, read_whole
from camgen.lang.vplus.names import canonical
from camgen.lang.vplus.text import (
    Impossible,
    Location,
    SpeedSetting,
    Statement,
    Stretch,
    Unreadable,
    parse_plain_speed,
)
from camgen.lang.vplus.variables import Table, check_name
from camgen.model.instructions import NO_POSTURE
from camgen.model.pose import Pose, translation
from camgen.model.program import Joints, Output, Stop, Wait

#: Maximum number of texts in the cache of values.
_KEPT = 4096
T = TypeVar("T")
_PROFILE = re.compile(r"\(\s*(\d{1,9})\s*\)\s*(?=[\d.])")
#: Postures of the elbow and the wrist, which a SCARA does not have.
_SIX_AXIS_ONLY = frozenset(PAIRS[1] + PAIRS[2])
#: Settings that posts write before the first motion. Without them those of the program before stay.
_SETTINGS = ("SELECT ROBOT", "ATTACH", "ENABLE CP", "ACCEL", "TOOL")
#: Maximum difference of two equal percentages, which are printed with 4 digits.
_SAME_SHARE = 5e-5
#: Numbers of outputs and of soft signals. Inputs are 1001 to 2000.
_OUTPUTS = frozenset((*range(1, 1001), *range(2001, 10_000)))
_ROBOT = re.compile(r"ROBOT\s*=\s*1", re.IGNORECASE)
#: ALWAYS before other words. The manual has it last.
_DISORDERED = re.compile(r"\bALWAYS\s+\w", re.IGNORECASE)
#: Arguments of COARSE, FINE, NULL and NONULL.
_SETTLING = re.compile(r"(\d+(?:\.\d*)?)?\s*(ALWAYS)?", re.IGNORECASE)


class Settings(Struct, frozen=True):
    """Options of the post.

    rated: speed at 100 %, mm/s.
    rated_turn: speed of reorientation at 100 %, deg/s.
    signals: name of a signal by number of its output.
    tool: name of the tool, as V+ stores it.
    work: name of the work frame, as V+ stores it.
    undeclared: locations that the text need not define.
    profile: profile of ACCEL.
    acceleration: percentages of ACCEL.
    posture: words of `post.posture`.
    """

    rated: float
    rated_turn: float
    signals: Mapping[int, str]
    tool: str
    work: str
    undeclared: frozenset[str]
    profile: int
    acceleration: float
    posture: frozenset[str]


class RobotState(Arm):
    """The robot while a program runs.

    Methods with a `Statement` run it. They raise Unreadable if they cannot.

    settings: options of the post.
    log: findings.
    tool: tool, None if only the controller has it.
    tool_name: name of a tool that only the controller has, else empty.
    axes: number of joints of the arm, 0 before the first precision point.
    bent: postures that only arms of six axes have, by line.
    stated: locations that `SET` has defined.
    """

    def __init__(self, log: Log, settings: Settings) -> None:
        super().__init__(settings.undeclared, settings.rated)
        self.log, self.settings = log, settings
        self.tool: Pose | None = None
        self.tool_name = ""
        self.axes = 0
        self.bent: dict[int, str] = {}
        self.stated: dict[str, Pose] = {}
        self._constants: dict[tuple[object, str], Any] = {}
        #: Whether the program has moved.
        self._has_moved = False
        #: Whether the robot is not attached to the program.
        self._detached = False
        #: Settings of the program so far.
        self._stated: set[str] = set()
        #: Whether there was no SPEED since a CALL or its RETURN.
        self._crossed = False
        #: Posture words since a CALL or its RETURN, None before and after the first motion.
        self._restated: set[str] | None = None
        #: Posture words since the last motion, by line.
        self._unused: dict[int, str] = {}
        #: SPEED of the last straight motion.
        self._straight: SpeedSetting | None = None

    def fault(self, line: int, what: str) -> None:
        """Adds a refusal of a line."""
        self.log.find("refused", what, line=line)

    def remark(self, line: int, what: str) -> None:
        """Adds an unusual finding of a line."""
        self.log.find("unusual", what, line=line)

    def enter(self, kept: Table | None = None) -> None:
        """Starts a program."""
        super().enter(kept)
        if self.depth > 1:
            self._cross()

    def leave(self) -> None:
        """Ends a program."""
        super().leave()
        if self.depth:
            self._cross()

    def _cross(self) -> None:
        """Marks a change between programs. It is not confirmed which settings the new one keeps."""
        self._crossed, self._restated = True, set()

    def finish(self, line: int) -> None:
        """Adds findings for the state at the end of the text.

        line: line of the last statement that was run.
        """
        what = "after the last motion stays in force for the program after this one"
        for posture_line, word in self._unused.items():
            self.remark(posture_line, f"{word} {what}")
        if "ATTACH" in self._stated and not self._detached:
            self.remark(line, "the program ends without DETACH: the robot stays attached")

    def current_location(self, word: str) -> Location:
        """The target of the last motion. Raises Unreadable if it is unknown."""
        if not isinstance(self._at, Location):
            raise Unreadable(f"{word} is not known here")
        if word == "HERE" and self._moving:
            raise Unreadable("HERE while the robot may still move: BREAK is missing before it")
        return self._at

    # -- variables

    def assign_number(self, statement: Statement) -> None:
        """Runs `name = number`."""
        name, _, text = statement.rest.partition("=")
        value = self._read(text, Expression.real)
        self.store(statement.line, check_name(name.strip()), value)

    def set(self, statement: Statement) -> None:
        """Runs `SET name = location` or `SET #name = precision point`."""
        name, sign, text = statement.rest.partition("=")
        name = check_name(name.strip())
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
        """Assigns a value. Variables that posts do not write, and global ones, are findings."""
        self.assign(name, value)
        if canonical(name) not in (self.settings.tool, self.settings.work):
            self.remark(line, f"{name} gets a value: programs of the post set tool and work alone")
        if not self.is_own(name):
            why = "a global variable, which other programs share and which outlives this one"
            what = f"{name} is not declared by AUTO: {why}"
            self.log.find("unusual", what, line=line, once="a global variable")

    def _point(self, text: Expression, statement: Statement) -> Joints:
        point = text.point()
        assert isinstance(point, Joints)  # Joint values of the controller are refused.
        if text.omitted:
            what = "a joint of #PPOINT left out, read as 0: what it means is not confirmed"
            self.remark(statement.line, what)
        return point

    def _read(self, text: str, parse: Callable[[Expression], T]) -> T:
        """The value of a whole text. It is cached if it does not depend on a variable."""
        key = (parse, text)
        if key in self._constants:
            value: T = self._constants[key]
            return value
        expression = Expression(text, self)
        value = parse(expression)
        expression.finish()
        if expression.constant and len(self._constants) < _KEPT:
            self._constants[key] = value
        return value

    # -- motion

    def try_stretch(self, plain: Stretch) -> bool:
        """Runs all motions of a stretch. Returns False, and runs none, in an unusual state."""
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
        """Runs `MOVE` or `MOVES` with any target."""
        text = Expression(statement.rest, self)
        target = self._point(text, statement) if text.peek()[:1] == "#" else text.location()
        text.finish()
        self._go(statement, target)

    def appro(self, statement: Statement) -> None:
        """Runs `APPRO`: to a location moved back by a distance, mm, along its tool z."""
        text = Expression(statement.rest, self)
        target = text.location()
        text.expect(",")
        distance = text.real()
        text.finish()
        self._go(statement, target.moved(translation(0, 0, -distance)))

    def depart(self, statement: Statement) -> None:
        """Runs `DEPART`: to the last target moved back by a distance, mm, along its tool z."""
        distance = self._read(statement.rest, Expression.real)
        self._go(statement, self.current_location("DEST").moved(translation(0, 0, -distance)))

    def lose_position(self) -> None:
        """Marks the position as unknown, after a motion that is not evaluated."""
        self._at, self._moving = None, True

    def _go(self, statement: Statement, target: Location | Joints) -> None:
        straight = statement.word.endswith("S")
        self._begin(statement.line, straight, isinstance(target, Location))
        if isinstance(target, Joints) and straight:
            self._once = None
            raise Unreadable("a straight motion to joint values is not evaluated")
        if (self._once or self._always)[1] != "%" and not straight:
            self.fault(statement.line, "a joint motion wants its SPEED in percent")
        if isinstance(target, Joints):
            self._count_axes(statement.line, target)
        self.travel(statement.line, target, straight, ROUNDED if self._path else 0.0)

    def _begin(self, line: int, straight: bool, posed: bool = True) -> None:
        """Checks the state before a motion.

        posed: whether its target is a pose.
        """
        if self._detached:
            self.fault(line, "a motion after DETACH: the robot is not attached to this program")
            self._detached = False  # one finding is enough
        self._check_speed(line, straight)
        self._check_posture(line, straight, posed)
        if self._has_moved:
            return
        self._has_moved = True
        missing = [setting for setting in _SETTINGS if setting not in self._stated]
        if missing:
            what = f"{', '.join(missing)} not set before the first motion"
            self.remark(line, f"{what}: the program before may have left it otherwise")

    def _check_speed(self, line: int, straight: bool) -> None:
        """Adds findings for a speed that the text leaves open."""
        if self._crossed and self._once is None:
            self._crossed = False
            what = "no SPEED since a CALL or its RETURN"
            self.remark(line, f"{what}: whether that keeps the speed is not confirmed")
        setting = self._once or self._always
        if straight and setting != self._straight:
            self._straight = setting
            if setting[1] == "%":
                self.remark(line, "a straight motion with its SPEED in percent: mm/s by post.rated")

    def _check_posture(self, line: int, straight: bool, posed: bool) -> None:
        """Adds findings for a posture that the text leaves open or that the options exclude."""
        self._unused.clear()
        if self.settings.posture:
            if not straight and "MOVE" not in self._stated:
                self._compare_posture(line)
        elif posed and self._restated is not None:
            kept = {*(self._posture or NO_POSTURE).switches} - self._restated
            self._restated = None
            if kept:
                what = f"{', '.join(sorted(kept))} not set since a CALL or its RETURN"
                self.remark(line, f"{what}: whether that keeps the posture is not confirmed")
        if not straight:
            self._stated.add("MOVE")

    def _compare_posture(self, line: int) -> None:
        if {*(self._posture or NO_POSTURE).switches} != self.settings.posture:
            words_of_posture = ", ".join(sorted(self.settings.posture))
            self.remark(line, f"post.posture asks for {words_of_posture} before the first MOVE")

    def _count_axes(self, line: int, point: Joints) -> None:
        """Checks that a precision point has as many joints as those before."""
        count = len(point.values)
        if self.axes and count != self.axes:
            self.fault(line, f"a precision point of {count} axes, others have {self.axes}")
        self.axes = self.axes or count

    def brake(self, statement: Statement) -> None:
        """Runs `BREAK`: the motion comes to its end."""
        if statement.rest:
            raise Unreadable("BREAK stands alone")
        self.rest()

    def speed(self, statement: Statement) -> None:
        """Runs all forms of `SPEED`."""
        line, text = statement.line, statement.rest
        value, unit, turning, always = parse_plain_speed(text) or self._read(text, Expression.speed)
        if turning > 100 or (value > 100 and unit != "mm/s"):
            self.remark(line, "SPEED above 100 %: the controller takes the most that it has")
        if not always and unit != "MONITOR":
            self.remark(line, "SPEED without ALWAYS holds for one motion")
        if _DISORDERED.search(text):
            self.remark(line, "ALWAYS stands last in a SPEED: another order is not confirmed")
        self._crossed = self._crossed and not (always and unit != "MONITOR")
        if unit == "MONITOR":
            self.remark(line, "SPEED MONITOR sets the operator's speed, for other programs too")
        self.set_speed(value, unit, turning, always)

    def configure(self, statement: Statement) -> None:
        """Runs a posture word. It holds from the next motion on and replaces its opposite."""
        if statement.rest:
            raise Unreadable(f"{statement.word} {statement.rest[:30]} is not evaluated")
        if statement.word in _SIX_AXIS_ONLY:
            self.bent[statement.line] = statement.word
        self.set_posture(statement.word)
        self._unused[statement.line] = statement.word
        if self._restated is not None:
            self._restated.add(statement.word)
        if self.settings.posture and "MOVE" in self._stated:
            self._compare_posture(statement.line)

    def accel(self, statement: Statement) -> None:
        """Runs `ACCEL`. Values that are not those of the options are a finding.

        They are not part of an instruction.
        """
        profile = _PROFILE.match(statement.rest)
        if profile and int(profile[1]) > 8:
            raise Unreadable(f"ACCEL has profiles 0 to 8, not {profile[1]}")
        values = self._read(statement.rest[profile.end() if profile else 0 :], Expression.reals)
        if len(values) > 2:
            raise Unreadable("ACCEL has two percentages")
        self._stated.add("ACCEL")
        wanted, percent = self.settings.profile, self.settings.acceleration
        if profile is None:
            self.remark(statement.line, "ACCEL without a profile keeps that of the program before")
        differences = [abs(value - percent) for value in values]
        is_same = len(values) == 2 and max(differences) <= _SAME_SHARE
        if (profile and int(profile[1]) != wanted) or not is_same:
            what = f"ACCEL other than ({wanted}) {percent:g}, {percent:g}"
            effect = "corners and the time of the program are others"
            self.remark(statement.line, f"{what}: {effect}")

    def switch(self, statement: Statement) -> None:
        """Runs `ENABLE CP` or `DISABLE CP`."""
        if statement.rest.upper() != "CP":
            raise Unreadable(f"{statement.word} {statement.rest[:20]} is not evaluated")
        self._path = statement.word == "ENABLE"
        if not self._path:
            what = "DISABLE CP: every motion stops, those of the programs after this one too"
            self.remark(statement.line, what)
        self._stated.add("ENABLE CP")

    def set_accuracy(self, statement: Statement) -> None:
        """Runs `COARSE`, `FINE`, `NULL` or `NONULL`.

        The accuracy of a stop is not part of an instruction.
        """
        form = _SETTLING.fullmatch(statement.rest)
        numbered = statement.word in ("COARSE", "FINE")
        if form is None or (form[1] and not (numbered and float(form[1]) > 0)):
            raise Unreadable(f"{statement.word} {statement.rest[:30]} is not evaluated")
        what = "sets how exactly the robot stops, which camgen never writes"
        self.remark(statement.line, f"{statement.word} {what}")

    def select(self, statement: Statement) -> None:
        """Runs `SELECT ROBOT = 1`, the robot that a program has by default."""
        if not _ROBOT.fullmatch(statement.rest):
            raise Unreadable(f"SELECT {statement.rest[:30]} is not evaluated")
        if "ATTACH" in self._stated and not self._detached:
            what = "SELECT ROBOT after ATTACH, which took the robot that was selected before"
            self.remark(statement.line, what)
        self._stated.add("SELECT ROBOT")

    def set_tool(self, statement: Statement) -> None:
        """Runs `TOOL`. A program has one tool."""
        self._stated.add("TOOL")
        location = read_whole(statement.rest, self, Expression.location)
        external = location.frame.external
        tool = None if external else location.in_base()
        changed = external != self.tool_name or not is_same(tool, self.tool)
        self.tool, self.tool_name = tool, external
        if changed and self._last is not None:
            self._at = None
            raise Unreadable("the tool changes between motions")

    def base(self, statement: Statement) -> None:
        """Runs `BASE`, which stops the path. Raises Unreadable if it moves the world frame."""
        values = self._read(statement.rest, Expression.reals)
        self.rest()
        self.remark(statement.line, "BASE sets the world frame, for other programs too")
        if any(values):
            raise Unreadable("BASE moves the world frame, which is not evaluated")

    # -- signals and robot

    def signal(self, statement: Statement) -> None:
        """Runs `SIGNAL`. Each number is an output."""
        values = self._read(statement.rest, Expression.reals)
        for value in values:
            number = abs(value)
            if number not in _OUTPUTS:
                raise Impossible(f"{value:g} is not an output")
        self._standing(statement, "an output")
        for value in values:
            name = self.settings.signals.get(int(abs(value)), f"signal {abs(value):g}")
            self.add(statement.line, Output(name, float(value > 0)))

    def wait_event(self, statement: Statement) -> None:
        """Runs `WAIT.EVENT , s`, a dwell."""
        event, comma, seconds = statement.rest.partition(",")
        if event.strip() or not comma:
            raise Unreadable("WAIT.EVENT with an event is not evaluated")
        self._pause(statement, seconds)

    def stop(self, statement: Statement) -> None:
        """Runs `PAUSE`, which waits for the operator."""
        if statement.rest:
            raise Unreadable("PAUSE stands alone")
        self._standing(statement, "PAUSE")
        self.add(statement.line, Stop())

    def delay(self, statement: Statement) -> None:
        """Runs `DELAY` as a dwell, and refuses it."""
        what = "DELAY is uncertain: it delays the next motion; WAIT.EVENT , s is a dwell"
        self.fault(statement.line, what)
        self._pause(statement, statement.rest)

    def _pause(self, statement: Statement, text: str) -> None:
        seconds = self._read(text, Expression.real)
        if seconds <= 0:
            raise Impossible("a dwell must be positive")
        self._standing(statement, "a dwell")
        self.add(statement.line, Wait(seconds))

    def _standing(self, statement: Statement, what: str) -> None:
        """Checks that the robot stands still and is attached."""
        line = statement.line
        if self._moving:
            self.fault(line, f"{what} while the robot may still move: BREAK is missing before it")
        if self._detached:
            self.remark(line, f"{what} after DETACH: the robot may be another program's by then")

    def attach(self, statement: Statement) -> None:
        """Runs `ATTACH`: the program gets the robot."""
        self._check_brackets(statement, f"ATTACH {statement.rest[:30]}")
        self._stated.add("ATTACH")
        self._detached = False

    def detach(self, statement: Statement) -> None:
        """Runs `DETACH`. The robot must stand still, and nothing may move it afterwards."""
        self._check_brackets(statement, "DETACH of a device")
        self._standing(statement, "DETACH")
        self._detached = True

    def _check_brackets(self, statement: Statement, name: str) -> None:
        if statement.rest.replace(" ", "") not in ("", "()"):
            raise Unreadable(f"{name} is not evaluated")
        if not statement.rest:
            what = "without (): what that means is not confirmed"
            self.remark(statement.line, f"{statement.word} {what}")
