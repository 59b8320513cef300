"""Joins passes by bridges, so that the tool covers a region without a lift.

If two passes are about one spacing apart and the tool has room on the straight line between them,
the tool crosses there, runs the other pass once, and returns on the same line. The shortest bridges
that connect all passes are chosen (Kruskal 1956). The passes of a region then are one closed
stroke, which may start anywhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from operator import itemgetter

import cv2
import numpy as np
import shapely
from msgspec import Struct

from camgen.geometry.ragged import count_rows, find_root, list_owners
from camgen.geometry.rings import ComplexArray
from camgen.geometry.segments import BoolArray, IntArray
from camgen.geometry.vectors import find_nearest_row
from camgen.model.pose import FloatArray
from camgen.plan.fill.ground import FillGrid
from camgen.plan.image_space.field import sample_field

#: Tolerance to which passes are thinned out before bridges are searched, px.
_NEAR_PX = 0.2
#: Maximum length of a bridge as a multiple of the spacing of the passes.
_LONGER = 1.1
#: Maximum length by which the tool may reach beyond the border on a bridge, px.
_OVERLAP_PX = 0.75
#: Sample positions along a bridge, as fractions.
_PLACES = np.linspace(0.0, 1.0, 9)


class Bridge(Struct, frozen=True):
    """A bridge between two passes.

    leaves: index of the point of this pass.
    to: index of the other pass.
    arrives: index of the point of the other pass.
    """

    leaves: int
    to: int
    arrives: int


def join_passes(
    field: FillGrid, passes: Sequence[ComplexArray], radius: float, spacing: float
) -> list[ComplexArray]:
    """Join the closed `passes` to closed strokes (N,) px, without a repeated first point.

    radius: radius of the tool, px.
    spacing: distance between neighbouring passes, px.
    """
    bridges: list[list[Bridge]] = [[] for _ in passes]
    group = list(range(len(passes)))
    for first, second, start, end in _find_bridges(field, passes, radius, _LONGER * spacing):
        a, b = find_root(group, first), find_root(group, second)
        if a != b:
            group[b] = a
            leaves = find_nearest_row(passes[first], start)
            arrives = find_nearest_row(passes[second], end)
            bridges[first].append(Bridge(leaves, second, arrives))
            bridges[second].append(Bridge(arrives, first, leaves))
    heads = [k for k in range(len(passes)) if find_root(group, k) == k]
    return [_join_group(passes, bridges, k) for k in heads]


def _find_bridges(
    field: FillGrid, passes: Sequence[ComplexArray], radius: float, max_length: float
) -> list[tuple[int, int, complex, complex]]:
    """Pairs of passes, with the ends of the line between them, the shortest line first.

    Only lines on which the tool has room.
    """
    if not passes:
        return []
    thinned = [_thin_out(points) for points in passes]
    lines = shapely.linestrings(np.concatenate(thinned), indices=list_owners(count_rows(thinned)))
    first, second = _find_near_pairs(thinned, max_length)
    shortest = shapely.get_coordinates(shapely.shortest_line(lines[first], lines[second]))
    ends = shortest @ np.array([1, 1j])
    start, end = ends[::2], ends[1::2]
    order = np.argsort(np.abs(end - start), kind="stable")
    rows = order[_has_room(field, start, end, radius)[order]]
    columns = first[rows].tolist(), second[rows].tolist(), start[rows].tolist(), end[rows].tolist()
    return list(zip(*columns, strict=True))


def _find_near_pairs(passes: Sequence[FloatArray], distance: float) -> IntArray:
    """(2, N) indices of pairs of `passes` at most `distance` px apart.

    Single segments are compared, since the box around a whole pass contains many other passes.
    """
    owner = list_owners(count_rows(passes) - 1)
    starts, ends = np.concatenate([p[:-1] for p in passes]), np.concatenate([p[1:] for p in passes])
    segments = np.stack([starts, ends], axis=1)
    lines = shapely.linestrings(segments)
    low, high = segments.min(axis=1) - distance, segments.max(axis=1) + distance
    pairs = shapely.STRtree(lines).query(shapely.box(*low.T, *high.T))
    first, second = pairs[:, owner[pairs[0]] < owner[pairs[1]]]
    near = shapely.dwithin(lines[first], lines[second], distance)
    return np.unique(owner[[first[near], second[near]]], axis=1)


def _thin_out(points: ComplexArray) -> FloatArray:
    flat = np.column_stack([points.real, points.imag]).astype(np.float32)[:, None]
    kept = cv2.approxPolyDP(flat, _NEAR_PX, True)[:, 0].astype(np.float64)
    return np.append(kept, kept[:1], axis=0)


def _has_room(field: FillGrid, start: ComplexArray, end: ComplexArray, radius: float) -> BoolArray:
    """(N,) true if the tool keeps its radius from the border on a line, within `_OVERLAP_PX`."""
    points = start[:, None] + (end - start)[:, None] * _PLACES
    depth = sample_field(field.depth, points.ravel()).reshape(points.shape)
    return np.asarray((depth >= radius - _OVERLAP_PX).all(axis=1))


def _join_group(
    passes: Sequence[ComplexArray], bridges: Sequence[Sequence[Bridge]], head: int
) -> ComplexArray:
    """The pass `head` once, with a detour over each bridge to the passes beyond it."""
    pieces: list[ComplexArray] = []
    # For each unfinished pass: its first point, its remaining bridges in order, and the steps done.
    unfinished = [(head, 0, _sort_bridges(passes[head], bridges[head], 0, -1), 0)]
    while unfinished:
        k, begin, pending, done = unfinished.pop()
        size = len(passes[k])
        if not pending:
            pieces.append(passes[k][_list_rows(begin, done, size, size)])
            continue
        place, bridge = pending[0]
        pieces.append(passes[k][_list_rows(begin, done, place, size)])
        unfinished.append((k, begin, pending[1:], place))
        target = bridge.to
        ordered = _sort_bridges(passes[target], bridges[target], bridge.arrives, k)
        unfinished.append((target, bridge.arrives, ordered, 0))
    return np.concatenate(pieces)[:-1]


def _sort_bridges(
    points: ComplexArray, bridges: Sequence[Bridge], begin: int, source: int
) -> list[tuple[int, Bridge]]:
    """The bridges of a pass except that to `source`, with their steps from `begin`, in order."""
    size = len(points)
    steps = [((bridge.leaves - begin) % size, bridge) for bridge in bridges if bridge.to != source]
    return sorted(steps, key=itemgetter(0))


def _list_rows(begin: int, first: int, last: int, size: int) -> IntArray:
    return np.asarray((begin + np.arange(first, last + 1)) % size)
