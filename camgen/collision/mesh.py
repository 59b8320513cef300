"""The part as triangles: whether boxes meet its surface or are within it, and their distances.

fcl measures distances. Whether boxes meet is tested by the tree of `camgen.collision.tree`, which
is many times as fast: it takes the boxes at all joint values at once, and stops at the first corner
within a box. Boxes wholly within the part are found here too. They are free for fcl, to which a
mesh is a surface. The continuous collision test of fcl is not used, because it misses plates.
"""

from __future__ import annotations

import itertools
from functools import cached_property, lru_cache
from typing import Any

import fcl  # type: ignore[import-untyped]
import numpy as np
from msgspec import Struct

from camgen.collision.boxes import Boxes, all_of_three
from camgen.collision.cells import OUTSIDE, PASSED, UNKNOWN, WITHIN, Cells, divide_space
from camgen.collision.tree import BITS, BoxTree, make_tree, search_tree
from camgen.geometry.ragged import select_distinct
from camgen.geometry.surface import is_closed
from camgen.geometry.vectors import cross
from camgen.model.part import BoolArray, IntArray, Solid
from camgen.model.pose import FloatArray, frozen
from camgen.robots.models import Link

#: Boxes that are tested with the tree together.
_BOXES = 512


class Mesh(Struct, frozen=True, eq=False, dict=True):
    """The surface of a part in its own frame.

    tree: its triangles.
    box: cuboid around it.
    model: the triangles as a model of fcl.
    closed: whether the surface bounds a body. Then all rays from a point count the same. A mesh is
        assumed to be open if its vertices are not shared, or if neighbouring triangles are wound in
        opposite directions.
    """

    tree: BoxTree
    box: Boxes
    model: Any
    closed: bool

    @cached_property
    def surface(self) -> Any:
        """The collision object of fcl, in the frame of the mesh."""
        return fcl.CollisionObject(self.model)

    @cached_property
    def outermost(self) -> FloatArray:
        """The corners (K, 3) that lie farthest outward."""
        return select_outermost(self.tree.corners.reshape(-1, 3))

    @cached_property
    def cells(self) -> Cells:
        """The cells around the surface, and those through which it passes."""
        return divide_space(self.tree.corners)


@lru_cache(maxsize=4)
def make_mesh(solid: Solid) -> Mesh:
    """The mesh of a part, made once and used in any number of scenes.

    50,000 triangles take 0.2 s, and a search for the place of a part needs it hundreds of times.
    """
    tree = make_tree(solid.vertices[solid.faces])
    low, high = tree.corners.min(axis=(0, 1)), tree.corners.max(axis=(0, 1))
    box = Boxes(frozen((low + high) / 2), frozen(np.eye(3)), frozen((high - low) / 2))
    closed = is_closed(solid.faces, len(solid.vertices))
    return Mesh(tree, box, make_model(solid.vertices, solid.faces), closed)


@lru_cache(maxsize=64)
def join_surfaces(link: Link) -> tuple[FloatArray, IntArray]:
    """Vertices (V, 3), mm, and faces (F, 3) of all surfaces of a link, in its frame."""
    first = np.cumsum([0, *(len(surface.vertices) for surface in link.surfaces)])
    vertices = np.concatenate([surface.vertices for surface in link.surfaces])
    faces = [surface.faces + row for surface, row in zip(link.surfaces, first, strict=False)]
    return frozen(vertices), np.concatenate(faces)


#: Points of a cube with its middle at the origin, and of these the middles of its faces and its
#: corners.
_CUBE = np.array(list(itertools.product((-1, 0, 1), repeat=3)))
_OUTWARD = _CUBE[np.abs(_CUBE).sum(axis=1) % 2 == 1]


def select_outermost(points: FloatArray) -> FloatArray:
    """The points (K, 3) of `points` (N, 3) that lie farthest along the axes and between them."""
    return frozen(points[np.unique((points @ _OUTWARD.T).argmax(axis=0))])


def make_model(vertices: FloatArray, faces: IntArray) -> Any:
    """The model of fcl for triangles with `vertices` (V, 3), mm, and `faces` (F, 3)."""
    model = fcl.BVHModel()
    model.beginModel(len(vertices), len(faces))
    model.addSubModel(np.asarray(vertices), np.asarray(faces))
    model.endModel()
    return model


