"""The machine of the strict run: the settings of the program, compared with the options."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from msgspec.structs import replace

from camgen.lang.pacscript.machine import RATED, RATED_TURN, Machine
from camgen.lang.pacscript.motions import MARKS
from camgen.lang.pacscript.values import (
    Either,
    ExternalPose,
    Mps,
    Speed,
    Unreadable,
    Value,
    name_place,
)
from camgen.lang.post_options import read_positive, read_signals
from camgen.lang.programs import Level
from camgen.model.pose import Pose
from camgen.model.program import Force, Instruction, Joints, MoveC, MoveJ, MoveL, Output, Wait

from .expected import check_internal, check_mark, check_settings, read_expected

#: Speed of `Mps(1)` by the unit of the controller, mm/s. The first one is used for an open unit.
_UNITS = {"mm/s": 1.0, "m/s": 1000.0}
_SIGNALS = {"process": 24}
#: Indices of the questions for the unit of `Mps`, and whether it is a percentage.
_QUESTIONS = [0, 1]
#: Maximum relative difference of two equal speeds: single precision.
_SAME = 1e-6


class StrictMachine(Machine):
    """The machine of the strict run.

    signals: name of a signal by number of its IO.
    units: possible speeds of `Mps(1)`, mm/s: one if the unit is known, else all of `_UNITS`.
    expected: options that the text must agree with.
    is_rated: whether the options give the speed at 100 %.
    given_back: whether the arm was given back.
    settled: whether nothing was set since the settings were last compared with the options.
    stated_external: ExtSpeed of the text, %, 0 without one.
    acceleration: acceleration and deceleration, %. Empty before them and after `Speed`.
    stated_internal: Speed of the text, % or by `Mps`, None without one.
    uses_internal: whether a motion runs at the internal speed.
    blends: blends of the pass marks so far, mm.
    compares_mps: whether the text compares `Mps` with a percentage.
    questions: indices of the questions of the post that the text has asked before its first motion.
    only_off: whether all instructions so far switch an output or a force off. Posts write these
        before the questions.
    unused_forces: lines of `ForceParam` by table, for forces that are not on yet.
    """

    def __init__(self, options: Mapping[str, object]) -> None:
        super().__init__({}, {})
        self.signals = read_signals(options, _SIGNALS)
        self.rated = read_positive(options, "rated", RATED)
        self.is_rated = read_positive(options, "rated", 0.0) > 0
        self.rated_turn = read_positive(options, "rated_turn", RATED_TURN)
        mps = options.get("mps", "ask")
        known = isinstance(mps, str) and mps in _UNITS
        self.units = (_UNITS[str(mps)],) if known else tuple(_UNITS.values())
        self.expected = read_expected(options)
        self.given_back = False
        self.settled = False
        self.stated_external = 0.0
        self.acceleration: tuple[float, ...] = ()
        self.stated_internal: Speed | None = None
        self.uses_internal = False
        self.blends: dict[str, float] = {}
        self.compares_mps = False
        self.questions: list[int] = []
        self.only_off = True
        self.unused_forces: dict[int, int] = {}
        #: Last speed by `Mps` and its value in mm/s. Most motions have the speed of the one before.
        self._last: tuple[Mps | None, float] = (None, 0.0)

    def fault(self, what: str) -> None:
        """Adds a refusal of the current line. Long quotations are shortened."""
        self.log.find("refused", what[:160])

    def remark(self, what: str) -> None:
        """Adds an unusual finding once."""
        self.log.find("unusual", what, once=what)

    def forget_place(self) -> None:
        """The arm is at a place that the text does not give."""
        self.current_pose = name_place(f"the position of the arm in line {self.line}")

    def unknown(self, what: str, key: str = "") -> Value:  # noqa: ARG002
        """Raises Unreadable: each value is that of the text."""
        raise Unreadable(f"{what} is not set in the text")

    # -- settings ------------------------------------------------------------------------------

    def check_settings(self) -> None:
        """Adds findings for settings that are not those of the options."""
        self.settled = True
        for what in check_settings(
            self.expected, self.numbers, self.stated_external, self.acceleration
        ):
            self.remark(what)

    def check_end(self) -> None:
        """Adds findings for settings at the end that are not those of the options."""
        if not self.moved:
            return
        if not self.settled:
            self.check_settings()
        what = "" if self.uses_internal else check_internal(self.expected, self.stated_internal)
        if what:
            self.remark(what)

    def blend(self, mark: str) -> float:
        """The blend of a new pass mark, mm."""
        blend = self.blends[mark] = MARKS[mark] if mark in MARKS else float(mark)
        if what := check_mark(self.expected, mark):
            self.remark(what)
        return blend

    # -- instructions --------------------------------------------------------------------------

    def emit(self, item: Instruction, base: str = "") -> None:  # noqa: ARG002
        """Adds an instruction of the current line."""
        self.body.append(item)
        self.lines.append(self.line)

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
            self.remark(f"{name} {'after GiveArm' if self.given_back else 'before TakeArm'}")
        self.emit(item)

    def move(
        self,
        item: MoveJ | MoveL | MoveC,
        passing: bool,
        base: str = "",  # noqa: ARG002 (the place of each target is known)
    ) -> None:
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
            self.check_settings()
        if self.figure is not None and item.posture:
            self._compare_figures(item, item.posture.figure)
        self.moved, self.passing = True, passing
        self.emit(item)
        if isinstance(item.target, Pose):
            self.current_pose = item.target
        else:
            self.forget_place()

    def _compare_figures(self, item: MoveJ | MoveL | MoveC, figure: int | None) -> None:
        """A line and an arc must end in the figure in which they start."""
        if isinstance(item, MoveJ) or figure in (None, self.figure):
            return
        what = f"from figure {self.figure} to {figure} along"
        if isinstance(item, MoveC):
            self.fault(f"{what} an arc")
        else:
            self.remark(f"{what} a line")

    def go_joints(
        self,
        target: Joints,
        speed: Speed,
        blend: float,
        at_once: bool = False,  # noqa: ARG002 (`StrictRun.go` has it)
    ) -> None:
        """Moves the axes to values of their own."""
        mm_s, share = self.speed(speed)
        self.move(MoveJ(target, mm_s, blend, share=share), blend > 0)
        self.figure = None

    # -- speeds --------------------------------------------------------------------------------

    def internal_speed(self) -> Speed:
        """The internal speed, for a motion without a speed of its own."""
        self.uses_internal = True
        return self.internal

    def speed(self, value: Speed) -> tuple[float, float]:
        """The speed of the TCP, mm/s, and its fraction of the maximum joint speeds.

        It is the product of an internal speed and the external speed (manual). The fraction is 0
        for a speed by `Mps`.
        """
        if not isinstance(value, Mps):
            share = value / 100 * self.external / 100
            return value / 100 * self.rated * self.external / 100, share
        if value is not self._last[0]:
            if isinstance(value.number, Either) and self.questions != _QUESTIONS:
                what = "a speed that depends on the unit of Mps"
                self.remark(f"{what}, and the questions of the post for it are not asked before")
            self._last = value, self._choose_speed(self.by_unit(value))
        return self._last[1] * self.external / 100, 0.0

    def pace(self, item: MoveL | MoveC, share: float, base: str) -> MoveL | MoveC:  # noqa: ARG002
        """The motion with a speed of turning if the TCP keeps its position.

        A percentage of a motion that travels is known only if the options give `rated`.
        """
        if not share:
            return item
        start = self.current_pose
        is_line = isinstance(item, MoveL) and isinstance(item.target, Pose)
        if is_line and not isinstance(start, ExternalPose) and start.origin == item.target.origin:
            # Even if the turn is smaller than a printed digit. It has no speed in mm/s.
            return replace(item, turn=math.radians(share * self.rated_turn))
        if not self.is_rated:
            what = f"a speed in percent, taken of {RATED:g} mm/s; give the option rated"
            self.log.find("refused", what, once="no option rated")
        return item

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
        if fastest - slowest > _SAME * fastest:
            level: Level = "refused" if self.compares_mps else "unusual"
            numbers = " or ".join(f"{speed:g}" for speed in speeds)
            reason = "as the controller reads Mps in mm/s or in m/s; give the option mps"
            self.log.find(level, f"{numbers} mm/s, {reason}", once="an open unit of Mps")
        return speeds[0]


def _is_off(item: Output | Wait | Force) -> bool:
    """Whether an instruction switches an output or a force off."""
    if isinstance(item, Output):
        return item.value == 0
    return isinstance(item, Force) and item.newtons == 0


_STILL: dict[type[Any], str] = {Output: "an output", Wait: "a delay", Force: "a force change"}
