"""What a path can choose from: joint values of every row, branch by branch, ordered so that columns go on smoothly."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from camgen.pose import FloatArray
from camgen.robots import damped
from camgen.robots.inverse import inverse
from camgen.robots.models import Robot
from camgen.robots.singular import from_singular
from camgen.robots.values import wrapped

#: rad: nearer than this to a singularity a joint is free, and is kept from the row before.
_FREE = 2e-9


def candidates(robot: Robot, rotations: FloatArray, origins: FloatArray, start: FloatArray) -> FloatArray:
    """Joint values (N, B, J) of a path of base_from_flange (N, 3, 3), (N, 3); nan: none. start: (J,), for joints that
    the first rows leave free.
    """
    if robot.arm is None:
        return _tracked(robot, rotations, origins)
    solutions = inverse(robot, rotations, origins, start)
    if robot.kind != "spherical-wrist":
        return solutions
    free = np.asarray((from_singular(robot, solutions)[:, :, ::2] < _FREE).any(axis=2))
    return _kept(robot, rotations, origins, solutions, free) if free.any() else solutions


def _kept(
    robot: Robot, rotations: FloatArray, origins: FloatArray, solutions: FloatArray, free: NDArray[np.bool_]
) -> FloatArray:
    """``solutions`` with free joints taken, in each branch, from the last row before in which they were not free, or
    the first after.
    """
    solutions = solutions.copy()
    rows = np.arange(len(solutions))
    for column in range(solutions.shape[1]):
        fixed = rows[~free[:, column] & np.isfinite(solutions[:, column, 0])]
        own = rows[free[:, column]]
        if len(fixed) and len(own):
            source = fixed[np.maximum(np.searchsorted(fixed, own) - 1, 0)]
            near = solutions[source, column][:, None]
            solutions[own, column] = inverse(robot, rotations[own], origins[own], near)[:, column]
    return solutions


def _tracked(robot: Robot, rotations: FloatArray, origins: FloatArray) -> FloatArray:
    """For arms without a closed form: each solution of the first row followed from row to row."""
    rows = np.full((len(origins), damped.SEEDS, len(robot.joints)), np.nan)
    rows[0] = inverse(robot, rotations[:1], origins[:1])[0]
    for row in range(1, len(origins)):
        alive = np.flatnonzero(np.isfinite(rows[row - 1, :, 0]))
        goal = np.broadcast_to(rotations[row], (len(alive), 3, 3)), np.broadcast_to(origins[row], (len(alive), 3))
        rows[row, alive] = wrapped(robot, damped.refine(robot, *goal, rows[row - 1, alive]))
    return rows
