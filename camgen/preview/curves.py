"""Lines and arcs as the points that a screen can draw, all of them at once."""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.ragged import begins, owners, ramp
from camgen.model.part import Contour
from camgen.model.pose import FloatArray

#: An arc is drawn in steps between these, rad.
_FINEST, _COARSEST = np.radians(2.0), np.radians(15.0)


class Drawn(Struct, frozen=True, eq=False):
    """points: (S, 3), the ends of the pieces of every segment. owner: (S,), the segment. fraction: (S,), how much of
    the segment has passed at the point, 0..1.
    """

    points: FloatArray
    owner: NDArray[np.int64]
    fraction: FloatArray


class Chains(Struct, frozen=True, eq=False):
    """Chains of points: points (N, 3) of all of them, counts (C,) how many each has."""

    points: FloatArray
    counts: NDArray[np.int64]


def drawn(start: FloatArray, via: FloatArray, end: FloatArray, sag: float) -> Drawn:
    """Segments from ``start`` to ``end``, each (M, 3), in pieces that leave the arc by about ``sag`` mm at most.

    via: (M, 3), a point half-way on the arc, NaN for a straight segment. An arc whose points are on one line is one.
    """
    to_via, to_end = via - start, end - start
    normal = np.cross(to_via, to_end)
    square = np.einsum("ij,ij->i", normal, normal)
    uu, ww = (np.einsum("ij,ij->i", v, v) for v in (to_via, to_end))
    arc = np.nan_to_num(square) > 1e-18 * np.nan_to_num(uu * ww)
    counts = np.ones(len(start), np.int64)
    arm, axis, sweep = _circles(to_via[arc], to_end[arc], normal[arc], square[arc], uu[arc], ww[arc])
    radius = np.linalg.norm(arm, axis=1)
    step = 2 * np.arccos(np.clip(1 - sag / radius, -1.0, 1.0))
    counts[arc] = np.ceil(sweep / np.clip(step, _FINEST, _COARSEST) - 1e-9).clip(1)
    owner, place = owners(counts), ramp(counts) + 1
    fraction = place / counts[owner]
    points = end[owner].copy()
    inner = np.flatnonzero(arc[owner] & (place < counts[owner]))
    row = (np.cumsum(arc) - 1)[owner[inner]]
    turned = _turned(arm[row], axis[row], sweep[row] * fraction[inner])
    points[inner] = start[owner[inner]] - arm[row] + turned
    return Drawn(points, owner, fraction)


def of_contours(contours: tuple[Contour, ...], sag: float) -> Chains:
    """Contours as chains at z = 0; a closed one ends in its first point."""
    return _chained([_segments(contour) for contour in contours], sag)


def of_spans(chains: list[tuple[FloatArray, FloatArray]], sag: float) -> Chains:
    """Chains given as points (N, 3) and the middles (N - 1, 3) of their spans."""
    return _chained([(points[:-1], via, points[1:]) for points, via in chains], sag)


def _chained(rows: list[tuple[FloatArray, FloatArray, FloatArray]], sag: float) -> Chains:
    """Chains of segments, each with its first point in front."""
    rows = [row for row in rows if len(row[0])]
    if not rows:
        return Chains(np.zeros((0, 3)), np.zeros(0, np.int64))
    start, via, end = (np.concatenate([row[k] for row in rows]) for k in range(3))
    found = drawn(start, via, end, sag)
    sizes = np.array([len(row[0]) for row in rows])
    starts = begins(sizes)
    first = np.searchsorted(found.owner, starts)
    counts = np.diff(np.append(first, len(found.owner))) + 1
    return Chains(np.insert(found.points, first, start[starts], axis=0), counts)


def _segments(contour: Contour) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Start, via and end of the segments. A bulge is the height of the arc over half its chord, to the right."""
    points = np.column_stack([contour.points, np.zeros(len(contour.points))])
    count = len(points) if contour.closed else len(points) - 1
    start, end = points[:count], np.roll(points, -1, axis=0)[:count]
    bulge = contour.bulges[:count, None]
    half = (end - start) / 2
    right = np.column_stack([half[:, 1], -half[:, 0], half[:, 2]])
    return start, np.where(bulge == 0, np.nan, start + half + right * bulge), end


def _circles(
    to_via: FloatArray, to_end: FloatArray, normal: FloatArray, square: FloatArray, uu: FloatArray, ww: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Of arcs: from the centre to the start (A, 3), the unit axis (A, 3), the sweep (A,) about it."""
    centre = (ww[:, None] * np.cross(normal, to_via) - uu[:, None] * np.cross(normal, to_end)) / (-2 * square[:, None])
    arm, last = centre, to_end + centre
    axis = normal / np.sqrt(square)[:, None]
    sine = np.einsum("ij,ij->i", np.cross(arm, last), axis)
    return arm, axis, np.arctan2(sine, np.einsum("ij,ij->i", arm, last)) % (2 * np.pi)


def _turned(arm: FloatArray, axis: FloatArray, angle: FloatArray) -> FloatArray:
    """``arm`` (N, 3), square to ``axis``, turned about it."""
    return np.asarray(arm * np.cos(angle)[:, None] + np.cross(axis, arm) * np.sin(angle)[:, None], dtype=np.float64)
