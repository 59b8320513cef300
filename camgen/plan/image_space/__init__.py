"""The planner of the PIST paper: from the mask of a part in a to-scale view to tool paths, all of it in image space.

MacMillan, Irani, Ahmadi: Planar image-space trajectory planning algorithm for contour following in robotic machining.
Sections in square brackets and equations are that paper's. The pieces: `field` has the
distance image, `border` the border between the pixels, `tool_path` the path of the tool centre
beside the part, `stretches` the pieces over which the observed feed is averaged.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import ramp
from camgen.geometry.rings import (
    ComplexArray,
    Rings,
    find_latest,
    make_rings,
    measure_perimeters,
    measure_steps,
    unit,
)
from camgen.geometry.segments import BoolArray, IntArray, make, reverse_segments
from camgen.geometry.vectors import nearest_row
from camgen.model.errors import InputError, JobError
from camgen.model.job import Job
from camgen.model.part import Note
from camgen.model.path import ToolPath
from camgen.model.pose import FloatArray
from camgen.model.text import counted
from camgen.plan.columns import Label, SegmentWork, pass_depths, tool_paths
from camgen.plan.image_space.border import Border, between_pixels, border
from camgen.plan.image_space.field import Field, Pixels, chains, field, sample_field
from camgen.plan.image_space.stretches import steady_ratio
from camgen.plan.image_space.tool_path import (
    ANGLE_NOISE,
    PIXEL_NOISE,
    Limits,
    PixelWay,
    check_reach,
    choose_needed,
    contact_points,
    feeds,
    iso_way,
    moving,
    nearest,
    observe,
    pixel_way,
    place_borders,
    sharpen,
    slowed,
    smooth,
    spaced,
    standing_below,
    touching,
)
from camgen.vision.similarity import measure_scale

# What the paths of an image are called, and notes on what they leave out.

#: What an image has instead of layers.
_LAYER = "image"
#: A length (px) that is not reached is told from here on: the resolution at two ends.
_TOLD = 4.0


def beside_which(edge: Border, table: Rings, points: ComplexArray, touched: IntArray) -> IntArray:
    """(L,) the border of the part that each path touches most often. touched: (N,) row of `edge` or -1.

    A path that touches nothing, only just fitting in, is beside the border that is nearest to its first point.
    """
    borders = len(edge.table.count)
    row = np.flatnonzero(touched >= 0)
    key = table.loop[row] * borders + edge.table.loop[touched[row]]
    often = np.bincount(key, minlength=len(table.count) * borders).reshape(-1, borders)
    main: IntArray = np.argmax(often, axis=1)
    for k in np.flatnonzero(~often.any(axis=1)).tolist():
        main[k] = edge.table.loop[nearest_row(edge.points, points[table.first[k]])]
    return main


def labels(main: IntArray, parent: IntArray, sound: BoolArray) -> list[Label | None]:
    """The paths by the border that each runs beside: `c1`, or `c1.1`, `c1.2` where that border has several; None
    for those that are not `sound`, and what they enclose is inside what they are inside of.
    """
    several = np.bincount(main[sound], minlength=1) > 1
    place = np.where(sound, np.cumsum(sound) - 1, -1).tolist()
    seen = [0] * len(several)
    result: list[Label | None] = []
    for k, (on, good) in enumerate(zip(main.tolist(), sound.tolist(), strict=True)):
        if not good:
            result.append(None)
            continue
        seen[on] += 1
        name = f"c{on + 1}.{seen[on]}" if several[on] else f"c{on + 1}"
        around = int(parent[k])
        while around >= 0 and place[around] < 0:
            around = int(parent[around])
        result.append(
            Label(name, _LAYER, True, False, place[around] if around >= 0 else -1, (f"c{on + 1}",))
        )
    return result


def left_out(
    edge: Border, reached: BoolArray, main: IntArray, sound: BoolArray, job: Job, mm_per_px: float
) -> list[Note]:
    """Notes on borders that have no path, and on the length that no tool of this size can touch.

    reached: (N,) of `edge`, whether the tool may stand where it would touch that point. main: `beside_which`.
    sound: (L,) false for paths that did not keep their distance.
    """
    tool = f"a {job.tool.diameter:g} mm tool" + (
        f" with corner radius {job.operation.corner_radius:g}"
        if job.operation.corner_radius
        else ""
    )
    count = len(edge.table.count)
    followed = np.isin(np.arange(count), main[sound])
    failed = np.isin(np.arange(count), main[~sound])
    # A border beside which no path runs for longest may still be touched by the one around a near neighbour.
    touched = np.bincount(edge.table.loop, reached, count) > 0
    why = "the path did not keep its distance; use waypoints that are closer together, or report it"
    notes = [
        not_followed(np.flatnonzero(which), how, reason)
        for which, how, reason in (
            (~followed & ~failed & ~touched, "too narrow", f"{tool} does not fit"),
            (failed, "check failed", why),
        )
        if which.any()
    ]
    length = measure_steps(edge.table, edge.points) * mm_per_px
    whole = float(length.sum())
    missing = np.where(
        touched & ~failed, np.bincount(edge.table.loop, np.where(reached, 0.0, length), count), 0.0
    )
    total = float(missing.sum())
    if total > max(1e-3 * whole, _TOLD * mm_per_px):
        worst = int(np.argmax(missing)) + 1
        what = f"{total:.4g} mm of {whole:.6g} mm of contour not touched, most of it on c{worst}"
        notes.append(
            Note("warning", what, f"inner corners and narrow places that {tool} does not reach")
        )
    return notes


def not_followed(borders: IntArray, how: str, why: str) -> Note:
    """One note on borders that have no path, the first of them by name."""
    ids = [f"c{k + 1}" for k in borders.tolist()]
    names = ", ".join(ids[:8]) + (" ..." if len(ids) > 8 else "")
    what = f"{counted(len(ids), 'contour')} not followed, {how}: {names} on layer {_LAYER}"
    return Note("skipped", what, why, tuple(ids))


#: Below this many pixels the tool's radius is not resolved.
_LEAST_RADIUS_PX = 1.5
#: Gap (px) between contact point and part from which contact is lost: to the exact border, and to pixel centres.
_CONTACT_GAP_PX, _PIXEL_GAP = 1.0, 2.0
#: Where the feed changes by more than this share, a waypoint stays.
_FEED_STEP = 0.02


class _Waypoints(Struct, frozen=True, eq=False):
    """Closed curves of eq. (12), pixels of the field. press: unit vectors of theta_f. feed: as a multiple of the
    nominal one, and force: on or off, both of the segment that ends in the row. spaced: (N,) those at the spacing that
    is asked for; the others lie between them.
    """

    table: Rings
    points: ComplexArray
    force_direction: ComplexArray
    feed: FloatArray
    force: BoolArray
    spaced: BoolArray


def image_space(
    mask_pixels: Pixels,
    work_from_view: FloatArray,
    job: Job,
    *,
    exact: bool = True,
    borders: Sequence[FloatArray] | None = None,
) -> tuple[tuple[ToolPath, ...], tuple[Note, ...]]:
    """Paths around the part in `mask_pixels` ((H, W) uint8, not 0: part) and in its holes, and what is left out.

    work_from_view: (2, 3) similarity, mm of a pixel centre (u, v); v may run against y. exact: the path is an iso-line
    between pixels, normals from the nearest point of the border; else integer pixels and the gradient of the distance
    image, as in the paper. borders: of the part in view pixels, closed (N, 2) without the first point again, where they
    are known better than the mask tells.

    Positions are in the work frame at z = 0, `depths` below it. The removal of redundant waypoints moves the path by
    at most `tolerance.chord`. Raises JobError for settings that an image has no answer to, InputError for a mask or a
    transform that cannot be used.
    """
    mm_per_px = measure_scale(work_from_view)
    distance, radius = job.tool.radius / mm_per_px, job.operation.corner_radius / mm_per_px
    _insist(mask_pixels, job, distance)
    if not mask_pixels.any():
        return (), (Note("skipped", "no part in the mask", "choose another mask"),)
    picture = field(mask_pixels, distance + radius)
    curves = (
        between_pixels(chains(picture.part)) if borders is None else place_borders(borders, picture)
    )
    edge = border(*curves, picture.far.shape)
    way = (
        iso_way(picture, edge, distance, radius) if exact else pixel_way(picture, distance, radius)
    )
    step = max((job.operation.waypoint_spacing or _usual_spacing(job)) / mm_per_px, 1.0)
    points, touched = _waypoints(
        way, edge, None if exact else picture, distance, step, job.process.max_feed_factor
    )
    main = beside_which(edge, points.table, points.points, touched)
    gouge = sample_field(picture.far, points.points) < distance - (
        _CONTACT_GAP_PX if exact else _PIXEL_GAP
    )
    sound = np.bincount(points.table.loop, gouge, len(main)) == 0
    notes = left_out(
        edge, check_reach(way, picture, edge, distance, radius), main, sound, job, mm_per_px
    )
    chain = _chain(
        points,
        Limits(
            np.radians(job.operation.waypoint_turn) * mm_per_px, job.tolerance.chord / mm_per_px
        ),
    )
    return _paths(
        chain, labels(main, way.parent, sound), _move_corner(work_from_view, picture.corner), job
    ), tuple(notes)


def _usual_spacing(job: Job) -> float:
    """mm: the chord that leaves a curve of half the tool's radius by `tolerance.chord`."""
    return math.sqrt(2 * job.tool.diameter * job.tolerance.chord)


