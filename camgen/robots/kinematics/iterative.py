"""Inverse kinematics without a closed form: damped least squares from several seeds at once.

The method is that of Levenberg and Marquardt. Six axes with a wrist that is nearly spherical have
good seeds: axis 6 passes the point where axes 4 and 5 meet. For a given angle of axis 6 that point
is known, and with it axes 1 to 5 in closed form, as if the wrist were spherical. These need another
angle of axis 6. Where the difference of both angles changes its sign there is a solution.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from camgen.geometry.rotations import compute_rotation_vectors, make_rotations_about_z
from camgen.model.pose import FloatArray
from camgen.robots.chain import make_zero_chain
from camgen.robots.kinematics import spherical
from camgen.robots.kinematics.arms import Spherical, find_resembling_arm
from camgen.robots.kinematics.forward import compute_jacobian
from camgen.robots.kinematics.joint_limits import compute_joints
from camgen.robots.models import Robot

#: Maximum number of solutions per pose, and number of seeds for arms with good `find_guesses`.
SEEDS = 16
#: Seeds per pose for other arms: 16 missed one in ten solutions of a cobot with three parallel
#: axes, 48 none of 200.
_TRIES = 48
#: mm and rad at which the iteration ends, far below the 1e-6 mm that is promised.
MM, RAD = 1e-8, 1e-11
#: Poses solved together: bounds the memory.
_CHUNK = 256
#: Maximum number of steps, and the largest change of a joint in one, rad.
_STEPS, _STRIDE = 40, 0.5
#: Smallest damping: keeps the equations solvable at singularities.
_MIN_DAMPING = 1e-14
#: rad or mm: solutions that differ by less are equal.
_SAME_SOLUTION = 1e-5


def solve(robot: Robot, rotations: FloatArray, origins: FloatArray) -> FloatArray:
    """Joint values (N, SEEDS, J) for poses of the flange; nan after the last solution.

    Each solution is listed once, in the order of the seeds that lead to it. Limits are ignored. The
    seeds are `find_guesses`, and an even spread over the limits for the rest.

    rotations, origins: base_from_flange, (N, 3, 3) and (N, 3), mm.
    """
    solutions = [np.empty((0, SEEDS, len(robot.joints)))]
    for begin in range(0, len(origins), _CHUNK):
        rows = slice(begin, begin + _CHUNK)
        solutions.append(_solve(robot, rotations[rows], origins[rows]))
    return np.concatenate(solutions)


def _solve(robot: Robot, rotations: FloatArray, origins: FloatArray) -> FloatArray:
    tries = _TRIES if find_resembling_arm(robot.joints, robot.flange) is None else SEEDS
    near = find_guesses(robot, rotations, origins, tries)
    start = np.where(np.isnan(near), _spread(robot, tries), near).reshape(len(origins) * tries, -1)
    goal = np.repeat(rotations, tries, axis=0), np.repeat(origins, tries, axis=0)
    solutions = refine(robot, *goal, start).reshape(len(origins), tries, -1)
    return _remove_repeated(robot, solutions)[:, :SEEDS]


def _spread(robot: Robot, tries: int) -> FloatArray:
    """Joint values (tries, J) spread evenly over the limits.

    Home is the first. Then come multiples of the powers of the generalised golden ratio, modulo 1.
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
    """Joint values (M, J) for M poses, each from its own start (M, J); nan without convergence."""
    joints = np.array(start, dtype=np.float64)
    # A slide moves in units of the lever.
    units = np.where(robot.revolute, 1.0, robot.lever)
    done = np.zeros(len(joints), dtype=bool)
    active = np.flatnonzero(np.isfinite(joints).all(axis=1))
    for _ in range(_STEPS):
        moved, error, mm, rad = _errors(robot, rotations[active], origins[active], joints[active])
        is_done = (mm <= MM) & (rad <= RAD)
        done[active[is_done]] = True
        active, moved, error = active[~is_done], moved[~is_done], error[~is_done]
        if not len(active):
            break
        joints[active] += _step(moved * units, error) * units
    joints[~done] = np.nan
    return joints


