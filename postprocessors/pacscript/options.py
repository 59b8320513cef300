"""The options of the PacScript post, and the checks of them without a program."""

from __future__ import annotations

import re
import string
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import chain
from typing import Literal

from msgspec.structs import replace

from camgen.model.cell import Dynamics
from camgen.model.errors import JobError
from camgen.post import Post

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,63}")
_PARAM = "ForceParam {n}, 2, P({x}, {y}, {z}, 0, 0, 0) ' verify"
#: Words that cannot name a program: statements, functions, types, operators, the one-letter arrays,
#: and the name that the program itself gives. Case does not matter.
_RESERVED = set(
    """
    abs accel acos addhandler addpathpoint and angulartrigger approach archmove area areapos
    areasize array arrive as asc asin atn atn2 avec base bin bit buzzer byref byte byval call
    callbyname cao case changetool changework chr clearareadetected clearservolog clrerr
    clrpathpoint collisiondetection comm continueall convertposbase convertpostool
    convertposwork cos cpmode createarray createmultiarray createmutex cross crtmotionallow
    curacc curcpmode curdec curerr curexj curextacc curextdec curextspd curfig
    curforcesensorpayload curjnt curlmt curoptmode curpathpoint curpayload curpos curspd
    curspeedmode curtool curtrn curwork date deadmanstate decel defio degrad delay deletemutex
    depart destjnt destpos desttrn detectoff detecton dev devh dim dist do dot double dps draw
    drive drivea else elseif encmotionallow encmotionallowjnt end eralw err errlvl errmsg error
    exclusivearea exclusivecontrolstatus exit exp extaccel extdecel extspeed false fig fix for
    forcechangetable forcectrl forceparam forcesensor forcesensorpayload forcevalue
    forcewaitcondition format function getareadetected getcollisionstatus gethandio getlanguage
    getpathpoint getpathpointcount getpriority getpublicvalue getsrvdata getsrvjntdata givearm
    givemutex goto grvctrl grvoffset halt hand hex highpathaccuracy hold if instr instrrev int
    integer interrupt io j2p j2t join joint keep kill killall killbyname lbound lcase left len
    lenb let leta letf letj leto letp letr letrx letry letrz letx lety letz loadpathpoint
    lockstate log log10 loop ltrim magnitude main max mid min mod motioncomplete motionskip
    motiontimeout motor motorstate move mps msgbox mutexid mutexstate next normalvector not now
    off on or outputtcpspeed outrange ovec p2j p2t pagechange pagechangebyname pallet payload
    posclr position posrx posry posrz posx posy posz pow printdbg printmsg public pvec raddeg
    randomize readbytearray realpath rem removehandler reset resetarea resetexclusivearea
    resetmutex resume right rnd robinfo rotate rotateh rpm rtrim run runbyname rvec select set
    setarea setcollisiondetection setexclusivearea sethandio setpriority setpublicvalue sgn sin
    single singularavoid speed speedmode split sprintf sqr srvunlock startservolog static status
    statusbyname step stop stopservolog str string sub suspend suspendall suspendbyname
    swapbytearray synctime sysinfo syslog sysstate t2j t2p takearm takearmstate takemutex tan
    then time timer tinv tmul tnorm to tool toolpos trackapproach trackarrivaltime
    trackbufferdelete trackbufferindexes trackbufferread trackbuffersort trackconveyorspd
    trackconveyorvector trackcount trackcurbuffersort trackcurpos trackcurstartarea trackdepart
    trackencoder trackinitialize trackinrange trackminimumintervallength trackmove
    trackoffsetmargin tracksetsensor tracksetvision trackstandbypos trackstart trackstartarea
    trackstop tracktargetoffset tracktargetpos tracktargetrelease trans true ubound ucase until
    val varchangetype variant vartype vector ver virtualfence vis wait waitmotion while work
    workattribute workpos writebytearray xor zforce p j t v i f d s l c ptp unit
""".split()  # noqa: SIM905 (hundreds of words read better so)
)
#: Minimum and maximum of the options that are numbers.
_RANGES = {
    "tool": (0, 63),
    "work": (0, 63),
    "rated": (0, 1e5),
    "rated_turn": (1, 1e4),
    "ext_speed": (0, 100),
    "internal_speed": (0.1, 100),
    "accel": (0.0001, 100),
    "force_table": (1, 10),
    "decimals": (1, 6),
    "max_lines": (0, 10**9),
}
#: The highest number of an IO (manual 5512).
_LAST_IO = 24063


