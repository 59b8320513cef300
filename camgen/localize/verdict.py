"""Whether the scan shows the model's shape: missing surface, and scan beyond the model's rims.

A part that is nearly the model (its mirror image, another length, a hole elsewhere) fits almost as
well as the model itself. A patch without points speaks against the model if points are expected:
the patch faces the scanner, nothing hides it, and its neighbourhood has points.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct

from camgen.geometry.vectors import measure_lengths, multiply_rows
from camgen.localize.fine import ScanFit, View
from camgen.localize.groups import group_places
from camgen.localize.model import Cloud, Model, find_touched_within
from camgen.localize.rims import Rims, find_rims
from camgen.localize.viewpoint import (
    DISC,
    Evidence,
    Sight,
    find_sides,
    find_sight,
    gather_evidence,
)
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray

#: A patch without points counts if this many points are expected in it.
_EXPECTED = 20.0
#: The width of a patch that counts, in radii of the disc. The rows of a scanner may miss a narrower
#: one.
_WIDTH = 2.0
#: The width of a strip along a rim, in spacings, and the points expected in a window of it.
_STRIP, _IN_WINDOW = 1.0, 8.0
#: A window is empty up to this share of the expected points. From the other share on it is full.
_EMPTY, _FULL = 0.4, 0.5
#: A stretch of empty windows counts if its few points have a chance below this.
_CHANCE = 1e-6
#: A stretch of full windows beyond a rim counts from this many points on.
_BEYOND = 8
#: Places along the rims. Most curves have fewer edges.
_RIM_PLACES = 4000
#: A strip counts if the face reaches inward from its rim by this many widths.
_DEEP = 1.6
#: The cosine between the normals of one face.
_ALIKE = 0.9


class Patch(Struct, frozen=True, eq=False):
    """A place at which scan and model differ.

    middle: (3,), mm, in the model's frame.
    size: length and width, mm.
    expected: the number of points that a part of the model's shape would have there.
    beyond: whether the scan runs on there, beyond a rim.
    """

    middle: FloatArray
    size: tuple[float, float]
    expected: float
    beyond: bool


def find_differences(model: Model, view: View, final: ScanFit) -> list[Patch]:
    """The patches that speak against the model, the largest first.

    view: all points of the scan that may be the part.
    """
    evidence = gather_evidence(model, view, final)
    if evidence is None:
        return []
    sight = find_sight(evidence, view, final)
    patches = _find_empty(evidence, sight) + _find_rim_patches(evidence, sight)
    return sorted(patches, key=lambda patch: -patch.expected)


def _find_empty(evidence: Evidence, sight: Sight) -> list[Patch]:
    """Patches of the surface that the scan should show and that hold no point."""
    model = evidence.model
    sample_side, point_side = find_sides(model.sample_normals), find_sides(evidence.normals)
    area = model.area / len(model.samples)
    patches: list[Patch] = []
    for k in np.unique(sample_side):
        samples = np.flatnonzero(sample_side == k)
        radius = DISC / np.sqrt(evidence.density[k])
        opposite = _see_through(evidence, samples, evidence.at[point_side == k ^ 1])
        points = np.vstack([evidence.at[point_side == k], opposite])
        empty = samples
        if len(points):
            empty = samples[Cloud(points).find_nearest(model.samples[samples])[1] > radius]
        empty = empty[sight.expects(model, model.samples[empty], model.sample_normals[empty])]
        for group in group_places(model.samples[empty], 2 * np.sqrt(area)):
            middles = Cloud(model.samples[empty[group]])
            covered = model.samples[samples]
            covered = covered[middles.find_nearest(covered)[1] <= radius]
            expected = float(evidence.density[k] * area * len(covered))
            patch = _make_patch(covered, expected, beyond=False)
            if patch.expected >= _EXPECTED and patch.size[1] >= _WIDTH * radius:
                patches.append(patch)
    return patches


def _see_through(evidence: Evidence, samples: IntArray, at: FloatArray) -> FloatArray:
    """The places `at` (N, 3) of the opposite side that noise may have put there.

    samples: the numbers of the samples on this side.
    """
    if not len(at):
        return at
    model = evidence.model
    nearest = samples[Cloud(model.samples[samples]).find_nearest(at)[0]]
    heights = multiply_rows(at - model.samples[nearest], model.sample_normals[nearest])
    return at[np.abs(heights) <= evidence.within]


def _make_patch(places: FloatArray, expected: float, beyond: bool) -> Patch:
    middle = places.mean(axis=0)
    axes = np.linalg.svd(places - middle, full_matrices=False)[2]
    length, width = [*np.ptp((places - middle) @ axes.T, axis=0).tolist(), 0.0][:2]
    return Patch(middle, (length, width), expected, beyond)


def _find_rim_patches(evidence: Evidence, sight: Sight) -> list[Patch]:
    """Stretches of the rims with an empty strip inside, or with scan beyond in the face's plane."""
    rims = find_rims(evidence.model, _RIM_PLACES)
    if not len(rims.places):
        return []
    density = evidence.density[find_sides(rims.normals)]
    width = _STRIP / np.sqrt(density)
    expected = density * width * rims.length / len(rims.places)
    gap = np.maximum(evidence.within, 0.3 * width)
    middles = rims.places - 0.5 * width[:, None] * rims.out
    shown = sight.expects(evidence.model, middles, rims.normals)
    shown &= _find_inward(evidence, rims, _DEEP * width)
    inner = _count_points(evidence, rims, evidence.at, evidence.normals, (-width, 0 * width))
    outer = _count_points(evidence, rims, evidence.stray, None, (gap, gap + width))
    ends = shown & _find_ends(evidence, rims, gap + width)
    inside = _find_stretches(rims, inner, expected, shown, beyond=False)
    return inside + _find_stretches(rims, outer, expected, ends, beyond=True)


