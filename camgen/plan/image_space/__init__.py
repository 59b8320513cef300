"""The planner of the PIST paper: from the mask of a part in a rectified view to tool paths.

It works in image space. MacMillan, Irani, Ahmadi: Planar image-space trajectory planning algorithm
for contour following in robotic machining. Sections in square brackets and equations are that
paper's. `field` has the distance image, `border` the border between the pixels, `tool_path` the
path of the tool centre beside the part, `stretches` the stretches over which the observed feed is
averaged.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import number_rows
from camgen.geometry.rings import (
    ComplexArray,
    Rings,
    apply_hysteresis,
    find_latest,
    make_rings,
    measure_perimeters,
    measure_steps,
    normalize,
)
from camgen.geometry.segments import BoolArray, IntArray, make_segments, reverse_segments
from camgen.geometry.vectors import find_nearest_row
from camgen.model.errors import InputError
from camgen.model.job import Job
from camgen.model.part import Note
from camgen.model.path import ToolPath
from camgen.model.pose import FloatArray
from camgen.model.text import counted, name_first, short
from camgen.plan.columns import Label, SegmentWork, compute_depths, make_tool_paths
from camgen.plan.image_space.border import Border, fit_border, make_border
from camgen.plan.image_space.field import Field, Pixels, find_chains, make_field, sample_field
from camgen.plan.image_space.stretches import compute_ratios
from camgen.plan.image_space.tool_path import (
    ANGLE_NOISE,
    CORNER_PX,
    MOVES,
    PIXEL_NOISE,
    STANDS,
    Limits,
    PixelPath,
    choose_needed,
    compute_feeds,
    is_reached,
    make_iso_path,
    make_pixel_path,
    mark_spaced,
    measure_gaps,
    measure_runs,
    place_borders,
    sharpen_corners,
    smooth,
    spread_slow,
)
from camgen.plan.unused import check_rules
from camgen.vision.similarity import measure_scale

# Names of the paths of an image, and notes on contours without a path.

#: Layer of the paths of an image.
_LAYER = "image"
#: Minimum length that a note reports as not reached, px: the resolution at two ends.
_MIN_NOTED = 4.0


def match_borders(edge: Border, table: Rings, points: ComplexArray, touched: IntArray) -> IntArray:
    """(L,) index of the border of the part that each path touches most often.

    touched: (N,) touched row of `edge` at each point, or -1.
    A path without contact, which fits only just, gets the border nearest to its first point.
    """
    borders = len(edge.table.count)
    row = np.flatnonzero(touched >= 0)
    key = table.loop[row] * borders + edge.table.loop[touched[row]]
    counts = np.bincount(key, minlength=len(table.count) * borders).reshape(-1, borders)
    main: IntArray = np.argmax(counts, axis=1)
    for k in np.flatnonzero(~counts.any(axis=1)).tolist():
        main[k] = edge.table.loop[find_nearest_row(edge.points, points[table.first[k]])]
    return main


def make_labels(main: IntArray, parent: IntArray, is_sound: BoolArray) -> Iterator[Label | None]:
    """The labels of paths, named by the border that each follows; None for unsound paths.

    main: (L,) border of each path.
    A name is `c1`, or `c1.1`, `c1.2` if the border has several paths. Paths inside an unsound one
    get the path around it as their parent.
    """
    has_several = np.bincount(main[is_sound], minlength=1) > 1
    place = np.where(is_sound, np.cumsum(is_sound) - 1, -1).tolist()
    seen = [0] * len(has_several)
    for k, border in enumerate(main.tolist()):
        if not is_sound[k]:
            yield None
            continue
        seen[border] += 1
        contour = f"c{border + 1}"
        name = f"{contour}.{seen[border]}" if has_several[border] else contour
        around = int(parent[k])
        while around >= 0 and place[around] < 0:
            around = int(parent[around])
        outer = place[around] if around >= 0 else -1
        yield Label(name, _LAYER, True, False, outer, (contour,))


def note_left_out(
    edge: Border,
    reached: BoolArray,
    main: IntArray,
    is_sound: BoolArray,
    job: Job,
    mm_per_px: float,
) -> Iterator[Note]:
    """Notes on borders without a path, and on the length that no tool of this size can touch.

    reached: (N,) of `edge`, true if the tool can touch that point.
    main: (L,) border of each path.
    is_sound: (L,) false for paths that did not keep their distance.
    """
    radius = job.operation.corner_radius
    tool = f"a {job.tool.diameter:g} mm tool" + (
        f" with corner radius {radius:g}" if radius else ""
    )
    count = len(edge.table.count)
    followed = np.isin(np.arange(count), main[is_sound])
    failed = np.isin(np.arange(count), main[~is_sound])
    # A border without a path of its own may be touched by the path of a near neighbour.
    touched = np.bincount(edge.table.loop, reached, count) > 0
    narrow = ~followed & ~failed & ~touched
    yield from _note_not_followed(narrow, "too narrow", f"{tool} does not fit")
    why = "the path did not keep its distance; use waypoints that are closer together, or report it"
    yield from _note_not_followed(failed, "check failed", why)
    length = measure_steps(edge.table, edge.points) * mm_per_px
    whole = float(length.sum())
    missing = np.bincount(edge.table.loop, np.where(reached, 0.0, length), count)
    missing = np.where(touched & ~failed, missing, 0.0)
    total = float(missing.sum())
    if total > max(1e-3 * whole, _MIN_NOTED * mm_per_px):
        yield Note(
            "warning",
            f"{short(total, 2)} mm of {short(whole, 2)} mm of contour not touched, "
            f"most of it on c{int(np.argmax(missing)) + 1}",
            f"inner corners and narrow places that {tool} does not reach",
        )


def _note_not_followed(borders: BoolArray, how: str, why: str) -> Iterator[Note]:
    ids = tuple(f"c{k + 1}" for k in np.flatnonzero(borders).tolist())
    if ids:
        yield Note(
            "skipped",
            f"{counted(len(ids), 'contour')} not followed, {how}: {name_first(ids)} "
            f"on layer {_LAYER}",
            why,
            ids,
        )


#: Minimum radius of the tool, px.
_MIN_RADIUS_PX = 1.5
#: Gap between contact point and part at which contact is lost, px: from the exact border, and from
#: pixel centres.
_CONTACT_GAP_PX, _PIXEL_GAP = 1.0, 2.0
#: Relative change of the feed at which a waypoint stays.
_FEED_STEP = 0.02


class _Waypoints(Struct, frozen=True, eq=False):
    """Waypoints of closed curves (eq. 12), in pixels of the field.

    table: lengths of the curves.
    points: (N,) positions of the tool centre.
    force_direction: (N,) unit vectors of theta_f.
    feed: (N,) feed of the segment before each row, as a multiple of the nominal feed.
    force: (N,) true if the tool presses on that segment.
    spaced: (N,) true for waypoints at the requested spacing; the others are between them.
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
    """Plan paths around the part in a mask and in its holes, with notes on contours left out.

    mask_pixels: (H, W) uint8, not 0 in the part.
    work_from_view: (2, 3) similarity from a pixel centre (u, v) to mm; v may run against y.
    exact: True for an iso-line between the pixels, with normals from the nearest point of the
        border. False for integer pixels and the gradient of the distance image, as in the paper.
    borders: borders of the part in view pixels, closed (N, 2) without a repeated first point, if
        they are known more exactly than from the mask.

    Positions are in the work frame at z = 0, `depths` below it. The removal of redundant waypoints
    moves the path by at most `tolerance.chord`. Raises JobError for settings that this planner
    does not support, InputError for an unsuitable mask or transform.
    """
    mm_per_px = measure_scale(work_from_view)
    distance, radius = job.tool.radius / mm_per_px, job.operation.corner_radius / mm_per_px
    _check_input(mask_pixels, job, distance)
    if not mask_pixels.any():
        return (), (Note("skipped", "no part in the mask", "choose another mask"),)
    picture = make_field(mask_pixels, distance + radius)
    if borders is None:
        curves = fit_border(find_chains(picture.part))
    else:
        curves = place_borders(borders, picture)
    edge = make_border(*curves, picture.far.shape)
    path = (
        make_iso_path(picture, edge, distance, radius)
        if exact
        else make_pixel_path(picture, distance, radius)
    )
    # The chord that leaves a curve of half the tool's radius by `tolerance.chord`, mm.
    usual_spacing = math.sqrt(2 * job.tool.diameter * job.tolerance.chord)
    step = max((job.operation.waypoint_spacing or usual_spacing) / mm_per_px, 1.0)
    field = None if exact else picture
    points, touched = _make_waypoints(
        path, edge, field, distance, step, job.process.max_feed_factor
    )
    main = match_borders(edge, points.table, points.points, touched)
    limit = distance - (_CONTACT_GAP_PX if exact else _PIXEL_GAP)
    gouges = sample_field(picture.far, points.points) < limit
    is_sound = np.bincount(points.table.loop, gouges, len(main)) == 0
    reached = is_reached(path, picture, edge, distance, radius)
    notes = tuple(note_left_out(edge, reached, main, is_sound, job, mm_per_px))
    rate = np.radians(job.operation.waypoint_turn) * mm_per_px
    chain = _make_chain(points, Limits(rate, job.tolerance.chord / mm_per_px))
    work_from_field = np.array(work_from_view, dtype=np.float64)
    corner = np.array([picture.corner.real, picture.corner.imag])
    work_from_field[:, 2] += work_from_field[:, :2] @ corner
    labels = list(make_labels(main, path.parent, is_sound))
    return _make_paths(chain, labels, work_from_field, job), notes


