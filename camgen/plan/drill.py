"""Drills holes: at + marks and in rings of a picture, at the circles of a drawing.

The tool path of a hole goes straight down and up again. Its first point is on the top face, where
the signal is switched. So links and order of the holes are planned as for all other paths. See
"Continuous path following", section 4.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import chain

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import count_rows, find_following_rows, list_owners
from camgen.geometry.segments import BoolArray, IntArray, flatten, make_contour_segments, points_at
from camgen.model.errors import InputError, JobError
from camgen.model.job import Job
from camgen.model.part import Note, Part, Raster, select_closed
from camgen.model.path import ToolPath, make_waypoints
from camgen.model.pose import FloatArray
from camgen.model.sequences import take_rows
from camgen.model.text import counted, short
from camgen.model.tolerance import PECK_CLEARANCE_MM
from camgen.plan.unused import check_rules

#: Maximum deviation of a loop from a circle: in a drawing, mm or as a fraction of the radius, and
#: in a picture, px.
_DEVIATION_MM, _DEVIATION_FRACTION, _DEVIATION_PX = 0.01, 0.01, 0.75
#: Circles with centres nearer than this, mm, are one hole and the pad around it.
_SAME_HOLE_MM = 0.05
#: Maximum difference of two diameters that count as equal, mm.
_SAME_MM = 0.01
#: Maximum number of circles that a note names.
_NAMED = 8
#: Resolution of diameters in notes, mm.
_DIAMETER_STEP_MM = 0.05
#: Minimum diameter of a ring in a picture, px. Smaller ones are noise.
_MIN_RING_PX = 4.0


class Hole(Struct, frozen=True):
    """A hole to drill.

    x, y: centre in the work frame, mm.
    diameter: mm, 0 for a mark.
    layer: layer of the circle or the mark.
    id: name of the hole, and of its path.
    contours: id of the circle in a drawing, empty in a picture.
    deviation: largest distance of the circle's contour from a circle of this diameter, mm.
    """

    x: float
    y: float
    diameter: float
    layer: str
    id: str
    contours: tuple[str, ...] = ()
    deviation: float = 0.0


def drill(part: Part, job: Job) -> tuple[tuple[ToolPath, ...], tuple[Note, ...]]:
    """Plan a path for every hole, in the order of the input, with notes on their diameters.

    `operation.passes` is the number of pecks; the tool retracts to the approach height after each.
    A circle of a drawing that is smaller than the tool is not drilled to a depth.
    Raises InputError without any hole, and JobError for settings that do not suit a drill.
    """
    smallest, largest = read_diameters(job)
    check_rules(
        [
            (
                job.process.force != 0,
                "a drill goes to a depth, not to a force",
                "process.force",
                "set process.force to 0",
            ),
            (
                job.process.plunge is not None,
                "a drill goes down at process.feed",
                "process.plunge",
                "leave it out",
            ),
        ]
    )
    raster = part.raster
    holes, notes = _find_in_drawing(part) if raster is None else _find_in_picture(part, raster)
    chosen = [h for h in holes if not h.diameter or smallest <= h.diameter <= largest]
    if not chosen:
        count = f"no hole to drill among {len(holes)} found"
        what = count if holes else "no + mark, ring or circle to drill"
        raise InputError(
            part.source,
            what,
            remedy="camgen inspect shows what the file holds; see operation.holes",
        )
    if len(chosen) < len(holes):
        why = f"operation.holes is {short(smallest, 3)} to {short(largest, 3)} mm"
        what = counted(
            len(holes) - len(chosen), "circle of another diameter", "circles of other diameters"
        )
        notes.append(Note("assumed", f"{what} not drilled", why))
    least = _compute_width(job)
    narrow = [hole for hole in chosen if hole.contours and _is_narrower(hole, least)]
    if narrow:
        why = f"the tool is {short(least, 3)} mm wide at the top face"
        notes.append(note_left_holes(narrow, "drilled, smaller than the tool", why))
        chosen = [hole for hole in chosen if not hole.contours or not _is_narrower(hole, least)]
    return tuple(_make_path(hole, job) for hole in chosen), (*notes, *_note_diameters(chosen, job))


def _is_narrower(hole: Hole, diameter: float) -> bool:
    """Whether a cut of `diameter`, mm, is wider than the contour of a hole."""
    return hole.diameter + 2 * hole.deviation < diameter - _SAME_MM


def note_left_holes(holes: Sequence[Hole], how: str, why: str) -> Note:
    """A note on circles that are not worked, with the names of the first ones.

    how: such as "drilled, smaller than the tool".
    """
    ids = tuple(chain.from_iterable(hole.contours for hole in holes))
    names = ", ".join(f"{hole.id} of {short(hole.diameter, 3)} mm" for hole in holes[:_NAMED])
    more = " ..." if len(holes) > _NAMED else ""
    return Note(
        "skipped",
        f"{counted(len(holes), 'circle')} not {how}: {names}{more}",
        why,
        ids,
        tuple((hole.x, hole.y) for hole in holes),
    )


def _compute_width(job: Job) -> float:
    """The width of the cut at the top face, mm; 0 for a touch without a depth."""
    tool, depth = job.tool, job.operation.depth
    if not depth or tool.kind != "v":
        return tool.diameter if depth else 0.0
    half = math.radians(tool.tip_angle if tool.tip_angle is not None else 90.0) / 2
    return min(tool.tip_diameter + 2 * depth * math.tan(half), tool.diameter)


def read_diameters(job: Job) -> tuple[float, float]:
    """Smallest and largest diameter that `operation.holes` chooses, mm; 0 and inf without it.

    Raises JobError for an invalid range.
    """
    values = job.operation.holes
    if values is None:
        return 0.0, np.inf
    if len(values) != 2 or not 0 <= values[0] <= values[1]:
        raise JobError(
            "job", f"{values} is not a range of diameters", "operation.holes", "give [from, to], mm"
        )
    return values[0], values[1]


def _find_in_picture(part: Part, raster: Raster) -> tuple[list[Hole], list[Note]]:
    """The + marks, and the rings: circles without ink in their centre."""
    from camgen.vision.crosses import find_crosses  # noqa: PLC0415 (it loads OpenCV)

    work_from_view = raster.work_from_view
    layer = part.contours[0].layer if part.contours else ""
    crosses = [(cross.u, cross.v) for cross in find_crosses(raster.mask, raster.view)]
    marks = _to_work(np.array(crosses).reshape(-1, 2), work_from_view)
    holes = [Hole(x, y, 0.0, layer, f"mark{k}") for k, (x, y) in enumerate(marks.tolist(), 1)]
    if not raster.borders:
        return holes, []
    points = np.concatenate(raster.borders)
    owner = list_owners(count_rows(raster.borders))
    centre, radius, deviation = _fit_circles(points, owner, len(raster.borders))
    is_large = 2 * radius >= _MIN_RING_PX
    height, width = raster.mask.shape
    pixel = np.rint(centre).astype(np.int64).clip(0, (width - 1, height - 1))
    is_hollow = is_large & (raster.mask[pixel[:, 1], pixel[:, 0]] == 0)
    is_round = deviation <= np.maximum(_DEVIATION_PX, 2 * _DEVIATION_FRACTION * radius)
    rings = np.flatnonzero(is_hollow & is_round)
    centre_mm = _to_work(centre, work_from_view)
    diameter_mm = 2 * radius * float(np.hypot(*work_from_view[:, 0]))
    # The outer border of a ring has no ink in its centre either.
    rings = rings[_find_innermost(centre_mm[rings], diameter_mm[rings])]
    for number, k in enumerate(rings.tolist(), 1):
        x, y = centre_mm[k].tolist()
        holes.append(Hole(x, y, float(diameter_mm[k]), layer, f"hole{number}"))
    return holes, list(_note_not_round(centre_mm[is_hollow & ~is_round], holes))


def _to_work(pixels: FloatArray, work_from_view: FloatArray) -> FloatArray:
    return np.asarray(pixels @ work_from_view[:, :2].T + work_from_view[:, 2])


def _note_not_round(centres: FloatArray, holes: Sequence[Hole]) -> Iterator[Note]:
    """A note on spaces without ink that are not circles, except the borders around drilled holes.

    centres: (N, 2) of the spaces, mm.
    """
    table = _tabulate_holes(holes)
    distances = np.linalg.norm(centres[:, None] - table[None, :, :2], axis=2)
    count = int((distances > np.maximum(table[:, 2], 1.0)).all(axis=1).sum())
    if count:
        spaces = counted(
            count,
            "space in the ink is not a circle and is",
            "spaces in the ink are not circles and are",
        )
        why = f"they leave one by more than {short(_DEVIATION_PX, 2)} px"
        yield Note("assumed", f"{spaces} not drilled", why)


def find_circles(part: Part) -> Iterator[Hole]:
    """All circles of a drawing that the operation works on."""
    closed = select_closed(take_rows(part.contours, part.list_worked_rows()))
    if not closed:
        return
    segments = make_contour_segments(closed)
    fractions = (0.0, 0.5)  # a line is farthest from the circle at its ends or in its middle
    points = np.concatenate([points_at(segments, np.full(len(segments), f)) for f in fractions])
    owner = np.tile(segments.owner, len(fractions))
    centre, radius, deviation = _fit_circles(points, owner, len(closed))
    is_round = deviation <= np.maximum(_DEVIATION_MM, _DEVIATION_FRACTION * radius)
    is_full = _has_circle_area(*flatten(segments, _DEVIATION_MM), radius, len(closed))
    for k in np.flatnonzero(is_round & is_full).tolist():
        contour, (x, y) = closed[k], centre[k].tolist()
        diameter, error = float(2 * radius[k]), float(deviation[k])
        yield Hole(x, y, diameter, contour.layer, contour.id, (contour.id,), error)


def select_innermost(holes: Sequence[Hole]) -> list[Hole]:
    """The smallest hole of each centre, in order."""
    table = _tabulate_holes(holes)
    return take_rows(holes, _find_innermost(table[:, :2], table[:, 2]))


def _tabulate_holes(holes: Sequence[Hole]) -> FloatArray:
    """Centre and diameter of each hole, (H, 3), mm."""
    return np.array([(hole.x, hole.y, hole.diameter) for hole in holes]).reshape(-1, 3)


def _find_in_drawing(part: Part) -> tuple[list[Hole], list[Note]]:
    circles = list(find_circles(part))
    holes = select_innermost(circles)
    pads = len(circles) - len(holes)
    others = len(part.list_worked_rows()) - len(circles)
    notes = []
    if pads:
        what = counted(
            pads, "circle around a hole taken for a pad", "circles around holes taken for pads"
        )
        notes.append(Note("assumed", what, "the smallest of a centre is drilled"))
    if others:
        what = counted(others, "contour is not a circle and is", "contours are not circles and are")
        notes.append(Note("assumed", f"{what} not drilled"))
    return holes, notes


def _fit_circles(
    points: FloatArray, owner: IntArray, count: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Fit circles by least squares (Kasa) through the `points` (N, 2) of each owner.

    Returns centres (count, 2), radii and largest deviations (count,).
    """
    size = np.bincount(owner, minlength=count)
    mean = np.column_stack([np.bincount(owner, column, count) / size for column in points.T])
    x, y = (points - mean[owner]).T
    square = x * x + y * y
    weights = (x * x, x * y, y * y, x * square, y * square, square)
    xx, xy, yy, xs, ys, s = (np.bincount(owner, weight, count) for weight in weights)
    det = 2 * np.where(xx * yy > xy * xy, xx * yy - xy * xy, np.inf)
    u, v = (xs * yy - ys * xy) / det, (ys * xx - xs * xy) / det
    radius = np.sqrt(u * u + v * v + s / size)
    centre = mean + np.column_stack([u, v])
    deviation = np.zeros(count)
    np.maximum.at(deviation, owner, np.abs(np.hypot(*(points - centre[owner]).T) - radius[owner]))
    return centre, radius, deviation


