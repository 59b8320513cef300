"""Holes: at + marks and in rings of a picture, at the circles of a drawing ("Continuous path following", section 4).

A hole is a tool path that goes straight down and comes up again. Its first point is on the top face, where the signal
is switched, so the way through the air and the order of the holes are those of all other paths.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import following
from camgen.geometry.segments import BoolArray, IntArray, flatten, from_contours, points_at
from camgen.model.errors import InputError, JobError
from camgen.model.job import Job
from camgen.model.part import Note, Part, Raster
from camgen.model.path import ToolPath, waypoints
from camgen.model.pose import FloatArray
from camgen.model.text import counted, short
from camgen.model.tolerance import PECK_CLEARANCE_MM

#: A loop is a circle when it leaves one by no more than this, mm, or this share of its radius; of a picture, px.
_OFF, _SHARE, _OFF_PX = 0.01, 0.01, 0.75
#: Circles with centres nearer than this, mm, are one hole and the pad around it.
_SAME_HOLE_MM = 0.05
#: Diameters are told apart to this, mm.
_GAUGE = 0.05
#: Smaller rings of a picture are noise, px.
_LEAST_PX = 4.0


class Hole(Struct, frozen=True):
    """x, y: mm, work frame. diameter: mm, 0 for a mark. contours: the id of the circle in a drawing."""

    x: float
    y: float
    diameter: float
    layer: str
    id: str
    contours: tuple[str, ...] = ()


def drill(part: Part, job: Job) -> tuple[tuple[ToolPath, ...], tuple[Note, ...]]:
    """A path for every hole, in the order of the input, and notes on how many there are of each diameter.

    ``operation.passes`` are pecks: the tool comes up to the height of approach after each. Raises InputError where
    there is no hole, JobError for settings that make no sense.
    """
    lowest, highest = diameters(job)
    if job.process.force:
        raise JobError(
            "job",
            "a drill goes to a depth, not to a force",
            "process.force",
            "set process.force to 0",
        )
    if job.process.plunge is not None:
        raise JobError("job", "a drill goes down at process.feed", "process.plunge", "leave it out")
    found, notes = _in_picture(part, part.raster) if part.raster is not None else _in_drawing(part)
    wanted = [h for h in found if not h.diameter or lowest <= h.diameter <= highest]
    if not wanted:
        what = (
            f"no hole to drill among {len(found)} found"
            if found
            else "no + mark, ring or circle to drill"
        )
        raise InputError(
            part.source,
            what,
            remedy="camgen inspect shows what the file holds; see operation.holes",
        )
    if len(wanted) < len(found):
        why = f"operation.holes is {short(lowest, 3)} to {short(highest, 3)} mm"
        what = counted(
            len(found) - len(wanted), "circle of another diameter", "circles of other diameters"
        )
        notes.append(Note("assumed", f"{what} not drilled", why))
    return tuple(_path(hole, job) for hole in wanted), (*notes, *_describe(wanted, job))


def diameters(job: Job) -> tuple[float, float]:
    """From which diameter to which ``operation.holes`` chooses circles, mm; all without it. JobError for no range."""
    values = job.operation.holes
    if values is None:
        return 0.0, np.inf
    if len(values) != 2 or not 0 <= values[0] <= values[1]:
        raise JobError("job", f"{values} is no range", "operation.holes", "give [from, to], mm")
    return values[0], values[1]


def _in_picture(part: Part, raster: Raster) -> tuple[list[Hole], list[Note]]:
    """Marks, and holes of rings: circles whose middle is no ink."""
    from camgen.vision.crosses import find_crosses  # noqa: PLC0415 (OpenCV is loaded only by what needs it)

    place = raster.work_from_view
    layer = part.contours[0].layer if part.contours else ""
    marks = (
        np.array([(c.u, c.v) for c in find_crosses(raster.mask, raster.view)]).reshape(-1, 2)
        @ place[:, :2].T
        + place[:, 2]
    )
    found = [Hole(x, y, 0.0, layer, f"mark{k}") for k, (x, y) in enumerate(marks.tolist(), 1)]
    if raster.borders:
        points = np.concatenate(raster.borders)
        owner = np.repeat(np.arange(len(raster.borders)), [len(b) for b in raster.borders])
        centre, radius, off = _fit_circles(points, owner, len(raster.borders))
        large = 2 * radius >= _LEAST_PX
        height, width = raster.mask.shape
        at = np.rint(centre).astype(np.int64).clip(0, (width - 1, height - 1))
        hollow = large & (raster.mask[at[:, 1], at[:, 0]] == 0)
        round_ = off <= np.maximum(_OFF_PX, 2 * _SHARE * radius)
        rings = np.flatnonzero(hollow & round_)
        middle = centre @ place[:, :2].T + place[:, 2]
        size = 2 * radius * float(np.hypot(*place[:, 0]))
        # The outer border of a ring has no ink in its middle either.
        rings = rings[_innermost(middle[rings], size[rings])]
        found += [
            _hole(middle[k], size[k], layer, f"hole{n}") for n, k in enumerate(rings.tolist(), 1)
        ]
        return found, _not_round(middle[hollow & ~round_], found)
    return found, []


def _not_round(middles: FloatArray, found: Sequence[Hole]) -> list[Note]:
    """What has no ink in its middle (N, 2) and is no circle, but for the borders around what is drilled."""
    places = np.array([(hole.x, hole.y) for hole in found]).reshape(-1, 2)
    near = np.array([max(hole.diameter, 1.0) for hole in found])
    apart = np.linalg.norm(middles[:, None] - places[None], axis=2)
    count = int((apart > near).all(axis=1).sum())
    why = f"they leave one by more than {short(_OFF_PX, 2)} px"
    spaces = counted(
        count, "space in the ink is no circle and is", "spaces in the ink are no circles and are"
    )
    return [Note("assumed", f"{spaces} not drilled", why)] if count else []


def find_circles(part: Part) -> list[Hole]:
    """All circles of a drawing that are worked on."""
    closed = [c for c in part.contours if c.closed and part.works_on(c.sources or (c.id,))]
    if not closed:
        return []
    segments = from_contours(closed)
    parts = (0.0, 0.25, 0.5, 0.75)
    points = np.concatenate([points_at(segments, np.full(len(segments), f)) for f in parts])
    centre, radius, off = _fit_circles(points, np.tile(segments.owner, len(parts)), len(closed))
    turns = _whole(*flatten(segments, _OFF), radius, len(closed))
    rows = np.flatnonzero((off <= np.maximum(_OFF, _SHARE * radius)) & turns).tolist()
    return [
        _hole(centre[k], 2 * radius[k], closed[k].layer, closed[k].id, closed[k].id) for k in rows
    ]


def innermost(holes: Sequence[Hole]) -> list[Hole]:
    """Of those about one centre the smallest, in order."""
    rows = _innermost(
        np.array([(h.x, h.y) for h in holes]).reshape(-1, 2), np.array([h.diameter for h in holes])
    )
    return [holes[k] for k in rows.tolist()]


def _in_drawing(part: Part) -> tuple[list[Hole], list[Note]]:
    """Circles; of those about one centre the smallest."""
    every = find_circles(part)
    found = innermost(every)
    pads = len(every) - len(found)
    other = sum(part.works_on(c.sources or (c.id,)) for c in part.contours) - len(every)
    notes = []
    if pads:
        what = f"{counted(pads, 'circle around a hole taken for a pad', 'circles around holes taken for pads')}"
        notes.append(Note("assumed", what, "the smallest of a centre is drilled"))
    if other:
        what = counted(other, "contour is no circle and is", "contours are no circles and are")
        notes.append(Note("assumed", f"{what} not drilled"))
    return found, notes


def _hole(centre: FloatArray, diameter: float, layer: str, name: str, *contours: str) -> Hole:
    x, y = centre.tolist()
    return Hole(x, y, float(diameter), layer, name, contours)


def _fit_circles(
    points: FloatArray, owner: IntArray, count: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Circles by least squares through the ``points`` (N, 2) of each owner: centres, radii, largest errors."""
    size = np.bincount(owner, minlength=count)
    mean = np.column_stack([np.bincount(owner, column, count) / size for column in points.T])
    x, y = (points - mean[owner]).T
    square = x * x + y * y
    xx, xy, yy, xs, ys, s = (
        np.bincount(owner, c, count) for c in (x * x, x * y, y * y, x * square, y * square, square)
    )
    det = 2 * np.where(xx * yy > xy * xy, xx * yy - xy * xy, np.inf)
    u, v = (xs * yy - ys * xy) / det, (ys * xx - xs * xy) / det
    radius = np.sqrt(u * u + v * v + s / size)
    centre = mean + np.column_stack([u, v])
    off = np.zeros(count)
    np.maximum.at(off, owner, np.abs(np.hypot(*(points - centre[owner]).T) - radius[owner]))
    return centre, radius, off


