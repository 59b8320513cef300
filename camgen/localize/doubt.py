"""What speaks against a pose: others that fit as well, motions that the scan does not hold, and how much was seen."""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct

from camgen.geometry.vectors import dots
from camgen.localize.coarse import Poses, turn_poses
from camgen.localize.fine import ScanFit, View, cost, costs, draw, is_worse, losses, on, refine
from camgen.localize.model import Cloud, Model, candidates, find_touched
from camgen.localize.sight import SeenPlaces, around, estimate_eye, far_eyes, look
from camgen.localize.starts import corners
from camgen.model.part import BoolArray
from camgen.model.pose import FloatArray, Pose, angle_between, frozen, to_vec3

#: Poses that put a corner of the model's box farther apart than this part of its size are different ones.
_DIFFERENT_SHARE = 0.01
#: Two sides of a part that are nearer than this part of its size are one to the search.
_THIN = 0.06
#: Fits whose other sides are tried, and shifts of each.
_BESIDE, _SHIFTS = 3, 6
#: Faces have one direction where the cosine is more than this; one that less than this share of the points lies on does
#: not count, nor one in the plane of two others (least singular value).
_ALIKE, _FEW_NORMALS, _FLAT = 0.95, 0.03, 0.3
#: A motion of which the points say less than this part of what they could is held weakly.
_WEAK = 0.003
#: How far a motion is tried that may be free: a corner of the box moves by this part of its size.
_NUDGE = 0.05
#: Samples that say how much of the model was seen, and the cosine between a face and the view that still shows it.
_SEEN_SAMPLES, _FACING = 4000, 0.3
#: Samples by which the place of the scanner is estimated, and the length of the mean normal of what was seen above
#: which one side of the part was.
_VIEW_SAMPLES, _ONE_SIDED = 800, 0.2
#: The cosine between two normals below which they belong to opposite sides.
_OPPOSITE = -0.5
#: Two poses are as good as one where no place of the surface is farther from the other's than this many standard
#: deviations of the scan's noise, or this part of the model's size, by which triangles may leave the part.
_BEYOND_NOISE, _BEYOND_SIZE = 3.0, 2e-4
#: By how much more a pose may cost that is drawn onto another one.
_TWIN_COST = 0.004
#: Samples, and corners of triangles, whose distance is asked for that.
_SPOTS = 1000
#: Two poses are told apart by a start that lies at most this part of the way from the one to the other.
_DECIDED = 0.4
#: A start says where the part stands if no corner of its box is farther from there than this part of its size.
_NEAR = 0.2


class Rival(Struct, frozen=True, eq=False):
    """Another pose of the model in the scan. turn: deg from the chosen one; shift: mm, what its box's middle moves;
    cost: by how much worse it fits, 0..1. off: mm, how far its surface is from that of the chosen one at most.
    """

    base_from_work: Pose
    turn: float
    shift: float
    cost: float
    off: float


class SeenShare(Struct, frozen=True):
    """Shares 0..1 of the model's surface that have points of the scan: of all, and of what faces as those points do."""

    all: float
    near: float


class Alternatives(Struct, frozen=True, eq=False):
    """Fits that were tried.

    fits, costs: each fit with its cost, 0..1.
    gate: distance of the costs, mm.
    same: difference of two costs up to which fits are equally good.
    """

    fits: list[ScanFit]
    costs: list[float]
    gate: float
    same: float


def best_of(
    model: Model, samples: Cloud, view: View, others: Alternatives, final: ScanFit
) -> list[ScanFit]:
    """The different fits that are not worse than the best by more than chance.

    view: more points than chose the fits.
    final: any of the fits, as the measure of difference.
    """
    least, limit = min(others.costs), _limit(model, final)
    kept: list[ScanFit] = []
    order = sorted(range(len(others.fits)), key=others.costs.__getitem__)
    for fit in (others.fits[k] for k in order if others.costs[k] <= least + others.same):
        if all(_off(model, fit, known) > limit for known in kept):
            kept.append(fit)
    each = [losses(model, samples, view, fit, others.gate) for fit in kept]
    best = min(each, key=lambda loss: float(loss.sum()))
    return [fit for fit, loss in zip(kept, each, strict=True) if not is_worse(loss, best)]


