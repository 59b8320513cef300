"""The box around contours and curves, arcs included."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from camgen.geometry.segments import compute_bounds, make_contour_segments
from camgen.model.part import Contour, Curve, tabulate_contours
from camgen.model.pose import FloatArray


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
