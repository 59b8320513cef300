"""The checks of a read-back: a strict run of a G-code program that a post has written.

It is the run of any program (`camgen.lang.gcode`) with a stricter profile. A line is a finding if

- no post writes it,
- it leaves open what the machine does,
- it differs from the options of the post.

Nothing is guessed: a finding also names the value that is assumed from its line on.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

from msgspec.structs import replace

from camgen.lang.gcode import dialects
from camgen.lang.gcode.code import compile_lines
from camgen.lang.gcode.codes import (
    HANDLERS,
    lift_tool,
    set_output,
    switch_coolant,
    turn_spindle,
)
from camgen.lang.gcode.interpreter import Interpreter
from camgen.lang.gcode.machine import ARCS, AXES, COOLANTS, Machine, Profile
from camgen.lang.gcode.predefined import find_value
from camgen.lang.gcode.strict_text import (
    Controller,
    check_characters,
    check_comments,
    check_words,
    remove_number,
)
from camgen.lang.gcode.third_party import run_without_axes
from camgen.lang.gcode.words import (
    GROUP,
    Line,
    LineError,
    Parameters,
    UnknownWord,
    explain_unread,
    without_comments,
    words_of,
)
from camgen.lang.run import Stopped
from camgen.model.program import Force, Output, ToolChange
from camgen.model.text import counted

#: The code of each modal group that posts write before the first motion. The program before may
#: have left another one: LinuxCNC's M2 and GRBL's reset restore the modes, an abort need not.
#: Units, tool length and path mode have findings of their own.
_MODES = {
    "plane": "G17",
    "cutter compensation": "G40",
    "cycle off": "G80",
    "distance": "G90",
    "arc distance": "G91.1",
    "feed mode": "G94",
}
#: Modes that a program of a post never leaves, by modal group; the next program starts in them.
_HELD = {group: code for group, code in _MODES.items() if group != "cycle off"} | {"units": "G21"}
#: The codes of the line that lifts the tool.
_LIFT = ("G53", "G0")
#: Sets of groups that count as one here. LinuxCNC or the interpreter takes two of their codes in
#: one line.
_ONE_GROUP = {"motion": ("cycle off", "motion"), "coolant": ("mist", "flood", "coolant off")}

#: Codes that end the reading. With other codes that no post writes, a program is run as one of
#: another author.
_UNREAD_CODES = """
    G5 G5.1 G5.2 G5.3 G7 G28 G28.1 G30 G30.1 G33 G33.1 G38.2 G38.3 G38.4 G38.5 G41 G41.1 G42 G42.1
    G43.1 G43.2 G52 G74 G76 G84 G87 G88 G92.3 G96 M0 M19 M50 M51 M52 M53 M60 M61 M66 M70 M71 M72 M73
    M97 M98 M99
