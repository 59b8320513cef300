"""The faces of a 3-D part: what of its surface lies between sharp edges, with ids as users see them."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from msgspec import Struct

from camgen.geometry.vectors import cross
from camgen.model.part import FEATURE_ANGLE, Edge, IntArray, Solid
from camgen.model.pose import FloatArray
from camgen.read.solid.topology import components, pair

#: mm: triangles that are so near to an edge, beside the nearest one, are beside it.
_BESIDE = 0.01
#: A face whose triangles look so nearly the same way (cosine) is flat.
_FLAT = float(np.cos(np.radians(1.0)))
#: Places are compared in steps of this (mm) for the order of faces.
_STEP = 1e-3


class Face(Struct, frozen=True, eq=False):
    """id: "f1" and on, from the highest to the lowest by their middles, then by y, then by x. area: mm2. looks: (3,)
    unit outward normal of a flat face, else None.
    """

    id: str
    area: float
    looks: FloatArray | None


class Faces(Struct, frozen=True, eq=False):
    """listed: by id. of: (F,) the place in ``listed`` of every triangle's face."""

    listed: tuple[Face, ...]
    of: IntArray


def faces_of(solid: Solid) -> Faces:
    """The faces of ``solid``: triangles that meet at less than ``FEATURE_ANGLE`` are one."""
    met = pair(solid.faces)
    a, b = met.first // 3, met.second // 3
    smooth = (solid.normals[a] * solid.normals[b]).sum(axis=1) > np.cos(FEATURE_ANGLE)
    roots, of = np.unique(components(len(solid.faces), a[smooth], b[smooth]), return_inverse=True)
    corners = solid.vertices[solid.faces]
    areas = (
        np.linalg.norm(cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        / 2
    )
    low, high = np.full((len(roots), 3), np.inf), np.full((len(roots), 3), -np.inf)
    np.minimum.at(low, of, corners.min(axis=1))
    np.maximum.at(high, of, corners.max(axis=1))
    area, mean = np.bincount(of, areas), np.zeros((len(roots), 3))
    np.add.at(mean, of, solid.normals * areas[:, None])
    key = np.floor(((low + high) / 2 * (1, 1, -1))[:, [2, 1, 0]] / _STEP + 0.4637)
    order = np.lexsort((roots, *key.T[::-1]))
    rank = np.argsort(order)
    looks = mean / np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-12)
    least = np.ones(len(roots))
    np.minimum.at(least, of, (solid.normals * looks[of]).sum(axis=1))
    listed = tuple(
        Face(f"f{k}", float(area[face]), looks[face] if least[face] > _FLAT else None)
        for k, face in enumerate(order.tolist(), start=1)
    )
    return Faces(listed, rank[of])


def beside(edges: Iterable[Edge], solid: Solid, faces: Faces) -> dict[str, tuple[int, int]]:
    """By the id of each edge the places in ``faces.listed`` of its two faces, the one of its first normal first."""
    corners = solid.vertices[solid.faces]
    centre = corners.mean(axis=1)
    round_ = np.linalg.norm(corners - centre[:, None], axis=2).max(axis=1)
    found = {}
    for edge in edges:
        span = len(edge.via) // 2
        point = (
            (edge.points[span] + edge.points[span + 1]) / 2
            if edge.kind == "line"
            else edge.via[span]
        )
        far = np.linalg.norm(centre - point, axis=1)
        near = np.flatnonzero(far - round_ <= 2 * far.min() + _BESIDE)
        gap = _gaps(point, corners[near])
        near = near[gap <= 2 * gap.min() + _BESIDE]
        one, other = (
            int(near[(solid.normals[near] @ normal).argmax()]) for normal in edge.via_normals[span]
        )
        found[edge.id] = int(faces.of[one]), int(faces.of[other])
    return found


def _gaps(point: FloatArray, corners: FloatArray) -> FloatArray:
    """(N,) mm from a point to the borders of triangles (N, 3, 3)."""
    along = np.roll(corners, -1, axis=1) - corners
    away = point - corners
    share = (away * along).sum(axis=2) / np.maximum((along * along).sum(axis=2), 1e-300)
    gap = np.linalg.norm(away - np.clip(share, 0.0, 1.0)[..., None] * along, axis=2)
    return np.asarray(gap.min(axis=1))
