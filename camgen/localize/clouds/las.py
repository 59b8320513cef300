"""LAS (ASPRS LAS 1.0 to 1.4): points as scaled whole numbers. Needs the extra `scan`.

The unit is that of the coordinate system: keys 3076 and 4099 of its GeoTIFF keys, or UNIT of its
WKT. LAZ, the packed form, is refused: its decompressors end the process on damaged files.
"""

from __future__ import annotations

import re
import struct
from io import BytesIO
from typing import Any

import numpy as np

from camgen.localize.clouds.cloud import AGAIN, FileCloud
from camgen.model.errors import InputError, make_one_line
from camgen.model.part import Note
from camgen.model.text import counted
from camgen.read.units import MM

#: Units of length by their EPSG codes.
_CODES = {9001: "m", 9002: "ft", 9003: "us-ft"}
_LENGTH_KEYS = (3076, 4099)
_MODEL_KEY, _GEOGRAPHIC = 1024, 2
_WKT_UNIT = re.compile(r"\b(?:LENGTH)?UNIT\s*\[\s*\"[^\"]*\"\s*,\s*([0-9.eE+-]+)")
_WKT_DEGREES = re.compile(r"\s*(?:GEOGCS|GEOGCRS|GEODCRS)\b")
#: Factors of WKT agree with a unit to this share.
_SAME_FACTOR = 1e-7
#: Bytes of the head of a record before the points.
_LEAST_RECORD = 54
#: The errors of laspy for damaged files, beside its own.
_STUMBLES = (ValueError, LookupError, ArithmeticError, TypeError, AttributeError, OSError, EOFError)


def read_las(name: str, data: bytes) -> FileCloud:
    """The points of a LAS file. Raises InputError if it cannot be read."""
    try:
        import laspy  # noqa: PLC0415 (an extra)
    except ImportError as error:
        raise InputError(
            name,
            "LAS needs the package laspy",
            remedy="pip install '.[scan]' in the folder of camgen, or export it as PLY",
        ) from error
    try:
        with np.errstate(all="ignore"):
            _check_records(data)
            header = laspy.LasHeader.read_from(BytesIO(data))
            if header.are_points_compressed:
                raise InputError(name, "is packed (LAZ)", remedy="export it as LAS")
            _check_points(header, len(data))
            cloud = laspy.read(BytesIO(data))
            points = np.column_stack([cloud.x, cloud.y, cloud.z]).astype(np.float64)
            withheld = np.asarray(cloud.withheld, bool)
    except (laspy.LaspyException, struct.error, *_STUMBLES) as error:
        why = make_one_line(str(error))[:100].strip() or type(error).__name__
        raise InputError(name, f"is damaged or not a LAS file: {why}", remedy=AGAIN) from error
    notes = []
    if withheld.any():
        what = counted(int(np.count_nonzero(withheld)), "point was", "points were")
        notes.append(Note("repaired", f"{what} left out", "the file marks them as withheld"))
    unit = _find_unit(name, [*header.vlrs, *(header.evlrs or ())])
    source = "its coordinate system" if unit else "LAS without a coordinate system is mostly in m"
    return FileCloud(points[~withheld], tuple(notes), None, unit, "" if unit else "m", source)


def _check_records(data: bytes) -> None:
    """Raises ValueError if the file is too short for its records: laspy makes up the rest."""
    minor, records = data[25:26], struct.unpack_from("<I", data, 100)[0]
    extended = struct.unpack_from("<I", data, 243)[0] if minor == b"\x04" else 0
    if _LEAST_RECORD * (records + extended) > len(data):
        raise ValueError(f"it claims {records + extended:,} records before and after its points")


def _check_points(header: Any, size: int) -> None:
    """Raises ValueError if the file is too short for its points: laspy allocates them first."""
    if header.offset_to_point_data + header.point_count * header.point_format.size > size:
        raise ValueError(f"it claims {header.point_count:,} points and ends before the last")


def _find_unit(name: str, records: list[Any]) -> str:
    """The unit that the coordinate system states; "" if it states none.

    Raises InputError for degrees, and for heights in another unit.
    """
    keys: dict[int, int] = {}
    texts: list[str] = []
    for record in records:
        for key in getattr(record, "geo_keys", ()):
            keys[key.id] = key.value_offset
        if hasattr(record, "string"):
            texts.append(record.string)
    if keys.get(_MODEL_KEY) == _GEOGRAPHIC or any(map(_WKT_DEGREES.match, texts)):
        raise InputError(
            name,
            "its coordinates are longitude and latitude",
            remedy="export it in a projected coordinate system",
        )
    units = {_CODES.get(keys.get(key, 0), "") for key in _LENGTH_KEYS}
    for text in texts:
        units.update(map(_name_factor, _WKT_UNIT.findall(text)))
    units.discard("")
    if len(units) > 1:
        raise InputError(
            name,
            f"its coordinates are in different units: {' and '.join(sorted(units))}",
            remedy="export it with heights in the unit of x and y",
        )
    return units.pop() if units else ""


def _name_factor(text: str) -> str:
    """The unit by its length in metres; "" for others, as degrees."""
    try:
        mm = 1000 * float(text)
    except ValueError:
        return ""
    return next((unit for unit in _CODES.values() if abs(mm / MM[unit] - 1) < _SAME_FACTOR), "")
