"""The rheological models against the formulas of thesis section 1.3."""

import numpy as np
import pytest

from labpipe.errors import InputError
from labpipe.materials import maxwell, standard_linear_solid

TIME = np.array([0.0, 0.1, 1.0, 7.0, 50.0])
OMEGA = np.array([0.01, 0.3, 1.0, 20.0])
SPRING, DASHPOT = 3e6, 6e6
TAU = DASHPOT / SPRING


def test_maxwell_relaxes_creeps_and_vibrates_as_printed():
    model = maxwell(SPRING, DASHPOT)
    np.testing.assert_allclose(model.relaxation(TIME), SPRING * np.exp(-TIME / TAU))  # (1.33)
    np.testing.assert_allclose(model.creep(TIME), 1 / SPRING + TIME / DASHPOT)  # (1.34)
    x = OMEGA * TAU
    printed = SPRING * x**2 / (1 + x**2) + 1j * SPRING * x / (1 + x**2)  # (1.36)
    np.testing.assert_allclose(model.complex_modulus(OMEGA), printed)
    series = 1 / (1 / SPRING + 1 / (1j * OMEGA * DASHPOT))  # (1.35)
    np.testing.assert_allclose(model.complex_modulus(OMEGA), series)


def test_standard_linear_solid_relaxes_and_creeps_as_printed():
    relaxed, unrelaxed = 2e6, 8e6
    model = standard_linear_solid(relaxed, unrelaxed, TAU)
    expected = relaxed + (unrelaxed - relaxed) * np.exp(-TIME / TAU)  # (1.37)
    np.testing.assert_allclose(model.relaxation(TIME), expected)
    beta = unrelaxed / relaxed
    creep = 1 / relaxed + (1 / unrelaxed - 1 / relaxed) * np.exp(-TIME / (beta * TAU))  # (1.40)
    np.testing.assert_allclose(model.creep(TIME), creep, rtol=1e-13)
    # (1.38): J' + J/(βτ) = 1/(E_unrelaxed τ) for t > 0.
    rate = -(1 / unrelaxed - 1 / relaxed) * np.exp(-TIME / (beta * TAU)) / (beta * TAU)
    left = rate + model.creep(TIME) / (beta * TAU)
    np.testing.assert_allclose(left, 1 / (unrelaxed * TAU), rtol=1e-12)


@pytest.mark.parametrize(
    "build",
    [
        lambda: maxwell(-1.0, 1.0),
        lambda: maxwell(1.0, 0.0),
        lambda: standard_linear_solid(2.0, 2.0, 1.0),
        lambda: standard_linear_solid(0.0, 2.0, 1.0),
        lambda: maxwell(np.nan, 1.0),
    ],
)
def test_impossible_elements_are_refused(build):
    with pytest.raises(InputError):
        build()
