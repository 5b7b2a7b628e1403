"""Budgets of a harmonic indentation: storage stiffness, and work per cycle."""

from collections.abc import Iterator
from math import cos, pi, sin

import numpy as np
import xarray as xr

from labpipe.uncertainty import Input, excess_uncertainty
from pipelines.experiments.shared import mach1_readings
from pipelines.experiments.shared.budget_quantity import TESTS, Quantity
from pipelines.experiments.shared.mach1_readings import relative_gain


def quantities(oscillations: xr.Dataset, loads: xr.Dataset) -> Iterator[Quantity]:
    """Yield storage stiffness and work per cycle at the first frequencies."""
    for i in range(min(TESTS, oscillations.sizes["oscillation"])):
        at = oscillations.isel(oscillation=i)
        frequency, amplitude, n = (float(at[name]) for name in ("frequency", "amplitude", "n_cycles"))
        storage, loss = float(at["storage_stiffness"]), float(at["loss_stiffness"])
        force, cell = float(np.hypot(storage, loss)) * amplitude, relative_gain(loads)
        lag = mach1_readings.force_lag(loads, frequency)
        u_gain = lag.u_gain / lag.gain
        noise = excess_uncertainty(float(at["u_force_amplitude"]), cell * force, u_gain * force)
        of_phase = excess_uncertainty(float(at["u_phase_lag"]), lag.u_phase)
        inputs = {
            "force_amplitude": Input(force, noise, "N"),
            "amplitude": Input(amplitude, float(at["u_amplitude"]), "m"),
            "phase": Input(float(np.arctan2(loss, storage)), of_phase, "rad"),
            "filter_lag": Input(0.0, lag.u_phase, "rad"),
            "filter_gain": Input(1.0, u_gain),
            "gain": Input(1.0, cell),
        }
        scatter = Input(0.0, float(at["work_sd"]) / np.sqrt(n), "J", degrees_of_freedom=max(n - 1.0, 1.0))
        where = f"at {frequency:.3g} Hz"
        yield Quantity(f"storage stiffness {where}", "N/m", _stiffness, inputs, "storage stiffness")
        inputs = {**inputs, "repeatability": scatter}
        yield Quantity(f"work per cycle {where}", "J", _work, inputs, "work per cycle")


def _stiffness(
    force_amplitude: float, amplitude: float, phase: float, filter_lag: float, filter_gain: float, gain: float
) -> float:
    return gain * force_amplitude / filter_gain / amplitude * cos(phase + filter_lag)


def _work(amplitude: float, phase: float, filter_lag: float, repeatability: float, **force: float) -> float:
    pushed = force["gain"] * force["force_amplitude"] / force["filter_gain"]
    return pi * pushed * amplitude * sin(phase + filter_lag) + repeatability