def rivals(
    model: Model,
    samples: Cloud,
    points: FloatArray,
    final: ScanFit,
    others: Alternatives,
    middle: FloatArray,
) -> tuple[tuple[Rival, ...], Rival | None]:
    """Other poses that fit as well as the best, by turn, and the best of those that do not. ``points`` refine those
    of the first whose surface does not lie on that of the best.
    """
    same = others.same
    best, limit = min(others.costs), _limit(model, final)
    least = losses(model, samples, View(points), final, others.gate)
    apart = [
        (fit, c - best)
        for fit, c in zip(others.fits, others.costs, strict=True)
        if _off(model, fit, final) > limit
    ]
    equal: list[tuple[ScanFit, float]] = []
    for fit, worse in sorted((pair for pair in apart if pair[1] <= same), key=lambda pair: pair[1]):
        if all(_off(model, fit, known) > limit for known, _ in equal):
            equal.append((fit, worse))
    told = []
    for fit, worse in equal:
        compared, off = _compare(model, samples, points, final, fit, others.gate)
        if off > noise_limit(model, final) and is_worse(
            losses(model, samples, View(points), compared, others.gate), least
        ):
            continue
        told.append(_rival(model, compared, final, worse, middle, off))
    told.sort(key=lambda rival: (round(rival.turn, 1), rival.shift))
    less = min(((f, w) for f, w in apart if w > same), key=lambda pair: pair[1], default=None)
    return tuple(told), None if less is None else _rival(
        model, less[0], final, less[1], middle, math.inf
    )


def _compare(
    model: Model,
    samples: Cloud,
    points: FloatArray,
    final: ScanFit,
    fit: ScanFit,
    gate: float,
) -> tuple[ScanFit, float]:
    """The fit and its distance from the best surface, mm. A fit that is elsewhere is refined with more points."""
    off = surface_off(model, samples, final, fit)
    if off > noise_limit(model, final):
        fit = refine(model, samples, points, (fit.rotation, fit.origin), gate)
        off = surface_off(model, samples, final, fit)
    if off > noise_limit(model, final):
        off = min(off, _twin_off(model, samples, points, final, fit, gate))
    return fit, off


