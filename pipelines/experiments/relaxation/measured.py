"""Relaxation under a periodic punch: force, ramps and holds with their peaks and plateaus."""

import warnings
from pathlib import Path

import numpy as np
import xarray as xr

from labpipe.errors import InputError
from labpipe.variables import with_u
from pipelines.experiments.relaxation.settings import Relaxation
from pipelines.experiments.shared import mach1_readings, ramps_and_holds


def loads(readings: xr.Dataset, record: Path | None, *, settings: Relaxation) -> xr.Dataset:
    """Make force compression-positive, and tare it where the file begins in air."""
    return mach1_readings.force(
        readings, settings.load_cell.tare, record, untared="peak and plateau hold the cell's offset and a preload"
    )


def ramps(loads: xr.Dataset, *, settings: Relaxation) -> xr.Dataset:
    """Find every ramp and hold, first touch, and the peak and plateau of the force."""
    try:
        touch, how = mach1_readings.contact_position(loads, settings.contact)
    except InputError as error:
        # forces need no depth
        warnings.warn(f"no modulus and no model: {error}", stacklevel=2)
        touch, how = None, str(error)
    result = ramps_and_holds.measured(loads, touch, settings.hold.plateau.value)
    value, u = (np.nan, np.nan) if touch is None else (touch.value, touch.u)
    result = result.assign(with_u("contact_position", (), value, u, "m", "stage position of first touch"))
    return result.assign_attrs(contact=how)
