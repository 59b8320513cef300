"""Tours of a few paths against all orders, directions and many starts, tried one after the other."""

import cmath
import itertools
import math
import random

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from camgen.model.path import ToolPath, make_waypoints
from camgen.order.arrange import TourSettings, order_paths
from camgen.order.proven import MAX_PROVEN_PATHS, is_proven
from camgen.order.starts import make_starts
from camgen.plan.starting import SEAM
from tests.order.test_tour import circle, ids, line
from tests.support.examples import fewer

Way = tuple[complex, complex]


def ways_of(path: ToolPath, middle: complex, radius: float, starts: int) -> list[Way]:
    """Where the path is entered and left."""
    if path.closed:
        return [
            (place, place)
            for k in range(starts)
            for place in [middle + cmath.rect(radius, k * math.tau / starts)]
        ]
    a, b = (complex(*path.position[row, :2]) for row in (0, -1))
    return [(a, b), (b, a)] if path.reversible else [(a, b)]


def shortest(ways: list[list[Way]], before: list[set[int]], home: complex | None) -> float:
    """By trying all orders; of each the best ways are found one path after the other."""
    best = math.inf
    for order in itertools.permutations(range(len(ways))):
        if any(before[item] - set(order[:k]) for k, item in enumerate(order)):
            continue
        here = [(0.0, home)]
        for item in order:
            here = [
                (min(cost + (0.0 if at is None else abs(enter - at)) for cost, at in here), leave)
                for enter, leave in ways[item]
            ]
        best = min(
            best,
            *(
                cost + (0.0 if home is None else abs(at - home))
                for cost, at in here
                if at is not None
            ),
        )
    return best


