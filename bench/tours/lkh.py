"""The order of a scene of ``bench/tours/search.py`` by LKH: the peer that is hardest to beat.

Wants ``pip install elkai``.

    python -m bench.tours.lkh PATHS [POINTS [RUNS]]

Each way to run a path is a city: an open path has two, a closed one POINTS starts around it. One city of each path
has to be visited, which is a generalised travelling salesman; it is made an ordinary, asymmetric one by walking the
cities of a path in a cycle that costs nothing (C. E. Noon and J. C. Bean, "An efficient transformation of the
generalized traveling salesman problem", 1993). LKH (K. Helsgaun, as packed by elkai; free for academic use, so no part
of camgen) gets the matrix. Afterwards the starts of the closed paths are chosen once more among 512 points each by
dynamic programming, which is exact for the order that it gave. Prints travel (mm) and seconds.
"""

from __future__ import annotations

import random
import sys
import time

import elkai
import numpy as np

from bench.tours.order import scattered
from camgen.model.path import ToolPath

#: Cities' distances are whole numbers of this many mm.
UNIT = 0.01
FINE = 512


def ways(path: ToolPath, count: int) -> tuple[np.ndarray, np.ndarray]:
    """(n, 2) points where the tool enters and where it leaves, one row a way to run the path."""
    xy = path.position[:, :2]
    if not path.closed:
        return xy[[0, -1]], xy[[-1, 0]]
    share = np.arange(count) / count
    if not np.isnan(path.via[1:, 0]).all():
        middle, turn = (xy[0] + xy[1]) / 2, 2 * np.pi * share
        points = middle + np.linalg.norm(xy[0] - middle) * np.stack(
            [np.cos(turn), np.sin(turn)], axis=1
        )
    else:
        edges = len(xy) - 1
        at = share * edges
        row = np.minimum(at.astype(int), edges - 1)
        points = xy[row] + (at - row)[:, None] * (xy[row + 1] - xy[row])
    return points, points


def matrix(enter: list[np.ndarray], leave: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """The asymmetric matrix of all cities and one that is nowhere, and the path of each city."""
    owner = np.repeat(np.arange(len(enter)), [len(e) for e in enter])
    a, b = np.concatenate(leave), np.concatenate(enter)
    apart = np.hypot(a[:, None, 0] - b[None, :, 0], a[:, None, 1] - b[None, :, 1])
    whole = np.rint(apart / UNIT).astype(np.int64)
    # Larger than any way between two paths that a good tour has: it never pays to leave a path half walked.
    dear = int(0.25 * whole.max()) + 1
    cost = np.minimum(whole, dear) + dear
    n = len(owner)
    following = np.arange(1, n + 1)
    last = np.flatnonzero(np.append(owner[1:] != owner[:-1], True))
    following[last] = np.append(0, last[:-1] + 1)
    cost = cost[
        following
    ]  # walked round, a path that was entered at the next city is left from this one
    same = owner[:, None] == owner[None, :]
    cost[same] = 4 * dear
    cost[np.arange(n), following] = 0
    whole = np.full((n + 1, n + 1), dear, dtype=np.int64)
    whole[:n, :n] = cost
    whole[n, n] = 0
    return whole, owner


def fitted(enter: list[np.ndarray], leave: list[np.ndarray]) -> float:
    """The shortest travel in the order given."""
    cost = np.zeros(len(enter[0]))
    for out, into in zip(leave[:-1], enter[1:], strict=True):
        apart = np.hypot(out[:, None, 0] - into[None, :, 0], out[:, None, 1] - into[None, :, 1])
        cost = (cost[:, None] + apart).min(axis=0)
    return float(cost.min())


def main(count: int, points: int = 12, runs: int = 10) -> None:
    paths = scattered(count, random.Random(count))
    begun = time.perf_counter()
    coarse = [ways(path, points) for path in paths]
    costs, owner = matrix([e for e, _ in coarse], [leave for _, leave in coarse])
    tour = np.array(elkai.DistanceMatrix(costs.tolist()).solve_tsp(runs=runs)[:-1])
    tour = np.roll(tour, -int(np.flatnonzero(tour == len(owner))[0]))[1:]
    walked = owner[tour]
    order = walked[np.append(True, walked[1:] != walked[:-1])]
    if len(order) != count:
        sys.exit(f"LKH left a path half walked: {len(order)} pieces of {count} paths")
    fine = [ways(paths[i], FINE) for i in order]
    print(fitted([e for e, _ in fine], [leave for _, leave in fine]), time.perf_counter() - begun)


if __name__ == "__main__":
    main(*(int(word) for word in sys.argv[1:]))
