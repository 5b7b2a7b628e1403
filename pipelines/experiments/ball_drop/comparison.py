"""Comparison of a ball drop with the model: displacement and restitution."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr

from labpipe import signals
from pipelines.experiments.ball_drop.settings import BallDrop
from pipelines.experiments.shared.comparison_rows import IMPACTS, Row, row


def comparison(repeats: xr.Dataset, model: xr.Dataset, *, settings: BallDrop) -> xr.Dataset:
    """Lay the model over the mean of the repeats, both from first contact, and measure the gap."""
    del settings
    first = float(model["impact_time"][0])
    since = model["time"].values - first
    window = repeats["time"].where((repeats["time"] >= since[0]) & (repeats["time"] <= since[-1]))
    time = window.dropna("time").values
    measured = repeats["displacement_mean"].sel(time=time)
    simulated = np.interp(time, since, model["displacement"].values)
    curves = signals.compare(measured, measured.copy(data=simulated))
    return curves.merge(_bounces_compared(repeats, model, first))


def _bounces_compared(repeats: xr.Dataset, model: xr.Dataset, first: float) -> xr.Dataset:
    count = min(repeats.sizes["impact"], model.sizes["impact"])
    pairs = {
        "restitution": (repeats["restitution"], model["restitution"], model["u_restitution"], 0.0),
        "touch_time": (repeats["touch_time"], model["impact_time"], model["u_impact_time"], first),
    }
    table: dict[str, Any] = {}
    for name, (ours, theirs, u_theirs, shift) in pairs.items():
        units = ours.attrs["units"]
        a, b = ours.values[:count], theirs.values[:count] - shift
        u = np.hypot(repeats[f"u_{name}"].values[:count], u_theirs.values[:count])
        for key, values, text in (
            (f"{name}_measured", a, "measured"),
            (f"{name}_model", b, "model"),
            (f"{name}_difference", a - b, "measured minus model"),
        ):
            table[key] = ("impact", values, {"units": units, "long_name": f"{name}, {text}"})
        table[f"u_{name}_difference"] = (
            "impact", u, {"units": units, "long_name": f"standard uncertainty: {name} difference"},
        )  # fmt: skip
    return xr.Dataset(table, coords={"impact": np.arange(1, count + 1)})


def rows(
    comparison: xr.Dataset, repeats: xr.Dataset, model: xr.Dataset, *, settings: BallDrop
) -> Iterator[Row]:
    """Yield the rows of ``compare``."""
    del settings
    n = int(repeats.sizes["repeat"])
    relative = float(repeats.attrs["u_systematic_relative"])
    mean_size = float(np.abs(repeats["displacement_mean"]).mean())
    yield row("displacement", "m", n, nrmse=comparison["nrmse"], difference=comparison["bias"],
              u_difference=relative * mean_size)  # fmt: skip
    for i in range(min(IMPACTS, comparison.sizes["impact"])):
        yield row(
            f"restitution, impact {i + 1}", "1", int(repeats["n_repeats"][i]),
            measured=comparison["restitution_measured"][i], u_measured=repeats["u_restitution"][i],
            model=comparison["restitution_model"][i], u_model=model["u_restitution"][i],
            difference=comparison["restitution_difference"][i],
            u_difference=comparison["u_restitution_difference"][i],
        )  # fmt: skip
