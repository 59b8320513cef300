"""Prisms and their arrangements for `step_solids`, with the numbers of their edges by formula."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from bench.support.motions import rotate
from camgen.model.pose import FloatArray

Point = tuple[float, float]


class Segment(NamedTuple):
    """A segment of an outline.

    start, end: its ends, mm; the same for a whole circle.
    center: center of an arc, None for a line.
    turns_left: whether an arc runs counter-clockwise.
    """

    start: Point
    end: Point
    center: Point | None = None
    turns_left: bool = True

    @property
    def radius(self) -> float:
        """mm, of an arc."""
        assert self.center is not None
        return math.dist(self.start, self.center)


class Shape(NamedTuple):
    """A prism. loops: its outline, which turns left, then its holes, which turn right."""

    loops: list[list[Segment]]
    height: float
    convex_corners: int
    concave_corners: int

    @property
    def rims(self) -> int:
        """The edges around one cap."""
        return sum(map(len, self.loops))

    @property
    def edges(self) -> int:
        """The sharp edges of the solid."""
        return 2 * self.rims + self.convex_corners + self.concave_corners


class Body(NamedTuple):
    """A shape and its pose: rotation (3, 3), offset (3,) mm."""

    shape: Shape
    rotation: FloatArray
    offset: FloatArray


class Arrangement(NamedTuple):
    """The content of a file.

    solids: bodies as the file has them.
    edges, concave: sharp edges, concave edges.
    instances: copies of the only solid in an assembly, empty without one.
    """

    solids: list[Body]
    edges: int
    concave: int
    instances: tuple[Body, ...] = ()

    @property
    def bodies(self) -> Sequence[Body]:
        """All bodies in their places."""
        return self.instances or self.solids

    def measure_size(self) -> FloatArray:
        """(3,) mm, the extent of all bodies."""
        size = np.zeros(3)
        for number, axis in enumerate(np.eye(3)):
            for direction in (axis, -axis):
                size[number] += max(measure_reach(body, direction) for body in self.bodies)
        return size


def measure_reach(placed: Body, direction: FloatArray) -> float:
    """The reach of a body along a direction, mm from the origin."""
    local = placed.rotation.T @ direction
    plane, length = local[:2], float(np.linalg.norm(local[:2]))
    reach = -math.inf
    for segment in placed.shape.loops[0]:
        reach = max(reach, float(plane @ segment.start), float(plane @ segment.end))
        if segment.center is not None and length > 1e-12:
            tip = np.array(segment.center) + plane / length * segment.radius
            if is_on_arc(segment, tip):
                reach = max(reach, float(plane @ tip))
    return (
        reach + max(0.0, float(local[2]) * placed.shape.height) + float(placed.offset @ direction)
    )


def is_on_arc(segment: Segment, tip: FloatArray) -> bool:
    """Whether a point of the circle is on the arc. Arcs of outlines turn left."""
    cx, cy = segment.center or (0.0, 0.0)
    start, end, angle = (
        math.atan2(y - cy, x - cx) for x, y in (segment.start, segment.end, tip.tolist())
    )
    whole = 2 * math.pi
    sweep = (end - start) % whole or whole
    return (angle - start) % whole <= sweep


# Shapes. Lengths are whole or half millimetres.


def make_polygon(corners: Sequence[Point]) -> list[Segment]:
    return [Segment(corners[k - 1], corners[k]) for k in range(len(corners))]


def make_circle(center: Point, radius: float, turns_left: bool) -> list[Segment]:
    start = (center[0] + radius, center[1])
    return [Segment(start, start, center, turns_left)]


def make_box(width: float, depth: float, height: float) -> Shape:
    corners = [(0.0, 0.0), (width, 0.0), (width, depth), (0.0, depth)]
    return Shape([make_polygon(corners)], height, 4, 0)


def make_plate(rng: random.Random) -> Shape:
    """A plate with one to four through holes."""
    count = rng.randint(1, 4)
    box = make_box(30.0 * count, 40.0, float(rng.randint(4, 12)))
    holes = [
        make_circle((15.0 + 30 * k, 20.0), rng.randint(4, 22) / 2, turns_left=False)
        for k in range(count)
    ]
    return box._replace(loops=[*box.loops, *holes])


def make_profile(rng: random.Random) -> Shape:
    """An L or a U profile."""
    width, depth = float(rng.randint(40, 80)), float(rng.randint(30, 60))
    wall = float(rng.randint(4, 12))
    if rng.random() < 0.5:
        corners = [(0.0, 0.0), (width, 0.0), (width, wall), (wall, wall), (wall, depth)]
        corners += [(0.0, depth)]
        concave = 1
    else:
        corners = [(0.0, 0.0), (width, 0.0), (width, depth), (width - wall, depth)]
        corners += [(width - wall, wall), (wall, wall), (wall, depth), (0.0, depth)]
        concave = 2
    height = float(rng.randint(10, 50))
    return Shape([make_polygon(corners)], height, len(corners) - concave, concave)


def make_cylinder(rng: random.Random) -> Shape:
    radius = rng.randint(10, 60) / 2
    circle = make_circle((radius, radius), radius, turns_left=True)
    return Shape([circle], float(rng.randint(10, 50)), 0, 0)


def cut_corners(rng: random.Random, is_round: bool) -> Shape:
    """A box with a fillet or a chamfer of 45 deg along one to four upright edges.

    A fillet has two tangent lines for one corner, a chamfer two edges.
    """
    width, depth = float(rng.randint(30, 60)), float(rng.randint(30, 60))
    corners = [(0.0, 0.0), (width, 0.0), (width, depth), (0.0, depth)]
    along = [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)]
    count, cut = rng.randint(1, 4), rng.randint(4, 20) / 2
    points: list[tuple[Point, Point]] = []
    for k, (x, y) in enumerate(corners):
        (x1, y1), (x2, y2) = along[k - 1], along[k]
        size = cut if k < count else 0.0
        points.append(((x - size * x1, y - size * y1), (x + size * x2, y + size * y2)))
    segments = []
    for k, (before, after) in enumerate(points):
        segments.append(Segment(points[k - 1][1], before))
        if k < count:
            center = (after[0] - cut * along[k - 1][0], after[1] - cut * along[k - 1][1])
            segments.append(Segment(before, after, center if is_round else None))
    uprights = 4 - count if is_round else 4 + count
    return Shape([segments], float(rng.randint(10, 50)), uprights, 0)


SHAPES: list[Callable[[random.Random], Shape]] = [
    lambda rng: make_box(*(float(rng.randint(10, 80)) for _ in range(3))),
    make_plate,
    make_profile,
    make_cylinder,
    partial(cut_corners, is_round=True),
    partial(cut_corners, is_round=False),
]


def make_shape(rng: random.Random) -> Shape:
    return rng.choice(SHAPES)(rng)


def place(shape: Shape, offset: Sequence[float], rotation: FloatArray | None = None) -> Body:
    return Body(shape, np.eye(3) if rotation is None else rotation, np.array(offset, float))


def make_rotation(rng: random.Random) -> FloatArray:
    """A rotation by whole quarters about z, or by any angle about any axis."""
    if rng.random() < 0.5:
        return np.round(rotate(np.array([0.0, 0.0, 1.0]), math.pi / 2 * rng.randint(1, 3)))
    axis = np.array([rng.gauss(0, 1) for _ in range(3)])
    return rotate(axis / np.linalg.norm(axis), rng.uniform(0.2, 3.0))


def count_all(bodies: Sequence[Body]) -> tuple[int, int]:
    """Edges, concave edges."""
    shapes = [body.shape for body in bodies]
    return sum(s.edges for s in shapes), sum(s.concave_corners for s in shapes)


# Arrangements: the bodies of a file and where they stand.


def arrange_one(rng: random.Random) -> Arrangement:
    solid = place(make_shape(rng), (0.0, 0.0, 0.0))
    return Arrangement([solid], *count_all([solid]))


def arrange_apart(rng: random.Random) -> Arrangement:
    """Two or three bodies, 200 mm from corner to corner."""
    solids = [place(make_shape(rng), (200.0 * k, 0.0, 0.0)) for k in range(rng.randint(2, 3))]
    return Arrangement(solids, *count_all(solids))


def arrange_instances(rng: random.Random) -> Arrangement:
    """A body that an assembly has two or three times, turned and moved."""
    shape = make_shape(rng)
    instances = tuple(
        place(shape, (300.0 * k, 50.0 * k, -20.0 * k), make_rotation(rng))
        for k in range(rng.randint(2, 3))
    )
    return Arrangement([place(shape, (0.0, 0.0, 0.0))], *count_all(instances), instances)


def arrange_flush(rng: random.Random) -> Arrangement:
    """Two prisms over the same outline, one on the other: the edges of one higher prism."""
    low = make_shape(rng)
    high = low._replace(height=float(rng.randint(5, 40)))
    solids = [place(low, (0.0, 0.0, 0.0)), place(high, (0.0, 0.0, low.height))]
    return Arrangement(solids, low.edges, low.concave_corners)


def arrange_foot(rng: random.Random) -> Arrangement:
    """A smaller prism on a plate of 200 x 200 mm: the rim of its foot is concave."""
    plate = make_box(200.0, 200.0, float(rng.randint(4, 20)))
    post = make_shape(rng)
    if len(post.loops) > 1:  # a hole of a post would end at the plate: take the post without
        post = post._replace(loops=post.loops[:1])
    solids = [place(plate, (0.0, 0.0, 0.0)), place(post, (40.0, 50.0, plate.height))]
    edges, concave = count_all(solids)
    return Arrangement(solids, edges, concave + post.rims)


ARRANGEMENTS: dict[str, Callable[[random.Random], Arrangement]] = {
    "one body": arrange_one,
    "bodies apart": arrange_apart,
    "instances": arrange_instances,
    "touching, equal faces": arrange_flush,
    "touching, different faces": arrange_foot,
}
