import itertools
import random

import numpy as np
import pytest

from camgen.order.solver.kernel import LOGS
from camgen.order.solver.local_search import ENDLESS, repair, search, try_shuffle
from camgen.order.solver.ring import make_ring, shorten_ring
from camgen.order.solver.ring_moves import move_between


def make_distances(points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points[:, None] - points[None], axis=-1)


def measure_length(table: np.ndarray, ring: list[int]) -> float:
    return float(sum(table[ring[k - 1], ring[k]] for k in range(len(ring))))


@pytest.mark.parametrize("seed", range(12))
def test_the_ring_of_few_points_is_the_shortest(seed: int) -> None:
    rng = random.Random(seed)
    count = rng.randint(5, 8)
    table = make_distances(np.array([[rng.random(), rng.random()] for _ in range(count)]))
    ring = shorten_ring(table, range(count), 60)
    best = min(
        measure_length(table, [0, *rest]) for rest in itertools.permutations(range(1, count))
    )
    assert ring[0] == 0
    assert sorted(ring) == list(range(count))
    assert measure_length(table, ring) == pytest.approx(best)


def test_the_shortest_ring_of_points_on_a_circle_is_the_circle() -> None:
    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    table = make_distances(np.column_stack([np.cos(angle), np.sin(angle)]))
    mixed = [0, *random.Random(3).sample(range(1, 60), 59)]
    ring = shorten_ring(table, mixed, 500)
    assert measure_length(table, ring) == pytest.approx(60 * 2 * np.sin(np.pi / 60))


def test_moves_change_the_length_by_the_change_that_they_report() -> None:
    table = make_distances(np.random.default_rng(5).random((40, 2)))
    scene, run = make_ring(table, range(40), 0, 1)
    before = measure_length(table, run.ring)
    change = repair(scene, run)
    assert before + change == pytest.approx(measure_length(table, run.ring))
    run.marks[LOGS] = 1
    for _ in range(200):
        before = measure_length(table, run.ring)
        change = try_shuffle(scene, run)
        assert change <= 0.0
        assert before + change == pytest.approx(measure_length(table, run.ring))
        assert [run.ring[run.place[k]] for k in range(40)] == list(range(40))


@pytest.mark.parametrize("count", [6, 9, 14])
def test_a_stretch_moves_between_neighbours_and_the_others_keep_their_order(count: int) -> None:
    table = make_distances(np.random.default_rng(count).random((count, 2)))
    for start, step, size, side in itertools.product(range(count), (1, -1), (1, 2, 3), (1, -1)):
        stretch = [(start + step * k) % count for k in range(size)]
        others = [k for k in range(count) if k not in stretch]
        for c in others:
            d = (c + side) % count
            if d in stretch:
                continue
            _, run = make_ring(table, range(count), 0, 0)
            move_between(run, start, step * size, c, d)
            assert [run.ring[run.place[k]] for k in range(count)] == list(range(count))
            begin = run.place[c]
            moved = [run.ring[(begin + side * k) % count] for k in range(size + 2)]
            assert moved == [c, *stretch, d]
            assert rotate_to(others[0], [k for k in run.ring if k not in stretch]) == others


def rotate_to(first: int, ring: list[int]) -> list[int]:
    at = ring.index(first)
    return ring[at:] + ring[:at]


def test_the_compiled_search_finds_the_same_ring() -> None:
    pytest.importorskip("numba", reason="the extra `fast` is not installed")
    table = np.round(make_distances(np.random.default_rng(9).random((60, 2))), 2)
    scene, run = make_ring(table, range(60), 1_200, 4)
    search(scene, run, ENDLESS, ENDLESS)
    assert shorten_ring(table, range(60), 1_200, 4) == rotate_to(0, run.ring)


def test_costs_that_differ_by_direction_are_refused() -> None:
    table = make_distances(np.random.default_rng(0).random((6, 2)))
    table[1, 2] += 0.1
    with pytest.raises(ValueError, match="the same both ways"):
        shorten_ring(table, range(6), 1)
