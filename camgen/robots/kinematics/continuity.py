"""One branch and one count of turns along a whole path: the choice that costs the joints the least time.

Point by point, the nearest solution can lead into a limit that another branch, or the same one a turn earlier, would
have passed. So every row keeps all of them, and dynamic programming finds the cheapest chain (Viterbi).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.ragged import offsets
from camgen.model.pose import FloatArray
from camgen.robots.kinematics import iterative as damped
from camgen.robots.kinematics.inverse import inverse
from camgen.robots.kinematics.joint_limits import turns, within_turned, wrap
from camgen.robots.kinematics.singular import from_singular
from camgen.robots.models import Robot

# What a path can choose from: joint values of every row, branch by branch, ordered so that columns go on smoothly.

#: rad: nearer than this to a singularity a joint is free, and is kept from the row before.
_FREE = 2e-9


def candidates(
    robot: Robot, rotations: FloatArray, origins: FloatArray, start: FloatArray
) -> FloatArray:
    """Joint values (N, B, J) of a path of base_from_flange (N, 3, 3), (N, 3); nan: none. start: (J,), for joints that
    the first rows leave free.
    """
    if robot.arm is None:
        return _track(robot, rotations, origins)
    return _solve(robot, rotations, origins, start, [slice(0, len(origins))])


def _solve(
    robot: Robot,
    rotations: FloatArray,
    origins: FloatArray,
    start: FloatArray,
    paths: Sequence[slice],
) -> FloatArray:
    """``candidates`` of several paths one after the other, for arms with a closed form. start: (J,) or, of each row,
    (N, 1, J).
    """
    solutions = inverse(robot, rotations, origins, start)
    if robot.kind != "spherical-wrist":
        return solutions
    free = np.asarray((from_singular(robot, solutions)[:, :, ::2] < _FREE).any(axis=2))
    if free.any():
        solutions = solutions.copy()
        for own in paths:
            solutions[own] = _keep_free(
                robot, rotations[own], origins[own], solutions[own], free[own]
            )
    return solutions


def _keep_free(
    robot: Robot,
    rotations: FloatArray,
    origins: FloatArray,
    solutions: FloatArray,
    free: NDArray[np.bool_],
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


def _track(robot: Robot, rotations: FloatArray, origins: FloatArray) -> FloatArray:
    """For arms without a closed form: each solution of the first row followed from row to row."""
    rows = np.full((len(origins), damped.SEEDS, len(robot.joints)), np.nan)
    rows[0] = inverse(robot, rotations[:1], origins[:1])[0]
    for row in range(1, len(origins)):
        alive = np.flatnonzero(np.isfinite(rows[row - 1, :, 0]))
        goal = (
            np.broadcast_to(rotations[row], (len(alive), 3, 3)),
            np.broadcast_to(origins[row], (len(alive), 3)),
        )
        rows[row, alive] = wrap(robot, damped.refine(robot, *goal, rows[row - 1, alive]))
    return rows


Index = NDArray[np.int64]
#: rad: the most a joint may turn from one row to the next.
JUMP = math.radians(30)
#: Rows whose transitions are worked out at once: bounds the memory.
_CHUNK = 512
#: rad or mm: joint values that are no farther apart are the same.
_SAME_JOINTS = 1e-6


class Choice(Struct, frozen=True, eq=False):
    """The joint values of a path (N, J), and the columns of ``candidates`` they came from (N,)."""

    joints: FloatArray
    branches: Index


class Ties(Struct, frozen=True, eq=False):
    """What a path of N rows is tied to. joined: its first row goes on from ``start`` as every row does from the one
    before. end: (J,), where the joints move to after it; its last row has these very values where it can. free: (N,)
    the rows to which joints move as they like: by any angle, but in the same branch, unless it is the first row.
    """

    joined: bool = False
    end: FloatArray | None = None
    free: NDArray[np.bool_] | None = None


class Stuck(Struct, frozen=True, eq=False):
    """How far a path came. row: the first that no solution continues to. candidates: (N, B, J). reached: the joint
    values (M, J) with which the row before can be left, empty before the first row.
    """

    row: int
    candidates: FloatArray
    reached: FloatArray


def follow(
    robot: Robot,
    rotations: FloatArray,
    origins: FloatArray,
    start: FloatArray | None = None,
    margin: float = 0.0,
    jump: float = JUMP,
    ties: Ties = Ties(),  # noqa: B008 (frozen)
) -> Choice | Stuck:
    """Joints for the path of base_from_flange (N, 3, 3), (N, 3), N > 0, that keep all limits, stay ``margin`` rad away
    from singularities, and turn by at most ``jump`` rad from row to row.

    Of all such chains the one with the least sum of times, the slowest joint counting, from ``start`` (J,), the robot's
    home by default, to the last row and to ``ties.end``. ``reasons.why`` says what a ``Stuck`` ran into.
    """
    start = robot.home if start is None else start
    found = candidates(robot, rotations, origins, start)
    return _choose(robot, found, _usable(robot, found, turns(robot), margin), start, jump, ties)


def follow_each(
    robot: Robot,
    paths: Sequence[tuple[FloatArray, FloatArray]],
    starts: Sequence[FloatArray],
    margin: float = 0.0,
    jump: float = JUMP,
) -> list[Choice | Stuck]:
    """``follow`` for each of several paths and starts, in half the time where they are short."""
    if robot.arm is None or not paths:
        return [
            follow(robot, *path, start, margin, jump)
            for path, start in zip(paths, starts, strict=True)
        ]
    first = offsets([len(origins) for _, origins in paths])
    parts = [slice(low, high) for low, high in pairwise(first.tolist())]
    rotations, origins = (np.concatenate(columns) for columns in zip(*paths, strict=True))
    each = np.repeat(np.stack(starts), np.diff(first), axis=0)[:, None]
    found = _solve(robot, rotations, origins, each, parts)
    usable = _usable(robot, found, turns(robot), margin)
    return [
        _choose(robot, found[own], usable[own], start, jump, Ties())
        for own, start in zip(parts, starts, strict=True)
    ]


def _choose(
    robot: Robot,
    found: FloatArray,
    usable: NDArray[np.bool_],
    start: FloatArray,
    jump: float,
    ties: Ties,
) -> Choice | Stuck:
    """``follow`` among candidates (N, B, J), ``usable`` (N, B, T)."""
    table = turns(robot)
    columns = np.flatnonzero(usable.any(axis=(0, 2)))
    few = _count_needed(table, usable)
    kept, usable, table = found[:, columns], usable[:, columns][:, :, few], table[few]
    first = _add_turns(kept[0], table) - start
    cost = np.where(
        usable[0] & ~(ties.joined & _leaps(robot, first, jump)), _time(robot, first), math.inf
    )
    if not np.isfinite(cost).any():
        return Stuck(0, found, start[None] if ties.joined else np.empty((0, found.shape[2])))
    backs = np.empty((len(found), cost.size), dtype=np.int32)
    free = np.zeros(len(found), np.bool_) if ties.free is None else ties.free
    for row in range(1, len(found), _CHUNK):
        here = slice(row, row + _CHUNK)
        source, times = _transitions(robot, kept[row - 1 : row + _CHUNK], table, jump, free[here])
        costs = _along(cost, source, times, usable[here], backs[here])
        lost = np.flatnonzero(~np.isfinite(costs).any(axis=(1, 2)))
        if len(lost):
            before = np.concatenate([cost[None], costs])[lost[0]]
            at = row + int(lost[0])
            return Stuck(at, found, _add_turns(kept[at - 1], table)[np.isfinite(before)])
        cost = costs[-1]
    states = _trace(_close_ends(robot, cost, _add_turns(kept[-1], table), ties.end), backs)
    branches, chosen = np.divmod(states, len(table))
    return Choice(
        kept[np.arange(len(kept)), branches] + math.tau * table[chosen], columns[branches]
    )


def _count_needed(table: Index, usable: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The rows of ``table`` (T,) within the turns that any candidate of (N, B, T) can make; those of 0 turns always."""
    most = np.abs(table[usable.any(axis=(0, 1))]).max(axis=0, initial=0)
    return np.asarray((np.abs(table) <= most).all(axis=1))


