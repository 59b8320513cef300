"""Areas that are cleared or filled: inside their walls, and covered."""

from __future__ import annotations

from itertools import compress
from typing import Any

import numpy as np
import shapely

from camgen.check.proof.findings import Findings
from camgen.check.proof.matching import PieceTree
from camgen.check.proof.motions import Motions
from camgen.check.proof.nesting import flatten
from camgen.check.proof.pieces import (
    BoolArray,
    IntArray,
    dot,
    find_ways_to,
    normals_along,
)
from camgen.check.proof.subject import Subject
from camgen.check.proof.tasks import HOP_MM, Drawing, Task, find_circles
from camgen.check.proof.travel import Phases
from camgen.model.pose import FloatArray

#: The area is examined at about this number of places on a grid.
_PLACES = 4_000
#: What earlier operations leave is small: then about this number of places.
_REST_PLACES = 40_000
#: A place that is nearer to the border of what the tool can reach, mm, is not examined.
_BORDER_MM = 0.03
#: A channel that is narrower than the tool by less than twice this, mm, is as wide as it.
_CHANNEL_MM = 1e-3
#: A fill is planned on a raster: its strokes may leave the area by this share of the diameter.
_FILL_SHARE = 0.05
#: A feed may differ by this share: a text gives it with a few digits.
_FEED_SHARE = 1e-3
#: The tool's centre is never slower than this share of the feed (docs/follow.md).
_SLOWEST = 0.02
#: Share of the places of a filled area that has to be covered (docs/fill.md).
_FILLED = 0.98


def make_region(task: Task, drawing: Drawing) -> Any:
    """The area between walls and islands, by the even-odd rule, as a shapely geometry."""
    region = shapely.Polygon()
    for index in np.flatnonzero(task.worked & drawing.closed).tolist():
        ring = flatten(drawing.pieces.take(drawing.pieces.owner == index))
        if len(ring) > 3:
            area = shapely.make_valid(shapely.polygons(shapely.linearrings(ring)))
            region = shapely.symmetric_difference(region, area)
    return region


