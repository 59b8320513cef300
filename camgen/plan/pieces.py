"""Pieces of tool paths: vertices added on the way, stretches of them, and chords in place of arcs.

Lengths count along a path from its start, mm. Arcs stay arcs where they are cut, press turns with them, and a floor
runs straight on between its waypoints.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec.structs import replace

from camgen.geometry.arcs import Spans, chain, span_lengths
from camgen.geometry.rotations import turn_vectors
from camgen.geometry.vectors import cross, dots
from camgen.model.part import BoolArray, IntArray
from camgen.model.path import ToolPath, join_paths, waypoints
from camgen.model.pose import FloatArray, frozen
from camgen.model.tolerance import NONZERO, SAME_POINT_MM
from camgen.plan.starting import between

#: A chord never stands for more of an arc than this, rad, however small the arc is.
_WIDEST = math.radians(30)


def lengths_along(path: ToolPath) -> FloatArray:
    """(N,) mm from the start of ``path`` to each of its vertices."""
    return np.asarray(np.concatenate([[0.0], np.cumsum(span_lengths(path.position, path.via[1:]))]))


def split_at(path: ToolPath, lengths: FloatArray) -> ToolPath:
    """``path`` with a vertex at each of ``lengths`` (K,), but where there is one already, within 1e-6 mm."""
    at = lengths_along(path)
    wanted = np.unique(lengths)
    wanted = wanted[np.diff(wanted, prepend=-np.inf) > SAME_POINT_MM]
    after = np.clip(np.searchsorted(at, wanted), 1, len(at) - 1)
    new = (wanted - at[after - 1] > SAME_POINT_MM) & (at[after] - wanted > SAME_POINT_MM)
    wanted, after = wanted[new], after[new]
    return _expand(path, after - 1, (wanted - at[after - 1]) / (at[after] - at[after - 1]))[0]


def point_at(path: ToolPath, length: float) -> FloatArray:
    """(3,) the point ``length`` mm after the start of ``path``, at one of its ends beyond them."""
    at = lengths_along(path)
    segment = np.clip(np.searchsorted(at, [length]) - 1, 0, len(at) - 2)
    fraction = (length - at[segment]) / np.maximum(at[segment + 1] - at[segment], NONZERO)
    return np.asarray(
        chain(path.position, path.via[1:]).point(np.clip(fraction, 0.0, 1.0), segment)[0]
    )


def nearest(path: ToolPath, point: FloatArray) -> tuple[float, float]:
    """Where on ``path`` is nearest to ``point`` (3,), mm from its start, and how far away that is, mm."""
    shape = chain(path.position, path.via[1:])
    arms = point - _centres(shape, np.arange(len(shape.length)))
    turn = np.arctan2(dots(arms, shape.along), dots(arms, shape.towards)) / np.where(
        shape.curved, shape.sweep, 1.0
    )
    ahead = dots(point - shape.start, shape.along) / np.maximum(shape.length, NONZERO)
    fraction = np.clip(np.where(shape.curved, turn + 0.5, ahead), 0.0, 1.0)
    away = np.linalg.norm(shape.point(fraction) - point, axis=1)
    k = int(np.argmin(away))
    return float(lengths_along(path)[k] + fraction[k] * shape.length[k]), float(away[k])


def head(path: ToolPath, length: float) -> ToolPath:
    """The first ``length`` mm of ``path``, as an open path."""
    split = split_at(path, np.array([length]))
    return split.rows(0, _vertex(split, length) + 1)


def begin_at(path: ToolPath, length: float) -> ToolPath:
    """The closed ``path`` begun ``length`` mm after its start; with its floor, if it has one."""
    split = split_at(path, np.array([length]))
    vertex, last = _vertex(split, length), len(split.position) - 1
    if vertex in (0, last):
        return path
    turned = join_paths([split.rows(vertex, last + 1), split.rows(0, vertex + 1)])
    return replace(turned, closed=True, reversible=path.reversible)


def stretch(path: ToolPath, begin: float, length: float) -> ToolPath:
    """From ``begin`` on the closed ``path`` for ``length`` mm, round and round, as an open path."""
    begun = begin_at(path, begin)
    rounds, rest = divmod(length, float(lengths_along(path)[-1]))
    pieces = [begun] * int(rounds) + ([head(begun, rest)] if rest > SAME_POINT_MM else [])
    return join_paths(pieces)


def _vertex(path: ToolPath, length: float) -> int:
    """The vertex that is ``length`` mm after the start."""
    return int(np.argmin(np.abs(lengths_along(path) - length)))


def chorded(path: ToolPath, chord: float, which: BoolArray | None = None) -> ToolPath:
    """``path`` with chords that leave its arcs by ``chord`` mm at most; they never come nearer to what it presses on.

    which: (N - 1,) the segments that it is done to, all if not given. Around what is pressed on the chords touch the
    arc from outside, everywhere else their ends are on it.
    """
    shape = chain(path.position, path.via[1:])
    rows = np.flatnonzero(shape.curved if which is None else shape.curved & which)
    if not len(rows):
        return path
    radius, sweep = shape.radius[rows], shape.sweep[rows]
    count = np.ceil(sweep / _steps(radius, chord)).astype(np.int64)
    outside = (
        dots(path.force_direction[rows + 1, 0], shape.start[rows] - _centres(shape, rows))
        < -1e-9 * radius
    )
    inner = [
        (np.arange(n) + 0.5) / n if out else np.arange(1, n) / n
        for n, out in zip(count.tolist(), outside.tolist(), strict=True)
    ]
    cuts = np.concatenate(inner)
    result, owner, part = _expand(path, np.repeat(rows, [len(one) for one in inner]), cuts)
    via, position = result.via.copy(), result.position.copy()
    via[1 + np.flatnonzero(np.isin(owner, rows))] = np.nan
    pushed = np.flatnonzero(np.isin(owner, rows[outside]) & (part < 1))
    centre = _centres(shape, owner[pushed])
    half = np.zeros(len(shape.sweep))
    half[rows] = sweep / count / 2
    position[pushed + 1] = (
        centre + (position[pushed + 1] - centre) / np.cos(half[owner[pushed]])[:, None]
    )
    return result.with_columns(via=via, position=position)


def shortest(path: ToolPath, chord: float) -> float:
    """The least length of ``chorded`` of any stretch of ``path`` for each mm of it: below 1 where it has arcs."""
    shape = chain(path.position, path.via[1:])
    half = _steps(shape.radius[shape.curved], chord) / 2
    return float(np.min(np.sin(half) / half, initial=1.0))


def _steps(radius: FloatArray, chord: float) -> FloatArray:
    """The angles (N,) whose chords touch arcs of ``radius`` from outside and leave them by ``chord`` at their ends."""
    return np.asarray(np.minimum(2 * np.arccos(radius / (radius + chord)), _WIDEST))


def _centres(shape: Spans, row: IntArray) -> FloatArray:
    return np.asarray(shape.via[row] - shape.radius[row, None] * shape.towards[row])


def _expand(
    path: ToolPath, segment: IntArray, fraction: FloatArray
) -> tuple[ToolPath, IntArray, FloatArray]:
    """``path`` with vertices at each ``fraction`` (K,) 0..1 of each ``segment`` (K,) 0..N-2; and by segment of the
    result the one of the path that it is of, and at what fraction of that it ends.
    """
    count = len(path.position) - 1
    owner, part = (
        np.concatenate([segment, np.arange(count)]),
        np.concatenate([fraction, np.ones(count)]),
    )
    order = np.lexsort((part, owner))
    owner, part = owner[order], part[order]
    before = np.where(np.diff(owner, prepend=-1) > 0, 0.0, np.roll(part, 1))
    shape, whole, row = chain(path.position, path.via[1:]), (before == 0) & (part == 1), owner + 1
    inside, axis = (part < 1)[:, None], path.axis
    position = np.where(inside, shape.point(part, owner), path.position[row])
    via = np.where(whole[:, None], path.via[row], shape.point((before + part) / 2, owner))
    via[~shape.curved[owner]] = np.nan
    press = np.stack([_press_at(path, shape, owner, at) for at in (before, part)], axis=1)
    press = np.where(whole[:, None, None], path.force_direction[row], press)
    floor = path.floor
    held = None if floor is None else floor[owner] + part * (floor[row] - floor[owner])
    made = replace(
        path,
        table=waypoints(
            position=np.concatenate([path.position[:1], position]),
            via=np.concatenate([np.full((1, 3), np.nan), via]),
            axis=np.concatenate(
                [axis[:1], np.where(inside, between(axis[owner], axis[row], part), axis[row])]
            ),
            force_direction=np.concatenate([press[:1], press]),
            force=np.concatenate([path.force[1:2], path.force[row]]),
            feed=np.concatenate([path.feed[1:2], path.feed[row]]),
        ),
        floor=None if floor is None or held is None else frozen(np.concatenate([floor[:1], held])),
    )
    return made, owner, part


def _press_at(path: ToolPath, shape: Spans, owner: IntArray, fraction: FloatArray) -> FloatArray:
    """The press directions (M, 3) at ``fraction`` (M,) of the segments ``owner`` (M,): they turn with an arc."""
    press = path.force_direction[owner + 1]
    turned = between(press[:, 0], press[:, 1], fraction)
    arc = np.flatnonzero(shape.curved[owner])
    of = owner[arc]
    axle = cross(shape.towards[of], shape.along[of])
    turned[arc] = turn_vectors(press[arc, 0], axle, fraction[arc] * shape.sweep[of])
    return turned
