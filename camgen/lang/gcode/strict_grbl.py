"""Reads a GRBL 1.1 program of a post back: text -> instructions, findings by line.

It is written from the parser of the firmware, its modal groups and its list of errors. A line that
the firmware answers with an error is refused.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from msgspec.structs import replace

from camgen.lang.gcode.arcs import Limits
from camgen.lang.post_options import read_number
from camgen.lang.programs import Executed
from camgen.model.body import Body
from camgen.model.program import Instruction, Output

from .strict import Expect, list_lines, list_written, run, signals, spiral
from .strict_text import Controller

_CODES = """
    G0 G1 G2 G3 G4 G17 G18 G19 G20 G21 G40 G49 G53 G54 G55 G56 G57 G58 G59 G61 G80 G90 G91 G91.1 G94
    M0 M2 M3 M4 M5 M7 M8 M9 M30
"""
GRBL = Controller(
    name="GRBL",
    codes=frozenset(_CODES.split()),
    limit=79,
    squeezed=True,
    forbidden=re.compile(r"[!~?]|[^\t -~]"),
    linuxcnc=False,
    arcs=Limits(spiral=(0.005, 0.5, 0.005), shorter=0.0, least_radius=1e-6, turns=False),
    max_tool=255,
    max_line_number=10_000_000,
)


def read(files: Mapping[str, str], options: Mapping[str, object]) -> Executed:
    """Reads a GRBL program back.

    options: options of the post. Missing ones have the defaults of docs/posts/grbl.md.
    Raises JobError if an option has the wrong type.
    """
    names = signals(options, {"process": "M3"})
    power = read_number(options, "power", 1000.0)
    expect = Expect(
        work=str(options.get("work", "G54")),
        names=names,
        lift=options.get("lift", False) is True,
        spiral=spiral(options),
    )
    reading = list_written(run(list_lines(files), GRBL, expect))
    assert isinstance(reading.body, Body)
    return replace(reading, body=_rename_spindle(reading.body, names, power))


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
