"""Names in RAPID: which ones a controller takes, and which speeds and zones it has already.

RAPID kernel manual 2.3 and 2.4; system data types manual, speeddata and zonedata.
"""

from __future__ import annotations

import re
from functools import lru_cache

import numpy as np

from camgen.ir import Program
from camgen.text import short

SPEEDS = {
    5, 10, 20, 30, 40, 50, 60, 80, 100, 150, 200, 300, 400, 500, 600, 800,
    1000, 1500, 2000, 2500, 3000, 4000, 5000, 6000, 7000,
}  # fmt: skip
#: Radius at the TCP, as it is printed -> name.
ZONES = {"0.3": "z0"} | {str(r): f"z{r}" for r in (1, 5, 10, 15, 20, 30, 40, 50, 60, 80, 100, 150, 200)}
#: Digits of a speed, a blend radius, a wait.
DIGITS = 3
#: The longest name on IRC5 and later, and on S4.
LONGEST, LONGEST_S4 = 32, 16

_RESERVED = """
    alias and backward case connect const default div do else elseif endfor endfunc endif endmodule endproc endrecord
    endtest endtrap endwhile error exit false for from func goto if inout local mod module nostepin not noview or pers
    proc raise readonly record retry return step sysmodule task test then to trap true trynext undo var viewonly while
    with xor""".split()  # noqa: SIM905 (sixty words read better so)
_INSTALLED = """
    main fine vmax tool0 wobj0 load0 high low pi bool num dnum string byte pos orient pose confdata robjoint extjoint
    robtarget jointtarget speeddata zonedata tooldata wobjdata loaddata signaldo signalao moveabsj movej movel movec
    movejdo moveldo movecdo offs reltool calcrobt crobt setdo setao setgo set reset pulsedo waittime waitdi waituntil
    confl confj singarea accset velset tpwrite tperase stop fcact fcdeact fccalib fcpress1lstart fcpressl fcpressc
    fcpressend triggio triggl load unload""".split()  # noqa: SIM905
_TAKEN = {*_INSTALLED, *(f"v{v}" for v in SPEEDS), *ZONES.values()}
#: Names that the post gives to what it declares itself: speeds, zones, parts.
_OURS = re.compile(r"(?:[vz]cam\d[\d_]*|part\d+)", re.IGNORECASE)


def name_fault(name: str, longest: int, installed: bool = False) -> str:
    """Why ``name`` cannot be used, empty when it can. installed: it may be one that the controller has already."""
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name):
        return "is not a RAPID name: a letter, then letters, digits and _"
    if len(name) > longest:
        return f"is longer than {longest} characters"
    if name.lower() in _RESERVED:
        return "is a reserved word of RAPID"
    if not installed and (name.lower() in _TAKEN or _OURS.fullmatch(name)):
        return "is taken already: predefined, or given by the post itself"
    return ""


def legal_name(text: str, longest: int) -> str:
    """The name nearest to ``text`` that can be used.

    >>> legal_name("10 Bracket-v2", 32), legal_name("MoveL", 32)
    ('m10_Bracket_v2', 'mMoveL')
    """
    name = re.sub(r"[^A-Za-z0-9_]", "_", text)[: longest - 1]
    return f"m{name}" if name_fault(name, longest) else name


@lru_cache(maxsize=1000)
def speed_name(speed: float) -> str:
    """The speeddata of ``speed`` (mm/s): predefined where there is one, else declared by ``motion_data``."""
    text = short(speed, DIGITS)
    return f"v{text}" if float(text) in SPEEDS else "vCam" + text.replace(".", "_")


@lru_cache(maxsize=1000)
def zone_name(blend: float) -> str:
    """The zonedata of ``blend`` (mm), a stop point for 0."""
    text = short(blend, DIGITS)
    return "fine" if text == "0" else ZONES.get(text) or "zCam" + text.replace(".", "_")


def motion_data(program: Program) -> list[str]:
    """Declarations of the speeds and zones that are not predefined, slow and small ones first.

    The components beside the TCP speed, and a zone's ratio of 1.5 to the TCP radius, are those of the predefined ones.
    """
    speeds = {short(speed, DIGITS) for speed in np.unique(program.columns.speed).tolist()}
    zones = {short(blend, DIGITS) for blend in np.unique(program.columns.blend).tolist()}
    lines = [
        f"CONST speeddata {speed_name(float(v))}:=[{v},500,5000,1000];"
        for v in sorted(speeds, key=float)
        if float(v) not in SPEEDS
    ]
    for r in sorted(zones - {"0"} - set(ZONES), key=float):
        wide, angle = short(1.5 * float(r), DIGITS + 1), short(0.15 * float(r), DIGITS + 2)
        lines.append(f"CONST zonedata {zone_name(float(r))}:=[FALSE,{r},{wide},{wide},{angle},{wide},{angle}];")
    return lines
