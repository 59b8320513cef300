"""Reads a LinuxCNC program back: text -> instructions, faults by line.

The interpreter of foreign programs runs it (``camgen.lang.gcode``). This layer asks for more: what no post writes is a
fault, and so is what a program leaves open, or what differs from the options of its post. Nothing is guessed: a fault
also says what is assumed from there on. A program with words that no post writes (other cycles, O-words, parameters,
shifts of the origin) is run once more as a foreign one; what is not known there either is a fault that names the word.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import cast

from msgspec.structs import replace

from camgen.lang.gcode import arcs
from camgen.lang.gcode.interpreter import interpret_plain, play
from camgen.lang.gcode.machine import AXES, HANDLERS, Machine, PlainReader
from camgen.lang.gcode.o_words import Blocks
from camgen.lang.gcode.words import (
    COMMENT,
    LineError,
    Parameters,
    UnknownWord,
    not_read,
    without_comments,
    without_number,
    words_of,
)
from camgen.lang.log import Log
from camgen.lang.programs import Executed
from camgen.lang.run import Stopped
from camgen.model.errors import JobError
from camgen.model.part import NoteKind
from camgen.model.program import Force, Instruction, Output, Stop, ToolChange
from camgen.model.text import counted

from .strict_runs import FEW, MOTION, REMARK, Chunk, Lines, Settled, cut, perform

_WORDS = re.compile(r"([a-z])([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+))")
_LINE = re.compile(rf"(?:{_WORDS.pattern})*")
#: Comments that LinuxCNC acts on. ``MSG`` only shows its text.
_ACTIVE = re.compile(
    r"\s*(debug|print|log|logopen|logappend|logclose|probeopen|probeclose|abort|py)\b",
    re.IGNORECASE,
)
#: What the program before may have left otherwise (LinuxCNC's M2 and GRBL's reset put it back, an abort need not):
#: by modal group, and as posts say it before anything moves. Units, tool length and path have remarks of their own.
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
#: Groups that are one here, of which LinuxCNC takes two codes in one line or the interpreter does.
_ONE_GROUP = {"motion": ("cycle off", "motion"), "coolant": ("mist", "flood", "coolant off")}
_COOLANTS = {"M7": "mist", "M8": "flood"}

_PLAIN, _REMARK = re.compile(MOTION), re.compile(REMARK)


@dataclass(frozen=True, slots=True)
class Rules:
    """What is taken from programs for a controller.

    codes: those that are read. limit: characters per line, counted without blanks and comments where ``squeezed``.
    forbidden: characters that must not even stand in a comment. linuxcnc: its per cent signs, active comments, block
    delete and circles without an end point, else GRBL's way with these. arcs: what it takes as one. most_tool,
    most_line: the largest T and N.
    """

    name: str
    codes: frozenset[str]
    limit: int
    squeezed: bool
    forbidden: re.Pattern[str] | None
    linuxcnc: bool
    arcs: arcs.Limits
    most_tool: float = math.inf
    most_line: float = math.inf


_CODES = """
    G0 G1 G2 G3 G4 G17 G18 G19 G20 G21 G40 G43 G49 G53 G54 G55 G56 G57 G58 G59 G59.1 G59.2 G59.3 G61 G61.1 G64 G80 G81
    G82 G83 G90 G90.1 G91 G91.1 G94 G97 G98 G99 M0 M1 M2 M3 M4 M5 M6 M7 M8 M9 M30 M62 M63 M64 M65 M67 M68
