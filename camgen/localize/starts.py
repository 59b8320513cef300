"""The poses with which the search begins: points that may be the part, slid onto the model."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.localize.coarse import (
    DistanceField,
    Poses,
    join_poses,
    measure_fit,
    slide_poses,
    spread_rotations,
    thin_out,
)
from camgen.localize.groups import group_places
from camgen.localize.model import Model
from camgen.model.pose import FloatArray, Pose

#: Number of orientations with which the search begins: neighbours are about 25 deg apart.
_ORIENTATIONS = 600
#: Trace of the rotation between two orientations that differ by less than 45 deg.
_LITTLE = 1 + 2 * np.cos(np.radians(45))
#: A scan that is thinner than this part of the model shows one side. It lies at this part of the
#: distance between the middle of the model and its corners.
_FLATTER, _OUT = 0.7, 0.6
#: Number of points that slide. With more the search is slower, and finds no more.
_POINTS = 120
#: Number of samples with which the symmetries of the model are searched.
_ITSELF = 60
#: Rounds: scale, as part of the model's size, pull of the samples (see `slide_poses`), steps.
_FAR = ((0.15, 1.0, 4), (0.08, 0.5, 4))
_NARROWING = ((0.05, 0.2, 6), (0.03, 0.05, 6), (0.015, 0.02, 6))
#: Poses that are kept after the rounds from afar.
_KEPT = 60
#: Poses are not refined if their fit is less than this part of the best one.
_WORTH_SHARE = 0.6
#: Maximum number of things that may be the part, and minimum number of points of each.
_HEAPS, _FEWEST = 3, 100
#: Poses are different to the search if a corner of the model's box moves by more than this part of
#: the model's size.
_DIFFERENT_SHARE = 0.03


def list_things(model: Model, points: FloatArray) -> list[FloatArray]:
    """Point sets that may be the part: all points (N, 3), and each of the largest things."""
    largest = split_heaps(points, model.size / 16)
    sets = [points, *(largest if len(largest) > 1 else [])]
    return [thin_out(each, _POINTS) for each in sets]


class StartPoses(Struct, frozen=True, eq=False):
    """Poses (model_from_scan) to refine, the best first.

    share: the share of the points that the best pose explains, 0..1.
    """

    poses: Poses
    share: float


def find_starts(
    model: Model, field: DistanceField, sets: list[FloatArray], given: Pose | None, near: bool
) -> StartPoses:
    """Different poses to refine.

    sets: point sets that may be the part, as by `list_things`.
    given: scan_from_model, as far as it is known.
    near: whether the search begins only with poses that are turned by less than 45 deg from it.
    """
    turns, origin = spread_rotations(_ORIENTATIONS), None
    if given is not None:
        back = given.inverse()
        if near:
            turns = turns[np.einsum("bij,ij->b", turns, back.rotation) > _LITTLE]
        turns = np.concatenate([back.rotation[None], turns])
        origin = back.origin
    poses = join_poses([_slide_turns(model, field, points, turns, origin) for points in sets])
    fits = measure_fit(field, sets[0], poses, 0.01 * model.size)
    order = np.argsort(-fits, kind="stable")
    good = poses[order[fits[order] > _WORTH_SHARE * fits[order[0]]]]
    different = select_different(model, good, _DIFFERENT_SHARE * model.size)
    return StartPoses(different, float(fits[order[0]]))


def find_symmetries(model: Model, field: DistanceField) -> Poses:
    """Poses of the model that put its surface about onto itself.

    The search finds them. Half a turn about each principal axis is added, because the search finds
    it only nearly if the part is thin.
    """
    poses = find_starts(model, field, [thin_out(model.samples, _ITSELF)], None, near=False).poses
    middle = model.samples.mean(axis=0)
    axes = np.linalg.eigh(np.cov((model.samples - middle).T))[1].T
    turns = 2 * axes[:, :, None] * axes[:, None] - np.eye(3)
    return join_poses([Poses(turns, middle - turns @ middle), poses])


def _slide_turns(
    model: Model,
    field: DistanceField,
    points: FloatArray,
    turns: FloatArray,
    origin: tuple[float, float, float] | None,
) -> Poses:
    """The best poses after sliding `points` (N, 3) onto the model.

    turns: (B, 3, 3), the orientations with which the points start at the middle of the model.
    origin: model_from_scan, a further start with the first of the orientations.
    """
    poses = _place_turns(model, points, turns)
    if origin is not None:
        poses = join_poses([Poses(turns[:1], np.array([origin])), poses])
    for scale, pull, steps in _FAR:
        for _ in range(steps):
            poses = slide_poses(field, points, poses, scale * model.size, pull)
    fits = measure_fit(field, points, poses, 0.03 * model.size)
    poses = poses[np.argsort(-fits, kind="stable")[:_KEPT]]
    for scale, pull, steps in _NARROWING:
        for _ in range(steps):
            poses = slide_poses(field, points, poses, scale * model.size, pull)
    return poses


def _place_turns(model: Model, points: FloatArray, turns: FloatArray) -> Poses:
    """Poses with `turns` (B, 3, 3) that put the middle of `points` (N, 3) onto that of the model.

    Points that are flatter than the model show one side of it. They are put towards either side
    too, so that there are 3 B poses.
    """
    middle, centre = points.mean(axis=0), model.samples.mean(axis=0)
    origins = centre - turns @ middle
    variances, axes = np.linalg.eigh(np.cov((points - middle).T))
    if variances[0] > _FLATTER**2 * np.linalg.eigvalsh(np.cov((model.samples - centre).T))[0]:
        return Poses(turns, origins)
    across = turns @ axes[:, 0]
    heights = (list_corners(model) - centre) @ across.T
    out = _OUT * np.stack([0 * heights[0], heights.max(axis=0), heights.min(axis=0)])
    return Poses(np.tile(turns, (3, 1, 1)), (origins + out[..., None] * across).reshape(-1, 3))


def list_corners(model: Model) -> FloatArray:
    """The corners (8, 3) of the model's box."""
    is_high = np.arange(8)[:, None] >> np.arange(3) & 1
    return np.where(is_high, model.high, model.low)


def select_different(model: Model, poses: Poses, distance: float, limit: int = 24) -> Poses:
    """The poses that put a corner of the model's box more than `distance` mm from all poses before.

    At most `limit` poses are selected; the first one always is.
    """
    corners = (list_corners(model)[None] - poses.origins[:, None]) @ poses.rotations
    kept: list[int] = []
    for i in range(len(poses)):
        distances = np.linalg.norm(corners[kept] - corners[i], axis=2).max(axis=1)
        if distances.min(initial=np.inf) > distance:
            kept.append(i)
        if len(kept) == limit:
            break
    return poses[np.array(kept, dtype=np.int64)]


def split_heaps(points: FloatArray, cell: float) -> list[FloatArray]:
    """The points (N, 3) of each of the largest things that stand apart by more than a cell (mm)."""
    largest = group_places(points, cell)[:_HEAPS]
    return [points[group] for group in largest if len(group) >= _FEWEST]
