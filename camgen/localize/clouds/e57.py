"""E57 (ASTM E2807): scans with a pose each, in metres. Needs the extra `scan`."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from camgen.localize.clouds.cloud import AGAIN, FileCloud, StationScan, join_scans
from camgen.model.errors import InputError, make_one_line
from camgen.model.pose import FloatArray

_PLACES = ("cartesianX", "cartesianY", "cartesianZ")
#: 0 for a point that was measured, 1 for a direction only, 2 for nothing (E2807, table 11).
_STATE = "cartesianInvalidState"
#: A point has at least one bit for each of its three coordinates.
_LEAST_BITS = 3
#: A quaternion turns if its length is one to this.
_UNIT_LENGTH = 1e-3


def read_e57(name: str, data: bytes) -> FileCloud:
    """The points of all scans in the frame of the file. Raises InputError if it cannot be read."""
    try:
        import pye57  # noqa: PLC0415 (an extra)
    except ImportError as error:
        raise InputError(
            name,
            "E57 needs the package pye57",
            remedy="pip install '.[scan]' in the folder of camgen, or export it as PLY or PTX",
        ) from error
    with TemporaryDirectory() as folder:
        path = Path(folder) / "scan.e57"
        path.write_bytes(data)
        try:
            with pye57.E57(str(path)) as file:
                limit = 8 * len(data) // _LEAST_BITS
                scans = [_read_scan(file, index, limit) for index in range(file.scan_count)]
        except (pye57.libe57.E57Exception, ValueError, OSError) as error:
            why = make_one_line(str(error).partition("\n")[0])[:100].strip()
            raise InputError(name, f"is damaged or not an E57 file: {why}", remedy=AGAIN) from error
    if not scans:
        raise InputError(name, "has no scan", remedy=AGAIN)
    return join_scans(
        scans,
        ("point was", "points were"),
        ("the scanner marks them as invalid", "each by its own pose"),
        "E57 is in m by its standard (ASTM E2807)",
    )


def _read_scan(file: Any, index: int, limit: int) -> StationScan:
    header = file.get_header(index)
    for field in _PLACES:
        if field not in header.point_fields:
            raise ValueError(f"scan {index + 1} has no {field}, as one in spherical coordinates")
    if header.point_count > limit:
        raise ValueError(f"scan {index + 1} claims {header.point_count:,} points")
    state = [_STATE] if _STATE in header.point_fields else []
    columns, buffers = file.make_buffers([*_PLACES, *state], header.point_count)
    header.points.reader(buffers).read()
    valid = np.ones(header.point_count, bool)
    if state:
        valid = columns[_STATE] == 0
    points = np.column_stack([columns[place][valid] for place in _PLACES]).astype(np.float64)
    invalid = int(np.count_nonzero(~valid))
    if not header.has_pose():
        return StationScan(points, invalid, None)
    turn, place = _read_pose(header.node["pose"], index)
    moved = not np.array_equal(turn, np.eye(3)) or place.any()
    return StationScan(points @ turn.T + place, invalid, place if moved else None)


def _read_pose(pose: Any, index: int) -> tuple[FloatArray, FloatArray]:
    """(3, 3) and (3,) from the frame of a scan to that of the file."""
    turn, place = np.eye(3), np.zeros(3)
    if pose.isDefined("rotation"):
        quaternion = np.array([pose["rotation"][key].value() for key in "wxyz"])
        if not abs(np.linalg.norm(quaternion) - 1) < _UNIT_LENGTH:
            raise ValueError(f"the rotation of scan {index + 1} is not a unit quaternion")
        w, x, y, z = quaternion / np.linalg.norm(quaternion)
        turn = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )
    if pose.isDefined("translation"):
        place = np.array([pose["translation"][key].value() for key in "xyz"])
        if not np.isfinite(place).all():
            raise ValueError(f"the translation of scan {index + 1} is not a place")
    return turn, place
