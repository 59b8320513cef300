"""The cheapest chain of (orientation, branch, turns) along an edge, by dynamic programming.

As ``robots/kinematics/continuity`` for one orientation per row; here each row has many, and from one row to the next
the orientation may stay or go to a neighbour in the grid. Away from singularities a branch never becomes another.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.model.part import BoolArray
from camgen.model.pose import FloatArray
from camgen.motion.pose_paths import Index
from camgen.robots.models import Robot

#: Seconds that a change of orientation is weighed with: each is a row of the program.
CHANGE = 0.05


class PoseChain(Struct, frozen=True, eq=False):
    """orientation: (K,) indices into the grid. moves: (K - 1,) that lead there. branch. joints: (K, J). cost: s."""

    orientation: Index
    moves: Index
    branch: int
    joints: FloatArray
    cost: float


class States(Struct, frozen=True, eq=False):
    """What K rows can choose from. joints: (K, C, B, J) of C orientations and B branches, nan: none. table: (T, J)
    whole turns, of all combinations of a range per joint, joint 1 slowest. usable: (K, C, B, T). open: (K - 1, M, C, B,
    T), which moves may be made from a row to the next, by the orientation and the turns of arrival. Both may be
    narrowed while a way is sought. moves, cost: ``Grid``'s.
    """

    joints: FloatArray
    table: Index
    usable: BoolArray
    open: BoolArray
    moves: Index
    cost: FloatArray


class Steps(Struct, frozen=True, eq=False):
    """From a row to the next by each move. time: (K - 1, M, C, B) s, infinite where there is no way. before: (K - 1, M,
    C, B, T) from which row of the table, by the turns of arrival; T: from none.
    """

    time: FloatArray
    before: NDArray[np.int16]


def steps(robot: Robot, states: States, jump: float) -> Steps:
    """All steps by the shortest turns, where no turning joint goes by more than ``jump`` rad."""
    table, most = states.table, states.table.max(axis=0)
    bad, time, whole = states.moves[..., None] < 0, np.zeros(()), {}
    for k, joint in enumerate(robot.joints):
        own = np.ascontiguousarray(states.joints[..., k])
        moved = own[1:, None] - own[:-1, states.moves]
        if most[k]:
            turns = np.rint(moved / math.tau)
            moved -= math.tau * turns
            whole[k] = np.where(np.isnan(turns), 0.0, turns).astype(np.int16)
        np.abs(moved, out=moved)
        bad = bad | ~(moved <= (math.inf if joint.sliding else jump))
        moved /= robot.speeds[k]
        time = np.maximum(time, moved)
    time = np.where(
        bad, math.inf, time + CHANGE * (np.arange(len(states.moves)) > 0)[:, None, None]
    )
    # Few numbers of whole turns come up: what each of their combinations does to the table is looked up.
    code, index = np.zeros(bad.shape, dtype=np.int64), np.zeros((1, len(table)), dtype=np.int16)
    lost = np.zeros(index.shape, dtype=bool)
    for k, turns in whole.items():
        low, high = int(turns.min(initial=0)), int(turns.max(initial=0))
        turned = (table[:, k] + np.arange(low, high + 1)[:, None]).astype(np.int16)
        index = (index[:, None] * np.int16(2 * most[k] + 1) + turned + np.int16(most[k])).reshape(
            -1, len(table)
        )
        lost = (lost[:, None] | (np.abs(turned) > most[k])).reshape(-1, len(table))
        code = code * (high + 1 - low) + (turns - low)
    return Steps(time, np.where(lost, np.int16(len(table)), index).take(code, axis=0))


def cheapest(robot: Robot, states: States, ways: Steps, start: FloatArray) -> PoseChain | None:
    """The chain with the least sum of times, the slowest joint counting, from ``start`` (J,), of the orientations'
    cost, averaged over the rows, and of changes.
    """
    share = states.cost[:, None, None] / len(states.joints)
    first = states.joints[0][:, :, None] + math.tau * states.table - start
    cost = np.where(states.usable[0], _time(robot, first) + share, math.inf)
    unreachable = np.full((*cost.shape[:2], 1), math.inf)
    # Where a move comes from in the costs of a row, laid out in one line, one more for "from none".
    count, branches, turns = cost.shape
    places = (states.moves[:, :, None] % count * branches + np.arange(branches))[..., None] * (
        turns + 1
    )
    costs = []
    for row, (time, before) in enumerate(zip(ways.time, ways.before, strict=True), start=1):
        padded = np.concatenate([cost, unreachable], axis=2)
        costs.append(padded)
        total = padded.take(places + before)
        total += time[..., None]
        np.copyto(total, math.inf, where=~states.open[row - 1])
        cost = np.where(states.usable[row], total.min(axis=0) + share, math.inf)
    return _trace(states, ways, cost, costs) if np.isfinite(cost).any() else None


def _time(robot: Robot, moved: FloatArray) -> FloatArray:
    """Seconds that the slowest joint needs for moving by (..., J); infinite where there is nothing to move."""
    time = (np.abs(moved) / robot.speeds).max(axis=-1)
    return np.where(np.isnan(time), math.inf, time)


def _trace(states: States, ways: Steps, cost: FloatArray, costs: list[FloatArray]) -> PoseChain:
    """The chain that ends in the least ``cost``. costs: of all rows but the last (C, B, T + 1), infinite from none."""
    here = np.unravel_index(int(cost.argmin()), cost.shape)
    orientation, branch, turns = (int(k) for k in here)
    chain, moves = [(orientation, turns)], []
    for row in reversed(range(len(costs))):
        sources, before = (
            states.moves[:, orientation],
            ways.before[row, :, orientation, branch, turns],
        )
        total = costs[row][sources, branch, before] + ways.time[row, :, orientation, branch]
        total[~states.open[row, :, orientation, branch, turns]] = math.inf
        move = int(total.argmin())
        turns, orientation = int(before[move]), int(sources[move])
        chain.append((orientation, turns))
        moves.append(move)
    chosen, turned = np.array(chain[::-1]).T
    joints = states.joints[np.arange(len(chosen)), chosen, branch] + math.tau * states.table[turned]
    return PoseChain(
        chosen, np.array(moves[::-1], dtype=np.int64), branch, joints, float(cost.min())
    )
