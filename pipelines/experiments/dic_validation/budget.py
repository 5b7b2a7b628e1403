"""Budgets of the holder's motion in a film, and of film against laser."""

import json
from collections.abc import Iterator
from math import isfinite

import numpy as np
import xarray as xr

from labpipe.uncertainty import Input, excess_uncertainty
from pipelines.experiments.dic_validation.comparison import RATIO
from pipelines.experiments.shared.budget_quantity import MEASURED, Quantity


def quantities(motion: xr.Dataset, comparison: xr.Dataset | None = None) -> Iterator[Quantity]:
    """Yield the largest displacement in the film, and film against laser where there was one."""
    size, moved = float(motion["pixel_size"]), motion["displacement"].values
    at = int(np.nanargmax(np.abs(moved)))
    noise = float(motion["u_displacement"][at]) / size  # that of the scale is not in it
    rows = {row["source"].replace(" ", "_"): row for row in json.loads(motion.attrs["budget"])}

    def along(measured: float, noise: float, **scale: float) -> float:
        changed = sum(row["sensitivity"] * (scale[n] - row["value"]) for n, row in rows.items())
        return (measured + noise) * (size + changed)

    inputs = {MEASURED: Input(float(moved[at]) / size, 0.0, "px"), "noise": Input(0.0, noise, "px")}
    inputs |= {n: Input(row["value"], row["u"], row["unit"]) for n, row in rows.items()}
    yield Quantity("largest displacement in the film", "m", along, inputs)
    if comparison is None or "bias" not in comparison or not isfinite(float(comparison["u_bias"])):
        return
    # both calibrations act on mean difference and ratio
    film = float(motion.attrs["u_systematic_relative"])
    laser = excess_uncertainty(float(comparison["scale_uncertainty"]), film)
    scales = {"pixel_size": Input(1.0, film), "inclination_and_gain": Input(1.0, laser)}
    of_film, of_laser = float(comparison["film"].mean()), float(comparison["laser"].mean())

    def mean(measured: float, noise: float, pixel_size: float, inclination_and_gain: float) -> float:
        return measured + noise + of_film * (pixel_size - 1.0) - of_laser * (inclination_and_gain - 1.0)

    def ratio(measured: float, noise: float, pixel_size: float, inclination_and_gain: float) -> float:
        return (measured + noise) * pixel_size / inclination_and_gain

    for name, title, unit, model in (
        ("bias", "mean of film minus laser", "m", mean),
        (RATIO, "ratio of displacements, film over laser", "1", ratio),
    ):
        value, u = float(comparison[name]), float(comparison[f"u_{name}"])
        if not isfinite(value):
            continue
        if name == "bias":
            u = excess_uncertainty(u, of_film * film, of_laser * laser)
        own = {MEASURED: Input(value, 0.0, unit), "noise": Input(0.0, u, unit)}
        yield Quantity(title, unit, model, own | scales)
