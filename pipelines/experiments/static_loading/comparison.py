"""Comparison of a static loading with the model: contact radii over time and under each load."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.judging import Agreement, along_curve, stretch_means, stretches
from labpipe.signals import nrmse
from labpipe.variables import variable, with_u
from pipelines.experiments.shared.comparison_rows import Row, curve_row, curve_table, row, split, with_its_u
from pipelines.experiments.shared.model_inputs import inputs_of
from pipelines.experiments.static_loading.measured import spans, windows
from pipelines.experiments.static_loading.settings import StaticLoading

SCALE, MODULUS, LOADS = "scale of length (gain and inclination)", "modulus", "loads"
"""Inputs of the rows, relative: the laser's gain and inclination together, the material as a whole, all masses."""
TOUCH, DRIFT = "first touch", "drift of the zero"


def comparison(
    displacement: xr.Dataset, approach: xr.Dataset, steps: xr.Dataset, model: xr.Dataset, *, settings: StaticLoading
) -> xr.Dataset:
    """Compare the record with the viscoelastic model and with Hertz's steps."""
    time, ours, theirs = approach["time"].values, approach["contact_radius"].values, model["contact_radius"].values
    kept = approach["is_settled"].values.astype(bool)
    elastic = model["hertz_radius_relaxed"].values[_held(steps, time)]
    rms, of_hertz = (nrmse(ours[kept], curve[kept]) for curve in (theirs, elastic))
    curve = _along(displacement, approach, steps, model, settings), rms, float(np.mean((ours - theirs)[kept]))
    table = curve_table((), [curve], "m")
    for other, error in (("model", rms), ("hertz", of_hertz)):
        table[f"nrmse_contact_radius_{other}"] = variable((), error, "1", f"rms error over the range of {other}")

    first, last = zip(*(windows(time, span, settings) for span in spans(steps)), strict=True)
    curves = [theirs, model["u_contact_radius"].values, model["approach"].values, time]
    simulated, u_simulated, depth, at = stretch_means(curves, last)
    level, u = (approach[f"{part}level_contact_radius"].values for part in ("", "u_"))
    radius, slopes = settings.sphere.radius, _slopes(level, simulated, at / time[-1], settings)
    # the radius of the sphere counts in both: with its root in one, its third root in the other
    u_gap = np.sqrt(u**2 + u_simulated**2 - level * simulated / 3 * (radius.u / radius.value) ** 2)
    creep, hertz = depth - stretch_means(curves[2:3], first)[0], level - model["hertz_radius_relaxed"].values
    table["creep_model"] = variable("load", creep, "m", "growth of the approach under the load, model")
    table["hertz_difference"] = variable("load", hertz, "m", "contact radius, measured minus Hertz")
    text = "contact radius at the end of the load, model"
    table |= with_u("radius_model", "load", simulated, u_simulated, "m", text)
    text = "contact radius, measured minus model"
    table |= with_u("radius_difference", "load", level - simulated, u_gap, "m", text)
    of_solid = -simulated * np.reshape(stretch_means(model["slope"].values, last), (-1, simulated.size))
    names, values = [*slopes, *inputs_of(model)], np.array([*slopes.values(), *of_solid])
    table["slope"] = variable(("uncertain", "load"), values, "1", f"change with an input, SI: {text}")
    coordinates = {"time": approach["time"], "load": steps["load"], "uncertain": names}
    return xr.Dataset(table, coordinates, {"reference": model.attrs["reference"]})


def _held(steps: xr.Dataset, time: Floats) -> Any:
    """Return the index of the load that rests on the disc at each time."""
    return np.maximum(np.searchsorted(steps["begin"].values, time, side="right") - 1, 0)


def _slopes(measured: Floats, simulated: Floats, share: Floats, settings: StaticLoading) -> dict[str, Floats]:
    """Return changes of the contact radius, measured minus model, with the inputs at a share of the record."""
    radius = settings.sphere.radius.value
    steep = np.where(measured > 0.0, 0.5 * radius / np.where(measured > 0.0, measured, 1.0), 0.0)
    return {
        "radius": (measured / 2 - simulated / 3) / radius,
        SCALE: measured / 2,
        TOUCH: -steep,
        DRIFT: steep * share,
        MODULUS: simulated / 3,
        LOADS: -simulated / 3,
    }


def _along(
    displacement: xr.Dataset, approach: xr.Dataset, steps: xr.Dataset, model: xr.Dataset, settings: StaticLoading
) -> Agreement | None:
    """Compare the contact radius with the model in stretches of each load, with the uncertainties that they share."""
    time, ours, theirs = approach["time"].values, approach["contact_radius"].values, model["contact_radius"].values
    kept = approach["is_settled"].values.astype(bool) & (ours > 0.0)
    places = []
    for first, last in spans(steps):
        inside = np.flatnonzero(kept & (time > first) & (time < last))
        places += split(time, inside, float(time[inside[:1]].sum()), last, first)
    if not places:
        return None
    means, own = stretches(ours - theirs, places)
    measured, simulated, middle = stretch_means([ours, theirs, time], places)
    u_of = {
        "radius": settings.sphere.radius.u,
        SCALE: float(displacement.attrs["u_systematic_relative"]),
        TOUCH: float(steps["u_touch"]),
        DRIFT: settings.steps.drift.value,
        LOADS: (steps["u_force"].values / steps["force"].values)[_held(steps, middle)],
    }
    slopes = _slopes(measured, simulated, middle / time[-1], settings)
    of_solid = stretch_means(model["slope"].values * model["input_u"].values[:, None], places)
    effects = [*(slopes[name] * u for name, u in u_of.items()), *(simulated * each for each in of_solid)]
    return along_curve(means, own, np.array(effects))


def rows(comparison: xr.Dataset, approach: xr.Dataset, *, settings: StaticLoading) -> Iterator[Row]:
    """Yield the rows of ``compare``."""
    yield curve_row("contact radius", "m", int(comparison["time"].size), comparison)
    for i, load in enumerate(settings.loads):
        yield row(
            "contact radius",
            "m",
            1,
            condition=f"{load.mass.value:g} kg",
            slopes=dict(zip(comparison["uncertain"].values.tolist(), comparison["slope"].values[:, i], strict=True)),
            measured=with_its_u(approach, "level_contact_radius", i),
            model=with_its_u(comparison, "radius_model", i),
            u_difference=comparison["u_radius_difference"][i],
        )