def _twin_off(
    model: Model, samples: Cloud, points: FloatArray, final: ScanFit, fit: ScanFit, gate: float
) -> float:
    """How far the surface is from that of the best pose where the fit is drawn onto that, mm; inf if it then is another
    pose or fits the points worse. A motion that the points hold badly puts each of two alike elsewhere.
    """
    limit = _limit(model, final)
    best = (model.samples[:: max(len(model.samples) // _SPOTS, 1)] - final.origin) @ final.rotation
    twin = draw(model, samples, best, fit, limit)
    there = [cost(model, samples, View(points), each, gate) for each in (twin, final)]
    if _off(model, twin, fit) > limit or there[0] > there[1] + _TWIN_COST:
        return math.inf
    return surface_off(model, samples, final, twin)


def noise_limit(model: Model, final: ScanFit) -> float:
    """How far apart two surfaces may be that the noise of the scan does not tell apart, mm."""
    return max(_BEYOND_NOISE * final.noise, _BEYOND_SIZE * model.size)


def surface_off(model: Model, samples: Cloud, a: ScanFit, b: ScanFit) -> float:
    """How far the model's surface at the one pose is from that at the other at most, mm, at ``_SPOTS`` samples and
    corners of triangles each.
    """
    every = model.tree.corners.reshape(-1, 3)
    spots = np.vstack([some[:: max(len(some) // _SPOTS, 1)] for some in (model.samples, every)])
    there = a.apply((spots - b.origin) @ b.rotation)
    touch = find_touched(
        model,
        candidates(model, samples, there, 2 * model.size + _distance(model, there), 0.0),
        there,
    )
    return float(touch.distance.max())


def _distance(model: Model, places: FloatArray) -> float:
    """How far the farthest of the places is from the middle of the model's box, mm."""
    return float(np.linalg.norm(places - (model.low + model.high) / 2, axis=1).max())


def decides(model: Model, start: Pose, found: Pose, other: Pose) -> bool:
    """Whether a start is plainly nearer to the pose that was found than to the other, along the way between them: the
    corners of the model's box say where each is.
    """
    begin, here, there = (_put_corners(model, pose).ravel() for pose in (start, found, other))
    way = there - here
    return abs(float(way @ (begin - here))) < _DECIDED * float(way @ way)


def is_near(model: Model, start: Pose, found: Pose) -> bool:
    """Whether a start says that the part stands where it was found."""
    off = _put_corners(model, start) - _put_corners(model, found)
    return float(np.linalg.norm(off, axis=1).max()) < _NEAR * model.size


def _put_corners(model: Model, pose: Pose) -> FloatArray:
    """The corners of the model's box (8, 3) where the pose puts them."""
    return np.asarray(corners(model) @ np.asarray(pose.rotation).T + np.asarray(pose.origin))


def beside(model: Model, samples: Cloud, few: FloatArray, fits: list[ScanFit]) -> Poses:
    """Poses by which a thin part may have been missed: its other side lies on the points, within the search's reach.

    The best different fits, moved by the thickness, to and fro, along each of the up to three directions that most of
    the faces have on which points lie, and along several of them together: those that put the points nearest to it.
    None if the part is not thin.
    """
    if not thin(model):
        return Poses(np.zeros((0, 3, 3)), np.zeros((0, 3)))
    thick = 2 * model.volume / model.area
    turns, origins = [], []
    for fit in _best_different(model, samples, few, fits):
        axes = _axes(model.sample_normals[samples.nearest(fit.apply(few))[0][:, 0]])
        signs = np.stack(np.meshgrid(*[(-1, 0, 1)] * len(axes), indexing="ij"), axis=-1).reshape(
            -1, len(axes)
        )
        shifts = (
            thick
            * np.linalg.lstsq(axes, signs[signs.any(axis=1)].T.astype(np.float64), rcond=None)[0].T
        )
        away = np.stack([samples.nearest(fit.apply(few) + shift)[1][:, 0] for shift in shifts])
        best = np.argsort(np.minimum(away, thick).mean(axis=1), kind="stable")[:_SHIFTS]
        turns.append(np.broadcast_to(fit.rotation, (len(best), 3, 3)))
        origins.append(fit.origin + shifts[best])
    return Poses(np.concatenate(turns), np.concatenate(origins))


def _best_different(
    model: Model, samples: Cloud, few: FloatArray, fits: list[ScanFit]
) -> list[ScanFit]:
    """The best fits of which none is near another one."""
    kept: list[ScanFit] = []
    worth = costs(model, samples, View(few), fits, 0.01 * model.size)
    for fit in (fits[k] for k in sorted(range(len(fits)), key=worth.__getitem__)):
        if all(_off(model, fit, known) > 0.5 * _DIFFERENT_SHARE * model.size for known in kept):
            kept.append(fit)
        if len(kept) == _BESIDE:
            break
    return kept


def _axes(normals: FloatArray) -> FloatArray:
    """Up to three directions (1 to 3, 3), not in one plane, that most of the normals (N, 3) have, to either side."""
    found = np.zeros((0, 3))
    left = normals
    while len(found) < 3 and len(left) >= max(_FEW_NORMALS * len(normals), 1):
        alike = np.abs(left @ left[:: max(len(left) // 100, 1)].T) > _ALIKE
        best = alike[:, int(alike.sum(axis=0).argmax())]
        axis = np.linalg.eigh(left[best].T @ left[best])[1][:, 2]
        if np.linalg.svd(np.vstack([found, axis]), compute_uv=False)[-1] > _FLAT:
            found = np.vstack([found, axis])
        left = left[~best]
    return found


def alike(fit: ScanFit, symmetries: Poses) -> Poses:
    """The poses by which the model looks about the same as by ``fit``; ``symmetries`` put the model onto itself."""
    return Poses(
        symmetries.rotations @ fit.rotation, symmetries.rotations @ fit.origin + symmetries.origins
    )


def thin(model: Model) -> bool:
    """Whether two sides of the part are so near that the search may take one for the other."""
    return 2 * model.volume < _THIN * model.size * model.area


def stray(model: Model, samples: Cloud, few: FloatArray, fit: ScanFit, within: float) -> float:
    """Points in the model's box, without a margin at its sides, that do not lie on the model, per point that does: 0
    where the part stands, more where it only seems to.
    """
    at = fit.apply(few)
    off = np.ones(len(at), dtype=bool)
    off[on(model, samples, at, within).point] = False
    inside = ((at > model.low + 2 * within) & (at < model.high - 2 * within)).all(axis=1)
    return float(np.count_nonzero(off & inside)) / max(float(np.count_nonzero(~off)), 1.0)


def _limit(model: Model, final: ScanFit) -> float:
    """How far apart corners of the model's box are by two poses that count as two, mm. The two sides of a sheet are
    two, if the noise does not hide that.
    """
    size = _DIFFERENT_SHARE * model.size
    return max(
        min(size, model.volume / model.area),
        min(size, 2 * _BEYOND_NOISE * final.noise),
        1e-3 * model.size,
    )


def _places(model: Model, fit: ScanFit) -> FloatArray:
    """The corners of the model's box in the scan."""
    return np.asarray((corners(model) - fit.origin) @ fit.rotation)


def _off(model: Model, a: ScanFit, b: ScanFit) -> float:
    return float(np.linalg.norm(_places(model, a) - _places(model, b), axis=1).max())


def _rival(
    model: Model, fit: ScanFit, final: ScanFit, worse: float, middle: FloatArray, off: float
) -> Rival:
    turn = math.degrees(angle_between(frozen(final.rotation), frozen(fit.rotation)))
    shift = float(np.linalg.norm((_places(model, fit) - _places(model, final)).mean(axis=0)))
    origin = to_vec3(middle - fit.rotation.T @ fit.origin)
    return Rival(Pose(frozen(fit.rotation.T), origin), turn, shift, worse, off)


def freedom(
    model: Model,
    samples: Cloud,
    view: View,
    final: ScanFit,
    limits: tuple[float, float],
) -> tuple[str, float]:
    """What motion of the part changes nothing, in words, "" if there is none, and how far it takes the surface from
    where it was, mm: the part is nudged along the motion that the points hold least, and stays there. ``limits``: mm
    and cost, as for equal poses.
    """
    vectors = np.linalg.eigh(final.information)[1]
    motion = vectors[:, 0]
    turn, shift = motion[:3] / final.arm, motion[3:]
    here = corners(model)
    reach = np.linalg.norm(np.cross(turn, here - final.centre) + shift, axis=1).max()
    factor = _NUDGE * model.size / float(reach)
    step = turn_poses(factor * turn[None])[0]
    start = (
        step @ final.rotation,
        step @ (final.origin - final.centre) + final.centre + factor * shift,
    )
    nudged = refine(model, samples, view.points, start, 2 * limits[0])
    away = _off(model, nudged, final)
    worse = cost(model, samples, view, nudged, limits[0]) - cost(
        model, samples, view, final, limits[0]
    )
    if away < 0.5 * _NUDGE * model.size or worse > limits[1]:
        return "", 0.0
    return _name_motion(final, motion), surface_off(model, samples, final, nudged)


def _name_motion(final: ScanFit, motion: FloatArray) -> str:
    """A motion (6,) in words, in the scan's frame."""
    turn, shift = motion[:3], motion[3:]
    back = final.rotation.T
    if float(np.linalg.norm(turn)) > float(np.linalg.norm(shift)):
        return f"turning it about {_direction(back @ turn)}"
    return f"moving it along {_direction(back @ shift)}"


def _direction(vector: FloatArray) -> str:
    """A direction for people: ``z`` within 5 deg of it, else three numbers; the largest is positive."""
    unit = vector / np.linalg.norm(vector)
    unit = unit * np.sign(unit[int(np.abs(unit).argmax())])
    if float(unit.max()) > math.cos(math.radians(5)):
        return "xyz"[int(unit.argmax())]
    return "[" + ", ".join(f"{v + 0.0:.2f}" for v in unit.tolist()) + "]"


def weakness(final: ScanFit) -> str:
    """The motion that the points hold weakly, in words, "" if none."""
    values, vectors = np.linalg.eigh(final.information)
    if float(values[0]) >= _WEAK * float(values[-1]):
        return ""
    return _name_motion(final, vectors[:, 0])


def measure_seen(
    model: Model,
    samples: Cloud,
    view: View,
    final: ScanFit,
    within: float,
) -> SeenShare:
    """The shares of the model that the scan shows: of all, and of the surface that could be seen.

    That surface faces the scanner, and the part itself does not hide it. An unknown place of the
    scanner is estimated.
    """
    step = max(len(model.samples) // _SEEN_SAMPLES, 1)
    places, normals = model.samples[::step], model.sample_normals[::step]
    limits = (within, noise_limit(model, final))
    hit = _hit(model, samples, final.apply(view.points), places, normals, limits)
    few = slice(None, None, max(len(places) // _VIEW_SAMPLES, 1))
    if view.eye is not None:
        asked = look(model, places, normals, final.apply(view.eye)[None], _FACING)[0]
    elif hit.any() and float(np.linalg.norm(normals[hit].mean(axis=0))) > _ONE_SIDED:
        shown = SeenPlaces(places[few], normals[few], hit[few])
        eye = estimate_eye(model, shown, _FACING).eye
        asked = look(model, places, normals, eye[None], _FACING)[0]
    else:  # from all around
        asked = look(model, places, normals, far_eyes(model, around()), _FACING).any(axis=0)
    return SeenShare(float(hit.mean()), float(hit[asked].mean()) if asked.any() else 0.0)


def _hit(
    model: Model,
    samples: Cloud,
    at: FloatArray,
    places: FloatArray,
    normals: FloatArray,
    limits: tuple[float, float],
) -> BoolArray:
    """Whether each place on the model (N, 3) has a point ``at`` (P, 3), in the model's frame, beside it.

    A point on a face with the opposite normal does not count, unless the noise hides that.
    limits: mm, the distance of a point beside a place, and its height that noise explains.
    """
    cloud = Cloud(at)
    nearest, near = (each[:, 0] for each in cloud.nearest(places))
    some = at[:: max(len(at) // 1000, 1)]
    spacing = float(np.median(cloud.nearest(some, 2)[1][:, 1]))
    reach = max(limits[0], 4 * spacing)
    hit = np.asarray(near <= reach)
    beside, of = np.unique(nearest[hit], return_inverse=True)
    touch = find_touched(model, candidates(model, samples, at[beside], reach, 0.0), at[beside])
    face = np.zeros((len(beside), 3))
    face[touch.point] = model.normals[touch.triangle]
    above = np.abs(dots(at[nearest[hit]] - places[hit], normals[hit]))
    hit[hit] = (dots(face[of], normals[hit]) > _OPPOSITE) | (above <= limits[1])
    return hit
