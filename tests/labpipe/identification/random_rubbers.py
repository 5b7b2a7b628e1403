"""Random rubbers whose relaxation is no sum of exponentials, and their identification from one hold.

The truths do not come from the prior: fractional solids (Cole and Cole's, Havriliak and Negami's) with
orders and strengths as published of polymers. Forces of a hold come from the exact mean of the relaxation
function over a ramp; gain and tare are drawn from their stated uncertainty. The bound is van Trees's: the
inverse of the information of the data and of the prior.
"""

from typing import NamedTuple

import numpy as np

from labpipe import identification
from labpipe.arrays import Floats
from labpipe.identification._posterior import ln_moduli
from labpipe.uncertainty import propagated_u
from pipelines.rig.solids import Element, Viscoelastic

_RAMP, _HOLD, _AREA = 0.1, 600.0, 1.6e-6  # s, s, m2
_NOISE, _GAIN, _TARE = 2e-3, 5e-3, 5e-3  # relative, relative, N
FREQUENCIES = np.array([3e-3, 3e-2, 3e-1])  # Hz


class Trial(NamedTuple):
    """Errors over their uncertainty, and uncertainties over their bound, of storage modulus and loss factor."""

    deviations: Floats
    widths: Floats
    holds_long_time_modulus: bool


def random_rubber(seed: int) -> Viscoelastic:
    """Draw a rubber; its dispersions, one far below a millisecond and two slow ones, are skewed for odd seeds."""
    rng = np.random.default_rng(seed)
    relaxed = 10.0 ** rng.uniform(6.3, 7.5)
    ranges = [((-9.0, -5.0), (1.5, 2.5)), *[((-3.0, 3.0), (-1.5, -0.3))] * 2]
    parts = tuple(_dispersion(relaxed, rng, *of, is_skewed=seed % 2 == 1) for of in ranges)
    return Viscoelastic(parts, relaxed, 0.5)


def _dispersion(
    relaxed: float,
    rng: np.random.Generator,
    centres: tuple[float, float],
    strengths: tuple[float, float],
    *,
    is_skewed: bool,
) -> Element:
    """Return a random dispersion; centres and strengths over ``relaxed`` are decadic logarithms.

    Secondary and primary dispersions of polymers have orders of 0.2 to 0.6; skewed ones are drawn
    a little broader on their other side.
    """
    order, skew = rng.uniform(0.2, 0.6), rng.uniform(0.3, 0.8)
    time, strength = 10.0 ** rng.uniform(*centres), relaxed * 10.0 ** rng.uniform(*strengths)
    return Element(strength, time, min(order / skew**0.5, 0.8), skew) if is_skewed else Element(strength, time, order)


def hold_trial(seed: int) -> Trial:
    """Identify one rubber from a hold with an uncertain gain and zero."""
    solid = random_rubber(seed)
    rng = np.random.default_rng(seed + 1)
    lag = np.geomspace(0.2, _HOLD, 42)
    end = lag + _RAMP
    clean = (end * solid.mean_relaxation(end) - lag * solid.mean_relaxation(lag)) / _RAMP
    clean *= _AREA / (1.0 - solid.nu**2)
    u = _NOISE * clean
    force = clean * (1.0 + _GAIN * rng.standard_normal()) + _TARE * rng.standard_normal()
    force += u * rng.standard_normal(lag.size)
    data = float(lag[0]), float(lag[-1])
    spectrum = identification.SmoothSpectrum(identification.relaxation_times(*data), solid.nu)
    time = np.concatenate([np.linspace(0.0, _RAMP, 41), _RAMP + lag])
    area = _AREA * np.minimum(time / _RAMP, 1.0)

    def rebuilt(rho: Floats) -> tuple[identification.Evidence, ...]:
        basis = identification.lee_radok_basis(time, area, rho, solid.nu)[41:]
        return (identification.force_evidence("hold", lag, force, u, basis, factors=("gain",), offsets=("tare",)),)

    unknowns = (
        identification.Parameter("gain", 1.0, _GAIN, "1", "gain", is_nuisance=True),
        identification.Parameter("tare", 0.0, _TARE, "N", "tare", is_nuisance=True),
    )
    known = identification.infer(identification.Problem(spectrum, rebuilt(spectrum.rho), unknowns), rebuilt)
    found, exact = identification.moduli(known, FREQUENCIES), solid.modulus(FREQUENCIES)
    value = np.concatenate([found.storage, found.loss_factor])
    u = np.concatenate([found.u_ln_storage, found.u_ln_loss_factor])
    by_xi = ln_moduli(known.fit.problem.spectrum, known.fit.xi, 2.0 * np.pi * FREQUENCIES)[1]
    bound = propagated_u(by_xi, known.covariance)
    deviations = np.log(value / np.concatenate([exact.real, exact.imag / exact.real])) / u
    relaxed = identification.long_time_modulus(known)
    return Trial(deviations, u / bound, relaxed.low <= solid.relaxed <= relaxed.high)
