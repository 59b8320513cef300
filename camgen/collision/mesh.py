"""The part as triangles: whether boxes meet its surface or are within it, many at once, and how far one is from it.

fcl knows the distance. For a yes or no the tree here is many times as fast, since it takes all boxes of all
configurations at once and stops at the first corner within a box. What fcl does not know either: to it a mesh is a
surface, and a box wholly within is free. Its continuous collision is not used: it misses plates.
"""

from __future__ import annotations

import itertools
from functools import cached_property, lru_cache
from typing import Any

import fcl  # type: ignore[import-untyped]
import numpy as np
from msgspec import Struct

from camgen.collision.boxes import Boxes
from camgen.collision.cells import OUTSIDE, PASSED, UNKNOWN, WITHIN, Cells, divide_space
from camgen.collision.tree import BITS, BoxTree, ask, grow
from camgen.geometry.ragged import each_once
from camgen.geometry.vectors import cross
from camgen.model.part import BoolArray, IntArray, Solid
from camgen.model.pose import FloatArray, frozen
from camgen.robots.models import Link

#: Boxes that are put to the tree at once.
_BOXES = 512


class Mesh(Struct, frozen=True, eq=False, dict=True):
    """A part's surface in its own frame.

    box: cuboid around it.
    model: the triangles for fcl.
    closed: whether the surface bounds a body.
    """

    tree: BoxTree
    box: Boxes
    model: Any
    closed: bool

    @cached_property
    def surface(self) -> Any:
        """Fcl's collision object, in the mesh's own frame."""
        return fcl.CollisionObject(self.model)

    @cached_property
    def outermost(self) -> FloatArray:
        """The corners (K, 3) that lie farthest outward."""
        return pick_outermost(self.tree.corners.reshape(-1, 3))

    @cached_property
    def cells(self) -> Cells:
        """Where in its box the surface is."""
        return divide_space(self.tree.corners)


@lru_cache(maxsize=4)
def make_mesh(solid: Solid) -> Mesh:
    """The mesh of a part, made once and used in any number of scenes: 50,000 triangles take 0.2 s, and a search for the
    place of a part asks for it hundreds of times.
    """
    tree = grow(solid.vertices[solid.faces])
    low, high = tree.corners.min(axis=(0, 1)), tree.corners.max(axis=(0, 1))
    box = Boxes(frozen((low + high) / 2), frozen(np.eye(3)), frozen((high - low) / 2))
    return Mesh(tree, box, make_model(solid.vertices, solid.faces), _is_closed(solid))


@lru_cache(maxsize=64)
def join_surfaces(link: Link) -> tuple[FloatArray, IntArray]:
    """Vertices (V, 3), mm, and faces (F, 3) of all surfaces of a link, in its frame."""
    first = np.cumsum([0, *(len(surface.vertices) for surface in link.surfaces)])
    vertices = np.concatenate([surface.vertices for surface in link.surfaces])
    faces = [surface.faces + row for surface, row in zip(link.surfaces, first, strict=False)]
    return frozen(vertices), np.concatenate(faces)


#: Points of a cube, and of these the middles of its sides and its corners, from its own middle.
_CUBE = np.array(list(itertools.product((-1, 0, 1), repeat=3)))
_OUTWARD = _CUBE[np.abs(_CUBE).sum(axis=1) % 2 == 1]


def pick_outermost(points: FloatArray) -> FloatArray:
    """The points (K, 3) of ``points`` (N, 3) that lie farthest along the axes and between them."""
    return frozen(points[np.unique((points @ _OUTWARD.T).argmax(axis=0))])


def make_model(vertices: FloatArray, faces: IntArray) -> Any:
    """Fcl's model of triangles: ``vertices`` (V, 3), mm, ``faces`` (F, 3)."""
    model = fcl.BVHModel()
    model.beginModel(len(vertices), len(faces))
    model.addSubModel(np.asarray(vertices), np.asarray(faces))
    model.endModel()
    return model


def _is_closed(solid: Solid) -> bool:
    """Whether every side of a triangle is run as often the other way: then all rays from a point count the same.

    A mesh whose vertices are not shared, or whose triangles are wound against each other, is taken for an open one.
    """
    one, other = solid.faces.ravel(), np.roll(solid.faces, -1, axis=1).ravel()
    count = len(solid.vertices)
    return bool(np.array_equal(np.sort(one * count + other), np.sort(other * count + one)))


