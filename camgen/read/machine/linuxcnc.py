"""The INI file of a LinuxCNC machine with three axes.

Source: LinuxCNC's documents, "INI Configuration". The planner works with the limits of the axes.
Trivial kinematics move an axis by its own joints, whose limits hold for the axis too: the tightest
counts. A variable that stands twice in a section has its first value. `#INCLUDE` is refused: the
controller searches for such files in folders that are unknown here.
"""

from __future__ import annotations

import re

from camgen.model.cell import Axes
from camgen.model.errors import InputError
from camgen.model.machine import Machine
from camgen.model.pose import Vec3
from camgen.model.text import harmless
from camgen.read.machine.values import Settings, Value

#: The header of a section, [TRAJ].
SECTION = re.compile(r"\s*\[(\w+)\]\s*$")
_VARIABLE = re.compile(r"\s*([A-Za-z_]\w*)\s*=(.*)")
_INCLUDE = re.compile(r"#INCLUDE\b")
#: mm in the units of a machine, by the names that LINEAR_UNITS takes.
_UNITS = {"mm": 1.0, "metric": 1.0, "inch": 25.4, "in": 25.4, "imperial": 25.4}
_AXES = "XYZ"
#: The axes of joints 0, 1, ... for trivial kinematics that do not name them.
_ALL_AXES = "XYZABCUVW"
#: Names of the limits along the path, the one of today first.
_PATH_SPEED = ("MAX_LINEAR_VELOCITY", "MAX_VELOCITY")
_PATH_ACCELERATION = ("MAX_LINEAR_ACCELERATION", "MAX_ACCELERATION")


def read_ini(file: str, lines: list[str]) -> Machine:
    """The machine of an INI file.

    Raises InputError for a limit that is missing or impossible, an unknown unit and #INCLUDE.
    """
    settings = Settings(file, _find_values(file, lines), "add it to the file")
    mm = _read_unit(settings)
    sections = {axis: _list_sections(settings, axis) for axis in _AXES}
    rates = _read_axes(settings, sections, "MAX_VELOCITY", mm)
    accelerations = _read_axes(settings, sections, "MAX_ACCELERATION", mm)
    low, high = _read_travel(settings, sections, mm)
    return Machine(
        file,
        "LinuxCNC",
        "gcode",
        "arc",
        Axes(rates, accelerations),
        low,
        high,
        speed=_read_path(settings, _PATH_SPEED, mm),
        acceleration=_read_path(settings, _PATH_ACCELERATION, mm),
    )


def _find_values(file: str, lines: list[str]) -> dict[str, Value]:
    """The variables of an INI file, named [SECTION] VARIABLE."""
    values: dict[str, Value] = {}
    section = ""
    for number, line in enumerate(lines, 1):
        if _INCLUDE.match(line):
            raise InputError(
                file,
                f"{harmless(line.strip())} is not followed",
                f"line {number}",
                "put the sections of the included file into this one",
            )
        if line.lstrip()[:1] in ("#", ";"):
            continue
        header = SECTION.match(line)
        if header:
            section = header[1]
            continue
        variable = _VARIABLE.match(line)
        if variable:
            values.setdefault(f"[{section}] {variable[1]}", Value(variable[2].strip(), number))
    return values


def _read_unit(settings: Settings) -> float:
    """Length of one unit of the machine, mm."""
    name = "[TRAJ] LINEAR_UNITS"
    value = settings.values.get(name)
    if value is None:
        raise InputError(settings.file, f"has no {name}", "cell.machine", settings.remedy)
    mm = _UNITS.get(value.text.lower())
    if mm is None:
        raise settings.fault(name, "is not known", f"one of {', '.join(_UNITS)}")
    return mm


def _list_sections(settings: Settings, axis: str) -> list[str]:
    """The sections with limits of an axis: its own, and with trivial kinematics its joints'."""
    kinematics = settings.values.get("[KINS] KINEMATICS")
    words = kinematics.text.split() if kinematics else []
    if not words or words[0].lower() != "trivkins":
        return [f"AXIS_{axis}"]
    letters = _ALL_AXES
    for word in words[1:]:
        key, _, value = word.partition("=")
        if key.lower() == "coordinates":
            letters = value.upper()
    joints = [f"JOINT_{number}" for number, letter in enumerate(letters) if letter == axis]
    return [f"AXIS_{axis}", *joints]


def _list_names(settings: Settings, sections: list[str], variable: str) -> list[str]:
    """The names under which a limit is set; the name for the axis if it is missing."""
    names = [f"[{section}] {variable}" for section in sections]
    return [name for name in names if name in settings.values] or names[:1]


def _read_axes(
    settings: Settings, sections: dict[str, list[str]], variable: str, mm: float
) -> Vec3:
    """The tightest limit above 0 of each axis, mm."""
    limits: list[float] = []
    for axis in _AXES:
        names = _list_names(settings, sections[axis], variable)
        limits.append(min(map(settings.above_zero, names)) * mm)
    return (limits[0], limits[1], limits[2])


def _read_travel(
    settings: Settings, sections: dict[str, list[str]], mm: float
) -> tuple[Vec3, Vec3]:
    """The lowest and the highest position of each axis, mm."""
    low: list[float] = []
    high: list[float] = []
    for axis in _AXES:
        begins = _list_names(settings, sections[axis], "MIN_LIMIT")
        ends = _list_names(settings, sections[axis], "MAX_LIMIT")
        begin = max(map(settings.number, begins))
        end = min(map(settings.number, ends))
        if begin >= end:
            raise settings.fault(
                begins[0], "leaves no travel", f"{ends[0]} is {end:g}; correct the limits"
            )
        low.append(begin * mm)
        high.append(end * mm)
    return (low[0], low[1], low[2]), (high[0], high[1], high[2])


def _read_path(settings: Settings, variables: tuple[str, ...], mm: float) -> float:
    """A limit along the path, mm; without it the axes alone limit the path."""
    for variable in variables:
        name = f"[TRAJ] {variable}"
        if name in settings.values:
            return settings.above_zero(name) * mm
    return float("inf")
