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
    if not states.usable.any(axis=(1, 2, 3)).all():
        return None
    share = states.cost / len(states.joints)
    count, branches, turns = states.usable.shape[1:]
    cost = np.full((count, branches, turns + 1), math.inf)
    costs = []
    for row, usable in enumerate(states.usable):
        # Few states are usable where joints may turn more than once. The states of a row lie in
        # one line. Each branch has one more, for "from none".
        used = np.flatnonzero(usable)
        state, turn = used // turns, used % turns
        if row:
            source = (states.moves % count)[:, state // branches] * branches + state % branches
            before, time, is_open = (
                table[row - 1].reshape(len(source), -1)
                for table in (ways.before, ways.time, states.open)
            )
            total = cost.take(source * (turns + 1) + before.take(used, axis=1))
            total += time.take(state, axis=1)
            total[~is_open.take(used, axis=1)] = math.inf
            least = total.min(axis=0)
            costs.append(cost)
            cost = np.full(cost.shape, math.inf)
        else:
            solutions = states.joints[0].reshape(count * branches, -1)
            least = _time(robot, solutions[state] + math.tau * states.table[turn] - start)
        cost.reshape(-1)[state * (turns + 1) + turn] = least + share[state // branches]
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
