"""The plate under a drop: from the settings, or from an experiment that measured it."""

import numpy as np
import xarray as xr

from labpipe import contact, signals
from labpipe.errors import InputError
from labpipe.units import Quantity
from pipelines.experiments.shared.settings import Plate

OF_PLATE = "plate "
"""Beginning of the names of the plate's inputs, next to those of the body."""


def resolve_plate(given: Plate | None, found: xr.Dataset | None) -> contact.Plate | None:
    """Return the plate of the model, that of session.toml or the result of a plate vibration; None is a rigid one.

    Raises
    ------
    InputError
        The plate vibration found no modal mass.
    """
    inputs = plate_inputs(given, found)
    return contact.Plate(**{name: each.value for name, each in inputs.items()}) if inputs else None


def plate_inputs(given: Plate | None, found: xr.Dataset | None) -> dict[str, Quantity]:
    """Return the uncertain numbers of the plate by their names in :class:`labpipe.contact.Plate`."""
    if found is not None:
        others = {"frequency": "Hz", "damping_ratio": "1"}
        return {"mass": modal_mass(found)} | {
            name: Quantity(float(found[name]), float(found[f"u_{name}"]), unit) for name, unit in others.items()
        }
    if given is None:
        return {}
    return {"mass": given.mass, "frequency": given.frequency, "damping_ratio": given.damping_ratio}


def floor_under(given: Plate | None, found: xr.Dataset | None, mass: Quantity) -> signals.Floor | None:
    """Return the plate as the analysis of impacts of a mass needs it, None where no plate is known."""
    if found is not None and not np.isfinite(float(found["mass"])):
        return None
    inputs = plate_inputs(given, found)
    if not inputs:
        return None
    plate, frequency = inputs["mass"], inputs["frequency"]
    share = mass.value / plate.value
    u_share = share * float(np.hypot(plate.u / plate.value, mass.u / mass.value))
    return signals.Floor(share, frequency.value, inputs["damping_ratio"].value, u_share, frequency.u)


def modal_mass(found: xr.Dataset) -> Quantity:
    """Return the plate's modal mass with its uncertainty.

    Raises
    ------
    InputError
        The plate vibration found none.
    """
    mass = float(found["mass"])
    if not np.isfinite(mass):
        raise InputError(
            "the plate vibration found no modal mass; name its sphere (radius and mass) and drops of a "
            "material of a DMA experiment or of the library, or give plate = {mass, frequency, damping_ratio} here"
        )
    return Quantity(mass, float(found["u_mass"]), "kg")
