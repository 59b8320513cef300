"""Lines and arcs as the points that a screen can draw, all of them at once."""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.arcs import find_bulge_middles, make_spans_through
from camgen.geometry.ragged import begins, owners, ramp
from camgen.model.part import Contour
from camgen.model.pose import FloatArray

#: An arc is drawn in steps between these, rad.
_FINEST, _COARSEST = np.radians(2.0), np.radians(15.0)


class DrawnSpans(Struct, frozen=True, eq=False):
    """points: (S, 3), the ends of the pieces of every segment. owner: (S,), the segment. fraction: (S,), how much of
    the segment has passed at the point, 0..1.
    """

    points: FloatArray
    owner: NDArray[np.int64]
    fraction: FloatArray


class SpaceChains(Struct, frozen=True, eq=False):
    """Chains of points: points (N, 3) of all of them, counts (C,) how many each has."""

    points: FloatArray
    counts: NDArray[np.int64]


def draw_spans(start: FloatArray, via: FloatArray, end: FloatArray, sag: float) -> DrawnSpans:
    """Segments from ``start`` to ``end``, each (M, 3), in pieces that leave the arc by about ``sag`` mm at most.

    via: (M, 3), a point on the arc, NaN for a straight segment. An arc whose points are on one line is one.
    """
    found = make_spans_through(start, via, end)
    with np.errstate(divide="ignore"):
        step = 2 * np.arccos(np.clip(1 - sag / found.radius, -1.0, 1.0))
    counts = (
        np.ceil(found.sweep / np.clip(step, _FINEST, _COARSEST) - 1e-9).clip(1).astype(np.int64)
    )
    owner, place = owners(counts), ramp(counts) + 1
    fraction = place / counts[owner]
    points = end[owner].copy()
    inner = np.flatnonzero(place < counts[owner])
    points[inner] = found.point(fraction[inner], owner[inner])
    return DrawnSpans(points, owner, fraction)


def of_contours(contours: tuple[Contour, ...], sag: float) -> SpaceChains:
    """Contours as chains at z = 0; a closed one ends in its first point."""
    return _chain([_segments(contour) for contour in contours], sag)


def of_spans(chains: list[tuple[FloatArray, FloatArray]], sag: float) -> SpaceChains:
    """Chains given as points (N, 3) and the middles (N - 1, 3) of their spans."""
    return _chain([(points[:-1], via, points[1:]) for points, via in chains], sag)


def _chain(rows: list[tuple[FloatArray, FloatArray, FloatArray]], sag: float) -> SpaceChains:
    """Chains of segments, each with its first point in front."""
    rows = [row for row in rows if len(row[0])]
    if not rows:
        return SpaceChains(np.zeros((0, 3)), np.zeros(0, np.int64))
    start, via, end = (np.concatenate([row[k] for row in rows]) for k in range(3))
    found = draw_spans(start, via, end, sag)
    sizes = np.array([len(row[0]) for row in rows])
    starts = begins(sizes)
    first = np.searchsorted(found.owner, starts)
    counts = np.diff(np.append(first, len(found.owner))) + 1
    return SpaceChains(np.insert(found.points, first, start[starts], axis=0), counts)


def _segments(contour: Contour) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Start, via and end of the segments."""
    points = np.column_stack([contour.points, np.zeros(len(contour.points))])
    count = len(points) if contour.closed else len(points) - 1
    start, end = points[:count], np.roll(points, -1, axis=0)[:count]
    bulge = contour.bulges[:count]
    return start, np.where(bulge[:, None] == 0, np.nan, find_bulge_middles(start, bulge, end)), end