def _insist(mask_pixels: Pixels, job: Job, distance: float) -> None:
    """What an image can be asked for."""
    if mask_pixels.ndim != 2 or mask_pixels.dtype != np.uint8:
        raise InputError(
            "mask",
            f"has shape {mask_pixels.shape} of {mask_pixels.dtype}",
            remedy="give (H, W) uint8",
        )
    if job.operation.side != "auto":
        what = f'"{job.operation.side}" is not known to the image-space planner'
        raise JobError("job", what, "operation.side", "set operation.side to auto")
    if distance < _LEAST_RADIUS_PX:
        what = f"{job.tool.diameter:g} mm is {2 * distance:.2g} px of the view"
        raise JobError("job", what, "tool.diameter", "use a larger tool or a finer view")
    rim = (mask_pixels[0], mask_pixels[-1], mask_pixels[:, 0], mask_pixels[:, -1])
    if any(line.any() for line in rim):
        raise InputError(
            "mask", "the part touches the border of the view", remedy="show the whole part"
        )


def _waypoints(
    way: PixelWay, edge: Border, picture: Field | None, distance: float, step: float, fastest: float
) -> tuple[_Waypoints, IntArray]:
    """Waypoints `step` px apart and those between them, with feed and force, and the row (N,) of `edge` that each
    touches, -1 for none.

    picture: where the gap between contact point and part is looked up in the distance image, as the paper does.
    """
    table = way.table
    count = np.clip(
        np.rint(measure_perimeters(table, way.points) / step).astype(np.int64), 8, table.count
    )
    points, press = smooth(table, count, way.points, way.press)
    # Opposite directions may cancel out in the filter; the one before holds.
    press = unit(press)[find_latest(table, np.abs(press) > 1e-6)]
    contact, along, run, touched = _contact(way, edge, picture, distance)
    ratio = steady_ratio(
        table, along, run, (ANGLE_NOISE if picture is None else PIXEL_NOISE) * distance
    )
    below = standing_below(distance)
    ratio = sharpen(table, ratio, along, way.press, below)
    force = contact & moving(table, ratio, below)
    ratio = slowed(table, ratio)
    waypoints = _Waypoints(
        table, points, press, feeds(ratio, contact, fastest), force, spaced(table, count)
    )
    return waypoints, touched


