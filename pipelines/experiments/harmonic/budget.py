"""Budgets of a harmonic indentation: storage stiffness, and work per cycle."""

from collections.abc import Iterator
from math import cos, pi, sin

import numpy as np
import xarray as xr

from labpipe.uncertainty import Input, excess_uncertainty
from pipelines.experiments.shared import mach1_readings
from pipelines.experiments.shared.budget_quantity import NOTHING_FALLS, TESTS, Quantity
from pipelines.experiments.shared.ramps_and_holds import relative_gain

_ON_CYCLES = (
    ("zero", "tare and position of first touch are constant"),
    ("sampling", "all readings of all cycles are fitted, and their rounding is included in the noise"),
    (
        "radius, Poisson's ratio, temperature",
        "the rubber was measured at its temperature; they affect model and theory",
    ),
)


def quantities(oscillations: xr.Dataset, loads: xr.Dataset) -> Iterator[Quantity]:
    """Yield storage stiffness and work per cycle at the first frequencies."""
    for i in range(min(TESTS, oscillations.sizes["oscillation"])):
        at = oscillations.isel(oscillation=i)
        where = f"at {float(at['frequency']):.3g} Hz"
        inputs, scatter = _of_cycle(at, loads, bool(oscillations.attrs["is_filter_corrected"]))
        once = (*NOTHING_FALLS, *_ON_CYCLES, ("repeatability", "all cycles are fitted together: included in the noise"))
        yield Quantity(f"storage stiffness {where}", "N/m", _stiffness, inputs, once, "storage stiffness")
        scattered, none = inputs | {"repeatability": scatter}, (*NOTHING_FALLS, *_ON_CYCLES)
        yield Quantity(f"work per cycle {where}", "J", _work, scattered, none, "work per cycle")


def _of_cycle(at: xr.Dataset, loads: xr.Dataset, is_corrected: bool) -> tuple[dict[str, Input], Input]:
    """Return what one oscillation hangs on, and the scatter of its loops."""
    storage, loss = float(at["storage_stiffness"]), float(at["loss_stiffness"])
    amplitude, n = float(at["amplitude"]), float(at["n_cycles"])
    force = float(np.hypot(storage, loss)) * amplitude
    lag = mach1_readings.force_lag(loads, float(at["frequency"])) if is_corrected else None
    of_filter = (0.0, 0.0) if lag is None else (lag.u_gain / lag.gain, lag.u_phase)
    cell = relative_gain(loads)
    noise = excess_uncertainty(float(at["u_force_amplitude"]), cell * force, of_filter[0] * force)
    return {
        "force_amplitude": Input(force, noise, "N"),
        "amplitude": Input(amplitude, float(at["u_amplitude"]), "m"),
        "phase": Input(
            float(np.arctan2(loss, storage)), excess_uncertainty(float(at["u_phase_lag"]), of_filter[1]), "rad"
        ),
        "filter_lag": Input(0.0, of_filter[1], "rad"),
        "filter_gain": Input(1.0, of_filter[0]),
        "gain": Input(1.0, cell),
    }, Input(0.0, float(at["work_sd"]) / np.sqrt(n), "J", degrees_of_freedom=max(n - 1.0, 1.0))


def _stiffness(
    force_amplitude: float, amplitude: float, phase: float, filter_lag: float, filter_gain: float, gain: float
) -> float:
    return gain * force_amplitude / filter_gain / amplitude * cos(phase + filter_lag)


def _work(
    force_amplitude: float,
    amplitude: float,
    phase: float,
    filter_lag: float,
    filter_gain: float,
    gain: float,
    repeatability: float,
) -> float:
    pushed = gain * force_amplitude / filter_gain
    return pi * pushed * amplitude * sin(phase + filter_lag) + repeatability
