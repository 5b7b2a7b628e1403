r"""Dynamic stiffness, dissipated work and the tapping front of a harmonic indentation.

Thesis eqs. (2.17)-(2.34): around the equilibrium contact of a cosine (half width a₀, s₀ =
sin(πa₀/λ), amplitude h = λ²/(4π²R)) an oscillation α of the displacement changes the force as a
flat punch of the width a₀ would,

.. math::
    \hat\kappa(\omega) = \frac{\pi E^*(\omega)}{2 \ln(1/s_0)}, \qquad
    W = \pi\, \mathrm{Im}\,\hat\kappa(\omega)\, \alpha^2, \qquad
    \alpha_c(\omega) = \frac{E_{relaxed}\,(\Delta_0 - h s_0^2)}{|E(\omega)|} .

Corrections to the text. The critical amplitude α_c *falls* as the frequency rises, because |E|
rises: from about Δ₀ at rest to about Δ₀/β, β = E_unrelaxed/E_relaxed (the sentence after 2.34 says
the opposite). E* = E/(1 − ν²) enters the stiffness; it cancels in α_c.

The theory keeps the contact width; it is the limit of small α. Beyond α_c the indenter taps.
"""

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from labpipe.arrays import Complexes, Floats
from labpipe.contact.line.westergaard import cosine_amplitude, from_displacement
from labpipe.errors import InputError
from labpipe.materials import Prony


def _relaxed_square(material: Prony, tip_radius: float, period: float, mean_indentation: float) -> float:
    """s₀² = sin²(πa₀/λ) of the fully relaxed contact at a mean indentation Δ₀ [m], eq. (2.17)."""
    if not (np.isfinite(mean_indentation) and mean_indentation > 0.0):
        raise InputError(f"the mean indentation is {mean_indentation} m, expected a positive length")
    if material.is_liquid:
        raise InputError("the material flows (E_relaxed is 0): it has no equilibrium contact")
    state = from_displacement(mean_indentation, tip_radius, period, 1.0, "cosine")
    return float(np.sin(np.pi * state.half_width / period) ** 2)


def dynamic_stiffness(
    material: Prony, frequency: ArrayLike, mean_indentation: float, tip_radius: float, period: float, depth: float = 1.0
) -> Complexes:
    """Complex contact stiffness κ̂(ω) [N/m], eqs. (2.24) and (2.25).

    Parameters
    ----------
    frequency : array [Hz]
        f = ω/2π, not negative.
    mean_indentation : float [m]
        Δ₀, above 0 and below h = λ²/(4π²R).
    tip_radius, period : float [m]
        R and λ.
    depth : float [m]
        Out-of-plane contact length, summed over the tips.

    Returns
    -------
    array of complex [N/m]
        The shape of ``frequency``.

    Raises
    ------
    InputError
        A length is not positive, the contact would be full, or the material is a liquid.

    Examples
    --------
    >>> rubber = Prony(7.6e6, [76e6], [1e-3], nu=0.5)
    >>> stiffness = dynamic_stiffness(rubber, [0.0, 1.0, 1e9], 1e-4, 2e-3, 8e-3)
    >>> float(np.round(stiffness[2].real / stiffness[0].real, 6))
    11.0
    """
    square = _relaxed_square(material, tip_radius, period, mean_indentation)
    modulus = material.complex_modulus(2.0 * np.pi * np.asarray(frequency, dtype=float), "contact")
    return np.asarray(depth * np.pi * modulus / -np.log(square))  # 2 ln(1/s) = -ln(s²)


