"""The options of the RAPID post, and what of them cannot be meant."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Literal

from camgen.errors import JobError
from camgen.post import Post

from .rapid_names import LONGEST, LONGEST_S4, name_fault

_LOAD = re.compile(r"\[N,\[N,N,N\],\[N,N,N,N\],N,N,N\]".replace("N", r"[+-]?[0-9]+(?:\.[0-9]+)?"))


@dataclass
class RapidOptions(Post):
    """Options of ``[post]``, each with its help. JobError for one that no controller takes."""

    max_lines: int = field(default=20000, kw_only=True, metadata={"help": "lines per module before it is split"})
    tool: str = field(default="tCamgen", kw_only=True, metadata={"help": "name of the tooldata"})
    work: str = field(default="wCamgen", kw_only=True, metadata={"help": "name of the wobjdata"})
    declare: bool = field(
        default=True, kw_only=True, metadata={"help": "declare tool and work; false: they are on the controller"}
    )
    mass: float = field(default=0.001, kw_only=True, metadata={"help": "mass of the tool, kg"})
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
    s4: bool = field(default=False, kw_only=True, metadata={"help": "for S4: names of 16 characters, plain PERS"})
    conf: Literal["auto", "state", "off"] = field(
        default="auto",
        kw_only=True,
        metadata={
            "help": "auto: state the posture where it is known, and supervise it; state: only state it; off: never"
        },
    )
    force: Literal["fcpress", "ignore"] = field(
        default="fcpress", kw_only=True, metadata={"help": "fcpress: Machining FC; ignore: leave pressing out"}
    )
    force_load: str = field(
        default="", kw_only=True, metadata={"help": "loaddata for FCCalib, name or aggregate; empty: no FCCalib"}
    )
    force_threshold: float = field(
        default=50.0, kw_only=True, metadata={"help": "part of the force to feel before travel goes on, %"}
    )
    force_change: float = field(default=0.0, kw_only=True, metadata={"help": "ForceChange, N/s; 0: not written"})
    force_distance: float = field(default=0.0, kw_only=True, metadata={"help": "PosSupvDist, mm; 0: not written"})
    force_sign: Literal[1, -1] = field(
        default=1, kw_only=True, metadata={"help": "-1 where a positive force pulls along the tool axis"}
    )
    force_arcs: bool = field(default=False, kw_only=True, metadata={"help": "FCPressC for arcs; false: lines"})

    @property
    def longest(self) -> int:
        """The longest name that the controller takes."""
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
        for option, (value, least, most) in ranges.items():
            if not least <= value <= most:
                raise JobError(f"[post] {option}", f"{value:g} is not {least:g} to {most:g}")
        if len(self.cog) != 3:
            raise JobError("[post] cog", f"{len(self.cog)} numbers", remedy="give x, y, z in mm")

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
            fault = name_fault(name, self.longest, present)
            if not fault and name.lower() in used:
                fault = f"is the name of {used[name.lower()]} already"
            if fault:
                raise JobError(f"[post] {option}", f"{name!r} {fault}", remedy="give it another name")
            used[name.lower()] = option
