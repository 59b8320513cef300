"""Runs a G-code program: its lines in the order in which its O-words lead, each to what it makes the machine do."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache, partial

from msgspec import Struct, field

from camgen.lang.gcode.arcs import LINUXCNC
from camgen.lang.gcode.machine import (
    HANDLERS,
    Machine,
    speed_and_tool,
)
from camgen.lang.gcode.motion import move, read_plain
from camgen.lang.gcode.words import (
    COMMENT,
    Line,
    LineError,
    Parameters,
    UnknownWord,
    bare,
    value_at,
)
from camgen.lang.recorded import ProgramRun
from camgen.lang.run import Budget, Stopped
from camgen.model.limits import Limits as Bounds

_BOUNDS = Bounds()
NO_FILES: dict[str, int] = {}
_KNOWN = 200
#: So many lines in loops a profile of a lathe may have.
_PROFILE = 10_000
_SPEED = re.compile(r"[sS][ \t]*[-+.0-9\[#]")


def interpret_plain(lines: Sequence[str]) -> ProgramRun:
    """What the lines of a program do, without what only programs of others use. Never raises for a text."""
    m = Machine(LINUXCNC, _BOUNDS, not has_speed(lines))
    stopped = perform(m, lines)
    return ProgramRun(
        tuple(m.body),
        tuple(m.lines),
        m.notes(),
        m.held,
        m.entry,
        stopped[:2] if stopped else None,
        bool(stopped and stopped[2]),
        m.ended,
        "mm" if m.scale == 1.0 else "inch",
    )


def perform(
    m: Machine, lines: Sequence[str], flow: bool = True, files: Mapping[str, int] = NO_FILES
) -> tuple[int, str, bool] | None:
    """Lets the machine do what the lines say: where it stopped, why, and whether for a code that is not known.

    flow: whether O-words lead anywhere. files: by name, the line from 0 on which each begins.
    """
    try:
        found = blocks(lines, flow, files, m.numbers_programs())
    except LineError as error:
        what, line = error.args
        return line, what, False
    try:
        play(m, lines, found)
        m.finish()
    except LineError as error:
        return m.line, str(error), isinstance(error, UnknownWord)
    except Stopped as stopped:
        return m.line, str(stopped), False
    return None


def has_speed(lines: Sequence[str]) -> bool:
    """Whether any line has an S word: without one the spindle is a switch. The O-words sub and sin are none."""
    return any(("S" in raw or "s" in raw) and _SPEED.search(COMMENT.sub("", raw)) for raw in lines)


def play(m: Machine, lines: Sequence[str], found: Blocks) -> None:
    """Lets the machine do what the lines say, to the end of the program. found: their O-words.

    Raises LineError unless the machine takes that in (``Machine.refuse``).
    """
    flow = Flow(found, Parameters(m.value, m.takes), absent=m.miss)
    remembered: dict[str, Line] = {}
    m.inside, m.find_lines = flow.depth, flow.find_profile
    m.run_lines = partial(_run_lines, m, lines, flow, remembered)
    at, budget = 0, Budget(len(lines), m.bounds.gcode_steps, "gcode_steps")
    m.most = len(lines) + m.bounds.gcode_motions
    end = found.main or len(lines)
    while at < len(lines) and not m.ended:
        if at >= end and not flow.calls:
            return
        if m.is_settled():
            after = m.read_plain(lines, at, end if at < end else len(lines), read_plain)
            budget.left -= after - at
            at = m.line = after
            if at == len(lines) or (at == end and not flow.calls):
                return
        m.line = at + 1
        try:
            budget.spend()
            m.insist_on_size()
            at = _step(m, lines, at, flow, remembered)
        except LineError as error:
            m.refuse(error)
            at += 1


def _run_lines(
    m: Machine, lines: Sequence[str], flow: Flow, remembered: dict[str, Line], first: int, last: int
) -> None:
    """Does what the lines from ``first`` to ``last`` (from 0) say, wherever they lead in between."""
    at, left = first, last - first + 1 + _PROFILE
    while first <= at <= last and not m.ended:
        m.line, left = at + 1, left - 1
        if left < 0:
            raise LineError(f"a profile of more than {_PROFILE} lines in loops")
        at = _step(m, lines, at, flow, remembered)


def _step(
    m: Machine, lines: Sequence[str], at: int, flow: Flow, remembered: dict[str, Line]
) -> int:
    """Does what line ``at`` (from 0) says; the line that is next."""
    raw = lines[at]
    block = flow.blocks.at.get(at)
    if block is not None:
        if not block.word and block.rest:
            raise LineError(f"cannot read {block.rest[:12]!r} after o{block.label}")
        return flow.after(at, block)
    went = m.branch(raw, at, lines, flow.known)
    if went is not None:
        return went if isinstance(went, int) else flow.find_number(went)
    line = remembered.get(raw)
    if line is None:
        text = m.bare(raw)
        if "%" in raw and raw.strip() == "%":
            m.ended, m.opened = m.opened, True
            return at + 1
        line = m.words(text, flow.known)
        m.take(*line)
        # Outputs and cycles come again and again; what depends on parameters is read anew.
        if "#" not in text and len(remembered) < _KNOWN:
            remembered[raw] = line
    m.leap = None
    _execute(m, line[0].copy(), line[1].copy())
    return flow.leap(at, *m.leap) if m.leap else at + 1


@lru_cache(maxsize=1000)
def _in_order(*groups: str) -> tuple[str, ...]:
    """The groups of a line that are no motion in the order in which their codes act."""
    return tuple(group for group in HANDLERS if group in groups)


def _execute(m: Machine, found: dict[str, str], words: dict[str, float]) -> None:
    """The codes and words of one line, in the order of the manual."""
    m.begin(found, words)
    if "F" in words or "feed mode" in found:
        m.set_feed(words, found)
    if "S" in words or "T" in words:
        speed_and_tool(m, words, found)
    motion = found.pop("motion", "")
    if motion:
        found.pop("cycle off", None)  # the other code holds, and a cycle goes on
    for group in _in_order(*found):
        if group in found:
            m.obey(group, found[group], words)
    if "machine coordinates" in found:
        m.lift(motion, words)
    if words or motion:
        move(m, motion, words)
    if "stop" in found:
        m.stop(found["stop"])
    m.end(found, words)
    words.pop("F", None)
    if words:
        letter, value = next(iter(words.items()))
        raise LineError(f"word {letter}{value:g}: nothing in the line uses it")


# O-words: which line opens what, and where it ends. Found once, before anything runs.

_START = re.compile(r"[ \t]*/?[ \t]*(?:[nN][ \t]*[0-9.]+)?[ \t]*[oO]")
_PROGRAM = re.compile(
    r"[ \t%]*(?:[nN][ \t]*[0-9.]+)?[ \t]*[oO][ \t]*([0-9]{1,9})(?![0-9])(?![ \t]*[a-zA-Z])"
)
_NUMBERED = re.compile(r"[ \t]*/?[ \t]*[nN][ \t]*([0-9]{1,9})(?![0-9.])")
_FILE = re.compile(r"[oO]?([0-9]{1,9})(?:\.[A-Za-z]+)?")
_OWORD = re.compile(
    r"o(?:<([^<>]*)>|([0-9]+)|(\[.*\])(?=call))"
    r"(sub|endsub|call|return|if|elseif|else|endif|while|endwhile|do|repeat|endrepeat|break|continue)?(.*)"
)
#: What closes, or goes on with, what.
_CLOSES = {"endsub": "sub", "endif": "if", "endwhile": "while", "endrepeat": "repeat"}


class Block(Struct):
    """One O-word. label: its number, its name in < >, or in [ ] what its number is worked out from. word: what it does.
    rest: the text after it. places: lines (from 0) of the parts of its structure, first to last: sub and endsub; if,
    elseif, else, endif; while and endwhile; do and while; repeat and endrepeat.
    """

    label: str
    word: str
    rest: str
    places: list[int] = field(default_factory=list)


class Blocks(Struct):
    """at: the O-words by line, from 0. subs: the line of each sub by its label. numbers: of each program by its O, as
    of each line by its N. main: where the first of several files ends, 0: there is one.
    """

    at: dict[int, Block]
    subs: dict[str, int]
    numbers: dict[str, int] = field(default_factory=dict)
    main: int = 0


def blocks(
    lines: Sequence[str],
    flow: bool = True,
    files: Mapping[str, int] = NO_FILES,
    numbers: bool = True,
) -> Blocks:
    """The O-words of a program. Raises LineError with ``line`` (1-based) in its arguments.

    flow: whether they lead anywhere, as LinuxCNC's do; else they are numbers of programs where there are ``numbers``.
    files: by name, the line from
    0 on which each begins.
    """
    found = Blocks({}, {})
    opened: list[Block] = []
    starts = sorted(files.values())
    found.main = starts[1] if len(starts) > 1 else 0
    for number, raw in enumerate(lines):
        if ("o" in raw or "O" in raw) and _START.match(raw):
            if flow:
                try:
                    _enter(found, opened, number, raw)
                except LineError as wrong:
                    raise LineError(str(wrong), number + 1) from wrong
            _number(found, number, raw, flow, numbers)
        elif line := _NUMBERED.match(raw):
            found.numbers.setdefault(f"n{int(line[1])}", number)
    for name, start in files.items():
        if digits := _FILE.fullmatch(name):
            found.numbers.setdefault(
                f"o{int(digits[1])}", start - 1
            )  # a program begins behind its number
    if opened:
        block = opened[-1]
        raise LineError(f"o{block.label} {block.word} has no end", block.places[0] + 1)
    return found


def _number(found: Blocks, number: int, raw: str, flow: bool, numbers: bool) -> None:
    """Keeps the number of a program: O1234 alone, or what follows it."""
    program = _PROGRAM.match(raw)
    if program:
        found.numbers.setdefault(f"o{int(program[1])}", number)
    if not flow and numbers:
        found.at[number] = Block(program[1] if program else "", "", "")


def _enter(found: Blocks, opened: list[Block], number: int, raw: str) -> None:
    text = bare(raw)
    match = _OWORD.fullmatch(text)
    if not match:
        raise LineError(f"cannot read the O-word {text[:16]!r}")
    name, digits, worked_out, word, rest = match.groups()
    block = Block(
        worked_out or (f"<{name}>" if name is not None else str(int(digits))), word or "", rest
    )
    found.at[number] = block
    top = opened[-1] if opened else None
    if word == "while" and top and top.word == "do" and top.label == block.label:
        block.places = top.places
        block.word = "until"
        block.places.append(number)
        opened.pop()
    elif word in ("sub", "if", "while", "do", "repeat"):
        block.places = [number]
        opened.append(block)
        if word == "sub":
            if block.label in found.subs:
                raise LineError(f"o{block.label} sub is there twice")
            found.subs[block.label] = number
    elif word in ("elseif", "else") or word in _CLOSES:
        _go_on(opened, block, number, _CLOSES.get(word, "if"))
    elif word in ("break", "continue"):
        loop = [b for b in opened if b.label == block.label and b.word in ("while", "do", "repeat")]
        if not loop:
            raise LineError(f"o{block.label} {word} stands in no such loop")
        block.places = loop[-1].places


def _go_on(opened: list[Block], block: Block, number: int, opener: str) -> None:
    top = opened[-1] if opened else None
    if top is None or top.word != opener or top.label not in (block.label, ""):
        inside = f"; o{top.label} {top.word} is open" if top else ""
        raise LineError(f"o{block.label} {block.word} has no {opener} before it{inside}")
    block.places = top.places
    block.places.append(number)
    if block.word in _CLOSES:
        opened.pop()


# Where a program goes next: subroutines, branches and loops. Bounded, so that no program keeps it for ever.

#: Subroutines in subroutines, as LinuxCNC allows.
_LEVELS = 10
_MOST_ARGUMENTS = 30


class _Call(Struct):
    """A subroutine that runs: where it was called from, and what belonged to the caller. start, again: of a subprogram
    (M98), where it begins and how often it runs once more. last: the line behind which it ends, -1: where it says so.
    """

    back: int
    own: dict[int, float]
    named: dict[str, float]
    counts: dict[int, int]
    start: int = 0
    again: int = 0


class Flow(Struct):
    """calls: the subroutines that run. counts: rounds left of the repeats that run, by their line. absent: is told of
    what is called and is in no file.
    """

    blocks: Blocks
    known: Parameters
    absent: Callable[[str], None]
    calls: list[_Call] = field(default_factory=list)
    counts: dict[int, int] = field(default_factory=dict)

    def depth(self) -> int:
        """How many subroutines run."""
        return len(self.calls)

    def after(self, at: int, block: Block) -> int:
        """The line (from 0) that runs after the O-word of line ``at``."""
        match block.word:
            case "call":
                return self._call(at, block)
            case "endsub" | "return":
                return self._return(block)
            case "if":
                return self._branch(block)
            case "sub" | "elseif" | "else":
                return block.places[-1] + 1  # a definition, or a branch after one that has run
            case "repeat" | "endrepeat":
                return self._repeat(at, block)
            case "while" | "endwhile" | "until" | "break" | "continue":
                return self._loop(at, block)
        return at + 1  # do, endif, or a program number

    def _loop(self, at: int, block: Block) -> int:
        first, last = block.places[0], block.places[-1]
        match block.word:
            case "while":
                return at + 1 if self._holds(block) else last + 1
            case "until":
                return first + 1 if self._holds(block) else last + 1
            case "break":
                self.counts.pop(first, None)
                return last + 1
            case "continue":
                return first if self.blocks.at[first].word == "while" else last
        return first  # endwhile

    def _holds(self, block: Block) -> bool:
        return bool(self._values(block, 1)[0])

    def _values(self, block: Block, count: int) -> list[float]:
        """The bracketed expressions after the word."""
        at, text = 0, block.rest
        values: list[float] = []
        while text[at : at + 1] == "[" and len(values) < count:
            value, at = value_at(text, at, self.known)
            values.append(value)
        if at < len(text):
            raise LineError(f"cannot read {text[at : at + 12]!r} after o{block.label} {block.word}")
        if count == 1 and not values:
            raise LineError(f"o{block.label} {block.word} without its condition or number")
        return values

    def _branch(self, block: Block) -> int:
        """After the first branch of an if whose condition holds."""
        for place in block.places:
            one = self.blocks.at[place]
            if one.word in ("else", "endif") or self._holds(one):
                return place + 1
        return block.places[-1] + 1

    def _repeat(self, at: int, block: Block) -> int:
        first = block.places[0]
        left = (
            int(self._values(block, 1)[0])
            if block.word == "repeat"
            else self.counts.get(first, 1) - 1
        )
        if left > 0:
            self.counts[first] = left
            return first + 1
        self.counts.pop(first, None)
        return block.places[-1] + 1 if block.word == "repeat" else at + 1

    def _call(self, at: int, block: Block) -> int:
        values, label = self._values(block, _MOST_ARGUMENTS), block.label
        if label.startswith("["):  # o[#1+100] call
            label = f"{value_at(label, 0, self.known)[0]:.0f}"
        if label not in self.blocks.subs:
            self.absent(f"o{label} call: the subroutine is not in this file")
            return at + 1
        if len(self.calls) >= _LEVELS:
            raise LineError(f"o{label} call: more than {_LEVELS} subroutines in each other")
        self.calls.append(_Call(at + 1, self.known.own, self.known.named, self.counts))
        self.known.own = dict(enumerate(values, 1))
        self.known.named, self.counts = {}, {}
        return self.blocks.subs[label] + 1

    def leap(
        self,
        at: int,
        code: str,
        number: float,
        times: int,
        given: Mapping[int, float] | None = None,
    ) -> int:
        """The line that runs after M97, M98, M99 or G65 in line ``at``. number: of the program or line. times: how
        often. given: parameters of its own.
        """
        if code == "M99":
            return self._come_back(number)
        if code == "GOTO":
            return self.find_number(f"n{number:.0f}") + 1
        start = self.blocks.numbers.get(f"{'n' if code == 'M97' else 'o'}{number:.0f}")
        if start is None:
            self.absent(f"{code} P{number:g}: the subprogram is not in this file")
            return at + 1
        if len(self.calls) >= _LEVELS:
            raise LineError(f"{code} P{number:g}: more than {_LEVELS} subroutines in each other")
        if times < 1:
            return at + 1
        known = self.known
        first = start + (code != "M97")
        self.calls.append(_Call(at + 1, known.own, known.named, self.counts, first, times - 1))
        if given is not None:
            known.own, known.named = dict(given), {}
        return self.calls[-1].start

    def _come_back(self, number: float) -> int:
        if not self.calls:
            raise LineError("M99 outside a subprogram that was called")
        call = self.calls[-1]
        if call.again > 0:
            call.again -= 1
            return call.start
        self.calls.pop()
        self.known.own, self.known.named = call.own, call.named
        return self.find_number(f"n{number:.0f}") if number else call.back

    def find_profile(self, first: float | None, last: float) -> tuple[int, int]:
        """The first and the last line (from 0) of a profile: between two numbers of lines, or those of a subroutine."""
        if first is not None:
            return self.find_number(f"n{first:.0f}"), self.find_number(f"n{last:.0f}")
        if f"{last:.0f}" not in self.blocks.subs:
            raise LineError(f"O{last:.0f} is not in this file: the profile of the cycle")
        start = self.blocks.subs[f"{last:.0f}"]
        return start + 1, self.blocks.at[start].places[-1] - 1

    def find_number(self, name: str) -> int:
        """The line (from 0) of a number of a line. LineError if there is none."""
        if name not in self.blocks.numbers:
            raise LineError(f"a jump to {name.upper()}, which no line has")
        return self.blocks.numbers[name]

    def _return(self, block: Block) -> int:
        values = self._values(block, 2)
        if not self.calls:
            raise LineError(f"o{block.label} {block.word} outside a subroutine that was called")
        call = self.calls.pop()
        self.known.own, self.known.named, self.counts = call.own, call.named, call.counts
        self.known.shared["_value"] = values[0] if values else 0.0
        self.known.shared["_value_returned"] = float(bool(values))
        return call.back
