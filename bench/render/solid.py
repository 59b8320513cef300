"""A flat part as a solid, for the scanner: the loops of the drawing and how thick the sheet is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
import trimesh

from bench.render.shapes import Loop, Pieces, flatten

#: mm between points of an arc's chords.
_STEP = 0.5


def sheet(loops: Sequence[Loop], thickness: float) -> trimesh.Trimesh:
    """The part as a watertight mesh, mm: its top face at z = 0, ``thickness`` below it the other one."""
    rings = [_points(loop) for loop in loops]
    flat = shapely.Polygon(rings[0], rings[1:])
    corners = np.concatenate(rings)
    faces = [
        shapely.get_coordinates(one)[:3]
        for one in shapely.constrained_delaunay_triangles(flat).geoms
    ]
    place = {tuple(point): k for k, point in enumerate(corners.tolist())}
    top = np.array([[place[tuple(point)] for point in face] for face in np.array(faces).tolist()])
    a, b, c = (corners[top[:, k]] for k in range(3))
    turned = (b - a)[:, 0] * (c - a)[:, 1] < (b - a)[:, 1] * (c - a)[:, 0]
    top[turned] = top[turned][:, ::-1]
    count, sides, begin = len(corners), [], 0
    for ring in rings:
        here = begin + np.arange(len(ring))
        ahead = begin + (np.arange(len(ring)) + 1) % len(ring)
        sides += [
            np.column_stack([here, here + count, ahead]),
            np.column_stack([ahead, here + count, ahead + count]),
        ]
        begin += len(ring)
    vertices = np.concatenate(
        [np.column_stack([corners, np.full(count, z)]) for z in (0.0, -thickness)]
    )
    mesh = trimesh.Trimesh(
        vertices, np.concatenate([top, top[:, ::-1] + count, *sides]), process=False
    )
    assert mesh.is_watertight
    return mesh


def _points(loop: Loop) -> np.ndarray:
    """(N, 2) mm: lines as they are, arcs as chords."""

    def count(whole: Pieces) -> np.ndarray:
        return np.where(whole.sweep == 0, 1, np.maximum(np.ceil(whole.length / _STEP), 2))

    at = flatten(loop, count)
    return np.column_stack([at.real, at.imag])
