import math

import numpy as np
import pytest
from msgspec.structs import replace

from camgen.model.cell import Dynamics
from camgen.motion.limits import LinkSpeeds, MotionLimits, make_limits, time_from_rest
from camgen.robots.catalogue import find_robot
from camgen.robots.kinematics.rates import find_held_fraction

LIMITS = MotionLimits(np.array([1.0, 2.0]), np.array([4.0, 5.0]), 100.0, 1000.0)


def simulate_seconds(distance: float, speed: float, acceleration: float) -> float:
    """Seconds from rest to rest, simulated in small steps.

    The speed is as high as its limit, the acceleration and the remaining braking distance allow.
    """
    travelled, current_speed, time, dt = 0.0, 0.0, 0.0, 1e-4
    while travelled < distance:
        current_speed = min(
            current_speed + acceleration * dt,
            speed,
            math.sqrt(2 * acceleration * max(distance - travelled, 1e-12)),
        )
        travelled += current_speed * dt
        time += dt
    return time


@pytest.mark.parametrize(
    ("distance", "speed", "acceleration"), [(2.0, 1.0, 4.0), (0.1, 1.0, 4.0), (0.25, 1.0, 4.0)]
)
def test_the_time_from_rest_to_rest_agrees_with_a_simulation(
    distance: float, speed: float, acceleration: float
) -> None:
    assert float(time_from_rest(np.array(distance), speed, acceleration)) == pytest.approx(
        simulate_seconds(distance, speed, acceleration), rel=0.01
    )


def test_the_slowest_joint_or_the_tcp_determines_the_time() -> None:
    changes = np.array([[0.5, 0.5], [0.0, 3.0], [0.0, 0.0]])
    expected = [
        max(simulate_seconds(0.5, 1, 4), simulate_seconds(0.5, 2, 5)),
        simulate_seconds(3.0, 2, 5),
        simulate_seconds(50.0, 100, 1000),
    ]
    assert LIMITS.seconds(changes, np.array([0.0, 0.0, 50.0])).tolist() == pytest.approx(
        expected, rel=0.01
    )


def test_a_table_of_times_agrees_with_single_times() -> None:
    rng = np.random.default_rng(2)
    start, end = rng.uniform(-2, 2, (7, 2)), rng.uniform(-2, 2, (5, 2))
    distance = rng.uniform(0, 90, (7, 5))
    expected = np.zeros((7, 5))
    for i, k in np.ndindex(7, 5):
        expected[i, k] = LIMITS.seconds(end[k] - start[i], distance[i, k])
    np.testing.assert_allclose(LIMITS.between(start, end, distance), expected)


def test_joint_accelerations_follow_from_the_ramp_of_the_controller() -> None:
    arm = find_robot("VS-060")
    limits = make_limits(arm, Dynamics(ramp=0.5), 100.0)
    np.testing.assert_allclose(limits.joint_accelerations * 0.5, arm.speeds)


def test_joints_that_a_job_slows_down_are_slowed_down_in_free_space() -> None:
    arm = find_robot("IRB 2400")
    held = replace(arm, held=arm.speeds * np.array([0.25, 1, 1, 1, 1, 1]))
    a, b = np.zeros(6), np.array([1.0, 0.2, 0, 0, 0, 0.1])
    # The first joint determines the time, and may run at a quarter of its speed.
    assert find_held_fraction(arm, b - a) == 1.0
    assert find_held_fraction(held, b - a) == pytest.approx(0.25)
    # Another joint determines the time, and the first one needs less than its quarter.
    assert find_held_fraction(held, np.array([0.01, 1.0, 0, 0, 0, 0])) == 1.0


def test_an_arm_with_limited_speeds_takes_as_long_to_reach_them() -> None:
    """The order of paths and the time of a link count the same accelerations, speed by ramp."""
    arm = find_robot("IRB 120")
    slow = replace(arm, held=arm.speeds / 4)
    limits = make_limits(slow, Dynamics(ramp=0.5), 100.0)
    assert limits.joint_accelerations == pytest.approx(arm.speeds / 4 / 0.5)
    moved = np.full(6, 0.3)
    seconds = LinkSpeeds(100.0, 100.0, 1.0, ramp=0.5).time_joints(slow, moved)
    assert float(limits.seconds(moved, np.array(0.0))) == pytest.approx(float(seconds))
