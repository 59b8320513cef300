"""Post for Adept V+ (Adept SmartController, older Staeubli controllers): SCARA and six-axis robots.

Sources: the V+ Language Reference and User's Guide, version 17, as far as docs/posts/vplus.md
quotes them. Facts that are not confirmed there are options or notes of that page, never guesses.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import ClassVar, Literal

from msgspec.structs import replace

from camgen.model.cell import Cell, Dynamics
from camgen.model.errors import JobError, Refused
from camgen.model.instructions import NO_POSTURE
from camgen.model.part import Note
from camgen.model.pose import FloatArray, Pose, translation
from camgen.model.program import (
    Comment,
    Force,
    Instruction,
    Joints,
    Motion,
    MoveC,
    MoveJ,
    MoveL,
    Output,
    Program,
    Stop,
    Wait,
)
from camgen.model.text import short
from camgen.post import OutputFile, Post, Tolerance, end_of, pose_of
from camgen.post.passes import remove_force
from camgen.post.values import choose_words, note_renamed

from . import records, rules
from .lines import IN, Lines
from .records import Records
from .rules import SPEED_DIGITS, Posture, unprintable

#: mm/s2: assumed acceleration of the TCP at 100 % of ACCEL.
_RATED_ACCELERATION = 5000.0


@dataclass
class VPlus(Post):
    """The post for V+: `.v2` text with LF; the file has CR LF, as Adept ACE exports it.

    docs/posts/vplus.md describes the options.
    """

    name: ClassVar[str] = "vplus"
    suffix: ClassVar[str] = ".v2"
    data_suffixes: ClassVar[tuple[str, ...]] = (".dat",)
    about: ClassVar[str] = "Adept V+ for SCARA and six-axis robots; arcs as chords"
    newline: ClassVar[str] = "\r\n"
    passes: ClassVar[tuple[str, ...]] = ("chords",)
    #: V+ rounds corners by speed, not by a radius: only stop or no stop is in the text.
    verified_fields: ClassVar[frozenset[str]] = frozenset(
        {"orientation", "speed", "joint-speed", "stop", "turn", "switches"}
    )

    max_lines: int = field(
        default=2000,
        kw_only=True,
        metadata={"help": "lines per .PROGRAM before it is split; 0: never"},
    )
    signals: dict[str, int] = field(
        default_factory=lambda: {"process": 33},
        kw_only=True,
        metadata={
            "help": "signal number of each output name: 1 to 1000 outputs, 2001 and up soft signals"
        },
    )
    rated: float = field(
        default=7500.0,
        kw_only=True,
        metadata={"help": "TCP speed that SPEED 100 means in a MOVE, mm/s"},
    )
    rated_turn: float = field(
        default=1200.0,
        kw_only=True,
        metadata={
            "help": "what 100 % rotational speed means, deg/s, for turns on the spot; "
            "a slower arm turns slower"
        },
    )
    accel: float = field(
        default=100.0,
        kw_only=True,
        metadata={"help": "acceleration and deceleration, % of the rated one"},
    )
    profile: int = field(
        default=0,
        kw_only=True,
        metadata={
            "help": "profile of ACCEL, 0 to 8; 0 is at full acceleration at once, others rise to it"
        },
    )
    declare: bool = field(
        default=True,
        kw_only=True,
        metadata={"help": "set tool and work frame; false: they are on the controller"},
    )
    tool: str = field(
        default="cg.tool", kw_only=True, metadata={"help": "location variable of the tool"}
    )
    work: str = field(
        default="cg.work", kw_only=True, metadata={"help": "location variable of the work frame"}
    )
    posture: list[Posture] = field(
        default_factory=list,
        kw_only=True,
        metadata={"help": "words before the first MOVE, such as RIGHTY"},
    )
    force: Literal["refuse", "ignore", "signal"] = field(
        default="refuse",
        kw_only=True,
        metadata={
            "help": "what a force becomes: refuse, ignore, or signal (the output named force)"
        },
    )
    spindle: Literal["refuse", "on-off"] = field(
        default="refuse",
        kw_only=True,
        metadata={"help": "what a spindle becomes: refuse, or on-off (output spindle)"},
    )
    points: Literal["program", "file"] = field(
        default="program",
        kw_only=True,
        metadata={
            "help": "where the motions are: in the program, "
            "or in a data file that it reads, for long jobs"
        },
    )
    _speed: str = field(default="", init=False, repr=False)
    _switches: tuple[str, ...] = field(default=(), init=False, repr=False)
    _posture_due: bool = field(default=True, init=False, repr=False)
    _scara: tuple[FloatArray, FloatArray] | None = field(default=None, init=False, repr=False)
    _by_hand: tuple[str, ...] = field(default=(), init=False, repr=False)
    _lines: Lines = field(init=False, repr=False, compare=False)
    _spelled: Lines | Records = field(init=False, repr=False, compare=False)
    _orientations: dict[bytes, str] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        rules.check_names(self.program, self.tool, self.work)
        for key, good, remedy in (
            ("decimals", 1 <= self.decimals <= 4, "1 to 4: a V+ real is single precision"),
            ("max_lines", self.max_lines >= 0, "0 for no limit"),
            (
                "rated",
                0 < self.rated <= 20000,
                "the TCP speed of a MOVE at 100 %, up to 20000 mm/s",
            ),
            ("accel", 1 <= self.accel <= 100, "1 to 100 %"),
            ("profile", 0 <= self.profile <= 8, "0 to 8"),
            ("rated_turn", 0 < self.rated_turn <= 10000, "deg/s at 100 %, up to 10000"),
        ):
            if not good:
                raise JobError(f"[post] {key}", f"cannot be {getattr(self, key)}", remedy=remedy)
        rules.check_signals(self.signals)
        rules.check_posture(self.posture)
        self._lines = Lines(self.work, self.decimals)
        self._spelled = self._lines
        if self.points == "file":
            self._check_file()
            self._spelled = Records(self.decimals)

    def _check_file(self) -> None:
        if self.decimals > 3:
            raise JobError("[post] decimals", "a data file holds 3 digits of a mm", remedy="1 to 3")
        for key, name in (("program", self.program), ("tool", self.tool), ("work", self.work)):
            if name.lower() in records.VARIABLES:
                raise JobError(
                    f"[post] {key}",
                    f"{name!r} is a variable of the program that reads the data file",
                    remedy="give another name",
                )

    @classmethod
    def cell(cls) -> Cell:
        """Adept Cobra s600: a sheet of 200 x 150 mm before the robot, 150 mm above its mount."""
        home = Joints((0.0, math.radians(45.0), 50.0, 0.0))
        work, tool = translation(250, -75, 150), translation(0, 0, 100)
        return Cell("Adept Cobra s600", work, tool, home, frozenset({2}), "Cobra s600")

    def tolerance(self) -> Tolerance:
        """Half of the last digit; of a percentage in mm/s."""
        speed = 0.5 * 10**-SPEED_DIGITS * max(1.0, self.rated / 100)
        turn = math.radians(0.5 * 10**-SPEED_DIGITS * self.rated_turn / 100)
        return replace(super().tolerance(), speed=speed, turn=turn)

    def dynamics(self) -> Dynamics:
        """Speed and acceleration determine corners, not the blend. 5000 mm/s2 is assumed."""
        pace = Dynamics(acceleration=_RATED_ACCELERATION * self.accel / 100, corner="overlap")
        return replace(pace, fastest=min(pace.fastest, self.rated))

    def list_verified(self) -> frozenset[str]:
        """Tool and work frame if the text declares them; the posture without `posture`."""
        frames = choose_words({"work": self.declare, "tool": self.declare})
        return (self.verified_fields | frames) - choose_words({"switches": bool(self.posture)})

    def list_changed(self) -> frozenset[str]:
        """Force, which is left out or an output, and the spindle speed, which no output carries."""
        return choose_words({"force": self.force != "refuse", "spindle": self.spindle == "on-off"})

    def prepare(self, program: Program, chord: float) -> Program:
        """See `Post`. Options replace force and spindle. Also refuses axes, postures and frames."""
        self._orientations.clear()
        self._scara = None
        if rules.axes(program, self.name) == 4:
            rules.check_arm(self.posture, program)
            self._scara = (program.base_from_work.rotation, program.flange_from_tool.rotation)
        frames = {"work frame": program.base_from_work, "tool": program.flange_from_tool}
        for what, pose in frames.items():
            reason = rules.bad_orientation(pose.rotation, None) or unprintable(pose)
            if reason:
                raise Refused(self.name, rules.WHOLE, f"the {what}: {reason}")
        self._by_hand = rules.by_hand(program, self.force, self.spindle, self.name)
        if self.force == "ignore":
            program = remove_force(program)
        prepared = super().prepare(program, chord)
        columns = prepared.columns
        if columns.are(Force).any() or any(item.signal == "spindle" for item in columns.outputs):
            return prepared.with_body(tuple(map(self._rewritten, prepared.body)))
        return prepared

    def why_not(self, item: Instruction, before: Motion | None, _after: Motion | None) -> str:
        """Return the reason with its remedy, or an empty text."""
        if self.points == "file" and (reason := records.too_large(item)):
            return reason
        match item:
            case MoveC():
                if end_of(before) is None:
                    return (
                        "V+ has no arc, and no pose is known where this one starts"
                        "; move to a pose before it"
                    )
                return "V+ has no arc; lower it to chords"
            case MoveJ() | MoveL():
                return (
                    rules.bad_speed(item, self.rated)
                    or self._bad_turn(item)
                    or self._bad_target(item.target)
                )
            case Output():
                return self._bad_output(item)
            case Wait() | Stop():
                return rules.bad_pause(item)
            case Force():
                return self._bad_force()
            case Comment():
                pass
        return ""

    def _bad_turn(self, item: MoveJ | MoveL) -> str:
        return "" if isinstance(item, MoveJ) else rules.bad_turn(item.turn, self.rated_turn)

    def _bad_target(self, target: Pose | Joints) -> str:
        if isinstance(target, Joints):
            return ""
        key = target.rotation.tobytes()
        if key not in self._orientations:
            self._orientations[key] = rules.bad_orientation(target.rotation, self._scara)
        return self._orientations[key] or unprintable(target)

    def _bad_output(self, item: Output) -> str:
        if item.signal == "spindle":
            if self.spindle == "refuse":
                return (
                    "V+ has no spindle speed; "
                    "set post.spindle to on-off and map spindle in post.signals"
                )
            if item.value < 0:
                return "a spindle turning backwards is more than on or off; give a positive speed"
        elif item.value not in (0, 1):
            return (
                f"signal {item.signal} can be 0 or 1, not {item.value:g}"
                "; use a signal that is on or off"
            )
        if item.signal not in self.signals:
            return f"signal {item.signal} has no number; add it to post.signals"
        return ""

    def _bad_force(self) -> str:
        if self.force == "refuse":
            return (
                "V+ has no confirmed force control; "
                "set post.force to signal (a pressure valve) or ignore"
            )
        if self.force == "signal" and "force" not in self.signals:
            return "the output named force has no number; add it to post.signals"
        return ""

    def _rewritten(self, item: Instruction) -> Instruction:
        match item:
            case Force():
                return Output("force", float(item.newtons > 0))
            case MoveL() if item.force or any(item.force_direction):
                return replace(item, force=0.0, force_direction=(0.0, 0.0, 0.0))
            case Output(signal="spindle"):
                return Output("spindle", float(item.value > 0))
        return item

    def begin(self, program: Program) -> Sequence[str]:
        """The start of a program that is one `.PROGRAM`."""
        return self._head(program, self._name(program, 0), (self.tool, self.work))

    def _head(self, program: Program, name: str, declared: Sequence[str]) -> list[str]:
        lines = [f".PROGRAM {name}()", *(self.note(text) for text in program.header)]
        lines += [self.comment(text) for text in self._remarks()]
        if self.declare:
            lines.append(f"{IN}AUTO {', '.join(declared)}")
        if self.points == "file":
            lines += records.declarations()
        # Modal, and as the last program left them: corners and the time rely on both.
        share = short(self.accel, SPEED_DIGITS)
        accel = f"ACCEL ({self.profile}) {share}, {share}"
        lines += [f"{IN}{text}" for text in ("SELECT ROBOT = 1", "ATTACH ()", "ENABLE CP", accel)]
        if self.declare:
            lines.append(f"{IN}SET {self.tool} = {self._lines.trans(program.flange_from_tool)}")
        lines.append(f"{IN}TOOL {self.tool}")
        if self.declare and self.work in declared:
            lines.append(f"{IN}SET {self.work} = {self._lines.trans(program.base_from_work)}")
        return lines

    def _name(self, program: Program, parts: int) -> str:
        return rules.program_name(self.program or program.name, parts, (self.tool, self.work))

    def warn(self, program: Program) -> tuple[Note, ...]:
        """Another name than that of the input."""
        if self.program or not rules.is_word(program.name):
            return ()
        return note_renamed(program.name, self._name(program, 0), "V+")

    def _remarks(self) -> list[str]:
        remarks = [
            "mm and deg. TRANS(x, y, z, yaw, pitch, roll), R = Rz Ry Rz",
            f"speeds hold at monitor speed 100. SPEED 100 in a MOVE counts as {self.rated:g} mm/s",
        ]
        return remarks + list(self._by_hand)

    def end(self, program: Program) -> Sequence[str]:  # noqa: ARG002 (the same for every program)
        """Every last motion has its BREAK already: a program's last motion does not blend."""
        return (f"{IN}DETACH ()", f"{IN}RETURN", ".END")

    def movej(self, motion: MoveJ) -> Sequence[str]:
        """MOVE, to a precision point or a pose."""
        lines = self._pace(self._spelled.percent(100 * motion.speed / self.rated))
        if self._posture_due:
            lines += [self._spelled.word(word) for word in self.posture]
            self._posture_due = False
        if isinstance(motion.target, Joints):
            return [*lines, *self._spelled.to_joints(motion.target, motion.blend == 0)]
        lines += self._switched(motion)
        return [*lines, *self._spelled.to_pose("MOVE", motion.target, motion.blend == 0)]

    def movel(self, motion: MoveL) -> Sequence[str]:
        """MOVES at 100 % of the rotational speed at most; a reorientation at its own speed."""
        turn = 100 * math.degrees(motion.turn) / self.rated_turn if motion.turn else 100.0
        lines = self._pace(self._spelled.straight(motion.speed, turn))
        lines += self._switched(motion)
        return [*lines, *self._spelled.to_pose("MOVES", pose_of(motion), motion.blend == 0)]

    def _switched(self, motion: MoveJ | MoveL) -> list[str]:
        words = (motion.posture or NO_POSTURE).switches
        if not words or words == self._switches:
            return []
        if self.posture:
            raise JobError(
                "[post] posture", "cell.robot plans the posture", remedy="leave out one of the two"
            )
        self._switches = words
        return [self._spelled.word(word) for word in words]

    def _pace(self, text: str) -> list[str]:
        if text == self._speed:
            return []
        self._speed = text
        return [text]

    def output(self, item: Output) -> Sequence[str]:
        """SIGNAL; the motion before it has printed the BREAK that it needs."""
        number = self.signals[item.signal]
        return (self._spelled.signal(number if item.value else -number),)

    def wait(self, item: Wait) -> Sequence[str]:
        """WAIT.EVENT without an event: a dwell in seconds."""
        return (self._spelled.wait(item.seconds),)

    def stop(self, item: Stop) -> Sequence[str]:  # noqa: ARG002 (an optional one is refused)
        """PAUSE until the operator lets the task proceed; the motion before printed its BREAK."""
        return (f"{IN}PAUSE",)

    def comment(self, text: str) -> str:
        """A line of its own."""
        return f"; {text}"

    def assemble(self, program: Program, parts: Sequence[Sequence[str]]) -> tuple[OutputFile, ...]:
        """One file; a long program calls the programs of its parts, each with its work frame."""
        self._speed, self._posture_due, self._switches = "", True, ()
        if self.points == "file":
            body = [line for line in chain.from_iterable(parts) if line[0] != ";"]
            return self._assemble_data(program, body)
        if len(parts) == 1:
            return super().assemble(program, parts)
        name = self._name(program, len(parts))
        if self.program and name != self.program:
            raise Refused(
                self.name,
                rules.WHOLE,
                f"{self.program} is too long a name for {len(parts)} parts",
                f"shorten post.program to {len(name)} characters or raise post.max_lines",
            )
        lines = self._head(program, name, (self.tool,))
        lines += [f"{IN}CALL {name}.{k}()" for k in range(1, len(parts) + 1)]
        lines += self.end(program)
        speed: list[str] = []
        switches: list[str] = []
        planned = any(motion.posture for motion in program.columns.moves)
        # A printed part is one text, which each access to a line splits.
        for k, part in enumerate(map(list, parts), start=1):
            lines += ["", f".PROGRAM {name}.{k}()"]
            if self.declare:
                lines += [
                    f"{IN}AUTO {self.work}",
                    f"{IN}SET {self.work} = {self._lines.trans(program.base_from_work)}",
                ]
            # Each part sets its speed and posture: it is not confirmed that a CALL keeps them.
            lines += [*speed, *switches, *part, f"{IN}RETURN", ".END"]
            speed = _last_speed(part, speed)
            switches = rules.last_switches(part, switches) if planned else []
        return (OutputFile(self.file_name(program), "\n".join(lines) + "\n"),)

    def _assemble_data(self, program: Program, body: Sequence[str]) -> tuple[OutputFile, ...]:
        """Print the reader program and its data, with the same identification in both.

        body: records.
        """
        file = records.data_name(program.name)
        name = rules.program_name(
            self.program or program.name, 0, (self.tool, self.work, *records.VARIABLES)
        )
        head = self._head(program, name, (self.tool, self.work))
        settings = [line for line in head if not line.startswith((".", ";"))]
        identity = records.identify(settings, body)
        head[1:1] = [self.note(f"the motions are in {file} on the default disk")]
        lines = [
            *head,
            *records.reader(file, identity, len(body), self.work, records.signals_of(body)),
        ]
        text = OutputFile(self.file_name(program), "\n".join(lines) + "\n")
        return (text, OutputFile(file, records.data(identity, body)))


def _last_speed(part: Sequence[str], before: list[str]) -> list[str]:
    return next(([line] for line in reversed(part) if line.startswith(f"{IN}SPEED ")), before)