def find_struck(mesh: Mesh, boxes: Boxes) -> BoolArray:
    """Whether boxes (N,) in the frame of the part meet its surface or are within it, (N,)."""
    if not len(boxes.centres):
        return np.zeros(0, dtype=np.bool_)
    is_struck = _are_inside(mesh, boxes.centres)
    pending = np.flatnonzero(~is_struck & mesh.cells.near(boxes.centres, boxes.reach))
    for begin in range(0, len(pending), _BOXES):
        batch = pending[begin : begin + _BOXES]
        is_struck[batch] = _meet_surface(mesh.tree, boxes[batch])
    return is_struck


def _are_inside(mesh: Mesh, points: FloatArray) -> BoolArray:
    """`are_inside`, by the state of cells where that is enough.

    If the surface does not pass a cell, all of its points are on the same side as its middle. If
    the surface is open, they get the answer for the middle.
    """
    cells = mesh.cells
    rows, cell = cells.locate(points)
    states = cells.state.reshape(-1)
    unknown = select_distinct(cell[states[cell] == UNKNOWN])
    if len(unknown):
        states[unknown] = np.where(are_inside(mesh, cells.middles(unknown)), WITHIN, OUTSIDE)
    state = states[cell]
    is_inside = np.zeros(len(points), dtype=np.bool_)
    is_inside[rows[state == WITHIN]] = True
    passed = rows[state == PASSED]
    if len(passed):
        is_inside[passed] = are_inside(mesh, points[passed])
    return is_inside


def _meet_surface(tree: BoxTree, boxes: Boxes) -> BoolArray:
    """Whether boxes (N,) meet a triangle.

    A corner of a triangle within a box decides. The other boxes are tested triangle by triangle.
    """
    # Stored column by column, thousands of pairs take a third of the time.
    centres, reach, half = (
        np.ascontiguousarray(table.T) for table in (boxes.centres, boxes.reach, boxes.half)
    )
    axes = np.ascontiguousarray(boxes.axes.transpose(1, 2, 0))
    absolute, lowest, highest = np.abs(axes), centres - reach, centres + reach

    def meet_nodes(which: IntArray, low: FloatArray, high: FloatArray) -> IntArray:
        is_near = low[0] <= highest[0].take(which)
        for axis in (1, 2):
            is_near &= low[axis] <= highest[axis].take(which)
        for axis in range(3):
            is_near &= high[axis] >= lowest[axis].take(which)
        kept = np.flatnonzero(is_near)
        which = which.take(kept >> BITS)
        low = low.reshape(3, -1).take(kept, axis=1)
        high = high.reshape(3, -1).take(kept, axis=1)
        offset, half_node = (low + high) / 2 - centres.take(which, axis=1), (high - low) / 2
        distance = np.abs(_project(offset, axes.take(which, axis=2)))
        extent = half.take(which, axis=1) + _project(half_node, absolute.take(which, axis=2))
        return kept[all_of_three((distance <= extent).T)]

    def has_corner(which: IntArray, corner: FloatArray) -> BoolArray:
        offset = corner - centres.take(which, axis=1)
        distance = np.abs(_project(offset, axes.take(which, axis=2)))
        return all_of_three((distance <= half.take(which, axis=1)).T)

    which, triangle, is_struck = search_tree(tree, len(boxes.centres), meet_nodes, has_corner)
    corners = tree.corners.take(triangle, axis=0).transpose(1, 2, 0) - centres.take(which, axis=1)
    box_axes = axes.take(which, axis=2)
    turned = np.stack([_project(corner, box_axes) for corner in corners])
    is_struck[which[_meet_triangles(turned, half.take(which, axis=1))]] = True
    return is_struck


def _project(vectors: FloatArray, axes: FloatArray) -> FloatArray:
    """Components (3, n) of vectors (3, n) along axes (3, 3, n), each of which is a column."""
    return np.asarray(vectors[0] * axes[0] + vectors[1] * axes[1] + vectors[2] * axes[2])


