"""Travel and time of the order of paths on random scenes: `python -m bench.tours.order [PATHS ...]`."""

from __future__ import annotations

import gc
import math
import random
import sys
from collections.abc import Callable, Iterator
from functools import partial
from itertools import product

import numpy as np

from bench.support.runner import Cells, Scenario, run
from bench.support.timing import timed
from camgen.model.path import ToolPath, make_waypoints
from camgen.order.arrange import TourSettings, order_paths

SIZES = (1_000, 10_000, 35_000, 100_000)
HOME = (0.0, 0.0)
COLUMNS = (
    "scene | paths {:,} | as drawn, m {:.1f} | nearest, m {:.2f} | of it {:.2f} % | seconds {:.2f}"
)
XY = tuple[float, float]


def path(number: int, points: list[XY], vias: list[XY | None], closed: bool) -> ToolPath:
    n = len(points)
    position = np.zeros((n, 3))
    position[:, :2] = points
    via = np.full((n, 3), np.nan)
    for row, middle in enumerate(vias, start=1):
        if middle:
            via[row] = (*middle, 0.0)
    return ToolPath(f"c{number}", "0", make_waypoints(position, via, 1.0, force=1.0), closed)


def shape(number: int, x: float, y: float, size: float, rng: random.Random) -> ToolPath:
    """Even numbers: a polygon or a circle of two arcs. Odd numbers: an open zigzag of 2 to 5 lines."""
    if number % 2:
        points = [(x, y)]
        for _ in range(rng.randint(2, 5)):
            x, y = x + rng.uniform(-size, size), y + rng.uniform(-size, size)
            points.append((x, y))
        return path(number, points, [None] * (len(points) - 1), closed=False)
    if number % 4:
        a, b = (x + size / 2, y), (x - size / 2, y)
        return path(number, [a, b, a], [(x, y + size / 2), (x, y - size / 2)], closed=True)
    corners = rng.randint(3, 5)
    turn = rng.uniform(0, math.tau)
    ring = [turn + math.tau * i / corners for i in range(corners)]
    points = [(x + size / 2 * math.cos(a), y + size / 2 * math.sin(a)) for a in ring]
    return path(number, [*points, points[0]], [None] * corners, closed=True)


def scattered(count: int, rng: random.Random) -> list[ToolPath]:
    """Evenly over a square, 20 mm of room for each."""
    side = 20 * math.sqrt(count)
    return [shape(i, rng.uniform(0, side), rng.uniform(0, side), 10, rng) for i in range(count)]


def clustered(count: int, rng: random.Random) -> list[ToolPath]:
    """A hundred dense heaps on the same square."""
    side = 20 * math.sqrt(count)
    heaps = [(rng.uniform(0, side), rng.uniform(0, side)) for _ in range(100)]
    place = [rng.choice(heaps) for _ in range(count)]
    return [
        shape(i, rng.gauss(x, side / 200), rng.gauss(y, side / 200), 1, rng)
        for i, (x, y) in enumerate(place)
    ]


SCENES: dict[str, Callable[[int, random.Random], list[ToolPath]]] = {
    "scattered": scattered,
    "clustered": clustered,
}


def judge(name: str, count: int) -> Iterator[Cells]:
    """The row of a scene with a number of paths."""
    paths = SCENES[name](count, random.Random(count))
    drawn = order_paths(paths, TourSettings("as-drawn", HOME, inside_first=False)).travel
    gc.collect()  # what the last scene left is not part of this one's time
    tour, seconds = timed(
        partial(order_paths, paths, TourSettings("nearest", HOME, inside_first=False))
    )
    shares = drawn / 1000, tour.travel / 1000, 100 * tour.travel / drawn
    yield name, count, *shares, seconds


if __name__ == "__main__":
    sizes = [int(word) for word in sys.argv[1:]] or SIZES
    run(Scenario(COLUMNS, product(SCENES, sizes), judge))
