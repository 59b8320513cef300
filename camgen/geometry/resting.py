"""The faces on which a part can rest on a table: stable facets of its convex hull."""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct

from camgen.geometry.hull import find_hull
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
    rectangle = polygon.minimum_rotated_rectangle
    ring = np.array(rectangle.exterior.coords)
    sides = np.linalg.norm(np.diff(ring[:3], axis=0), axis=1)
    middle = np.array(polygon.centroid.coords[0]) @ axes + level * normal
    tipping = math.atan2(polygon.exterior.distance(foot), height)
    longer, shorter = float(sides.max()), float(sides.min())
    return RestingFace(
        frozen(normal.round(9) + 0.0), frozen(middle), polygon.area, (longer, shorter), tipping
    )
