"""The units of length and the uncertainty of a STEP file, read from its text."""

from __future__ import annotations

import re

from camgen.model.errors import InputError, make_one_line
from camgen.model.files import Source
from camgen.model.part import Note
from camgen.read.units import MM

_CONTEXT = re.compile(rb"GLOBAL_UNIT_ASSIGNED_CONTEXT\s*\(\s*\(([^)]*)\)")
_INSTANCE = re.compile(rb"#(\d+)\s*=\s*\((?=[^;]*\bLENGTH_UNIT\b)([^;]*);")
_CONVERTED = re.compile(rb"CONVERSION_BASED_UNIT\s*\(\s*'([^']*)'")
_SI = re.compile(rb"SI_UNIT\s*\(\s*(\$|\.\w+\.)\s*,\s*\.METRE\.")
_UNCERTAINTY = re.compile(
    rb"UNCERTAINTY_MEASURE_WITH_UNIT\s*\(\s*LENGTH_MEASURE\s*\(\s*([-+.\dEe]+)\s*\)\s*,\s*#(\d+)"
)
_PREFIX = {
    b"$": "m",
    b".MILLI.": "mm",
    b".CENTI.": "cm",
    b".DECI.": "dm",
    b".MICRO.": "um",
    b".KILO.": "km",
}


def read_units(source: Source) -> tuple[str, list[Note]]:
    """The units of length of the shapes of a file for the user, and notes.

    The kernel converts the lengths. Raises InputError for a file of another kind.
    """
    data = source.data
    if not data[:4096].lstrip().startswith(b"ISO-10303-21"):
        raise InputError(source.name, "is not a STEP file", "it does not begin with ISO-10303-21")
    lengths = _list_units(data)
    used = {ref.strip(b" \t\r\n#") for ref in b",".join(_CONTEXT.findall(data)).split(b",")}
    names = sorted({lengths[ref] for ref in used if ref in lengths})
    if not names:
        return "mm", [
            Note("assumed", "1 unit of the file = 1 mm", "the file states no unit of length")
        ]
    return ", ".join(names), []


def read_uncertainty(data: bytes) -> float:
    """The largest uncertainty of lengths that a STEP file states, mm; 0 if it states none."""
    units = _list_units(data)
    stated = _UNCERTAINTY.findall(data)
    lengths = [float(value) * MM.get(units.get(unit, ""), 1.0) for value, unit in stated]
    return max(lengths, default=0.0)


def _list_units(data: bytes) -> dict[bytes, str]:
    """The names of the units of length, by the numbers of their entities."""
    return {number: _name(text) for number, text in _INSTANCE.findall(data)}


def _name(text: bytes) -> str:
    converted, si = _CONVERTED.search(text), _SI.search(text)
    if converted:
        return make_one_line(converted[1].decode("ascii", "replace")).lower().replace("metre", "m")
    return _PREFIX.get(si[1], "unknown") if si else "unknown"