def _meet_triangles(corners: FloatArray, half: FloatArray) -> BoolArray:
    """Whether triangles, corner by corner (3, 3, n), meet boxes around the origin.

    The boxes have half edges (3, n) along x, y and z. A triangle meets its box if none of 13 axes
    separates them (Akenine-Moeller, Fast 3D triangle-box overlap testing, 2001).
    """
    meets = all_of_three(((corners.min(axis=0) <= half) & (corners.max(axis=0) >= -half)).T)
    sides = corners[[1, 2, 0]] - corners
    normal = cross(sides[0].T, sides[1].T).T
    meets &= np.abs((normal * corners[0]).sum(axis=0)) <= (np.abs(normal) * half).sum(axis=0)
    size = np.abs(sides)
    for axis in range(3):
        # The product of a side and an axis of the box is perpendicular to that axis.
        u, v = (axis + 1) % 3, (axis + 2) % 3
        along = sides[:, None, u] * corners[None, :, v] - sides[:, None, v] * corners[None, :, u]
        extent = size[:, u] * half[v] + size[:, v] * half[u]
        meets &= all_of_three(((along.min(axis=1) <= extent) & (along.max(axis=1) >= -extent)).T)
    return meets


def are_inside(mesh: Mesh, points: FloatArray) -> BoolArray:
    """Whether points (N, 3) are in the part (N,).

    Crossings of the surface are counted along both rays of an axis: +1 for each exit, -1 for each
    entry. A closed surface gives the same count along all axes, so one axis is enough. For an open
    one, at least half of the six rays along three axes must say inside.
    """
    total = np.zeros(len(points))
    axes = 1 if mesh.closed else 3
    rows = np.flatnonzero((np.abs(points - mesh.box.centres) <= mesh.box.half).all(axis=1))
    for axis in range(axes):
        total[rows] += _count_crossings(mesh.tree, points[rows], axis)
    return np.abs(total) >= axes


def _count_crossings(tree: BoxTree, points: FloatArray, axis: int) -> FloatArray:
    """The counts along both rays of an axis, summed (N,)."""
    u, v = (axis + 1) % 3, (axis + 2) % 3

    def meet_nodes(which: IntArray, low: FloatArray, high: FloatArray) -> IntArray:
        at_u, at_v = points[:, u].take(which), points[:, v].take(which)
        in_u = (low[u] <= at_u) & (at_u <= high[u])
        return np.flatnonzero(in_u & (low[v] <= at_v) & (at_v <= high[v]))

    which, triangle, _ = search_tree(tree, len(points), meet_nodes)
    corners, ray = tree.corners[triangle][..., [u, v, axis]], points[which][:, [u, v, axis]]
    facing = _count_turns(corners, ray)
    hit = facing != 0
    which, corners, ray, facing = which[hit], corners[hit], ray[hit], facing[hit]
    normal = cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    # A triangle that counts has an area as seen along the ray, unless rounding has removed it. Then
    # any height of its corners is right.
    steep = np.where(normal[:, 2] == 0, 1.0, normal[:, 2])
    offset = corners[:, 0, :2] - ray[:, :2]
    height = corners[:, 0, 2] + (offset * normal[:, :2]).sum(axis=1) / steep
    signs = np.where(height > ray[:, 2], facing, -facing)
    return np.asarray(np.bincount(which, signs, len(points)), dtype=np.float64)


def _count_turns(corners: FloatArray, points: FloatArray) -> FloatArray:
    """Turns of triangles (n, 3, 3) about points (n, 3), seen along the third axis: +1, 0 or -1.

    Both triangles at a side evaluate it from its lower end, so a ray through the side counts for
    exactly one of them.
    """
    total = np.zeros(len(points))
    for k in range(3):
        a, b = corners[:, k], corners[:, (k + 1) % 3]
        rising = (a[:, 1] <= points[:, 1]).astype(float) - (b[:, 1] <= points[:, 1])
        lower = np.where(rising[:, None] > 0, a, b)
        side, offset = np.where(rising[:, None] > 0, b, a) - lower, points - lower
        area = side[:, 0] * offset[:, 1] - side[:, 1] * offset[:, 0]
        total += np.where(area > 0, rising, 0.0)
    return total


def make_box_object(boxes: Boxes, which: int) -> Any:
    """A collision object of fcl for one of the boxes (n,), by its index."""
    x, y, z = (2 * boxes.half[which]).tolist()
    return fcl.CollisionObject(
        fcl.Box(x, y, z), fcl.Transform(boxes.axes[which], boxes.centres[which])
    )


def measure_distance(first: Any, second: Any) -> float:
    """The distance of two objects of fcl that do not meet, mm.

    A negative distance, which results from rounding, counts as 0.
    """
    shortest = fcl.distance(first, second, fcl.DistanceRequest(), fcl.DistanceResult())
    return max(float(shortest), 0.0)
