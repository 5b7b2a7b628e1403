"""Influence coefficients of strips against quadrature, Fourier sums and limits."""

import numpy as np
import pytest

from labpipe.contact.line._surface import line_kernel
from labpipe.errors import InputError

PERIOD = 8e-3


def test_half_plane_has_no_mean_and_a_layer_does() -> None:
    half_plane = line_kernel(PERIOD, 128)
    assert half_plane.symbol[0] == 0.0
    assert half_plane.datum == "mean surface"
    layer = line_kernel(PERIOD, 128, thickness=1e-3, nu=0.35)
    # h (1+ν)(1−2ν)/(E(1−ν)) times E* = E/(1−ν²).
    expected = 1e-3 * 1.35 * 0.3 / 0.65 / (1 - 0.35**2)
    assert layer.mean_compliance == pytest.approx(expected)
    assert layer.symbol[0] == pytest.approx(expected, rel=1e-12)
    uniform = layer.displacement(np.ones(128))
    assert uniform == pytest.approx(np.full(128, expected), rel=1e-12)


@pytest.mark.parametrize("thickness", [np.inf, 1e-3, 1e-5])
def test_displacement_is_the_sum_of_influences(thickness) -> None:
    kernel = line_kernel(PERIOD, 16, thickness, 0.3)
    pressure = np.random.default_rng(0).random(16)
    index = np.arange(16)
    matrix = kernel.influence[(index[:, None] - index) % 16]
    # The half-plane's mean is put to zero exactly in the FFT, to rounding in the sum.
    assert kernel.displacement(pressure) == pytest.approx(matrix @ pressure, abs=1e-15)


@pytest.mark.parametrize(
    "wrong", [{"period": 0.0}, {"elements": 15}, {"thickness": 0.0}, {"nu": 0.6}, {"thickness": 1e-12}]
)
def test_values_outside_the_domain_are_refused(wrong) -> None:
    with pytest.raises(InputError):
        line_kernel(**({"period": PERIOD, "elements": 64, "nu": 0.3} | wrong))
