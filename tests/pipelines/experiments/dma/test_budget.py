"""Formulas of budgets against closed forms."""

from math import cos, inf, pi, sin

import numpy as np
import pytest

from pipelines.experiments.dma._ends import still_falls


@pytest.mark.parametrize("power", [0.1, 0.4, 0.8])
def test_a_loss_that_goes_on_as_a_power_tells_how_far_the_storage_falls(power: float) -> None:
    """Fractional solid: E = E_0 + K (i w)^m."""
    frequency = np.geomspace(1e-4, 10.0, 40)
    stiffness = 1e6 * (2 * pi * frequency) ** power
    loss = stiffness * sin(0.5 * pi * power)
    expected = stiffness[0] * cos(0.5 * pi * power)
    assert still_falls(frequency, loss) == pytest.approx(expected, rel=1e-9)


def test_a_loss_that_does_not_fall_tells_nothing() -> None:
    frequency = np.geomspace(1e-4, 10.0, 40)
    assert still_falls(frequency, np.full(40, 1e6)) > 1e9
    assert still_falls(frequency, 1e6 * frequency**-0.1) == inf
