"""The kind of each deviation of a photo from the drawing: only burrs are worked again.

A silhouette decides: a chip that lies along an edge and touches it has the shape of a burr.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
import shapely
from msgspec.structs import replace

from camgen.check.photo.differences import Difference
from camgen.check.photo.expected import Expected
from camgen.model.pose import FloatArray

Kind = Literal[
    "burr",
    "dent",
    "loose",
    "feature missing",
    "feature extra",
    "dimension",
    "unclear",
    "ink extra",
    "ink missing",
]

#: Kinds with the reason why they are not worked again. A burr has none.
WHY_NOT: dict[str, str] = {
    "dent": "material is missing, and no tool puts it back",
    "loose": "it lies apart from the part: take it away and take another photo",
    "feature missing": (
        "a hole or an island of the drawing is not there: run its operation, or empty the hole"
    ),
    "feature extra": "a hole that is not drawn",
    "dimension": (
        "the contour is off along much of its length: check job, tool and scale of the photo"
    ),
    "unclear": "too high, or too narrow at its foot, for a burr: look at the part",
    "ink extra": "ink is not taken off",
    "ink missing": "run the drawing again, or a part of it",
}

#: The reason for a burr of a part with a wrong dimension: the photo is not laid on it surely, and
#: the part may lie upside down.
WHY_NOT_OFF = "a burr of a part of which a contour is off: see to that first"

# Limits of the definitions. docs/inspection.md has the same table.

#: Greatest height of a burr, mm. Cutting leaves up to 2 mm; a tab or an uncut corner is higher.
BURR_HEIGHT = 3.0
#: Greatest height of a burr, in lengths of its foot. A ridge is lower; a chip that touches is not.
BURR_HEIGHT_PER_FOOT = 1.5
#: Least foot of a burr, as a share of its length along the contour. A burr stands on its foot; a
#: screw that leans on the side of a hole touches it with a small part.
BURR_FOOT_SHARE = 0.5
#: Longest foot of a burr, as a share of the contour: the side of a square. A longer piece is off
#: by the path, the tool or the scale, which the rework would repeat.
BURR_CONTOUR_SHARE = 0.25
#: A contour that is off with one sign along this share has a wrong dimension. Burrs may cover
#: less than that, since the fit of the photo follows the greater part of the outline.
DIMENSION_SHARE = 0.5
#: A hole is missing if this share of it is covered. A screw leaves more open, a burr much more.
COVERED_SHARE = 0.8
#: Contours are sampled at this distance, mm: five samples on the shortest burr of the bench.
_SAMPLE = 0.4
#: Polygons nearer than this touch, mm.
_TOUCH = 1e-6


def classify(
    differences: tuple[Difference, ...], expected: Expected, seen: shapely.Geometry, foot: float
) -> tuple[Difference, ...]:
    """The differences with their kinds.

    foot: the noise of an outline stays below this, mm.
    """
    if expected.inked:
        kinds: list[Kind] = ["ink extra" if each.surplus else "ink missing" for each in differences]
    else:
        outlines = _Outlines(expected, seen, foot)
        kinds = [outlines.kind(each) for each in differences]
    return tuple(replace(each, kind=kind) for each, kind in zip(differences, kinds, strict=True))


class _Outlines:
    """The contours of the drawing beside the outline of the photo."""

    def __init__(self, expected: Expected, seen: shapely.Geometry, foot: float) -> None:
        self.foot = foot
        self.region = expected.region
        self.edge = shapely.boundary(expected.region)
        self.lines = {
            name: shapely.LineString(np.concatenate([ring, ring[:1]]))
            for name, ring in zip(expected.names, expected.rings, strict=True)
        }
        parts = shapely.get_parts(expected.region)
        rings = shapely.get_rings(parts)
        outer = shapely.get_exterior_ring(parts)
        self.holes = [
            shapely.Polygon(ring) for ring in rings if not shapely.equals(ring, outer).any()
        ]
        self.deviations = {
            name: _measure_deviations(line, seen, foot) for name, line in self.lines.items()
        }

    def kind(self, difference: Difference) -> Kind:
        """The first definition that holds."""
        shape, surplus = difference.shape, difference.surplus
        if difference.whole and surplus:
            return "loose"
        if not surplus and shapely.distance(shape, self.edge) > _TOUCH:
            return "feature extra"
        if difference.whole:
            return "feature missing"
        if surplus and any(
            shapely.intersection(shape, hole).area >= COVERED_SHARE * hole.area
            for hole in self.holes
        ):
            return "feature missing"
        line = self.lines[difference.contour]
        foot = shapely.intersection(line, shapely.buffer(shape, self.foot)).length
        if self.deviations[difference.contour][not surplus] >= DIMENSION_SHARE:
            return "dimension"
        if not _is_low(difference, foot):
            return "unclear"
        if foot > BURR_CONTOUR_SHARE * line.length:
            return "dimension"
        return "burr" if surplus else "dent"


def _is_low(difference: Difference, foot: float) -> bool:
    return (
        difference.height <= BURR_HEIGHT
        and difference.height <= BURR_HEIGHT_PER_FOOT * foot
        and foot >= BURR_FOOT_SHARE * difference.length
    )


def _measure_deviations(
    line: shapely.Geometry, seen: shapely.Geometry, foot: float
) -> tuple[float, float]:
    """Measure the fractions of a contour with a surplus, and with a lack, of `foot` mm."""
    points = sample(line)
    far = points[shapely.distance(points, shapely.boundary(seen)) >= foot]
    # There is material on both sides of the line, or on neither: with a surplus the line is inside.
    inside = shapely.intersects(seen, far)
    count = len(points)
    return float(inside.sum() / count), float((~inside).sum() / count)


def sample(line: shapely.Geometry) -> np.ndarray[tuple[int], np.dtype[np.object_]]:
    """Points along lines, as shapely has them."""
    places: list[FloatArray] = []
    for part in shapely.get_parts(line):
        count = max(int(np.ceil(part.length / _SAMPLE)), 8)
        steps = (np.arange(count) + 0.5) / count
        places.append(
            shapely.get_coordinates(shapely.line_interpolate_point(part, steps, normalized=True))
        )
    return np.asarray(shapely.points(np.concatenate(places)))


def remove_loose(seen: shapely.Geometry, differences: Sequence[Difference]) -> shapely.Geometry:
    """The part in the photo without the loose things beside it."""
    loose = [each.shape for each in differences if each.kind == "loose"]
    return shapely.difference(seen, shapely.union_all(loose)) if loose else seen


def share_of_fit(
    differences: tuple[Difference, ...],
    expected: Expected,
    seen: shapely.Geometry,
    near: float,
) -> float:
    """The share of both outlines within ``near`` mm of the other one, the less of the two.

    Loose things do not count, and along burrs and dents the outlines fit.
    """
    known = [each.shape for each in differences if each.kind in ("burr", "dent")]
    explained = shapely.buffer(shapely.union_all(known), near)
    edges = shapely.boundary(expected.region), shapely.boundary(remove_loose(seen, differences))
    shares = []
    for edge, other in (edges, edges[::-1]):
        points = sample(edge)
        fits = shapely.distance(points, other) <= near
        fits |= shapely.intersects(points, explained)
        shares.append(float(fits.mean()))
    return min(shares)
