"""Runs the lines of a G-code program and writes down what a three-axis machine does as instructions.

The order within a line is that of the LinuxCNC manual: feed, speed, tool, outputs, spindle, coolant, dwell, modes,
motion, end. Nothing is guessed: what a program leaves open is a fault, which also says what is assumed from there on.
"""

from __future__ import annotations

from collections.abc import Iterable

from camgen.post import Fault, Reading
from camgen.read.gcode.words import Unread, Wrong

from .lexis import Line, Rules, is_percent, lex
from .motion import move
from .plain import is_settled, read_plain
from .state import HANDLERS, Expect, Machine, feed, speed_and_tool

#: So many lines are remembered.
_KNOWN = 200


def run(text: Iterable[str], rules: Rules, expect: Expect) -> Reading:
    """What the lines say. Never raises for anything that they hold."""
    return written(played(text, rules, expect))


def written(m: Machine) -> Reading:
    """What a machine has written down."""
    return Reading(tuple(m.body), tuple(m.lines), tuple(m.faults))


def played(text: Iterable[str], rules: Rules, expect: Expect) -> Machine:
    """The machine after the lines."""
    m = Machine(rules, expect)
    opened = begun = settled = False
    known: dict[str, Line | None] = {}
    for m.line, raw in enumerate(text, start=1):
        if settled and read_plain(m, raw):
            continue
        try:
            if "%" in raw and is_percent(raw) and rules.linuxcnc:
                opened = _percent(m, opened, begun)
                continue
            begun = begun or not raw.isspace()
            line = known[raw] if raw in known else _remembered(known, raw, lex(raw, rules))
            if line is not None:
                _execute(m, line[0].copy(), line[1].copy())
        except Wrong as wrong:
            m.fault(str(wrong))
            m.unread = m.unread or (m.line if isinstance(wrong, Unread) else 0)
        settled = is_settled(m)
    _finish(m)
    return m


def _remembered(known: dict[str, Line | None], raw: str, line: Line | None) -> Line | None:
    """``line``, kept for when the same words come again: outputs do, for every path."""
    if len(known) < _KNOWN:
        known[raw] = line
    return line


def _percent(m: Machine, opened: bool, begun: bool) -> bool:
    """A per cent sign opens a LinuxCNC program before anything else, and then ends it."""
    if opened:
        m.ended = True
    elif begun and not m.ended:
        raise Wrong("a per cent sign that does not belong to one on the first line")
    return True


def _finish(m: Machine) -> None:
    m.line = max(m.line, 1)
    if not m.ended:
        m.fault("the program has no end (M2 or M30)")
    if not m.placed and any(v is not None for v in m.at):
        m.fault("the program ends before the position is known in all axes")
    if m.waiting:
        m.faults.append(Fault(m.waiting, "an output that waits for the next motion (M62, M63, M67), and none follows"))
        m.faults.sort(key=lambda fault: fault.line)
    if m.expect.tool and not m.changed:
        m.fault(f"the tool change T{m.expect.tool} M6 of post.tool is missing")


def _execute(m: Machine, codes: dict[str, str], words: dict[str, float]) -> None:
    if m.ended:
        m.remark("a line after the end of the program")
        return
    if "F" in words:
        feed(m, words.pop("F"), codes)
    if "S" in words or "T" in words:
        speed_and_tool(m, words, codes)
    motion = codes.pop("motion", "")
    stop = codes.pop("stop", "")
    for group, handler in HANDLERS if codes else ():
        if group in codes:
            handler(m, codes[group], words)
    if words or motion:
        move(m, motion, words)
    if stop:
        m.ended = True
    if words:
        letter, value = next(iter(words.items()))
        raise Wrong(f"word {letter}{value:g}: nothing in the line uses it")
