"""The coarse search: many poses at once slide a few hundred points of the scan onto the model."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.geometry.rotations import make_rotations_from_quaternions, make_rotations_from_vectors
from camgen.geometry.vectors import add_coordinates, cross
from camgen.localize.groups import pack_cells
from camgen.localize.model import Model
from camgen.model.part import IntArray
from camgen.model.pose import FloatArray

#: Cells along the longest side of the model, and the part of that side by which the field extends
#: beyond the model.
_CELLS, _BEYOND = 40, 0.25
#: Super-Fibonacci spiral (Alexa, CVPR 2022): the constants of its two golden-like ratios.
_PHI, _PSI = 2**0.5, 1.533751168755204288118041
#: Poses that slide together: their points stay in the processor's cache.
_BLOCK = 64
#: A cell with less than this share of the median number of points is one of strays.
_SPARSE = 0.1
#: Maximum turn of a step, rad. A step goes along tangents, which say nothing about larger turns.
_FARTHEST_TURN = 0.5


class DistanceField(Struct, frozen=True, eq=False):
    """A grid around the model that replaces the search for the nearest sample.

    low: (3,), lower corner of the grid, mm.
    cell: width of a cell, mm.
    nearest: (nx, ny, nz), index of the sample that is nearest to the middle of each cell.
    samples: (S, 6), the points and the normals of the samples.
    """

    low: FloatArray
    cell: float
    nearest: IntArray
    samples: FloatArray

    def at(self, places: FloatArray) -> IntArray:
        """The sample near each of `places` (..., 3). Outside the grid its nearest cell is used."""
        row = np.zeros(places.shape[:-1], dtype=np.int64)
        for k, count in enumerate(self.nearest.shape):
            cells = (places[..., k] - self.low[k]) * (1 / self.cell)
            row = row * count + np.clip(cells, 0, count - 1).astype(np.int64)
        return np.asarray(self.nearest.take(row))


class Poses(Struct, frozen=True, eq=False):
    """Many rigid transforms: rotations (B, 3, 3), origins (B, 3), mm."""

    rotations: FloatArray
    origins: FloatArray

    def __len__(self) -> int:
        return len(self.origins)

    def __getitem__(self, which: IntArray) -> Poses:
        return Poses(self.rotations[which], self.origins[which])

    def apply(self, points: FloatArray) -> FloatArray:
        """`points` (n, 3) under each of the transforms: (B, n, 3)."""
        rotated = (self.rotations.reshape(-1, 3) @ points.T).reshape(len(self), 3, -1)
        return np.asarray(rotated.transpose(0, 2, 1) + self.origins[:, None])


def join_poses(groups: list[Poses]) -> Poses:
    """All poses of the groups, in order."""
    rotations = np.concatenate([group.rotations for group in groups])
    return Poses(rotations, np.concatenate([group.origins for group in groups]))


def make_field(model: Model) -> DistanceField:
    """The distance field of a model."""
    side = float((model.high - model.low).max())
    cell = side / _CELLS
    low = model.low - _BEYOND * side
    counts = np.ceil((model.high + _BEYOND * side - low) / cell).astype(int)
    axes = [low[k] + cell * (np.arange(counts[k]) + 0.5) for k in range(3)]
    middles = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    nearest = model.cloud.find_nearest(middles)[0].reshape(tuple(counts))
    return DistanceField(low, cell, nearest, np.hstack([model.samples, model.sample_normals]))


def spread_rotations(count: int) -> FloatArray:
    """Rotations (count, 3, 3), spread evenly (Alexa, Super-Fibonacci Spirals, 2022)."""
    s = np.arange(count) + 0.5
    t, d = s / count, 2 * np.pi * s
    near, far = np.sqrt(t), np.sqrt(1 - t)
    a, b = d / _PHI, d / _PSI
    x, y, z, w = near * np.sin(a), near * np.cos(a), far * np.sin(b), far * np.cos(b)
    return make_rotations_from_quaternions(w, x, y, z)


def slide_poses(
    field: DistanceField, points: FloatArray, poses: Poses, scale: float, pull: float
) -> Poses:
    """One Gauss-Newton step of all poses, as by `_slide_block`."""
    blocks = np.split(np.arange(len(poses)), range(_BLOCK, len(poses), _BLOCK))
    return join_poses([_slide_block(field, points, poses[each], scale, pull) for each in blocks])


def _slide_block(
    field: DistanceField, points: FloatArray, poses: Poses, scale: float, pull: float
) -> Poses:
    """One Gauss-Newton step of all poses (model_from_scan), which moves points to planes.

    The planes are those of the samples near the points.

    points: (n, 3) of the scan.
    scale: distance beyond which a point has little weight, mm (Geman and McClure).
    pull: 0..1, weight of the distances to the samples themselves, besides those to their planes.
        These distances move poses that are far from the model.
    """
    at = poses.apply(points)
    samples = field.samples.take(field.at(at), axis=0)
    normal, offset = samples[..., 3:], at - samples[..., :3]
    weight = (scale**2 / (scale**2 + add_coordinates(offset * offset))) ** 2
    total = weight.sum(axis=1)
    centre = (weight[..., None] * at).sum(axis=1) / total[:, None]
    arm = at - centre[:, None]
    rows = np.concatenate([cross(arm, normal), normal], axis=2)
    weighted = rows * weight[..., None]
    matrix = weighted.transpose(0, 2, 1) @ rows
    gradient = _add_points(weighted * add_coordinates(offset * normal)[..., None])
    weighted_arm = arm * weight[..., None]
    square = np.einsum("bni,bnj->bij", weighted_arm, arm)
    trace = np.trace(square, axis1=1, axis2=2)[:, None, None]
    eye = np.eye(3)
    matrix[:, :3, :3] += pull * (trace * eye - square)
    matrix[:, 3:, 3:] += pull * total[:, None, None] * eye
    gradient[:, :3] += pull * _add_points(cross(weighted_arm, offset))
    gradient[:, 3:] += pull * _add_points(offset * weight[..., None])
    matrix += (1e-6 * np.trace(matrix, axis1=1, axis2=2))[:, None, None] * np.eye(6)
    step = -np.linalg.solve(matrix, gradient[..., None])[..., 0]
    turn = make_turns(step[:, :3])
    origins = (turn @ (poses.origins - centre)[..., None])[..., 0] + centre + step[:, 3:]
    return Poses(turn @ poses.rotations, origins)


def _add_points(values: FloatArray) -> FloatArray:
    """(B, k) sums over the points of values (B, n, k), as `sum(axis=1)` in half the time."""
    return np.asarray(np.ascontiguousarray(values.transpose(1, 0, 2)).sum(axis=0))


def make_turns(vectors: FloatArray) -> FloatArray:
    """Rotations (B, 3, 3) about the directions of `vectors` (B, 3), by their lengths, rad.

    Longer vectors turn by 0.5 rad.
    """
    angle = np.linalg.norm(vectors, axis=1)[:, None]
    return make_rotations_from_vectors(
        vectors * (_FARTHEST_TURN / np.maximum(angle, _FARTHEST_TURN))
    )


def measure_fit(field: DistanceField, points: FloatArray, poses: Poses, scale: float) -> FloatArray:
    """The share of the points that each pose puts near the model, 0..1 (B,).

    A point counts 1 on the model, and 1/2 at the distance `scale` (mm).
    """
    at = poses.apply(points)
    offset = at - field.samples.take(field.at(at), axis=0)[..., :3]
    return np.asarray((scale**2 / (scale**2 + add_coordinates(offset * offset))).mean(axis=1))


def thin_out(points: FloatArray, count: int) -> FloatArray:
    """About `count` of `points` (N, 3), spread evenly in space however dense the scan is.

    Places with far fewer points than most are left out, so that a stray point does not weigh as
    much as a patch.
    """
    low, span = points.min(axis=0), float(np.ptp(points, axis=0).max())
    cell, kept = span / 2, points
    for _ in range(24):
        cells = np.floor((points - low) / cell).astype(np.int64)
        _, first, held = np.unique(pack_cells(cells), return_index=True, return_counts=True)
        kept = points[first[held >= _SPARSE * np.median(held)]]
        if len(kept) >= count:
            break
        cell *= 0.8
    return np.asarray(kept)
