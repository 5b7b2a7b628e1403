r"""Consistency of storage and loss modulus by the Kramers-Kronig relations.

Causality ties E′(ω) and E″(ω): one non-negative spectrum must describe both. It is fitted to one modulus alone,
predicts the other, and the misfit of a common fit is compared with those of either alone. A material that slips, a
clamp that yields, a delayed phase, or sweeps that do not superpose show up here.

References
----------
Booij & Thoone, Rheol. Acta 21 (1982) 15, doi:10.1007/BF01520701.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.materials.spectrum._spectrum import Grid, compress, make_grid, moduli_of_terms, solve_by_cross_validation

Verdict = Literal["pass", "warn", "fail"]

#: Misfit of a common fit over that of either modulus, or of every sweep, alone: limits of pass and warn.
PASS_RATIO, WARN_RATIO = 1.5, 3.0
#: Relative misfit of the common fit, of the worse modulus: a pass or a warning is none beyond. Where
#: both moduli are that rough by themselves, they are too rough to judge.
PASS_MISFIT, WARN_MISFIT = 0.1, 0.3
#: Share of the logarithmic frequency window, about its middle, where predictions are compared;
#: near the ends one modulus cannot know what lies beyond.
MIDDLE_SHARE = 0.7
# No instrument is better than this (relative); smaller misfits are not distinguished.
_LEAST_MISFIT = 1e-3
#: Below this number of points per modulus a spectrum can follow anything.
LEAST_POINTS = 8


@dataclass(frozen=True, slots=True)
class KramersKronig:
    """Verdict of the cross-prediction, with its reason in one sentence.

    ``ratio`` is the larger of the two ratios of misfits (common fit over own fit); ``error_of_loss`` and
    ``error_of_storage`` are the root mean square relative errors of the modulus predicted from the other one, in the
    middle of the window.
    """

    verdict: Verdict
    ratio: float
    reason: str
    error_of_loss: float
    error_of_storage: float


def kramers_kronig(frequency: ArrayLike, storage: ArrayLike, loss: ArrayLike) -> KramersKronig:
    """Judge if two moduli over frequency can be those of one linear material.

    Parameters
    ----------
    frequency : array (point,) [Hz]
        In any order; of a master curve the reduced frequencies.
    storage, loss : array (point,) [Pa]
        Positive.

    Raises
    ------
    InputError
        Lengths differ, or a value is not positive and finite.

    Examples
    --------
    >>> f = np.logspace(-2, 2, 40)
    >>> x = 2 * np.pi * f
    >>> kramers_kronig(f, 1 + x**2 / (1 + x**2), x / (1 + x**2)).verdict
    'pass'
    """
    arrays = [np.asarray(a, dtype=float) for a in (frequency, storage, loss)]
    if any(a.ndim != 1 or a.shape != arrays[0].shape for a in arrays):
        raise InputError(
            f"frequency, storage and loss have shapes {[a.shape for a in arrays]}; expected three lists of one length"
        )
    for name, values in zip(("frequency", "storage", "loss"), arrays, strict=True):
        bad = ~(np.isfinite(values) & (values > 0))
        if bad.any() or values.size == 0:
            found = values[bad][0] if bad.any() else "nothing"
            raise InputError(f"{name}: found {found}, expected positive, finite values")
    order = np.argsort(arrays[0], kind="stable")
    f, first, second = (a[order] for a in arrays)
    ln_omega, values = np.log(2.0 * np.pi * f), np.concatenate([first, second])
    grid = make_grid(ln_omega, first, second)
    alone, misfit_alone, smoothing = _fit(ln_omega, grid, values, (1.0, np.inf))
    lossy, misfit_lossy, smoother = _fit(ln_omega, grid, values, (np.inf, 1.0), smoothing)
    noise = max(misfit_alone[0], _LEAST_MISFIT), max(misfit_lossy[1], _LEAST_MISFIT)
    # The same smoothing in units of the noise: a start to walk from.
    near = float(np.sqrt(smoothing * smoother)) / (noise[0] * noise[1])
    common = _fit(ln_omega, grid, values, noise, near)[1]
    # The loss says nothing of the relaxed modulus: the constant that fits the storage best.
    relative = 1.0 / first**2
    storage_from_loss = lossy[: f.size] + float(np.sum((first - lossy[: f.size]) * relative) / np.sum(relative))
    ratio = max(common[0] / noise[0], common[1] / noise[1])
    margin = 0.5 * (1.0 - MIDDLE_SHARE) * np.ptp(ln_omega)
    middle = (ln_omega >= ln_omega.min() + margin) & (ln_omega <= ln_omega.max() - margin)
    errors = _rms((alone[f.size :] / second - 1.0)[middle]), _rms((storage_from_loss / first - 1.0)[middle])
    misfit = max(common)
    reason = (
        f"the common fit misses by {100 * misfit:.2g} %, {ratio:.2f} times the misfit of either modulus alone; "
        f"predicted from each other they agree within {100 * errors[0]:.1f} % (loss) and "
        f"{100 * errors[1]:.1f} % (storage)"
    )
    verdict: Verdict = "warn" if ratio <= WARN_RATIO and misfit <= WARN_MISFIT else "fail"
    if ratio <= PASS_RATIO and misfit <= PASS_MISFIT:
        verdict = "pass"
    if f.size < LEAST_POINTS:
        verdict, reason = "warn", f"only {f.size} points: too few for a verdict; {reason}"
    return KramersKronig(verdict, ratio, reason, *errors)


def _fit(
    ln_omega: Floats, grid: Grid, values: Floats, noise: tuple[float, float], near: float | None = None
) -> tuple[Floats, list[float], float]:
    """Fit one spectrum to storage and loss (2 point,) of relative noise; infinite noise leaves a modulus out.

    Returned are both moduli of the fit, their relative misfits, and the smoothing.
    """
    design = moduli_of_terms(ln_omega, grid.ln_time) * grid.scale
    target = 1.0 / np.repeat(noise, ln_omega.size)
    count = int(np.count_nonzero(target))
    system = compress(design * (target / values)[:, None], target)
    solution = solve_by_cross_validation(*system, grid.penalty, count, near)
    fitted = design @ solution.coefficient
    root = float(np.sqrt(1.0 - min(solution.freedom / count, 0.9)))
    return fitted, [_rms(part) / root for part in np.split(fitted / values - 1.0, 2)], solution.strength


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")
