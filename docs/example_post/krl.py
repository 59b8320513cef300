"""KUKA KRL, one `.src` file. docs/writing-a-post.md has the used features and their sources."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar

from msgspec.structs import replace

from camgen.geometry.arcs import compute_circle
from camgen.model.cell import Cell
from camgen.model.errors import JobError, Refused
from camgen.model.pose import Pose, compute_fixed_xyz, translation
from camgen.model.program import (
    Force,
    Instruction,
    Joints,
    Motion,
    MoveC,
    MoveJ,
    MoveL,
    Output,
    Program,
    Wait,
)
from camgen.model.text import fixed
from camgen.post import OutputFile, Post, Tolerance, end_of

#: Words that must not name a program.
WORDS = re.compile(
    r"(DEF|END|EXT)\w*|S?(PTP|LIN|CIRC)(_REL)?|(E[36])?(POS|AXIS)|SPL(INE)?|A(ND|NIN|NOUT)|BAS|"
    r"BOOL|BRAKE|CASE|CHANNEL|CHAR|CON(FIRM|ST|TINUE)|C(CLOSE|OPEN|READ|WRITE)|DECL|DELAY|DIGIN|"
    r"DISTANCE|DO|ELSE|ENUM|EXIT|FALSE|FOR|FRAME|GLOBAL|GOTO|HALT|IF|IMPORT|INT|INTERRUPT|IS|LOOP|"
    r"NOT|OR|PATH|PRIO|PUBLIC|PULSE|REAL|REPEAT|RESUME|RETURN|SEC|SIGNAL|STEP|STRUC|SWITCH|THEN|TO|"
    r"TRIGGER|TRUE|UNTIL|WAIT|WHEN|WHILE|WITH"
)
FLAT = 10_000.0  # mm; three points in 32-bit numbers do not define a larger radius


@dataclass(kw_only=True)
class Krl(Post):
    """The post. Its public fields are options of `[post]`, besides those of all posts."""

    name: ClassVar[str] = "krl"
    suffix: ClassVar[str] = ".src"
    about: ClassVar[str] = "KUKA KRL, the worked example of the post tutorial"
    newline: ClassVar[str] = "\r\n"
    verified_fields: ClassVar[frozenset[str]] = frozenset(
        {"orientation", "via-orientation", "speed", "blend", "stop", "work", "tool"}
    )

    signals: dict[str, int] = field(
        default_factory=lambda: {"process": 1}, metadata={"help": "$OUT by signal"}
    )
    spindle_rpm: float = field(
        default=0.0, metadata={"help": "rpm of the spindle while its $OUT is on"}
    )
    joint_speed: int = field(
        default=10, metadata={"help": "$VEL_AXIS of all axes, percent, for PTP"}
    )
    max_speed: float = field(default=2000.0, metadata={"help": "the greatest $VEL.CP, mm/s"})
    _assigned: dict[str, str] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        numbers = self.signals.values()
        if len(set(numbers)) < len(numbers) or min(numbers, default=1) < 1:
            raise JobError(
                "[post] signals",
                "two share an output, or one is below 1",
                remedy="number them from 1",
            )
        if not 1 <= self.joint_speed <= 100:
            what = f"{self.joint_speed} % is not possible"
            raise JobError("[post] joint_speed", what, remedy="give 1 to 100")
        if self.program and self.program != _legal(self.program):
            remedy = "24 letters, digits and _, a letter first"
            raise JobError("[post] program", "no name in KRL", remedy=remedy)

    def why_not(self, item: Instruction, before: Motion | None, _after: Motion | None) -> str:
        """The reason why the controller cannot do `item`, with the remedy; empty if it can."""
        on, start = {"spindle": self.spindle_rpm}, end_of(before)
        match item:
            case MoveJ(Joints(values)) if len(values) != 6:
                return f"PTP takes six axes, not {len(values)}; take an arm with six"
            case MoveC(via, end) if (
                start is None or compute_circle(start.origin, via.origin, end.origin)[1] > FLAT
            ):
                return f"CIRC needs a pose to start from and a radius to {FLAT:g} mm; plan a line"
            case MoveL() | MoveC() if not 0.01 <= item.speed <= self.max_speed:
                limit = f"0.01 and {self.max_speed:g}"
                return f"{item.speed:g} mm/s is not within {limit}; change it or post.max_speed"
            case Output(signal, value) if signal not in self.signals or value not in (
                0,
                on.get(signal, 1),
            ):
                return f"no $OUT means {signal} = {value:g}; see post.signals and post.spindle_rpm"
            case Force():
                return "KRL alone has no force control; set process.force to 0"
        return ""

    def prepare(self, program: Program, chord: float) -> Program:
        """All PTP stop: KRL rounds them by a percentage, and a blend need not be used."""
        if program.columns.moves and isinstance(program.columns.moves[0].target, Pose):
            raise Refused(
                self.name,
                int(program.columns.at[0]),
                "the first PTP needs axes",
                "set cell.home to joints",
            )
        stops = (
            replace(item, blend=0.0) if isinstance(item, MoveJ) else item for item in program.body
        )
        return super().prepare(program.with_body(tuple(stops)), chord)

    def begin(self, program: Program) -> Sequence[str]:
        """DEF, the header, and all variables on which the motions depend."""
        return (
            f"DEF {_legal(self.program or program.name)}()",
            *(self.note(line) for line in program.header),
            *("BAS(#INITMOV, 0)", "$IPO_MODE=#BASE", "$ORI_TYPE=#VAR", "$CIRC_TYPE=#BASE"),
            *(f"$VEL_AXIS[{axis}]={self.joint_speed}" for axis in range(1, 7)),
            f"$BASE={self._place(program.base_from_work)}",
            f"$TOOL={self._place(program.flange_from_tool)}",
        )

    def end(self, program: Program) -> Sequence[str]:  # noqa: ARG002 (the same for every program)
        """END."""
        return ("END",)

    def comment(self, text: str) -> str:
        """A comment that never begins with FOLD, which would hide lines on the pendant."""
        return f"; - {text}".rstrip()

    def movej(self, motion: MoveJ) -> Sequence[str]:
        """PTP, to axis values or to a pose."""
        return (f"PTP {self._place(motion.target)}",)

    def movel(self, motion: MoveL) -> Sequence[str]:
        """LIN."""
        return self._path(motion, f"LIN {self._place(motion.target)}")

    def movec(self, motion: MoveC) -> Sequence[str]:
        """CIRC: the auxiliary point, then the end."""
        return self._path(motion, f"CIRC {self._place(motion.via)}, {self._place(motion.target)}")

    def output(self, item: Output) -> Sequence[str]:
        """$OUT by its number."""
        return (f"$OUT[{self.signals[item.signal]}]={'TRUE' if item.value else 'FALSE'}",)

    def wait(self, item: Wait) -> Sequence[str]:
        """WAIT SEC."""
        return (f"WAIT SEC {fixed(item.seconds, 3)}",)

    def _path(self, motion: MoveL | MoveC, statement: str) -> Sequence[str]:
        zone = {"$APO.CDIS": fixed(motion.blend, self.decimals)} if motion.blend else {}
        wanted = {"$VEL.CP": fixed(motion.speed / 1000, 6)} | zone  # mm/s to m/s
        changed = [
            f"{name}={value}" for name, value in wanted.items() if self._assigned.get(name) != value
        ]
        self._assigned |= wanted
        return (*changed, statement + (" C_DIS" if motion.blend else ""))

    def _place(self, place: Pose | Joints) -> str:
        if isinstance(place, Joints):
            axes = (
                f"A{axis} {fixed(math.degrees(angle), 4)}"
                for axis, angle in enumerate(place.values, 1)
            )
            return f"{{{', '.join(axes)}}}"
        c, b, a = (fixed(math.degrees(angle), 4) for angle in compute_fixed_xyz(place.rotation))
        x, y, z = (fixed(value, self.decimals) for value in place.origin)
        return f"{{X {x}, Y {y}, Z {z}, A {a}, B {b}, C {c}}}"

    def assemble(self, program: Program, parts: Sequence[Sequence[str]]) -> tuple[OutputFile, ...]:
        """One file, called as its DEF."""
        (file,) = super().assemble(program, parts)
        return (OutputFile(_legal(self.program or program.name) + self.suffix, file.text),)

    def tolerance(self) -> Tolerance:
        """Half the last printed digit: 0.00005 deg, 0.9e-6 rad. Orientations add three angles."""
        return Tolerance(0.5 * 10**-self.decimals, 2.7e-6, 0.9e-6, 0.0005, 0.0005, 0.0005)

    @classmethod
    def cell(cls) -> Cell:
        """An arm with a table in front of it; at home its tool points down."""
        home = Joints(tuple(math.radians(angle) for angle in (0, -90, 90, 0, 90, 0)))
        return Cell("KUKA arm", translation(500, 0, 0), translation(0, 0, 100), home)


def _legal(name: str) -> str:
    name = re.sub(r"[^A-Za-z0-9_]", "_", name)[:24]
    return name if name[:1].isalpha() and not WORDS.fullmatch(name.upper()) else f"p_{name}"[:24]
