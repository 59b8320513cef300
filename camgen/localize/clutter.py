"""The points of a scan that are not the part: isolated points, and the bench under the part."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.geometry.vectors import multiply_rows, normalize
from camgen.localize.coarse import thin_out
from camgen.localize.groups import pick_rows
from camgen.localize.model import Cloud, Model, cross_edges
from camgen.model.part import BoolArray
from camgen.model.pose import FloatArray
from camgen.model.tolerance import SIGMAS_OF_MEDIAN

#: A point is isolated if its third neighbour is farther than this many times the median of all.
#: A surface that is seen at 86 deg from its normal has that spacing.
_NEIGHBOURS, _ISOLATED = 3, 4.0
#: Places, and neighbours of each, that show the noise.
_NOISE_PLACES, _NOISE_NEIGHBOURS = 400, 12
#: Points that show the plane of a bench, and triples that are drawn from them with a fixed seed.
_PLANE_POINTS, _TRIES = 3000, 300
#: A point lies in a plane within this many standard deviations of the noise, and within this share
#: of the model's size: a bench is not quite flat.
_IN_PLANE, _FLATNESS = 3.5, 1e-3
#: Planes that are examined.
_MOST_PLANES = 3
#: A bench holds at least this share of its candidates, and has this share of the rest on one side.
_LEAST_BENCH, _ONE_SIDE = 0.05, 0.95
#: A plane is larger than each flat face of the model if its area is larger by this factor.
_LARGER = 1.25
#: Triangles belong to one face within these steps of the normal and of the distance. The distance
#: is a share of the model's size.
_SAME_NORMAL, _SAME_PLANE = 0.02, 2e-3


class Bench(Struct, frozen=True, eq=False):
    """A plane with the scene on one side.

    normal: (3,), unit, towards the scene and the scanner.
    height: the height of the plane along the normal, mm.
    within: the distance up to which a point lies in the plane, mm.
    certain: whether the plane is larger than each face of the model.
    """

    normal: FloatArray
    height: float
    within: float
    certain: bool

    def carries(self, places: FloatArray, slack: float) -> bool:
        """Whether all `places` (N, 3) are above the plane, up to the noise and `slack` (mm)."""
        return float((places @ self.normal).min()) - self.height > -(2 * self.within + slack)

    def holds(self, points: FloatArray) -> BoolArray:
        """Whether each of `points` (N, 3) lies in the plane or below it: (N,)."""
        return np.asarray(points @ self.normal - self.height < self.within)


def find_isolated(points: FloatArray) -> BoolArray:
    """Whether each of `points` (N, 3) is far from all others, as strays and flying pixels are.

    The points of a sparse surface are not: they lie in the planes of their neighbours.
    """
    cloud = Cloud(points)
    distances = cloud.find_neighbours(points, min(_NEIGHBOURS + 1, len(points)))[1][:, -1]
    far = distances > _ISOLATED * float(np.median(distances))
    suspects = np.flatnonzero(far)
    if not len(suspects) or len(points) <= _NOISE_NEIGHBOURS:
        return np.asarray(far)
    noise = measure_noise(points[~far])
    around = points[cloud.find_neighbours(points[suspects], _NOISE_NEIGHBOURS + 1)[0][:, 1:]]
    middles = around.mean(axis=1)
    _, spreads, axes = np.linalg.svd(around - middles[:, None], full_matrices=False)
    thickness = spreads[:, 2] / np.sqrt(_NOISE_NEIGHBOURS - 3)
    offsets = np.abs(multiply_rows(points[suspects] - middles, axes[:, 2]))
    far[suspects[(thickness <= _IN_PLANE * noise) & (offsets <= 2 * _IN_PLANE * noise)]] = False
    return np.asarray(far)


def measure_noise(points: FloatArray) -> float:
    """The standard deviation of `points` (N, 3) about the planes through their neighbours, mm."""
    count = min(_NOISE_NEIGHBOURS, len(points))
    places = pick_rows(points, _NOISE_PLACES)
    patches = points[Cloud(points).find_neighbours(places, count)[0]]
    patches = patches - patches.mean(axis=1, keepdims=True)
    least = np.linalg.svd(patches, compute_uv=False)[:, -1]
    return float(np.median(least)) / float(np.sqrt(max(count - 3, 1)))


def find_benches(model: Model, points: FloatArray, among: FloatArray | None = None) -> list[Bench]:
    """Planes that may be the bench, the one with most points first.

    The scene lies on one side of a bench. A face of the part may be such a plane too.

    points: (N, 3), the scene.
    among: (M, 3), the points that may be the bench; None for all.
    """
    pending = points if among is None else among
    least = _LEAST_BENCH * len(pending)
    within = max(_IN_PLANE * measure_noise(points), _FLATNESS * model.size)
    benches: list[Bench] = []
    for _ in range(_MOST_PLANES):
        if len(pending) <= _NEIGHBOURS:
            break
        plane = _fit_plane(thin_out(pending, _PLANE_POINTS), within)
        if plane is None:
            break
        normal, height = plane
        on_plane = np.abs(pending @ normal - height) < within
        if np.count_nonzero(on_plane) >= least:
            bench = _make_bench(model, points, normal, height, within)
            benches += [bench] if bench else []
            if bench and bench.certain:
                break
        pending = pending[~on_plane]
    return benches


def _make_bench(
    model: Model, points: FloatArray, normal: FloatArray, height: float, within: float
) -> Bench | None:
    """The plane as a bench under `points` (N, 3), None if the points are on both sides."""
    offsets = points @ normal - height
    off_plane = np.abs(offsets) >= within
    above = float(np.mean(offsets[off_plane] > 0)) if off_plane.any() else 1.0
    if above < 0.5:
        normal, height, above = -normal, -height, 1 - above
    if above < _ONE_SIDE:
        return None
    larger = _measure_covered(points[~off_plane], normal) > _LARGER * _measure_largest_face(model)
    return Bench(normal, height, within, larger)


def _fit_plane(points: FloatArray, within: float) -> tuple[FloatArray, float] | None:
    """The unit normal (3,) and the height, mm, of the plane with most of `points` (N, 3).

    MSAC (Torr and Zisserman, MLESAC, 2000) finds it, least squares refine it.
    """
    drawn = np.random.default_rng(0).integers(0, len(points), (_TRIES, 3))
    a, b, c = points[drawn.T]
    normals = normalize(np.cross(b - a, c - a))
    heights = (normals * a).sum(axis=1)
    proper = normals.any(axis=1)
    if not proper.any():
        return None
    offsets = points @ normals[proper].T - heights[proper]
    best = int(np.minimum((offsets / within) ** 2, 1.0).sum(axis=0).argmin())
    normal, height = normals[proper][best], float(heights[proper][best])
    for _ in range(3):
        near = points[np.abs(points @ normal - height) < within]
        if len(near) < _NEIGHBOURS:
            return None
        middle = near.mean(axis=0)
        fitted = np.linalg.svd(near - middle, full_matrices=False)[2][2]
        normal = fitted * np.sign(fitted @ normal)
        height = float(normal @ middle)
    return normal, height


def _measure_covered(points: FloatArray, normal: FloatArray) -> float:
    """The area that `points` (N, 3) of a plane cover, mm2: in cells three spacings wide."""
    first = np.cross(normal, np.eye(3)[int(np.abs(normal).argmin())])
    first /= np.linalg.norm(first)
    flat = points @ np.column_stack([first, np.cross(normal, first)])
    spacings = Cloud(points).find_neighbours(pick_rows(points, 1000), 2)[1][:, 1]
    cell = 3 * float(np.median(spacings)) / SIGMAS_OF_MEDIAN
    cells = np.unique(np.floor(flat / max(cell, 1e-9)).astype(np.int64), axis=0)
    return len(cells) * cell * cell


def _measure_largest_face(model: Model) -> float:
    areas = np.linalg.norm(cross_edges(model.tree.corners), axis=1) / 2
    heights = (model.normals * model.tree.corners[:, 0]).sum(axis=1) / (_SAME_PLANE * model.size)
    keys = np.rint(np.column_stack([model.normals / _SAME_NORMAL, heights])).astype(np.int64)
    _, face = np.unique(keys, axis=0, return_inverse=True)
    return float(np.bincount(face.reshape(-1), weights=areas).max())