def _contact(
    way: PixelWay, edge: Border, picture: Field | None, distance: float
) -> tuple[BoolArray, FloatArray, FloatArray, IntArray]:
    """Of the segment that ends in each row (N,): whether the tool touches, and by how many px the contact point and the
    tool centre run; and the row of `edge` that is touched at its end, -1 for none.
    """
    table, back = way.table, way.table.shifted(-1)
    tolerance = _CONTACT_GAP_PX if picture is None else _PIXEL_GAP
    contacts = contact_points(way.points, way.press, distance)
    gap, row = _gaps(edge, contacts, picture)
    along, run = observe(table, way.points, contacts)
    half_way = contact_points(
        (way.points + way.points[back]) / 2, unit(way.press + way.press[back]), distance
    )
    far = _gaps(edge, half_way, picture)[0] > tolerance
    # In a sharp inner corner contact leaps from one side to the other: the tool touches both.
    leaps = far | (gap > tolerance) | (gap > tolerance)[back]
    # The way is bent there, within a pixel.
    leaps = leaps | leaps[back] | leaps[table.shifted(1)]
    touches = (
        touching(table, gap, tolerance) if way.back is not None else np.ones(len(table), dtype=bool)
    )
    contact = touches & touches[back]
    return contact, np.where(leaps, run, along), run, np.where(gap <= tolerance, row, -1)