def _errors(
    robot: Robot, rotations: FloatArray, origins: FloatArray, joints: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """The Jacobian (M, 6, J), the error of the pose (M, 6), and its length and its angle (M,).

    Lengths in the first two are divided by the lever.
    """
    moved, rotation, origin = compute_jacobian(robot, joints)
    offset = origins - origin
    turn = compute_rotation_vectors(rotations @ rotation.transpose(0, 2, 1))
    moved[:, :3] /= robot.lever
    error = np.hstack([offset / robot.lever, turn])
    return moved, error, np.linalg.norm(offset, axis=1), np.linalg.norm(turn, axis=1)


def _step(moved: FloatArray, error: FloatArray) -> FloatArray:
    """The damped step (M, J), at most `_STRIDE` in any joint.

    The damping is proportional to the square of the error, so the last steps are those of Newton's
    method.
    """
    back = moved.transpose(0, 2, 1)
    damping = np.minimum(0.1 * (error**2).sum(axis=1), 0.1) + _MIN_DAMPING
    square = back @ moved + damping[:, None, None] * np.eye(moved.shape[2])
    step = np.linalg.solve(square, back @ error[..., None])[..., 0]
    largest = np.abs(step).max(axis=1, keepdims=True)
    return np.asarray(step * np.minimum(1.0, _STRIDE / np.maximum(largest, _STRIDE)))


def _remove_repeated(robot: Robot, solutions: FloatArray) -> FloatArray:
    """`solutions` (N, S, J) without repeated ones, up to whole turns; nan at the end of a row."""
    change = solutions[:, :, None] - solutions[:, None]
    change = np.where(robot.revolute, np.remainder(change + math.pi, math.tau) - math.pi, change)
    is_same: NDArray[np.bool_] = np.abs(change).max(axis=3) < _SAME_SOLUTION
    is_repeated = (is_same & np.tri(solutions.shape[1], k=-1, dtype=bool)).any(axis=2)
    is_lost = is_repeated | np.isnan(solutions[:, :, 0])
    order = np.argsort(is_lost, axis=1, kind="stable")
    kept = np.where(is_lost[..., None], np.nan, solutions)
    return np.take_along_axis(kept, order[..., None], axis=1)


# Seeds for a wrist that is nearly spherical.

#: Angles of axis 6 that are tried: two solutions within 3 deg of each other can be missed.
_GUESS_STEPS = 120


def find_guesses(
    robot: Robot, rotations: FloatArray, origins: FloatArray, limit: int
) -> FloatArray:
    """Joint values (N, limit, J) near solutions for poses of the flange; nan for no guess.

    An arm of another build has no guesses.

    rotations, origins: base_from_flange, (N, 3, 3) and (N, 3), mm.
    """
    arm = find_resembling_arm(robot.joints, robot.flange)
    if arm is None:
        return np.full((len(origins), limit, len(robot.joints)), np.nan)
    steps = np.linspace(-math.pi, math.pi, _GUESS_STEPS + 1)
    theta = _compute_angles(robot, arm, rotations, origins, steps)
    # Both postures of the wrist need angles of axis 6 that are half a turn apart. If one needs 0 up
    # to half a turn, the posture that needs exactly 0 is a solution.
    needed = np.remainder(theta[..., 5] + math.pi, math.tau) - math.pi
    theta[..., 5] = steps[:, None]
    is_first = (np.abs(needed[..., ::2]) < math.pi / 2)[..., None]
    chosen = np.where(is_first, theta[:, :, ::2], theta[:, :, 1::2])
    needed = np.remainder(needed[..., ::2] + math.pi / 2, math.pi) - math.pi / 2
    near = np.where(_are_near(needed)[..., None], chosen, np.nan).reshape(len(origins), -1, 6)
    order = np.argsort(np.isnan(near[:, :, 0]), axis=1, kind="stable")[:, :limit]
    return compute_joints(robot, arm, np.take_along_axis(near, order[..., None], axis=1))


def _are_near(needed: FloatArray) -> NDArray[np.bool_]:
    """Whether angles (N, K, 4) are next to a change of sign, on the nearer side of it."""
    is_near = np.zeros(needed.shape, dtype=bool)
    before, after = needed[:, :-1], needed[:, 1:]
    crosses = (before * after <= 0) & (np.abs(before - after) < math.pi / 2)
    is_nearer = np.abs(before) <= np.abs(after)
    is_near[:, :-1] |= crosses & is_nearer
    is_near[:, 1:] |= crosses & ~is_nearer
    return is_near


def _compute_angles(
    robot: Robot, arm: Spherical, rotations: FloatArray, origins: FloatArray, steps: FloatArray
) -> FloatArray:
    """The angles (N, K, 8, 6) of the arm for K angles of axis 6.

    The last column is the further angle of axis 6 that the others need.
    """
    zero = make_zero_chain(robot.joints, robot.flange)
    flange_from_wrist = arm.flange_from_wrist
    x, y, _ = (zero.base_from_flange @ flange_from_wrist).inverse().apply(zero.points[5])
    # The rotation back about axis 6, which passes through x, y.
    back = make_rotations_about_z(-steps)
    passes = np.array([x, y, 0.0])
    frame, centre = flange_from_wrist.rotation, np.asarray(flange_from_wrist.origin)
    turn = frame @ back @ frame.T
    shift = centre + (passes - back @ passes) @ frame.T - turn @ centre
    turned = rotations[:, None] @ turn
    places = origins[:, None] + (rotations[:, None] @ shift[..., None])[..., 0]
    theta = spherical.compute_angles(
        arm, turned.reshape(-1, 3, 3), places.reshape(-1, 3), np.zeros(6)
    )
    return theta.reshape(len(origins), len(steps), spherical.BRANCHES, 6)
