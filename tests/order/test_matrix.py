"""Orders and directions of items from a table of costs, compared with a trial of all orders."""

import itertools
import math
import random
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camgen.order.solver import matrix
from camgen.order.solver.matrix import Table, nearest, shortest, total
from tests.support.examples import fewer


def make_random_costs(rng: random.Random, count: int, holes: float = 0.0) -> Table:
    """Random costs, different in the two directions, a fraction `holes` of them infinite."""

    def cost(*shape: int) -> np.ndarray:
        values = [
            math.inf if rng.random() < holes else rng.uniform(0, 100)
            for _ in range(math.prod(shape))
        ]
        return np.array(values).reshape(shape)

    return Table(cost(count, 2, count, 2), cost(count, 2), cost(count, 2))


def make_plane_costs(rng: random.Random, count: int) -> Table:
    """Distances between the ends of lines in a plane, with home in a corner."""
    points = [complex(rng.uniform(0, 100), rng.uniform(0, 100)) for _ in range(2 * count)]
    ends = np.array(points).reshape(count, 2)
    between = np.abs(ends[:, :, None, None] - ends[None, None, :, :])
    return Table(between, np.abs(ends), np.abs(ends))


def add_costs(table: Table, order: tuple[int, ...], flips: tuple[int, ...]) -> float:
    between, first, last = table.between, table.first, table.last
    flips = tuple(map(int, flips))
    cost = first[order[0], flips[0]] + last[order[-1], 1 - flips[-1]]
    for k in range(len(order) - 1):
        cost += between[order[k], 1 - flips[k], order[k + 1], flips[k + 1]]
    return float(cost)


def find_least_cost(table: Table, orders: list[tuple[int, ...]]) -> float:
    """Least cost of some orders with all directions of their items."""
    directions = list(itertools.product((0, 1), repeat=len(table.first)))
    return min(add_costs(table, *tour) for tour in itertools.product(orders, directions))


@given(st.integers(0, 10**6), st.integers(1, 5), st.sampled_from([0.0, 0.3, 0.8]))
def test_the_tour_of_few_items_is_the_shortest_of_all(seed: int, count: int, holes: float) -> None:
    costs = make_random_costs(random.Random(seed), count, holes)
    order, flipped = shortest(costs)
    assert sorted(order) == list(range(count))
    cost = total(costs, order, flipped)
    assert cost == pytest.approx(add_costs(costs, tuple(order), tuple(flipped)))
    assert cost == pytest.approx(find_least_cost(costs, list(itertools.permutations(range(count)))))


