r"""Elastic periodic line contact of a half-plane, in closed form: cosine and parabola.

Per unit depth, for a reduced modulus E* = E/(1 − ν²), s = sin(πa/λ), a the contact *half* width; the approach is
relative to the mean surface.

Cosine h (1 − cos(2πx/λ)) (Westergaard):

.. math::
    \delta = h s^2 (1 - \ln s^2), \quad P = \pi E^* h s^2, \quad
    p = \frac{2\bar p \cos(\pi x/\lambda)}{s^2} \sqrt{s^2 - \sin^2(\pi x/\lambda)} .

Parabola x²/(2R), from the flat punch's stiffness S(b) = −(π/2)/ln sin(πb/λ) by superposition:

.. math::
    \delta = \frac{\lambda^2}{4\pi^2 R} \Big[\frac{\pi^2}{6} - Li_2(1 - s^2)\Big], \quad
    P = -\frac{E^* \lambda^2}{2\pi R} \ln\cos\frac{\pi a}{\lambda}, \quad
    p = \frac{E^* \lambda}{2\pi R}\,
        artanh\frac{\sqrt{s^2 - \sin^2(\pi x/\lambda)}}{\cos(\pi x/\lambda)} .

References
----------
.. [1] H. M. Westergaard, Bearing pressures and cracks, J. Appl. Mech. 6 (1939) A49.
.. [2] K. L. Johnson, Contact Mechanics, Cambridge 1985, section 13.2,
   https://doi.org/10.1017/CBO9781139171731.
"""

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import spence

from labpipe.arrays import Floats
from labpipe.errors import InputError

Profile = Literal["cosine", "parabola"]

_BELOW_ONE = float(np.nextafter(1.0, 0.0))


class LineContact(NamedTuple):
    """Half width, approach [m], force [N/m] per tip and unit depth, peak pressure [Pa], of one shape."""

    half_width: Floats
    displacement: Floats
    force: Floats
    peak_pressure: Floats


def cosine_amplitude(tip_radius: float, period: float) -> float:
    """Amplitude h = λ²/(4π²R) of the cosine with curvature 1/R at its tips, thesis eq. (2.20)."""
    return period**2 / (4.0 * np.pi**2 * tip_radius)


def from_half_width(
    half_width: ArrayLike, tip_radius: float, period: float, reduced_modulus: float = 1.0, profile: Profile = "parabola"
) -> LineContact:
    """Force, approach and peak pressure that belong to a contact half width.

    Parameters
    ----------
    half_width : array [m]
        0 to below half a period (the cosine: up to half a period).
    tip_radius, period : float [m]
        R and λ.
    reduced_modulus : float [Pa]
        E* = E/(1 − ν²).
    profile : {"parabola", "cosine"}
        Shape of the tips; the cosine has the amplitude h = λ²/(4π²R).

    Raises
    ------
    InputError
        A half width is negative, not a number, or the contact is full.

    Examples
    --------
    >>> state = from_half_width(0.25, 1.0, 1.0)
    >>> round(float(state.force), 12), round(float(state.displacement), 12)
    (0.055158900038, 0.02691834184)
    """
    if profile not in ("cosine", "parabola"):
        raise InputError(f'no closed form for the profile "{profile}"; use "parabola" or "cosine"')
    a = np.asarray(half_width, dtype=float)
    if not np.all((a >= 0.0) & (a < 0.5 * period)):
        raise InputError(f"half widths of a periodic contact lie from 0 to below half a period, found {a}")
    angle = np.pi * a / period
    s2 = np.sin(angle) ** 2
    if profile == "cosine":
        h = cosine_amplitude(tip_radius, period)
        with np.errstate(divide="ignore", invalid="ignore"):
            approach = np.where(s2 > 0.0, h * s2 * (1.0 - np.log(s2)), 0.0)
        peak = 2.0 * np.pi * reduced_modulus * h / period * np.sin(angle)
        return LineContact(a, approach, np.pi * reduced_modulus * h * s2, peak)
    approach = period**2 / (4.0 * np.pi**2 * tip_radius) * _dilogarithm_rest(s2)
    scale = reduced_modulus * period / (2.0 * np.pi * tip_radius)
    force = -0.5 * scale * period * np.log1p(-np.minimum(s2, _BELOW_ONE))
    peak = scale * np.arctanh(np.minimum(np.sin(angle), _BELOW_ONE))
    return LineContact(a, approach, force, peak)


