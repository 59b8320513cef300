"""Reads a LinuxCNC program of a post back: text -> instructions, findings by line.

A program may have words that no post writes: other cycles, O-words, parameters, shifts of the
origin. It is then run once more as a third-party program. A word that is unknown there too is
refused by name.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from camgen.lang.gcode import arcs
from camgen.lang.gcode.strict import Expect, list_lines, list_written, run, signals, spiral
from camgen.lang.gcode.strict_text import Controller
from camgen.lang.log import Log
from camgen.lang.post_options import read_number
from camgen.lang.programs import Executed, name_outputs

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
    lines = list_lines(files)
    m = run(lines, LINUXCNC, expect)
    third_party = _read_third_party(lines, m.unknown_line, names) if m.unknown_line else None
    return third_party or list_written(m)


def _read_third_party(
    lines: Sequence[str], unknown_line: int, names: Mapping[str, str]
) -> Executed | None:
    """Reads a program with words that no post writes as a third-party program.

    The words are a finding, so that a program of a post with such words never passes.
    unknown_line: first line with such a word.
    names: signal by output.
    Returns None if this run stops before the first of these words.
    """
    from camgen.lang.gcode.replayed import interpret  # noqa: PLC0415 (only for words of others)

    program = interpret(lines)
    if program.stopped and program.stopped[0] < unknown_line:
        return None
    what = "a word that camgen does not write; the program is read as LinuxCNC runs it"
    log = Log()
    log.find("unusual", what, line=unknown_line)
    for line, note in program.remarks:
        log.find("unusual", str(note), line=line)
    if program.stopped:
        line, reason = program.stopped
        log.find("refused", f"{reason}; nothing from here on is read", line=line)
    elif not program.ended:
        log.find("refused", "the program has no end (M2 or M30)", line=len(lines))
    return Executed(name_outputs(program.body, names), program.lines, findings=log.list_findings())
