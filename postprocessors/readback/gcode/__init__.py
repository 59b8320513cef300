"""Reads a LinuxCNC program back: text -> instructions, faults by line.

Written from the LinuxCNC manual and checked against its interpreter. What no post writes (other cycles, O-words,
parameters, expressions, shifts of the origin) is left to the interpreter of foreign programs; what that does not know
either is a fault that names the word.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from camgen.model.errors import JobError
from camgen.post import Reading
from camgen.read.gcode import arcs

from .lexis import Rules, by_group
from .machine import played, written
from .state import Expect

#: Codes by modal group: two of one group in a line are an error of the controller.
_GROUPS = {
    "motion": "G0 G1 G2 G3 G80 G81 G82 G83",
    "plane": "G17 G18 G19",
    "distance": "G90 G91",
    "arc distance": "G90.1 G91.1",
    "feed mode": "G94",
    "units": "G20 G21",
    "cutter compensation": "G40",
    "length offset": "G43 G49",
    "return level": "G98 G99",
    "work offset": "G54 G55 G56 G57 G58 G59 G59.1 G59.2 G59.3",
    "path": "G61 G61.1 G64",
    "spindle mode": "G97",
    "dwell": "G4",
    "stop": "M2 M30",
    "input/output": "M62 M63 M64 M65 M67 M68",
    "tool change": "M6",
    "spindle": "M3 M4 M5",
    "coolant": "M7 M8 M9",
}
LINUXCNC = Rules(
    name="LinuxCNC",
    codes=by_group(_GROUPS),
    limit=252,
    squeezed=False,
    forbidden=None,
    linuxcnc=True,
    arcs=arcs.LINUXCNC,
)


def read(files: Mapping[str, str], options: Mapping[str, object]) -> Reading:
    """What a LinuxCNC program says. options: of the post; left out, its defaults (docs/posts/gcode.md)."""
    force = None
    if options.get("force") == "analog":
        force = (int(number(options, "force_channel", 0)), number(options, "force_scale", 0.0) or 1.0)
    expect = Expect(
        work=str(options.get("work", "G54")),
        tool=int(number(options, "tool", 0)),
        path=number(options, "path_tolerance", 0.01),
        names={word: name for name, word in signals(options, {"process": "P0"}).items()},
        force=force,
    )
    text = list(lines(files))
    machine = played(text, LINUXCNC, expect)
    if machine.unread:
        from .foreign import foreign  # noqa: PLC0415 (camgen's own programs need no interpreter)

        return foreign(text, machine) or written(machine)
    return written(machine)


def lines(files: Mapping[str, str]) -> Iterator[str]:
    """The lines of all files in order, without their ends."""
    for text in files.values():
        yield from text.removesuffix("\n").split("\n")


def number(options: Mapping[str, object], key: str, default: float) -> float:
    """The option ``key`` as a number; JobError for anything else."""
    value = options.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise JobError(f"[post] {key}", f"{value!r} is not a number")
    return value


def signals(options: Mapping[str, object], default: dict[str, str]) -> dict[str, str]:
    """The option ``signals``: output word by signal; JobError for anything else."""
    table = options.get("signals", default)
    if not isinstance(table, Mapping) or not all(isinstance(word, str) for word in table.values()):
        raise JobError("[post] signals", "is not a table of output words", remedy='e.g. { process = "P0" }')
    return {str(name): word for name, word in table.items()}
