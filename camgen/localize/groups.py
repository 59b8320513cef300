"""Places in groups that stand apart from each other."""

from __future__ import annotations

from itertools import product

import numpy as np

from camgen.model.part import IntArray
from camgen.model.pose import FloatArray

_STEPS = tuple(step for step in product((-1, 0, 1), repeat=3) if any(step))


def group_places(places: FloatArray, gap: float) -> list[IntArray]:
    """The numbers of ``places`` (N, 3) in groups, those with the most places first.

    Two places are in one group if their cells of the width ``gap`` (mm) touch, or those of places
    between them.
    """
    if not len(places):
        return []
    cells = np.floor((places - places.min(axis=0)) / gap).astype(np.int64)
    unique, cell_of = np.unique(cells, axis=0, return_inverse=True)
    left = {(x, y, z): i for i, (x, y, z) in enumerate(unique.tolist())}
    group = np.zeros(len(unique), dtype=np.int64)
    number = 0
    while left:
        border = [left.popitem()]
        while border:
            (x, y, z), i = border.pop()
            group[i] = number
            near = [(x + a, y + b, z + c) for a, b, c in _STEPS]
            border += [(cell, left.pop(cell)) for cell in near if cell in left]
        number += 1
    group_of = group[cell_of.reshape(-1)]
    order = np.argsort(-np.bincount(group_of), kind="stable")
    return [np.flatnonzero(group_of == k) for k in order]
