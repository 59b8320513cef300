"""Covers of small ladder graphs against the best of all that there are."""

import itertools
import math
from collections.abc import Iterator

import numpy as np
import pytest

from camgen.model.pose import FloatArray
from camgen.motion.pose_chains import States, Steps
from camgen.motion.pose_covers import CoverChain, find_cover

#: Rows, orientations, and moves: stay, or go to the next orientation.
ROWS, CHOICES = 5, 2
MOVES = np.array([[0, 1], [1, 0]])
PRICE = 3.0


def draw_ladder(seed: int) -> tuple[States, Steps, FloatArray]:
    """States with one branch and one turn, some closed, with random times and lengths."""
    draw = np.random.default_rng(seed)
    usable = draw.random((ROWS, CHOICES, 1, 1)) < 0.7
    opened = draw.random((ROWS - 1, 2, CHOICES, 1, 1)) < 0.7
    joints = draw.random((ROWS, CHOICES, 1, 1))
    table = np.zeros((1, 1), dtype=np.int64)
    cost = draw.random(CHOICES)
    states = States(joints, table, usable, opened, MOVES, cost)
    time = draw.random((ROWS - 1, 2, CHOICES, 1))
    before = np.zeros((ROWS - 1, 2, CHOICES, 1, 1), dtype=np.int16)
    return states, Steps(time, before), draw.uniform(1, 10, ROWS - 1)


def list_chains(states: States) -> Iterator[tuple[int, tuple[int, ...], tuple[int, ...]]]:
    """All chains: their first rows, orientations and moves."""
    for first, last in itertools.combinations(range(ROWS), 2):
        for passed in itertools.product(range(CHOICES), repeat=last - first + 1):
            moves = []
            good = all(states.usable[first + k, c, 0, 0] for k, c in enumerate(passed))
            for k, (a, b) in enumerate(itertools.pairwise(passed)):
                move = int(np.flatnonzero(MOVES[:, b] == a)[0])
                good &= bool(states.open[first + k, move, b, 0, 0])
                moves.append(move)
            if good:
                yield first, passed, tuple(moves)


def measure(
    chain: tuple[int, tuple[int, ...], tuple[int, ...]],
    ladder: tuple[States, Steps, FloatArray],
) -> float:
    """The length of a chain less its price and its costs, mm, by the definition of `find_cover`."""
    states, transitions, lengths = ladder
    first, passed, moves = chain
    seconds = sum(
        float(transitions.time[first + k, move, passed[k + 1], 0]) for k, move in enumerate(moves)
    )
    seconds += sum(states.cost[c] / ROWS for c in passed)
    return float(lengths[first : first + len(moves)].sum()) - PRICE - 0.02 * seconds


@pytest.mark.parametrize("seed", range(60))
def test_no_other_cover_is_worth_more(seed: int) -> None:
    ladder = draw_ladder(seed)
    states = ladder[0]
    chains = [(chain, measure(chain, ladder)) for chain in list_chains(states)]
    best = np.zeros(ROWS)
    for row in range(1, ROWS):
        ending = [
            best[chain[0]] + value for chain, value in chains if chain[0] + len(chain[2]) == row
        ]
        best[row] = max([best[row - 1], *ending])
    cover = find_cover(*ladder, PRICE)
    values = [measure((chain.first, *_states_of(chain)), ladder) for chain in cover]
    assert sum(values) == pytest.approx(best[-1])
    listed = [chain for chain, _ in chains]
    assert all((chain.first, *_states_of(chain)) in listed for chain in cover)
    assert all(a.last <= b.first for a, b in itertools.pairwise(cover))


def _states_of(chain: CoverChain) -> tuple[tuple[int, ...], tuple[int, ...]]:
    return tuple(chain.orientation.tolist()), tuple(chain.moves.tolist())


def test_without_a_state_there_is_no_chain() -> None:
    states, transitions, lengths = draw_ladder(0)
    states.usable[:] = False
    assert find_cover(states, transitions, lengths, PRICE) == []


def test_a_chain_that_is_not_longer_than_its_price_is_not_taken() -> None:
    states, transitions, lengths = draw_ladder(0)
    states.usable[:], states.open[:] = True, True
    assert find_cover(states, transitions, 0 * lengths + 1.0, 4.0) == []
    (whole,) = find_cover(states, transitions, 0 * lengths + 2.0, 4.0)
    assert (whole.first, whole.last) == (0, ROWS - 1)
    assert math.isclose(whole.joints[0, 0], states.joints[0, whole.orientation[0], 0, 0])
