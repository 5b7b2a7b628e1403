"""The material of an experiment: from the library, a file of the session, or a DMA experiment."""

import json
import warnings
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np
import xarray as xr

from labpipe import materials
from labpipe.errors import InputError
from labpipe.materials import Prony, ShiftLaw, shift_at
from labpipe.units import Quantity
from pipelines.experiments.shared.settings import MaterialChoice, Sphere

IMPACT_TIMES = 1e-4, 1e-2
"""s; an impact depends on how the solid relaxes from a tenth of it to ten times its duration."""

TEMPERATURE, POISSONS_RATIO, SPECIMEN = "temperature", "Poisson's ratio", "DMA, specimen"
"""Names of variations; all others are modes of the rheometer's spectrum."""

_OF_DMA = "DMA, "
OF_LIBRARY = "counter-body, "
"""Beginning of the name of a counter-body whose modulus is of the library."""


def resolve(choice: MaterialChoice, file: Path | None, fitted: xr.Dataset | None) -> Prony:
    """Return the material that the settings name, by the library, a file or the master curve of a DMA experiment.

    Raises
    ------
    InputError
        No material is named, or its shifts do not reach the temperature.

    Warns
    -----
    UserWarning
        The temperature lies outside the isotherms of the DMA experiment.
    """
    temperature = None if choice.temperature is None else choice.temperature.value
    if fitted is not None:
        return fitted_at(fitted, temperature)
    if (named := file or choice.material) is None:
        raise InputError("no material is named")
    return materials.load(named, temperature)


def is_unstated(name: str) -> bool:
    """Return whether an input is one that nobody states: a change of a spectrum, or a modulus of the library.

    Examples
    --------
    >>> [is_unstated(name) for name in ("DMA, mode 1", "DMA, specimen", "counter-body, sapphire", "temperature")]
    [True, False, True, False]
    """
    return name.startswith((_OF_DMA, OF_LIBRARY)) and not name.startswith(SPECIMEN)


class Variation(NamedTuple):
    """An uncertain input of a material, a change of it, and the solid that it makes."""

    given: Quantity
    change: float
    solid: Prony


def variations(
    choice: MaterialChoice,
    file: Path | None,
    fitted: xr.Dataset | None,
    times: tuple[float, float],
    *,
    warmer: float = 3.0,
    least: float = 0.03,
) -> dict[str, Variation]:
    """Return the uncertain inputs of the material, each with the solid of a changed one.

    The temperature shifts the material by its law; Poisson's ratio changes the modulus of a
    contact, E / (1 - nu^2), and nothing else. A rheometer's uncertainty comes as independent
    changes of the whole spectrum, of unit size. Changes exceed the error of a simulation: a temperature by ``warmer``
    [K] at least, Poisson's ratio and the scale of the modulus by ``least``. ``times`` are the shortest and longest [s]
    on which the experiment depends.
    """
    found: dict[str, Variation] = {}
    stated = choice.temperature if not isinstance(choice, Sphere) else choice.inside
    if stated is not None:  # one without an uncertainty may be stated wrongly as well
        step = max(stated.u, warmer)
        off = Quantity(stated.value + step, 0.0, stated.si)
        solid = resolve(msgspec.structs.replace(choice, temperature=off), file, fitted)
        found[TEMPERATURE] = Variation(stated, step, solid)
    if fitted is not None:  # what the rheometer leaves uncertain: modes of its spectrum, and the specimen's size
        best = fitted_at(fitted, None)
        where = float(fitted["T_ref"]) if stated is None else stated.value
        slower, stiffer = _shift(fitted, where)
        for name, solid in materials.uncertain_spectra(fitted, best, where, times, slower).items():
            found[name] = Variation(Quantity(0.0, 1.0, "1"), 1.0, solid.shifted(slower, stiffer))
        u_scale = float(fitted.attrs["u_scale"])
        if u_scale > 0.0:
            step = max(u_scale, least)
            solid = best.shifted(slower, stiffer).scaled(1.0 + step)
            found[SPECIMEN] = Variation(Quantity(1.0, u_scale, "1"), step, solid)
    nu = poissons_ratio(choice, file, fitted)
    if nu.u > 0.0:
        # of a modulus that was measured in shear, nu has made the one in tension before
        power = 1 if fitted is not None and float(fitted.attrs["modulus_factor"]) != 1.0 else 2
        step = max(nu.u, least)
        factor = (1.0 - nu.value**power) / (1.0 - (nu.value + step) ** power)
        found[POISSONS_RATIO] = Variation(nu, step, resolve(choice, file, fitted).scaled(factor))
    return found


def poissons_ratio(choice: MaterialChoice, file: Path | None, fitted: xr.Dataset | None) -> Quantity:
    """Return Poisson's ratio of the material that the settings name; arguments as for :func:`resolve`."""
    if fitted is not None:
        return Quantity(float(fitted["nu"]), float(fitted["u_nu"]), "1")
    known = materials.describe(choice.material or "" if file is None else file)
    return next(Quantity(e.value, e.u, "1") for e in known.entries if e.name == "poisson")


def fitted_at(fitted: xr.Dataset, temperature: float | None) -> Prony:
    """Return the material of a master curve, shifted from its reference temperature to another one [degC].

    Warns
    -----
    UserWarning
        The temperature lies outside the isotherms.
    """
    at_reference = Prony(float(fitted["E_relaxed"]), fitted["E"].values, fitted["rho"].values, nu=float(fitted["nu"]))
    if temperature is None or temperature == float(fitted["T_ref"]):
        return at_reference
    shift = _shift(fitted, temperature)
    measured = fitted["temperature"].values
    if not measured.min() <= temperature <= measured.max():
        warnings.warn(
            f"{temperature:g} °C lies outside the isotherms of the DMA experiment ({measured.min():g} to "
            f"{measured.max():g} °C); its {json.loads(fitted.attrs['law'])['name']} law is extrapolated",
            UserWarning,
            stacklevel=3,
        )
    return at_reference.shifted(*shift)


def _shift(fitted: xr.Dataset, temperature: float) -> tuple[float, float]:
    """Return a_T and b_T of a master curve at a temperature [degC]."""
    if temperature == float(fitted["T_ref"]):
        return 1.0, 1.0
    law = ShiftLaw.of(json.loads(fitted.attrs["law"]))
    log10_aT = shift_at(law, fitted["temperature"].values, fitted["log10_aT"].values, temperature)
    vertical = fitted["b_T"].dropna("temperature").sortby("temperature")
    b_T = float(np.interp(temperature, vertical["temperature"].values, vertical.values))
    return 10.0 ** float(log10_aT), b_T
