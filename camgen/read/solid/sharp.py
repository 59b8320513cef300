"""Edges of a mesh where its faces meet at an angle."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import run_starts
from camgen.geometry.vectors import angles, cross, dots
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray
from camgen.read.solid.topology import Pairs, ends

#: A face lower than this many single-precision steps of its coordinates has no direction of its own.
_STEPS = 8 * 2.0**-24
#: So many faces in a row may be too flat to have a direction.
_FLAT_RUN = 64


class SharpSides(Struct, frozen=True, eq=False):
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

    def take(self, rows: IntArray | BoolArray) -> SharpSides:
        """Those of ``rows``, in their order."""
        return SharpSides(
            self.start[rows],
            self.end[rows],
            self.normals[rows],
            self.angle[rows],
            self.convex[rows],
        )

    def turned(self, which: BoolArray) -> SharpSides:
        """Those of ``which`` (M,) run the other way, so that left is right."""
        return SharpSides(
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
) -> SharpSides:
    """The sides where two faces, wound alike, meet at more than ``feature_angle`` (rad).

    Convex: the normals turn about the way as they do round a block, from the left face to the right one.
    """
    half, other = pairs.first[~pairs.turned], pairs.second[~pairs.turned]
    left, right = normals[half // 3], normals[other // 3]
    directed = left.any(axis=1) & right.any(axis=1)
    rows = np.flatnonzero((dots(left, right) < np.cos(feature_angle)) & directed)
    both = np.stack([normals[half[rows] // 3], normals[other[rows] // 3]], axis=1)
    start, end = ends(faces, half[rows])
    convex = dots(cross(both[:, 0], both[:, 1]), vertices[end] - vertices[start]) > 0
    return SharpSides(start, end, both, angles(both[:, 0], both[:, 1]), convex)


# Sharp sides of triangles put end to end: as long as just two of one kind meet, and turn only a little.

#: A turn above this (rad) is a corner of the part: the sides of a circle drawn with 9 or more turn less.
CORNER = float(np.radians(41.0))


class SideChains(Struct, frozen=True, eq=False):
    """segments: in running order, chain after chain. first: (K + 1,) where each chain begins in them. closed: (K,)."""

    segments: SharpSides
    first: IntArray
    closed: BoolArray


def chain(segments: SharpSides, vertices: FloatArray) -> SideChains:
    """All ``segments`` in chains. Which way a chain runs and where a closed one begins depends on places alone."""
    rank = np.empty(len(vertices), dtype=np.int64)
    rank[np.lexsort(vertices.T[::-1])] = np.arange(len(vertices))
    segments = segments.turned(rank[segments.start] > rank[segments.end])
    order, turned, first, closed = _runs(_mates(segments, vertices), _seeds(segments, rank))
    return SideChains(segments.take(order).turned(turned), first, closed)


def _seeds(segments: SharpSides, rank: IntArray) -> IntArray:
    """(M,) the segments by where they start, then where they end: the order in which chains are begun."""
    return np.lexsort((rank[segments.end], rank[segments.start]))


def _mates(segments: SharpSides, vertices: FloatArray) -> IntArray:
    """(2 M,) the end that each end of a segment goes on with, -1 if the chain ends there.

    End 2 s is the start of segment s, 2 s + 1 its end.
    """
    count = len(segments)
    mates = np.full(2 * count, -1)
    at = np.column_stack([segments.start, segments.end]).reshape(-1)
    order = np.argsort(at, kind="stable")
    new = run_starts(at[order])
    size = np.diff(np.append(new, 2 * count))
    a, b = order[new[size == 2]], order[new[size == 2] + 1]
    along = vertices[segments.end] - vertices[segments.start]
    along /= np.linalg.norm(along, axis=1)[:, None]
    into = along[a // 2] * np.where(a % 2, 1, -1)[:, None]
    out = along[b // 2] * np.where(b % 2, -1, 1)[:, None]
    smooth = (into * out).sum(axis=1) > np.cos(CORNER)
    smooth &= segments.convex[a // 2] == segments.convex[b // 2]
    mates[a[smooth]], mates[b[smooth]] = b[smooth], a[smooth]
    return mates


def _runs(mates: IntArray, seeds: IntArray) -> tuple[IntArray, BoolArray, IntArray, BoolArray]:
    """The segments in running order, which of them run backwards, where each chain begins, and whether it is closed.

    An open chain is begun at the first of its two ends in the order of ``seeds``, a closed one at its first segment.
    """
    mate, seed = mates.tolist(), seeds.tolist()
    seen = [False] * len(seed)
    order: list[int] = []
    turned: list[bool] = []
    first: list[int] = []
    closed: list[bool] = []
    free = [2 * s + e for s in seed for e in (0, 1) if mate[2 * s + e] < 0]
    for begin in free + [2 * s for s in seed]:
        if seen[begin // 2]:
            continue
        first.append(len(order))
        here = begin
        while here >= 0 and not seen[here // 2]:
            seen[here // 2] = True
            order.append(here // 2)
            turned.append(here % 2 == 1)
            here = mate[here ^ 1]
        closed.append(here == begin)
    first.append(len(order))
    return (
        np.array(order, dtype=np.int64), np.array(turned, dtype=bool), np.array(first, dtype=np.int64),
        np.array(closed, dtype=bool),
    )  # fmt: skip
