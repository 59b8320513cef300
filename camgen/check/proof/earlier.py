"""Motions of earlier operations, for an operation that takes only what they leave."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from camgen.check.proof.heights import tab_top
from camgen.check.proof.matching import Covered, PieceTree, join_ranges
from camgen.check.proof.motions import Motions
from camgen.check.proof.pieces import BoolArray, Pieces, points_along
from camgen.check.proof.tasks import Task
from camgen.model.pose import FloatArray

#: Distance of the places of a stretch at which it is examined, mm, and their least number.
_SPACING_MM, _LEAST_PLACES = 0.5, 3
#: Share of the radius of the tool at the ends of a stretch that is not examined.
_CORNER_SHARE = 0.1
#: An earlier tool touches a contour if it leaves no more than this there, mm (docs/follow.md).
_LEFT_MM = 0.02
#: Tools that touch a contour with their whole diameter at the depth of their tip.
_FLAT = ("end mill",)


class EarlierCut(NamedTuple):
    """The motions of one earlier operation in one program.

    task: work of that operation.
    motions: all motions of the program.
    of_task: (M,) working motions of the operation.
    """

    task: Task
    motions: Motions
    of_task: BoolArray


class EarlierCuts:
    """Tells which stretches of contours earlier operations touch at a depth.

    limit: distance, mm, that a motion may have from its place in the drawing.
    radius: radius of the tool that takes the rest, mm.
    """

    def __init__(self, cuts: Iterable[EarlierCut], limit: float, radius: float) -> None:
        self._corner = _CORNER_SHARE * radius
        self._cuts = [cut for cut in cuts if cut.task.job.tool.kind in _FLAT]
        self._limit = limit

    def touch(self, gaps: Covered, pieces: Pieces, depth: float, slack: float) -> BoolArray:
        """(G,) whether the stretches `gaps` of the drawing `pieces` are touched, all along.

        depth: depth of the pass below the top face, mm. Over its tabs an operation is higher.
        slack: deviation of a height, mm.
        """
        length = (gaps.high - gaps.low) * pieces.length[gaps.piece]
        # Near its ends a stretch may be in a shallow corner, which neither tool reaches.
        ends = np.minimum(self._corner / np.maximum(length, 1e-9), 0.5)
        count = np.maximum(np.ceil(length / _SPACING_MM), _LEAST_PLACES).astype(np.int64)
        gap = np.repeat(np.arange(len(count)), count)
        place = join_ranges(np.zeros(len(count), np.intp), count)
        inside = ends[gap] + (1 - 2 * ends[gap]) * place / (count[gap] - 1)
        points = points_along(
            pieces, gaps.piece[gap], gaps.low[gap] + (gaps.high - gaps.low)[gap] * inside
        )
        touched = np.zeros(len(points), np.bool_)
        for cut in self._cuts:
            if float(max(cut.task.depths)) >= depth - slack:
                highest = max(-depth, tab_top(cut.task)) + slack
                touched |= self._reach(cut, points, highest, _LEFT_MM)
        return np.asarray(np.bincount(gap, ~touched, len(length)) == 0)

    def clear(self, points: FloatArray, depth: float, slack: float) -> BoolArray:
        """(N,) whether earlier operations clear the places `points` (N, 2) at a depth.

        depth: depth of the pass below the top face, mm.
        slack: deviation of a height, mm.
        """
        cleared = np.zeros(len(points), np.bool_)
        for cut in self._cuts:
            cleared |= self._reach(cut, points, slack - depth, 0.0)
        return cleared

    def _reach(self, cut: EarlierCut, points: FloatArray, highest: float, left: float) -> BoolArray:
        """(N,) whether the tool of a cut comes to `points` (N, 2), `left` mm aside of it or less.

        highest: largest height of the motions that count, mm.
        """
        motions = cut.motions
        top = np.maximum(motions.start[:, 2], motions.end[:, 2])
        tree = PieceTree(motions.plane, np.flatnonzero(cut.of_task & (top <= highest)))
        nearest = tree.find(points, cut.task.job.tool.radius + self._limit + left)
        return np.asarray(np.isfinite(nearest.distance))


def cuts_before(task: Task, tasks: Sequence[Task]) -> list[Task]:
    """The tasks listed before `task` for one of its contours, if it takes only what they leave."""
    if not task.operation.rest:
        return []
    return [
        other
        for other in tasks
        if other.number < task.number and (other.worked & task.worked).any()
    ]
