"""A flat part as a solid, for the scanner."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
import trimesh

from bench.render.shapes import Loop, flatten_arcs

#: mm between points of an arc's chords.
_STEP = 0.5


def sheet(loops: Sequence[Loop], thickness: float) -> trimesh.Trimesh:
    """The part as a watertight mesh, mm: a face at z = 0, the other one ``thickness`` below it."""
    rings = [flatten_arcs(loop, _STEP, 2) for loop in loops]
    corners, top = np.concatenate(rings), triangulate(rings)
    count, sides, first = len(corners), [], 0
    for ring in rings:
        start = first + np.arange(len(ring))
        end = np.roll(start, -1)
        sides.append(np.column_stack([start, start + count, end]))
        sides.append(np.column_stack([end, start + count, end + count]))
        first += len(ring)
    heights = np.repeat([0.0, -thickness], count)
    vertices = np.column_stack([np.tile(corners, (2, 1)), heights])
    faces = np.concatenate([top, top[:, ::-1] + count, *sides])
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    assert mesh.is_watertight
    return mesh


def triangulate(rings: Sequence[np.ndarray]) -> np.ndarray:
    """Triangles (T, 3) of an outline and its holes, (N, 2) each, by the numbers of all points.

    They turn left.
    """
    corners = np.concatenate(rings)
    index = {tuple(point): k for k, point in enumerate(corners.tolist())}
    faces = []
    for triangle in shapely.constrained_delaunay_triangles(
        shapely.Polygon(rings[0], rings[1:])
    ).geoms:
        faces.append([index[point] for point in triangle.exterior.coords[:3]])
    triangles = np.array(faces)
    a, b, c = (corners[triangles[:, k]] for k in range(3))
    turned = (b - a)[:, 0] * (c - a)[:, 1] < (b - a)[:, 1] * (c - a)[:, 0]
    triangles[turned] = triangles[turned][:, ::-1]
    return triangles
