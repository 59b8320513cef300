"""The options of the PacScript post and what is checked about them before a program is seen."""

from __future__ import annotations

import re
import string
from dataclasses import dataclass, field
from typing import Literal

from camgen.model.cell import Dynamics
from camgen.model.errors import JobError
from camgen.post import Post

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,63}")
_PARAM = "ForceParam {n}, 2, P({x}, {y}, {z}, 0, 0, 0) ' verify"
#: Words that name no program: statements, types, operators, and the one-letter arrays. Case does not matter.
_RESERVED = set(re.findall(r"\w+", """
accel and approach archmove arrive as base byref byval call case changetool changework curjnt curpos date decel delay
depart dev devh dim do double draw drive drivea else elseif end error exit extaccel extdecel extspeed false fig for
forcectrl forceparam function givearm goto halt hold if integer interrupt io joint keep kill let loop main mod motor
move mps next not now off on or position printdbg printmsg public reset resume rem rotate rotateh run select set
single speed static step stop string sub suspend takearm then time timer to tool trans true until variant vector wait
waitmotion while work xor p j t v i f d s l c ptp
"""))  # fmt: skip
#: Least and greatest value of the options that are numbers.
_RANGES = {
    "tool": (0, 63), "work": (0, 63), "rated": (0, 1e5), "ext_speed": (0, 100), "internal_speed": (0.1, 100),
    "accel": (0.0001, 100), "force_table": (1, 10), "decimals": (1, 6), "max_lines": (0, 10**9),
}  # fmt: skip


@dataclass
class PacScriptOptions(Post):
    """Fields are options of ``[post]``. Raises JobError for one that the controller cannot be meant to take."""

    max_lines: int = field(default=5000, kw_only=True, metadata={"help": "body lines per Sub; 0: one Sub"})
    tool: int = field(default=1, metadata={"help": "number for ChangeTool"})
    work: int = field(default=1, metadata={"help": "number for ChangeWork"})
    define: bool = field(default=False, metadata={"help": "write the tool and work frames to the controller"})
    pass_mark: Literal["P", "mm"] = field(default="P", metadata={"help": "blends as @P, or as @n in whole mm"})
    speed: Literal["mps", "percent"] = field(default="mps", metadata={"help": "Mps(m/s), or percent of rated"})
    rated: float = field(default=0.0, metadata={"help": "mm/s that 100 % stands for; 0: not known"})
    ext_speed: float = field(default=0.0, metadata={"help": "external speed, %; 0: the pendant's is left as it is"})
    internal_speed: float = field(default=10.0, metadata={"help": "% for motions added by hand without a Speed"})
    accel: float = field(default=50.0, metadata={"help": "acceleration and deceleration, %"})
    signals: dict[str, int] = field(default_factory=lambda: {"process": 24}, metadata={"help": "IO number by signal"})
    spindle: Literal["refuse", "on-off"] = field(default="refuse", metadata={"help": "on-off: IO without its rpm"})
    force: Literal["refuse", "template", "ignore"] = field(
        default="refuse", metadata={"help": "template: force lines as below; ignore: leave force out"}
    )
    force_table: int = field(default=1, metadata={"help": "number of the force parameter table, {n}"})
    force_on: list[str] = field(
        default_factory=lambda: [_PARAM, "ForceCtrl True, {n} ' verify"], metadata={"help": "lines that start force"}
    )
    force_change: list[str] = field(default_factory=lambda: [_PARAM], metadata={"help": "lines that change the force"})
    force_off: list[str] = field(
        default_factory=lambda: ["ForceCtrl False ' verify"], metadata={"help": "lines that end force"}
    )

    def __post_init__(self) -> None:
        for name, (least, most) in _RANGES.items():
            if not least <= getattr(self, name) <= most:
                raise JobError(f"[post] {name}", f"is {getattr(self, name)}", remedy=f"give {least:g} to {most:g}")
        if self.speed == "percent" and not self.rated:
            raise JobError('[post] speed = "percent"', "needs rated", remedy="give the arm's speed at 100 % in mm/s")
        if self.define and not (self.tool and self.work):
            raise JobError("[post] define", "cannot define tool 0 or work 0", remedy="give tool and work from 1 on")
        if self.program and not _legal(self.program):
            remedy = "a letter, then letters, digits and _, at most 64, no word of the language"
            raise JobError("[post] program", f"{self.program} cannot name a program", remedy=remedy)
        numbers = list(self.signals.values())
        if len(set(numbers)) < len(numbers) or min(numbers, default=0) < 0:
            raise JobError("[post] signals", "two signals share an IO, or one is negative", remedy="one IO per signal")
        _check_template("force_on", self.force_on, {"x", "y", "z"})
        _check_template("force_change", self.force_change, {"x", "y", "z"})
        _check_template("force_off", self.force_off, set())

    def dynamics(self) -> Dynamics:
        """``Accel`` as a share of 10 m/s2. @P leaves the corner to speed and acceleration."""
        return Dynamics(acceleration=100.0 * self.accel, corner="overlap" if self.pass_mark == "P" else "zone")


def _legal(name: str) -> bool:
    return _NAME.fullmatch(name) is not None and name.lower() not in _RESERVED


def derive(name: str) -> str:
    """A name that the controller takes for files and Subs, as near to ``name`` as it allows."""
    text = re.sub(r"[^A-Za-z0-9_]", "_", name)[:60]
    return text if _legal(text) else f"job_{text}"


def _check_template(option: str, lines: list[str], needed: set[str]) -> None:
    """JobError unless the lines are plain text with the known places, all of ``needed`` among them."""
    where = f"[post] {option}"
    try:
        places = [place[1:] for line in lines for place in string.Formatter().parse(line) if place[1] is not None]
    except ValueError as error:
        raise JobError(where, "has a brace without its other half", remedy="write {{ for a brace") from error
    known = {"n", "x", "y", "z", "newtons"} if needed else {"n"}
    fields = {str(name) for name, _, _ in places}
    if fields - known or needed - fields or any(spec or conversion for _, spec, conversion in places):
        raise JobError(where, f"has the places {sorted(fields)}", remedy=f"use {sorted(needed)}, of {sorted(known)}")
    if not lines or not all(line.isascii() and line.isprintable() and line.strip() for line in lines):
        raise JobError(where, "must be lines of ASCII text", remedy="give one list item per line")
