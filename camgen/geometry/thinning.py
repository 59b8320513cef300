"""Douglas-Peucker for all contours at once: which points to keep so that the lines between them leave none too far.

The recursion of the textbook runs level by level. A level looks at all points of all stretches that are not yet near
enough, as columns; the stretches that fail are cut at their farthest point.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.ragged import begins, owners, stretches
from camgen.model.part import Contour
from camgen.model.pose import FloatArray

IntArray = NDArray[np.int64]


class Polylines(Struct, frozen=True, eq=False):
    """Contours end to end: chain k is the rows first[k] to first[k + 1]. A closed one ends with its first point again.

    points: (V, 2) mm. bulges: (V,) of the segment that leaves a point. fixed: rows that must stay, sorted.
    """

    points: FloatArray
    bulges: FloatArray
    first: IntArray
    fixed: IntArray

    @classmethod
    def of(cls, contours: Sequence[Contour]) -> Polylines:
        """A closed chain of lines starts at its point farthest from its middle: most likely a corner."""
        points, bulges, fixed = [], [], []
        at = 0
        firsts = [0]
        for contour in contours:
            p, b = contour.points, contour.bulges
            if contour.closed:
                start = 0
                if not b.any():
                    start = int(np.argmax(np.hypot(*(p - (p.min(axis=0) + p.max(axis=0)) / 2).T)))
                p, b = (
                    np.concatenate([p[start:], p[: start + 1]]),
                    np.concatenate([b[start:], b[: start + 1]]),
                )
            points.append(p)
            bulges.append(b)
            last = len(p) - 1
            stay = {0, last}
            if contour.closed:
                # A stretch from a point to itself has no direction: cut at the point farthest from it.
                stay.add(int(np.argmax(np.hypot(*(p - p[0]).T))))
            arcs = np.flatnonzero(b[:-1])
            fixed += sorted(at + k for k in {*stay, *arcs.tolist(), *(arcs + 1).tolist()})
            at += len(p)
            firsts.append(at)
        return cls(
            np.concatenate(points), np.concatenate(bulges), np.array(firsts), np.array(fixed)
        )


def thin(chains: Polylines, tolerance: float) -> IntArray:
    """The rows to keep, sorted: no dropped point is farther than ``tolerance`` from the line over it."""
    points = chains.points
    kept = [chains.fixed]
    same = np.searchsorted(chains.first, chains.fixed[:-1], side="right")
    inside = same == np.searchsorted(chains.first, chains.fixed[1:], side="right")
    low, high = chains.fixed[:-1][inside], chains.fixed[1:][inside]
    while True:
        wide = high - low > 1
        low, high = low[wide], high[wide]
        if not len(low):
            return np.unique(np.concatenate(kept))
        counts = high - low - 1
        begin, of, rows = begins(counts), owners(counts), stretches(low + 1, counts)
        off = to_lines(points[rows], points[low][of], points[high][of])
        most = np.maximum.reduceat(off, begin)
        farthest = np.minimum.reduceat(np.where(off == most[of], rows, len(points)), begin)
        bad = most > tolerance
        cut = farthest[bad]
        kept.append(cut)
        low, high = np.concatenate([low[bad], cut]), np.concatenate([cut, high[bad]])


def to_lines(points: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """Distances (N,) of points from the lines a to b, each (N, 2), their ends included."""
    chord = b - a
    size = np.einsum("nd,nd->n", chord, chord)
    local = points - a
    share = np.einsum("nd,nd->n", local, chord) / np.where(size > 0, size, 1.0)
    foot = local - np.clip(share, 0.0, 1.0)[:, None] * chord
    return np.asarray(np.hypot(foot[:, 0], foot[:, 1]))
