"""The box around contours and curves, arcs included, and the size of each contour."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from camgen.geometry.segments import compute_bounds, make_contour_segments
from camgen.model.part import Contour, Curve, Part, tabulate_contours
from camgen.model.pose import FloatArray
from camgen.read.units import format_size


def measure_box(
    contours: Sequence[Contour], curves: Sequence[Curve] = ()
) -> tuple[FloatArray, FloatArray]:
    """Lower left and upper right corner (2,) of contours and curves from above, mm.

    Arcs of contours count where they bulge beyond their ends, arcs of curves by their middles.
    Circles that stand for points do not count beside others. Raises ValueError without contours and
    curves.
    """
    boxes: list[FloatArray] = []
    if any(contour.is_mark for contour in contours):
        contours = [contour for contour in contours if not contour.is_mark] or contours
    if contours:
        points = tabulate_contours(contours).points
        boxes += [
            compute_bounds(make_contour_segments(contours)),
            np.column_stack([points, points]),
        ]
    for curve in curves:
        points = np.concatenate([curve.points, curve.middles])[:, :2]
        boxes.append(np.column_stack([points, points]))
    table = np.concatenate(boxes)
    return table[:, :2].min(axis=0), table[:, 2:].max(axis=0)


class ContourFacts(Struct, frozen=True):
    """A contour of a part, for a list with the ids by which a job chooses contours.

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
