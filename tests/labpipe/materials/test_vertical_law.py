"""The vertical laws: b ∝ T is a special case of the linear one, and none turns negative."""

import numpy as np
import pytest

from labpipe.materials.superposition._vertical_law import VERTICAL_SIZE, fit_vertical, vertical_slopes, vertical_values

TEMPERATURE = np.linspace(-40.0, 120.0, 9)


def test_linear_law_contains_the_entropic_one():
    entropic = vertical_values("rho_T", np.empty(0), TEMPERATURE, 25.0)
    slope = np.array([100.0 / 298.15])
    np.testing.assert_allclose(vertical_values("linear", slope, TEMPERATURE, 25.0), entropic)
    np.testing.assert_allclose(fit_vertical("linear", entropic, TEMPERATURE, 25.0), slope)


@pytest.mark.parametrize("name", ["none", "linear", "quadratic"])
def test_slopes_are_those_of_the_values(name):
    parameters = np.array([0.2, -0.05])[: VERTICAL_SIZE[name]]
    slopes = vertical_slopes(name, parameters, TEMPERATURE, 25.0)
    assert slopes.shape == (9, VERTICAL_SIZE[name])
    for k in range(parameters.size):
        step = np.zeros(parameters.size)
        step[k] = 1e-6
        up, down = (vertical_values(name, parameters + s * step, TEMPERATURE, 25.0) for s in (1, -1))
        np.testing.assert_allclose((up - down) / 2e-6, slopes[:, k], atol=1e-8)


def test_negative_factor_has_no_value():
    assert vertical_values("linear", np.array([-2.0]), TEMPERATURE, 25.0) is None
