"""The faces on which a part can rest on a table: stable facets of its convex hull.

The hull is found by quickhull (Barber, Dobkin, Huhdanpaa: The quickhull algorithm, 1996).
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct, field

from camgen.geometry.surface import is_closed
from camgen.geometry.vectors import cross
from camgen.model.part import IntArray
from camgen.model.pose import FloatArray, frozen, rotation_about, rotation_about_axis

#: Shares of the longest side of a part: what the hull may leave outside, which is more than the
#: rounding of an STL file; and how far a vertex may be above a face on which the part rests.
_HULL, _FLAT = 1e-6, 1e-4
#: rad: a part that falls over when it is tilted by less does not rest.
STABLE = math.radians(5.0)


class RestingFace(Struct, frozen=True, eq=False):
    """A face on which a part rests, in the frame of the part.

    normal: (3,) unit, outward: it points down when the part rests.
    middle: (3,) centre of area of the face, mm.
    area: area of the convex polygon around the points that touch the table, mm2.
    size: sides of the smallest rectangle around the polygon, the longer one first, mm.
    tipping: angle by which the part can be tilted before it falls over, rad.
    """

    normal: FloatArray
    middle: FloatArray
    area: float
    size: tuple[float, float]
    tipping: float


def find_resting_faces(
    vertices: FloatArray, faces: IntArray, stable: float = STABLE
) -> list[RestingFace]:
    """The faces on which a part rests, the largest first.

    vertices: (V, 3) mm.
    faces: (F, 3) rows of vertices.
    stable: a face with a smaller angle of tipping is left out, rad.

    The centre of mass is that of a body of even density. A mesh that is not closed has none: the
    centre of mass of its hull counts instead. A flat part has no resting face.
    """
    points = np.unique(vertices[np.unique(faces)], axis=0)
    size = float(np.ptp(points, axis=0).max(initial=0.0)) if len(points) else 0.0
    hull = find_hull(points, _HULL * size)
    if not len(hull):
        return []
    # Vertices at one place count as one.
    _, same = np.unique(vertices, axis=0, return_inverse=True)
    has_volume = is_closed(same.ravel()[faces], len(vertices))
    centre = find_centre_of_mass(vertices, faces) if has_volume else None
    if centre is None:
        centre = find_centre_of_mass(points, hull)
    assert centre is not None
    corners = np.unique(hull)
    normals = cross(
        points[hull[:, 1]] - points[hull[:, 0]], points[hull[:, 2]] - points[hull[:, 0]]
    )
    areas = np.linalg.norm(normals, axis=1)
    pending = areas > 0
    resting = []
    for triangle in np.argsort(-areas, kind="stable").tolist():
        if not pending[triangle]:
            continue
        normal = normals[triangle] / areas[triangle]
        heights = points[corners] @ normal
        touches = np.zeros(len(points), dtype=np.bool_)
        touches[corners[heights >= heights.max() - _FLAT * size]] = True
        pending &= ~touches[hull].all(axis=1)
        pending[triangle] = False
        face = _make_face(points[touches], normal, centre, stable)
        if face is not None and face.tipping >= stable:
            resting.append(face)
    return sorted(resting, key=lambda face: (-round(face.area, 3), face.normal.round(6).tolist()))


def find_centre_of_mass(vertices: FloatArray, faces: IntArray) -> FloatArray | None:
    """The centre (3,) of a closed mesh of even density, by the divergence theorem.

    None for a mesh without a volume.
    """
    origin = vertices.mean(axis=0)
    a, b, c = (vertices[faces] - origin).transpose(1, 0, 2)
    volumes = (a * cross(b, c)).sum(axis=1) / 6
    total = float(volumes.sum())
    if abs(total) <= 1e-9 * float(np.ptp(vertices, axis=0).max()) ** 3:
        return None
    return np.asarray(origin + volumes @ (a + b + c) / (4 * total))


def make_rotation_down(normal: FloatArray) -> tuple[FloatArray, float]:
    """Axis (3,) and angle (rad) of the smallest rotation that turns a unit normal downwards."""
    axis = np.cross(normal, (0.0, 0.0, -1.0))
    sine = float(np.linalg.norm(axis))
    angle = math.atan2(sine, -float(normal[2]))
    return (axis / sine if sine > 1e-9 else np.array([1.0, 0.0, 0.0])), angle


def turn_down(normal: FloatArray) -> FloatArray:
    """The rotation (3, 3) of `make_rotation_down`."""
    axis, angle = make_rotation_down(normal)
    if abs(angle) < 1e-9:
        return frozen(np.eye(3))
    if math.pi - angle < 1e-9:
        return rotation_about(0, math.pi)
    return rotation_about_axis(axis, angle)


def _make_face(
    points: FloatArray, normal: FloatArray, centre: FloatArray, stable: float
) -> RestingFace | None:
    """The face with the corners `points`; None if the part falls over on it."""
    level = float((points @ normal).mean())
    height = level - float(centre @ normal)
    aside = np.linalg.norm(points - centre - height * normal, axis=1).max()
    if aside < height * math.tan(stable):
        return None
    from shapely import MultiPoint, Point  # noqa: PLC0415 (only where faces are sought)

    x = np.cross(normal, np.eye(3)[int(np.abs(normal).argmin())])
    x /= np.linalg.norm(x)
    axes = np.stack([x, np.cross(normal, x)])
    polygon = MultiPoint(points @ axes.T).convex_hull
    foot = Point(*(axes @ centre))
    if polygon.area <= 0 or not polygon.contains(foot):
        return None
    ring = np.array(polygon.minimum_rotated_rectangle.exterior.coords)
    sides = np.linalg.norm(np.diff(ring[:3], axis=0), axis=1)
    middle = np.array(polygon.centroid.coords[0]) @ axes + level * normal
    tipping = math.atan2(polygon.exterior.distance(foot), height)
    longer, shorter = float(sides.max()), float(sides.min())
    return RestingFace(
        frozen(normal.round(9) + 0.0), frozen(middle), polygon.area, (longer, shorter), tipping
    )


# The convex hull of points in space.


def find_hull(points: FloatArray, tolerance: float) -> IntArray:
    """Triangles (F, 3) of the convex hull of `points` (N, 3), as rows of the points.

    They are counter-clockwise seen from outside. A point may be outside by up to `tolerance`, mm.
    Points that lie in a plane within the tolerance have no hull: (0, 3).
    """
    first = _find_tetrahedron(points, tolerance)
    if first is None:
        return np.zeros((0, 3), dtype=np.int64)
    hull = _Hull(points, tolerance)
    a, b, c, d = first
    hull.add([(a, b, c), (a, c, d), (a, d, b), (b, d, c)], np.arange(len(points)))
    while hull.pending:
        hull.extend(hull.pending.pop())
    return np.array(list(hull.triangles.values()), dtype=np.int64)


class _Hull(Struct, eq=False):
    """A hull while points are added to it.

    triangles: rows of the points, by the number of the triangle.
    planes: unit outward normal and distance of each triangle from the origin.
    outside: rows of the points outside a triangle, each point at one triangle only.
    neighbours: number of the triangle that has a directed side.
    pending: numbers of triangles that may have points outside.
    count: number of triangles that were made.
    """

    points: FloatArray
    tolerance: float
    triangles: dict[int, tuple[int, int, int]] = field(default_factory=dict)
    planes: dict[int, tuple[FloatArray, float]] = field(default_factory=dict)
    outside: dict[int, IntArray] = field(default_factory=dict)
    neighbours: dict[tuple[int, int], int] = field(default_factory=dict)
    pending: list[int] = field(default_factory=list)
    count: int = 0

    def add(self, triangles: list[tuple[int, int, int]], rows: IntArray) -> None:
        """Adds triangles, and gives each the points of `rows` that are farthest outside it."""
        a, b, c = self.points[np.array(triangles)].transpose(1, 0, 2)
        normals = cross(b - a, c - a)
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
        distances = (normals * a).sum(axis=1)
        heights = self.points[rows] @ normals.T - distances
        owner = heights.argmax(axis=1)
        is_outside = heights.max(axis=1) > self.tolerance
        for k, triangle in enumerate(triangles):
            number = self.count
            self.count += 1
            self.triangles[number] = triangle
            self.planes[number] = normals[k], float(distances[k])
            self.outside[number] = rows[is_outside & (owner == k)]
            for side in _sides(triangle):
                self.neighbours[side] = number
            if len(self.outside[number]):
                self.pending.append(number)

    def extend(self, number: int) -> None:
        """Makes the farthest point outside a triangle a corner of the hull."""
        if number not in self.triangles:
            return
        normal, _ = self.planes[number]
        rows = self.outside[number]
        corner = int(rows[(self.points[rows] @ normal).argmax()])
        visible = self._find_visible(number, corner)
        sides = set().union(*(_sides(self.triangles[triangle]) for triangle in visible))
        horizon = sorted(side for side in sides if side[::-1] not in sides)
        rows = np.concatenate([self.outside[triangle] for triangle in visible])
        for triangle in visible:
            for side in _sides(self.triangles.pop(triangle)):
                if self.neighbours.get(side) == triangle:
                    del self.neighbours[side]
            del self.planes[triangle], self.outside[triangle]
        self.add([(a, b, corner) for a, b in horizon], rows[rows != corner])

    def _find_visible(self, number: int, corner: int) -> list[int]:
        """The connected triangles that a point is outside of, or inside by up to the tolerance."""
        point = self.points[corner]
        visible, border = [number], [number]
        seen = {number}
        while border:
            for a, b in _sides(self.triangles[border.pop()]):
                other = self.neighbours.get((b, a))
                if other is None or other in seen:
                    continue
                seen.add(other)
                normal, distance = self.planes[other]
                if float(point @ normal) - distance >= -self.tolerance:
                    visible.append(other)
                    border.append(other)
        return visible


def _sides(triangle: tuple[int, int, int]) -> list[tuple[int, int]]:
    a, b, c = triangle
    return [(a, b), (b, c), (c, a)]


def _find_tetrahedron(points: FloatArray, tolerance: float) -> tuple[int, int, int, int] | None:
    """Rows of four points that span a volume, a, b, c counter-clockwise seen from outside."""
    if len(points) < 4:
        return None
    a = int(points[:, 0].argmin())
    offsets = points - points[a]
    b = int(np.linalg.norm(offsets, axis=1).argmax())
    size = float(np.linalg.norm(offsets[b]))
    if not math.isfinite(size) or size <= tolerance:
        return None
    along = offsets[b] / size
    aside = offsets - np.outer(offsets @ along, along)
    c = int(np.linalg.norm(aside, axis=1).argmax())
    width = float(np.linalg.norm(aside[c]))
    if width <= tolerance:
        return None
    heights = offsets @ np.cross(along, aside[c] / width)
    d = int(np.abs(heights).argmax())
    if abs(heights[d]) <= tolerance:
        return None
    return (a, b, c, d) if heights[d] < 0 else (a, c, b, d)
