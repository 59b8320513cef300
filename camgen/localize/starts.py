"""Where the search begins: what of the scan may be the part, and poses all around it, thinned to the few that count."""

from __future__ import annotations

import numpy as np

from camgen.localize.coarse import DistanceField, Poses, fit, rotations, slide, thin
from camgen.localize.model import Model
from camgen.model.part import BoolArray
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
#: A plane that holds this part of the scan with all else on one side may be the bench.
_BENCH, _ASIDE, _TRIES = 0.15, 0.97, 200
#: Things on the bench that may be the part, the fewest points of one, and the places around a cell.
_HEAPS, _FEWEST = 3, 100
_AROUND = tuple(
    (a, b, c) for a in (-1, 0, 1) for b in (-1, 0, 1) for c in (-1, 0, 1) if (a, b, c) != (0, 0, 0)
)
#: Poses that put the corners of the model's box farther apart than this part of its size are different to the search.
_DIFFERENT_SHARE = 0.03


def things(model: Model, points: FloatArray) -> list[FloatArray]:
    """What of the scan (N, 3) may be the part: all of it, what is not the bench, and the largest things on that."""
    sets = [points]
    bench = flat(thin(points, 2000), points, 0.005 * model.size)
    if bench is not None and np.count_nonzero(~bench) >= _FEWEST:
        sets.append(points[~bench])
        apart = heaps(sets[1], model.size / 16)
        sets += apart if len(apart) > 1 else []
    return [thin(some, _POINTS) for some in sets]


def starts(
    model: Model, field: DistanceField, sets: list[FloatArray], given: Pose | None = None
) -> Poses:
    """Poses (model_from_scan) worth refining, the best first, all different, of the ``things`` of a scan.

    given: scan_from_model as far as it is known. The search then begins only with what is turned little from it.
    """
    turns, origin = rotations(_ORIENTATIONS), None
    if given is not None:
        back = given.inverse()
        turns = np.concatenate(
            [back.rotation[None], turns[np.einsum("bij,ij->b", turns, back.rotation) > _LITTLE]]
        )
        origin = back.origin
    found = [_slide(model, field, some, turns, origin) for some in sets]
    poses = Poses(
        *(np.concatenate([getattr(p, name) for p in found]) for name in ("rotations", "origins"))
    )
    fits = fit(field, sets[0], poses, 0.01 * model.size)
    best = np.argsort(-fits, kind="stable")
    return different(
        model, poses[best[fits[best] > _WORTH_SHARE * fits[best[0]]]], _DIFFERENT_SHARE * model.size
    )


def symmetries(model: Model, field: DistanceField) -> Poses:
    """Poses of the model that put its surface about onto itself: found by the search, and half a turn about each
    principal axis, which the search meets only nearly where the part is thin.
    """
    found = starts(model, field, [thin(model.samples, _ITSELF)])
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
    """The points of each of the largest things that stand apart by more than a cell (mm), the largest first."""
    cells, of = np.unique(
        np.floor((points - points.min(axis=0)) / cell).astype(np.int64), axis=0, return_inverse=True
    )
    free = {(x, y, z): i for i, (x, y, z) in enumerate(cells.tolist())}
    heap = np.zeros(len(cells), dtype=np.int64)
    number = 0
    while free:
        border = [free.popitem()]
        while border:
            (x, y, z), i = border.pop()
            heap[i] = number
            near = [(x + a, y + b, z + c) for a, b, c in _AROUND]
            border += [(place, free.pop(place)) for place in near if place in free]
        number += 1
    count = np.bincount(heap[of.reshape(-1)], minlength=number)
    largest = np.argsort(-np.bincount(heap), kind="stable")
    return [points[heap[of.reshape(-1)] == i] for i in largest[:_HEAPS] if count[i] >= _FEWEST]


def flat(thin: FloatArray, points: FloatArray, tolerance: float) -> BoolArray | None:
    """Which ``points`` (N, 3) lie in the plane that holds most of the scan, None if that cannot be the bench.

    thin: the scan spread evenly. Triples are drawn with a fixed seed (RANSAC).
    """
    draw = np.random.default_rng(0).integers(0, len(thin), (_TRIES, 3))
    a, b, c = (thin[draw[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1)
    proper = lengths > 0
    if not proper.any():
        return None
    normals, a = normals[proper] / lengths[proper, None], a[proper]
    counts = (np.abs(thin @ normals.T - (normals * a).sum(axis=1)) < tolerance).sum(axis=0)
    best = int(counts.argmax())
    within = thin[np.abs((thin - a[best]) @ normals[best]) < tolerance]
    middle = within.mean(axis=0)
    normal = np.linalg.svd(within - middle, full_matrices=False)[2][2]
    heights = (thin - middle) @ normal
    beside = np.abs(heights) >= tolerance
    share = 1 - np.count_nonzero(beside) / len(thin)
    above = float(np.mean(heights[beside] > 0)) if beside.any() else 1.0
    if share < _BENCH or max(above, 1 - above) < _ASIDE:
        return None
    return np.asarray(np.abs((points - middle) @ normal) < tolerance)
