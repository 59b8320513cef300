"""Nearest points on a surface of triangles, with outward normals interpolated over smooth edges."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.geometry.vectors import cross, measure_angles, multiply_rows, normalize
from camgen.model.part import FEATURE_ANGLE, BoolArray, IntArray, Solid
from camgen.model.pose import FloatArray

#: Pairs of a point and a face in a batch: bounds the memory.
_PAIR_BATCH = 4_000_000
#: mm: distances that differ by less are equal, and the first face at that distance is taken.
_SAME_DISTANCE_MM = 1e-9
#: mm: rounding of the bound by which faces are excluded.
_ROUNDING_MM = 1e-6


def is_closed(faces: IntArray, count: int) -> bool:
    """Whether every side of a triangle is also run in the other direction, equally often.

    faces: (F, 3) rows of `count` vertices.
    """
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    return bool(np.array_equal(np.sort(start * count + end), np.sort(end * count + start)))


class Nearest(Struct, frozen=True, eq=False):
    """The points of a surface that are nearest to M points.

    place: (M, 3) point on the surface, mm.
    distance: (M,) distance from it, mm.
    normal: (M, 3) unit outward normal there.
    """

    place: FloatArray
    distance: FloatArray
    normal: FloatArray


def find_nearest(solid: Solid, points: FloatArray) -> Nearest:
    """The point on the surface of `solid` that is nearest to each of `points` (M, 3), mm.

    The normal is interpolated over the corners of the face, where faces that meet smoothly share
    a normal. So it follows the surface from which the triangles were made: around a cylinder it
    changes evenly.
    """
    corners = solid.vertices[solid.faces]
    centres = corners.mean(axis=1)
    radii = np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1)
    face, place = np.zeros(len(points), dtype=np.int64), np.zeros_like(points)
    step = max(1, _PAIR_BATCH // max(len(corners), 1))
    for begin in range(0, len(points), step):
        batch = slice(begin, begin + step)
        face[batch], place[batch] = _find_faces(corners, centres, radii, points[batch])
    distance = np.linalg.norm(points - place, axis=1)
    return Nearest(place, distance, _interpolate_normals(solid, corners, face, place))


def _find_faces(
    corners: FloatArray, centres: FloatArray, radii: FloatArray, points: FloatArray
) -> tuple[IntArray, FloatArray]:
    """The nearest face (M,) and the nearest point on it (M, 3)."""
    square = (
        multiply_rows(points, points)[:, None]
        + multiply_rows(centres, centres)
        - 2 * points @ centres.T
    )
    to_centre = np.sqrt(np.maximum(square, 0.0))
    # A face cannot be the nearest if its whole sphere about its centre is farther away than the
    # nearest centre.
    limit = to_centre.min(axis=1)[:, None] + _ROUNDING_MM
    row, face = np.nonzero(to_centre - radii <= limit)
    place = _project_on_triangles(points[row], corners[face])
    distance = np.linalg.norm(points[row] - place, axis=1)
    order = np.lexsort((face, np.round(distance / _SAME_DISTANCE_MM), row))
    first = order[np.searchsorted(row[order], np.arange(len(points)))]
    return face[first], place[first]


def _project_on_triangles(points: FloatArray, corners: FloatArray) -> FloatArray:
    """The nearest point (K, 3) of triangle k of `corners` (K, 3, 3) to point k.

    It is the foot of the perpendicular if that is inside, else the nearest point of the sides.
    """
    weights = _compute_weights(points, corners)
    inside: BoolArray = np.asarray((weights >= 0).all(axis=1))
    best = (weights[:, :, None] * corners).sum(axis=1)
    best_distance = np.where(inside, 0.0, np.inf)
    for a, b in ((0, 1), (1, 2), (2, 0)):
        start, side = corners[:, a], corners[:, b] - corners[:, a]
        square = multiply_rows(side, side)
        fraction = np.clip(
            multiply_rows(points - start, side) / np.where(square > 0, square, 1.0), 0.0, 1.0
        )
        place = start + fraction[:, None] * side
        distance = np.linalg.norm(points - place, axis=1)
        nearer = ~inside & (distance < best_distance)
        best[nearer], best_distance[nearer] = place[nearer], distance[nearer]
    return np.asarray(best)


def _compute_weights(points: FloatArray, corners: FloatArray) -> FloatArray:
    """(K, 3) barycentric coordinates of each point's foot on the plane of its triangle.

    They are -1 for a triangle without area.
    """
    first_side = corners[:, 1] - corners[:, 0]
    second_side = corners[:, 2] - corners[:, 0]
    arm = points - corners[:, 0]
    normal = cross(first_side, second_side)
    area = multiply_rows(normal, normal)
    safe = np.where(area > 0, area, 1.0)
    second = multiply_rows(cross(arm, second_side), normal) / safe
    third = multiply_rows(cross(first_side, arm), normal) / safe
    weights = np.column_stack([1 - second - third, second, third])
    weights[area <= 0] = -1.0
    return weights


def _interpolate_normals(
    solid: Solid, corners: FloatArray, face: IntArray, place: FloatArray
) -> FloatArray:
    """Unit normals (M, 3) at points `place` (M, 3) on faces `face` (M,)."""
    faces, index = np.unique(face, return_inverse=True)
    at_corners = _corner_normals(solid, corners, faces)
    weights = np.clip(_compute_weights(place, corners[face]), 0.0, 1.0)
    mixed = (weights[:, :, None] * at_corners[index]).sum(axis=1)
    plain = solid.normals[face]
    return np.asarray(np.where((multiply_rows(mixed, mixed) > 0)[:, None], normalize(mixed), plain))


def _corner_normals(solid: Solid, corners: FloatArray, faces: IntArray) -> FloatArray:
    """(K, 3, 3) unit normals at the corners of `faces` (K,).

    Each is the mean normal of the faces that share the corner and meet this face smoothly, weighted
    with their angles at the corner.
    """
    flat = solid.faces.ravel()
    order = np.argsort(flat, kind="stable")
    first = np.searchsorted(flat[order], np.arange(len(solid.vertices) + 1))
    result = np.empty((len(faces), 3, 3))
    for k, face in enumerate(faces.tolist()):
        face_normal = solid.normals[face]
        for c, vertex in enumerate(solid.faces[face].tolist()):
            sharing, corner = np.divmod(order[first[vertex] : first[vertex + 1]], 3)
            smooth = solid.normals[sharing] @ face_normal > np.cos(FEATURE_ANGLE)
            sharing, corner = sharing[smooth], corner[smooth]
            apex = corners[sharing, corner]
            next_side = corners[sharing, (corner + 1) % 3] - apex
            last_side = corners[sharing, (corner + 2) % 3] - apex
            weight = measure_angles(next_side, last_side)
            total = (weight[:, None] * solid.normals[sharing]).sum(axis=0)
            result[k, c] = total if total.any() else face_normal
    return normalize(result)
