"""Where a block reference puts its block: object coordinates, scales, arrays; and when it cannot be used."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from camgen.errors import InputError
from camgen.pose import FloatArray

#: An array with more cells is a mistake or an attack.
MOST_CELLS = 3_000_000


def ocs_matrix(extrusion: tuple[float, float, float]) -> FloatArray:
    """4 x 4 from the object to the world coordinate system, by the arbitrary axis algorithm of the DXF reference."""
    z = np.array(extrusion)
    size = float(np.linalg.norm(z))
    if not 0 < size < math.inf:
        return np.eye(4)
    z /= size
    x = np.cross((0.0, 1.0, 0.0) if abs(z[0]) < 1 / 64 and abs(z[1]) < 1 / 64 else (0.0, 0.0, 1.0), z)
    x /= np.linalg.norm(x)
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1], matrix[:3, 2] = x, np.cross(z, x), z
    return matrix


def unusable(entity: Any, block: Any, a: dict[str, Any], around: tuple[str, ...]) -> str:
    """Why the reference ``entity`` to ``block`` cannot be used, "" if it can. around: blocks it stands in."""
    if block is None:
        return "its block is missing"
    if block.block_record.is_xref:
        return "an external reference, not in this file"
    if str(a.get("name")).casefold() in around:
        return "its block contains itself"
    if not (a.get("xscale", 1.0) and a.get("yscale", 1.0)):
        return "scaled to nothing"
    if entity.has_extension_dict and _clipped(entity):
        return "clipped (XCLIP), which cannot be honoured; explode it"
    return ""


def _clipped(entity: Any) -> bool:
    from ezdxf.xclip import XClip  # noqa: PLC0415 - rare

    clip = XClip(entity)
    return bool(clip.has_clipping_path and clip.is_clipping_enabled)


def cells(name: str, a: dict[str, Any], base: tuple[float, float, float]) -> Iterable[FloatArray]:
    """World from block (4 x 4) for each cell of the array of a reference with attributes ``a``.

    base: base point of the block. The array is turned with the reference but not scaled.
    """
    ocs = ocs_matrix(a["extrusion"].xyz) if "extrusion" in a else np.eye(4)
    turn = math.radians(a.get("rotation", 0.0))
    rotation = np.eye(4)
    rotation[:2, :2] = [[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]]
    # Some writers leave 0 for z in a flat drawing; heights are judged later and must not be hidden by it.
    scale = np.diag([a.get("xscale", 1.0), a.get("yscale", 1.0), a.get("zscale", 1.0) or 1.0, 1.0])
    scale[:3, 3] = scale[:3, :3] @ -np.array(base)
    columns, rows = max(1, a.get("column_count", 1)), max(1, a.get("row_count", 1))
    if columns * rows > MOST_CELLS:
        raise InputError(name, f"a block array of {columns} x {rows}", "INSERT", "explode or thin it")
    dx, dy = a.get("column_spacing", 0.0), a.get("row_spacing", 0.0)
    at = a["insert"].xyz if "insert" in a else (0.0, 0.0, 0.0)
    for row in range(rows if dy else 1):
        for column in range(columns if dx else 1):
            step = rotation[:3, :3] @ (column * dx, row * dy, 0.0)
            place = np.eye(4)
            place[:3, 3] = step + at
            yield ocs @ place @ rotation @ scale
