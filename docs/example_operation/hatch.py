"""Hatching: parallel lines across the area of closed contours, by the even-odd rule."""

from functools import reduce

import numpy as np
import shapely
from msgspec import Struct
from shapely.affinity import rotate

from camgen.geometry.segments import flatten, make_contour_segments
from camgen.model.errors import InputError
from camgen.plan import Operation, Plan, read_options
from camgen.plan.columns import straight_path


class Hatching(Struct, forbid_unknown_fields=True):
    """The options of a hatch.

    spacing: distance of the lines, mm.
    angle: direction from the work x, deg.
    """

    spacing: float = 5.0
    angle: float = 45.0


def plan(part, job, _cell, _watch):
    """One path per line. The tour decides on their order and direction."""
    options = read_options(job, Hatching)
    closed = [contour for contour in part.contours if contour.closed]
    if not closed or options.spacing <= 0:
        raise InputError(
            part.source, "nothing to hatch", remedy="give closed contours and a spacing above 0"
        )
    points, owner = flatten(make_contour_segments(closed), job.tolerance.chord)
    rings = [shapely.Polygon(points[owner == k]) for k in range(len(closed))]
    area = rotate(reduce(shapely.symmetric_difference, rings), -options.angle, origin=(0, 0))
    left, low, right, high = area.bounds
    rows = [
        shapely.LineString([(left, y), (right, y)])
        for y in np.arange(low + options.spacing / 2, high, options.spacing)
    ]
    parts = shapely.get_parts(shapely.intersection(rows, area))
    lines = [rotate(part, options.angle, origin=(0, 0)) for part in parts if part.length > 0]
    ids = tuple(contour.id for contour in closed)
    paths = (
        straight_path(f"h{k}", points, job, "hatch", closed[0].layer, ids)
        for k, points in enumerate(map(shapely.get_coordinates, lines), 1)
    )
    return Plan(part, tuple(paths), part.notes)


HATCH = Operation("hatch", "parallel lines across closed contours", ("drawing", "picture"), plan)
