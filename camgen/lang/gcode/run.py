"""One run of a G-code program of any author."""

from __future__ import annotations

import re
from collections.abc import Mapping
from itertools import pairwise, repeat

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
from camgen.lang.programs import Executed, Frames, RunRequest, index_frames
from camgen.lang.run import Stopped
from camgen.model.program import Output

#: Words that may move X, Y and Z: the axis, its increment, polar words, and codes that move to a
#: position of the machine.
_MOVING_WORDS = tuple(
    re.compile(rf"[{letters}]|\bG[ \t]*0*(?:28|30|53)\b", re.IGNORECASE)
    for letters in (r"xu@\^", r"yv@\^", "zw")
)
#: Maximum number of items in the text of a fact.
_LISTED = 8
#: The profile of third-party programs.
PROFILE = Profile(
    handlers=HANDLERS,
    clean=third_party.clean,
    parse=third_party.parse,
    prepare_motion=third_party.prepare_motion,
    run_without_axes=third_party.run_without_axes,
    switch=third_party.switch,
)


#: The machine after a run, line and reason of a stop before the end, and the steps of the program,
#: None if it could not be compiled.
ProgramTrace = tuple[Machine, tuple[int, str] | None, Code | None]


def run_program(
    files: Mapping[str, str],
    request: RunRequest,
    usual: Dialect | None = None,
    chord: float | None = None,
) -> ProgramTrace:
    """Runs the first of ``files``. Never raises for a text.

    files: the program, and then files with its subprograms.
    request: dialect, assumed values, entry and limits.
    usual: dialect if the request names none. None: the text determines it.
    chord: deviation of the lines of helices and splines, mm. None: the deviation of the dialect.
    """
    lines: list[str] = []
    starts: dict[str, int] = {}
    for name, text in files.items():
        starts[name] = len(lines)
        lines += _split_lines(text)
    name, text = next(iter(files.items()), ("", ""))
    dialect, sign = (usual, "") if usual else recognise(text, name)
    if request.dialect:
        dialect, sign = DIALECTS.get(request.dialect, dialect), ""
    helix = dialect.arcs.helix if chord is None else chord
    m = Machine(
        profile=PROFILE,
        dialect=dialect,
        given=request.assume,
        limits=replace(dialect.arcs, pieces=request.limits.gcode_pieces, helix=helix),
        bounds=request.limits,
        on_off=not has_speed(lines),
        to_start=dialect.to_start or None,
    )
    if dialect.name == "grbl" and m.given.get("laser", float(sets_laser_mode(text))):
        m.beam = Beam("process" if m.on_off else "spindle")
    words = COMMENT.sub("", "\n".join(files.values()))
    m.unnamed = [axis for axis, moving in enumerate(_MOVING_WORDS) if not moving.search(words)]
    m.log.fact("dialect", f"{dialect.name} ({sign[:30]})" if sign else dialect.name)
    other = find_other(text)
    if other is not None and not request.dialect:
        return m, (other[0], f"a program of {other[1]}: its language is not read"), None
    try:
        code = compile_program(lines, dialect, starts)
    except LineError as error:
        what, line = error.args
        return m, (line, what), None
    third_party.find_split_numbers(m, lines)
    try:
        Interpreter(m, lines, code).run(request.entry)
        m.finish()
    except (LineError, Stopped) as error:
        return m, (m.line, str(error)), code
    return m, None, code


def run(files: Mapping[str, str], request: RunRequest, usual: Dialect | None = None) -> Executed:
    """Runs the first of ``files``. Never raises for a text.

    usual: dialect if the request names none. None: the text determines it.
    """
    m, stopped, code = run_program(files, request, usual)
    coverage = None if code is None else _measure_coverage(files, code, m)
    if stopped is None:
        _check_end(m, [len(_split_lines(text)) for text in files.values()])
    frames, frame = _list_frames(m)
    return Executed(
        body=m.body.body(),
        lines=tuple(m.lines),
        frames=frames,
        frame=frame,
        findings=m.log.list_findings(),
        assumed=m.log.list_assumed(),
        facts=_list_facts(m),
        lost=m.log.list_lost(),
        stopped=stopped,
        is_limited=m.log.is_limited,
        coverage=coverage,
    )


def _measure_coverage(files: Mapping[str, str], code: Code, m: Machine) -> Coverage:
    """The coverage of the lines that have more than a comment, a block skip or a per cent sign."""
    has_statement: list[bool] = []
    for text in files.values():
        lines = map(COMMENT.sub, repeat(""), _split_lines(text))
        has_statement += [bool(line.strip(" \t\r%/")) for line in lines]
    coverage = measure_coverage([code], m.log.ran, m.line)
    chosen = np.array(has_statement)[coverage.lines - 1]
    return Coverage(coverage.lines[chosen], coverage.ran[chosen])


def _split_lines(text: str) -> list[str]:
    return text.removeprefix("\ufeff").removesuffix("\n").split("\n")


def _check_end(m: Machine, line_counts: list[int]) -> None:
    """Adds findings for a missing end, outputs that stay on, and a shift that stays.

    line_counts: number of lines of each file.
    """
    m.line = min(m.line, sum(line_counts)) or 1
    if not m.ended and line_counts:
        m.line = line_counts[0]
        if m.dialect.needs_end:
            what = "the program has no end (M2, M30 or per cent signs)"
            m.log.find("unusual", f"{what}: LinuxCNC stops here with an error")
        values = {item.signal: item.value for item in m.body if isinstance(item, Output)}
        on = [name for name, value in values.items() if value and name[:4] in ("dout", "aout")]
        # The run has switched spindle and coolant off at its end. The text has not.
        if m.left_on:
            what = f"the file ends with {' and '.join(m.left_on)} on, and without M2 or M30"
            m.log.find("dangerous", what)
        elif on:
            m.log.find("unusual", f"the program ends with {', '.join(on)} on")
    if any(m.shifted):
        m.log.find("unusual", "the shift of the origin by G92 or G52 is still on at the end")


def _list_frames(m: Machine) -> tuple[tuple[Frames, ...], tuple[int, ...]]:
    """The pairs of a tool and a work offset, and the index of the pair of each instruction.

    The indices are empty for one pair.
    """
    if not m.marks:
        return ((Frames(work=m.work),), ()) if m.work else ((), ())
    table: dict[tuple[str, str], int] = {}
    frame: list[int] = []
    marks = [*m.marks, (len(m.body), 0, "")]
    if marks[0][0] > 0:
        marks.insert(0, (0, 0, ""))
    for (begin, tool, work), (end, *_) in pairwise(marks):
        if end > begin:
            index = table.setdefault((f"T{tool}" if tool else "", work), len(table))
            frame += [index] * (end - begin)
    frames = tuple(Frames(tool=tool, work=work) for tool, work in table)
    return frames, index_frames(frames, frame)


def _list_facts(m: Machine) -> tuple[tuple[str, str], ...]:
    """The facts of a run: label and text, with the first lines of each."""
    facts = [
        ("dialect", next(iter(m.log.facts.pop("dialect")))),
        ("units", "mm" if m.scale == 1.0 else "inch"),
    ]
    if m.tools:
        facts.append(("tools", ", ".join(f"T{number}" for number in m.tools)))
    if m.filament:
        facts.append(("filament", f"{m.filament:.1f} mm"))
    for label, items in m.log.facts.items():
        listed = [f"{what} (line {line})" for what, line in items.items()]
        text = ", ".join(listed[:_LISTED])
        if len(listed) > _LISTED:
            text += f" and {len(listed) - _LISTED} more"
        facts.append((label, text))
    return tuple(facts)
