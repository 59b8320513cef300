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


def tables(rng: random.Random, count: int, holes: float = 0.0) -> Table:
    """Costs without any order in them: asymmetric, each direction its own, some ways missing."""

    def cost(*shape: int) -> np.ndarray:
        values = [
            math.inf if rng.random() < holes else rng.uniform(0, 100)
            for _ in range(math.prod(shape))
        ]
        return np.array(values).reshape(shape)

    return Table(cost(count, 2, count, 2), cost(count, 2), cost(count, 2))


def plane(rng: random.Random, count: int) -> Table:
    """Lines in a plane with home in a corner."""
    ends = np.array(
        [
            [complex(rng.uniform(0, 100), rng.uniform(0, 100)) for _ in range(2)]
            for _ in range(count)
        ]
    )
    between = np.abs(ends[:, :, None, None] - ends[None, None, :, :])
    return Table(between, np.abs(ends), np.abs(ends))


def by_hand(table: Table, order: tuple[int, ...], ways: tuple[int, ...]) -> float:
    between, first, last = table.between, table.first, table.last
    ways = tuple(map(int, ways))
    cost = first[order[0], ways[0]] + last[order[-1], 1 - ways[-1]]
    for k in range(len(order) - 1):
        cost += between[order[k], 1 - ways[k], order[k + 1], ways[k + 1]]
    return float(cost)


def least(table: Table) -> float:
    count = len(table.first)
    return min(
        by_hand(table, order, ways)
        for order in itertools.permutations(range(count))
        for ways in itertools.product((0, 1), repeat=count)
    )


@given(st.integers(0, 10**6), st.integers(1, 5), st.sampled_from([0.0, 0.3, 0.8]))
def test_nothing_is_shorter_among_all_orders(seed: int, count: int, holes: float) -> None:
    costs = tables(random.Random(seed), count, holes)
    found = shortest(costs)
    assert sorted(found[0]) == list(range(count))
    assert total(costs, *found) == pytest.approx(by_hand(costs, tuple(found[0]), tuple(found[1])))
    assert total(costs, *found) == pytest.approx(least(costs))


# Costs without any order in them are the hardest there are: there the search may stay a little above.
@pytest.mark.parametrize(("make", "above"), [(plane, 1.0), (tables, 1.3)])
@pytest.mark.parametrize("seed", range(6))
def test_the_search_finds_what_the_exact_method_finds(
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
def test_many_are_far_shorter_than_nearest_neighbour_and_no_move_is_left(count: int) -> None:
    costs = plane(random.Random(count), count)
    order, flipped = shortest(costs)
    assert sorted(order) == list(range(count))
    found = total(costs, order, flipped)
    assert found < 0.9 * total(costs, *nearest(costs))
    ways = [int(back) for back in flipped]
    for i, j in itertools.combinations(range(count + 1), 2):
        turned = (
            order[:i] + order[i:j][::-1] + order[j:],
            ways[:i] + [1 - w for w in ways[i:j][::-1]] + ways[j:],
        )
        assert by_hand(costs, *map(tuple, turned)) > found - 1e-6
    for i, j in itertools.product(range(count), repeat=2):
        rest = order[:i] + order[i + 1 :], ways[:i] + ways[i + 1 :]
        put = [*rest[0][:j], order[i], *rest[0][j:]], [*rest[1][:j], ways[i], *rest[1][j:]]
        assert by_hand(costs, *map(tuple, put)) > found - 1e-6


def test_the_same_seed_gives_the_same_order() -> None:
    costs = plane(random.Random(5), 30)
    assert shortest(costs, seed=3) == shortest(costs, seed=3)


def test_a_search_goes_on_from_an_order() -> None:
    """From a good order it never ends with a worse one, and from any order it ends far below that."""
    tables = plane(random.Random(5), 40)
    good = shortest(tables)
    assert total(tables, *shortest(tables, effort=0.0, start=good)) <= total(tables, *good) + 1e-9
    drawn = list(range(40)), [False] * 40
    assert total(tables, *shortest(tables, effort=0.0, start=drawn)) < 0.6 * total(tables, *drawn)


def test_a_way_around_what_is_missing_is_found() -> None:
    # Only one chain of 14 items is possible at all, each run backwards: 0 <- 1 <- 2 ...
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
    costs = tables(random.Random(2), 7)
    order, flipped = nearest(costs)
    left = set(range(7))
    row = costs.first
    for item, back in zip(order, flipped, strict=True):
        assert row[item, int(back)] == min(row[i, a] for i in left for a in (0, 1))
        left.remove(item)
        row = costs.between[item, 1 - int(back)]


def test_nothing_and_tables_that_are_none() -> None:
    none = Table(np.zeros((0, 2, 0, 2)), np.zeros((0, 2)), np.zeros((0, 2)))
    assert shortest(none) == ([], [])
    assert total(none, [], []) == 0.0
    table = tables(random.Random(1), 3)
    with pytest.raises(ValueError, match="do not belong together"):
        shortest(Table(table.between, table.first[:2], table.last))
    table.first[0, 0] = math.nan
    with pytest.raises(ValueError, match="a number or inf"):
        shortest(table)


def keeps(order: tuple[int, ...], rules: matrix.Rules) -> bool:
    place = {item: k for k, item in enumerate(order)}
    ranks = [int(rules.rank[item]) for item in order]
    inside = all(
        parent < 0 or place[item] < place[parent]
        for item, parent in enumerate(rules.parent.tolist())
    )
    return ranks == sorted(ranks) and inside


def rules_for(rng: random.Random, count: int) -> matrix.Rules:
    """Items of two ranks, some of which wait for another one of theirs."""
    rank = [rng.randint(0, 1) for _ in range(count)]
    parent = [-1] * count
    for item in range(count):
        later = [k for k in range(item + 1, count) if rank[k] == rank[item]]
        if later and rng.random() < 0.4:
            parent[item] = later[0]
    return matrix.Rules(np.array(parent), np.array(rank))


def test_rules_are_kept_and_hardly_an_order_that_keeps_them_is_shorter() -> None:
    best_found = 0
    for seed in range(20):
        rng = random.Random(seed)
        count = rng.randint(2, 6)
        costs, rules = plane(rng, count), rules_for(rng, count)
        allowed = [order for order in itertools.permutations(range(count)) if keeps(order, rules)]
        found = shortest(costs, start=(list(allowed[0]), [False] * count), rules=rules)
        assert keeps(tuple(found[0]), rules)
        best = min(
            by_hand(costs, order, ways)
            for order in allowed
            for ways in itertools.product((0, 1), repeat=count)
        )
        best_found += total(costs, *found) <= best + 1e-9
    assert best_found >= 18


@fewer(10)
@given(st.integers(0, 10**6), st.integers(2, 14))
def test_rules_are_kept_whatever_the_costs(seed: int, count: int) -> None:
    rng = random.Random(seed)
    costs, rules = tables(rng, count), rules_for(rng, count)
    start = sorted(range(count), key=lambda item: (rules.rank[item], item))
    found = shortest(costs, start=(start, [False] * count), rules=rules)
    assert sorted(found[0]) == list(range(count))
    assert keeps(tuple(found[0]), rules)
    assert total(costs, *found) <= by_hand(costs, tuple(start), (0,) * count) + 1e-9


def test_rules_need_an_order_to_start_from() -> None:
    costs = tables(random.Random(1), 3)
    with pytest.raises(ValueError, match="start"):
        shortest(costs, rules=matrix.Rules(np.full(3, -1), np.zeros(3, dtype=np.int64)))
