"""Budgets of a harmonic indentation: storage stiffness, and work per cycle."""

from collections.abc import Callable, Iterator
from math import cos, pi, sin

import numpy as np
import xarray as xr

from labpipe.uncertainty import Input, excess_uncertainty
from pipelines.experiments.shared import mach1_readings
from pipelines.experiments.shared.budget_quantity import TESTS, Factor, Quantity, product
from pipelines.experiments.shared.mach1_readings import relative_gain


def quantities(oscillations: xr.Dataset, loads: xr.Dataset) -> Iterator[Quantity]:
    """Yield storage stiffness and work per cycle at the first frequencies."""
    for i in range(min(TESTS, oscillations.sizes["oscillation"])):
        at = oscillations.isel(oscillation=i)
        where, stiffness = f"at {float(at['frequency']):.3g} Hz", float(at["storage_stiffness"])
        yield product(f"storage stiffness {where}", "N/m", stiffness, _factors(at, loads, cos, -1.0))
        work = pi * float(at["loss_stiffness"]) * float(at["amplitude"]) ** 2
        n = float(at["n_cycles"])
        scatter = {"repeatability": Input(0.0, float(at["work_sd"]) / np.sqrt(n), "J", max(n - 1.0, 1.0))}
        yield product(f"work per cycle {where}", "J", work, _factors(at, loads, sin, 1.0), scatter)


def _factors(at: xr.Dataset, loads: xr.Dataset, part: Callable[[float], float], power: float) -> dict[str, Factor]:
    """Return the inputs of a part of the force, cosine or sine of its phase, times a power of the amplitude."""
    amplitude, storage, loss = (float(at[name]) for name in ("amplitude", "storage_stiffness", "loss_stiffness"))
    force, phase = float(np.hypot(storage, loss)) * amplitude, float(np.arctan2(loss, storage))
    cell, lag = relative_gain(loads), mach1_readings.force_lag(loads, float(at["frequency"]))
    noise = excess_uncertainty(float(at["u_force_amplitude"]), cell * force, lag.u_gain / lag.gain * force)
    of_phase = excess_uncertainty(float(at["u_phase_lag"]), lag.u_phase)
    return {
        "force_amplitude": (Input(force, noise, "N"), 1.0),
        "amplitude": (Input(amplitude, float(at["u_amplitude"]), "m"), power),
        "phase": (Input(phase, of_phase, "rad"), lambda turned: part(turned) / part(phase)),
        "filter_lag": (Input(0.0, lag.u_phase, "rad"), lambda late: part(phase + late) / part(phase)),
        "filter_gain": (Input(1.0, lag.u_gain / lag.gain), -1.0),
        "gain": (Input(1.0, cell), 1.0),
    }
