"""The shape of a tool that turns: how far it reaches to the side at each height above its tip."""

from __future__ import annotations

import math

import numpy as np

from camgen.model.job import ToolTable
from camgen.model.pose import FloatArray

#: Kinds that cut with a beam or a blade through the whole thickness, at whatever height their tip runs.
BEAMS = ("laser", "plasma", "knife")
#: The whole angle at the tip of a V tool, deg, where the job does not say it.
_V_ANGLE = 90.0


def is_flat(tool: ToolTable) -> bool:
    """Whether the tool is as wide at its tip as above; a drill counts as one, its tip is not looked at."""
    return tool.kind not in ("ball mill", "bull nose", "v") or (
        tool.kind == "bull nose" and tool.corner_radius == 0
    )


def slope(tool: ToolTable) -> float:
    """By how much a V tool is wider for each mm of height on one side."""
    return math.tan(math.radians((tool.tip_angle or _V_ANGLE) / 2))


def reach(tool: ToolTable, height: FloatArray) -> FloatArray:
    """The radius (N,) in mm at ``height`` (N,) mm above the tip, 0 and more.

    A ball of radius R leaves sqrt(R^2 - (R - h)^2); a bull nose that of its corner beside the flat; a V tool its half
    flat and h tan(angle / 2), all of them R at most.
    """
    most = tool.radius
    height = np.maximum(height, 0.0)
    if is_flat(tool):
        return np.full(height.shape, most)
    if tool.kind == "v":
        return np.minimum(tool.tip_diameter / 2 + height * slope(tool), most)
    round_ = most if tool.kind == "ball mill" else min(tool.corner_radius, most)
    low = np.minimum(height, round_)
    return np.asarray(most - round_ + np.sqrt(low * (2 * round_ - low)))


def height_of_widest(tool: ToolTable) -> float:
    """The height above the tip, mm, from which on the tool has its whole radius."""
    if is_flat(tool):
        return 0.0
    if tool.kind == "v":
        return max(tool.diameter - tool.tip_diameter, 0.0) / 2 / slope(tool)
    return tool.radius if tool.kind == "ball mill" else min(tool.corner_radius, tool.radius)
