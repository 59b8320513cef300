"""The cheapest chain of orientations, branches and turns against every chain there is, and the grid it walks on."""

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
#: Three orientations in a row.
MOVES = np.array([[0, 1, 2], [-1, 0, 1], [1, 2, -1]])
WORTH = np.array([0.0, 0.4, 0.9])
K, C, B, T = 3, 3, 2, len(TABLE)


def drawn(seed: int) -> States:
    rng = np.random.default_rng(seed)
    joints = rng.uniform([-2, -2, 0, -3.1], [2, 2, 200, 3.1], (K, C, B, 4))
    joints[rng.random((K, C, B)) < 0.1] = np.nan
    share = (0.6, 0.1)[seed % 2]
    usable = (rng.random((K, C, B, T)) < share) & np.isfinite(joints[..., :1])
    return States(joints, TABLE, usable, rng.random((K - 1, 3, C, B, T)) < 0.8, MOVES, WORTH)


def seconds(moved: np.ndarray) -> float:
    return max(abs(float(m)) / float(v) for m, v in zip(moved, SCARA.speeds, strict=True))


def by_trying_all(states: States) -> float:
    least = math.inf
    for branch in range(B):
        for chain in itertools.product(itertools.product(range(C), range(T)), repeat=K):
            if not all(states.usable[k, c, branch, t] for k, (c, t) in enumerate(chain)):
                continue
            values = [
                states.joints[k, c, branch] + 2 * math.pi * TABLE[t]
                for k, (c, t) in enumerate(chain)
            ]
            cost = seconds(values[0] - START) + sum(WORTH[c] for c, _ in chain) / K
            for k in range(1, K):
                (c, t), source = chain[k], chain[k - 1][0]
                move = {0: 0, 1: 1, -1: 2}.get(c - source, -1)
                moved = values[k] - values[k - 1]
                if (
                    move < 0
                    or not states.open[k - 1, move, c, branch, t]
                    or np.abs(moved[[0, 1, 3]]).max() > JUMP
                ):
                    cost = math.inf
                    break
                cost += seconds(moved) + (CHANGE if move else 0.0)
            least = min(least, cost)
    return least


@given(st.integers(0, 10**6))
def test_no_chain_is_cheaper(seed: int) -> None:
    states = drawn(seed)
    found = find_cheapest_chain(SCARA, states, find_steps(SCARA, states, JUMP), START)
    least = by_trying_all(states)
    assert (found is None) == math.isinf(least)
    if found is None:
        return
    assert found.cost == pytest.approx(least, rel=1e-12)
    # And it is a chain of the table that costs what it says.
    turned = found.joints - states.joints[np.arange(K), found.orientation, found.branch]
    assert np.allclose(turned / (2 * math.pi), np.rint(turned / (2 * math.pi)))
    moved = np.diff(found.joints, axis=0)
    cost = seconds(found.joints[0] - START) + sum(seconds(m) for m in moved)
    cost += WORTH[found.orientation].sum() / K + CHANGE * np.count_nonzero(found.moves)
    assert cost == pytest.approx(least)
    assert [MOVES[m, c] for m, c in zip(found.moves, found.orientation[1:], strict=True)] == [
        *found.orientation[:-1]
    ]


def test_the_trials_meet_both_cases() -> None:
    found = [by_trying_all(drawn(seed)) < math.inf for seed in range(12)]
    assert 0 < sum(found) < len(found)


def test_a_grid_is_the_cone_and_the_turn_and_starts_nominal() -> None:
    tilt = math.radians(20)
    full = make_grid(OrientationFreedom(tilt, roll=True))
    assert (
        len(full.nominal_from_tool) == 13 * 12
    )  # 13 points of a 5 x 5 square lie in its inner circle
    assert np.array_equal(full.nominal_from_tool[0], np.eye(3))
    assert full.cost[0] == 0 < full.cost[1:].min()
    lent, _ = measure_lean(
        np.broadcast_to(np.eye(3), full.nominal_from_tool.shape), full.nominal_from_tool
    )
    assert lent.max() == pytest.approx(tilt)
    assert len(np.unique(full.nominal_from_tool.round(9), axis=0)) == 13 * 12
    # Neighbours are one step apart: half the tilt, or a twelfth of a turn.
    for move in full.moves[1:]:
        own = np.flatnonzero(move >= 0)
        turn = np.swapaxes(full.nominal_from_tool[move[own]], 1, 2) @ full.nominal_from_tool[own]
        angle = np.degrees(np.arccos((np.trace(turn, axis1=1, axis2=2) - 1) / 2))
        assert (angle < 30 + 1e-6).all()


@pytest.mark.parametrize(
    ("freedom", "size", "moves"),
    [
        (OrientationFreedom(), 1, 1),
        (OrientationFreedom(0.1), 13, 5),
        (OrientationFreedom(0, True), 12, 3),
    ],
)
def test_a_grid_has_only_what_is_free(freedom: OrientationFreedom, size: int, moves: int) -> None:
    found = make_grid(freedom)
    assert (len(found.cost), len(found.moves)) == (size, moves)


@given(st.floats(0, 1.5), st.floats(0, 6.2), st.floats(-3.1, 3.1))
def test_lean_takes_tilt_and_roll_apart(tilt: float, around: float, roll: float) -> None:
    axis = np.array([math.cos(around), math.sin(around), 0.0])
    nominal = rotation_about(0, 0.7)
    actual = nominal @ rotation_about_axis(axis, tilt) @ rotation_about(2, roll)
    found = measure_lean(nominal[None], actual[None])
    assert found[0][0] == pytest.approx(tilt, abs=1e-9)
    assert found[1][0] == pytest.approx(roll, abs=1e-9)
