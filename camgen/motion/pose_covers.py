"""Chains of states that cover as much of a path as possible, by dynamic programming.

It differs from `camgen.motion.pose_chains` in that a chain may end at any row and another one may
begin, for a price. The states of the rows and the steps between them form a ladder graph, as in
Descartes (github:ros-industrial-consortium/descartes_light).
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.model.pose import FloatArray
from camgen.motion.pose_chains import States, Steps, add_steps
from camgen.motion.pose_paths import Index

#: mm: value of a second of joint motion, or of the cost of an orientation.
_MM_PER_SECOND = 0.02


class CoverChain(Struct, frozen=True, eq=False):
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
) -> list[CoverChain]:
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
        end = int(value.argmax()) if len(used) else None
        rows.ending.append(0 if end is None else int(used[end]))
        rows.best[row + 1] = rows.best[row] if end is None else max(rows.best[row], value[end])
        start = rows.best[row + 1] - price - cost
        move[start > value] = _BEGINS
        moves = np.full(usable.shape, _BEGINS, dtype=np.int8)
        moves.flat[used] = move
        rows.moves.append(moves)
        values = np.full(len(values), -math.inf)
        values[used + used // turns] = np.maximum(value, start)
    return _trace(rows, states, transitions)


def _trace(rows: _Rows, states: States, transitions: Steps) -> list[CoverChain]:
    """The chains of the best cover of all rows."""
    chains: list[CoverChain] = []
    row = len(rows.ending) - 1
    while row > 0:
        if rows.best[row + 1] == rows.best[row]:
            row -= 1
            continue
        chain = _trace_chain(rows, states, transitions, row)
        chains.append(chain)
        row = chain.first
    return chains[::-1]


def _trace_chain(rows: _Rows, states: States, transitions: Steps, row: int) -> CoverChain:
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
    return CoverChain(row, chosen, np.array(moves[::-1], dtype=np.int64), branch, joints)
