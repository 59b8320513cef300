"""Replaces short lines by the arcs that they approximate, for fewer motions and an even feed."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from msgspec.structs import replace

from camgen.geometry.segments import BoolArray, make_contour_segments
from camgen.geometry.vectors import measure_signed_angles
from camgen.model.part import Contour, Note, tabulate_contours
from camgen.model.pose import FloatArray, frozen
from camgen.model.sequences import take_rows
from camgen.model.text import counted

#: Minimum number of lines of an arc. Fewer may be corners.
_MIN_LINES = 6
#: Angle between two lines from which on they form a corner, rad.
_CORNER_TURN = np.radians(20.0)
#: Maximum number of lines that one search for the end of an arc looks at.
_MAX_LINES = 4096


def recover_arcs(
    contours: Sequence[Contour], tolerance: float
) -> tuple[tuple[Contour, ...], tuple[Note, ...]]:
    """Replace sequences of short lines by arcs that differ from them by at most `tolerance` mm.

    The ends of an arc are drawn points. A note counts the replaced lines.
    """
    result = list(contours)
    lines = arcs = 0
    for k in _find_candidates(contours) if tolerance else []:
        contour, count = _recover(contours[k], tolerance)
        lines += len(contours[k].points) - len(contour.points) + count
        arcs += count
        result[k] = contour
    if not arcs:
        return tuple(contours), ()
    return tuple(result), (
        Note(
            "assumed",
            f"{counted(lines, 'short line')} recognised as {counted(arcs, 'arc')}",
            f"within tolerance.arc_fit = {tolerance:g} mm; 0 keeps the lines",
        ),
    )


def _find_candidates(contours: Sequence[Contour]) -> list[int]:
    """Indices of contours with enough successive lines that turn slightly to one side."""
    long = np.flatnonzero(tabulate_contours(contours).counts > _MIN_LINES).tolist()
    if not long:
        return []
    segments = make_contour_segments(take_rows(contours, long))
    is_line = ~(segments.is_arc[1:] | segments.is_arc[:-1])
    bending = np.sign(_compute_turns(segments.start, segments.end)) * is_line
    bending[segments.owner[1:] != segments.owner[:-1]] = 0
    same = np.append(False, (bending[1:] == bending[:-1]) & (bending[1:] != 0))
    run = np.arange(len(same)) - np.maximum.accumulate(np.where(same, 0, np.arange(len(same))))
    return take_rows(long, np.unique(segments.owner[1:][run >= _MIN_LINES - 3]))


def _compute_turns(start: FloatArray, end: FloatArray) -> FloatArray:
    """(N - 1,) signed angle from each segment to the next, rad; 0 at corners, straight joints."""
    turn = measure_signed_angles((end - start)[:-1], (end - start)[1:])
    return np.where((np.abs(turn) > 1e-7) & (np.abs(turn) < _CORNER_TURN), turn, 0.0)


def _recover(contour: Contour, tolerance: float) -> tuple[Contour, int]:
    points, bulges = contour.points, contour.bulges
    if contour.closed:
        points, bulges = _start_at_longest(points, bulges)
        points = np.concatenate([points, points[:1]])
    count = len(points) - 1
    line = bulges[:count] == 0.0
    turn = np.append(0.0, _compute_turns(points[:-1], points[1:]))
    kept, kept_bulges = [], []
    k = arcs = 0
    while k < count:
        end = _find_arc_end(points, line, turn, k, tolerance)
        kept.append(k)
        kept_bulges.append(bulges[k] if end == k + 1 else _compute_bulge(points, k, end))
        arcs += end > k + 1
        k = end
    if not contour.closed:
        kept.append(count)
        kept_bulges.append(0.0)
    if not arcs:
        return contour, 0
    return replace(contour, points=frozen(points[kept]), bulges=frozen(kept_bulges)), arcs


def _start_at_longest(points: FloatArray, bulges: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotate a closed contour to its longest segment, so that the seam divides no arc."""
    length = np.hypot(*(np.roll(points, -1, axis=0) - points).T)
    first = int(np.argmax(np.round(length, 6)))
    return np.roll(points, -first, axis=0), np.roll(bulges, -first)


