"""Lines and arcs of the drawings, and the curves beside them, by formulas of their own.

Nothing here imports camgen: the judge knows a drawing from its vertices alone.
"""

from __future__ import annotations

import cmath
import math
from functools import cache
from typing import NamedTuple

import numpy as np
import shapely

from bench.render.shapes import Loop, Pieces, pieces

#: Segments of a quarter circle in a flattened curve: they leave a radius of 10 mm by 8e-4 mm.
_QUARTER = 64
Array = np.ndarray


class Shape(NamedTuple):
    """A contour of a drawing.

    name: the name by which verdicts call it.
    vertices: x, y (mm) and bulge of the segment that begins there: the tangent of a quarter of its
        angle, positive counter-clockwise, 0 for a line.
    is_closed: whether the last vertex is joined to the first.
    is_hole: whether another contour encloses it.
    """

    name: str
    vertices: tuple[tuple[float, float, float], ...]
    is_closed: bool = True
    is_hole: bool = False

    @property
    def pieces(self) -> Pieces:
        """The lines and arcs in order."""
        x, y, bulges = np.array(self.vertices).T
        whole = pieces([Loop(x + 1j * y, bulges)])
        last = len(x) if self.is_closed else len(x) - 1
        return Pieces(whole.start[:last], whole.chord[:last], whole.sweep[:last])

    def flatten(self) -> Array:
        """Points along the contour, (N, 2) mm; a closed one ends where it begins."""
        whole = self.pieces
        fine = np.ceil(np.abs(whole.sweep) / (math.pi / 2.0) * _QUARTER)
        counts = np.where(whole.sweep == 0.0, 1, np.maximum(fine, 2)).astype(int)
        points = np.append(whole.walk(counts), whole.start[-1] + whole.chord[-1])
        return np.column_stack([points.real, points.imag])

    @property
    def length(self) -> float:
        """The length in mm."""
        return float(self.pieces.length.sum())

    def find_contact(self, place: Array, distance: float, tolerance: float) -> float | None:
        """The radius (mm) of the piece whose foot is at a distance from a place, inf for a line.

        None if the foot is a corner, or at another distance.
        """
        whole, point = self.pieces, complex(*place)
        for start, chord, sweep in zip(whole.start, whole.chord, whole.sweep, strict=True):
            if sweep == 0.0:
                foot, radius = (point - start) / chord, math.inf
                is_inside, clearance = 0.0 < foot.real < 1.0, abs(foot.imag * chord)
            else:
                arm = chord / (cmath.exp(1j * sweep) - 1.0)
                centre, radius = start - arm, abs(arm)
                middle = arm * cmath.exp(0.5j * sweep)
                is_inside = abs(cmath.phase((point - centre) / middle)) < abs(sweep) / 2.0
                clearance = abs(abs(point - centre) - radius)
            if is_inside and abs(clearance - distance) < tolerance:
                return radius
        return None


def circle(name: str, x: float, y: float, radius: float) -> Shape:
    """A round hole, mm."""
    return Shape(name, ((x - radius, y, 1.0), (x + radius, y, 1.0)), is_hole=True)


@cache
def make_region(shapes: tuple[Shape, ...]) -> shapely.Geometry:
    """The material of a part: what the outlines enclose without the holes."""
    outlines = [shapely.Polygon(shape.flatten()) for shape in shapes if not shape.is_hole]
    holes = [shapely.Polygon(shape.flatten()) for shape in shapes if shape.is_hole]
    return shapely.difference(shapely.union_all(outlines), shapely.union_all(holes))


@cache
def offset_ring(shape: Shape, distance: float) -> shapely.LinearRing:
    """The curve at a distance from a closed contour, outside an outline and inside a hole.

    It runs counter-clockwise.
    """
    signed = -distance if shape.is_hole else distance
    polygon = shapely.buffer(shapely.Polygon(shape.flatten()), signed, quad_segs=_QUARTER)
    ring = polygon.exterior
    return ring if ring.is_ccw else shapely.reverse(ring)
