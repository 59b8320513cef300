"""Loops that can be taken as they are: convex, and nothing else within their box. Most holes of a plate are."""

from __future__ import annotations

import numpy as np
import shapely

from camgen.geometry.boxes import boxed
from camgen.geometry.segments import BoolArray, IntArray, Segments, bounds, neighbours, tangents_at
from camgen.pose import FloatArray

#: Turning against the sense of the loop by up to this is rounding, rad; a sharper corner than the other is none.
_STRAIGHT, _BACK = 1e-9, 3.0
#: Boxes that are looked at together: bounds the memory of a query.
_CHUNK = 500_000


def plain(segments: Segments, count: int) -> BoolArray:
    """(count,): which of the closed loops that own ``segments``, in order, are convex and alone in their box."""
    result = _convex(segments, count)
    loops = np.flatnonzero(result)
    result[loops] = _alone(segments, loops)
    return result


def loop_areas(segments: Segments, count: int) -> FloatArray:
    """Signed areas (count,), mm2, of closed loops, arcs exact: shoelace about each loop's first point, and segments."""
    first = np.searchsorted(segments.owner, np.arange(count))
    origin = segments.start[np.minimum(first, len(segments) - 1)][segments.owner]
    a, b = segments.start - origin, segments.end - origin
    area = (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2
    rows = np.flatnonzero(segments.is_arc)
    sweep = segments.sweep[rows]
    area[rows] += segments.radius[rows] ** 2 * (sweep - np.sin(sweep)) / 2
    return np.asarray(np.bincount(segments.owner, area, count))


def _convex(segments: Segments, count: int) -> BoolArray:
    """Loops that turn one way only, and once round."""
    size = len(segments)
    following = neighbours(segments, np.ones(count, dtype=np.bool_))
    leaves, arrives = tangents_at(segments, np.zeros(size)), tangents_at(segments, np.ones(size))
    after = leaves[following]
    corner = np.arctan2(
        arrives[:, 0] * after[:, 1] - arrives[:, 1] * after[:, 0],
        arrives[:, 0] * after[:, 0] + arrives[:, 1] * after[:, 1],
    )
    turn = np.bincount(segments.owner, segments.sweep + corner, count)
    sense = np.sign(turn)[segments.owner]
    wrong = (segments.sweep * sense < 0) | (corner * sense < -_STRAIGHT) | (np.abs(corner) > _BACK)
    many = np.bincount(segments.owner, minlength=count) >= 2
    return np.asarray(
        many & (np.abs(np.abs(turn) - 2 * np.pi) < 1e-6) & (np.bincount(segments.owner, wrong, count) == 0)
    )


def _alone(segments: Segments, loops: IntArray) -> BoolArray:
    """(M,): which of ``loops`` have no segment of another loop in their box."""
    boxes = bounds(segments)
    owners, first = np.unique(segments.owner, return_index=True)
    place = np.searchsorted(owners, loops)
    low, high = np.minimum.reduceat(boxes[:, :2], first)[place], np.maximum.reduceat(boxes[:, 2:], first)[place]
    tree = shapely.STRtree(boxed(boxes))
    result = np.ones(len(loops), dtype=np.bool_)
    step, done = 256, 0
    while done < len(loops):
        rows = slice(done, done + step)
        which, segment = tree.query(boxed(np.column_stack([low[rows], high[rows]])))
        result[done + which[segments.owner[segment] != loops[rows][which]]] = False
        done += step
        # As many loops at a time as the last ones let expect.
        step = int(np.clip(_CHUNK * step / max(len(which), 1), 16, 4 * step))
    return result