def from_displacement(
    displacement: ArrayLike,
    tip_radius: float,
    period: float,
    reduced_modulus: float = 1.0,
    profile: Profile = "parabola",
) -> LineContact:
    """Contact at an approach [m]; none below zero.

    Raises
    ------
    InputError
        The approach closes the period (λ²/(24R) for the parabola, h for the cosine) or is NaN.

    Examples
    --------
    >>> state = from_displacement(0.02691834184017, 1.0, 1.0)
    >>> round(float(state.half_width), 10)
    0.25
    """
    approach = np.asarray(displacement, dtype=float)
    full = full_contact(tip_radius, period, profile)
    if not np.all(approach < full):
        reason = f"closes the period: a half-plane takes less than {full * 1e6:.4g} µm"
        raise InputError(f"an approach of {approach.max() * 1e6:.4g} µm {reason}")

    # Bisection in ln(a/(λ/2 − a)), from one end of double precision to the other.
    low, high = np.full(approach.shape, -350.0), np.full(approach.shape, 350.0)
    half_width = np.zeros(approach.shape)
    for _ in range(80):
        middle = 0.5 * (low + high)
        half_width = np.minimum(0.5 * period / (1.0 + np.exp(-middle)), np.nextafter(0.5 * period, 0.0))
        below = from_half_width(half_width, tip_radius, period, 1.0, profile).displacement < approach
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return from_half_width(np.where(approach > 0.0, half_width, 0.0), tip_radius, period, reduced_modulus, profile)


def pressure(
    x: ArrayLike,
    half_width: float,
    tip_radius: float,
    period: float,
    reduced_modulus: float = 1.0,
    profile: Profile = "parabola",
) -> Floats:
    """Contact pressure [Pa] at positions ``x`` [m] from the tip's centre; 0 outside the contact.

    Examples
    --------
    >>> float(np.round(pressure(0.0, 0.1, 1.0, 1.0), 12))
    0.050843361108
    """
    angle = np.pi * np.asarray(x, dtype=float) / period
    s2 = float(np.sin(np.pi * half_width / period) ** 2)
    inside = np.maximum(s2 - np.sin(angle) ** 2, 0.0)
    cosine = np.abs(np.cos(angle))
    if profile == "cosine":
        h = cosine_amplitude(tip_radius, period)
        return np.asarray(2.0 * np.pi * reduced_modulus * h / period * cosine * np.sqrt(inside))
    ratio = np.where(inside > 0.0, np.sqrt(inside) / np.maximum(cosine, 1e-300), 0.0)
    scale = reduced_modulus * period / (2.0 * np.pi * tip_radius)
    return np.asarray(scale * np.arctanh(np.minimum(ratio, 1.0)))


def full_contact(tip_radius: float, period: float, profile: Profile = "parabola") -> float:
    """Approach [m] at which the contact of a half-plane closes over the period."""
    if profile == "cosine":
        return cosine_amplitude(tip_radius, period)
    return period**2 / (24.0 * tip_radius)


def _dilogarithm_rest(z: Floats) -> Floats:
    """π²/6 − Li2(1 − z) = ln z ln(1 − z) + Li2(z), to full relative accuracy from z = 0 on."""
    small = np.minimum(z, 0.05)
    series = np.zeros_like(z)
    for n in range(12, 0, -1):
        series = small * (series + 1.0 / n**2)
    logarithm = np.log(np.maximum(small, np.finfo(float).tiny))
    near = logarithm * np.log1p(-small) + series
    # spence(z) is the dilogarithm of 1 − z.
    return np.where(z < 0.05, near, np.pi**2 / 6.0 - spence(z))
