"""Chains of segments as one runs along them: places by the length from the start, pieces, another start."""

from __future__ import annotations

import numpy as np

from camgen.geometry.intersect import fractions
from camgen.geometry.segments import (
    IntArray,
    Segments,
    concatenate,
    make,
    points_at,
    split,
    tangents_at,
)
from camgen.model.pose import FloatArray

#: A cut nearer than this, mm, to the end of a segment is made there: no controller prints a shorter piece.
_LEAST = 1e-4


def places(chain: Segments, spacing: float) -> tuple[FloatArray, FloatArray]:
    """Lengths (M,) from the start of ``chain``, at most ``spacing`` mm apart, its ends among them; points (M, 2)."""
    total = float(chain.length.sum())
    at = np.linspace(0.0, total, max(int(np.ceil(total / spacing)), 1) + 1)
    return at, locate(chain, at)


def locate(chain: Segments, at: FloatArray) -> FloatArray:
    """(M, 2) the points at the lengths ``at`` (M,) mm from the start."""
    row, fraction = _find(chain, at)
    return points_at(chain.take(row), fraction)


def tangents_along(chain: Segments, at: FloatArray) -> FloatArray:
    """(M, 2) unit directions of travel at the lengths ``at`` (M,) mm from the start of a closed chain."""
    row, fraction = _find(chain, at % float(chain.length.sum()))
    return tangents_at(chain.take(row), fraction)


def _find(chain: Segments, at: FloatArray) -> tuple[IntArray, FloatArray]:
    length = chain.length
    ends = np.cumsum(length)
    row = np.minimum(np.searchsorted(ends, at, side="right"), len(chain) - 1)
    return row, np.clip((at - (ends[row] - length[row])) / np.maximum(length[row], 1e-12), 0.0, 1.0)


def nearest(chain: Segments, point: FloatArray) -> tuple[float, float]:
    """How far (mm) along ``chain`` it is nearest to ``point`` (2,), and its distance there."""
    fraction = np.clip(fractions(chain, np.tile(point, (len(chain), 1))), 0.0, 1.0)
    gap = np.hypot(*(points_at(chain, fraction) - point).T)
    row = int(np.argmin(gap))
    length = chain.length
    return float(length[:row].sum() + fraction[row] * length[row]), float(gap[row])


def cut_out(chain: Segments, low: float, high: float) -> Segments:
    """The stretch from ``low`` to ``high`` mm; of a closed chain it may pass the start."""
    total = float(chain.length.sum())
    if high > total:
        return (
            join([cut_out(chain, low, total), cut_out(chain, 0.0, high - total)])
            if low < total
            else (cut_out(chain, low - total, high - total))
        )
    length = chain.length
    ends = np.cumsum(length)
    begin = ends - length
    first, last = np.maximum(low - begin, 0.0), np.minimum(high - begin, length)
    first, last = (
        np.where(first < _LEAST, 0.0, first),
        np.where(length - last < _LEAST, length, last),
    )
    rows = np.flatnonzero(last - first > np.minimum(_LEAST, length / 2))
    return split(chain, rows, first[rows] / length[rows], last[rows] / length[rows])


def begun_at(ring: Segments, at: float) -> Segments:
    """The closed chain ``ring`` begun ``at`` mm from its start."""
    total = float(ring.length.sum())
    return ring if at < _LEAST or total - at < _LEAST else cut_out(ring, at, at + total)


def join(chains: list[Segments]) -> Segments:
    """The chains one after the other, with straight links where they do not meet."""
    parts: list[Segments] = []
    for chain in chains:
        if not len(chain):
            continue
        if parts:
            start, end = parts[-1].end[-1:], chain.start[:1]
            if np.hypot(*(end - start)[0]) > _LEAST:
                parts.append(make(start, end, np.zeros(1), np.zeros(1, dtype=np.int64)))
                parts.append(chain)
            else:
                parts.append(_with_start(chain, start[0]))
        else:
            parts.append(chain)
    return concatenate(parts)


def _with_start(chain: Segments, start: FloatArray) -> Segments:
    """``chain`` begun exactly at ``start``, which is as near as its own start."""
    begins = chain.start.copy()
    begins[0] = start
    return make(begins, chain.end, chain.bulge, chain.owner)


def straight(start: FloatArray, ends: FloatArray) -> Segments:
    """Lines from one point (2,) to each of ``ends`` (M, 2)."""
    count = len(ends)
    return make(np.tile(start, (count, 1)), ends, np.zeros(count), np.arange(count))


def polyline(corners: FloatArray) -> Segments:
    """Lines from each of ``corners`` (K, 2) to the next one, if it is another point."""
    is_new = np.append(True, np.hypot(*np.diff(corners, axis=0).T) > _LEAST)
    corners = corners[is_new]
    count = len(corners) - 1
    return make(corners[:-1], corners[1:], np.zeros(count), np.zeros(count, dtype=np.int64))
