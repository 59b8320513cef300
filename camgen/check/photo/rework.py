"""The rework of burrs: a stretch of contour for each, its passes and its feed.

Under a constant force the same material goes away per second, so that the height that a pass takes
off is as one over the feed. A burr gets as many whole passes as its height has removals, at the
feed at which they take all of it off. That feed is never above the feed of the job, and more than
half of it.

A burr is a bump: each pass runs only where the burr is higher than the passes before it took off.
So the later ones are shorter, and they do not work the part beside the burr.
"""

from __future__ import annotations

import math

import numpy as np
import shapely
from msgspec import Struct

from camgen.check.photo.differences import Difference
from camgen.check.photo.expected import Expected
from camgen.check.photo.registration import Fit
from camgen.model.errors import JobError, NoSafeProgram
from camgen.model.job import Job
from camgen.model.pose import FloatArray
from camgen.model.tolerance import BESIDE_WORKED_MM

#: Most passes over a burr. A pass of less than a twentieth of the highest burr, 3 mm, is about as
#: small as the error of a height, 0.05 mm: it is not known then how many passes there must be.
MOST_PASSES = 20
#: Between the places where the tool meets a burr and where it comes down, mm: the error of the ends
#: of a burr, 0.33 mm on the photos of `bench.photo.burrs`, and the room to come down beside it.
BESIDE = 1.0
#: That distance for a pass which is reached at working height, over ground already worked, mm: the
#: error of the ends alone.
NEXT_TO = 0.35
#: A pass also runs where the burr is lower than the removed height by this, mm: the error of its
#: height.
SURE = 0.05
#: A pass has the stretch of the one before it unless it is shorter by this, mm.
SHORTER = 0.2
#: Length of run-in and run-out, mm, if the job has none: the force builds up on them.
LEAD = 2.0
#: A photo has the frame of the drawing if the part is turned by less, rad, and moved by less, mm,
#: than a part that is clamped again by hand.
SAME_TURN, SAME_PLACE = 0.17, 5.0
#: The tool may be so deep in the drawn part, mm2 of its sweep, by rounding.
_NOTHING = 0.01
#: The swept area is narrower than the tool by this, mm: chords, and the fit of the photo.
_SLACK = 0.02
#: Chords of a quarter circle of the sweep.
_CHORDS = 32


class Rework(Struct, frozen=True, eq=False):
    """Passes over a burr."""

    #: Its place in the list of differences, from 1.
    number: int
    #: The burr.
    burr: Difference
    #: Speed of the contact point, mm/s.
    feed: float
    #: For each pass (N, 2) points along the contour, mm, the material on the left. The first
    #: stretch is the longest one.
    stretches: tuple[FloatArray, ...]

    @property
    def passes(self) -> int:
        """The number of passes."""
        return len(self.stretches)


#: A warning for jobs without force control.
WITHOUT_FORCE = "process.force is 0: the first pass takes off the whole height of each burr"


class NotReworked(Struct, frozen=True):
    """A difference that is not worked again."""

    #: Its place in the list of differences, from 1.
    number: int
    #: The reason.
    why: str


def plan_passes(height: float, removal: float, feed: float) -> tuple[int, float]:
    """Passes over a burr of ``height`` mm and their feed, mm/s.

    removal: height that a pass takes off at ``feed``, mm.

    >>> plan_passes(0.8, 0.2, 20.0), plan_passes(0.1, 0.2, 20.0)
    ((4, 20.0), (1, 20.0))
    >>> plan_passes(0.5, 0.2, 20.0)
    (2, 16.0)
    """
    passes = max(math.floor(height / removal + 1e-9), 1)
    return passes, feed * min(passes * removal / height, 1.0)


def cut_stretches(
    burr: Difference, expected: Expected, radius: float, passes: int, later: float = BESIDE
) -> tuple[FloatArray, ...]:
    """The stretches (N, 2) of contour on which the passes of a tool of ``radius`` mm work ``burr``.

    The material is on their left. They reach from the place where the tool meets the rest of the
    burr to the place where it leaves it, and `BESIDE` beyond. A stretch is at most its contour.
    later: length beyond, mm, of the passes after the first one.
    """
    ring = _material_left(expected.rings[expected.names.index(burr.contour)], expected.region)
    line = shapely.LineString(np.concatenate([ring, ring[:1]]))
    centres = _offset(line, radius)
    stretches: list[FloatArray] = []
    for done in range(passes):
        gone = max(burr.height * done / passes - SURE, 0.0)
        rest = _wear(burr.shape, line, gone) if gone else burr.shape
        begin, length = _find_contact(line, centres, rest, radius)
        margin = later if done else BESIDE
        reach = min(length + 2 * margin, line.length)
        stretch = _along(ring, line, (begin - margin) % line.length, reach)
        if stretches and _measure_length(stretches[-1]) - _measure_length(stretch) < SHORTER:
            stretch = stretches[-1]
        stretches.append(stretch)
    return tuple(stretches)


def _measure_length(points: FloatArray) -> float:
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def _wear(shape: shapely.Geometry, line: shapely.Geometry, gone: float) -> shapely.Geometry:
    """The rest of a burr from which passes took off ``gone`` mm everywhere: lower, and shorter."""
    high = shapely.difference(shape, shapely.buffer(line, gone, quad_segs=_CHORDS))
    places = shapely.get_coordinates(high)
    at = shapely.line_locate_point(line, shapely.points(places))
    feet = shapely.get_coordinates(shapely.line_interpolate_point(line, at))
    heights = np.maximum(np.linalg.norm(places - feet, axis=1), gone)[:, None]
    return shapely.set_coordinates(high, feet + (places - feet) * (1 - gone / heights))


