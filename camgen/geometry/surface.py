"""The nearest place of a surface of triangles, and its outward normal there, smooth over the seams of smooth faces."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.geometry.vectors import angles, cross, dots, unit
from camgen.model.part import FEATURE_ANGLE, BoolArray, IntArray, Solid
from camgen.model.pose import FloatArray

#: Pairs of a point and a face that are looked at in one go.
_PAIRS = 4_000_000
#: Distances that differ by less, mm, are the same: of such faces the first is taken.
_EVEN = 1e-9


class Nearest(Struct, frozen=True, eq=False):
    """Of M points: the nearest place (M, 3) of a surface, how far it is (M,), mm, and the unit normal there (M, 3)."""

    place: FloatArray
    apart: FloatArray
    normal: FloatArray


def nearest(solid: Solid, points: FloatArray) -> Nearest:
    """The place of ``solid`` that is nearest to each of ``points`` (M, 3).

    The normal is that of the face, blended over its corners with the faces that meet it smoothly, as a surface from
    which the triangles were made has it: of a cylinder the normal runs round evenly.
    """
    corners = solid.vertices[solid.faces]
    centres = corners.mean(axis=1)
    radii = np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1)
    face, place = np.zeros(len(points), dtype=np.int64), np.zeros_like(points)
    step = max(1, _PAIRS // max(len(corners), 1))
    for begin in range(0, len(points), step):
        some = slice(begin, begin + step)
        face[some], place[some] = _nearest_faces(corners, centres, radii, points[some])
    apart = np.linalg.norm(points - place, axis=1)
    return Nearest(place, apart, _normals(solid, corners, face, place))


def _nearest_faces(
    corners: FloatArray, centres: FloatArray, radii: FloatArray, points: FloatArray
) -> tuple[IntArray, FloatArray]:
    """The nearest face (M,) and the place on it (M, 3)."""
    square = dots(points, points)[:, None] + dots(centres, centres) - 2 * points @ centres.T
    way = np.sqrt(np.maximum(square, 0.0))
    # No face whose disc about its centre is farther than the nearest centre can be the nearest.
    row, face = np.nonzero(way - radii <= way.min(axis=1)[:, None] + 1e-6)
    place = _on_triangles(points[row], corners[face])
    apart = np.linalg.norm(points[row] - place, axis=1)
    order = np.lexsort((face, np.round(apart / _EVEN), row))
    first = order[np.searchsorted(row[order], np.arange(len(points)))]
    return face[first], place[first]


def _on_triangles(points: FloatArray, corners: FloatArray) -> FloatArray:
    """The nearest point (K, 3) of each triangle (K, 3, 3): within it, else on one of its sides."""
    shares = _shares(points, corners)
    inside: BoolArray = np.asarray((shares >= 0).all(axis=1))
    best = (shares[:, :, None] * corners).sum(axis=1)
    apart = np.where(inside, 0.0, np.inf)
    for a, b in ((0, 1), (1, 2), (2, 0)):
        start, along = corners[:, a], corners[:, b] - corners[:, a]
        length = dots(along, along)
        share = np.clip(dots(points - start, along) / np.where(length > 0, length, 1.0), 0.0, 1.0)
        place = start + share[:, None] * along
        way = np.linalg.norm(points - place, axis=1)
        nearer = ~inside & (way < apart)
        best[nearer], apart[nearer] = place[nearer], way[nearer]
    return np.asarray(best)


def _shares(points: FloatArray, corners: FloatArray) -> FloatArray:
    """(K, 3) of each corner in the foot of the point on the triangle's plane; negative for a triangle without area."""
    one, two, out = (
        corners[:, 1] - corners[:, 0],
        corners[:, 2] - corners[:, 0],
        points - corners[:, 0],
    )
    normal = cross(one, two)
    area = dots(normal, normal)
    safe = np.where(area > 0, area, 1.0)
    second, third = dots(cross(out, two), normal) / safe, dots(cross(one, out), normal) / safe
    shares = np.column_stack([1 - second - third, second, third])
    shares[area <= 0] = -1.0
    return shares


def _normals(solid: Solid, corners: FloatArray, face: IntArray, place: FloatArray) -> FloatArray:
    """Unit normals (M, 3) at places on faces."""
    known, back = np.unique(face, return_inverse=True)
    blended = _corner_normals(solid, corners, known)
    shares = np.clip(_shares(place, corners[face]), 0.0, 1.0)
    mixed = (shares[:, :, None] * blended[back]).sum(axis=1)
    plain = solid.normals[face]
    return np.asarray(np.where((dots(mixed, mixed) > 0)[:, None], unit(mixed), plain))


def _corner_normals(solid: Solid, corners: FloatArray, faces: IntArray) -> FloatArray:
    """(K, 3, 3) unit normals at the corners of ``faces``: the mean over the faces round the corner that meet smoothly,
    each with the angle that it has there.
    """
    flat = solid.faces.ravel()
    order = np.argsort(flat, kind="stable")
    first = np.searchsorted(flat[order], np.arange(len(solid.vertices) + 1))
    made = np.empty((len(faces), 3, 3))
    for k, face in enumerate(faces.tolist()):
        own = solid.normals[face]
        for c, vertex in enumerate(solid.faces[face].tolist()):
            around, at = np.divmod(order[first[vertex] : first[vertex + 1]], 3)
            smooth = solid.normals[around] @ own > np.cos(FEATURE_ANGLE)
            around, at = around[smooth], at[smooth]
            here = corners[around, at]
            spread = angles(
                corners[around, (at + 1) % 3] - here, corners[around, (at + 2) % 3] - here
            )
            total = (spread[:, None] * solid.normals[around]).sum(axis=0)
            made[k, c] = total if total.any() else own
    return unit(made)
