"""Whether the scan shows the model's shape: surface that should be seen and is not, and scan beyond the model's rims.

A part that is nearly the model (its mirror image, another length, a hole elsewhere) fits almost as well as the model
itself. A patch without points speaks against it where points are expected: the patch faces the scanner, nothing hides
it, and by the density of the points around it the chance of none there is small.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct

from camgen.geometry.vectors import dots, unit
from camgen.localize.fine import ScanFit, View
from camgen.localize.model import Cloud, Model, Touch, candidates, find_touched
from camgen.localize.rims import Rims, find_rims
from camgen.localize.sight import above, around, estimate_eye, far_eyes, look
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray

#: A point within so many standard deviations of the noise lies on the model, and within this share of its size.
_ON_MODEL, _LEAST_ON = 4.0, 1e-3
#: Points whose distances show the density, and the quantile of the densities of a side of the model that is expected.
_DENSITY_NEIGHBOURS, _DENSITY_QUANTILE = 12, 0.25
#: Fewer points on a side of the model do not show its density. It then is this share of that of all.
_FEW_ON_SIDE, _SHARE_OF_ALL = 40, 0.3
#: The radius of a disc without points that counts, in spacings (mm between points on a square grid of the density).
_EMPTY_DISC = 1.4
#: Points expected in a patch that has none.
_EXPECTED_IN_PATCH = 20.0
#: The least width of a patch, in such radii: the rows of a scanner may miss what is narrower.
_WIDTH = 2.0
#: The width of a strip along a rim in spacings, and points expected in a window of it.
_STRIP, _IN_WINDOW = 1.0, 8.0
#: Places along the rims that count the points beside them: as many as most curves have edges.
_RIM_PLACES = 4000
#: A face reaches inward from its rim by so many strips at least.
_DEEP = 1.6
#: The cosine between the normals of one face.
_ALIKE = 0.9
#: Share of the expected points up to which a strip is empty, and from which the scan runs on.
_EMPTY, _FILLED = 0.4, 0.5
#: The chance of so few points in a stretch of a strip, and points beyond a rim, that speak against the model.
_CHANCE, _FEWEST_BEYOND = 1e-6, 8
#: The cosine between a face and the line of sight from which points are expected, and the least one that shows any.
_FACING, _STEEPEST = 0.3, 0.1
#: Places by which the directions of sight are chosen.
_SIGHT_PLACES = 800
#: More of the seen places than this that one direction does not see: there were several.
_ONE_VIEW = 0.12
#: A direction counts as one of several if this share of all that is seen from it was seen. A place is expected if this
#: share of the directions sees it.
_SHOWN, _OPEN = 0.75, 0.3
#: About a known and about an estimated direction of sight, rad: a place is expected if it is seen from all of these.
_NEAR_KNOWN, _NEAR_ESTIMATED = 0.03, 0.15


class Patch(Struct, frozen=True, eq=False):
    """A place where scan and model differ. middle: (3,) mm, in the model's frame. size: mm, length and width.

    expected: points that the model lets expect there. beyond: whether the scan runs on there, beyond a rim.
    """

    middle: FloatArray
    size: tuple[float, float]
    expected: float
    beyond: bool


class _Sight(Struct, frozen=True, eq=False):
    """Eyes (D, 3) in the model's frame, and the share of them that must see a place for it to be expected."""

    eyes: FloatArray
    share: float

    def expects(self, model: Model, places: FloatArray, normals: FloatArray) -> BoolArray:
        """Which of ``places`` (N, 3) on the model, with their normals, the scan should show."""
        if not len(places):
            return np.zeros(0, dtype=bool)
        seen = look(model, places, normals, self.eyes, _FACING)
        return np.asarray(seen.mean(axis=0) >= self.share - 1e-9)


def differences(model: Model, samples: Cloud, view: View, final: ScanFit) -> list[Patch]:
    """The patches that speak against the model, those with most expected points first. ``view`` holds all points of the
    scan that may be the part.
    """
    at = final.apply(view.points)
    within = max(_ON_MODEL * final.noise, _LEAST_ON * model.size)
    touch = find_touched(model, candidates(model, samples, at, within, 0.0), at)
    near = touch.distance <= within
    on = Touch(touch.point[near], touch.at[near], touch.triangle[near], touch.distance[near])
    if len(on.point) < 2 * _DENSITY_NEIGHBOURS:
        return []
    normals = model.normals[on.triangle]
    density = _densities(on.at, normals)
    sight = _find_sight(model, on, density, view, final, within)
    patches = _empty_patches(model, on.at, normals, density, sight, within)
    off = np.delete(at, on.point, axis=0)
    patches += _along_rims(model, samples, (on.at, normals), off, density, sight, within)
    return sorted(patches, key=lambda patch: -patch.expected)


