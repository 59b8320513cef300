"""KRL as a language, from the description of it alone: nothing here is taken from the post."""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from camgen.lang.log import Log
from camgen.lang.programs import Executed, Frames, Language, RunRequest
from camgen.model.pose import Pose, frozen, rotation_about
from camgen.model.program import Instruction, Joints, MoveC, MoveJ, MoveL, Output, Wait

_NUMBER = r"(-?\d+(?:\.\d+)?)"
_FRAME = r"\{" + ", ".join(f"{name} {_NUMBER}" for name in "XYZABC") + r"\}"
_AXES = r"\{" + ", ".join(f"A{axis} {_NUMBER}" for axis in range(1, 7)) + r"\}"
#: Settings that stand once in a program, before the first motion, which depends on all of them.
_SETTINGS = ["BAS", "$IPO_MODE", "$ORI_TYPE", "$CIRC_TYPE", "$BASE", "$TOOL"]
_SETTINGS += [f"$VEL_AXIS[{axis}]" for axis in range(1, 7)]
#: Options that give numbers their meaning, with the defaults of the post.
_DEFAULTS = {"signals": {"process": 1}, "spindle_rpm": 0.0, "joint_speed": 10}
#: Speed of the TCP, mm/s, that is assumed for a PTP at 100 % of the axes.
_RATED = 1000.0


@dataclass
class _Controller:
    """The state of the controller, and the effect of the program so far.

    options: options of the post that wrote the program, None for a program of any author.
    rated: speed of the TCP of a PTP at 100 %, mm/s.
    settings: names of the settings so far.
    axis_speed, speed, zone: %, mm/s and mm, 0 until they are set.
    """

    options: Mapping[str, Any] | None
    rated: float
    number: int = 0
    settings: list[str] = field(default_factory=list)
    frames: dict[str, Pose] = field(default_factory=dict)
    axis_speed: float = 0.0
    speed: float = 0.0
    zone: float = 0.0
    body: list[Instruction] = field(default_factory=list)
    lines: list[int] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.log = Log(lambda: self.number)

    def take(self, line: str) -> None:
        self.number += 1
        for pattern, follow in _STATEMENTS.items():
            match = re.fullmatch(pattern, line)
            if match:
                return follow(self, *match.groups())
        return self.log.lose(f"not a statement that is known: {line}")

    def need(self, met: bool, what: str) -> None:
        """Add a finding of this line, unless the condition is met."""
        if not met:
            self.log.find("unusual" if self.options is None else "refused", what)

    def do(self, item: Instruction) -> None:
        self.body.append(item)
        self.lines.append(self.number)

    def set_once(self, name: str, percent: str = "") -> None:
        """A setting for the whole program. BAS gives every variable of motions a default."""
        is_later = bool(self.settings or self.speed or self.zone)
        self.need((name == "BAS") != is_later, "BAS must come before other settings")
        is_first = name not in self.settings and not self.body
        self.need(is_first, f"{name} must be set once, before the first motion")
        if percent:
            self.axis_speed = float(percent)
            self.need(0 < self.axis_speed <= 100, f"{name} must be above 0 and at most 100 %")
            wanted = self.axis_speed if self.options is None else self.options["joint_speed"]
            self.need(self.axis_speed == wanted, f"{name} must be joint_speed, {wanted:g} %")
        self.settings.append(name)

    def place(self, name: str, *values: str) -> None:
        """$BASE in the world, $TOOL at the flange."""
        self.set_once(name)
        self.frames[name] = _pose(values)

    def go_at(self, metres_per_second: str) -> None:
        self.speed = 1000 * float(metres_per_second)

    def round_within(self, millimetres: str) -> None:
        self.zone = float(millimetres)

    def ptp_axes(self, *degrees: str) -> None:
        """PTP to axis values."""
        missing = [name for name in _SETTINGS if name not in self.settings]
        self.need(not missing, f"{', '.join(missing)} must be set before the first motion")
        self.ptp_to(Joints(tuple(math.radians(float(value)) for value in degrees)))

    def ptp(self, *values: str) -> None:
        """PTP to a pose without S and T: the arm keeps the posture of an earlier motion."""
        self.moved()
        self.ptp_to(_pose(values))

    def ptp_to(self, target: Pose | Joints) -> None:
        """PTP. Its speed is $VEL_AXIS, which says nothing of the speed of the TCP."""
        if self.options is None:
            self.log.assume("the TCP moves at this speed in a PTP of 100 %", "rated", self.rated)
        self.do(MoveJ(target, max(1.0, self.rated * self.axis_speed / 100)))

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
        name, on = f"$OUT[{number}]", 1.0
        if self.options is not None:
            names = {output: signal for signal, output in self.options["signals"].items()}
            name = names.get(int(number), "")
            on = self.options["spindle_rpm"] if name == "spindle" else 1.0
        self.need(name != "", f"no signal has the output {number}")
        self.do(Output(name, on if value == "TRUE" else 0.0))


