"""Lines and arcs of the drawings, and the curves beside them, by formulas of their own.

Nothing here imports camgen: the judge knows a drawing from its vertices alone.
"""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

import numpy as np
import shapely

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

    def list_segments(self) -> list[Segment]:
        """The lines and arcs in order."""
        ends = self.vertices[1:] + (self.vertices[:1] if self.is_closed else ())
        segments = []
        for (x0, y0, bulge), (x1, y1, _) in zip(self.vertices, ends, strict=False):
            segments.append(Segment((x0, y0), (x1, y1), bulge))
        return segments

    def flatten(self) -> Array:
        """Points along the contour, (N, 2) mm; a closed one ends where it begins."""
        return np.concatenate([segment.sample(_QUARTER) for segment in self.list_segments()])

    @property
    def length(self) -> float:
        """The length in mm."""
        return sum(segment.length for segment in self.list_segments())


class Segment(NamedTuple):
    """A line or an arc between two points, mm.

    bulge: tangent of a quarter of its angle, positive counter-clockwise, 0 for a line.
    """

    start: tuple[float, float]
    end: tuple[float, float]
    bulge: float

    @property
    def angle(self) -> float:
        """The angle of an arc, rad, positive counter-clockwise."""
        return 4.0 * math.atan(self.bulge)

    @property
    def chord(self) -> float:
        """The distance of the ends, mm."""
        return math.dist(self.start, self.end)

    @property
    def radius(self) -> float:
        """The radius of an arc, mm; infinite for a line."""
        if self.bulge == 0.0:
            return math.inf
        return self.chord / (2.0 * abs(math.sin(self.angle / 2.0)))

    @property
    def length(self) -> float:
        """The length in mm."""
        return self.chord if self.bulge == 0.0 else self.radius * abs(self.angle)

    @property
    def centre(self) -> Array:
        """The centre of an arc, mm: on the bisector of its chord, to the left if it turns left."""
        start, end = np.array(self.start), np.array(self.end)
        along = (end - start) / self.chord
        left = np.array([-along[1], along[0]])
        height = self.chord / (2.0 * math.tan(self.angle / 2.0))
        return (start + end) / 2.0 + height * left

    def sample(self, per_quarter: int) -> Array:
        """Points from start to end, (N, 2) mm."""
        if self.bulge == 0.0:
            return np.array([self.start, self.end])
        count = max(2, math.ceil(abs(self.angle) / (math.pi / 2.0) * per_quarter))
        spokes = np.array(self.start) - self.centre
        angles = np.linspace(0.0, self.angle, count + 1)
        cos, sin = np.cos(angles), np.sin(angles)
        x = cos * spokes[0] - sin * spokes[1]
        y = sin * spokes[0] + cos * spokes[1]
        return self.centre + np.column_stack([x, y])

    def find_feet(self, points: Array) -> tuple[Array, Array]:
        """The distance of points (N, 2) from the segment, and whether its inside is nearest.

        The inside is nearest if the foot of the perpendicular lies between the ends.
        """
        if self.bulge == 0.0:
            along = np.subtract(self.end, self.start) / self.chord
            offsets = points - self.start
            positions = offsets @ along
            heights = np.abs(offsets @ [-along[1], along[0]])
            return heights, (positions > 0.0) & (positions < self.chord)
        spokes = points - self.centre
        first = math.atan2(*(np.array(self.start) - self.centre)[::-1])
        turns = (np.arctan2(spokes[:, 1], spokes[:, 0]) - first) * math.copysign(1.0, self.bulge)
        inside = (turns % math.tau) < abs(self.angle)
        return np.abs(np.hypot(*spokes.T) - self.radius), inside


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