def _step(cost: FloatArray, source: Index, times: FloatArray) -> tuple[FloatArray, Index]:
    """The least cost (B, T) of the states of a row from those of the row before, and for each, in one line, the state
    it came from. source, times: of ``_transitions`` for this step.
    """
    padded = np.full((len(cost), cost.shape[1] + 1), math.inf)
    padded[:, :-1] = cost
    total = (padded.take(source) + times[:, :, None]).reshape(len(cost), -1)
    best, every = total.argmin(axis=0), np.arange(total.shape[1])
    before = source.reshape(len(cost), -1)[best, every]
    # From a table with one column more, the unreachable one, to a table without.
    return total[best, every].reshape(cost.shape), before - before // padded.shape[1]


def _along(
    cost: FloatArray,
    source: Index,
    times: FloatArray,
    usable: NDArray[np.bool_],
    backs: NDArray[np.int32],
) -> FloatArray:
    """The least costs (n, B, T) of n rows from those of the row before them, infinite from the first row on that none
    reaches. source, times: ``_transitions``. backs: (n, B * T), filled in.

    Where no branch leads to another one and no joint passes half a turn, as it is nearly always, there is nothing to
    choose: every state comes from its own, and its costs add up.
    """
    size, every = cost.shape[1], np.arange(cost.shape[0])
    own = times[:, every, every]
    away = times.copy()
    away[:, every, every] = math.inf
    still = source[:, every, every] == (np.arange(size) + every[:, None] * (size + 1))
    if not np.isfinite(away).any() and (still | np.isinf(own)[..., None]).all():
        backs[:] = np.arange(cost.size)
        steps = np.where(usable, own[..., None], math.inf)
        return np.asarray(np.cumsum(np.concatenate([cost[None], steps]), axis=0)[1:])
    costs = np.full((len(times), *cost.shape), math.inf)
    for row in range(len(times)):
        cost, backs[row] = _step(cost, source[row], times[row])
        cost[~usable[row]] = math.inf
        costs[row] = cost
    return costs


