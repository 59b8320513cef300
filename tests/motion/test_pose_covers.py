"""Covers of small ladder graphs, compared with the best of all covers."""

import itertools
import math
from collections.abc import Iterator

import numpy as np
import pytest

from camgen.model.pose import FloatArray
from camgen.motion.pose_chains import PoseChain, States, Steps, find_cover

#: Rows, orientations, and moves: stay, or go to the next orientation.
ROWS, CHOICES = 5, 2
MOVES = np.array([[0, 1], [1, 0]])
PRICE = 3.0


def draw_ladder(seed: int) -> tuple[States, Steps, FloatArray]:
    """Random states with one branch and one turn count, steps and lengths; some are blocked."""
    draw = np.random.default_rng(seed)
    usable = draw.random((ROWS, CHOICES, 1, 1)) < 0.7
    is_open = draw.random((ROWS - 1, 2, CHOICES, 1, 1)) < 0.7
    joints = draw.random((ROWS, CHOICES, 1, 1))
    table = np.zeros((1, 1), dtype=np.int64)
    cost = draw.random(CHOICES)
    states = States(joints, table, usable, is_open, MOVES, cost)
    time = draw.random((ROWS - 1, 2, CHOICES, 1))
    before = np.zeros((ROWS - 1, 2, CHOICES, 1, 1), dtype=np.int16)
    return states, Steps(time, before), draw.uniform(1, 10, ROWS - 1)


def list_chains(states: States) -> Iterator[tuple[int, tuple[int, ...], tuple[int, ...]]]:
    """All chains: their first rows, orientations and moves."""
    for first, last in itertools.combinations(range(ROWS), 2):
        for orientations in itertools.product(range(CHOICES), repeat=last - first + 1):
            moves = []
            is_usable = all(states.usable[first + k, c, 0, 0] for k, c in enumerate(orientations))
            for k, (a, b) in enumerate(itertools.pairwise(orientations)):
                move = int(np.flatnonzero(MOVES[:, b] == a)[0])
                is_usable &= bool(states.open[first + k, move, b, 0, 0])
                moves.append(move)
            if is_usable:
                yield first, orientations, tuple(moves)


def measure_value(
    chain: tuple[int, tuple[int, ...], tuple[int, ...]],
    ladder: tuple[States, Steps, FloatArray],
) -> float:
    """The value of a chain, mm: its length less its price and costs, as `find_cover` defines it."""
    states, transitions, lengths = ladder
    first, orientations, moves = chain
    seconds = sum(
        float(transitions.time[first + k, move, orientations[k + 1], 0])
        for k, move in enumerate(moves)
    )
    seconds += sum(states.cost[c] / ROWS for c in orientations)
    return float(lengths[first : first + len(moves)].sum()) - PRICE - 0.02 * seconds


@pytest.mark.parametrize("seed", range(60))
def test_no_other_cover_has_a_higher_value(seed: int) -> None:
    ladder = draw_ladder(seed)
    states = ladder[0]
    chains = [(chain, measure_value(chain, ladder)) for chain in list_chains(states)]
    best = np.zeros(ROWS)
    for row in range(1, ROWS):
        ending = [
            best[chain[0]] + value for chain, value in chains if chain[0] + len(chain[2]) == row
        ]
        best[row] = max([best[row - 1], *ending])
    cover = find_cover(*ladder, PRICE)
    values = [measure_value((chain.first, *_states_of(chain)), ladder) for chain in cover]
    assert sum(values) == pytest.approx(best[-1])
    listed = [chain for chain, _ in chains]
    assert all((chain.first, *_states_of(chain)) in listed for chain in cover)
    assert all(a.last <= b.first for a, b in itertools.pairwise(cover))


def _states_of(chain: PoseChain) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Orientations and moves of a chain."""
    return tuple(chain.orientation.tolist()), tuple(chain.moves.tolist())


def test_states_that_are_all_blocked_have_no_chain() -> None:
    states, transitions, lengths = draw_ladder(0)
    states.usable[:] = False
    assert find_cover(states, transitions, lengths, PRICE) == []


def test_a_chain_that_is_not_longer_than_its_price_is_left_out() -> None:
    states, transitions, lengths = draw_ladder(0)
    states.usable[:], states.open[:] = True, True
    assert find_cover(states, transitions, 0 * lengths + 1.0, 4.0) == []
    (whole,) = find_cover(states, transitions, 0 * lengths + 2.0, 4.0)
    assert (whole.first, whole.last) == (0, ROWS - 1)
    assert math.isclose(whole.joints[0, 0], states.joints[0, whole.orientation[0], 0, 0])
