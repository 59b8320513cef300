"""The shortest ring through places whose costs are a table, the same both ways: points that an arm goes to.

Moves that reverse a stretch (2-opt) or carry a short one elsewhere (Or-opt) are tried from one place to its nearest
ones, and again where two neighbouring stretches were exchanged; what is longer after that is undone.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from camgen.model.pose import FloatArray
from camgen.order.solver import ring_moves, speed
from camgen.order.solver.matrix import Dice
from camgen.order.solver.ring_moves import Ring

#: Near places that are tried.
_NEAR = 10
#: Kicks above which the compiled search is worth its start, where it is installed.
_WORTH = 500


def shorten_ring(table: FloatArray, start: Sequence[int], kicks: int, seed: int = 0) -> list[int]:
    """A ring no longer than ``start``, which holds each of n places once, by ``kicks`` exchanges. table: (n, n) costs.

    The first place stays the first. Equal arguments, equal rings, compiled or not. ValueError for a table that is not
    the same both ways.
    """
    if not np.array_equal(table, table.T):
        raise ValueError("the costs of a ring are the same both ways")
    if len(start) < 5:
        return list(start)
    ring = make_ring(table, start, seed)
    search: speed.Shorten = ring_moves.search
    if kicks >= _WORTH and speed.available():
        ring = Ring(*(np.array(column) if isinstance(column, list) else column for column in ring))  # type: ignore[arg-type]
        search = speed.compile_ring()
    search(ring, kicks)
    places = list(map(int, ring.places))
    at = places.index(start[0])
    return places[at:] + places[:at]


def make_ring(table: FloatArray, start: Sequence[int], seed: int) -> Ring:
    """The ring ``start`` made ready for the search, in lists."""
    count = len(start)
    near = np.argsort(table + np.diag(np.full(count, np.inf)), axis=1, kind="stable")[:, :_NEAR]
    places = list(start)
    where = np.argsort(places).tolist()
    return Ring(
        cost=table.ravel().tolist(),
        near=near.ravel().tolist(),
        width=near.shape[1],
        places=places,
        where=where,
        before=[0] * count,
        where_before=[0] * count,
        spare=[0] * count,
        queue=[0] * (count + 6),
        waits=[0] * count,
        touched=[0] * 5,
        marks=[0, 0, Dice(seed).state],
    )
