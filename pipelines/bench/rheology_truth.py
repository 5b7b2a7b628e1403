"""Sweeps of known materials, computed without any formula of the analysis."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import xarray as xr

from labpipe.arrays import Complexes, Floats

_GAS_LN10 = 8.314462618 * float(np.log(10.0))
_ZERO_CELSIUS = 273.15


@dataclass(frozen=True, slots=True)
class Truth:
    """A material and its shift law: E(ω, T) = E(a_T ω, T_ref).

    ``name``; ``T_ref`` [degC]: where ``modulus`` is given; ``modulus``: complex modulus (Pa) at angular frequencies
    (rad/s); ``shift``: log10 a at temperatures in degC, up to a constant.
    """

    name: str
    T_ref: float
    modulus: Callable[[Floats], Complexes]
    shift: Callable[[Floats], Floats]


@dataclass(frozen=True, slots=True)
class Measured:
    """One set of sweeps and what is true of it.

    ``sweeps``; ``reference`` [degC]: the isotherm that errors are counted from; ``log10_aT`` (temperature,): true
    shifts from that isotherm; ``exact`` (temperature, frequency) [Pa]: true complex modulus.
    """

    sweeps: xr.Dataset
    reference: float
    log10_aT: Floats
    exact: Complexes

    def error(self, log10_aT: Floats) -> float:
        """Root-mean-square error of shifts counted from any isotherm (decades)."""
        at = int(np.argmin(np.abs(self.sweeps["temperature"].values - self.reference)))
        return float(np.sqrt(np.mean((log10_aT - log10_aT[at] - self.log10_aT) ** 2)))


def measured(truth: Truth, seed: int, temperatures: int = 12, noise: float = 0.02, points: int = 11) -> Measured:
    """Measure a material from −40 to 120 °C at 0.1 to 10 Hz, relative noise on both moduli."""
    temperature = np.linspace(-40.0, 120.0, temperatures)
    frequency = np.logspace(-1.0, 1.0, points)
    return recorded(truth, temperature, frequency, np.random.default_rng(seed), (noise, noise))


def recorded(
    truth: Truth,
    temperature: Floats,
    frequency: Floats,
    rng: np.random.Generator,
    noise: tuple[float, float] = (0.02, 0.02),
    vertical: Callable[[Floats], Floats] | None = None,
) -> Measured:
    """Measure a material anywhere, with relative noise of storage and loss.

    Temperatures are in degC and frequencies in Hz; ``vertical`` is b_T at temperatures in degC, one by default.
    """
    at = int(np.argmin(np.abs(temperature - truth.T_ref)))
    law = truth.shift(temperature)
    from_reference = law - truth.shift(np.array([truth.T_ref]))[0]
    exact = truth.modulus(2.0 * np.pi * frequency * 10.0 ** from_reference[:, None])
    if vertical is not None:
        exact = exact * vertical(temperature)[:, None]
    storage = exact.real * (1.0 + noise[0] * rng.standard_normal(exact.shape))
    loss = exact.imag * (1.0 + noise[1] * rng.standard_normal(exact.shape))
    dims = ("temperature", "frequency")
    sweeps = xr.Dataset(
        {"storage": (dims, storage, {"units": "Pa"}), "loss": (dims, loss, {"units": "Pa"})},
        coords={
            "temperature": ("temperature", temperature, {"units": "degC"}),
            "frequency": ("frequency", frequency, {"units": "Hz"}),
        },
    )
    return Measured(sweeps, float(temperature[at]), law - law[at], exact)


def _maxwell(omega: Floats) -> Complexes:
    """Twenty terms, 1e-10 to 1e2 s, 8 MPa to 3 GPa, two loss peaks."""
    rho = np.logspace(-10.0, 2.0, 20)
    x = np.log10(rho)
    weight = np.exp(-0.5 * ((x + 6.0) / 1.6) ** 2)
    weight = weight + 0.12 * np.exp(-0.5 * ((x + 0.5) / 1.1) ** 2) + 0.004
    z = 1j * omega[..., None] * rho
    return np.asarray(8e6 + (z / (1.0 + z)) @ (weight / weight.sum() * (3e9 - 8e6)))


def _fractional(omega: Floats) -> Complexes:
    """Two fractional Zener elements: no sum of exponentials."""
    total = np.full(omega.shape, 12e6, dtype=complex)
    for strength, time, exponent in ((1.9e9, 3e-5, 0.32), (7e8, 2e-1, 0.55)):
        z = (1j * omega * time) ** exponent
        total += strength * z / (1.0 + z)
    return total


def _single_times(omega: Floats) -> Complexes:
    """Three single relaxation times: most sweeps hold no process of their own."""
    z = 1j * omega[..., None] * np.array([2e-4, 1e-2, 0.3])
    return np.asarray(2e7 + (z / (1.0 + z)) @ np.array([1.2e9, 4e8, 6e7]))


def _glass(omega: Floats) -> Complexes:
    """Return a stiff glass with a weak second process; the coldest sweeps hardly change."""
    first, second = (1j * omega * 30.0) ** 0.4, (1j * omega * 1e-7) ** 0.22
    return np.asarray(3e7 + 1.8e9 * first / (1.0 + first) + 4e8 * second / (1.0 + second))


def _wlf(temperature: Floats) -> Floats:
    return np.asarray(-15.0 * (temperature - 40.0) / (210.0 + temperature))


def _kinked(temperature: Floats) -> Floats:
    """Arrhenius below 30 °C, WLF above."""
    cold = 150e3 / _GAS_LN10 * (1.0 / (temperature + _ZERO_CELSIUS) - 1.0 / (30 + _ZERO_CELSIUS))
    warm = np.maximum(temperature, 30.0)
    return np.where(temperature < 30.0, cold, -11.0 * (warm - 30.0) / (100.0 + warm))


MAXWELL = Truth("twenty Maxwell terms, WLF", 60.0, _maxwell, _wlf)
FRACTIONAL = Truth("two fractional elements, kinked law", 40.0, _fractional, _kinked)
SINGLE_TIMES = Truth("three single relaxation times, WLF", 60.0, _single_times, _wlf)
GLASS = Truth("a glass of two fractional elements, kinked law", 60.0, _glass, _kinked)
