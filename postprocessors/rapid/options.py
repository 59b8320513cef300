"""The options of the RAPID post with their checks, and its names, speeds and zones."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Literal

import numpy as np

from camgen.geometry.ragged import select_distinct
from camgen.model.errors import JobError
from camgen.model.pose import Pose, pose_from_values
from camgen.model.program import Columns
from camgen.model.text import counted, short
from camgen.post import Post

from .predefined import PREDEFINED, PREFIXES

#: mm/s: predefined speeds.
SPEEDS = {5, 10, 20, 30, 40, 50, 60, 80, 100, 150, 200, 300, 400, 500, 600, 800, 1000, 1500, 2000}
SPEEDS |= {2500, 3000, 4000, 5000, 6000, 7000}
#: Number of other speeds that get a name: the most frequent ones. Motions contain the rest.
MAX_NAMED = 6
#: Names of predefined zones by their radius at the TCP as it is printed, mm.
ZONES = {"0.3": "z0"} | {
    str(r): f"z{r}" for r in (1, 5, 10, 15, 20, 30, 40, 50, 60, 80, 100, 150, 200)
}
#: mm: largest coordinate at which a num (24 bits) still distinguishes 0.001 mm.
FARTHEST = 8388
#: kg: mass of tool0. A tool with this mass was not weighed.
NO_MASS = 0.001
#: Digits of a speed, a blend radius, a wait.
DIGITS = 3
#: Maximum length of names on IRC5 and later, and on S4.
LONGEST, LONGEST_S4 = 32, 16

_RESERVED = """
    alias and backward case connect const default div do else elseif endfor endfunc endif endmodule
    endproc endrecord endtest endtrap endwhile error exit false for from func goto if inout local
    mod module nostepin not noview or pers proc raise readonly record retry return step sysmodule
    task test then to trap true trynext undo var viewonly while with xor
