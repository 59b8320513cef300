"""The machine that runs G-code programs of any author.

A value that the text does not hold is an assumption. A wrong line is a finding, and an effect that
no other machine has is a loss. The run goes on after both.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from camgen.lang.gcode.arcs import Arc, Piece, find_centre
from camgen.lang.gcode.beam import Beam
from camgen.lang.gcode.compensation import OffsetPath, Segment
from camgen.lang.gcode.dialects import LINUXCNC, LOSSES, Dialect
from camgen.lang.gcode.drilling import CYCLES
from camgen.lang.gcode.machine import (
    ARCS,
    AXES,
    RAPID,
    Grammar,
    Handler,
    Leap,
    Machine,
    feed,
    switch_off,
)
from camgen.lang.gcode.macros import ARGUMENTS, assign
from camgen.lang.gcode.rotation import Rotation
from camgen.lang.gcode.words import (
    COMMENT,
    GROUP,
    Line,
    LineError,
    Parameters,
    UnknownWord,
    bare,
    drop_comments,
    without_number,
)
from camgen.model.part import NoteKind
from camgen.model.pose import TOOL_DOWN, Pose, Vec3
from camgen.model.program import Instruction, MoveL, Output, Wait

#: Feed, mm/min, of a machine with a default feed, before the first F.
FEED = 600.0
#: s: a longer wait is probably a number of ms.
_LONG = 100.0
_TEXT = re.compile(
    r"[ \t]*(?:[nN][0-9]+)?[ \t]*[mM](?:117|118|23|28|30|32|98[ \t]*P\")\b[^;]*[A-Za-z]{3}"
)
_MACRO = re.compile(r"[ \t]*[A-Za-z_]{3,}(?![\[#])|[ \t]*\{")
_BLANKS = str.maketrans("", "", " \t\r\f\v")
_QUOTED = re.compile(r'"[^"]*"?')
_TEXTS = re.compile(r"^([ \t]*(?:[nN][0-9]+[ \t]*)?[mM][0-9.]+).*[A-Za-z]{2}.*")
_FLAG = re.compile(r"([A-Za-z])(?=[ \t]*(?:[A-Za-z]|$))")
_EXPONENT = re.compile(
    r"[A-FH-LN-Z][ \t]*[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)E[-+]?[0-9]+(?![.0-9])", re.IGNORECASE
)
_HAS_E = re.compile(r"g76|m6[78]")
_LOGS = re.compile(r"[ \t]*\([ \t]*(?:probeopen|probeclose)\b", re.IGNORECASE)
_PARTS = dict(zip("UVW", AXES, strict=True))
_PLAIN = re.compile(r"(?:[a-z][+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+))*")
_WORKING = ("G1", "G2", "G3")
_PLANES = {"G17": "XY", "G18": "ZX", "G19": "YZ"}

_FULL_POWER = "M4 lowers the power with the speed on GRBL, and does not here"
_NO_HEIGHT = "begin the program with its height (G0 Z5)"
_IN_STEP = "the spindle keeps step with the feed, for which programs here have no word"
_PROBES = "probes: how far it goes is not in the text"
#: Codes whose effect depends on their machine, with the reason.
_OF_ITS_MACHINE = {
    **dict.fromkeys(("G33", "G33.1", "G76"), f"cuts a thread: {_IN_STEP}"),
    **dict.fromkeys(("G74", "G84"), f"taps: {_IN_STEP}"),
    **dict.fromkeys(("G38.2", "G38.3", "G38.4", "G38.5"), _PROBES),
    **dict.fromkeys(
        ("G70", "G71", "G71.1", "G71.2", "G72", "G72.1", "G72.2"), "is of a lathe: the part turns"
    ),
    "G7": "is of a lathe: X is a diameter",
    "G87": "stops the spindle at an angle and goes in beside the hole",
    "G88": "lets the operator bring the tool up",
    "G96": "is of a lathe: the spindle turns faster towards the centre",
    "M19": "turns the spindle to an angle",
    "M66": "waits for an input",
}

#: Codes that must not come while the coordinates are rotated.
_SHIFTS = frozenset(["G52", "G92", *(f"G{n}" for n in range(54, 60))])
#: Codes that use the axis words of a line for themselves.
_TAKE_AXES = frozenset(["G10", "G28", "G30", "G52", "G92"])


@dataclass(slots=True, kw_only=True)
class Foreign(Machine):
    """The machine of a foreign program.

    dialect: the dialect of its controller.
    given: values from the user, by name.
    traced: handlers of motions other than lines, arcs and holes, by code.
    raw: the line as it is written.
    homes: places that the program stores (G28.1), by code and axis.
    adrift: numbers of the axes whose position no text states.
    tools: numbers of the tools in the order of their changes.
    radii: radius of each tool in the tool table, mm.
    rotary: position of the axes A, B and C, deg.
    filament: length of filament, mm.
    saved: modes that M70 and M73 saved.
    side: side of the cutter compensation, 1 left, -1 right, 0 off.
    path: path of the tool beside the programmed one, None without compensation.
    marks: number of instructions before each frame, with its tool and work offset.
    lathe: whether X is a diameter.
    control: control points of a spline (G5.2), with their weights.
    rotation: rotation of the coordinates (G68).
    modal: macro after each motion (G66), at the depth of subprograms ``modal_depth``.
    moving: whether the line moves an axis.
    cycle: group, code and words of a cycle that waits for its feed.
    first_line: words of the first line of a lathe cycle (G71).
    radius_of: function that finds the radius of a tool.
    most_turns: maximum spindle speed at constant surface speed, rpm.
    reached: whether G43 has come.
    beam: beam of a laser that its dialect switches off in rapid motions.
    varies_power: whether motions at feed have an S of their own, as for a laser.
    has_heights: whether the program states any height.
    left_path: whether no motion has run since G40.
    halted: line of the M6 that stopped the spindle, 0 after its next start.
    height: height of the tool beside the path, along the normal, mm.
    """

    dialect: Dialect = LINUXCNC
    given: Mapping[str, float] = field(default_factory=dict)
    traced: Mapping[str, Handler] = field(default_factory=dict)
    raw: str = ""
    homes: dict[str, float] = field(default_factory=dict)
    adrift: set[int] = field(default_factory=set)
    tools: list[int] = field(default_factory=list)
    radii: dict[int, float] = field(default_factory=dict)
    rotary: dict[str, float] = field(default_factory=dict)
    filament: float = 0.0
    at_filament: float = 0.0
    filament_adds: bool = False
    saved: list[tuple[object, ...]] = field(default_factory=list)
    side: int = 0
    path: OffsetPath | None = None
    left_path: bool = False
    halted: int = 0
    height: float = 0.0
    marks: list[tuple[int, int, str]] = field(default_factory=list)
    lathe: bool = False
    most_turns: float = 0.0
    reached: bool = False
    left_on: list[str] = field(default_factory=list)
    control: list[tuple[tuple[float, float], float]] = field(default_factory=list)
    order: int = 3
    going_on: tuple[float, float] | None = None
    suspended: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    rotation: Rotation | None = None
    modal: Leap | None = None
    modal_depth: int = 0
    moving: bool = False
    cycle: tuple[str, str, dict[str, float]] | None = None
    first_line: dict[str, float] = field(default_factory=dict)
    radius_of: Callable[[str, float | None], float] = lambda _code, _number: 0.0
    beam: Beam | None = None
    varies_power: bool = False
    has_heights: bool = True

    # The log of the run.

    def without_mode(self) -> None:
        """Runs axis words without a modal motion code as G0, which LinuxCNC refuses."""
        if not self.dialect.open:
            Machine.without_mode(self)
        self.assume("axis words without a motion code are run as G0", "", 0.0)
        self.motion = "G0"

    def centre(self, absolute: Callable[[], list[Piece]], error: LineError) -> list[Piece]:
        """The pieces of an arc whose centre fits in absolute coordinates alone."""
        if not self.dialect.open:
            raise error
        try:
            pieces = absolute()
        except LineError:
            raise error from None
        what = "the centre of the arc fits in absolute coordinates alone (G90.1); it is read so"
        self.log.find("unusual", what, once="centre")
        self.log.lose(what.partition(";")[0])
        return pieces

    def assume(self, what: str, key: str, value: float, why: str = "") -> float:
        """The value that the user gives for `key`, else `value`, as an assumption."""
        taken = self.given.get(key, value)
        self.log.assume(what + (f" ({why})" if why else ""), key, taken)
        return taken

    def guess(self, what: str, key: str, value: float, why: str = "") -> float:
        """The value that the user gives for `key`, else `value`, as an assumption and a loss."""
        if key not in self.given:
            self.log.lose(what)
        return self.assume(what, key, value, why)

    def note(self, kind: NoteKind, what: str, why: str = "") -> None:
        """Adds a note of the plain machine as an assumption, a fact or a finding."""
        if kind == "assumed":
            self.log.assume(f"{what} ({why})" if why else what)
        elif kind == "skipped":
            self.log.fact("left out", what)
        else:
            self.log.find("unusual", f"{what}: {why}" if why else what, once=what)

    def refuse(self, error: LineError) -> None:
        """The run goes on after a line that the controller refuses, not after an unknown line."""
        if isinstance(error, UnknownWord):
            raise error
        self.log.find("refused", str(error))

    def stands(self, what: str) -> None:
        """A motion that needs another spindle state is refused."""
        self.log.find("refused", what)

    def read_grammar(self) -> Grammar:
        """The words that change the flow. All dialects but GRBL have numbers of programs."""
        dialect = self.dialect
        numbers = dialect.open or dialect.flow
        return Grammar(dialect.flow, numbers, dialect.increments, dialect.nested)

    def miss(self, what: str) -> None:
        """A subroutine in another file is left out."""
        self.assume(f"{what}; it is left out", "", 0.0)
        self.log.lose(what)

    # The words of a line.

    def bare(self, raw: str) -> str:
        """The words of a line as its controller reads them."""
        self.raw, dialect = raw, self.dialect
        if dialect.name == "iso" and raw.lstrip().startswith("["):
            # A comment of WinCNC.
            return ""
        if raw.startswith("\ufeff") or raw.startswith("\xef\xbb\xbf"):
            raw = raw.lstrip("\ufeff\xef\xbb\xbf")
        if dialect.name == "grbl" and raw.lstrip()[:1] in ("$", "?", "!", "~"):
            self.log.fact("settings of the machine", raw.strip()[:40])
            if raw.lstrip()[:2].upper() in ("$J", "$H"):
                self.log.lose(f"{raw.strip()[:40]}: a motion of GRBL beside the program")
            return ""
        if dialect.extruder and (
            _TEXT.match(raw) or (_MACRO.match(raw) and not raw.lstrip().startswith("("))
        ):
            self.log.fact("not evaluated", raw.partition(";")[0].strip()[:40])
            self.log.lose(f"{raw.partition(';')[0].strip()[:40]} is not evaluated")
            return ""
        if dialect.name.startswith("fanuc") and raw.lstrip()[:1] in ("%", ":"):
            return ""
        why = "whether they are depends on a switch of the operator"
        if raw.lstrip().startswith("/") and self.assume(
            "lines with / are run", "block_delete", 0.0, why
        ):
            return ""
        if dialect.nested or dialect.name == "grbl":
            text = drop_comments(raw, dialect.nested)
            text = _as_printers_read(text) if dialect.extruder else text
            return without_number(text.translate(_BLANKS).lower().lstrip("/").removesuffix("%"))
        if _LOGS.match(raw):
            self.log.fact("left out", raw.strip()[:40])
            return ""
        return bare(raw)

    def words(self, text: str, known: Parameters) -> Line:
        """Codes and words of a line. An unreadable line may be a macro of its controller."""
        if self.dialect.letters:
            self._insist_on_plain(text)
        if "e" in text and not self.dialect.extruder:
            self._insist_on_no_exponent(text)
        try:
            if self.dialect.increments and self._assign(text, known):
                return {}, {}
            return Machine.words(self, text, known)
        except UnknownWord:
            raise
        except LineError as error:
            if self.dialect.open and str(error).startswith("cannot read"):
                raise UnknownWord(f"{error}; what follows may depend on it") from error
            raise

    def _insist_on_no_exponent(self, text: str) -> None:
        """Raises LineError for a number such as 1.2E-07, unless E is a word of G76, M67 or M68."""
        number = _EXPONENT.search(COMMENT.sub("", self.raw))
        if number and not _HAS_E.search(text):
            raise LineError(
                f"{number[0]} is a number with an exponent, which G-code does not have; write it "
                "with its decimals"
            )

    def _assign(self, text: str, known: Parameters) -> bool:
        """Return whether a line only sets a parameter, as a macro of Fanuc."""
        try:
            return assign(text, known)
        except LineError as error:
            if str(error).startswith("cannot read"):
                # Words may follow the value.
                return False
            raise

    def _insist_on_plain(self, text: str) -> None:
        """Raises LineError for other words than letters with plain numbers."""
        odd = _PLAIN.sub("", text, count=1)
        if odd:
            raise LineError(
                f"cannot read {odd[:12]!r}: {self.dialect.name} takes letters with plain numbers "
                "alone"
            )
        odd = next(
            (letter for letter in text if letter.isalpha() and letter not in self.dialect.letters),
            "",
        )
        if odd:
            raise LineError(f"{odd.upper()} is no word of {self.dialect.name}")

    def group(self, code: str) -> str:
        """The modal group of a code. An idle or an unknown code has its own group."""
        dialect = self.dialect
        if code in dialect.idle:
            return f"idle {code}"
        meant = dialect.names.get(code, code)
        known = dialect.codes.get(code) if meant == code else GROUP.get(meant)
        if known is not None:
            return known
        if not dialect.open:
            raise LineError(f"{code} is not a code of {dialect.name}")
        return f"unknown {code}"

    def take(self, codes: Mapping[str, str], words: Mapping[str, float]) -> None:  # noqa: ARG002
        """Adds a loss for each code whose effect no other machine has."""
        for code in codes.values():
            usual = self.dialect.names.get(code, code)
            if usual in _OF_ITS_MACHINE:
                self.log.lose(f"{code} {_OF_ITS_MACHINE[usual]}")

    def begin(self, codes: dict[str, str], words: dict[str, float]) -> None:
        """Renames the codes of the dialect, and removes words of subprograms and idle codes."""
        dialect = self.dialect
        for group in [group for group in codes if group.startswith(("idle ", "unknown "))]:
            kind, _, code = group.partition(" ")
            del codes[group]
            act = self._leave_out if kind == "idle" else self._pass_over
            act(code, codes, words)
        for group, code in codes.items() if dialect.names else ():
            codes[group] = dialect.names.get(code, code)
        self._judge(codes, words)
        if "S" in words and codes.get("motion", self.motion) in _WORKING and self.dialect.has_beams:
            self.varies_power |= any(axis in words for axis in AXES)
        self._begin_wider(codes, words)
        if "subprogram" in codes:
            self._call(codes["subprogram"], words)
        if dialect.extruder:
            self._extrude(codes, words)
        if dialect.increments:
            self._add_up(codes, words)
        if dialect.diameter:
            self._turn(codes, words)
        if self.lathe and "X" in words:
            words["X"] /= 2

    def _judge(self, codes: Mapping[str, str], words: Mapping[str, float]) -> None:
        """Adds findings for lines that controllers of the dialect refuse."""
        dialect = self.dialect
        if not dialect.open and "motion" in codes and codes.get("offsets") in _TAKE_AXES:
            self.log.find(
                "refused",
                f"{codes['motion']} and {codes['offsets']} both use the axis words of the line",
            )
        if not dialect.open and "mist" in codes and "flood" in codes:
            self.log.find("refused", "M7 and M8 are of one group (coolant)")
        arc = codes.get("motion", self.motion)
        if dialect.ends_arcs and arc in ("G2", "G3") and any(letter in words for letter in "IJKR"):
            plane = _PLANES[codes.get("plane", self.plane)]
            if not any(axis in words for axis in plane):
                self.log.find(
                    "refused",
                    f"{arc} names neither {plane[0]} nor {plane[1]}: {dialect.name} turns it down",
                )

    def _begin_wider(self, codes: dict[str, str], words: dict[str, float]) -> None:
        """Removes codes and words that only some controllers have."""
        self.cycle = None
        for group in ("circular pocket", "turning"):
            if group in codes:
                used = "DIKLQXYZ" if group == "circular pocket" else "DEIKLPQRUWXZ"
                self.cycle = (
                    group,
                    codes.pop(group),
                    {x: words.pop(x) for x in [*words] if x in used},
                )
        for group in ("rotation", "modal macro"):
            if group in codes:
                self.plane = codes.get("plane", self.plane)
                self.handlers[group](self, codes.pop(group), words)
        self.moving = any(letter in words for letter in "XYZUVW") and "offsets" not in codes
        if self.rotation is not None and _SHIFTS & set(codes.values()):
            self.log.find(
                "unusual",
                "the origin is moved while the coordinates are rotated (G68)",
                once="rotated",
            )
            self.log.lose("the origin is moved while the coordinates are rotated (G68)")

    def _turn(self, codes: dict[str, str], words: dict[str, float]) -> None:
        """Words of a lathe: T0102 is tool 1 with offset 2, and X is a diameter."""
        if words.get("T", 0.0) >= 100:
            words["T"] = float(int(words["T"]) // 100)
            codes.setdefault("tool change", "M6")
        if "X" in words and not self.lathe:
            self.lathe = bool(self.assume("X is a diameter", "diameter", 1.0, "as on most lathes"))
            self.log.lose("a program of a lathe: the part turns, which no machine here does")

    def _leave_out(self, code: str, codes: Mapping[str, str], words: dict[str, float]) -> None:
        self.log.fact(self.dialect.idle[code], code)
        if self.dialect.idle[code] in LOSSES:
            self.log.lose(f"{code}: {self.dialect.idle[code]}")
        if self.dialect.extruder and code in ("M82", "M83"):
            self.filament_adds = code == "M83"
        if code[0] == "G" and "motion" not in codes and code != "G15":
            if self.dialect.diameter and code == "G50" and "S" in words:
                self.most_turns = words["S"]
            for letter in [letter for letter in words if letter not in "FT"]:
                del words[letter]
        elif code[0] == "M" and (self.dialect.extruder or not any(axis in words for axis in "XYZ")):
            words.clear()

    def _pass_over(self, code: str, codes: Mapping[str, str], words: dict[str, float]) -> None:
        """Adds a loss for an unknown code. Raises UnknownWord if it may be a motion."""
        if code[0] == "G" and "motion" not in codes and any(axis in words for axis in "XYZIJKR"):
            raise UnknownWord(f"{code} is not known, and what follows depends on where it leads")
        self.log.fact("not evaluated", code)
        self.log.lose(f"{code} is not known and not evaluated")
        if code[0] == "G":
            self.log.find("unusual", f"{code} is not known and not evaluated", once=code)
        if "motion" not in codes and (
            self.dialect.extruder or not any(axis in words for axis in "XYZ")
        ):
            for letter in [letter for letter in words if letter not in "FST"]:
                del words[letter]

    def _call(self, code: str, words: dict[str, float]) -> None:
        number, times = words.pop("P", 0.0), int(words.pop("L", 1.0))
        if code == "M98" and number >= 10_000 and self.dialect.name.startswith("fanuc"):
            number, times = number % 10_000, int(number) // 10_000
        if code == "M99" and self.leaves():
            return
        given = None
        if code == "G65":
            given = {
                ARGUMENTS[letter]: words.pop(letter) for letter in [*words] if letter in ARGUMENTS
            }
        self.leap = (code, number, min(times, 10_000), given)

    def leaves(self) -> bool:
        """Return whether M99 ends the program, since no subprogram runs."""
        if self.inside():
            return False
        self.log.fact("left out", "M99 begins the program again; it is run once")
        self.ended = True
        return True

    def _extrude(self, codes: Mapping[str, str], words: dict[str, float]) -> None:
        if "dwell" in codes and "S" in words:
            words["P"] = words.pop("S") * 1000.0
        if "E" not in words:
            return
        value = words.pop("E")
        if codes.get("offsets") == "G92":
            self.at_filament = value
            return
        self.filament += value if self.filament_adds else value - self.at_filament
        if value != (0.0 if self.filament_adds else self.at_filament):
            self.log.lose("E feeds filament: only X, Y and Z are replayed")
        self.at_filament = self.at_filament + value if self.filament_adds else value
        if self.motion == "G0" and "motion" not in codes:
            self.motion = "G1"

    def _add_up(self, codes: Mapping[str, str], words: dict[str, float]) -> None:
        """Adds U, V and W as increments to X, Y and Z."""
        for letter, axis in _PARTS.items():
            if letter in words and axis not in words:
                by = words.pop(letter) / (2 if letter == "U" and self.dialect.diameter else 1)
                k = AXES.index(axis)
                place = self.turned(list(self.at), True)[k]
                words[axis] = by if self.incremental else (place - self.shift[k]) / self.scale + by
                if self.dialect.diameter and axis == "X":
                    words[axis] *= 2
                if "offsets" not in codes:
                    self.known[k] = True

    def end(self, codes: Mapping[str, str], words: dict[str, float]) -> None:  # noqa: ARG002
        """Runs the cycle and the macro of the line, and adds losses for words without a use."""
        if self.cycle is not None:
            group, code, cycle_words = self.cycle
            self.handlers[group](self, code, cycle_words)
        if (
            self.modal is not None
            and self.moving
            and self.leap is None
            and self.inside() == self.modal_depth
        ):
            self.leap = self.modal
        if not words.keys() - {"F"}:
            return
        if self.dialect.open:
            for letter in [letter for letter in words if letter != "F"]:
                words.pop(letter)
                what = f"word {letter}: nothing in the line uses it"
                # The number of an offset, which a later line may use.
                if letter in "HD":
                    self.log.fact("left out", what)
                    continue
                self.log.find("unusual", what, once=f"idle {letter}")
                self.log.lose(what)

    # Motions.

    def set_feed(self, words: dict[str, float], codes: dict[str, str]) -> None:
        """Sets the feed. The dialect determines the unit of F in a line that changes the unit."""
        change = codes.get("units")
        if change is None or "F" not in words or codes.get("feed mode", self.feed_mode) == "G93":
            feed(self, words, codes)
            return
        before = self.unit
        unit = 25.4 if change == "G20" else 1.0
        if self.dialect.unit_first or before is None:
            self.unit = unit
        elif unit != before:
            self.log.find(
                "unusual", f"F{words['F']:g} counts in the unit before {change}", once="unit"
            )
        feed(self, words, {group: code for group, code in codes.items() if group != "units"})
        self.unit = before

    def insist_on_feed(self, code: str) -> None:
        """Sets the default feed of the machine before the first F, or adds a refusal."""
        if self.feed > 0 or self.feed_mode == "G93":
            return
        if self.dialect.name == "iso":
            self.log.find(
                "unusual", f"{code} without a feed (F), which LinuxCNC and GRBL refuse", once="feed"
            )
        if self.dialect.default_feed:
            what = "the feed before the first F is one of the machine's, mm/min"
            self.feed = self.guess(what, "feed", FEED) / 60.0
            return
        if any(item.key.startswith("#") for item in self.log.assumed.values()):
            self.feed = (
                self.guess("a feed that depends on the machine, mm/min", "feed", FEED) / 60.0
            )
            return
        self.log.find("refused", f"{code} without a feed (F)")
        self.feed = self.given.get("feed", FEED) / 60.0

    def is_settled(self) -> bool:
        """Return whether the words of a line alone determine its effect."""
        plain = not (
            self.beam
            or self.control
            or self.varies_power
            or self.given.get("laser")
            or self.adrift
            or self.halted
            or self.side
            or self.left_path
            or self.lathe
            or self.rotation
            or self.dialect.extruder
            or self.dialect.increments
        )
        return plain and Machine.is_settled(self)

    def settle(self, code: str, words: Mapping[str, float], cycle: bool) -> None:
        """Judges units, spindle, compensation and tool length before a motion."""
        if self.unit is None:
            inch = self.assume(
                "lengths are mm", "inch", 0.0, "neither G20 nor G21 stands before the first motion"
            )
            self.unit = 25.4 if inch else 1.0
        if self.adrift:
            stated = {k for k, axis in enumerate(AXES) if axis in words and not self.incremental}
            self.adrift -= stated
            if self.adrift and code != "G0" and self.motion != "G0":
                names = " ".join(AXES[k] for k in sorted(self.adrift))
                self.log.find(
                    "unusual",
                    f"a motion at feed from where no line says: {names} came from a stored "
                    "position",
                    once="adrift",
                )
                self.adrift.clear()
        if self.spindle != "M5":
            self.halted = 0
        elif self.halted and (cycle or "G0" not in (code, self.motion)):
            self.log.find(
                "dangerous",
                f"cuts with a spindle that does not turn: M6 stopped it (line {self.halted}), "
                "and no M3 follows",
            )
            self.halted = 0
        if cycle and self.side and not self.dialect.open:
            self.log.find("refused", f"{self.motion} with cutter compensation on")
        if self.left_path and self.motion in ARCS and not self.dialect.open:
            self.log.find(
                "refused", f"{self.motion} right after G40: the way off the path is straight"
            )
        self.left_path = False
        if "Z" in words and self.length == "G49" and self.reached and not cycle:
            what = "Z moves after G49 without the length of the tool: its tip goes lower by as much"
            self.log.find("dangerous", what, once="G49")
        self.length_at_z = self.length

    def turn_axes(self, words: dict[str, float], code: str) -> None:
        """Adds a loss for each motion of other axes, and its time if X, Y and Z stand still."""
        turned = 0.0
        for letter in self.others:
            if letter not in words:
                continue
            value, before = words.pop(letter), self.rotary.get(letter, 0.0)
            if value != (0.0 if self.incremental else before):
                self.log.lose(f"axis {letter} moves: only X, Y and Z are replayed")
            self.rotary[letter] = before + value if self.incremental else value
            turned = max(turned, abs(self.rotary[letter] - before))
            self.log.fact("axes that are not shown", letter)
        if (
            turned
            and (code or self.motion) != "G0"
            and self.feed > 0
            and not any(axis in words for axis in AXES)
        ):
            seconds = (
                1 / self.feed
                if self.feed_mode == "G93"
                else turned / (self.feed * 60.0 / self.scale) * 60.0
            )
            self.add(Wait(min(seconds, 1e6)))

    def trace(self, code: str, words: dict[str, float]) -> bool:
        """Runs splines, threads, taps and probes. Returns whether the line has one."""
        if self.dialect.increments and self.motion in CYCLES and "K" in words:
            words["L"] = words.pop("K")
        if self.control and self.motion not in ("G5.2", "G5.3"):
            self.control.clear()
            raise LineError("the control points of G5.2 without G5.3, which draws their curve")
        act = self.traced.get(self.motion)
        if act is None or (not code and not any(axis in words for axis in "XYZ")):
            return False
        self.settle(code, words, False)
        act(self, self.motion, words)
        return True

    def rapid(self, end: Sequence[float], axes: Sequence[int] = ()) -> None:
        """Adds a rapid motion, on a printer one at the feed."""
        if self.path is not None:
            start = self.here()
            self.at[:] = end
            self.follow(start, self.here(), None)
            return
        if self.dialect.extruder and self.feed > 0 and self.has_position:
            self.at[:] = end
            self.add(MoveL(Pose(TOOL_DOWN, self.here()), self.feed))
            return
        self._insist_on_dark_rapids()
        if not (self.has_heights or self.has_position or self.known[2]):
            # The whole program runs at one height.
            self.known[2], self.entry = True, RAPID
            self.note("assumed", "the program begins at Z0", "it does not say where")
        Machine.rapid(self, end, axes)

    def _insist_on_dark_rapids(self) -> None:
        """Adds a finding for a rapid motion with the beam of a laser on."""
        is_on = self.spindle != "M5" and bool(self.on_off or self.speed)
        if self.beam is not None or not is_on:
            return
        if self.given.get("laser"):
            what = (
                "moves at rapid with the beam on; GRBL in laser mode switches it off there "
                '(input.dialect = "grbl")'
            )
            self.log.find("dangerous", what, once="beam")
        elif self.varies_power:
            what = "the output of S stays on in rapid motions; GRBL in laser mode switches it off"
            self.assume(what, "laser", 0.0, "$32=1 or a tool of kind laser says so")

    @property
    def power(self) -> float:
        """The value of the spindle's output, 1 for a program that only switches."""
        return 1.0 if self.on_off else self.speed or 0.0

    def turn(self) -> None:
        """Switches the spindle, or the beam of a laser, to its modal state."""
        if self.beam is not None:
            if self.spindle == "M4":
                self.assume(_FULL_POWER, "", 0.0, "its output has the power of S")
            self._write_beam(self.beam.at_rest(self.power, self.spindle, self.motion))
        elif self.given.get("laser") and self.spindle == "M4" and not self.on_off:
            self.switch("spindle", self.power)
        else:
            Machine.turn(self)

    def _write_beam(self, output: Output | None) -> None:
        if output is not None:
            Machine.switch(self, output.signal, output.value)

    def turned(self, point: list[float], back: bool = False) -> list[float]:
        """The point in the coordinates rotated by G68."""
        return point if self.rotation is None else self.rotation.turn(point, back)

    def turn_centre(self, words: dict[str, float]) -> None:
        """Rotates the words of the centre by G68."""
        if self.rotation is not None:
            self.rotation.turn_offset(words, self.absolute_centre)

    def beside(self, start: Vec3, end: Vec3, words: dict[str, float]) -> tuple[float, ...]:
        """The centre of an arc beside which the tool runs, or (0,) for a line."""
        if self.path is None:
            return ()
        if self.motion not in ARCS:
            return (0.0,)
        arc = Arc(self.plane, self.motion, start, end, words, self.absolute_centre)
        return find_centre(arc, self.limits)

    def follow(
        self, start: Vec3, end: Vec3, speed: float | None, centre: tuple[float, ...] = ()
    ) -> None:
        """Adds a motion beside which the tool runs."""
        assert self.path is not None
        first, second, normal = self.path.axes
        turn = 1 if self.motion == "G3" else -1
        middle = complex(*centre) if len(centre) > 1 else None
        a, b = complex(start[first], start[second]), complex(end[first], end[second])
        self.path.move(Segment(a, b, middle, turn, end[normal], speed, self.line))

    def switch(self, signal: str, value: float) -> None:
        """Switches an output. A switch at an unknown height is a loss."""
        is_placeless = self.held > 0 and not self.has_position
        if is_placeless and not value and self._was_on(signal):
            self.log.lose(f"{signal} is on and off again where Z is not known; {_NO_HEIGHT}")
        Machine.switch(self, signal, value)

    def _was_on(self, signal: str) -> bool:
        """Return whether the program has switched an output on."""
        outputs = (item for item in self.body if isinstance(item, Output))
        return any(item.signal == signal and item.value for item in outputs)

    def add(self, item: Instruction) -> None:
        """Adds an instruction, after the motion of the compensation that waits for its corner."""
        if self.beam is not None:
            self._write_beam(self.beam.before(item, self.power, self.spindle, self.motion))
        if self.path is not None and self.path.last is not None:
            self.path.pending.append((item, self.line))
        else:
            Machine.add(self, item)

    def top(self) -> float:
        """The maximum height of the program so far, mm."""
        ends = self.body.body().packed.end
        return max(float(np.nanmax(ends[:, 2])) if len(ends) else self.at[2], self.at[2])

    def lift(self, motion: str, words: dict[str, float]) -> None:
        """G53: machine coordinates."""
        if (
            not self.has_position
            and motion == "G0"
            and words.get("Z") == 0
            and not self.given
            and not {"X", "Y"} & words.keys()
        ):
            Machine.lift(self, motion, words)
        else:
            self.handlers["machine coordinates"](self, motion, words)

    def finish(self) -> None:
        """Switches all outputs off. Without M2 or M30 they are named as left on."""
        if self.path is not None:
            self.path.flush()
        if not self.ended:
            on = [] if self.spindle == "M5" else ["the spindle"]
            self.left_on[:] = on + ["a coolant"] * bool(self.coolants)
        switch_off(self)

    def value(self, name: str) -> float | None:
        """The value of a parameter of the machine, assumed if the program does not determine it."""
        known = Machine.value(self, name)
        if known is not None:
            return known
        if name in self.homes:
            return self.homes[name]
        if name == "5400":
            return float(self.changed_to or 0)
        if name.isdigit():
            return self.guess(f"#{name} is a value of the machine", f"#{name}", 0.0)
        if name.startswith(("_hal[", "_ini[")):
            return self.guess(f"#<{name}> is a value of the machine", f"#<{name}>", 0.0)
        return None

    def takes(self, key: int) -> bool:
        """Return whether a line may set this parameter of the machine."""
        return not 5400 <= key <= 5428


def _as_printers_read(text: str) -> str:
    """A line without its checksum and texts in quotes; a letter without a number is a flag."""
    text = _QUOTED.sub("0", text.partition("*")[0])
    return _FLAG.sub(r"\1 0", _TEXTS.sub(r"\1", text))
