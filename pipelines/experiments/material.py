"""The material of an experiment: from the library, a file of the session, or a DMA experiment."""

from pathlib import Path

import xarray as xr

from labpipe import materials
from labpipe.errors import InputError
from labpipe.materials import Prony
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
        A temperature is given for a fitted material that has no shift law.
    """
    temperature = None if choice.temperature is None else choice.temperature.value
    if fitted is not None:
        if temperature is not None:
            message = (
                "a material from a DMA experiment is taken at its reference temperature; set "
                "T_ref there instead of temperature here"
            )
            raise InputError(message)
        return Prony(
            float(fitted["E_relaxed"]),
            fitted["E"].values,
            fitted["rho"].values,
            nu=float(fitted["nu"]),
        )
    if file is not None:
        return materials.load_file(file, temperature=temperature)
    if choice.material is None:
        message = "no material is named"
        raise InputError(message)
    return materials.load(choice.material, temperature=temperature)
