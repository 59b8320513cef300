"""The contours of a part, one by one, by the ids that a job chooses them by."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.geometry.segments import compute_bounds, from_contours
from camgen.model.part import Part
from camgen.model.text import short


class ContourFacts(Struct, frozen=True):
    """A contour: its id, layer, whether it is closed, its size and its middle (x, y), mm, of the box around it."""

    id: str
    layer: str
    closed: bool
    size: tuple[float, float]
    middle: tuple[float, float]

    def __str__(self) -> str:
        width, height, x, y = (short(value, 3) for value in (*self.size, *self.middle))
        kind = "closed" if self.closed else "open"
        return f"{self.id}: {kind}, {width} x {height} mm around {x}, {y}, layer {self.layer}"


def list_contours(part: Part) -> list[ContourFacts]:
    """All contours of a part, in its order."""
    segments = from_contours(part.contours)
    box = compute_bounds(segments)
    # Some are one point, without a segment.
    low = np.array([contour.points[0] for contour in part.contours]).reshape(-1, 2)
    high = low.copy()
    np.minimum.at(low, segments.owner, box[:, :2])
    np.maximum.at(high, segments.owner, box[:, 2:])
    sizes, middles = (high - low).tolist(), ((low + high) / 2).tolist()
    return [
        ContourFacts(
            contour.id, contour.layer, contour.closed, (size[0], size[1]), (middle[0], middle[1])
        )
        for contour, size, middle in zip(part.contours, sizes, middles, strict=True)
    ]
