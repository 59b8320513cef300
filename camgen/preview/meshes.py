"""Meshes of the links of an arm for the page: one per link, with a limited number of triangles."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from camgen.geometry.ragged import compute_first_rows, count_rows
from camgen.model.pose import FloatArray
from camgen.preview.track import IntArray
from camgen.robots.models import Surface

#: Maximum number of triangles of a link; cells across a link, tried from the finest.
MOST_FACES, _CELLS = 6000, (200, 120, 80, 50, 30, 20)


def merge_surfaces(surfaces: Sequence[Surface]) -> tuple[FloatArray, IntArray] | None:
    """Join the surfaces of a link, simplified if they have too many triangles.

    All vertices in one cell of a grid become one vertex at their mean (J. Rossignac and P. Borrel,
    Multi-resolution 3D approximations for rendering complex scenes, 1993).

    Returns vertices (V, 3) in the frame of the link, mm, and faces (F, 3); None without surfaces.
    """
    if not surfaces:
        return None
    parts = [surface.vertices for surface in surfaces]
    vertices = np.concatenate(parts)
    first = compute_first_rows(count_rows(parts)).tolist()
    faces = np.concatenate([surface.faces + k for surface, k in zip(surfaces, first, strict=True)])
    low, size = vertices.min(axis=0), float(np.ptp(vertices, axis=0).max())
    mesh = vertices, faces
    for cells in _CELLS:
        if len(mesh[1]) <= MOST_FACES:
            break
        cell = np.floor((vertices - low) / max(size / cells, 1e-6)).astype(np.int64)
        mesh = _cluster(vertices, faces, cell)
    return mesh


def _cluster(vertices: FloatArray, faces: IntArray, cell: IntArray) -> tuple[FloatArray, IntArray]:
    """The mesh with one vertex per cell; cell: (V, 3) cell of each vertex.

    Triangles with two corners in one cell are removed, and all but the first of equal triangles.
    """
    _, group, count = np.unique(cell, axis=0, return_inverse=True, return_counts=True)
    group = group.ravel()
    mean = np.column_stack([np.bincount(group, column) / count for column in vertices.T])
    faces = group[faces]
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    _, kept = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    return mean, faces[np.sort(kept)]
