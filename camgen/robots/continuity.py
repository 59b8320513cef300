"""One branch and one count of turns along a whole path: the choice that costs the joints the least time.

Point by point, the nearest solution can lead into a limit that another branch, or the same one a turn earlier, would
have passed. So every row keeps all of them, and dynamic programming finds the cheapest chain (Viterbi).
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.pose import FloatArray
from camgen.robots.candidates import candidates
from camgen.robots.models import Robot
from camgen.robots.singular import from_singular
from camgen.robots.values import turns, within_turned

Index = NDArray[np.int64]
#: rad: the most a joint may turn from one row to the next.
JUMP = math.radians(30)
#: Rows whose transitions are worked out at once: bounds the memory.
_CHUNK = 512


class Choice(Struct, frozen=True, eq=False):
    """The joint values of a path (N, J), and the columns of ``candidates`` they came from (N,)."""

    joints: FloatArray
    branches: Index


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
) -> Choice | Stuck:
    """Joints for the path of base_from_flange (N, 3, 3), (N, 3), N > 0, that keep all limits, stay ``margin`` rad away
    from singularities, and turn by at most ``jump`` rad from row to row.

    Of all such chains the one with the least sum of times, the slowest joint counting, from ``start`` (J,), the robot's
    home by default, to the last row. ``reasons.why`` says what a ``Stuck`` ran into.
    """
    start = robot.home if start is None else start
    found = candidates(robot, rotations, origins, start)
    table = turns(robot)
    usable = _usable(robot, found, table, margin)
    columns = np.flatnonzero(usable.any(axis=(0, 2)))
    few = _needed(table, usable)
    kept, usable, table = found[:, columns], usable[:, columns][:, :, few], table[few]
    cost = np.where(usable[0], _time(robot, _turned(kept[0], table) - start), math.inf)
    if not np.isfinite(cost).any():
        return Stuck(0, found, np.empty((0, found.shape[2])))
    backs = np.empty((len(found), cost.size), dtype=np.int32)
    for row, (source, times) in enumerate(_steps(robot, kept, table, jump), start=1):
        after, backs[row] = _step(cost, source, times)
        after[~usable[row]] = math.inf
        if not np.isfinite(after).any():
            return Stuck(row, found, _turned(kept[row - 1], table)[np.isfinite(cost)])
        cost = after
    states = _traced(cost, backs)
    branches, chosen = np.divmod(states, len(table))
    return Choice(kept[np.arange(len(kept)), branches] + math.tau * table[chosen], columns[branches])


def _needed(table: Index, usable: NDArray[np.bool_]) -> NDArray[np.bool_]:
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


def _steps(robot: Robot, kept: FloatArray, table: Index, jump: float) -> Iterator[tuple[Index, FloatArray]]:
    """``_transitions`` step by step."""
    for first in range(0, len(kept) - 1, _CHUNK):
        yield from zip(*_transitions(robot, kept[first : first + _CHUNK + 1], table, jump), strict=True)


def _turned(solutions: FloatArray, table: Index) -> FloatArray:
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


def _transitions(robot: Robot, found: FloatArray, table: Index, jump: float) -> tuple[Index, FloatArray]:
    """For n rows of candidates (n, B, J), the n - 1 steps between them. times: (n - 1, B, B), from branch to branch by
    the shortest turn, infinite where a joint jumps. source: (n - 1, B, B, T), for the branch before, the branch after
    and its turns: the index of the state before in a table (B, T + 1) whose last column is unreachable.
    """
    most, size = table.max(axis=0), len(table)
    moved = found[1:, None, :, :] - found[:-1, :, None, :]
    moved = np.where(np.isnan(moved), math.inf, moved)
    whole = np.where(most > 0, np.rint(np.where(np.isinf(moved), 0.0, moved) / math.tau), 0.0).astype(np.int64)
    moved = moved - whole * math.tau
    turning = np.array([not joint.sliding for joint in robot.joints])
    leaps = (np.abs(moved) > jump)[..., turning].any(axis=-1)
    times = np.where(leaps, math.inf, _time(robot, moved))
    index = np.zeros((*times.shape, size), dtype=np.int64)
    lost = np.zeros_like(index, dtype=bool)
    for k in np.flatnonzero(most):
        before = table[:, k] + whole[..., k, None]
        lost |= np.abs(before) > most[k]
        index = index * (2 * most[k] + 1) + before + most[k]
    branch = np.arange(found.shape[1])[:, None, None] * (size + 1)
    return np.where(lost, size, index) + branch, times


def _traced(cost: FloatArray, backs: NDArray[np.int32]) -> Index:
    """The states (N,) of the cheapest chain, from its end."""
    states = np.empty(len(backs), dtype=np.int64)
    states[-1] = cost.argmin()
    for row in range(len(backs) - 1, 0, -1):
        states[row - 1] = backs[row, states[row]]
    return states
