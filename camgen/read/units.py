"""Units of length: names that users write, codes in files, and notes on doubtful sizes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from camgen.model.errors import JobError
from camgen.model.part import Note
from camgen.model.text import harmless, short

#: mm per unit, by the names that `input.units` takes. Notes use the first name of a length.
MM = {
    "mm": 1.0, "cm": 10.0, "dm": 100.0, "m": 1000.0, "km": 1e6, "um": 1e-3, "nm": 1e-6,
    "inch": 25.4, "ft": 304.8, "yd": 914.4, "mile": 1609344.0, "mil": 0.0254, "uinch": 25.4e-6,
    "us-ft": 1200000 / 3937, "us-inch": 100000 / 3937, "us-yd": 3600000 / 3937,
    "us-mile": 5280 * 1200000 / 3937,
    "in": 25.4, '"': 25.4, "inches": 25.4, "foot": 304.8, "feet": 304.8, "'": 304.8,
    "yard": 914.4, "yards": 914.4, "thou": 0.0254, "mils": 0.0254, "miles": 1609344.0,
    "micron": 1e-3, "microns": 1e-3, "millimeter": 1.0, "millimetre": 1.0, "millimeters": 1.0,
    "millimetres": 1.0, "centimeter": 10.0, "centimetre": 10.0, "meter": 1000.0, "metre": 1000.0,
    "meters": 1000.0, "metres": 1000.0,
}  # fmt: skip

#: Units of the codes of $INSUNITS (DXF reference, 2018) in which a part can be drawn.
INSUNITS = {
    1: "inch", 2: "ft", 3: "mile", 4: "mm", 5: "cm", 6: "m", 7: "km", 8: "uinch", 9: "mil",
    10: "yd", 12: "nm", 13: "um", 14: "dm", 21: "us-ft", 22: "us-inch", 23: "us-yd", 24: "us-mile",
}  # fmt: skip

#: mm: a larger or smaller part was probably drawn in another unit.
LARGEST, SMALLEST = 3000.0, 1.0
#: Units that are mistaken for each other in drawings.
_CONFUSED = ("um", "mm", "inch", "m")
#: mm: usual size of a part.
_USUAL = 100.0

_OVERRIDE = "set input.units if that is not meant"
#: Suffixes of files whose unit cannot be overridden (`read.solid.step`).
_OWN_UNIT = (".step", ".stp")


def resolve(
    file: str, wanted: str, insunits: int, measurement: int | None
) -> tuple[str, float, tuple[Note, ...]]:
    """Name of the unit, its length in mm, and notes.

    wanted: `input.units`; "auto" for the unit of the file.
    insunits: code of the unit in the file, 0 if it has none.
    measurement: $MEASUREMENT of the file, 0 for inch and 1 for metric, None if it has none. It is
        named in the note alone: it says which template a drawing has, not its unit.

    Raises JobError for an unknown unit.
    """
    name = wanted.strip().lower()
    if name in MM:
        return name, MM[name], ()
    if name != "auto":
        from difflib import get_close_matches  # noqa: PLC0415 (1 ms, only for an unknown unit)

        near = get_close_matches(name, [*MM, "auto"], n=1)
        remedy = (
            f"did you mean {near[0]}?" if near else "use one of auto, mm, cm, m, inch, ft, mil, ..."
        )
        raise JobError(file, f"unknown unit {harmless(wanted)!r}", "input.units", remedy)
    if insunits in INSUNITS:
        name = INSUNITS[insunits]
        return name, MM[name], ()
    states = "states no unit" if insunits == 0 else f"states the unknown unit {insunits}"
    hints = {0: ", though its $MEASUREMENT says inch", 1: ", its $MEASUREMENT says metric"}
    hint = "" if measurement is None else hints.get(measurement, "")
    return (
        "mm",
        1.0,
        (Note("assumed", "1 drawing unit = 1 mm", f"the file {states}{hint}; {_OVERRIDE}"),),
    )


def choose_remedy(source: str) -> str:
    """The remedy for a file, by its name, that was read in a wrong unit."""
    if source.lower().endswith(_OWN_UNIT):
        return "export it again in another one if that is not meant"
    return _OVERRIDE


def format_size(lengths: Iterable[float], decimals: int = 3, separator: str = " x ") -> str:
    """Lengths, or other numbers, as a text: "100 x 60"."""
    return separator.join(short(length, decimals) for length in lengths)


def note_doubtful_size(size: Sequence[float], unit: str, source: str) -> tuple[Note, ...]:
    """A warning if the size of a part contradicts its unit, otherwise nothing.

    size: extent along the axes, mm.
    unit: unit in which the part was read.
    source: name of its file.
    """
    largest = max(size)
    if SMALLEST <= largest <= LARGEST:
        return ()
    which = "large" if largest > LARGEST else "small"
    return (
        Note(
            "warning",
            f"the part is {format_size(size)} mm, which is {which}",
            f"drawn in {unit}, likely in {_guess_unit(largest, unit)}; {choose_remedy(source)}",
        ),
    )


def _guess_unit(length: float, unit: str) -> str:
    """The unit other than `unit` in which a length, mm, would be nearest to a usual size."""
    drawn = length / MM.get(unit, 1.0)
    units = [name for name in _CONFUSED if name != unit]
    return min(units, key=lambda name: abs(math.log(drawn * MM[name] / _USUAL)))
