"""Areas that tools take away at one depth, seen from above: unions of swept discs."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import shapely

from camgen.check.stock.cells import CHORD_MM, Shapes
from camgen.check.stock.moves import Cut, Moves, Portions
from camgen.check.stock.profile import compute_radius
from camgen.geometry.ragged import mark_run_starts, measure_runs
from camgen.geometry.segments import BoolArray, IntArray, Segments, flatten, make_segments
from camgen.model.pose import FloatArray

#: mm: maximum deviation of the chords around a swept area.
_RIM_MM = 0.006
#: Chords of a quarter circle in shapes that are not measured.
QUARTER = 12


def sweep(
    moves: Moves,
    cuts: Sequence[Cut],
    depth: float,
    rows: IntArray | None = None,
    seen: set[bytes] | None = None,
) -> Shapes:
    """Compute the polygons that motions remove at `depth` mm, one per path of a tool.

    rows: the motions; None: all.
    seen: paths that are left out; the new ones are added. Passes at several depths are one path.
    """
    portions = _remove_idle(moves, moves.below(depth, rows))
    if not len(portions.row):
        return np.zeros(0, object)
    radius = compute_radii(moves, cuts, portions, depth)
    chain = _number_chains(moves, portions, radius)
    plane = portions.plane
    if seen is not None:
        new = _are_new(plane, chain, radius, seen)
        plane, chain, radius = plane.take(new), chain[new], radius[new]
    first = _find_first_laps(plane, chain)
    chain = chain[first] + np.cumsum(np.diff(first, prepend=-1) > 1)
    return _widen(*_make_lines(plane.take(first), chain, radius[first]))


def sweep_each(
    moves: Moves, cuts: Sequence[Cut], depth: float, rows: IntArray
) -> tuple[list[int], Shapes]:
    """Compute the polygon that each of the motions `rows` removes at `depth` mm.

    Returns the numbers of the motions that are deeper, and their polygons.
    """
    portions = moves.below(depth, rows)
    number = np.arange(len(portions.row))
    radius = compute_radii(moves, cuts, portions, depth)
    return portions.row.tolist(), _widen(*_make_lines(portions.plane, number, radius))


def _widen(lines: Shapes, radius: FloatArray) -> Shapes:
    if not len(lines):
        return np.zeros(0, object)
    quarter = np.pi / 4 / np.arccos(1 - min(_RIM_MM / float(radius.max(initial=_RIM_MM)), 0.3))
    return np.asarray(shapely.buffer(lines, radius, quad_segs=int(np.ceil(quarter))))


def _remove_idle(moves: Moves, portions: Portions) -> Portions:
    """Remove upright motions whose deeper end is at a level motion, which covers them."""
    row = portions.row
    deeper = moves.down[row, 1] >= moves.down[row, 0]
    neighbour = np.where(deeper, np.minimum(row + 1, len(moves) - 1), np.maximum(row - 1, 0))
    gap = np.where(
        deeper[:, None],
        moves.end[row] - moves.start[neighbour],
        moves.start[row] - moves.end[neighbour],
    )
    is_covered = ~moves.upright[neighbour] & ~moves.rapid[neighbour]
    is_covered &= (moves.cut[neighbour] == moves.cut[row]) & np.isin(neighbour, row)
    is_covered &= np.abs(gap).max(axis=1, initial=0.0) < 1e-6
    keep = np.flatnonzero(~(moves.upright[row] & is_covered))
    return Portions(row[keep], portions.low[keep], portions.high[keep], portions.plane.take(keep))


def compute_radii(
    moves: Moves, cuts: Sequence[Cut], portions: Portions, depth: float
) -> FloatArray:
    """Compute the radius (K,) of each tool at `depth` mm, for a sloping portion in its middle."""
    down = moves.down[portions.row]
    with np.errstate(invalid="ignore"):
        rise = (portions.low + portions.high) / 2 * (down[:, 1] - down[:, 0])
        mean = down[:, 0] + np.where(np.isfinite(down[:, 0]), rise, 0)
    height = np.where(moves.upright[portions.row], moves.deepest[portions.row], mean) - depth
    return measure_radii(cuts, moves.cut[portions.row], height)


def measure_radii(cuts: Sequence[Cut], number: IntArray, height: FloatArray) -> FloatArray:
    """Compute the radius (K,) of the tools of the cuts `number` (K,) at heights (K,), mm."""
    radius = np.empty(len(height))
    for k, cut in enumerate(cuts):
        of_cut = number == k
        radius[of_cut] = compute_radius(cut.tool, height[of_cut])
    return radius


def _number_chains(moves: Moves, portions: Portions, radius: FloatArray) -> IntArray:
    """Number the portions (K,) by chains.

    The portions of a chain follow each other without a gap, all on one level or all sloping.
    """
    row, plane = portions.row, portions.plane
    joined = (np.diff(row) == 1) & (portions.high[:-1] == 1.0) & (portions.low[1:] == 0.0)
    with np.errstate(invalid="ignore"):
        level = ~(np.abs(moves.down[row[:-1], 0] - moves.down[row[1:], 1]) > 1e-6)
    joined &= level | ~(moves.level[row[:-1]] | moves.level[row[1:]])
    joined &= (np.diff(radius) == 0) & (np.diff(moves.cut[row]) == 0)
    joined &= np.abs(plane.end[:-1] - plane.start[1:]).max(axis=1, initial=0.0) < 1e-6
    return np.concatenate([[0], np.cumsum(~joined)])


def _are_new(plane: Segments, chain: IntArray, radius: FloatArray, seen: set[bytes]) -> BoolArray:
    keys = np.round(np.column_stack([plane.start, plane.end, plane.bulge, radius]), 6) + 0.0
    ends = np.cumsum(measure_runs(chain)).tolist()
    fresh = np.zeros(len(ends), dtype=np.bool_)
    for number, (first, last) in enumerate(pairwise([0, *ends])):
        key = keys[first:last].tobytes()
        fresh[number] = key not in seen
        seen.add(key)
    return fresh[chain]


def _find_first_laps(plane: Segments, chain: IntArray) -> IntArray:
    """Find the rows of portions that repeat none before in their chain, as the laps of a helix."""
    keys = np.round(np.column_stack([chain, plane.start, plane.end, plane.bulge]), 6)
    return np.sort(np.unique(keys, axis=0, return_index=True)[1])


def _make_lines(plane: Segments, chain: IntArray, radius: FloatArray) -> tuple[Shapes, FloatArray]:
    if not len(chain):
        return np.zeros(0, object), np.zeros(0)
    chain = np.cumsum(mark_run_starts(chain)) - 1
    points, owner = flatten(make_segments(plane.start, plane.end, plane.bulge, chain), 2 * CHORD_MM)
    last = np.cumsum(measure_runs(chain)) - 1
    points, owner = np.concatenate([points, plane.end[last]]), np.concatenate([owner, chain[last]])
    order = np.argsort(owner, kind="stable")
    lines = shapely.linestrings(np.round(points[order], 6), indices=owner[order])
    return np.asarray(lines), radius[last]


def merge_shapes(shapes: Shapes | Sequence[Any]) -> Any:
    """Merge shapes into one."""
    return shapely.disjoint_subset_union_all(np.asarray(shapes, dtype=object))


def select_distinct(curves: Segments) -> Segments:
    """Select each curve once: passes at several depths are one curve."""
    return curves.take(find_same_curves(curves)[0])


def find_same_curves(curves: Segments) -> tuple[IntArray, IntArray]:
    """Return the rows of different curves (U,), seen from above.

    Also returns the index of each curve among them, (N,).
    """
    keys = np.round(np.column_stack([curves.start, curves.end, curves.bulge]), 6) + 0.0
    data = np.ascontiguousarray(keys).view(f"V{keys.itemsize * keys.shape[1]}").ravel()
    indices: dict[bytes, int] = {}
    same = np.fromiter(
        (indices.setdefault(key, len(indices)) for key in map(bytes, data)), np.int64, len(data)
    )
    first = np.full(len(indices), len(curves), dtype=np.int64)
    np.minimum.at(first, same, np.arange(len(curves)))
    return first, same
