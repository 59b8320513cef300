"""A saved listing of the settings of GRBL 1.1, the answer to `$$`.

Source: the wiki of the firmware, "Grbl v1.1 Configuration". All lengths of the listing are mm;
`$13` changes reports alone. Travel is stored as a length. Machine coordinates of an axis run from
minus its travel to 0, with the firmware as it is distributed.
"""

from __future__ import annotations

import re

from camgen.model.cell import Axes
from camgen.model.errors import InputError
from camgen.model.machine import Machine
from camgen.model.part import Note
from camgen.model.pose import Vec3
from camgen.model.text import harmless
from camgen.read.machine.values import Settings, Value

#: A setting: its number, its value and the rest of the line, a remark in brackets or nothing.
SETTING = re.compile(r"\s*(\$\d+)\s*=\s*([^\s(]*)\s*(.*)")
#: s: a minute, and a millisecond.
_MINUTE, _MILLISECOND = 60.0, 1e-3
#: The value of `$1` with which the motors stay on, and the largest one.
_STAYS_ON = 255
#: Settings that a listing may lack, with the firmware's own values and their meaning.
_DEFAULTS = {
    "$1": ("25", "ms of idle delay at a stop"),
    "$12": ("0.002", "mm of arc tolerance"),
    "$100": ("250", "steps/mm in X"),
    "$101": ("250", "steps/mm in Y"),
    "$102": ("250", "steps/mm in Z"),
}


def read_listing(file: str, lines: list[str]) -> Machine:
    """The machine of a listing.

    Raises InputError for a limit that is missing or impossible, and for a setting with two values.
    """
    values = _find_values(file, lines)
    notes: list[Note] = []
    for name, (text, meaning) in _DEFAULTS.items():
        if name not in values:
            values[name] = Value(text, 0)
            notes.append(
                Note(
                    "assumed",
                    f"{name} = {text} {meaning}",
                    f"{file} lacks it; the firmware's default",
                )
            )
    settings = Settings(file, values, "save all that GRBL answers to $$")
    x, y, z = _read_axes(settings, "$13")
    x_rate, y_rate, z_rate = _read_axes(settings, "$11")
    axes = Axes(
        (x_rate / _MINUTE, y_rate / _MINUTE, z_rate / _MINUTE),
        _read_axes(settings, "$12"),
        _read_axes(settings, "$10"),
    )
    delay = settings.number("$1", 0.0, _STAYS_ON)
    return Machine(
        file,
        "GRBL",
        "grbl",
        "junction",
        axes,
        low=(-x, -y, -z),
        high=(0.0, 0.0, 0.0),
        chord=settings.above_zero("$12"),
        deviation=settings.number("$11", 0.0),
        pause=0.0 if delay == _STAYS_ON else delay * _MILLISECOND,
        notes=tuple(notes),
    )


def _find_values(file: str, lines: list[str]) -> dict[str, Value]:
    """The settings of a listing. Its other lines are greetings, answers and reports."""
    values: dict[str, Value] = {}
    for number, line in enumerate(lines, 1):
        match = SETTING.match(line)
        if match is None:
            continue
        name, text, rest = match.groups()
        if rest and not rest.startswith("("):
            raise InputError(
                file,
                f"{name} is followed by {harmless(rest)!r}",
                f"line {number}",
                "put one setting on a line",
            )
        earlier = values.setdefault(name, Value(text, number))
        if earlier.text != text:
            other = f"{harmless(earlier.text)} in line {earlier.line}"
            raise InputError(
                file,
                f"{name} is {harmless(text)} here and {other}",
                f"line {number}",
                "keep one listing in the file",
            )
    return values


def _read_axes(settings: Settings, prefix: str) -> Vec3:
    """The settings of X, Y and Z, whose names end with 0, 1 and 2."""
    x, y = settings.above_zero(f"{prefix}0"), settings.above_zero(f"{prefix}1")
    return x, y, settings.above_zero(f"{prefix}2")
