"""How the vertical factor b_T depends on temperature: proportional to it, linear, or quadratic.

A law has at most two numbers. One number per isotherm could imitate half of the horizontal
shifts. The polynomials are those of b_T itself, so that b_T ∝ T is a special case of both:

- ``rho_T``: b = T/T_ref in kelvin, the entropic elasticity of a rubber at constant density;
- ``linear``: b = 1 + β ΔT;  ``quadratic``: b = 1 + β ΔT + γ ΔT².
"""

from typing import Literal

import numpy as np

from labpipe.arrays import Floats
from labpipe.units import ZERO_CELSIUS

Vertical = Literal["none", "rho_T", "linear", "quadratic"]

#: Every law and its number of parameters, simplest first.
VERTICAL_SIZE: dict[Vertical, int] = {"none": 0, "rho_T": 0, "linear": 1, "quadratic": 2}
# ΔT is taken per 100 K, so that the parameters are of order one.
_UNIT = 100.0
# A factor this small means that the law has run away.
_LEAST = 0.02
#: Fastest fall of ln b_T per kelvin that a material can show, and what is left to a sweep's own
#: error: a glass softens by at most 0.6 % per kelvin, a rubber at constant density stiffens as T
#: does. A factor beyond is no vertical shift; it makes up for sweeps that do not superpose.
STEEPEST_FALL, _SLACK = 0.006, 0.1
#: Storage modulus [Pa] above which no reading is of a rubber or a melt: there nothing stiffens as T does.
GLASS = 3e8


def vertical_values(name: Vertical, parameters: Floats, temperature: Floats, T_ref: float) -> Floats | None:
    """Return ln b at temperatures in °C, or None where the law would turn negative."""
    if name == "rho_T":
        return np.asarray(np.log((temperature + ZERO_CELSIUS) / (T_ref + ZERO_CELSIUS)))
    factor = 1.0 + _powers(name, temperature, T_ref) @ parameters
    return None if np.any(factor < _LEAST) else np.asarray(np.log(factor))


def vertical_slopes(name: Vertical, parameters: Floats, temperature: Floats, T_ref: float) -> Floats:
    """Return the derivatives of ln b, (temperature, parameter)."""
    powers = _powers(name, temperature, T_ref)
    return np.asarray(powers / (1.0 + powers @ parameters)[:, None])


def fit_vertical(name: Vertical, ln_bT: Floats, temperature: Floats, T_ref: float) -> Floats:
    """Return the parameters that come nearest to given ln b."""
    powers = _powers(name, temperature, T_ref)
    if not powers.size:
        return np.empty(0)
    return np.asarray(np.linalg.lstsq(powers, np.expm1(ln_bT), rcond=None)[0])


def is_physical(ln_bT: Floats, temperature: Floats, T_ref: float, stiffness: float = 0.0) -> bool:
    """Tell whether vertical factors stay within what the modulus of a material can do.

    ``stiffness`` is the least storage modulus (Pa) of its sweeps.

    Examples
    --------
    >>> celsius = np.array([-40.0, 20.0, 80.0])
    >>> is_physical(vertical_values("rho_T", np.empty(0), celsius, 20.0), celsius, 20.0)
    True
    >>> is_physical(np.log([1.8, 1.0, 1.3]), celsius, 20.0)
    False
    >>> is_physical(np.log([0.95, 1.0, 1.2]), celsius, 20.0, stiffness=2e9)
    False
    """
    step = temperature - T_ref
    rise = 0.0 if stiffness > GLASS else np.log((temperature + ZERO_CELSIUS) / (T_ref + ZERO_CELSIUS))
    highest = np.where(step > 0, rise, -STEEPEST_FALL * step) + _SLACK
    lowest = np.where(step > 0, -STEEPEST_FALL * step, rise) - _SLACK
    return bool(np.all((ln_bT <= highest) & (ln_bT >= lowest)))


def _powers(name: Vertical, temperature: Floats, T_ref: float) -> Floats:
    step = (temperature - T_ref) / _UNIT
    return np.stack([step, step**2], axis=1)[:, : VERTICAL_SIZE[name]]
