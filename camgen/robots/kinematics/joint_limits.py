"""Joint values: the controller's and those of the closed form, limits, and the copies a turn away."""

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

#: rad or mm: a joint so far beyond its limit stands on it.
_ON_LIMIT = 1e-9


def theta_of(
    robot: Robot, arm: Spherical | ThreeParallel | Scara, joints: FloatArray
) -> FloatArray:
    """The angles of the closed form (..., J) for joint values (..., J)."""
    return np.asarray(joints @ robot.coupling.T * arm.signs + arm.offsets)


def joints_of(
    robot: Robot, arm: Spherical | ThreeParallel | Scara, theta: FloatArray
) -> FloatArray:
    """The joint values (..., J), wrapped, for angles of the closed form (..., J)."""
    return _unwind(robot, (theta - arm.offsets) * arm.signs)


def wrap(robot: Robot, joints: FloatArray) -> FloatArray:
    """``joints`` (..., J) with every turning joint within half a turn of the middle of its limits: those of the serial
    chain where a rod sets them.
    """
    return _unwind(robot, joints @ robot.coupling.T)


def _unwind(robot: Robot, serial: FloatArray) -> FloatArray:
    """``wrap`` for the values of the serial chain (..., J)."""
    middle, turn = _middles(robot)
    whole = np.rint((serial - middle) / math.tau)
    whole *= turn
    # Where one value is none all are.
    return np.asarray((serial - whole) @ uncoupling(robot).T)


@lru_cache(maxsize=16)
def _middles(robot: Robot) -> tuple[FloatArray, FloatArray]:
    """Of each joint of the serial chain (J,) the middle of its limits, and a whole turn, 0 of one that slides."""
    rod = np.isfinite(robot.serial_limits[:, 0])
    middle = np.where(rod[:, None], robot.serial_limits, robot.limits).mean(axis=1)
    return frozen(middle), frozen(math.tau * ~np.array([joint.sliding for joint in robot.joints]))


@lru_cache(maxsize=16)
def uncoupling(robot: Robot) -> FloatArray:
    """(J, J), takes turns of the serial chain to the controller's values."""
    return frozen(np.linalg.inv(robot.coupling))


def within(robot: Robot, joints: FloatArray) -> NDArray[np.bool_]:
    """Which joint values (..., J) keep all limits, the rod's too; nan does not."""
    return np.asarray(excess(robot, joints).max(axis=-1) <= _ON_LIMIT)


def excess(robot: Robot, joints: FloatArray) -> FloatArray:
    """Rad or mm by which each joint is beyond its limits or the rod's (..., J), 0 or less: within; nan: infinite."""
    serial = joints @ robot.coupling.T
    beyond = np.maximum.reduce(
        [
            robot.limits[:, 0] - joints,
            joints - robot.limits[:, 1],
            robot.serial_limits[:, 0] - serial,
            serial - robot.serial_limits[:, 1],
        ]
    )
    return np.where(np.isnan(beyond), math.inf, beyond)


@lru_cache(maxsize=16)
def turns(robot: Robot) -> NDArray[np.int64]:
    """Whole turns (T, J) by which a solution of ``inverse`` can be moved with hope of staying within the limits, from
    the most negative to the most positive, joint 1 slowest; joints at a rod stay.
    """
    plain = (robot.coupling == np.eye(len(robot.joints))).all(axis=0) & np.isinf(
        robot.serial_limits[:, 0]
    )
    ranges = []
    for joint, (low, high), alone in zip(
        robot.joints, robot.limits.tolist(), plain.tolist(), strict=True
    ):
        most = (
            int(((high - low) / 2 + math.pi + _ON_LIMIT) // math.tau)
            if alone and not joint.sliding
            else 0
        )
        ranges.append(range(-most, most + 1))
    table = np.array(list(itertools.product(*ranges)), dtype=np.int64)
    table.setflags(write=False)
    return table


def within_turned(
    robot: Robot, solutions: FloatArray, table: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Which of ``solutions`` (..., J), moved by each row of ``table`` (T, J), keep the limits (..., T)."""
    turning = table.any(axis=0)
    stays = np.ones(solutions.shape[:-1], dtype=np.bool_)
    for k in np.flatnonzero(~turning).tolist():
        stays &= _lies(solutions[..., k], robot.limits[k])
    for k in np.flatnonzero(np.isfinite(robot.serial_limits).any(axis=1)).tolist():
        stays &= _lies(solutions @ robot.coupling[k], robot.serial_limits[k])
    good = np.repeat(stays[..., None], len(table), axis=-1)
    for k in np.flatnonzero(turning).tolist():
        # Rows of the table share their turns of one joint: each number of turns is tested once.
        own = table[:, k]
        numbers = np.arange(own.min(), own.max() + 1)
        good &= _lies(solutions[..., k, None] + math.tau * numbers, robot.limits[k]).take(
            own - numbers[0], axis=-1
        )
    return good


def _lies(values: FloatArray, limits: FloatArray) -> NDArray[np.bool_]:
    """Which values of a joint are within its limits (2,); nan is not."""
    low, high = limits.tolist()
    return np.asarray((values >= low - _ON_LIMIT) & (values <= high + _ON_LIMIT))


def copies(robot: Robot, solutions: FloatArray) -> FloatArray:
    """All joint values within the limits that put the flange where ``solutions`` (..., J) do: (..., T, J), nan for a
    copy beyond a limit. T as in ``turns``.
    """
    table = turns(robot)
    every = np.asarray(solutions)[..., None, :] + math.tau * table
    return np.where(within_turned(robot, solutions, table)[..., None], every, np.nan)
