"""Passes joined by bridges, so that the tool covers a region without a lift.

Where two passes are no farther apart than one pass from the next, and the tool has room on the straight way between
them, it goes over there, once round, and back the same way. Of all such bridges the shortest that hold the passes
together are taken (Kruskal 1956), so that the passes of a region become one closed stroke, which may begin anywhere.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import shapely
from msgspec import Struct

from camgen.geometry.ragged import owners
from camgen.geometry.rings import ComplexArray
from camgen.geometry.segments import BoolArray, IntArray
from camgen.geometry.vectors import nearest_row
from camgen.model.pose import FloatArray
from camgen.plan.fill.ground import Ground
from camgen.plan.image_space.field import sample_field

#: Passes are looked at within so many px when bridges are looked for.
_NEAR_PX = 0.2
#: A bridge may be longer than from pass to pass by this factor, and the tool nearer to the border by so many px.
_LONGER, _ROOM_PX = 1.1, 0.75
#: Places along a bridge where that is looked at.
_PLACES = np.linspace(0.0, 1.0, 9)


class Bridge(Struct, frozen=True):
    """From the point with index `leaves` of one pass to the point `arrives` of the pass `to`."""

    leaves: int
    to: int
    arrives: int


def join_passes(
    field: Ground, passes: Sequence[ComplexArray], radius: float, spacing: float
) -> list[ComplexArray]:
    """Closed strokes (N,) px of the closed `passes`, joined where they can be. No first point again.

    radius: of the tool, spacing: from pass to pass, both px.
    """
    bridges: list[list[Bridge]] = [[] for _ in passes]
    group = list(range(len(passes)))
    for one, other, start, end in _find_bridges(field, passes, radius, _LONGER * spacing):
        a, b = _root(group, one), _root(group, other)
        if a != b:
            group[b] = a
            leaves = nearest_row(passes[one], start)
            arrives = nearest_row(passes[other], end)
            bridges[one].append(Bridge(leaves, other, arrives))
            bridges[other].append(Bridge(arrives, one, leaves))
    heads = [k for k in range(len(passes)) if _root(group, k) == k]
    return [_walk(passes, bridges, k) if bridges[k] else passes[k] for k in heads]


def _find_bridges(
    field: Ground, passes: Sequence[ComplexArray], radius: float, most: float
) -> list[tuple[int, int, complex, complex]]:
    """Pairs of passes and the ends of the shortest way between them, the shortest first, where the tool has room."""
    thin = [_thinned(points) for points in passes]
    lines = np.array([shapely.LineString(points) for points in thin], dtype=object)
    one, other = _near_each_other(thin, most)
    ends = shapely.get_coordinates(shapely.shortest_line(lines[one], lines[other])) @ np.array(
        [1, 1j]
    )
    start, end = ends[::2], ends[1::2]
    good = _has_room(field, start, end, radius)
    order = np.argsort(np.abs(end - start), kind="stable")
    rows = order[good[order]]
    return list(
        zip(
            one[rows].tolist(),
            other[rows].tolist(),
            start[rows].tolist(),
            end[rows].tolist(),
            strict=True,
        )
    )


def _near_each_other(passes: Sequence[FloatArray], most: float) -> IntArray:
    """(2, N) the pairs of `passes` no farther apart than `most`.

    Looked for among their lines, since the box around a whole pass holds many others.
    """
    if not passes:
        return np.zeros((2, 0), dtype=np.int64)
    owner = owners([len(points) - 1 for points in passes])
    ends = np.stack(
        [np.concatenate([p[:-1] for p in passes]), np.concatenate([p[1:] for p in passes])], axis=1
    )
    lines = shapely.linestrings(ends)
    low, high = ends.min(axis=1) - most, ends.max(axis=1) + most
    pairs = shapely.STRtree(lines).query(shapely.box(*low.T, *high.T))
    one, other = pairs[:, owner[pairs[0]] < owner[pairs[1]]]
    near = shapely.dwithin(lines[one], lines[other], most)
    return np.unique(owner[[one[near], other[near]]], axis=1)


def _thinned(points: ComplexArray) -> FloatArray:
    """(N, 2) of the closed line, the first point again."""
    flat = np.column_stack([points.real, points.imag]).astype(np.float32)[:, None]
    kept = cv2.approxPolyDP(flat, _NEAR_PX, True)[:, 0].astype(np.float64)
    return np.append(kept, kept[:1], axis=0)


def _has_room(field: Ground, start: ComplexArray, end: ComplexArray, radius: float) -> BoolArray:
    """Where (N,) the tool keeps its radius from the border all the way."""
    way = start[:, None] + (end - start)[:, None] * _PLACES
    depth = sample_field(field.depth, way.ravel()).reshape(way.shape)
    return np.asarray((depth >= radius - _ROOM_PX).all(axis=1))


def _root(group: list[int], k: int) -> int:
    while group[k] != k:
        group[k] = group[group[k]]
        k = group[k]
    return k


def _walk(
    passes: Sequence[ComplexArray], bridges: Sequence[Sequence[Bridge]], head: int
) -> ComplexArray:
    """Once round the pass `head`, over each bridge on the way to what is beyond it, and back."""
    pieces: list[ComplexArray] = []
    # Of each pass that is not done: where it began, what is left of its bridges by the way there, and where it stands.
    open_ = [(head, 0, _by_way(passes[head], bridges[head], 0, -1), 0)]
    while open_:
        k, begin, left, at = open_.pop()
        size = len(passes[k])
        if not left:
            pieces.append(passes[k][_stretch(begin, at, size, size)])
            continue
        place, bridge = left[0]
        pieces.append(passes[k][_stretch(begin, at, place, size)])
        open_.append((k, begin, left[1:], place))
        there = _by_way(passes[bridge.to], bridges[bridge.to], bridge.arrives, k)
        open_.append((bridge.to, bridge.arrives, there, 0))
    return np.concatenate(pieces)[:-1]


def _by_way(
    points: ComplexArray, bridges: Sequence[Bridge], begin: int, came: int
) -> list[tuple[int, Bridge]]:
    """The bridges of a pass but the one it was reached by, each with the steps from `begin` to it, in that order."""
    others = [bridge for bridge in bridges if bridge.to != came]
    return sorted(
        (((bridge.leaves - begin) % len(points), bridge) for bridge in others),
        key=lambda one: one[0],
    )


def _stretch(begin: int, first: int, last: int, size: int) -> IntArray:
    """The rows from step `first` to step `last` after `begin` of a closed line, both included."""
    return np.asarray((begin + np.arange(first, last + 1)) % size)
