"""Joint values along a whole path: the chain of branches and turn counts that takes the least time.

The nearest solution for each point can lead into a limit that another branch, or the same one a
turn earlier, would have avoided. So each row keeps all solutions, and dynamic programming (Viterbi)
finds the cheapest chain.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.ragged import compute_offsets
from camgen.model.pose import FloatArray
from camgen.robots.kinematics import iterative as damped
from camgen.robots.kinematics.inverse import compute_solutions
from camgen.robots.kinematics.joint_limits import (
    are_turned_within_limits,
    list_turn_counts,
    wrap_joints,
)
from camgen.robots.kinematics.singular import measure_singularity_distance
from camgen.robots.models import Robot

# Candidates: joint values of every row, with the branches in columns that continue smoothly.

#: rad: nearer than this to a singularity a joint is free, and is kept from the row before.
_FREE = 2e-9


def find_candidates(
    robot: Robot, rotations: FloatArray, origins: FloatArray, start: FloatArray
) -> FloatArray:
    """The joint values (N, B, J) of all branches along a path, nan for no solution.

    rotations, origins: base_from_flange, (N, 3, 3) and (N, 3), mm.
    start: (J,) joint values for joints that the first rows leave free.
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
    """`find_candidates` of several paths, for arms with a closed form.

    start: (J,), or (N, 1, J) for each row.
    paths: rows of each path.
    """
    solutions = compute_solutions(robot, rotations, origins, start)
    if robot.kind != "spherical-wrist":
        return solutions
    free = np.asarray(
        (measure_singularity_distance(robot, solutions)[:, :, ::2] < _FREE).any(axis=2)
    )
    if free.any():
        solutions = solutions.copy()
        for rows in paths:
            _keep_free(robot, rotations[rows], origins[rows], solutions[rows], free[rows])
    return solutions


def _keep_free(
    robot: Robot,
    rotations: FloatArray,
    origins: FloatArray,
    solutions: FloatArray,
    free: NDArray[np.bool_],
) -> None:
    """Set free joints in `solutions` from the last row before in which they were not free.

    Without such a row, they are set from the first one after.

    solutions: (N, B, J), is changed.
    free: (N, B) whether joints of a solution are free.
    """
    rows = np.arange(len(solutions))
    for column in range(solutions.shape[1]):
        fixed = rows[~free[:, column] & np.isfinite(solutions[:, column, 0])]
        loose = rows[free[:, column]]
        if len(fixed) and len(loose):
            source = fixed[np.maximum(np.searchsorted(fixed, loose) - 1, 0)]
            near = solutions[source, column][:, None]
            kept = compute_solutions(robot, rotations[loose], origins[loose], near)
            solutions[loose, column] = kept[:, column]


def _track(robot: Robot, rotations: FloatArray, origins: FloatArray) -> FloatArray:
    """The candidates of an arm without a closed form: solutions of the first row, followed."""
    rows = np.full((len(origins), damped.SEEDS, len(robot.joints)), np.nan)
    rows[0] = compute_solutions(robot, rotations[:1], origins[:1])[0]
    for row in range(1, len(origins)):
        alive = np.flatnonzero(np.isfinite(rows[row - 1, :, 0]))
        rotation = np.broadcast_to(rotations[row], (len(alive), 3, 3))
        origin = np.broadcast_to(origins[row], (len(alive), 3))
        refined = damped.refine(robot, rotation, origin, rows[row - 1, alive])
        rows[row, alive] = wrap_joints(robot, refined)
    return rows


Index = NDArray[np.int64]
#: rad: largest angle of a joint from one row to the next.
JUMP = math.radians(30)
#: Rows whose transitions are computed together: bounds the memory.
_CHUNK = 512
#: rad or mm: joint values that differ by less are equal.
_SAME_JOINTS = 1e-6


class Choice(Struct, frozen=True, eq=False):
    """The chosen joint values along a path.

    joints: (N, J) joint values, rad or mm.
    branches: (N,) their columns in the result of `find_candidates`.
    """

    joints: FloatArray
    branches: Index


class Ties(Struct, frozen=True, eq=False):
    """Conditions at the ends and rows of a path of N rows.

    joined: whether the first row continues from `start` as every row does from the one before.
    end: (J,) joint values to which the joints move after the path. The last row has these values if
        it can.
    free: (N,) rows to which joints may move by any angle, but in the same branch, unless it is the
        first row.
    """

    joined: bool = False
    end: FloatArray | None = None
    free: NDArray[np.bool_] | None = None


class Stuck(Struct, frozen=True, eq=False):
    """The place where a path could not be continued.

    row: first row to which no solution continues.
    candidates: (N, B, J) result of `find_candidates`.
    reached: (M, J) joint values at which the row before can be left, empty before the first row.
    """

    row: int
    candidates: FloatArray
    reached: FloatArray