def some_paths(
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
    return ids(paths), rings


@given(st.integers(0, 10**6), st.integers(1, 5), st.booleans(), st.booleans())
def test_open_paths_are_run_in_the_best_order_there_is(
    seed: int, count: int, at_home: bool, layered: bool
) -> None:
    rng = random.Random(seed)
    paths, rings = some_paths(rng, count, 0.0)
    ranks = [int(layered and rng.random() < 0.5) for _ in paths]
    paths = [type(path)(**{name: getattr(path, name) for name in path.__struct_fields__} | {"layer": "ba"[1 - rank]})
             for path, rank in zip(paths, ranks, strict=True)]  # fmt: skip
    before = [{k for k, rank in enumerate(ranks) if rank < own} for own in ranks]
    best = shortest(
        [ways_of(p, *r, 1) for p, r in zip(paths, rings, strict=True)],
        before,
        0j if at_home else None,
    )
    tour = order_paths(
        paths, TourSettings("best", (0, 0) if at_home else None, False, layers=["a", "b"])
    )
    assert tour.travel == pytest.approx(best, abs=1e-6)
    assert tour.bound is not None
    assert tour.bound == pytest.approx(best, abs=1e-2)
    assert tour.bound <= best


@fewer(12)
@given(st.integers(0, 10**6), st.integers(1, 4), st.booleans())
@example(seed=220479, count=3, at_home=False)  # a start 0.09 mm beside a corner
def test_no_start_of_closed_paths_is_better(seed: int, count: int, at_home: bool) -> None:
    paths, rings = some_paths(random.Random(seed), count, 0.7)
    home = 0j if at_home else None
    best = shortest(
        [ways_of(p, *r, 60) for p, r in zip(paths, rings, strict=True)],
        [set() for _ in paths],
        home,
    )
    tour = order_paths(paths, TourSettings("best", (0, 0) if at_home else None, False))
    assert tour.bound is not None
    assert tour.bound <= best + 1e-9
    assert tour.bound <= tour.travel + 1e-9
    # A start that would cut off less than SEAM beside a corner is at the corner, which costs little of that.
    moved = SEAM / 10 * sum(path.closed for path in paths)
    assert tour.travel <= best + max(2e-3, 5e-4 * best) + moved
    assert is_proven(tour.travel - moved, tour.bound)


def polygon(x: float, y: float, radius: float, corners: int) -> ToolPath:
    turns = [cmath.rect(radius, k * math.tau / corners) for k in range(corners + 1)]
    rows = np.array([[x + one.real, y + one.imag, 0.0] for one in turns])
    rows[-1] = rows[0]
    return ToolPath(
        "x", "0", make_waypoints(rows, np.nan, np.nan, axis=(0.0, 0.0, 1.0)), True, True
    )


@fewer(8)
@given(
    st.integers(0, 10**6), st.integers(2, 3), st.integers(3, 40), st.sampled_from(["any", "smooth"])
)
def test_no_place_on_polygons_is_better_than_the_bound(
    seed: int, count: int, corners: int, seam: str
) -> None:
    rng = random.Random(seed)
    paths = ids(
        [
            polygon(rng.uniform(0, 60), rng.uniform(0, 60), rng.uniform(1, 12), corners)
            for _ in range(count)
        ]
    )
    where = make_starts(paths, seam)
    ways: list[list[Way]] = [[] for _ in paths]
    for part in np.linspace(0.0, 1.0, 1 + -(-60 // corners)):
        for owner, place in zip(
            where.path, where.shape.point(np.full(len(where.path), part)), strict=True
        ):
            ways[owner].append((complex(*place[:2]),) * 2)
    best = shortest(ways, [set() for _ in paths], 0j)
    tour = order_paths(paths, TourSettings("best", (0, 0), False, seam=seam))
    assert tour.bound is not None
    assert tour.bound <= best + 1e-9
    assert tour.bound <= tour.travel + 1e-9
    # A stretch about a corner that is no start stays as long as what is left out there: that is not closed in on.
    if seam == "any":
        assert tour.travel <= best + max(2e-3, 5e-4 * best)
        assert is_proven(tour.travel, tour.bound)


def test_what_is_inside_comes_first_in_a_proven_tour() -> None:
    # The hole lies beyond its outline: without the rule the outline would be run on the way there.
    holes = [circle(100, 0, 2, parent=1), circle(50, 0, 5)]
    tour = order_paths(ids(holes), TourSettings("best", (0, 0), True))
    assert [path.id for path in tour.paths] == ["c0", "c1"]
    assert tour.travel == pytest.approx(2 * 98, abs=1e-2)
    assert tour.bound is not None
    assert is_proven(tour.travel, tour.bound)


@pytest.mark.parametrize("home", [None, 0j])
def test_a_grid_is_not_above_the_best_of_its_starts_and_the_bound_is_near(
    home: complex | None,
) -> None:
    # Many orders of a grid are as long as the best: the bound closes in slowly.
    ring = [cmath.rect(5, k * math.tau / 16) for k in range(16)]
    grid = [circle(20.0 * (k % 3), 20.0 * (k // 3), 5) for k in range(6)]
    tour = order_paths(ids(grid), TourSettings("best", None if home is None else (0, 0), False))
    places = [
        [(complex(20.0 * (k % 3), 20.0 * (k // 3)) + one,) * 2 for one in ring] for k in range(6)
    ]
    assert tour.travel <= shortest(places, [set() for _ in grid], home) + 1e-6
    assert tour.bound is not None
    assert tour.bound <= tour.travel <= 1.01 * tour.bound


def test_twelve_are_proven_and_thirteen_are_searched() -> None:
    rng = random.Random(4)
    paths = [
        line((x, y), (x + 3, y))
        for x, y in ((rng.uniform(0, 90), rng.uniform(0, 90)) for _ in range(MAX_PROVEN_PATHS + 1))
    ]
    some = order_paths(ids(paths[:MAX_PROVEN_PATHS]), TourSettings("best", (0, 0), False))
    assert some.bound is not None
    assert is_proven(some.travel, some.bound)
    more = order_paths(ids(paths), TourSettings("best", (0, 0), False))
    assert more.bound is not None
    assert more.bound < more.travel