"""
LINUXCNC = Rules(
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
    """What the options of the post say about the text.

    work: the work offset. tool: the tool that is changed to, 0: none. path: most mm of G64, None where the controller
    has none. names: signal by output, as the interpreter names those. lift: up in machine coordinates before G49.
    force: analog output and value per N, None without force. digital, analog: how many of these outputs the machine
    has. spiral: by how much the radii of an arc may differ for its printed digits, mm.
    """

    work: str
    tool: int = 0
    path: float | None = None
    names: Mapping[str, str] = field(default_factory=dict)
    lift: bool = False
    force: tuple[int, float] | None = None
    digital: int = 4
    analog: int = 4
    spiral: float = 0.003


@dataclass(slots=True, kw_only=True)
class Strict(Machine):
    """The machine that takes only what posts write, and notes faults instead of stopping.

    text: whether a line has come that is not blank. said: the modal groups that have come. started: a motion was read.
    applied, path: G43 or G49, and G61 or G64, as the program said. changed: to the tool. pressing: by force; following:
    N from the next motion on. waiting: the line of an output that waits for the next motion. unread: the first line
    with a word that no post writes. due: the number of the tool whose length has to be applied before the next motion.
    idle: words whose code has not come, S and T, with their lines. chunk: the lines that are read by column.
    """

    rules: Rules
    expect: Expect
    others: str = ""
    plain: re.Pattern[str] = _PLAIN
    blend: float = 0.0
    log: Log = field(init=False)
    text: bool = False
    said: set[str] = field(default_factory=set)
    started: bool = False
    applied: str = ""
    path: str = ""
    changed: bool = False
    pressing: bool = False
    following: float | None = None
    waiting: int = 0
    unread: int = 0
    due: int = 0
    idle: dict[str, tuple[int, str]] = field(default_factory=dict)
    chunk: Chunk | None = None
    #: Codes of modes that no post sets, each of which is noted once.
    unusual: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        self.log = Log(lambda: self.line)

    def fault(self, what: str) -> None:
        """Notes a fault of the line that is read."""
        self.log.find("refused", what)

    def remark(self, what: str) -> None:
        """Notes what the line leaves open."""
        self.log.find("unusual", what)

    def note(self, kind: NoteKind, what: str, why: str = "") -> None:
        """What a replay assumes or leaves out is open in a program of our own."""
        if kind != "warning":
            self.remark(f"{what} ({why})")

    def refuse(self, error: LineError) -> None:
        """Notes what is wrong; the next line is read."""
        self.fault(str(error))
        if isinstance(error, UnknownWord):
            self.unread = self.unread or self.line

    def read_plain(self, lines: Sequence[str], at: int, bound: int, plain: PlainReader) -> int:
        """By column where there are many in a row, in mm and without force; the outputs between them too."""
        usual = (
            isinstance(lines, Lines) and self.unit == 1.0 and not self.force and not any(self.shift)
        )
        while usual and at < bound:
            chunk = self.chunk
            if chunk is None or not chunk.holds(at):
                chunk = self.chunk = cut(cast(Lines, lines), at, self.output)
            stop = min(bound, chunk.end(at))
            state = Settled(self.here(), self.feed, self.blend, self.exact or self.limits)
            done = perform(chunk, state, at, stop) if chunk.usable and stop - at >= FEW else None
            if done is None:
                break
            self.body.extend_body(done.body)
            self.lines.frombytes(done.lines.tobytes())
            self.at[:], self.feed, self.motion, self.cut = (
                done.at,
                done.feed,
                done.motion,
                self.cut or done.cut,
            )
            chunk.usable, at = done.line == stop, done.line
        return plain(self, lines, at, bound) if at < bound else at

    def output(self, digit: str, number: str) -> Output | None:
        """What M64 or M65 sets, by the last digit of the code; None where the machine has no such code or output."""
        if f"M6{digit}" not in self.rules.codes or int(number) >= self.expect.digital:
            return None
        signal = f"dout{int(number)}"
        return Output(
            self.expect.names.get(signal, signal.replace("dout", "P")), 1.0 if digit == "4" else 0.0
        )

    def is_remark(self, raw: str) -> bool:
        """Whether the line is one comment in harmless characters, far from the limit of a line."""
        return raw[:1] == "(" and _REMARK.fullmatch(raw) is not None

    def bare(self, raw: str) -> str:
        """The line without all that is no word, if the controller takes it as it is written."""
        text, rules = raw.removesuffix("\r"), self.rules
        if not rules.squeezed and len(text) > rules.limit:
            raise LineError(f"{len(text)} characters, {rules.name} reads {rules.limit}")
        if rules.forbidden and (bad := rules.forbidden.search(text)):
            raise LineError(
                f"character {bad[0]!r} acts at once or is no ASCII, which {rules.name} minds in comments too"
            )
        if rules.linuxcnc and text.strip(" \t\r") == "%":
            if self.text and not (self.opened or self.ended):
                raise LineError("a per cent sign that does not belong to one on the first line")
            return "%"
        self.text = self.text or not raw.isspace()
        if "(" in text or ";" in text or ")" in text:
            if rules.linuxcnc:
                _refuse_active(text)
            text = without_comments(text)
        text = text.replace(" ", "").replace("\t", "")
        if not text.isascii():
            raise LineError("a character that is not ASCII outside a comment")
        if rules.squeezed and len(text) > rules.limit:
            raise LineError(
                f"{len(text)} characters without blanks and comments, {rules.name} reads {rules.limit}"
            )
        if text.startswith("/"):
            self.note_slash()
        return _words(text.lower().removeprefix("/"), rules)

    def note_slash(self) -> None:
        """A slash before a line. UnknownWord if a switch of the operator decides about the line."""
        if self.rules.linuxcnc:
            raise UnknownWord(
                "block delete: whether the line runs depends on a switch of the operator"
            )
        self.remark(f"a slash before a line, which {self.rules.name} ignores and no post writes")

    def take(self, codes: Mapping[str, str], words: Mapping[str, float]) -> None:
        """LineError for a code that no post writes, for two of one group, and for a tool that cannot be."""
        for code in codes.values():
            if code not in self.rules.codes:
                raise not_read(code, f"not a code of {self.rules.name}")
        for name, groups in _ONE_GROUP.items():
            both = [codes[group] for group in groups if group in codes]
            if len(both) > 1:
                raise LineError(f"{both[0]} and {both[1]} are of one group ({name})")
        if words.get("T", 0.0) > self.rules.most_tool:
            raise LineError(
                f"T{words['T']:g}: {self.rules.name} has tools to T{self.rules.most_tool:g}"
            )
        self.said.update(codes)
        self._take_idle(codes, words)

    def _take_idle(self, codes: Mapping[str, str], words: Mapping[str, float]) -> None:
        """Remarks on what changes no motion of a program, and the machine all the same."""
        changes = self.expect.tool and int(words.get("T", 0.0)) == self.expect.tool
        if "T" in words and changes:
            self.note_idle("T")
        elif "T" in words:
            self._wait_for("T", f"T{words['T']:g} selects a tool that no M6 changes to")
        if "S" in words and codes.get("spindle", self.spindle) == "M5":
            self._wait_for("S", f"S{words['S']:g} without M3 or M4")
        if "tool change" in codes:
            self.idle.pop("T", None)
        if codes.get("spindle", "M5") != "M5":
            self.idle.pop("S", None)
        if self.rules.linuxcnc and "M30" in codes.values():
            self.remark("M30 exchanges pallets before the end; posts write M2")
        if "G53" in codes.values() and len(codes) > len(_LIFT):
            self.remark("a code in the line of G53 G0 Z0, which posts write alone")
        for group, usual in _HELD.items():
            code = codes.get(group, usual)
            if code != usual and code not in self.unusual:
                self.unusual.add(code)
                self.remark(f"{code} where posts write in {usual}")

    def _wait_for(self, letter: str, what: str) -> None:
        """Keeps a word until its code comes, and notes the one before it that has none."""
        self.note_idle(letter)
        self.idle[letter] = (self.line, what)

    def note_idle(self, letter: str) -> None:
        """Notes a word whose code has not come."""
        if letter in self.idle:
            line, what = self.idle.pop(letter)
            self.log.find("unusual", what, line=line)

    def obey(self, group: str, code: str, words: dict[str, float]) -> None:
        """As the machine does, but as the options of the post expect it."""
        _HANDLERS[group](self, code, words)

    def switch(self, signal: str, value: float) -> None:
        """Sets an output under the name of its signal, or presses."""
        channel, scale = self.expect.force or (-1, 1.0)
        if self.lifted and not self.begun:
            self.remark("an output is switched when the machine has moved already (G53)")
        if signal != f"aout{channel}":
            name = self.expect.names.get(signal, signal.replace("dout", "P").replace("aout", "E"))
            self.add(Output(name, value))
            return
        newtons = value / scale
        if newtons < 0:
            raise LineError(f"a force of {newtons:g} N")
        if self.waiting == self.line and self.pressing:
            self.following = newtons
            return
        self.pressing, self.force, self.following = newtons > 0, newtons, None
        self.add(Force(newtons))

    def stop(self, code: str) -> None:
        """M0 and M1 stand still until the operator goes on."""
        if code in ("M0", "M1"):
            self.add(Stop(optional=code == "M1"))
        else:
            Machine.stop(self, code)

    def is_settled(self) -> bool:
        """Nor may anything wait for the next motion."""
        return Machine.is_settled(self) and not self.waiting and self.following is None

    def stand(self, code: str) -> None:
        """A motion code that leads nowhere needs a feed too."""
        if code == "G1" and self.feed <= 0:
            raise LineError("G1 without a feed (F)")
        if self.lifted:
            _check_modes(self)
            _check_path(self)
        Machine.stand(self, code)

    def settle(self, code: str, words: Mapping[str, float], cycle: bool) -> None:
        """What a post has said before anything moves, and where the tool is."""
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
            _place(self, named)
            _check_spiral(self, words)
        self.waiting = 0
        if self.following is not None:
            self.force, self.following = self.following, None
        Machine.settle(self, code, words, cycle)


def _words(text: str, rules: Rules) -> str:
    """A line of small letters without its number. LineError for a number out of range, and for what is no word."""
    words = without_number(text)
    number = text[: len(text) - len(words)]
    if number and float(number[1:]) > rules.most_line:
        raise LineError(
            f"{number.upper()[:12]}: {rules.name} numbers lines to {rules.most_line:.0f}"
        )
    _refuse_unread(words)
    return words


def _refuse_active(text: str) -> None:
    """LineError for a comment that LinuxCNC would act on."""
    for comment in COMMENT.finditer(text):
        if comment[1] is not None and "," in comment[1] and _ACTIVE.match(comment[1]):
            raise LineError(f"active comment {comment[0][:20]!r}")
        if comment[0].lower().startswith(";py,"):
            raise LineError("active comment ';py,'")


def _refuse_unread(text: str) -> None:
    """LineError for anything but words with plain numbers."""
    if not _LINE.fullmatch(text):
        if any(character in text for character in "#[]"):
            raise UnknownWord("parameters and expressions are not read")
        if re.search("o[0-9<]", text):
            raise UnknownWord("O-words are not read")
        match = _LINE.match(text)
        raise LineError(f"cannot read {text[match.end() if match else 0 :].upper()[:12]!r}")
    if "n" in text or "o" in text:  # of words only the number of a line, and of a program
        letter, number = next(word for word in _WORDS.findall(text) if word[0] in "no")
        raise LineError(f"word {letter.upper()}{float(number):g}: nothing in the line uses it")


def _start(m: Strict) -> None:
    """What must be settled before anything moves."""
    if m.started:
        return
    m.started = True
    _check_modes(m)
    if m.unit is None:
        m.unit = 1.0
        m.remark("a motion before G20 or G21; read as mm")
    m.work = m.work or "G54"
    if m.work != m.expect.work:
        m.fault(f"work offset {m.work}, but post.work is {m.expect.work}")
    if m.expect.tool and m.applied != "G43":
        m.fault("the length of the tool is not applied (G43) before the first motion")
    elif not m.applied:
        m.remark("neither G49 nor G43 before the first motion: a tool length that is on shifts Z")
    if m.lifted and not m.expect.lift:
        m.remark("G53 has sent the tool to the machine's zero of Z, but post.lift is false")
    _check_path(m)


def _check_change(m: Strict) -> None:
    """What a tool change asks for before the next motion."""
    if m.due:
        m.fault(f"the length of tool {m.due} is not applied (G43 H{m.due}) before it moves")
        m.due = 0


def _check_modes(m: Strict) -> None:
    """A remark on the modes that the program has not said when something moves for the first time."""
    needed = {**_MODES, "work offset": m.expect.work}
    missing = [code for group, code in needed.items() if group not in m.said]
    if missing:
        m.remark(
            f"{', '.join(missing)} not said before the first motion: the program before may have left it otherwise"
        )
    m.said.update(needed)


def _check_path(m: Strict) -> None:
    """A remark on corners that may be rounded by any amount, once."""
    if m.expect.path is not None and not m.path:
        m.path = "none"
        m.remark(
            "neither G61 nor G64 P before the first motion: corners may be rounded by any amount"
        )


def _place(m: Strict, named: Sequence[str]) -> None:
    """What leaves the position open. A tool that stands anywhere is lifted first, then moved in X and Y."""
    if m.begun:
        return
    why = ""
    if m.incremental or m.motion != "G0":
        why = f"{'an incremental' if m.incremental else 'a feed'} motion from a position that is not known"
    elif m.lifted and "Z" in named and not (m.known[0] and m.known[1]):
        m.remark("Z comes down from the top of the machine before X and Y are over the part")
    elif not (m.known[2] or m.lifted) and "Z" not in named:
        why = "X or Y moves while Z is not known"
    elif any(m.known[AXES.index(axis)] for axis in named):
        m.remark("an axis moves again before the position is known in all axes")
    elif not (m.known[2] or m.lifted) and len(named) > 1:
        m.remark("Z moves together with X or Y while it is not known")
    elif len([axis for axis in "XY" if axis in named]) == 1 and not (m.known[0] or m.known[1]):
        m.remark("X and Y move one after the other to where the program begins")
    if why:
        m.remark(f"{why}; read as from 0")
        m.known[:] = [True, True, True]
        m.begun = True


def _check_spiral(m: Strict, words: Mapping[str, float]) -> None:
    """A remark on an arc that the controller takes, though its radius changes by more than its digits lose."""
    if (
        m.motion not in ("G2", "G3")
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
    taken = max(m.rules.arcs.spiral[0], 0.001 * start)  # more is a fault of its own
    if m.expect.spiral + 1e-9 < abs(start - end) <= taken:
        m.remark(f"an arc whose radius goes from {start:.4f} to {end:.4f} mm")


def _check_cycle(m: Strict, words: Mapping[str, float]) -> None:
    """Only what leaves nothing open: straight down, absolute, from a known height to which G98 returns."""
    usual = (
        m.begun and m.unit == 1.0 and m.plane == "G17" and m.to_start is True and not m.incremental
    )
    if not usual or m.waiting or m.pressing or m.following is not None or "L" in words:
        raise UnknownWord(f"{m.motion} in another state than a post leaves it in is not read")
    held = {**m.sticky, **words}
    if "R" in held and held["R"] > (m.at[2] if m.level is None else m.level):
        raise UnknownWord(f"{m.motion} that begins above where G98 returns to is not read")
    if m.motion == "G83" and "R" in held and held["R"] == held.get("Z"):
        raise LineError("G83 with pecks and no depth")


def _switch(m: Strict, code: str, words: dict[str, float]) -> None:
    letter, count = ("E", m.expect.analog) if code in ("M67", "M68") else ("P", m.expect.digital)
    if words.get(letter, 0.0) >= count:
        has = f"the machine has {counted(count, 'such output')} from {letter}0 (post.outputs)"
        raise LineError(f"{code} {letter}{words[letter]:g}: {has}")
    if code in ("M62", "M63", "M67"):
        m.waiting = m.line
    HANDLERS["outputs"](m, code, words)


def _change(m: Strict, code: str, words: dict[str, float]) -> None:  # noqa: ARG001 (as all handlers)
    if m.tool is None:
        raise LineError("M6 without a tool (T)")
    if not m.expect.tool:
        _change_among(m)
        return
    if m.begun:
        raise LineError("a tool change after the first motion is not read")
    if m.changed:
        m.remark("M6 a second time")
    if m.tool != m.expect.tool:
        raise LineError(f"tool T{m.tool}, but post.tool is {m.expect.tool}")
    m.changed = True


def _change_among(m: Strict) -> None:
    """One of several tools: where the machine stands afterwards, and how long the tool is, is not known."""
    if m.tool == 0 or m.tool is None:
        raise LineError("T0 M6 takes the tool out")
    _check_first_change(m)
    if m.spindle != "M5" or m.coolants or m.pressing:
        m.fault(f"tool {m.tool} is changed while the spindle, a coolant or a force is on")
    if m.due:
        m.remark(f"tool {m.due} is changed to and never used")
    m.add(ToolChange(m.tool))
    m.due, m.applied, m.begun, m.lifted = m.tool, "", False, False
    m.known[:] = [False, False, False]


def _check_first_change(m: Strict) -> None:
    """Remarks on settings that are missing before the first change, for which a machine moves."""
    if any(isinstance(item, ToolChange) for item in m.body):
        return
    _check_modes(m)
    _check_path(m)
    if m.expect.lift and not m.lifted:
        m.remark("G53 G0 Z0 is missing before the first tool change")
    if m.applied != "G49":
        m.remark("G49 is missing before the first tool change: a length that is on shifts Z")


def _spindle(m: Strict, code: str, words: dict[str, float]) -> None:
    if code != "M5" and m.speed is None:
        m.spindle = code
        raise LineError(f"{code} without a speed (S)")
    HANDLERS["spindle"](m, code, words)


def _coolant_off(m: Strict, code: str, words: dict[str, float]) -> None:
    # With none on, M9 still says that the one in use is off.
    used = {word for word, signal in _COOLANTS.items() if signal in m.expect.names}
    m.coolants = m.coolants or used or {"M8"}
    HANDLERS["coolant off"](m, code, words)


def _length(m: Strict, code: str, words: dict[str, float]) -> None:
    if code == "G43" and m.due:
        if "H" not in words:
            m.remark(f"G43 without H: the length of tool {m.due} is asked for by H{m.due}")
        number = words.pop("H", m.due)
        if number != m.due:
            raise LineError(f"G43 H{number:g} shifts z by the length of another tool than T{m.due}")
        m.due = 0
    elif code == "G43":
        number = words.pop("H", m.expect.tool)
        if not m.expect.tool or number != m.expect.tool:
            raise LineError(
                f"G43 shifts z by the length of a tool, but post.tool is {m.expect.tool}"
            )
    if code == "G49" and m.expect.lift and not m.lifted:
        m.remark("G49 lowers the next height by a tool length that is on; G53 G0 Z0 first")
    if m.begun and code != m.applied:
        raise LineError(f"{code} after the first motion shifts the origin")
    m.length = m.applied = code


def _work_offset(m: Strict, code: str, words: dict[str, float]) -> None:
    # A tool change leaves the position open again, but not where the work is.
    if m.started and code != m.work:
        raise LineError(f"{code}: another work offset after the first motion is not read")
    HANDLERS["work offset"](m, code, words)


def _path(m: Strict, code: str, words: dict[str, float]) -> None:
    m.path = code
    if code != "G64":
        wanted = f"G64 P{m.expect.path:g}" if m.expect.path else "G61"
        if m.expect.path is None:
            m.remark(f"{code} changes nothing: {m.rules.name} rounds corners by its own setting")
        elif code != wanted:
            m.remark(
                f"{code} where post.path_tolerance asks for {wanted}: corners take another time"
            )
        return
    tolerance = words.pop("P", 0.0)
    if "Q" not in words:
        m.remark("G64 without Q joins lines within P")
    joined = words.pop("Q", tolerance)
    allowed = m.expect.path or 0.0
    if tolerance <= 0:
        raise LineError("G64 without P rounds corners by any amount")
    if max(tolerance, joined) * m.scale > allowed * (1 + 1e-9):
        raise LineError(
            f"G64 may leave the path by {max(tolerance, joined):g}, post.path_tolerance is {allowed:g}"
        )


_HANDLERS: dict[str, Callable[[Strict, str, dict[str, float]], None]] = {
    **HANDLERS,
    "outputs": _switch,
    "tool change": _change,
    "spindle": _spindle,
    "coolant off": _coolant_off,
    "length offset": _length,
    "work offset": _work_offset,
    "path": _path,
}


def run(lines: Sequence[str], rules: Rules, expect: Expect) -> Strict:
    """The machine after the lines. Never raises for anything that they hold."""
    exact = replace(rules.arcs, spiral=(expect.spiral,) * 3)
    m = Strict(limits=rules.arcs, exact=exact, rules=rules, expect=expect)
    try:
        play(m, lines, Blocks({}, {}))
    except Stopped as stopped:
        m.fault(str(stopped))
    _read_rest(m, lines)
    for letter in "ST":
        m.note_idle(letter)
    if not m.ended:
        m.fault("the program has no end (M2 or M30)")
    if any(m.known) and not m.begun:
        m.fault("the program ends before the position is known in all axes")
    if m.waiting:
        m.log.find(
            "refused",
            "an output that waits for the next motion (M62, M63, M67), and none follows",
            line=m.waiting,
        )
    if m.due:
        line = max(
            line for item, line in zip(m.body, m.lines, strict=True) if isinstance(item, ToolChange)
        )
        m.log.find(
            "refused",
            f"tool {m.due} is changed to, and its length is not applied (G43 H{m.due})",
            line=line,
        )
    if m.expect.tool and not m.changed:
        m.fault(f"the tool change T{m.expect.tool} M6 of post.tool is missing")
    return m


def _read_rest(m: Strict, lines: Sequence[str]) -> None:
    """The lines after the end: none of them may hold a word."""
    known = Parameters(m.value)
    for place in range(m.line, len(lines)):
        m.line = place + 1
        try:
            text = m.bare(lines[place])
            if text not in ("", "%"):
                m.take(*words_of(text, known))
                m.remark("a line after the end of the program")
        except LineError as error:
            m.refuse(error)


def list_written(m: Strict) -> Executed:
    """The effect of the program that a machine has run."""
    return Executed(m.body.body(), m.lines, findings=m.log.list_findings())


def read(files: Mapping[str, str], options: Mapping[str, object]) -> Executed:
    """What a LinuxCNC program says. options: of the post; left out, its defaults (docs/posts/gcode.md)."""
    force = None
    if options.get("force") == "analog":
        force = (
            int(number(options, "force_channel", 0)),
            number(options, "force_scale", 0.0) or 1.0,
        )
    names = signals(options, {"process": "P0"})
    outputs = int(number(options, "outputs", 4))
    expect = Expect(
        work=str(options.get("work", "G54")),
        tool=int(number(options, "tool", 0)),
        path=number(options, "path_tolerance", 0.01),
        names=names,
        lift=options.get("lift", True) is True,
        force=force,
        spiral=spiral(options),
        digital=max(
            [
                outputs,
                *(int(word[4:]) + 1 for word in names if re.fullmatch("dout[0-9]{1,2}", word)),
            ]
        ),
        analog=max(outputs, force[0] + 1 if force else 0),
    )
    lines = lines_of(files)
    m = run(lines, LINUXCNC, expect)
    return (m.unread and _read_foreign(lines, m)) or list_written(m)


def _read_foreign(lines: Sequence[str], m: Strict) -> Executed | None:
    """What a program with words that no post writes says; None where it stops at the first of them.

    m: the machine that met those words. That they are there is a remark, so that a program of our own never passes.
    """
    found = interpret_plain(lines)
    if found.stopped and found.unread and found.stopped[0] <= m.unread:
        return None
    what = "a word that camgen does not write; the program is read as LinuxCNC runs it"
    log = Log()
    log.find("unusual", what, line=m.unread)
    for line, note in found.remarks:
        log.find("unusual", str(note), line=line)
    if found.stopped:
        line, reason = found.stopped
        log.find("refused", f"{reason}; nothing from here on is read", line=line)
    elif not found.ended:
        log.find("refused", "the program has no end (M2 or M30)", line=len(lines))
    body = rename(found.body, m.expect.names)
    return Executed(body, found.lines, findings=log.list_findings())


def rename(body: Iterable[Instruction], names: Mapping[str, str]) -> tuple[Instruction, ...]:
    """``body`` with the names of signals for the outputs that have one."""
    return tuple(
        Output(names[item.signal], item.value)
        if isinstance(item, Output) and item.signal in names
        else item
        for item in body
    )


def lines_of(files: Mapping[str, str]) -> Lines:
    """The lines of all files in order, without their ends."""
    return Lines(list(files.values()))


def number(options: Mapping[str, object], key: str, default: float) -> float:
    """The option ``key`` as a number; JobError for anything else."""
    value = options.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise JobError(f"[post] {key}", f"{value!r} is not a number")
    return value


def spiral(options: Mapping[str, object]) -> float:
    """By how much the two radii of an arc differ at most in coordinates of so many digits, mm: half a digit in X and Y
    of both its ends, and what more its centre loses.
    """
    return 3 * 10 ** -number(options, "decimals", 3)


def signals(options: Mapping[str, object], default: dict[str, str]) -> dict[str, str]:
    """The option ``signals``: signal by output, as the interpreter names those; JobError for anything else."""
    table = options.get("signals", default)
    if not isinstance(table, Mapping) or not all(isinstance(word, str) for word in table.values()):
        raise JobError(
            "[post] signals", "is not a table of output words", remedy='e.g. { process = "P0" }'
        )
    return {
        _COOLANTS.get(word, word.replace("P", "dout")): str(name) for name, word in table.items()
    }
