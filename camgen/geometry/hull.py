"""The convex hull of points in space (Barber, Dobkin, Huhdanpaa: The quickhull algorithm, 1996)."""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct, field

from camgen.geometry.vectors import cross
from camgen.model.part import IntArray
from camgen.model.pose import FloatArray


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
    normal = np.cross(along, aside[c] / width)
    heights = offsets @ normal
    d = int(np.abs(heights).argmax())
    if abs(heights[d]) <= tolerance:
        return None
    return (a, b, c, d) if heights[d] < 0 else (a, c, b, d)
