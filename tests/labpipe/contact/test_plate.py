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


@pytest.mark.parametrize(
    ("mass", "frequency", "damping_ratio"),
    [(0.0, 1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 1.0), (1.0, 1.0, -0.1), (np.nan, 1.0, 0.0)],
)
def test_impossible_plates_are_refused(mass, frequency, damping_ratio):
    with pytest.raises(InputError, match="plate"):
        Plate(mass, frequency, damping_ratio)
