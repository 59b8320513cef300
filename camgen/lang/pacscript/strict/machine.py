"""State of the controller while a PacScript program runs, and the settings of the program."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from camgen.lang.log import Log
from camgen.lang.programs import Level
from camgen.model.pose import Pose, Vec3
from camgen.model.program import Force, Instruction, MoveC, MoveJ, MoveL, Output, Wait

from .expected import Expected, judge_internal, judge_mark, judge_settings, read_expected
from .values import Either, Mps, Unreadable, Value, evaluate, speed
from .words import TYPES

#: Speed at 100 % if the options do not give it, mm/s. It is refused, except for joint motions.
_RATED = 1000.0
#: Blend of a pass mark, mm. The controller chooses how near `@P` and `@C` pass their target.
_BLENDS = {"@0": 0.0, "@E": 0.0, "@P": 1.0, "@C": 1.0}
#: Speed of `Mps(1)` by the unit of the controller, mm/s. The first one is used for an open unit.
UNITS = {"mm/s": 1.0, "m/s": 1000.0}
#: Indices of the questions for the unit of `Mps`, and whether it is a percentage.
_QUESTIONS = [0, 1]
#: Maximum relative difference of two equal speeds: single precision.
_SAME = 1e-6


@dataclass(slots=True)
class Machine:
    """State of the interpreter.

    rated: speed at 100 %, mm/s, 0 if the options do not give it.
    signals: name of a signal by number of its IO.
    rated_turn: speed of a reorientation at 100 %, deg/s.
    units: possible speeds of `Mps(1)`, mm/s: one if the unit is known, else all of `UNITS`.
    expected: options that the text must agree with.
    line: line of the statement that runs.
    armed: whether the program has the arm.
    given: whether the arm was given back.
    motor: whether the motor is on.
    moved: whether the program has moved.
    settled: whether nothing was set since the settings were last compared with the options.
    stated_external: ExtSpeed of the text, %, 0 without one.
    acceleration: acceleration and deceleration, %. Empty before them and after `Speed`.
    stated_internal: Speed of the text, % or by `Mps`, None without one.
    uses_internal: whether a motion runs at the internal speed.
    blends: blends of the pass marks so far, mm.
    figure: figure of the arm, None if the text does not state it.
    compares_mps: whether the text compares `Mps` with a percentage.
    questions: indices of the questions of the post that the text has asked before its first motion.
    only_off: whether all instructions so far switch an output or a force off. Posts write these
        before the questions.
    unused_forces: lines of `ForceParam` by table, for forces that are not on yet.
    passing: whether the last motion passes its target. The next statement may then run early.
    current_pose: last commanded pose, None if the text does not give it.
    internal: internal speed, % or by `Mps`.
    external: external speed, %.
    numbers: numbers of the tool and work frame.
    frames: poses of frames by kind and number.
    forces: force by table, N.
    table: table of the force that is on, None without one.
    scopes: values of variables by name, for each running procedure.
    types: types of declared variables by name, for each running procedure.
    arrays: values of array elements, by letter and index.
    body: N instructions.
    lines: (N,) line of each instruction.
    log: findings.
    speeds: cache of speeds by text, for the present values of the variables.
    """

    rated: float
    signals: Mapping[int, str]
    rated_turn: float = 500.0
    units: tuple[float, ...] = tuple(UNITS.values())
    expected: Expected = field(default_factory=lambda: read_expected({}))
    line: int = 0
    armed: bool = False
    given: bool = False
    motor: bool = True
    moved: bool = False
    settled: bool = False
    stated_external: float = 0.0
    acceleration: tuple[float, ...] = ()
    stated_internal: float | Mps | None = None
    uses_internal: bool = False
    blends: dict[str, float] = field(default_factory=dict)
    figure: int | None = None
    compares_mps: bool = False
    questions: list[int] = field(default_factory=list)
    only_off: bool = True
    unused_forces: dict[int, int] = field(default_factory=dict)
    passing: bool = False
    current_pose: Pose | None = None
    internal: float | Mps = 100.0
    external: float = 100.0
    numbers: dict[str, int] = field(default_factory=lambda: {"tool": 0, "work": 0})
    frames: dict[tuple[str, int], Pose] = field(default_factory=dict)
    forces: dict[int, Vec3] = field(default_factory=dict)
    table: int | None = None
    scopes: list[dict[str, Value]] = field(default_factory=lambda: [{}])
    types: list[dict[str, str]] = field(default_factory=lambda: [{}])
    arrays: dict[tuple[str, int], Value] = field(default_factory=dict)
    body: list[Instruction] = field(default_factory=list)
    lines: list[int] = field(default_factory=list)
    log: Log = field(init=False)
    speeds: dict[str, float | Mps] = field(default_factory=dict)
    _open_unit: bool = False
    #: Last speed by `Mps` and its value in mm/s. Most motions have the speed of the one before.
    _last: tuple[Mps | None, float] = (None, 0.0)

    def __post_init__(self) -> None:
        self.log = Log(lambda: self.line)

    def fault(self, what: str) -> None:
        """Adds a refusal of the current line. Long quotations are shortened."""
        self.log.find("refused", what[:160])

    def remark(self, what: str) -> None:
        """Adds an unusual finding once."""
        self.log.find("unusual", what, once=what)

    def judge_settings(self) -> None:
        """Adds findings for settings that are not those of the options."""
        self.settled = True
        for what in judge_settings(
            self.expected, self.numbers, self.stated_external, self.acceleration
        ):
            self.remark(what)

    def judge_end(self) -> None:
        """Adds findings for settings at the end that are not those of the options."""
        if not self.moved:
            return
        if not self.settled:
            self.judge_settings()
        what = "" if self.uses_internal else judge_internal(self.expected, self.stated_internal)
        if what:
            self.remark(what)

    def check_questions(self) -> None:
        """Adds a finding for a speed by `unit` before both questions of the post."""
        if self.questions != _QUESTIONS:
            what = (
                "a speed that depends on the unit of Mps, and the questions of the post for it are"
            )
            self.remark(f"{what} not asked before")

    def internal_speed(self) -> float | Mps:
        """The internal speed, for a motion without a speed of its own."""
        self.uses_internal = True
        return self.internal

    def blend(self, mark: str) -> float:
        """The blend of a pass mark, mm."""
        blend = self.blends.get(mark)
        if blend is None:
            blend = self.blends[mark] = _BLENDS[mark] if mark in _BLENDS else float(mark[1:])
            if what := judge_mark(self.expected, mark):
                self.remark(what)
        return blend

    def lookup(self, key: str | tuple[str, int]) -> Value:
        """The value of a variable. Raises Unreadable if the text has not set it."""
        value = self.arrays.get(key) if isinstance(key, tuple) else self.scopes[-1].get(key)
        if value is None:
            if isinstance(key, tuple):
                raise Unreadable(f"{key[0].upper()}[{key[1]}] is not set in the text")
            raise Unreadable(f"unknown name {key}")
        return value

    def emit(self, item: Instruction) -> None:
        """Adds an instruction of the current line."""
        self.body.append(item)
        self.lines.append(self.line)

    def emit_motion(self, item: MoveJ | MoveL | MoveC, passing: bool) -> None:
        """Adds a motion.

        It is refused without the arm or with the motor off. The first one must be a joint motion.
        """
        if not self.armed:
            self.fault("a motion without TakeArm")
        if not self.moved and not isinstance(item, MoveJ):
            self.fault("the first motion is not Move P: where it starts is open")
        if not self.motor:
            self.fault("a motion with the motor off")
        if not self.settled:
            self.judge_settings()
        self._turn_into(item)
        self.moved, self.passing = True, passing
        self.current_pose = item.target if isinstance(item.target, Pose) else None
        self.emit(item)

    def _turn_into(self, item: MoveJ | MoveL | MoveC) -> None:
        """Updates the figure. A line and an arc must end in the figure in which they start."""
        figure = item.posture.figure if item.posture else None
        is_joint_motion = isinstance(item, MoveJ)
        if figure is not None and not is_joint_motion and self.figure not in (None, figure):
            what = f"from figure {self.figure} to {figure} along"
            if isinstance(item, MoveC):
                self.fault(f"{what} an arc")
            else:
                self.remark(f"{what} a line")
        keeps = is_joint_motion and figure is None and isinstance(item.target, Pose)
        self.figure = self.figure if keeps else figure

    def emit_still(self, item: Output | Wait | Force) -> None:
        """Adds an instruction that must not run before the arm has arrived."""
        name = _STILL[type(item)]
        if self.passing:
            self.fault(f"{name} after a motion that passes its target: it may come too early")
            self.passing = False
        self.only_off = self.only_off and not self.moved and _is_off(item)
        if self.questions and self.only_off:
            self.remark("an output or a force is put off after Mps is asked, not before")
        if not self.armed:
            self.remark(f"{name} {'after GiveArm' if self.given else 'before TakeArm'}")
        self.emit(item)

    def pressing(self) -> tuple[float, Vec3]:
        """Newtons and direction of the force that is on. All are 0 without one."""
        x, y, z = (0.0, 0.0, 0.0) if self.table is None else self.forces[self.table]
        newtons = math.hypot(x, y, z)
        if not newtons:
            return 0.0, (0.0, 0.0, 0.0)
        return newtons, (x / newtons, y / newtons, z / newtons)

    def speed_of(self, text: str) -> float | Mps:
        """The speed of an expression, for the present values of the variables."""
        value = self.speeds.get(text)
        if value is None:
            value = self.speeds[text] = speed(evaluate(text, self.lookup))
        return value

    def mm_per_second(self, value: float | Mps) -> float:
        """The product of an internal speed and the external speed, mm/s (manual)."""
        if isinstance(value, Mps):
            if isinstance(value.number, Either):
                self.check_questions()
            if value is not self._last[0]:
                self._last = value, self._choose_speed(self.by_unit(value))
            return self._last[1] * self.external / 100
        if not self.rated:
            self.fault(f"a speed in percent, taken of {_RATED:g} mm/s; give the option rated")
            self.rated = _RATED
        return value / 100 * self.rated * self.external / 100

    def joint_speed(self, value: float | Mps) -> tuple[float, float]:
        """The speed of a joint motion, mm/s, and its fraction of the maximum joint speeds.

        The fraction is 0 for a speed by `Mps`. Percentages refer to the joint speeds, so that the
        speed in mm/s is known only if the options give `rated`.
        """
        if isinstance(value, Mps):
            return self.mm_per_second(value), 0.0
        share = value / 100 * self.external / 100
        return share * (self.rated or _RATED), share

    def turning(self, value: float) -> float:
        """The speed of a reorientation, rad/s, by its internal speed, %."""
        return math.radians(value / 100 * self.external / 100 * self.rated_turn)

    def by_unit(self, value: Mps) -> list[float]:
        """The speed for each of `units`, mm/s."""
        if isinstance(value.number, Either):
            numbers = value.number.values
        else:
            numbers = (value.number,) * len(self.units)
        return [number * unit for number, unit in zip(numbers, self.units, strict=True)]

    def _choose_speed(self, speeds: list[float]) -> float:
        """The speed for the first unit, mm/s.

        A speed that depends on the unit of `Mps` is a finding once. It is refused if the text
        compares `Mps` with a percentage.
        """
        slowest, fastest = min(speeds), max(speeds)
        if fastest - slowest > _SAME * fastest and not self._open_unit:
            self._open_unit = True
            level: Level = "refused" if self.compares_mps else "unusual"
            numbers = " or ".join(f"{speed:g}" for speed in speeds)
            reason = "as the controller reads Mps in mm/s or in m/s; give the option mps"
            self.log.find(level, f"{numbers} mm/s, {reason}")
        return speeds[0]

    def enter(self, types: Mapping[str, str], values: list[Value]) -> None:
        """Starts a procedure with the values of its parameters."""
        self.scopes.append({})
        self.types.append(dict(types))
        for name, value in zip(types, values, strict=True):
            self.name(name, value)

    def leave(self) -> None:
        """Ends a procedure."""
        self.speeds.clear()
        self.scopes.pop()
        self.types.pop()

    def declare(self, name: str, kind: str) -> None:
        """Declares a name, both lower case."""
        if name in self.types[-1]:
            raise Unreadable(f"{name} is declared twice")
        if kind not in TYPES:
            raise Unreadable(f"{kind} is no type")
        self.types[-1][name] = kind

    def name(self, key: str | tuple[str, int], value: Value) -> None:
        """Sets a variable. Raises Unreadable if its type cannot hold the value."""
        self.speeds.clear()
        if isinstance(key, tuple):
            self.arrays[key] = value
            return
        kind = self.types[-1].get(key, "variant")
        if not TYPES[kind](value):
            raise Unreadable(f"{key} is {kind.capitalize()} and does not hold this value")
        self.scopes[-1][key] = value


def _is_off(item: Output | Wait | Force) -> bool:
    """Whether an instruction switches an output or a force off."""
    if isinstance(item, Output):
        return item.value == 0
    return isinstance(item, Force) and item.newtons == 0


_STILL: dict[type, str] = {Output: "an output", Wait: "a delay", Force: "a force change"}
