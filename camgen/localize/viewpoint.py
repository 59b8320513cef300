"""The points of a scan on and beside the model, and the places on it that the scan should show.

The direction from which the part was scanned shows which places these are.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.geometry.vectors import normalize
from camgen.localize.fine import ScanFit, View
from camgen.localize.groups import pick_rows
from camgen.localize.model import Cloud, Model, find_touched_within
from camgen.localize.rims import find_rims
from camgen.localize.sight import (
    SeenPlaces,
    estimate_eye,
    find_seen,
    find_shown,
    make_far_eyes,
    select_above,
    spread_directions,
)
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray

# The points on and beside the model, with their density on each side of it.

#: A point lies on the model within this many standard deviations of the noise.
_SIGMAS = 4.0
#: It lies on the model within this share of the model's size, whatever the noise.
_LEAST_WITHIN = 1e-3
#: Neighbours whose distance gives the density.
_NEIGHBOURS = 12
#: The density of a side is this quantile of the densities at its points.
_QUANTILE = 0.25
#: A side with fewer points does not show its density. It then has this share of the median of all.
_FEW_ON_SIDE, _SHARE_OF_ALL = 40, 0.3
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
    if len(touch.point) < 2 * _NEIGHBOURS:
        return None
    normals = model.normals[touch.triangle]
    stray = np.delete(points, touch.point, axis=0)
    return Evidence(model, touch.at, normals, stray, within, _measure_density(touch.at, normals))


def find_sides(normals: FloatArray) -> IntArray:
    """The side of the model, 0 to 5, by the largest component of each of `normals` (N, 3)."""
    axis = np.abs(normals).argmax(axis=1)
    largest = np.take_along_axis(normals, axis[:, None], 1)[:, 0]
    return np.asarray(2 * axis + (largest < 0))


def _measure_density(at: FloatArray, normals: FloatArray) -> FloatArray:
    """The low usual density on each side (6,), 1/mm2, of points `at` (N, 3)."""
    distances = np.maximum(Cloud(at).find_neighbours(at, _NEIGHBOURS + 1)[1][:, -1], 1e-9)
    local = _NEIGHBOURS / (np.pi * distances**2)
    side = find_sides(normals)
    density = np.full(6, _SHARE_OF_ALL * float(np.median(local)))
    for k in range(6):
        if np.count_nonzero(side == k) >= _FEW_ON_SIDE:
            density[k] = np.quantile(local[side == k], _QUANTILE)
    return density


# The direction of sight.

#: The cosine between a face and the line of sight. Points are expected above the first, and
#: possible above the second.
_FACING, _STEEPEST = 0.3, 0.1
#: Places by which the directions of sight are chosen.
_PLACES = 800
#: There were several scanners if one direction misses more than this share of the seen places.
_MISSED = 0.12
#: A direction is one of several if this share of its sight was seen.
_SHOWN = 0.75
#: This share of several directions must see a place that is expected.
_OPEN = 0.3
#: This share of the eyes that agree about as well must see a place that is expected.
_MOST_ALIKE = 0.9
#: The angle about a known and about an estimated direction, rad. All directions within it must see
#: a place that is expected.
_NEAR_KNOWN, _NEAR_ESTIMATED = 0.03, 0.15


class Sight(Struct, frozen=True, eq=False):
    """The places from which the part may have been seen.

    eyes: (D, 3) in the model's frame, mm.
    share: 0..1, the share of the eyes that must see a place for it to be expected.
    facing: the cosine between a face and the line of sight above which the face is seen.
    """

    eyes: FloatArray
    share: float
    facing: float = _FACING

    def expects(self, model: Model, places: FloatArray, normals: FloatArray) -> BoolArray:
        """Whether the scan should show each of `places` (N, 3) on the model: (N,)."""
        if not len(places):
            return np.zeros(0, dtype=bool)
        return find_shown(model, places, normals, self.eyes, self.facing, self.share)


def find_sight(evidence: Evidence, view: View, final: ScanFit) -> Sight:
    """The place of the scanner, as it is known or follows from the points."""
    model = evidence.model
    if view.eye is not None:
        return Sight(_make_ring(final.apply(view.eye), model, _NEAR_KNOWN), 1.0)
    clear = _find_clear(evidence)
    at, faces = evidence.at[clear], evidence.normals[clear]
    places, normals = pick_rows(model.samples, _PLACES), pick_rows(model.sample_normals, _PLACES)
    hit = _find_hit(evidence, at, faces, places, normals)
    up = None if view.up is None else final.rotation @ view.up
    likely = _fit_direction(at, faces)
    estimate = estimate_eye(model, SeenPlaces(places, normals, hit), _STEEPEST, up, likely)
    if estimate.share >= 1 - _MISSED:
        near = _make_ring(estimate.eye, model, _NEAR_ESTIMATED)
        return Sight(np.vstack([near, estimate.alike]), _MOST_ALIKE, _STEEPEST)
    eyes = make_far_eyes(model, select_above(spread_directions(), up))
    seen = find_seen(model, places, normals, eyes, _FACING)
    shown = (seen & hit).sum(axis=1) >= _SHOWN * np.maximum(seen.sum(axis=1), 1)
    return Sight(np.vstack([estimate.eye[None], eyes[shown]]), _OPEN)


def _find_hit(
    evidence: Evidence, at: FloatArray, faces: FloatArray, places: FloatArray, normals: FloatArray
) -> BoolArray:
    """Whether each of `places` (N, 3) has a point `at` (M, 3) of its side beside it: (N,)."""
    point_side, place_side = find_sides(faces), find_sides(normals)
    hit = np.zeros(len(places), dtype=bool)
    for k in np.flatnonzero(np.bincount(point_side, minlength=6) >= _FEW_ON_SIDE):
        on_side = place_side == k
        _, distances = Cloud(at[point_side == k]).find_nearest(places[on_side])
        hit[on_side] = distances < DISC / np.sqrt(evidence.density[k])
    return hit


def _fit_direction(at: FloatArray, normals: FloatArray) -> FloatArray | None:
    """The unit direction (3,) of a single scanner, None if there are too few points `at` (N, 3).

    The density of points on a face is in proportion to the cosine between its normal and the
    direction. The direction is fitted to the densities by least squares.
    """
    if len(at) <= _NEIGHBOURS:
        return None
    distances = np.maximum(Cloud(at).find_neighbours(at, _NEIGHBOURS + 1)[1][:, -1], 1e-9)
    # The area that a point stands for is in proportion to the squared distance of its neighbours.
    weighted = normals * (distances**2)[:, None]
    direction = np.linalg.pinv(weighted.T @ normals, rcond=1e-3) @ normals.sum(axis=0)
    length = float(np.linalg.norm(direction))
    return np.asarray(direction / length) if length else None


def _find_clear(evidence: Evidence) -> BoolArray:
    """Whether each point is so far from the rims that noise does not put it on another face."""
    rims = find_rims(evidence.model)
    if not len(rims.places):
        return np.ones(len(evidence.at), dtype=bool)
    gap = 2 * evidence.within + rims.length / len(rims.places)
    return np.asarray(Cloud(rims.places).find_nearest(evidence.at)[1] > gap)


def _make_ring(eye: FloatArray, model: Model, angle: float) -> FloatArray:
    """The eye (3,) and six eyes turned from it about the model by `angle` (rad): (7, 3)."""
    axis = eye - (model.low + model.high) / 2
    side = normalize(np.cross(axis, np.eye(3)[int(np.abs(axis).argmin())])[None])[0]
    other = np.cross(normalize(axis[None])[0], side)
    turns = np.arange(6) * np.pi / 3
    ring = np.outer(np.cos(turns), side) + np.outer(np.sin(turns), other)
    shift = np.tan(angle) * float(np.linalg.norm(axis))
    return np.asarray(np.vstack([eye, eye + shift * ring]))
