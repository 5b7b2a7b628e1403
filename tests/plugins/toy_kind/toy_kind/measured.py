"""Stages of a ringing bar: pure functions from files and Datasets to one Dataset."""

from pathlib import Path

import numpy as np
import xarray as xr

import instruments
from toy_kind.settings import RingingBar


def readings(path: Path, *, settings: RingingBar) -> xr.Dataset:
    """Read one recording."""
    del settings
    return instruments.read_table(path, "displacement", "toy_vibrometer")


def frequency(readings: xr.Dataset, *, settings: RingingBar) -> xr.Dataset:
    """Return the mean frequency, and its standard uncertainty by the scatter of the periods."""
    del settings
    time, moved = readings["time"].values, readings["out1"].values
    rising = np.flatnonzero((moved[:-1] < 0.0) & (moved[1:] >= 0.0))
    share = -moved[rising] / (moved[rising + 1] - moved[rising])
    periods = np.diff(time[rising] + share * (time[rising + 1] - time[rising]))
    mean, u = 1.0 / periods.mean(), periods.std(ddof=1) / np.sqrt(periods.size)
    return xr.Dataset(
        {
            "frequency": ((), mean, {"units": "Hz", "long_name": "frequency"}),
            "u_frequency": ((), u * mean**2, {"units": "Hz", "long_name": "of the frequency"}),
        }
    )


def comparison(frequency: list[xr.Dataset], *, settings: RingingBar) -> xr.Dataset:
    """Compare with sqrt(g / sag) / 2 pi, a mass on a spring that its weight presses down."""
    each = np.array([float(one["frequency"]) for one in frequency])
    own = np.array([float(one["u_frequency"]) for one in frequency])
    sag, gravity = settings.sag, settings.gravity
    model = float(np.sqrt(gravity.value / sag.value) / (2 * np.pi))
    u_model = 0.5 * model * float(np.hypot(sag.u / sag.value, gravity.u / gravity.value))
    u = float(np.sqrt(np.sum(own**2)) / own.size)
    values = {
        "measured": each.mean(),
        "u_measured": u,
        "model": model,
        "u_model": u_model,
        "difference": each.mean() - model,
        "u_difference": np.hypot(u, u_model),
    }
    return xr.Dataset(
        {
            name: ((), float(value), {"units": "Hz", "long_name": name.replace("_", " ")})
            for name, value in values.items()
        },
        attrs={"recordings": len(frequency)},
    )
