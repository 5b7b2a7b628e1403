"""Comparison of a static loading with the model: contact radii over time and under each load."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.judging import Agreement, along_curve, stretch_means, stretches
from labpipe.variables import variable, with_u
from pipelines.experiments.shared.comparison_rows import Row, curve_table, of_curve, row, with_its_u
from pipelines.experiments.static_loading.measured import spans, windows
from pipelines.experiments.static_loading.model import of_material
from pipelines.experiments.static_loading.settings import StaticLoading

SCALE, MODULUS, LOADS = "scale of length (gain and inclination)", "modulus", "loads"
"""Inputs of the rows, relative: the laser's gain and inclination together, the material as a whole, all masses."""
TOUCH, DRIFT = "first touch", "drift of the zero"
_STRETCHES = 3  # of each load
_FEWEST = 10  # readings of a stretch


def comparison(
    displacement: xr.Dataset, approach: xr.Dataset, steps: xr.Dataset, model: xr.Dataset, *, settings: StaticLoading
) -> xr.Dataset:
    """Compare the record with the viscoelastic model and with Hertz's steps."""
    time, ours = approach["time"].values, approach["contact_radius"].values
    kept = approach["is_settled"].values.astype(bool)
    held = np.maximum(np.searchsorted(steps["begin"].values, time, side="right") - 1, 0)
    simulated, elastic = model["contact_radius"].values, model["hertz_radius_relaxed"].values[held]
    table: dict[str, Any] = {}
    for other, theirs in (("model", simulated), ("hertz", elastic)):
        # of the model: a measurement with a wrong scale must not hide in its own range
        rms = float(np.sqrt(np.mean((ours - theirs)[kept] ** 2)) / np.ptp(theirs[kept]))
        table[f"nrmse_contact_radius_{other}"] = variable((), rms, "1", f"rms error over the range of {other}")
    bias = float(np.mean((ours - simulated)[kept]))
    table["bias_contact_radius_model"] = variable((), bias, "m", "mean of contact radius, measured minus model")
    table |= _per_load(approach, steps, model, settings)
    table |= curve_table((), [_along(displacement, approach, steps, model, settings)])
    coordinates = {"time": approach["time"], "load": steps["load"]}
    return xr.Dataset(table, coordinates, {"reference": model.attrs["reference"]})


def _per_load(approach: xr.Dataset, steps: xr.Dataset, model: xr.Dataset, settings: StaticLoading) -> dict[str, Any]:
    """Compare levels and creep under each load."""
    time, radius = approach["time"].values, settings.sphere.radius
    ends = [windows(time, step, settings) for step in spans(steps)]

    def mean(values: Floats, at: int = 1) -> Floats:
        return np.array([values[both[at]].mean() for both in ends])

    level, u = (approach[f"{part}level_contact_radius"].values for part in ("", "u_"))
    theirs, u_theirs = (mean(model[f"{part}contact_radius"].values) for part in ("", "u_"))
    depth = model["approach"].values
    steep = np.where(level > 0.0, radius.value / (2 * np.where(level > 0.0, level, 1.0)), 0.0)
    # the radius of the sphere counts in both: with its root in one, its third root in the other
    twice = 2 * (0.5 * level) * (theirs / 3) * (radius.u / radius.value) ** 2
    u_gap = np.sqrt(u**2 + u_theirs**2 - twice)
    columns = {
        "creep_model": (mean(depth) - mean(depth, 0), "growth of the approach under the load, model"),
        "hertz_difference": (level - model["hertz_radius_relaxed"].values, "contact radius, measured minus Hertz"),
    }
    table = {name: variable("load", values, "m", text) for name, (values, text) in columns.items()}
    for name, slope in (("first touch", -steep), ("drift", steep * mean(time) / float(time[-1]))):
        text = f"change of the contact radius by {name}"
        table[f"radius_{name.rpartition(' ')[2]}"] = variable("load", slope, "1", text)
    table |= with_u("radius_model", "load", theirs, u_theirs, "m", "contact radius at the end of the load, model")
    return table | with_u(
        "radius_difference", "load", level - theirs, u_gap, "m", "contact radius, measured minus model"
    )


def _along(
    displacement: xr.Dataset, approach: xr.Dataset, steps: xr.Dataset, model: xr.Dataset, settings: StaticLoading
) -> Agreement | None:
    """Compare the contact radius with the model in stretches of each load, with the uncertainties that they share."""
    time, radius = approach["time"].values, settings.sphere.radius
    ours, theirs = approach["contact_radius"].values, model["contact_radius"].values
    kept = approach["is_settled"].values.astype(bool) & (ours > 0.0)
    begin, force, u_force = (steps[name].values for name in ("begin", "force", "u_force"))
    places = []
    for first, last in spans(steps):
        inside = np.flatnonzero(kept & (time > first) & (time < last))
        count = min(_STRETCHES, inside.size // _FEWEST)
        if count:
            at = first + np.geomspace(time[inside[0]] - first, last - first, count + 1)[1:-1]
            places += np.split(inside, np.searchsorted(time[inside], at))
    if not places:
        return None
    means, own = stretches(ours - theirs, places)
    a, expected = stretch_means([ours, theirs], places)
    steep = 0.5 * radius.value / a
    middle = stretch_means([time], places)[0]
    held = np.maximum(np.searchsorted(begin, middle, side="right") - 1, 0)
    effects = [
        0.5 * a * float(displacement.attrs["u_systematic_relative"]),
        steep * float(steps["u_touch"]),
        steep * settings.steps.drift.value * middle / time[-1],
        (0.5 * a - expected / 3.0) * radius.u / radius.value,
        expected / 3.0 * (u_force / force)[held],
        *(expected * np.interp(middle, model["node"].values, one) for one in model["effect"].values),
    ]
    return along_curve(means, own, np.array(effects))


def rows(comparison: xr.Dataset, approach: xr.Dataset, model: xr.Dataset, *, settings: StaticLoading) -> Iterator[Row]:
    """Yield the rows of ``compare``."""
    n, nrmse = int(comparison["time"].size), comparison["nrmse_contact_radius_model"]
    bias = comparison["bias_contact_radius_model"]
    yield row("contact radius", "m", n, nrmse=nrmse, difference=bias, **of_curve(comparison))
    radius = settings.sphere.radius.value
    for i, load in enumerate(settings.loads):
        value, level = float(comparison["radius_model"][i]), float(approach["level_contact_radius"][i])
        yield row(
            "contact radius",
            "m",
            1,
            condition=f"{load.mass.value:g} kg",
            slopes={
                "radius": level / (2 * radius) - value / (3 * radius),
                SCALE: level / 2,
                TOUCH: float(comparison["radius_touch"][i]),
                DRIFT: float(comparison["radius_drift"][i]),
                MODULUS: value / 3,
                LOADS: -value / 3,
            }
            | {name: -value * slope for name, (_, slope) in of_material(model).items()},
            measured=with_its_u(approach, "level_contact_radius", i),
            model=with_its_u(comparison, "radius_model", i),
            difference=with_its_u(comparison, "radius_difference", i),
        )
