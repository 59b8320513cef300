"""The points of a scan on and beside the model, with their density on each side of the model."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.localize.fine import ScanFit, View
from camgen.localize.model import Cloud, Model, find_touched_within
from camgen.model.part import IntArray
from camgen.model.pose import FloatArray

#: A point lies on the model within this many standard deviations of the noise.
_SIGMAS = 4.0
#: It lies on the model within this share of the model's size, whatever the noise.
_LEAST_WITHIN = 1e-3
#: Neighbours whose distance gives the density.
NEIGHBOURS = 12
#: The density of a side is this quantile of the densities at its points.
_QUANTILE = 0.25
#: A side with fewer points does not show its density. It then has this share of the median of all.
FEW_ON_SIDE, _SHARE_OF_ALL = 40, 0.3
#: The radius of a disc that usually holds points, in spacings. A spacing is the distance between
#: points on a square grid of the density.
DISC = 1.4


class Evidence(Struct, frozen=True, eq=False):
    """The points of a scan under a pose. Lengths are mm, in the model's frame.

    model: the model.
    at: (N, 3), the places on the model that points touch.
    normals: (N, 3), the unit normals at these places.
    stray: (M, 3), the points off the model.
    within: the distance up to which a point lies on the model.
    density: (6,), the low usual density of points on each side of the model, 1/mm2.
    """

    model: Model
    at: FloatArray
    normals: FloatArray
    stray: FloatArray
    within: float
    density: FloatArray


def gather_evidence(model: Model, view: View, final: ScanFit) -> Evidence | None:
    """The evidence in the points of a view, None if too few of them lie on the model."""
    points = final.apply(view.points)
    within = max(_SIGMAS * final.noise, _LEAST_WITHIN * model.size)
    touch = find_touched_within(model, points, within)
    if len(touch.point) < 2 * NEIGHBOURS:
        return None
    normals = model.normals[touch.triangle]
    stray = np.delete(points, touch.point, axis=0)
    density = _measure_density(touch.at, normals)
    return Evidence(model, touch.at, normals, stray, within, density)


def find_sides(normals: FloatArray) -> IntArray:
    """The side of the model, 0 to 5, by the largest component of each of `normals` (N, 3)."""
    axis = np.abs(normals).argmax(axis=1)
    largest = np.take_along_axis(normals, axis[:, None], 1)[:, 0]
    return np.asarray(2 * axis + (largest < 0))


def _measure_density(at: FloatArray, normals: FloatArray) -> FloatArray:
    """The low usual density on each side (6,), 1/mm2, of points `at` (N, 3)."""
    distances = np.maximum(Cloud(at).find_neighbours(at, NEIGHBOURS + 1)[1][:, -1], 1e-9)
    local = NEIGHBOURS / (np.pi * distances**2)
    side = find_sides(normals)
    density = np.full(6, _SHARE_OF_ALL * float(np.median(local)))
    for k in range(6):
        if np.count_nonzero(side == k) >= FEW_ON_SIDE:
            density[k] = np.quantile(local[side == k], _QUANTILE)
    return density