@dataclass
class PacScriptOptions(Post):
    """The options of `[post]`. Raises JobError for one that the controller does not take."""

    max_lines: int = field(
        default=5000, kw_only=True, metadata={"help": "body lines per Sub; 0: one Sub"}
    )
    tool: int = field(default=1, metadata={"help": "number for ChangeTool"})
    work: int = field(default=1, metadata={"help": "number for ChangeWork"})
    define: bool = field(
        default=False, metadata={"help": "write the tool and work frames to the controller"}
    )
    pass_mark: Literal["P", "mm"] = field(
        default="P", metadata={"help": "blends as @P, or as @n in whole mm"}
    )
    speed: Literal["mps", "percent"] = field(
        default="mps", metadata={"help": "Mps(), or percent of rated"}
    )
    mps: Literal["ask", "mm/s", "m/s"] = field(
        default="ask", metadata={"help": "unit of Mps(); ask: the program finds it out"}
    )
    rated: float = field(default=0.0, metadata={"help": "mm/s that 100 % stands for; 0: not known"})
    rated_turn: float = field(
        default=500.0,
        metadata={"help": "deg/s that 100 % is, for turns on the spot; a slower arm turns slower"},
    )
    ext_speed: float = field(
        default=0.0, metadata={"help": "external speed, %; 0: the pendant's is left as it is"}
    )
    internal_speed: float = field(
        default=10.0, metadata={"help": "% for motions added by hand without a Speed"}
    )
    accel: float = field(default=50.0, metadata={"help": "acceleration and deceleration, %"})
    signals: dict[str, int] = field(
        default_factory=lambda: {"process": 24}, metadata={"help": "IO number by signal"}
    )
    spindle: Literal["refuse", "on-off"] = field(
        default="refuse", metadata={"help": "on-off: IO without its rpm"}
    )
    force: Literal["refuse", "template", "ignore"] = field(
        default="refuse",
        metadata={"help": "template: force lines as below; ignore: leave force out"},
    )
    force_table: int = field(
        default=1, metadata={"help": "number of the force parameter table, {n}"}
    )
    force_on: list[str] = field(
        default_factory=lambda: [_PARAM, "ForceCtrl True, {n} ' verify"],
        metadata={"help": "lines that start force"},
    )
    force_change: list[str] = field(
        default_factory=lambda: [_PARAM], metadata={"help": "lines that change the force"}
    )
    force_off: list[str] = field(
        default_factory=lambda: ["ForceCtrl False ' verify"],
        metadata={"help": "lines that end force"},
    )

    def __post_init__(self) -> None:
        for name, (low, high) in _RANGES.items():
            value = getattr(self, name)
            if not low <= value <= high:
                raise JobError(f"[post] {name}", f"is {value}", remedy=f"give {low:g} to {high:g}")
        if 0 < self.ext_speed < _RANGES["accel"][0]:
            raise JobError(
                "[post] ext_speed",
                f"must be 0, or {_RANGES['accel'][0]:g} to 100, not {self.ext_speed:g}",
                remedy="smaller ones are printed as 0",
            )
        if self.speed == "percent" and not self.rated:
            raise JobError(
                '[post] speed = "percent"',
                "needs rated",
                remedy="give the arm's speed at 100 % in mm/s",
            )
        if self.define and not (self.tool and self.work):
            raise JobError(
                "[post] define",
                "cannot define tool 0 or work 0",
                remedy="give tool and work from 1 on",
            )
        if self.program and not _legal(self.program):
            raise JobError(
                "[post] program",
                f"{self.program} cannot name a program",
                remedy="a letter, then letters, digits and _, at most 64, no word of the language",
            )
        numbers = list(self.signals.values())
        if len(set(numbers)) < len(numbers) or min(numbers, default=0) < 0:
            raise JobError(
                "[post] signals",
                "two signals share an IO, or one is negative",
                remedy="one IO per signal",
            )
        if max(numbers, default=0) > _LAST_IO:
            raise JobError(
                "[post] signals",
                f"IO {max(numbers)} must be at most {_LAST_IO}",
                remedy="give an IO of the controller",
            )
        _check_template("force_on", self.force_on, {"x", "y", "z"})
        _check_template("force_change", self.force_change, {"x", "y", "z"})
        _check_template("force_off", self.force_off, set())

    def name_tool(self, number: int, name: str) -> Mapping[str, object]:
        """The number for ChangeTool. Raises JobError for one that the controller does not have."""
        first, last = _RANGES["tool"]
        if number > last:
            raise JobError(
                "job",
                f"tool {name or number} has the number {number}",
                "[[tools]] number",
                f"PacScript has tools {first} to {last}",
            )
        return {"tool": number} if number else {}

    def held_tool(self) -> str:
        """The number of the tool, unless the program defines it."""
        return "" if self.define else f"tool {self.tool}"

    def dynamics(self) -> Dynamics:
        """`Accel` is a fraction of 10 m/s2. With @P, speed and acceleration decide on corners."""
        corner: Literal["overlap", "zone"] = "overlap" if self.pass_mark == "P" else "zone"
        pace = Dynamics(acceleration=100.0 * self.accel, corner=corner, shares=True)
        fraction = (self.ext_speed or 100.0) / 100.0
        fastest = fraction * min(pace.fastest, self.rated or pace.fastest)
        return replace(pace, max_fraction=fraction, fastest=fastest)


def is_reserved(name: str) -> bool:
    """Whether a name is a word of the language."""
    return name.lower() in _RESERVED


def _legal(name: str) -> bool:
    return _NAME.fullmatch(name) is not None and not is_reserved(name)


def derive(name: str) -> str:
    """Make a name for files and Subs that the controller takes, as similar as possible."""
    text = re.sub(r"[^A-Za-z0-9_]", "_", name)[:60]
    return text if _legal(text) else f"job_{text}"


def _check_template(option: str, lines: list[str], needed: set[str]) -> None:
    """Check that lines are text with known fields, and all of `needed`. Raises JobError."""
    where = f"[post] {option}"
    try:
        parsed = chain.from_iterable(string.Formatter().parse(line) for line in lines)
        places = [place[1:] for place in parsed if place[1] is not None]
    except ValueError as error:
        raise JobError(
            where, "has a brace without its other half", remedy="write {{ for a brace"
        ) from error
    known = {"n", "x", "y", "z", "newtons"} if needed else {"n"}
    fields = {str(name) for name, _, _ in places}
    if (
        fields - known
        or needed - fields
        or any(spec or conversion for _, spec, conversion in places)
    ):
        raise JobError(
            where,
            f"has the places {sorted(fields)}",
            remedy=f"use {sorted(needed)}, of {sorted(known)}",
        )
    if not lines or not all(
        line.isascii() and line.isprintable() and line.strip() for line in lines
    ):
        raise JobError(where, "must be lines of ASCII text", remedy="give one list item per line")
