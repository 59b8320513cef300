"""Runs the motions, settings and outputs of third-party V+ programs.

Sources: V+ Language Reference and User's Guide as docs/posts/vplus.md and docs/languages/vplus.md
quote them. A motion does not block, and blends into the next one unless BREAK is between them.
SPEED without ALWAYS is for one motion; it is 100 % at the start. OPEN and CLOSE act with the next
motion, OPENI and CLOSEI after the last one.
"""

from __future__ import annotations

import math
import re
from itertools import repeat
from typing import NamedTuple

from camgen.lang.log import Log
from camgen.lang.programs import RunRequest
from camgen.model.pose import Pose, compute_zyz, translation
from camgen.model.program import Instruction, Joints, Output, Stop, Wait

from .arm import ROUNDED, is_same
from .asked import MAX_SIGNAL, RATED, ExternalState
from .effects import SILENT_SWITCHES
from .functions import truth
from .locations import (
    Expression,
    describe,
    describe_any,
    make_external,
    read_whole,
    to_joints,
    to_values,
)
from .text import (
    NULL,
    Frame,
    Impossible,
    Location,
    SpeedSetting,
    Statement,
    Stretch,
    Unreadable,
    parse_plain_speed,
    rotation_zyz,
)

#: deg/s: assumed reorientation speed at 100 % rotational speed.
RATED_ROTATION = 1200.0
#: Name of the output of the hand. Its signal numbers are set on the controller.
HAND = "hand.open"
#: Range of valid speeds, % or mm/s, and maximum duration of a motion, s.
_MIN, _MAX = 1e-6, 1e6
_HERE = re.compile(r"(?<![\w.])HERE(?![\w.])", re.IGNORECASE)
_START = "HERE at the start"
_START_UNKNOWN = (
    "where the robot stands at the start is not known: "
    "what refers to it is given in a frame of that name"
)


class Tool(NamedTuple):
    """A tool.

    name: its name in the text, empty without one.
    pose: flange_from_tool, None if it is stored on the controller alone.
    """

    name: str
    pose: Pose | None


