"""Edges of a mesh where its faces meet at an angle."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.pose import FloatArray
from camgen.solid import BoolArray, IntArray
from camgen.solids.pairs import Pairs, ends

#: A face lower than this many single-precision steps of its coordinates has no direction of its own.
_STEPS = 8 * 2.0**-24
#: So many faces in a row may be too flat to have a direction.
_FLAT_RUN = 64


class Segments(Struct, frozen=True, eq=False):
    """Sides of triangles between two faces. start, end: (M,) vertices. angle: (M,) rad. convex: (M,).

    normals: (M, 2, 3) of the face on the left of the way and of the one on the right, seen from outside.
    """

    start: IntArray
    end: IntArray
    normals: FloatArray
    angle: FloatArray
    convex: BoolArray

    def __len__(self) -> int:
        return len(self.start)

    def take(self, rows: IntArray | BoolArray) -> Segments:
        """Those of ``rows``, in their order."""
        return Segments(self.start[rows], self.end[rows], self.normals[rows], self.angle[rows], self.convex[rows])

    def turned(self, which: BoolArray) -> Segments:
        """Those of ``which`` (M,) run the other way, so that left is right."""
        return Segments(
            np.where(which, self.end, self.start),
            np.where(which, self.start, self.end),
            np.where(which[:, None, None], self.normals[:, ::-1], self.normals),
            self.angle,
            self.convex,
        )


def face_normals(vertices: FloatArray, faces: IntArray, pairs: Pairs) -> tuple[FloatArray, int]:
    """(F, 3) unit normals, and how many faces are too flat to have one of their own.

    Such a face lies along its longest side, so it belongs to the face beyond that side and takes its normal. It is
    zero where there is none.
    """
    cross, flat, longest = _shapes(vertices, faces)
    doubled = np.linalg.norm(cross, axis=1)
    normals = cross / np.where(flat, np.inf, doubled)[:, None]
    if flat.any():
        normals = normals[_leaders(flat, longest, pairs)]
    return normals, int(np.count_nonzero(flat))


def dangling(vertices: FloatArray, faces: IntArray, pairs: Pairs) -> BoolArray:
    """(F,) faces without a direction whose longest side leads to no other face, or to several: they close nothing."""
    _, flat, longest = _shapes(vertices, faces)
    met = np.zeros(3 * len(faces), dtype=bool)
    met[pairs.first] = met[pairs.second] = True
    return np.asarray(flat & ~met[3 * np.arange(len(faces)) + longest])


def _shapes(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, BoolArray, IntArray]:
    """(F, 3) cross products of the sides, (F,) which faces have no height, (F,) the longest side."""
    sides = vertices[faces[:, [1, 2, 0]]] - vertices[faces]
    cross = np.cross(sides[:, 0], sides[:, 1])
    length = np.linalg.norm(sides, axis=2)
    limit = _STEPS * float(np.abs(vertices).max(initial=0.0))
    return cross, np.linalg.norm(cross, axis=1) <= limit * length.max(axis=1), length.argmax(axis=1)


def _leaders(flat: BoolArray, longest: IntArray, pairs: Pairs) -> IntArray:
    """(F,) the face whose normal each face takes: its own unless it is ``flat``."""
    beyond = np.full(3 * len(flat), -1)
    beyond[pairs.first], beyond[pairs.second] = pairs.second // 3, pairs.first // 3
    own = np.arange(len(flat))
    leader = np.where(flat, beyond[3 * own + longest], own)
    leader = np.where(leader < 0, own, leader)
    for _ in range(_FLAT_RUN):
        further = np.where(flat[leader], leader[leader], leader)
        if np.array_equal(further, leader):
            break
        leader = further
    return leader


def segments(
    vertices: FloatArray, faces: IntArray, normals: FloatArray, pairs: Pairs, feature_angle: float
) -> Segments:
    """The sides where two faces, wound alike, meet at more than ``feature_angle`` (rad).

    Convex: the normals turn about the way as they do round a block, from the left face to the right one.
    """
    half, other = pairs.first[~pairs.turned], pairs.second[~pairs.turned]
    left, right = normals[half // 3], normals[other // 3]
    directed = left.any(axis=1) & right.any(axis=1)
    rows = np.flatnonzero((np.einsum("mi,mi->m", left, right) < np.cos(feature_angle)) & directed)
    both = np.stack([normals[half[rows] // 3], normals[other[rows] // 3]], axis=1)
    start, end = ends(faces, half[rows])
    cross = np.cross(both[:, 0], both[:, 1])
    angle = np.arctan2(np.linalg.norm(cross, axis=1), np.einsum("mi,mi->m", both[:, 0], both[:, 1]))
    convex = np.einsum("mi,mi->m", cross, vertices[end] - vertices[start]) > 0
    return Segments(start, end, both, angle, convex)
