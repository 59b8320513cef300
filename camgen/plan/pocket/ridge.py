"""The ridge of a pocket: where two of its walls are equally near (its medial axis), as a graph of places.

Samples of the walls are joined to Delaunay triangles; a circle through the corners of one holds no other sample, so
that its centre is as far from two walls or more, and nearer to none. The ridge runs from triangle to triangle.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
from msgspec import Struct

from camgen.geometry.intersect import nearest_distances
from camgen.geometry.ragged import owners, ramp
from camgen.geometry.segments import IntArray, Segments, points_at
from camgen.model.pose import FloatArray

#: Samples of the walls of one pocket at most, beside one for each of its segments.
_MOST_SAMPLES = 100_000
#: Places lie closer than samples by this factor. A loop ends at a place, so that wide distances
#: between them would waste engagement.
_FINER = 4
#: Places lie no farther apart than this share of the room about them, but no nearer than that share of the spacing.
_SHARE, _LEAST_SHARE = 0.25, 0.05
#: Samples are moved to places of a grid of so many mm, or of the next one; how near the walls are is measured anew.
_GRIDS = (1e-4, 1e-3, 1e-2)


class Ridge(Struct, frozen=True, eq=False):
    """points: (N, 2). room: (N,) mm from the nearest wall. links: (E, 2) the rows of places beside each other."""

    points: FloatArray
    room: FloatArray
    links: IntArray


def ridge(
    walls: Segments, following: IntArray, region: Any, first: float, spacing: float, turn: float
) -> Ridge:
    """The ridge in ``region``, which the closed ``walls`` enclose, where it is more than ``first`` mm from them.

    following: (N,) the next segment of each. spacing: mm between samples of the walls; places lie
    closer, above all near ``first``. turn: rad; left out is what runs into a corner, or along a
    bend, where the walls turn by less.
    """
    samples, after = _sample(walls, following, spacing)
    middle = samples.mean(axis=0)
    samples, triangles = _triangulate(samples - middle)
    samples = samples + middle
    centres, room = _circles(samples, triangles)
    arms = samples[triangles] - centres[:, None]
    arms /= np.maximum(np.hypot(*np.moveaxis(arms, 2, 0)), 1e-12)[..., None]
    cosines = (arms * np.roll(arms, 1, axis=1)).sum(axis=2)
    kept = np.isfinite(room) & (room > first) & (cosines.min(axis=1) <= np.cos(turn))
    kept[kept] = shapely.contains_xy(region, centres[kept])
    links = _links(triangles[kept], after)
    points, links = _divide(centres[kept], links, room[kept] - first, spacing / _FINER)
    reach = float(room[kept].max(initial=0.0)) + spacing
    return Ridge(points, nearest_distances(points, walls, reach), links)


def _divide(
    points: FloatArray, links: IntArray, room: FloatArray, spacing: float
) -> tuple[FloatArray, IntArray]:
    """Places and links with more places along the links: no farther apart than ``spacing`` mm, nor than a share of the
    ``room`` (N,) about them.
    """
    one, two = links.T
    length = np.hypot(*(points[two] - points[one]).T)
    most = np.clip(_SHARE * np.minimum(room[one], room[two]), _LEAST_SHARE * spacing, spacing)
    count = np.maximum(np.ceil(length / most), 1).astype(np.int64)
    link, step = owners(count), ramp(count)
    inner = step > 0
    share = (step / count[link])[:, None]
    along = points[one[link]] * (1 - share) + points[two[link]] * share
    name = np.where(inner, len(points) + np.cumsum(inner) - 1, one[link])
    after = np.where(step + 1 < count[link], np.roll(name, -1), two[link])
    return np.vstack([points, along[inner]]), np.column_stack([name, after])


def _sample(walls: Segments, following: IntArray, spacing: float) -> tuple[FloatArray, IntArray]:
    """Points (M, 2) on the walls, their corners among them, and the next one (M,) of each along its wall."""
    spacing = max(spacing, float(walls.length.sum()) / _MOST_SAMPLES)
    count = np.maximum(np.ceil(walls.length / spacing), 1).astype(np.int64)
    row, place = owners(count), ramp(count)
    samples = points_at(walls.take(row), place / count[row])
    first = np.cumsum(count) - count
    after = np.where(place + 1 < count[row], np.arange(len(row)) + 1, first[following[row]])
    return samples, after


def _triangulate(samples: FloatArray) -> tuple[FloatArray, IntArray]:
    """``samples`` (N, 2) on a grid, and the rows (T, 3) of them: the corners of the Delaunay triangles.

    GEOS loses its way between samples of one circle now and then, on a grid much less; none where all grids fail.
    """
    for grid in _GRIDS:
        snapped = np.round(samples / grid) * grid
        try:
            made = shapely.get_parts(shapely.delaunay_triangles(shapely.multipoints(snapped)))
        except shapely.GEOSException:
            continue
        return snapped, _corners(snapped, shapely.get_coordinates(made))
    return samples, np.zeros((0, 3), dtype=np.int64)


def _corners(samples: FloatArray, found: FloatArray) -> IntArray:
    """(T, 3) rows of ``samples``: of triangles that are ``found`` as closed rings of four points each."""
    if not len(found):
        return np.zeros((0, 3), dtype=np.int64)
    corners = found.reshape(-1, 4, 2)[:, :3].reshape(-1, 2)
    # Corners are samples to the bit: each is found by its coordinates, the first of equal ones.
    _, of = np.unique(np.vstack([samples, corners]), axis=0, return_inverse=True)
    of = of.reshape(-1)
    first = np.full(int(of.max()) + 1, -1)
    first[of[: len(samples)][::-1]] = np.arange(len(samples))[::-1]
    return np.asarray(first[of[len(samples) :]].reshape(-1, 3))


def _circles(samples: FloatArray, triangles: IntArray) -> tuple[FloatArray, FloatArray]:
    """Centres (T, 2) and radii (T,) of the circles through the corners; inf for flat triangles."""
    a, b, c = np.moveaxis(samples[triangles], 1, 0)
    b, c = b - a, c - a
    twice = 2 * (b[:, 0] * c[:, 1] - b[:, 1] * c[:, 0])
    flat = np.abs(twice) < 1e-12
    bb, cc = (b**2).sum(axis=1), (c**2).sum(axis=1)
    safe = np.where(flat, 1.0, twice)
    arm = (
        np.column_stack([c[:, 1] * bb - b[:, 1] * cc, b[:, 0] * cc - c[:, 0] * bb]) / safe[:, None]
    )
    return a + arm, np.where(flat, np.inf, np.hypot(*arm.T))


def _links(triangles: IntArray, after: IntArray) -> IntArray:
    """Pairs (E, 2) of triangles beside each other, but for those between which a wall runs, or that a spur to it."""
    count = len(triangles)
    ends = np.sort(
        np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1
    )
    of = np.tile(np.arange(count), 3)
    order = np.lexsort(ends.T)
    ends, of = ends[order], of[order]
    same = np.flatnonzero((ends[1:] == ends[:-1]).all(axis=1))
    one, two = ends[same].T
    apart = (after[one] != two) & (after[two] != one)
    return np.column_stack([of[same][apart], of[same + 1][apart]])