def find_struck(mesh: Mesh, boxes: Boxes) -> BoolArray:
    """Which boxes (N,) in the part's frame meet the surface or are within the part (N,)."""
    if not len(boxes.centres):
        return np.zeros(0, dtype=np.bool_)
    found = _inside_cells(mesh, boxes.centres)
    left = np.flatnonzero(~found & mesh.cells.near(boxes.centres, boxes.reach))
    for begin in range(0, len(left), _BOXES):
        some = left[begin : begin + _BOXES]
        found[some] = _surface(mesh.tree, boxes[some])
    return found


def _inside_cells(mesh: Mesh, points: FloatArray) -> BoolArray:
    """``inside``, where it is known by cells: what holds in the middle of one that the surface does not pass holds in
    all of it. Of an open surface, for which rays decide, that is how they are cast.
    """
    cells = mesh.cells
    rows, cell = cells.of(points)
    known = cells.state.reshape(-1)
    new = each_once(cell[known[cell] == UNKNOWN])
    if len(new):
        known[new] = np.where(inside(mesh, cells.middles(new)), WITHIN, OUTSIDE)
    state = known[cell]
    found = np.zeros(len(points), dtype=np.bool_)
    found[rows[state == WITHIN]] = True
    passed = rows[state == PASSED]
    if len(passed):
        found[passed] = inside(mesh, points[passed])
    return found


def _surface(tree: BoxTree, boxes: Boxes) -> BoolArray:
    """Which boxes (N,) meet a triangle. One corner within a box settles it; others are tested triangle by triangle."""
    # Column by column in memory: what is worked out for thousands of pairs takes a third of the time.
    centres, reach, half = (
        np.ascontiguousarray(table.T) for table in (boxes.centres, boxes.reach, boxes.half)
    )
    axes = np.ascontiguousarray(boxes.axes.transpose(1, 2, 0))
    steep, lowest, highest = np.abs(axes), centres - reach, centres + reach

    def near(which: IntArray, low: FloatArray, high: FloatArray) -> IntArray:
        good = low[0] <= highest[0].take(which)
        for axis in (1, 2):
            good &= low[axis] <= highest[axis].take(which)
        for axis in range(3):
            good &= high[axis] >= lowest[axis].take(which)
        left = np.flatnonzero(good)
        which = which.take(left >> BITS)
        low, high = (corner.reshape(3, -1).take(left, axis=1) for corner in (low, high))
        apart, room = (low + high) / 2 - centres.take(which, axis=1), (high - low) / 2
        across = np.abs(_turn(apart, axes.take(which, axis=2)))
        most = half.take(which, axis=1) + _turn(room, steep.take(which, axis=2))
        return left[_every(across <= most)]

    def holds(which: IntArray, corner: FloatArray) -> BoolArray:
        across = np.abs(_turn(corner - centres.take(which, axis=1), axes.take(which, axis=2)))
        return _every(across <= half.take(which, axis=1))

    which, triangle, found = ask(tree, len(boxes.centres), near, holds)
    corners = tree.corners.take(triangle, axis=0).transpose(1, 2, 0) - centres.take(which, axis=1)
    own = axes.take(which, axis=2)
    turned = np.stack([_turn(corner, own) for corner in corners])
    found[which[_cut(turned, half.take(which, axis=1))]] = True
    return found


def _every(good: BoolArray) -> BoolArray:
    """``good`` (3, n) along the first axis."""
    return np.asarray(good[0] & good[1] & good[2])


def _turn(vectors: FloatArray, axes: FloatArray) -> FloatArray:
    """How far vectors (3, n) lead along axes (3, 3, n), each a column: (3, n)."""
    return np.asarray(vectors[0] * axes[0] + vectors[1] * axes[1] + vectors[2] * axes[2])


