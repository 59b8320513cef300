"""The edges at which faces of the model end, and whether the scan ends there too.

If the scan shows a larger part, it runs on beyond them.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct

from camgen.geometry.vectors import multiply_rows, normalize
from camgen.localize.doubt import compute_noise_limit
from camgen.localize.fine import ScanFit
from camgen.localize.groups import pack_cells
from camgen.localize.model import Cloud, Model, find_touched_within
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray

#: Two faces end at the edge between them if they differ by more than this angle, rad. Triangles of
#: a curved face differ by less.
_TURNED = math.radians(10)
#: Number of places along the rims, and maximum number of points that are compared with them.
_PLACES, _POINTS = 2000, 50_000
#: If fewer rims than this share of all are seen, they say nothing about the part.
_FEW_RIMS = 0.01
#: A surface has a point within this many medians of the distance between neighbouring points, at
#: 99 of 100 places if the points are spread by chance.
_SPACINGS = 2.5
#: Corners of triangles are the same corner if they are in the same step of a grid with this many
#: steps along the size of the model.
_SAME = 2**20


class Rims(Struct, frozen=True, eq=False):
    """Places spread evenly along the edges at which faces end. An edge is a rim of both its faces.

    places: (R, 3), mm.
    normals: (R, 3), unit normals of the face at the places.
    out: (R, 3), unit directions in the plane of the face, away from it.
    length: length of all rims, mm.
    """

    places: FloatArray
    normals: FloatArray
    out: FloatArray
    length: float


def find_rims(model: Model, count: int = _PLACES) -> Rims:
    """The rims of a model, at `count` places; at no place if there is no rim.

    An edge without exactly one face on each side is not a rim. It may be a seam between triangles
    that do not share their corners, at which the surface does not end.
    """
    begin, end, owner, neighbour = _find_shared_edges(model)
    normals, other = model.normals[owner], model.normals[neighbour]
    out = normalize(np.cross(end - begin, normals))
    sharp = (multiply_rows(normals, other) < math.cos(_TURNED)) & (multiply_rows(out, other) > 0)
    begin, end, normals, out = begin[sharp], end[sharp], normals[sharp], out[sharp]
    if not len(begin):
        return Rims(begin, normals, out, 0.0)
    lengths = np.linalg.norm(end - begin, axis=1)
    until = np.cumsum(lengths)
    at = (np.arange(count) + 0.5) / count * until[-1]
    edge = np.searchsorted(until, at).clip(max=len(until) - 1)
    along = 1 - (until[edge] - at) / lengths[edge]
    places = begin[edge] + along[:, None] * (end - begin)[edge]
    return Rims(places, normals[edge], out[edge], float(until[-1]))


def _find_shared_edges(model: Model) -> tuple[FloatArray, FloatArray, IntArray, IntArray]:
    """The edges that two triangles share, once for each of the two.

    Returns where each edge begins and ends (E, 3), and the indices of its triangle and of the
    triangle on the other side (E,).
    """
    corners = model.tree.corners
    cells = np.rint((corners - model.low) * (_SAME / model.size)).astype(np.int64)
    corner = np.unique(pack_cells(cells), return_inverse=True)[1].reshape(-1, 3)
    start, stop = corner.ravel(), np.roll(corner, -1, axis=1).ravel()
    count = int(corner.max()) + 1
    keys, first, times = np.unique(start * count + stop, return_index=True, return_counts=True)
    reverse = stop[first] * count + start[first]
    back = np.searchsorted(keys, reverse).clip(max=len(keys) - 1)
    is_shared = (keys[back] == reverse) & (times == 1) & (times[back] == 1)
    edge, other = first[is_shared], first[back[is_shared]]
    begin, end = corners.reshape(-1, 3), np.roll(corners, -1, axis=1).reshape(-1, 3)
    return begin[edge], end[edge], edge // 3, other // 3


def measure_run_on(model: Model, points: FloatArray, final: ScanFit) -> float:
    """The share of the rims seen beyond which the scan runs on in the plane of the face, 0..1.

    It is 0 if the part stands alone, and more if the model only fits into a larger part, or if the
    part is flush with a thing beside it.
    """
    rims, at = find_rims(model), final.apply(points[:_POINTS])
    cloud, noise = Cloud(at), compute_noise_limit(model, final)
    spacing = float(np.median(cloud.find_neighbours(at[:1000], 2)[1][:, 1]))
    reach = max(_SPACINGS * spacing, noise)
    # At this distance from the rim, points on the other side of it are out of reach.
    clear = reach + noise
    beyond = rims.places + 2 * clear * rims.out
    # Rows at which the face goes on beyond the rim.
    continued = find_touched_within(model, beyond, clear).point

    def is_shown(places: FloatArray) -> BoolArray:
        nearest, distance = cloud.find_nearest(places)
        heights = np.abs(multiply_rows(at[nearest] - places, rims.normals))
        return np.asarray((distance <= reach) & (heights <= noise))

    seen = is_shown(rims.places - clear * rims.out)
    seen[continued] = False
    if np.count_nonzero(seen) < _FEW_RIMS * _PLACES:
        return 0.0
    return float(is_shown(beyond)[seen].mean())
