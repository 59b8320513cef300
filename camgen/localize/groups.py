"""Rows of large arrays: some of them, keys of their cells, and groups that stand apart."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from camgen.model.part import IntArray
from camgen.model.pose import FloatArray

_STEPS = tuple(filter(any, product((-1, 0, 1), repeat=3)))


def pick_rows(rows: NDArray[Any], count: int) -> NDArray[Any]:
    """Rows of `rows` (N, ...) at equal steps, from `count` to two times as many; all of fewer."""
    return rows[:: max(len(rows) // count, 1)]


def pack_cells(cells: IntArray) -> IntArray:
    """(...,) one number for each of the cells (..., 3), whose coordinates are 0 to 2**21 - 1."""
    return (cells[..., 0] << 42) | (cells[..., 1] << 21) | cells[..., 2]


def group_places(places: FloatArray, gap: float) -> list[IntArray]:
    """Indices of `places` (N, 3) in groups, those with the most places first.

    Two places are in one group if their cells of the width `gap` (mm) touch, or those of places
    between them.
    """
    if not len(places):
        return []
    cells = np.floor((places - places.min(axis=0)) / gap).astype(np.int64)
    unique, cell_of = np.unique(cells, axis=0, return_inverse=True)
    pending = {(x, y, z): i for i, (x, y, z) in enumerate(unique.tolist())}
    group = np.zeros(len(unique), dtype=np.int64)
    number = 0
    while pending:
        border = [pending.popitem()]
        while border:
            (x, y, z), i = border.pop()
            group[i] = number
            for a, b, c in _STEPS:
                cell = (x + a, y + b, z + c)
                if cell in pending:
                    border.append((cell, pending.pop(cell)))
        number += 1
    group_of = group[cell_of.reshape(-1)]
    order = np.argsort(-np.bincount(group_of), kind="stable")
    return [np.flatnonzero(group_of == k) for k in order]
