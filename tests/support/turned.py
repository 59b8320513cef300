"""Joint values that differ from a solution of the inverse kinematics by whole turns."""

from __future__ import annotations

import math

import numpy as np

from camgen.model.pose import FloatArray
from camgen.robots.kinematics.joint_limits import are_turned_within_limits, list_turn_counts
from camgen.robots.models import Robot


def add_turns(robot: Robot, solutions: FloatArray) -> FloatArray:
    """The joint values (..., T, J) with each of the turn counts for solutions (..., J).

    They are nan beyond a limit.
    """
    table = list_turn_counts(robot)
    turned = np.asarray(solutions)[..., None, :] + math.tau * table
    return np.where(are_turned_within_limits(robot, solutions, table)[..., None], turned, np.nan)