""".split()  # noqa: SIM905 (sixty words read better so)
#: The system modules of older controllers, and what they declare (RAPID overview, system modules).
_RESIDENT = "base user wobj1 reg1 reg2 reg3 reg4 reg5 clock1 high low edge".split()  # noqa: SIM905
#: The PROC that drops the process.
SAFE = "camSafe"
_TAKEN = {"main", *PREDEFINED, *_RESIDENT, SAFE.lower()}
_NAME, _NO_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*"), re.compile(r"[^A-Za-z0-9_]")
#: Names that the post gives to the speeds and zones that it declares.
_OURS = re.compile(r"[vz]cam\d[\d_]*(t\d[\d_]*)?")


def find_name_fault(name: str, longest: int, installed: bool = False) -> str:
    """Return why `name` cannot be used; empty if it can.

    installed: whether it may be a name that the controller already has.
    """
    if not _NAME.fullmatch(name):
        return "is not a RAPID name: a letter, then letters, digits and _"
    if len(name) > longest:
        return f"is longer than {longest} characters"
    key = name.lower()
    if key in _RESERVED:
        return "is a reserved word of RAPID"
    is_ours = key[1:4] == "cam" and _OURS.fullmatch(key)
    if not installed and (is_predefined(key) or is_ours):
        return "is taken already: predefined, of a system module, or given by the post itself"
    return ""


def is_predefined(name: str) -> bool:
    """Whether the controller already has a name, as a word or as data."""
    key = name.lower()
    return key in _RESERVED or key in _TAKEN or key.startswith(PREFIXES)


def legal_name(text: str, longest: int, prefix: str = "m") -> str:
    """Return a name like `text` that can be used; `prefix` is put before one that cannot.

    >>> legal_name("10 Bracket-v2", 32), legal_name("MoveL", 32), legal_name("user", 32)
    ('m10_Bracket_v2', 'mMoveL', 'muser')
    """
    name = _NO_NAME.sub("_", text)[: longest - 1]
    return f"{prefix}{name}" if find_name_fault(name, longest) else name


#: The printed components of a speed that a program sets: TCP, mm/s, and reorientation, deg/s.
Speed = tuple[str, str]
#: deg/s: reorientation in every predefined speed. A motion that travels is limited by its TCP.
_PREDEFINED_TURN = "500"


def _print_speed(speed: float, turn: float) -> Speed:
    return short(speed, DIGITS), short(math.degrees(turn), DIGITS) if turn else _PREDEFINED_TURN


def name_speeds(columns: Columns) -> frozenset[Speed]:
    """Choose the speeds of a program that get a name: the most frequent ones."""
    used: Counter[Speed] = Counter()
    speeds, speed = np.unique(columns.speed, return_inverse=True)
    turns, turn = np.unique(columns.turn, return_inverse=True)
    pairs, counts = np.unique(speed * len(turns) + turn, return_counts=True)
    for pair, count in zip(pairs.tolist(), counts.tolist(), strict=True):
        k, j = divmod(pair, len(turns))
        used[_print_speed(float(speeds[k]), float(turns[j]))] += count
    others = [speed for speed in used if not _is_predefined(speed)]
    ranked = sorted(others, key=lambda speed: (-used[speed], *map(float, speed)))
    return frozenset(ranked[:MAX_NAMED])


def _is_predefined(speed: Speed) -> bool:
    return speed[1] == _PREDEFINED_TURN and float(speed[0]) in SPEEDS


@lru_cache(maxsize=1000)
def speed_text(speed: float, turn: float, named: frozenset[Speed]) -> str:
    """Print a speeddata: a predefined one, otherwise its name, otherwise its components.

    speed: speed of the TCP, mm/s.
    turn: speed of a reorientation at a fixed TCP, rad/s; 0 for other motions.
    named: speeds that have a name.
    """
    printed = _print_speed(speed, turn)
    if _is_predefined(printed):
        return f"v{printed[0]}"
    return _name_of(printed) if printed in named else _speeddata(printed)


def _name_of(speed: Speed) -> str:
    tcp, turn = (text.replace(".", "_") for text in speed)
    return f"vCam{tcp}" + ("" if turn == _PREDEFINED_TURN else f"t{turn}")


def _speeddata(speed: Speed) -> str:
    return f"[{speed[0]},{speed[1]},5000,1000]"


@lru_cache(maxsize=1000)
def zone_name(blend: float) -> str:
    """Return the name of the zonedata of `blend` mm, a stop point for 0."""
    text = short(blend, DIGITS)
    return "fine" if text == "0" else ZONES.get(text) or "zCam" + text.replace(".", "_")


def motion_data(columns: Columns, named: frozenset[Speed]) -> list[str]:
    """Declare the speeds that have a name, and the zones that are not predefined, in order of size.

    The ratio of 1.5 to the TCP radius is that of predefined zones.
    """
    speeds = sorted(named, key=lambda speed: tuple(map(float, speed)))
    lines = [f"CONST speeddata {_name_of(speed)}:={_speeddata(speed)};" for speed in speeds]
    zones = {short(blend, DIGITS) for blend in select_distinct(columns.blend).tolist()}
    for r in sorted(zones - {"0"} - set(ZONES), key=float):
        wide, angle = short(1.5 * float(r), DIGITS + 1), short(0.15 * float(r), DIGITS + 2)
        values = f"FALSE,{r},{wide},{wide},{angle},{wide},{angle}"
        lines.append(f"CONST zonedata {zone_name(float(r))}:=[{values}];")
    return lines


_LOAD = re.compile(r"\[N,\[N,N,N\],\[N,N,N,N\],N,N,N\]".replace("N", r"[+-]?[0-9]+(?:\.[0-9]+)?"))


@dataclass
class RapidOptions(Post):
    """Options of `[post]`, each with its help. Raises JobError for one that no controller takes."""

    max_lines: int = field(
        default=20000, kw_only=True, metadata={"help": "lines per module before it is split"}
    )
    tool: str = field(default="tCamgen", kw_only=True, metadata={"help": "name of the tooldata"})
    work: str = field(default="wCamgen", kw_only=True, metadata={"help": "name of the wobjdata"})
    declare: bool = field(
        default=True,
        kw_only=True,
        metadata={"help": "declare tool and work; false: they are on the controller"},
    )
    fixture: list[float] = field(
        default_factory=list,
        kw_only=True,
        metadata={
            "help": "the fixture in the robot's base, [x, y, z, rx, ry, rz] in mm and deg: "
            "it becomes the user frame, and where the work lies in it the object frame; "
            "empty: the user frame is the work frame"
        },
    )
    mass: float = field(
        default=NO_MASS,
        kw_only=True,
        metadata={"help": "mass of the tool, kg; the default is that of tool0"},
    )
    cog: list[float] = field(
        default_factory=lambda: [0.0, 0.0, 0.001],
        kw_only=True,
        metadata={"help": "centre of gravity of the tool at the flange, mm"},
    )
    signals: dict[str, str] = field(
        default_factory=lambda: {"process": "doProcess"},
        kw_only=True,
        metadata={"help": "controller name of each signal; spindle is an analog output"},
    )
    s4: bool = field(
        default=False, kw_only=True, metadata={"help": "for S4: names of 16 characters, plain PERS"}
    )
    conf: Literal["auto", "state", "off"] = field(
        default="auto",
        kw_only=True,
        metadata={
            "help": "auto: state the posture where it is known, and supervise it; "
            "state: only state it; off: never"
        },
    )
    on_error: Literal["raise", "exit", "none"] = field(
        default="raise",
        kw_only=True,
        metadata={
            "help": "an ERROR handler drops the process; "
            "raise: then the controller reports the error and stops; "
            "exit: it stops, and starts again from the top only; none: no handler"
        },
    )
    sing_area: Literal["", "wrist", "off"] = field(
        default="", kw_only=True, metadata={"help": "SingArea at the start; empty: not written"}
    )
    acc_set: list[float] = field(
        default_factory=list,
        kw_only=True,
        metadata={"help": "AccSet at the start: acceleration and ramp, %; empty: not written"},
    )
    force: Literal["fcpress", "ignore"] = field(
        default="fcpress",
        kw_only=True,
        metadata={"help": "fcpress: Machining FC; ignore: leave pressing out"},
    )
    force_load: str = field(
        default="",
        kw_only=True,
        metadata={"help": "loaddata for FCCalib, name or aggregate; empty: no FCCalib"},
    )
    force_calibrated: bool = field(
        default=False,
        kw_only=True,
        metadata={"help": "the cell sets the force sensor to zero, the program need not"},
    )
    force_threshold: float = field(
        default=50.0,
        kw_only=True,
        metadata={"help": "part of the force to feel before travel goes on, %"},
    )
    force_change: float = field(
        default=0.0, kw_only=True, metadata={"help": "ForceChange, N/s; 0: not written"}
    )
    force_distance: float = field(
        default=0.0, kw_only=True, metadata={"help": "PosSupvDist, mm; 0: not written"}
    )
    force_sign: Literal[1, -1] = field(
        default=1,
        kw_only=True,
        metadata={"help": "-1 where a positive force pulls along the tool axis"},
    )
    force_arcs: bool = field(
        default=False, kw_only=True, metadata={"help": "FCPressC for arcs; false: lines"}
    )

    @property
    def longest(self) -> int:
        """Maximum length of a name on the controller."""
        return LONGEST_S4 if self.s4 else LONGEST

    def __post_init__(self) -> None:
        self._check_names()
        ranges = {
            "decimals": (self.decimals, 0, 6),
            "max_lines": (self.max_lines, 0, 10**9),
            "mass": (self.mass, 0.001, 1000),
            "force_threshold": (self.force_threshold, 0, 100),
            "force_change": (self.force_change, 0, 10000),
            "force_distance": (self.force_distance, 0, 10000),
        }
        ranges |= {f"cog[{k}]": (value, -10000, 10000) for k, value in enumerate(self.cog)}
        ranges |= {
            f"fixture[{k}]": (value, -FARTHEST, FARTHEST) for k, value in enumerate(self.fixture)
        }
        limits = ((20, 100), (10, 100))
        ranges |= {f"acc_set[{k}]": (value, *limits[k]) for k, value in enumerate(self.acc_set[:2])}
        for option, (value, low, high) in ranges.items():
            if not low <= value <= high:
                raise JobError(f"[post] {option}", f"must be {low:g} to {high:g}, not {value:g}")
        self._check_lists()

    def _check_lists(self) -> None:
        remedies = {
            "cog": ((3,), "give x, y, z in mm"),
            "fixture": ((0, 6), "give x, y, z in mm and rx, ry, rz in deg"),
            "acc_set": ((0, 2), "give acceleration and ramp in %"),
        }
        for option, (sizes, remedy) in remedies.items():
            size = len(getattr(self, option))
            if size not in sizes:
                raise JobError(f"[post] {option}", counted(size, "number"), remedy=remedy)
        if self.fixture and not self.declare:
            raise JobError(
                "[post] fixture",
                "the work object is on the controller",
                remedy="leave out one of the two",
            )

    def name_tool(self, number: int, name: str) -> Mapping[str, object]:
        """Name the tooldata; a declared one by the number or the name of the tool.

        Raises JobError for a name that is not allowed in RAPID.
        """
        if self.declare and number:
            return {"tool": f"{self.tool}{number}"}
        if self.declare:
            return {"tool": legal_name(f"{self.tool}_{name}", self.longest)} if name else {}
        if fault := find_name_fault(name, self.longest, True):
            what = f"the tool {name!r} {fault}" if name else "a tool has no name"
            raise JobError(
                "job",
                what,
                "[[tools]] name",
                "with post.declare = false it is the name of the tooldata on the controller",
            )
        return {"tool": name}

    def held_tool(self) -> str:
        """Return the tooldata. Modules that declare it by the same name overwrite each other."""
        return f"tooldata {self.tool}"

    def place_fixture(self, base_from_work: Pose) -> Pose:
        """The user frame of the work object: the fixture, or the work frame itself."""
        if not self.fixture:
            return base_from_work
        return pose_from_values(self.fixture)

    def _check_names(self) -> None:
        names = {"tool": self.tool, "work": self.work}
        names |= {f"signals.{signal}": name for signal, name in self.signals.items()}
        if self.program:
            names["program"] = self.program
        if self.force_load and not _LOAD.fullmatch(self.force_load):
            names["force_load"] = self.force_load
        used: dict[str, str] = {}
        for option, name in names.items():
            present = option == "force_load" or (not self.declare and option in ("tool", "work"))
            fault = find_name_fault(name, self.longest, present)
            if not fault and name.lower() in used:
                fault = f"is the name of {used[name.lower()]} already"
            if fault:
                raise JobError(
                    f"[post] {option}", f"{name!r} {fault}", remedy="give it another name"
                )
            used[name.lower()] = option