class Robot(ExternalState):
    """The robot during a run.

    Methods with a `Statement` run it, and raise Unreadable if that is impossible.

    bases: BASE in force at each instruction of the body, None for the base of the robot.
    tools: all tools that were used.
    tool: index in `tools` of the tool in force at each instruction of the body.
    detached: the program has released the robot.
    """

    def __init__(self, request: RunRequest, log: Log) -> None:
        super().__init__(request, log)
        self.bases: list[Pose | None] = []
        self.tools: list[Tool] = [Tool("", None)]
        self.tool: list[int] = []
        self._held = 0
        self._base: Pose | None = None
        self._flange = request.find_flange
        self._once_exact = False
        self._hand: float | None = None
        self.detached = False

    # -- position -----------------------------------------------------------------------------

    def current_location(self, word: str) -> Location:
        """See `Variables.current_location`. HERE and DEST are the target of the last motion."""
        if word == "TOOL":
            tool = self.tools[self._held]
            if tool.pose is None:
                return make_external(f"TOOL {tool.name}".strip())
            return Location(tool.pose)
        if word == "BASE":
            return Location(self._base or NULL)
        if isinstance(self._at, Joints):
            return self._reach(self._at)
        if self._at is None:
            self.log.assume(_START_UNKNOWN)
            return make_external(_START)
        return self._at

    def _reach(self, joints: Joints) -> Location:
        """Return the location of joint values. It is external if the arm or the tool is unknown."""
        flange = self._flange(joints.values)
        tool = self.tools[self._held].pose if self._held else NULL
        if flange is None or tool is None:
            return make_external(f"#PPOINT({','.join(f'{v:.6g}' for v in to_values(joints))})")
        return Location((self._base or NULL).inverse() @ flange @ tool)

    def current_point(self, word: str) -> Joints | Location:
        """See `Variables.current_point`."""
        if not isinstance(self._at, Joints):
            return make_external(f"#{describe_any(self.current_location(word))}")
        return self._at

    def check_here(self, text: str) -> None:
        """Add a finding if the text uses HERE while the robot still moves."""
        if self._moving and "HERE" in text.upper() and _HERE.search(text):
            what = "HERE while the robot may still move: BREAK is missing"
            self.log.find("unusual", f"{what}; the end of that motion is taken")

    # -- motions ------------------------------------------------------------------------------

    def move(self, statement: Statement) -> None:
        """Run `MOVE` or `MOVES`; `MOVET` or `MOVEST`, which move the hand too."""
        self.check_here(statement.rest)
        text = Expression(statement.rest, self)
        target = text.operand()
        if "T" in statement.word:
            text.expect(",")
            self._hand = float(text.logic() != 0)
        text.finish()
        self.go(target, "S" in statement.word)

    def jmove(self, statement: Statement) -> None:
        """Run `JMOVE`, a motion to joint values."""
        values = read_whole(statement.rest, self, Expression.numbers)
        if len(values) > 12:
            raise Unreadable(f"JMOVE to {len(values)} joints")
        self.go(to_joints(values), straight=False)

    def appro(self, statement: Statement) -> None:
        """Run `APPRO` or `APPROS`: to a distance from a location, backwards along its z axis."""
        text = Expression(statement.rest, self)
        target = text.operand()
        text.expect(",")
        distance = text.logic()
        text.finish()
        if isinstance(target, Joints):
            target = self._reach(target)
        self.go(target.moved(translation(0, 0, -distance)), statement.word == "APPROS")

    def depart(self, statement: Statement) -> None:
        """Run `DEPART` or `DEPARTS`: backwards along the tool axis from the last target."""
        distance = read_whole(statement.rest, self, Expression.logic)
        target = self.current_location("DEST").moved(translation(0, 0, -distance))
        self.go(target, statement.word == "DEPARTS")

    def drive(self, statement: Statement) -> None:
        """Run `DRIVE joint, change, speed`, which moves one joint."""
        text = Expression(statement.rest, self)
        joint = text.logic()
        text.expect(",")
        change = text.logic()
        speed = text.after(",", text.logic, 100.0)
        text.finish()
        if not (1 <= joint <= 12 and joint == int(joint)):
            raise Impossible(f"DRIVE of joint {joint:g}")
        if not 0 < speed <= 1000:
            raise Impossible(f"DRIVE at {speed:g} %")
        self._once = (speed, "%", 100.0)
        if isinstance(self._at, Joints) and joint <= len(self._at.values):
            values = to_values(self._at)
            values[int(joint) - 1] += change
            self.go(to_joints(values), straight=False)
        else:
            self._go_external(
                f"{describe_any(self.current_location('DEST'))}, joint {joint:g} by {change:g}"
            )

    def move_external(self, statement: Statement) -> None:
        """Run `READY`, `NEST` or `ALIGN`, whose target the controller computes."""
        if statement.word == "ALIGN":
            self._go_external(f"ALIGN of {describe_any(self.current_location('DEST'))}")
        else:
            self._go_external(statement.word)

    def _go_external(self, name: str) -> None:
        self.log.assume(f"{name}: a place that only the controller works out")
        self.go(make_external(name), straight=False)

    def lose_position(self, name: str) -> None:
        """Note a motion that is not evaluated, so that the position is unknown."""
        self._at, self._moving = make_external(f"after {name}"), True

    def go(self, target: Location | Joints, straight: bool) -> None:
        """Add a motion with the settings in force."""
        if self.detached:
            self.log.find(
                "refused", "a motion after DETACH: the robot is not attached to this program"
            )
            self.detached = False  # one finding is enough
        if self._hand is not None:
            self._switch_hand(self._hand)
        blend = ROUNDED if self._path and not self._once_exact else 0.0
        self._once_exact = False
        is_linear = straight and isinstance(target, Location)
        share = 0.0 if is_linear else self._share(self._once or self._always)
        self.travel(self.line, target, straight, blend, share)

    def try_stretch(self, plain: Stretch) -> bool:
        """Add consecutive motions at once. Returns False if a setting forbids it."""
        frame = self.frame(plain.name)
        if (
            frame is None
            or self.detached
            or self._hand is not None
            or self._once is not None
            or self._once_exact
        ):
            return False
        self.follow(plain, frame, 0.0 if plain.word == "MOVES" else self._share(self._always))
        self.bases += repeat(self._base, len(plain.poses))
        self.tool += repeat(self._held, len(plain.poses))
        return True

    def _share(self, setting: SpeedSetting) -> float:
        return min(1.0, setting[0] / 100 * self._monitor) if setting[1] == "%" else 0.0

    def add(self, line: int, item: Instruction, frame: Frame | None = None) -> None:
        """Add an instruction, with the base and tool in force."""
        super().add(line, item, frame)
        self.bases.append(self._base)
        self.tool.append(self._held)

    # -- stops and waits ----------------------------------------------------------------------

    def brake(self, statement: Statement) -> None:
        """Run `BREAK`, or `BRAKE`, which ends a motion at once."""
        if statement.rest:
            self.log.find("unusual", f"{statement.word} stands alone")
        self.rest()

    def pause(self, seconds: float) -> None:
        """Add a wait, s."""
        if not 0 <= seconds <= 1e7:
            raise Impossible(f"{seconds:g} s is not a time to wait")
        self.rest()
        self.clock += seconds
        if seconds:
            self.add(self.line, Wait(seconds))

    def delay(self, statement: Statement) -> None:
        """Run `DELAY`, a wait of some seconds."""
        self.pause(read_whole(statement.rest, self, Expression.logic))

    def stop(self, _: Statement) -> None:
        """Run `PAUSE`, which waits for the operator."""
        self.rest()
        self.add(self.line, Stop())

    # -- settings -----------------------------------------------------------------------------

    def speed(self, statement: Statement) -> None:
        """Run all forms of `SPEED`."""
        value, unit, turning, always = parse_plain_speed(statement.rest) or self._read_speed(
            statement.rest
        )
        if min(value, turning) < _MIN or max(value, turning) > _MAX:
            raise Impossible(f"a speed of {value:g} is beyond that of any arm")
        self.set_speed(value, unit, turning, always)
        if unit == "MONITOR":
            self.log.fact("monitor speed", f"{min(value, 100.0):g} %")
        if unit == "%":
            self.log.fact("speed", f"100 % is assumed to be {RATED:g} mm/s of the TCP")

    def _read_speed(self, rest: str) -> tuple[float, str, float, bool]:
        try:
            return read_whole(rest, self, Expression.speed)
        except Impossible:
            if self.doubt:  # an assumed value, which is not a valid speed
                return 100.0, "%", 100.0, "ALWAYS" in rest.upper()
            raise

    def duration(self, statement: Statement) -> None:
        """Run `DURATION`: minimum time of the next motion, s, or with `ALWAYS` of all."""
        text = Expression(statement.rest, self)
        seconds = text.logic()
        always = text.accept("ALWAYS")
        text.finish()
        if not 0 <= seconds <= _MAX:
            raise Impossible(f"a motion in {seconds:g} s")
        self._lasts_once = seconds
        if always:
            self._lasts_always, self._lasts_once = seconds, 0.0

    def configure(self, statement: Statement) -> None:
        """Run a posture word, see `set_posture`."""
        if statement.rest and statement.rest.upper() != "ALWAYS":
            raise Unreadable(f"{statement.word} stands alone or with ALWAYS")
        self.log.fact("posture", statement.word)
        self.set_posture(statement.word)

    def set_accuracy(self, statement: Statement) -> None:
        """Run `COARSE`, `FINE`, `NULL` or `NONULL`: the accuracy of stops."""
        text = Expression(statement.rest, self)
        if text.peek() not in ("", "ALWAYS"):
            text.logic()
        text.accept("ALWAYS")
        text.finish()
        self.log.omit(f"{statement.word}: how exactly a motion stops")

    def path(self, statement: Statement) -> None:
        """Run `CPON` or `CPOFF`: blends, for one motion or always."""
        if statement.rest.upper() not in ("", "ALWAYS"):
            raise Unreadable(f"{statement.word} stands alone or with ALWAYS")
        if statement.rest:
            self._path = statement.word == "CPON"
        else:
            self._once_exact = statement.word == "CPOFF"

    def switch(self, statement: Statement) -> None:
        """Run `ENABLE` or `DISABLE` of switches."""
        on = statement.word == "ENABLE"
        for part in statement.rest.split(","):
            name = "".join(part.split()).lower()
            if not name:
                raise Unreadable(f"{statement.word} wants the name of a switch")
            self.set_switch(statement.word, name, on)

    def set_switch(self, word: str, name: str, on: bool) -> None:
        """Set a switch of the controller. word: the instruction that sets it."""
        self.switches[name] = truth(on)
        if name == "cp":
            self._path = on
        elif name == "dry.run" and on:
            self.log.find("unusual", "DRY.RUN: the robot does not move while it is on")
        elif name not in SILENT_SWITCHES:
            self.log.omit(f"{word} {name}: a switch of the controller")
        if name == "power":
            self.rest()

    def set_tool(self, statement: Statement) -> None:
        """Run `TOOL`; without a location the tool is the flange."""
        location = read_whole(statement.rest or "NULL", self, Expression.location)
        external = location.frame.external
        if external:
            tool = Tool(external, None)
        else:
            name = statement.rest.lower()
            is_name = name != "null" and name.replace(".", "").replace("_", "").isalnum()
            tool = Tool(name if is_name else "", location.in_base())
        self.rest()
        for index, known in enumerate(self.tools):
            if known.name == tool.name and is_same(known.pose, tool.pose):
                self._held = index
                return
        self.tools.append(tool)
        self._held = len(self.tools) - 1

    def base(self, statement: Statement) -> None:
        """Run `BASE dx, dy, dz, turn`, which moves the base of the robot in mm and degrees."""
        self.rest()
        if statement.rest.upper() in ("", "NULL"):
            self._base = None
            return
        values = read_whole(statement.rest, self, Expression.reals)
        if len(values) > 4:
            raise Unreadable(f"BASE has {len(values)} values, at most four")
        x, y, z, turn = values + [0.0] * (4 - len(values))
        # Poses in the moved world frame are given in the base of the robot by the inverse.
        moved = Pose(rotation_zyz(turn, 0.0, 0.0), (x, y, z))
        self._base = moved.inverse() if any(values) else None

    # -- signals and hand ---------------------------------------------------------------------

    def signal(self, statement: Statement) -> None:
        """Run `SIGNAL`, which sets one output per number."""
        for value in read_whole(statement.rest, self, Expression.numbers):
            number = abs(value)
            if number != int(number) or number > MAX_SIGNAL:
                if self.doubt:
                    continue
                raise Impossible(f"{value:g} is not an output")
            if number:
                self._output(int(number), value > 0)

    def _output(self, number: int, on: bool) -> None:
        self.budget.spend()
        if 1000 < number <= 2000:
            self.log.find("unusual", f"SIGNAL {number}: numbers 1001 to 2000 are inputs")
        elif self._moving and number <= 1000 and self.outputs.get(number) != on:
            what = (
                f"signal {number} switches while the motion before it still runs: BREAK is missing"
            )
            self.log.find("dangerous", what)
        self.outputs[number] = on
        self.rest_for_output()
        self.add(self.line, Output(str(number), float(on)))

    def rest_for_output(self) -> None:
        """End the last motion without a blend: an output is set at its target.

        The robot may still move there, unlike after a BREAK.
        """
        moving = self._moving
        self.rest()
        self._moving = moving

    def set_bits(self, statement: Statement) -> None:
        """Run `BITS first, count = value`."""
        text = Expression(statement.rest, self)
        first = text.logic()
        count = text.after(",", text.logic, 1.0)
        text.expect("=")
        value = text.logic()
        text.finish()
        if not (0 < first <= MAX_SIGNAL and 0 < count <= 32 and abs(value) < 2**32):
            raise Impossible("BITS of signals that do not exist")
        for k in range(int(count)):
            self._output(int(first) + k, bool(int(value) >> k & 1))

    def reset(self, _: Statement) -> None:
        """Run `RESET`: switch off all outputs that the text has switched on."""
        self.log.fact("outputs", "RESET switches off those that the text has switched on")
        for number in [n for n, on in self.outputs.items() if on and n <= 1000]:
            self._output(number, on=False)

    def hand(self, statement: Statement) -> None:
        """Run `OPEN` or `CLOSE`, at the next motion; `OPENI` or `CLOSEI`, after the last one."""
        word = statement.word
        if statement.rest:
            Expression(statement.rest, self).logic()
        value = float(word.startswith("OPEN"))
        if word.startswith("RELAX"):
            self.log.fact("hand", f"{word}: neither opened nor closed")
        elif word.endswith("I"):
            self.rest()
            self._switch_hand(value)
            if seconds := self.parameters.get("hand.time", 0.0):
                self.pause(min(abs(seconds), 1e4))
        else:
            self._hand = value

    def _switch_hand(self, value: float) -> None:
        self._hand = None
        self.rest_for_output()
        self.add(self.line, Output(HAND, value))

    def forget(self) -> None:
        """Delete all instructions and the state of the robot."""
        del self.body[:], self.lines[:], self.frames[:], self.bases[:], self.tool[:], self.tools[1:]
        self.durations.clear()
        self._last, self._hand, self._held = None, None, 0
        self._moving = self.detached = False

    def decompose(self, statement: Statement) -> None:
        """Run `DECOMPOSE array[first] = location`, which assigns its components to elements."""
        name, sign, rest = statement.rest.partition("=")
        if not sign:
            raise Unreadable("DECOMPOSE wants array[] = location")
        left = Expression(name, self)
        array = left.take()
        start = left.subscripts() or "[0]"
        left.finish()
        self.check_here(rest)
        target = read_whole(rest, self, Expression.operand)
        *front, first = start[1:-1].split(",")
        for k, value in enumerate(self._list_components(target)):
            subscripts = ",".join([*front, str(int(first) + k)])
            self.doubt = value is None
            self.assign(f"{array}[{subscripts}]", 0.0 if value is None else value)

    def _list_components(self, target: Location | Joints) -> list[float | None]:
        if isinstance(target, Joints):
            return [*to_values(target)]
        if target.frame.external:
            self.log.assume(f"the values of {describe(target)} are assumed to be 0")
            return [None] * 6
        pose = target.in_base()
        yaw, pitch, roll = (math.degrees(v) + 0.0 for v in compute_zyz(pose.rotation))
        return [*pose.origin, yaw, pitch, roll]
