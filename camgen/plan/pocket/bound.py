"""The bound of engagement in a pocket, and the material that loops leave for the passes after them.

A pass runs along the walls in any case. Loops therefore leave as much material at the walls as that
pass may take: they are smaller, and sooner done.
"""

from __future__ import annotations

import heapq
import math

import numpy as np
from msgspec import Struct

from camgen.model.pose import FloatArray
from camgen.plan.pocket.ridge import Ridge

#: The smallest disc that leaves material at the walls, as a share of the tool's radius. Smaller
#: loops save less time than their stops take.
_SMALLEST_SHARE = 0.67
#: Discs reach over the second pass from the walls by this share of the tool's radius. The crests
#: between loops are lower, so that this pass touches nothing beside the discs.
_OVERLAP_SHARE = 0.05


class Bound(Struct, frozen=True):
    """A bound of engagement.

    radius: radius of the tool, mm.
    step: distance from pass to pass, mm.
    limit: the largest engagement, as a share of the diameter.
    ccw: whether fronts are cut counter-clockwise.
    """

    radius: float
    step: float
    limit: float
    ccw: bool

    @property
    def turn(self) -> float:
        """The angle by which a straight pass may turn, or a link lean, and engage no more, rad."""
        return math.acos(1 - 2 * self.limit) - math.acos(1 - self.step / self.radius)

    @property
    def curve(self) -> float:
        """The smallest radius of curves of the tool's centre on which a pass engages no more, mm.

        share = step (2 (rho + r) - step) / (4 rho r) by the law of cosines, for the outer circle.
        """
        r, s = self.radius, self.step
        return max(s, s * (2 * r - s) / (4 * r * self.limit - 2 * s))

    def widths(self, curves: FloatArray) -> FloatArray:
        """Material (N,) that a pass may take on inner curves, mm: the equation of `curve` for step.

        curves: (N,) their radii at the tool's centre, mm, 0 or more.
        """
        total = curves + self.radius
        square = total**2 - 4 * self.limit * curves * self.radius
        return np.asarray(total - np.sqrt(np.maximum(square, 0.0)))


def disc_sizes(axis: Ridge, largest: FloatArray, bound: Bound) -> FloatArray:
    """Radii (N,) of the discs about the places of a ridge, mm.

    A disc leaves no more at the walls than the pass along them may take. The material left grows
    so slowly along the ridge that this pass leans on it by `Bound.turn` or less.

    largest: (N,) radii of the largest discs between the walls, mm.
    """
    widths = np.minimum(
        bound.step - _OVERLAP_SHARE * bound.radius, bound.widths(np.maximum(largest, 0.0))
    )
    left = np.clip(largest - _SMALLEST_SHARE * bound.radius, 0.0, np.maximum(widths, 0.0))
    left = _flattened(axis, left, math.tan(bound.turn))
    return np.asarray(np.minimum(largest - left, bound.curve))


def _flattened(axis: Ridge, heights: FloatArray, slope: float) -> FloatArray:
    """The largest heights (N,) that are no more than ``heights``, and no steeper than ``slope``."""
    lowered = heights.tolist()
    steps = axis.points[axis.links[:, 1]] - axis.points[axis.links[:, 0]]
    rises = (slope * np.hypot(*steps.T)).tolist()
    neighbours: list[list[tuple[int, float]]] = [[] for _ in lowered]
    for (first, second), rise in zip(axis.links.tolist(), rises, strict=True):
        neighbours[first].append((second, rise))
        neighbours[second].append((first, rise))
    queue = [(height, place) for place, height in enumerate(lowered)]
    heapq.heapify(queue)
    while queue:
        height, place = heapq.heappop(queue)
        if height > lowered[place]:
            continue
        for neighbour, rise in neighbours[place]:
            if height + rise < lowered[neighbour]:
                lowered[neighbour] = height + rise
                heapq.heappush(queue, (height + rise, neighbour))
    return np.array(lowered)
