"""The profile of a rotating tool: its radius at each height above its tip."""

from __future__ import annotations

import math

import numpy as np

from camgen.model.job import ToolTable
from camgen.model.pose import FloatArray

#: Kinds of tools that cut through the whole thickness with a beam or a blade, at any tip height.
BEAMS = ("laser", "plasma", "knife")
#: deg: full angle at the tip of a V tool, if the job does not state it.
_V_ANGLE = 90.0


def is_flat(tool: ToolTable) -> bool:
    """Whether the tool is a cylinder; the tip of a drill is not examined, so a drill is one too."""
    return tool.kind not in ("ball mill", "bull nose", "v") or (
        tool.kind == "bull nose" and tool.corner_radius == 0
    )


def compute_slope(tool: ToolTable) -> float:
    """Compute the increase of the radius of a V tool per mm of height."""
    return math.tan(math.radians((tool.tip_angle or _V_ANGLE) / 2))


def compute_radius(tool: ToolTable, height: FloatArray) -> FloatArray:
    """Compute the radius (N,) of a tool at `height` (N,) above the tip, mm.

    A ball of radius R has sqrt(R^2 - (R - h)^2). A bull nose has its flat, and the same of its
    corner. A V tool has half of its flat, and h tan(angle / 2). All are at most R.
    """
    height = np.maximum(height, 0.0)
    if is_flat(tool):
        return np.full(height.shape, tool.radius)
    if tool.kind == "v":
        return np.minimum(tool.tip_diameter / 2 + height * compute_slope(tool), tool.radius)
    corner = compute_full_height(tool)
    low = np.minimum(height, corner)
    return np.asarray(tool.radius - corner + np.sqrt(low * (2 * corner - low)))


def compute_full_height(tool: ToolTable) -> float:
    """Compute the height above the tip from which on the tool has its full radius, mm."""
    if is_flat(tool):
        return 0.0
    if tool.kind == "v":
        return max(tool.diameter - tool.tip_diameter, 0.0) / 2 / compute_slope(tool)
    return tool.radius if tool.kind == "ball mill" else min(tool.corner_radius, tool.radius)
