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

from camgen.errors import InputError
from camgen.geometry.segments import IntArray
from camgen.paths import ToolPath
from camgen.planners.columns import pass_depths
from camgen.planners.coverage import Coverage
from camgen.planners.fill_cover import lines_of, measured, painted
from camgen.planners.fill_ground import Ground, ground
from camgen.planners.fill_lines import Line, centre_lines
from camgen.planners.fill_passes import core, passes
from camgen.planners.fill_rest import uncovered
from camgen.planners.image_space_rings import ComplexArray
from camgen.settings import Job
from camgen.shapes import Note, Part
from camgen.text import short

#: Strokes are thinned out within this, px of the grid, where the job does not say.
_SIMPLIFY = 0.2
#: What is left bare is worth a stroke from this share of the tool's disc on.
_WORTH = 0.05


class Kind(Struct, frozen=True, eq=False):
    """Strokes of one kind. mark: what their ids begin with. lines: (N,) px each, the first again where closed."""

    mark: str
    lines: list[ComplexArray]
    closed: list[bool]
    thin: list[bool]


def fill(part: Part, job: Job) -> tuple[tuple[ToolPath, ...], tuple[Note, ...], Coverage]:
    """Strokes that cover what the closed contours of ``part`` enclose, even-odd, notes, and what they cover.

    Of a picture the borders in it count. Raises InputError where nothing is closed, JobError for a tool that is too
    small for the picture or the drawing.
    """
    if not any(c.closed for c in part.contours):
        raise InputError(part.source, "no closed contour to fill", remedy="trace it, or close its outlines")
    field = ground(part, job.tool.diameter / 2)
    kinds = _strokes(field, job.tool.diameter / 2 / field.mm_per_px, job)
    region = _regions(field)
    paths = _paths(field, kinds, _layers(part, field, region), region, job)
    coverage = covered_by(field, paths, [thin for kind in kinds for thin in kind.thin], job.tool.diameter / 2)
    return paths, (*_open(part), *_rules(kinds, region, job)), coverage


def _strokes(field: Ground, radius: float, job: Job) -> list[Kind]:
    simplify = job.tolerance.simplify
    near = max(job.tolerance.chord / field.mm_per_px, _SIMPLIFY) if simplify is None else simplify / field.mm_per_px
    wide = passes(field, radius, 2 * radius * job.operation.stepover)
    round_ = Kind("f", [_thinned(points, True, near) for points in wide], [True] * len(wide), [False] * len(wide))
    middle = _kind("m", centre_lines(field, radius, core(field, radius)), near, radius)
    ink = painted(*lines_of(round_.lines + middle.lines), radius, field.mask.shape[:2])
    rest = uncovered(field, ink, radius, _WORTH * np.pi * radius**2)
    return [round_, middle, _kind("r", rest, near, 0.0)]


def _kind(mark: str, lines: Sequence[Line], near: float, radius: float) -> Kind:
    """radius: a place less than twice as wide is thinner than the tool."""
    points = [_thinned(line.points, line.closed, near) for line in lines]
    return Kind(mark, points, [line.closed for line in lines], [line.wide < radius for line in lines])


def _thinned(points: ComplexArray, closed: bool, near: float) -> ComplexArray:
    """The points that a line needs to stay within ``near`` px (Douglas and Peucker 1973); closed: the first again."""
    if len(points) > 2 and near > 0:
        flat = np.column_stack([points.real, points.imag]).astype(np.float32)[:, None]
        points = cv2.approxPolyDP(flat, near, closed)[:, 0].astype(np.float64) @ np.array([1, 1j])
    return np.append(points, points[:1]) if closed else points


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


def _layers(part: Part, field: Ground, region: IntArray) -> dict[int, str]:
    """The layer of each region: that of the longest border around it."""
    layers = [part.contours[k].layer for k in field.contour.tolist()]
    if len(set(layers)) == 1:
        return dict.fromkeys(range(int(region.max()) + 1), layers[0])
    table = field.edge.table
    found: dict[int, str] = {}
    for k in np.argsort(table.count, kind="stable").tolist():
        rows = slice(int(table.first[k]), int(table.first[k] + table.count[k]))
        inside = _region_of(field.edge.points[rows], region)
        found[int(np.bincount(inside).argmax())] = layers[k]
    return found


def _paths(
    field: Ground, kinds: Sequence[Kind], layers: dict[int, str], region: IntArray, job: Job
) -> tuple[ToolPath, ...]:
    lines = [line for kind in kinds for line in kind.lines]
    if not lines:
        return ()
    counts = np.array([len(line) for line in lines])
    low = np.cumsum(counts) - counts
    flat = np.concatenate(lines)
    where = _region_of(flat[low], region).tolist()
    position = np.column_stack([field.placed(flat), np.zeros(len(flat))])
    via = np.full_like(position, np.nan)
    axis = np.tile([0.0, 0.0, -1.0], (len(flat), 1))
    press = np.zeros((len(flat), 2, 3))
    if job.process.force:
        press[:, :, 2] = -1.0
    force, feed = np.full(len(flat), job.process.force), np.full(len(flat), job.process.feed)
    for column in (position, via, axis, press, force, feed):
        column.flags.writeable = False
    names = [(f"{kind.mark}{k}", closed) for kind in kinds for k, closed in enumerate(kind.closed, 1)]
    rows = [slice(a, a + n) for a, n in zip(low.tolist(), counts.tolist(), strict=True)]
    return tuple(
        ToolPath(
            id=name,
            layer=layers.get(at, layers[min(layers)]),
            position=position[own],
            via=via[own],
            axis=axis[own],
            press=press[own],
            force=force[own],
            feed=feed[own],
            closed=closed,
            depths=pass_depths(job.operation.depth, job.operation.passes),
        )
        for (name, closed), at, own in zip(names, where, rows, strict=True)
    )


def covered_by(field: Ground, paths: Sequence[ToolPath], thin: Sequence[bool], radius: float) -> Coverage:
    """What the paths cover of the ground, mm2, from where the tool will be. thin: whose ink beside is counted apart."""
    edge = field.placed(field.edge.points) @ np.array([1, 1j])
    lines = [path.position[:, :2] @ np.array([1, 1j]) for path in paths]
    wide = [line for line, apart in zip(lines, thin, strict=True) if not apart]
    narrow = [line for line, apart in zip(lines, thin, strict=True) if apart]
    return measured(field.edge.table, edge, wide, narrow, radius)


def _open(part: Part) -> tuple[Note, ...]:
    ids = tuple(c.id for c in part.contours if not c.closed)
    why = "only what is closed has an inside; join gaps with input.join, or trace them"
    return (Note("skipped", f"{len(ids)} open contours not filled", why, ids),) if ids else ()


def _rules(kinds: Sequence[Kind], region: IntArray, job: Job) -> tuple[Note, ...]:
    """Which rule was used where."""
    round_, middle, rest = kinds
    starts = (np.array([line[0] for line in kind.lines], dtype=complex) for kind in (round_, middle))
    by, along = (set(_region_of(at, region).tolist()) for at in starts)
    apart = short(job.tool.diameter * job.operation.stepover, 3)
    shares = ((by - along, f"by passes {apart} mm apart"), (along - by, "by centre lines"), (by & along, "by both"))
    what = f"{len(by | along)} regions to fill: {', '.join(f'{len(own)} {how}' for own, how in shares if own)}"
    why = (
        f"{len(round_.lines)} passes, {len(middle.lines)} centre lines ({sum(middle.thin)} of places thinner than the "
        f"tool), {len(rest.lines)} strokes for what they left"
    )
    return (Note("assumed", what, why),)
