"""Melts of different molar mass: shifts by the distance to the glass transition.

Chain ends carry free volume, so that the glass transition of short chains is lower, by
T_g(M) = T_g(∞) − K/M. Melts of one polymer have the same friction at the same distance to it: their
WLF laws share one law, whose pole moves with the glass transition.

References
----------
Fox & Flory, J. Appl. Phys. 21 (1950) 581, doi:10.1063/1.1699711.
Ferry, Viscoelastic Properties of Polymers, 3rd ed., Wiley, 1980, ch. 11.
"""

import numpy as np

from labpipe.errors import InputError
from labpipe.materials._shift_law import ShiftLaw, wlf


def isofrictional_temperature(temperature: float, molar_mass: float, fox_flory: float) -> float:
    """Return where a melt has the friction that long chains have at a temperature [degC].

    Parameters
    ----------
    temperature : float [degC]
        Of the long chains.
    molar_mass : float [kg/mol]
    fox_flory : float [K kg/mol]
        K of T_g(M) = T_g(∞) − K/M.

    Raises
    ------
    InputError
        The molar mass is not positive or K is negative.

    Examples
    --------
    >>> isofrictional_temperature(25.0, 5.0, 14.65)
    22.07
    """
    if not (molar_mass > 0 and np.isfinite(fox_flory) and fox_flory >= 0):
        raise InputError(f"molar mass {molar_mass} kg/mol, K = {fox_flory} K kg/mol: expected positive numbers")
    return temperature - fox_flory / molar_mass


def wlf_of_melt(
    B1: float, B2: float, T_ref: float, *, molar_mass: float = float("inf"), fox_flory: float = 0.0
) -> ShiftLaw:
    """Return the WLF law of a melt from material constants that hold for every molar mass.

    log10 a_T = −B₁ (T − T_ref)/((B₂ + T_ref)(B₂ + T)), with the pole at −B₂ for long chains; for
    a finite molar mass B₂ is larger by K/M, as the glass transition is lower.

    Parameters
    ----------
    B1 : float [K]
    B2 : float [K]
        Temperatures in °C: the pole lies at −B₂ °C.
    T_ref : float [degC]
    molar_mass : float [kg/mol]
    fox_flory : float [K kg/mol]
        K of T_g(M) = T_g(∞) − K/M; 0 corrects nothing.

    Raises
    ------
    InputError
        T_ref lies at or below the pole.

    Examples
    --------
    >>> law = wlf_of_melt(850.0, 126.0, 25.0)
    >>> float(law.log10_aT(0.0).round(4))
    1.1169
    """
    pole = isofrictional_temperature(-B2, molar_mass, fox_flory)
    if T_ref <= pole:
        raise InputError(f"T_ref = {T_ref:g} °C lies at or below the pole of the law, {pole:.4g} °C")
    C2 = T_ref - pole
    return wlf(B1 / C2, C2, T_ref)