def _check_input(mask_pixels: Pixels, job: Job, distance: float) -> None:
    if mask_pixels.ndim != 2 or mask_pixels.dtype != np.uint8:
        raise InputError(
            "mask",
            f"has shape {mask_pixels.shape} of {mask_pixels.dtype}",
            remedy="give (H, W) uint8",
        )
    rim = (mask_pixels[0], mask_pixels[-1], mask_pixels[:, 0], mask_pixels[:, -1])
    check_rules(
        [
            (
                job.operation.side != "auto",
                f'"{job.operation.side}" is not known to the image-space planner',
                "operation.side",
                "set operation.side to auto",
            ),
            (
                distance < _MIN_RADIUS_PX,
                f"{job.tool.diameter:g} mm is {2 * distance:.2g} px of the view",
                "tool.diameter",
                "use a larger tool or a finer view",
            ),
        ]
    )
    if np.concatenate(rim).any():
        raise InputError(
            "mask", "the part touches the border of the view", remedy="show the whole part"
        )


def _make_waypoints(
    path: PixelPath,
    edge: Border,
    field: Field | None,
    distance: float,
    step: float,
    fastest: float,
) -> tuple[_Waypoints, IntArray]:
    """The waypoints with feed and force, and the row (N,) of `edge` that each touches, or -1.

    field: distance image for the gap between contact point and part, as in the paper; None to
        measure it from `edge`.
    step: spacing, px.
    fastest: maximum feed as a multiple of the nominal feed.
    """
    table = path.table
    count = np.rint(measure_perimeters(table, path.points) / step).astype(np.int64)
    count = np.clip(count, 8, table.count)
    points, direction = smooth(table, count, path.points, path.force_direction)
    # Opposite directions may cancel out in the filter; then the direction before is kept.
    direction = normalize(direction)[find_latest(table, np.abs(direction) > 1e-6)]
    contact, along, run, touched = _find_contact(path, edge, field, distance)
    noise = (ANGLE_NOISE if field is None else PIXEL_NOISE) * distance
    ratio = compute_ratios(table, along, run, noise)
    # A corner as round as a photo shows a sharp one has a larger ratio.
    standing = max(STANDS, CORNER_PX / (distance + CORNER_PX))
    ratio = sharpen_corners(table, ratio, along, path.force_direction, standing)
    # The observed feed is nearly zero at sharp outer corners [4.2.1].
    is_moving = ratio >= standing + MOVES - STANDS
    force = contact & apply_hysteresis(table, is_moving, ratio < standing, True)
    feed = compute_feeds(spread_slow(table, ratio), contact, fastest)
    return _Waypoints(table, points, direction, feed, force, mark_spaced(table, count)), touched