def _gaps(
    edge: Border, contacts: ComplexArray, picture: Field | None
) -> tuple[FloatArray, IntArray]:
    """The gap (N,) px between contact points and part, and the row of `edge` there, -1 where none is near."""
    gap, row = nearest(edge, contacts)
    return (gap if picture is None else sample_field(picture.far, contacts)), row


class _Chain(Struct, frozen=True, eq=False):
    """Straight segments of all curves: begin, end (N,) px, press (N, 2) at both, feed, force, and the curve of each."""

    begin: ComplexArray
    end: ComplexArray
    force_direction: ComplexArray
    feed: FloatArray
    force: BoolArray
    loop: IntArray


def _chain(points: _Waypoints, limits: Limits) -> _Chain:
    """The segments between the waypoints that are needed [3.4.2], each as fast as those that it stands for."""
    count = points.table.count
    closed = make_rings(count + 1)
    row = points.table.first[closed.loop] + ramp(closed.count) % count[closed.loop]
    here, press, force, feed = (
        points.points[row],
        points.force_direction[row],
        points.force[row],
        points.feed[row],
    )
    # A segment ends in its row: what changes after a row changes there.
    switched = np.append(
        (force[1:] != force[:-1]) | (np.abs(np.log(feed[1:] / feed[:-1])) > _FEED_STEP), False
    )
    keep = choose_needed(
        np.append(closed.first, len(closed)), here, press, points.spaced[row], switched, limits
    )
    step = np.append(0.0, np.abs(np.diff(here)))
    run, time = np.cumsum(step), np.cumsum(step / feed)
    vertex = np.flatnonzero(keep)
    low, high = vertex[:-1], vertex[1:]
    same = (closed.loop[low] == closed.loop[high]) & (run[high] > run[low])
    low, high = low[same], high[same]
    feed = (run[high] - run[low]) / (time[high] - time[low])
    pressing = np.column_stack([press[low], press[high]])
    return _Chain(here[low], here[high], pressing, feed, force[high], closed.loop[low])


def _move_corner(work_from_view: FloatArray, corner: complex) -> FloatArray:
    """work_from_field (2, 3): `corner` is the view pixel of the field's first one."""
    matrix = np.array(work_from_view, dtype=np.float64)
    matrix[:, 2] += matrix[:, :2] @ np.array([corner.real, corner.imag])
    return matrix


def _paths(
    chain: _Chain, names: list[Label | None], work_from_field: FloatArray, job: Job
) -> tuple[ToolPath, ...]:
    """The curves that have a label as tool paths in the work frame (eq. 14 to 16), in the direction of the job.

    A direction goes through the same matrix as a position, without the shift. So it needs no angle, and a view whose v
    runs against y, in which angles count the other way round, needs no case of its own.
    """
    matrix = work_from_field[:, :2]

    def turned(vectors: ComplexArray) -> FloatArray:
        return np.stack([vectors.real, vectors.imag], axis=-1) @ matrix.T

    place = np.cumsum([name is not None for name in names]) - 1
    used = np.array([name is not None for name in names])[chain.loop]
    begin, end = turned(chain.begin[used]), turned(chain.end[used])
    shift = work_from_field[:, 2]
    segments = make(begin + shift, end + shift, np.zeros(len(begin)), place[chain.loop[used]])
    press = np.zeros((len(begin), 2, 3))
    towards = turned(chain.force_direction[used])
    press[:, :, :2] = towards / np.linalg.norm(towards, axis=2, keepdims=True)
    feed, force = (
        job.process.feed * chain.feed[used],
        np.where(chain.force[used], job.process.force, 0.0),
    )
    # The part is on the left as the view is shown: in the work frame too, where v runs against y. Climb has it right.
    if (np.linalg.det(matrix) < 0) != (job.operation.direction == "conventional"):
        segments, back = reverse_segments(segments)
        press, feed, force = press[back][:, ::-1], feed[back], force[back]
    depths = pass_depths(job.operation.depth, job.operation.passes)
    labels_ = [name for name in names if name is not None]
    return tool_paths(segments, labels_, SegmentWork(press, force, feed), depths, "follow")
