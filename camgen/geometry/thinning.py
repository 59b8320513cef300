"""Douglas-Peucker for all contours at once: removes points that are near the lines between others.

The recursion of the textbook runs level by level. A level measures all points of all stretches that
are not near enough yet, as columns. Stretches that fail are split at their farthest point.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import compute_first_rows, list_owners, list_range_numbers
from camgen.model.part import Contour, IntArray
from camgen.model.pose import FloatArray


class Polylines(Struct, frozen=True, eq=False):
    """Contours as chains in one table: chain k is the rows from first[k] to first[k + 1].

    A closed chain ends with its first point again.

    points: (V, 2) mm.
    bulges: (V,) bulge of the segment that begins at each point.
    first: (chains + 1,) first row of each chain, and the number of rows.
    fixed: (F,) rows that must stay, sorted.
    """

    points: FloatArray
    bulges: FloatArray
    first: IntArray
    fixed: IntArray

    @classmethod
    def from_contours(cls, contours: Sequence[Contour]) -> Polylines:
        """Chains of `contours`, whose ends and ends of arcs are fixed.

        A closed chain of lines starts at its point farthest from the middle of its box, which is
        probably a corner.
        """
        points, bulges, fixed = [], [], []
        firsts = [0]
        for contour in contours:
            chain_points, chain_bulges = contour.points, contour.bulges
            if contour.closed:
                middle = (chain_points.min(axis=0) + chain_points.max(axis=0)) / 2
                start = 0 if chain_bulges.any() else _find_farthest(chain_points, middle)
                chain_points = np.concatenate([chain_points[start:], chain_points[: start + 1]])
                chain_bulges = np.concatenate([chain_bulges[start:], chain_bulges[: start + 1]])
            points.append(chain_points)
            bulges.append(chain_bulges)
            arcs = np.flatnonzero(chain_bulges[:-1])
            chain_fixed = {0, len(chain_points) - 1, *arcs.tolist(), *(arcs + 1).tolist()}
            if contour.closed:
                # A stretch from a point to itself has no direction, so it is split at the point
                # farthest from its start.
                chain_fixed.add(_find_farthest(chain_points, chain_points[0]))
            fixed += [firsts[-1] + k for k in sorted(chain_fixed)]
            firsts.append(firsts[-1] + len(chain_points))
        return cls(
            np.concatenate(points), np.concatenate(bulges), np.array(firsts), np.array(fixed)
        )


def _find_farthest(points: FloatArray, centre: FloatArray) -> int:
    """The row of `points` (N, 2) that is farthest from `centre` (2,)."""
    return int(np.argmax(np.hypot(*(points - centre).T)))


def thin_chains(chains: Polylines, tolerance: float) -> IntArray:
    """The rows to keep, sorted. No removed point is farther than `tolerance` mm from the new line.

    Rows in `chains.fixed` are kept.
    """
    points = chains.points
    kept = [chains.fixed]
    chain = np.searchsorted(chains.first, chains.fixed, side="right")
    same_chain = chain[:-1] == chain[1:]
    low, high = chains.fixed[:-1][same_chain], chains.fixed[1:][same_chain]
    while True:
        has_inner = high - low > 1
        low, high = low[has_inner], high[has_inner]
        if not len(low):
            return np.unique(np.concatenate(kept))
        counts = high - low - 1
        begin, owner = compute_first_rows(counts), list_owners(counts)
        rows = list_range_numbers(low + 1, counts)
        distance = measure_from_lines(points[rows], points[low][owner], points[high][owner])
        largest = np.maximum.reduceat(distance, begin)
        is_farthest = distance == largest[owner]
        farthest = np.minimum.reduceat(np.where(is_farthest, rows, len(points)), begin)
        too_far = largest > tolerance
        cut = farthest[too_far]
        kept.append(cut)
        low, high = np.concatenate([low[too_far], cut]), np.concatenate([cut, high[too_far]])


def measure_from_lines(points: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """(N,) distance of each point from the line segment a to b, all (N, 2), mm."""
    chord = b - a
    square = np.einsum("nd,nd->n", chord, chord)
    local = points - a
    fraction = np.einsum("nd,nd->n", local, chord) / np.where(square > 0, square, 1.0)
    foot = local - np.clip(fraction, 0.0, 1.0)[:, None] * chord
    return np.asarray(np.hypot(foot[:, 0], foot[:, 1]))
