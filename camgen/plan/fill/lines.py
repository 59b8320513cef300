"""Centre lines of areas too narrow for passes, to a fraction of a pixel, with their ends."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import compute_first_rows, list_owners, number_rows
from camgen.geometry.rings import ComplexArray, normalize
from camgen.geometry.segments import IntArray
from camgen.model.pose import FloatArray
from camgen.plan.fill.ground import FillGrid
from camgen.plan.image_space.border import CLOSE, find_foot, find_near
from camgen.plan.image_space.field import Pixels, sample_field
from camgen.vision.skeleton import Stroke, join_strokes, make_graph, thin_mask

#: Distance to both sides at which the depth is compared to find the middle, as a fraction of the
#: depth.
_SIDE = 0.6
#: Maximum depth as a multiple of the usual depth of a stroke. Beyond is a junction or a widening,
#: in which the depths at the sides are not comparable.
_USUAL = 1.2
#: Maximum shift towards the middle, px.
_MAX_SHIFT_PX = 1.5
#: Width as a multiple of the tool diameter from which on two parallel lines are needed.
_WIDER = 1.02
#: Depth interpolated between pixels at the border, px.
_BORDER = 0.275
#: Minimum length of a line, in tool radii. A shorter one is one touch of the tool.
_DOT = 0.3


class CentreLine(Struct, frozen=True, eq=False):
    """A centre line.

    points: (N,) px, one for a dot. The first point of a closed line is not repeated.
    closed: the line ends at its start.
    wide: half the width of the area there, px.
    """

    points: ComplexArray
    closed: bool
    wide: float


def find_centre_lines(field: FillGrid, radius: float, kept: Pixels) -> Iterator[CentreLine]:
    """The centre lines of the area except `kept` (H, W), for a tool of `radius` px."""
    strokes = join_strokes(make_graph(thin_mask(field.mask, kept), kept, field.depth))
    if not strokes:
        return
    widths, points = centre_strokes(strokes, field, radius)
    for stroke, centred, half in zip(strokes, points, widths, strict=True):
        line = centred if stroke.closed else _move_ends(centred, stroke, field, radius, half)
        if half > _WIDER * radius and len(line) > 2:
            yield from _make_parallel(line, stroke.closed, half, radius)
        else:
            yield CentreLine(line, stroke.closed and len(line) > 2, half)


def centre_strokes(
    strokes: Sequence[Stroke], field: FillGrid, radius: float
) -> tuple[list[float], list[ComplexArray]]:
    """Half the usual width of each stroke, px, and its points moved to the middle."""
    count = np.array([len(s.points) for s in strokes])
    first, stroke, place = compute_first_rows(count), list_owners(count), number_rows(count)
    closed = np.array([s.closed for s in strokes])
    raw = np.concatenate([s.points for s in strokes])
    # There are no points to average beyond the longest stroke.
    reach = min(max(2, round(radius / 2)), int(count.max()))

    def along(step: int) -> IntArray:
        size = count[stroke]
        further = np.where(
            closed[stroke], (place + step) % size, np.clip(place + step, 0, size - 1)
        )
        return np.asarray(first[stroke] + further)

    neighbours = [raw[along(k)] for k in range(-reach, reach + 1)]
    points: ComplexArray = np.asarray(sum(neighbours) / len(neighbours))
    # At the tips the mean, with points on one side only, would shorten the stroke.
    tip = (np.minimum(place, count[stroke] - 1 - place) < reach) & ~closed[stroke]
    points[tip] = raw[tip]
    normal = 1j * normalize(points[along(reach)] - points[along(-reach)])
    depth = sample_field(field.depth, points)
    offset = _SIDE * depth
    left, right = (
        _measure_depths(field, points + side * offset * normal, points + side * depth * normal)
        for side in (1, -1)
    )
    shift = np.clip((left - right) / 2, -_MAX_SHIFT_PX, _MAX_SHIFT_PX)
    half = (left + right) / 2 + offset
    usual = np.array([float(np.median(part)) for part in np.split(depth, first[1:])])
    weight = np.where(depth <= _USUAL * usual[stroke] + 0.5, 1.0, 1e-3)
    rows = [along(k) for k in range(-2 * reach, 2 * reach + 1)]
    mean = np.asarray(sum((weight * shift)[row] for row in rows) / sum(weight[row] for row in rows))
    points = points + normal * mean
    parts = zip(np.split(half, first[1:]), np.split(weight, first[1:]), strict=True)
    widths = [float(np.median(part[good > 0.5])) for part, good in parts]
    return widths, np.split(points, first[1:])


def _measure_depths(field: FillGrid, points: ComplexArray, about: ComplexArray) -> FloatArray:
    """(N,) distance from `points` to the border near `about`, px; from the pixels without one."""
    row = find_near(field.edge, about)
    foot, _ = find_foot(field.edge, points, np.maximum(row, 0), CLOSE)
    sampled, exact = sample_field(field.depth, points), np.abs(points - foot)
    return np.where((row >= 0) & (np.abs(exact - sampled) < 1.5), exact, sampled)


def _move_ends(
    points: ComplexArray, stroke: Stroke, field: FillGrid, radius: float, half: float
) -> ComplexArray:
    """The line with its free ends moved, so that the round end of the tool covers the tip best."""
    # Bare area and ink outside are equal if half the width of the tip is inside the tool.
    from_tip = float(np.sqrt(radius**2 - min(half, radius) ** 2 / 4))
    if stroke.start:
        points = _move_end(points[::-1], field, from_tip, max(half, 1.0))[::-1]
    if stroke.end:
        points = _move_end(points, field, from_tip, max(half, 1.0))
    is_dot = float(np.abs(np.diff(points)).sum()) < _DOT * radius
    return _centre_dot(points[[0, -1]].mean(keepdims=True), field) if is_dot else points


def _move_end(points: ComplexArray, field: FillGrid, from_tip: float, half: float) -> ComplexArray:
    """The line with its last point `from_tip` px before the border."""
    run = np.append(0.0, np.cumsum(np.abs(np.diff(points))))
    direction = points[-1] - points[np.searchsorted(run, run[-1] - 3 * half)]
    if abs(direction) < 0.5:
        return points
    direction /= abs(direction)
    move = _measure_tip(points[-1], direction, field, half) - from_tip
    if move >= 0:
        return np.append(points, points[-1] + move * direction)
    length = run[-1] + move
    if length <= 0:
        # The tool is longer than the line: one touch in the middle.
        return np.array([np.interp(run[-1] / 2, run, points)])
    return np.append(points[run < length], np.interp(length, run, points))


def _measure_tip(end: complex, direction: complex, field: FillGrid, half: float) -> float:
    step = np.arange(0.0, 4 * half + 2.0, 0.25)
    inside = sample_field(field.depth, np.asarray(end + step * direction)) > _BORDER
    sampled = float(step[np.argmin(inside)]) if not inside.all() else float(step[-1])
    about = np.array([end + sampled * direction])
    row = find_near(field.edge, about)
    foot, _ = find_foot(field.edge, about, np.maximum(row, 0), CLOSE)
    exact = float(((foot[0] - end) * direction.conjugate()).real)
    return exact if row[0] >= 0 and abs(exact - sampled) < 1.0 else sampled


def _centre_dot(point: ComplexArray, field: FillGrid) -> ComplexArray:
    """A dot (1,) moved to the middle between the borders on its left and right, above and below."""
    for _ in range(2):
        depth = sample_field(field.depth, point)
        for axis in (1.0, 1j):
            offset = _SIDE * depth * axis
            ahead = _measure_depths(field, point + offset, point + depth * axis)
            back = _measure_depths(field, point - offset, point - depth * axis)
            point = point + axis * np.clip((ahead - back) / 2, -_MAX_SHIFT_PX, _MAX_SHIFT_PX)
    return point


def _make_parallel(
    points: ComplexArray, closed: bool, half: float, radius: float
) -> list[CentreLine]:
    """Two lines that together reach both borders, joined to one if the line is open."""
    ahead = np.roll(points, -1) - points if closed else np.diff(points, append=points[-1:])
    back = points - np.roll(points, 1) if closed else np.diff(points, prepend=points[:1])
    offset = 1j * normalize(ahead + back) * (half - radius)
    if closed:
        return [CentreLine(points + offset, True, half), CentreLine(points - offset, True, half)]
    return [CentreLine(np.concatenate([points + offset, (points - offset)[::-1]]), True, half)]
