"""The key numbers of the page say how far the data carry them."""

import numpy as np
import pytest
import xarray as xr

from pipelines.experiments.dma.model import ends, still_falls
from pipelines.experiments.dma.page import _end

FREQUENCY = np.logspace(-6, 6, 121)


def curve(storage, loss, relaxed, unrelaxed):
    made = xr.Dataset(
        {
            "reduced_frequency": ("f", FREQUENCY), "master_storage": ("f", storage), "master_loss": ("f", loss),
            "u_master_storage": ("f", 0.01 * storage), "E_relaxed": relaxed, "E_unrelaxed": unrelaxed,
        }
    )  # fmt: skip
    return made.merge(ends(made, scale=0.02))


def test_ends_that_the_loss_determines_have_an_uncertainty_and_others_bounds():
    """A solid of two power laws: its moduli differ from the ends of the data by what Kramers and Kronig say."""
    x = 2j * np.pi * FREQUENCY
    solid = 1e6 + (1e9 - 1e6) * (1.0 / (1.0 + x**-0.6))
    found = curve(solid.real, solid.imag, 1e6, 1e9)
    assert _end(found, "relaxed")[1].endswith("MPa")
    assert "±" in _end(found, "relaxed")[1]
    assert "±" in _end(found, "unrelaxed")[1]
    u = float(found["u_relaxed_modulus"])
    falls = solid.real[0] - 1e6  # what the storage modulus still falls by, taken as a limit
    assert u == pytest.approx(np.hypot(falls / np.sqrt(3.0), np.hypot(0.01, 0.02) * 1e6), rel=0.05)
    level = curve(solid.real, np.full_like(FREQUENCY, 1e8), 1e6, 1e9)
    assert _end(level, "relaxed")[1].startswith("0 to ")
    assert _end(level, "unrelaxed")[1].endswith("at least")


@pytest.mark.parametrize("power", [0.1, 0.4, 0.8])
def test_a_loss_that_goes_on_as_a_power_tells_how_far_the_storage_falls(power):
    """Fractional solid: E = E_0 + K (i w)^m."""
    frequency = np.geomspace(1e-4, 10.0, 40)
    stiffness = 1e6 * (2 * np.pi * frequency) ** power
    loss = stiffness * np.sin(0.5 * np.pi * power)
    expected = stiffness[0] * np.cos(0.5 * np.pi * power)
    assert still_falls(frequency, loss) == pytest.approx(expected, rel=1e-9)
