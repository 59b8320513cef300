"""One run of a G-code program of any author."""

from __future__ import annotations

import re
from collections.abc import Mapping
from itertools import accumulate, repeat
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from camgen.lang.code import Code
from camgen.lang.coverage import Coverage, measure_coverage
from camgen.lang.gcode import third_party
from camgen.lang.gcode.beam import Beam, sets_laser_mode
from camgen.lang.gcode.code import compile_program
from camgen.lang.gcode.codes import HANDLERS
from camgen.lang.gcode.dialects import DIALECTS, Dialect, find_other, recognise
from camgen.lang.gcode.interpreter import Interpreter, has_speed
from camgen.lang.gcode.machine import Machine, Profile
from camgen.lang.gcode.words import COMMENT, LineError
from camgen.lang.programs import Ask, Executed, Frames
from camgen.lang.run import Stopped
from camgen.model.program import Output

#: Words that lead to a place of X, Y and Z: the axis, its increment, polar words, and places that
#: the machine stores.
_LEADS = tuple(
    re.compile(rf"[{letters}]|\bG[ \t]*0*(?:28|30|53)\b", re.IGNORECASE)
    for letters in (r"xu@\^", r"yv@\^", "zw")
)


#: The profile of third-party programs.
PROFILE = Profile(
    handlers=HANDLERS,
    clean=third_party.clean,
    parse=third_party.parse,
    settle=third_party.settle,
    stand=third_party.stand,
    switch=third_party.switch,
)


class Played(NamedTuple):
    """A program that was run.

    machine: the machine after the run.
    stopped: line and reason of a stop before the end, None without one.
    code: steps of the program, None if it could not be compiled.
    """

    machine: Machine
    stopped: tuple[int, str] | None = None
    code: Code | None = None


def play(
    files: Mapping[str, str], ask: Ask, usual: Dialect | None = None, chord: float | None = None
) -> Played:
    """Runs the first of ``files``.

    files: the program, and then files with its subprograms.
    usual: dialect without one in ``ask``, None for that which the text shows.
    chord: deviation of the lines of helices and splines, mm.
    """
    texts = {name: _lines_of(text) for name, text in files.items()}
    lines = [line for text in texts.values() for line in text]
    starts = dict(
        zip(texts, accumulate((len(text) for text in texts.values()), initial=0), strict=False)
    )
    name, text = next(iter(files.items()), ("", ""))
    dialect, sign = (usual, "") if usual else recognise(text, name)
    if ask.dialect:
        dialect, sign = DIALECTS.get(ask.dialect, dialect), ""
    helix = dialect.arcs.helix if chord is None else chord
    m = Machine(
        profile=PROFILE,
        dialect=dialect,
        given=ask.assume,
        limits=replace(dialect.arcs, pieces=ask.limits.gcode_pieces, helix=helix),
        bounds=ask.limits,
        on_off=not has_speed(lines),
        pause=dialect.dwell,
        to_start=dialect.to_start or None,
        fewest_holes=0 if dialect.increments else 1,
    )
    _set_beam(m, text)
    words = COMMENT.sub("", "\n".join(files.values()))
    m.unnamed = [axis for axis, leads in enumerate(_LEADS) if not leads.search(words)]
    m.log.fact("dialect", f"{dialect.name} ({sign[:30]})" if sign else dialect.name)
    other = find_other(text)
    if other is not None and not ask.dialect:
        return Played(m, (other[0], f"a program of {other[1]}: its language is not read"))
    try:
        code = compile_program(lines, third_party.read_grammar(m), starts)
    except LineError as error:
        what, line = error.args
        return Played(m, (line, what))
    third_party.judge_blanks(m, lines)
    try:
        Interpreter(m, lines, code).run(ask.entry)
        m.finish()
    except (LineError, Stopped) as error:
        return Played(m, (m.line, str(error)), code)
    return Played(m, None, code)


def _set_beam(m: Machine, text: str) -> None:
    """Gives the machine of GRBL the beam of a laser where its laser mode is on."""
    is_on = m.given.get("laser", float(sets_laser_mode(text)))
    if m.dialect.name == "grbl" and is_on:
        m.beam = Beam("process" if m.on_off else "spindle")


