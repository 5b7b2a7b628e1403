"""Budgets of the holder's motion in a film, and of film against laser."""

import json
from collections.abc import Iterator
from functools import partial
from math import inf, isfinite

import numpy as np
import xarray as xr

from labpipe.uncertainty import Input, excess_uncertainty
from pipelines.experiments.dic_validation.comparison import RATIO
from pipelines.experiments.shared.budget_quantity import Quantity, product


def quantities(motion: xr.Dataset, comparison: xr.Dataset | None = None) -> Iterator[Quantity]:
    """Yield the largest displacement in the film, and film against laser where there was one."""
    size, moved = float(motion["pixel_size"]), motion["displacement"].values
    at = int(np.nanargmax(np.abs(moved)))
    noise = float(motion["u_displacement"][at])  # that of the scale is not in it
    scale = {
        row["source"].replace(" ", "_"): (
            Input(row["value"], row["u"], row["unit"]),
            partial(lambda by, at, given: 1.0 + by * (given - at), row["sensitivity"] / size, row["value"]),
        )
        for row in json.loads(motion.attrs["budget"])
    }
    yield product("largest displacement in the film", "m", float(moved[at]), scale, {"noise": Input(0.0, noise)})
    if comparison is None or "bias" not in comparison or not isfinite(float(comparison["u_bias"])):
        return
    # both calibrations act on mean difference and ratio
    film = float(motion.attrs["u_systematic_relative"])
    laser = excess_uncertainty(float(comparison["scale_uncertainty"]), film)
    of_film, of_laser = (float(comparison[name].mean()) * u for name, u in (("film", film), ("laser", laser)))
    errors = {"pixel_size": Input(0.0, abs(of_film)), "inclination_and_gain": Input(0.0, abs(of_laser))}
    rest = ("noise", float(comparison["u_bias"]), inf)
    yield product("mean of film minus laser", "m", float(comparison["bias"]), errors=errors, rest=rest)
    if isfinite(value := float(comparison[RATIO])):
        scales = {"pixel_size": (Input(1.0, film), 1.0), "inclination_and_gain": (Input(1.0, laser), -1.0)}
        errors = {"noise": Input(0.0, float(comparison[f"u_{RATIO}"]))}
        yield product("ratio of displacements, film over laser", "1", value, scales, errors)
