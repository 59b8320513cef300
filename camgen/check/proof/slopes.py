"""Slopes: ramps into the material, and the tabs over which the tool is lifted (docs/follow.md)."""

from __future__ import annotations

import math

import numpy as np
import shapely

from camgen.check.proof.contours import Matched
from camgen.check.proof.findings import Findings
from camgen.check.proof.heights import tab_slopes, tab_top
from camgen.check.proof.motions import Motions
from camgen.check.proof.nesting import enclosed_areas, flatten
from camgen.check.proof.outputs import plunge_speed
from camgen.check.proof.pieces import (
    BoolArray,
    IntArray,
    cross,
    dot,
    find_ways_to,
    normals_along,
)
from camgen.check.proof.tasks import BESIDE, Drawing, Task
from camgen.check.proof.visits import Laps, highest_of, lowest_of
from camgen.model.job import OperationTable
from camgen.model.pose import FloatArray

#: A slope may be steeper by this share: a chord is shorter than its arc.
_STEEPER = 1.02
#: A speed may be higher by this share: a text gives it with a few digits.
_FASTER = 1.01
#: Deviation of the length of a tab, mm.
_TAB_MM = 0.05
#: Areas of slugs are known with this share.
_AREA_SHARE = 0.05
#: Lengths of laps are known with this slack, mm.
_ROOM_MM = 1.0
#: A path runs at the depth of each pass for more than this share of the length of another.
_PASS_SHARE = 0.1
#: Two motions at heights that differ by more, mm, have a lift or a plunge between them.
_LIFT_MM = 0.02
#: A motion that is shorter, mm, has no slope in a text with three digits.
_FLAT_MM = 0.05


