"""From the poses of a way to those of the flange, and how finely a motion is looked at."""

from __future__ import annotations

import math

import numpy as np

from camgen.edges.results import Setup
from camgen.edges.ways import Index, Way, counts
from camgen.pose import FloatArray

#: mm, rad: a motion is looked at so often, and no joint turns by more than JUMP rad from one look to the next.
_STEP, _TURN, JUMP = 5.0, math.radians(5), math.radians(15)
#: rad: what a motion keeps from singularities.
MARGIN = math.radians(2)


def dense_parts(way: Way) -> Index:
    """Into how many parts the segments of ``way`` are cut to be looked at."""
    return counts(way, _STEP, _TURN)


def flange_poses(setup: Setup, position: FloatArray, rotation: FloatArray) -> tuple[FloatArray, FloatArray]:
    """base_from_flange, rotations (..., 3, 3) and origins (..., 3), for the TCP in the work frame."""
    tool_from_flange = setup.flange_from_tool.inverse()
    turned = setup.base_from_work.rotation @ rotation
    base = position @ setup.base_from_work.rotation.T + np.asarray(setup.base_from_work.origin)
    return turned @ tool_from_flange.rotation, base + turned @ np.asarray(tool_from_flange.origin)