# Random costs are the hardest case, in which the search may stay a little above the least cost.
@pytest.mark.parametrize(("make", "above"), [(make_plane_costs, 1.0), (make_random_costs, 1.3)])
@pytest.mark.parametrize("seed", range(6))
def test_the_search_comes_near_to_the_exact_method(
    make: Callable[[random.Random, int], Table],
    above: float,
    seed: int,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    costs = make(random.Random(seed), 8)
    exact = total(costs, *shortest(costs))
    monkeypatch.setattr(matrix, "EXACT", 0)
    order, flipped = shortest(costs)
    assert sorted(order) == list(range(8))
    assert exact - 1e-9 <= total(costs, order, flipped) <= above * exact + 1e-9


@pytest.mark.parametrize("count", [40, 80])
def test_no_move_shortens_a_tour_of_many_items_far_below_nearest_neighbour(count: int) -> None:
    costs = make_plane_costs(random.Random(count), count)
    order, flipped = shortest(costs)
    assert sorted(order) == list(range(count))
    cost = total(costs, order, flipped)
    assert cost < 0.9 * total(costs, *nearest(costs))
    flips = [int(back) for back in flipped]
    for i, j in itertools.combinations(range(count + 1), 2):
        reversed_stretch = (
            order[:i] + order[i:j][::-1] + order[j:],
            flips[:i] + [1 - w for w in flips[i:j][::-1]] + flips[j:],
        )
        assert add_costs(costs, *map(tuple, reversed_stretch)) > cost - 1e-6
    for i, j in itertools.product(range(count), repeat=2):
        rest = order[:i] + order[i + 1 :], flips[:i] + flips[i + 1 :]
        relocated = [*rest[0][:j], order[i], *rest[0][j:]], [*rest[1][:j], flips[i], *rest[1][j:]]
        assert add_costs(costs, *map(tuple, relocated)) > cost - 1e-6


def test_the_same_seed_gives_the_same_order() -> None:
    costs = make_plane_costs(random.Random(5), 30)
    assert shortest(costs, seed=3) == shortest(costs, seed=3)


def test_a_search_starts_from_a_given_order() -> None:
    """A good order is never made worse, and a bad one is improved a lot."""
    make_random_costs = make_plane_costs(random.Random(5), 40)
    good = shortest(make_random_costs)
    assert (
        total(make_random_costs, *shortest(make_random_costs, effort=0.0, start=good))
        <= total(make_random_costs, *good) + 1e-9
    )
    drawn = list(range(40)), [False] * 40
    assert total(
        make_random_costs, *shortest(make_random_costs, effort=0.0, start=drawn)
    ) < 0.6 * total(make_random_costs, *drawn)


def test_the_only_possible_tour_is_found() -> None:
    # Only one chain of 14 items has finite costs, each item run backwards: 0 <- 1 <- 2 ...
    count = 14
    between = np.full((count, 2, count, 2), math.inf)
    first, last = np.full((count, 2), math.inf), np.full((count, 2), math.inf)
    between[np.arange(1, count), 0, np.arange(count - 1), 1] = 1.0
    first[count - 1, 1] = last[0, 0] = 1.0
    table = Table(between, first, last)
    assert shortest(table) == (list(range(count))[::-1], [True] * count)
    first[:] = math.inf
    assert total(table, *shortest(table)) == math.inf


def test_nearest_takes_the_cheapest_end_each_time() -> None:
    costs = make_random_costs(random.Random(2), 7)
    order, flipped = nearest(costs)
    left = set(range(7))
    row = costs.first
    for item, back in zip(order, flipped, strict=True):
        assert row[item, int(back)] == row[list(left)].min()
        left.remove(item)
        row = costs.between[item, 1 - int(back)]


def test_an_empty_table_has_an_empty_tour_and_invalid_tables_are_refused() -> None:
    empty = Table(np.zeros((0, 2, 0, 2)), np.zeros((0, 2)), np.zeros((0, 2)))
    assert shortest(empty) == ([], [])
    assert total(empty, [], []) == 0.0
    table = make_random_costs(random.Random(1), 3)
    with pytest.raises(ValueError, match="do not belong together"):
        shortest(Table(table.between, table.first[:2], table.last))
    table.first[0, 0] = math.nan
    with pytest.raises(ValueError, match="a number or inf"):
        shortest(table)


def keeps_rules(order: tuple[int, ...], rules: matrix.Rules) -> bool:
    position = {item: k for k, item in enumerate(order)}
    ranks = [int(rules.rank[item]) for item in order]
    inside = all(
        parent < 0 or position[item] < position[parent]
        for item, parent in enumerate(rules.parent.tolist())
    )
    return ranks == sorted(ranks) and inside


def make_rules(rng: random.Random, count: int) -> matrix.Rules:
    """Items of two ranks, some of which come before another item of their rank."""
    rank = [rng.randint(0, 1) for _ in range(count)]
    parent = [-1] * count
    for item in range(count):
        later = [k for k in range(item + 1, count) if rank[k] == rank[item]]
        if later and rng.random() < 0.4:
            parent[item] = later[0]
    return matrix.Rules(np.array(parent), np.array(rank))


def test_rules_are_kept_and_the_tour_is_nearly_always_the_shortest_that_keeps_them() -> None:
    shortest_tours = 0
    for seed in range(20):
        rng = random.Random(seed)
        count = rng.randint(2, 6)
        costs, rules = make_plane_costs(rng, count), make_rules(rng, count)
        allowed = [
            order for order in itertools.permutations(range(count)) if keeps_rules(order, rules)
        ]
        tour = shortest(costs, start=(list(allowed[0]), [False] * count), rules=rules)
        assert keeps_rules(tuple(tour[0]), rules)
        shortest_tours += total(costs, *tour) <= find_least_cost(costs, allowed) + 1e-9
    assert shortest_tours >= 18


@fewer(10)
@given(st.integers(0, 10**6), st.integers(2, 14))
def test_rules_are_kept_with_any_costs(seed: int, count: int) -> None:
    rng = random.Random(seed)
    costs, rules = make_random_costs(rng, count), make_rules(rng, count)
    start = sorted(range(count), key=lambda item: (rules.rank[item], item))
    tour = shortest(costs, start=(start, [False] * count), rules=rules)
    assert sorted(tour[0]) == list(range(count))
    assert keeps_rules(tuple(tour[0]), rules)
    assert total(costs, *tour) <= add_costs(costs, tuple(start), (0,) * count) + 1e-9


def test_rules_need_an_order_to_start_from() -> None:
    costs = make_random_costs(random.Random(1), 3)
    with pytest.raises(ValueError, match="start"):
        shortest(costs, rules=matrix.Rules(np.full(3, -1), np.zeros(3, dtype=np.int64)))