def _close_ends(
    robot: Robot, cost: FloatArray, last: FloatArray, end: FloatArray | None
) -> FloatArray:
    """The costs (B, T) of ending in ``last`` (B, T, J), with the way to ``end``; only the states there, if any is."""
    if end is None:
        return cost
    there = np.isfinite(cost) & (np.abs(last - end).max(axis=-1) < _SAME_JOINTS)
    if there.any():
        return np.where(there, cost, math.inf)
    return cost + np.where(np.isfinite(cost), _time(robot, last - end), 0.0)


def _leaps(robot: Robot, moved: FloatArray, jump: float) -> NDArray[np.bool_]:
    """Whether a joint turns by more than ``jump`` rad in moving by (..., J)."""
    turning = np.array([not joint.sliding for joint in robot.joints])
    return np.asarray((np.abs(moved) > jump)[..., turning].any(axis=-1))


def _add_turns(solutions: FloatArray, table: Index) -> FloatArray:
    """``solutions`` (..., B, J) with each combination of turns: (..., B, T, J)."""
    return np.asarray(solutions[..., None, :] + math.tau * table)


def _usable(robot: Robot, found: FloatArray, table: Index, margin: float) -> NDArray[np.bool_]:
    """Which candidates, turns included, keep the limits and the margin: (N, B, T)."""
    usable = within_turned(robot, found, table)
    if margin > 0 and robot.kind != "cartesian":
        usable &= (from_singular(robot, found).min(axis=2) >= margin)[..., None]
    return usable


def _time(robot: Robot, moved: FloatArray) -> FloatArray:
    """Seconds that the slowest joint needs for moving by (..., J); nan where there is nothing to move."""
    return np.asarray((np.abs(moved) / robot.speeds).max(axis=-1))


def _transitions(
    robot: Robot, found: FloatArray, table: Index, jump: float, free: NDArray[np.bool_]
) -> tuple[Index, FloatArray]:
    """For n rows of candidates (n, B, J), the n - 1 steps between them. times: (n - 1, B, B), from branch to branch by
    the shortest turn, infinite where a joint jumps, or, on ``free`` steps, where the branch changes. source:
    (n - 1, B, B, T), for the branch before, the branch after and its turns: the index of the state before in a table
    (B, T + 1) whose last column is unreachable.
    """
    most, size = table.max(axis=0), len(table)
    moved = found[1:, None, :, :] - found[:-1, :, None, :]
    moved = np.where(np.isnan(moved), math.inf, moved)
    whole = np.where(
        most > 0, np.rint(np.where(np.isinf(moved), 0.0, moved) / math.tau), 0.0
    ).astype(np.int64)
    moved = moved - whole * math.tau
    leaps = np.where(
        free[:, None, None], ~np.eye(found.shape[1], dtype=bool), _leaps(robot, moved, jump)
    )
    times = np.where(leaps, math.inf, _time(robot, moved))
    source = np.full((*times.shape, size), size)
    near = np.isfinite(times)
    index, lost = np.zeros((1, size), dtype=np.int64), np.zeros((1, size), dtype=np.bool_)
    for k in np.flatnonzero(most):
        before = table[:, k] + whole[near, k, None]
        lost = lost | (np.abs(before) > most[k])
        index = index * (2 * most[k] + 1) + before + most[k]
    source[near] = np.where(lost, size, index)
    return source + np.arange(found.shape[1])[:, None, None] * (size + 1), times


def _trace(cost: FloatArray, backs: NDArray[np.int32]) -> Index:
    """The states (N,) of the cheapest chain, from its end."""
    states = np.empty(len(backs), dtype=np.int64)
    states[-1] = cost.argmin()
    for row in range(len(backs) - 1, 0, -1):
        states[row - 1] = backs[row, states[row]]
    return states
