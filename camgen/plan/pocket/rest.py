"""The walls of what earlier operations leave of pockets, for a smaller tool that clears only that.

Material that the tool reaches, and that earlier tools leave, is grown by the tool's diameter within
its pocket. Each disc of the tool that meets such material lies in the grown area. So a pocket of
that shape clears all that the tool would clear of the whole pocket.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
from msgspec import Struct

from camgen.geometry.segments import from_contours, neighbours
from camgen.model.errors import JobError
from camgen.model.job import Job
from camgen.model.part import Contour, Part
from camgen.plan.pocket.regions import QUARTER_CHORDS, PocketWalls, make_pocket_polygon
from camgen.plan.recover import recover
from camgen.plan.rest import find_rest

#: Tolerance with which arcs of walls are found again in their chords, mm.
_ARC_MM = 0.004
#: Channels narrower than the tool by twice this, mm, count as wide as it.
_CHANNEL_MM = 0.005
#: Material in no wider a strip, mm, is an error of chords.
_NARROW_MM = 0.01
#: The area is grown by the diameter and this share of the radius more.
_MORE_SHARE = 0.05


class Rest(Struct, frozen=True, eq=False):
    """The areas of pockets that earlier operations leave.

    ground: walls of the areas that are left, in the order of their pockets.
    pocket: (A,) the pocket of each area.
    cleared: polygons of the pockets that are cleared before.
    """

    ground: PocketWalls
    pocket: list[int]
    cleared: Any


def find_rest_of_pockets(ground: PocketWalls, part: Part, job: Job) -> Rest:
    """The walls of what operations before, of `part`, leave of the pockets of `ground`.

    Raises JobError if no operation with a larger tool comes before.
    """
    radius = job.tool.radius
    if part.earlier and max(run.radius for run in part.earlier) <= radius:
        what = "no operation before it has a larger tool"
        remedy = "list it after the operations of larger tools"
        raise JobError("job", what, "operation.rest", remedy)
    regions = [make_pocket_polygon(ground, number) for number in range(ground.pocket_count)]
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
    walls = from_contours(recover(loops, _ARC_MM)[0])
    following = neighbours(walls, np.ones(len(loops), np.bool_))
    owner_group = np.array(group, np.int64)[walls.owner]
    rest_ground = PocketWalls(walls, following, owner_group, len(pocket))
    return Rest(rest_ground, pocket, shapely.difference(whole, rest))


def _grow(region: Any, rest: Any, radius: float) -> Any:
    """The area around the rest that a tool has to clear of a pocket, empty polygons for nothing."""
    centres = shapely.buffer(region, _CHANNEL_MM - radius, quad_segs=QUARTER_CHORDS)
    reached = shapely.buffer(centres, radius, quad_segs=QUARTER_CHORDS)
    left = shapely.get_parts(shapely.intersection(reached, rest))
    left = left[~shapely.is_empty(shapely.buffer(left, -_NARROW_MM / 2, quad_segs=2))]
    grown = shapely.buffer(
        shapely.union_all(left), (2 + _MORE_SHARE) * radius, quad_segs=QUARTER_CHORDS
    )
    area = shapely.get_parts(shapely.intersection(region, grown))
    return shapely.multipolygons(area[shapely.area(area) > np.pi * radius**2 / 2])


def _make_loop(ring: Any) -> Contour:
    points = shapely.get_coordinates(ring)[:-1]
    return Contour(points, np.zeros(len(points)), True, "")
