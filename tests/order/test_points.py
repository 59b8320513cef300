"""Tours through points: the states that are chosen are the soonest ones that are clear, and nothing is tested twice."""

import importlib
import itertools
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

import camgen
from bench.robots import robotsp
from camgen.model.pose import FloatArray
from camgen.order.arm.blocks import find_blocks, narrow_states, select_clear_states
from camgen.order.arm.lattice import (
    DETOUR_GUESS,
    RejectedLinks,
    add_detours,
    choose_point_states,
    prove_links,
    reject_links,
)
from camgen.order.arm.points import are_points, find_point_tour
from camgen.order.arm.search import TourProblem, find_blocked_paths, find_colliding_links

ARM = importlib.import_module("camgen.order.arm")


class _Begun(Exception):
    """The search is about to begin."""


@pytest.fixture
def problem(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> TourProblem:
    """What the search for the tour through twelve holes begins with."""
    begun: list[TourProblem] = []

    def catch(problem: TourProblem, *_: object) -> None:
        begun.append(problem)
        raise _Begun

    monkeypatch.setattr(ARM, "_search", catch)
    with pytest.raises(_Begun):
        camgen.build(
            robotsp.draw(robotsp.make_holes(), tmp_path), post="rapid", job=robotsp.make_job([])
        )
    return begun[0]


def thin(problem: TourProblem, items: list[int], count: int) -> TourProblem:
    """``problem`` with so many clear states of each of ``items``, evenly taken."""
    select_clear_states(problem, items)
    states = list(problem.states)
    for k in items:
        states[k] = states[k].pick(
            np.unique(np.linspace(0, len(states[k]) - 1, count).astype(np.int64))
        )
    return replace(problem, states=states)


def test_the_states_are_the_soonest_of_all_where_a_link_that_collides_costs_a_way_round(
    problem: TourProblem,
) -> None:
    order = [4, 9, 2]
    problem = thin(problem, order, 9)
    solution = choose_point_states(problem, order, problem.states, {})
    assert solution is not None
    home, best = problem.cost_model.home, np.inf
    rows = [problem.states[k].enter for k in order]
    links = {
        (one, a, b): (start, end)
        for one, (starts, ends) in enumerate(itertools.pairwise([home[None], *rows, home[None]]))
        for a, start in enumerate(starts)
        for b, end in enumerate(ends)
    }
    met = dict(
        zip(links, find_colliding_links(problem, list(links.values())).tolist(), strict=True)
    )
    assert any(met.values())
    branch = [problem.states[k].branch for k in order]
    for chosen in itertools.product(*(range(len(own)) for own in rows)):
        seconds = 0.0
        for one, (a, b) in enumerate(itertools.pairwise([0, *chosen, 0])):
            start, end = links[one, a, b]
            seconds += (
                float(problem.cost_model.limits.seconds(end - start, 0.0))
                + DETOUR_GUESS * met[one, a, b]
            )
            # A change of the posture is weighed with a second.
            seconds += 0 < one < len(order) and branch[one - 1][a] != branch[one][b]
        best = min(best, seconds)
    own = solution.states.branch[order]
    assert solution.seconds + int((own[1:] != own[:-1]).sum()) == pytest.approx(best, abs=1e-9)


def test_what_was_tested_is_not_tested_again(problem: TourProblem) -> None:
    looked: list[int] = []

    def count(joints: FloatArray) -> np.ndarray:
        looked.append(len(joints))
        return np.asarray(problem.setup.clear(joints))

    counting = replace(problem, setup=replace(problem.setup, clear=count))
    order = list(range(12))
    first = choose_point_states(counting, order, counting.states, {})
    begun = sum(looked)
    again = choose_point_states(counting, order, counting.states, {})
    assert begun > 0
    assert sum(looked) == begun
    assert first is not None
    assert again is not None
    assert first.states.enter.tolist() == again.states.enter.tolist()


def test_a_tour_of_points_is_proved_and_as_long_as_it_says(problem: TourProblem) -> None:
    kept = list(range(12))
    assert are_points(problem, kept)
    solution = find_point_tour(problem, kept, lambda _: None)
    assert solution is not None
    assert sorted(solution.order) == kept
    assert not find_blocked_paths(problem, solution)
    assert not prove_links(problem, solution)
    assert add_detours(problem, solution).seconds == pytest.approx(solution.seconds, abs=1e-9)


def test_links_beside_one_that_was_turned_down_are_left(problem: TourProblem) -> None:
    order = list(range(12))
    first = choose_point_states(problem, order, problem.states, {})
    assert first is not None
    barred: RejectedLinks = {}
    for places in ([0, 5], [0, 5], [0, 5], [0, 5], [0, 5], [0, 5], [5]):
        reject_links(problem, first, places, barred)
    again = choose_point_states(problem, order, problem.states, {}, barred)
    assert again is not None
    assert again.seconds >= first.seconds
    # After five that were turned down one by one those 0.02 rad beside them too, then 0.04.
    for item, other, near in ((-1, 0, 0.02), (4, 5, 0.04)):
        ends = (
            (
                found.states.leave[item] if item >= 0 else problem.cost_model.home,
                found.states.enter[other],
            )
            for found in (first, again)
        )
        (a, b), (c, d) = ends
        assert max(np.abs(a - c).max(), np.abs(b - d).max()) >= near


def test_blocks_have_the_fewest_postures_that_reach_all(problem: TourProblem) -> None:
    kept = list(range(12))
    select_clear_states(problem, kept)
    found = find_blocks(problem, kept, 3)
    assert found
    for blocks in found:
        assert len(blocks.branches) == 1
        assert set(blocks.branch) <= set(blocks.branches)
        for own, b in zip(narrow_states(problem, blocks), blocks.branch, strict=True):
            assert len(own)
            assert set(own.branch.tolist()) == {b}


def test_what_has_an_order_is_not_searched_as_points(problem: TourProblem) -> None:
    rules = replace(problem.rules, rank=np.arange(12))
    assert not are_points(replace(problem, rules=rules), list(range(12)))
    assert not are_points(problem, [0, 1, 2])
