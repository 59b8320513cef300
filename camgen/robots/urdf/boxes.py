"""Cuboids around the shapes of a URDF: one around each simple shape, one to three around a mesh."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.model.errors import InputError
from camgen.model.part import IntArray
from camgen.model.pose import IDENTITY, FloatArray, Pose, frozen, to_vec3
from camgen.model.tolerance import PARALLEL_EDGES
from camgen.read.files import Files
from camgen.read.solid.mesh_file import load
from camgen.robots.kinematics.forward import frames
from camgen.robots.models import Box, Robot, Surface
from camgen.robots.urdf.xml import UrdfShape, mesh_path

#: A mesh is looked at in so many slices along each axis, and becomes so many cuboids at most.
_SLICES, _MOST_CUBOIDS = 16, 3
#: More cuboids, or turned ones, have to be smaller than the upright one by at least this factor.
_WORTH_FACTOR = 0.85
#: mm: the least half edge of a cuboid, for meshes that are flat.
_THIN = 0.01
#: Of the radius: two cuboids, one as wide as a circle and this high, the other the other way round, hold the circle.
_CROSS = math.sqrt(0.5)


class Shapes(Struct, frozen=True):
    """Cuboids around the shapes of a link, in its frame, its meshes, and notes on what has none."""

    boxes: tuple[Box, ...]
    surfaces: tuple[Surface, ...]
    notes: tuple[str, ...]


def shapes_of(link: str, shapes: tuple[UrdfShape, ...], folder: Path, files: Files) -> Shapes:
    """What the URDF in ``folder`` says of the shapes of a link."""
    boxes: list[Box] = []
    surfaces, notes = [], []
    for shape in shapes:
        if shape.kind != "mesh":
            boxes += _simple(shape)
            continue
        path = mesh_path(shape.mesh, folder)
        if path is None:
            notes.append(
                f"link {link} has no boxes of its mesh {shape.mesh}: there is no such file near the URDF"
            )
            continue
        try:
            soup = load(files.read(path))
        except InputError as error:
            notes.append(f"link {link} has no boxes of its mesh {error}")
            continue
        vertices = (soup.mm if soup.unit else 1000.0) * soup.vertices * np.array(shape.size)
        boxes += [
            Box(shape.link_from_shape @ box.link_from_box, box.half)
            for box in around(vertices, soup.faces)
        ]
        surfaces.append(
            Surface(
                frozen(vertices @ shape.link_from_shape.rotation.T + shape.link_from_shape.origin),
                soup.faces,
            )
        )
    return Shapes(tuple(boxes), tuple(surfaces), tuple(notes))


def _simple(shape: UrdfShape) -> list[Box]:
    """The cuboid around a box or a sphere; two around a cylinder, crosswise, which leaves its corners out."""
    a, b, c = (size / 2 for size in shape.size)
    if shape.kind != "cylinder":
        return [Box(shape.link_from_shape, (a, b, c))]
    return [
        Box(shape.link_from_shape, (a, b * _CROSS, c)),
        Box(shape.link_from_shape, (a * _CROSS, b, c)),
    ]


def around(vertices: FloatArray, faces: IntArray) -> list[Box]:
    """Cuboids that together hold a mesh of ``vertices`` (V, 3), mm: one, upright or turned, or up to three upright."""
    points, corners = vertices[np.unique(faces)], vertices[faces]
    single = _upright(points.min(axis=0), points.max(axis=0))
    best, size = [single], _volume([single]) * _WORTH_FACTOR
    for boxes in ([_box_along_axes(points)], *(_slice(corners, axis) for axis in range(3))):
        if _volume(boxes) < size:
            best, size = boxes, _volume(boxes)
    return best


def _volume(boxes: list[Box]) -> float:
    return sum(8 * float(np.prod(box.half)) for box in boxes)


def _upright(low: FloatArray, high: FloatArray, rotation: FloatArray = IDENTITY) -> Box:
    """The cuboid from ``low`` to ``high``, both in a frame with this rotation."""
    centre = to_vec3(rotation @ ((low + high) / 2))
    return Box(Pose(rotation, centre), to_vec3(np.maximum((high - low) / 2, _THIN)))


def _box_along_axes(points: FloatArray) -> Box:
    """The cuboid along the principal axes of the points."""
    _, _, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    rotation = frozen(np.column_stack([axes[0], axes[1], np.cross(axes[0], axes[1])]))
    own = points @ rotation
    return _upright(own.min(axis=0), own.max(axis=0), rotation)


def _slice(corners: FloatArray, axis: int) -> list[Box]:
    """Up to three cuboids, one behind the other along ``axis``, around triangles (F, 3, 3)."""
    low, high = _slices(corners, axis)
    kept = np.isfinite(low[:, 0])
    low, high = low[kept], high[kept]
    count = len(low)
    sizes = np.full((count, count + 1), np.inf)  # of the cuboid around slices from a to below b
    for a in range(count):
        edges = np.maximum.accumulate(high[a:], axis=0) - np.minimum.accumulate(low[a:], axis=0)
        sizes[a, a + 1 :] = np.maximum(edges, 2 * _THIN).prod(axis=1)
    best, least = [0, count], float(sizes[0, count])
    for more in range(1, min(_MOST_CUBOIDS, count)):
        least *= _WORTH_FACTOR
        for cuts in itertools.combinations(range(1, count), more):
            ends = [0, *cuts, count]
            size = sum(float(sizes[a, b]) for a, b in itertools.pairwise(ends))
            if size < least:
                best, least = ends, size
    return [
        _upright(low[a:b].min(axis=0), high[a:b].max(axis=0)) for a, b in itertools.pairwise(best)
    ]


def _slices(corners: FloatArray, axis: int) -> tuple[FloatArray, FloatArray]:
    """What of the triangles lies in each slice across ``axis``: least and greatest coordinates (S, 3), infinite where
    there is nothing. An edge that passes a plane between two slices touches both there.
    """
    along = corners[..., axis]
    planes = np.linspace(along.min(), along.max(), _SLICES + 1)
    low, high = np.full((_SLICES, 3), np.inf), np.full((_SLICES, 3), -np.inf)
    points = corners.reshape(-1, 3)
    inside = np.clip(np.searchsorted(planes, points[:, axis], side="right") - 1, 0, _SLICES - 1)
    np.minimum.at(low, inside, points)
    np.maximum.at(high, inside, points)
    a, b = points, corners[:, [1, 2, 0]].reshape(-1, 3)
    for k, plane in enumerate(planes[1:-1].tolist()):
        crosses = (a[:, axis] - plane) * (b[:, axis] - plane) <= 0
        crosses &= a[:, axis] != b[:, axis]
        if not crosses.any():
            continue
        start, end = a[crosses], b[crosses]
        there = (
            start
            + (end - start) * ((plane - start[:, axis]) / (end[:, axis] - start[:, axis]))[:, None]
        )
        there[:, axis] = plane
        for slice_ in (k, k + 1):
            low[slice_] = np.minimum(low[slice_], there.min(axis=0))
            high[slice_] = np.maximum(high[slice_], there.max(axis=0))
    return low, high


# Which links of an arm overlap whatever its joints do: there is no sense in testing those against each other.

#: Configurations in which two links have to overlap, every time.
_OVERLAP_SAMPLES = 48

_Boxes = tuple[FloatArray, FloatArray, FloatArray]


def touching(robot: Robot) -> tuple[tuple[int, int], ...]:
    """Pairs of links, the base being 0, that are neighbours or whose boxes, grown by the robot's pad, overlap at home
    and in all of an even sample of configurations.
    """
    rng = np.random.default_rng(1)
    spread = rng.uniform(
        robot.limits[:, 0], robot.limits[:, 1], (_OVERLAP_SAMPLES, len(robot.joints))
    )
    rotations, origins = frames(robot, np.vstack([robot.home, spread]))
    bodies = [
        _place(link.boxes, robot.pad, rotations[:, k], origins[:, k]) if link.boxes else None
        for k, link in enumerate(robot.links)
    ]
    pairs = []
    for i, j in itertools.combinations(range(len(bodies)), 2):
        a, b = bodies[i], bodies[j]
        if j == i + 1 or (a and b and bool(overlaps(a, b).any(axis=(1, 2)).all())):
            pairs.append((i, j))
    return tuple(pairs)


def _place(
    boxes: tuple[Box, ...], pad: float, rotations: FloatArray, origins: FloatArray
) -> _Boxes:
    """B boxes of a link in S places of it: axes (S, B, 3, 3), centres (S, B, 3) and half edges (B, 3)."""
    own = np.stack([box.link_from_box.rotation for box in boxes])
    centres = np.array([box.link_from_box.origin for box in boxes])
    half = np.array([box.half for box in boxes]) + pad
    return rotations[:, None] @ own, origins[:, None] + centres @ rotations.transpose(0, 2, 1), half


def overlaps(a: _Boxes, b: _Boxes) -> NDArray[np.bool_]:
    """(S, A, B): which boxes overlap which others, by separating axes (Gottschalk, Lin, Manocha, 1996)."""
    (axes_a, at_a, half_a), (axes_b, at_b, half_b) = a, b
    turn = np.swapaxes(axes_a[:, :, None], -1, -2) @ axes_b[:, None]
    away = ((at_b[:, None] - at_a[:, :, None])[..., None, :] @ axes_a[:, :, None])[..., 0, :]
    size = np.abs(turn) + PARALLEL_EDGES
    first, second = half_a[:, None], half_b[None]
    apart = (np.abs(away) > first + (size @ second[..., None])[..., 0]).any(axis=-1)
    seen = (away[..., None, :] @ turn)[..., 0, :]
    apart |= (np.abs(seen) > second + (first[..., None, :] @ size)[..., 0, :]).any(axis=-1)
    for i, j in itertools.product(range(3), range(3)):
        i1, i2, j1, j2 = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
        reach = first[..., i1] * size[..., i2, j] + first[..., i2] * size[..., i1, j]
        reach = reach + second[..., j1] * size[..., i, j2] + second[..., j2] * size[..., i, j1]
        apart |= np.abs(away[..., i2] * turn[..., i1, j] - away[..., i1] * turn[..., i2, j]) > reach
    return np.asarray(~apart)
