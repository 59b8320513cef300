"""Differences between controllers of G-code, as tables.

The option ``--dialect`` names a dialect. Without it, the text determines the dialect.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from msgspec import Struct, field

from camgen.lang.gcode.arcs import LINUXCNC as LINUXCNC_ARCS
from camgen.lang.gcode.arcs import Limits
from camgen.lang.gcode.words import GROUP

#: Speed of G0, mm/s. No text states it, and a motion needs a positive speed.
RAPID = 100.0


class Dialect(Struct, frozen=True):
    """One kind of controller.

    source: manual or source code that the facts come from.
    signs: text that no other dialect writes.
    codes: modal group of each code that it takes.
    open: whether other codes are facts of the program; otherwise they are refused.
    names: usual name of each code that it spells another way.
    idle: effect of each code without a motion.
    dwell: length of one unit of P in G4 and in cycles, s.
    nested: whether comments may stand within comments and may lack their end.
    flow: whether it runs O-words of LinuxCNC.
    default_feed: whether a motion at feed without F runs at a feed of the machine.
    unit_first: whether F counts in the unit of its own line, None if a line must not have both.
    needs_end: whether a program ends with M2, M30 or per cent signs.
    arcs: limits of arcs.
    increments: whether U, V and W are increments of X, Y and Z.
    letters: letters of its words, with plain numbers; "" for any letter, with expressions.
    ends_arcs: whether an arc names an axis of its plane.
    homes: whether G28 goes to the origin.
    to_start: whether a cycle without G98 and G99 retracts to the height of its start.
    diameter: whether X is a diameter.
    extruder: whether E is filament.
    has_beams: whether the machine may be a laser whose beam is off in G0.
    """

    name: str
    source: str
    signs: re.Pattern[str]
    codes: Mapping[str, str] = field(default_factory=lambda: GROUP)
    open: bool = True
    names: Mapping[str, str] = field(default_factory=dict)
    idle: Mapping[str, str] = field(default_factory=dict)
    dwell: float = 1.0
    nested: bool = True
    flow: bool = False
    default_feed: bool = False
    unit_first: bool | None = True
    needs_end: bool = False
    arcs: Limits = LINUXCNC_ARCS
    increments: bool = False
    letters: str = ""
    ends_arcs: bool = False
    homes: bool = False
    to_start: bool = True
    diameter: bool = False
    extruder: bool = False
    has_beams: bool = False


def _signs(*patterns: str) -> re.Pattern[str]:
    return re.compile("|".join(patterns), re.IGNORECASE | re.MULTILINE)


_REMAP = "a program or remap of the user's"
_LATHE, _FUNCTION, _HOMING = "a lathe cycle", "a function of a printer", "homing"
#: Effects without a motion that are lost on another machine.
LOSSES = frozenset([_REMAP, _LATHE, _FUNCTION, _HOMING])
_USER = dict.fromkeys((f"M{n}" for n in range(100, 200)), _REMAP)
#: Lathe cycles of LinuxCNC 2.9 and of Fanuc.
_TURNING = dict.fromkeys(("G70", "G71", "G71.1", "G71.2", "G72", "G72.1", "G72.2"), "turning")

LINUXCNC = Dialect(
    name="linuxcnc",
    source="LinuxCNC manual, G-Code Reference; tried with its interpreter rs274",
    signs=_signs(
        r"^[ \t]*(?:n\d+[ \t]*)?o(?:<[^>]*>|\d+)[ \t]*(?:sub|if|while|do|repeat|call)\b",
        r"#<[^>]+>",
        r"\(debug,",
        r"\bg64[ \t]*p",
        r"\bm6[2-6][ \t]*p",
        r"\bm6[78][ \t]*e",
        r"\bm5[0-3][ \t]*p",
        # A curve: where G5.1 is a switch, it takes no I or J.
        r"\bg0?5\.1(?=[^(;\n]*[ij][ \t]*[-+.\d\[#])",
    ),
    codes={code: group for code, group in GROUP.items() if code != "M97"} | _TURNING,
    open=False,
    idle=_USER,
    nested=False,
    flow=True,
    unit_first=False,
    needs_end=True,
    to_start=False,
)
_GRBL_CODES = """
    G0 G1 G2 G3 G4 G10 G17 G18 G19 G20 G21 G28 G28.1 G30 G30.1 G38.2 G38.3 G38.4 G38.5 G40 G43.1
    G49 G53 G54 G55 G56 G57 G58 G59 G61 G80 G90 G91 G91.1 G92 G92.1 G93 G94
    M0 M1 M2 M3 M4 M5 M7 M8 M9 M30
