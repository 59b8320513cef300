"""The medial axis of a pocket as a graph of points: all centres that are equally near to two walls.

The walls are sampled, and the samples are joined to Delaunay triangles. The circle through the
corners of a triangle contains no other sample. So its centre is equally far from at least two
places of the walls, and nearer to none. The medial axis is the graph of these centres, with a link
between neighbouring triangles.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
from msgspec import Struct

from camgen.geometry.intersect import measure_nearest
from camgen.geometry.ragged import list_owners, number_rows
from camgen.geometry.segments import IntArray, Segments, points_at
from camgen.model.pose import FloatArray

#: Maximum number of samples on the walls of one pocket, in addition to one per segment.
_MAX_SAMPLES = 100_000
#: The points of the axis are closer together than the samples by this factor. A trochoidal loop
#: ends at a point, so wide distances between points would waste engagement.
_REFINEMENT = 4
#: Maximum distance of neighbouring points, as a fraction of their wall distance.
_WALL_FRACTION = 0.25
#: The distance that this fraction gives is raised to at least this fraction of the spacing.
_MIN_SPACING_FRACTION = 0.05
#: mm: samples are rounded to the first of these grids on which the triangulation succeeds. Wall
#: distances are measured afterwards, so the grid does not falsify them.
_GRIDS_MM = (1e-4, 1e-3, 1e-2)


class MedialAxis(Struct, frozen=True, eq=False):
    """A medial axis as a graph.

    points: (N, 2) points of the axis, mm.
    wall_distance: (N,) distance of each point from the nearest wall, mm.
    links: (E, 2) rows of the two points that each link joins.
    """

    points: FloatArray
    wall_distance: FloatArray
    links: IntArray


def compute_medial_axis(
    walls: Segments,
    following: IntArray,
    region: Any,
    min_distance: float,
    spacing: float,
    min_corner: float,
) -> MedialAxis:
    """The part of a pocket's medial axis that is farther than `min_distance` from the walls.

    walls: N segments of closed contours.
    following: (N,) row of the segment after each one, along its contour.
    region: polygon that the walls enclose.
    min_distance: mm.
    spacing: distance between samples of the walls, mm. Points of the axis are closer together,
        most of all near `min_distance`.
    min_corner: rad. Branches of the axis into a corner, or along a bend, in which the walls turn by
        less are left out.
    """
    samples, after = _sample_walls(walls, following, spacing)
    middle = samples.mean(axis=0)
    samples, triangles = _triangulate(samples - middle)
    samples = samples + middle
    centres, radii = _compute_circles(samples, triangles)
    arms = samples[triangles] - centres[:, None]
    arms /= np.maximum(np.hypot(*np.moveaxis(arms, 2, 0)), 1e-12)[..., None]
    cosines = (arms * np.roll(arms, 1, axis=1)).sum(axis=2)
    is_axis = np.isfinite(radii) & (radii > min_distance)
    is_axis &= cosines.min(axis=1) <= np.cos(min_corner)
    is_axis[is_axis] = shapely.contains_xy(region, centres[is_axis])
    links = _link_triangles(triangles[is_axis], after)
    points, links = _divide_links(
        centres[is_axis], links, radii[is_axis] - min_distance, spacing / _REFINEMENT
    )
    search_radius = float(radii[is_axis].max(initial=0.0)) + spacing
    return MedialAxis(points, measure_nearest(points, walls, search_radius), links)


def _divide_links(
    points: FloatArray, links: IntArray, free: FloatArray, spacing: float
) -> tuple[FloatArray, IntArray]:
    """Add points along the links until neighbours are close together.

    Their distance becomes at most `spacing`, and at most `_WALL_FRACTION` of `free`.

    points: (N, 2).
    links: (E, 2).
    free: (N,) wall distance of each point above the minimum, mm.
    spacing: mm.

    Returns all points and the links between them; the first N points are the given ones.
    """
    first, second = links.T
    length = np.hypot(*(points[second] - points[first]).T)
    max_spacing = np.clip(
        _WALL_FRACTION * np.minimum(free[first], free[second]),
        _MIN_SPACING_FRACTION * spacing,
        spacing,
    )
    count = np.maximum(np.ceil(length / max_spacing), 1).astype(np.int64)
    link, step = list_owners(count), number_rows(count)
    is_added = step > 0
    fraction = (step / count[link])[:, None]
    positions = points[first[link]] * (1 - fraction) + points[second[link]] * fraction
    start = np.where(is_added, len(points) + np.cumsum(is_added) - 1, first[link])
    end = np.where(step + 1 < count[link], np.roll(start, -1), second[link])
    return np.vstack([points, positions[is_added]]), np.column_stack([start, end])


def _sample_walls(
    walls: Segments, following: IntArray, spacing: float
) -> tuple[FloatArray, IntArray]:
    """Sample the walls at most `spacing` mm apart, or as densely as `_MAX_SAMPLES` allows.

    Returns the samples (M, 2), all corners among them, and the row (M,) of the next sample along
    the same wall.
    """
    spacing = max(spacing, float(walls.length.sum()) / _MAX_SAMPLES)
    count = np.maximum(np.ceil(walls.length / spacing), 1).astype(np.int64)
    row, step = list_owners(count), number_rows(count)
    samples = points_at(walls.take(row), step / count[row])
    first = np.cumsum(count) - count
    after = np.where(step + 1 < count[row], np.arange(len(row)) + 1, first[following[row]])
    return samples, after


def _triangulate(samples: FloatArray) -> tuple[FloatArray, IntArray]:
    """The Delaunay triangles of `samples` (N, 2), which are rounded to a grid.

    GEOS sometimes fails on samples of one circle, and much less often on a grid.

    Returns the rounded samples (N, 2) and the rows (T, 3) of the corners of the triangles. There
    are no triangles if GEOS fails on all grids.
    """
    for grid in _GRIDS_MM:
        rounded = np.round(samples / grid) * grid
        try:
            triangles = shapely.get_parts(shapely.delaunay_triangles(shapely.multipoints(rounded)))
        except shapely.GEOSException:
            continue
        return rounded, _find_corners(rounded, shapely.get_coordinates(triangles))
    return samples, np.zeros((0, 3), dtype=np.int64)


def _find_corners(samples: FloatArray, rings: FloatArray) -> IntArray:
    """The rows (T, 3) of `samples` that are the corners of triangles.

    rings: (4 T, 2) corners of the triangles as closed rings of four points.
    """
    corners = rings.reshape(-1, 4, 2)[:, :3].reshape(-1, 2)
    # The coordinates of a corner equal those of its sample exactly. The first of several equal
    # samples counts.
    _, distinct = np.unique(np.vstack([samples, corners]), axis=0, return_inverse=True)
    distinct = distinct.reshape(-1)
    first_sample = np.full(int(distinct.max()) + 1, -1)
    first_sample[distinct[: len(samples)][::-1]] = np.arange(len(samples))[::-1]
    return np.asarray(first_sample[distinct[len(samples) :]].reshape(-1, 3))


def _compute_circles(samples: FloatArray, triangles: IntArray) -> tuple[FloatArray, FloatArray]:
    """Centres (T, 2) and radii (T,) of the circles through the corners of triangles, mm.

    The radius is inf if the corners lie on one line.
    """
    a, b, c = np.moveaxis(samples[triangles], 1, 0)
    b, c = b - a, c - a
    twice_area = 2 * (b[:, 0] * c[:, 1] - b[:, 1] * c[:, 0])
    is_flat = np.abs(twice_area) < 1e-12
    bb, cc = (b**2).sum(axis=1), (c**2).sum(axis=1)
    divisor = np.where(is_flat, 1.0, twice_area)
    x = c[:, 1] * bb - b[:, 1] * cc
    y = b[:, 0] * cc - c[:, 0] * bb
    arm = np.column_stack([x, y]) / divisor[:, None]
    return a + arm, np.where(is_flat, np.inf, np.hypot(*arm.T))


def _link_triangles(triangles: IntArray, after: IntArray) -> IntArray:
    """Pairs (E, 2) of triangles that share a side.

    A side between two neighbouring samples of a wall does not count: that link would cross the
    wall, or run straight towards it.

    triangles: (T, 3) rows of samples.
    after: (M,) next sample of each along its wall.
    """
    sides = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    sides = np.sort(sides, axis=1)
    triangle = np.tile(np.arange(len(triangles)), 3)
    order = np.lexsort(sides.T)
    sides, triangle = sides[order], triangle[order]
    shared = np.flatnonzero((sides[1:] == sides[:-1]).all(axis=1))
    first, second = sides[shared].T
    is_free = (after[first] != second) & (after[second] != first)
    return np.column_stack([triangle[shared][is_free], triangle[shared + 1][is_free]])
