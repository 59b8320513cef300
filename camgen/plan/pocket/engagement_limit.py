"""The engagement limit of a pocket, and the material that trochoidal loops leave for the passes.

A pass along the walls is cut in any case. So the loops before it leave as much material at the
walls as this pass may take. That makes the loops smaller and faster.
"""

from __future__ import annotations

import heapq
import math

import numpy as np
from msgspec import Struct

from camgen.model.pose import FloatArray
from camgen.plan.pocket.medial_axis import MedialAxis

#: Radius of the smallest disc that leaves material at the walls, as a fraction of the tool radius.
#: Smaller loops save less time than their stops take.
_SMALLEST_FRACTION = 0.67
#: Discs overlap with the second pass from the walls by this fraction of the tool radius. The crests
#: between loops are lower, so this pass cuts no material beside the discs.
_OVERLAP_FRACTION = 0.05


class EngagementLimit(Struct, frozen=True):
    """An engagement limit, and the settings of a pocket from which other limits follow.

    tool_radius: mm.
    stepover: distance between neighbouring passes, mm.
    engagement: maximum engagement, as a fraction of the tool diameter.
    ccw: whether the fronts of loops are cut counter-clockwise.
    """

    tool_radius: float
    stepover: float
    engagement: float
    ccw: bool

    @property
    def max_turn(self) -> float:
        """Maximum corner angle of a pass, or angle between link and pass, within the limit, rad."""
        straight = math.acos(1 - self.stepover / self.tool_radius)
        return math.acos(1 - 2 * self.engagement) - straight

    @property
    def min_radius(self) -> float:
        """Minimum radius of an inner curve of the tool centre on which a pass keeps the limit, mm.

        With radius rho, stepover s and tool radius r the law of cosines, for the outer circle,
        gives the engagement s (2 (rho + r) - s) / (4 rho r).
        """
        r, s = self.tool_radius, self.stepover
        return max(s, s * (2 * r - s) / (4 * r * self.engagement - 2 * s))

    def max_widths(self, radii: FloatArray) -> FloatArray:
        """Widths of material (N,) that a pass may take on inner curves, mm.

        This is the equation of `min_radius`, solved for the stepover.

        radii: (N,) radii of the curves at the tool centre, mm, 0 or more.
        """
        total = radii + self.tool_radius
        square = total**2 - 4 * self.engagement * radii * self.tool_radius
        return np.asarray(total - np.sqrt(np.maximum(square, 0.0)))


def compute_disc_radii(axis: MedialAxis, largest: FloatArray, limit: EngagementLimit) -> FloatArray:
    """Radii (N,) of the discs around the points of a medial axis, mm.

    A disc leaves no more material at the walls than the pass along them may take, and is no larger
    than `EngagementLimit.min_radius`. The thickness of the material at the walls grows slowly along
    the axis, so that the pass turns by at most `EngagementLimit.max_turn`.

    largest: (N,) radii of the largest discs between the walls, mm; negative if there is no room.
    """
    widths = np.minimum(
        limit.stepover - _OVERLAP_FRACTION * limit.tool_radius,
        limit.max_widths(np.maximum(largest, 0.0)),
    )
    thickness = np.clip(
        largest - _SMALLEST_FRACTION * limit.tool_radius, 0.0, np.maximum(widths, 0.0)
    )
    thickness = _limit_slope(axis, thickness, math.tan(limit.max_turn))
    return np.asarray(np.minimum(largest - thickness, limit.min_radius))


def _limit_slope(axis: MedialAxis, heights: FloatArray, slope: float) -> FloatArray:
    """The largest heights (N,) that exceed neither `heights` nor, along any link, `slope`."""
    lowered = heights.tolist()
    links = np.concatenate([axis.links, axis.links[:, ::-1]])
    points, others = links.T
    rises = slope * np.hypot(*(axis.points[others] - axis.points[points]).T)
    neighbours: list[list[tuple[int, float]]] = [[] for _ in lowered]
    for (point, neighbour), rise in zip(links.tolist(), rises.tolist(), strict=True):
        neighbours[point].append((neighbour, rise))
    # Only points that lower a neighbour are needed at first.
    is_lower = heights[points] + rises < heights[others]
    queue = [(lowered[point], point) for point in points[is_lower].tolist()]
    heapq.heapify(queue)
    while queue:
        height, point = heapq.heappop(queue)
        if height > lowered[point]:
            continue
        for neighbour, rise in neighbours[point]:
            if height + rise < lowered[neighbour]:
                lowered[neighbour] = height + rise
                heapq.heappush(queue, (height + rise, neighbour))
    return np.array(lowered)
