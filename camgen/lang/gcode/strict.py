"""Reads a LinuxCNC program of a post back: text -> instructions, findings by line.

The interpreter of third-party programs runs it (`camgen.lang.gcode`). This profile is stricter. A
line is a finding if

- no post writes it,
- it leaves open what the machine does,
- it differs from the options of the post.

Nothing is guessed: a finding also names the value that is assumed from its line on.

A program may have words that no post writes: other cycles, O-words, parameters, shifts of the
origin. It is then run once more as a third-party program. A word that is unknown there too is
refused by name.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from msgspec.structs import replace

from camgen.lang.gcode import arcs
from camgen.lang.gcode.code import compile_lines
from camgen.lang.gcode.interpreter import Interpreter
from camgen.lang.gcode.machine import AXES, HANDLERS, Machine, PlainReader
from camgen.lang.gcode.words import (
    COMMENT,
    GROUP,
    LineError,
    Parameters,
    UnknownWord,
    tell_unread,
    without_comments,
    without_number,
    words_of,
)
from camgen.lang.log import Log
from camgen.lang.post_options import read_number
from camgen.lang.programs import Executed
from camgen.lang.run import Stopped
from camgen.model.errors import JobError
from camgen.model.part import NoteKind
from camgen.model.program import Force, Instruction, Output, ToolChange
from camgen.model.text import counted

from .strict_runs import MOTION, REMARK, SHORTEST_RUN, Chunk, Lines, MotionState, cut, perform

_WORDS = re.compile(r"([a-z])([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+))")
_LINE = re.compile(rf"(?:{_WORDS.pattern})*")
#: Comments that LinuxCNC acts on. `MSG` only shows its text.
_ACTIVE = re.compile(
    r"\s*(debug|print|log|logopen|logappend|logclose|probeopen|probeclose|abort|py)\b",
    re.IGNORECASE,
)
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
_COOLANTS = {"M7": "mist", "M8": "flood"}

#: Codes that end the reading. With other codes that no post writes, a program is run as one of
#: another author.
_UNREAD_CODES = """
    G5 G5.1 G5.2 G5.3 G7 G28 G28.1 G30 G30.1 G33 G33.1 G38.2 G38.3 G38.4 G38.5 G41 G41.1 G42 G42.1
    G43.1 G43.2 G52 G74 G76 G84 G87 G88 G92.3 G96 M0 M19 M50 M51 M52 M53 M60 M61 M66 M70 M71 M72 M73
    M97 M98 M99
"""
_UNREAD = frozenset(_UNREAD_CODES.split())
_PLAIN, _REMARK = re.compile(MOTION), re.compile(REMARK)


@dataclass(frozen=True, slots=True)
class Controller:
    """The rules of a controller.

    name: name of the controller, for messages.
    codes: codes that are read.
    limit: maximum number of characters per line.
    squeezed: whether `limit` counts a line without its blanks and comments.
    forbidden: characters that may not occur, not even in a comment. None: all may occur.
    linuxcnc: whether per cent signs, active comments, block delete and circles without an end
        point have their meaning of LinuxCNC, not that of GRBL.
    arcs: tolerances of arcs.
    max_tool: largest T.
    max_line_number: largest N.
    """

    name: str
    codes: frozenset[str]
    limit: int
    squeezed: bool
    forbidden: re.Pattern[str] | None
    linuxcnc: bool
    arcs: arcs.Limits
    max_tool: float = math.inf
    max_line_number: float = math.inf


_CODES = """
    G0 G1 G2 G3 G4 G17 G18 G19 G20 G21 G40 G43 G49 G53 G54 G55 G56 G57 G58 G59 G59.1 G59.2 G59.3
    G61 G61.1 G64 G80 G81 G82 G83 G90 G90.1 G91 G91.1 G94 G97 G98 G99
    M0 M1 M2 M3 M4 M5 M6 M7 M8 M9 M30 M62 M63 M64 M65 M67 M68