def _whole(points: FloatArray, owner: IntArray, radius: FloatArray, count: int) -> BoolArray:
    """Whether the loops enclose what a circle would: an arc there and back encloses nothing."""
    a = points - points[np.searchsorted(owner, np.arange(count))][owner]
    b = a[following(np.bincount(owner, minlength=count))]
    area = np.abs(np.bincount(owner, a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], count)) / 2
    return np.asarray(np.abs(area / (np.pi * radius**2) - 1) < 0.1)


def _innermost(centre: FloatArray, radius: FloatArray) -> IntArray:
    """The rows of the smallest circle about each centre, in order."""
    from shapely import STRtree, points  # noqa: PLC0415 (loaded only by what needs it)

    if not len(centre):
        return np.zeros(0, dtype=np.int64)
    places = points(centre)
    one, two = STRtree(places).query(places, predicate="dwithin", distance=_SAME_HOLE_MM)
    smaller = (radius[two] < radius[one]) | ((radius[two] == radius[one]) & (two < one))
    return np.setdiff1d(np.arange(len(centre)), one[smaller])


def _path(hole: Hole, job: Job) -> ToolPath:
    """Down at the feed and up again at the speed of travel, peck by peck; without a depth one touch."""
    levels, clear = _levels(job), job.process.approach
    way = [(0.0, job.process.feed)]
    for k, level in enumerate(levels):
        if k:
            way.append((clear, job.process.travel_speed))
            again = levels[k - 1] + PECK_CLEARANCE_MM
            way += [(again, job.process.travel_speed)] if again < clear else []
        way.append((level, job.process.feed))
    way += [(0.0, job.process.travel_speed)] if levels else []
    z, feed = np.array(way).T
    return ToolPath(
        id=hole.id,
        layer=hole.layer,
        table=waypoints(
            position=np.array([[hole.x, hole.y, level] for level in z]),
            via=np.nan,
            feed=feed,
        ),
        closed=False,
        reversible=False,
        contours=hole.contours,
        operation="drill",
    )


