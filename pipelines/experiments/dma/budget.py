"""Budgets of a dynamic mechanical analysis: a shift, and the slow end of the modulus."""

from collections.abc import Iterator
from math import prod, sqrt

import numpy as np
import xarray as xr

from labpipe.report import quantity
from labpipe.uncertainty import Input, Source
from pipelines.experiments.dma.model import still_falls
from pipelines.experiments.shared.budget_quantity import MEASURED, Quantity, model_quantity


def quantities(sweeps: xr.Dataset, master_curve: xr.Dataset) -> Iterator[Quantity]:
    """Yield a shift, and the modulus at the slow end and after an infinite time.

    The last modulus is left out where the data do not determine it: where the loss, going on as it
    does at the slow end, would take all of the storage modulus.
    """
    yield _shift(sweeps, master_curve)
    yield from _moduli(sweeps, master_curve)


def _shift(sweeps: xr.Dataset, master: xr.Dataset) -> Quantity:
    """Return the largest shift; the temperatures of its sweep act by the slope of the shifts."""
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
    return model_quantity(name, float(shifts[far]), "1", rows, "log10 a_T, the largest")


def _moduli(sweeps: xr.Dataset, master: xr.Dataset) -> Iterator[Quantity]:
    slow = int(np.argmin(master["reduced_frequency"].values))
    frequency, storage, u_storage = (
        float(master[name][slow]) for name in ("reduced_frequency", "master_storage", "u_master_storage")
    )
    factor = float(sweeps.attrs["u_modulus_factor"]) / float(sweeps.attrs["modulus_factor"])
    factors = {"noise": u_storage / storage, "scale": float(sweeps.attrs["u_scale"]), "Poisson's_ratio": factor}
    inputs = {name: Input(1.0, u) for name, u in factors.items() if u or name == "noise"}
    yield Quantity(
        f"storage modulus at {quantity(frequency, 'Hz', 2)}, the slow end",
        "Pa",
        lambda **factors: prod(factors.values()),
        {MEASURED: Input(storage, 0.0, "Pa"), **inputs},
        "storage modulus at the slow end",
    )
    left = still_falls(master["reduced_frequency"].values, master["master_loss"].values)
    if left < storage:
        yield Quantity(
            "modulus after an infinite time",
            "Pa",
            lambda extrapolation, **factors: prod(factors.values()) + extrapolation,
            {
                MEASURED: Input(float(master["E_relaxed"]), 0.0, "Pa"),
                **inputs,
                "extrapolation": Input(0.0, left / sqrt(3.0), "Pa"),
            },
        )
