"""Sections of tool paths: adds vertices, cuts out stretches, replaces arcs by chords.

Lengths count along a path from its start, mm. Parts of an arc stay arcs. Press directions turn
along an arc, and a floor is interpolated linearly between its waypoints.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec.structs import replace

from camgen.geometry.arcs import Spans, make_span_chain, measure_spans
from camgen.geometry.ragged import count_rows
from camgen.geometry.rotations import turn_vectors
from camgen.geometry.vectors import cross, multiply_rows
from camgen.model.part import BoolArray, IntArray
from camgen.model.path import ToolPath, join_paths, make_waypoints
from camgen.model.pose import FloatArray, frozen
from camgen.model.tolerance import NONZERO, SAME_POINT_MM
from camgen.plan.starting import interpolate_vectors

#: rad: maximum sweep of an arc that one chord replaces, for small arcs.
_MAX_SWEEP = math.radians(30)


def lengths_along(path: ToolPath) -> FloatArray:
    """Length (N,) of each vertex of a path from its start, mm."""
    return np.asarray(
        np.concatenate([[0.0], np.cumsum(measure_spans(path.position, path.via[1:]))])
    )


def split_at(path: ToolPath, lengths: FloatArray) -> ToolPath:
    """The path with a vertex at each of `lengths` (K,), mm.

    Nothing is added within `SAME_POINT_MM` of another vertex.
    """
    vertices = lengths_along(path)
    added = np.unique(lengths)
    added = added[np.diff(added, prepend=-np.inf) > SAME_POINT_MM]
    after = np.clip(np.searchsorted(vertices, added), 1, len(vertices) - 1)
    is_new = np.minimum(added - vertices[after - 1], vertices[after] - added) > SAME_POINT_MM
    added, after = added[is_new], after[is_new]
    fraction = (added - vertices[after - 1]) / (vertices[after] - vertices[after - 1])
    return _expand(path, after - 1, fraction)[0]


def point_at(path: ToolPath, length: float) -> FloatArray:
    """The point (3,) at `length` mm from the start of a path, or the end nearest to it."""
    return np.asarray(points_at(path, np.array([length]))[0])


def points_at(path: ToolPath, lengths: FloatArray) -> FloatArray:
    """The points (K, 3) at `lengths` (K,), mm, from the start of a path, or the nearest ends."""
    vertices = lengths_along(path)
    segment = np.clip(np.searchsorted(vertices, lengths) - 1, 0, len(vertices) - 2)
    size = np.maximum(vertices[segment + 1] - vertices[segment], NONZERO)
    fraction = np.clip((lengths - vertices[segment]) / size, 0.0, 1.0)
    return np.asarray(make_span_chain(path.position, path.via[1:]).point(fraction, segment))


def nearest(path: ToolPath, point: FloatArray) -> tuple[float, float]:
    """The point of a path that is nearest to `point` (3,).

    Returns its length from the start of the path and its distance from `point`, both in mm.
    """
    shape = make_span_chain(path.position, path.via[1:])
    arms = point - _centres(shape, np.arange(len(shape.length)))
    angle = np.arctan2(multiply_rows(arms, shape.along), multiply_rows(arms, shape.towards))
    on_arc = angle / np.where(shape.curved, shape.sweep, 1.0) + 0.5
    on_line = multiply_rows(point - shape.start, shape.along) / np.maximum(shape.length, NONZERO)
    fraction = np.clip(np.where(shape.curved, on_arc, on_line), 0.0, 1.0)
    distance = np.linalg.norm(shape.point(fraction) - point, axis=1)
    k = int(np.argmin(distance))
    return float(lengths_along(path)[k] + fraction[k] * shape.length[k]), float(distance[k])


def head(path: ToolPath, length: float) -> ToolPath:
    """The first `length` mm of a path, as an open path."""
    split = split_at(path, np.array([length]))
    return split.rows(0, _vertex(split, length) + 1)


def begin_at(path: ToolPath, length: float) -> ToolPath:
    """A closed path with its start point moved forwards by `length`, mm; it keeps its floor."""
    split = split_at(path, np.array([length]))
    vertex, last = _vertex(split, length), len(split.position) - 1
    if vertex in (0, last):
        return path
    moved = join_paths([split.rows(vertex, last + 1), split.rows(0, vertex + 1)])
    return replace(moved, closed=True, reversible=path.reversible)


def stretch(path: ToolPath, begin: float, length: float) -> ToolPath:
    """`length` mm of a closed path, as an open path; it may be longer than one turn.

    begin: start of the stretch, mm from the start of the path.
    """
    moved = begin_at(path, begin)
    turns, rest = divmod(length, float(lengths_along(path)[-1]))
    parts = [moved] * int(turns)
    if rest > SAME_POINT_MM:
        parts.append(head(moved, rest))
    return join_paths(parts)


def _vertex(path: ToolPath, length: float) -> int:
    """Index of the vertex that is nearest to `length` mm from the start, along the path."""
    return int(np.argmin(np.abs(lengths_along(path) - length)))


def chorded(path: ToolPath, chord: float, which: BoolArray | None = None) -> ToolPath:
    """The path with chords in place of arcs. They never come nearer to the surface in contact.

    The chords of an arc around the surface touch that arc from outside. On any other arc the ends
    of the chords lie on the arc.

    chord: maximum deviation of the chords from an arc, mm.
    which: (N - 1,) whether a segment is replaced; None for all.
    """
    shape = make_span_chain(path.position, path.via[1:])
    rows = np.flatnonzero(shape.curved if which is None else shape.curved & which)
    if not len(rows):
        return path
    radius, sweep = shape.radius[rows], shape.sweep[rows]
    count = np.ceil(sweep / _steps(radius, chord)).astype(np.int64)
    towards_start = shape.start[rows] - _centres(shape, rows)
    outside = multiply_rows(path.force_direction[rows + 1, 0], towards_start) < -1e-9 * radius
    inner = [
        (np.arange(n) + 0.5) / n if is_outside else np.arange(1, n) / n
        for n, is_outside in zip(count.tolist(), outside.tolist(), strict=True)
    ]
    result, owner, part = _expand(path, np.repeat(rows, count_rows(inner)), np.concatenate(inner))
    via, position = result.via.copy(), result.position.copy()
    via[1 + np.flatnonzero(np.isin(owner, rows))] = np.nan
    pushed = np.flatnonzero(np.isin(owner, rows[outside]) & (part < 1))
    centre = _centres(shape, owner[pushed])
    half = np.zeros(len(shape.sweep))
    half[rows] = sweep / count / 2
    stretching = np.cos(half[owner[pushed]])[:, None]
    position[pushed + 1] = centre + (position[pushed + 1] - centre) / stretching
    return result.with_columns(via=via, position=position)


def shortest(path: ToolPath, chord: float) -> float:
    """Minimum length of `chorded` for one mm of a path: 1 without arcs, less with arcs.

    chord: maximum deviation of the chords from an arc, mm.
    """
    shape = make_span_chain(path.position, path.via[1:])
    half = _steps(shape.radius[shape.curved], chord) / 2
    return float(np.min(np.sin(half) / half, initial=1.0))


def _steps(radius: FloatArray, chord: float) -> FloatArray:
    """Sweep (N,) of the arc that one chord replaces, rad.

    Such a chord touches the arc from outside and deviates from it by `chord` at its ends.

    radius: (N,) radii of arcs, mm.
    chord: mm.
    """
    return np.asarray(np.minimum(2 * np.arccos(radius / (radius + chord)), _MAX_SWEEP))


def _centres(shape: Spans, row: IntArray) -> FloatArray:
    return np.asarray(shape.via[row] - shape.radius[row, None] * shape.towards[row])


def _expand(
    path: ToolPath, segment: IntArray, fraction: FloatArray
) -> tuple[ToolPath, IntArray, FloatArray]:
    """Add a vertex at a fraction of each of some segments.

    segment: (K,) from 0 to N - 2.
    fraction: (K,) from 0 to 1, along the segment.

    Returns the new path. For each of its segments, returns the old segment of which it is a part,
    and the fraction of that old segment at which it ends.
    """
    count = len(path.position) - 1
    owner = np.concatenate([segment, np.arange(count)])
    part = np.concatenate([fraction, np.ones(count)])
    order = np.lexsort((part, owner))
    owner, part = owner[order], part[order]
    before = np.where(np.diff(owner, prepend=-1) > 0, 0.0, np.roll(part, 1))
    shape = make_span_chain(path.position, path.via[1:])
    is_whole = (before == 0) & (part == 1)
    row = owner + 1
    is_inside, axis = (part < 1)[:, None], path.axis
    position = np.where(is_inside, shape.point(part, owner), path.position[row])
    via = np.where(is_whole[:, None], path.via[row], shape.point((before + part) / 2, owner))
    via[~shape.curved[owner]] = np.nan
    press = np.stack([_press_at(path, shape, owner, end) for end in (before, part)], axis=1)
    press = np.where(is_whole[:, None, None], path.force_direction[row], press)
    axes = np.where(is_inside, interpolate_vectors(axis[owner], axis[row], part), axis[row])
    floor = path.floor
    if floor is not None:
        at_ends = floor[owner] + part * (floor[row] - floor[owner])
        floor = frozen(np.concatenate([floor[:1], at_ends]))
    expanded = replace(
        path,
        table=make_waypoints(
            position=np.concatenate([path.position[:1], position]),
            via=np.concatenate([np.full((1, 3), np.nan), via]),
            axis=np.concatenate([axis[:1], axes]),
            force_direction=np.concatenate([press[:1], press]),
            force=np.concatenate([path.force[1:2], path.force[row]]),
            feed=np.concatenate([path.feed[1:2], path.feed[row]]),
        ),
        floor=floor,
    )
    return expanded, owner, part


def _press_at(path: ToolPath, shape: Spans, owner: IntArray, fraction: FloatArray) -> FloatArray:
    """Press directions (M, 3) at `fraction` (M,) of the segments `owner` (M,).

    On an arc they turn with the tangent. On a line they are interpolated.
    """
    press = path.force_direction[owner + 1]
    turned = interpolate_vectors(press[:, 0], press[:, 1], fraction)
    arc = np.flatnonzero(shape.curved[owner])
    arc_owner = owner[arc]
    axle = cross(shape.towards[arc_owner], shape.along[arc_owner])
    turned[arc] = turn_vectors(press[arc, 0], axle, fraction[arc] * shape.sweep[arc_owner])
    return turned
