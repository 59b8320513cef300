"""Edges of which only a part is run: cut where the work begins and ends."""

from __future__ import annotations

import numpy as np

from camgen.pose import FloatArray


def cut(points: FloatArray, first: FloatArray, last: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A chain (N, 3) in three: before, within and after the places nearest to two points (3,), in either order.

    Before or after has no points where the work goes to the end.
    """
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    at = np.append(0.0, np.cumsum(steps))
    low, high = sorted((_nearest(points, at, first), _nearest(points, at, last)))
    ends = [np.array([np.interp(s, at, column) for column in points.T]) for s in (low, high)]
    inner = points[(at > low) & (at < high)]
    before = np.vstack([points[at < low], ends[0]]) if low > 0 else points[:0]
    after = np.vstack([ends[1], points[at > high]]) if high < at[-1] else points[:0]
    return before, np.vstack([ends[0], inner, ends[1]]), after


def _nearest(points: FloatArray, at: FloatArray, place: FloatArray) -> float:
    """How far along the chain, mm, it comes nearest to ``place``."""
    steps = np.diff(points, axis=0)
    square = np.einsum("ij,ij->i", steps, steps)
    share = np.einsum("ij,ij->i", place - points[:-1], steps) / np.where(square > 0, square, 1.0)
    share = np.clip(share, 0.0, 1.0)
    gap = np.linalg.norm(points[:-1] + share[:, None] * steps - place, axis=1)
    k = int(np.argmin(gap))
    return float(at[k] + share[k] * (at[k + 1] - at[k]))
