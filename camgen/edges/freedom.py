"""The orientations that a tool may have instead of the nominal one: a small grid of tilts and rolls."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
from msgspec import Struct

from camgen.edges.results import Freedom
from camgen.edges.ways import Index, rotations
from camgen.pose import FloatArray

#: Tilts to each side, in steps of the most; rolls in a turn.
_STEPS, _ROLLS = 2, 12
#: Seconds of joint motion that a rad of tilt and of roll are weighed with: a roll does nothing to the process.
_TILT, _ROLL = 10.0, 0.2


class Grid(Struct, frozen=True, eq=False):
    """C orientations, the nominal one first. nominal_from_tool: (C, 3, 3). cost: (C,) s, what each is worth avoiding.
    moves: (M, C) the index of the one from which move m leads to each, -1 if none; move 0 stays.
    """

    nominal_from_tool: FloatArray
    cost: FloatArray
    moves: Index


def grid(freedom: Freedom) -> Grid:
    """Tilts across the edge (about y) and along it (about x) within the cone, each with all rolls (about z)."""
    steps = range(-_STEPS, _STEPS + 1) if freedom.tilt > 0 else range(1)
    rolls = range(_ROLLS if freedom.roll else 1)
    cells = [(a, b, r) for a, b, r in product(steps, steps, rolls) if a * a + b * b <= _STEPS**2]
    cells.sort(key=lambda cell: (cell[0] ** 2 + cell[1] ** 2, min(cell[2], len(rolls) - cell[2]), cell))
    index = {cell: k for k, cell in enumerate(cells)}
    around = [(0, 0, 0), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]
    moves = [[index.get((a - u, b - v, (r - w) % len(rolls)), -1) for a, b, r in cells] for u, v, w in around]
    across, along, roll = np.array(cells, dtype=np.float64).T
    tilts = np.column_stack([along, across, 0 * roll]) * (freedom.tilt / _STEPS)
    turn = np.remainder(roll * (math.tau / len(rolls)) + math.pi, math.tau) - math.pi
    spin = rotations(np.column_stack([0 * turn, 0 * turn, turn]))
    cost = _TILT * np.linalg.norm(tilts, axis=1) + _ROLL * np.abs(turn)
    # A grid without tilts or rolls has moves that lead nowhere, or to where they come from.
    useful = [0, *(m for m in range(1, 7) if any(k >= 0 and k != c for c, k in enumerate(moves[m])))]
    return Grid(rotations(tilts) @ spin, cost, np.array(moves, dtype=np.int64)[useful])


def lean(nominal: FloatArray, actual: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rad (N,) between the z axes of two orientations (N, 3, 3), and of the turn about z (swing and twist)."""
    turn = np.swapaxes(nominal, 1, 2) @ actual
    tilt = np.arctan2(np.hypot(turn[:, 0, 2], turn[:, 1, 2]), turn[:, 2, 2])
    return tilt, np.arctan2(turn[:, 1, 0] - turn[:, 0, 1], turn[:, 0, 0] + turn[:, 1, 1])