def _levels(job: Job) -> list[float]:
    """How deep each peck ends, mm, below 0. None is deeper than the depth shared out among ``operation.passes``.

    The first one begins at the height of approach, as that of the cycle G83 does, where it reaches the material then.
    """
    depth, count = job.operation.depth, job.operation.passes
    if not depth:
        return []
    step, above = depth / count, job.process.approach
    first = above if count > 1 and above < step else 0.0
    count = math.ceil((first + depth) / step - 1e-6)
    return [*(first - k * step for k in range(1, count)), -depth]


def _describe(holes: Sequence[Hole], job: Job) -> list[Note]:
    """How many holes of each diameter, and which the tool does not make as wide as they are drawn."""
    sizes = Counter(round(hole.diameter / _GAUGE) * _GAUGE for hole in holes)
    shares = [
        f"{count} of {short(size, 2)} mm" if size else counted(count, "at a mark", "at marks")
        for size, count in sorted(sizes.items())
    ]
    notes = [
        Note("assumed", f"{counted(len(holes), 'hole')}: {', '.join(shares)}", "sizes to 0.05 mm")
    ]
    other = sum(
        count for size, count in sizes.items() if size and abs(size - job.tool.diameter) > _GAUGE
    )
    if other:
        why = "choose holes with operation.holes, or another tool"
        drawn = counted(other, "hole is drawn", "holes are drawn")
        what = f"{drawn} wider or narrower than the tool of {short(job.tool.diameter, 3)} mm"
        notes.append(Note("warning", what, why))
    return notes
