"""The shortest ring through stops whose links cost an entry of a table: points that an arm visits.

The costs are the same in both directions.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from camgen.model.pose import FloatArray
from camgen.order.solver import local_search, ring_moves, speed
from camgen.order.solver.kernel import BOTH_WAYS, Run, Scene
from camgen.order.solver.local_search import ENDLESS, LOG
from camgen.order.solver.matrix import Dice

#: Nearest stops to which moves are tried.
_NEAR = 10
#: Stops below which there is no other ring.
_FEWEST = 5
#: Shuffles from which the compiled search saves more time than its start takes.
_LEAST_COMPILED = 500


def shorten_ring(
    table: FloatArray, start: Sequence[int], shuffles: int, seed: int = 0
) -> list[int]:
    """A ring that holds each of n stops once and is no longer than ``start``.

    table: (n, n) costs.
    start: a ring; its first stop stays the first.
    shuffles: number of shuffles of the search.

    Equal arguments give equal rings, compiled or not. ValueError for a table that differs by
    direction.
    """
    if not np.array_equal(table, table.T):
        raise ValueError("the costs of a ring are the same both ways")
    if len(start) < _FEWEST:
        return list(start)
    scene, run = make_ring(table, start, shuffles, seed)
    search: speed.Search = local_search.search
    if shuffles >= _LEAST_COMPILED and speed.available():
        scene, run = speed.to_arrays(scene, run)
        search = speed.compile_search()
    search(scene, run, ENDLESS, ENDLESS)
    stops = list(map(int, run.ring))
    first = stops.index(start[0])
    return stops[first:] + stops[:first]


def make_ring(
    table: FloatArray, start: Sequence[int], shuffles: int, seed: int
) -> tuple[Scene, Run]:
    """The problem and the ring ``start`` as lists; all stops wait for an evaluation."""
    count = len(start)
    near = np.argsort(table + np.diag(np.full(count, np.inf)), axis=1, kind="stable")[:, :_NEAR]
    ring = list(start)
    stops = list(range(count))
    scene = Scene(
        x=[0.0],
        y=[0.0],
        first=[*stops, count],
        kind=[BOTH_WAYS] * count,
        step=[1.0] * count,
        near=near.ravel().tolist(),
        min_cost=np.take_along_axis(table, near, axis=1).ravel().tolist(),
        width=near.shape[1],
        parent=[-1] * count,
        children=[0] * (count + 1),
        child=[0],
        rank=[0] * count,
        nowhere=-1,
        directed=False,
        table=table.ravel().tolist(),
        least=ring_moves.EPS,
        longest=min(local_search.LONGEST_SHUFFLED, (count - 2) // 2),
        shuffles=shuffles,
        newest_first=True,
    )
    # A shuffle can queue six items beside all others.
    queue = [*ring, *[0] * 6]
    run = Run(
        ring=ring,
        place=np.argsort(ring).tolist(),
        enter=stops.copy(),
        leave=stops.copy(),
        queue=queue,
        waits=[1] * count,
        log=[0] * (5 * LOG),
        marks=[count, 0, 0, 0, 0, Dice(seed).state, 0, 0],
    )
    return scene, run
