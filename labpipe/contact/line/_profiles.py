"""Shapes of a periodic indenter."""

import numpy as np

from labpipe.arrays import Floats
from labpipe.errors import InputError

PROFILES: tuple[str, ...] = ("parabola", "circle", "cosine")

# Collocation at the centre of a strip sees half of the curvature that its mean sees, dx² f''/24.
_COLLOCATION = 1.0 / 48.0


def cosine_amplitude(tip_radius: float, period: float) -> float:
    """Amplitude h = λ²/(4π²R) of the cosine with curvature 1/R at its tips, thesis eq. (2.20)."""
    return period**2 / (4.0 * np.pi**2 * tip_radius)


def tip_height(profile: str, x: Floats, tip_radius: float, period: float) -> Floats:
    """Height (n,) [m] of a tip over its lowest point at ``x`` (n,) [m], |x| up to half a period.

    ``"parabola"`` is x²/(2R), ``"circle"`` is R − √(R² − x²) and infinite (no indenter) beyond R,
    ``"cosine"`` is h (1 − cos(2πx/λ)) with h = λ²/(4π²R).

    Raises
    ------
    InputError
        The name is unknown, or the radius is not positive.

    Examples
    --------
    >>> tip_height("parabola", np.array([0.0, 1e-3]), 2e-3, 8e-3)
    array([0.     , 0.00025])
    """
    if not (np.isfinite(tip_radius) and tip_radius > 0.0):
        raise InputError(f"the tip radius is {tip_radius} m, expected a positive length")
    if not isinstance(profile, str) or profile not in PROFILES:
        raise InputError(f'profile "{profile}" is unknown; use one of {", ".join(PROFILES)}')
    if profile == "parabola":
        return np.asarray(x**2 / (2.0 * tip_radius))
    if profile == "cosine":
        height = 2.0 * cosine_amplitude(tip_radius, period) * np.sin(np.pi * x / period) ** 2
        return np.asarray(height)
    inside = np.abs(x) < tip_radius
    root = np.sqrt(np.where(inside, tip_radius**2 - x**2, 0.0))
    return np.where(inside, x**2 / (tip_radius + root), np.inf)


def strip_heights(profile: str, tip_radius: float, period: float, elements: int) -> Floats:
    """Height (element,) [m] that collocation at the strips' centres should see; x = 0 at N/2.

    The curvature inside a strip is accounted for, see :mod:`labpipe.contact.springs._bed`.
    """
    spacing = period / elements
    x = spacing * np.arange(-(elements // 2), elements - elements // 2, dtype=float)
    height = tip_height(profile, x, tip_radius, period)
    if profile == "cosine":
        wave = 2.0 * np.pi / period
        return height + _COLLOCATION * spacing**2 * (cosine_amplitude(tip_radius, period) * wave**2 * np.cos(wave * x))
    if profile == "circle":
        root = np.sqrt(np.maximum(tip_radius**2 - x**2, (0.25 * tip_radius) ** 2))
        return height + _COLLOCATION * spacing**2 * tip_radius**2 / root**3
    return height + _COLLOCATION * spacing**2 / tip_radius
