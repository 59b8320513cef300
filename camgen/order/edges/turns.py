"""Whole turns of the joints along a route: the same poses with the least motion between them.

A revolute joint with more than one turn within its limits reaches a pose in several ways. Motions
and retractions are the same in all of them, so only the links between them depend on the choice.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from msgspec.structs import replace

from camgen.model.part import IntArray
from camgen.model.pose import FloatArray, frozen
from camgen.motion.setup import EdgeMotion
from camgen.order.edges.retract import Retraction
from camgen.robots.kinematics.joint_limits import are_within_limits, list_turn_counts
from camgen.robots.models import Robot

#: Turns of a motion that are tried.
MOST_TURNS = 8

_Motion = TypeVar("_Motion", EdgeMotion, Retraction)


def list_turns(robot: Robot, joints: FloatArray, home: FloatArray) -> IntArray:
    """Whole turns (T, J) by which a motion can be moved, at most `MOST_TURNS`.

    Zero comes first, then those after which the joints need least time from home.

    joints: (N, J) joint values of the motion.
    home: (J,) joint values.
    """
    turn_ranges = []
    for values, (low, high), turning in zip(
        joints.T, robot.limits, (list_turn_counts(robot) != 0).any(axis=0).tolist(), strict=True
    ):
        lowest = math.ceil((low - values.min()) / math.tau) if turning else 0
        highest = math.floor((high - values.max()) / math.tau) if turning else 0
        turn_ranges.append(range(lowest, highest + 1))
    table = np.array(list(itertools.product(*turn_ranges)), dtype=np.int64)
    table = table.reshape(-1, joints.shape[1])
    table = table[table.any(axis=1)]
    moved = joints + math.tau * table[:, None]
    table, moved = (rows[are_within_limits(robot, moved).all(axis=1)] for rows in (table, moved))
    time = (np.abs(moved - home) / robot.fastest).max(axis=(1, 2))
    order = np.lexsort((*table.T[::-1], np.abs(table).sum(axis=1), np.round(time, 9)))
    no_turns = np.zeros((1, joints.shape[1]), dtype=np.int64)
    return np.concatenate([no_turns, table[order][: MOST_TURNS - 1]])


def turn_motion(motion: _Motion, whole: IntArray) -> _Motion:
    """A motion, or a retraction without detour, moved by whole turns (J,)."""
    angle = math.tau * whole
    return replace(
        motion,
        joints=frozen(motion.joints + angle),
        sampled_joints=frozen(motion.sampled_joints + angle),
    )


def find_cheapest(
    first: FloatArray, between: Sequence[FloatArray], last: FloatArray
) -> tuple[list[int], float]:
    """The turns of each of N motions in order with the least time, s, and that time.

    The time may be infinite. The earlier turns are taken if two choices are equal.

    first, last: (T,) time from home to the first motion, and from the last one.
    between: N - 1 tables (T, T) of the time from each motion to the next one.
    """
    time, sources = first, []
    for table in between:
        total = time[:, None] + table
        sources.append(total.argmin(axis=0))
        time = total.min(axis=0)
    total = time + last
    chosen = [int(total.argmin())]
    for source in reversed(sources):
        chosen.append(int(source[chosen[-1]]))
    return chosen[::-1], float(total.min())
