"""The search in the plane, the nearest items and the lower bound, compared with plain formulas."""

import importlib.util
import itertools
import math
import random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camgen.geometry.nearest import Discs, find_nearest_items
from camgen.order.solver import local_search, plane
from camgen.order.solver.bound import compute_lower_bound
from camgen.order.solver.kernel import (
    BOTH_WAYS,
    CLOSED,
    DICE,
    LOGGED,
    LOGS,
    ONE_WAY,
    Run,
    Scene,
    undo,
)
from camgen.order.solver.plane import Items, Problem, Start, make_discs, shorten_tour
from tests.support.examples import fewer

HOME = np.array([0.0, 0.0])


def make_items(
    rng: random.Random, count: int, *, rules: bool = False, spread: float = 20.0
) -> Items:
    """Random lines, and circles of 4 to 20 samples.

    rules: some lines have one direction, some items come before others, and there are two ranks.
    spread: mm between items, on average.
    """
    points: list[np.ndarray] = []
    kinds, steps, parents, ranks = [], [], [], []
    side = spread * math.sqrt(count)
    for k in range(count):
        middle = np.array([rng.uniform(0, side), rng.uniform(0, side)])
        if rng.random() < 0.5:
            points.append(
                np.array([middle, middle + np.array([rng.uniform(-20, 20), rng.uniform(-20, 20)])])
            )
            kinds.append(ONE_WAY if rules and rng.random() < 0.4 else BOTH_WAYS)
            steps.append(1.0)
        else:
            samples, radius = rng.randint(4, 20), rng.uniform(1, 12)
            turn = np.arange(samples) * math.tau / samples + rng.uniform(0, 1)
            points.append(middle + radius * np.stack([np.cos(turn), np.sin(turn)], axis=1))
            kinds.append(CLOSED)
            steps.append(math.tau * radius / samples)
        parents.append(
            rng.randrange(k + 1, count) if rules and k + 1 < count and rng.random() < 0.2 else -1
        )
        ranks.append(0)
    if rules:
        ranks = [int(k >= count - 2) for k in range(count)]
    first = np.cumsum([0, *map(len, points)])
    return Items(
        first,
        np.concatenate(points),
        np.array(kinds),
        np.array(steps),
        np.array(parents),
        np.array(ranks),
    )


def keep_order(items: Items) -> Start:
    return Start(np.arange(len(items.kind)), items.first[:-1].copy())


def find_exits(items: Items, enter: np.ndarray) -> np.ndarray:
    other = items.first[:-1] + items.first[1:] - 1 - enter
    return np.where(items.kind == CLOSED, enter, other)


def measure_travel(items: Items, tour: Start, home: np.ndarray | None) -> float:
    """Length of all links of a tour, mm."""
    position, total = home, 0.0
    out = find_exits(items, tour.enter)
    for item in tour.order.tolist():
        if position is not None:
            total += math.dist(position, items.points[tour.enter[item]])
        position = items.points[out[item]]
    return total if home is None else total + math.dist(position, home)


def find_near(items: Items) -> object:
    return find_nearest_items(make_discs(items), len(items.kind), 10)


def check_rules(items: Items, tour: Start) -> None:
    count = len(items.kind)
    assert sorted(tour.order.tolist()) == list(range(count))
    position = np.argsort(tour.order)
    assert ((items.first[:-1] <= tour.enter) & (tour.enter < items.first[1:])).all()
    one_way = items.kind == ONE_WAY
    assert (tour.enter[one_way] == items.first[:-1][one_way]).all()
    waits = items.parent >= 0
    assert (position[waits] < position[items.parent[waits]]).all()
    assert (np.diff(items.rank[tour.order]) >= 0).all()


@given(st.integers(0, 10**6), st.integers(1, 40), st.booleans(), st.booleans())
def test_a_search_keeps_all_items_and_rules_and_never_lengthens_the_tour(
    seed: int, count: int, rules: bool, at: bool
) -> None:
    items = make_items(random.Random(seed), count, rules=rules)
    home = HOME if at else None
    tour = shorten_tour(Problem(items, find_near(items), home), keep_order(items), 300, seed)
    check_rules(items, tour)
    assert (
        measure_travel(items, tour, home) <= measure_travel(items, keep_order(items), home) + 1e-6
    )


@given(st.integers(0, 10**6), st.integers(1, 4), st.booleans(), st.booleans())
def test_few_items_are_solved_and_no_tour_is_below_the_bound(
    seed: int, count: int, rules: bool, at: bool
) -> None:
    items = make_items(random.Random(seed), count, rules=rules)
    home = HOME if at else None
    best = math.inf
    ends = [range(a, b) for a, b in itertools.pairwise(items.first.tolist())]
    # Circles have at least four samples, of which every third is tried.
    rings = [rows[::3] if items.kind[i] == CLOSED else rows for i, rows in enumerate(ends)]
    for order in itertools.permutations(range(count)):
        for enter in itertools.islice(itertools.product(*rings), 100):
            best = min(best, measure_travel(items, Start(np.array(order), np.array(enter)), home))
    assert compute_lower_bound(items, home, best, 30) <= best + 1e-6
    if not rules:
        tour = shorten_tour(Problem(items, find_near(items), home), keep_order(items), 400, seed)
        # The search uses all samples, the trial every third one and at most 100 combinations.
        assert measure_travel(items, tour, home) <= best * 1.1 + 1.0


