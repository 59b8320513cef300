"""The order of a scene of ``bench.tours.scenes`` by LKH, the hardest peer.

It needs ``pip install elkai``. Each choice for a path is a city: an open path has two, a closed one
some starts around it. One city of each path has to be visited, which is a generalised travelling
salesman. It becomes an ordinary, asymmetric one if the cities of a path form a cycle that costs
nothing (C. E. Noon and J. C. Bean, "An efficient transformation of the generalized traveling
salesman problem", 1993). LKH (K. Helsgaun, as packed by elkai; free for academic use, so no part of
camgen) gets the matrix. The starts of the closed paths are then chosen again among 512 points each,
by dynamic programming, which is exact for its order.
"""

from __future__ import annotations

import sys
import time
from itertools import pairwise

import elkai
import numpy as np

from bench.tours.scenes import draw_paths
from camgen.model.path import ToolPath

#: Distances of cities are whole numbers of this length, mm.
UNIT = 0.01
FINE = 512
#: Points (n, 2) at which the tool enters and leaves a path, a row for each choice.
Ends = tuple[np.ndarray, np.ndarray]


def list_ends(path: ToolPath, count: int) -> Ends:
    """The choices for a path. count: number of starts of a closed one."""
    xy = path.position[:, :2]
    if not path.closed:
        return xy[[0, -1]], xy[[-1, 0]]
    share = np.arange(count) / count
    if not np.isnan(path.via[1:, 0]).all():
        middle, turn = (xy[0] + xy[1]) / 2, 2 * np.pi * share
        circle = np.column_stack([np.cos(turn), np.sin(turn)])
        points = middle + np.linalg.norm(xy[0] - middle) * circle
    else:
        place = share * (len(xy) - 1)
        row = place.astype(int)
        points = xy[row] + (place - row)[:, None] * (xy[row + 1] - xy[row])
    return points, points


def _measure(leave: np.ndarray, enter: np.ndarray) -> np.ndarray:
    return np.asarray(np.linalg.norm(leave[:, None] - enter[None], axis=2))


def make_matrix(ends: list[Ends]) -> tuple[np.ndarray, np.ndarray]:
    """The asymmetric matrix of all cities and one that is nowhere, and the path of each city."""
    owner = np.repeat(np.arange(len(ends)), [len(enter) for enter, _ in ends])
    enter, leave = (np.concatenate(points) for points in zip(*ends, strict=True))
    lengths = np.rint(_measure(leave, enter) / UNIT).astype(np.int64)
    # Longer than any link of a good tour: to leave a path half visited never pays.
    penalty = int(0.25 * lengths.max()) + 1
    cost = np.minimum(lengths, penalty) + penalty
    n = len(owner)
    following = np.arange(1, n + 1)
    last = np.flatnonzero(np.append(owner[1:] != owner[:-1], True))
    following[last] = np.append(0, last[:-1] + 1)
    # A path that is entered at a city is left at the one before it in its cycle.
    cost = cost[following]
    cost[owner[:, None] == owner[None, :]] = 4 * penalty
    cost[np.arange(n), following] = 0
    matrix = np.full((n + 1, n + 1), penalty, dtype=np.int64)
    matrix[:n, :n] = cost
    matrix[n, n] = 0
    return matrix, owner


def measure_travel(ends: list[Ends]) -> float:
    """The shortest travel in the order of the paths, mm."""
    cost = np.zeros(len(ends[0][0]))
    for (_, leave), (enter, _) in pairwise(ends):
        cost = (cost[:, None] + _measure(leave, enter)).min(axis=0)
    return float(cost.min())


def order_scene(count: int, points: int, runs: int) -> None:
    """Prints the travel (mm) and the seconds of LKH.

    points: starts of a closed path.
    """
    paths = draw_paths(count)
    start = time.perf_counter()
    matrix, owner = make_matrix([list_ends(path, points) for path in paths])
    tour = np.array(elkai.DistanceMatrix(matrix.tolist()).solve_tsp(runs=runs)[:-1])
    tour = np.roll(tour, -int(np.flatnonzero(tour == len(owner))[0]))[1:]
    visited = owner[tour]
    order = visited[np.append(True, visited[1:] != visited[:-1])]
    if len(order) != count:
        sys.exit(f"LKH left a path half visited: {len(order)} pieces of {count} paths")
    travel = measure_travel([list_ends(paths[k], FINE) for k in order])
    print(travel, time.perf_counter() - start)