class SlopeChecker:
    """Examines the slopes of the working motions of one task.

    rows: (W,) indices of the motions.
    reached: (W,) see `Laps`.
    slack: deviation of a height, mm.
    """

    def __init__(
        self, task: Task, motions: Motions, rows: IntArray, reached: IntArray, slack: float
    ) -> None:
        self.task, self.motions, self.rows = task, motions, rows
        self.reached, self.slack = reached, slack
        self.rise = motions.end[rows, 2] - motions.start[rows, 2]
        self.flat = motions.plane.length[rows]
        self.low, self.high = lowest_of(motions, rows), highest_of(motions, rows)

    def check(self, visit: IntArray, levels: IntArray, findings: Findings) -> None:
        """Finds slopes that are steeper or faster than the job allows, or deeper than a pass.

        visit: (W,) number of the visit of each motion.
        levels: (W,) index of the pass at whose depth a motion runs, -1 for a slope.
        """
        operation, process = self.task.operation, self.task.job.process
        over_tab = self.high <= tab_top(self.task) + self.slack
        may_be_45 = over_tab & ((self.rise > 0) | (operation.entry == "plunge"))
        steepest = np.where(may_be_45, 1.0, math.tan(math.radians(operation.entry_angle)))
        allowed = _STEEPER * steepest * self.flat + 2 * self.slack
        findings.add_first(
            self.motions,
            self.rows[(np.abs(self.rise) > allowed) & (self.flat > _FLAT_MM)],
            "is steeper than the job allows",
        )
        findings.add_first(
            self.motions,
            self.rows[(self.rise > self.slack) & ~over_tab],
            "goes up on a slope where no tab is",
        )
        down = self.rise < -self.slack
        speed = self.motions.speed[self.rows]
        # Down from a tab only the vertical part of the speed is limited.
        length = np.hypot(self.flat, self.rise)
        drop = np.maximum(-self.rise - self.slack, 0.0)
        falling = np.where(over_tab, speed * drop / np.maximum(length, 1e-9), speed)
        findings.add_first(
            self.motions,
            self.rows[
                down & (falling > _FASTER * plunge_speed(process) + 1e-6) & (self.flat > _FLAT_MM)
            ],
            "goes down on a slope faster than process.plunge",
        )
        heights = np.append(-np.array(self.task.depths), 0.0)
        following = heights[np.minimum(self.reached + 1, len(self.task.depths) - 1)]
        findings.add_first(
            self.motions,
            self.rows[(self.low < following - self.slack) & ~self._finish(levels)],
            "goes deeper at once than one pass",
        )
        self._check_starts(visit, levels, findings)

    def _finish(self, levels: IntArray) -> BoolArray:
        """(W,) motions of paths that run at the whole depth only, where others have cut before."""
        path = self.motions.path[self.rows]
        if not self.task.operation.finish or not len(path):
            return np.zeros(len(path), np.bool_)
        # A piece of a ramp may be too short to have a slope: a pass runs at its depth for longer.
        length = np.zeros((int(path.max()) + 2, len(self.task.depths)))
        np.add.at(length, (path[levels >= 0], levels[levels >= 0]), self.flat[levels >= 0])
        is_pass = length > _PASS_SHARE * length.max(axis=1, keepdims=True)
        highest = np.where(is_pass.any(axis=1), is_pass.argmax(axis=1), len(self.task.depths))
        return np.asarray((path < 0) | (highest[path] == len(self.task.depths) - 1))

    def _check_starts(self, visit: IntArray, levels: IntArray, findings: Findings) -> None:
        if self.task.operation.entry == "plunge" or not len(self.rows):
            return
        begins = self._begins(visit)
        heights = np.append(-np.array(self.task.depths), 0.0)[levels]
        done = _lowest_before(self.motions.path[self.rows], np.minimum(heights, 0.0))
        findings.add_first(
            self.motions,
            self.rows[
                begins
                & (self.motions.start[self.rows, 2] < done - self.slack)
                & ~self._finish(levels)
            ],
            "begins deeper than its path has run before",
        )

    def goes_round(self, laps: Laps) -> BoolArray:
        """(W,) motions of closed paths without leads, which have ramps around them."""
        operation, path = self.task.operation, self.motions.path[self.rows]
        closed = np.zeros(int(path.max(initial=-1)) + 2, np.bool_)
        if not (operation.lead_in or operation.lead_out or operation.overlap):
            closed[path[laps.first]] = laps.closed
        closed[-1] = False
        return np.asarray(closed[path] & (operation.entry != "plunge"))

    def _begins(self, visit: IntArray) -> BoolArray:
        """(W,) motions before which the tool is lifted or plunges.

        The chord of a ramp may be so short that it counts as upright.
        """
        start, end = self.motions.start[self.rows, 2], self.motions.end[self.rows, 2]
        begins = np.ones(len(self.rows), np.bool_)
        begins[1:] = (visit[1:] != visit[:-1]) | (np.abs(start[1:] - end[:-1]) > _LIFT_MM)
        return begins

    def check_linked(self, laps: Laps, visit: IntArray, findings: Findings) -> None:
        """Finds ramps after a lift; the passes around a closed path without leads need none.

        visit: (W,) number of the visit of each motion.
        """
        path = self.motions.path[self.rows]
        findings.add_first(
            self.motions,
            self.rows[
                (self._begins(visit) & ~np.append(True, path[1:] != path[:-1]))
                & self.goes_round(laps)
            ],
            "begins a pass of a closed path after a lift",
        )