@fewer(10)
@given(st.integers(0, 10**6), st.integers(2, 60), st.booleans())
def test_the_bound_rises_with_its_rounds_and_stays_below_the_tour(
    seed: int, count: int, at: bool
) -> None:
    items = make_items(
        random.Random(seed), count, spread=random.Random(seed).choice([0.5, 20.0, 200.0])
    )
    home = HOME if at else None
    tour = shorten_tour(Problem(items, find_near(items), home), keep_order(items), 500, 0)
    length_mm = measure_travel(items, tour, home)
    bounds = [compute_lower_bound(items, home, length_mm, rounds) for rounds in (1, 10, 100)]
    assert 0 <= bounds[0] <= bounds[1] <= bounds[2] <= length_mm + 1e-9


def test_the_bound_of_points_on_a_line_is_exact_or_nearly_so() -> None:
    # Without home the tour runs along the line, and the bound is exact.
    # With home it runs there and back, and the bound is a little less. For one point it is exact.
    count = 9
    points = np.stack([np.arange(1.0, count + 1), np.zeros(count)], axis=1)
    none, flat = np.full(count, -1), np.zeros(count, dtype=np.int64)
    items = Items(np.arange(count + 1), points, np.full(count, CLOSED), np.ones(count), none, flat)
    assert compute_lower_bound(items, None, 8.0, 50) == pytest.approx(8.0)
    assert 16.0 < compute_lower_bound(items, HOME, 18.0, 200) <= 18.0
    lone = Items(np.array([0, 1]), points[:1], np.array([CLOSED]), np.ones(1), none[:1], flat[:1])
    assert compute_lower_bound(lone, HOME, 2.0, 1) == pytest.approx(2.0)
    assert compute_lower_bound(lone, None, 0.0, 1) == 0.0


def test_the_bound_of_short_lines_is_near_their_tour() -> None:
    rng = random.Random(4)
    points = np.repeat([[rng.uniform(0, 200), rng.uniform(0, 200)] for _ in range(120)], 2, axis=0)
    points[1::2] += [0.5, 0.0]
    first = np.arange(0, 241, 2)
    zeros = np.zeros(120, dtype=np.int64)
    items = Items(first, points, zeros, np.ones(120), zeros - 1, zeros)
    tour = shorten_tour(Problem(items, find_near(items), HOME), keep_order(items), 6000, 0)
    length_mm = measure_travel(items, tour, HOME)
    assert 0.88 * length_mm < compute_lower_bound(items, HOME, length_mm, 100) <= length_mm


