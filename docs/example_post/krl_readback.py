"""Reads a KRL program back, from the description of the language alone: nothing here is taken from the post."""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from camgen.model.pose import Pose, frozen, rotation_about
from camgen.model.program import Instruction, Joints, MoveC, MoveJ, MoveL, Output, Wait
from camgen.post import Fault, Reading

_NUMBER = r"(-?\d+(?:\.\d+)?)"
_FRAME = r"\{" + ", ".join(f"{name} {_NUMBER}" for name in "XYZABC") + r"\}"
_AXES = r"\{" + ", ".join(f"A{axis} {_NUMBER}" for axis in range(1, 7)) + r"\}"
#: What is set once, before the first motion, which depends on all of it.
_SETTINGS = (
    "BAS",
    "$IPO_MODE",
    "$ORI_TYPE",
    "$CIRC_TYPE",
    "$BASE",
    "$TOOL",
    *(f"$VEL_AXIS[{k}]" for k in range(1, 7)),
)
#: Options that are numbers, with the defaults of the post.
_NUMBERS = {"spindle_rpm": 0.0, "joint_speed": 10}


@dataclass
class _Reader:
    """The controller as it goes through a program: what it has been told, and what it has done.

    signals: names by number of output.
    rpm: of the spindle while it is on.
    percent: speed of PTP, `joint_speed` of the job.
    settings: those of ``_SETTINGS`` that are set.
    speed, zone: mm/s and mm, 0 until they are set.
    """

    signals: Mapping[int, str]
    rpm: float
    percent: float
    number: int = 0
    settings: list[str] = field(default_factory=list)
    frames: dict[str, Pose] = field(default_factory=dict)
    speed: float = 0.0
    zone: float = 0.0
    body: list[Instruction] = field(default_factory=list)
    lines: list[int] = field(default_factory=list)
    faults: list[Fault] = field(default_factory=list)

    def take(self, line: str) -> None:
        self.number += 1
        for pattern, follow in _STATEMENTS.items():
            match = re.fullmatch(pattern, line)
            if match:
                return follow(self, *match.groups())
        return self.need(False, f"not a statement that is known: {line}")

    def need(self, met: bool, what: str) -> None:
        """A fault of this line, unless the condition is met."""
        if not met:
            self.faults.append(Fault(self.number, what))

    def do(self, item: Instruction) -> None:
        self.body.append(item)
        self.lines.append(self.number)

    def settle(self, name: str, percent: str = "") -> None:
        """A setting for the whole program. BAS(#INITMOV, 0) gives every variable of motions a default."""
        self.need(
            (name == "BAS") != bool(self.settings or self.speed or self.zone),
            "BAS must come before other settings",
        )
        self.need(
            name not in self.settings and not self.body,
            f"{name} must be set once, before the first motion",
        )
        if percent:
            self.need(0 < float(percent) <= 100, f"{name} must be above 0 and at most 100 %")
            wanted = self.percent
            self.need(float(percent) == wanted, f"{name} must be joint_speed, {wanted:g} %")
        self.settings.append(name)

    def place(self, name: str, *values: str) -> None:
        """$BASE in the world, $TOOL at the flange."""
        self.settle(name)
        self.frames[name] = _pose(values)

    def go_at(self, metres_per_second: str) -> None:
        self.speed = 1000 * float(metres_per_second)

    def round_within(self, millimetres: str) -> None:
        self.zone = float(millimetres)

    def ptp_axes(self, *degrees: str) -> None:
        """PTP to axis values. Its speed is $VEL_AXIS, which says nothing of the tool: 1 mm/s stands for it."""
        missing = [name for name in _SETTINGS if name not in self.settings]
        self.need(not missing, f"{', '.join(missing)} must be set before the first motion")
        self.do(MoveJ(Joints(tuple(math.radians(float(value)) for value in degrees)), 1.0))

    def ptp(self, *values: str) -> None:
        """PTP to a pose without S and T: the arm stays as it stands, so an earlier motion must have said how."""
        self.moved()
        self.do(MoveJ(_pose(values), 1.0))

    def lin(self, *values: str) -> None:
        """LIN, and C_DIS where the tool need not stop."""
        self.do(MoveL(_pose(values[:6]), self.moved(path=True), self.corner(values[6])))

    def circ(self, *values: str) -> None:
        """CIRC: the auxiliary point, the end."""
        speed, corner = self.moved(path=True), self.corner(values[12])
        self.do(MoveC(_pose(values[:6]), _pose(values[6:12]), speed, corner))

    def moved(self, *, path: bool = False) -> float:
        """The speed, mm/s, of a motion that relies on those before it."""
        self.need(
            any(isinstance(item, MoveJ) for item in self.body),
            "the first motion must be PTP to axis values",
        )
        self.need(self.speed > 0 or not path, "$VEL.CP must be set, and positive")
        return self.speed

    def corner(self, word: str | None) -> float:
        self.need(self.zone > 0 or not word, "C_DIS without a positive $APO.CDIS")
        return self.zone if word else 0.0

    def switch(self, number: str, value: str) -> None:
        """$OUT; the spindle turns with its rpm while its output is on."""
        name = self.signals.get(int(number), "")
        self.need(name != "", f"no signal has the output {number}")
        self.do(Output(name, (self.rpm if name == "spindle" else 1.0) if value == "TRUE" else 0.0))


