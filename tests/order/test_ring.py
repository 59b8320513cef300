import itertools
import random

import numpy as np
import pytest

from camgen.order.solver.matrix import Dice
from camgen.order.solver.ring import _Ring, shorten_ring


def table_of(points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points[:, None] - points[None], axis=-1)


def length(table: np.ndarray, ring: list[int]) -> float:
    return float(sum(table[ring[k - 1], ring[k]] for k in range(len(ring))))


@pytest.mark.parametrize("seed", range(12))
def test_no_ring_of_few_places_is_shorter(seed: int) -> None:
    rng = random.Random(seed)
    count = rng.randint(5, 8)
    table = table_of(np.array([[rng.random(), rng.random()] for _ in range(count)]))
    found = shorten_ring(table, range(count), 60)
    best = min(length(table, [0, *rest]) for rest in itertools.permutations(range(1, count)))
    assert found[0] == 0
    assert sorted(found) == list(range(count))
    assert length(table, found) == pytest.approx(best)


def test_a_circle_is_found_again() -> None:
    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    table = table_of(np.column_stack([np.cos(angle), np.sin(angle)]))
    mixed = [0, *random.Random(3).sample(range(1, 60), 59)]
    assert length(table, shorten_ring(table, mixed, 500)) == pytest.approx(60 * 2 * np.sin(np.pi / 60))


def test_what_moves_gain_is_what_the_ring_is_shorter() -> None:
    rng = np.random.default_rng(5)
    table = table_of(rng.random((40, 2)))
    near = np.argsort(table + np.diag(np.full(40, np.inf)), axis=1)[:, :10].tolist()
    ring = _Ring(table.tolist(), near, list(range(40)))
    before = length(table, ring.places)
    gained = ring.improve(list(range(40)))
    assert before - gained == pytest.approx(length(table, ring.places))
    now = length(table, ring.places)
    dice = Dice(1)
    for _ in range(200):
        ring.kick(dice)
        assert length(table, ring.places) <= now + 1e-9
        now = length(table, ring.places)
        assert [ring.places[ring.where[k]] for k in range(40)] == list(range(40))


def test_costs_that_differ_by_direction_are_refused() -> None:
    table = table_of(np.random.default_rng(0).random((6, 2)))
    table[1, 2] += 0.1
    with pytest.raises(ValueError, match="the same both ways"):
        shorten_ring(table, range(6), 1)
