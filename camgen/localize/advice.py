"""Advice on units, tried before it is given: the part is looked for again in other units."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from msgspec import Struct

from camgen.localize import Location
from camgen.localize.scans import Scan
from camgen.model.errors import InputError, NoSafeProgram
from camgen.model.part import IntArray, Note
from camgen.model.pose import FloatArray
from camgen.model.text import short
from camgen.read.units import LARGEST, MM, SMALLEST

#: Units that files are confused in.
_CONFUSED = ("mm", "cm", "m", "inch", "um")
#: The size of a scan, as a share of the model's, at which the scan may show the model.
_LEAST_RATIO, _MOST_RATIO = 0.3, 3.0


class ModelPart(Struct, frozen=True, eq=False):
    """A model as triangles.

    vertices: (V, 3) mm.
    faces: (F, 3) indices of vertices.
    notes: repairs and assumptions.
    unit: the unit of the file, a key of `MM`.
    stated: whether the file itself states the unit.
    """

    vertices: FloatArray
    faces: IntArray
    notes: list[Note]
    unit: str
    stated: bool


#: Looks for a part in a scan. Raises as `localize`.
Search = Callable[[ModelPart, Scan], Location]


def localize_or_advise(
    search: Search, part: ModelPart, scan: Scan, reread: Callable[[str], ModelPart]
) -> Location:
    """The location of the part in the scan.

    reread: the model as read in another unit.

    Raises InputError if the part is not found. If it is found in other units the error says which,
    and the size of the part in them. Raises NoSafeProgram as `search`.
    """
    try:
        return search(part, scan)
    except InputError as error:
        tried = [_try(search, part, scan, reread, *option) for option in _list_options(part, scan)]
        advice = list(filter(None, tried))
        if not advice:
            raise
        raise InputError(
            error.file, error.what, error.where, f"it is found with {', and with '.join(advice)}"
        ) from error


def _list_options(part: ModelPart, scan: Scan) -> list[tuple[str, str]]:
    """The options with the units in which the scan is about as large as the model."""
    sides = np.ptp(part.vertices, axis=0)
    size = float(np.linalg.norm(sides))
    low, high = np.percentile(scan.points, (1, 99), axis=0)
    extent = float(np.linalg.norm(high - low))
    if not size or not extent or _LEAST_RATIO < extent / size < _MOST_RATIO:
        return []
    options = []
    for name, file in (("--model-units", part), ("--units", scan)):
        for unit in () if file.stated else _CONFUSED:
            factor = MM[unit] / MM[file.unit]
            model, cloud = (factor, 1.0) if file is part else (1.0, factor)
            usual = SMALLEST <= float(sides.max()) * model <= LARGEST
            if usual and _LEAST_RATIO < extent * cloud / (size * model) < _MOST_RATIO:
                options.append((name, unit))
    return options


def _try(
    search: Search,
    part: ModelPart,
    scan: Scan,
    reread: Callable[[str], ModelPart],
    option: str,
    unit: str,
) -> str:
    """An option with its unit and the size of the part; "" if the part is not found with it.

    A part that is found and may be elsewhere as well is found.
    """
    if option == "--units":
        scan = scan.scaled(unit)
    else:
        part = reread(unit)
    try:
        search(part, scan)
    except NoSafeProgram:
        pass
    except InputError:
        return ""
    size = " x ".join(short(side, 3) for side in np.ptp(part.vertices, axis=0).tolist())
    return f"{option} {unit} (a part of {size} mm)"
