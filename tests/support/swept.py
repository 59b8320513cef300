"""The area that a tool sweeps along its paths, and the area that a disc can reach, both by GEOS."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain

import numpy as np
import shapely

from camgen.model.part import Contour
from camgen.model.path import ToolPath

#: Deviation of chords from their arcs, mm, and number of chords of a quarter of a disc.
CHORD, QUARTER = 0.001, 48
#: Number of points of a line that are swept together.
_PIECE = 200


def enclosed(contours: Sequence[Contour]) -> shapely.Geometry:
    """The area that closed contours enclose, by the even-odd rule."""
    region = shapely.Polygon()
    for contour in contours:
        if contour.closed:
            region = region.symmetric_difference(outline(contour))
    return region


def outline(contour: Contour) -> shapely.Polygon:
    """A closed contour as a polygon."""
    ends = np.vstack([contour.points, contour.points[:1]])
    spans = zip(ends[:-1], ends[1:], contour.bulges, strict=True)
    points: list[np.ndarray] = []
    for start, end, bulge in spans:
        points += _bulged(start, end, float(bulge))
    # Two points, of a nearly flat arc and its chord, enclose no area.
    return shapely.Polygon(np.array(points)) if len(points) > 2 else shapely.Polygon()


def _bulged(a: np.ndarray, b: np.ndarray, bulge: float) -> list[np.ndarray]:
    if not bulge:
        return [a]
    chord = b - a
    middle = (a + b) / 2 - bulge / 2 * np.array([-chord[1], chord[0]])
    return _on_arc(a, middle, b)[:-1]


def _on_arc(a: np.ndarray, middle: np.ndarray, b: np.ndarray) -> list[np.ndarray]:
    """Points on the arc from `a` over `middle` to `b`, including both ends."""
    matrix = 2 * np.array([middle - a, b - a])
    centre = np.linalg.solve(matrix, [middle @ middle - a @ a, b @ b - a @ a])
    radius = float(np.hypot(*(a - centre)))
    begin, half = (np.arctan2(*(p - centre)[::-1]) for p in (a, middle))
    sweep = 2 * ((half - begin + np.pi) % (2 * np.pi) - np.pi)
    count = int(np.ceil(abs(sweep) / (2 * np.arccos(1 - min(CHORD / radius, 1.0))))) + 1
    angles = begin + sweep * np.linspace(0, 1, count + 1)
    return [a, *(centre + radius * np.column_stack([np.cos(angles), np.sin(angles)])[1:-1]), b]


def centre_line(path: ToolPath) -> shapely.LineString:
    """The line of the tool centre in the plane."""
    position, via = path.position[:, :2], path.via[:, :2]
    points = [position[0]]
    for k in range(1, len(position)):
        straight = np.isnan(via[k, 0])
        points += [position[k]] if straight else _on_arc(position[k - 1], via[k], position[k])[1:]
    return shapely.LineString(np.array(points))


def swept(paths: Sequence[ToolPath], radius: float) -> shapely.Geometry:
    """The area that a disc of `radius` mm covers along paths."""
    # The paths are split into pieces: GEOS fills holes of a long line that overlaps itself often.
    pieces = chain.from_iterable(map(_pieces, paths))
    return shapely.union_all([piece.buffer(radius, quad_segs=QUARTER) for piece in pieces])


def _pieces(path: ToolPath) -> list[shapely.LineString]:
    points = shapely.get_coordinates(centre_line(path))
    return [
        shapely.LineString(points[k : k + _PIECE + 1]) for k in range(0, len(points) - 1, _PIECE)
    ]


def reachable(region: shapely.Geometry, radius: float) -> shapely.Geometry:
    """The part of a region that a disc of `radius` mm covers 0.001 mm or more within the region."""
    return region.buffer(-(radius + 0.001), quad_segs=QUARTER).buffer(radius, quad_segs=QUARTER)
