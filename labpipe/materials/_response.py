r"""Stress of a solid under any history of strain, with the energies.

Boltzmann's superposition, thesis (1.4), for a generalised Maxwell solid: with :math:`e_j` the strain
of the spring of element j,

.. math::
    \sigma = E_\infty \varepsilon + \sum_j E_j e_j, \qquad
    \dot e_j = \dot\varepsilon - e_j / \rho_j,

which is solved exactly for a strain that is linear between the samples. The stored energy (1.25) is
:math:`\psi = \tfrac12 E_\infty \varepsilon^2 + \tfrac12 \sum_j E_j e_j^2` per volume (the double
integral with :math:`G(2t - \tau - \eta)`), the rate of dissipation (1.20), which is also (1.22),
:math:`\Lambda = \sum_j E_j e_j^2 / \rho_j`, not negative as no weight is.
"""

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from labpipe.errors import InputError
from labpipe.materials.prony import Prony
from labpipe.variables import variable


def respond(solid: Prony, time: ArrayLike, strain: ArrayLike) -> xr.Dataset:
    """Follow a uniaxial strain history, exactly between the samples.

    Parameters
    ----------
    solid : Prony
    time : array (time,) [s]
        Never falling; two samples at one time are a jump. Before the first sample there is no strain.
    strain : array (time,)
        Linear between the samples.

    Returns
    -------
    Dataset
        Over ``time``: ``strain``; ``stress`` [Pa], thesis (1.4); ``work`` done so far, ``stored_energy``
        (1.25) and ``dissipated_energy`` [J/m3], whose balance is (1.23); ``dissipation_rate`` [W/m3], (1.20).

    Raises
    ------
    InputError
        The histories do not fit, are not finite, or time falls; or the solid has a dashpot in parallel.

    Examples
    --------
    >>> solid = Prony(1.0, [1.0], [1.0])
    >>> made = respond(solid, [0.0, 0.0, 1.0], [0.0, 1.0, 1.0])
    >>> [round(float(s), 3) for s in made.stress]
    [0.0, 2.0, 1.368]
    """
    t, strains = np.asarray(time, dtype=float), np.asarray(strain, dtype=float)
    if t.ndim != 1 or t.shape != strains.shape or not t.size:
        raise InputError(f"time has shape {t.shape} and strain {strains.shape}: expected two lists of equal length")
    if not (np.isfinite(t).all() and np.isfinite(strains).all()):
        raise InputError("time and strain must be finite numbers")
    falling = np.flatnonzero(np.diff(t) < 0)
    if falling.size:
        n = int(falling[0])
        raise InputError(f"time[{n + 1}] = {t[n + 1]} s comes before time[{n}] = {t[n]} s; sort the history")
    if solid.viscosity > 0:
        message = "the solid has a dashpot in parallel: its stress follows the rate of strain; give a solid without one"
        raise InputError(message)
    springs, lost = np.zeros((t.size, solid.rho.size)), np.zeros(t.size)
    # Before the first sample there is no strain: a first one that is not zero is a jump.
    lengths, rises = np.diff(t, prepend=t[0]).tolist(), np.diff(strains, prepend=0.0).tolist()
    springs[0] = rises[0]
    for i in range(1, t.size):
        before, length, rise = springs[i - 1], lengths[i], rises[i]
        if length <= 0.0:
            springs[i] = before + rise
            continue
        gone, steady = -np.expm1(-length / solid.rho), solid.rho * (rise / length)
        swing = before - steady
        springs[i] = before - swing * gone
        # The integral of e^2 over the step, e = steady + swing exp(-t / rho).
        square = steady**2 * length + 2.0 * steady * swing * solid.rho * gone
        square += swing**2 * solid.rho * -0.5 * np.expm1(-2.0 * length / solid.rho)
        lost[i] = np.maximum(square, 0.0) @ (solid.E / solid.rho)
    stress = solid.E_relaxed * strains + springs @ solid.E
    stored = 0.5 * (solid.E_relaxed * strains**2 + springs**2 @ solid.E)
    dissipated = np.cumsum(lost)
    table = {
        "strain": variable("time", strains, "1", "strain"),
        "stress": variable("time", stress, "Pa", "stress"),
        "work": variable("time", stored + dissipated, "J/m3", "work done on the solid so far"),
        "stored_energy": variable("time", stored, "J/m3", "elastically stored energy"),
        "dissipated_energy": variable("time", dissipated, "J/m3", "dissipated energy so far"),
        "dissipation_rate": variable("time", springs**2 @ (solid.E / solid.rho), "W/m3", "rate of dissipation"),
    }
    return xr.Dataset(table, coords={"time": variable("time", t, "s", "time")})
