"""What the controller knows while a PacScript program runs, and what the program has said so far."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from camgen.lang.log import Log
from camgen.lang.programs import Level
from camgen.model.pose import Pose, Vec3
from camgen.model.program import Force, Instruction, MoveC, MoveJ, MoveL, Output, Wait

from .asked import Asked, judge_internal, judge_mark, judge_settings, read_asked
from .values import Either, Mps, Unreadable, Value, evaluate, speed
from .words import TYPES

#: What 100 % is taken for when the options do not say it (a fault tells, but of joint motions), mm/s.
_RATED = 1000.0
#: The blend of a pass mark, mm; how near ``@P`` and ``@C`` pass their target is the controller's choice.
_BLENDS = {"@0": 0.0, "@E": 0.0, "@P": 1.0, "@C": 1.0}
#: mm/s that ``Mps(1)`` is, by the unit that the controller reads; the first one is taken where a text leaves it open.
UNITS = {"mm/s": 1.0, "m/s": 1000.0}
#: Indices of the questions in which unit ``Mps`` is, and whether it is a percentage at all.
_QUESTIONS = [0, 1]
#: Two speeds are the same within so much of them: single precision.
_SAME = 1e-6


@dataclass(slots=True)
class Machine:
    """State of the interpreter. ``here`` is the commanded pose, None where the text does not give it."""

    rated: float
    signals: Mapping[int, str]
    #: deg/s of a turn on the spot at 100 %.
    rated_turn: float = 500.0
    #: mm/s that ``Mps(1)`` may be: one value where the unit is known, else all of ``UNITS``.
    units: tuple[float, ...] = tuple(UNITS.values())
    #: What the options ask of the text.
    wanted: Asked = field(default_factory=lambda: read_asked({}))
    line: int = 0
    armed: bool = False
    #: The arm was given back.
    given: bool = False
    motor: bool = True
    moved: bool = False
    #: Nothing was set since the settings were last held against the options.
    settled: bool = False
    #: ExtSpeed as the text says it, 0: not at all; acceleration and deceleration, all in %,
    #: empty before them and after ``Speed``.
    stated_external: float = 0.0
    acceleration: tuple[float, ...] = ()
    #: The internal speed as the text says it, None: not at all; whether a motion runs at it.
    stated_internal: float | Mps | None = None
    leans: bool = False
    #: The pass marks so far and their blends, mm.
    blends: dict[str, float] = field(default_factory=dict)
    #: The figure of the arm, where the text tells it.
    figure: int | None = None
    #: The text compares ``Mps`` with a percentage.
    asked: bool = False
    #: Indices of the questions of the post that the text has asked before its first motion.
    questions: list[int] = field(default_factory=list)
    #: All instructions so far put an output or a force off. Posts write these before the questions.
    only_off: bool = True
    #: Lines of ``ForceParam`` by table, whose force is not on yet.
    unused_forces: dict[int, int] = field(default_factory=dict)
    #: The last motion passes its target: what follows may happen before the arm is there.
    passing: bool = False
    here: Pose | None = None
    internal: float | Mps = 100.0
    external: float = 100.0
    numbers: dict[str, int] = field(default_factory=lambda: {"tool": 0, "work": 0})
    frames: dict[tuple[str, int], Pose] = field(default_factory=dict)
    forces: dict[int, Vec3] = field(default_factory=dict)
    table: int | None = None
    scopes: list[dict[str, Value]] = field(default_factory=lambda: [{}])
    #: For each scope the types of the names that are declared in it.
    types: list[dict[str, str]] = field(default_factory=lambda: [{}])
    arrays: dict[tuple[str, int], Value] = field(default_factory=dict)
    body: list[Instruction] = field(default_factory=list)
    lines: list[int] = field(default_factory=list)
    log: Log = field(init=False)
    #: Speeds that have been worked out with the present values of the names, by their text.
    speeds: dict[str, float | Mps] = field(default_factory=dict)
    _open_unit: bool = False
    #: A speed by ``Mps`` and its mm/s: most motions have the one of the motion before.
    _last: tuple[Mps | None, float] = (None, 0.0)

    def __post_init__(self) -> None:
        self.log = Log(lambda: self.line)

    def fault(self, what: str) -> None:
        """Notes a fault of the current line; what it quotes is cut short."""
        self.log.find("refused", what[:160])

    def remark(self, what: str) -> None:
        """Notes once what a controller takes and a program of ours does not say."""
        self.log.find("unusual", what, once=what)

    def judge_settings(self) -> None:
        """Holds what has been set against the options."""
        self.settled = True
        for what in judge_settings(
            self.wanted, self.numbers, self.stated_external, self.acceleration
        ):
            self.remark(what)

    def judge_end(self) -> None:
        """Holds what is left behind against the options."""
        if self.moved and not self.settled:
            self.judge_settings()
        if (
            self.moved
            and not self.leans
            and (what := judge_internal(self.wanted, self.stated_internal))
        ):
            self.remark(what)

    def check_questions(self) -> None:
        """A remark on a speed by ``unit`` before the text has asked for it and guarded it."""
        if self.questions != _QUESTIONS:
            self.remark(
                "a speed that depends on the unit of Mps, and the questions of the post for it are"
                " not asked before"
            )

    def lean(self) -> float | Mps:
        """The internal speed, for a motion without its own."""
        self.leans = True
        return self.internal

    def blend(self, mark: str) -> float:
        """The blend in mm that a pass mark stands for."""
        known = self.blends.get(mark)
        if known is None:
            known = self.blends[mark] = _BLENDS[mark] if mark in _BLENDS else float(mark[1:])
            if what := judge_mark(self.wanted, mark):
                self.remark(what)
        return known

    def lookup(self, key: str | tuple[str, int]) -> Value:
        """The value of a variable that the text has set."""
        found = self.arrays.get(key) if isinstance(key, tuple) else self.scopes[-1].get(key)
        if found is None:
            name = (
                f"{key[0].upper()}[{key[1]}] is not set in the text"
                if isinstance(key, tuple)
                else f"unknown name {key}"
            )
            raise Unreadable(name)
        return found

    def emit(self, item: Instruction) -> None:
        """Adds an instruction of the current line."""
        self.body.append(item)
        self.lines.append(self.line)

    def emit_motion(self, item: MoveJ | MoveL | MoveC, passing: bool) -> None:
        """Adds a motion; the arm must be owned and the first one joint-interpolated."""
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
        self.here = item.target if isinstance(item.target, Pose) else None
        self.emit(item)

    def _turn_into(self, item: MoveJ | MoveL | MoveC) -> None:
        """Takes on the figure of a motion's target. A line and an arc end in the one in which they start."""
        said = item.posture.figure if item.posture else None
        if said is not None and not isinstance(item, MoveJ) and self.figure not in (None, said):
            what = f"from figure {self.figure} to {said} along"
            if isinstance(item, MoveC):
                self.fault(f"{what} an arc")
            else:
                self.remark(f"{what} a line")
        keeps = isinstance(item, MoveJ) and isinstance(item.target, Pose) and said is None
        self.figure = self.figure if keeps else said

    def emit_still(self, item: Output | Wait | Force) -> None:
        """Adds something that must not happen before the arm has arrived."""
        if self.passing:
            self.fault(
                f"{_STILL[type(item)]} after a motion that passes its target: it may come too early"
            )
            self.passing = False
        self.only_off = self.only_off and not self.moved and _is_off(item)
        if self.questions and self.only_off:
            self.remark("an output or a force is put off after Mps is asked, not before")
        if not self.armed:
            self.remark(
                f"{_STILL[type(item)]} {'after GiveArm' if self.given else 'before TakeArm'}"
            )
        self.emit(item)

    def pressing(self) -> tuple[float, Vec3]:
        """Newtons and direction of the force that is on, 0 and zero when none is."""
        x, y, z = (0.0, 0.0, 0.0) if self.table is None else self.forces[self.table]
        newtons = math.hypot(x, y, z)
        return (
            (newtons, (x / newtons, y / newtons, z / newtons))
            if newtons
            else (0.0, (0.0, 0.0, 0.0))
        )

    def speed_of(self, text: str) -> float | Mps:
        """The speed that ``text`` says with the present values of the names."""
        known = self.speeds.get(text)
        if known is None:
            known = self.speeds[text] = speed(evaluate(text, self.lookup))
        return known

    def mm_per_second(self, value: float | Mps) -> float:
        """An internal speed times the external one (manual: both are multiplied)."""
        if isinstance(value, Mps):
            if isinstance(value.said, Either):
                self.check_questions()
            if value is not self._last[0]:
                self._last = value, self._one(self.by_unit(value))
            return self._last[1] * self.external / 100
        if not self.rated:
            self.fault(f"a speed in percent, taken of {_RATED:g} mm/s; give the option rated")
            self.rated = _RATED
        return value / 100 * self.rated * self.external / 100

    def joint_speed(self, value: float | Mps) -> tuple[float, float]:
        """The speed of a joint motion, mm/s, and its share of the joints' greatest speeds, 0 for one by ``Mps``.

        Percent are of the joints' speeds, so that the first one is only known where ``rated`` says it.
        """
        if isinstance(value, Mps):
            return self.mm_per_second(value), 0.0
        share = value / 100 * self.external / 100
        return share * (self.rated or _RATED), share

    def turning(self, value: float) -> float:
        """The speed of a turn on the spot by its internal speed in %, rad/s."""
        return math.radians(value / 100 * self.external / 100 * self.rated_turn)

    def by_unit(self, value: Mps) -> list[float]:
        """mm/s for each of ``units``."""
        said = (
            value.said.values if isinstance(value.said, Either) else (value.said,) * len(self.units)
        )
        return [number * unit for number, unit in zip(said, self.units, strict=True)]

    def _one(self, speeds: list[float]) -> float:
        """A speed in mm/s. One that depends on the unit of ``Mps`` is told once: a fault where the text has asked."""
        least, most = min(speeds), max(speeds)
        if most - least > _SAME * most and not self._open_unit:
            self._open_unit = True
            level: Level = "refused" if self.asked else "unusual"
            numbers = " or ".join(f"{speed:g}" for speed in speeds)
            what = f"{numbers} mm/s, as the controller reads Mps in mm/s or in m/s; give the option mps"
            self.log.find(level, what)
        return speeds[0]

    def enter(self, types: Mapping[str, str], values: list[Value]) -> None:
        """Begins a procedure with the values of its parameters."""
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
        """Gives a variable its value. Unreadable where its type does not hold it."""
        self.speeds.clear()
        if isinstance(key, tuple):
            self.arrays[key] = value
            return
        kind = self.types[-1].get(key, "variant")
        if not TYPES[kind](value):
            raise Unreadable(f"{key} is {kind.capitalize()} and does not hold this value")
        self.scopes[-1][key] = value


def _is_off(item: Output | Wait | Force) -> bool:
    """Whether an instruction puts an output or a force off."""
    if isinstance(item, Output):
        return item.value == 0
    return isinstance(item, Force) and item.newtons == 0


_STILL: dict[type, str] = {Output: "an output", Wait: "a delay", Force: "a force change"}
