"""Approximates lines and arcs by points that a screen can draw."""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.arcs import find_bulge_middles, make_spans_through
from camgen.geometry.ragged import compute_first_rows, list_owners, number_rows
from camgen.model.part import Contour
from camgen.model.pose import FloatArray

#: Smallest and largest step in which an arc is drawn, rad.
_FINEST, _COARSEST = np.radians(2.0), np.radians(15.0)
#: Tolerance with which arcs are drawn, as a fraction of the size of the program.
_SAG_FRACTION = 2e-5


class DrawnSpans(Struct, frozen=True, eq=False):
    """S pieces of segments.

    points: (S, 3) end of each piece.
    owner: (S,) its segment.
    fraction: (S,) fraction of the segment up to that end, 0 to 1.
    """

    points: FloatArray
    owner: NDArray[np.int64]
    fraction: FloatArray


class SpaceChains(Struct, frozen=True, eq=False):
    """C chains of points.

    points: (N, 3) points of all chains.
    counts: (C,) number of points of each chain.
    """

    points: FloatArray
    counts: NDArray[np.int64]


def choose_sag(points: FloatArray) -> float:
    """The distance of a drawn arc from the true one, mm, for a program with these points (N, 3).

    Rows that are NaN do not count.
    """
    points = points[~np.isnan(points[:, 0])]
    if not len(points):
        return 1e-3
    return max(float(np.linalg.norm(np.ptp(points, axis=0))) * _SAG_FRACTION, 1e-4)


def measure_length(points: FloatArray) -> float:
    """The length of a chain of lines, mm."""
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def lift(points: FloatArray, z: float = 0.0) -> FloatArray:
    """Points (N, 2) as points (N, 3) at the height `z`, mm."""
    return np.column_stack([points, np.full(len(points), z)])


def draw_spans(start: FloatArray, via: FloatArray, end: FloatArray, sag: float) -> DrawnSpans:
    """Divide M segments into straight pieces.

    start, end: (M, 3) ends of the segments.
    via: (M, 3) via point of an arc, NaN for a straight segment. An arc with all points on one line
        is straight too.
    sag: approximate maximum distance of a piece from its arc, mm.
    """
    spans = make_spans_through(start, via, end)
    with np.errstate(divide="ignore"):
        step = 2 * np.arccos(np.clip(1 - sag / spans.radius, -1.0, 1.0))
    pieces = np.ceil(spans.sweep / np.clip(step, _FINEST, _COARSEST) - 1e-9)
    counts = pieces.clip(1).astype(np.int64)
    owner, place = list_owners(counts), number_rows(counts) + 1
    fraction = place / counts[owner]
    points = end[owner].copy()
    inner = np.flatnonzero(place < counts[owner])
    points[inner] = spans.point(fraction[inner], owner[inner])
    return DrawnSpans(points, owner, fraction)


def trace_contours(contours: tuple[Contour, ...], sag: float) -> SpaceChains:
    """Contours as chains at z = 0. A closed one ends at its first point."""
    return _trace_segments([_list_segments(contour) for contour in contours], sag)


def trace_spans(chains: list[tuple[FloatArray, FloatArray]], sag: float) -> SpaceChains:
    """Chains with arcs, given as points (N, 3) and via points (N - 1, 3)."""
    return _trace_segments([(points[:-1], via, points[1:]) for points, via in chains], sag)


def _trace_segments(
    rows: list[tuple[FloatArray, FloatArray, FloatArray]], sag: float
) -> SpaceChains:
    """Chains of segments, given as start, via and end points. Each keeps its first point."""
    rows = [row for row in rows if len(row[0])]
    if not rows:
        return SpaceChains(np.zeros((0, 3)), np.zeros(0, np.int64))
    start, via, end = map(np.concatenate, zip(*rows, strict=True))
    drawn = draw_spans(start, via, end, sag)
    starts = compute_first_rows(np.array([len(row[0]) for row in rows]))
    first = np.searchsorted(drawn.owner, starts)
    counts = np.diff(np.append(first, len(drawn.owner))) + 1
    return SpaceChains(np.insert(drawn.points, first, start[starts], axis=0), counts)


def _list_segments(contour: Contour) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Start, via and end points of the segments, each (N, 3)."""
    points = lift(contour.points)
    count = len(points) if contour.closed else len(points) - 1
    start, end = points[:count], np.roll(points, -1, axis=0)[:count]
    bulge = contour.bulges[:count]
    return start, np.where(bulge[:, None] == 0, np.nan, find_bulge_middles(start, bulge, end)), end
