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
from camgen.order.arm.blocks import find_blocks, leave_clear, narrow_states
from camgen.order.arm.lattice import AROUND, Barred, bar_links, go_round, prove_links, settle_points
from camgen.order.arm.points import are_points, find_points
from camgen.order.arm.search import Work, blocked_paths, find_met

ARM = importlib.import_module("camgen.order.arm")


class _Begun(Exception):
    """The search is about to begin."""


@pytest.fixture
def work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Work:
    """What the search for the tour through twelve holes begins with."""
    begun: list[Work] = []

    def catch(work: Work, *_: object) -> None:
        begun.append(work)
        raise _Begun

    monkeypatch.setattr(ARM, "_search", catch)
    with pytest.raises(_Begun):
        camgen.build(
            robotsp.draw(robotsp.made_holes(), tmp_path), post="rapid", job=robotsp.job([])
        )
    return begun[0]


def thin(work: Work, items: list[int], count: int) -> Work:
    """``work`` with so many clear states of each of ``items``, evenly taken."""
    leave_clear(work, items)
    states = list(work.states)
    for k in items:
        states[k] = states[k].pick(
            np.unique(np.linspace(0, len(states[k]) - 1, count).astype(np.int64))
        )
    return replace(work, states=states)


def test_the_states_are_the_soonest_of_all_where_a_link_that_collides_costs_a_way_round(
    work: Work,
) -> None:
    order = [4, 9, 2]
    work = thin(work, order, 9)
    found = settle_points(work, order, work.states, {})
    assert found is not None
    home, best = work.ground.home, np.inf
    rows = [work.states[k].enter for k in order]
    links = {
        (one, a, b): (start, end)
        for one, (starts, ends) in enumerate(itertools.pairwise([home[None], *rows, home[None]]))
        for a, start in enumerate(starts)
        for b, end in enumerate(ends)
    }
    met = dict(zip(links, find_met(work, list(links.values())).tolist(), strict=True))
    assert any(met.values())
    branch = [work.states[k].branch for k in order]
    for chosen in itertools.product(*(range(len(own)) for own in rows)):
        seconds = 0.0
        for one, (a, b) in enumerate(itertools.pairwise([0, *chosen, 0])):
            start, end = links[one, a, b]
            seconds += float(work.ground.limits.seconds(end - start, 0.0)) + AROUND * met[one, a, b]
            # A change of the posture is weighed with a second.
            seconds += 0 < one < len(order) and branch[one - 1][a] != branch[one][b]
        best = min(best, seconds)
    own = found.now.branch[order]
    assert found.seconds + int((own[1:] != own[:-1]).sum()) == pytest.approx(best, abs=1e-9)


def test_what_was_tested_is_not_tested_again(work: Work) -> None:
    looked: list[int] = []

    def count(joints: FloatArray) -> np.ndarray:
        looked.append(len(joints))
        return np.asarray(work.setup.clear(joints))

    counting = replace(work, setup=replace(work.setup, clear=count))
    order = list(range(12))
    first = settle_points(counting, order, counting.states, {})
    begun = sum(looked)
    again = settle_points(counting, order, counting.states, {})
    assert begun > 0
    assert sum(looked) == begun
    assert first is not None
    assert again is not None
    assert first.now.enter.tolist() == again.now.enter.tolist()


def test_a_tour_of_points_is_proved_and_as_long_as_it_says(work: Work) -> None:
    kept = list(range(12))
    assert are_points(work, kept)
    found = find_points(work, kept, lambda _: None)
    assert found is not None
    assert sorted(found.order) == kept
    assert not blocked_paths(work, found)
    assert not prove_links(work, found)
    assert go_round(work, found).seconds == pytest.approx(found.seconds, abs=1e-9)


def test_links_beside_one_that_was_turned_down_are_left(work: Work) -> None:
    order = list(range(12))
    first = settle_points(work, order, work.states, {})
    assert first is not None
    barred: Barred = {}
    for places in ([0, 5], [0, 5], [0, 5], [0, 5], [0, 5], [0, 5], [5]):
        bar_links(work, first, places, barred)
    again = settle_points(work, order, work.states, {}, barred)
    assert again is not None
    assert again.seconds >= first.seconds
    # After five that were turned down one by one those 0.02 rad beside them too, then 0.04.
    for item, other, near in ((-1, 0, 0.02), (4, 5, 0.04)):
        ends = (
            (found.now.leave[item] if item >= 0 else work.ground.home, found.now.enter[other])
            for found in (first, again)
        )
        (a, b), (c, d) = ends
        assert max(np.abs(a - c).max(), np.abs(b - d).max()) >= near


def test_blocks_have_the_fewest_postures_that_reach_all(work: Work) -> None:
    kept = list(range(12))
    leave_clear(work, kept)
    found = find_blocks(work, kept, 3)
    assert found
    for blocks in found:
        assert len(blocks.branches) == 1
        assert set(blocks.branch) <= set(blocks.branches)
        for own, b in zip(narrow_states(work, blocks), blocks.branch, strict=True):
            assert len(own)
            assert set(own.branch.tolist()) == {b}


def test_what_has_an_order_is_not_searched_as_points(work: Work) -> None:
    rules = replace(work.rules, rank=np.arange(12))
    assert not are_points(replace(work, rules=rules), list(range(12)))
    assert not are_points(work, [0, 1, 2])
