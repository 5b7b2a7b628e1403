"""Admissibility of Prony terms, and the errors for inadmissible ones.

The thermodynamic conditions of the thesis, (1.8), (1.9), (1.20) and (1.24), reduce for a Prony
series to this: no negative weight, no negative long-time modulus, no negative instantaneous
compliance, positive times.
"""

from fractions import Fraction

import numpy as np
from numpy.typing import ArrayLike

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.materials.prony._interconversion import merged

# Rounding of ΣC against 1/E_relaxed: a smaller remainder counts as none.
_ROUNDING = 4.0 * float(np.finfo(float).eps)
# A weight this small against the whole has no effect in double precision at any time, and the
# squares of its offsets would leave the range of the numbers.
_NEGLIGIBLE = 1e-100


def frozen(values: Floats) -> Floats:
    """Return a read-only copy."""
    copy = np.array(values, dtype=float)
    copy.setflags(write=False)
    return copy


def not_negative(name: str, value: float, units: str) -> None:
    """Refuse a negative or non-finite number."""
    if not (np.isfinite(value) and value >= 0):
        raise InputError(f"{name} = {value} {units}: expected a finite number, not negative")


def checked_terms(
    weight_name: str, time_name: str, weight: ArrayLike, time: ArrayLike, constant: float
) -> tuple[Floats, Floats]:
    """Return merged ascending terms, or say which term is not admissible."""
    weights, times = np.asarray(weight, dtype=float), np.asarray(time, dtype=float)
    if weights.ndim != 1 or weights.shape != times.shape:
        raise InputError(
            f"{weight_name} has shape {weights.shape} and {time_name} {times.shape}: "
            "expected two lists of equal length, one weight and one time per term"
        )
    bad_weight = ~(np.isfinite(weights) & (weights >= 0))
    if bad_weight.any():
        k = int(np.argmax(bad_weight))
        raise InputError(
            f"{weight_name}[{k}] = {weights[k]}: with a negative weight the material would "
            f"return more work than was put in (not admissible); fit the terms with weights ≥ 0"
        )
    bad_time = ~(np.isfinite(times) & (times > 0))
    if bad_time.any():
        k = int(np.argmax(bad_time))
        raise InputError(f"{time_name}[{k}] = {times[k]} s: expected a positive, finite time")
    floor = _NEGLIGIBLE * (constant + float(np.sum(weights)))
    return merged(np.where(weights > floor, weights, 0.0), times)


def instantaneous_compliance(E_relaxed: float, C: Floats) -> float:
    """Return 1/E_relaxed − ΣC without cancellation, exactly zero when it is rounding."""
    exact = 1 / Fraction(E_relaxed) - sum((Fraction(c) for c in C), Fraction(0))
    remainder = float(exact)
    if abs(remainder) * E_relaxed <= _ROUNDING:
        return 0.0
    if remainder < 0:
        raise InputError(
            f"ΣC = {float(np.sum(C)):.6g} 1/Pa exceeds 1/E_relaxed = {1 / E_relaxed:.6g} 1/Pa: "
            "the instantaneous compliance would be negative (not admissible)"
        )
    return remainder


def times(t: ArrayLike) -> Floats:
    """Return times as an array, refusing negative ones."""
    time = np.asarray(t, dtype=float)
    if (time < 0).any():
        raise InputError(f"t = {time.min()} s: the response is defined for t ≥ 0")
    return time


def frequencies(omega: ArrayLike) -> Floats:
    """Return angular frequencies as an array, refusing negative ones."""
    frequency = np.asarray(omega, dtype=float)
    if (frequency < 0).any():
        raise InputError(f"omega = {frequency.min()} rad/s: expected angular frequencies ≥ 0")
    return frequency
