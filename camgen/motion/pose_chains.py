"""Chains of orientations, branches and turn counts along an edge, by dynamic programming.

They are the cheapest chain along the whole edge, and chains that cover as much of it as possible:
such a chain may end at any row and another one may begin, for a price. The states of the rows and
the steps between them form a ladder graph, as in Descartes
(github:ros-industrial-consortium/descartes_light).

The method is that of `camgen.robots.kinematics.continuity` for one orientation per row. Here each
row has many, and from one row to the next the orientation stays or changes to a neighbour in the
grid. Away from singularities a branch never becomes another one.
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

#: s: cost of a change of the orientation, because each change is a row of the program.
CHANGE = 0.05


class PoseChain(Struct, frozen=True, eq=False):
    """A chain of states from a row to a later one.

    first: row at which it begins.
    orientation: (N,) orientations at its rows, indices into the grid.
    moves: (N - 1,) moves of the grid from row to row.
    branch: branch of the inverse kinematics.
    joints: (N, J) joint values at its rows.
    """

    first: int
    orientation: Index
    moves: Index
    branch: int
    joints: FloatArray

    @property
    def last(self) -> int:
        """The row at which it ends."""
        return self.first + len(self.moves)


class States(Struct, frozen=True, eq=False):
    """The states of K rows, with C orientations, B branches and T combinations of turn counts.

    joints: (K, C, B, J) solutions of the inverse kinematics, nan for none.
    table: (T, J) turn counts, all combinations of a range per joint; joint 1 changes slowest.
    usable: (K, C, B, T) states that may be used.
    open: (K - 1, M, C, B, T) moves that may be made from a row to the next one, by the orientation
        and the turn counts of arrival.
    moves, cost: fields of `Grid`.

    A search may clear entries of `usable` and `open`.
    """

    joints: FloatArray
    table: Index
    usable: BoolArray
    open: BoolArray
    moves: Index
    cost: FloatArray


class Steps(Struct, frozen=True, eq=False):
    """The steps from each row to the next one, by move, and orientation and branch of arrival.

    time: (K - 1, M, C, B) s, infinite without a step.
    before: (K - 1, M, C, B, T) row of the table of turn counts from which a step comes, by the row
        of arrival; T for none.
    """

    time: FloatArray
    before: NDArray[np.int16]


def find_steps(robot: Robot, states: States, jump: float) -> Steps:
    """All steps, by the shortest rotation of each joint.

    jump: rad; steps in which a revolute joint turns by more are left out.
    """
    table, limit = states.table, states.table.max(axis=0)
    is_bad, time, whole = states.moves[..., None] < 0, np.zeros(()), {}
    for k, joint in enumerate(robot.joints):
        values = np.ascontiguousarray(states.joints[..., k])
        moved = values[1:, None] - values[:-1, states.moves]
        if limit[k]:
            turns = np.rint(moved / math.tau)
            moved -= math.tau * turns
            whole[k] = np.where(np.isnan(turns), 0.0, turns).astype(np.int16)
        np.abs(moved, out=moved)
        is_bad = is_bad | ~(moved <= (math.inf if joint.sliding else jump))
        moved /= robot.speeds[k]
        time = np.maximum(time, moved)
    change = CHANGE * (np.arange(len(states.moves)) > 0)[:, None, None]
    time = np.where(is_bad, math.inf, time + change)
    # Few turn counts occur. The change that each of their combinations makes is kept in a table.
    code, index = np.zeros(is_bad.shape, dtype=np.int64), np.zeros((1, len(table)), dtype=np.int16)
    is_lost = np.zeros(index.shape, dtype=bool)
    for k, turns in whole.items():
        low, high = int(turns.min(initial=0)), int(turns.max(initial=0))
        turned = (table[:, k] + np.arange(low, high + 1)[:, None]).astype(np.int16)
        digits = index[:, None] * np.int16(2 * limit[k] + 1) + turned + np.int16(limit[k])
        index = digits.reshape(-1, len(table))
        is_lost = (is_lost[:, None] | (np.abs(turned) > limit[k])).reshape(-1, len(table))
        code = code * (high + 1 - low) + (turns - low)
    before = np.where(is_lost, np.int16(len(table)), index)
    return Steps(time, before.take(code, axis=0))


def add_steps(
    values: FloatArray,
    states: States,
    steps: Steps,
    row: int,
    used: Index,
    factor: float = 1.0,
) -> FloatArray:
    """The values of U states of a row by each move from the row before, (M, U).

    values: values of the states of the row before, (C, B, T + 1) or in one line; the last one of
        each branch stands for no state.
    used: (U,) indices of the states among the C * B * T of the row.
    factor: value of a second. Moves that are not open get infinity with its sign.
    """
    count, branches, turns = states.usable.shape[1:]
    state = used // turns
    source = (states.moves % count)[:, state // branches] * branches + state % branches
    before, time, is_open = (
        table[row - 1].reshape(len(source), -1) for table in (steps.before, steps.time, states.open)
    )
    total: FloatArray = values.take(source * (turns + 1) + before.take(used, axis=1))
    total += factor * time.take(state, axis=1)
    total[~is_open.take(used, axis=1)] = math.copysign(math.inf, factor)
    return total


def find_cheapest_chain(
    robot: Robot, states: States, steps: Steps, start: FloatArray
) -> PoseChain | None:
    """The chain of least cost from joint values `start` (J,), None if there is no chain.

    The cost is the sum of the times of its steps, in which the slowest joint counts, of the changes
    of orientation, and of the mean cost of its orientations.
    """
    if not states.usable.any(axis=(1, 2, 3)).all():
        return None
    row_cost = states.cost / len(states.joints)
    count, branches, turns = states.usable.shape[1:]
    cost = np.full((count, branches, turns + 1), math.inf)
    costs = []
    for row, usable in enumerate(states.usable):
        # Few states are usable if joints may turn more than once. The states of a row are in one
        # line. Each branch has one more, which stands for no state.
        used = np.flatnonzero(usable)
        state, turn = used // turns, used % turns
        if row:
            least = add_steps(cost, states, steps, row, used).min(axis=0)
            costs.append(cost)
            cost = np.full(cost.shape, math.inf)
        else:
            solutions = states.joints[0].reshape(count * branches, -1)
            moved = np.abs(solutions[state] + math.tau * states.table[turn] - start)
            least = (moved / robot.speeds).max(axis=-1)
        cost.reshape(-1)[state * (turns + 1) + turn] = least + row_cost[state // branches]
    return _trace(states, steps, cost, costs) if np.isfinite(cost).any() else None


def _trace(states: States, steps: Steps, cost: FloatArray, costs: list[FloatArray]) -> PoseChain:
    """The chain that ends at the least `cost`.

    cost, costs: (C, B, T + 1) s, of the last row, and of each row before it.
    """
    orientation, branch, turns = map(int, np.unravel_index(int(cost.argmin()), cost.shape))
    chain, moves = [(orientation, turns)], []
    for row in reversed(range(len(costs))):
        sources = states.moves[:, orientation]
        before = steps.before[row, :, orientation, branch, turns]
        total = costs[row][sources, branch, before] + steps.time[row, :, orientation, branch]
        total[~states.open[row, :, orientation, branch, turns]] = math.inf
        move = int(total.argmin())
        turns, orientation = int(before[move]), int(sources[move])
        chain.append((orientation, turns))
        moves.append(move)
    chosen, turned = np.array(chain[::-1]).T
    joints = states.joints[np.arange(len(chosen)), chosen, branch] + math.tau * states.table[turned]
    return PoseChain(0, chosen, np.array(moves[::-1], dtype=np.int64), branch, joints)


# Chains that cover as much of an edge as possible.

#: mm: value of a second of joint motion, or of the cost of an orientation.
_MM_PER_SECOND = 0.02


class _Rows(Struct, frozen=True, eq=False):
    """The best partial covers at the K rows.

    moves: (C, B, T) at each row, the move by which the last chain comes to a state, `_BEGINS` if
        the chain begins there.
    ending: index among the C * B * T states of the one in which the best cover that ends at each
        row ends.
    best: (K + 1,) value of the best cover of the rows before each, and of all, mm.
    """

    moves: list[NDArray[np.int8]]
    ending: list[int]
    best: FloatArray


#: The move of a chain that begins.
_BEGINS = -1


def find_cover(
    states: States, transitions: Steps, lengths: FloatArray, price: float
) -> list[PoseChain]:
    """The chains, in order, that together cover the largest length minus a price for each chain.

    lengths: (K - 1,) length from row to row, mm.
    price: length that a chain must cover at least, mm.
    """
    if not states.usable.any():
        return []
    row_cost = _MM_PER_SECOND / len(states.joints) * states.cost
    rows = _Rows([], [], np.zeros(len(states.joints) + 1))
    count, branches, turns = states.usable.shape[1:]
    # The values of the states of a row are in one line. Each branch has one more, for no state.
    values = np.full(count * branches * (turns + 1), -math.inf)
    for row, usable in enumerate(states.usable):
        # Few states are usable if joints may turn more than once.
        used = np.flatnonzero(usable)
        cost = row_cost[used // (branches * turns)]
        value, move = np.full(len(used), -math.inf), np.full(len(used), _BEGINS, dtype=np.int8)
        if row and len(used):
            total = add_steps(values, states, transitions, row, used, -_MM_PER_SECOND)
            best = total.argmax(axis=0)
            value, move = total[best, np.arange(len(used))], best.astype(np.int8)
            value += lengths[row - 1]
            value -= cost
        # A row without usable states ends no chain.
        ended = np.append(value, -math.inf)
        end = int(ended.argmax())
        rows.ending.append(int(np.append(used, 0)[end]))
        rows.best[row + 1] = max(rows.best[row], ended[end])
        start = rows.best[row + 1] - price - cost
        move[start > value] = _BEGINS
        moves = np.full(usable.shape, _BEGINS, dtype=np.int8)
        moves.flat[used] = move
        rows.moves.append(moves)
        values = np.full(len(values), -math.inf)
        values[used + used // turns] = np.maximum(value, start)
    return _trace_cover(rows, states, transitions)


def _trace_cover(rows: _Rows, states: States, transitions: Steps) -> list[PoseChain]:
    """The chains of the best cover of all rows."""
    chains: list[PoseChain] = []
    row = len(rows.ending) - 1
    while row > 0:
        if rows.best[row + 1] == rows.best[row]:
            row -= 1
            continue
        chain = _trace_chain(rows, states, transitions, row)
        chains.append(chain)
        row = chain.first
    return chains[::-1]


def _trace_chain(rows: _Rows, states: States, transitions: Steps, row: int) -> PoseChain:
    ending = rows.ending[row]
    orientation, branch, turn = map(int, np.unravel_index(ending, states.usable.shape[1:]))
    passed, moves = [(orientation, turn)], []
    while (move := int(rows.moves[row][orientation, branch, turn])) != _BEGINS:
        turn = int(transitions.before[row - 1, move, orientation, branch, turn])
        orientation = int(states.moves[move, orientation])
        row -= 1
        passed.append((orientation, turn))
        moves.append(move)
    chosen, turned = np.array(passed[::-1]).T
    joints = states.joints[row + np.arange(len(chosen)), chosen, branch]
    joints = joints + math.tau * states.table[turned]
    return PoseChain(row, chosen, np.array(moves[::-1], dtype=np.int64), branch, joints)
