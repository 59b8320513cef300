"""Moves for all items at once, judged by the lengths of the tours that they make."""

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


def scene(rng: random.Random, count: int, rules: bool) -> Items:
    """Lines and rings of samples; with rules some wait for others, in two ranks."""
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


def travel(items: Items, tour: Start, home: np.ndarray | None) -> float:
    leave = np.where(
        items.kind == CLOSED, tour.enter, items.first[:-1] + items.first[1:] - 1 - tour.enter
    )
    begins, ends = items.points[tour.enter[tour.order]], items.points[leave[tour.order]]
    if home is not None:
        begins, ends = np.concatenate([begins, [home]]), np.concatenate([[home], ends])
    else:
        begins, ends = begins[1:], ends[:-1]
    return float(np.hypot(*(begins - ends).T).sum())


@given(st.integers(0, 10**6), st.integers(1, 60), st.booleans(), st.booleans())
def test_rules_are_kept_and_each_move_changes_what_it_says(
    seed: int, count: int, at: bool, rules: bool
) -> None:
    items, home = scene(random.Random(seed), count, rules), np.array([30.0, 0.0]) if at else None
    discs = make_discs(items)
    begun = join_greedily(items, discs, home)
    assert begun is not None
    near = find_nearest_items(discs, count, 10)
    # What a greedy tour leaves over and, without rules, what any order does.
    random_order = Start(np.random.default_rng(seed).permutation(count), begun.enter)
    for tour in (begun, begun if rules else random_order):
        saved: list[float] = []
        with pytest.MonkeyPatch.context() as patch:
            watch(patch, saved)
            found = shorten_together(Problem(items, near, home), tour)
        order = found.order.tolist()
        assert sorted(order) == list(range(count))
        assert all(
            p < 0 or order.index(k) < order.index(p) for k, p in enumerate(items.parent.tolist())
        )
        assert (np.diff(items.rank[found.order]) >= 0).all()
        assert ((items.first[:-1] <= found.enter) & (found.enter < items.first[1:])).all()
        # Closed items that are begun anew save the rest.
        assert travel(items, found, home) <= travel(items, tour, home) + sum(saved) + 1e-6


def watch(patch: pytest.MonkeyPatch, saved: list[float]) -> None:
    """Each time moves are made, that the tour is shorter by what they say; ``saved`` gets it, mm, below 0."""
    apply, made = together._make_moves, list[tuple[int, ...]]()

    def length(now: together._Tour) -> float:
        return float(np.nansum(now.measure(now.leave[now.order[:-1]], now.enter[now.order[1:]])))

    def noted(name: str) -> None:
        make = getattr(together, name)

        def move(now: together._Tour, *items: int) -> tuple[int, ...]:
            cut: tuple[int, ...] = make(now, *items)
            if cut:
                made.append(
                    (
                        *items[:4],
                        together._JOIN
                        if name == "_reverse_section"
                        else together._CARRY + items[4],
                    )
                )
            return cut

        patch.setattr(together, name, move)

    def checked(now: together._Tour, found: list[together._Moves]) -> np.ndarray:
        before = length(now)
        changes = {
            key: change
            for moves in reversed(found)
            for *key_, change in zip(
                moves.a.tolist(), moves.b.tolist(), moves.c.tolist(), moves.d.tolist(), moves.kind.tolist(),
                moves.change.tolist(), strict=True,
            )
            for key in [tuple(key_)]
        }  # fmt: skip
        made.clear()
        touched = apply(now, found)
        change = sum(changes[move] for move in made)
        assert length(now) == pytest.approx(before + change, abs=1e-6)
        assert (now.order[now.place] == np.arange(len(now.order))).all()
        saved.append(change)
        return touched

    noted("_reverse_section")
    noted("_relocate")
    patch.setattr(together, "_make_moves", checked)


def test_crossings_are_undone_and_strays_brought_home() -> None:
    # Two rows of points, crossed over in the middle, and one point of the first row visited last.
    points = np.array([(10.0 * k, y) for y in (0.0, 7.0) for k in range(10)])
    count = len(points)
    items = Items(np.arange(count + 1), points, np.full(count, CLOSED), np.ones(count), np.full(count, -1),
                  np.zeros(count, dtype=np.int64))  # fmt: skip
    order = np.array([0, 1, 2, 14, 13, 12, 11, 10, 9, 8, 6, 5, 4, 3, 15, 16, 17, 18, 19, 7])
    home = np.array([0.0, 3.5])
    near = find_nearest_items(make_discs(items), count, 10)
    found = shorten_together(Problem(items, near, home), Start(order, np.arange(count)))
    assert travel(items, found, home) == pytest.approx(2 * 90 + 7 + 2 * 3.5)
