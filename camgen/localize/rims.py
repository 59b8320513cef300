"""Where the faces of the model end, and whether the scan ends there too: on a larger part it does not."""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct

from camgen.geometry.vectors import dots, unit
from camgen.localize.doubt import noise_limit
from camgen.localize.fine import ScanFit
from camgen.localize.model import Cloud, Model, candidates, find_touched
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray

#: Two faces that are turned by more than this from each other end at the edge between them, rad: less is a curve.
_TURNED = math.radians(10)
#: Places along the rims, and the points of the scan that are asked about them at most.
_PLACES, _POINTS = 2000, 50_000
#: Fewer rims than this share of all that show say nothing of the part.
_FEW_RIMS = 0.01
#: A surface has a point within so many medians of the distance between points that are next to each other: but for
#: one place in a hundred where they lie by chance.
_SPACINGS = 2.5
#: Steps of the grid, along the size of the model, by which corners of triangles are the same.
_SAME = 2**20


class Rims(Struct, frozen=True, eq=False):
    """Places (R, 3) spread evenly along the edges where faces end, mm. normals: (R, 3) of the face. out: (R, 3), unit,
    which way the face would run on. length: mm, of all. An edge is the rim of both its faces.
    """

    places: FloatArray
    normals: FloatArray
    out: FloatArray
    length: float


def find_rims(model: Model, count: int = _PLACES) -> Rims:
    """The rims of a closed surface. An edge that has not one face on each side is none: a seam of triangles that do
    not share their corners does not say that the surface ends.
    """
    begin, end, beside, owner = _half_edges(model)
    normals = model.normals[owner]
    out = unit(np.cross(end - begin, normals))
    other = model.normals[beside]
    sharp = (dots(normals, other) < math.cos(_TURNED)) & (dots(out, other) > 0)
    begin, end, normals, out = begin[sharp], end[sharp], normals[sharp], out[sharp]
    if not len(begin):
        return Rims(begin, normals, out, 0.0)
    lengths = np.linalg.norm(end - begin, axis=1)
    until = np.cumsum(lengths)
    at = (np.arange(count) + 0.5) / count * until[-1]
    of = np.searchsorted(until, at).clip(max=len(until) - 1)
    along = 1 - (until[of] - at) / lengths[of]
    return Rims(
        begin[of] + along[:, None] * (end - begin)[of], normals[of], out[of], float(until[-1])
    )


def _half_edges(model: Model) -> tuple[FloatArray, FloatArray, IntArray, IntArray]:
    """Of each edge of each triangle that has one other triangle on its other side: where it begins and ends (E, 3),
    and the indices of the other triangle and its own (E,).
    """
    corners = model.tree.corners
    cells = np.rint((corners - model.low) * (_SAME / model.size)).astype(np.int64)
    _, corner = np.unique(
        (cells[..., 0] << 42) | (cells[..., 1] << 21) | cells[..., 2], return_inverse=True
    )
    corner = corner.reshape(-1, 3)
    one, two = corner.ravel(), np.roll(corner, -1, axis=1).ravel()
    count = int(corner.max()) + 1
    keys, first, times = np.unique(one * count + two, return_index=True, return_counts=True)
    back = np.searchsorted(keys, two[first] * count + one[first]).clip(max=len(keys) - 1)
    paired = (keys[back] == two[first] * count + one[first]) & (times == 1) & (times[back] == 1)
    half, other = first[paired], first[back[paired]]
    begin, end = corners.reshape(-1, 3), np.roll(corners, -1, axis=1).reshape(-1, 3)
    return begin[half], end[half], other // 3, half // 3


def run_on(model: Model, samples: Cloud, points: FloatArray, final: ScanFit) -> float:
    """Beyond which share 0..1 of its rims that the scan shows the scan runs on, in the plane of the face that ends
    there: 0 where the part stands alone, more where it only fits into a larger one or is flush with a thing beside it.
    """
    rims, at = find_rims(model), final.apply(points[:_POINTS])
    cloud, off = Cloud(at), noise_limit(model, final)
    spacing = float(np.median(cloud.nearest(at[:1000], 2)[1][:, 1]))
    reach = max(_SPACINGS * spacing, off)
    # So far from the rim that what lies on the other side of it is out of reach.
    clear = reach + off
    beyond = rims.places + 2 * clear * rims.out
    touch = find_touched(model, candidates(model, samples, beyond, clear, 0.0), beyond)
    ends = np.ones(len(beyond), dtype=bool)
    ends[touch.point[touch.distance <= clear]] = False

    def shows(places: FloatArray) -> BoolArray:
        nearest, away = (each[:, 0] for each in cloud.nearest(places))
        return np.asarray(
            (away <= reach) & (np.abs(dots(at[nearest] - places, rims.normals)) <= off)
        )

    seen = ends & shows(rims.places - clear * rims.out)
    if np.count_nonzero(seen) < _FEW_RIMS * _PLACES:
        return 0.0
    return float(shows(beyond)[seen].mean())
