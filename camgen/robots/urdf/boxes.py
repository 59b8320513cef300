"""Cuboids around the shapes of a URDF: one around each simple shape, one to three around a mesh."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import find_run_starts, list_owners, number_rows
from camgen.model.errors import InputError
from camgen.model.part import IntArray
from camgen.model.pose import IDENTITY, FloatArray, Pose, frozen, to_vec3
from camgen.read.files import Files
from camgen.read.solid.mesh_file import read_mesh
from camgen.robots.models import Box, Surface
from camgen.robots.urdf.dae import read_dae
from camgen.robots.urdf.xml import UrdfShape, find_mesh

#: Slices of a mesh along each axis, and maximum number of cuboids around it.
_SLICES, _MAX_CUBOIDS = 16, 3
#: Further cuboids, and turned ones, must be smaller than the upright one by at least this factor.
_WORTH_FACTOR = 0.85
#: mm: rounding of files. A vertex of a convex mesh is beyond a face by at most this.
_HULL_MM = 0.5
#: Planes that are compared with all vertices together, and number of planes that are tested first.
_PLANES, _FIRST_PLANES = 256, 16
#: mm: smallest half edge of a cuboid, for flat meshes.
_THIN = 0.01
#: Two crossed cuboids that are as wide as a circle, and this fraction of it high, together hold the
#: circle.
_CROSS = math.sqrt(0.5)
#: Vertices (V, 3), mm, and faces (F, 3).
_Triangles = tuple[FloatArray, IntArray]


class Shapes(Struct, frozen=True):
    """The shapes of a link, in its frame.

    parts: shapes with the triangles of a mesh, in the frame of the shape; None for a shape that is
        not a mesh. Meshes that could not be read are left out.
    surfaces: its meshes.
    unread: names of meshes that could not be read.
    notes: notes on these.
    """

    parts: tuple[tuple[UrdfShape, _Triangles | None], ...]
    surfaces: tuple[Surface, ...]
    unread: tuple[str, ...]
    notes: tuple[str, ...]

    def boxes(self) -> list[Box]:
        """Cuboids around the parts."""
        boxes: list[Box] = []
        for shape, triangles in self.parts:
            if triangles is None:
                boxes += _enclose_shape(shape)
            else:
                boxes += [
                    Box(shape.link_from_shape @ box.link_from_box, box.half)
                    for box in enclose_mesh(*triangles)
                ]
        return boxes


def read_shapes(link: str, shapes: tuple[UrdfShape, ...], folder: Path, files: Files) -> Shapes:
    """The shapes of a link. folder: folder of the URDF."""
    parts: list[tuple[UrdfShape, _Triangles | None]] = []
    surfaces, unread, notes = [], [], []
    for shape in shapes:
        if shape.kind != "mesh":
            parts.append((shape, None))
            continue
        try:
            vertices, faces = _read_mesh(shape.mesh, folder, files)
        except InputError as error:
            unread.append(shape.mesh)
            notes.append(f"link {link} has no boxes of its mesh {error}")
            continue
        vertices = vertices * np.array(shape.size)
        parts.append((shape, (vertices, faces)))
        surfaces.append(Surface(place_points(shape.link_from_shape, vertices), faces))
    return Shapes(tuple(parts), tuple(surfaces), tuple(unread), tuple(notes))


def place_points(pose: Pose, points: FloatArray) -> FloatArray:
    """Points (N, 3) of a frame in the frame in which `pose` is its pose."""
    if not np.any(pose.origin) and np.array_equal(pose.rotation, IDENTITY):
        return frozen(points)
    return frozen(points @ pose.rotation.T + pose.origin)


def _read_mesh(name: str, folder: Path, files: Files) -> tuple[FloatArray, IntArray]:
    """Vertices (V, 3), mm, and faces (F, 3). Raises InputError for a missing or damaged file."""
    path = find_mesh(name, folder)
    if path is None:
        raise InputError(name, "there is no such file near the URDF")
    source = files.read(path)
    if source.suffix == ".dae":
        vertices, triangles = read_dae(source)
        return 1000.0 * vertices, triangles.faces
    soup = read_mesh(source)
    return (soup.mm if soup.unit else 1000.0) * soup.vertices, soup.faces


def is_own_hull(surface: Surface) -> bool:
    """Whether a mesh is convex: no vertex is on both sides of the plane of any face."""
    corners = surface.vertices[surface.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normals, axis=1)
    normals = normals[length > 0] / length[length > 0, None]
    level = (normals * corners[length > 0, 0]).sum(axis=1)
    # A few faces are mostly enough to find that a mesh is not convex.
    first = np.arange(0, len(normals), max(len(normals) // _FIRST_PLANES, 1))
    if _separate_vertices(surface.vertices, normals[first], level[first]):
        return False
    vertices = np.unique(surface.vertices, axis=0)
    for begin in range(0, len(normals), _PLANES):
        rows = slice(begin, begin + _PLANES)
        if _separate_vertices(vertices, normals[rows], level[rows]):
            return False
    return True


def _separate_vertices(vertices: FloatArray, normals: FloatArray, level: FloatArray) -> bool:
    """Whether vertices (V, 3) are on both sides of any of F planes.

    normals: (F, 3) unit vectors.
    level: (F,) distances of the planes along these, mm.
    """
    height = normals @ vertices.T
    is_above = height.max(axis=1) - level > _HULL_MM
    return bool((is_above & (height.min(axis=1) - level < -_HULL_MM)).any())


def _enclose_shape(shape: UrdfShape) -> list[Box]:
    """The cuboid around a box or a sphere, or two crossed ones around a cylinder.

    The corners of the square around the cylinder are in neither of these.
    """
    a, b, c = (size / 2 for size in shape.size)
    if shape.kind != "cylinder":
        return [Box(shape.link_from_shape, (a, b, c))]
    return [
        Box(shape.link_from_shape, (a, b * _CROSS, c)),
        Box(shape.link_from_shape, (a * _CROSS, b, c)),
    ]


def enclose_mesh(vertices: FloatArray, faces: IntArray) -> list[Box]:
    """Cuboids that together hold a mesh of `vertices` (V, 3), mm, and `faces` (F, 3).

    It is one cuboid, upright or turned, or up to three upright ones.
    """
    used = np.zeros(len(vertices), dtype=np.bool_)
    used[faces] = True
    points, sides = vertices[used], faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    single = _upright(points.min(axis=0), points.max(axis=0))
    best, size = [single], _volume([single]) * _WORTH_FACTOR
    slices = (_slice(points, vertices, sides, axis) for axis in range(3))
    for boxes in ([_box_along_axes(points)], *slices):
        if _volume(boxes) < size:
            best, size = boxes, _volume(boxes)
    return best


def _volume(boxes: list[Box]) -> float:
    return sum(8 * float(np.prod(box.half)) for box in boxes)


def _upright(low: FloatArray, high: FloatArray, rotation: FloatArray = IDENTITY) -> Box:
    """The cuboid from `low` to `high`, in a frame with this rotation."""
    centre = to_vec3(rotation @ ((low + high) / 2))
    return Box(Pose(rotation, centre), to_vec3(np.maximum((high - low) / 2, _THIN)))


def _box_along_axes(points: FloatArray) -> Box:
    """The cuboid along the principal axes of the points."""
    _, _, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    rotation = frozen(np.column_stack([axes[0], axes[1], np.cross(axes[0], axes[1])]))
    turned = points @ rotation
    return _upright(turned.min(axis=0), turned.max(axis=0), rotation)


def _slice(points: FloatArray, vertices: FloatArray, sides: IntArray, axis: int) -> list[Box]:
    """Up to three cuboids around triangles, one after the other along `axis`.

    points: (P, 3) corners of the triangles.
    vertices: (V, 3) vertices of the mesh.
    sides: (S, 2) indices of vertices at the ends of the sides of the triangles.
    """
    low, high = _slices(points, vertices, sides, axis)
    kept = np.isfinite(low[:, 0])
    low, high = low[kept], high[kept]
    count = len(low)
    # sizes[a, b] is the volume of the cuboid around the slices from a up to b - 1.
    sizes = np.full((count, count + 1), np.inf)
    for a in range(count):
        edges = np.maximum.accumulate(high[a:], axis=0) - np.minimum.accumulate(low[a:], axis=0)
        sizes[a, a + 1 :] = np.maximum(edges, 2 * _THIN).prod(axis=1)
    best, smallest = [0, count], float(sizes[0, count])
    for cut_count in range(1, min(_MAX_CUBOIDS, count)):
        smallest *= _WORTH_FACTOR
        for cuts in itertools.combinations(range(1, count), cut_count):
            ends = [0, *cuts, count]
            size = sum(float(sizes[a, b]) for a, b in itertools.pairwise(ends))
            if size < smallest:
                best, smallest = ends, size
    return [
        _upright(low[a:b].min(axis=0), high[a:b].max(axis=0)) for a, b in itertools.pairwise(best)
    ]


def _slices(
    points: FloatArray, vertices: FloatArray, sides: IntArray, axis: int
) -> tuple[FloatArray, FloatArray]:
    """The smallest and largest coordinates (S, 3) of triangles in each slice across `axis`.

    They are infinite in an empty slice. A side that passes a plane between two slices touches both
    there. The arguments are those of `_slice`.
    """
    along = vertices[:, axis]
    planes = np.linspace(points[:, axis].min(), points[:, axis].max(), _SLICES + 1)
    inside = np.searchsorted(planes, points[:, axis], side="right") - 1
    first = np.searchsorted(planes[1:-1], along)
    beyond = np.searchsorted(planes[1:-1], along, side="right")
    a, b = sides.T
    falls = along[a] > along[b]
    begin, stop = np.where(falls, b, a), np.where(falls, a, b)
    counts = beyond[stop] - first[begin]
    counts[along[a] == along[b]] = 0
    side = np.flatnonzero(counts)
    counts = counts[side]
    owner = list_owners(counts)
    number = first[begin[side]][owner] + number_rows(counts)
    start, end, plane = vertices[a[side]][owner], vertices[b[side]][owner], planes[1 + number]
    fraction = (plane - start[:, axis]) / (end[:, axis] - start[:, axis])
    crossing = start + (end - start) * fraction[:, None]
    crossing[:, axis] = plane
    slices = np.concatenate([np.clip(inside, 0, _SLICES - 1), number, number + 1])
    return _measure_extents(np.concatenate([points, crossing, crossing]), slices)


def _measure_extents(points: FloatArray, slices: IntArray) -> tuple[FloatArray, FloatArray]:
    """The smallest and largest coordinates (S, 3) of points (N, 3) in each slice."""
    low, high = np.full((_SLICES, 3), np.inf), np.full((_SLICES, 3), -np.inf)
    # NumPy sorts numbers of one byte by counting, which is faster.
    order = np.argsort(slices.astype(np.int8), kind="stable")
    points, slices = points[order], slices[order]
    firsts = find_run_starts(slices)
    low[slices[firsts]] = np.minimum.reduceat(points, firsts, axis=0)
    high[slices[firsts]] = np.maximum.reduceat(points, firsts, axis=0)
    return low, high
