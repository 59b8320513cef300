"""Hatching: parallel lines across what the closed contours of a drawing enclose, even-odd."""

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
    """spacing: mm between the lines. angle: deg of them from the work x."""

    spacing: float = 5.0
    angle: float = 45.0


def plan(part, job, _cell, _watch):
    """A path a line; the tour decides on their order and which way they are run."""
    wish = read_options(job, Hatching)
    closed = [contour for contour in part.contours if contour.closed]
    if not closed or wish.spacing <= 0:
        raise InputError(
            part.source, "nothing to hatch", remedy="give closed contours and a spacing above 0"
        )
    points, owner = flatten(make_contour_segments(closed), job.tolerance.chord)
    rings = [shapely.Polygon(points[owner == k]) for k in range(len(closed))]
    area = rotate(reduce(shapely.symmetric_difference, rings), -wish.angle, origin=(0, 0))
    left, low, right, high = area.bounds
    rows = [
        shapely.LineString([(left, y), (right, y)])
        for y in np.arange(low + wish.spacing / 2, high, wish.spacing)
    ]
    lines = [
        line
        for row in shapely.intersection(rows, area)
        for line in shapely.get_parts(row)
        if line.length > 0
    ]
    ways = [shapely.get_coordinates(rotate(line, wish.angle, origin=(0, 0))) for line in lines]
    ids = tuple(contour.id for contour in closed)
    paths = (
        straight_path(f"h{k}", way, job, "hatch", closed[0].layer, ids)
        for k, way in enumerate(ways, 1)
    )
    return Plan(part, tuple(paths), part.notes)


HATCH = Operation("hatch", "parallel lines across closed contours", ("drawing", "picture"), plan)