class TabChecker:
    """Compares the tabs of each lap with the job: their number, length and height."""

    def __init__(
        self, task: Task, drawing: Drawing, motions: Motions, slack: float, skipped: BoolArray
    ) -> None:
        """Prepares the comparison.

        skipped: (C,) contours that are left out: a note says so.
        """
        self.task, self.drawing, self.motions, self.slack = task, drawing, motions, slack
        self.skipped = skipped
        self._top = tab_top(task)

    def check(self, matched: Matched, laps: Laps, fewer: BoolArray, findings: Findings) -> None:
        """Finds laps with other tabs than the job asks for.

        fewer: (L,) laps that may have fewer tabs: a note is about them.
        """
        if not np.isfinite(self._top) or self.task.kind not in BESIDE:
            return
        rows = matched.rows
        heights = -np.array(self.task.depths)[np.maximum(laps.depth, 0)]
        low, high = lowest_of(self.motions, rows), highest_of(self.motions, rows)
        lap = laps.lap
        floor = np.append(heights, np.inf)[lap] + self.slack
        raised = (lap >= 0) & (high > floor)
        level = np.abs(high - self._top) + np.abs(low - self._top) <= 2 * self.slack
        # Two tabs may meet at the depth of the lap.
        goes_on = np.append(False, raised[:-1] & (lap[1:] == lap[:-1]))
        begins = raised & ~(goes_on & (self.motions.start[rows, 2] > floor))
        tab = np.cumsum(begins) - 1
        count = int(begins.sum())
        flat = self.motions.plane.length[rows]
        length = np.bincount(tab[raised & level], flat[raised & level], count)
        wanted = self.task.operation.tab_width + self.task.job.tool.diameter
        rise, fall = tab_slopes(self.task.operation)
        # A piece of a slope that is as flat as the heights are inexact counts as level.
        flatter = 2 * self.slack * (rise + fall) / self.task.operation.tab_height
        for number in np.flatnonzero(np.abs(length - wanted) > _TAB_MM + flatter)[:1].tolist():
            row = rows[np.flatnonzero(begins)[number]]
            what = f"runs over a tab of {length[number]:.3f} mm, the job asks for {wanted:.3f} mm"
            findings.add(self.motions, int(row), what)
        counts = np.bincount(lap[begins], minlength=len(laps.depth))
        least, greatest = self._wanted_counts(matched, laps)
        closed = laps.closed | (self.task.operation.overlap > 0)
        must, may = self._have_tabs(matched, laps)
        below = heights < self._top - self.slack
        least[~(must & below & closed) | (fewer & ~self._has_room(matched, laps, counts))] = 0
        # A ramp down to the next depth belongs to no lap, so the lap before it stays open.
        ramped = np.isin(laps.contour, laps.contour[laps.closed])
        greatest[~(may & below & (closed | ramped))] = 0
        for lap in np.flatnonzero((counts < least) | (counts > greatest))[:1].tolist():
            name = self.drawing.contours[int(laps.contour[lap])].id
            findings.add(
                self.motions,
                int(matched.rows[laps.first[lap]]),
                f"begins a lap around contour {name} with {counts[lap]} tabs, "
                f"the job asks for {greatest[lap]}",
            )

    def _have_tabs(self, matched: Matched, laps: Laps) -> tuple[BoolArray, BoolArray]:
        drawing, task = self.drawing, self.task
        turns_left = enclosed_areas(drawing.pieces, len(drawing.contours)) > 0
        worked = task.worked & drawing.closed & ~self.skipped
        outside = worked & (turns_left == (task.tool_side < 0))
        holes = np.zeros(len(worked), np.bool_)
        pairs = task.enclosed
        holes[pairs[outside[pairs[:, 0]], 1]] = True
        holes &= worked & ~outside
        cut_out = outside[laps.contour] & self._are_cut_out(matched, laps)
        # A contour of which a piece is left out may have tabs on its other pieces.
        named = task.worked & drawing.closed & self.skipped
        if outside.any():
            may = outside | holes | named
            return cut_out | holes[laps.contour], may[laps.contour]
        areas = np.zeros(len(worked))
        areas[worked] = [self._measure_slug(k) for k in np.flatnonzero(worked).tolist()]
        chip = task.job.tool.chip_area
        must, may = areas > (1 + _AREA_SHARE) * chip, areas > (1 - _AREA_SHARE) * chip
        return must[laps.contour], may[laps.contour]

    def _measure_slug(self, contour: int) -> float:
        pieces = self.drawing.pieces
        ring = shapely.Polygon(flatten(pieces.take(pieces.owner == contour)))
        slug = shapely.buffer(shapely.make_valid(ring), -self.task.job.tool.diameter)
        return float(shapely.area(shapely.get_parts(slug)).max(initial=0.0))

    def _has_room(self, matched: Matched, laps: Laps, counts: IntArray) -> BoolArray:
        """(L,) whether there is room for one more tab, wherever the others are."""
        operation, diameter = self.task.operation, self.task.job.tool.diameter
        return np.asarray(self._lengths(matched, laps) > find_tab_room(operation, diameter, counts))

    def _lengths(self, matched: Matched, laps: Laps) -> FloatArray:
        """(L,) lengths of the laps without overlap, mm."""
        along = np.append(0.0, np.cumsum(self.motions.plane.length[matched.rows]))
        return np.asarray(along[laps.last + 1] - along[laps.first] - self.task.operation.overlap)

    def _wanted_counts(self, matched: Matched, laps: Laps) -> tuple[IntArray, IntArray]:
        """Fewest and most tabs of each lap; the length of a path is known with a little slack."""
        operation = self.task.operation
        count = len(laps.depth)
        if operation.tabs:
            return np.full(count, operation.tabs), np.full(count, operation.tabs)
        length = self._lengths(matched, laps)
        spacing = operation.tab_spacing or math.inf
        slack = 0.1 + 4 * math.pi * operation.finish
        least, greatest = np.ceil((length - slack) / spacing), np.ceil((length + slack) / spacing)
        return np.maximum(least, 2).astype(np.intp), np.maximum(greatest, 2).astype(np.intp)

    def _are_cut_out(self, matched: Matched, laps: Laps) -> BoolArray:
        """(L,) whether a lap runs around its contour: that lies on the inner side of the lap."""
        plane, pieces = self.motions.plane, self.drawing.pieces
        chosen = np.flatnonzero((laps.lap >= 0) & matched.follows)
        rows, lap = matched.rows[chosen], laps.lap[chosen]
        begin = self.motions.start[matched.rows[laps.first], :2][lap]
        start, middle, end = (
            points[rows] - begin for points in (plane.start, plane.middle, plane.end)
        )
        area = np.bincount(lap, cross(start, middle) + cross(middle, end), len(laps.first))
        row, piece = matched.rows[laps.first], matched.piece[laps.first]
        to_contour = find_ways_to(plane.middle[row], pieces, piece)
        left = dot(to_contour, normals_along(plane, row, np.full(len(row), 0.5))) > 0
        return np.asarray(left == (area > 0))


