"""Holes that are drilled or bored: each where its circle is drawn, as deep as the job says."""

from __future__ import annotations

import math

import numpy as np
import shapely
from msgspec import Struct

from camgen.check.proof.findings import Findings
from camgen.check.proof.motions import Motions, Rounding
from camgen.check.proof.pieces import BoolArray, IntArray
from camgen.check.proof.tasks import Drawing, Task, find_circles
from camgen.model.pose import FloatArray
from camgen.model.sequences import take_rows

#: A contour counts as a hole if it leaves a circle by this share of its radius, or by this, mm.
_ROUND_SHARE, _ROUND_MM = 0.01, 0.01
#: Circles whose centres are nearer, mm, are one hole; the smallest of them is worked.
_SAME_HOLE_MM = 0.05


class Holes(Struct, frozen=True, eq=False):
    """The circles that an operation works on.

    contour: (H,) index of the contour.
    centre: (H, 2) mm.
    radius: (H,) mm.
    """

    contour: IntArray
    centre: FloatArray
    radius: FloatArray


def select_holes(task: Task, drawing: Drawing) -> Holes:
    """The circles of the task: of those around one centre the smallest, within `holes`."""
    fitted = find_circles(drawing, _ROUND_SHARE, _ROUND_MM)
    index = [k for k, circle in enumerate(fitted) if circle is not None and task.worked[k]]
    circles = np.array(take_rows(fitted, index), np.float64).reshape(-1, 3)
    low, high = task.operation.holes or (0.0, math.inf)
    wanted = (2 * circles[:, 2] >= low) & (2 * circles[:, 2] <= high)
    smallest = _are_smallest(circles)
    if task.kind == "bore":
        # Boring looks only at circles of the wanted diameters.
        smallest = np.zeros(len(circles), np.bool_)
        smallest[wanted] = _are_smallest(circles[wanted])
    rows = np.flatnonzero(wanted & smallest)
    return Holes(np.array(index, np.intp)[rows], circles[rows, :2], circles[rows, 2])


def _are_smallest(circles: FloatArray) -> BoolArray:
    """(H,) whether no other circle about the same centre is smaller, or as small and earlier."""
    places = shapely.points(circles[:, :2])
    first, second = shapely.STRtree(places).query(places, "dwithin", distance=_SAME_HOLE_MM)
    radius = circles[:, 2]
    smaller = (radius[second] < radius[first]) | (
        (radius[second] == radius[first]) & (second < first)
    )
    smallest = np.ones(len(circles), np.bool_)
    smallest[first[smaller]] = False
    return smallest


def find_hole(points: FloatArray, holes: Holes, reach: float) -> IntArray:
    """(N,) index of the hole whose centre is within `reach` mm of each point, or -1."""
    hole = np.full(len(points), -1, np.intp)
    if len(holes.centre) and len(points):
        tree = shapely.STRtree(shapely.points(holes.centre))
        row, index = tree.query(shapely.points(points), "dwithin", distance=reach)
        hole[row] = index
    return hole


def check_drilled(
    task: Task,
    drawing: Drawing,
    motions: Motions,
    rows: IntArray,
    rounding: Rounding,
    findings: Findings,
) -> tuple[BoolArray, BoolArray]:
    """Checks the upright motions `rows` of a drill.

    Returns (M,) which motions are in a hole, and (C,) which contours are drilled.
    """
    holes = select_holes(task, drawing)
    limit = rounding.slack
    hole = find_hole(motions.end[rows, :2], holes, limit)
    contact = np.zeros(len(motions), np.bool_)
    contact[rows[hole >= 0]] = True
    depth = task.operation.depth
    deepest = np.full(len(holes.contour), np.inf)
    np.minimum.at(deepest, hole[hole >= 0], motions.end[rows[hole >= 0], 2])
    done = np.zeros(len(drawing.contours), np.bool_)
    reached = np.isfinite(deepest) & (deepest <= task.job.process.approach)
    done[holes.contour[reached & (np.abs(deepest + depth) <= limit)]] = True
    for index in np.flatnonzero(reached & ~(np.abs(deepest + depth) <= limit))[:1].tolist():
        name = drawing.contours[int(holes.contour[index])].id
        at = rows[(hole == index) & (motions.end[rows, 2] == deepest[index])]
        what = f"ends {-deepest[index]:.4g} mm deep in hole {name}, the job asks for {depth:.4g}"
        findings.add(motions, int(at[0]), what)
    _check_strokes(task, motions, rows[hole >= 0], hole[hole >= 0], (limit, rounding), findings)
    return contact, done


