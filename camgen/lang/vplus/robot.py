"""The robot of a foreign V+ program: where it goes, how fast, with which tool, and what it switches.

Sources: V+ Language Reference and User's Guide as docs/posts/vplus.md and docs/languages/vplus.md quote them. Motions
do not block and run into each other unless BREAK stands between them; SPEED without ALWAYS is for one motion; 100 % at
the start; OPEN and CLOSE act with the next motion, OPENI and CLOSEI after the last one.
"""

from __future__ import annotations

import math
import re
from itertools import repeat
from typing import NamedTuple

from camgen.lang.log import Log
from camgen.lang.programs import Ask
from camgen.model.pose import Pose, translation, zyz
from camgen.model.program import Instruction, Joints, Output, Stop, Wait

from . import words
from .arm import ROUNDED, is_same
from .asked import MOST_SIGNAL, RATED, Surroundings
from .effects import SILENT_SWITCHES
from .locations import Expression, describe, to_joints, to_values, unknown
from .text import (
    NULL,
    Frame,
    Impossible,
    Location,
    Pace,
    Statement,
    Stretch,
    Unreadable,
    pace,
    rotation_zyz,
)

#: What 100 % rotational speed is taken to be, deg/s.
RATED_TURN = 1200.0
#: The output of the hand: its numbers are set on the controller.
HAND = "hand.open"
#: Speeds, % or mm/s, that somebody can mean.
_LEAST, _MOST = 1e-6, 1e6
_HERE = re.compile(r"(?<![\w.])HERE(?![\w.])", re.IGNORECASE)
_START = "HERE at the start"


class Tool(NamedTuple):
    """A tool by the name that the text gives it. pose: None where only the controller knows it."""

    name: str
    pose: Pose | None


