"""Filling regions with a round tool, a marker say: passes along the border, one inside the other, until all is covered.

"Continuous path following", section 4: a region wide enough is covered by contour-following passes, peeled off one
after the other; what is thinner than the tool gets a stroke along its skeleton. The choice is made place by place:
passes go where there is room beyond the first of them, a centre line runs where there is none and ends at the pass that
it meets. What the passes leave between them is found on the painted picture and gets strokes of its own.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.arcs import find_bulge_middles
from camgen.geometry.ragged import begins, true_runs
from camgen.geometry.rings import ComplexArray, find_latest, make_rings, unit
from camgen.geometry.segments import BoolArray, IntArray, flatten, from_contours
from camgen.model.errors import InputError
from camgen.model.job import Job
from camgen.model.part import Contour, Note, Part
from camgen.model.path import ToolPath, waypoints
from camgen.model.pose import FloatArray, frozen
from camgen.model.text import counted, short
from camgen.plan import Coverage
from camgen.plan.columns import pass_depths
from camgen.plan.fill.bridges import join_passes
from camgen.plan.fill.cover import SAG, lines_of, measure, paint, run_along
from camgen.plan.fill.ground import Distances, Ground, Pixels, ground, slope
from camgen.plan.fill.joined import tell_joined
from camgen.plan.fill.lines import CentreLine, centre, centre_lines
from camgen.plan.image_space.border import CLOSE, foot, near
from camgen.plan.image_space.field import beyond, sample_field
from camgen.plan.open_outlines import check_outlines
from camgen.plan.simplify import thin_out
from camgen.vision.similarity import measure_scale
from camgen.vision.skeleton import join_strokes, make_graph, thin_mask

# Passes along the border, one inside the other, each the line at one distance from the border.

#: Room beyond a pass that makes it one, px.
ROOM = 0.75
#: Passes that no border shows are made of one pixel in so many.
_EVERY = 3
_DISC = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (5, 5))


def passes(field: Ground, radius: float, spacing: float) -> list[ComplexArray]:
    """Closed lines (N,) px at `radius`, `radius + spacing`, ... px from the border, no first point again."""
    level = radius
    found: list[ComplexArray] = []
    deepest = float(field.depth.max()) if field.depth.size else 0.0
    window = (0, 0, field.mask.shape[1], field.mask.shape[0])
    while level + ROOM <= deepest:
        u, v, width, height = window
        depth = field.depth[v : v + height, u : u + width]
        core = beyond(depth, level + ROOM)
        wide = cv2.bitwise_and(cv2.dilate(core, _DISC), beyond(depth, level))
        chains, _ = cv2.findContours(wide, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        first = level == radius
        corner = np.array([u, v], dtype=np.float64)
        pixels = [
            chain[:: 1 if first else _EVERY, 0] + corner for chain in chains if len(chain) > 2
        ]
        found += _exact(field, pixels, level, 3 if first else 1)
        box = cv2.boundingRect(core)
        window = (max(u + box[0] - 1, 0), max(v + box[1] - 1, 0), box[2] + 2, box[3] + 2)
        level += spacing
    return found


def core(field: Ground, radius: float) -> Pixels:
    """255 where there is room beyond the first pass: what passes take care of."""
    return beyond(field.depth, radius + ROOM)


def _exact(
    field: Ground, chains: Sequence[FloatArray], level: float, rounds: int
) -> list[ComplexArray]:
    """Chains of pixels (N, 2) moved to exactly `level` px from the border.

    Beside a corner a point has two sides to keep away from: in further `rounds` its neighbours' feet are tried too.
    """
    if not chains:
        return []
    table = make_rings([len(c) for c in chains])
    flat = np.concatenate(chains)
    pixels = flat[:, 0] + 1j * flat[:, 1]
    depth, inwards = slope(field, pixels)
    points = pixels - inwards * (depth - level)
    row = near(field.edge, points - inwards * level)
    row = np.where(row >= 0, row, row[np.maximum(find_latest(table, row >= 0), 0)])
    for again in range(rounds):
        on, row = foot(field.edge, points, np.maximum(row, 0), CLOSE)
        for by in (-3, 3) if again else ():
            other, there = foot(field.edge, points, row[table.shifted(by)], CLOSE)
            nearer = np.abs(points - other) < np.abs(points - on)
            on, row = np.where(nearer, other, on), np.where(nearer, there, row)
        away = points - on
        # A foot much farther than the depth says is that of another border.
        good = np.abs(np.abs(away) - level) < 1.0
        points = np.where(good, on + level * unit(away), points)
    return np.split(points, table.first[1:])


# What passes and centre lines left bare: strokes where the tool has room, one touch where it pays.

#: The tool has room where it is no nearer to the border than this share of its radius.
_ROOM_SHARE = 0.9
#: A touch needs a piece so many times as large as a line does and so many pixels, which is more than the corner of a
#: square leaves wherever the pixels lie, and must cover this many times what it inks outside.
_TOUCH, _GRAIN, _PAYS = 1.6, 4, 2.0
#: Where a touch is tried, from the place with most room towards the middle of the piece.
_WAY = tuple(k / 8 for k in range(9))


class _Bare(Struct, frozen=True, eq=False):
    """Pieces without ink: labels (H, W), facts (N, 5) as OpenCV gives them, room (N,): depth of the deepest pixel."""

    labels: NDArray[np.int32]
    facts: IntArray
    room: Distances


def find_uncovered(field: Ground, ink: Pixels, radius: float, least: float) -> list[CentreLine]:
    """Lines and dots for what of `field` is without `ink`. least: pixels of a piece that is worth one."""
    pixels = np.asarray(cv2.bitwise_and(field.mask, cv2.bitwise_not(ink)), dtype=np.uint8)
    count, labels, facts, _ = cv2.connectedComponentsWithStats(pixels)
    room = np.zeros(count, dtype=np.float32)
    here = np.flatnonzero(pixels)
    piece: NDArray[np.int32] = np.asarray(labels, dtype=np.int32)
    np.maximum.at(room, piece.ravel()[here], field.depth.ravel()[here])
    bare = _Bare(piece, np.asarray(facts, dtype=np.int64), room)
    worth = bare.facts[:, cv2.CC_STAT_AREA] >= least
    worth[0] = False
    lines = _lines(field, bare, worth & (room >= _ROOM_SHARE * radius), radius)
    left = worth & (bare.facts[:, cv2.CC_STAT_AREA] >= _TOUCH * least + _GRAIN)
    if lines:
        drawn = np.concatenate([line.points for line in lines])
        left[
            bare.labels[np.rint(drawn.imag).astype(np.int64), np.rint(drawn.real).astype(np.int64)]
        ] = False
    touches = [_touch(field, ink, bare, k, radius) for k in np.flatnonzero(left).tolist()]
    return lines + [touch for touch in touches if touch is not None]


def _lines(field: Ground, bare: _Bare, wide: BoolArray, radius: float) -> list[CentreLine]:
    """The centre lines of the pieces `wide` (N,), where the tool has room."""
    own = wide[bare.labels].astype(np.uint8) * np.uint8(255)
    if not cv2.countNonZero(own):
        return []
    width = np.asarray(
        cv2.distanceTransform(own, cv2.DIST_L2, cv2.DIST_MASK_PRECISE), dtype=np.float32
    )
    found = join_strokes(make_graph(thin_mask(own), None, width))
    result = []
    for stroke, points in zip(found, centre(found, field, radius)[1] if found else [], strict=True):
        room = sample_field(field.depth, points) >= _ROOM_SHARE * radius
        closed = stroke.closed and bool(room.all()) and len(points) > 2
        result += [CentreLine(part, closed, radius) for part in _runs(points, room)]
    return result


def _touch(field: Ground, ink: Pixels, bare: _Bare, piece: int, radius: float) -> CentreLine | None:
    """One touch, between a piece and where the tool has most room near it, if it covers more than it spoils."""
    left, top, wide, high, _ = bare.facts[piece].tolist()
    reach = int(np.ceil(radius))
    u, v = max(left - 2 * reach, 0), max(top - 2 * reach, 0)
    window = (slice(v, top + high + 2 * reach), slice(u, left + wide + 2 * reach))
    own = bare.labels[window] == piece
    rows, columns = np.nonzero(own)
    middle = complex(columns.mean(), rows.mean())
    y, x = np.ogrid[: own.shape[0], : own.shape[1]]
    near = (y - middle.imag) ** 2 + (x - middle.real) ** 2 <= radius**2
    deepest = np.unravel_index(int(np.argmax(np.where(near, field.depth[window], 0.0))), own.shape)
    room = complex(deepest[1], deepest[0])
    # A pixel of copper that gets ink counts for it, one beside counts against.
    value = np.where(field.mask[window] != 0, 1, -1) * (ink[window] == 0)
    best, most = room, -1
    for place in (room + share * (middle - room) for share in _WAY):
        fresh = value[(y - place.imag) ** 2 + (x - place.real) ** 2 <= radius**2]
        gained, spoiled = int((fresh > 0).sum()), int((fresh < 0).sum())
        if gained >= _PAYS * spoiled and 2 * gained >= len(rows) and gained - spoiled > most:
            best, most = place, gained - spoiled
    return CentreLine(np.array([best + complex(u, v)]), False, radius) if most > 0 else None


def _runs(points: ComplexArray, where: BoolArray) -> list[ComplexArray]:
    """The stretches of a line where it holds."""
    return [points[a:b] for a, b in true_runs(where).tolist()]


#: Strokes are thinned out within this, px of the grid, where the job does not say. Of a picture within so many of its
#: own px, since it does not know its edges better, and within this share of the tool's diameter.
_SIMPLIFY, _SEEN, _OF_TOOL = 0.2, 0.5, 1 / 20
#: Where it is looked at what strokes cover, px, their arcs are chords.
_FLAT = 0.05
#: What is left bare is worth a stroke from this share of the tool's disc on.
_WORTH_SHARE = 0.05


class Kind(Struct, frozen=True, eq=False):
    """Strokes of one kind, px. mark: what their ids begin with. strokes: lines and arcs, one point: a touch. lines: the
    same as lines alone, (N,) each, the first point again where closed. thin: of a place thinner than the tool. made_of:
    how many passes or lines they are.
    """

    mark: str
    strokes: tuple[Contour, ...]
    lines: list[ComplexArray]
    thin: list[bool]
    made_of: int


def fill(part: Part, job: Job) -> tuple[tuple[ToolPath, ...], tuple[Note, ...], Coverage]:
    """Strokes that cover what the closed contours of `part` enclose, even-odd, notes, and what they cover.

    Of a picture the borders in it count. Raises InputError where nothing is closed, JobError for a tool that is too
    small for the picture or the drawing.
    """
    if not any(c.closed for c in part.contours):
        raise InputError(
            part.source, "no closed contour to fill", remedy="trace it, or close its outlines"
        )
    check_outlines(part, {c.id for c in part.contours}, "leave it out of what is filled")
    field = ground(part, job.tool.radius)
    kinds = _strokes(field, job.tool.radius / field.mm_per_px, job, _thinning(part, field, job))
    region = _regions(field)
    of = _of_borders(field, region)
    paths = _paths(field, kinds, _borders(part, field, of), region, job)
    coverage = measure_coverage(
        field, paths, [thin for kind in kinds for thin in kind.thin], job.tool.radius
    )
    lines = [line for kind in kinds for line in kind.lines]
    ink = paint(*lines_of(lines), job.tool.radius / field.mm_per_px, field.mask.shape[:2])
    notes = (
        *_open(part),
        *_rules(kinds, region, job),
        *tell_joined(part, field, ink, region, of, job.tool.diameter),
    )
    return paths, notes, coverage


def _thinning(part: Part, field: Ground, job: Job) -> float:
    """Px of the grid within which strokes are thinned out."""
    if job.tolerance.simplify is not None:
        return job.tolerance.simplify / field.mm_per_px
    near = max(job.tolerance.chord, _SIMPLIFY * field.mm_per_px)
    if part.raster is not None and part.raster.borders:
        near = max(
            near,
            min(_SEEN * measure_scale(part.raster.work_from_view), _OF_TOOL * job.tool.diameter),
        )
    return near / field.mm_per_px


def _strokes(field: Ground, radius: float, job: Job, near: float) -> list[Kind]:
    arcs = job.tolerance.arc_fit > 0
    spacing = 2 * radius * job.operation.stepover
    rounds = passes(field, radius, spacing)
    wide = [
        CentreLine(points, True, radius) for points in join_passes(field, rounds, radius, spacing)
    ]
    narrow = centre_lines(field, radius, core(field, radius))
    # As they were found: what is worth a stroke of its own does not hang on how they are thinned out.
    drawn = [
        np.append(line.points, line.points[:1]) if line.closed else line.points
        for line in (*wide, *narrow)
    ]
    ink = paint(*lines_of(drawn), radius, field.mask.shape[:2])
    rest = find_uncovered(field, ink, radius, _WORTH_SHARE * np.pi * radius**2)
    found = (
        ("f", wide, 0.0, len(rounds)),
        ("m", narrow, radius, len(narrow)),
        ("r", rest, 0.0, len(rest)),
    )
    return [_kind(mark, lines, near, arcs, least, made_of) for mark, lines, least, made_of in found]


def _kind(
    mark: str, lines: Sequence[CentreLine], near: float, arcs: bool, radius: float, made_of: int
) -> Kind:
    """radius: a place less than twice as wide is thinner than the tool."""
    drawn = tuple(_contour(line) for line in lines)
    if near > 0 and drawn:
        drawn = thin_out(drawn, near, arcs)
    points, owner = flatten(from_contours(drawn), _FLAT)
    flat = (
        np.split(points @ np.array([1, 1j]), np.searchsorted(owner, np.arange(1, len(drawn))))
        if drawn
        else []
    )
    last = [stroke.points[0 if stroke.closed else -1] @ np.array([1, 1j]) for stroke in drawn]
    ended = [np.append(line, end) for line, end in zip(flat, last, strict=True)]
    return Kind(mark, drawn, ended, [line.wide < radius for line in lines], made_of)


def _contour(line: CentreLine) -> Contour:
    points = np.column_stack([line.points.real, line.points.imag])
    return Contour(frozen(points), frozen(np.zeros(len(points))), line.closed, "")


def _regions(field: Ground) -> IntArray:
    """(H, W) which connected piece of the ground each pixel is of, 1 and on; 0 outside."""
    return np.asarray(cv2.connectedComponents(field.mask)[1])


def _region_of(points: ComplexArray, region: IntArray) -> IntArray:
    """(N,) the region at or beside each point px: a stroke may run on the edge of what it covers."""
    height, width = region.shape
    u, v = np.rint(points.real).astype(np.int64), np.rint(points.imag).astype(np.int64)
    around = [
        region[np.clip(v + down, 0, height - 1), np.clip(u + right, 0, width - 1)]
        for down in (-1, 0, 1)
        for right in (-1, 0, 1)
    ]
    middle = around[4]
    return np.asarray(np.where(middle > 0, middle, np.max(around, axis=0)))


def _of_borders(field: Ground, region: IntArray) -> IntArray:
    """(L,) the region that each border runs around, 0 where it is too small to hold a pixel."""
    table = field.edge.table
    regions = int(region.max()) + 1
    beside = np.bincount(
        table.loop * regions + _region_of(field.edge.points, region),
        minlength=len(table.count) * regions,
    ).reshape(-1, regions)
    beside[:, 0] = 0
    return np.asarray(beside.argmax(axis=1))


def _borders(part: Part, field: Ground, of: IntArray) -> dict[int, list[Contour]]:
    """The contours around each region, the longest first."""
    found: dict[int, list[Contour]] = {}
    for k in np.argsort(field.edge.table.count, kind="stable")[::-1].tolist():
        found.setdefault(int(of[k]), []).append(part.contours[int(field.contour[k])])
    return found


def _paths(
    field: Ground,
    kinds: Sequence[Kind],
    borders: dict[int, list[Contour]],
    region: IntArray,
    job: Job,
) -> tuple[ToolPath, ...]:
    strokes = [stroke for kind in kinds for stroke in kind.strokes]
    if not strokes:
        return ()
    counts = np.array([len(stroke.points) + stroke.closed for stroke in strokes])
    low = begins(counts)
    flat, middle = _rows(strokes)
    where = _region_of(flat[low], region).tolist()
    position = np.column_stack([field.placed(flat), np.zeros(len(flat))])
    via = np.column_stack([field.placed(middle), np.where(np.isnan(middle), np.nan, 0.0)])
    press = [0.0, 0.0, -1.0 if job.process.force else 0.0]
    table = waypoints(
        position, via, job.process.feed, force_direction=press, force=job.process.force
    )
    some = borders[min(borders)]
    names = [
        (f"{kind.mark}{k}", stroke.closed)
        for kind in kinds
        for k, stroke in enumerate(kind.strokes, 1)
    ]
    rows = [slice(a, a + n) for a, n in zip(low.tolist(), counts.tolist(), strict=True)]
    return tuple(
        ToolPath(
            id=name,
            layer=borders.get(at, some)[0].layer,
            table=table[own],
            closed=closed,
            depths=pass_depths(job.operation.depth, job.operation.passes),
            contours=tuple(dict.fromkeys(contour.id for contour in borders.get(at, ()))),
            operation="fill",
        )
        for (name, closed), at, own in zip(names, where, rows, strict=True)
    )


def _rows(strokes: Sequence[Contour]) -> tuple[ComplexArray, ComplexArray]:
    """The points (N,) px of the strokes, of closed ones the first again, and the middles (N,) of the arcs that end
    there, NaN where none does.
    """
    points = [np.append(s.points, s.points[:1], axis=0) if s.closed else s.points for s in strokes]
    middles = []
    for stroke, own in zip(strokes, points, strict=True):
        bulge = stroke.bulges[: len(own) - 1]
        arcs = np.where(bulge[:, None] != 0, find_bulge_middles(own[:-1], bulge, own[1:]), np.nan)
        middles += [np.full((1, 2), np.nan), arcs]
    both = (np.concatenate(rows) @ np.array([1, 1j]) for rows in (points, middles))
    flat, middle = both
    return np.asarray(flat), np.asarray(middle)


def measure_coverage(
    field: Ground, paths: Sequence[ToolPath], thin: Sequence[bool], radius: float
) -> Coverage:
    """What the paths cover of the ground, mm2, from where the tool will be. thin: whose ink beside is counted apart."""
    edge = field.placed(field.edge.points) @ np.array([1, 1j])
    lines = [run_along(path, radius / SAG) @ np.array([1, 1j]) for path in paths]
    wide = [line for line, apart in zip(lines, thin, strict=True) if not apart]
    narrow = [line for line, apart in zip(lines, thin, strict=True) if apart]
    return measure(field.edge.table, edge, wide, narrow, radius)


def _open(part: Part) -> tuple[Note, ...]:
    ids = tuple(c.id for c in part.contours if not c.closed)
    why = "only what is closed has an inside; join gaps with input.join, or trace them"
    return (
        (Note("skipped", f"{counted(len(ids), 'open contour')} not filled", why, ids),)
        if ids
        else ()
    )


def _rules(kinds: Sequence[Kind], region: IntArray, job: Job) -> tuple[Note, ...]:
    """Which rule was used where."""
    round_, middle, rest = kinds
    starts = (
        np.array([line[0] for line in kind.lines], dtype=complex) for kind in (round_, middle)
    )
    by, along = (set(_region_of(at, region).tolist()) for at in starts)
    apart = short(job.tool.diameter * job.operation.stepover, 3)
    shares = (
        (by - along, f"by passes {apart} mm apart"),
        (along - by, "by centre lines"),
        (by & along, "by both"),
    )
    what = (
        f"{counted(len(by | along), 'region')} to fill: "
        f"{', '.join(f'{len(own)} {how}' for own, how in shares if own)}"
    )
    joined = (
        f" in {counted(len(round_.lines), 'stroke')}" if len(round_.lines) < round_.made_of else ""
    )
    why = (
        f"{counted(round_.made_of, 'pass', 'passes')}{joined}, {counted(len(middle.lines), 'centre line')} "
        f"({sum(middle.thin)} of places thinner than the tool), {counted(len(rest.lines), 'stroke')} for what they left"
    )
    return (Note("assumed", what, why),)
