"""The meshes of an arm's links for the page: one a link, with no more triangles than a page can carry."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from camgen.model.pose import FloatArray
from camgen.preview.track import IntArray
from camgen.robots.models import Surface

#: Triangles of a link at most; cells across a link, tried from the finest.
MOST_FACES, _CELLS = 6000, (200, 120, 80, 50, 30, 20)


def one_mesh(surfaces: Sequence[Surface]) -> tuple[FloatArray, IntArray] | None:
    """Vertices (V, 3) in the link's frame, mm, and faces (F, 3) of all ``surfaces``, coarser where they have too many.

    None where there are none. What lies in one cell of a grid becomes one vertex, at their mean: J. Rossignac and
    P. Borrel, Multi-resolution 3D approximations for rendering complex scenes, 1993.
    """
    if not surfaces:
        return None
    first = np.cumsum([0, *(len(one.vertices) for one in surfaces[:-1])])
    vertices = np.concatenate([one.vertices for one in surfaces])
    faces = np.concatenate([one.faces + k for one, k in zip(surfaces, first.tolist(), strict=True)])
    low, size = vertices.min(axis=0), float(np.ptp(vertices, axis=0).max())
    found = vertices, faces
    for cells in _CELLS:
        if len(found[1]) <= MOST_FACES:
            break
        found = _cluster(
            vertices, faces, np.floor((vertices - low) / max(size / cells, 1e-6)).astype(np.int64)
        )
    return found


def _cluster(vertices: FloatArray, faces: IntArray, cell: IntArray) -> tuple[FloatArray, IntArray]:
    """The mesh with one vertex for each cell (V, 3); triangles that lie in two cells are gone, and doubled ones."""
    _, group, count = np.unique(cell, axis=0, return_inverse=True, return_counts=True)
    group = group.ravel()
    mean = np.column_stack([np.bincount(group, column) / count for column in vertices.T])
    faces = group[faces]
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    _, kept = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    return mean, faces[np.sort(kept)]
