"""Centre lines of what is too narrow for passes: its middle to a part of a pixel, and how far to go at its ends."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import begins, owners, ramp
from camgen.geometry.rings import ComplexArray, unit
from camgen.geometry.segments import IntArray
from camgen.model.pose import FloatArray
from camgen.plan.fill.ground import Ground, Pixels
from camgen.plan.image_space.border import CLOSE, foot, near
from camgen.plan.image_space.field import sample_field
from camgen.vision.skeleton import Stroke, join_strokes, make_graph, thin_mask

#: How far to both sides the depth is compared to find the middle, of the depth there; more than the usual depth by this
#: factor is a junction or a widening, where the sides say nothing.
_SIDE, _USUAL = 0.6, 1.2
#: The middle is moved by this much at most, px.
_MOST_SHIFT_PX = 1.5
#: A place wider than the tool by more than this factor takes two lines side by side.
_WIDER = 1.02
#: Depth, px, that is seen between pixels where the border is.
_BORDER = 0.275
#: A line shorter than this, in tool radii, is one touch of the tool.
_DOT = 0.3


class CentreLine(Struct, frozen=True, eq=False):
    """points: (N,) px, N = 1 for a dot, the first not repeated where closed. wide: half the width there, px."""

    points: ComplexArray
    closed: bool
    wide: float


def centre_lines(field: Ground, radius: float, kept: Pixels) -> list[CentreLine]:
    """The lines along the middle of `field` where it is not `kept` (H, W), for a tool of `radius` px."""
    depth = field.depth
    lines = thin_mask(field.mask, kept)
    found = join_strokes(make_graph(lines, kept, depth))
    if not found:
        return []
    wide, points = centre(found, field, radius)
    result = []
    for stroke, own, half in zip(found, points, wide, strict=True):
        ends = own if stroke.closed else _close_ends(own, stroke, field, radius, half)
        if half > _WIDER * radius and len(ends) > 2:
            result += _side_by_side(ends, stroke.closed, half, radius)
        else:
            result.append(CentreLine(ends, stroke.closed and len(ends) > 2, half))
    return result


def centre(
    found: Sequence[Stroke], field: Ground, radius: float
) -> tuple[list[float], list[ComplexArray]]:
    """Half the usual width of each stroke, px, and its points in the middle."""
    count = np.array([len(s.points) for s in found])
    first, stroke, place = begins(count), owners(count), ramp(count)
    closed = np.array([s.closed for s in found])
    raw = np.concatenate([s.points for s in found])
    # Farther than the longest stroke there is nothing to average.
    reach = min(max(2, round(radius / 2)), int(count.max()))

    def along(by: int) -> IntArray:
        size = count[stroke]
        further = np.where(closed[stroke], (place + by) % size, np.clip(place + by, 0, size - 1))
        return np.asarray(first[stroke] + further)

    points = _mean([raw[along(k)] for k in range(-reach, reach + 1)])
    # The mean of what lies on one side only would draw the ends in.
    tip = (np.minimum(place, count[stroke] - 1 - place) < reach) & ~closed[stroke]
    points[tip] = raw[tip]
    normal = 1j * unit(points[along(reach)] - points[along(-reach)])
    here = sample_field(field.depth, points)
    off = _SIDE * here
    left, right = (
        _depths(field, points + side * off * normal, points + side * here * normal)
        for side in (1, -1)
    )
    shift = np.clip((left - right) / 2, -_MOST_SHIFT_PX, _MOST_SHIFT_PX)
    half = (left + right) / 2 + off
    usual = np.array([float(np.median(part)) for part in np.split(here, first[1:])])
    weight = np.where(here <= _USUAL * usual[stroke] + 0.5, 1.0, 1e-3)
    ways = [along(k) for k in range(-2 * reach, 2 * reach + 1)]
    even = np.asarray(sum((weight * shift)[at] for at in ways) / sum(weight[at] for at in ways))
    points = points + normal * even
    parts = zip(np.split(half, first[1:]), np.split(weight, first[1:]), strict=True)
    wide = [float(np.median(part[good > 0.5])) for part, good in parts]
    return wide, np.split(points, first[1:])


def _depths(field: Ground, points: ComplexArray, about: ComplexArray) -> FloatArray:
    """Px (N,) from `points` to the border near `about`; of the pixels where there is none."""
    row = near(field.edge, about)
    on, _ = foot(field.edge, points, np.maximum(row, 0), CLOSE)
    seen, exact = sample_field(field.depth, points), np.abs(points - on)
    return np.where((row >= 0) & (np.abs(exact - seen) < 1.5), exact, seen)


def _mean(columns: Sequence[ComplexArray]) -> ComplexArray:
    return np.asarray(sum(columns) / len(columns))


def _close_ends(
    points: ComplexArray, stroke: Stroke, field: Ground, radius: float, half: float
) -> ComplexArray:
    """The line with its free ends where the tool's round end and the end of what it covers leave each other least."""
    # As much of the end is missed as is inked beyond it where half of the end's width lies within the tool.
    from_tip = float(np.sqrt(radius**2 - min(half, radius) ** 2 / 4))
    for free, back in ((stroke.start, True), (stroke.end, False)):
        if free:
            points = points[::-1] if back else points
            points = _end_moved(points, field, from_tip, max(half, 1.0))
            points = points[::-1] if back else points
    short = float(np.abs(np.diff(points)).sum()) < _DOT * radius
    return _in_the_middle(points[[0, -1]].mean(keepdims=True), field) if short else points


