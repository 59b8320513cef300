import math

import numpy as np
import pytest
from msgspec.structs import replace

from camgen.model.cell import Dynamics
from camgen.motion.limits import MotionLimits, make_limits, time_from_rest
from camgen.robots.catalogue import find_robot
from camgen.robots.kinematics.rates import find_held_fraction

LIMITS = MotionLimits(np.array([1.0, 2.0]), np.array([4.0, 5.0]), 100.0, 1000.0)


def driven(way: float, speed: float, gain: float) -> float:
    """From rest to rest, driven in small steps as fast as it may: the speed from which braking still ends in time."""
    at, v, time, dt = 0.0, 0.0, 0.0, 1e-4
    while at < way:
        v = min(v + gain * dt, speed, math.sqrt(2 * gain * max(way - at, 1e-12)))
        at += v * dt
        time += dt
    return time


@pytest.mark.parametrize(
    ("way", "speed", "gain"), [(2.0, 1.0, 4.0), (0.1, 1.0, 4.0), (0.25, 1.0, 4.0)]
)
def test_from_rest_to_rest(way: float, speed: float, gain: float) -> None:
    assert float(time_from_rest(np.array(way), speed, gain)) == pytest.approx(
        driven(way, speed, gain), rel=0.01
    )


def test_the_slowest_joint_or_the_tip_counts() -> None:
    moved = np.array([[0.5, 0.5], [0.0, 3.0], [0.0, 0.0]])
    expected = [
        max(driven(0.5, 1, 4), driven(0.5, 2, 5)),
        driven(3.0, 2, 5),
        driven(50.0, 100, 1000),
    ]
    assert LIMITS.seconds(moved, np.array([0.0, 0.0, 50.0])).tolist() == pytest.approx(
        expected, rel=0.01
    )


def test_a_table_of_times_is_each_of_them() -> None:
    rng = np.random.default_rng(2)
    start, end, way = (
        rng.uniform(-2, 2, (7, 2)),
        rng.uniform(-2, 2, (5, 2)),
        rng.uniform(0, 90, (7, 5)),
    )
    each = np.array(
        [[float(LIMITS.seconds(end[k] - start[i], way[i, k])) for k in range(5)] for i in range(7)]
    )
    np.testing.assert_allclose(LIMITS.between(start, end, way), each)


def test_without_accelerations_full_speed_takes_the_ramp_of_the_controller() -> None:
    arm = find_robot("VS-060")
    limits = make_limits(arm, Dynamics(ramp=0.5), 100.0)
    np.testing.assert_allclose(limits.joint_accelerations * 0.5, arm.speeds)


def test_joints_that_a_job_holds_back_are_held_back_in_free_space_too() -> None:
    arm = find_robot("IRB 2400")
    held = replace(arm, held=arm.speeds * np.array([0.25, 1, 1, 1, 1, 1]))
    a, b = np.zeros(6), np.array([1.0, 0.2, 0, 0, 0, 0.1])
    # The first joint is the slowest for its way, and may run at a quarter of its speed.
    assert find_held_fraction(arm, b - a) == 1.0
    assert find_held_fraction(held, b - a) == pytest.approx(0.25)
    # Another joint sets the time: the first one needs no more than its quarter.
    assert find_held_fraction(held, np.array([0.01, 1.0, 0, 0, 0, 0])) == 1.0
