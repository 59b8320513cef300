"""The cheapest chain of orientations, branches and turn counts, compared with all chains."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camgen.model.pose import rotation_about, rotation_about_axis
from camgen.motion.pose_chains import CHANGE, States, find_cheapest_chain, find_steps
from camgen.motion.search import make_grid, measure_lean
from camgen.motion.setup import OrientationFreedom
from camgen.robots.catalogue import find_robot
from camgen.robots.kinematics.joint_limits import list_turn_counts

SCARA = find_robot("Cobra s600")
TABLE = list_turn_counts(SCARA)
JUMP = math.radians(120)
START = np.array([0.1, -0.2, 50.0, 0.3])
#: Three neighbouring orientations: the target of each of three moves, -1 for none.
MOVES = np.array([[0, 1, 2], [-1, 0, 1], [1, 2, -1]])
WORTH = np.array([0.0, 0.4, 0.9])
K, C, B, T = 3, 3, 2, len(TABLE)


def draw_states(seed: int) -> States:
    """Random states; odd seeds have few usable ones."""
    rng = np.random.default_rng(seed)
    joints = rng.uniform([-2, -2, 0, -3.1], [2, 2, 200, 3.1], (K, C, B, 4))
    joints[rng.random((K, C, B)) < 0.1] = np.nan
    fraction = (0.6, 0.1)[seed % 2]
    usable = (rng.random((K, C, B, T)) < fraction) & np.isfinite(joints[..., :1])
    return States(joints, TABLE, usable, rng.random((K - 1, 3, C, B, T)) < 0.8, MOVES, WORTH)


def compute_seconds(change: np.ndarray) -> float:
    """The time of the slowest joint, s, for a change of joint values (4,)."""
    return max(
        abs(float(joint_change)) / float(speed)
        for joint_change, speed in zip(change, SCARA.speeds, strict=True)
    )


def find_cheapest_by_trial(states: States) -> float:
    """The least cost of all chains, s; infinite without a chain."""
    least = math.inf
    for branch in range(B):
        for chain in itertools.product(itertools.product(range(C), range(T)), repeat=K):
            if not all(states.usable[k, c, branch, t] for k, (c, t) in enumerate(chain)):
                continue
            values = [
                states.joints[k, c, branch] + 2 * math.pi * TABLE[t]
                for k, (c, t) in enumerate(chain)
            ]
            cost = compute_seconds(values[0] - START) + sum(WORTH[c] for c, _ in chain) / K
            for k in range(1, K):
                (c, t), source = chain[k], chain[k - 1][0]
                move = {0: 0, 1: 1, -1: 2}.get(c - source, -1)
                change = values[k] - values[k - 1]
                if (
                    move < 0
                    or not states.open[k - 1, move, c, branch, t]
                    or np.abs(change[[0, 1, 3]]).max() > JUMP
                ):
                    cost = math.inf
                    break
                cost += compute_seconds(change) + (CHANGE if move else 0.0)
            least = min(least, cost)
    return least


@given(st.integers(0, 10**6))
def test_no_chain_is_cheaper(seed: int) -> None:
    states = draw_states(seed)
    chain = find_cheapest_chain(SCARA, states, find_steps(SCARA, states, JUMP), START)
    least = find_cheapest_by_trial(states)
    assert (chain is None) == math.isinf(least)
    if chain is None:
        return
    # The chain consists of states of the table, and has the least cost.
    turns = chain.joints - states.joints[np.arange(K), chain.orientation, chain.branch]
    assert np.allclose(turns / (2 * math.pi), np.rint(turns / (2 * math.pi)))
    changes = np.diff(chain.joints, axis=0)
    cost = compute_seconds(chain.joints[0] - START) + sum(
        compute_seconds(change) for change in changes
    )
    cost += WORTH[chain.orientation].sum() / K + CHANGE * np.count_nonzero(chain.moves)
    assert cost == pytest.approx(least, rel=1e-12)
    assert [
        MOVES[change, c] for change, c in zip(chain.moves, chain.orientation[1:], strict=True)
    ] == [*chain.orientation[:-1]]


def test_some_random_states_have_a_chain_and_some_have_none() -> None:
    has_chain = [find_cheapest_by_trial(draw_states(seed)) < math.inf for seed in range(12)]
    assert 0 < sum(has_chain) < len(has_chain)


def test_a_grid_covers_tilt_and_roll_and_starts_with_the_nominal_orientation() -> None:
    tilt = math.radians(20)
    full = make_grid(OrientationFreedom(tilt, roll=True))
    # 13 points of a 5 x 5 square are in its inner circle.
    assert len(full.nominal_from_tool) == 13 * 12
    assert np.array_equal(full.nominal_from_tool[0], np.eye(3))
    assert full.cost[0] == 0 < full.cost[1:].min()
    tilts, _ = measure_lean(
        np.broadcast_to(np.eye(3), full.nominal_from_tool.shape), full.nominal_from_tool
    )
    assert tilts.max() == pytest.approx(tilt)
    assert len(np.unique(full.nominal_from_tool.round(9), axis=0)) == 13 * 12
    # Neighbours are one step apart: half of the tilt, or 30 deg of roll.
    for move in full.moves[1:]:
        sources = np.flatnonzero(move >= 0)
        rotations = (
            np.swapaxes(full.nominal_from_tool[move[sources]], 1, 2)
            @ full.nominal_from_tool[sources]
        )
        angle = np.degrees(np.arccos((np.trace(rotations, axis1=1, axis2=2) - 1) / 2))
        assert (angle < 30 + 1e-6).all()


@pytest.mark.parametrize(
    ("freedom", "size", "moves"),
    [
        (OrientationFreedom(), 1, 1),
        (OrientationFreedom(0.1), 13, 5),
        (OrientationFreedom(0, True), 12, 3),
    ],
)
def test_a_grid_has_only_the_orientations_that_are_free(
    freedom: OrientationFreedom, size: int, moves: int
) -> None:
    grid = make_grid(freedom)
    assert (len(grid.cost), len(grid.moves)) == (size, moves)


@given(st.floats(0, 1.5), st.floats(0, 6.2), st.floats(-3.1, 3.1))
def test_an_orientation_is_divided_into_tilt_and_roll(
    tilt: float, direction: float, roll: float
) -> None:
    axis = np.array([math.cos(direction), math.sin(direction), 0.0])
    nominal = rotation_about(0, 0.7)
    actual = nominal @ rotation_about_axis(axis, tilt) @ rotation_about(2, roll)
    measured = measure_lean(nominal[None], actual[None])
    assert measured[0][0] == pytest.approx(tilt, abs=1e-9)
    assert measured[1][0] == pytest.approx(roll, abs=1e-9)