"""
GRBL = Dialect(
    name="grbl",
    source="gnea/grbl 1.1: gcode.c, error_codes_en_US.csv",
    signs=_signs(r"^[ \t]*\$[$#GICXHNJRS0-9]", r"\bgrbl\b"),
    codes={code: GROUP[code] for code in _GRBL_CODES.split()},
    open=False,
    idle={"M56": "parking override"},
    has_beams=True,
    letters="fgijklmnprstxyz",
    ends_arcs=True,
    arcs=Limits(spiral=(0.005, 0.5, 0.005), shorter=0.0, least_radius=1e-6, turns=False),
)
#: Limits of controllers on which a setting limits the difference between the radii of an arc.
_LOOSE = Limits(spiral=(0.1, 2.83, 0.1), shorter=0.05, least_radius=1e-6, turns=True)
_MACHINING = {
    "G5.1": "look-ahead on",
    "G8": "look-ahead on",
    "G15": "polar coordinates off",
    "G22": "stroke check on",
    "G23": "stroke check off",
    "G50": "scaling off, or the greatest spindle speed",
    "G50.1": "mirroring off",
    "G60": "positioning from one side",
    "G62": "corners slowed down",
    "G63": "tapping mode",
    "G9": "exact stop",
    "G103": "look-ahead limit",
    "G187": "smoothness",
}
#: Words of codes without a motion. The other words of such a line are those of the modal motion.
OWN_WORDS = {
    "G5.1": "PQRXYZ", "G8": "P", "G22": "XYZIJK", "G50": "S", "G50.1": "XYZ", "G103": "P",
    "G187": "PE",
}  # fmt: skip
_ROTATION = dict.fromkeys(("G68", "G69"), "rotation")
FANUC = Dialect(
    name="fanuc",
    source="Fanuc Series 0i-MF operator's manual (B-64694); Haas mill operator's manual",
    signs=_signs(
        r"^[ \t]*%?[ \t]*[o:]\d{4,5}\b(?![ \t]*(?:sub|call|if|while|do|repeat))",
        r"\bg28[ \t]*(?:g91[ \t]*)?[uvw]",
        r"\bm98[ \t]*p\d",
        r"\bg65[ \t]*p",
        r"\bgoto[ \t]*\d",
        r"\bt\d{4}\b",
        r"\bg05\.1\b",
        r"\bg187\b",
    ),
    idle=_MACHINING,
    codes=GROUP
    | _ROTATION
    | {"G65": "subprogram", "G66": "modal macro", "G67": "modal macro"}
    | dict.fromkeys(("G12", "G13"), "circular pocket"),
    names={"G31": "G38.2"},
    dwell=0.001,
    arcs=_LOOSE,
    increments=True,
)
_LATHE_CYCLES = ("G73", "G74", "G75", "G76", "G90", "G92", "G94")
LATHE = Dialect(
    name="fanuc-lathe",
    source="Fanuc Series 0i-TF operator's manual (B-64694), G-code system A; "
    "Haas lathe operator's manual",
    signs=_signs(r"\bg50[ \t]*s\d", r"\bt\d{4}\b(?![\s\S]{0,40}\bm0?6\b)"),
    names={"G98": "G94", "G99": "G95", "G32": "G33"},
    idle=_MACHINING | dict.fromkeys(_LATHE_CYCLES, _LATHE),
    codes={code: group for code, group in GROUP.items() if code not in _LATHE_CYCLES} | _TURNING,
    dwell=0.001,
    arcs=_LOOSE,
    increments=True,
    diameter=True,
)
MACH3 = Dialect(
    name="mach3",
    source="Using Mach3Mill (ArtSoft), chapter 10",
    signs=_signs(
        r"\bmach[ -]?[23]\b",
        r"\bm98[ \t]*p\d+[ \t]*l",
        r"\bg7[01][ \t]*g91\.1",
        r"\bg7[01][ \t]*$",
    ),
    names={"G70": "G20", "G71": "G21", "G40.1": "G40", "G31": "G38.2"},
    idle={"G15": "polar mode off", "G50": "scaling off", "G48": "slow feeds"},
    codes=GROUP | _ROTATION,
    arcs=_LOOSE,
    default_feed=True,
)
#: Codes that have another effect on a printer than on a mill, and G5, in the order of the table.
_PRINTER_CODES = """
    M17 M18 M20 M21 M22 M23 M24 M25 M26 M27 M28 M29 M31 M42 M70 M71 M72 M73 M74 M75 M76 M77 M78 M80
    M81 M82 M83 M84 M85 M92 G130 G161 G162 G10 G11 G12 G29 G42 G60 G61 G76 G80 G81 G26 G27 G32 G34
    G35 G5.1 G5
