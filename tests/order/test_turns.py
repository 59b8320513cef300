"""Turn counts along a route, compared with all choices and with the route without a choice."""

import importlib
import itertools
import math

import numpy as np
import pytest

from camgen.motion.limits import LinkSpeeds
from camgen.motion.setup import EdgeMotion
from camgen.order.edges.problem import RouteCell, RouteOptions
from camgen.order.edges.route import Route, find_route
from camgen.order.edges.turns import MOST_TURNS, find_cheapest, list_turns, turn_motion
from camgen.read.solid import mesh
from camgen.robots.kinematics.joint_limits import are_within_limits
from tests.order.test_rfa import ARM, PARTS, list_no_turns, load_cell
from tests.support.files import source

CALLERS = [
    importlib.import_module(f"camgen.order.edges.{name}") for name in ("route", "turned_tour")
]
#: With these speeds the joints alone decide the time of a link.
FAST = LinkSpeeds(100.0, 5000.0, 0.0)
LAST = np.array([0, 0, 0, 0, 0, 1])


def list_lowered_motions() -> list[EdgeMotion]:
    """The motions of rfa1, the last joint one turn lower where its limits allow it."""
    motions = []
    for motion in load_cell("rfa1")[2]:
        lower = turn_motion(motion, -LAST)
        motions.append(lower if are_within_limits(ARM, lower.sampled_joints).all() else motion)
    return motions


def link_motions(motions: list[EdgeMotion]) -> Route:
    setup, space, _ = load_cell("rfa1")
    edges = mesh.read(source(PARTS / "rfa1.stl")).edges
    return find_route(
        RouteCell(setup, space, ARM.home), motions, edges, RouteOptions(FAST, best=True)
    )


def test_the_cheapest_turn_counts_are_those_of_a_trial_of_all_choices() -> None:
    draw = np.random.default_rng(5)
    sizes = (3, 2, 4)
    first, last = draw.random(sizes[0]), draw.random(sizes[-1])
    between = [draw.random(pair) for pair in itertools.pairwise(sizes)]
    chosen, seconds = find_cheapest(first, between, last)
    times = {}
    for choice in itertools.product(*map(range, sizes)):
        inner = [
            table[pair] for table, pair in zip(between, itertools.pairwise(choice), strict=True)
        ]
        times[choice] = first[choice[0]] + sum(inner) + last[choice[-1]]
    assert tuple(chosen) == min(times, key=times.__getitem__)
    assert seconds == pytest.approx(min(times.values()))


def test_turn_counts_keep_the_limits_and_the_first_is_zero() -> None:
    lowest = min(
        list_lowered_motions(), key=lambda motion: float(motion.sampled_joints[:, 5].min())
    )
    table = list_turns(ARM, lowest.sampled_joints, ARM.home)
    assert 2 <= len(table) <= MOST_TURNS
    assert not table[0].any()
    assert len(np.unique(table, axis=0)) == len(table)
    assert are_within_limits(ARM, lowest.sampled_joints + math.tau * table[:, None]).all()
    # The turn count nearest to home is tried first.
    assert np.abs(lowest.sampled_joints[:, 5] + math.tau * table[1, 5]).max() < math.pi * 1.5


def test_motions_have_the_turn_counts_of_the_shortest_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """In two of three motions the last joint is one turn farther from home than necessary."""
    motions = [motion for motion in list_lowered_motions() if motion.id in {"e7", "e8", "e14"}]
    assert sum(motion.sampled_joints[:, 5].min() < -math.pi for motion in motions) == 2
    chosen = link_motions(motions)
    for module in CALLERS:
        monkeypatch.setattr(module, "list_turns", list_no_turns)
    kept = link_motions(motions)
    assert chosen.seconds < kept.seconds - 0.1
    by_id = {motion.id: motion for motion in motions}
    for leg in chosen.legs:
        motion = by_id[leg.motion.id]
        run = leg.motion.joints[::-1] if leg.motion.backwards else leg.motion.joints
        whole = (run - motion.joints) / math.tau
        assert whole == pytest.approx(np.rint(whole[:1]) * np.ones((len(run), 1)), abs=1e-9)
        assert are_within_limits(ARM, leg.motion.sampled_joints).all()