def _has_circle_area(
    points: FloatArray, owner: IntArray, radius: FloatArray, count: int
) -> BoolArray:
    """(count,) true for loops that enclose the area of a circle: an arc there and back does not."""
    a = points - points[np.searchsorted(owner, np.arange(count))][owner]
    b = a[find_following_rows(np.bincount(owner, minlength=count))]
    area = np.abs(np.bincount(owner, a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], count)) / 2
    return np.asarray(np.abs(area / (np.pi * radius**2) - 1) < 0.1)


def _find_innermost(centre: FloatArray, radius: FloatArray) -> IntArray:
    from shapely import STRtree, points  # noqa: PLC0415 (loaded only by what needs it)

    centres = points(centre)
    first, second = STRtree(centres).query(centres, predicate="dwithin", distance=_SAME_HOLE_MM)
    is_smaller = radius[second] < radius[first]
    is_smaller |= (radius[second] == radius[first]) & (second < first)
    return np.setdiff1d(np.arange(len(centre)), first[is_smaller])


def _make_path(hole: Hole, job: Job) -> ToolPath:
    """Down at the feed and up again at the travel speed, peck by peck; a touch without a depth."""
    levels, clear = _plan_pecks(job), job.process.approach
    feed, travel = job.process.feed, job.process.travel_speed
    motions = [(0.0, feed)]
    for k, level in enumerate(levels):
        if k:
            motions.append((clear, travel))
            resumed = levels[k - 1] + PECK_CLEARANCE_MM
            if resumed < clear:
                motions.append((resumed, travel))
        motions.append((level, feed))
    if levels:
        motions.append((0.0, travel))
    z, speeds = np.array(motions).T
    position = np.column_stack(np.broadcast_arrays(hole.x, hole.y, z))
    return ToolPath(
        id=hole.id,
        layer=hole.layer,
        table=make_waypoints(position=position, via=np.nan, feed=speeds),
        closed=False,
        reversible=False,
        contours=hole.contours,
        operation="drill",
    )


