"""Motions of earlier operations, for an operation that takes only what they leave."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from camgen.check.proof.heights import tab_top
from camgen.check.proof.matching import Covered, PieceTree
from camgen.check.proof.motions import Motions
from camgen.check.proof.pieces import BoolArray, Pieces, points_along
from camgen.check.proof.tasks import Task
from camgen.model.pose import FloatArray

#: Shares of a stretch of a contour at which it is examined.
_SHARES = (0.02, 0.25, 0.5, 0.75, 0.98)
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
    """

    def __init__(self, cuts: Iterable[EarlierCut], limit: float) -> None:
        self._cuts = [cut for cut in cuts if cut.task.job.tool.kind in _FLAT]
        self._limit = limit

    def touch(self, gaps: Covered, pieces: Pieces, depth: float, slack: float) -> BoolArray:
        """(G,) whether the stretches `gaps` of the drawing `pieces` are touched, all along.

        depth: depth of the pass below the top face, mm. Over its tabs an operation is higher.
        slack: deviation of a height, mm.
        """
        touched = np.zeros((len(gaps.piece), len(_SHARES)), np.bool_)
        for column, share in enumerate(_SHARES):
            at = gaps.low + (gaps.high - gaps.low) * share
            points = points_along(pieces, gaps.piece, at)
            for cut in self._cuts:
                touched[:, column] |= self._touches(cut, points, depth, slack)
        return np.asarray(touched.all(axis=1))

    def _touches(
        self, cut: EarlierCut, points: FloatArray, depth: float, slack: float
    ) -> BoolArray:
        motions = cut.motions
        highest = np.maximum(motions.start[:, 2], motions.end[:, 2])
        if float(max(cut.task.depths)) < depth - slack:
            return np.zeros(len(points), np.bool_)
        deep = cut.of_task & (highest <= max(-depth, tab_top(cut.task)) + slack)
        tree = PieceTree(motions.plane, np.flatnonzero(deep))
        reach = cut.task.job.tool.radius + self._limit + _LEFT_MM
        near: BoolArray = np.isfinite(tree.find(points, reach).distance)
        return near


def cuts_before(task: Task, tasks: Sequence[Task]) -> list[Task]:
    """The tasks that are listed before `task`, if it takes only what they leave."""
    if not task.operation.rest:
        return []
    return [other for other in tasks if other.number < task.number]