def _find_contact(
    path: PixelPath, edge: Border, field: Field | None, distance: float
) -> tuple[BoolArray, FloatArray, FloatArray, IntArray]:
    """Contact on the segment before each row (N,).

    Returns whether the tool touches, the lengths that contact point and tool centre run, px, and
    the row of `edge` that is touched at the end of the segment, or -1.
    """
    table, back = path.table, path.table.shifted(-1)
    tolerance = _CONTACT_GAP_PX if field is None else _PIXEL_GAP
    points, direction = path.points, path.force_direction
    # The contact point is at the offset distance along the force direction (eq. 10).
    contacts = points + distance * direction
    gap, row = measure_gaps(edge, contacts, field)
    along, run = measure_runs(table, points, contacts)
    half_way = (points + points[back]) / 2 + distance * normalize(direction + direction[back])
    is_far = gap > tolerance
    # In a sharp inner corner the contact point leaps from one side to the other: the tool touches
    # both.
    leaps = (measure_gaps(edge, half_way, field)[0] > tolerance) | is_far | is_far[back]
    # Within a pixel of it the path is bent.
    leaps = leaps | leaps[back] | leaps[table.shifted(1)]
    contact = np.ones(len(table), dtype=bool)
    if path.inside is not None:
        # Contact is found again at half of the gap at which it is lost [4.2.1].
        contact = apply_hysteresis(table, gap <= tolerance / 2, is_far, True)
    contact = contact & contact[back]
    return contact, np.where(leaps, run, along), run, np.where(is_far, -1, row)


