"""What speaks against a pose: others that fit as well, motions that the scan does not hold, and how much was seen."""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct

from camgen.localize.coarse import Poses, turn_poses
from camgen.localize.fine import ScanFit, cost, on, refine
from camgen.localize.model import Cloud, Model
from camgen.localize.starts import corners
from camgen.model.pose import FloatArray, Pose, angle_between, frozen

#: Poses that put a corner of the model's box farther apart than this part of its size are different ones.
_DIFFERENT_SHARE = 0.01
#: Two sides of a part that are nearer than this part of its size are one to the search.
_THIN = 0.06
#: A motion of which the points say less than this part of what they could is held weakly.
_WEAK = 0.003
#: How far a motion is tried that may be free: a corner of the box moves by this part of its size.
_NUDGE = 0.05
#: Samples that say how much of the model was seen, and the cosine between a face and the view that still shows it.
_SEEN_SAMPLES, _FACING = 4000, 0.3


class Rival(Struct, frozen=True, eq=False):
    """Another pose of the model in the scan. turn: deg from the chosen one; shift: mm, what its box's middle moves;
    cost: by how much worse it fits, 0..1.
    """

    base_from_work: Pose
    turn: float
    shift: float
    cost: float


class SeenShare(Struct, frozen=True):
    """Shares 0..1 of the model's surface that have points of the scan: of all, and of what faces as those points do."""

    all: float
    near: float


def rivals(
    model: Model, final: ScanFit, others: tuple[list[ScanFit], list[float], float], same: float, middle: FloatArray
) -> tuple[tuple[Rival, ...], Rival | None]:
    """Other poses that fit as well as the best, by turn, and the best of those that do not. ``others``: fits, costs."""
    fits, costs, _ = others
    best = min(costs)
    apart = [(fit, c - best) for fit, c in zip(fits, costs, strict=True) if _off(model, fit, final) > _limit(model)]
    equal: list[tuple[ScanFit, float]] = []
    for fit, worse in apart:
        if worse <= same and all(_off(model, fit, known) > _limit(model) for known, _ in equal):
            equal.append((fit, worse))
    told = sorted((_rival(model, f, final, w, middle) for f, w in equal), key=lambda r: (round(r.turn, 1), r.shift))
    less = min(((f, w) for f, w in apart if w > same), key=lambda pair: pair[1], default=None)
    return tuple(told), None if less is None else _rival(model, less[0], final, less[1], middle)


def beside(model: Model, samples: Cloud, few: FloatArray, fits: list[ScanFit]) -> Poses:
    """Poses by which a thin part may have been missed: its other side lies on the points, within the search's reach.

    The best two fits, moved by the thickness along and against the face that most points lie on. None if the part is
    not thin.
    """
    if not thin(model):
        return Poses(np.zeros((0, 3, 3)), np.zeros((0, 3)))
    thick = 2 * model.volume / model.area
    best = sorted(fits, key=lambda fit: cost(model, samples, few, fit, 0.01 * model.size))[:2]
    turns, origins = [], []
    for fit in best:
        normals = model.sample_normals[samples.nearest(fit.apply(few))[0][:, 0]]
        face = np.linalg.eigh(normals.T @ normals)[1][:, 2]
        turns += [fit.rotation] * 2
        origins += [fit.origin + thick * face, fit.origin - thick * face]
    return Poses(np.array(turns), np.array(origins))


def alike(fit: ScanFit, symmetries: Poses) -> Poses:
    """The poses by which the model looks about the same as by ``fit``; ``symmetries`` put the model onto itself."""
    return Poses(symmetries.rotations @ fit.rotation, symmetries.rotations @ fit.origin + symmetries.origins)


def thin(model: Model) -> bool:
    """Whether two sides of the part are so near that the search may take one for the other."""
    return 2 * model.volume < _THIN * model.size * model.area


def stray(model: Model, samples: Cloud, few: FloatArray, fit: ScanFit, within: float) -> float:
    """Points in the model's box, without a margin at its sides, that do not lie on the model, per point that does: 0
    where the part stands, more where it only seems to.
    """
    at = fit.apply(few)
    off = np.ones(len(at), dtype=bool)
    off[on(model, samples, at, within)[0]] = False
    inside = ((at > model.low + 2 * within) & (at < model.high - 2 * within)).all(axis=1)
    return float(np.count_nonzero(off & inside)) / max(float(np.count_nonzero(~off)), 1.0)


def _limit(model: Model) -> float:
    return _DIFFERENT_SHARE * model.size


def _places(model: Model, fit: ScanFit) -> FloatArray:
    """The corners of the model's box in the scan."""
    return np.asarray((corners(model) - fit.origin) @ fit.rotation)


def _off(model: Model, a: ScanFit, b: ScanFit) -> float:
    return float(np.linalg.norm(_places(model, a) - _places(model, b), axis=1).max())


def _rival(model: Model, fit: ScanFit, final: ScanFit, worse: float, middle: FloatArray) -> Rival:
    turn = math.degrees(angle_between(frozen(final.rotation), frozen(fit.rotation)))
    shift = float(np.linalg.norm((_places(model, fit) - _places(model, final)).mean(axis=0)))
    x, y, z = (middle - fit.rotation.T @ fit.origin).tolist()
    return Rival(Pose(frozen(fit.rotation.T), (x, y, z)), turn, shift, worse)


def freedom(model: Model, samples: Cloud, few: FloatArray, final: ScanFit, limits: tuple[float, float]) -> str:
    """What motion of the part changes nothing, in words, "" if there is none: it is nudged along the motion that the
    points hold least, and stays there. ``limits``: mm and cost, as for equal poses.
    """
    vectors = np.linalg.eigh(final.information)[1]
    motion = vectors[:, 0]
    turn, shift = motion[:3] / final.arm, motion[3:]
    here = corners(model)
    reach = np.linalg.norm(np.cross(turn, here - final.centre) + shift, axis=1).max()
    factor = _NUDGE * model.size / float(reach)
    step = turn_poses(factor * turn[None])[0]
    start = (step @ final.rotation, step @ (final.origin - final.centre) + final.centre + factor * shift)
    nudged = refine(model, samples, few, start, 2 * limits[0])
    away = _off(model, nudged, final)
    worse = cost(model, samples, few, nudged, limits[0]) - cost(model, samples, few, final, limits[0])
    if away < 0.5 * _NUDGE * model.size or worse > limits[1]:
        return ""
    return _name_motion(final, motion)


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


def measure_seen(model: Model, points: FloatArray, final: ScanFit, within: float) -> SeenShare:
    """How much of the model the scan shows. The side that was looked at is where the normals of what was seen point on
    average; what other parts of the model hide is not taken off.
    """
    step = max(len(model.samples) // _SEEN_SAMPLES, 1)
    places, normals = model.samples[::step], model.sample_normals[::step]
    at = final.apply(points)
    cloud = Cloud(at)
    near = cloud.nearest(places)[1][:, 0]
    some = at[:: max(len(at) // 1000, 1)]
    spacing = float(np.median(cloud.nearest(some, 2)[1][:, 1]))
    hit = near <= max(within, 4 * spacing)
    view = normals[hit].mean(axis=0) if hit.any() else np.zeros(3)
    length = float(np.linalg.norm(view))
    facing = normals @ (view / length) > _FACING if length > 0.2 else np.ones(len(normals), dtype=bool)
    return SeenShare(float(hit.mean()), float(hit[facing].mean()))
