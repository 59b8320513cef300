"""Reads a LinuxCNC or GRBL program of a post back: text -> instructions, findings by line.

A LinuxCNC program may have words that no post writes: other cycles, O-words, parameters, shifts of
the origin. It is then run once more as a third-party program. A word that is unknown there too is
refused by name.

The rules of GRBL 1.1 are written from the parser of the firmware, its modal groups and its list of
errors. A line that the firmware answers with an error is refused.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from camgen.lang.gcode import arcs
from camgen.lang.gcode.machine import COOLANTS
from camgen.lang.gcode.strict import Expect, run
from camgen.lang.gcode.strict_text import Controller
from camgen.lang.log import Log
from camgen.lang.post_options import read_number
from camgen.lang.programs import Executed, name_outputs
from camgen.model.body import Body
from camgen.model.errors import JobError
from camgen.model.program import Instruction, Output

_LINUXCNC_CODES = """
    G0 G1 G2 G3 G4 G17 G18 G19 G20 G21 G40 G43 G49 G53 G54 G55 G56 G57 G58 G59 G59.1 G59.2 G59.3
    G61 G61.1 G64 G80 G81 G82 G83 G90 G90.1 G91 G91.1 G94 G97 G98 G99
    M0 M1 M2 M3 M4 M5 M6 M7 M8 M9 M30 M62 M63 M64 M65 M67 M68
"""
LINUXCNC = Controller(
    name="LinuxCNC",
    codes=frozenset(_LINUXCNC_CODES.split()),
    limit=252,
    squeezed=False,
    forbidden=None,
    linuxcnc=True,
    arcs=arcs.LINUXCNC,
)
_GRBL_CODES = """
    G0 G1 G2 G3 G4 G17 G18 G19 G20 G21 G40 G49 G53 G54 G55 G56 G57 G58 G59 G61 G80 G90 G91 G91.1 G94
    M0 M2 M3 M4 M5 M7 M8 M9 M30
"""
GRBL = Controller(
    name="GRBL",
    codes=frozenset(_GRBL_CODES.split()),
    limit=79,
    squeezed=True,
    forbidden=re.compile(r"[!~?]|[^\t -~]"),
    linuxcnc=False,
    arcs=arcs.Limits(spiral=(0.005, 0.5, 0.005), shorter=0.0, least_radius=1e-6, turns=False),
    max_tool=255,
    max_line_number=10_000_000,
)


def read_linuxcnc(files: Mapping[str, str], options: Mapping[str, object]) -> Executed:
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
    names = _read_signals(options, {"process": "P0"})
    outputs = int(read_number(options, "outputs", 4))
    numbers = [int(name[4:]) for name in names if re.fullmatch("dout[0-9]{1,2}", name)]
    expect = Expect(
        work=str(options.get("work", "G54")),
        tool=int(read_number(options, "tool", 0)),
        path_tolerance=read_number(options, "path_tolerance", 0.01),
        names=names,
        lift=options.get("lift", True) is True,
        force=force,
        spiral=_find_spiral(options),
        digital=max([outputs, *(number + 1 for number in numbers)]),
        analog=max(outputs, force[0] + 1 if force else 0),
    )
    lines = list_lines(files)
    m = run(lines, LINUXCNC, expect)
    third_party = _read_third_party(lines, m.unknown_line, names) if m.unknown_line else None
    return third_party or Executed(m.body.body(), m.lines, findings=m.log.list_findings())


def _read_third_party(
    lines: Sequence[str], unknown_line: int, names: Mapping[str, str]
) -> Executed | None:
    """Reads a program with words that no post writes as a third-party program.

    The words are a finding, so that a program of a post with such words never passes.
    unknown_line: first line with such a word.
    names: signal by output.
    Returns None if this run stops before the first of these words.
    """
    from camgen.lang.gcode import interpret  # noqa: PLC0415 (only for words of others)

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


def read_grbl(files: Mapping[str, str], options: Mapping[str, object]) -> Executed:
    """Reads a GRBL program back.

    options: options of the post. Missing ones have the defaults of docs/posts/grbl.md.
    Raises JobError if an option has the wrong type.
    """
    names = _read_signals(options, {"process": "M3"})
    power = read_number(options, "power", 1000.0)
    expect = Expect(
        work=str(options.get("work", "G54")),
        names=names,
        lift=options.get("lift", False) is True,
        spiral=_find_spiral(options),
    )
    m = run(list_lines(files), GRBL, expect)
    body = _rename_spindle(m.body.body(), names, power)
    return Executed(body, m.lines, findings=m.log.list_findings())


def _rename_spindle(body: Body, names: Mapping[str, str], power: float) -> Body:
    """`body` with the spindle output under the name of the signal that uses it.

    A program uses this output for a spindle or for a signal, not for both. It is the signal if its
    value is always 0 or `power` with the sign of its code. A single other value makes it a spindle
    throughout. The body then differs from the plan.
    """
    outputs = [item for item in body.objects if isinstance(item, Output)]
    values = {item.value for item in outputs if item.signal == "spindle"} - {0.0}
    sign = -1.0 if any(value < 0 for value in values) else 1.0
    if values:
        signal = names.get("M4" if sign < 0 else "M3")
    else:
        signal = names.get("M3", names.get("M4"))
    if signal is None or any(abs(value - sign * power) > 1e-6 for value in values):
        return body
    renamed: list[Instruction] = []
    for item in body.objects:
        if isinstance(item, Output) and item.signal == "spindle":
            renamed.append(Output(signal, float(item.value != 0)))
        else:
            renamed.append(item)
    return Body(body.packed, body.rotations, renamed)


def list_lines(files: Mapping[str, str]) -> list[str]:
    """The lines of all files in order, without their ends."""
    lines: list[str] = []
    for text in files.values():
        lines += text.removesuffix("\n").split("\n")
    return lines


def _find_spiral(options: Mapping[str, object]) -> float:
    """Maximum difference of the two radii of an arc that the printed digits cause, mm.

    Both ends lose up to half a digit in X and Y, and the centre loses more.
    """
    return 3 * 10 ** -read_number(options, "decimals", 3)


def _read_signals(options: Mapping[str, object], default: dict[str, str]) -> dict[str, str]:
    """The option `signals`: signal by output. Outputs have the names of the interpreter.

    Raises JobError if the option is not a table of texts.
    """
    table = options.get("signals", default)
    if not isinstance(table, Mapping) or not all(isinstance(word, str) for word in table.values()):
        raise JobError(
            "[post] signals", "is not a table of output words", remedy='e.g. { process = "P0" }'
        )
    return {
        COOLANTS.get(word, word.replace("P", "dout")): str(name) for name, word in table.items()
    }
