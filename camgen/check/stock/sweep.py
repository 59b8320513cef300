"""Areas that tools take away at one depth, seen from above: unions of swept discs."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import shapely

from camgen.check.stock.cells import CHORD_MM, Shapes
from camgen.check.stock.moves import Cut, Moves, Portions
from camgen.check.stock.profile import reach
from camgen.geometry.ragged import run_lengths, starts_run
from camgen.geometry.segments import BoolArray, IntArray, Segments, flatten, make
from camgen.model.pose import FloatArray

#: Chords leave the rim of what a tool sweeps by at most this, mm.
_RIM_MM = 0.006
#: Chords of a quarter of a circle for shapes that nothing is measured on.
QUARTER = 12


def sweep(
    moves: Moves,
    cuts: Sequence[Cut],
    depth: float,
    rows: IntArray | None = None,
    seen: set[bytes] | None = None,
) -> Shapes:
    """Polygons that ``rows`` (else all motions) take away at ``depth``, mm, one for each path of a tool.

    seen: paths to leave out, to which these are added: passes at several depths are one path.
    """
    portions = _without_idle(moves, moves.below(depth, rows))
    if not len(portions.row):
        return np.zeros(0, object)
    radius = radii(moves, cuts, portions, depth)
    chain = _chains(moves, portions, radius)
    plane = portions.plane
    if seen is not None:
        new = _unseen(plane, chain, radius, seen)
        plane, chain, radius = plane.take(new), chain[new], radius[new]
    return _widen(*_ways(plane, chain, radius))


def sweep_each(
    moves: Moves, cuts: Sequence[Cut], depth: float, rows: IntArray
) -> tuple[list[int], Shapes]:
    """Numbers of motions in ``rows`` that reach below ``depth``, mm, and what each takes away there.

    One polygon for each of the numbers.
    """
    portions = moves.below(depth, rows)
    number = np.arange(len(portions.row))
    radius = radii(moves, cuts, portions, depth)
    return portions.row.tolist(), _widen(*_ways(portions.plane, number, radius))


def _widen(lines: Shapes, radius: FloatArray) -> Shapes:
    """Polygons that discs of the radii sweep along the lines."""
    if not len(lines):
        return np.zeros(0, object)
    quarter = np.pi / 4 / np.arccos(1 - min(_RIM_MM / float(radius.max(initial=_RIM_MM)), 0.3))
    return np.asarray(shapely.buffer(lines, radius, quad_segs=int(np.ceil(quarter))))


def _without_idle(moves: Moves, portions: Portions) -> Portions:
    """The portions without upright motions that meet a level one: that one covers them."""
    row = portions.row
    upright = moves.upright[row]
    after, before = np.minimum(row + 1, len(moves) - 1), np.maximum(row - 1, 0)
    moved = ~moves.upright & ~moves.rapid
    goes_on = (
        moved[after]
        & (moves.cut[after] == moves.cut[row])
        & (_apart(moves.end[row], moves.start[after]) < 1e-6)
    )
    came = (
        moved[before]
        & (moves.cut[before] == moves.cut[row])
        & (_apart(moves.start[row], moves.end[before]) < 1e-6)
    )
    deeper = moves.down[row, 1] >= moves.down[row, 0]
    shown = np.isin(np.where(deeper, after, before), row)
    keep = np.flatnonzero(~(upright & np.where(deeper, goes_on, came) & shown))
    return Portions(row[keep], portions.low[keep], portions.high[keep], portions.plane.take(keep))


def _apart(one: FloatArray, two: FloatArray) -> FloatArray:
    return np.asarray(np.abs(one - two).max(axis=1, initial=0.0))


def radii(moves: Moves, cuts: Sequence[Cut], portions: Portions, depth: float) -> FloatArray:
    """(K,) the radius at ``depth`` of each tool in its portion: of a slanted one half-way between its ends there."""
    deep = moves.down[portions.row]
    with np.errstate(invalid="ignore"):
        mean = deep[:, 0] + np.where(
            np.isfinite(deep[:, 0]),
            (portions.low + portions.high) / 2 * (deep[:, 1] - deep[:, 0]),
            0,
        )
    height = np.where(moves.upright[portions.row], moves.deepest[portions.row], mean) - depth
    radius = np.empty(len(height))
    for number, cut in enumerate(cuts):
        own = moves.cut[portions.row] == number
        radius[own] = reach(cut.tool, height[own])
    return radius


def _chains(moves: Moves, portions: Portions, radius: FloatArray) -> IntArray:
    """(K,) numbers of portions that follow each other without a gap, on one level, or all of them aslant."""
    row, plane = portions.row, portions.plane
    joined = (np.diff(row) == 1) & (portions.high[:-1] == 1.0) & (portions.low[1:] == 0.0)
    with np.errstate(invalid="ignore"):
        level = ~(np.abs(moves.down[row[:-1], 0] - moves.down[row[1:], 1]) > 1e-6)
    joined &= level | ~(moves.level[row[:-1]] | moves.level[row[1:]])
    joined &= (np.diff(radius) == 0) & (np.diff(moves.cut[row]) == 0)
    joined &= np.abs(plane.end[:-1] - plane.start[1:]).max(axis=1, initial=0.0) < 1e-6
    return np.concatenate([[0], np.cumsum(~joined)])


def _unseen(plane: Segments, chain: IntArray, radius: FloatArray, seen: set[bytes]) -> BoolArray:
    """(K,) which portions belong to a chain that is not among those ``seen``, where the new ones are added."""
    keys = np.round(np.column_stack([plane.start, plane.end, plane.bulge, radius]), 6) + 0.0
    ends = np.cumsum(run_lengths(chain)).tolist()
    fresh = np.zeros(len(ends), dtype=np.bool_)
    for number, (first, last) in enumerate(pairwise([0, *ends])):
        key = keys[first:last].tobytes()
        fresh[number] = key not in seen
        seen.add(key)
    return fresh[chain]


def _ways(plane: Segments, chain: IntArray, radius: FloatArray) -> tuple[Shapes, FloatArray]:
    """A line for each chain, and its radius."""
    if not len(chain):
        return np.zeros(0, object), np.zeros(0)
    chain = np.cumsum(starts_run(chain)) - 1
    points, owner = flatten(make(plane.start, plane.end, plane.bulge, chain), 2 * CHORD_MM)
    last = np.cumsum(run_lengths(chain)) - 1
    order = np.argsort(np.concatenate([owner, chain[last]]), kind="stable")
    points, owner = (
        np.concatenate([points, plane.end[last]])[order],
        np.concatenate([owner, chain[last]])[order],
    )
    return np.asarray(shapely.linestrings(np.round(points, 6), indices=owner)), radius[last]


def unite(shapes: Shapes | Sequence[Any]) -> Any:
    """All of them as one."""
    return shapely.disjoint_subset_union_all(np.asarray(shapes, dtype=object))


def distinct(ways: Segments) -> Segments:
    """Each way once: passes at several depths are one."""
    return ways.take(same_ways(ways)[0])


def same_ways(ways: Segments) -> tuple[IntArray, IntArray]:
    """The rows of ways that differ, seen from above, and (N,) which of these each way is."""
    keys = np.round(np.column_stack([ways.start, ways.end, ways.bulge]), 6) + 0.0
    data = np.ascontiguousarray(keys).view(f"V{keys.itemsize * keys.shape[1]}").ravel()
    places: dict[bytes, int] = {}
    same = np.fromiter(
        (places.setdefault(key, len(places)) for key in map(bytes, data)), np.int64, len(data)
    )
    first = np.full(len(places), len(ways), dtype=np.int64)
    np.minimum.at(first, same, np.arange(len(ways)))
    return first, same
