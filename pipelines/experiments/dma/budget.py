"""Budgets of a dynamic mechanical analysis: a shift, and the modulus after an infinite time."""

import json
from collections.abc import Iterator
from math import sqrt

import numpy as np
import xarray as xr

from labpipe.report import quantity
from labpipe.uncertainty import Source
from pipelines.experiments.shared.budget_quantity import Quantity, model_quantity


def quantities(sweeps: xr.Dataset, master_curve: xr.Dataset) -> Iterator[Quantity]:
    """Yield the largest shift, and the relaxed modulus where the data determine it.

    The temperatures of the shifted sweep act by the slope of the shifts.
    """
    master = master_curve
    order = np.argsort(master["temperature"].values)
    T, shifts, u = (master[name].values[order] for name in ("temperature", "log10_aT", "u_log10_aT"))
    far = int(np.nanargmax(np.abs(shifts)))
    at = float(T[far])
    slope = float(np.gradient(shifts, T)[far]) if T.size > 1 else 0.0
    number = int(np.argmin(np.abs(sweeps["temperature"].values - at)))
    count = max(int(np.isfinite(sweeps["storage"].values[number]).sum()), 1)
    u_level = float(sweeps["temperature_spread"][number]) / sqrt(12.0 * count)
    rows = [
        Source("noise", 0.0, float(u[far]), "1", 1.0)._asdict(),
        Source("temperature", at, u_level, "degC", slope)._asdict(),
    ]
    name = f"log10 a_T at {quantity(at, 'degC', 3)}"
    yield model_quantity(name, float(shifts[far]), "1", rows)
    if "budget" in master.attrs:
        modulus, rows = float(master["relaxed_modulus"]), json.loads(master.attrs["budget"])
        yield model_quantity("modulus after an infinite time", modulus, "Pa", rows)
