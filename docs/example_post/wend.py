"""WEND, a controller language made up for this example. Its manual, in full:

A program is `PROGRAM name`, then one statement a line, then `END`. `*` starts a comment line. Lengths are mm, angles
deg. A place is x y z and three angles, R = Rz(c) Ry(b) Rx(a), in the frame set by WORK.

    WORK x y z a b c        TOOL x y z a b c        the frames, once each
    JOINT j1 .. j6 AT v     GOTO place AT v NEAR r  joint-interpolated, v in mm/s, passing within r mm (0: stop)
    LINE place AT v NEAR r  ARC place TO place AT v NEAR r      at most a quarter of a circle
    OUT n 0|1               PAUSE s
"""

import math
import re
import runpy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

from camgen.model.cell import Cell
from camgen.model.errors import JobError
from camgen.model.pose import Pose, fixed_xyz, translation
from camgen.model.program import Force, Instruction, Joints, MoveC, MoveJ, MoveL, Output, Program, Wait
from camgen.model.text import fixed, short
from camgen.post import Post, Reading, Tolerance
from camgen.post.passes import circle


@dataclass
class Wend(Post):
    """The post. Its public fields are the options of ``[post]``, beside those of every post."""

    name: ClassVar[str] = "wend"
    suffix: ClassVar[str] = ".wnd"
    about: ClassVar[str] = "WEND, the made-up language of the post tutorial"
    #: A longer arc than the controller has becomes two halves, exactly; chords would only come near it.
    passes: ClassVar[tuple[str, ...]] = ("halves",)
    carries: ClassVar[frozenset[str]] = Post.carries | {"work", "tool"}

    signals: dict[str, int] = field(
        default_factory=lambda: {"process": 1}, kw_only=True, metadata={"help": "output number by signal"}
    )

    def __post_init__(self) -> None:
        numbers = list(self.signals.values())
        if len(set(numbers)) < len(numbers) or min(numbers, default=1) < 1:
            raise JobError("[post] signals", "two signals share a number, or one is below 1", remedy="one each, from 1")

    # What the controller lacks, with the remedy.

    def refuses(self, item: Instruction, start: Pose | None) -> str:
        """The reason against ``item``, if there is one."""
        match item:
            case MoveC():
                return self._refuses_arc(item, start) or _refuses_speed(item.speed)
            case MoveJ() | MoveL():
                return _refuses_axes(item) or _refuses_speed(item.speed)
            case Output(signal, value) if signal not in self.signals or value not in (0, 1):
                return f"{signal} = {value:g} is no output that is on or off; name it in post.signals"
            case Force(newtons) if newtons > 0:
                return "WEND has no force control; set process.force to 0"
        return ""

    def _refuses_arc(self, arc: MoveC, start: Pose | None) -> str:
        if start is None:
            return "an arc must start at a pose; move to one before it"
        sweep = circle(start.origin, arc.via.origin, arc.target.origin)[3]
        return "an arc is at most a quarter of a circle; halve it" if sweep > math.pi / 2 + 1e-6 else ""

    # What is written.

    def begin(self, program: Program) -> Sequence[str]:
        """The head: name, remarks, frames."""
        name = re.sub(r"[^A-Za-z0-9_]", "_", self.program or program.name)[:16]
        frames = (("WORK", program.base_from_work), ("TOOL", program.flange_from_tool))
        return (
            f"PROGRAM {name}",
            *(self.note(line) for line in program.header),
            *(f"{word} {self._place(pose)}" for word, pose in frames),
        )

    def end(self, program: Program) -> Sequence[str]:  # noqa: ARG002 (the same for every program)
        """The foot."""
        return ("END",)

    def movej(self, motion: MoveJ) -> Sequence[str]:
        """To joint values or to a place."""
        if isinstance(motion.target, Joints):
            degrees = " ".join(fixed(math.degrees(value), 4) for value in motion.target.values)
            return (f"JOINT {degrees} AT {fixed(motion.speed, 2)}",)
        return (f"GOTO {self._place(motion.target)}{_manner(motion)}",)

    def movel(self, motion: MoveL) -> Sequence[str]:
        """Straight to a place."""
        return (f"LINE {self._place(motion.target)}{_manner(motion)}",)

    def movec(self, motion: MoveC) -> Sequence[str]:
        """An arc through a place."""
        return (f"ARC {self._place(motion.via)} TO {self._place(motion.target)}{_manner(motion)}",)

    def output(self, item: Output) -> Sequence[str]:
        """An output by its number."""
        return (f"OUT {self.signals[item.signal]} {short(item.value, 0)}",)

    def wait(self, item: Wait) -> Sequence[str]:
        """A pause in seconds."""
        return (f"PAUSE {fixed(item.seconds, 3)}",)

    def comment(self, text: str) -> str:
        """A comment line."""
        return f"* {text}"

    def _place(self, pose: Pose) -> str:
        angles = (fixed(math.degrees(angle), 4) for angle in fixed_xyz(pose.rotation))
        return " ".join([*(fixed(value, self.decimals) for value in pose.origin), *angles])

    # How exactly, and where.

    def tolerance(self) -> Tolerance:
        """Half the last digit printed; three angles add up in an orientation."""
        half_digit = math.radians(0.51e-4)
        return Tolerance(0.5 * 10**-self.decimals, 3 * half_digit, half_digit, 0.005, 0.0, 0.0005)

    @classmethod
    def cell(cls) -> Cell:
        """An arm with six axes and a table in front of it."""
        home = Joints(tuple(math.radians(angle) for angle in (0, -20, 110, 0, 90, 0)))
        return Cell("WEND arm", translation(400, 0, 0), translation(0, 0, 100), home)


def _manner(motion: MoveJ | MoveL | MoveC) -> str:
    return f" AT {fixed(motion.speed, 2)} NEAR {short(motion.blend, 3)}"


def _refuses_speed(speed: float) -> str:
    return "" if speed >= 0.01 else f"{speed:g} mm/s is slower than WEND can say; raise the speed"


def _refuses_axes(motion: MoveJ | MoveL) -> str:
    if isinstance(motion.target, Joints) and (len(motion.target.values) != 6 or motion.blend):
        return "JOINT takes six axes and stops there; give six values"
    return ""


def read(files: Mapping[str, str], options: Mapping[str, object]) -> Reading:
    """The read-back, for ``--post ./wend.py``; the installed package names it by an entry point instead."""
    beside = runpy.run_path(str(Path(__file__).with_name("wend_readback.py")))
    reading: Reading = beside["read"](files, options)
    return reading
