"""Ball drop: from laser exports to bounces, the mean of the repeats, and the model beside it."""

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

import calibration
import instruments
from calibration import laser
from labpipe import signals
from labpipe.errors import InputError
from labpipe.units import Quantity
from pipelines.settings.ball_drop import BallDrop

Array = NDArray[np.float64]

_MODEL_STEP = 1e-4  # s, spacing of the model's curve between the contacts
_PERTURBATION = 0.01  # relative change by which the model's sensitivity is found


def readings(path: Path, *, settings: BallDrop) -> xr.Dataset:
    """Read one laser export; what it leaves unsaid comes from the settings."""
    given = settings.keyence
    options: dict[str, Any] = {
        "cycle": None if given.cycle is None else given.cycle.value,
        "units": given.units,
        "encoding": given.encoding,
        "decimal": given.decimal,
    }
    found = instruments.read(
        path, instrument="keyence", **{k: v for k, v in options.items() if v is not None}
    )
    if not isinstance(found, xr.Dataset):
        message = f"{path}: expected a table of readings, found a film"
        raise InputError(message)
    return found


def displacement(readings: xr.Dataset, record: Path, *, settings: BallDrop) -> xr.Dataset:
    """Correct the inclination: upward displacement of the holder, with uncertainty."""
    known = calibration.load_record(record)
    options: dict[str, Any] = {
        "output": settings.sensor.output,
        "direction": settings.sensor.direction,
        "measured": settings.measured_on,
    }
    moved = laser.displacement(readings, known, **options)
    if not settings.analysis.inclination_from_height:
        return moved
    found = _inclination(moved, settings.height)
    again = laser.displacement(readings, known, inclination=found, **options)
    again.attrs["inclination_of_record"] = float(moved["inclination"])
    again.attrs["u_inclination_of_record"] = float(moved["u_inclination"])
    return again


def _inclination(moved: xr.Dataset, height: Quantity) -> Quantity:
    """Fit the inclination from the fall of known height, along the line of sight."""
    along = moved["displacement_raw"] * float(moved["gain"])
    fall = signals.bounces(along.rename("displacement"))
    travel = Quantity(
        float(fall["release_level"] - fall["contact_level"]),
        float(np.hypot(fall["u_release_level"], fall["u_contact_level"])),
        "m",
    )
    return laser.inclination_from_drop(travel, height)