"""
LINUXCNC = Controller(
    name="LinuxCNC",
    codes=frozenset(_CODES.split()),
    limit=252,
    squeezed=False,
    forbidden=None,
    linuxcnc=True,
    arcs=arcs.LINUXCNC,
)


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
class Strict(Machine):
    """The machine that accepts only text of posts. A fault is a finding and does not stop it.

    rules: rules of the controller.
    expect: text that follows from the options of the post.
    has_text: whether a line so far was not blank.
    stated_groups: modal groups of the codes so far.
    has_moved: whether a motion was read.
    length_code: last G43 or G49, empty before.
    path_code: last G61 or G64, empty before.
    is_changed: whether the program has changed to the tool of `expect`.
    is_pressing: whether a force is on.
    next_force: force from the next motion on, N. None: the force stays.
    output_line: line of an output that waits for the next motion, 0 without one.
    unknown_line: first line with a word that no post writes, 0 without one.
    due_tool: number of the tool whose length must be applied before the next motion, 0 without one.
    idle_words: line and finding of each T and S whose code has not come, by letter.
    chunk: lines that are read by column, None before the first.
    unusual: codes of modes that no post sets. Each is a finding once.
    """

    rules: Controller
    expect: Expect
    others: str = ""
    plain: re.Pattern[str] = _PLAIN
    blend: float = 0.0
    has_text: bool = False
    stated_groups: set[str] = field(default_factory=set)
    has_moved: bool = False
    length_code: str = ""
    path_code: str = ""
    is_changed: bool = False
    is_pressing: bool = False
    next_force: float | None = None
    output_line: int = 0
    unknown_line: int = 0
    due_tool: int = 0
    idle_words: dict[str, tuple[int, str]] = field(default_factory=dict)
    chunk: Chunk | None = None
    unusual: set[str] = field(default_factory=set)

    def note(self, kind: NoteKind, what: str, why: str = "") -> None:
        """Adds a finding for an assumption or omission of the interpreter."""
        if kind != "warning":
            self.log.find("unusual", f"{what} ({why})")

    def refuse(self, error: LineError) -> None:
        """Adds the error as a finding. Reading continues with the next line."""
        self.log.find("refused", str(error))
        if isinstance(error, UnknownWord):
            self.unknown_line = self.unknown_line or self.line

    def read_plain(self, lines: Sequence[str], at: int, bound: int, plain: PlainReader) -> int:
        """Runs long sequences of motions and outputs by column, and the rest by `plain`.

        A sequence runs by column only in mm, without a shift of the origin and without force.
        Returns the index of the next line.
        """
        is_usual = self.unit == 1.0 and not self.force and not any(self.shift)
        while is_usual and isinstance(lines, Lines) and at < bound:
            chunk = self.chunk
            if chunk is None or not chunk.holds(at):
                chunk = self.chunk = cut(lines, at, self.output)
            stop = min(bound, chunk.end(at))
            if not chunk.usable or stop - at < SHORTEST_RUN:
                break
            start = MotionState(self.here(), self.feed, self.blend, self.exact or self.limits)
            effect = perform(chunk, start, at, stop)
            if effect is None:
                break
            self.body.extend_body(effect.body)
            self.lines.frombytes(effect.lines.tobytes())
            self.at[:] = effect.at
            self.feed, self.motion = effect.feed, effect.motion
            self.cut = self.cut or effect.cut
            chunk.usable, at = effect.line == stop, effect.line
        return plain(self, lines, at, bound) if at < bound else at

    def output(self, digit: str, number: str) -> Output | None:
        """The output that M64 or M65 sets.

        digit: last digit of the code.
        Returns None if the machine does not have the code or the output.
        """
        if f"M6{digit}" not in self.rules.codes or int(number) >= self.expect.digital:
            return None
        name = self.expect.names.get(f"dout{int(number)}", f"P{int(number)}")
        return Output(name, 1.0 if digit == "4" else 0.0)

    def is_remark(self, raw: str) -> bool:
        """Whether the line is a short comment without special characters."""
        return raw[:1] == "(" and _REMARK.fullmatch(raw) is not None

    def bare(self, raw: str) -> str:
        """The words of a line, in small letters and without blanks.

        Raises LineError if the controller refuses the line.
        """
        text, rules = raw.removesuffix("\r"), self.rules
        if not rules.squeezed and len(text) > rules.limit:
            raise LineError(f"{len(text)} characters, {rules.name} reads {rules.limit}")
        if rules.forbidden and (bad := rules.forbidden.search(text)):
            reason = f"acts at once or is no ASCII, which {rules.name} minds in comments too"
            raise LineError(f"character {bad[0]!r} {reason}")
        if rules.linuxcnc and text.strip(" \t\r") == "%":
            if self.has_text and not (self.opened or self.ended):
                raise LineError("a per cent sign that does not belong to one on the first line")
            return "%"
        self.has_text = self.has_text or not raw.isspace()
        if "(" in text or ";" in text or ")" in text:
            if rules.linuxcnc:
                _refuse_active(text)
            text = without_comments(text)
        text = text.replace(" ", "").replace("\t", "")
        if not text.isascii():
            raise LineError("a character that is not ASCII outside a comment")
        if rules.squeezed and len(text) > rules.limit:
            length = f"{len(text)} characters without blanks and comments"
            raise LineError(f"{length}, {rules.name} reads {rules.limit}")
        if text.startswith("/"):
            self.note_slash()
        return _words(text.lower().removeprefix("/"), rules)

    def note_slash(self) -> None:
        """Adds a finding for a slash before a line.

        Raises UnknownWord if a switch of the operator decides whether the line runs.
        """
        if self.rules.linuxcnc:
            raise UnknownWord(
                "block delete: whether the line runs depends on a switch of the operator"
            )
        self.log.find(
            "unusual", f"a slash before a line, which {self.rules.name} ignores and no post writes"
        )

    def group(self, code: str) -> str:
        """The modal group of a code. Raises LineError."""
        if code not in GROUP:
            raise LineError(tell_unread(code, "not a code that is known"))
        return GROUP[code]

    def take(self, codes: Mapping[str, str], words: Mapping[str, float]) -> None:
        """Checks the codes and words of a line.

        Raises LineError if the controller does not have a code or tool, or if two codes are of one
        group.
        """
        for code in codes.values():
            if code not in self.rules.codes:
                what = tell_unread(code, f"not a code of {self.rules.name}")
                raise LineError(what) if code in _UNREAD else UnknownWord(what)
        for name, groups in _ONE_GROUP.items():
            both = [codes[group] for group in groups if group in codes]
            if len(both) > 1:
                raise LineError(f"{both[0]} and {both[1]} are of one group ({name})")
        if words.get("T", 0.0) > self.rules.max_tool:
            raise LineError(
                f"T{words['T']:g}: {self.rules.name} has tools to T{self.rules.max_tool:g}"
            )
        self.stated_groups.update(codes)
        self._take_idle(codes, words)

    def _take_idle(self, codes: Mapping[str, str], words: Mapping[str, float]) -> None:
        """Adds findings for codes that no post writes and that change no motion."""
        is_expected = self.expect.tool and int(words.get("T", 0.0)) == self.expect.tool
        if "T" in words and is_expected:
            self.note_idle("T")
        elif "T" in words:
            self._wait_for("T", f"T{words['T']:g} selects a tool that no M6 changes to")
        if "S" in words and codes.get("spindle", self.spindle) == "M5":
            self._wait_for("S", f"S{words['S']:g} without M3 or M4")
        if "tool change" in codes:
            self.idle_words.pop("T", None)
        if codes.get("spindle", "M5") != "M5":
            self.idle_words.pop("S", None)
        if self.rules.linuxcnc and "M30" in codes.values():
            self.log.find("unusual", "M30 exchanges pallets before the end; posts write M2")
        if "G53" in codes.values() and len(codes) > len(_LIFT):
            self.log.find("unusual", "a code in the line of G53 G0 Z0, which posts write alone")
        for group, usual in _HELD.items():
            code = codes.get(group, usual)
            if code != usual and code not in self.unusual:
                self.unusual.add(code)
                self.log.find("unusual", f"{code} where posts write in {usual}")

    def _wait_for(self, letter: str, what: str) -> None:
        """Keeps a word until its code comes. A word of this letter that waits is a finding."""
        self.note_idle(letter)
        self.idle_words[letter] = (self.line, what)

    def note_idle(self, letter: str) -> None:
        """Adds a finding for a word whose code has not come."""
        if letter in self.idle_words:
            line, what = self.idle_words.pop(letter)
            self.log.find("unusual", what, line=line)

    def switch(self, signal: str, value: float) -> None:
        """Sets an output under the name of its signal, or the force."""
        channel, scale = self.expect.force or (-1, 1.0)
        if self.lifted and not self.has_position:
            self.log.find(
                "unusual", "an output is switched when the machine has moved already (G53)"
            )
        if signal != f"aout{channel}":
            name = self.expect.names.get(signal, signal.replace("dout", "P").replace("aout", "E"))
            self.add(Output(name, value))
            return
        newtons = value / scale
        if newtons < 0:
            raise LineError(f"a force of {newtons:g} N")
        if self.output_line == self.line and self.is_pressing:
            self.next_force = newtons
            return
        self.is_pressing, self.force, self.next_force = newtons > 0, newtons, None
        self.add(Force(newtons))

    def is_settled(self) -> bool:
        """Whether the machine is settled and neither an output nor a force waits for a motion."""
        return Machine.is_settled(self) and not self.output_line and self.next_force is None

    def stand(self, code: str) -> None:
        """Runs a motion code without a target. Raises LineError if it needs a feed."""
        if code == "G1" and self.feed <= 0:
            raise LineError("G1 without a feed (F)")
        if self.lifted:
            _check_modes(self)
            _check_path(self)
        Machine.stand(self, code)

    def settle(self, code: str, words: Mapping[str, float], cycle: bool) -> None:
        """Checks the state of the machine before a motion. Raises LineError."""
        named = [axis for axis in AXES if axis in words]
        if not named and (cycle or not self.rules.linuxcnc):
            raise LineError(f"{code} without {'X, Y or Z' if cycle else 'an end point'}")
        if self.motion != "G0" and self.feed <= 0:
            raise LineError(f"{self.motion} without a feed (F)")
        if cycle:
            _check_cycle(self, words)
        else:
            _start(self)
            _check_change(self)
            _check_position(self, named)
            _check_spiral(self, words)
        self.output_line = 0
        if self.next_force is not None:
            self.force, self.next_force = self.next_force, None
        Machine.settle(self, code, words, cycle)


def _words(text: str, rules: Controller) -> str:
    """A line in small letters without its number.

    Raises LineError if the number is out of range or if anything but words follows.
    """
    words = without_number(text)
    number = text[: len(text) - len(words)]
    if number and float(number[1:]) > rules.max_line_number:
        largest = f"{rules.max_line_number:.0f}"
        raise LineError(f"{number.upper()[:12]}: {rules.name} numbers lines to {largest}")
    _refuse_unread(words)
    return words


def _refuse_active(text: str) -> None:
    """Raises LineError for a comment that LinuxCNC acts on."""
    for comment in COMMENT.finditer(text):
        if comment[1] is not None and "," in comment[1] and _ACTIVE.match(comment[1]):
            raise LineError(f"active comment {comment[0][:20]!r}")
        if comment[0].lower().startswith(";py,"):
            raise LineError("active comment ';py,'")


def _refuse_unread(text: str) -> None:
    """Raises LineError for anything but words with plain numbers."""
    if not _LINE.fullmatch(text):
        if any(character in text for character in "#[]"):
            raise UnknownWord("parameters and expressions are not read")
        if re.search("o[0-9<]", text):
            raise UnknownWord("O-words are not read")
        match = _LINE.match(text)
        raise LineError(f"cannot read {text[match.end() if match else 0 :].upper()[:12]!r}")
    if "n" in text or "o" in text:  # the number of a line or a program, which is not a word
        letter, number = next(word for word in _WORDS.findall(text) if word[0] in "no")
        raise LineError(f"word {letter.upper()}{float(number):g}: nothing in the line uses it")


def _start(machine: Strict) -> None:
    """Checks the state of the machine before the first motion."""
    if machine.has_moved:
        return
    machine.has_moved = True
    _check_modes(machine)
    if machine.unit is None:
        machine.unit = 1.0
        machine.log.find("unusual", "a motion before G20 or G21; read as mm")
    machine.work = machine.work or "G54"
    if machine.work != machine.expect.work:
        machine.log.find(
            "refused", f"work offset {machine.work}, but post.work is {machine.expect.work}"
        )
    if machine.expect.tool and machine.length_code != "G43":
        machine.log.find(
            "refused", "the length of the tool is not applied (G43) before the first motion"
        )
    elif not machine.length_code:
        machine.log.find(
            "unusual",
            "neither G49 nor G43 before the first motion: a tool length that is on shifts Z",
        )
    if machine.lifted and not machine.expect.lift:
        machine.log.find(
            "unusual", "G53 has sent the tool to the machine's zero of Z, but post.lift is false"
        )
    _check_path(machine)


def _check_change(machine: Strict) -> None:
    """Adds a finding if the length of a tool is not applied before it moves."""
    if machine.due_tool:
        what = f"is not applied (G43 H{machine.due_tool}) before it moves"
        machine.log.find("refused", f"the length of tool {machine.due_tool} {what}")
        machine.due_tool = 0


def _check_modes(machine: Strict) -> None:
    """Adds a finding for modes without a code before the first motion."""
    needed = {**_MODES, "work offset": machine.expect.work}
    missing = [code for group, code in needed.items() if group not in machine.stated_groups]
    if missing:
        reason = "the program before may have left it otherwise"
        what = f"{', '.join(missing)} not said before the first motion: {reason}"
        machine.log.find("unusual", what)
    machine.stated_groups.update(needed)


def _check_path(machine: Strict) -> None:
    """Adds a finding, once, if corners may be rounded by any amount."""
    if machine.expect.path_tolerance is not None and not machine.path_code:
        machine.path_code = "none"
        machine.log.find(
            "unusual",
            "neither G61 nor G64 P before the first motion: corners may be rounded by any amount",
        )


def _check_position(machine: Strict, named: Sequence[str]) -> None:
    """Adds a finding for a motion from an unknown position that may collide.

    The usual order of a post is Z up first, then X and Y together.
    named: axes of the motion.
    """
    if machine.has_position:
        return
    what = ""
    if machine.incremental or machine.motion != "G0":
        kind = "an incremental" if machine.incremental else "a feed"
        what = f"{kind} motion from a position that is not known"
    elif machine.lifted and "Z" in named and not (machine.known[0] and machine.known[1]):
        machine.log.find(
            "unusual", "Z comes down from the top of the machine before X and Y are over the part"
        )
    elif not (machine.known[2] or machine.lifted) and "Z" not in named:
        what = "X or Y moves while Z is not known"
    elif any(machine.known[AXES.index(axis)] for axis in named):
        machine.log.find("unusual", "an axis moves again before the position is known in all axes")
    elif not (machine.known[2] or machine.lifted) and len(named) > 1:
        machine.log.find("unusual", "Z moves together with X or Y while it is not known")
    elif len([axis for axis in "XY" if axis in named]) == 1 and not (
        machine.known[0] or machine.known[1]
    ):
        machine.log.find("unusual", "X and Y move one after the other to where the program begins")
    if what:
        machine.log.find("unusual", f"{what}; read as from 0")
        machine.known[:] = [True, True, True]
        machine.has_position = True


def _check_spiral(machine: Strict, words: Mapping[str, float]) -> None:
    """Adds a finding for an arc whose radius changes by more than its printed digits explain.

    A change that is so large that the controller refuses it is a finding of its own.
    """
    if (
        machine.motion not in ("G2", "G3")
        or "R" in words
        or machine.incremental
        or machine.absolute_centre
        or machine.plane != "G17"
    ):
        return
    (x, y), (i, j) = machine.at[:2], (words.get(letter, 0.0) * machine.scale for letter in "IJ")
    u, v = (
        words[axis] * machine.scale + machine.shift[k] if axis in words else machine.at[k]
        for k, axis in enumerate("XY")
    )
    start, end = math.hypot(i, j), math.hypot(u - x - i, v - y - j)
    accepted = max(machine.rules.arcs.spiral[0], 0.001 * start)
    if machine.expect.spiral + 1e-9 < abs(start - end) <= accepted:
        machine.log.find("unusual", f"an arc whose radius goes from {start:.4f} to {end:.4f} mm")


def _check_cycle(machine: Strict, words: Mapping[str, float]) -> None:
    """Checks that a cycle leaves nothing open.

    It has to go straight down in absolute coordinates from a known height, to which G98 returns.
    Raises UnknownWord for another cycle.
    """
    is_usual = (
        machine.has_position
        and machine.unit == 1.0
        and machine.plane == "G17"
        and machine.to_start is True
        and not machine.incremental
    )
    if (
        not is_usual
        or machine.output_line
        or machine.is_pressing
        or machine.next_force is not None
        or "L" in words
    ):
        raise UnknownWord(f"{machine.motion} in another state than a post leaves it in is not read")
    held = {**machine.sticky, **words}
    if "R" in held and held["R"] > (machine.at[2] if machine.level is None else machine.level):
        raise UnknownWord(f"{machine.motion} that begins above where G98 returns to is not read")
    if machine.motion == "G83" and "R" in held and held["R"] == held.get("Z"):
        raise LineError("G83 with pecks and no depth")


def _switch(machine: Strict, code: str, words: dict[str, float]) -> None:
    letter, count = (
        ("E", machine.expect.analog) if code in ("M67", "M68") else ("P", machine.expect.digital)
    )
    if words.get(letter, 0.0) >= count:
        has = f"the machine has {counted(count, 'such output')} from {letter}0 (post.outputs)"
        raise LineError(f"{code} {letter}{words[letter]:g}: {has}")
    if code in ("M62", "M63", "M67"):
        machine.output_line = machine.line
    HANDLERS["outputs"](machine, code, words)


def _change(machine: Strict, code: str, words: dict[str, float]) -> None:  # noqa: ARG001
    if machine.tool is None:
        raise LineError("M6 without a tool (T)")
    if not machine.expect.tool:
        _change_among(machine)
        return
    if machine.has_position:
        raise LineError("a tool change after the first motion is not read")
    if machine.is_changed:
        machine.log.find("unusual", "M6 a second time")
    if machine.tool != machine.expect.tool:
        raise LineError(f"tool T{machine.tool}, but post.tool is {machine.expect.tool}")
    machine.is_changed = True


def _change_among(machine: Strict) -> None:
    """Changes to one of several tools. The position and the tool length are unknown after it."""
    if machine.tool == 0 or machine.tool is None:
        raise LineError("T0 M6 takes the tool out")
    _check_first_change(machine)
    if machine.spindle != "M5" or machine.coolants or machine.is_pressing:
        machine.log.find(
            "refused",
            f"tool {machine.tool} is changed while the spindle, a coolant or a force is on",
        )
    if machine.due_tool:
        machine.log.find("unusual", f"tool {machine.due_tool} is changed to and never used")
    machine.add(ToolChange(machine.tool))
    machine.due_tool, machine.length_code = machine.tool, ""
    machine.has_position = machine.lifted = False
    machine.known[:] = [False, False, False]


def _check_first_change(machine: Strict) -> None:
    """Adds findings for settings that are missing before the first tool change.

    The machine moves in a tool change.
    """
    if any(isinstance(item, ToolChange) for item in machine.body):
        return
    _check_modes(machine)
    _check_path(machine)
    if machine.expect.lift and not machine.lifted:
        machine.log.find("unusual", "G53 G0 Z0 is missing before the first tool change")
    if machine.length_code != "G49":
        machine.log.find(
            "unusual", "G49 is missing before the first tool change: a length that is on shifts Z"
        )


def _spindle(machine: Strict, code: str, words: dict[str, float]) -> None:
    if code != "M5" and machine.speed is None:
        machine.spindle = code
        raise LineError(f"{code} without a speed (S)")
    HANDLERS["spindle"](machine, code, words)


def _coolant_off(machine: Strict, code: str, words: dict[str, float]) -> None:
    # M9 switches the coolants of the options off, even if none is on.
    named = {word for word, signal in _COOLANTS.items() if signal in machine.expect.names}
    machine.coolants = machine.coolants or named or {"M8"}
    HANDLERS["coolant off"](machine, code, words)


def _length(machine: Strict, code: str, words: dict[str, float]) -> None:
    due_tool = machine.due_tool
    if code == "G43" and due_tool:
        if "H" not in words:
            machine.log.find(
                "unusual",
                f"G43 without H: the length of tool {due_tool} is asked for by H{due_tool}",
            )
        number = words.pop("H", due_tool)
        if number != due_tool:
            length = f"the length of another tool than T{due_tool}"
            raise LineError(f"G43 H{number:g} shifts z by {length}")
        machine.due_tool = 0
    elif code == "G43":
        number = words.pop("H", machine.expect.tool)
        if not machine.expect.tool or number != machine.expect.tool:
            raise LineError(
                f"G43 shifts z by the length of a tool, but post.tool is {machine.expect.tool}"
            )
    if code == "G49" and machine.expect.lift and not machine.lifted:
        machine.log.find(
            "unusual", "G49 lowers the next height by a tool length that is on; G53 G0 Z0 first"
        )
    if machine.has_position and code != machine.length_code:
        raise LineError(f"{code} after the first motion shifts the origin")
    machine.length = machine.length_code = code


def _work_offset(machine: Strict, code: str, words: dict[str, float]) -> None:
    # A tool change makes the position unknown again, but not the work offset.
    if machine.has_moved and code != machine.work:
        raise LineError(f"{code}: another work offset after the first motion is not read")
    HANDLERS["work offset"](machine, code, words)


def _path_mode(machine: Strict, code: str, words: dict[str, float]) -> None:
    machine.path_code = code
    if code != "G64":
        wanted = (
            f"G64 P{machine.expect.path_tolerance:g}" if machine.expect.path_tolerance else "G61"
        )
        if machine.expect.path_tolerance is None:
            reason = f"{machine.rules.name} rounds corners by its own setting"
            machine.log.find("unusual", f"{code} changes nothing: {reason}")
        elif code != wanted:
            machine.log.find(
                "unusual",
                f"{code} where post.path_tolerance asks for {wanted}: corners take another time",
            )
        return
    tolerance = words.pop("P", 0.0)
    if "Q" not in words:
        machine.log.find("unusual", "G64 without Q joins lines within P")
    joined = words.pop("Q", tolerance)
    allowed = machine.expect.path_tolerance or 0.0
    if tolerance <= 0:
        raise LineError("G64 without P rounds corners by any amount")
    if max(tolerance, joined) * machine.scale > allowed * (1 + 1e-9):
        largest = f"{max(tolerance, joined):g}"
        limit = f"post.path_tolerance is {allowed:g}"
        raise LineError(f"G64 may leave the path by {largest}, {limit}")


_HANDLERS: dict[str, Callable[[Strict, str, dict[str, float]], None]] = {
    **HANDLERS,
    "outputs": _switch,
    "tool change": _change,
    "spindle": _spindle,
    "coolant off": _coolant_off,
    "length offset": _length,
    "work offset": _work_offset,
    "path": _path_mode,
}


def run(lines: Sequence[str], rules: Controller, expect: Expect) -> Strict:
    """The machine after a run of the lines. It raises nothing for any text."""
    exact = replace(rules.arcs, spiral=(expect.spiral,) * 3)
    machine = Strict(limits=rules.arcs, exact=exact, rules=rules, expect=expect, handlers=_HANDLERS)
    try:
        Interpreter(machine, lines, compile_lines(len(lines))).run()
    except Stopped as stopped:
        machine.log.find("refused", str(stopped))
    _read_rest(machine, lines)
    for letter in "ST":
        machine.note_idle(letter)
    if not machine.ended:
        machine.log.find("refused", "the program has no end (M2 or M30)")
    if any(machine.known) and not machine.has_position:
        machine.log.find("refused", "the program ends before the position is known in all axes")
    if machine.output_line:
        what = "an output that waits for the next motion (M62, M63, M67), and none follows"
        machine.log.find("refused", what, line=machine.output_line)
    if machine.due_tool:
        tool = machine.due_tool
        what = f"tool {tool} is changed to, and its length is not applied (G43 H{tool})"
        machine.log.find("refused", what, line=_last_change(machine))
    if machine.expect.tool and not machine.is_changed:
        machine.log.find(
            "refused", f"the tool change T{machine.expect.tool} M6 of post.tool is missing"
        )
    return machine


def _last_change(machine: Strict) -> int:
    """The line of the last tool change."""
    instructions = zip(machine.body, machine.lines, strict=True)
    return max(line for item, line in instructions if isinstance(item, ToolChange))


def _read_rest(machine: Strict, lines: Sequence[str]) -> None:
    """Adds findings for lines with words after the end of the program."""
    parameters = Parameters(machine.value)
    for index in range(machine.line, len(lines)):
        machine.line = index + 1
        try:
            text = machine.bare(lines[index])
            if text not in ("", "%"):
                machine.take(*words_of(text, parameters, machine.group))
                machine.log.find("unusual", "a line after the end of the program")
        except LineError as error:
            machine.refuse(error)


def list_written(machine: Strict) -> Executed:
    """The program that a machine has run."""
    return Executed(machine.body.body(), machine.lines, findings=machine.log.list_findings())


def read(files: Mapping[str, str], options: Mapping[str, object]) -> Executed:
    """Reads a LinuxCNC program back.

    options: options of the post. Missing ones have the defaults of docs/posts/gcode.md.
    Raises JobError if an option has the wrong type.
    """
    force = None
    if options.get("force") == "analog":
        force = (
            int(read_number(options, "force_channel", 0)),
            read_number(options, "force_scale", 0.0) or 1.0,
        )
    names = signals(options, {"process": "P0"})
    outputs = int(read_number(options, "outputs", 4))
    numbers = [int(name[4:]) for name in names if re.fullmatch("dout[0-9]{1,2}", name)]
    expect = Expect(
        work=str(options.get("work", "G54")),
        tool=int(read_number(options, "tool", 0)),
        path_tolerance=read_number(options, "path_tolerance", 0.01),
        names=names,
        lift=options.get("lift", True) is True,
        force=force,
        spiral=spiral(options),
        digital=max([outputs, *(number + 1 for number in numbers)]),
        analog=max(outputs, force[0] + 1 if force else 0),
    )
    lines = lines_of(files)
    machine = run(lines, LINUXCNC, expect)
    foreign = _read_foreign(lines, machine) if machine.unknown_line else None
    return foreign or list_written(machine)


def _read_foreign(lines: Sequence[str], machine: Strict) -> Executed | None:
    """Reads a program with words that no post writes as a third-party program.

    The words are a finding, so that a program of a post with such words never passes.
    machine: the strict machine after it has run the lines.
    Returns None if this run stops before the first of these words.
    """
    from camgen.lang.gcode.replayed import interpret  # noqa: PLC0415 (only for words of others)

    program = interpret(lines)
    if program.stopped and program.stopped[0] < machine.unknown_line:
        return None
    what = "a word that camgen does not write; the program is read as LinuxCNC runs it"
    log = Log()
    log.find("unusual", what, line=machine.unknown_line)
    for line, note in program.remarks:
        log.find("unusual", str(note), line=line)
    if program.stopped:
        line, reason = program.stopped
        log.find("refused", f"{reason}; nothing from here on is read", line=line)
    elif not program.ended:
        log.find("refused", "the program has no end (M2 or M30)", line=len(lines))
    body = rename(program.body, machine.expect.names)
    return Executed(body, program.lines, findings=log.list_findings())


def rename(body: Iterable[Instruction], names: Mapping[str, str]) -> tuple[Instruction, ...]:
    """`body` with the names of signals for the outputs that have one."""
    return tuple(
        Output(names[item.signal], item.value)
        if isinstance(item, Output) and item.signal in names
        else item
        for item in body
    )


def lines_of(files: Mapping[str, str]) -> Lines:
    """The lines of all files in order, without their ends."""
    return Lines(list(files.values()))


def spiral(options: Mapping[str, object]) -> float:
    """Maximum difference of the two radii of an arc that the printed digits cause, mm.

    Both ends lose up to half a digit in X and Y, and the centre loses more.
    """
    return 3 * 10 ** -read_number(options, "decimals", 3)


def signals(options: Mapping[str, object], default: dict[str, str]) -> dict[str, str]:
    """The option `signals`: signal by output. Outputs have the names of the interpreter.

    Raises JobError if the option is not a table of texts.
    """
    table = options.get("signals", default)
    if not isinstance(table, Mapping) or not all(isinstance(word, str) for word in table.values()):
        raise JobError(
            "[post] signals", "is not a table of output words", remedy='e.g. { process = "P0" }'
        )
    return {
        _COOLANTS.get(word, word.replace("P", "dout")): str(name) for name, word in table.items()
    }
