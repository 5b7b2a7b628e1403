r"""Relaxation and creep over time as moduli over frequency: one spectrum, taken at both.

A stress relaxation :math:`E(t) = E_\infty + \sum E_i e^{-t/\rho_i}` and a sweep hold the same
spectrum. It is fitted to the readings over time with weights that are not negative and a
smoothness chosen by cross-validation, as to sweeps; a creep compliance is fitted by retardation
terms, from which the relaxation terms follow exactly. Moduli are given at frequencies
:math:`\omega = 1/t` inside the times that were measured, where the spectrum is determined.

References
----------
Ferry, Viscoelastic Properties of Polymers, 3rd ed., Wiley, 1980, ch. 3.
"""

import numpy as np
from numpy.typing import ArrayLike

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.materials.prony import Prony, Retardation, relaxation_from_creep
from labpipe.materials.spectrum._spectrum import (
    TERMS_PER_DECADE,
    compress,
    second_differences,
    solve_by_cross_validation,
)

_LEAST = 8  # readings over time
_WITHIN = 0.5  # decades inside the measured times at either end, where a frequency is trusted
_MARGIN = 1.5  # decades of terms beyond the measured times
_PER_DECADE = 5  # frequencies, on a grid that all temperatures share


def prony_of_relaxation(time: ArrayLike, modulus: ArrayLike, nu: float = 0.5) -> Prony:
    """Fit a relaxation modulus over time.

    Parameters
    ----------
    time : array (reading,) [s]
        Since the step, positive; in any order.
    modulus : array (reading,) [Pa]
        Relaxation modulus, positive.
    nu : float
        Poisson's ratio, handed on.

    Raises
    ------
    InputError
        There are too few readings, or times or moduli are not positive.

    Examples
    --------
    >>> t = np.geomspace(0.1, 100, 60)
    >>> found = prony_of_relaxation(t, 1e6 + 1e6 * np.exp(-t / 3.0))
    >>> bool(np.allclose(found.relaxation(t), 1e6 + 1e6 * np.exp(-t / 3.0), rtol=0.02))
    True
    """
    t, E = _checked(time, modulus, "modulus")
    rho = _times(t)
    columns = np.column_stack([np.exp(-t[:, None] / rho), np.ones(t.size)])
    weight = _fitted(columns, E, rho.size)
    return Prony(weight[-1], weight[:-1], rho, nu)


def prony_of_creep(time: ArrayLike, compliance: ArrayLike, nu: float = 0.5) -> Prony:
    """Fit a creep compliance over time.

    Parameters
    ----------
    time : array (reading,) [s]
        Since the step, positive; in any order.
    compliance : array (reading,) [1/Pa]
        Creep compliance, positive.
    nu : float
        Poisson's ratio, handed on.

    Raises
    ------
    InputError
        There are too few readings, or times or compliances are not positive.
    """
    t, J = _checked(time, compliance, "compliance")
    tau = _times(t)
    columns = np.column_stack([-np.expm1(-t[:, None] / tau), np.ones(t.size), t / t.max()])
    weight = _fitted(columns, J, tau.size)
    C, instant, flow = weight[: tau.size], weight[tau.size], weight[tau.size + 1] / t.max()
    if instant <= 0:  # what yields before the first reading is instantaneous for these readings
        first = int(np.flatnonzero(C > 0)[0])
        instant, C[first] = C[first], 0.0
    kept = C > 0
    family = relaxation_from_creep(Retardation(float(instant), C[kept], tau[kept], float(flow)))
    return Prony(family.relaxed, family.weight, family.time, nu, family.viscosity)


def frequencies_of(time: ArrayLike) -> Floats:
    """Return the frequencies [Hz] at which readings over time [s] determine the moduli.

    They lie on a grid that all temperatures share, half a decade inside the measured times.

    Examples
    --------
    >>> found = frequencies_of([0.01, 100.0])
    >>> float(found[0].round(4)), float(found[-1].round(2))
    (0.0063, 3.98)
    """
    t = np.asarray(time, dtype=float)
    low = -np.log10(2.0 * np.pi * t.max()) + _WITHIN
    high = -np.log10(2.0 * np.pi * t.min()) - _WITHIN
    first, last = int(np.ceil(low * _PER_DECADE)), int(np.floor(high * _PER_DECADE))
    return np.asarray(10.0 ** (np.arange(first, last + 1) / _PER_DECADE))


def _checked(time: ArrayLike, values: ArrayLike, name: str) -> tuple[Floats, Floats]:
    t, y = np.asarray(time, dtype=float), np.asarray(values, dtype=float)
    good = np.isfinite(t) & np.isfinite(y) & (t > 0)
    t, y = t[good], y[good]
    if t.size < _LEAST or np.ptp(np.log10(t)) < 2 * _WITHIN:
        raise InputError(
            f"found {t.size} readings after the step"
            f"{f', from {t.min():.3g} to {t.max():.3g} s' if t.size else ''}; a spectrum needs {_LEAST} over a decade"
        )
    if (y <= 0).any():
        message = f"the {name} is zero or negative at {int((y <= 0).sum())} of {y.size} times; expected positive values"
        raise InputError(message)
    order = np.argsort(t, kind="stable")
    return t[order], y[order]


def _times(t: Floats) -> Floats:
    """Lay terms over the measured times and beyond, where the tails of faster and slower ones come from."""
    low, high = np.log10(t[0]) - _MARGIN, np.log10(t[-1]) + _MARGIN
    return np.logspace(low, high, int(np.ceil((high - low) * TERMS_PER_DECADE)) + 1)


def _fitted(columns: Floats, measured: Floats, terms: int) -> Floats:
    """Return weights that are not negative, smooth over the terms, by relative residuals."""
    scale = np.full(columns.shape[1], float(np.median(measured)))
    rows = columns * scale / measured[:, None]
    penalty = second_differences(terms, scale.size, TERMS_PER_DECADE)
    system = compress(rows, np.ones(measured.size))
    found = solve_by_cross_validation(*system, penalty, measured.size)
    return found.coefficient * scale
