"""Runs a G-code program: its text to instructions, each with its line, and notes on what was assumed."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

from msgspec import Struct

from camgen.model.part import Note, Part
from camgen.model.program import Instruction
from camgen.read.gcode import codes
from camgen.read.gcode.arcs import LINUXCNC, Limits
from camgen.read.gcode.flow import Block, Blocks, Flow, blocks
from camgen.read.gcode.motion import is_settled, move, read_plain
from camgen.read.gcode.state import Machine
from camgen.read.gcode.words import Line, Parameters, Unread, Wrong, bare, words_of

#: So many lines beyond those of the text may run, in loops and subroutines.
_STEPS = 500_000
_KNOWN = 200
_COMMENT = re.compile(r"\([^()]*\)|;.*")
_SPEED = re.compile(r"[sS][ \t]*[-+.0-9\[#]")


class Run(Struct, frozen=True, eq=False):
    """What a program does.

    body: motions with the tool straight down, rapid ones as MoveJ, those that may round their corner with a blend of 1;
    outputs and waits. lines: of each, 1-based. remarks: what was assumed or left out, with its first line. held: rapid
    motions at the start whose position is not known in all axes, not in the body. entry: mm/s at which an assumed start
    is reached, 0 where the text says it. stopped: the line and the reason where it cannot be read on. unread: whether
    that is a code which is not known. ended: whether the text says so (M2, M30, a second per cent sign). units: "mm" or
    "inch".
    """

    body: tuple[Instruction, ...]
    lines: tuple[int, ...]
    remarks: tuple[tuple[int, Note], ...]
    held: int
    entry: float
    stopped: tuple[int, str] | None
    unread: bool
    ended: bool
    units: str


def interpret(lines: Sequence[str], limits: Limits = LINUXCNC) -> Run:
    """What the lines of a program do. limits: of its arcs. Never raises for a text."""
    m = Machine(limits, on_off=not _has_speed(lines))
    stopped, unread = None, False
    try:
        found = blocks(lines)
    except Wrong as wrong:
        what, line = wrong.args
        found, stopped = Blocks({}, {}), (line, what)
    if stopped is None:
        try:
            _run(m, lines, found)
            codes.switch_off(m)
        except Wrong as wrong:
            stopped, unread = (m.line, str(wrong)), isinstance(wrong, Unread)
    return Run(
        tuple(m.body),
        tuple(m.lines),
        m.notes(),
        m.held,
        m.entry,
        stopped,
        unread,
        m.ended,
        "mm" if m.scale == 1.0 else "inch",
    )


def _has_speed(lines: Sequence[str]) -> bool:
    """Whether any line has an S word: without one the spindle is a switch. The O-words sub and sin are none."""
    return any(("S" in raw or "s" in raw) and _SPEED.search(_COMMENT.sub("", raw)) for raw in lines)


def _run(m: Machine, lines: Sequence[str], found: Blocks) -> None:
    known = Parameters(m.value)
    flow = Flow(found, known)
    remembered: dict[str, Line] = {}
    at, steps, settled, opened = 0, len(lines) + _STEPS, False, False
    while at < len(lines) and not m.ended:
        raw = lines[at]
        at += 1
        m.line = at
        steps -= 1
        if settled and read_plain(m, raw):
            continue
        if steps < 0:
            raise Wrong(f"the program has not ended after {_STEPS} lines in loops")
        if at - 1 in found.at:
            at = _jump(flow, at - 1, found.at[at - 1])
        elif "%" in raw and raw.strip() == "%":
            m.ended, opened = opened, True
        else:
            line = remembered.get(raw)
            if line is None:
                line = _read(m, raw, known, remembered)
            _execute(m, line[0].copy(), line[1].copy())
        settled = is_settled(m)


def _jump(flow: Flow, at: int, block: Block) -> int:
    if not block.word and block.rest:
        raise Wrong(f"cannot read {block.rest[:12]!r} after o{block.label}")
    return flow.after(at, block)


def _read(m: Machine, raw: str, known: Parameters, remembered: dict[str, Line]) -> Line:
    """The words of a line, kept where they do not depend on parameters: outputs and cycles come again and again."""
    text = bare(raw)
    if raw.lstrip().startswith("/"):
        m.remark("assumed", "lines with / are run", "whether they are depends on a switch of the operator")
    line = words_of(text, known)
    if "#" not in text and len(remembered) < _KNOWN:
        remembered[raw] = line
    return line


def _execute(m: Machine, found: dict[str, str], words: dict[str, float]) -> None:
    """The codes and words of one line, in the order of the manual."""
    if "feed mode" in found:
        codes.feed_mode(m, found["feed mode"], words)
    if "F" in words:
        codes.feed(m, words["F"], found)
        if m.feed_mode != "G93":
            del words["F"]
    if "S" in words or "T" in words:
        codes.speed_and_tool(m, words, found)
    motion = found.pop("motion", "")
    if motion:
        found.pop("cycle off", None)  # the other code holds, and a cycle goes on
    for group, handler in codes.HANDLERS if found else ():
        if group in found:
            handler(m, found[group], words)
    if words or motion:
        move(m, motion, words)
    _nothing_left(words)
    if "stop" in found:
        codes.stop(m, found["stop"])


def _nothing_left(words: dict[str, float]) -> None:
    words.pop("F", None)
    if words:
        letter, value = next(iter(words.items()))
        raise Wrong(f"word {letter}{value:g}: nothing in the line uses it")


# A program as the part that a reader returns: it has no contours, but motions of its own.

if TYPE_CHECKING:
    pass


class Recorded(Part, frozen=True, eq=False, kw_only=True):
    """A part whose motions were written down before: what ``operation.kind = "replay"`` runs again."""

    run: Run
