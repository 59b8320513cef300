"""Where the search begins: what of the scan may be the part, and poses all around it, thinned to the few that count."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.localize.coarse import DistanceField, Poses, fit, rotations, slide, thin
from camgen.localize.groups import group_places
from camgen.localize.model import Model
from camgen.model.pose import FloatArray, Pose

#: Orientations to begin with: about 25 deg from one to the next.
_ORIENTATIONS = 600
#: Trace of the rotation between two that are turned by less than 45 deg.
_LITTLE = 1 + 2 * np.cos(np.radians(45))
#: A scan that measures less than this part of the model across shows one side, which lies this part of the way out.
_FLATTER, _OUT = 0.7, 0.6
#: Points that slide. More make it slower, not better.
_POINTS = 120
#: Points of the model by which its symmetries are looked for.
_ITSELF = 60
#: Rounds: reach of a point and pull of the samples (see ``coarse.slide``), steps.
#: Reaches are parts of the model's size.
_FAR = ((0.15, 1.0, 4), (0.08, 0.5, 4))
_NARROWING = ((0.05, 0.2, 6), (0.03, 0.05, 6), (0.015, 0.02, 6))
_KEPT = 60
#: Poses that fit less than this part of the best one are not refined.
_WORTH_SHARE = 0.6
#: Things that may be the part, and the fewest points of one.
_HEAPS, _FEWEST = 3, 100
#: Poses that put the corners of the model's box farther apart than this part of its size are different to the search.
_DIFFERENT_SHARE = 0.03


def things(model: Model, points: FloatArray) -> list[FloatArray]:
    """Point sets that may be the part: all points (N, 3), and each of the largest things."""
    largest = heaps(points, model.size / 16)
    sets = [points, *(largest if len(largest) > 1 else [])]
    return [thin(each, _POINTS) for each in sets]


class Begins(Struct, frozen=True, eq=False):
    """Poses (model_from_scan) to refine, the best first.

    share: the share of the points that the best pose explains, 0..1.
    """

    poses: Poses
    share: float


def starts(
    model: Model, field: DistanceField, sets: list[FloatArray], given: Pose | None, near: bool
) -> Begins:
    """Different poses to refine, of the ``things`` of a scan.

    given: scan_from_model as far as it is known.
    near: whether the search begins only with poses that are turned little from it.
    """
    turns, origin = rotations(_ORIENTATIONS), None
    if given is not None:
        back = given.inverse()
        if near:
            turns = turns[np.einsum("bij,ij->b", turns, back.rotation) > _LITTLE]
        turns = np.concatenate([back.rotation[None], turns])
        origin = back.origin
    found = [_slide(model, field, some, turns, origin) for some in sets]
    poses = Poses(
        *(np.concatenate([getattr(p, name) for p in found]) for name in ("rotations", "origins"))
    )
    fits = fit(field, sets[0], poses, 0.01 * model.size)
    best = np.argsort(-fits, kind="stable")
    worth = poses[best[fits[best] > _WORTH_SHARE * fits[best[0]]]]
    return Begins(different(model, worth, _DIFFERENT_SHARE * model.size), float(fits[best[0]]))


def symmetries(model: Model, field: DistanceField) -> Poses:
    """Poses of the model that put its surface about onto itself: found by the search, and half a turn about each
    principal axis, which the search meets only nearly where the part is thin.
    """
    found = starts(model, field, [thin(model.samples, _ITSELF)], None, near=False).poses
    middle = model.samples.mean(axis=0)
    axes = np.linalg.eigh(np.cov((model.samples - middle).T))[1].T
    turns = 2 * axes[:, :, None] * axes[:, None] - np.eye(3)
    origins = middle - turns @ middle
    return Poses(np.concatenate([turns, found.rotations]), np.concatenate([origins, found.origins]))


def _slide(
    model: Model,
    field: DistanceField,
    points: FloatArray,
    turns: FloatArray,
    origin: tuple[float, float, float] | None,
) -> Poses:
    """The best of ``turns`` (B, 3, 3) about the middle of the points, and of the first with ``origin``, slid onto the
    model.
    """
    turns, origins = _lay(model, points, turns)
    if origin is not None:
        turns, origins = (
            np.concatenate([turns[:1], turns]),
            np.concatenate([np.array([origin]), origins]),
        )
    poses = Poses(turns, origins)
    for scale, plain, steps in _FAR:
        for _ in range(steps):
            poses = slide(field, points, poses, scale * model.size, plain)
    best = np.argsort(-fit(field, points, poses, 0.03 * model.size), kind="stable")[:_KEPT]
    poses = poses[best]
    for scale, plain, steps in _NARROWING:
        for _ in range(steps):
            poses = slide(field, points, poses, scale * model.size, plain)
    return poses


def _lay(model: Model, points: FloatArray, turns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """``turns`` (B, 3, 3) and origins (B, 3) that lay the middle of the points onto that of the model; of points that
    are flatter than the model, which show one side of it, also towards either side.
    """
    middle, centre = points.mean(axis=0), model.samples.mean(axis=0)
    origins = centre - turns @ middle
    least, axes = np.linalg.eigh(np.cov((points - middle).T))
    if least[0] > _FLATTER**2 * np.linalg.eigvalsh(np.cov((model.samples - centre).T))[0]:
        return turns, origins
    across = turns @ axes[:, 0]
    heights = (corners(model) - centre) @ across.T
    out = _OUT * np.stack([0 * heights[0], heights.max(axis=0), heights.min(axis=0)])
    return np.tile(turns, (3, 1, 1)), (origins + out[..., None] * across).reshape(-1, 3)


def corners(model: Model) -> FloatArray:
    """The eight corners (8, 3) of the model's box."""
    pick = np.array([[(i >> k) & 1 for k in range(3)] for i in range(8)])
    return np.where(pick, model.high, model.low)


def different(model: Model, poses: Poses, apart: float, limit: int = 24) -> Poses:
    """The first of ``poses`` and those of the next that put a corner of the model more than ``apart`` mm elsewhere."""
    places = (corners(model)[None] - poses.origins[:, None]) @ poses.rotations
    kept: list[int] = []
    for i in range(len(poses)):
        off = (
            np.linalg.norm(places[kept] - places[i], axis=2).max(axis=1)
            if kept
            else np.array([np.inf])
        )
        if off.min() > apart:
            kept.append(i)
        if len(kept) == limit:
            break
    return poses[np.array(kept, dtype=np.int64)]


def heaps(points: FloatArray, cell: float) -> list[FloatArray]:
    """The points (N, 3) of each of the largest things that stand apart by more than a cell (mm)."""
    groups = group_places(points, cell)[:_HEAPS]
    return [points[group] for group in groups if len(group) >= _FEWEST]
