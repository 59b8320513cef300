"""The coarse search: many poses at once slide a few hundred points of the scan onto the model."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.geometry.rotations import from_quaternions, from_vectors
from camgen.geometry.vectors import add_coordinates, cross
from camgen.localize.model import Cloud, Model
from camgen.model.part import IntArray
from camgen.model.pose import FloatArray

#: Cells along the longest side of the model, and how far the field goes beyond it, as part of that side.
_CELLS, _BEYOND = 40, 0.25
#: Super-Fibonacci spiral (Alexa, CVPR 2022): the constants of its two golden-like ratios.
_PHI, _PSI = 2**0.5, 1.533751168755204288118041
#: A cell with less than this share of the median number of points is one of strays.
_SPARSE = 0.1
#: No step turns further, rad: beyond it the tangents that a step goes along say nothing.
_FARTHEST_TURN = 0.5


class DistanceField(Struct, frozen=True, eq=False):
    """For each cell of a grid around the model the sample nearest to its middle. A look-up instead of a search.

    low: (3,) corner, mm. cell: mm. nearest: (nx, ny, nz). points, normals: (S, 3) of the samples.
    """

    low: FloatArray
    cell: float
    nearest: IntArray
    points: FloatArray
    normals: FloatArray

    def at(self, places: FloatArray) -> IntArray:
        """The sample near each of ``places`` (..., 3); far outside that of the nearest cell of the rim."""
        cells = np.floor((places - self.low) * (1 / self.cell)).astype(np.int64)
        x, y, z = (np.clip(cells[..., k], 0, n - 1) for k, n in enumerate(self.nearest.shape))
        return np.asarray(self.nearest[x, y, z])


class Poses(Struct, frozen=True, eq=False):
    """Many rigid transforms: rotations (B, 3, 3), origins (B, 3), mm."""

    rotations: FloatArray
    origins: FloatArray

    def __len__(self) -> int:
        return len(self.origins)

    def __getitem__(self, which: IntArray) -> Poses:
        return Poses(self.rotations[which], self.origins[which])

    def apply(self, points: FloatArray) -> FloatArray:
        """``points`` (n, 3) under each: (B, n, 3)."""
        moved = (
            (self.rotations.reshape(-1, 3) @ points.T).reshape(len(self), 3, -1).transpose(0, 2, 1)
        )
        return np.asarray(moved + self.origins[:, None])


def field(model: Model, samples: Cloud) -> DistanceField:
    """The field of a model."""
    side = float((model.high - model.low).max())
    cell = side / _CELLS
    low = model.low - _BEYOND * side
    counts = np.ceil((model.high + _BEYOND * side - low) / cell).astype(int)
    axes = [low[k] + cell * (np.arange(counts[k]) + 0.5) for k in range(3)]
    middles = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    nearest = samples.nearest(middles)[0][:, 0].reshape(tuple(counts))
    return DistanceField(low, cell, nearest, model.samples, model.sample_normals)


def rotations(count: int) -> FloatArray:
    """``count`` rotations (count, 3, 3) spread evenly over all there are (Alexa, Super-Fibonacci Spirals, 2022)."""
    s = np.arange(count) + 0.5
    t, d = s / count, 2 * np.pi * s
    near, far = np.sqrt(t), np.sqrt(1 - t)
    a, b = d / _PHI, d / _PSI
    x, y, z, w = near * np.sin(a), near * np.cos(a), far * np.sin(b), far * np.cos(b)
    return from_quaternions(w, x, y, z)


def slide(
    field: DistanceField, points: FloatArray, poses: Poses, scale: float, plain: float
) -> Poses:
    """One Gauss-Newton step of all ``poses`` (model_from_scan): ``points`` (n, 3) of the scan go to the planes of the
    samples that they are near to. scale: mm, beyond which a point counts little (Geman and McClure). plain: 0..1, how
    much the samples themselves pull besides their planes, which is what moves poses from afar.
    """
    at = poses.apply(points)
    which = field.at(at)
    normal, off = field.normals.take(which, axis=0), at - field.points.take(which, axis=0)
    weight = (scale**2 / (scale**2 + add_coordinates(off * off))) ** 2
    total = weight.sum(axis=1)
    centre = (weight[..., None] * at).sum(axis=1) / total[:, None]
    arm = at - centre[:, None]
    lines = np.concatenate([cross(arm, normal), normal], axis=2)
    pulled = lines * weight[..., None]
    matrix = pulled.transpose(0, 2, 1) @ lines
    towards = (pulled * add_coordinates(off * normal)[..., None]).sum(axis=1)
    heavy = arm * weight[..., None]
    square = np.einsum("bni,bnj->bij", heavy, arm)
    eye = np.eye(3)
    matrix[:, :3, :3] += plain * (np.trace(square, axis1=1, axis2=2)[:, None, None] * eye - square)
    matrix[:, 3:, 3:] += plain * total[:, None, None] * eye
    towards[:, :3] += plain * cross(heavy, off).sum(axis=1)
    towards[:, 3:] += plain * (off * weight[..., None]).sum(axis=1)
    matrix += (1e-6 * np.trace(matrix, axis1=1, axis2=2))[:, None, None] * np.eye(6)
    step = -np.linalg.solve(matrix, towards[..., None])[..., 0]
    turn = turn_poses(step[:, :3])
    origins = (turn @ (poses.origins - centre)[..., None])[..., 0] + centre + step[:, 3:]
    return Poses(turn @ poses.rotations, origins)


def turn_poses(vectors: FloatArray) -> FloatArray:
    """Rotations (B, 3, 3) by the length (rad, at most 0.5) about the direction of each of ``vectors`` (B, 3)."""
    angle = np.linalg.norm(vectors, axis=1)[:, None]
    return from_vectors(vectors * (_FARTHEST_TURN / np.maximum(angle, _FARTHEST_TURN)))


def fit(field: DistanceField, points: FloatArray, poses: Poses, scale: float) -> FloatArray:
    """How much of the scan each pose (B,) puts near the model, 0..1: 1 on it, 1/2 at ``scale`` mm."""
    at = poses.apply(points)
    off = at - field.points.take(field.at(at), axis=0)
    return np.asarray((scale**2 / (scale**2 + add_coordinates(off * off))).mean(axis=1))


def thin(points: FloatArray, count: int) -> FloatArray:
    """About ``count`` of ``points`` (N, 3), spread evenly in space however dense the scan is.

    A place with far fewer points than most is left out: a stray does not weigh as much as a patch.
    """
    low, span = points.min(axis=0), float(np.ptp(points, axis=0).max())
    cell, some = span / 2, points
    for _ in range(24):
        cells = np.floor((points - low) / cell).astype(np.int64)
        keys = (cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2]
        _, first, held = np.unique(keys, return_index=True, return_counts=True)
        some = points[first[held >= _SPARSE * np.median(held)]]
        if len(some) >= count:
            break
        cell *= 0.8
    return np.asarray(some)