def _sides(normals: FloatArray) -> IntArray:
    """The side of the model, 0 to 5, that each of ``normals`` (N, 3) belongs to: its largest component."""
    axis = np.abs(normals).argmax(axis=1)
    return np.asarray(2 * axis + (np.take_along_axis(normals, axis[:, None], 1)[:, 0] < 0))


def _densities(at: FloatArray, normals: FloatArray) -> FloatArray:
    """The least usual density of points (6,) on each side of the model, 1/mm2."""
    count = _DENSITY_NEIGHBOURS
    distances = np.maximum(Cloud(at).nearest(at, count + 1)[1][:, -1], 1e-9)
    each = count / (np.pi * distances**2)
    side = _sides(normals)
    found = np.full(6, _SHARE_OF_ALL * float(np.median(each)))
    for k in range(6):
        if np.count_nonzero(side == k) >= _FEW_ON_SIDE:
            found[k] = np.quantile(each[side == k], _DENSITY_QUANTILE)
    return found


def _find_sight(
    model: Model, on: Touch, density: FloatArray, view: View, final: ScanFit, within: float
) -> _Sight:
    """From where the scanner saw the part, as far as that is known or follows from the points."""
    if view.eye is not None:
        return _Sight(_about(final.apply(view.eye)[None], model, _NEAR_KNOWN), 1.0)
    step = max(len(model.samples) // _SIGHT_PLACES, 1)
    places, normals = model.samples[::step], model.sample_normals[::step]
    clear = _off_rims(model, on.at, within)
    at, own = on.at[clear], _sides(model.normals[on.triangle[clear]])
    side = _sides(normals)
    hit = np.zeros(len(places), dtype=bool)
    for k in np.flatnonzero(np.bincount(own, minlength=6) >= _FEW_ON_SIDE):
        mine = side == k
        nearest = Cloud(at[own == k]).nearest(places[mine])[1][:, 0]
        hit[mine] = nearest < _EMPTY_DISC / np.sqrt(density[k])
    up = None if view.up is None else final.rotation @ view.up
    likely = _by_density(at, model.normals[on.triangle[clear]])
    best, shows = estimate_eye(model, places, normals, hit, _STEEPEST, up, likely)
    if shows >= 1 - _ONE_VIEW:
        return _Sight(_about(best[None], model, _NEAR_ESTIMATED), 1.0)
    directions = above(around(), up)
    seen = look(model, places, normals, far_eyes(model, directions), _FACING)
    shown = (seen & hit).sum(axis=1) >= _SHOWN * np.maximum(seen.sum(axis=1), 1)
    return _Sight(np.vstack([best[None], far_eyes(model, directions[shown])]), _OPEN)


def _by_density(at: FloatArray, normals: FloatArray) -> FloatArray | None:
    """The direction (3,) of one scanner by the density of its points ``at`` (N, 3), None if it does not show.

    A face with the unit normal n has a density in proportion to the cosine between n and the direction.
    """
    if len(at) <= _DENSITY_NEIGHBOURS:
        return None
    distances = np.maximum(Cloud(at).nearest(at, _DENSITY_NEIGHBOURS + 1)[1][:, -1], 1e-9)
    density = 1 / distances**2
    # Each point stands for an area of one over the density, so that faces count by their areas.
    weighted = normals / density[:, None]
    direction = np.linalg.pinv(weighted.T @ normals, rcond=1e-3) @ normals.sum(axis=0)
    length = float(np.linalg.norm(direction))
    return np.asarray(direction / length) if length else None


def _off_rims(model: Model, at: FloatArray, within: float) -> BoolArray:
    """Which places (N, 3) on the model are so far from its rims that the noise does not put them on another face."""
    rims = find_rims(model)
    if not len(rims.places):
        return np.ones(len(at), dtype=bool)
    gap = 2 * within + rims.length / len(rims.places)
    return np.asarray(Cloud(rims.places).nearest(at)[1][:, 0] > gap)


def _about(eye: FloatArray, model: Model, angle: float) -> FloatArray:
    """Eyes (7, 3): the one at ``eye`` (1, 3), and six turned about the model by ``angle`` (rad)."""
    middle = (model.low + model.high) / 2
    axis = eye[0] - middle
    first = unit(np.cross(axis, np.eye(3)[int(np.abs(axis).argmin())])[None])[0]
    second = np.cross(unit(axis[None])[0], first)
    turns = np.arange(6) * np.pi / 3
    shift = np.tan(angle) * float(np.linalg.norm(axis))
    ring = np.outer(np.cos(turns), first) + np.outer(np.sin(turns), second)
    return np.asarray(np.vstack([eye, eye + shift * ring]))


def _empty_patches(
    model: Model,
    at: FloatArray,
    normals: FloatArray,
    density: FloatArray,
    sight: _Sight,
    within: float,
) -> list[Patch]:
    """Patches of the surface that should be seen and hold no point."""
    side, own = _sides(model.sample_normals), _sides(normals)
    area = model.area / len(model.samples)
    patches: list[Patch] = []
    for k in range(6):
        mine = np.flatnonzero(side == k)
        if not len(mine):
            continue
        radius = _EMPTY_DISC / np.sqrt(density[k])
        there = np.vstack([at[own == k], _through(model, mine, at[own == k ^ 1], within)])
        distances = (
            Cloud(there).nearest(model.samples[mine])[1][:, 0]
            if len(there)
            else np.full(len(mine), np.inf)
        )
        empty = mine[distances > radius]
        empty = empty[sight.expects(model, model.samples[empty], model.sample_normals[empty])]
        for group in _groups(model.samples[empty], 2 * np.sqrt(area)):
            spots = model.samples[empty[group]]
            around_it = Cloud(spots).nearest(model.samples[mine])[1][:, 0] <= radius
            expected = float(density[k] * area * np.count_nonzero(around_it))
            patch = _patch(model.samples[mine][around_it], expected, beyond=False)
            if expected >= _EXPECTED_IN_PATCH and patch.size[1] >= _WIDTH * radius:
                patches.append(patch)
    return patches


def _through(model: Model, mine: IntArray, at: FloatArray, within: float) -> FloatArray:
    """Those of the places ``at`` (N, 3) on the opposite side that the noise does not tell from the samples ``mine``."""
    if not len(at):
        return at
    nearest = mine[Cloud(model.samples[mine]).nearest(at)[0][:, 0]]
    offset = dots(at - model.samples[nearest], model.sample_normals[nearest])
    return at[np.abs(offset) <= within]


def _groups(places: FloatArray, gap: float) -> list[IntArray]:
    """The indices of ``places`` (N, 3) in groups that are more than about ``gap`` mm apart."""
    if not len(places):
        return []
    cells = np.floor((places - places.min(axis=0)) / gap).astype(np.int64)
    unique, of = np.unique(cells, axis=0, return_inverse=True)
    of = of.reshape(-1)
    left = {tuple(cell): i for i, cell in enumerate(unique.tolist())}
    group = np.zeros(len(unique), dtype=np.int64)
    number = 0
    while left:
        border = [left.popitem()]
        while border:
            (x, y, z), i = border.pop()
            group[i] = number
            for near in [
                (x + a, y + b, z + c) for a in (-1, 0, 1) for b in (-1, 0, 1) for c in (-1, 0, 1)
            ]:
                if near in left:
                    border.append((near, left.pop(near)))
        number += 1
    return [np.flatnonzero(group[of] == k) for k in range(number)]


def _patch(places: FloatArray, expected: float, beyond: bool) -> Patch:
    """The patch that ``places`` (N, 3) cover."""
    middle = places.mean(axis=0)
    axes = np.linalg.svd(places - middle, full_matrices=False)[2]
    spans = np.ptp((places - middle) @ axes.T, axis=0)
    return Patch(
        middle, (float(spans[0]), float(spans[1]) if len(spans) > 1 else 0.0), expected, beyond
    )


def _along_rims(
    model: Model,
    samples: Cloud,
    on: tuple[FloatArray, FloatArray],
    off: FloatArray,
    density: FloatArray,
    sight: _Sight,
    within: float,
) -> list[Patch]:
    """Stretches of the rims inside of which no point is, and beyond which the scan runs on in the plane of the face.

    on: places (N, 3) of the points on the model, and the normals there. off: (M, 3), the other points.
    """
    rims = find_rims(model, _RIM_PLACES)
    if not len(rims.places):
        return []
    side = _sides(rims.normals)
    length = rims.length / len(rims.places)
    width = _STRIP / np.sqrt(density[side])
    expected = density[side] * width * length
    deep = _runs_inward(model, samples, rims, _DEEP * width, within)
    should = deep & sight.expects(
        model, rims.places - 0.5 * width[:, None] * rims.out, rims.normals
    )
    inside = _count(rims, *on, (-width, np.zeros(len(width))), within)
    gap = np.maximum(within, 0.3 * width)
    clear = _ends(model, samples, rims, gap + width, within)
    outside = _count(rims, off, None, (gap, gap + width), within)
    patches: list[Patch] = []
    for k in np.unique(side):
        mine = np.flatnonzero(side == k)
        apart = np.linalg.norm(rims.places[mine][:, None] - rims.places[mine], axis=2)
        same = rims.normals[mine] @ rims.normals[mine].T > _ALIKE
        for counts, valid, beyond in ((inside, should, False), (outside, should & clear, True)):
            half = max(_IN_WINDOW / float(density[k] * width[mine[0]]) / 2, 1.5 * length)
            window = (apart <= half) & same & valid[mine] & valid[mine][:, None]
            wanted, there = window @ expected[mine], window @ counts[mine]
            odd = there >= _FILLED * wanted if beyond else there <= _EMPTY * wanted
            odd &= valid[mine] & (wanted > 0.5 * _IN_WINDOW)
            chosen = mine[odd]
            for group in _groups(rims.places[chosen], half):
                total, seen = expected[chosen[group]].sum(), counts[chosen[group]].sum()
                speaks = seen >= _FEWEST_BEYOND if beyond else _chance(seen, total) < _CHANCE
                if speaks:
                    patches.append(_patch(rims.places[chosen[group]], float(total), beyond))
    return patches


def _chance(seen: float, expected: float) -> float:
    """The chance of at most ``seen`` points where ``expected`` are, if each falls by itself (Poisson)."""
    terms = [k * math.log(expected) - math.lgamma(k + 1) - expected for k in range(round(seen) + 1)]
    return math.fsum(math.exp(term) for term in terms)


def _runs_inward(
    model: Model, samples: Cloud, rims: Rims, depth: FloatArray, within: float
) -> BoolArray:
    """At which rims the face reaches ``depth`` (R,) mm inward: a narrow one may lie between two rows of points."""
    inward = rims.places - depth[:, None] * rims.out
    touch = find_touched(model, candidates(model, samples, inward, within, 0.0), inward)
    runs = np.zeros(len(inward), dtype=bool)
    same = dots(model.normals[touch.triangle], rims.normals[touch.point]) > _ALIKE
    runs[touch.point[same & (touch.distance <= within)]] = True
    return runs


def _ends(model: Model, samples: Cloud, rims: Rims, reach: FloatArray, within: float) -> BoolArray:
    """At which rims the model has no other surface beyond, out to ``reach`` (R,) mm."""
    clear = np.ones(len(rims.places), dtype=bool)
    for share in (0.5, 1.0):
        beyond = rims.places + share * reach[:, None] * rims.out
        touch = find_touched(model, candidates(model, samples, beyond, 2 * within, 0.0), beyond)
        clear[touch.point[touch.distance <= 2 * within]] = False
    return clear


def _count(
    rims: Rims,
    points: FloatArray,
    normals: FloatArray | None,
    limits: tuple[FloatArray, FloatArray],
    within: float,
) -> FloatArray:
    """How many of ``points`` (N, 3) lie beside each rim place (R,), between two distances (R,) beyond it.

    normals: (N, 3), of the face that each point lies on; None: a point in the plane of the rim's face counts.
    """
    count = np.zeros(len(rims.places))
    spacing = rims.length / len(rims.places)
    side = _sides(rims.normals)
    for k in np.unique(side) if len(points) else ():
        mine = np.flatnonzero(side == k)
        taken = np.zeros(len(points), dtype=bool)
        for rim in mine[Cloud(rims.places[mine]).nearest(points, min(3, len(mine)))[0]].T:
            offset = points - rims.places[rim]
            out = dots(offset, rims.out[rim])
            along = dots(offset, np.cross(rims.normals[rim], rims.out[rim]))
            fits = (
                (np.abs(dots(offset, rims.normals[rim])) <= within)
                & (np.abs(along) <= spacing)
                & (out >= limits[0][rim])
                & (out <= limits[1][rim])
                & ~taken
            )
            if normals is not None:
                fits &= np.abs(dots(normals, rims.normals[rim])) > _ALIKE
            taken |= fits
            np.add.at(count, rim[fits], 1.0)
    return count
