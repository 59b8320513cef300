"""G-code for LinuxCNC 2.9.

Sources: the LinuxCNC manual (G-code, M-code and overview chapters) and its interpreter, which judges the printed text
in the tests.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Literal

from msgspec.structs import replace

from camgen.body import spliced
from camgen.errors import JobError
from camgen.ir import Force, Motion, MoveC, MoveJ, MoveL, Output, Program
from camgen.passes import without_force
from camgen.pose import Pose
from camgen.post import Pace, Tolerance
from camgen.text import short

from .rs274 import COOLANT, Rs274, check_signals
from .rs274_cycles import Hole, holes, rows

#: What a signal may be put on: LinuxCNC has at most 64 digital outputs.
_OUTPUTS = (*COOLANT, *(f"P{n}" for n in range(64)))


@dataclass
class GCode(Rs274):
    """LinuxCNC 2.9, three axes."""

    name: ClassVar[str] = "gcode"
    suffix: ClassVar[str] = ".ngc"
    about: ClassVar[str] = "G-code for LinuxCNC (RS-274/NGC), three-axis mill"
    works: ClassVar[tuple[str, ...]] = (*Rs274.works, "G59.1", "G59.2", "G59.3")

    tool: int = field(default=0, kw_only=True, metadata={"help": "tool to change to and measure by; 0: no change"})
    path_tolerance: float = field(default=0.01, kw_only=True, metadata={"help": "G64 P, mm; 0: exact path (G61)"})
    cycles: bool = field(default=True, kw_only=True, metadata={"help": "G81 and G83 for holes; false: each motion"})
    signals: dict[str, str] = field(
        default_factory=lambda: {"process": "P0"},
        kw_only=True,
        metadata={"help": "digital output (P0 to P63) or coolant (M7, M8) of each signal"},
    )
    force: Literal["refuse", "ignore", "analog"] = field(
        default="refuse", kw_only=True, metadata={"help": "ignore: leave out; analog: an analog output (M67, M68)"}
    )
    force_channel: int = field(default=0, kw_only=True, metadata={"help": "analog output of the force, 0 to 63"})
    force_scale: float = field(default=0.0, kw_only=True, metadata={"help": "output value per N; analog needs it"})

    #: The printed analog value, empty while force is off.
    _pressing: str = field(default="", init=False, repr=False)
    #: By identity, with the motion itself: the cycle that it begins, whether it goes on and ends; None inside of one.
    _cycles: dict[int, tuple[Motion, tuple[Hole, bool, bool] | None]] = field(
        default_factory=dict, init=False, repr=False
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 <= self.tool <= 99_999:
            raise JobError("[post] tool", f"{self.tool} is no tool number", remedy="0 for none")
        if self.path_tolerance != 0 and not 1e-4 <= self.path_tolerance <= 10:
            remedy = "0 for the exact path; without a tolerance LinuxCNC would round corners by any amount"
            raise JobError("[post] path_tolerance", f"{self.path_tolerance} is not 0.0001 to 10 mm", remedy=remedy)
        check_signals(self.signals, _OUTPUTS, [COOLANT])
        if not 0 <= self.force_channel <= 63:
            raise JobError("[post] force_channel", f"{self.force_channel} is not 0 to 63")
        if self.force == "analog" and not 1e-3 <= self.force_scale <= 1e3:
            raise JobError("[post] force_scale", "analog force needs the output's value per N", remedy="0.001 to 1000")

    def tolerance(self) -> Tolerance:
        """Half the last printed digit, a force by its scale."""
        scale = self.force_scale if self.force == "analog" else 1.0
        return replace(super().tolerance(), force=0.5e-4 / scale)

    def pace(self) -> Pace:
        """A small mill; G64 P rounds every corner, G61 none. The shares are LinuxCNC's (docs/cycle-time.md)."""
        rounded = self.path_tolerance
        last = 0.5 if rounded else 1.0
        return Pace(acceleration=500.0, corner="arc", deviation=rounded, across=0.866, along=0.5, last=last)

    def prepare(self, program: Program, chord: float) -> Program:
        """See ``Rs274``; drops force where the user said so, and makes cycles of holes."""
        program = super().prepare(without_force(program) if self.force == "ignore" else program, chord)
        found = holes(program.columns, self.decimals) if self.cycles else []
        if not found:
            return program
        changed: dict[int, Sequence[Motion]] = {}
        for row in rows(program.body, found):
            first, *others = row[0].motions
            self._cycles[id(first)] = first, row
            self._cycles.update((id(motion), (motion, None)) for motion in others)
            changed |= dict.fromkeys(range(row[0].first, row[0].last + 1), ())
            changed[row[0].first] = row[0].motions
        return program.with_body(spliced(program.body, changed))

    def begin(self, program: Program) -> Sequence[str]:
        """Q0 keeps LinuxCNC from joining lines, so that the path stays within P."""
        path = f"G64 P{short(self.path_tolerance, 4)} Q0" if self.path_tolerance else "G61"
        change = (f"T{self.tool} M6", "G43") if self.tool else ()
        return [*super().begin(program), path, *change]

    def movej(self, motion: MoveJ) -> Sequence[str]:
        """G0, or the cycle that begins with it."""
        lines = self._cycle(motion)
        return super().movej(motion) if lines is None else lines

    def movel(self, motion: MoveL) -> Sequence[str]:
        """G1, after the force of this line, or the cycle that begins with it."""
        lines = self._cycle(motion)
        return (*self._pressed(motion), *super().movel(motion)) if lines is None else lines

    def _cycle(self, motion: MoveJ | MoveL) -> Sequence[str] | None:
        """The lines of the cycle that ``motion`` begins, none inside of one; None where it is of no cycle."""
        known, row = self._cycles.get(id(motion), (None, None))
        if known is not motion:
            return None
        self._go(motion)
        if row is None:
            return ()
        hole, going, last = row
        x, y = (f"{axis}{short(value, self.decimals)}" for axis, value in zip("XY", hole.place[:2], strict=True))
        feed = self._feed_word(MoveL(motion.target, hole.feed)) if isinstance(motion.target, Pose) else []
        words = (x, y) if going else ("G98", hole.words[:3], x, y, hole.words[4:], *feed)
        return (" ".join(words), *(("G80",) if last else ()))

    def movec(self, motion: MoveC) -> Sequence[str]:
        """G2 or G3, after the force of this arc."""
        return (*self._pressed(motion), *super().movec(motion))

    def output(self, item: Output) -> Sequence[str]:
        """M64 and M65 wait for the end of the motion before them."""
        if item.signal == "spindle":
            return (f"S{short(item.value, 6)} M3" if item.value else "M5",)
        word = self.signals[item.signal]
        if word in COOLANT:
            return (word if item.value else "M9",)
        return (f"{'M64' if item.value else 'M65'} {word}",)

    def press(self, item: Force) -> Sequence[str]:
        """M68 acts at once, after the motion before it has ended."""
        value = self._force_word(item.newtons)
        self._pressing = value if item.newtons > 0 else ""
        return (f"M68 E{self.force_channel} Q{value}",)

    def _pressed(self, motion: MoveL | MoveC) -> Sequence[str]:
        """M67 acts with the next motion, without a stop before it."""
        if not self._pressing:
            return ()
        value = self._force_word(motion.force)
        if value == self._pressing:
            return ()
        self._pressing = value
        return (f"M67 E{self.force_channel} Q{value}",)

    def _force_word(self, newtons: float) -> str:
        return short(newtons * self.force_scale, 4)

    def refuses_force(self, item: Force) -> str:
        """An analog output can stand for a force; what it does to the tool is wired in HAL."""
        if self.force != "analog":
            return super().refuses_force(item) + ', or post.force = "analog" with an output wired to a regulator'
        if item.newtons > 0 and self._force_word(item.newtons) == "0":
            return f"{item.newtons:g} N is nothing at post.force_scale = {self.force_scale:g}; raise the scale"
        return ""
