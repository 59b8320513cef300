"""Fills regions with a round tool such as a marker: passes along the border until all is covered.

"Continuous path following", section 4: a region wide enough is covered by passes that follow its
contour, one inside the other. An area thinner than the tool gets a stroke along its skeleton. The
rule is chosen for each place: passes run where there is room for another one beyond the first, a
centre line where there is not, and it ends at the pass that it meets. Gaps between the passes are
found in the painted picture and get their own strokes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product

import cv2
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.arcs import find_bulge_middles
from camgen.geometry.ragged import compute_first_rows, count_rows, find_true_runs
from camgen.geometry.rings import ComplexArray, find_latest, make_rings, normalize
from camgen.geometry.segments import BoolArray, IntArray, flatten, make_contour_segments
from camgen.model.errors import InputError
from camgen.model.job import Job
from camgen.model.part import (
    Contour,
    Note,
    Part,
    list_ids,
    select_closed,
    select_open,
    tabulate_contours,
)
from camgen.model.path import ToolPath, make_waypoints
from camgen.model.pose import FloatArray, frozen
from camgen.model.text import counted, short
from camgen.plan import Coverage
from camgen.plan.columns import compute_depths
from camgen.plan.fill.bridges import join_passes
from camgen.plan.fill.cover import SAG, measure_areas, paint, run_along, split_lines
from camgen.plan.fill.ground import FillGrid, compute_slope, make_grid
from camgen.plan.fill.joined import note_joined
from camgen.plan.fill.lines import CentreLine, centre_strokes, find_centre_lines
from camgen.plan.image_space.border import CLOSE, find_foot, find_near
from camgen.plan.image_space.field import Pixels, mask_beyond, sample_field
from camgen.plan.open_outlines import check_outlines
from camgen.plan.simplify import thin_out
from camgen.vision.similarity import measure_scale
from camgen.vision.skeleton import join_strokes, make_graph, thin_mask

# Passes along the border, one inside the other, each at one distance from the border.

#: Minimum depth beyond a pass, px.
ROOM = 0.75
#: Pixels per point of the inner passes, which need less detail than the pass along the border.
_PIXELS_PER_POINT = 3
_DISC = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (5, 5))


def make_passes(field: FillGrid, radius: float, spacing: float) -> Iterator[ComplexArray]:
    """Closed lines (N,) px at `radius`, `radius + spacing`, ... px from the border.

    The first point is not repeated.
    """
    offset = radius
    deepest = float(field.depth.max()) if field.depth.size else 0.0
    window = (0, 0, field.mask.shape[1], field.mask.shape[0])
    while offset + ROOM <= deepest:
        u, v, width, height = window
        depth = field.depth[v : v + height, u : u + width]
        core = mask_beyond(depth, offset + ROOM)
        wide = cv2.bitwise_and(cv2.dilate(core, _DISC), mask_beyond(depth, offset))
        chains, _ = cv2.findContours(wide, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        stride, rounds = (1, 3) if offset == radius else (_PIXELS_PER_POINT, 1)
        corner = np.array([u, v], dtype=np.float64)
        pixels = [pixel[::stride, 0] + corner for pixel in chains if len(pixel) > 2]
        yield from _move_to_offset(field, pixels, offset, rounds)
        box = cv2.boundingRect(core)
        window = (max(u + box[0] - 1, 0), max(v + box[1] - 1, 0), box[2] + 2, box[3] + 2)
        offset += spacing


def _move_to_offset(
    field: FillGrid, chains: Sequence[FloatArray], offset: float, rounds: int
) -> list[ComplexArray]:
    """Move chains of pixels (N, 2) to exactly `offset` px from the border.

    Near a corner a point has two sides to keep away from. So the `rounds` after the first also try
    the nearest border points of its neighbours.
    """
    if not chains:
        return []
    table = make_rings(count_rows(chains))
    flat = np.concatenate(chains)
    pixels = flat[:, 0] + 1j * flat[:, 1]
    depth, inwards = compute_slope(field, pixels)
    points = pixels - inwards * (depth - offset)
    row = find_near(field.edge, points - inwards * offset)
    row = np.where(row >= 0, row, row[np.maximum(find_latest(table, row >= 0), 0)])
    for round_ in range(rounds):
        foot, row = find_foot(field.edge, points, np.maximum(row, 0), CLOSE)
        for shift in (-3, 3) if round_ else ():
            other, other_row = find_foot(field.edge, points, row[table.shifted(shift)], CLOSE)
            nearer = np.abs(points - other) < np.abs(points - foot)
            foot, row = np.where(nearer, other, foot), np.where(nearer, other_row, row)
        outwards = points - foot
        # A point much farther away than the depth is on another border.
        is_valid = np.abs(np.abs(outwards) - offset) < 1.0
        points = np.where(is_valid, foot + offset * normalize(outwards), points)
    return np.split(points, table.first[1:])


# Bare pieces after passes and centre lines: strokes if the tool has room, else one touch.

#: Minimum distance of the tool centre from the border, as a fraction of the radius, for a stroke.
_ROOM_FRACTION = 0.9
#: Minimum area of a piece for a touch: a multiple of that for a line, plus a number of pixels. This
#: is more than the corner of a square leaves at any position of the pixels.
_TOUCH, _GRAIN = 1.6, 4
#: Minimum area that a touch covers, as a multiple of the area that it inks outside.
_PAYS = 2.0
#: Positions of a touch that are tried, as fractions from the deepest place to the middle of the
#: piece.
_TRIED = np.linspace(0.0, 1.0, 9).tolist()


def find_uncovered(
    field: FillGrid, ink: Pixels, radius: float, min_area: float
) -> list[CentreLine]:
    """Lines and dots for pieces of the area without `ink`.

    min_area: minimum area of a piece, in pixels.
    """
    pixels = np.asarray(cv2.bitwise_and(field.mask, cv2.bitwise_not(ink)), dtype=np.uint8)
    count, labels, facts, _ = cv2.connectedComponentsWithStats(pixels)
    # The deepest pixel of each piece; piece 0 is the pixels with ink.
    depth = np.zeros(count, dtype=np.float32)
    bare_rows = np.flatnonzero(pixels)
    piece: NDArray[np.int32] = np.asarray(labels, dtype=np.int32)
    np.maximum.at(depth, piece.ravel()[bare_rows], field.depth.ravel()[bare_rows])
    area = np.asarray(facts, dtype=np.int64)[:, cv2.CC_STAT_AREA]
    is_large = area >= min_area
    is_large[0] = False
    is_wide = is_large & (depth >= _ROOM_FRACTION * radius)
    lines = list(_find_lines(field, is_wide[piece], radius))
    pending = is_large & (area >= _TOUCH * min_area + _GRAIN)
    if lines:
        drawn = np.concatenate([line.points for line in lines])
        v, u = np.rint(drawn.imag).astype(np.int64), np.rint(drawn.real).astype(np.int64)
        pending[piece[v, u]] = False
    for k in np.flatnonzero(pending).tolist():
        touch = _find_touch(field, ink, piece, k, facts[k].tolist(), radius)
        if touch is not None:
            lines.append(touch)
    return lines


def _find_lines(field: FillGrid, area: BoolArray, radius: float) -> Iterator[CentreLine]:
    """The centre lines of an `area` (H, W), where the tool has room."""
    mask = area.astype(np.uint8) * np.uint8(255)
    if not cv2.countNonZero(mask):
        return
    width = cv2.distanceTransform(mask, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    strokes = join_strokes(make_graph(thin_mask(mask), None, np.asarray(width, dtype=np.float32)))
    if not strokes:
        return
    for stroke, points in zip(strokes, centre_strokes(strokes, field, radius)[1], strict=True):
        has_room = sample_field(field.depth, points) >= _ROOM_FRACTION * radius
        closed = stroke.closed and bool(has_room.all()) and len(points) > 2
        for first, end in find_true_runs(has_room).tolist():
            yield CentreLine(points[first:end], closed, radius)


def _find_touch(
    field: FillGrid,
    ink: Pixels,
    pieces: NDArray[np.int32],
    number: int,
    facts: list[int],
    radius: float,
) -> CentreLine | None:
    """One touch between the middle of a piece and the deepest place near it.

    None if every position inks too much outside.

    pieces: (H, W) piece of each pixel.
    facts: the statistics of the piece `number` as OpenCV returns them.
    """
    left, top, width, height, _ = facts
    reach = int(np.ceil(radius))
    u, v = max(left - 2 * reach, 0), max(top - 2 * reach, 0)
    window = (slice(v, top + height + 2 * reach), slice(u, left + width + 2 * reach))
    is_piece = pieces[window] == number
    rows, columns = np.nonzero(is_piece)
    middle = complex(columns.mean(), rows.mean())
    y, x = np.ogrid[: is_piece.shape[0], : is_piece.shape[1]]
    near = (y - middle.imag) ** 2 + (x - middle.real) ** 2 <= radius**2
    deepest = int(np.argmax(np.where(near, field.depth[window], 0.0)))
    row, column = np.unravel_index(deepest, is_piece.shape)
    start = complex(column, row)
    # 1 for a pixel of copper without ink, -1 for a pixel outside without ink.
    value = np.where(field.mask[window] != 0, 1, -1) * (ink[window] == 0)
    best, largest_gain = start, -1
    for fraction in _TRIED:
        place = start + fraction * (middle - start)
        disc = value[(y - place.imag) ** 2 + (x - place.real) ** 2 <= radius**2]
        covered, outside = int((disc > 0).sum()), int((disc < 0).sum())
        pays = covered >= _PAYS * outside and 2 * covered >= len(rows)
        if pays and covered - outside > largest_gain:
            best, largest_gain = place, covered - outside
    if largest_gain <= 0:
        return None
    return CentreLine(np.array([best + complex(u, v)]), False, radius)


#: Default tolerance to which strokes are thinned out, px of the grid.
_SIMPLIFY = 0.2
#: The same for a picture, whose edges are as uncertain: px of the picture, but at most this
#: fraction of the tool's diameter.
_SIMPLIFY_PICTURE, _OF_DIAMETER = 0.5, 1 / 20
#: Sagitta of the chords of arcs in the coverage, px.
_FLAT = 0.05
#: Minimum area of a bare piece for a stroke, as a fraction of the tool's disc.
_MIN_FRACTION = 0.05


class StrokeKind(Struct, frozen=True, eq=False):
    """Strokes of one kind.

    mark: first letter of their ids.
    strokes: lines and arcs, px; one point is a touch.
    lines: the strokes as lines alone, (N,) px each; closed ones repeat the first point.
    thin: true for strokes in places thinner than the tool.
    count: number of passes or lines from which the strokes were made.
    """

    mark: str
    strokes: tuple[Contour, ...]
    lines: list[ComplexArray]
    thin: list[bool]
    count: int


def fill(part: Part, job: Job) -> tuple[tuple[ToolPath, ...], tuple[Note, ...], Coverage]:
    """Plan strokes that cover the inside of the closed contours of `part`, even-odd.

    Returns the strokes, notes and their coverage. For a picture its borders count. Raises
    InputError without a closed contour, and JobError for a tool that is too small for the picture
    or the drawing.
    """
    if not select_closed(part.contours):
        raise InputError(
            part.source, "no closed contour to fill", remedy="trace it, or close its outlines"
        )
    check_outlines(part, list_ids(part.contours), "leave it out of the contours to fill")
    field = make_grid(part, job.tool.radius)
    radius = job.tool.radius / field.mm_per_px
    kinds = _make_strokes(field, radius, job, _compute_tolerance(part, field, job))
    region: IntArray = np.asarray(cv2.connectedComponents(field.mask)[1], dtype=np.int32)
    border_region = _find_border_regions(field, region)
    around = _group_contours(part, field, border_region)
    paths = tuple(_make_paths(field, kinds, around, region, job))
    thin: list[bool] = []
    lines: list[ComplexArray] = []
    for kind in kinds:
        thin += kind.thin
        lines += kind.lines
    coverage = measure_coverage(field, paths, thin, job.tool.radius)
    ink = paint(*split_lines(lines), radius, field.mask.shape[:2])
    notes = (
        *_note_open(part),
        _note_rules(kinds, region, job),
        *note_joined(part, field, ink, region, border_region, job.tool.diameter),
    )
    return paths, notes, coverage


def _compute_tolerance(part: Part, field: FillGrid, job: Job) -> float:
    """The tolerance to which strokes are thinned out, px of the grid."""
    if job.tolerance.simplify is not None:
        return job.tolerance.simplify / field.mm_per_px
    tolerance = max(job.tolerance.chord, _SIMPLIFY * field.mm_per_px)
    if part.raster is not None and part.raster.borders:
        of_picture = _SIMPLIFY_PICTURE * measure_scale(part.raster.work_from_view)
        tolerance = max(tolerance, min(of_picture, _OF_DIAMETER * job.tool.diameter))
    return tolerance / field.mm_per_px


def _make_strokes(field: FillGrid, radius: float, job: Job, tolerance: float) -> list[StrokeKind]:
    spacing = 2 * radius * job.operation.stepover
    passes = list(make_passes(field, radius, spacing))
    joined = join_passes(field, passes, radius, spacing)
    wide = [CentreLine(points, True, radius) for points in joined]
    narrow = list(find_centre_lines(field, radius, mask_beyond(field.depth, radius + ROOM)))
    # The lines as found: thinning out does not decide which pieces get a stroke.
    drawn = []
    for line in (*wide, *narrow):
        drawn.append(np.append(line.points, line.points[:1]) if line.closed else line.points)
    ink = paint(*split_lines(drawn), radius, field.mask.shape[:2])
    rest = find_uncovered(field, ink, radius, _MIN_FRACTION * np.pi * radius**2)
    fits_arcs = job.tolerance.arc_fit > 0
    return [
        _make_kind("f", wide, _thin_lines(wide, tolerance, fits_arcs), 0.0, len(passes)),
        _make_kind("m", narrow, _thin_lines(narrow, tolerance, fits_arcs), radius, len(narrow)),
        _make_kind("r", rest, _thin_lines(rest, tolerance, fits_arcs), 0.0, len(rest)),
    ]


def _thin_lines(
    lines: Sequence[CentreLine], tolerance: float, fits_arcs: bool
) -> tuple[Contour, ...]:
    contours = tuple(_make_contour(line) for line in lines)
    return thin_out(contours, tolerance, fits_arcs) if tolerance > 0 and contours else contours


def _make_kind(
    mark: str,
    lines: Sequence[CentreLine],
    strokes: tuple[Contour, ...],
    radius: float,
    count: int,
) -> StrokeKind:
    """radius: half the width below which a place is thinner than the tool, px."""
    points, owner = flatten(make_contour_segments(strokes), _FLAT)
    flat = points @ np.array([1, 1j])
    pieces = np.split(flat, np.searchsorted(owner, np.arange(1, len(strokes))))
    ends = [stroke.points[0 if stroke.closed else -1] @ np.array([1, 1j]) for stroke in strokes]
    drawn = [np.append(piece, end) for piece, end in zip(pieces, ends, strict=False)]
    return StrokeKind(mark, strokes, drawn, [line.wide < radius for line in lines], count)


def _make_contour(line: CentreLine) -> Contour:
    points = np.column_stack([line.points.real, line.points.imag])
    return Contour(frozen(points), frozen(np.zeros(len(points))), line.closed, "")


def _find_regions(points: ComplexArray, region: IntArray) -> IntArray:
    """(N,) the region at or beside each point, px: a stroke may run on the edge of its region."""
    height, width = region.shape
    u, v = np.rint(points.real).astype(np.int64), np.rint(points.imag).astype(np.int64)
    values = []
    for down, right in product((-1, 0, 1), repeat=2):
        row, column = np.clip(v + down, 0, height - 1), np.clip(u + right, 0, width - 1)
        values.append(region[row, column])
    middle = values[4]
    return np.asarray(np.where(middle > 0, middle, np.max(values, axis=0)))


def _find_border_regions(field: FillGrid, region: IntArray) -> IntArray:
    """(L,) the region that each border bounds, 0 if the border is too small to hold a pixel."""
    table = field.edge.table
    regions = int(region.max()) + 1
    key = table.loop * regions + _find_regions(field.edge.points, region)
    counts = np.bincount(key, minlength=len(table.count) * regions).reshape(-1, regions)
    counts[:, 0] = 0
    return np.asarray(counts.argmax(axis=1))


def _group_contours(
    part: Part, field: FillGrid, border_region: IntArray
) -> dict[int, list[Contour]]:
    contours: dict[int, list[Contour]] = {}
    for k in np.argsort(field.edge.table.count, kind="stable")[::-1].tolist():
        contours.setdefault(int(border_region[k]), []).append(part.contours[int(field.contour[k])])
    return contours


def _make_paths(
    field: FillGrid,
    kinds: Sequence[StrokeKind],
    contours: dict[int, list[Contour]],
    region: IntArray,
    job: Job,
) -> Iterator[ToolPath]:
    """All strokes as tool paths.

    contours: contours around each region.
    region: (H, W) region of each pixel.
    """
    strokes: list[Contour] = []
    names: list[str] = []
    for kind in kinds:
        strokes += kind.strokes
        names += [f"{kind.mark}{k}" for k in range(1, len(kind.strokes) + 1)]
    if not strokes:
        return
    columns = tabulate_contours(strokes)
    counts = columns.counts + columns.closed
    first = compute_first_rows(counts).tolist()
    flat, middle = _join_strokes(strokes)
    regions = _find_regions(flat[first], region).tolist()
    position = np.column_stack([field.to_work(flat), np.zeros(len(flat))])
    table = make_waypoints(
        position,
        np.column_stack([field.to_work(middle), np.where(np.isnan(middle), np.nan, 0.0)]),
        job.process.feed,
        force_direction=[0.0, 0.0, -1.0 if job.process.force else 0.0],
        force=job.process.force,
    )
    fallback = contours[min(contours)]
    for k, stroke in enumerate(strokes):
        around = contours.get(regions[k], ())
        yield ToolPath(
            id=names[k],
            layer=(around or fallback)[0].layer,
            table=table[first[k] : first[k] + counts[k]],
            closed=stroke.closed,
            depths=compute_depths(job.operation.depth, job.operation.passes),
            contours=tuple(dict.fromkeys(list_ids(around))),
            operation="fill",
        )


def _join_strokes(strokes: Sequence[Contour]) -> tuple[ComplexArray, ComplexArray]:
    """The points (N,) of all strokes, px, and the middles (N,) of the arcs that end there.

    Closed strokes repeat the first point. A middle is NaN without an arc.
    """
    points, middles = [], []
    for stroke in strokes:
        rows = stroke.points
        rows = np.append(rows, rows[:1], axis=0) if stroke.closed else rows
        bulge = stroke.bulges[: len(rows) - 1]
        arcs = np.where(bulge[:, None] != 0, find_bulge_middles(rows[:-1], bulge, rows[1:]), np.nan)
        points.append(rows)
        middles += [np.full((1, 2), np.nan), arcs]
    flat = np.concatenate(points) @ np.array([1, 1j])
    return np.asarray(flat), np.asarray(np.concatenate(middles) @ np.array([1, 1j]))


def measure_coverage(
    field: FillGrid, paths: Sequence[ToolPath], thin: Sequence[bool], radius: float
) -> Coverage:
    """The area that the paths cover, mm2, measured along the paths.

    thin: true for each path whose ink outside is counted separately.
    """
    edge = field.to_work(field.edge.points) @ np.array([1, 1j])
    wide: list[ComplexArray] = []
    narrow: list[ComplexArray] = []
    for path, is_thin in zip(paths, thin, strict=True):
        (narrow if is_thin else wide).append(run_along(path, radius / SAG) @ np.array([1, 1j]))
    return measure_areas(field.edge.table, edge, wide, narrow, radius)


def _note_open(part: Part) -> Iterator[Note]:
    ids = list_ids(select_open(part.contours))
    if ids:
        yield Note(
            "skipped",
            f"{counted(len(ids), 'open contour')} not filled",
            "only closed contours have an inside; join gaps with input.join, or trace them",
            ids,
        )


def _note_rules(kinds: Sequence[StrokeKind], region: IntArray, job: Job) -> Note:
    passes, centre, rest = kinds
    by_passes, by_lines = set[int](), set[int]()
    for kind, regions in ((passes, by_passes), (centre, by_lines)):
        starts = np.array([line[0] for line in kind.lines], dtype=complex)
        regions.update(_find_regions(starts, region).tolist())
    spacing = short(job.tool.diameter * job.operation.stepover, 3)
    rules = (
        (by_passes - by_lines, f"by passes {spacing} mm apart"),
        (by_lines - by_passes, "by centre lines"),
        (by_passes & by_lines, "by both"),
    )
    shares = ", ".join(f"{len(regions)} {how}" for regions, how in rules if regions)
    what = f"{counted(len(by_passes | by_lines), 'region')} to fill: {shares}"
    strokes = f" in {counted(len(passes.lines), 'stroke')}"
    joined = strokes if len(passes.lines) < passes.count else ""
    return Note(
        "assumed",
        what,
        f"{counted(passes.count, 'pass', 'passes')}{joined}, "
        f"{counted(len(centre.lines), 'centre line')} "
        f"({sum(centre.thin)} of places thinner than the tool), "
        f"{counted(len(rest.lines), 'stroke')} for the rest",
    )