def _check_strokes(
    task: Task,
    motions: Motions,
    rows: IntArray,
    hole: IntArray,
    limits: tuple[float, Rounding],
    findings: Findings,
) -> None:
    """Finds motions into new depth at another feed, from too high, or deeper than a peck.

    hole: (W,) index of the hole of each of the motions `rows`.
    limits: deviation of a height, mm, and the rounding of the text.
    """
    limit, rounding = limits
    process, operation = task.job.process, task.operation
    feed = process.feed
    start, end = motions.start[rows, 2], motions.end[rows, 2]
    before = _deepest_before(motions, rows, hole)
    # Between pecks the tool returns quickly to just above where it was.
    deeper = (end < start - limit) & (end < before - limit)
    is_wrong = np.abs(motions.speed[rows] - feed) > rounding.speed + 1e-3 * feed
    for row in rows[deeper & is_wrong][:1].tolist():
        findings.add(motions, row, f"drills at {motions.speed[row]:.4g} mm/s, the feed is {feed:g}")
    # Down to the part with the feed. Back towards the bottom, which may still be near the face,
    # with the feed or quickly through air.
    begun = (end < -limit) | (before < -limit)
    quick = motions.joint[rows] | (
        np.abs(motions.speed[rows] - process.travel_speed) <= rounding.speed + 1e-3 * feed
    )
    returns = (end < start - limit) & (end < process.approach - limit) & ~deeper
    for row in rows[returns & is_wrong & ~(quick & begun)][:1].tolist():
        what = f"goes down at {motions.speed[row]:.4g} mm/s, the feed is {feed:g}"
        findings.add(motions, row, what)
    highest = np.maximum(process.approach, before) + limit
    for row in rows[deeper & (start > highest)][:1].tolist():
        findings.add(motions, row, "drills from above process.approach")
    peck = operation.depth / operation.passes
    for row in rows[deeper & (before - end > peck + limit)][:1].tolist():
        findings.add(motions, row, f"drills deeper at once than {peck:.4g} mm")


def _deepest_before(motions: Motions, rows: IntArray, hole: IntArray) -> FloatArray:
    """(W,) lowest height, mm, that a hole had before each motion; 0 at first."""
    lowest = np.zeros(len(rows))
    reached: dict[int, float] = {}
    for index, (row, name) in enumerate(zip(rows.tolist(), hole.tolist(), strict=True)):
        lowest[index] = reached.get(name, 0.0)
        reached[name] = min(lowest[index], float(motions.end[row, 2]))
    return lowest


def check_bored(
    task: Task,
    drawing: Drawing,
    motions: Motions,
    rows: IntArray,
    limit: float,
    findings: Findings,
) -> BoolArray:
    """Checks the working motions `rows` of a bore; returns (C,) which contours are bored.

    The tool's centre stays within the radius of the hole less its own. At the full depth it runs
    once around at that distance.
    """
    holes = select_holes(task, drawing)
    tool = task.job.tool.radius
    done = np.zeros(len(drawing.contours), np.bool_)
    centres = holes.centre
    if not len(centres):
        for row in rows[:1].tolist():
            findings.add(motions, row, "works where no circle is to be bored")
        return done
    hole = shapely.STRtree(shapely.points(centres)).nearest(shapely.points(motions.end[rows, :2]))
    plane = motions.plane
    from_centre = np.zeros(len(rows))
    for points in (plane.start[rows], plane.middle[rows], plane.end[rows]):
        offset = points - centres[hole]
        from_centre = np.maximum(from_centre, np.sqrt((offset**2).sum(axis=1)))
    room = holes.radius[hole] - tool
    for index in np.flatnonzero(from_centre > room + limit)[:1].tolist():
        name = drawing.contours[int(holes.contour[hole[index]])].id
        what = f"leaves circle {name} by {from_centre[index] - room[index]:.4g} mm"
        findings.add(motions, int(rows[index]), what)
    deep = np.abs(motions.end[rows, 2] + task.operation.depth) <= limit
    deep &= np.abs(motions.start[rows, 2] + task.operation.depth) <= limit
    sweep = _swept_angle(motions, rows, centres[hole], room, limit)
    total = np.bincount(hole[deep], sweep[deep], len(centres))
    done[holes.contour[total >= 2 * math.pi - 0.01]] = True
    return done


def find_plunged(
    task: Task, drawing: Drawing, motions: Motions, rows: IntArray, limit: float
) -> tuple[BoolArray, BoolArray]:
    """The holes as wide as the tool that it goes straight down into.

    rows: the upright motions.
    Returns (C,) contours that are bored to the depth, and (M,) motions in their middles.
    """
    holes = select_holes(task, drawing)
    same = np.abs(holes.radius - task.job.tool.radius) <= limit
    holes = Holes(holes.contour[same], holes.centre[same], holes.radius[same])
    hole = find_hole(motions.end[rows, :2], holes, limit)
    strokes = np.zeros(len(motions), np.bool_)
    strokes[rows[hole >= 0]] = True
    deep = (hole >= 0) & (np.abs(motions.end[rows, 2] + task.operation.depth) <= limit)
    done = np.zeros(len(drawing.contours), np.bool_)
    done[holes.contour[hole[deep]]] = True
    return done, strokes


def _swept_angle(
    motions: Motions, rows: IntArray, centre: FloatArray, room: FloatArray, limit: float
) -> FloatArray:
    """(W,) angle about `centre`, rad, that each motion runs along the circle of radius `room`."""
    plane = motions.plane
    arms = [points - centre for points in (plane.start[rows], plane.middle[rows], plane.end[rows])]
    on_circle = np.ones(len(rows), np.bool_)
    for arm in arms:
        on_circle &= np.abs(np.sqrt((arm**2).sum(axis=1)) - room) <= limit
    sweep = np.zeros(len(rows))
    for first, second in ((arms[0], arms[1]), (arms[1], arms[2])):
        cross = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
        sweep += np.abs(np.arctan2(cross, (first * second).sum(axis=1)))
    return np.where(on_circle, sweep, 0.0)
