"""The model as the search sees it: triangles with normals in a tree, and points spread evenly over them."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.collision.tree import Tree, grown
from camgen.pose import FloatArray
from camgen.solid import IntArray

#: Steps of the R2 sequence (Roberts, The unreasonable effectiveness of quasirandom sequences, 2018).
_R2 = (0.7548776662466927, 0.5698402909980532)


class Model(Struct, frozen=True, eq=False):
    """A part's surface in its own frame, mm.

    tree: its triangles. normals: (F, 3) unit, outward, in the tree's order. samples, sample_normals: (S, 3), spread
    evenly. low, high: (3,), corners of the box around it. size: its diagonal.
    """

    tree: Tree
    normals: FloatArray
    samples: FloatArray
    sample_normals: FloatArray
    low: FloatArray
    high: FloatArray

    @property
    def area(self) -> float:
        """Of the surface, mm2."""
        a, b, c = (self.tree.corners[:, k] for k in range(3))
        return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)

    @property
    def volume(self) -> float:
        """mm3, as far as the surface is closed."""
        a, b, c = (self.tree.corners[:, k] - self.low for k in range(3))
        return float(abs((a * np.cross(b, c)).sum()) / 6)

    @property
    def size(self) -> float:
        """Diagonal of the box around it, mm."""
        return float(np.linalg.norm(self.high - self.low))


def modelled(vertices: FloatArray, faces: IntArray, count: int = 20_000) -> Model:
    """The model with ``count`` samples of the triangles ``faces`` (F, 3) of ``vertices`` (V, 3); faces have an area."""
    corners = vertices[faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    tree = grown(corners[(cross != 0).any(axis=1)])
    cross = np.cross(tree.corners[:, 1] - tree.corners[:, 0], tree.corners[:, 2] - tree.corners[:, 0])
    normals = cross / np.linalg.norm(cross, axis=1, keepdims=True)
    samples, of = spread(tree.corners, count)
    ends = tree.corners.reshape(-1, 3)
    return Model(tree, normals, samples, normals[of], ends.min(axis=0), ends.max(axis=0))


def spread(corners: FloatArray, count: int) -> tuple[FloatArray, IntArray]:
    """``count`` points (count, 3) evenly over triangles (F, 3, 3), and the triangle of each. The same every time."""
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    ends = np.cumsum(areas)
    of = np.searchsorted(ends, (np.arange(count) + 0.5) / count * ends[-1]).clip(max=len(corners) - 1)
    u, v = (np.arange(1, count + 1) * step % 1.0 for step in _R2)
    beyond = u + v > 1
    u, v = np.where(beyond, 1 - u, u), np.where(beyond, 1 - v, v)
    a, b, c = (corners[of, k] for k in range(3))
    return a + (b - a) * u[:, None] + (c - a) * v[:, None], of
