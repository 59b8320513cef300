"""The model of the contact, compared with formulas."""

import numpy as np
import pytest

from bench.photo.contact import Contact, simulate_force

MODEL = Contact()


def test_the_force_without_an_error_is_the_nominal_one() -> None:
    force, beyond = simulate_force(np.zeros(200), np.full(200, 2.0), np.full(200, 0.01), MODEL)
    assert force[100:] == pytest.approx(2.0, abs=1e-3)
    # The compliances of tool and arm are in series.
    assert beyond[-1] == pytest.approx(2.0 * (1 / 4 + 1 / 40), rel=1e-3)


def test_a_growing_error_adds_its_speed_times_the_damping() -> None:
    time = np.full(400, 0.01)
    force, _ = simulate_force(0.3 * np.cumsum(time), np.full(400, 2.0), time, MODEL)
    assert force[200:] == pytest.approx(2.0 + 0.2 * 0.3, rel=1e-3)


def test_a_step_decays_with_the_time_constant_damping_over_stiffness() -> None:
    error = np.where(np.arange(4000) < 2000, 0.0, 0.2)
    force, _ = simulate_force(
        error, np.full(4000, 2.0), np.full(4000, 0.001), Contact(mass=1e-4 * 4, cutoff=1e3)
    )
    error_force = force[2000:] - 2.0
    assert error_force.max() == pytest.approx(0.2 * MODEL.stiffness, rel=0.05)
    settling_time = (
        np.searchsorted(-error_force[error_force.argmax() :], -error_force.max() / np.e) * 0.001
    )
    assert settling_time == pytest.approx(0.2 / MODEL.stiffness, rel=0.1)


def test_a_nominal_force_of_zero_gives_no_force() -> None:
    nominal = np.where(np.arange(600) < 300, 2.0, 0.0)
    force, _ = simulate_force(np.zeros(600), nominal, np.full(600, 0.01), MODEL)
    assert force[400:] == pytest.approx(0.0, abs=0.01)
    assert (force >= 0).all()
