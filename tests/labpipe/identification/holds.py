"""Holds after a ramp, on solids that are not on the fit's grid, and rubbers that the method was not made on.

Forces come from the exact mean of the relaxation function over the ramp; gain and tare are drawn from their stated
uncertainty. Random rubbers are fractional solids (Cole and Cole's, Havriliak and Negami's), no sums of exponentials.
"""

from collections.abc import Callable

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
from pipelines.rig.solids import Element, Viscoelastic

AREA, RAMP = 1.6e-6, 0.1  # m2, elastic force over reduced modulus of the hold; s
_RHO = np.logspace(-5.1, 3.1, 50)
RUBBER = Prony(7.6e6, 4e5 * _RHO**-0.2 * np.exp(-_RHO / 300.0), _RHO, nu=0.5)


def exact_force(solid: Prony | Viscoelastic, lag: np.ndarray) -> np.ndarray:
    """Closed form of a ramp: the integral of the relaxation modulus over it."""
    if isinstance(solid, Viscoelastic):
        end = lag + RAMP
        total = (end * solid.mean_relaxation(end) - lag * solid.mean_relaxation(lag)) / RAMP
    else:
        parts = solid.E * solid.rho / RAMP * np.exp(-lag[:, None] / solid.rho) * -np.expm1(-RAMP / solid.rho)
        total = solid.E_relaxed + parts.sum(axis=1)
    return total * AREA / (1.0 - solid.nu**2)


def hold(
    solid: Prony | Viscoelastic,
    seed: int,
    *,
    shortest: float = 1e-3,
    longest: float = 600.0,
    noise: float = 2e-3,
    gain: float = 5e-3,
    tare: float = 0.0,
    hidden: float = 0.0,
    rho: np.ndarray | None = None,
) -> tuple[Problem, Callable[[np.ndarray], tuple[Evidence, ...]]]:
    """Return a hold with an uncertain gain (and tare [N]), and its evidence for other relaxation times.

    ``hidden``: amplitude of a wave in the force that no relaxation makes.
    """
    rng = np.random.default_rng(seed)
    lag = np.geomspace(shortest, longest, 30 if shortest < 0.1 else 42)
    time = np.concatenate([np.linspace(0.0, RAMP, 41), RAMP + lag])
    area = AREA * np.minimum(time / RAMP, 1.0)
    clean = exact_force(solid, lag) * (1.0 + hidden * np.sin(4.0 * np.log(lag)))
    force = clean * (1.0 + gain * rng.standard_normal()) + tare * rng.standard_normal()
    force += noise * clean * rng.standard_normal(lag.size)
    offsets = ("tare",) if tare else ()

    def rebuilt(rho: np.ndarray) -> tuple[Evidence, ...]:
        basis = lee_radok_basis(time, area, rho, solid.nu)[41:]
        return (force_evidence("hold", lag, force, noise * clean, basis, factors=("gain",), offsets=offsets),)

    spectrum = SmoothSpectrum(relaxation_times(float(lag[0]), float(lag[-1])) if rho is None else rho, solid.nu)
    unknowns = [Parameter("gain", 1.0, gain, "1", "gain", is_nuisance=True)]
    unknowns += [Parameter("tare", 0.0, tare, "N", name, is_nuisance=True) for name in offsets]
    return Problem(spectrum, rebuilt(spectrum.rho), tuple(unknowns)), rebuilt


def random_rubber(seed: int) -> Viscoelastic:
    """Draw a rubber: one dispersion far below a millisecond and two slow ones, skewed for odd seeds.

    Orders of 0.2 to 0.6 are those of secondary and primary dispersions of polymers; skewed ones are drawn a little
    broader on their other side. Centres and strengths over the relaxed modulus are decadic logarithms.
    """
    rng = np.random.default_rng(seed)
    relaxed, parts = 10.0 ** rng.uniform(6.3, 7.5), []
    for centres, strengths in (((-9.0, -5.0), (1.5, 2.5)), *[((-3.0, 3.0), (-1.5, -0.3))] * 2):
        order, skew = rng.uniform(0.2, 0.6), rng.uniform(0.3, 0.8)
        time, strength = 10.0 ** rng.uniform(*centres), relaxed * 10.0 ** rng.uniform(*strengths)
        skewed = (min(order / skew**0.5, 0.8), skew) if seed % 2 else (order,)
        parts.append(Element(strength, time, *skewed))
    return Viscoelastic(tuple(parts), relaxed, 0.5)
