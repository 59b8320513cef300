"""Joints of an arm without a closed form: damped least squares (Levenberg, Marquardt) from several seeds at once."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from camgen.geometry.rotations import vectors_of
from camgen.model.pose import FloatArray
from camgen.robots.kinematics.arms import resembling
from camgen.robots.kinematics.forward import jacobian
from camgen.robots.kinematics.near_spherical import guesses
from camgen.robots.models import Robot

#: So many solutions per pose at most, and as many seeds for arms whose ``guesses`` are near them.
SEEDS = 16
#: Seeds per pose for other arms: 16 missed one in ten solutions of a cobot with three parallel axes, 48 none of 200.
_TRIES = 48
#: The iteration ends at so many mm and rad: far below the 1e-6 mm that is promised.
MM, RAD = 1e-8, 1e-11
#: Poses solved at once: bounds the memory.
_CHUNK = 256
_STEPS, _STRIDE = 40, 0.5
#: Keeps the equations solvable where the arm is singular.
_LEAST_DAMPING = 1e-14
#: rad, mm: two solutions as near as this are one.
_SAME_SOLUTION = 1e-5


def solve(robot: Robot, rotations: FloatArray, origins: FloatArray) -> FloatArray:
    """Joint values (N, SEEDS, J) for base_from_flange (N, 3, 3), (N, 3), mm: each solution once, in the order of the
    seeds that found it, limits aside; nan where no more was found.

    The seeds: ``guesses``, and an even spread over the limits for the rest.
    """
    parts = range(0, len(origins), _CHUNK)
    found = [_solve(robot, rotations[i : i + _CHUNK], origins[i : i + _CHUNK]) for i in parts]
    return np.concatenate([np.empty((0, SEEDS, len(robot.joints))), *found])


def _solve(robot: Robot, rotations: FloatArray, origins: FloatArray) -> FloatArray:
    tries = _TRIES if resembling(robot.joints, robot.flange) is None else SEEDS
    near = guesses(robot, rotations, origins, tries)
    start = np.where(np.isnan(near), _spread(robot, tries), near).reshape(len(origins) * tries, -1)
    found = refine(
        robot, np.repeat(rotations, tries, axis=0), np.repeat(origins, tries, axis=0), start
    )
    return _distinct(robot, found.reshape(len(origins), tries, -1))[:, :SEEDS]


def _spread(robot: Robot, tries: int) -> FloatArray:
    """Configurations (tries, J) spread evenly over the limits: home, then multiples of roots of a polynomial, the
    generalised golden ratio, modulo 1.
    """
    count = len(robot.joints)
    ratio = 2.0
    for _ in range(64):
        ratio = (1.0 + ratio) ** (1.0 / (count + 1))
    steps = ratio ** -np.arange(1.0, count + 1)
    spread = np.mod(0.5 + np.arange(1, tries)[:, None] * steps, 1.0)
    low, high = robot.limits.T
    return np.vstack([robot.home, low + spread * (high - low)])


def refine(
    robot: Robot, rotations: FloatArray, origins: FloatArray, start: FloatArray
) -> FloatArray:
    """Joint values (M, J) for M poses, each from its own start (M, J); nan where the iteration does not arrive."""
    joints = np.array(start, dtype=np.float64)
    units = np.array(
        [robot.lever if joint.sliding else 1.0 for joint in robot.joints]
    )  # a slide moves in levers
    done = np.zeros(len(joints), dtype=bool)
    active = np.flatnonzero(np.isfinite(joints).all(axis=1))
    for _ in range(_STEPS):
        moved, error, mm, rad = _errors(robot, rotations[active], origins[active], joints[active])
        arrived = (mm <= MM) & (rad <= RAD)
        done[active[arrived]] = True
        active, moved, error = active[~arrived], moved[~arrived], error[~arrived]
        if not len(active):
            break
        joints[active] += _step(moved * units, error) * units
    joints[~done] = np.nan
    return joints


def _errors(
    robot: Robot, rotations: FloatArray, origins: FloatArray, joints: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Jacobian (M, 6, J) and what is missing to the pose (M, 6), lengths divided by the lever; both errors (M,)."""
    moved, now, tip = jacobian(robot, joints)
    away = origins - tip
    turn = vectors_of(rotations @ now.transpose(0, 2, 1))
    moved[:, :3] /= robot.lever
    return (
        moved,
        np.hstack([away / robot.lever, turn]),
        np.linalg.norm(away, axis=1),
        np.linalg.norm(turn, axis=1),
    )


def _step(moved: FloatArray, error: FloatArray) -> FloatArray:
    """The damped step (M, J), not longer than ``_STRIDE`` in any joint. The damping falls with the square of the error,
    so that the last steps are Newton's.
    """
    back = moved.transpose(0, 2, 1)
    damping = np.minimum(0.1 * (error**2).sum(axis=1), 0.1) + _LEAST_DAMPING
    square = back @ moved + damping[:, None, None] * np.eye(moved.shape[2])
    step = np.linalg.solve(square, back @ error[..., None])[..., 0]
    most = np.abs(step).max(axis=1, keepdims=True)
    return np.asarray(step * np.minimum(1.0, _STRIDE / np.maximum(most, _STRIDE)))


def _distinct(robot: Robot, found: FloatArray) -> FloatArray:
    """``found`` (N, S, J) with repeated solutions, whole turns apart too, moved out: nan at the end of each row."""
    turning = np.array([not joint.sliding for joint in robot.joints])
    apart = found[:, :, None] - found[:, None]
    apart = np.where(turning, np.remainder(apart + math.pi, math.tau) - math.pi, apart)
    same: NDArray[np.bool_] = np.abs(apart).max(axis=3) < _SAME_SOLUTION
    repeated = (same & np.tri(found.shape[1], k=-1, dtype=bool)).any(axis=2)
    lost = repeated | np.isnan(found[:, :, 0])
    order = np.argsort(lost, axis=1, kind="stable")
    kept = np.where(lost[..., None], np.nan, found)
    return np.take_along_axis(kept, order[..., None], axis=1)