def _find_contact(
    line: shapely.Geometry, centres: shapely.Geometry, shape: shapely.Geometry, radius: float
) -> tuple[float, float]:
    """The place at which a tool of ``radius`` mm meets a shape, and the length of the contact.

    Both are mm along the closed ``line``. centres: the path of the tool's centre.
    """
    meeting = shapely.intersection(centres, shapely.buffer(shape, radius, quad_segs=_CHORDS))
    points = [shapely.get_coordinates(each) for each in (shape, meeting)]
    at = np.sort(shapely.line_locate_point(line, shapely.points(np.concatenate(points))))
    gaps = np.append(np.diff(at), at[0] + line.length - at[-1])
    return float(at[(int(gaps.argmax()) + 1) % len(at)]), line.length - float(gaps.max())


def _offset(line: shapely.Geometry, radius: float) -> shapely.Geometry:
    return shapely.offset_curve(line, -radius, quad_segs=_CHORDS, join_style="round")


def is_clear(stretch: FloatArray, region: shapely.Geometry, radius: float) -> bool:
    """Whether a tool of ``radius`` mm on the right of ``stretch`` keeps clear of the drawn part."""
    path = _offset(shapely.LineString(stretch), radius)
    swept = shapely.buffer(path, radius - _SLACK, quad_segs=_CHORDS)
    return not path.is_empty and shapely.intersection(swept, region).area < _NOTHING


def plan_burr(
    number: int, burr: Difference, expected: Expected, job: Job, removal: float
) -> Rework | NotReworked:
    """The rework of a burr. Raises JobError if it needs too many passes."""
    passes, feed = plan_passes(burr.height, removal, job.process.feed)
    if passes > MOST_PASSES:
        x, y = burr.place
        what = f"{removal:g} mm would make {passes} passes over the burr "
        what += f"of {burr.height:.2f} mm at {x:.2f}, {y:.2f}"
        least = burr.height / MOST_PASSES
        remedy = f"take a tool, a force or a feed that takes off {least:.2g} mm a pass or more"
        raise JobError("--removal", what, f"{MOST_PASSES} at most", remedy)
    later = NEXT_TO if stays_down(job) else BESIDE
    stretches = cut_stretches(burr, expected, job.tool.radius, passes, later)
    if not is_clear(stretches[0], expected.region, job.tool.radius):
        return NotReworked(number, f"a {job.tool.diameter:g} mm tool does not fit beside it")
    return Rework(number, burr, feed, stretches)


def stays_down(job: Job) -> bool:
    """Whether the tool stays at working height between the passes over a burr.

    A tool under force is lifted after each pass, and so is one that is turned about its axis.
    """
    tool = job.tool
    is_turned = tool.orient != "fixed" or tool.symmetric or tool.turn is not None
    return not (job.process.force or is_turned)


def is_in_the_way(stretch: FloatArray, loose: shapely.Geometry, job: Job) -> bool:
    """Whether the tool may touch a loose thing: on run-in, run-out, or its return."""
    width = max(job.operation.lead_in, job.operation.lead_out, LEAD, BESIDE_WORKED_MM)
    reach = job.tool.diameter + width
    return bool(shapely.distance(shapely.LineString(stretch), loose) < reach)


def check_following(job: Job, kind: str) -> None:
    """Raises JobError for a job that follows no contours, or has several operations."""
    if job.operations:
        remedy = "give --against the job that deburrs, with an [operation] alone"
        raise JobError("--rework", "the job of the drawing has several operations", remedy=remedy)
    if kind != "follow":
        remedy = 'set operation.kind to "follow"'
        raise JobError("--rework", f"works along contours, and this job is {kind}", remedy=remedy)


def check_pose(photo: str, fit: Fit, region: shapely.Geometry) -> None:
    """Raises NoSafeProgram for a part of several like sides that lies otherwise than drawn.

    The frame of the photo is that of the drawing if the part lies as drawn.
    Then the nearest turn is right.
    """
    if not fit.rivals:
        return
    middle = shapely.get_coordinates(shapely.centroid(region))
    moved = float(np.linalg.norm(fit.apply(middle) - middle))
    if abs(fit.turn) > SAME_TURN or moved > SAME_PLACE:
        what = "the part looks the same from several sides, so that a burr may be on another one"
        remedy = "take the photo in the work frame, with the part as it is clamped"
        raise NoSafeProgram(photo, what, "--rework", remedy)


def _material_left(ring: FloatArray, region: shapely.Geometry) -> FloatArray:
    """The ring (N, 2) run so that ``region`` is on its left."""
    longest = int(np.argmax(np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1)))
    start, end = ring[longest], ring[(longest + 1) % len(ring)]
    along = (end - start) / np.linalg.norm(end - start)
    x, y = (start + end) / 2 + 0.01 * np.array([-along[1], along[0]])
    return ring if shapely.contains_xy(region, x, y) else ring[::-1]


def _along(ring: FloatArray, line: shapely.Geometry, begin: float, length: float) -> FloatArray:
    """The points (N, 2) of ``line``, the closed ``ring``, from ``begin`` mm on."""
    steps = np.linalg.norm(np.diff(np.concatenate([ring, ring[:1]]), axis=0), axis=1)
    ahead = (np.concatenate([[0.0], np.cumsum(steps)[:-1]]) - begin) % line.length
    order = np.argsort(ahead, kind="stable")
    order = order[(ahead[order] > 1e-6) & (ahead[order] < length - 1e-6)]
    ends = shapely.line_interpolate_point(line, [begin, (begin + length) % line.length])
    first, last = shapely.get_coordinates(ends)
    return np.concatenate([[first], ring[order], [last]])