def _end_moved(points: ComplexArray, field: Ground, from_tip: float, half: float) -> ComplexArray:
    """The line with its last point `from_tip` px from where it would leave the ground."""
    run = np.append(0.0, np.cumsum(np.abs(np.diff(points))))
    back = int(np.searchsorted(run, run[-1] - 3 * half))
    way = points[-1] - points[back]
    if abs(way) < 0.5:
        return points
    way /= abs(way)
    move = _tip(points[-1], way, field, half) - from_tip
    if move >= 0:
        return np.append(points, points[-1] + move * way)
    left = run[-1] + move
    if left <= 0:
        # The tool is longer than the line: it is put down once, in the middle.
        return np.array([np.interp(run[-1] / 2, run, points)])
    k = int(np.searchsorted(run, left))
    return np.append(points[:k], np.interp(left, run, points))


def _tip(end: complex, way: complex, field: Ground, half: float) -> float:
    """How far (px) from `end` along `way` (unit) the border is."""
    step = np.arange(0.0, 4 * half + 2.0, 0.25)
    inside = sample_field(field.depth, np.asarray(end + step * way)) > _BORDER
    seen = float(step[np.argmin(inside)]) if not inside.all() else float(step[-1])
    about = np.array([end + seen * way])
    row = near(field.edge, about)
    on, _ = foot(field.edge, about, np.maximum(row, 0), CLOSE)
    exact = float(((on[0] - end) * way.conjugate()).real)
    return exact if row[0] >= 0 and abs(exact - seen) < 1.0 else seen


def _in_the_middle(point: ComplexArray, field: Ground) -> ComplexArray:
    """A dot (1,) moved to the middle between what is left and right, above and below of it."""
    for _ in range(2):
        here = sample_field(field.depth, point)
        for way in (1.0, 1j):
            off = _SIDE * here * way
            ahead, behind = (
                _depths(field, point + s * off, point + s * here * way) for s in (1, -1)
            )
            point = point + way * np.clip((ahead - behind) / 2, -_MOST_SHIFT_PX, _MOST_SHIFT_PX)
    return point


def _side_by_side(
    points: ComplexArray, closed: bool, half: float, radius: float
) -> list[CentreLine]:
    """Two lines that together reach both borders; of an open line they are one, there and back."""
    ahead = np.roll(points, -1) - points if closed else np.diff(points, append=points[-1:])
    behind = points - np.roll(points, 1) if closed else np.diff(points, prepend=points[:1])
    off = 1j * unit(ahead + behind) * (half - radius)
    if closed:
        return [CentreLine(points + off, True, half), CentreLine(points - off, True, half)]
    return [CentreLine(np.concatenate([points + off, (points - off)[::-1]]), True, half)]
