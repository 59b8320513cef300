"""Lists the contours of a part with their ids, by which a job chooses them."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.geometry.segments import compute_bounds, make_contour_segments
from camgen.model.part import Part
from camgen.read.units import format_size


class ContourFacts(Struct, frozen=True):
    """A contour of a part.

    id: its id.
    layer: name of its layer.
    closed: whether it is closed.
    size: width and height of the box around it, mm.
    middle: x and y of the centre of the box, mm.
    """

    id: str
    layer: str
    closed: bool
    size: tuple[float, float]
    middle: tuple[float, float]

    def __str__(self) -> str:
        kind = "closed" if self.closed else "open"
        place = f"{format_size(self.size)} mm around {format_size(self.middle, separator=', ')}"
        return f"{self.id}: {kind}, {place}, layer {self.layer}"


def list_contours(part: Part) -> list[ContourFacts]:
    """All contours of a part, in its order."""
    segments = make_contour_segments(part.contours)
    box = compute_bounds(segments)
    # A contour of one point has no segment.
    lower = np.array([contour.points[0] for contour in part.contours]).reshape(-1, 2)
    upper = lower.copy()
    np.minimum.at(lower, segments.owner, box[:, :2])
    np.maximum.at(upper, segments.owner, box[:, 2:])
    sizes, middles = (upper - lower).tolist(), ((lower + upper) / 2).tolist()
    return [
        ContourFacts(contour.id, contour.layer, contour.closed, tuple(size), tuple(middle))
        for contour, size, middle in zip(part.contours, sizes, middles, strict=True)
    ]
