"""Parts of lines and arcs that lie on each other.

Segments with one supporting line or circle, within a tolerance, are a group. Along the support each
of them is an interval. In order of their ranks the intervals take free places; the rest of an
interval is covered. Groups come from sorted columns: segments with different supports are never
compared.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterator
from itertools import chain

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import find_run_starts, mark_run_starts
from camgen.geometry.segments import IntArray, Segments, compute_bounds, points_at
from camgen.model.pose import FloatArray
from camgen.model.tolerance import SAME_POINT_MM

#: Differences of direction, rad, up to which lines may have one support. The small one keeps exact
#: repetitions together in drawings with many directions, the large one finds rounded ones.
_DIRECTIONS = (1e-6, 1e-3)

#: Curves lie on each other up to this share of their length, within the tolerance. So the short
#: segments of a small drawing are not swallowed.
_SHARE = 0.02
#: Share of the tolerance within which the supports of a pattern of many close curves are one.
_NEARLY = 0.02
#: Distance up to which two drawn curves lie on each other, mm, however large the gaps between ends
#: are that are joined.
SAME_CURVE_MM = 0.05

#: Fractions (low, high) of a segment that are covered, in order.
Parts = list[tuple[float, float]]
Chain = tuple[FloatArray, FloatArray]


class _Intervals(Struct, frozen=True, eq=False):
    """Segments along their supports.

    row: (M,) index of the segment; an arc over the direction 0 is there twice.
    group: (M,) number of the support.
    low, high: (M,) along it, mm.
    at_low, at_high: (M,) fraction of the segment there.
    """

    row: IntArray
    group: IntArray
    low: FloatArray
    high: FloatArray
    at_low: FloatArray
    at_high: FloatArray

    def take(self, rows: IntArray) -> _Intervals:
        """The intervals of `rows`, in that order."""
        return _Intervals(*(getattr(self, name)[rows] for name in self.__struct_fields__))


def find_covered(
    segments: Segments, rank: IntArray, label: IntArray, tolerance: float
) -> dict[int, Parts]:
    """Parts of segments that lie on segments of a lower rank and another owner, by their index.

    rank: (N,) rank of each segment; segments of the lowest rank are never covered.
    label: (N,) segments of different labels do not cover each other.
    tolerance: distance up to which two segments lie on each other, mm, above 0, and 2 % of their
        lengths at most; shorter overlaps and rests are ignored.
    """
    covered: dict[int, Parts] = {}
    lowest = int(rank.min(initial=0))
    lines = np.flatnonzero(~segments.is_arc)
    arcs = np.flatnonzero(segments.is_arc)
    length = segments.length
    allowed = _allow(length, tolerance)
    intervals = [_place_lines(segments, lines, label, cell, allowed) for cell in _DIRECTIONS]
    intervals.append(_place_arcs(segments, arcs, label, allowed))
    for placed in intervals:
        for members in _list_groups(placed, tolerance):
            _cover(placed.take(members), segments.owner, rank, (lowest, tolerance), covered)
    return {
        row: _merge(parts, tolerance / max(float(length[row]), tolerance))
        for row, parts in sorted(covered.items())
    }


def _allow(length: FloatArray, tolerance: float) -> FloatArray:
    """(N,) distance up to which curves of these lengths lie on each other, mm."""
    return np.clip(_SHARE * length, 4 * SAME_POINT_MM, tolerance)


def _place_lines(
    segments: Segments, rows: IntArray, label: IntArray, cell: float, allowed: FloatArray
) -> _Intervals:
    """Lines along their supports: groups of one direction within `cell` rad."""
    start, end = segments.start[rows], segments.end[rows]
    along = end - start
    angle = np.arctan2(along[:, 1], along[:, 0]) % math.pi
    angle = np.where(angle > math.pi - 2 * cell, angle - math.pi, angle)
    group = _cluster(label[rows], angle, np.full(len(rows), cell))
    # The direction of a group is that of its middle line, exact if most of them are parallel.
    order = np.lexsort([angle, group])
    first = find_run_starts(group[order])
    middle = order[(first + np.append(first[1:], len(order))) // 2] if len(order) else order
    direction = np.column_stack([np.cos(angle[middle]), np.sin(angle[middle])])[group]
    offset = np.column_stack([_cross(direction, start), _cross(direction, end)])
    parallel = np.abs(offset[:, 1] - offset[:, 0]) <= allowed[rows]
    rows, group, direction = rows[parallel], group[parallel], direction[parallel]
    group = _cluster(group, offset[parallel].mean(axis=1), allowed[rows])
    ends = np.column_stack(
        [
            np.einsum("nd,nd->n", direction, start[parallel]),
            np.einsum("nd,nd->n", direction, end[parallel]),
        ]
    )
    at_low = np.where(ends[:, 1] >= ends[:, 0], 0.0, 1.0)
    return _Intervals(rows, group, ends.min(axis=1), ends.max(axis=1), at_low, 1 - at_low)


def _cross(direction: FloatArray, points: FloatArray) -> FloatArray:
    return np.asarray(direction[:, 0] * points[:, 1] - direction[:, 1] * points[:, 0])


def _place_arcs(
    segments: Segments, rows: IntArray, label: IntArray, allowed: FloatArray
) -> _Intervals:
    """Arcs along their circles, from the direction 0 on, cut there."""
    columns = np.column_stack([segments.centre[rows], segments.radius[rows]])
    group, shared = _cluster_rows(label[rows], columns, allowed[rows])
    rows = rows[shared]
    arm = segments.start[rows] - segments.centre[rows]
    sweep, radius = segments.sweep[rows], segments.radius[rows]
    angle = np.arctan2(arm[:, 1], arm[:, 0])
    low = np.minimum(angle, angle + sweep) % (2 * math.pi)
    high = low + np.abs(sweep)
    at_low = np.where(sweep > 0, 0.0, 1.0)
    wrapped = np.flatnonzero(high > 2 * math.pi)
    at_cut = at_low + (1 - 2 * at_low) * (2 * math.pi - low) / np.abs(sweep)
    at_high = 1 - at_low
    at_high[wrapped] = at_cut[wrapped]
    size = np.concatenate([radius, radius[wrapped]])
    return _Intervals(
        np.concatenate([rows, rows[wrapped]]),
        np.concatenate([group, group[wrapped]]),
        np.concatenate([low, np.zeros(len(wrapped))]) * size,
        np.concatenate([np.minimum(high, 2 * math.pi), high[wrapped] - 2 * math.pi]) * size,
        np.concatenate([at_low, at_cut[wrapped]]),
        np.concatenate([at_high, 1 - at_low[wrapped]]),
    )


def _cluster(label: IntArray, value: FloatArray, allowed: FloatArray) -> IntArray:
    """(N,) numbers of groups of one label with close values.

    allowed: (N,) largest difference of each value from the next one of its group. In a wider group,
        which is a pattern, only values that are nearly equal stay together.
    """
    order = np.lexsort([value, label])
    labels, ranked, limit = label[order], value[order], allowed[order]
    gap = np.diff(ranked)
    begins = mark_run_starts(labels)
    begins[1:] |= gap > np.minimum(limit[1:], limit[:-1])
    number = np.cumsum(begins) - 1
    first = np.flatnonzero(begins)
    last = np.append(first[1:], len(ranked)) - 1
    if len(ranked):
        width = ranked[last] - ranked[first]
        is_pattern = (width > np.maximum.reduceat(limit, first))[number]
        begins[1:] |= is_pattern[1:] & (gap > _NEARLY * limit[1:])
    group = np.empty(len(value), np.int64)
    group[order] = np.cumsum(begins) - 1
    return group


def _cluster_rows(
    label: IntArray, columns: FloatArray, allowed: FloatArray
) -> tuple[IntArray, IntArray]:
    """Groups of rows of one label that agree in all columns (N, C) within `allowed` (N,).

    Returns the number of the group of each row in a group of two or more, and these rows.
    """
    group, rows = label, np.arange(len(label))
    for column in columns.T:
        group = _cluster(group, column[rows], allowed[rows])
        shared = np.bincount(group, minlength=1)[group] > 1
        group, rows = group[shared], rows[shared]
    return group, rows


def _list_groups(intervals: _Intervals, least: float) -> Iterator[IntArray]:
    """Rows of each group in which two intervals have more than `least` mm in common."""
    if not len(intervals.row):
        return
    order = np.lexsort([intervals.low, intervals.group])
    group, low, high = (
        column[order] for column in (intervals.group, intervals.low, intervals.high)
    )
    span = float(np.ptp(np.concatenate([low, high]))) + 1
    # Shifted by its number, a group lies beyond all groups before it.
    shift = group * span
    reach = np.maximum.accumulate(high + shift)
    overlaps = np.zeros(len(low), np.bool_)
    overlaps[1:] = (low + shift)[1:] < reach[:-1] - least
    starts = find_run_starts(group)
    has_overlap = np.logical_or.reduceat(overlaps, starts)
    ends = np.append(starts[1:], len(group))
    for first, after in zip(starts[has_overlap].tolist(), ends[has_overlap].tolist(), strict=True):
        yield order[first:after]


def _cover(
    members: _Intervals,
    owner: IntArray,
    rank: IntArray,
    limits: tuple[int, float],
    covered: dict[int, Parts],
) -> None:
    """Adds the covered parts of the intervals of one group to `covered`.

    limits: the rank that is never covered, and the length that is ignored, mm.
    """
    lowest, least = limits
    lows: list[float] = []
    highs: list[float] = []
    owners: list[int] = []
    for k in np.argsort(rank[members.row], kind="stable").tolist():
        row = int(members.row[k])
        low, high = float(members.low[k]), float(members.high[k])
        at_low, at_high = float(members.at_low[k]), float(members.at_high[k])
        scale = (at_high - at_low) / max(high - low, np.finfo(float).tiny)
        free: list[tuple[float, float]] = []
        done = low
        place = max(bisect_right(lows, low) - 1, 0)
        while place < len(lows) and lows[place] < high:
            first, last = max(lows[place], low), min(highs[place], high)
            if first < last:
                if first > done:
                    free.append((done, first))
                done = max(done, last)
                if owners[place] != owner[row] and rank[row] > lowest and last - first > least:
                    ends = (at_low + (first - low) * scale, at_low + (last - low) * scale)
                    covered.setdefault(row, []).append((min(ends), max(ends)))
            place += 1
        if done < high:
            free.append((done, high))
        for first, last in free:
            place = bisect_right(lows, first)
            lows.insert(place, first)
            highs.insert(place, last)
            owners.insert(place, int(owner[row]))


def _merge(parts: Parts, least: float) -> Parts:
    """Disjoint parts in order; rests of at most `least` between them and at ends are covered."""
    merged: Parts = []
    for low, high in sorted(parts):
        if merged and low - merged[-1][1] <= least:
            merged[-1] = (merged[-1][0], max(merged[-1][1], high))
        else:
            merged.append((low, high))
    if merged[0][0] <= least:
        merged[0] = (0.0, merged[0][1])
    if merged[-1][1] >= 1 - least:
        merged[-1] = (merged[-1][0], 1.0)
    return merged


def measure_covered(segments: Segments, covered: dict[int, Parts]) -> float:
    """Length of all covered parts, mm."""
    length = segments.length
    total = 0.0
    for row, parts in covered.items():
        total += float(length[row]) * sum(high - low for low, high in parts)
    return total


def cut_chain(
    points: FloatArray, bulges: FloatArray, closed: bool, parts: dict[int, Parts]
) -> list[Chain]:
    """Open chains of points and bulges that remain of a chain without the covered `parts`.

    parts: covered fractions of the segments of the chain, by their index.
    """
    count = len(points) if closed else len(points) - 1
    chains: list[tuple[list[FloatArray], list[float]]] = []
    # Whether the segment before is free up to its end.
    is_open = False
    for k in range(count):
        start, end, bulge = points[k], points[(k + 1) % len(points)], float(bulges[k])
        for low, high in _list_free(parts.get(k, [])):
            begin, finish = (_point_at(start, end, bulge, at) for at in (low, high))
            if low > 0 or not is_open:
                chains.append(([begin], []))
            chains[-1][0].append(finish)
            chains[-1][1].append(math.tan(math.atan(bulge) * (high - low)))
            is_open = high == 1
        if parts.get(k) and parts[k][-1][1] == 1:
            is_open = False
    is_first_free = not parts.get(0) or parts[0][0][0] > 0
    if closed and is_first_free and is_open and len(chains) > 1:
        head = chains.pop(0)
        chains[-1][0].extend(head[0][1:])
        chains[-1][1].extend(head[1])
    return [(np.array(rows), np.array([*bends, 0.0])) for rows, bends in chains]


def _list_free(covered: Parts) -> Parts:
    edges = [0.0, *chain.from_iterable(covered), 1.0]
    return [(low, high) for low, high in zip(edges[::2], edges[1::2], strict=True) if high > low]


def _point_at(start: FloatArray, end: FloatArray, bulge: float, fraction: float) -> FloatArray:
    """The point at a fraction of a line or an arc; exact at its ends."""
    if fraction in (0.0, 1.0):
        return end if fraction else start
    chord = end - start
    if bulge == 0:
        return np.asarray(start + fraction * chord)
    centre = (start + end) / 2 + np.array([-chord[1], chord[0]]) * (1 - bulge * bulge) / (4 * bulge)
    angle = 4 * math.atan(bulge) * fraction
    arm = start - centre
    return np.asarray(
        centre + math.cos(angle) * arm + math.sin(angle) * np.array([-arm[1], arm[0]])
    )


def find_equal_loops(
    segments: Segments, count: int, label: IntArray, tolerance: float
) -> list[int]:
    """Loops that have the shape and the place of an earlier one of their label, in order.

    segments: segments of `count` closed loops, loop after loop, `owner` counting them.
    label: (count,) loops of different labels are not compared.
    """
    starts = np.searchsorted(segments.owner, np.arange(count))
    sides = compute_bounds(segments) * np.array([1, 1, -1, -1])
    lengths = np.add.reduceat(segments.length, starts)
    allowed = _allow(lengths, tolerance)
    group, loops = _cluster_rows(label, np.minimum.reduceat(sides, starts), allowed)
    order = np.argsort(group, kind="stable")
    dropped: list[int] = []
    kept: list[int] = []
    for first, k in zip(mark_run_starts(group[order]).tolist(), loops[order].tolist(), strict=True):
        if first:
            kept = []
        if _is_repeated(segments, k, kept, lengths, tolerance):
            dropped.append(k)
        else:
            kept.append(k)
    return sorted(dropped)


def _is_repeated(
    segments: Segments, loop: int, others: list[int], lengths: FloatArray, tolerance: float
) -> bool:
    """Whether a loop lies on one of `others`, and that one on the loop."""
    from camgen.geometry.intersect import measure_nearest  # noqa: PLC0415 (it loads shapely)

    loop_segments = segments.take(segments.owner == loop)
    for other in others:
        other_segments = segments.take(segments.owner == other)
        # Along each segment the lengths of two loops differ by the tolerance at most.
        allowed = 2 * tolerance * max(len(loop_segments), len(other_segments))
        if abs(lengths[loop] - lengths[other]) > allowed:
            continue
        forth = measure_nearest(_sample(loop_segments), other_segments, 2 * tolerance)
        back = measure_nearest(_sample(other_segments), loop_segments, 2 * tolerance)
        if max(forth.max(), back.max()) <= _allow(lengths[[loop]], tolerance)[0]:
            return True
    return False


#: Points of a segment that are compared with another loop, as fractions of its length.
_SAMPLES = (0.0, 0.25, 0.5, 0.75)


def _sample(segments: Segments) -> FloatArray:
    points = [points_at(segments, np.full(len(segments), at)) for at in _SAMPLES]
    return np.concatenate(points)