def run(files: Mapping[str, str], ask: Ask, usual: Dialect | None = None) -> Executed:
    """Runs the first of ``files``.

    usual: dialect without one in ``ask``, None for that which the text shows.
    """
    m, stopped, code = play(files, ask, usual)
    coverage = None if code is None else _measure_coverage(files, code, m)
    if stopped is None:
        _judge_end(m, [_lines_of(text) for text in files.values()])
    frames, frame = _frames(m)
    return Executed(
        body=m.body.body(),
        lines=tuple(m.lines),
        frames=frames,
        frame=frame,
        findings=m.log.list_findings(),
        assumed=m.log.list_assumed(),
        facts=_facts(m),
        lost=m.log.list_lost(),
        stopped=stopped,
        is_limited=m.log.is_limited,
        coverage=coverage,
    )


def _measure_coverage(files: Mapping[str, str], code: Code, m: Machine) -> Coverage:
    """The coverage of the lines that have more than a comment, a block skip or a per cent sign."""
    has_statement: list[bool] = []
    for text in files.values():
        lines = map(COMMENT.sub, repeat(""), _lines_of(text))
        has_statement += [bool(line.strip(" \t\r%/")) for line in lines]
    coverage = measure_coverage([code], m.log.ran, m.line)
    chosen = np.array(has_statement)[coverage.lines - 1]
    return Coverage(coverage.lines[chosen], coverage.ran[chosen])


def _lines_of(text: str) -> list[str]:
    return text.removeprefix("\ufeff").removesuffix("\n").split("\n")


def _judge_end(m: Machine, texts: list[list[str]]) -> None:
    """What is left on, what follows the end, and whether the text says that it ends. texts: the lines of the files."""
    m.line = min(m.line, sum(map(len, texts))) or 1
    if not m.ended and texts:
        m.line = len(texts[0])
        if m.dialect.needs_end:
            m.log.find(
                "unusual",
                "the program has no end (M2, M30 or per cent signs): LinuxCNC stops here with an error",
            )
        left = {item.signal: item.value for item in m.body if isinstance(item, Output)}
        # What the end of the run switched off, the text does not.
        on = [name for name, value in left.items() if value and name.startswith(("dout", "aout"))]
        if m.left_on:
            m.log.find(
                "dangerous",
                f"the file ends with {' and '.join(m.left_on)} on, and without M2 or M30",
            )
        elif on:
            m.log.find("unusual", f"the program ends with {', '.join(on)} on")
    if any(by for by in m.shifted):
        m.log.find("unusual", "the shift of the origin by G92 or G52 is still on at the end")


def _frames(m: Machine) -> tuple[tuple[Frames, ...], tuple[int, ...]]:
    """The tools and work offsets in force, and which of them at each instruction."""
    if not m.marks:
        return ((Frames(work=m.work),), ()) if m.work else ((), ())
    table: dict[tuple[str, str], int] = {}
    frame: list[int] = []
    marks = m.marks if m.marks[0][0] == 0 else [(0, 0, ""), *m.marks]
    for (begin, tool, work), (end, *_) in zip(
        marks, [*marks[1:], (len(m.body), 0, "")], strict=True
    ):
        if end > begin:
            place = table.setdefault((f"T{tool}" if tool else "", work), len(table))
            frame += [place] * (end - begin)
    frames = tuple(Frames(tool=tool, work=work) for tool, work in table)
    return frames, tuple(frame) if len(frames) > 1 else ()


def _facts(m: Machine) -> tuple[tuple[str, str], ...]:
    """What else stands in the program."""
    facts = [
        ("dialect", next(iter(m.log.facts.pop("dialect")))),
        ("units", "mm" if m.scale == 1.0 else "inch"),
    ]
    if m.tools:
        facts.append(("tools", ", ".join(f"T{number}" for number in m.tools)))
    if m.filament:
        facts.append(("filament", f"{m.filament:.1f} mm"))
    for label, items in m.log.facts.items():
        some = [f"{what} (line {line})" for what, line in list(items.items())[:8]]
        facts.append(
            (label, ", ".join(some) + (f" and {len(items) - 8} more" if len(items) > 8 else ""))
        )
    return tuple(facts)
