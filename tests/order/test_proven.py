"""Tours of a few paths, compared with all orders and directions and with many starts."""

import cmath
import itertools
import math
import random

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from msgspec.structs import replace

from camgen.model.job import TourTable
from camgen.model.path import ToolPath, make_waypoints
from camgen.order.arrange import order_paths
from camgen.order.proven import MAX_PROVEN_PATHS, is_proven
from camgen.order.starts import make_starts
from camgen.plan.starting import SEAM
from tests.order.test_tour import circle, line, number_paths
from tests.support.examples import fewer

Ends = tuple[complex, complex]


def list_ends(path: ToolPath, middle: complex, radius: float, starts: int) -> list[Ends]:
    """Points at which a path can be entered and left, `starts` of them for a circle."""
    if path.closed:
        ring = [middle + cmath.rect(radius, k * math.tau / starts) for k in range(starts)]
        return [(point, point) for point in ring]
    a, b = (complex(*path.position[row, :2]) for row in (0, -1))
    return [(a, b), (b, a)] if path.reversible else [(a, b)]


def measure_shortest(ends: list[list[Ends]], before: list[set[int]], home: complex | None) -> float:
    """Length of the shortest tour, mm, by a trial of all orders.

    ends: the points at which each path can be entered and left.
    before: the paths that come before each path.
    """
    best = math.inf
    for order in itertools.permutations(range(len(ends))):
        if any(before[item] - set(order[:k]) for k, item in enumerate(order)):
            continue
        costs = [(0.0, home)]
        for item in order:
            costs = [(_measure_cheapest(costs, enter), leave) for enter, leave in ends[item]]
        if home is None:
            best = min(best, *(cost for cost, _ in costs))
        else:
            best = min(best, _measure_cheapest(costs, home))
    return best


def _measure_cheapest(costs: list[tuple[float, complex | None]], target: complex) -> float:
    """Length of the shortest tour so far that ends at `target`, mm.

    costs: lengths of tours so far, mm, and the points where they end; None if a tour has no start.
    """
    return min(cost if end is None else cost + abs(target - end) for cost, end in costs)


def make_paths(
    rng: random.Random, count: int, closed: float
) -> tuple[list[ToolPath], list[tuple[complex, float]]]:
    side = 20 * math.sqrt(count)
    paths, rings = [], []
    for _ in range(count):
        x, y, radius = rng.uniform(0, side), rng.uniform(0, side), rng.uniform(1, 6)
        if rng.random() < closed:
            paths.append(circle(x, y, radius))
        else:
            end = (x + rng.uniform(1, 20), y + rng.uniform(-20, 20))
            paths.append(line((x, y), end, reversible=rng.random() < 0.7))
        rings.append((complex(x, y), radius))
    return number_paths(paths), rings


@given(st.integers(0, 10**6), st.integers(1, 5), st.booleans(), st.booleans())
def test_open_paths_are_run_in_the_shortest_order(
    seed: int, count: int, at_home: bool, layered: bool
) -> None:
    rng = random.Random(seed)
    paths, rings = make_paths(rng, count, 0.0)
    ranks = [int(layered and rng.random() < 0.5) for _ in paths]
    paths = [replace(path, layer="ab"[rank]) for path, rank in zip(paths, ranks, strict=True)]
    first = {k for k, rank in enumerate(ranks) if rank == 0}
    before = [first if rank else set[int]() for rank in ranks]
    ends = [list_ends(p, *r, 1) for p, r in zip(paths, rings, strict=True)]
    best = measure_shortest(ends, before, 0j if at_home else None)
    tour = order_paths(
        paths, TourTable("best", layers=["a", "b"]), (0, 0) if at_home else None, False
    )
    assert tour.travel == pytest.approx(best, abs=1e-6)
    assert tour.bound is not None
    assert tour.bound == pytest.approx(best, abs=1e-2)
    assert tour.bound <= best


@fewer(12)
@given(st.integers(0, 10**6), st.integers(1, 4), st.booleans())
@example(seed=220479, count=3, at_home=False)  # a start 0.09 mm from a corner
def test_no_start_of_closed_paths_is_better(seed: int, count: int, at_home: bool) -> None:
    paths, rings = make_paths(random.Random(seed), count, 0.7)
    home = 0j if at_home else None
    ends = [list_ends(p, *r, 60) for p, r in zip(paths, rings, strict=True)]
    best = measure_shortest(ends, [set() for _ in paths], home)
    tour = order_paths(paths, TourTable("best"), (0, 0) if at_home else None, False)
    assert tour.bound is not None
    assert tour.bound <= best + 1e-9
    assert tour.bound <= tour.travel + 1e-9
    # A start less than SEAM from a corner is moved to the corner, which costs a fraction of that.
    moved = SEAM / 10 * sum(path.closed for path in paths)
    assert tour.travel <= best + max(2e-3, 5e-4 * best) + moved
    assert is_proven(tour.travel - moved, tour.bound)


