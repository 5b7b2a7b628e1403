r"""Harmonic indentation of a material whose modulus depends on the amplitude of strain.

Equivalent linearisation: the punch oscillates by α about an equilibrium contact of half width a₀;
the material answers as a linear one whose complex modulus is that of one representative amplitude
of strain,

.. math::
    \varepsilon = \frac{\pi}{4 \ln(1/s_0)} \frac{\alpha}{a_0}, \qquad
    \gamma = (1 + \nu)\,\varepsilon, \qquad s_0 = \sin(\pi a_0/\lambda),

ε being the mean contact pressure of the oscillation over E*, and γ the shear strain of that
uniaxial state. For α → 0 it is :func:`labpipe.contact.dynamic_stiffness` to the last digit.

Validity: contact width kept (α well below the tapping amplitude), steady state; the first harmonic
only, no force at 3ω (Kraus's model has none); strain in reality varies over the contact, so that
the fall with amplitude is sharper here than it is, over about the same range of amplitudes.
"""

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from labpipe.contact.line import dynamic_stiffness, equilibrium, tapping_amplitude
from labpipe.errors import InputError
from labpipe.materials import Kraus, Prony
from labpipe.variables import variable


def amplitude_sweep(
    material: Prony,
    kraus: Kraus,
    frequency: float,
    amplitude: ArrayLike,
    mean_indentation: float,
    tip_radius: float,
    period: float,
    depth: float = 1.0,
) -> xr.Dataset:
    """Dynamic stiffness and loss of a harmonic indentation over its amplitude.

    Parameters
    ----------
    material : Prony
        At small strain.
    kraus : Kraus
        How it changes with the amplitude.
    frequency : float [Hz]
    amplitude : array (amplitude,) [m]
        Of the displacement, positive.
    mean_indentation, tip_radius, period, depth : float [m]
        As for :func:`labpipe.contact.dynamic_stiffness`.

    Returns
    -------
    Dataset
        Over ``amplitude`` [m]: ``strain`` (amplitude of the representative shear strain),
        ``storage_stiffness``, ``loss_stiffness`` [N/m], ``phase`` [rad], ``work_per_cycle`` [J],
        ``lifts_off`` (the amplitude is beyond the tapping amplitude: not valid).

    Raises
    ------
    InputError
        A value is out of range.

    Examples
    --------
    >>> rubber = Prony(7.6e6, [7.6e6], [0.1], nu=0.5)
    >>> soft = Kraus(0.01, storage_floor=0.4)
    >>> found = amplitude_sweep(rubber, soft, 1.0, [1e-9, 1e-4], 1e-4, 2e-3, 8e-3)
    >>> (found.storage_stiffness[1] / found.storage_stiffness[0]).item().__round__(3)
    0.421
    """
    swing = np.atleast_1d(np.asarray(amplitude, dtype=float))
    if not np.all((swing > 0.0) & np.isfinite(swing)):
        raise InputError(f"amplitude is {swing} m, expected positive numbers")
    state = equilibrium(material, tip_radius, period, mean_indentation)
    # 2 ln(1/s) = −ln(s²): mean pressure κα/(2a) of a stiffness κ = πE*/(2 ln(1/s)).
    strain = 0.5 * np.pi / -np.log(state.square) * swing / state.half_width
    shear = (1.0 + material.nu) * strain
    geometry = (mean_indentation, tip_radius, period)
    linear = complex(dynamic_stiffness(material, frequency, *geometry, depth))
    stiffness = kraus.modulus(linear, shear)
    limit = float(tapping_amplitude(material, frequency, *geometry))
    columns = {
        "strain": (shear, "1", "amplitude of the representative shear strain"),
        "storage_stiffness": (stiffness.real, "N/m", "storage stiffness"),
        "loss_stiffness": (stiffness.imag, "N/m", "loss stiffness"),
        "phase": (np.angle(stiffness), "rad", "phase lead of the force"),
        "work_per_cycle": (np.pi * stiffness.imag * swing**2, "J", "work dissipated in a cycle"),
        "lifts_off": (swing > limit, "1", "beyond the amplitude at which the punch lifts off"),
    }
    axis = variable("amplitude", swing, "m", "amplitude of the displacement")
    return xr.Dataset(
        {n: variable("amplitude", v, u, t) for n, (v, u, t) in columns.items()},
        {"amplitude": axis},
        {"tapping_amplitude": limit, "half_width": state.half_width},
    )
