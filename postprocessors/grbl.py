"""G-code for GRBL 1.1: lines of at most 79 ASCII characters, with words that the firmware knows.

Source: the firmware (gcode.c, protocol.c) and its list of error codes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Literal

from camgen.model.cell import Dynamics
from camgen.model.errors import JobError, Refused
from camgen.model.program import Instruction, Motion, Output, Program, Stop
from camgen.model.text import short
from camgen.post.passes import remove_force
from camgen.post.values import choose_line, choose_words

from .rs274 import COOLANT, Rs274, check_signals

#: Words of the spindle line, which a signal may use; with M4 laser power follows the speed.
_SPINDLE = ("M3", "M4")


@dataclass
class Grbl(Rs274):
    """GRBL 1.1, three axes."""

    name: ClassVar[str] = "grbl"
    suffix: ClassVar[str] = ".nc"
    about: ClassVar[str] = "G-code for GRBL 1.1, three-axis mill, laser or plotter"

    signals: dict[str, str] = field(
        default_factory=lambda: {"process": "M3"},
        kw_only=True,
        metadata={
            "help": "spindle line (M3, M4: power follows the speed) "
            "or coolant (M7, M8) of each signal"
        },
    )
    power: float = field(
        default=1000.0,
        kw_only=True,
        metadata={"help": "S of a signal on M3 or M4; $30 is full power"},
    )
    force: Literal["refuse", "ignore"] = field(
        default="refuse", kw_only=True, metadata={"help": "ignore: leave out"}
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        check_signals(self.signals, (*_SPINDLE, *COOLANT), [_SPINDLE, COOLANT])
        if not 0 < self.power <= 99_999:
            raise JobError(
                "[post] power", f"must be more than 0 and at most 99999, not {self.power:g}"
            )

    def dynamics(self) -> Dynamics:
        """A small mill or plotter.

        Junction deviation ($11, mm), arc tolerance ($12, mm) and idle delay ($1, s) are the
        defaults of the firmware.
        """
        return Dynamics(
            acceleration=500.0, corner="junction", deviation=0.01, chord=0.002, pause=0.025
        )

    def list_changed(self) -> frozenset[str]:
        """Force, if it is left out."""
        return choose_words({"force": self.force == "ignore"})

    def prepare(self, program: Program, chord: float) -> Program:
        """See `Rs274`. May leave out force, and allows one use of the spindle line."""
        self._one_use(program)
        return super().prepare(remove_force(program) if self.force == "ignore" else program, chord)

    def output(self, item: Output) -> Sequence[str]:
        """The spindle line or a coolant."""
        word, power = "M3", item.value
        if item.signal != "spindle":
            word, power = self.signals[item.signal], self.power
        if word in COOLANT:
            return choose_line(item.value, word, "M9")
        return choose_line(item.value, f"{word} S{short(power, 6)}", "M5")

    def why_not(self, item: Instruction, before: Motion | None, after: Motion | None) -> str:
        """Also of a stop that depends on a switch: GRBL reads M1 and passes over it."""
        if isinstance(item, Stop) and item.optional:
            return "GRBL passes over M1, the optional stop; leave it out, or make it a stop"
        return super().why_not(item, before, after)

    def _one_use(self, program: Program) -> None:
        """Raise Refused if the spindle and a signal share M3 and M5, which are ambiguous then."""
        outputs = [(i, item) for i, item in enumerate(program.body) if isinstance(item, Output)]
        spins = [(i, item) for i, item in outputs if item.signal == "spindle"]
        lines = {name for name, word in self.signals.items() if word in _SPINDLE}
        if not spins or not lines:
            return
        remedy = 'put the signal on a coolant line, e.g. post.signals = {process = "M8"}'
        for index, item in outputs:
            if item.signal in lines:
                raise Refused(
                    self.name,
                    index,
                    f"signal {item.signal} and the spindle share one output",
                    remedy,
                )
        if all(item.value in (0, self.power) for _, item in spins):
            raise Refused(
                self.name,
                spins[0][0],
                f"a spindle at {self.power:g} rpm reads like signal {min(lines)} at post.power",
                "change post.power or " + remedy,
            )
