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