def _plan_pecks(job: Job) -> list[float]:
    """Heights at which the pecks end, mm, below 0; empty without a depth.

    No peck is deeper than the depth divided by `operation.passes`. The first one is counted from
    the approach height, as by the cycle G83, if it reaches the material then.
    """
    depth, count = job.operation.depth, job.operation.passes
    if not depth:
        return []
    step, above = depth / count, job.process.approach
    first = above if count > 1 and above < step else 0.0
    count = math.ceil((first + depth) / step - 1e-6)
    return [*(first - np.arange(1, count) * step).tolist(), -depth]


def _note_diameters(holes: Sequence[Hole], job: Job) -> Iterator[Note]:
    steps = np.round(_tabulate_holes(holes)[:, 2] / _DIAMETER_STEP_MM)
    sizes = Counter((steps * _DIAMETER_STEP_MM).tolist())
    counts = []
    others = 0
    for size, count in sorted(sizes.items()):
        at_marks = counted(count, "at a mark", "at marks")
        counts.append(f"{count} of {short(size, 2)} mm" if size else at_marks)
        if size and abs(size - job.tool.diameter) > _DIAMETER_STEP_MM:
            others += count
    if holes:
        what = f"{counted(len(holes), 'hole')}: {', '.join(counts)}"
        yield Note("assumed", what, "sizes to 0.05 mm")
    if others:
        drawn = counted(others, "hole is drawn", "holes are drawn")
        yield Note(
            "warning",
            f"{drawn} wider or narrower than the tool of {short(job.tool.diameter, 3)} mm",
            "choose holes with operation.holes, or another tool",
        )
