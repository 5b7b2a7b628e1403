"""The material of an experiment: from the library, a file of the session, or a DMA experiment."""

import json
import warnings
from pathlib import Path

import numpy as np
import xarray as xr

from labpipe import materials
from labpipe.errors import InputError
from labpipe.materials import Prony, ShiftLaw, shift_at
from pipelines.settings.common import MaterialChoice


def resolve(choice: MaterialChoice, file: Path | None, fitted: xr.Dataset | None) -> Prony:
    """Return the material that the settings name.

    Parameters
    ----------
    choice : MaterialChoice
        What session.toml says.
    file : Path, optional
        The material file, when the settings name one.
    fitted : Dataset, optional
        The master curve of the DMA experiment, when the settings name one.

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
        return _fitted(fitted, temperature)
    if file is not None:
        return materials.load_file(file, temperature=temperature)
    if choice.material is None:
        message = "no material is named"
        raise InputError(message)
    return materials.load(choice.material, temperature=temperature)


def _fitted(fitted: xr.Dataset, temperature: float | None) -> Prony:
    """Return the material of a master curve, shifted from its reference temperature."""
    at_reference = Prony(
        float(fitted["E_relaxed"]),
        fitted["E"].values,
        fitted["rho"].values,
        nu=float(fitted["nu"]),
    )
    if temperature is None or temperature == float(fitted["T_ref"]):
        return at_reference
    stored = json.loads(fitted.attrs["law"])
    size = len(stored["parameters"])
    law = ShiftLaw(
        stored["name"], stored["T_ref"], tuple(stored["parameters"]), np.zeros((size, size))
    )
    measured = fitted["temperature"].values
    log10_aT = shift_at(law, measured, fitted["log10_aT"].values, temperature)
    if not measured.min() <= temperature <= measured.max():
        warnings.warn(
            f"{temperature:g} °C lies outside the isotherms of the DMA experiment "
            f"({measured.min():g} to {measured.max():g} °C); its {law.name} law is extrapolated",
            UserWarning,
            stacklevel=3,
        )
    vertical = fitted["b_T"].dropna("temperature").sortby("temperature")
    b_T = float(np.interp(temperature, vertical["temperature"].values, vertical.values))
    return at_reference.shifted(10.0**log10_aT, b_T)
