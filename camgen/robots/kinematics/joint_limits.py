"""Joint limits and turn counts, and conversions between joint values and angles of closed forms."""

from __future__ import annotations

import itertools
import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from camgen.model.pose import FloatArray, frozen
from camgen.robots.kinematics.arms import Scara, Spherical
from camgen.robots.kinematics.three_parallel import ThreeParallel
from camgen.robots.models import Robot

#: rad or mm: a joint that is beyond its limit by less is at the limit.
ON_LIMIT = 1e-9


def compute_theta(
    robot: Robot, arm: Spherical | ThreeParallel | Scara, joints: FloatArray
) -> FloatArray:
    """The angles of the closed form (..., J) for joint values (..., J)."""
    return np.asarray(joints @ robot.coupling.T * arm.signs + arm.offsets)


def compute_joints(
    robot: Robot, arm: Spherical | ThreeParallel | Scara, theta: FloatArray
) -> FloatArray:
    """The joint values (..., J), wrapped, for angles of the closed form (..., J)."""
    return _unwind(robot, (theta - arm.offsets) * arm.signs)


def wrap_joints(robot: Robot, joints: FloatArray) -> FloatArray:
    """Joint values (..., J) with revolute joints within half a turn of the middle of their limits.

    The limits are those of the serial chain if a rod sets them.
    """
    return _unwind(robot, joints @ robot.coupling.T)


def _unwind(robot: Robot, serial: FloatArray) -> FloatArray:
    """`wrap` for values of the serial chain (..., J)."""
    middle, turn = _middles(robot)
    whole = np.rint((serial - middle) / math.tau)
    whole *= turn
    # If one value is nan, all are.
    return np.asarray((serial - whole) @ invert_coupling(robot).T)


@lru_cache(maxsize=16)
def _middles(robot: Robot) -> tuple[FloatArray, FloatArray]:
    """Middles of the limits of the serial chain, and whole turns, 0 for slides (J,), rad or mm."""
    rod = np.isfinite(robot.serial_limits[:, 0])
    middle = np.where(rod[:, None], robot.serial_limits, robot.limits).mean(axis=1)
    return frozen(middle), frozen(math.tau * robot.revolute)


@lru_cache(maxsize=16)
def invert_coupling(robot: Robot) -> FloatArray:
    """(J, J) matrix from values of the serial chain to joint values."""
    return frozen(np.linalg.inv(robot.coupling))


def are_within_limits(robot: Robot, joints: FloatArray) -> NDArray[np.bool_]:
    """Whether joint values (..., J) keep all limits, also those of a rod; False for nan."""
    return np.asarray(measure_excess(robot, joints).max(axis=-1) <= ON_LIMIT)


def measure_excess(robot: Robot, joints: FloatArray) -> FloatArray:
    """Distance by which each joint is beyond its limits or those of a rod (..., J), rad or mm.

    It is at most 0 within the limits, and infinite for nan.
    """
    serial, low, high = joints @ robot.coupling.T, robot.limits[:, 0], robot.limits[:, 1]
    beyond = np.maximum(low - joints, joints - high)
    beyond = np.maximum(beyond, robot.serial_limits[:, 0] - serial)
    beyond = np.maximum(beyond, serial - robot.serial_limits[:, 1])
    return np.where(np.isnan(beyond), math.inf, beyond)


@lru_cache(maxsize=16)
def list_turn_counts(robot: Robot) -> NDArray[np.int64]:
    """The turn counts (T, J) that may bring a solution of `inverse` within the limits.

    They are sorted from the most negative one, and joint 1 changes slowest. Joints at a rod do not
    turn.
    """
    is_alone = (robot.coupling == np.eye(len(robot.joints))).all(axis=0)
    is_alone &= np.isinf(robot.serial_limits[:, 0])
    low, high = robot.limits.T
    limit = ((high - low) / 2 + math.pi + ON_LIMIT) // math.tau
    limit *= is_alone & robot.revolute
    ranges = [range(-count, count + 1) for count in limit.astype(np.int64).tolist()]
    table = np.array(list(itertools.product(*ranges)), dtype=np.int64)
    table.setflags(write=False)
    return table


def are_turned_within_limits(
    robot: Robot, solutions: FloatArray, table: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Whether solutions (..., J), turned by rows of `table` (T, J), keep the limits (..., T)."""
    turns_joint = table.any(axis=0)
    stays = np.ones(solutions.shape[:-1], dtype=np.bool_)
    for k in np.flatnonzero(~turns_joint).tolist():
        stays &= _keep_limits(solutions[..., k], robot.limits[k])
    for k in np.flatnonzero(np.isfinite(robot.serial_limits).any(axis=1)).tolist():
        stays &= _keep_limits(solutions @ robot.coupling[k], robot.serial_limits[k])
    is_within = np.repeat(stays[..., None], len(table), axis=-1)
    for k in np.flatnonzero(turns_joint).tolist():
        # Rows of the table share turn counts of a joint. Each count is tested once.
        turn_counts = table[:, k]
        distinct = np.arange(turn_counts.min(), turn_counts.max() + 1)
        kept = _keep_limits(solutions[..., k, None] + math.tau * distinct, robot.limits[k])
        is_within &= kept.take(turn_counts - distinct[0], axis=-1)
    return is_within


def _keep_limits(values: FloatArray, limits: FloatArray) -> NDArray[np.bool_]:
    """Whether values of a joint are within its limits (2,); False for nan."""
    low, high = limits.tolist()
    return np.asarray((values >= low - ON_LIMIT) & (values <= high + ON_LIMIT))
