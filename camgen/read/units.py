"""Units of length of a drawing: names people write, codes that files hold, and doubts worth a note."""

from __future__ import annotations

import math
from collections.abc import Sequence

from camgen.model.errors import JobError
from camgen.model.part import Note
from camgen.model.text import harmless, short

#: mm per unit, by the names that ``input.units`` takes; the first name of a length is the one that notes use.
MM = {
    "mm": 1.0, "cm": 10.0, "dm": 100.0, "m": 1000.0, "km": 1e6, "um": 1e-3, "nm": 1e-6,
    "inch": 25.4, "ft": 304.8, "yd": 914.4, "mile": 1609344.0, "mil": 0.0254, "uinch": 25.4e-6,
    "us-ft": 1200000 / 3937, "us-inch": 100000 / 3937, "us-yd": 3600000 / 3937, "us-mile": 5280 * 1200000 / 3937,
    "in": 25.4, '"': 25.4, "inches": 25.4, "foot": 304.8, "feet": 304.8, "'": 304.8, "yard": 914.4, "yards": 914.4,
    "thou": 0.0254, "mils": 0.0254, "miles": 1609344.0, "micron": 1e-3, "microns": 1e-3, "millimeter": 1.0,
    "millimetre": 1.0, "millimeters": 1.0, "millimetres": 1.0, "centimeter": 10.0, "centimetre": 10.0,
    "meter": 1000.0, "metre": 1000.0, "meters": 1000.0, "metres": 1000.0,
}  # fmt: skip

#: $INSUNITS of the DXF reference (2018), as far as a part can be drawn in it.
INSUNITS = {
    1: "inch", 2: "ft", 3: "mile", 4: "mm", 5: "cm", 6: "m", 7: "km", 8: "uinch", 9: "mil", 10: "yd",
    12: "nm", 13: "um", 14: "dm", 21: "us-ft", 22: "us-inch", 23: "us-yd", 24: "us-mile",
}  # fmt: skip

#: A part larger or smaller than this (mm) is more likely drawn in another unit than meant.
LARGEST, SMALLEST = 3000.0, 1.0
#: Units that drawings are confused in, and the usual size of a part, mm.
_CONFUSED, _USUAL = ("um", "mm", "inch", "m"), 100.0

_OVERRIDE = "set input.units if that is not meant"
#: Files whose own unit holds (``read.solid.step``).
_OWN = (".step", ".stp")


def resolve(
    file: str, wanted: str, insunits: int, measurement: int | None
) -> tuple[str, float, tuple[Note, ...]]:
    """Name of the unit, mm per unit, and notes.

    wanted: ``input.units``, "auto" for the file's own. insunits: the file's code, 0 if it has none. measurement:
    $MEASUREMENT (0 inch, 1 metric), only named in the note since it tells templates apart, not drawings. ``JobError``
    for a unit that is not known.
    """
    name = wanted.strip().lower()
    if name in MM:
        return name, MM[name], ()
    if name != "auto":
        from difflib import get_close_matches  # noqa: PLC0415 (1 ms, only for what is wrong)

        near = get_close_matches(name, [*MM, "auto"], n=1)
        remedy = (
            f"did you mean {near[0]}?" if near else "use one of auto, mm, cm, m, inch, ft, mil, ..."
        )
        raise JobError(file, f"unknown unit {harmless(wanted)!r}", "input.units", remedy)
    if insunits in INSUNITS:
        name = INSUNITS[insunits]
        return name, MM[name], ()
    hint = {0: ", though its $MEASUREMENT says inch", 1: ", its $MEASUREMENT says metric"}.get(
        measurement or 0, ""
    )
    states = "states no unit" if insunits == 0 else f"states the unknown unit {insunits}"
    hint = hint if measurement is not None else ""
    return (
        "mm",
        1.0,
        (Note("assumed", "1 drawing unit = 1 mm", f"the file {states}{hint}; {_OVERRIDE}"),),
    )


def remedy_for(source: str) -> str:
    """What to do where the file ``source`` was read in another unit than meant."""
    if source.lower().endswith(_OWN):
        return "export it again in another one if that is not meant"
    return _OVERRIDE


def doubts(size: Sequence[float], unit: str, source: str) -> tuple[Note, ...]:
    """A warning if a part of this size along the axes (mm), from the file ``source``, contradicts its unit."""
    if SMALLEST <= max(size) <= LARGEST:
        return ()
    size_text = " x ".join(short(length, 3) for length in size)
    odd = "large" if max(size) > LARGEST else "small"
    return (
        Note(
            "warning",
            f"the part is {size_text} mm, which is {odd}",
            f"drawn in {unit}, likely in {_guess(max(size), unit)}; {remedy_for(source)}",
        ),
    )


def _guess(length: float, unit: str) -> str:
    """The unit in which a part of a length, mm, is nearest to a usual size.

    unit: the unit in which it was read.
    """
    drawn = length / MM.get(unit, 1.0)
    units = [name for name in _CONFUSED if name != unit]
    return min(units, key=lambda name: abs(math.log(drawn * MM[name] / _USUAL)))
