"""Extreme materials and moduli: conversions, fits of a spectrum, master curves.

Moduli are computed here term by term in plain sums, and compliances are their inverses, so that
the conversion between the two families is held against arithmetic that it does not use.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from labpipe import materials
from labpipe.arrays import Complexes, Floats
from labpipe.materials import Prony
from tests.extremes.inputs import Random, laid_out
from tests.extremes.outcome import Case, Outcome, silently, worst


def _extreme_terms(random: Random, most: int = 60) -> tuple[float, Floats, Floats]:
    """Draw E_relaxed, weights over twelve decades, times over thirty, some of them equal."""
    count = int(random.integers(0, most + 1))
    relaxed = 10 ** random.uniform(0, 13)
    weight = relaxed * 10 ** random.uniform(-8, 4, count)
    time = 10 ** random.uniform(-18, 12, count)
    if count > 3 and random.random() < 0.3:
        time[1], time[2] = time[0], time[0] * (1.0 + 1e-13)
    return relaxed, weight, time


def _modulus(relaxed: float, weight: Floats, time: Floats, omega: Floats) -> Complexes:
    x = omega[:, None] * time
    # x / (1 + x²) without an overflow of x²
    storage = 1.0 / (1.0 + np.minimum(1.0 / x, 1e150) ** 2)
    loss = 1.0 / (x + 1.0 / x)
    return np.asarray(relaxed + storage @ weight + 1j * (loss @ weight))


def modulus_and_compliance(random: Random) -> Outcome:
    """E* from the terms, J* its inverse; creep terms give the same, and the way back."""
    relaxed, weight, time = _extreme_terms(random)
    material = Prony(relaxed, laid_out(random, weight), laid_out(random, time), nu=0.3)
    omega = 10 ** random.uniform(-15, 20, 12)
    exact = _modulus(relaxed, weight, time, omega)
    found = material.complex_modulus(laid_out(random, omega))
    C, tau = material.creep_terms()
    with np.errstate(over="ignore"):
        compliance = 1.0 / material.E_unrelaxed + (C / (1.0 + 1j * omega[:, None] * tau)).sum(axis=1)
    ordered = bool(np.all(np.diff(tau) > 0.0) and np.all(C > 0.0))
    back = Prony.from_creep(relaxed, C, tau, nu=0.3).complex_modulus(omega)
    limit = 1.0 / material.E_unrelaxed + float(C.sum())
    return worst(
        (_relative(found, exact) / 1e-12, "a modulus by 1e-12"),
        (_relative(compliance * exact, np.ones_like(exact)) / 1e-9, "E* times J* off 1 by 1e-9"),
        (_relative(back, exact) / 1e-6, "the way back by 1e-6"),
        (abs(limit * relaxed - 1.0) / 1e-9, "a long-time compliance by 1e-9"),
        (0.0 if ordered else np.inf, "creep terms out of order or below zero"),
    )


def _relative(found: Complexes, exact: Complexes) -> float:
    """Largest error of either part, relative to the part, down to 1e-3 of the size."""
    floor = 1e-3 * np.abs(exact)
    parts = [
        np.abs(getattr(found - exact, part)) / np.maximum(np.abs(getattr(exact, part)), floor)
        for part in ("real", "imag")
    ]
    return float(np.max(parts))


def creep_and_relaxation(random: Random) -> Outcome:
    """E falls, J rises, their product stays below one, and both meet their limits."""
    relaxed, weight, time = _extreme_terms(random)
    material = Prony(relaxed, weight, time, nu=float(random.uniform(-0.9, 0.5)))
    t = np.concatenate([[0.0], np.sort(10 ** random.uniform(-20, 14, 40))])
    E, J = material.relaxation(t), material.creep(t)
    plain = relaxed + np.exp(-t[:, None] / time) @ weight
    slack = 1e-12
    return worst(
        (float(np.max(np.abs(E / plain - 1.0))) / 1e-11, "a relaxation modulus by 1e-11"),
        (float(np.max(np.diff(E) / E[:-1])) / slack, "a modulus that rises"),
        (float(np.max(-np.diff(J) / J[1:])) / slack, "a compliance that falls"),
        (float(np.max(E * J - 1.0)) / 1e-9, "more than one by E times J"),
        (abs(E[0] * J[0] - 1.0) / 1e-9, "E times J at once off one by 1e-9"),
    )


def _broad(random: Random) -> tuple[float, Floats, Floats]:
    """Draw a material with a term in every half decade, as polymers have."""
    time = 10.0 ** np.arange(-8.0, 6.0, 0.5)
    relaxed = 10 ** random.uniform(3, 9)
    centre, width = random.uniform(-5.0, 3.0), random.uniform(1.0, 3.0)
    weight = np.exp(-0.5 * ((np.log10(time) - centre) / width) ** 2) + 1e-3
    return relaxed, relaxed * 10 ** random.uniform(0.3, 3) * weight / weight.sum(), time


def _sweeps(random: Random) -> tuple[Any, Floats]:
    """Isotherms of a broad material with a smooth law, and their true shifts."""
    count = int(random.integers(3, 6))
    relaxed, weight, time = _broad(random)
    temperature = 20.0 + 10.0 * np.arange(count)
    shift = -np.cumsum(np.concatenate([[0.0], random.uniform(0.4, 1.0, count - 1)]))
    frequency = np.logspace(-1.0, 1.0, 8)
    exact = np.stack([_modulus(relaxed, weight, time, 2 * np.pi * frequency * 10**s) for s in shift])
    noise = 10 ** random.uniform(-4, -2)
    storage = exact.real * (1.0 + noise * random.standard_normal(exact.shape))
    loss = exact.imag * (1.0 + noise * random.standard_normal(exact.shape))
    place = (int(random.integers(0, count)), int(random.integers(0, 8)))
    if random.random() < 0.5:
        storage[place] = loss[place] = np.nan
    order = random.permutation(count)
    dims = ("temperature", "frequency")
    units = {"units": "Pa"}
    sweeps = xr.Dataset(
        {
            "storage": (dims, laid_out(random, storage[order]), units),
            "loss": (dims, laid_out(random, loss[order]), units),
        },
        coords={"temperature": temperature[order], "frequency": frequency},
    )
    return sweeps, shift[order]


def shift_factors(random: Random) -> Outcome:
    """Shifts of unordered isotherms with gaps: right within their own uncertainty."""
    sweeps, shift = _sweeps(random)
    with silently():
        found = materials.master_curve(sweeps, vertical="none", delay=False)
    a, u = found.log10_aT.values, found.u_log10_aT.values
    at = int(np.argmin(np.abs(sweeps["temperature"].values - found.T_ref)))
    error = np.abs(a - (shift - shift[at]))
    return worst(
        (float(np.max(error / (8.0 * u + 0.02))), "a shift by 8 u and 0.02 decades"),
        (0.0 if np.isfinite(a).all() else np.inf, "a shift that is not finite"),
    )


#: Families and how many of their cases the tests try.
FAMILIES: Mapping[str, tuple[Case, int]] = {
    "modulus and compliance": (modulus_and_compliance, 300),
    "creep and relaxation": (creep_and_relaxation, 300),
    "shift factors": (shift_factors, 6),
}