class _Chain(Struct, frozen=True, eq=False):
    """Straight segments of all curves.

    begin, end: (N,) end points, px.
    force_direction: (N, 2) unit vectors at both ends.
    feed: (N,) multiple of the nominal feed.
    force: (N,) true if the tool presses.
    loop: (N,) curve of each segment.
    """

    begin: ComplexArray
    end: ComplexArray
    force_direction: ComplexArray
    feed: FloatArray
    force: BoolArray
    loop: IntArray


def _make_chain(points: _Waypoints, limits: Limits) -> _Chain:
    """The segments between the needed waypoints [3.4.2]. They take as long as all of them."""
    count = points.table.count
    closed = make_rings(count + 1)
    row = points.table.first[closed.loop] + number_rows(closed.count) % count[closed.loop]
    position, direction = points.points[row], points.force_direction[row]
    force, feed = points.force[row], points.feed[row]
    # A segment ends in its row, so a change after a row is a change at that row.
    feed_change = np.abs(np.log(feed[1:] / feed[:-1]))
    is_switched = np.append((force[1:] != force[:-1]) | (feed_change > _FEED_STEP), False)
    first = np.append(closed.first, len(closed))
    keep = choose_needed(first, position, direction, points.spaced[row], is_switched, limits)
    step = np.append(0.0, np.abs(np.diff(position)))
    run, time = np.cumsum(step), np.cumsum(step / feed)
    vertex = np.flatnonzero(keep)
    low, high = vertex[:-1], vertex[1:]
    is_segment = (closed.loop[low] == closed.loop[high]) & (run[high] > run[low])
    low, high = low[is_segment], high[is_segment]
    feed = (run[high] - run[low]) / (time[high] - time[low])
    directions = np.column_stack([direction[low], direction[high]])
    return _Chain(position[low], position[high], directions, feed, force[high], closed.loop[low])


def _make_paths(
    chain: _Chain, labels: list[Label | None], work_from_field: FloatArray, job: Job
) -> tuple[ToolPath, ...]:
    """The curves with a label as tool paths in the work frame (eq. 14 to 16).

    They run in the direction of the job. A direction is transformed by the same matrix as a
    position, without the shift. So it needs no angle, and a view whose v runs against y, in which
    angles count the other way, needs no case of its own.
    """
    matrix = work_from_field[:, :2]

    def transform(vectors: ComplexArray) -> FloatArray:
        return np.stack([vectors.real, vectors.imag], axis=-1) @ matrix.T

    has_label = np.array([label is not None for label in labels])
    place = np.cumsum(has_label) - 1
    used = has_label[chain.loop]
    begin, end = transform(chain.begin[used]), transform(chain.end[used])
    shift = work_from_field[:, 2]
    segments = make_segments(
        begin + shift, end + shift, np.zeros(len(begin)), place[chain.loop[used]]
    )
    direction = np.zeros((len(begin), 2, 3))
    planar = transform(chain.force_direction[used])
    direction[:, :, :2] = planar / np.linalg.norm(planar, axis=2, keepdims=True)
    feed = job.process.feed * chain.feed[used]
    force = np.where(chain.force[used], job.process.force, 0.0)
    # The part is on the left in the view, so also in the work frame if v runs against y. Climb
    # milling has it on the right.
    if (np.linalg.det(matrix) < 0) != (job.operation.direction == "conventional"):
        segments, back = reverse_segments(segments)
        direction, feed, force = direction[back][:, ::-1], feed[back], force[back]
    depths = compute_depths(job.operation.depth, job.operation.passes)
    used_labels = [label for label in labels if label is not None]
    return make_tool_paths(
        segments, used_labels, SegmentWork(direction, force, feed), depths, "follow"
    )