class AreaChecker:
    """Examines the motions of one task that clear or fill an area.

    region: the area, see `make_region`.
    limit: distance, mm, that a motion may have from its place in the drawing.
    """

    def __init__(
        self, task: Task, drawing: Drawing, region: Any, motions: Motions, limit: float
    ) -> None:
        self.task, self.drawing, self.region = task, drawing, region
        self.motions, self.limit = motions, limit
        self._radius = task.job.tool.radius
        shapely.prepare(region)

    def check_inside(self, rows: IntArray, findings: Findings) -> None:
        """Finds motions that leave the area, or come nearer to a wall than the tool's radius."""
        plane, fills = self.motions.plane, self.task.kind == "fill"
        points = np.concatenate([plane.start[rows], plane.middle[rows], plane.end[rows]])
        room = 0.0 if fills else self._radius - self.limit
        inside = shapely.contains_xy(self.region, points[:, 0], points[:, 1])
        worked = self.task.worked[self.drawing.pieces.owner]
        walls = PieceTree(self.drawing.pieces, np.flatnonzero(worked))
        distance = walls.find(points, room + 2 * self.limit + fills * self._radius).distance
        # A track thinner than the tool is filled along its middle, so a fill may touch its border.
        beyond = self.limit + (_FILL_SHARE * self.task.job.tool.diameter if fills else 0.0)
        outside = ~inside & ((distance > beyond) | (not fills))
        near = inside & (distance < room)
        for index in np.flatnonzero(outside)[:1].tolist():
            if fills:
                # Thin tracks are filled along a middle that follows a raster.
                x, y = points[index].tolist()
                findings.leave(
                    "that strokes stay inside", f"one leaves the area at {x:.2f} {y:.2f}"
                )
                continue
            findings.add(self.motions, int(rows[index % len(rows)]), "leaves the area")
        for index in np.flatnonzero(near)[:1].tolist():
            what = "comes nearer to a wall than the tool's radius"
            findings.add(self.motions, int(rows[index % len(rows)]), what)

    def check_hops(
        self, phases: Phases, of_task: BoolArray, slack: float, findings: Findings
    ) -> None:
        """Finds rapid motions below the clearance that are not level `HOP_MM` above a pass.

        They have to stay inside as well. That they meet no material the stock proof shows.
        slack: deviation of a height, mm.
        """
        motions, process = self.motions, self.task.job.process
        low = np.minimum(motions.start[:, 2], motions.end[:, 2]) < process.clearance - slack
        rows = np.flatnonzero(phases.known & ~phases.upright & ~phases.works & of_task & low)
        if self.task.kind != "pocket" or not len(rows):
            return
        heights = HOP_MM - np.array(self.task.depths)
        deviation = np.zeros(len(rows))
        for end in (motions.start[rows, 2], motions.end[rows, 2]):
            deviation = np.maximum(deviation, np.abs(end[:, None] - heights).min(axis=1))
        for index in np.flatnonzero(deviation > slack)[:1].tolist():
            what = "is a rapid motion that is not level above the floor of a pass"
            findings.add(motions, int(rows[index]), what)
        self.check_inside(rows, findings)

    def check_direction(self, rows: IntArray, findings: Findings) -> None:
        """Finds walls that are run along against `operation.direction` for most of the length.

        Climb: the wall is on the right. Links and the loops of a channel may touch a wall in any
        direction. rows: the motions at the depth of one pass.
        """
        direction, plane = self.task.operation.direction, self.motions.plane
        if self.task.kind != "pocket" or direction == "any" or not len(rows):
            return
        pieces = self.drawing.pieces
        walls = PieceTree(pieces, np.flatnonzero(self.task.worked[pieces.owner]))
        points = np.concatenate([plane.middle[rows], plane.start[rows], plane.end[rows]])
        nearest = walls.find(points, self._radius + self.limit)
        at_wall = (nearest.distance >= self._radius - self.limit).reshape(3, -1)
        at_wall &= np.isfinite(nearest.distance).reshape(3, -1)
        along = at_wall.all(axis=0) & (nearest.side[: len(rows)] != 0)
        rows, piece = rows[along], nearest.piece[: len(along)][along]
        to_wall = find_ways_to(plane.middle[rows], pieces, piece)
        on_left = dot(normals_along(plane, rows, np.full(len(rows), 0.5)), to_wall) > 0
        against = on_left == (direction == "climb")
        # Between two walls as far apart as the tool is wide, a motion runs along both.
        unit = to_wall / np.maximum(np.sqrt((to_wall**2).sum(axis=1)), 1e-9)[:, None]
        beyond, reach = plane.middle[rows] - self._radius / 2 * unit, self._radius / 2 + self.limit
        single = walls.find(beyond, reach).distance > reach
        rows, piece, against = rows[single], piece[single], against[single]
        length = np.where(against, plane.length[rows], -plane.length[rows])
        wall = pieces.owner[piece]
        wrong = np.bincount(wall, length, len(self.drawing.contours)) > 0
        for index in np.flatnonzero(against & wrong[wall])[:1].tolist():
            name = self.drawing.contours[int(wall[index])].id
            findings.add(
                self.motions,
                int(rows[index]),
                f"and others run along wall {name} against operation.direction",
            )

    def check_speeds(self, rows: IntArray, speed_slack: float, findings: Findings) -> None:
        """Finds motions at the depth of a pass that are faster than the feed.

        speed_slack: rounding of a speed, mm/s.
        """
        feed, speed = self.task.job.process.feed, self.motions.speed[rows]
        slack = speed_slack + _FEED_SHARE * feed
        is_wrong = (speed > feed + slack) | (speed < _SLOWEST * feed - slack)
        for index in np.flatnonzero(is_wrong)[:1].tolist():
            what = f"has a feed of {speed[index]:.4g} mm/s, the job asks for {feed:.4g}"
            findings.add(self.motions, int(rows[index]), what)

    def are_inside(self, rows: IntArray, findings: Findings) -> BoolArray:
        """(N,) whether motions end inside the area or on its border; a fill may touch it only."""
        points = self.motions.end[rows, :2]
        distance = shapely.distance(shapely.points(points), self.region)
        distance[shapely.contains_xy(self.region, points[:, 0], points[:, 1])] = 0.0
        if self.task.kind != "fill":
            return np.asarray(distance <= self.limit)
        beyond = self.limit + _FILL_SHARE * self.task.job.tool.diameter
        for x, y in points[(distance > beyond) & (distance <= self._radius)][:1].tolist():
            findings.leave("that strokes stay inside", f"one leaves the area at {x:.2f} {y:.2f}")
        return np.asarray(distance <= max(beyond, self._radius))

    def list_places(self, depth: float, subject: Subject) -> FloatArray:
        """(N, 2) places of the area to be cleared at a depth, without those that earlier operations
        clear if the task takes only their rest.

        depth: depth of the pass below the top face, mm.
        """
        if subject.earlier is None:
            return _grid_in(self.region, _PLACES)
        points = _grid_in(self.region, _REST_PLACES)
        return points[~subject.earlier.clear(points, depth, subject.slack)]

    def check_covered(
        self, rows: IntArray, points: FloatArray, left: float, findings: Findings
    ) -> None:
        """Finds places that the tool can reach, and that no motion of `rows` clears.

        points: (N, 2) places of the area, see `list_places`.
        left: material that is left at the walls, mm.
        """
        if not len(points):
            return
        reach = self._radius + self.limit
        bare = ~np.isfinite(PieceTree(self.motions.plane, rows).find(points, reach).distance)
        if self.task.kind == "fill":
            share = 1 - bare.mean()
            if share < _FILLED:
                findings.leave("that all is filled", f"{100 * share:.1f} % of the area is")
            return
        reachable = shapely.buffer(self.region, -(reach + left), quad_segs=64)
        if not left:
            reachable = shapely.union(reachable, self._find_channels())
        places = points[bare]
        if not len(places) or shapely.is_empty(reachable):
            return
        places = places[self._are_near(places, reachable)]
        if len(places):
            walls = shapely.buffer(self._find_common_edges(), reach + left, quad_segs=64)
            places = places[self._are_near(places, shapely.difference(reachable, walls))]
        for x, y in places[:1].tolist():
            what = f"the area is not cleared at {x:.3f} {y:.3f} mm, which the tool can reach"
            findings.miss(what)

    def _are_near(self, places: FloatArray, reachable: Any) -> BoolArray:
        """(N,) whether a tool whose centre is in the area `reachable` clears `places` (N, 2)."""
        distance = shapely.distance(shapely.points(places), reachable)
        return np.asarray(distance < self._radius - _BORDER_MM)

    def _find_common_edges(self) -> Any:
        """The walls inside of the area: two pockets beside each other have them in common."""
        rings = []
        for index in np.flatnonzero(self.task.worked & self.drawing.closed).tolist():
            rings.append(flatten(self.drawing.pieces.take(self.drawing.pieces.owner == index)))
        lines = shapely.union_all([shapely.linestrings(ring) for ring in rings if len(ring) > 3])
        border = shapely.buffer(shapely.boundary(self.region), self.limit)
        return shapely.difference(lines, border)

    def _find_channels(self) -> Any:
        """Middles of channels and round holes as wide as the tool: thin polygons and points."""
        radius = self._radius
        inner = shapely.buffer(self.region, -(radius - _CHANNEL_MM), quad_segs=64)
        wide = shapely.buffer(self.region, -(radius + self.limit), quad_segs=64)
        rest = shapely.difference(inner, shapely.buffer(wide, 2 * self.limit, quad_segs=64))
        thin = shapely.get_parts(rest)
        circles = compress(find_circles(self.drawing), self.task.worked)
        same = [c for c in circles if c is not None and abs(c[2] - radius) <= _CHANNEL_MM]
        middles = [shapely.Point(circle[:2]) for circle in same]
        return shapely.union_all([*thin[shapely.length(thin) > 2 * radius], *middles])


def _grid_in(region: Any, places: int) -> FloatArray:
    if shapely.is_empty(region):
        return np.zeros((0, 2))
    low_x, low_y, high_x, high_y = shapely.bounds(region).tolist()
    step = max(np.sqrt(shapely.area(region) / places), 1e-3)
    # Off round numbers, on which drawings have their walls.
    x = np.arange(low_x + 0.381966 * step, high_x, step)
    y = np.arange(low_y + 0.381966 * step, high_y, step)
    grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    shapely.prepare(region)
    return np.asarray(grid[shapely.contains_xy(region, grid[:, 0], grid[:, 1])])