def dissipated_work(
    material: Prony,
    frequency: ArrayLike,
    amplitude: ArrayLike,
    mean_indentation: float,
    tip_radius: float,
    period: float,
    depth: float = 1.0,
    *,
    beyond: Literal["formula", "nan"] = "formula",
) -> Floats:
    """Work dissipated in one cycle, W = π Im κ̂(ω) α² [J], eq. (2.31).

    Parameters
    ----------
    amplitude : array [m]
        α, not negative; broadcast against ``frequency``.
    beyond : {"formula", "nan"}
        Values beyond the tapping front, where the theory does not hold.

    Returns
    -------
    array [J]
        The broadcast shape of ``frequency`` and ``amplitude``.

    Raises
    ------
    InputError
        An amplitude is negative or NaN, or as for :func:`dynamic_stiffness`.

    See Also
    --------
    dynamic_stiffness : the other parameters.

    Examples
    --------
    >>> rubber = Prony(7.6e6, [76e6], [1e-3], nu=0.5)
    >>> work = dissipated_work(rubber, 2.0, [1e-5, 2e-5], 1e-4, 2e-3, 8e-3, 18e-3)
    >>> float(work[1] / work[0])
    4.0
    """
    alpha = np.asarray(amplitude, dtype=float)
    if not np.all(alpha >= 0.0):
        raise InputError(f"amplitudes are numbers from 0 m up, found {alpha}")
    stiffness = dynamic_stiffness(material, frequency, mean_indentation, tip_radius, period, depth)
    work = np.pi * stiffness.imag * alpha**2
    if beyond == "nan":
        front = tapping_amplitude(material, frequency, mean_indentation, tip_radius, period)
        work = np.where(alpha <= front, work, np.nan)
    return np.asarray(work)


def dissipated_power(
    material: Prony, time: ArrayLike, displacement: ArrayLike, tip_radius: float, period: float, depth: float = 1.0
) -> float:
    """Mean power [W] that a recorded oscillation dissipates, by its spectrum: eqs. (2.26)-(2.30).

    The power of force and velocity is summed over the lines of the displacement's spectrum,
    ``sum omega Im kappa(omega) |x(omega)|^2 / 2``, each with the stiffness at its own frequency.

    Parameters
    ----------
    time : array (n,) [s]
        Even, over whole cycles: the sample after the last would be the first again.
    displacement : array (n,) [m]
        Approach from first touch, positive into the surface; its mean is the mean indentation.
    tip_radius, period, depth : float [m]
        As for :func:`dynamic_stiffness`.

    Raises
    ------
    InputError
        The record is short, uneven or not finite, or as for :func:`dynamic_stiffness`.
    """
    t, x = np.asarray(time, dtype=float), np.asarray(displacement, dtype=float)
    if t.ndim != 1 or t.shape != x.shape or t.size < 8 or not np.isfinite(x).all():
        raise InputError(f"time has shape {t.shape}, displacement {x.shape}: expected 8 or more finite samples of both")
    interval = np.diff(t)
    if not (interval.min() > 0.0 and np.allclose(interval, interval.mean(), rtol=5e-4, atol=0.0)):
        raise InputError(f"the samples are uneven ({interval.min():.4g} to {interval.max():.4g} s apart); resample")
    frequency = np.fft.rfftfreq(t.size, float(interval.mean()))[1:]
    line = 2.0 * np.abs(np.fft.rfft(x)[1:]) / t.size
    if t.size % 2 == 0:
        line[-1] *= 0.5
    stiffness = dynamic_stiffness(material, frequency, float(x.mean()), tip_radius, period, depth)
    return float(np.sum(np.pi * frequency * stiffness.imag * line**2))


def tapping_amplitude(
    material: Prony, frequency: ArrayLike, mean_indentation: float, tip_radius: float, period: float
) -> Floats:
    """Amplitude α(ω) [m] at which the indenter starts to leave the surface, eqs. (2.33), (2.34).

    See Also
    --------
    dynamic_stiffness : the parameters, and what is refused.

    Examples
    --------
    >>> rubber = Prony(7.6e6, [76e6], [1e-3], nu=0.5)
    >>> slow, fast = tapping_amplitude(rubber, [0.0, 1e9], 1e-4, 2e-3, 8e-3)
    >>> float(np.round(slow / fast, 6))
    11.0
    """
    square = _relaxed_square(material, tip_radius, period, mean_indentation)
    reserve = mean_indentation - cosine_amplitude(tip_radius, period) * square
    omega = 2.0 * np.pi * np.asarray(frequency, dtype=float)
    return np.asarray(material.E_relaxed * reserve / np.abs(material.complex_modulus(omega)))


def dimensionless_work(work: ArrayLike, material: Prony, tip_radius: float, period: float, depth: float) -> Floats:
    """Return W̃ = W/(E_relaxed λ R d) of a work [J] on a contact length d [m]; in eq. (2.40) W is per unit of d."""
    return np.asarray(work, dtype=float) / (material.E_relaxed * period * tip_radius * depth)