def _cut(corners: FloatArray, half: FloatArray) -> BoolArray:
    """Which triangles, corner by corner (3, 3, n), meet the boxes of half edges (3, n) around the origin, square to the
    frame: those that none of 13 axes parts (Akenine-Moeller, Fast 3D triangle-box overlap testing, 2001).
    """
    good = _every((corners.min(axis=0) <= half) & (corners.max(axis=0) >= -half))
    sides = corners[[1, 2, 0]] - corners
    normal = cross(sides[0].T, sides[1].T).T
    good &= np.abs((normal * corners[0]).sum(axis=0)) <= (np.abs(normal) * half).sum(axis=0)
    wide = np.abs(sides)
    for axis in range(3):
        # The product of a side with an axis of the box has no part along that axis.
        u, v = (axis + 1) % 3, (axis + 2) % 3
        along = sides[:, None, u] * corners[None, :, v] - sides[:, None, v] * corners[None, :, u]
        room = wide[:, u] * half[v] + wide[:, v] * half[u]
        good &= _every((along.min(axis=1) <= room) & (along.max(axis=1) >= -room))
    return good


def inside(mesh: Mesh, points: FloatArray) -> BoolArray:
    """Which points (N, 3) are in the part (N,).

    The surface is counted along rays each way along axes: left outward +1, entered -1. A closed surface gives the same
    along all: one axis is enough. Of any other, half of the six rays along three axes decide.
    """
    total = np.zeros(len(points))
    axes = 1 if mesh.closed else 3
    within = np.flatnonzero((np.abs(points - mesh.box.centres) <= mesh.box.half).all(axis=1))
    for axis in range(axes):
        total[within] += _through(mesh.tree, points[within], axis)
    return np.abs(total) >= axes


def _through(tree: BoxTree, points: FloatArray, axis: int) -> FloatArray:
    """The counts along both rays of an axis, summed (N,)."""
    u, v = (axis + 1) % 3, (axis + 2) % 3

    def stabbed(which: IntArray, low: FloatArray, high: FloatArray) -> IntArray:
        one, other = points[:, u].take(which), points[:, v].take(which)
        return np.flatnonzero(
            (low[u] <= one) & (one <= high[u]) & (low[v] <= other) & (other <= high[v])
        )

    which, triangle, _ = ask(tree, len(points), stabbed)
    corners, at = tree.corners[triangle][..., [u, v, axis]], points[which][:, [u, v, axis]]
    facing = _around(corners, at)
    hit = facing != 0
    which, corners, at, facing = which[hit], corners[hit], at[hit], facing[hit]
    normal = cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    # A triangle that is counted has an area seen along the ray, unless it is lost in rounding: then any height is its.
    steep = np.where(normal[:, 2] == 0, 1.0, normal[:, 2])
    height = (
        corners[:, 0, 2] + ((corners[:, 0, :2] - at[:, :2]) * normal[:, :2]).sum(axis=1) / steep
    )
    return np.asarray(
        np.bincount(which, np.where(height > at[:, 2], facing, -facing), len(points)),
        dtype=np.float64,
    )


def _around(corners: FloatArray, at: FloatArray) -> FloatArray:
    """How often triangles (n, 3, 3) run around points (n, 3) in the plane of the first two coordinates: +1, 0 or -1.

    A side is seen by both of its triangles as from its lower end, so that a ray through it counts for just one.
    """
    total = np.zeros(len(at))
    for k in range(3):
        a, b = corners[:, k], corners[:, (k + 1) % 3]
        rising = (a[:, 1] <= at[:, 1]).astype(float) - (b[:, 1] <= at[:, 1])
        lower, upper = np.where(rising[:, None] > 0, a, b), np.where(rising[:, None] > 0, b, a)
        side = (upper - lower)[:, 0] * (at - lower)[:, 1] - (upper - lower)[:, 1] * (at - lower)[
            :, 0
        ]
        total += np.where(side > 0, rising, 0.0)
    return total


def body(boxes: Boxes, which: int) -> Any:
    """One of the boxes (n,) as fcl's."""
    x, y, z = (2 * boxes.half[which]).tolist()
    return fcl.CollisionObject(
        fcl.Box(x, y, z), fcl.Transform(boxes.axes[which], boxes.centres[which])
    )


def distance(one: Any, other: Any) -> float:
    """The distance of two of fcl's objects that do not meet, mm. A negative one, of rounding, is 0."""
    return max(float(fcl.distance(one, other, fcl.DistanceRequest(), fcl.DistanceResult())), 0.0)
