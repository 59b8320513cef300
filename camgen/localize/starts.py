"""Where the search begins: what of the scan may be the part, and poses all around it, thinned to the few that count."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from camgen.localize.coarse import Field, Poses, fit, rotations, slid, thinned
from camgen.localize.model import Model
from camgen.pose import FloatArray, Pose
from camgen.solid import BoolArray

#: Orientations to begin with: about 25 deg from one to the next.
_ORIENTATIONS = 600
#: Points that slide. More make it slower, not better.
_POINTS = 300
#: Rounds: reach of a point and pull of the samples (see ``coarse.slid``), steps. Reaches are parts of the model's size.
_FAR = ((0.15, 1.0, 4), (0.08, 0.5, 4))
_NEAR = ((0.05, 0.2, 6), (0.03, 0.05, 6), (0.015, 0.02, 6))
_KEPT = 120
#: Poses that fit less than this part of the best one are not refined.
_WORTH = 0.6
#: A plane that holds this part of the scan with all else on one side may be the bench.
_BENCH, _ASIDE, _TRIES = 0.15, 0.97, 200
#: Things on the bench that may be the part, the fewest points of one, and the places around a cell.
_HEAPS, _FEWEST = 3, 100
_AROUND = tuple((a, b, c) for a in (-1, 0, 1) for b in (-1, 0, 1) for c in (-1, 0, 1) if (a, b, c) != (0, 0, 0))
#: Poses that put the corners of the model's box farther apart than this part of its size are different to the search.
_APART = 0.03


def starts(model: Model, field: Field, points: FloatArray, given: Pose | None, stage: Callable[[str], None]) -> Poses:
    """Poses (model_from_scan) worth refining, the best first, all different. ``given``: scan_from_model to try too."""
    sets = [points]
    bench = flat(thinned(points, 2000), points, 0.005 * model.size)
    if bench is not None and np.count_nonzero(~bench) >= _FEWEST:
        sets.append(points[~bench])
        things = heaps(sets[1], model.size / 16)
        sets += things if len(things) > 1 else []
    everything = thinned(points, _POINTS)
    found: list[Poses] = []
    for number, some in enumerate(sets):
        stage(f"searching, {number + 1} of {len(sets)}")
        found.append(_slid(model, field, thinned(some, _POINTS), given))
    poses = Poses(*(np.concatenate([getattr(p, name) for p in found]) for name in ("rotations", "origins")))
    fits = fit(field, everything, poses, 0.01 * model.size)
    best = np.argsort(-fits, kind="stable")
    return different(model, poses[best[fits[best] > _WORTH * fits[best[0]]]], _APART * model.size)


def _slid(model: Model, field: Field, points: FloatArray, given: Pose | None) -> Poses:
    """The best of all orientations about the middle of the points, slid onto the model."""
    turns = rotations(_ORIENTATIONS)
    origins = model.samples.mean(axis=0) - turns @ points.mean(axis=0)
    if given is not None:
        back = given.inverse()
        turns = np.concatenate([turns, back.rotation[None]])
        origins = np.concatenate([origins, np.array([back.origin])])
    poses = Poses(turns, origins)
    for scale, plain, steps in _FAR:
        for _ in range(steps):
            poses = slid(field, points, poses, scale * model.size, plain)
    best = np.argsort(-fit(field, points, poses, 0.03 * model.size), kind="stable")[:_KEPT]
    poses = poses[best]
    for scale, plain, steps in _NEAR:
        for _ in range(steps):
            poses = slid(field, points, poses, scale * model.size, plain)
    return poses


def corners(model: Model) -> FloatArray:
    """The eight corners (8, 3) of the model's box."""
    pick = np.array([[(i >> k) & 1 for k in range(3)] for i in range(8)])
    return np.where(pick, model.high, model.low)


def different(model: Model, poses: Poses, apart: float, limit: int = 24) -> Poses:
    """The first of ``poses`` and those of the next that put a corner of the model more than ``apart`` mm elsewhere."""
    places = (corners(model)[None] - poses.origins[:, None]) @ poses.rotations
    kept: list[int] = []
    for i in range(len(poses)):
        off = np.linalg.norm(places[kept] - places[i], axis=2).max(axis=1) if kept else np.array([np.inf])
        if off.min() > apart:
            kept.append(i)
        if len(kept) == limit:
            break
    return poses[np.array(kept, dtype=np.int64)]


def heaps(points: FloatArray, cell: float) -> list[FloatArray]:
    """The points of each of the largest things that stand apart by more than a cell (mm), the largest first."""
    cells, of = np.unique(np.floor((points - points.min(axis=0)) / cell).astype(np.int64), axis=0, return_inverse=True)
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
