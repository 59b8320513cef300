"""Sharp sides of a mesh, where two faces meet at an angle, and chains of such sides."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import find_run_starts
from camgen.geometry.vectors import cross, measure_angles, multiply_rows
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray
from camgen.read.solid.topology import Pairs, list_ends

#: A face has no normal of its own if its height is at most this part of the largest coordinate:
#: eight rounding errors of single precision.
_FLAT_HEIGHT = 8 * 2.0**-24
#: Iterations in which flat faces beside each other pass a normal on. Each one doubles the number of
#: faces over which a normal has been passed.
_FLAT_RUN = 64


class SharpSides(Struct, frozen=True, eq=False):
    """M sides of triangles, each between two faces.

    start, end: (M,) vertices.
    normals: (M, 2, 3) unit normals of the face to the left of the side and of the face to its
        right, seen from outside.
    angle: (M,) angle between the two normals, rad.
    convex: (M,) True as on the outside of a block, False as in an inner corner.
    """

    start: IntArray
    end: IntArray
    normals: FloatArray
    angle: FloatArray
    convex: BoolArray

    def __len__(self) -> int:
        return len(self.start)

    def take(self, rows: IntArray | BoolArray) -> SharpSides:
        """The sides of `rows`, in their order."""
        return SharpSides(
            self.start[rows],
            self.end[rows],
            self.normals[rows],
            self.angle[rows],
            self.convex[rows],
        )

    def reverse(self, which: BoolArray) -> SharpSides:
        """All sides, with those of `which` (M,) reversed: start and end, left and right swapped."""
        return SharpSides(
            np.where(which, self.end, self.start),
            np.where(which, self.start, self.end),
            np.where(which[:, None, None], self.normals[:, ::-1], self.normals),
            self.angle,
            self.convex,
        )


def compute_normals(vertices: FloatArray, faces: IntArray, pairs: Pairs) -> tuple[FloatArray, int]:
    """(F, 3) unit normals of the faces, and the number of faces without height.

    A face without height lies along its longest side. It gets the normal of the face beyond that
    side, and a zero vector without such a face.
    """
    products, is_flat, longest = _measure_faces(vertices, faces)
    doubled_areas = np.linalg.norm(products, axis=1)
    normals = products / np.where(is_flat, np.inf, doubled_areas)[:, None]
    if is_flat.any():
        normals = normals[_find_leaders(is_flat, longest, pairs)]
    return normals, int(np.count_nonzero(is_flat))


def find_dangling(vertices: FloatArray, faces: IntArray, pairs: Pairs) -> BoolArray:
    """(F,) whether a face has no height, and its longest side is not shared with exactly one face.

    Such a face closes no gap between others.
    """
    _, is_flat, longest = _measure_faces(vertices, faces)
    is_paired = np.zeros(3 * len(faces), dtype=bool)
    is_paired[pairs.first] = is_paired[pairs.second] = True
    return np.asarray(is_flat & ~is_paired[3 * np.arange(len(faces)) + longest])


def _measure_faces(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, BoolArray, IntArray]:
    """Cross products of the sides (F, 3), faces without height (F,), longest sides 0 to 2 (F,)."""
    sides = vertices[faces[:, [1, 2, 0]]] - vertices[faces]
    products = np.cross(sides[:, 0], sides[:, 1])
    length = np.linalg.norm(sides, axis=2)
    limit = _FLAT_HEIGHT * float(np.abs(vertices).max(initial=0.0))
    is_flat = np.linalg.norm(products, axis=1) <= limit * length.max(axis=1)
    return products, is_flat, length.argmax(axis=1)


def _find_leaders(is_flat: BoolArray, longest: IntArray, pairs: Pairs) -> IntArray:
    """(F,) the face whose normal each face gets: itself unless it is flat."""
    beyond = np.full(3 * len(is_flat), -1)
    beyond[pairs.first], beyond[pairs.second] = pairs.second // 3, pairs.first // 3
    itself = np.arange(len(is_flat))
    leader = np.where(is_flat, beyond[3 * itself + longest], itself)
    leader = np.where(leader < 0, itself, leader)
    for _ in range(_FLAT_RUN):
        further = np.where(is_flat[leader], leader[leader], leader)
        if np.array_equal(further, leader):
            break
        leader = further
    return leader


def find_sharp_sides(
    vertices: FloatArray, faces: IntArray, normals: FloatArray, pairs: Pairs, feature_angle: float
) -> SharpSides:
    """The sides where two faces, wound alike, meet at more than `feature_angle` (rad).

    A side is convex if the rotation from its left normal to its right one is right-handed about the
    direction of the side, as on a block.
    """
    left_half, right_half = pairs.first[~pairs.turned], pairs.second[~pairs.turned]
    left, right = normals[left_half // 3], normals[right_half // 3]
    has_normals = left.any(axis=1) & right.any(axis=1)
    rows = np.flatnonzero((multiply_rows(left, right) < np.cos(feature_angle)) & has_normals)
    both = np.stack([left[rows], right[rows]], axis=1)
    start, end = list_ends(faces, left_half[rows])
    convex = multiply_rows(cross(both[:, 0], both[:, 1]), vertices[end] - vertices[start]) > 0
    return SharpSides(start, end, both, measure_angles(both[:, 0], both[:, 1]), convex)


# Chains: sharp sides joined end to end where exactly two of the same convexity meet and the
# direction changes little.

#: rad: a larger change of direction is a corner of the part. The sides of a circle that is meshed
#: with 9 sides or more turn less.
CORNER = float(np.radians(41.0))


class SideChains(Struct, frozen=True, eq=False):
    """K chains of sharp sides.

    sides: sides of all chains, chain after chain, each in its running order.
    first: (K + 1,) index of the first side of each chain, and the number of sides.
    closed: (K,) whether the chain ends at the vertex where it starts.
    """

    sides: SharpSides
    first: IntArray
    closed: BoolArray


def chain_sides(sides: SharpSides, vertices: FloatArray) -> SideChains:
    """Join all sides to chains.

    Direction and start of a chain depend on the positions of its vertices alone, not on the order
    of the faces in the file.
    """
    rank = np.empty(len(vertices), dtype=np.int64)
    rank[np.lexsort(vertices.T[::-1])] = np.arange(len(vertices))
    sides = sides.reverse(rank[sides.start] > rank[sides.end])
    seeds = np.lexsort((rank[sides.end], rank[sides.start]))
    order, is_reversed, first, closed = _walk_chains(_match_ends(sides, vertices), seeds)
    return SideChains(sides.take(order).reverse(is_reversed), first, closed)


def _match_ends(sides: SharpSides, vertices: FloatArray) -> IntArray:
    """(2 M,) the end at which the chain continues after each end of a side, -1 at its last end.

    End 2 s is the start of side s, end 2 s + 1 is its end.
    """
    count = len(sides)
    mates = np.full(2 * count, -1)
    vertex = np.column_stack([sides.start, sides.end]).reshape(-1)
    order = np.argsort(vertex, kind="stable")
    groups = find_run_starts(vertex[order])
    size = np.diff(np.append(groups, 2 * count))
    a, b = order[groups[size == 2]], order[groups[size == 2] + 1]
    along = vertices[sides.end] - vertices[sides.start]
    along /= np.linalg.norm(along, axis=1)[:, None]
    into = along[a // 2] * np.where(a % 2, 1, -1)[:, None]
    out = along[b // 2] * np.where(b % 2, -1, 1)[:, None]
    smooth = (into * out).sum(axis=1) > np.cos(CORNER)
    smooth &= sides.convex[a // 2] == sides.convex[b // 2]
    mates[a[smooth]], mates[b[smooth]] = b[smooth], a[smooth]
    return mates


def _walk_chains(
    mates: IntArray, seeds: IntArray
) -> tuple[IntArray, BoolArray, IntArray, BoolArray]:
    """Follow the chains from end to end.

    mates: (2 M,) as from `_match_ends`.
    seeds: (M,) order of the sides in which starts are tried. An open chain starts at the first of
        its two ends, a closed one at its first side.

    Returns the sides (M,) in running order, whether each is reversed (M,), the index of the first
    side of each chain (K + 1,), and whether the chain is closed (K,).
    """
    mate = mates.tolist()
    is_used = [False] * len(seeds)
    entered: list[int] = []
    first: list[int] = []
    closed: list[bool] = []
    ends = np.column_stack([2 * seeds, 2 * seeds + 1]).reshape(-1)
    for start in [*ends[mates[ends] < 0].tolist(), *(2 * seeds).tolist()]:
        if is_used[start // 2]:
            continue
        first.append(len(entered))
        end = start
        while end >= 0 and not is_used[end // 2]:
            is_used[end // 2] = True
            entered.append(end)
            end = mate[end ^ 1]
        closed.append(end == start)
    first.append(len(entered))
    order, is_reversed = np.divmod(np.array(entered, dtype=np.int64), 2)
    return order, is_reversed == 1, np.array(first, dtype=np.int64), np.array(closed, dtype=bool)
