"""Parts with shapes drawn by a seed, and scans of them from one place or several. Lengths are mm.

A part is a stack of layers, each an outline with holes. Rays from the scanner's places meet its
triangles and the bench. Nothing here is camgen's own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
import shapely
import trimesh
from shapely.geometry import Point, Polygon, box

Array = np.ndarray

KINDS = ("plate", "bent sheet", "block", "flange")
#: The scanned part: the model, or the model with one difference.
RIGHT, HAND, LONGER, MOVED, LARGER = (
    "right",
    "wrong hand",
    "other length",
    "hole moved",
    "hole larger",
)
#: The ranges from which a seed draws.
LENGTHS = {"plate": (80, 200), "bent sheet": (80, 160), "block": (80, 150), "flange": (80, 150)}
THICKNESSES = {"plate": (1.5, 5), "bent sheet": (1.5, 3), "block": (25, 60), "flange": (8, 15)}
WIDTH_SHARE, HOLES = (0.5, 0.75), (8, 18)
CHANGED_LENGTH, CHANGED_PLACE, CHANGED_DIAMETER = (5, 10), (5, 10), (4, 8)
NOISE, SPACING, FLYING = (0.02, 0.2), (0.8, 1.4), (0.0, 0.01)
STRAY, BENCH = (0.0, 0.2), (0.0, 0.6)
DISTANCE, ELEVATION_DEG = (500, 900), (35, 65)


@dataclass(frozen=True)
class Shape:
    """The dimensions of a part. holes: (x, y, diameter) each."""

    kind: str
    length: float
    width: float
    thickness: float
    height: float
    holes: tuple[tuple[float, float, float], ...]


def draw_shape(kind: str, rng: np.random.Generator) -> Shape:
    """A part of a kind, with holes that keep a distance from each other and from the sides."""
    length, thickness = rng.uniform(*LENGTHS[kind]), rng.uniform(*THICKNESSES[kind])
    width = length if kind == "flange" else length * rng.uniform(*WIDTH_SHARE)
    height = rng.uniform(12, 30)
    while True:
        holes = [
            (rng.uniform(0.15, 0.85) * length, rng.uniform(0.2, 0.8) * width, rng.uniform(*HOLES))
            for _ in range(3)
        ]
        shape = Shape(kind, length, width, thickness, height, tuple(holes))
        if is_sound(shape):
            return shape


def is_sound(shape: Shape, clearance: float = 4.0) -> bool:
    """Whether each hole keeps ``room`` mm to the other holes and to the sides of its floor."""
    floor = free_floor(shape).buffer(-clearance)
    discs = [Point(x, y).buffer(d / 2) for x, y, d in shape.holes]
    gaps = [a.distance(b) for a, b in combinations(discs, 2)]
    return min(gaps) > clearance and all(floor.contains(disc) for disc in discs)


def free_floor(shape: Shape) -> Polygon:
    """The area for holes: the lowest outline without the layers on it."""
    low, *upper = outlines(shape)
    if shape.kind in ("plate", "block"):
        return low if shape.kind == "plate" else upper[0]
    return low.difference(shapely.union_all(upper))


def outlines(shape: Shape) -> list[Polygon]:
    """The outlines of the layers without holes, from below."""
    length, width = shape.length, shape.width
    corner = Polygon([(length, width), (length - 0.2 * length, width), (length, 0.7 * width)])
    whole = box(0, 0, length, width)
    if shape.kind == "plate":
        plate = whole.difference(corner).difference(
            box(0.3 * length, 0, 0.45 * length, 0.15 * width)
        )
        return [plate, plate]
    if shape.kind == "bent sheet":
        t = shape.thickness
        return [whole.difference(corner), box(0, 0, t, width), box(0, 0, t, 0.55 * width)]
    if shape.kind == "block":
        return [
            whole,
            whole.difference(box(0.75 * length, 0.5 * width, length, width)).difference(corner),
        ]
    r = length / 2
    disc = Point(r, r).buffer(r, 32).difference(box(0, 0, 0.12 * length, length))
    return [disc, Point(0.55 * length, r).buffer(0.22 * length, 32)]


def heights(shape: Shape) -> list[float]:
    """The heights between the layers, from below."""
    t = shape.thickness
    return {
        "plate": [0, 0.5 * t, t],
        "bent sheet": [0, t, t + shape.height, t + 1.7 * shape.height],
        "block": [0, 0.5 * t, t],
        "flange": [0, t, t + shape.height],
    }[shape.kind]


def build(shape: Shape) -> trimesh.Trimesh:
    """The surface of a part. The counterbore of a plate makes it differ from its mirror image."""
    discs = [Point(x, y).buffer(d / 2, 24) for x, y, d in shape.holes]
    layers = [outline.difference(shapely.union_all(discs)) for outline in outlines(shape)]
    if shape.kind == "plate":
        x, y, d = shape.holes[0]
        layers[1] = layers[1].difference(Point(x, y).buffer(d / 2 + 5, 24))
    return stack(layers, heights(shape))


def stack(layers: list[Polygon], levels: list[float]) -> trimesh.Trimesh:
    """The closed surface of layers, the i-th between the i-th level and the next."""
    triangles: list[Array] = []
    corners = shapely.MultiPoint(shapely.get_coordinates(layers))
    # An edge ends at each corner of another layer that lies on it.
    layers = [shapely.snap(layer, corners, 1e-9) for layer in layers]
    nothing = Polygon()
    for below, above, z in zip([nothing, *layers], [*layers, nothing], levels, strict=True):
        triangles += [triangulate(each, z, up=True) for each in polygons(below.difference(above))]
        triangles += [triangulate(each, z, up=False) for each in polygons(above.difference(below))]
    for layer, low, high in zip(layers, levels, levels[1:], strict=False):
        for each in polygons(layer):
            rings = [each.exterior, *each.interiors]
            triangles += [wall(np.asarray(ring.coords), low, high) for ring in rings]
    corners = np.concatenate(triangles)
    vertices, indices = np.unique(np.round(corners.reshape(-1, 3), 6), axis=0, return_inverse=True)
    return trimesh.Trimesh(vertices, indices.reshape(-1, 3), process=False)


def polygons(shape) -> list[Polygon]:
    """The polygons of a shape, outer rings counter-clockwise, without slivers."""
    pieces = shapely.get_parts(shape)
    large = [piece for piece in pieces if piece.geom_type == "Polygon" and piece.area > 1e-6]
    return list(shapely.orient_polygons(large))


def triangulate(polygon: Polygon, z: float, up: bool) -> Array:
    """The triangles (F, 3, 3) of a polygon at a height, seen from above or from below."""
    pieces = shapely.get_parts(shapely.constrained_delaunay_triangles(polygon))
    triangles = shapely.orient_polygons(pieces)
    flat = np.array([np.asarray(triangle.exterior.coords)[:3] for triangle in triangles])
    corners = np.dstack([flat, np.full(flat.shape[:2], z)])
    return corners if up else corners[:, ::-1]


def wall(ring: Array, low: float, high: float) -> Array:
    """The triangles of the wall along a ring whose material is on its left."""
    below, above = (np.column_stack([ring, np.full(len(ring), z)]) for z in (low, high))
    a, b, c, d = below[:-1], below[1:], above[1:], above[:-1]
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def change(shape: Shape, variant: str, rng: np.random.Generator) -> trimesh.Trimesh:
    """The part that is scanned: the shape itself, or with one difference."""
    if variant == RIGHT:
        return build(shape)
    if variant == HAND:
        mesh = build(shape)
        return trimesh.Trimesh(mesh.vertices * [-1, 1, 1], mesh.faces[:, ::-1], process=False)
    if variant == LONGER:
        change_mm = rng.uniform(*CHANGED_LENGTH) * rng.choice([-1, 1])
        longer = replace(shape, length=shape.length + change_mm)
        if shape.kind == "flange":  # the holes keep their places about the middle
            holes = tuple((x + change_mm / 2, y + change_mm / 2, d) for x, y, d in shape.holes)
            longer = replace(longer, width=longer.length, holes=holes)
        return build(longer)
    while True:
        x, y, d = shape.holes[1]
        if variant == MOVED:
            angle, change_mm = rng.uniform(0, 2 * np.pi), rng.uniform(*CHANGED_PLACE)
            hole = (x + change_mm * np.cos(angle), y + change_mm * np.sin(angle), d)
        else:
            hole = (x, y, d + rng.uniform(*CHANGED_DIAMETER))
        other = replace(shape, holes=(shape.holes[0], hole, shape.holes[2]))
        if is_sound(other, 0.5):
            return build(other)


@dataclass(frozen=True)
class Scene:
    """A scan of a part.

    points: (N, 3).
    eye: (3,), the scanner's place, None if it had several.
    turn, place: (3, 3) and (3,), the pose of the part. A scan of the model must lead to it.
    """

    points: Array
    eye: Array | None
    turn: Array
    place: Array


def rings(shape: Shape) -> Array:
    """Places (K, 3) around the second hole, on both sides of the floor, 4 mm from its rim."""
    x, y, d = shape.holes[1]
    angles = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    flat = [x, y] + (d / 2 + 4) * np.column_stack([np.cos(angles), np.sin(angles)])
    return np.concatenate([np.column_stack([flat, np.full(16, z)]) for z in (0.0, shape.thickness)])


def scan(
    part: trimesh.Trimesh, shape: Shape, views: int, rng: np.random.Generator, shown: Array
) -> Scene:
    """The part on a bench, seen from ``views`` places and then moved to anywhere.

    Plates and flanges may lie turned over. The ranges above hold all else. The first place sees
    all of ``shown`` (K, 3) on the part's upper side.
    """
    noise, step, stray, bench, flying = (
        rng.uniform(*each) for each in (NOISE, SPACING, STRAY, BENCH, FLYING)
    )
    is_flipped = shape.kind in ("plate", "flange") and rng.random() < 0.4
    flip = np.diag([1.0, -1.0, -1.0]) if is_flipped else np.eye(3)
    corners = (part.triangles - part.bounds.mean(axis=0)) @ flip.T
    lowest = corners[..., 2].min()
    inner = -flip @ part.bounds.mean(axis=0) - [0, 0, lowest]
    corners[..., 2] -= lowest
    upper = shown @ flip.T + inner
    upper = upper[upper[:, 2] > upper[:, 2].max(initial=-np.inf) - 0.01]
    parts, benches, flown, eyes = [], [], [], []
    first = choose_side(corners, upper, shape, rng)
    for k in range(views):
        rise = np.radians(rng.uniform(*ELEVATION_DEG))
        eye = rng.uniform(*DISTANCE) * direction(first + 2 * np.pi * k / views, rise)
        on_part, on_bench, between = cast(corners, eye, step * np.sqrt(views), noise, rng)
        eyes.append(eye)
        parts.append(on_part)
        benches.append(on_bench)
        flown.append(between)
    on_part, on_bench, between = (np.concatenate(each) for each in (parts, benches, flown))
    wanted = round(bench / (1 - bench) * len(on_part))
    nearest = np.argsort(np.abs(on_bench[:, :2]).max(axis=1), kind="stable")[:wanted]
    drawn = rng.permutation(len(between))[: round(flying * len(on_part))]
    points = np.concatenate([on_part, on_bench[nearest], between[drawn]])
    low, high = points.min(axis=0) - 20, points.max(axis=0) + 20
    strays = rng.uniform(low, high, (round(stray / (1 - stray) * len(points)), 3))
    points = rng.permutation(np.concatenate([points, strays]))
    axis = rng.normal(size=3)
    turn = trimesh.transformations.rotation_matrix(rng.uniform(0, np.pi), axis)[:3, :3]
    shift = rng.uniform(-300, 300, 3)
    eye = turn @ eyes[0] + shift if views == 1 else None
    return Scene(points @ turn.T + shift, eye, turn @ flip, turn @ inner + shift)


def direction(turn: float, rise: float) -> Array:
    """The unit direction (3,) at an azimuth and an elevation, both rad."""
    return np.array([np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn), np.sin(rise)])


def choose_side(corners: Array, shown: Array, shape: Shape, rng: np.random.Generator) -> float:
    """The azimuth of the first place, rad. From there each of ``shown`` (K, 3) is seen.

    A bent sheet is seen from its open side: else its wall would hide its floor.
    """
    widest = 1.0 if shape.kind == "bent sheet" else np.pi
    while True:
        turn = rng.uniform(-widest, widest)
        eye = DISTANCE[0] * direction(turn, np.radians(ELEVATION_DEG[0]))
        distances = np.linalg.norm(shown - eye, axis=1)
        rays = (shown - eye) / distances[:, None]
        if (meet(corners, eye, rays) > distances - 0.01).all():
            return turn


def cast(
    corners: Array, eye: Array, step: float, noise: float, rng: np.random.Generator
) -> tuple[Array, Array, Array]:
    """Places (N, 3) on the part, on the bench at z = 0, and of flying pixels.

    Rays from ``eye`` find them. A flying pixel lies between the depths of two neighbouring rays
    that differ by more than 5 mm.

    step: mm between two rays at the middle of the part.
    noise: mm, along the ray.
    """
    reach = 1.3 * np.linalg.norm(corners.reshape(-1, 3), axis=1).max()
    back = eye / np.linalg.norm(eye)
    side = np.cross([0.0, 0.0, 1.0], back)
    side /= np.linalg.norm(side)
    ticks = np.arange(-reach, reach, step)
    grid = np.stack(np.meshgrid(ticks, ticks, indexing="ij"), axis=-1)
    grid = grid + rng.uniform(-0.3, 0.3, grid.shape) * step
    targets = grid[..., :1] * side + grid[..., 1:] * np.cross(back, side)
    rays = targets - eye
    rays /= np.linalg.norm(rays, axis=2, keepdims=True)
    part = meet(corners, eye, rays.reshape(-1, 3)).reshape(rays.shape[:2])
    floor = np.where(rays[..., 2] < -1e-6, -eye[2] / np.minimum(rays[..., 2], -1e-6), np.inf)
    depth = np.minimum(part, floor)
    first, second = depth[:-1].ravel(), depth[1:].ravel()
    jump = np.isfinite(first) & np.isfinite(second) & (np.abs(first - second) > 5)
    between = first + rng.random(len(first)) * (second - first)
    flown = eye + between[jump, None] * rays[:-1].reshape(-1, 3)[jump]
    places = eye + (depth + rng.normal(0, noise, depth.shape))[..., None] * rays
    on_part = np.isfinite(part) & (part < floor)
    on_bench = ~on_part & np.isfinite(floor) & (np.abs(places[..., :2]) < 2 * reach).all(axis=2)
    return places[on_part], places[on_bench], flown


def meet(corners: Array, eye: Array, rays: Array) -> Array:
    """The distance (N,) from ``eye`` to the first triangle on each ray (N, 3), inf without one.

    The triangles are about the origin. A block of neighbouring rays is tested with those that its
    part of the picture from the eye towards the origin holds.
    """
    a, b, c = (corners[:, k] - eye for k in range(3))
    sides = [np.cross(u, v) for u, v in ((a, b), (b, c), (c, a))]
    normal, height = np.cross(b - a, c - a), np.einsum("ij,ij->i", a, np.cross(b, c))
    across = np.cross(eye, [0.0, 0.0, 1.0])
    axes = np.stack([across, np.cross(eye, across), -eye], axis=1)
    picture = draw(corners - eye, axes)
    low, high = picture.min(axis=1) - 1e-6, picture.max(axis=1) + 1e-6
    depths = np.full(len(rays), np.inf)
    for begin in range(0, len(rays), 1000):
        block = rays[begin : begin + 1000]
        at = draw(block, axes)
        near = ((low <= at.max(axis=0)) & (high >= at.min(axis=0))).all(axis=1)
        signs = np.stack([block @ side[near].T for side in sides])
        inside = (signs >= -1e-9).all(axis=0) | (signs <= 1e-9).all(axis=0)
        fall = block @ normal[near].T
        depth = height[near] / np.where(fall == 0, 1, fall)
        hits = inside & (np.abs(fall) > 1e-12) & (depth > 0)
        depths[begin : begin + 1000] = np.where(hits, depth, np.inf).min(axis=1, initial=np.inf)
    return depths


def draw(directions: Array, axes: Array) -> Array:
    """The picture (..., 2) of directions (..., 3); axes (3, 3): across, upright and forward."""
    seen = directions @ axes
    return seen[..., :2] / seen[..., 2:]
