"""First guesses for a wrist that is not quite spherical: the angles of axis 6 near a solution."""

from __future__ import annotations

import numpy as np
import pytest

from camgen.robots.kinematics.iterative import _are_near


@pytest.mark.parametrize(
    ("values", "near"),
    [
        ([0.3, 0.1, -0.2, -0.4], [False, True, False, False]),
        ([0.3, 0.2, -0.1, -0.4], [False, False, True, False]),
        ([-0.4, -0.2, 0.1, 0.3], [False, False, True, False]),
        ([0.2, 0.0, -0.2, -0.3], [False, True, False, False]),
        ([0.3, 0.2, 0.1, 0.3], [False, False, False, False]),
        ([1.2, 1.5, -1.5, -1.2], [False, False, False, False]),
    ],
    ids=["before", "after", "rising", "zero", "no change of sign", "a jump of half a turn"],
)
def test_the_angle_nearer_to_a_change_of_sign_is_marked(
    values: list[float], near: list[bool]
) -> None:
    column = np.array(values)[None, :, None]
    assert _are_near(column)[0, :, 0].tolist() == near
