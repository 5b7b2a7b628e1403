"""The substrate as an oscillator."""

import numpy as np
import pytest

from labpipe.contact.impact._plate import Plate, PlateState
from labpipe.errors import InputError

PLATE = Plate(mass=2.0, frequency=100.0, damping_ratio=0.05)


def test_free_vibration_has_the_frequency_and_the_damping():
    start = PlateState(1e-5, 0.0, 0.0)
    damped_period = 1.0 / (100.0 * np.sqrt(1 - 0.05**2))
    after = PLATE.free(start, damped_period)
    decrement = np.exp(-2 * np.pi * 0.05 / np.sqrt(1 - 0.05**2))
    assert after.displacement == pytest.approx(1e-5 * decrement)
    assert after.velocity == pytest.approx(0.0, abs=1e-12)


def test_free_vibration_may_be_split():
    start = PlateState(1e-5, -2e-3, 0.0)
    split = PLATE.free(PLATE.free(start, 1.3e-3), 2.9e-3)
    np.testing.assert_allclose(split, PLATE.free(start, 4.2e-3), rtol=1e-12)


def test_steps_converge_to_free_vibration_with_second_order():
    start = PLATE.free(PlateState(1e-5, -2e-3, 0.0), 0.0)
    exact = PLATE.free(start, 5e-3)
    errors = []
    for n in (100, 200):
        state, dt = start, 5e-3 / n
        for _ in range(n):
            moved, _ = PLATE.predict(state, dt)
            state = PLATE.follow(state, dt, moved, 0.0)
        errors.append(abs(state.displacement - exact.displacement))
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.05)


def test_energy_of_a_step_is_accounted_for():
    state, dt, force = PLATE.free(PlateState(1e-5, -2e-3, 0.0), 0.0), 1e-4, 50.0
    free, answer = PLATE.predict(state, dt)
    after = PLATE.follow(state, dt, free + answer * force, force)
    work = 0.5 * force * (after.displacement - state.displacement)
    gained = PLATE.energy(after) - PLATE.energy(state)
    assert gained + PLATE.loss(state, after, dt) == pytest.approx(work, rel=1e-10, abs=0.0)


@pytest.mark.parametrize(
    ("mass", "frequency", "damping_ratio"),
    [(0.0, 1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 1.0), (1.0, 1.0, -0.1), (np.nan, 1.0, 0.0)],
)
def test_impossible_plates_are_refused(mass, frequency, damping_ratio):
    with pytest.raises(InputError, match="plate"):
        Plate(mass, frequency, damping_ratio)
