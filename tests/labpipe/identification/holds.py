"""A synthetic relaxation: force of a ramp and hold on a solid that is not on the fit's grid."""

import numpy as np

from labpipe.identification import (
    Evidence,
    Parameter,
    Problem,
    SmoothSpectrum,
    force_evidence,
    lee_radok_basis,
    relaxation_times,
)
from labpipe.materials import Prony

AREA = 1.6e-6  # m2, elastic force over reduced modulus of the hold
_RHO = np.logspace(-5.1, 3.1, 50)
RUBBER = Prony(7.6e6, 4e5 * _RHO**-0.2 * np.exp(-_RHO / 300.0), _RHO, nu=0.5)


def history(longest: float) -> tuple[np.ndarray, np.ndarray]:
    time = np.concatenate([np.linspace(0.0, 0.1, 21), 0.1 + np.geomspace(1e-3, longest, 60)])
    return time, AREA * np.minimum(time / 0.1, 1.0)


def exact_force(solid: Prony, lag: np.ndarray) -> np.ndarray:
    """Closed form of a ramp of 0.1 s: the integral of the relaxation modulus over the ramp."""
    total = np.full(lag.size, solid.E_relaxed)
    for weight, rho in zip(solid.E, solid.rho, strict=True):
        total += weight * rho / 0.1 * np.exp(-lag / rho) * -np.expm1(-0.1 / rho)
    return total * AREA / (1 - solid.nu**2)


def hold_problem(
    seed: int, *, longest: float = 600.0, relative: float = 2e-3, gain: float = 5e-3, rho: np.ndarray | None = None
) -> Problem:
    """A hold with noise and a gain that is only known to ``gain``."""
    rng = np.random.default_rng(seed)
    time, area = history(longest)
    lag = time[22::2] - 0.1
    clean = exact_force(RUBBER, lag)
    force = clean * (1 + gain * rng.standard_normal()) * (1 + relative * rng.standard_normal(lag.size))
    rho = relaxation_times(float(lag[0]), float(lag[-1])) if rho is None else rho
    spectrum = SmoothSpectrum(rho, 0.5)
    basis = lee_radok_basis(time, area, spectrum.rho, 0.5)[22::2]
    evidence = force_evidence("hold", lag, force, relative * clean, basis, factors=("gain",))
    return Problem(spectrum, (evidence,), (Parameter("gain", 1.0, gain, "1", "gain", is_nuisance=True),))


def with_values(evidence: Evidence, values: np.ndarray) -> Evidence:
    group = evidence.groups[0]
    changed = type(group)(group.name, values, group.u, group.axis, group.units, group.axis_name, group.axis_units)
    return Evidence(evidence.name, (changed,), evidence.model, evidence.is_prior)