def find_tab_room(operation: OperationTable, diameter: float, counts: IntArray | int) -> FloatArray:
    """Lengths of paths, mm, from which on there is room for one more tab, wherever the others are.

    The seam with its leads and the overlap stays free, and so does the length of a tab on both
    sides of each tab (docs/follow.md). The last path is shorter than the first: its centre line
    is nearer to the contour by `operation.finish`.

    diameter: diameter of the tool, mm.
    counts: tabs of each path.
    """
    top = (operation.tab_width + diameter) / 2
    rise, fall = (top + _STEEPER * slope for slope in tab_slopes(operation))
    seam = operation.overlap
    for slope, lead in ((fall, operation.lead_in), (rise, operation.lead_out)):
        seam += max(slope, top + lead / (math.pi / 2))
    if operation.entry != "plunge":
        seam += diameter
    seams = 2 if operation.finish else 1
    spacing = rise + fall + 2 * math.pi * operation.finish
    return np.asarray(seams * seam + 2 * spacing * counts + _ROOM_MM)


def _lowest_before(group: IntArray, height: FloatArray) -> FloatArray:
    """(W,) lowest `height` (W,), at most 0, of earlier motions of the same group; 0 at first."""
    order = np.argsort(group, kind="stable")
    member, sorted_height = group[order], height[order]
    first = np.append(True, member[1:] != member[:-1])
    # Each group is shifted below the one before it, so that one running minimum serves all.
    shift = np.cumsum(first) * (1.0 - float(height.min(initial=0.0)))
    earlier = np.append(0.0, sorted_height[:-1])
    earlier[first] = 0.0
    lowest = np.empty(len(group))
    lowest[order] = np.minimum.accumulate(earlier - shift) + shift
    return lowest
