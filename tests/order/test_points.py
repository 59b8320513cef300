"""Tours through points: the states are the fastest ones without a collision, each tested once."""

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


class _SearchStarted(Exception):
    """Raised when the search is about to start."""


@pytest.fixture
def problem(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> TourProblem:
    """Problem with which the search for the tour through twelve holes starts."""
    problems: list[TourProblem] = []

    def catch(problem: TourProblem, *_: object) -> None:
        problems.append(problem)
        raise _SearchStarted

    monkeypatch.setattr(ARM, "_search", catch)
    with pytest.raises(_SearchStarted):
        camgen.build(
            robotsp.draw(robotsp.make_holes(), tmp_path), post="rapid", job=robotsp.make_job([])
        )
    return problems[0]


def select_even_states(problem: TourProblem, items: list[int], count: int) -> TourProblem:
    """`problem` with `count` clear states of each of `items`, evenly selected."""
    select_clear_states(problem, items)
    states = list(problem.states)
    for k in items:
        states[k] = states[k].pick(
            np.unique(np.linspace(0, len(states[k]) - 1, count).astype(np.int64))
        )
    return replace(problem, states=states)


def test_the_states_are_the_fastest_of_all_if_a_link_that_collides_costs_a_detour(
    problem: TourProblem,
) -> None:
    order = [4, 9, 2]
    problem = select_even_states(problem, order, 9)
    solution = choose_point_states(problem, order, problem.states, {})
    assert solution is not None
    home, best = problem.cost_model.home, np.inf
    rows = [problem.states[k].enter for k in order]
    links = {}
    for step, (starts, ends) in enumerate(itertools.pairwise([home[None], *rows, home[None]])):
        for (a, start), (b, end) in itertools.product(enumerate(starts), enumerate(ends)):
            links[step, a, b] = start, end
    collides = dict(
        zip(links, find_colliding_links(problem, list(links.values())).tolist(), strict=True)
    )
    assert any(collides.values())
    branch = [problem.states[k].branch for k in order]
    for chosen in itertools.product(*map(range, map(len, rows))):
        seconds = 0.0
        for step, (a, b) in enumerate(itertools.pairwise([0, *chosen, 0])):
            start, end = links[step, a, b]
            seconds += float(problem.cost_model.limits.seconds(end - start, 0.0))
            seconds += DETOUR_GUESS * collides[step, a, b]
            # A change of the posture costs a second.
            seconds += 0 < step < len(order) and branch[step - 1][a] != branch[step][b]
        best = min(best, seconds)
    branches = solution.states.branch[order]
    changes = int((branches[1:] != branches[:-1]).sum())
    assert solution.seconds + changes == pytest.approx(best, abs=1e-9)


def test_a_state_is_not_tested_again(problem: TourProblem) -> None:
    tested: list[int] = []

    def count(joints: FloatArray) -> np.ndarray:
        tested.append(len(joints))
        return np.asarray(problem.setup.clear(joints))

    counting = replace(problem, setup=replace(problem.setup, clear=count))
    order = list(range(12))
    first = choose_point_states(counting, order, counting.states, {})
    tests = sum(tested)
    again = choose_point_states(counting, order, counting.states, {})
    assert tests > 0
    assert sum(tested) == tests
    assert first is not None
    assert again is not None
    assert first.states.enter.tolist() == again.states.enter.tolist()


def test_a_tour_of_points_is_proved_and_takes_its_seconds(problem: TourProblem) -> None:
    kept = list(range(12))
    assert are_points(problem, kept)
    solution = find_point_tour(problem, kept, lambda _: None)
    assert solution is not None
    assert sorted(solution.order) == kept
    assert not find_blocked_paths(problem, solution)
    assert not prove_links(problem, solution)
    assert add_detours(problem, solution).seconds == pytest.approx(solution.seconds, abs=1e-9)


def test_links_near_a_rejected_link_are_avoided(problem: TourProblem) -> None:
    order = list(range(12))
    first = choose_point_states(problem, order, problem.states, {})
    assert first is not None
    rejected: RejectedLinks = {}
    for steps in ([0, 5], [0, 5], [0, 5], [0, 5], [0, 5], [0, 5], [5]):
        reject_links(problem, first, steps, rejected)
    again = choose_point_states(problem, order, problem.states, {}, rejected)
    assert again is not None
    assert again.seconds >= first.seconds
    # After five rejected links, links within 0.02 rad are rejected with them, then within 0.04 rad.
    home = problem.cost_model.home
    for item, other, near in ((-1, 0, 0.02), (4, 5, 0.04)):
        starts = [home if item < 0 else tour.states.leave[item] for tour in (first, again)]
        ends = [tour.states.enter[other] for tour in (first, again)]
        assert max(np.abs(np.diff(pair, axis=0)).max() for pair in (starts, ends)) >= near


def test_blocks_have_the_fewest_postures_that_reach_all_points(problem: TourProblem) -> None:
    kept = list(range(12))
    select_clear_states(problem, kept)
    candidates = find_blocks(problem, kept, 3)
    assert candidates
    for blocks in candidates:
        assert len(blocks.branches) == 1
        assert set(blocks.branch) <= set(blocks.branches)
        for states, branch in zip(narrow_states(problem, blocks), blocks.branch, strict=True):
            assert len(states)
            assert set(states.branch.tolist()) == {branch}


def test_paths_with_an_order_and_few_paths_are_not_searched_as_points(problem: TourProblem) -> None:
    rules = replace(problem.rules, rank=np.arange(12))
    assert not are_points(replace(problem, rules=rules), list(range(12)))
    assert not are_points(problem, [0, 1, 2])