def _find_stretches(
    rims: Rims, counts: FloatArray, expected: FloatArray, valid: BoolArray, beyond: bool
) -> list[Patch]:
    """The stretches of strips along the rims that speak against the model.

    counts, expected: (R,), the points in the strip at each rim place, and the number expected.
    valid: (R,), whether the strip says anything at each place.
    beyond: whether the strips lie beyond the rims.
    """
    side = find_sides(rims.normals)
    patches: list[Patch] = []
    for k in np.unique(side[valid]):
        rows = np.flatnonzero((side == k) & valid)
        places, normals = rims.places[rows], rims.normals[rows]
        half = max(_IN_WINDOW / float(expected[rows[0]]) / 2, 1.5) * _mm_per_place(rims)
        distances = measure_lengths(places[:, None] - places)
        window = (distances <= half) & (normals @ normals.T > _ALIKE)
        wanted, held = window @ expected[rows], window @ counts[rows]
        is_odd = held >= _FULL * wanted if beyond else held <= _EMPTY * wanted
        odd = np.flatnonzero(is_odd & (wanted > 0.5 * _IN_WINDOW))
        for group in group_places(places[odd], half):
            stretch = odd[group]
            total = float(expected[rows[stretch]].sum())
            seen = float(counts[rows[stretch]].sum())
            if seen >= _BEYOND if beyond else _compute_chance(seen, total) < _CHANCE:
                patches.append(_make_patch(places[stretch], total, beyond))
    return patches


def _mm_per_place(rims: Rims) -> float:
    return rims.length / len(rims.places)


def _compute_chance(seen: float, expected: float) -> float:
    """The chance of at most `seen` points among `expected` independent ones (Poisson)."""
    terms = [k * math.log(expected) - math.lgamma(k + 1) - expected for k in range(round(seen) + 1)]
    return math.fsum(map(math.exp, terms))


def _find_inward(evidence: Evidence, rims: Rims, depth: FloatArray) -> BoolArray:
    """Whether the face at each rim place reaches inward by `depth` (R,) mm: (R,)."""
    inward = rims.places - depth[:, None] * rims.out
    touch = find_touched_within(evidence.model, inward, evidence.within)
    normals = evidence.model.normals[touch.triangle]
    is_same_face = multiply_rows(normals, rims.normals[touch.point]) > _ALIKE
    return np.isin(np.arange(len(inward)), touch.point[is_same_face])


def _find_ends(evidence: Evidence, rims: Rims, reach: FloatArray) -> BoolArray:
    """Whether the model has no surface beyond each rim place, out to `reach` (R,) mm: (R,)."""
    ends = np.ones(len(rims.places), dtype=bool)
    for share in (0.5, 1.0):
        beyond = rims.places + share * reach[:, None] * rims.out
        ends[find_touched_within(evidence.model, beyond, 2 * evidence.within).point] = False
    return ends


def _count_points(
    evidence: Evidence,
    rims: Rims,
    points: FloatArray,
    normals: FloatArray | None,
    limits: tuple[FloatArray, FloatArray],
) -> FloatArray:
    """The number of `points` (N, 3) beside each rim place, between two distances beyond it: (R,).

    normals: (N, 3), of the face under each point; None if the plane of the rim's face decides.
    limits: (R,) each, mm. Negative distances are inward.
    """
    counts = np.zeros(len(rims.places))
    side = find_sides(rims.normals)
    for k in np.unique(side) if len(points) else ():
        places = np.flatnonzero(side == k)
        counted = np.zeros(len(points), dtype=bool)
        nearest = Cloud(rims.places[places]).find_neighbours(points, min(3, len(places)))[0]
        for rim in places[nearest].T:
            offsets = points - rims.places[rim]
            out = multiply_rows(offsets, rims.out[rim])
            along = multiply_rows(offsets, np.cross(rims.normals[rim], rims.out[rim]))
            fits = (
                (np.abs(multiply_rows(offsets, rims.normals[rim])) <= evidence.within)
                & (np.abs(along) <= _mm_per_place(rims))
                & (out >= limits[0][rim])
                & (out <= limits[1][rim])
                & ~counted
            )
            if normals is not None:
                fits &= np.abs(multiply_rows(normals, rims.normals[rim])) > _ALIKE
            counted |= fits
            np.add.at(counts, rim[fits], 1.0)
    return counts
