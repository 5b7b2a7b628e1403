"""Comparison of a static loading with the model: contact radii over time and under each load."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr

from labpipe.variables import variable
from pipelines.experiments.shared.comparison_rows import Row, row
from pipelines.experiments.static_loading.measured import spans, windows
from pipelines.experiments.static_loading.settings import StaticLoading


def comparison(approach: xr.Dataset, steps: xr.Dataset, model: xr.Dataset, *, settings: StaticLoading) -> xr.Dataset:
    """Compare the record with the viscoelastic model and with Hertz's steps."""
    time = approach["time"].values
    kept = approach["is_settled"].values.astype(bool)
    held = np.maximum(np.searchsorted(steps["begin"].values, time, side="right") - 1, 0)
    table: dict[str, Any] = {}
    for name in ("approach", "contact_radius"):
        ours = approach[name].values
        extent = float(np.ptp(ours[kept]))
        elastic = model[f"hertz_{'radius' if name == 'contact_radius' else name}_relaxed"].values
        for other, theirs in (("model", model[name].values), ("hertz", elastic[held])):
            gap = np.where(kept, ours - theirs, np.nan)
            rms = float(np.sqrt(np.nanmean(gap**2))) / extent
            words = f"{name.replace('_', ' ')}, measured minus {other}"
            table[f"nrmse_{name}_{other}"] = variable((), rms, "1", f"rms error over range: {words}")
            table[f"bias_{name}_{other}"] = variable((), float(np.nanmean(gap)), "m", f"mean of {words}")
            if other == "model":
                table[f"{name}_residual"] = variable("time", gap, "m", words)
    table |= _per_load(approach, steps, model, settings)
    return xr.Dataset(table, coords={"time": approach["time"], "load": steps["load"]})


def _per_load(approach: xr.Dataset, steps: xr.Dataset, model: xr.Dataset, settings: StaticLoading) -> dict[str, Any]:
    """Compare levels and creep under each load, and the radii that session.toml gives."""
    time = approach["time"].values
    rows = []
    for number, step in enumerate(spans(steps)):
        first, last = windows(time, step, settings)
        at = approach.isel(load=number)
        depth, a = model["approach"].values, model["contact_radius"].values
        u_a = float(model["u_contact_radius"].values[last].mean())
        given = settings.loads[number].radius
        level, u = float(at["level_contact_radius"]), float(at["u_level_contact_radius"])
        hertzian = float(model["hertz_radius_relaxed"][number])
        rows.append(
            {
                "creep_model": float(depth[last].mean() - depth[first].mean()),
                "radius_model": float(a[last].mean()),
                "radius_difference": level - float(a[last].mean()),
                "u_radius_difference": float(np.hypot(u, u_a)),
                "hertz_difference": level - hertzian,
                "given_radius": np.nan if given is None else given.value,
                "u_given_radius": np.nan if given is None else given.u,
                "given_difference": np.nan if given is None else level - given.value,
                "u_given_difference": np.nan if given is None else float(np.hypot(u, given.u)),
            }
        )
    texts = {
        "creep_model": "growth of the approach under the load, model",
        "radius_model": "contact radius at the end of the load, model",
        "radius_difference": "contact radius, measured minus model",
        "u_radius_difference": "standard uncertainty: radius difference",
        "hertz_difference": "contact radius, measured minus Hertz with the relaxed modulus",
        "given_radius": "contact radius that session.toml gives",
        "u_given_radius": "standard uncertainty: given contact radius",
        "given_difference": "contact radius, from the approach minus given",
        "u_given_difference": "standard uncertainty: given difference",
    }
    return {name: variable("load", np.array([r[name] for r in rows]), "m", text) for name, text in texts.items()}


def rows(comparison: xr.Dataset, *, settings: StaticLoading) -> Iterator[Row]:
    """Yield the rows of ``compare``."""
    yield row(
        "contact radius",
        "m",
        int(comparison["time"].size),
        nrmse=comparison["nrmse_contact_radius_model"],
        difference=comparison["bias_contact_radius_model"],
    )
    for i, load in enumerate(settings.loads):
        value, difference = comparison["radius_model"][i], comparison["radius_difference"][i]
        yield row(
            "contact radius",
            "m",
            1,
            condition=f"{load.mass.value:g} kg",
            measured=float(value) + float(difference),
            model=value,
            difference=difference,
            u_difference=comparison["u_radius_difference"][i],
        )
