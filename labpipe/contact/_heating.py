r"""Self-heating of a sphere by the energy its impacts dissipate: bounds in closed form.

Dissipated energy Q is born where the strain is, in a region of about the contact's radius a [1]_:

- *bulk*, without conduction: Q in a half sphere of radius a, Q/(ρc (2/3)πa³), which under Hertz's pressure bounds the
  rise wherever loss follows strain energy, for a Poisson's ratio from 0.25 up.
- *train*: each half sphere cools by conduction, at its centre as erf(s) − (2s/√π) e^{−s²}, s = a/(2√(κt)), and the
  remains add up; without cooling they add up to the upper bound.

Validity: order of magnitude. Friction adds heat that is not in Q; air and the flat take some away.

References
----------
.. [1] H. S. Carslaw, J. C. Jaeger, Conduction of Heat in Solids, 2nd ed. (1959), section 2.2 (the
   sphere at a uniform temperature).
"""

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike
from scipy.special import erf

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.materials import Material, Thermal
from labpipe.variables import variable

NOTICEABLE = 0.01
"""Relative change of |E*| from which heating is said to matter: 0.4 % of an impact's force."""


def remaining_share(radius: ArrayLike, time: ArrayLike, thermal: Thermal) -> Floats:
    """Share of its rise that the centre of an evenly heated (half) sphere of a radius [m] keeps after a time [s]."""
    with np.errstate(divide="ignore"):
        s = np.asarray(radius) / (2.0 * np.sqrt(thermal.diffusivity * np.asarray(time, float)))
    bounded = np.minimum(s, 25.0)  # exp(−s²) is 0 from here on
    return np.asarray(erf(bounded) - 2.0 / np.sqrt(np.pi) * bounded * np.exp(-(bounded**2)))


def self_heating(
    drop: xr.Dataset, material: Material, thermal: Thermal, temperature: float | None = None
) -> xr.Dataset:
    """Estimate the self-heating of a simulated drop, and its effect on the modulus.

    Parameters
    ----------
    drop : Dataset
        Of :func:`labpipe.contact.drop`, at its own times (without ``times``).
    material : Material
        Its law of temperature turns a rise into a change of modulus.
    thermal : Thermal
    temperature : float [degC], optional
        Of the experiment; by default the material's reference.

    Returns
    -------
    Dataset
        Over ``impact``: ``bulk_rise`` [K] by the impact alone, ``train_rise`` [K] and, without conduction,
        ``train_rise_adiabatic`` [K] by all so far, ``modulus_change`` of ``|E*|`` at the contact's frequency.
        ``attrs["verdict"]``: "negligible" when the bound without conduction changes ``|E*|`` by less than a hundredth,
        "matters" when the estimate changes it by more, "may matter" between them.

    Raises
    ------
    InputError
        The drop has no impact, or no ledger (the thesis's scheme keeps none).

    Examples
    --------
    >>> from labpipe.contact import drop
    >>> from labpipe.materials import describe, thermal
    >>> acrylic = describe("acrylic")
    >>> one = drop(acrylic.prony, 9.525e-3, 0.505, 1.5e-3, 0.04)
    >>> found = self_heating(one, acrylic, thermal("acrylic"))
    >>> found.verdict, round(float(found.bulk_rise[0]), 1)
    ('negligible', 0.6)
    """
    if "dissipated_energy" not in drop or not drop.sizes["impact"]:
        raise InputError("self-heating needs a drop with at least one completed impact and its ledger")
    radius = drop["peak_contact_radius"].values
    contact = drop["contact_duration"].values
    # From touch to next touch: the energy that the dent still holds at lift-off becomes heat in flight.
    ends = np.append(drop["impact_time"].values[1:], drop["time"].values[-1])
    ledger = (drop["time"].values, drop["dissipated_energy"].values)
    heat = np.interp(ends, *ledger) - np.interp(drop["impact_time"].values, *ledger)
    bulk = heat / (thermal.density * thermal.heat_capacity * 2.0 / 3.0 * np.pi * radius**3)
    end = drop["lift_off_time"].values
    since = end[:, None] - end[None, :]
    remains = np.where(since >= 0.0, remaining_share(radius, np.maximum(since, 0.0), thermal), 0.0)
    train = remains @ bulk
    adiabatic = np.cumsum(bulk)
    omega, start = np.pi / contact[0], material.T_ref if temperature is None else temperature
    rises = [0.0, *train.tolist(), float(adiabatic[-1])]
    modulus = np.array([abs(complex(material.at(start + rise).complex_modulus(omega))) for rise in rises])
    *changes, bound = (modulus[1:] / modulus[0] - 1.0).tolist()
    matters = max(map(abs, changes)) >= NOTICEABLE
    verdict = "negligible" if abs(bound) < NOTICEABLE else "matters" if matters else "may matter"
    columns = {
        "bulk_rise": (bulk, "K", "temperature rise of the contact's hemisphere by one impact"),
        "train_rise": (train, "K", "temperature rise after all impacts so far, with conduction"),
        "train_rise_adiabatic": (adiabatic, "K", "the same, without conduction"),
        "modulus_change": (np.array(changes), "1", "relative change of |E*| by the rise after the impact"),
    }
    return xr.Dataset(
        {name: variable("impact", *column) for name, column in columns.items()}, attrs={"verdict": verdict}
    )
