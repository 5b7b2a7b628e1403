"""Known materials that sweeps are made from, shared by the tests of this folder."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
import xarray as xr

from pipelines.bench.master_curve import MAXWELL


@dataclass(frozen=True)
class Truth:
    """A material with its shift law, E(ω, T) = E(a_T ω, T_ref), and the delay of a rig's phase [s]."""

    T_ref: float
    modulus: Callable[[np.ndarray], np.ndarray]
    shift: Callable[[np.ndarray], np.ndarray]
    delay: float = 0.0
    temperature: tuple[float, ...] = tuple(np.linspace(-40.0, 120.0, 12))
    frequency: tuple[float, ...] = tuple(np.logspace(-1, 1, 11))

    @property
    def log10_aT(self) -> np.ndarray:
        return self.shift(np.array(self.temperature)) - self.shift(np.array(self.T_ref))

    def clean(self) -> np.ndarray:
        """Complex modulus over (temperature, frequency), without the instrument."""
        omega = 2 * np.pi * np.array(self.frequency)
        return self.modulus(omega * 10.0 ** self.log10_aT[:, None])

    def sweeps(self, seed: int, storage: float = 0.02, loss: float = 0.02) -> xr.Dataset:
        """Dataset with relative noise on either modulus."""
        rng = np.random.default_rng(seed)
        phase = 2 * np.pi * np.array(self.frequency) * self.delay
        measured = self.clean() * np.exp(1j * phase)
        factors = [1 + level * rng.standard_normal(measured.shape) for level in (storage, loss)]
        dims = ("temperature", "frequency")
        return xr.Dataset(
            {
                "storage": (dims, measured.real * factors[0], {"units": "Pa"}),
                "loss": (dims, measured.imag * factors[1], {"units": "Pa"}),
            },
            coords={
                "temperature": ("temperature", np.array(self.temperature), {"units": "degC"}),
                "frequency": ("frequency", np.array(self.frequency), {"units": "Hz"}),
            },
        )


@pytest.fixture(scope="session")
def maxwell_truth():
    return Truth(60.0, lambda omega: MAXWELL.at().modulus(omega / (2 * np.pi)), MAXWELL.log10_aT)


@pytest.fixture(scope="session")
def melt_truth():
    """A liquid: power-law spectrum that ends, no relaxed modulus."""
    rho = np.logspace(-10, 1, 23)
    weight = 10 ** (-0.3 * (np.log10(rho) + 10))
    weight = weight / weight.sum() * 2e9

    def modulus(omega):
        z = 1j * omega[..., None] * rho
        return (z / (1 + z)) @ weight

    return Truth(60.0, modulus, MAXWELL.log10_aT)
