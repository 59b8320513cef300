"""Reads a GRBL 1.1 program back: text -> instructions, faults by line.

Written from the firmware's parser, its modal groups and its list of errors: what it answers with an error is a fault.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from msgspec.structs import replace

from camgen.lang.gcode.arcs import Limits
from camgen.lang.programs import Executed
from camgen.model.program import Instruction, Output

from .strict import Expect, Rules, lines_of, list_written, number, run, signals, spiral

_CODES = """
    G0 G1 G2 G3 G4 G17 G18 G19 G20 G21 G40 G49 G53 G54 G55 G56 G57 G58 G59 G61 G80 G90 G91 G91.1 G94
    M0 M2 M3 M4 M5 M7 M8 M9 M30
"""
GRBL = Rules(
    name="GRBL",
    codes=frozenset(_CODES.split()),
    limit=79,
    squeezed=True,
    forbidden=re.compile(r"[!~?]|[^\t -~]"),
    linuxcnc=False,
    arcs=Limits(spiral=(0.005, 0.5, 0.005), shorter=0.0, least_radius=1e-6, turns=False),
    most_tool=255,
    most_line=10_000_000,
)


def read(files: Mapping[str, str], options: Mapping[str, object]) -> Executed:
    """What a GRBL program says. options: of the post; left out, its defaults (docs/posts/grbl.md)."""
    names = signals(options, {"process": "M3"})
    power = number(options, "power", 1000.0)
    reading = list_written(
        run(
            lines_of(files),
            GRBL,
            Expect(
                work=str(options.get("work", "G54")),
                names=names,
                lift=options.get("lift", False) is True,
                spiral=spiral(options),
            ),
        )
    )
    return replace(reading, body=_rename_spindle(reading.body, names, power))


def _rename_spindle(
    body: Sequence[Instruction], names: Mapping[str, str], power: float
) -> Sequence[Instruction]:
    """``body`` with the spindle line under the name of the signal that is on it.

    One line serves a spindle or a signal, not both in one program. It is the signal if nothing else than its word and
    its power occurs; a single other value makes it a spindle throughout, which then differs from what was planned.
    """
    values = {
        item.value for item in body if isinstance(item, Output) and item.signal == "spindle"
    } - {0.0}
    sign = -1.0 if any(value < 0 for value in values) else 1.0
    signal = names.get("M4" if sign < 0 else "M3") if values else names.get("M3", names.get("M4"))
    if signal is None or any(abs(value - sign * power) > 1e-6 for value in values):
        return body
    return tuple(
        Output(signal, 1.0 if item.value else 0.0)
        if isinstance(item, Output) and item.signal == "spindle"
        else item
        for item in body
    )