"""
_PRINTER = dict.fromkeys(_PRINTER_CODES.split(), _FUNCTION)
MARLIN = Dialect(
    name="marlin",
    source="marlinfw.org/meta/gcode",
    signs=_signs(
        r"^;[ \t]*flavor:",
        r"^[ \t]*(?:n\d+[ \t]*)?m(?:10[4-9]|140|190|82|83|84|20[1-9]|300|117|907)\b",
        r"\bg92[ \t]*e",
        r"^[ \t]*n\d+[^;(#\[=\n]*\*\d+[ \t]*$",
        r"^[ \t]*g[01][^(;\n]*\be-?\d",
    ),
    codes={code: group for code, group in GROUP.items() if code not in _PRINTER},
    idle=_PRINTER
    | dict.fromkeys(("M17", "M18", "M82", "M83", "M84"), "motors, and how filament counts")
    | {"M9": "coolant off"},
    dwell=0.001,
    default_feed=True,
    arcs=Limits(spiral=(5.0, 50.0, 5.0), shorter=0.5, least_radius=1e-6, turns=True),
    homes=True,
    extruder=True,
)
#: The dialect of a text without the signs of a controller: codes that controllers have in common.
COMMON = Dialect(
    name="iso",
    source="ISO 6983-1; RS274/NGC, version 3 (NIST IR 6556)",
    # A probe of many controllers. LinuxCNC and GRBL have G38 instead.
    signs=_signs(r"\bg31\b(?=[ \t]*[xyz])"),
    codes=GROUP | _ROTATION,
    idle=_MACHINING | {"G28.2": _HOMING, "G28.3": _HOMING},
    names={"G31": "G38.2"},
    default_feed=True,
    to_start=False,
    has_beams=True,
)
DIALECTS = {
    dialect.name: dialect for dialect in (LINUXCNC, GRBL, FANUC, LATHE, MACH3, MARLIN, COMMON)
}
#: The order in which the signs of dialects are searched.
_ORDER = (LINUXCNC, MARLIN, GRBL, LATHE, MACH3, FANUC, COMMON)
#: A word of Y, which no program for a lathe has.
_Y_WORD = re.compile(r"\by[ \t]*[-+.\d]", re.IGNORECASE)

#: Languages that look like G-code: name of the controller, and text that no G-code has.
_OTHERS = (
    (
        "Siemens' Sinumerik",
        _signs(r"^[ \t]*%_N_\w", r"^[ \t]*;\$PATH=", r"\bMCALL\b", r"\bCYCLE[89]\d+[ \t]*\("),
    ),
    (
        "Okuma's OSP",
        _signs(r"^\$\S+\.(?:MIN|SSB|LIB|SUB)\b", r"^[ \t]*CALL[ \t]+O[A-Z]", r"\bVC\d+[ \t]*="),
    ),
    ("Philips' CNC 3000", _signs(r"^[ \t]*%P[MC]\b")),
    ("Heidenhain's TNC", _signs(r"^\d*[ \t]*BEGIN PGM\b", r"^\d+[ \t]+TOOL CALL\b")),
)


def find_other(text: str) -> tuple[int, str] | None:
    """The name of the controller of a text that is not G-code, and the line from 1 that shows it.

    None if no line shows another language.
    """
    for name, signs in _OTHERS:
        sign = signs.search(text)
        if sign:
            return text.count("\n", 0, sign.start()) + 1, name
    return None


def recognise(text: str, name: str = "") -> tuple[Dialect, str]:
    """The dialect of a text and the sign that shows it, an empty sign if the text has none.

    name: name of the file.
    """
    bare = re.sub(r"\((?!debug)[^()\n]*\)", "", text, flags=re.IGNORECASE)
    for dialect in _ORDER:
        if dialect is LATHE and _Y_WORD.search(bare):
            continue
        sign = dialect.signs.search(text if dialect in (MARLIN, MACH3, GRBL) else bare)
        if sign:
            return dialect, sign[0].strip()
    return (LINUXCNC, ".ngc") if name.lower().endswith(".ngc") else (COMMON, "")
