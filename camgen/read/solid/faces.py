"""The faces and bodies of a 3-D part.

Faces are regions of its surface between sharp edges, with ids for the user. Bodies are connected
surfaces, with the names that the file gives them.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from msgspec import Struct

from camgen.geometry.vectors import cross
from camgen.model.part import FEATURE_ANGLE, BoolArray, Edge, IntArray, Solid
from camgen.model.pose import FloatArray
from camgen.model.text import harmless
from camgen.read.solid.soup import NamedVertices
from camgen.read.solid.topology import Pairs, label_components, pair_half_edges

#: mm: triangles count as adjacent to an edge up to twice the distance of the nearest one plus this.
_ADJACENT_MM = 0.01
#: A face is flat if no normal of its triangles is farther from their mean than this (cosine).
_FLAT_COSINE = float(np.cos(np.radians(1.0)))
#: mm: positions are compared in steps of this for the order of faces.
_ORDER_STEP_MM = 1e-3


class Face(Struct, frozen=True, eq=False):
    """A region of the surface between sharp edges.

    id: "f1", "f2", ... from the highest to the lowest by the middles of their boxes, then by y,
        then by x.
    area: mm2.
    looks: (3,) unit outward normal of a flat face, None for a curved one.
    """

    id: str
    area: float
    looks: FloatArray | None


class Faces(Struct, frozen=True, eq=False):
    """The faces of a part.

    listed: faces in the order of their ids.
    face_of_triangle: (F,) index in `listed` of the face of each triangle.
    """

    listed: tuple[Face, ...]
    face_of_triangle: IntArray


def make_faces(solid: Solid) -> Faces:
    """The faces of `solid`: triangles that meet at less than `FEATURE_ANGLE` belong together."""
    pairs = pair_half_edges(solid.faces)
    a, b = pairs.first // 3, pairs.second // 3
    smooth = (solid.normals[a] * solid.normals[b]).sum(axis=1) > np.cos(FEATURE_ANGLE)
    label = label_components(len(solid.faces), a[smooth], b[smooth])
    roots, face_of = np.unique(label, return_inverse=True)
    corners = solid.vertices[solid.faces]
    sides = corners[:, 1:] - corners[:, :1]
    areas = np.linalg.norm(cross(sides[:, 0], sides[:, 1]), axis=1) / 2
    low, high = np.full((len(roots), 3), np.inf), np.full((len(roots), 3), -np.inf)
    np.minimum.at(low, face_of, corners.min(axis=1))
    np.maximum.at(high, face_of, corners.max(axis=1))
    area, mean = np.bincount(face_of, areas), np.zeros((len(roots), 3))
    np.add.at(mean, face_of, solid.normals * areas[:, None])
    # The offset keeps middles at whole and half steps away from the limits of their steps.
    key = np.floor(((low + high) / 2 * (1, 1, -1))[:, [2, 1, 0]] / _ORDER_STEP_MM + 0.4637)
    order = np.lexsort((roots, *key.T[::-1]))
    rank = np.argsort(order)
    looks = mean / np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-12)
    lowest_cosine = np.ones(len(roots))
    np.minimum.at(lowest_cosine, face_of, (solid.normals * looks[face_of]).sum(axis=1))
    listed = tuple(
        Face(
            f"f{k}", float(area[face]), looks[face] if lowest_cosine[face] > _FLAT_COSINE else None
        )
        for k, face in enumerate(order.tolist(), start=1)
    )
    return Faces(listed, rank[face_of])


def find_adjacent_faces(
    edges: Iterable[Edge], solid: Solid, faces: Faces
) -> dict[str, tuple[int, int]]:
    """The two faces of each edge, by the id of the edge.

    A face is given by its index in `faces.listed`. The first one belongs to the first normal of the
    edge.
    """
    corners = solid.vertices[solid.faces]
    center = corners.mean(axis=1)
    radius = np.linalg.norm(corners - center[:, None], axis=2).max(axis=1)
    adjacent = {}
    for edge in edges:
        span = len(edge.via) // 2
        point = edge.via[span]
        distance = np.linalg.norm(center - point, axis=1)
        near = np.flatnonzero(distance - radius <= 2 * distance.min() + _ADJACENT_MM)
        gap = _measure_gaps(point, corners[near])
        near = near[gap <= 2 * gap.min() + _ADJACENT_MM]
        left, right = edge.via_normals[span]
        first = near[(solid.normals[near] @ left).argmax()]
        second = near[(solid.normals[near] @ right).argmax()]
        adjacent[edge.id] = int(faces.face_of_triangle[first]), int(faces.face_of_triangle[second])
    return adjacent


def _measure_gaps(point: FloatArray, corners: FloatArray) -> FloatArray:
    """(N,) distances, mm, of a point from the outlines of triangles (N, 3, 3)."""
    sides = np.roll(corners, -1, axis=1) - corners
    offset = point - corners
    share = (offset * sides).sum(axis=2) / np.maximum((sides * sides).sum(axis=2), 1e-300)
    gap = np.linalg.norm(offset - np.clip(share, 0.0, 1.0)[..., None] * sides, axis=2)
    return np.asarray(gap.min(axis=1))


# Bodies.


class BodyTable(NamedTuple):
    """The bodies of a mesh: its B connected surfaces, in the order of their first faces.

    body_of_face: (F,) number of the body of each face.
    volume: (B,) mm3, negative for a surface that is inside out.
    is_closed: (B,) whether every side has two faces.
    """

    body_of_face: IntArray
    volume: FloatArray
    is_closed: BoolArray


def tabulate_bodies(
    vertices: FloatArray, faces: IntArray, pairs: Pairs, is_turned: BoolArray
) -> BodyTable:
    """The bodies of a mesh. Faces belong to one body if they share a side with no third face.

    is_turned: (F,) faces whose winding counts as opposite.
    """
    root = label_components(len(faces), pairs.first // 3, pairs.second // 3)
    label, body_of_face = np.unique(root, return_inverse=True)
    corners = vertices[faces] - vertices[faces].mean(axis=(0, 1))
    volume = np.einsum("fi,fi->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    volume = np.where(is_turned, -volume, volume)
    total = np.asarray(np.bincount(body_of_face, volume, len(label)), dtype=np.float64)
    is_closed = np.ones(len(label), dtype=bool)
    is_closed[body_of_face[np.concatenate([pairs.open, pairs.crowded]) // 3]] = False
    return BodyTable(body_of_face, total, is_closed)


def name_bodies(
    vertices: FloatArray, faces: IntArray, pairs: Pairs, named: NamedVertices | None
) -> tuple[str, ...]:
    """The name of each body of a mesh that is wound outward, "" for a body without one.

    A closed surface of negative volume bounds a void in another body and is not counted.
    """
    table = tabulate_bodies(vertices, faces, pairs, np.zeros(len(faces), dtype=np.bool_))
    is_body = ~table.is_closed | (table.volume >= 0)
    names = np.full(len(is_body), -1)
    if named is not None:
        owners = named.owners[faces[:, 0]]
        count = len(named.names)
        keys = (table.body_of_face * count + owners)[owners >= 0]
        used, face_counts = np.unique(keys, return_counts=True)
        # The name that most faces of a body have is written last and stays.
        order = np.argsort(face_counts, kind="stable")
        names[used[order] // count] = used[order] % count
    listed = names[is_body].tolist()
    return tuple("" if k < 0 or named is None else harmless(named.names[k]) for k in listed)
