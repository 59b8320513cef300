"""Local search moves for all items at once, checked by the lengths of the tours."""

import random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camgen.geometry.nearest import find_nearest_items
from camgen.order.solver import together
from camgen.order.solver.greedy import join_greedily
from camgen.order.solver.kernel import BOTH_WAYS, CLOSED
from camgen.order.solver.plane import Items, Problem, Start, make_discs
from camgen.order.solver.together import shorten_together
from tests.order.test_solver import measure_travel


def make_items(rng: random.Random, count: int, rules: bool) -> Items:
    """Random lines and rings; with rules some come before others, and there are two ranks."""
    points, kinds, parents = [], [], []
    for k in range(count):
        middle = np.array(
            [rng.uniform(0, 100), rng.choice([rng.uniform(0, 100), float(rng.randrange(5))])]
        )
        ring = rng.random() < 0.5
        turn = np.arange(6 if ring else 2) * np.pi / (3 if ring else 1) + rng.uniform(0, 1)
        points.append(middle + rng.uniform(1, 6) * np.stack([np.cos(turn), np.sin(turn)], axis=1))
        kinds.append(CLOSED if ring else BOTH_WAYS)
        parents.append(
            rng.randrange(k + 1, count) if rules and k + 1 < count and rng.random() < 0.2 else -1
        )
    rank = np.array([int(rules and k > count / 2) for k in range(count)])
    parents = [p if p < 0 or rank[p] == rank[k] else -1 for k, p in enumerate(parents)]
    first = np.cumsum([0, *map(len, points)])
    return Items(
        first, np.concatenate(points), np.array(kinds), np.full(count, 6.0), np.array(parents), rank
    )


@given(st.integers(0, 10**6), st.integers(1, 60), st.booleans(), st.booleans())
def test_rules_are_kept_and_each_move_saves_the_length_that_it_reports(
    seed: int, count: int, at: bool, rules: bool
) -> None:
    items, home = (
        make_items(random.Random(seed), count, rules),
        np.array([30.0, 0.0]) if at else None,
    )
    discs = make_discs(items)
    greedy = join_greedily(items, discs, home)
    assert greedy is not None
    near = find_nearest_items(discs, count, 10)
    # The search starts from a greedy tour and, without rules, from a random order as well.
    random_order = Start(np.random.default_rng(seed).permutation(count), greedy.enter)
    for tour in (greedy, greedy if rules else random_order):
        saved: list[float] = []
        with pytest.MonkeyPatch.context() as patch:
            check_moves(patch, saved)
            shortened = shorten_together(Problem(items, near, home), tour)
        order = shortened.order.tolist()
        assert sorted(order) == list(range(count))
        assert all(
            p < 0 or order.index(k) < order.index(p) for k, p in enumerate(items.parent.tolist())
        )
        assert (np.diff(items.rank[shortened.order]) >= 0).all()
        assert ((items.first[:-1] <= shortened.enter) & (shortened.enter < items.first[1:])).all()
        # New start points of closed items save the rest.
        assert (
            measure_travel(items, shortened, home)
            <= measure_travel(items, tour, home) + sum(saved) + 1e-6
        )


def check_moves(patch: pytest.MonkeyPatch, saved: list[float]) -> None:
    """Checks each time moves are made that the tour changes by the length that they report.

    saved: receives the change of each time, mm, below 0.
    """
    apply, done = together._make_moves, list[tuple[int, ...]]()

    def length(tour: together._Tour) -> float:
        return float(
            np.nansum(tour.measure(tour.leave[tour.order[:-1]], tour.enter[tour.order[1:]]))
        )

    def note_moves(name: str) -> None:
        make = getattr(together, name)

        def move(tour: together._Tour, *items: int) -> tuple[int, ...]:
            cut: tuple[int, ...] = make(tour, *items)
            if cut:
                joins = name == "_reverse_section"
                done.append((*items[:4], together._JOIN if joins else together._CARRY + items[4]))
            return cut

        patch.setattr(together, name, move)

    def make_checked(tour: together._Tour, candidates: list[together._Moves]) -> np.ndarray:
        before = length(tour)
        changes: dict[tuple[int, ...], float] = {}
        for moves in reversed(candidates):
            keys = np.stack([moves.a, moves.b, moves.c, moves.d, moves.kind], axis=1).tolist()
            changes.update(zip(map(tuple, keys), moves.change.tolist(), strict=True))
        done.clear()
        touched = apply(tour, candidates)
        change = sum(changes[move] for move in done)
        assert length(tour) == pytest.approx(before + change, abs=1e-6)
        assert (tour.order[tour.place] == np.arange(len(tour.order))).all()
        saved.append(change)
        return touched

    note_moves("_reverse_section")
    note_moves("_relocate")
    patch.setattr(together, "_make_moves", make_checked)


def test_crossings_are_undone_and_stray_points_are_moved_to_their_row() -> None:
    # The tour of two rows of points crosses itself and visits one point of the first row last.
    points = np.array([(10.0 * (k % 10), 7.0 * (k // 10)) for k in range(20)])
    count = len(points)
    closed, zeros = np.full(count, CLOSED), np.zeros(count, dtype=np.int64)
    items = Items(np.arange(count + 1), points, closed, np.ones(count), zeros - 1, zeros)
    order = np.array([0, 1, 2, 14, 13, 12, 11, 10, 9, 8, 6, 5, 4, 3, 15, 16, 17, 18, 19, 7])
    home = np.array([0.0, 3.5])
    near = find_nearest_items(make_discs(items), count, 10)
    shortened = shorten_together(Problem(items, near, home), Start(order, np.arange(count)))
    assert measure_travel(items, shortened, home) == pytest.approx(2 * 90 + 7 + 2 * 3.5)
