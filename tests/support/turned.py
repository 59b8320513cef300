"""Joint values that differ from a solution of the inverse kinematics by whole turns."""

from __future__ import annotations

import math

import numpy as np

from camgen.model.pose import FloatArray
from camgen.robots.kinematics.joint_limits import turns, within_turned
from camgen.robots.models import Robot


def add_turns(robot: Robot, solutions: FloatArray) -> FloatArray:
    """The joint values (..., T, J) with each of the turn counts for solutions (..., J).

    They are nan beyond a limit.
    """
    table = turns(robot)
    turned = np.asarray(solutions)[..., None, :] + math.tau * table
    return np.where(within_turned(robot, solutions, table)[..., None], turned, np.nan)
