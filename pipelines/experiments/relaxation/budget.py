"""Budgets of a relaxation: relaxed modulus, and peak of the force."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import replace

import xarray as xr

from labpipe.uncertainty import Input, excess_uncertainty
from pipelines.experiments.shared.budget_quantity import MEASURED, NOTHING_FALLS, TESTS, Quantity, model_quantity
from pipelines.experiments.shared.ramps_and_holds import relative_gain

_ON_MODULUS = (
    ("sampling", "plateau and first touch are fitted to many readings: included in their noise"),
    ("Poisson's ratio", "the reduced modulus includes it; for a bonded sheet it is taken as exact"),
    ("temperature", "the rubber was measured at its temperature; it affects the model"),
    ("repeatability", "one test per depth; the mean modulus compares the depths"),
)
_ON_PEAK = (
    ("zero of the depth, radius, Poisson's ratio, temperature", "a force was measured; they affect the model"),
    ("sampling", "the fitted force interpolates between the readings"),
    ("repeatability", "one test per depth"),
)


def quantities(loads: Sequence[xr.Dataset], curves: Sequence[xr.Dataset]) -> Iterator[Quantity]:
    """Yield relaxed reduced modulus and peak of the first tests; nothing that was not found."""
    for number, (load, curve) in enumerate(zip(loads[:TESTS], curves, strict=False), 1):
        if "reduced_modulus" in curve:
            family, rows = "relaxed reduced modulus", json.loads(curve.attrs["budgets"])[0]
            made = model_quantity(f"{family}, test {number}", float(curve["reduced_modulus"][0]), "Pa", rows, ())
            yield replace(made, inert=(*NOTHING_FALLS, *_ON_MODULUS), family=family)
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
                (*NOTHING_FALLS, *_ON_PEAK),
                "largest force before the filter",
            )