"""
_UNREAD = frozenset(_UNREAD_CODES.split())
#: An output, and a comment, as posts print them.
_OUTPUT = re.compile(r"M6([45]) P([0-9]{1,2})")
REMARK = re.compile(r"\((?!.{71})[A-Za-z0-9 _.+\-=/:#@*]*\)")
#: The dialect of a read-back: nothing but what the controllers of the posts have in common.
_DIALECT = replace(dialects.LINUXCNC, unit_first=None)


@dataclass(frozen=True, slots=True)
class Expect:
    """The text that follows from the options of the post.

    work: work offset.
    tool: number of the tool that the program changes to, 0 if it changes to several or none.
    path_tolerance: maximum P of G64, mm. None if the controller does not have G64.
    names: signal by output. Outputs have the names of the interpreter.
    lift: whether Z moves up in machine coordinates (G53) before G49.
    force: number of the analog output and its value per N, None without force.
    digital, analog: number of outputs that the machine has.
    spiral: maximum difference of the radii of an arc that its printed digits cause, mm.
    """

    work: str
    tool: int = 0
    path_tolerance: float | None = None
    names: Mapping[str, str] = field(default_factory=dict)
    lift: bool = False
    force: tuple[int, float] | None = None
    digital: int = 4
    analog: int = 4
    spiral: float = 0.003


@dataclass(slots=True, kw_only=True)
class Strict:
    """The checks of one strict run. A fault is a finding and does not stop it.

    rules: rules of the controller.
    expect: text that follows from the options of the post.
    has_text: whether a line so far was not blank.
    percents: number of lines so far with a per cent sign alone.
    stated_groups: modal groups of the codes so far.
    has_moved: whether a motion was read.
    length_code: last G43 or G49, empty before.
    path_code: last G61 or G64, empty before.
    is_changed: whether the program has changed to the tool of `expect`.
    is_pressing: whether a force is on.
    next_force: force from the next motion on, N. None: the force stays.
    due_tool: number of the tool whose length must be applied before the next motion, 0 without one.
    idle_words: line and finding of each T and S whose code has not come, by letter.
    """

    rules: Controller
    expect: Expect
    has_text: bool = False
    percents: int = 0
    stated_groups: set[str] = field(default_factory=set)
    has_moved: bool = False
    length_code: str = ""
    path_code: str = ""
    is_changed: bool = False
    is_pressing: bool = False
    next_force: float | None = None
    due_tool: int = 0
    idle_words: dict[str, tuple[int, str]] = field(default_factory=dict)

    def make_machine(self) -> Machine:
        """The machine that the program of a post runs on."""
        handlers = {
            **HANDLERS,
            "outputs": self.set_output,
            "tool change": self.change_tool,
            "spindle": self.turn_spindle,
            "coolant off": self.switch_coolant_off,
            "length offset": self.set_length,
            "work offset": self.set_work,
            "path": self.set_path,
            "machine coordinates": self.lift_tool,
        }
        profile = Profile(
            handlers=handlers,
            clean=self.clean,
            parse=self.parse,
            prepare_motion=self.prepare_motion,
            run_without_axes=self.run_without_axes,
            switch=self.switch,
            find_effect=self.find_effect,
            goes_on=True,
        )
        return Machine(
            profile=profile,
            dialect=_DIALECT,
            limits=self.rules.arcs,
            exact=replace(self.rules.arcs, spiral=(self.expect.spiral,) * 3),
            others="",
            blend=0.0,
            long_wait=math.inf,
        )

    # -- lines ---------------------------------------------------------------------------------

    def find_effect(self, raw: str) -> Output | bool | None:
        """The output of M64 or M65, None if the machine does not have it.

        For other lines: whether the line is a comment of a post, which has no effect.
        """
        match = _OUTPUT.fullmatch(raw)
        if match is None:
            return REMARK.fullmatch(raw) is not None
        number = int(match[2])
        if f"M6{match[1]}" not in self.rules.codes or number >= self.expect.digital:
            return None
        return Output(self.expect.names.get(f"dout{number}", f"P{number}"), float(match[1] == "4"))

    def clean(self, m: Machine, raw: str) -> str:
        """The words of a line, in lower case and without blanks.

        Raises LineError if the controller refuses the line.
        """
        text, rules = raw.removesuffix("\r"), self.rules
        check_characters(text, rules)
        if rules.linuxcnc and text.strip(" \t\r") == "%":
            if self.has_text and not (m.opened or m.ended):
                raise LineError("a per cent sign that does not belong to one on the first line")
            self.percents += 1
            return "%"
        self.has_text = self.has_text or not raw.isspace()
        if "(" in text or ";" in text or ")" in text:
            if rules.linuxcnc:
                check_comments(text)
            text = without_comments(text)
        text = text.replace(" ", "").replace("\t", "")
        if not text.isascii():
            raise LineError("a character that is not ASCII outside a comment")
        if rules.squeezed and len(text) > rules.limit:
            length = f"{len(text)} characters without blanks and comments"
            raise LineError(f"{length}, {rules.name} reads {rules.limit}")
        if text.startswith("/"):
            if rules.linuxcnc:
                what = "whether the line runs depends on a switch of the operator"
                raise UnknownWord(f"block delete: {what}")
            what = f"which {rules.name} ignores and no post writes"
            m.log.find("unusual", f"a slash before a line, {what}")
        words = remove_number(text.lower().removeprefix("/"), rules)
        check_words(words)
        return words

    def parse(self, m: Machine, text: str, known: Parameters) -> Line:
        """The codes and words of a line.

        Raises LineError if the controller does not have a code or tool, or if two codes are of one
        group.
        """
        codes, words = words_of(text, known, _find_group)
        rules = self.rules
        for code in codes.values():
            if code not in rules.codes:
                what = explain_unread(code, f"not a code of {rules.name}")
                raise LineError(what) if code in _UNREAD else UnknownWord(what)
        for name, groups in _ONE_GROUP.items():
            both = [codes[group] for group in groups if group in codes]
            if len(both) > 1:
                raise LineError(f"{both[0]} and {both[1]} are of one group ({name})")
        if words.get("T", 0.0) > rules.max_tool:
            raise LineError(f"T{words['T']:g}: {rules.name} has tools to T{rules.max_tool:g}")
        self.stated_groups.update(codes)
        self._find_idle(m, codes, words)
        return codes, words

    def _find_idle(self, m: Machine, codes: Mapping[str, str], words: Mapping[str, float]) -> None:
        if "T" in words:
            self.note_idle(m, "T")
            if not self.expect.tool or int(words["T"]) != self.expect.tool:
                what = f"T{words['T']:g} selects a tool that no M6 changes to"
                self.idle_words["T"] = (m.line, what)
        if "S" in words and codes.get("spindle", m.spindle) == "M5":
            self.note_idle(m, "S")
            self.idle_words["S"] = (m.line, f"S{words['S']:g} without M3 or M4")
        if "tool change" in codes:
            self.idle_words.pop("T", None)
        if codes.get("spindle", "M5") != "M5":
            self.idle_words.pop("S", None)
        if self.rules.linuxcnc and "M30" in codes.values():
            m.log.find("unusual", "M30 exchanges pallets before the end; posts write M2")
        if "G53" in codes.values() and len(codes) > len(_LIFT):
            m.log.find("unusual", "a code in the line of G53 G0 Z0, which posts write alone")
        for group, usual in _HELD.items():
            code = codes.get(group, usual)
            if code != usual:
                m.log.find("unusual", f"{code} where posts write in {usual}", once=code)

    def note_idle(self, m: Machine, letter: str) -> None:
        """Adds a finding for a word whose code has not come."""
        if letter in self.idle_words:
            line, what = self.idle_words.pop(letter)
            m.log.find("unusual", what, line=line)

    # -- motions -------------------------------------------------------------------------------

    def run_without_axes(self, m: Machine, code: str) -> None:
        """Checks a motion code without a target. Raises LineError if it needs a feed."""
        if code == "G1" and m.feed <= 0:
            raise LineError("G1 without a feed (F)")
        if m.lifted:
            self._check_modes(m)
            self._check_path(m)
        run_without_axes(m, code)

    def prepare_motion(
        self, m: Machine, code: str, words: Mapping[str, float], cycle: bool
    ) -> None:
        """Checks the state of the machine before a motion. Raises LineError."""
        named = [axis for axis in AXES if axis in words]
        if not named and (cycle or not self.rules.linuxcnc):
            raise LineError(f"{code} without {'X, Y or Z' if cycle else 'an end point'}")
        if m.motion != "G0" and m.feed <= 0:
            raise LineError(f"{m.motion} without a feed (F)")
        if cycle:
            self._check_cycle(m, words)
        else:
            self._check_start(m)
            if self.due_tool:
                due = f"(G43 H{self.due_tool}) before it moves"
                m.log.find("refused", f"the length of tool {self.due_tool} is not applied {due}")
                self.due_tool = 0
            _check_position(m, named)
            _check_spiral(m, words, self.expect.spiral)
        m.output_line = 0
        if self.next_force is not None:
            m.force, self.next_force = self.next_force, None
        if cycle or "Z" in words:
            m.length_at_z = m.length_at_z or m.length
            if m.length != m.length_at_z:
                why = "it shifts z by the length of the tool, which is not known here"
                raise LineError(f"a motion of Z after {m.length}: {why}")

    def _check_start(self, m: Machine) -> None:
        if self.has_moved:
            return
        self.has_moved = True
        expect = self.expect
        self._check_modes(m)
        if m.unit is None:
            m.unit = 1.0
            m.log.find("unusual", "a motion before G20 or G21; read as mm")
        m.work = m.work or "G54"
        if m.work != expect.work:
            m.log.find("refused", f"work offset {m.work}, but post.work is {expect.work}")
        if expect.tool and self.length_code != "G43":
            m.log.find(
                "refused", "the length of the tool is not applied (G43) before the first motion"
            )
        elif not self.length_code:
            m.log.find(
                "unusual",
                "neither G49 nor G43 before the first motion: a tool length that is on shifts Z",
            )
        if m.lifted and not expect.lift:
            m.log.find(
                "unusual",
                "G53 has sent the tool to the machine's zero of Z, but post.lift is false",
            )
        self._check_path(m)

    def _check_modes(self, m: Machine) -> None:
        needed = {**_MODES, "work offset": self.expect.work}
        missing = [code for group, code in needed.items() if group not in self.stated_groups]
        if missing:
            reason = "the program before may have left it otherwise"
            m.log.find("unusual", f"{', '.join(missing)} not set before the first motion: {reason}")
        self.stated_groups.update(needed)

    def _check_path(self, m: Machine) -> None:
        """Adds a finding, once, if corners may be rounded by any amount."""
        if self.expect.path_tolerance is not None and not self.path_code:
            where = "before the first motion: corners may be rounded by any amount"
            m.log.find("unusual", f"neither G61 nor G64 P {where}", once="path")

    def _check_cycle(self, m: Machine, words: Mapping[str, float]) -> None:
        """Checks that a cycle leaves nothing open.

        It has to go straight down in absolute coordinates from a known height, to which G98
        returns. Raises UnknownWord for another cycle.
        """
        is_usual = (
            m.has_position
            and m.unit == 1.0
            and m.plane == "G17"
            and m.to_start is True
            and not m.incremental
        )
        is_waiting = m.output_line or self.is_pressing or self.next_force is not None
        if not is_usual or is_waiting or "L" in words:
            raise UnknownWord(f"{m.motion} in another state than a post leaves it in is not read")
        held = {**m.sticky, **words}
        if "R" in held and held["R"] > (m.at[2] if m.level is None else m.level):
            raise UnknownWord(f"{m.motion} that begins above where G98 returns to is not read")
        if m.motion == "G83" and "R" in held and held["R"] == held.get("Z"):
            raise LineError("G83 with pecks and no depth")

    # -- codes ---------------------------------------------------------------------------------

    def switch(self, m: Machine, signal: str, value: float) -> None:
        """Sets an output under the name of its signal, or the force. Raises LineError."""
        channel, scale = self.expect.force or (-1, 1.0)
        if m.lifted and not m.has_position:
            m.log.find("unusual", "an output is switched when the machine has moved already (G53)")
        if signal != f"aout{channel}":
            name = signal.replace("dout", "P").replace("aout", "E")
            m.add(Output(self.expect.names.get(signal, name), value))
            return
        newtons = value / scale
        if newtons < 0:
            raise LineError(f"a force of {newtons:g} N")
        if m.output_line == m.line and self.is_pressing:
            self.next_force = newtons
        else:
            self.is_pressing, m.force, self.next_force = newtons > 0, newtons, None
            m.add(Force(newtons))

    def set_output(self, m: Machine, code: str, words: dict[str, float]) -> None:
        """M62 to M68. Raises LineError for an output that the machine does not have."""
        letter, count = "P", self.expect.digital
        if code in ("M67", "M68"):
            letter, count = "E", self.expect.analog
        if words.get(letter, 0.0) >= count:
            has = f"the machine has {counted(count, 'such output')} from {letter}0 (post.outputs)"
            raise LineError(f"{code} {letter}{words[letter]:g}: {has}")
        if code in ("M62", "M63", "M67"):
            m.output_line = m.line
        set_output(m, code, words)

    def change_tool(self, m: Machine, _code: str, _words: dict[str, float]) -> None:
        """M6. Raises LineError for another tool than that of the post."""
        if m.tool is None:
            raise LineError("M6 without a tool (T)")
        if not self.expect.tool:
            self._change_among(m, m.tool)
            return
        if m.has_position:
            raise LineError("a tool change after the first motion is not read")
        if self.is_changed:
            m.log.find("unusual", "M6 a second time")
        if m.tool != self.expect.tool:
            raise LineError(f"tool T{m.tool}, but post.tool is {self.expect.tool}")
        self.is_changed = True

    def _change_among(self, m: Machine, tool: int) -> None:
        """Changes to one of several tools. Position and tool length are unknown after it."""
        if not tool:
            raise LineError("T0 M6 takes the tool out")
        if not any(isinstance(item, ToolChange) for item in m.body.objects):
            self._check_first_change(m)
        if m.spindle != "M5" or m.coolants or self.is_pressing:
            m.log.find(
                "refused", f"tool {tool} is changed while the spindle, a coolant or a force is on"
            )
        if self.due_tool:
            m.log.find("unusual", f"tool {self.due_tool} is changed to and never used")
        m.add(ToolChange(tool))
        self.due_tool, self.length_code = tool, ""
        m.has_position = m.lifted = False
        m.known[:] = [False, False, False]

    def _check_first_change(self, m: Machine) -> None:
        self._check_modes(m)
        self._check_path(m)
        if self.expect.lift and not m.lifted:
            m.log.find("unusual", "G53 G0 Z0 is missing before the first tool change")
        if self.length_code != "G49":
            m.log.find(
                "unusual",
                "G49 is missing before the first tool change: a length that is on shifts Z",
            )

    def turn_spindle(self, m: Machine, code: str, words: dict[str, float]) -> None:
        """M3, M4 and M5. Raises LineError without a speed."""
        if code != "M5" and m.speed is None:
            m.spindle = code
            raise LineError(f"{code} without a speed (S)")
        turn_spindle(m, code, words)

    def switch_coolant_off(self, m: Machine, code: str, words: dict[str, float]) -> None:
        """M9. It switches the coolants of the options off, even if none is on."""
        named = {word for word, signal in COOLANTS.items() if signal in self.expect.names}
        m.coolants = m.coolants or named or {"M8"}
        switch_coolant(m, code, words)

    def set_length(self, m: Machine, code: str, words: dict[str, float]) -> None:
        """G43 and G49. Raises LineError for the length of another tool."""
        tool, due_tool = self.expect.tool, self.due_tool
        if code == "G43" and due_tool:
            if "H" not in words:
                m.log.find(
                    "unusual",
                    f"G43 without H: the length of tool {due_tool} is asked for by H{due_tool}",
                )
            number = words.pop("H", due_tool)
            if number != due_tool:
                raise LineError(
                    f"G43 H{number:g} shifts z by the length of another tool than T{due_tool}"
                )
            self.due_tool = 0
        elif code == "G43" and (words.pop("H", tool) != tool or not tool):
            raise LineError(f"G43 shifts z by the length of a tool, but post.tool is {tool}")
        if code == "G49" and self.expect.lift and not m.lifted:
            m.log.find(
                "unusual", "G49 lowers the next height by a tool length that is on; G53 G0 Z0 first"
            )
        if m.has_position and code != self.length_code:
            raise LineError(f"{code} after the first motion shifts the origin")
        m.length = self.length_code = code

    def set_work(self, m: Machine, code: str, _words: dict[str, float]) -> None:
        """G54 to G59.3. Raises LineError for another one after the first motion.

        A tool change makes the position unknown again, but not the work offset.
        """
        if self.has_moved and code != m.work:
            raise LineError(f"{code}: another work offset after the first motion is not read")
        m.work = code

    def set_path(self, m: Machine, code: str, words: dict[str, float]) -> None:
        """G61 and G64. Raises LineError if corners may be rounded by more than the post allows."""
        self.path_code = code
        allowed = self.expect.path_tolerance
        if code != "G64":
            wanted = f"G64 P{allowed:g}" if allowed else "G61"
            if allowed is None:
                m.log.find(
                    "unusual",
                    f"{code} changes nothing: {self.rules.name} rounds corners by its own setting",
                )
            elif code != wanted:
                option = f"post.path_tolerance asks for {wanted}"
                m.log.find("unusual", f"{code} where {option}: corners take another time")
            return
        tolerance = words.pop("P", 0.0)
        if "Q" not in words:
            m.log.find("unusual", "G64 without Q joins lines within P")
        largest = max(tolerance, words.pop("Q", tolerance))
        if tolerance <= 0:
            raise LineError("G64 without P rounds corners by any amount")
        if largest * m.scale > (allowed or 0.0) * (1 + 1e-9):
            raise LineError(
                f"G64 may leave the path by {largest:g}, post.path_tolerance is {allowed or 0.0:g}"
            )

    def lift_tool(self, m: Machine, motion: str, words: dict[str, float]) -> None:
        """G53. Raises LineError for another motion than G53 G0 Z0 at the start."""
        is_lift = motion == "G0" and "X" not in words and "Y" not in words
        if not m.incremental and (m.has_position or not is_lift or words.pop("Z", 1.0) != 0):
            raise LineError(explain_unread("G53", "not known"))
        lift_tool(m)

    # -- the end -------------------------------------------------------------------------------

    def find_missing(self, m: Machine) -> None:
        """Adds findings for what the program lacks, and for assumptions."""
        for letter in "ST":
            self.note_idle(m, letter)
        for item in m.log.list_assumed():
            m.log.find("unusual", item.what, line=item.line)
        changes = zip(m.body, m.lines, strict=True) if self.due_tool else ()
        last_change = max(
            (line for item, line in changes if isinstance(item, ToolChange)), default=0
        )
        tool, wanted = self.due_tool, self.expect.tool
        missing = (
            (not m.ended, "the program has no end (M2 or M30)", 0),
            (m.opened and self.percents < 2, "the per cent sign of line 1 has no second one", 1),
            (
                any(m.known) and not m.has_position,
                "the program ends before the position is known in all axes",
                0,
            ),
            (
                m.output_line,
                "an output that waits for the next motion (M62, M63, M67), and none follows",
                m.output_line,
            ),
            (
                tool,
                f"tool {tool} is changed to, and its length is not applied (G43 H{tool})",
                last_change,
            ),
            (
                wanted and not self.is_changed,
                f"the tool change T{wanted} M6 of post.tool is missing",
                0,
            ),
        )
        for is_missing, what, line in missing:
            if is_missing:
                m.log.find("refused", what, line=line)


def _find_group(code: str) -> str:
    if code not in GROUP:
        raise LineError(explain_unread(code, "not a code that is known"))
    return GROUP[code]


def _check_position(m: Machine, named: Sequence[str]) -> None:
    """Adds a finding for a motion from an unknown position that may collide.

    The usual order of a post is Z up first, then X and Y together.
    named: axes of the motion.
    """
    if m.has_position:
        return
    what = ""
    if m.incremental or m.motion != "G0":
        kind = "an incremental" if m.incremental else "a feed"
        what = f"{kind} motion from a position that is not known"
    elif m.lifted and "Z" in named and not (m.known[0] and m.known[1]):
        m.log.find(
            "unusual", "Z comes down from the top of the machine before X and Y are over the part"
        )
    elif not (m.known[2] or m.lifted) and "Z" not in named:
        what = "X or Y moves while Z is not known"
    elif any(m.known[AXES.index(axis)] for axis in named):
        m.log.find("unusual", "an axis moves again before the position is known in all axes")
    elif not (m.known[2] or m.lifted) and len(named) > 1:
        m.log.find("unusual", "Z moves together with X or Y while it is not known")
    elif len([axis for axis in "XY" if axis in named]) == 1 and not (m.known[0] or m.known[1]):
        m.log.find("unusual", "X and Y move one after the other to where the program begins")
    if what:
        m.log.find("unusual", f"{what}; read as from 0")
        m.known[:] = [True, True, True]
        m.has_position = True


def _check_spiral(m: Machine, words: Mapping[str, float], spiral: float) -> None:
    """Adds a finding for an arc whose radius changes by more than its printed digits explain.

    A change that is so large that the controller refuses it is a finding of its own.
    spiral: change that the digits explain, mm.
    """
    if (
        m.motion not in ARCS
        or "R" in words
        or m.incremental
        or m.absolute_centre
        or m.plane != "G17"
    ):
        return
    (x, y), (i, j) = m.at[:2], (words.get(letter, 0.0) * m.scale for letter in "IJ")
    u, v = (
        words[axis] * m.scale + m.shift[k] if axis in words else m.at[k]
        for k, axis in enumerate("XY")
    )
    start, end = math.hypot(i, j), math.hypot(u - x - i, v - y - j)
    if spiral + 1e-9 < abs(start - end) <= max(m.limits.spiral[0], 0.001 * start):
        m.log.find("unusual", f"an arc whose radius goes from {start:.4f} to {end:.4f} mm")


def run(lines: Sequence[str], rules: Controller, expect: Expect) -> Machine:
    """The machine after a run of the lines. It raises nothing for any text."""
    strict = Strict(rules=rules, expect=expect)
    m = strict.make_machine()
    try:
        Interpreter(m, lines, compile_lines(len(lines))).run()
    except Stopped as stopped:
        m.log.find("refused", str(stopped))
    _read_rest(m, lines)
    strict.find_missing(m)
    return m


def _read_rest(m: Machine, lines: Sequence[str]) -> None:
    """Adds findings for lines with words after the end of the program."""
    parameters = Parameters(partial(find_value, m))
    for index in range(m.line, len(lines)):
        m.line = index + 1
        try:
            text = m.profile.clean(m, lines[index])
            if text not in ("", "%"):
                m.profile.parse(m, text, parameters)
                m.log.find("unusual", "a line after the end of the program")
        except LineError as error:
            m.refuse(error)