def _number(value: object) -> float:
    return float(value) if isinstance(value, (int, float)) else 0.0


def _pose(values: Sequence[str]) -> Pose:
    """X, Y, Z in mm; A about z, then B about the new y, then C about the new x, in degrees."""
    x, y, z, *angles = map(float, values)
    a, b, c = map(math.radians, angles)
    return Pose(
        frozen(rotation_about(2, a) @ rotation_about(1, b) @ rotation_about(0, c)), (x, y, z)
    )


#: Every line that may stand in a program, and what the controller does.
_STATEMENTS: dict[str, Callable[..., None]] = {
    r"DEF [A-Za-z]\w{0,23}\(\)|;.*|END": lambda _: None,
    r"(BAS)\(#INITMOV, 0\)": _Reader.settle,
    r"(\$IPO_MODE|\$CIRC_TYPE)=#BASE": _Reader.settle,
    r"(\$ORI_TYPE)=#VAR": _Reader.settle,
    rf"(\$VEL_AXIS\[[1-6]\])={_NUMBER}": _Reader.settle,
    rf"(\$BASE|\$TOOL)={_FRAME}": _Reader.place,
    rf"\$VEL\.CP={_NUMBER}": _Reader.go_at,
    rf"\$APO\.CDIS={_NUMBER}": _Reader.round_within,
    rf"PTP {_AXES}": _Reader.ptp_axes,
    rf"PTP {_FRAME}": _Reader.ptp,
    rf"LIN {_FRAME}( C_DIS)?": _Reader.lin,
    rf"CIRC {_FRAME}, {_FRAME}( C_DIS)?": _Reader.circ,
    r"\$OUT\[(\d+)\]=(TRUE|FALSE)": _Reader.switch,
    rf"WAIT SEC {_NUMBER}": lambda reader, seconds: reader.do(Wait(float(seconds))),
}


def read(files: Mapping[str, str], options: Mapping[str, object]) -> Reading:
    """What the files say. options: as in ``[post]``, for what the outputs mean."""
    given = options.get("signals", {"process": 1})
    rpm, percent = (_number(options.get(name, default)) for name, default in _NUMBERS.items())
    names = {number: name for name, number in given.items()} if isinstance(given, dict) else {}
    reader = _Reader(names, rpm, percent)
    text = [line for content in files.values() for line in content.splitlines()]
    for line in text:
        reader.take(line)
    frame = [line.split(" ")[0] for line in text if line.startswith(("DEF", "END"))]
    reader.need(
        frame == ["DEF", "END"] == [text[0][:3], text[-1]], "a program runs from DEF to END"
    )
    frames = (reader.frames.get(name) for name in ("$BASE", "$TOOL"))
    return Reading(tuple(reader.body), tuple(reader.lines), tuple(reader.faults), *frames)