def _pose(values: Sequence[str]) -> Pose:
    """X, Y, Z in mm; A about z, then B about the new y, then C about the new x, in degrees."""
    x, y, z, *angles = map(float, values)
    a, b, c = map(math.radians, angles)
    return Pose(
        frozen(rotation_about(2, a) @ rotation_about(1, b) @ rotation_about(0, c)), (x, y, z)
    )


#: Every line that a program may have, and its effect.
_STATEMENTS: dict[str, Callable[..., None]] = {
    r"DEF [A-Za-z]\w{0,23}\(\)|;.*|END": lambda _: None,
    r"(BAS)\(#INITMOV, 0\)": _Controller.set_once,
    r"(\$IPO_MODE|\$CIRC_TYPE)=#BASE": _Controller.set_once,
    r"(\$ORI_TYPE)=#VAR": _Controller.set_once,
    rf"(\$VEL_AXIS\[[1-6]\])={_NUMBER}": _Controller.set_once,
    rf"(\$BASE|\$TOOL)={_FRAME}": _Controller.place,
    rf"\$VEL\.CP={_NUMBER}": _Controller.go_at,
    rf"\$APO\.CDIS={_NUMBER}": _Controller.round_within,
    rf"PTP {_AXES}": _Controller.ptp_axes,
    rf"PTP {_FRAME}": _Controller.ptp,
    rf"LIN {_FRAME}( C_DIS)?": _Controller.lin,
    rf"CIRC {_FRAME}, {_FRAME}( C_DIS)?": _Controller.circ,
    r"\$OUT\[(\d+)\]=(TRUE|FALSE)": _Controller.switch,
    rf"WAIT SEC {_NUMBER}": lambda controller, seconds: controller.do(Wait(float(seconds))),
}


def run(files: Mapping[str, str], request: RunRequest) -> Executed:
    """Runs the program, strictly if the request has the options of the post that wrote it."""
    options = None if request.options is None else {**_DEFAULTS, **request.options}
    controller = _Controller(options, request.assume.get("rated", _RATED))
    text = "\n".join(files.values()).splitlines()
    for line in text:
        controller.take(line)
    ends = [line.split(" ")[0] for line in text if line.startswith(("DEF", "END"))]
    controller.need(
        ends == ["DEF", "END"] == [text[0][:3], text[-1]], "a program runs from DEF to END"
    )
    work, tool = (controller.frames.get(name) for name in ("$BASE", "$TOOL"))
    return Executed(
        tuple(controller.body),
        tuple(controller.lines),
        (Frames("$TOOL", "$BASE", tool, work),),
        findings=controller.log.list_findings(),
        assumed=controller.log.list_assumed(),
        lost=controller.log.list_lost(),
    )


KRL = Language(
    name="krl",
    about="KUKA KRL, the worked example of the post tutorial",
    suffixes=(".src",),
    recognise=lambda text: "BAS(#INITMOV" in text[:5000].replace(" ", ""),
    run=run,
)