def follow(
    robot: Robot,
    poses: tuple[FloatArray, FloatArray],
    start: FloatArray | None = None,
    margin: float = 0.0,
    jump: float = JUMP,
    ties: Ties = Ties(),  # noqa: B008 (frozen)
) -> Choice | Stuck:
    """The joint values along a path that take the least time within all limits.

    If none lead along the whole path, the place where they end is returned, which
    `reasons.explain_stuck` explains. The time is the sum over the rows, in which the slowest joint
    counts, from `start` to the last row and to `ties.end`.

    poses: base_from_flange, rotations (N, 3, 3) and origins (N, 3), mm, N > 0.
    start: (J,) joint values, by default the robot's home.
    margin: minimum distance from singularities, rad.
    jump: largest angle of a revolute joint from row to row, rad.
    """
    start = robot.home if start is None else start
    solutions = find_candidates(robot, *poses, start)
    return _choose(robot, solutions, _find_usable(robot, solutions, margin), start, jump, ties)


def follow_each(
    robot: Robot,
    paths: Sequence[tuple[FloatArray, FloatArray]],
    starts: Sequence[FloatArray],
    margin: float = 0.0,
    jump: float = JUMP,
) -> list[Choice | Stuck]:
    """`follow` for each of several paths and starts, in half of the time if they are short."""
    if robot.arm is None or not paths:
        return [
            follow(robot, path, start, margin, jump)
            for path, start in zip(paths, starts, strict=True)
        ]
    first = compute_offsets([len(origins) for _, origins in paths])
    parts = [slice(low, high) for low, high in pairwise(first.tolist())]
    rotations, origins = map(np.concatenate, zip(*paths, strict=True))
    row_starts = np.repeat(np.stack(starts), np.diff(first), axis=0)[:, None]
    solutions = _solve(robot, rotations, origins, row_starts, parts)
    usable = _find_usable(robot, solutions, margin)
    return [
        _choose(robot, solutions[rows], usable[rows], start, jump, Ties())
        for rows, start in zip(parts, starts, strict=True)
    ]


def _choose(
    robot: Robot,
    solutions: FloatArray,
    usable: NDArray[np.bool_],
    start: FloatArray,
    jump: float,
    ties: Ties,
) -> Choice | Stuck:
    """`follow` among candidates (N, B, J). usable: (N, B, T), see `_find_usable`."""
    columns = np.flatnonzero(usable.any(axis=(0, 2)))
    is_needed = find_needed(list_turn_counts(robot), usable)
    table = list_turn_counts(robot)[is_needed]
    kept, usable = solutions[:, columns], usable[:, columns][:, :, is_needed]
    first = _add_turns(kept[0], table) - start
    may_start = usable[0] & ~(ties.joined & _leaps(robot, first, jump))
    cost = np.where(may_start, _time(robot, first), math.inf)
    if not np.isfinite(cost).any():
        none = np.empty((0, solutions.shape[2]))
        return Stuck(0, solutions, start[None] if ties.joined else none)
    sources = np.empty((len(solutions), cost.size), dtype=np.int32)
    free = np.zeros(len(solutions), np.bool_) if ties.free is None else ties.free
    for row in range(1, len(solutions), _CHUNK):
        rows = slice(row, row + _CHUNK)
        steps = _find_transitions(robot, kept[row - 1 : row + _CHUNK], table, jump, free[rows])
        costs = _add_rows(cost, *steps, usable[rows], sources[rows])
        lost = np.flatnonzero(~np.isfinite(costs).any(axis=(1, 2)))
        if len(lost):
            before = np.concatenate([cost[None], costs])[lost[0]]
            at = row + int(lost[0])
            return Stuck(at, solutions, _add_turns(kept[at - 1], table)[np.isfinite(before)])
        cost = costs[-1]
    cost = _close_ends(robot, cost, _add_turns(kept[-1], table), ties.end)
    branches, chosen = np.divmod(_trace(cost, sources), len(table))
    joints = kept[np.arange(len(kept)), branches] + math.tau * table[chosen]
    return Choice(joints, columns[branches])