@pytest.mark.skipif(
    importlib.util.find_spec("numba") is None, reason="numba (extra fast) is not installed"
)
@pytest.mark.parametrize("rules", [False, True])
def test_compiled_and_plain_searches_find_the_same_tour(
    rules: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    items = make_items(random.Random(7), 150, rules=rules)
    # The order as drawn keeps the ranks and parents of `make_items`.
    near = find_near(items)
    monkeypatch.setattr(plane, "_MIN_COMPILED_EVALUATIONS", 10**9)
    plain = shorten_tour(Problem(items, near, HOME), keep_order(items), 3000, 5)
    monkeypatch.setattr(plane, "_MIN_COMPILED_EVALUATIONS", 0)
    fast = shorten_tour(Problem(items, near, HOME), keep_order(items), 3000, 5)
    assert plain.order.tolist() == fast.order.tolist()
    assert plain.enter.tolist() == fast.enter.tolist()
    assert measure_travel(items, plain, HOME) < 0.5 * measure_travel(items, keep_order(items), HOME)


@given(st.integers(0, 10**6), st.integers(4, 40), st.booleans())
def test_a_perturbation_is_undone_and_each_change_has_the_length_that_it_reports(
    seed: int, count: int, rules: bool
) -> None:
    items = make_items(random.Random(seed), count, rules=rules)
    parts, run = plane._make_scene(Problem(items, find_near(items), HOME), keep_order(items), seed)

    def length() -> float:
        ring = np.array(run.ring)
        points = np.array([parts.x, parts.y]).T
        ends = points[np.array(run.leave)[np.roll(ring, 1)]]
        return float(np.linalg.norm(points[np.array(run.enter)[ring]] - ends, axis=1).sum())

    before = length()
    assert before + local_search.search(parts, run, 60, 60) == pytest.approx(length())
    for _ in range(5):
        kept = [list(column) for column in (run.ring, run.place, run.enter, run.leave)]
        started = length()
        run.marks[LOGS], run.marks[LOGGED] = 1, 0
        change = local_search.shuffle(parts, run)
        change += local_search.repair(parts, run)
        assert started + change == pytest.approx(length())
        undo(parts, run)
        after = [run.ring, run.place, run.enter, run.leave]
        # A tour without rules may be reversed then: it has the same links in the other direction.
        assert length() == pytest.approx(started)
        assert not rules or not parts.directed or after == kept
    assert run.marks[DICE] != seed


@given(
    st.integers(0, 10**6), st.integers(1, 90), st.integers(1, 3), st.sampled_from([0.0, 1.0, 30.0])
)
def test_the_nearest_items_are_those_of_a_plain_search(
    seed: int, count: int, each: int, size: float
) -> None:
    rng = np.random.default_rng(seed)
    centre = rng.integers(0, 12, (count * each, 2)).astype(float)  # many of them at the same point
    discs = Discs(np.repeat(np.arange(count), each), centre, rng.uniform(0, size, count * each))
    gap = np.linalg.norm(centre[:, None] - centre, axis=2) - discs.radius[:, None] - discs.radius
    distances = np.maximum(gap, 0.0).reshape(count, each, count, each).min(axis=(1, 3))
    np.fill_diagonal(distances, np.inf)
    near = find_nearest_items(discs, count, 8)
    listed = np.zeros((count, count), dtype=bool)
    listed[near.item, near.other] = True
    assert not np.diagonal(listed).any()
    assert not ((distances < near.sure[:, None] * (1 - 1e-9) - 1e-9) & ~listed).any()
    assert (near.distance >= distances[near.item, near.other] - 1e-9).all()
    exact = near.distance <= near.sure[near.item]
    assert near.distance[exact] == pytest.approx(distances[near.item, near.other][exact], abs=1e-9)


def test_the_nearest_items_of_many_at_one_point_are_not_quadratic() -> None:
    count = 20_000
    discs = Discs(np.arange(count), np.zeros((count, 2)), np.zeros(count))
    assert len(find_nearest_items(discs, count, 8).item) < 20 * count


@pytest.mark.parametrize("rules", [False, True])
@pytest.mark.parametrize("budget", [50, 700, 3000])
def test_a_search_with_progress_reports_finds_the_same_tour(
    rules: bool, budget: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    items = make_items(random.Random(11), 120, rules=rules)
    near = find_near(items)
    monkeypatch.setattr(plane, "_MIN_COMPILED_EVALUATIONS", 10**9)
    monkeypatch.setattr(plane, "_PAUSE", (37, 37))
    whole = shorten_tour(Problem(items, near, HOME), keep_order(items), budget, 3)
    progress: list[float] = []
    sliced = shorten_tour(Problem(items, near, HOME), keep_order(items), budget, 3, progress.append)
    assert sliced.order.tolist() == whole.order.tolist()
    assert sliced.enter.tolist() == whole.enter.tolist()
    assert sliced.end == plane.DONE
    assert progress == sorted(progress)
    assert 0 <= progress[0] <= progress[-1] < 1
    assert budget / 37 / 4 < len(progress) <= budget / 37 + 1


@pytest.mark.parametrize("rules", [False, True])
def test_an_interrupt_at_any_time_gives_the_best_tour_so_far(
    rules: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    items = make_items(random.Random(12), 80, rules=rules)
    monkeypatch.setattr(plane, "_MIN_COMPILED_EVALUATIONS", 10**9)
    monkeypatch.setattr(plane, "_PAUSE", (100, 100))
    plain = local_search.search
    lengths = []
    for calls in (0, 1, 5, 12):
        left = [calls]

        def search(s: Scene, r: Run, budget: int, pause: int, left: list[int] = left) -> float:
            left[0] -= 1
            if left[0] < 0:
                # The interrupt comes during a move, when the ring does not hold every item once.
                r.ring[0] = r.ring[1]
                raise KeyboardInterrupt
            return plain(s, r, budget, pause)

        monkeypatch.setattr(local_search, "search", search)
        tour = shorten_tour(
            Problem(items, find_near(items), HOME), keep_order(items), 3000, 1, lambda _: None
        )
        assert tour.end == plane.STOPPED
        check_rules(items, tour)
        lengths.append(measure_travel(items, tour, HOME))
        left[0] = 0
        with pytest.raises(KeyboardInterrupt):
            shorten_tour(Problem(items, find_near(items), HOME), keep_order(items), 3000, 1)
    assert lengths[0] == pytest.approx(measure_travel(items, keep_order(items), HOME))
    assert lengths == sorted(lengths, reverse=True)
    assert lengths[-1] < lengths[0]