def polygon(x: float, y: float, radius: float, corners: int) -> ToolPath:
    turns = np.arange(corners + 1) * math.tau / corners
    rows = np.zeros((corners + 1, 3))
    rows[:, :2] = np.transpose([x + radius * np.cos(turns), y + radius * np.sin(turns)])
    rows[-1] = rows[0]
    waypoints = make_waypoints(rows, np.nan, np.nan, axis=(0.0, 0.0, 1.0))
    return ToolPath("x", "0", waypoints, True, True)


@fewer(8)
@given(
    st.integers(0, 10**6), st.integers(2, 3), st.integers(3, 40), st.sampled_from(["any", "smooth"])
)
def test_no_start_on_polygons_is_better_than_the_bound(
    seed: int, count: int, corners: int, seam: str
) -> None:
    rng = random.Random(seed)
    polygons = []
    for _ in range(count):
        polygons.append(
            polygon(rng.uniform(0, 60), rng.uniform(0, 60), rng.uniform(1, 12), corners)
        )
    paths = number_paths(polygons)
    starts = make_starts(paths, seam)
    ends: list[list[Ends]] = [[] for _ in paths]
    for fraction in np.linspace(0.0, 1.0, 1 + -(-60 // corners)):
        points = starts.shape.point(np.full(len(starts.path), fraction))
        for path, point in zip(starts.path, points, strict=True):
            ends[path].append((complex(*point[:2]),) * 2)
    best = measure_shortest(ends, [set() for _ in paths], 0j)
    tour = order_paths(paths, TourTable("best", seam=seam), (0, 0), False)
    assert tour.bound is not None
    assert tour.bound <= best + 1e-9
    assert tour.bound <= tour.travel + 1e-9
    # Smooth seams keep away from corners, and the proof does not narrow down the gap there.
    if seam == "any":
        assert tour.travel <= best + max(2e-3, 5e-4 * best)
        assert is_proven(tour.travel, tour.bound)


def test_inner_paths_come_first_in_a_proven_tour() -> None:
    # The hole is farther from home than its outline.
    # Without the rule the outline would come first.
    holes = [circle(100, 0, 2, parent=1), circle(50, 0, 5)]
    tour = order_paths(number_paths(holes), TourTable("best"), (0, 0), True)
    assert [path.id for path in tour.paths] == ["c0", "c1"]
    assert tour.travel == pytest.approx(2 * 98, abs=1e-2)
    assert tour.bound is not None
    assert is_proven(tour.travel, tour.bound)


@pytest.mark.parametrize("home", [None, 0j])
def test_the_tour_of_a_grid_is_at_most_the_best_of_many_starts_and_its_bound_is_near(
    home: complex | None,
) -> None:
    # Many orders of a grid are as short as the best one, so its bound improves slowly.
    middles = [(20.0 * (k % 3), 20.0 * (k // 3)) for k in range(6)]
    grid = number_paths([circle(x, y, 5) for x, y in middles])
    tour = order_paths(grid, TourTable("best"), None if home is None else (0, 0), False)
    ends = [list_ends(path, complex(*xy), 5, 16) for path, xy in zip(grid, middles, strict=True)]
    assert tour.travel <= measure_shortest(ends, [set() for _ in grid], home) + 1e-6
    assert tour.bound is not None
    assert tour.bound <= tour.travel <= 1.01 * tour.bound


def test_the_largest_proven_number_of_paths_is_proven_and_one_more_is_searched() -> None:
    rng = random.Random(4)
    paths = []
    for _ in range(MAX_PROVEN_PATHS + 1):
        x, y = rng.uniform(0, 90), rng.uniform(0, 90)
        paths.append(line((x, y), (x + 3, y)))
    paths = number_paths(paths)
    proven = order_paths(paths[:MAX_PROVEN_PATHS], TourTable("best"), (0, 0), False)
    assert proven.bound is not None
    assert is_proven(proven.travel, proven.bound)
    searched = order_paths(paths, TourTable("best"), (0, 0), False)
    assert searched.bound is not None
    assert searched.bound < searched.travel
