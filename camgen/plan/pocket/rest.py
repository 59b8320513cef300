"""The areas of pockets that earlier operations leave, for a smaller tool that clears only these.

Rest material of the earlier tools that this tool reaches is enlarged by the tool diameter, within
its pocket. The enlarged area contains each position of the tool that touches such material. So the
tool clears as much of it as it would by clearing the whole pocket.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely

from camgen.geometry.segments import find_following, make_contour_segments
from camgen.model.errors import JobError
from camgen.model.job import Job
from camgen.model.part import Contour, Part
from camgen.plan.pocket.regions import QUARTER_CHORDS, PocketWalls, make_pocket_polygon
from camgen.plan.recover import recover_arcs
from camgen.plan.rest import find_rest

#: mm: tolerance with which arcs are recovered from the chords of walls.
_ARC_MM = 0.004
#: mm: channels narrower than the tool by up to twice this count as wide as the tool.
_CHANNEL_MM = 0.005
#: mm: strips of material up to this width are deviations of chords.
_NARROW_MM = 0.01
#: The area is enlarged by the diameter and this fraction of the radius.
_EXTRA_FRACTION = 0.05


def find_rest_of_pockets(
    pocket_walls: PocketWalls, part: Part, job: Job
) -> tuple[PocketWalls, list[int], Any]:
    """The areas that earlier operations leave of pockets.

    pocket_walls: walls of the pockets.
    part: part with its earlier operations.

    Returns the walls of these areas in the order of their pockets, the pocket (A,) of each area,
    and polygons of the pockets that earlier operations clear.

    Raises JobError if no operation with a larger tool comes before.
    """
    radius = job.tool.radius
    if part.earlier and max(run.radius for run in part.earlier) <= radius:
        raise JobError(
            "job",
            "no operation before it has a larger tool",
            "operation.rest",
            "list it after the operations of larger tools",
        )
    regions = [make_pocket_polygon(pocket_walls, k) for k in range(pocket_walls.pocket_count)]
    whole = shapely.union_all(regions)
    rest = find_rest(whole, part, job)
    loops: list[Contour] = []
    pocket: list[int] = []
    group: list[int] = []
    for number, region in enumerate(regions):
        for area in shapely.get_parts(_grow(region, rest, radius)):
            # Walls run clockwise, islands counter-clockwise: the material is on their left.
            rings = shapely.get_rings(shapely.orient_polygons(area, exterior_cw=True))
            loops += [_make_loop(ring) for ring in rings]
            group += [len(pocket)] * len(rings)
            pocket.append(number)
    walls = make_contour_segments(recover_arcs(loops, _ARC_MM)[0])
    following = find_following(walls, np.ones(len(loops), np.bool_))
    rest_walls = PocketWalls(walls, following, np.array(group, np.int64)[walls.owner], len(pocket))
    return rest_walls, pocket, shapely.difference(whole, rest)


def _grow(region: Any, rest: Any, radius: float) -> Any:
    """The area of a pocket around rest material that a tool has to clear, as polygons.

    region: polygon of the pocket.
    rest: polygons of rest material.
    radius: tool radius, mm.

    Returns an empty multipolygon if the tool reaches no rest material.
    """
    centres = shapely.buffer(region, _CHANNEL_MM - radius, quad_segs=QUARTER_CHORDS)
    reached = shapely.buffer(centres, radius, quad_segs=QUARTER_CHORDS)
    left = shapely.get_parts(shapely.intersection(reached, rest))
    left = left[~shapely.is_empty(shapely.buffer(left, -_NARROW_MM / 2, quad_segs=2))]
    grown = shapely.buffer(
        shapely.union_all(left), (2 + _EXTRA_FRACTION) * radius, quad_segs=QUARTER_CHORDS
    )
    area = shapely.get_parts(shapely.intersection(region, grown))
    return shapely.multipolygons(area[shapely.area(area) > np.pi * radius**2 / 2])


def _make_loop(ring: Any) -> Contour:
    points = shapely.get_coordinates(ring)[:-1]
    return Contour(points, np.zeros(len(points)), True, "")
