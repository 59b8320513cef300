"""Contours that cross larger ones, such as recesses at the edge of a part, and mills for them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import compress

import numpy as np
import shapely

from camgen.geometry.nesting import find_nesting, measure_loop_areas
from camgen.geometry.segments import flatten, make_contour_segments
from camgen.model.part import Contour, keep_ids, list_ids
from camgen.model.sequences import take_rows

#: A mill clears enough of pockets if it reaches this share of their area.
_ENOUGH_SHARE = 0.95
#: A recess has at most this share of the area of each contour that is cut around it.
_LARGEST_SHARE = 0.25
#: Chords of contours leave them by this, mm.
_CHORD_MM = 0.01
#: Up to this number of contours that cross others are sorted out. More are faults of a drawing.
_MOST = 100


def find_across(closed: Sequence[Contour]) -> tuple[Contour, ...]:
    """The closed contours that cross much larger ones and none of each other, in their order.

    Without them no other contour crosses another. Empty if that is not so.
    """
    crossing = _list_crossing(closed)
    if not 1 < len(crossing) <= _MOST:
        return ()
    areas = np.abs(measure_loop_areas(make_contour_segments(crossing), len(crossing)))
    kept: list[int] = []
    across: list[int] = []
    for k in np.argsort(-areas, kind="stable").tolist():
        crosses = bool(_list_crossing(take_rows(crossing, [*kept, k])))
        (across if crosses else kept).append(k)
    smaller = take_rows(crossing, across)
    if (
        not kept
        or _list_crossing(smaller)
        or areas[across].max() > _LARGEST_SHARE * areas[kept].min()
    ):
        return ()
    return keep_ids(closed, list_ids(smaller))


def _list_crossing(closed: Sequence[Contour]) -> list[Contour]:
    nesting = find_nesting(make_contour_segments(closed), len(closed))
    return list(compress(closed, nesting.crossed >= 0))


def choose_pocket_mill(contours: Sequence[Contour], diameters: Sequence[float]) -> float:
    """The largest mill that reaches enough of the area of all contours, else the one that reaches
    most, mm.
    """
    points, owner = flatten(make_contour_segments(contours), _CHORD_MM)
    areas = shapely.make_valid(shapely.polygons(shapely.linearrings(points, indices=owner)))
    chosen, largest_share = min(diameters), -1.0
    for diameter in sorted(diameters, reverse=True):
        centres = shapely.buffer(areas, -diameter / 2)
        reached = shapely.area(shapely.buffer(centres, diameter / 2))
        share = float((reached / shapely.area(areas)).min())
        if share > largest_share:
            chosen, largest_share = diameter, share
        if share >= _ENOUGH_SHARE:
            break
    return chosen
