"""Budgets of a relaxation: relaxed modulus, and peak of the force."""

import json
from collections.abc import Iterator, Sequence

import xarray as xr

from labpipe.uncertainty import Input, excess_uncertainty
from pipelines.experiments.shared.budget_quantity import MEASURED, TESTS, Quantity, model_quantity
from pipelines.experiments.shared.mach1_readings import relative_gain


def quantities(loads: Sequence[xr.Dataset], curves: Sequence[xr.Dataset]) -> Iterator[Quantity]:
    """Yield relaxed reduced modulus and peak of the first tests; nothing that was not found."""
    for number, (load, curve) in enumerate(zip(loads[:TESTS], curves, strict=False), 1):
        if "reduced_modulus" in curve:
            family, rows = "relaxed reduced modulus", json.loads(curve.attrs["budgets"])[0]
            modulus = float(curve["reduced_modulus"][0])
            yield model_quantity(f"{family}, test {number}", modulus, "Pa", rows, family)
        if "peak_filter_part" in curve:
            force, lag = float(curve["peak_force_unfiltered"][0]), float(curve["peak_filter_part"][0])
            gain, tare = relative_gain(load), float(load["u_tare"])
            noise = excess_uncertainty(float(curve["u_peak_force_unfiltered"][0]), tare, gain * force, lag)
            errors = {"noise": noise, "tare": tare, "filter_lag": lag}
            inputs = {MEASURED: Input(force, 0.0, "N"), "gain": Input(1.0, gain)}
            yield Quantity(
                f"largest force before the filter, test {number}",
                "N",
                lambda measured, noise, tare, gain, filter_lag: (measured + noise) * gain - tare - filter_lag,
                inputs | {name: Input(0.0, u, "N") for name, u in errors.items()},
                "largest force before the filter",
            )