def _find_arc_end(
    points: FloatArray, line: BoolArray, turn: FloatArray, k: int, tolerance: float
) -> int:
    """The vertex up to which the lines from vertex `k` on are one arc; k + 1 without an arc."""

    def is_arc(first: int, last: int) -> bool:
        return _is_arc(points[first : last + 1], tolerance)

    limit = _find_turn_end(line, turn, k)
    if limit - k < _MIN_LINES or not is_arc(k, k + _MIN_LINES):
        return k + 1
    return find_farthest(is_arc, k, k + _MIN_LINES, limit, _MIN_LINES)


def find_farthest(
    fits: Callable[[int, int], bool], k: int, good: int, limit: int, step: int = 1
) -> int:
    """The last index up to `limit` to which a line or an arc from `k` fits, by doubling steps.

    It fits to `good`, and is assumed to fit to all indices before the last one.

    step: the first step.
    """
    while good + step <= limit and fits(k, good + step):
        good += step
        step *= 2
    while step > 1:
        step //= 2
        if good + step <= limit and fits(k, good + step):
            good += step
    return good


def _find_turn_end(line: BoolArray, turn: FloatArray, k: int) -> int:
    """The vertex up to which the lines from `k` on turn to one side, by at most half a circle."""
    if not line[k] or k + 1 >= len(line) or turn[k + 1] == 0.0:
        return k + 1
    side = np.sign(turn[k + 1])
    ahead = slice(k + 1, None)
    stop = (
        ~line[ahead]
        | (np.sign(turn[ahead]) != side)
        | (np.abs(np.cumsum(turn[ahead])) > np.pi - _CORNER_TURN)
    )
    stops = np.flatnonzero(stop[:_MAX_LINES])
    return k + 1 + (int(stops[0]) if len(stops) else min(len(stop), _MAX_LINES))


def _is_arc(points: FloatArray, tolerance: float) -> bool:
    """True if a polyline is within `tolerance` of the arc over its first, middle, last point."""
    centre, radius = _fit_circle(points)
    if not np.isfinite(radius):
        return False
    vertex = np.abs(np.hypot(*(points - centre).T) - radius).max()
    half = np.hypot(*np.diff(points, axis=0).T).max() / 2
    # r - sqrt(r^2 - h^2), without the loss of digits for a large r.
    sagitta = half**2 / (radius + np.sqrt(radius**2 - half**2)) if half < radius else np.inf
    return bool(vertex + sagitta <= tolerance)


def _fit_circle(points: FloatArray) -> tuple[FloatArray, float]:
    p, q, r = points[0], points[len(points) // 2], points[-1]
    u, w = q - p, r - p
    cross = 2 * float(u[0] * w[1] - u[1] * w[0])
    if abs(cross) < 1e-12:
        return p, np.inf
    uu, ww = float(u @ u), float(w @ w)
    centre = p + np.array([w[1] * uu - u[1] * ww, u[0] * ww - w[0] * uu]) / cross
    return centre, float(np.hypot(*(p - centre)))


def _compute_bulge(points: FloatArray, first: int, last: int) -> float:
    p, r = points[first], points[last]
    centre, _ = _fit_circle(points[first : last + 1])
    a, b = p - centre, r - centre
    sweep = np.arctan2(a[0] * b[1] - a[1] * b[0], float(a @ b))
    middle = points[(first + last) // 2] - p
    side = np.sign((r - p)[1] * middle[0] - (r - p)[0] * middle[1])
    # The middle lies on the right of the chord of a counter-clockwise arc.
    sweep = sweep if np.sign(sweep) == side else sweep + side * 2 * np.pi
    return float(np.tan(sweep / 4))