def find_needed(table: Index, usable: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The rows of `table` (T,) within the turn counts that occur in `usable` (..., T), and 0."""
    occurs = usable.reshape(-1, len(table)).any(axis=0)
    limit = np.abs(table[occurs]).max(axis=0, initial=0)
    return np.asarray((np.abs(table) <= limit).all(axis=1))


def _step(cost: FloatArray, source: Index, times: FloatArray) -> tuple[FloatArray, Index]:
    """The least cost (B, T) of the states of a row, and the state of the row before each came from.

    cost: (B, T) least cost of the states of the row before.
    source, times: result of `_find_transitions` for this step.
    """
    padded = np.full((len(cost), cost.shape[1] + 1), math.inf)
    padded[:, :-1] = cost
    total = (padded.take(source) + times[:, :, None]).reshape(len(cost), -1)
    best, columns = total.argmin(axis=0), np.arange(total.shape[1])
    before = source.reshape(len(cost), -1)[best, columns]
    # The index is converted from a table with one more column, the unreachable one.
    return total[best, columns].reshape(cost.shape), before - before // padded.shape[1]


def _add_rows(
    cost: FloatArray,
    source: Index,
    times: FloatArray,
    usable: NDArray[np.bool_],
    sources: NDArray[np.int32],
) -> FloatArray:
    """The least costs (n, B, T) of n rows; infinite from the first row on that no state reaches.

    If no branch leads to another one and no joint passes half a turn, which is nearly always so,
    each state comes from itself, and the costs are a sum.

    cost: (B, T) least cost of the states of the row before.
    source, times: result of `_find_transitions`.
    usable: (n, B, T).
    sources: (n, B * T) is set to the state of the row before from which each state comes.
    """
    size, branches = cost.shape[1], np.arange(cost.shape[0])
    staying = times[:, branches, branches]
    changing = times.copy()
    changing[:, branches, branches] = math.inf
    same = np.arange(size) + branches[:, None] * (size + 1)
    is_same = (source[:, branches, branches] == same) | np.isinf(staying)[..., None]
    if is_same.all() and not np.isfinite(changing).any():
        sources[:] = np.arange(cost.size)
        steps = np.where(usable, staying[..., None], math.inf)
        return np.asarray(np.cumsum(np.concatenate([cost[None], steps]), axis=0)[1:])
    costs = np.full((len(times), *cost.shape), math.inf)
    for row in range(len(times)):
        cost, sources[row] = _step(cost, source[row], times[row])
        cost[~usable[row]] = math.inf
        costs[row] = cost
    return costs


def _close_ends(
    robot: Robot, cost: FloatArray, last: FloatArray, end: FloatArray | None
) -> FloatArray:
    """The costs (B, T) of ending at `last` (B, T, J), with the motion to `end`.

    If some states are at `end`, only these are kept.
    """
    if end is None:
        return cost
    is_at_end = np.isfinite(cost) & (np.abs(last - end).max(axis=-1) < _SAME_JOINTS)
    if is_at_end.any():
        return np.where(is_at_end, cost, math.inf)
    return cost + np.where(np.isfinite(cost), _time(robot, last - end), 0.0)


def _leaps(robot: Robot, moved: FloatArray, jump: float) -> NDArray[np.bool_]:
    """Whether a revolute joint turns by more than `jump` rad in changes (..., J)."""
    return np.asarray((np.abs(moved) > jump)[..., robot.revolute].any(axis=-1))


def _add_turns(solutions: FloatArray, table: Index) -> FloatArray:
    """`solutions` (..., B, J) with each combination of turn counts, (..., B, T, J)."""
    return np.asarray(solutions[..., None, :] + math.tau * table)


def _find_usable(robot: Robot, solutions: FloatArray, margin: float) -> NDArray[np.bool_]:
    """Whether candidates keep the limits and the margin, with each of the turn counts (N, B, T)."""
    usable = are_turned_within_limits(robot, solutions, list_turn_counts(robot))
    if margin > 0 and robot.kind != "cartesian":
        usable &= (measure_singularity_distance(robot, solutions).min(axis=2) >= margin)[..., None]
    return usable


def _time(robot: Robot, moved: FloatArray) -> FloatArray:
    """Time of the slowest joint for changes (..., J) of joint values, s; nan for nan."""
    return np.asarray((np.abs(moved) / robot.speeds).max(axis=-1))


def _find_transitions(
    robot: Robot, solutions: FloatArray, table: Index, jump: float, free: NDArray[np.bool_]
) -> tuple[Index, FloatArray]:
    """The n - 1 steps between n rows of candidates (n, B, J).

    Returns `source` (n - 1, B, B, T): for the branch before, the branch after and its turn counts,
    the index of the state before in a table (B, T + 1) whose last column is unreachable. And
    `times` (n - 1, B, B) from branch to branch by the shortest rotations, s; infinite if a joint
    jumps, or, in `free` steps (n - 1,), if the branch changes.
    """
    limit, size = table.max(axis=0), len(table)
    moved = solutions[1:, None, :, :] - solutions[:-1, :, None, :]
    moved = np.where(np.isnan(moved), math.inf, moved)
    rounded = np.rint(np.where(np.isinf(moved), 0.0, moved) / math.tau)
    whole = np.where(limit > 0, rounded, 0.0).astype(np.int64)
    moved = moved - whole * math.tau
    changes_branch = ~np.eye(solutions.shape[1], dtype=bool)
    leaps = np.where(free[:, None, None], changes_branch, _leaps(robot, moved, jump))
    times = np.where(leaps, math.inf, _time(robot, moved))
    source = np.full((*times.shape, size), size)
    near = np.isfinite(times)
    index, is_lost = np.zeros((1, size), dtype=np.int64), np.zeros((1, size), dtype=np.bool_)
    for k in np.flatnonzero(limit):
        before = table[:, k] + whole[near, k, None]
        is_lost = is_lost | (np.abs(before) > limit[k])
        index = index * (2 * limit[k] + 1) + before + limit[k]
    source[near] = np.where(is_lost, size, index)
    return source + np.arange(solutions.shape[1])[:, None, None] * (size + 1), times


def _trace(cost: FloatArray, sources: NDArray[np.int32]) -> Index:
    """The states (N,) of the cheapest chain, traced from its end."""
    states = np.empty(len(sources), dtype=np.int64)
    states[-1] = cost.argmin()
    for row in range(len(sources) - 1, 0, -1):
        states[row - 1] = sources[row, states[row]]
    return states