class Robot(Surroundings):
    """What the robot does, while a text is carried out. bases: by instruction the base that was in force. tools, tool:
    those used, and by instruction the place of the one in force. Methods with a ``Statement`` carry it out; Unreadable
    when they cannot.
    """

    def __init__(self, ask: Ask, log: Log) -> None:
        super().__init__(ask, log)
        self.bases: list[Pose | None] = []
        self.tools: list[Tool] = [Tool("", None)]
        self.tool: list[int] = []
        self._held = 0
        self._base: Pose | None = None
        self._flange = ask.flange
        self._once_exact = False
        self._hand: float | None = None
        self.detached = False

    # -- where it is ---------------------------------------------------------------------------------------------

    def here(self, word: str) -> Location:
        """HERE and DEST: where the last motion goes; TOOL and BASE."""
        if word == "TOOL":
            tool = self.tools[self._held]
            return (
                unknown(f"TOOL {tool.name}".strip()) if tool.pose is None else Location(tool.pose)
            )
        if word == "BASE":
            return Location(self._base or NULL)
        if isinstance(self._at, Joints):
            return self._reach(self._at) or unknown(_spell(self._at))
        if self._at is None:
            self._from_start()
            return unknown(_START)
        return self._at

    def _reach(self, joints: Joints) -> Location | None:
        """Where joint values lead, where the arm and the tool are known."""
        flange = self._flange(joints.values) if self._flange is not None else None
        tool = self.tools[self._held].pose if self._held else NULL
        if flange is None or tool is None:
            return None
        return Location((self._base or NULL).inverse() @ flange @ tool)

    def point_here(self, word: str) -> Joints | Location:
        """The same as joint values."""
        if not isinstance(self._at, Joints):
            return unknown(f"#{describe_any(self.here(word))}")
        return self._at

    def check_here(self, text: str) -> None:
        """A remark on a place that is taken while the robot moves on."""
        if self._moving and "HERE" in text.upper() and _HERE.search(text):
            what = "HERE while the robot may still move: BREAK is missing; the end of that motion is taken"
            self.log.find("unusual", what)

    def _from_start(self) -> None:
        what = "where the robot stands at the start is not known: what refers to it is given in a frame of that name"
        self.log.assume(what)

    # -- motions -------------------------------------------------------------------------------------------------

    def target(self, text: Expression) -> Location | Joints:
        """The target of a motion."""
        return text.any_point() if text.peek()[:1] == "#" else text.location()

    def move(self, statement: Statement) -> None:
        """``MOVE``, ``MOVES``, and with the hand ``MOVET``, ``MOVEST``."""
        self.check_here(statement.rest)
        text = Expression(statement.rest, self)
        target = self.target(text)
        if "T" in statement.word:
            text.expect(",")
            self._hand = 1.0 if text.logic() != 0 else 0.0
        text.finish()
        self.go(target, "S" in statement.word)

    def jmove(self, statement: Statement) -> None:
        """``JMOVE``: joint values."""
        text = Expression(statement.rest, self)
        values = text.numbers()
        text.finish()
        if len(values) > 12:
            raise Unreadable(f"JMOVE to {len(values)} joints")
        self.go(to_joints(values), straight=False)

    def appro(self, statement: Statement) -> None:
        """To the point so many mm back along the tool z of a location."""
        text = Expression(statement.rest, self)
        target = self.target(text)
        text.expect(",")
        distance = text.logic()
        text.finish()
        place = (
            (self._reach(target) or unknown(_spell(target)))
            if isinstance(target, Joints)
            else target
        )
        self.go(place.moved(translation(0, 0, -distance)), statement.word == "APPROS")

    def depart(self, statement: Statement) -> None:
        """Back along the tool z from where the last motion went."""
        text = Expression(statement.rest, self)
        distance = text.logic()
        text.finish()
        self.go(self.here("DEST").moved(translation(0, 0, -distance)), statement.word == "DEPARTS")

    def drive(self, statement: Statement) -> None:
        """``DRIVE joint, change, speed``: one joint."""
        text = Expression(statement.rest, self)
        joint = text.logic()
        text.expect(",")
        change = text.logic()
        speed = text.logic() if text.accept(",") else 100.0
        text.finish()
        if not (1 <= joint <= 12 and joint == int(joint)):
            raise Impossible(f"DRIVE of joint {joint:g}")
        if not 0 < speed <= 1000:
            raise Impossible(f"DRIVE at {speed:g} %")
        self._once = (speed, "%", 100.0)
        where = self._at
        if isinstance(where, Joints) and joint <= len(where.values):
            values = to_values(where)
            values[int(joint) - 1] += change
            self.go(to_joints(values), straight=False)
        else:
            self._somewhere(f"{describe_any(self.here('DEST'))}, joint {joint:g} by {change:g}")

    def elsewhere(self, statement: Statement) -> None:
        """``READY``, ``NEST``, ``ALIGN``: to a place that the controller works out."""
        if statement.word == "ALIGN":
            self._somewhere(f"ALIGN of {describe_any(self.here('DEST'))}")
        else:
            self._somewhere(statement.word)

    def _somewhere(self, name: str) -> None:
        self.log.assume(f"{name}: a place that only the controller works out")
        self.go(unknown(name), straight=False)

    def lost(self, name: str) -> None:
        """A motion that is not evaluated: nobody knows where the robot is."""
        self._at, self._moving = unknown(f"after {name}"), True

    def go(self, target: Location | Joints, straight: bool) -> None:
        """A motion to a place."""
        if self.detached:
            self.log.find(
                "refused", "a motion after DETACH: the robot is not attached to this program"
            )
            self.detached = False  # told once
        if self._hand is not None:
            self._switch_hand(self._hand)
        blend = ROUNDED if self._path and not self._once_exact else 0.0
        self._once_exact = False
        share = (
            0.0
            if straight and isinstance(target, Location)
            else self._share(self._once or self._always)
        )
        self.travel(self.line, target, straight, blend, share)

    def stretch(self, plain: Stretch) -> bool:
        """The motions of a stretch at once, if the state is the usual one; else nothing is done."""
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

    def _share(self, setting: Pace) -> float:
        return min(1.0, setting[0] / 100 * self._monitor) if setting[1] == "%" else 0.0

    def add(self, line: int, item: Instruction, frame: Frame | None = None) -> None:
        """One more instruction."""
        super().add(line, item, frame)
        self.bases.append(self._base)
        self.tool.append(self._held)

    # -- standing still ------------------------------------------------------------------------------------------

    def brake(self, statement: Statement) -> None:
        """``BREAK``, and ``BRAKE``, which ends a motion where it is."""
        if statement.rest:
            self.log.find("unusual", f"{statement.word} stands alone")
        self.rest()

    def pause(self, seconds: float) -> None:
        """A dwell."""
        if not 0 <= seconds <= 1e7:
            raise Impossible(f"{seconds:g} s is no time to wait")
        self.rest()
        self.clock += seconds
        if seconds:
            self.add(self.line, Wait(seconds))

    def delay(self, statement: Statement) -> None:
        """``DELAY``: the robot stands for so long."""
        text = Expression(statement.rest, self)
        seconds = text.logic()
        text.finish()
        self.pause(seconds)

    def stop(self, _: Statement) -> None:
        """``PAUSE``: until the operator lets it proceed."""
        self.rest()
        self.add(self.line, Stop())

    # -- settings ------------------------------------------------------------------------------------------------

    def speed(self, statement: Statement) -> None:
        """All forms of ``SPEED``."""
        value, unit, turning, always = pace(statement.rest) or self._read_speed(statement.rest)
        if min(value, turning) < _LEAST or max(value, turning) > _MOST:
            raise Impossible(f"a speed of {value:g} is no arm's")
        self.set_pace(value, unit, turning, always)
        if unit == "MONITOR":
            self.log.fact("monitor speed", f"{min(value, 100.0):g} %")
        if unit == "%":
            self.log.fact("speed", f"100 % is taken for {RATED:g} mm/s of the TCP")

    def _read_speed(self, rest: str) -> tuple[float, str, float, bool]:
        try:
            return words.speed(Expression(rest, self))
        except Impossible:
            if self.doubt:  # an assumed value that is no speed
                return 100.0, "%", 100.0, "ALWAYS" in rest.upper()
            raise

    def duration(self, statement: Statement) -> None:
        """``DURATION``: the least time, s, of the next motion, with ``ALWAYS`` of all."""
        text = Expression(statement.rest, self)
        seconds = text.logic()
        always = text.accept("ALWAYS")
        text.finish()
        if not 0 <= seconds <= _MOST:
            raise Impossible(f"a motion in {seconds:g} s")
        self.set_duration(seconds, bool(always))

    def configure(self, statement: Statement) -> None:
        """A posture word: in force from the next motion on, and instead of the one that it excludes."""
        if statement.rest and statement.rest.upper() != "ALWAYS":
            raise Unreadable(f"{statement.word} stands alone or with ALWAYS")
        self.log.fact("posture", statement.word)
        self.set_posture(statement.word)

    def settle(self, statement: Statement) -> None:
        """``COARSE``, ``FINE``, ``NULL``, ``NONULL``: how exactly a motion stops."""
        text = Expression(statement.rest, self)
        if text.peek() not in ("", "ALWAYS"):
            text.logic()
        text.accept("ALWAYS")
        text.finish()
        self.log.omit(f"{statement.word}: how exactly a motion stops")

    def path(self, statement: Statement) -> None:
        """``CPON`` and ``CPOFF``."""
        if statement.rest.upper() not in ("", "ALWAYS"):
            raise Unreadable(f"{statement.word} stands alone or with ALWAYS")
        if statement.rest:
            self._path = statement.word == "CPON"
        else:
            self._once_exact = statement.word == "CPOFF"

    def switch(self, statement: Statement) -> None:
        """``ENABLE`` and ``DISABLE``; ``CP`` is the path."""
        on = statement.word == "ENABLE"
        for part in statement.rest.split(","):
            name = "".join(part.split()).lower()
            if not name:
                raise Unreadable(f"{statement.word} wants the name of a switch")
            self.set_switch(statement.word, name, on)

    def set_switch(self, word: str, name: str, on: bool) -> None:
        """A switch. word: the instruction that sets it."""
        self.switches[name] = -1.0 if on else 0.0
        if name == "cp":
            self._path = on
        elif name == "dry.run" and on:
            self.log.find("unusual", "DRY.RUN: the robot does not move while it is on")
        elif name not in SILENT_SWITCHES:
            self.log.omit(f"{word} {name}: a switch of the controller")
        if name == "power":
            self.rest()

    def set_tool(self, statement: Statement) -> None:
        """``TOOL``; without a location there is none."""
        text = Expression(statement.rest or "NULL", self)
        location = text.location()
        text.finish()
        name = (
            statement.rest.lower()
            if statement.rest.replace(".", "").replace("_", "").isalnum()
            else ""
        )
        name = "" if name == "null" else name
        tool = Tool(
            location.frame.external or name, None if location.frame.external else location.in_base()
        )
        self.rest()
        for place, known in enumerate(self.tools):
            if known.name == tool.name and is_same(known.pose, tool.pose):
                self._held = place
                return
        self.tools.append(tool)
        self._held = len(self.tools) - 1

    def base(self, statement: Statement) -> None:
        """``BASE dx, dy, dz, turn``: where the world frame is; it stops the path."""
        self.rest()
        if statement.rest.upper() in ("", "NULL"):
            self._base = None
            return
        text = Expression(statement.rest, self)
        values = text.reals()
        text.finish()
        if len(values) > 4:
            raise Unreadable(f"BASE has {len(values)} values, at most four")
        x, y, z, turn = values + [0.0] * (4 - len(values))
        # The base of the robot is moved: the world frame the other way.
        self._base = (
            Pose(rotation_zyz(turn, 0.0, 0.0), (x, y, z)).inverse() if any(values) else None
        )

    # -- signals and hand ----------------------------------------------------------------------------------------

    def signal(self, statement: Statement) -> None:
        """``SIGNAL``: each number one output."""
        text = Expression(statement.rest, self)
        values = text.numbers()
        text.finish()
        for value in values:
            number = abs(value)
            if number != int(number) or number > MOST_SIGNAL:
                if self.doubt:
                    continue
                raise Impossible(f"{value:g} is no output")
            if number:
                self._output(int(number), value > 0)

    def spend(self, count: int) -> None:
        """Counts what is done; nothing here."""

    def _output(self, number: int, on: bool) -> None:
        self.spend(1)
        if 1000 < number <= 2000:
            self.log.find("unusual", f"SIGNAL {number}: numbers 1001 to 2000 are inputs")
        elif self._moving and number <= 1000 and self.outputs.get(number) != on:
            what = (
                f"signal {number} switches while the motion before it still runs: BREAK is missing"
            )
            self.log.find("dangerous", what)
        self.outputs[number] = on
        self.rest_for_output()
        self.add(self.line, Output(str(number), 1.0 if on else 0.0))

    def rest_for_output(self) -> None:
        """The corner before an output is not rounded in what is told: an instruction switches where it stands."""
        moving = self._moving
        self.rest()
        self._moving = moving

    def set_bits(self, statement: Statement) -> None:
        """``BITS first, count = value``."""
        text = Expression(statement.rest, self)
        first = text.logic()
        count = text.logic() if text.accept(",") else 1.0
        text.expect("=")
        value = text.logic()
        text.finish()
        if not (0 < first <= MOST_SIGNAL and 0 < count <= 32 and abs(value) < 2**32):
            raise Impossible("BITS of signals that there are none of")
        for k in range(int(count)):
            self._output(int(first) + k, bool(int(value) >> k & 1))

    def reset(self, _: Statement) -> None:
        """``RESET``: all outputs off; those that the text names."""
        self.log.fact("outputs", "RESET switches off those that the text has switched on")
        for number in [n for n, on in self.outputs.items() if on and n <= 1000]:
            self._output(number, on=False)

    def hand(self, statement: Statement) -> None:
        """``OPEN`` and ``CLOSE`` with the next motion, ``OPENI`` and ``CLOSEI`` at once, after the last one."""
        word = statement.word
        if statement.rest:
            Expression(statement.rest, self).logic()
        value = 1.0 if word.startswith("OPEN") else 0.0
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
        """As if nothing had been done."""
        del self.body[:], self.lines[:], self.frames[:], self.bases[:], self.tool[:], self.tools[1:]
        self.durations.clear()
        self._last, self._moving, self._hand, self._held, self.detached = (
            None,
            False,
            None,
            0,
            False,
        )

    def finish(self) -> None:
        """The program ends: the robot stops, and a hand that waits for a motion acts no more."""
        self.rest()

    def decompose(self, statement: Statement) -> None:
        """``DECOMPOSE array[first] = location``: its parts, from an element on."""
        name, sign, rest = statement.rest.partition("=")
        if not sign:
            raise Unreadable("DECOMPOSE wants array[] = location")
        left = Expression(name, self)
        array = left.take()
        start = left.subscripts() or "[0]"
        left.finish()
        self.check_here(rest)
        text = Expression(rest, self)
        found = self.target(text)
        text.finish()
        *front, first = start[1:-1].split(",")
        for k, value in enumerate(self._parts(found)):
            where = ",".join([*front, str(int(first) + k)])
            self.doubt = value is None
            taken = 0.0 if value is None else value
            self.assign(f"{array}[{where}]", taken)

    def _parts(self, found: Location | Joints) -> list[float | None]:
        if isinstance(found, Joints):
            return [*to_values(found)]
        if found.frame.external:
            self.log.assume(f"the values of {describe(found)} are taken for 0")
            return [None] * 6
        pose = found.in_base()
        yaw, pitch, roll = (math.degrees(v) + 0.0 for v in zyz(pose.rotation))
        return [*pose.origin, yaw, pitch, roll]


def _spell(joints: Joints) -> str:
    return f"#PPOINT({','.join(f'{v:.6g}' for v in to_values(joints))})"


def describe_any(location: Location) -> str:
    """A location as a short text."""
    if location.frame.external:
        return describe(location)
    return location.name or "TRANS({:.6g},{:.6g},{:.6g},..)".format(*location.in_base().origin)
