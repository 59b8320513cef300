"""Chains of segments, measured by the length from their start.

A chain is a `Segments` table in the direction of travel. Each segment starts where the one before
it ends. A closed chain ends at its start point.
"""

from __future__ import annotations

import numpy as np

from camgen.geometry.intersect import find_fractions
from camgen.geometry.segments import (
    IntArray,
    Segments,
    concatenate,
    make_segments,
    points_at,
    split_segments,
    tangents_at,
)
from camgen.model.pose import FloatArray

#: mm: a cut nearer than this to the end of a segment is moved to that end, because no controller
#: prints a shorter segment. Points nearer than this to each other are equal.
_SHORTEST_MM = 1e-4


def sample_chain(chain: Segments, spacing: float) -> tuple[FloatArray, FloatArray]:
    """Sample a chain evenly, both ends included.

    spacing: maximum distance between samples along the chain, mm.

    Returns the lengths (M,) of the samples from the start, mm, and the sampled points (M, 2).
    """
    total = float(chain.length.sum())
    lengths = np.linspace(0.0, total, max(int(np.ceil(total / spacing)), 1) + 1)
    return lengths, locate(chain, lengths)


def locate(chain: Segments, lengths: FloatArray) -> FloatArray:
    """The points (M, 2) of a chain at the given `lengths` (M,) from its start, mm."""
    row, fraction = _find(chain, lengths)
    return points_at(chain.take(row), fraction)


def tangents_along(chain: Segments, lengths: FloatArray) -> FloatArray:
    """Unit directions of travel (M, 2) of a closed chain at `lengths` (M,) from its start, mm.

    A length beyond the end continues at the start.
    """
    row, fraction = _find(chain, lengths % float(chain.length.sum()))
    return tangents_at(chain.take(row), fraction)


def _find(chain: Segments, lengths: FloatArray) -> tuple[IntArray, FloatArray]:
    """The segment (M,) at each length, and the fraction (M,) of that segment before it, 0 to 1."""
    sizes = chain.length
    ends = np.cumsum(sizes)
    row = np.minimum(np.searchsorted(ends, lengths, side="right"), len(chain) - 1)
    fraction = (lengths - (ends[row] - sizes[row])) / np.maximum(sizes[row], 1e-12)
    return row, np.clip(fraction, 0.0, 1.0)


def find_nearest(chain: Segments, point: FloatArray) -> tuple[float, float]:
    """The point of a chain that is nearest to `point` (2,).

    Returns its length from the start of the chain and its distance from `point`, both in mm.
    """
    fraction = np.clip(find_fractions(chain, np.tile(point, (len(chain), 1))), 0.0, 1.0)
    gap = np.hypot(*(points_at(chain, fraction) - point).T)
    row = int(np.argmin(gap))
    length = chain.length
    return float(length[:row].sum() + fraction[row] * length[row]), float(gap[row])


def cut_out(chain: Segments, low: float, high: float) -> Segments:
    """The section of a chain from `low` to `high`, mm from its start.

    On a closed chain `high` may exceed the total length: the section then continues over the start.
    """
    total = float(chain.length.sum())
    if high > total:
        if low >= total:
            return cut_out(chain, low - total, high - total)
        return join_chains([cut_out(chain, low, total), cut_out(chain, 0.0, high - total)])
    length = chain.length
    begin = np.cumsum(length) - length
    first, last = np.maximum(low - begin, 0.0), np.minimum(high - begin, length)
    first = np.where(first < _SHORTEST_MM, 0.0, first)
    last = np.where(length - last < _SHORTEST_MM, length, last)
    rows = np.flatnonzero(last - first > np.minimum(_SHORTEST_MM, length / 2))
    return split_segments(chain, rows, first[rows] / length[rows], last[rows] / length[rows])


def start_at(ring: Segments, length: float) -> Segments:
    """A closed chain with its start point moved forwards by `length`, mm."""
    total = float(ring.length.sum())
    if length < _SHORTEST_MM or total - length < _SHORTEST_MM:
        return ring
    return cut_out(ring, length, length + total)


def join_chains(chains: list[Segments]) -> Segments:
    """The chains in the given order as one, with straight links where two do not meet."""
    parts: list[Segments] = []
    for chain in chains:
        if not len(chain):
            continue
        if parts:
            start, end = parts[-1].end[-1:], chain.start[:1]
            if np.hypot(*(end - start)[0]) > _SHORTEST_MM:
                parts.append(make_segments(start, end, np.zeros(1), np.zeros(1, dtype=np.int64)))
                parts.append(chain)
            else:
                parts.append(_with_start(chain, start[0]))
        else:
            parts.append(chain)
    return concatenate(parts)


def _with_start(chain: Segments, start: FloatArray) -> Segments:
    """A chain with its first point moved to `start` (2,), within `_SHORTEST_MM` of it."""
    starts = chain.start.copy()
    starts[0] = start
    return make_segments(starts, chain.end, chain.bulge, chain.owner)


def make_lines(start: FloatArray, ends: FloatArray) -> Segments:
    """Lines from one point `start` (2,) to each of `ends` (M, 2)."""
    count = len(ends)
    return make_segments(np.tile(start, (count, 1)), ends, np.zeros(count), np.arange(count))


def make_polyline(corners: FloatArray) -> Segments:
    """A chain of lines through `corners` (K, 2); a corner equal to the one before is left out."""
    is_new = np.append(True, np.hypot(*np.diff(corners, axis=0).T) > _SHORTEST_MM)
    corners = corners[is_new]
    count = len(corners) - 1
    return make_segments(
        corners[:-1], corners[1:], np.zeros(count), np.zeros(count, dtype=np.int64)
    )
