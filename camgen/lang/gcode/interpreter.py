"""Runs the lines of a G-code program in the order of its flow."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import lru_cache, partial

from camgen.lang.gcode.arcs import LINUXCNC
from camgen.lang.gcode.machine import HANDLERS, Machine, speed_and_tool
from camgen.lang.gcode.motion import move, read_plain
from camgen.lang.gcode.o_words import NO_FILES, Blocks, Flow, list_blocks
from camgen.lang.gcode.words import COMMENT, Line, LineError, Parameters, UnknownWord
from camgen.lang.recorded import ProgramRun
from camgen.lang.run import Budget, Stopped
from camgen.model.limits import Limits as Bounds

_BOUNDS = Bounds()
#: Number of different lines whose words are kept.
_KEPT_LINES = 200
#: Number of lines in loops of a profile of a lathe.
_PROFILE = 10_000
_SPEED = re.compile(r"[sS][ \t]*[-+.0-9\[#]")


def interpret_plain(lines: Sequence[str]) -> ProgramRun:
    """The effect of a program without the codes that only `Foreign` runs. Never raises."""
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
    """Runs a program to its end.

    Returns None, or the line and the reason of a stop, and whether the reason is an unknown code.

    flow: whether O-words change the flow.
    files: first line of each file, from 0, by name.
    """
    try:
        blocks = list_blocks(lines, flow, files, m.numbers_programs())
    except LineError as error:
        what, line = error.args
        return line, what, False
    try:
        play(m, lines, blocks)
        m.finish()
    except LineError as error:
        return m.line, str(error), isinstance(error, UnknownWord)
    except Stopped as stopped:
        return m.line, str(stopped), False
    return None


def has_speed(lines: Sequence[str]) -> bool:
    """Return whether a line has an S word. Without one the spindle is only switched."""
    return any(("S" in raw or "s" in raw) and _SPEED.search(COMMENT.sub("", raw)) for raw in lines)


def play(m: Machine, lines: Sequence[str], blocks: Blocks) -> None:
    """Runs the lines up to the end of the program.

    Raises LineError for a wrong line, unless the machine goes on after it (`Machine.refuse`).
    """
    flow = Flow(blocks, Parameters(m.value, m.takes), absent=m.miss)
    remembered: dict[str, Line] = {}
    m.inside, m.find_lines = flow.depth, flow.find_profile
    m.run_lines = partial(_run_lines, m, lines, flow, remembered)
    at, budget = 0, Budget(len(lines), m.bounds.gcode_steps, "gcode_steps")
    m.most = len(lines) + m.bounds.gcode_motions
    end = blocks.main or len(lines)
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
    """Runs the lines from `first` to `last`, from 0. Raises LineError."""
    at, left = first, last - first + 1 + _PROFILE
    while first <= at <= last and not m.ended:
        m.line, left = at + 1, left - 1
        if left < 0:
            raise LineError(f"a profile of more than {_PROFILE} lines in loops")
        at = _step(m, lines, at, flow, remembered)


def _step(
    m: Machine, lines: Sequence[str], at: int, flow: Flow, remembered: dict[str, Line]
) -> int:
    """Runs line `at`, from 0. Returns the next line. Raises LineError."""
    raw = lines[at]
    block = flow.blocks.at.get(at)
    if block is not None:
        if not block.word and block.rest:
            raise LineError(f"cannot read {block.rest[:12]!r} after o{block.label}")
        return flow.after(at, block)
    target = m.branch(raw, at, lines, flow.known)
    if target is not None:
        return target if isinstance(target, int) else flow.find_number(target)
    line = remembered.get(raw)
    if line is None:
        text = m.bare(raw)
        if "%" in raw and raw.strip() == "%":
            m.ended, m.opened = m.opened, True
            return at + 1
        line = m.words(text, flow.known)
        m.take(*line)
        # Many lines repeat. A line with parameters has other values each time.
        if "#" not in text and len(remembered) < _KEPT_LINES:
            remembered[raw] = line
    m.leap = None
    _execute(m, line[0].copy(), line[1].copy())
    return flow.leap(at, *m.leap) if m.leap else at + 1


@lru_cache(maxsize=1000)
def _in_order(*groups: str) -> tuple[str, ...]:
    """The groups of a line in the order in which their codes act, without motions."""
    return tuple(group for group in HANDLERS if group in groups)


def _execute(m: Machine, codes: dict[str, str], words: dict[str, float]) -> None:
    """Runs codes and words of one line, in the order of the manual. Raises LineError."""
    m.begin(codes, words)
    if "F" in words or "feed mode" in codes:
        m.set_feed(words, codes)
    if "S" in words or "T" in words:
        speed_and_tool(m, words, codes)
    motion = codes.pop("motion", "")
    if motion:
        # The motion counts, and a cycle goes on.
        codes.pop("cycle off", None)
    for group in _in_order(*codes):
        if group in codes:
            m.obey(group, codes[group], words)
    if "machine coordinates" in codes:
        m.lift(motion, words)
    if words or motion:
        move(m, motion, words)
    if "stop" in codes:
        m.stop(codes["stop"])
    m.end(codes, words)
    words.pop("F", None)
    if words:
        letter, value = next(iter(words.items()))
        raise LineError(f"word {letter}{value:g}: nothing in the line uses it")
