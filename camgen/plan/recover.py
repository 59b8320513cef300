"""Arcs that were drawn as many short lines, found again: fewer instructions, an even feed, a faster plan."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec.structs import replace

from camgen.geometry.segments import BoolArray, from_contours
from camgen.geometry.vectors import turns
from camgen.model.part import Contour, Note
from camgen.model.pose import FloatArray, frozen
from camgen.model.text import counted

#: So many lines in a row make an arc; fewer may be meant as corners.
_LEAST_LINES = 6
#: A turn between two lines above this (rad) is a corner, however round the rest is.
_CORNER_TURN = np.radians(20.0)


def recover(
    contours: Sequence[Contour], tolerance: float
) -> tuple[tuple[Contour, ...], tuple[Note, ...]]:
    """The contours with runs of short lines replaced by arcs that leave them by at most ``tolerance`` mm.

    The ends of an arc are drawn points. A note counts what was replaced.
    """
    result = list(contours)
    lines = arcs = 0
    for k in _suspects(contours) if tolerance else []:
        contour, found = _recover(contours[k], tolerance)
        lines += len(contours[k].points) - len(contour.points) + found
        arcs += found
        result[k] = contour
    if not arcs:
        return tuple(contours), ()
    what = f"{counted(lines, 'short line')} recognised as {counted(arcs, 'arc')}"
    return tuple(result), (
        Note("assumed", what, f"within tolerance.arc_fit = {tolerance:g} mm; 0 keeps the lines"),
    )


def _suspects(contours: Sequence[Contour]) -> list[int]:
    """Contours that hold enough lines in a row which turn a little and to one side."""
    long = [k for k, c in enumerate(contours) if len(c.points) > _LEAST_LINES]
    if not long:
        return []
    chosen = [contours[k] for k in long]
    segments = from_contours(chosen)
    bending = np.sign(_turns(segments.start, segments.end)) * ~(
        segments.is_arc[1:] | segments.is_arc[:-1]
    )
    bending[segments.owner[1:] != segments.owner[:-1]] = 0
    same = np.append(False, (bending[1:] == bending[:-1]) & (bending[1:] != 0))
    run = np.arange(len(same)) - np.maximum.accumulate(np.where(same, 0, np.arange(len(same))))
    return sorted({long[o] for o in segments.owner[1:][run >= _LEAST_LINES - 3].tolist()})


def _turns(start: FloatArray, end: FloatArray) -> FloatArray:
    """(N - 1,) signed turn from each segment to the next, rad; 0 for a corner and where it goes straight on."""
    turn = turns((end - start)[:-1], (end - start)[1:])
    return np.where((np.abs(turn) > 1e-7) & (np.abs(turn) < _CORNER_TURN), turn, 0.0)


def _recover(contour: Contour, tolerance: float) -> tuple[Contour, int]:
    """One contour with its arcs, and how many there are."""
    points, bulges = contour.points, contour.bulges
    if contour.closed:
        points, bulges = _from_the_longest(points, bulges)
        points = np.concatenate([points, points[:1]])
    count = len(points) - 1
    line = bulges[:count] == 0.0
    turn = np.append(0.0, _turns(points[:-1], points[1:]))
    kept, kept_bulges = [], []
    k = arcs = 0
    while k < count:
        end = _reach(points, line, turn, k, tolerance)
        kept.append(k)
        kept_bulges.append(bulges[k] if end == k + 1 else _bulge(points, k, end))
        arcs += end > k + 1
        k = end
    if not contour.closed:
        kept.append(count)
        kept_bulges.append(0.0)
    if not arcs:
        return contour, 0
    return replace(contour, points=frozen(points[kept]), bulges=frozen(kept_bulges)), arcs


def _from_the_longest(points: FloatArray, bulges: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A closed contour started with its longest segment, so that the seam does not cut an arc without need."""
    length = np.hypot(*(np.roll(points, -1, axis=0) - points).T)
    first = int(np.argmax(np.round(length, 6)))
    return np.roll(points, -first, axis=0), np.roll(bulges, -first)


def _reach(points: FloatArray, line: BoolArray, turn: FloatArray, k: int, tolerance: float) -> int:
    """The vertex up to which the lines from vertex ``k`` on are one arc; k + 1 if they are none."""
    limit = _run_end(line, turn, k)
    if limit - k < _LEAST_LINES or not _is_arc(points[k : k + _LEAST_LINES + 1], tolerance):
        return k + 1
    good, step = k + _LEAST_LINES, _LEAST_LINES
    while good + step <= limit and _is_arc(points[k : good + step + 1], tolerance):
        good += step
        step *= 2
    while step > 1:
        step //= 2
        if good + step <= limit and _is_arc(points[k : good + step + 1], tolerance):
            good += step
    return good


def _run_end(line: BoolArray, turn: FloatArray, k: int) -> int:
    """The vertex where the lines from ``k`` stop turning to one side, or have turned by half a circle."""
    if not line[k] or k + 1 >= len(line) or turn[k + 1] == 0.0:
        return k + 1
    side = np.sign(turn[k + 1])
    ahead = slice(k + 1, None)
    stop = (
        ~line[ahead]
        | (np.sign(turn[ahead]) != side)
        | (np.abs(np.cumsum(turn[ahead])) > np.pi - _CORNER_TURN)
    )
    hit = np.flatnonzero(stop[:4096])
    return k + 1 + (int(hit[0]) if len(hit) else min(len(stop), 4096))


def _is_arc(points: FloatArray, tolerance: float) -> bool:
    """Whether the polyline is nowhere farther than ``tolerance`` from the arc over its first, middle and last point."""
    centre, radius = _circle(points)
    if not np.isfinite(radius):
        return False
    vertex = np.abs(np.hypot(*(points - centre).T) - radius).max()
    half = np.hypot(*np.diff(points, axis=0).T).max() / 2
    # r - sqrt(r^2 - h^2), without the loss of digits where r is large.
    sagitta = half**2 / (radius + np.sqrt(radius**2 - half**2)) if half < radius else np.inf
    return bool(vertex + sagitta <= tolerance)


def _circle(points: FloatArray) -> tuple[FloatArray, float]:
    p, q, r = points[0], points[len(points) // 2], points[-1]
    u, w = q - p, r - p
    cross = 2 * float(u[0] * w[1] - u[1] * w[0])
    if abs(cross) < 1e-12:
        return p, np.inf
    uu, ww = float(u @ u), float(w @ w)
    centre = p + np.array([w[1] * uu - u[1] * ww, u[0] * ww - w[0] * uu]) / cross
    return centre, float(np.hypot(*(p - centre)))


def _bulge(points: FloatArray, low: int, high: int) -> float:
    """Bulge of the arc over the points low..high."""
    p, r = points[low], points[high]
    centre, _ = _circle(points[low : high + 1])
    a, b = p - centre, r - centre
    sweep = np.arctan2(a[0] * b[1] - a[1] * b[0], float(a @ b))
    middle = points[(low + high) // 2] - p
    side = np.sign((r - p)[1] * middle[0] - (r - p)[0] * middle[1])
    # The middle lies on the right of the chord of a counter-clockwise arc.
    sweep = sweep if np.sign(sweep) == side else sweep + side * 2 * np.pi
    return float(np.tan(sweep / 4))
