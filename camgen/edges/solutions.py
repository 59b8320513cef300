"""Joints for a table of poses, D looks by C orientations, branches in the same columns throughout."""

from __future__ import annotations

import numpy as np

from camgen.edges.ways import Index
from camgen.pose import FloatArray
from camgen.robots import damped
from camgen.robots.inverse import inverse
from camgen.robots.models import Robot
from camgen.robots.values import wrapped


def solutions(robot: Robot, rotations: FloatArray, origins: FloatArray, moves: Index) -> FloatArray:
    """Joint values (D, C, B, J) for base_from_flange (D, C, 3, 3), (D, C, 3), nan: none. moves: ``freedom.Grid``'s.

    Without a closed form those of the first pose are followed: from orientation to neighbouring orientation, then all
    from look to look.
    """
    looks, choices = origins.shape[:2]
    if robot.arm:
        found = inverse(robot, rotations.reshape(-1, 3, 3), origins.reshape(-1, 3), robot.home)
        return found.reshape(looks, choices, found.shape[1], -1)
    first = inverse(robot, rotations[0, :1], origins[0, :1])[0]
    first = first[np.isfinite(first[:, 0])]
    found = np.full((looks, choices, len(first), len(robot.joints)), np.nan)
    found[0, 0] = first
    known = np.arange(choices) == 0
    for _ in range(choices):
        sources = np.where((moves >= 0) & known[moves], moves, -1).max(axis=0)
        new = np.flatnonzero(~known & (sources >= 0))
        if not len(new):
            break
        found[0, new] = _followed(robot, rotations[0, new], origins[0, new], found[0, sources[new]])
        known[new] = True
    for row in range(1, looks):
        found[row] = _followed(robot, rotations[row], origins[row], found[row - 1])
    return found


def _followed(robot: Robot, rotations: FloatArray, origins: FloatArray, near: FloatArray) -> FloatArray:
    """Joints (C, B, J) for C poses from those of ``near`` (C, B, J)."""
    branches = near.shape[1]
    goal = np.repeat(rotations, branches, axis=0), np.repeat(origins, branches, axis=0)
    return wrapped(robot, damped.refine(robot, *goal, near.reshape(-1, near.shape[2]))).reshape(near.shape)
