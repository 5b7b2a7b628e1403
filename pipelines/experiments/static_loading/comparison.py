"""Comparison of a static loading with the model: contact radii over time and under each load."""

from collections.abc import Iterator

import numpy as np
import xarray as xr

from labpipe.judging import along_curve, stretch_means, stretches
from labpipe.signals import nrmse
from labpipe.units import Quantity
from labpipe.variables import variable, with_u
from pipelines.experiments.shared.comparison_rows import Row, curve_row, curve_table, row, split, with_its_u
from pipelines.experiments.shared.model_inputs import inputs_of, slopes_of, table_of
from pipelines.experiments.static_loading.measured import spans, windows
from pipelines.experiments.static_loading.settings import StaticLoading

SCALE, MODULUS, LOADS = "scale of length (gain and inclination)", "modulus", "loads"
"""Inputs of the rows, relative: the laser's gain and inclination together, the material as a whole, all masses."""
TOUCH, DRIFT = "first touch", "drift of the zero"


def comparison(
    displacement: xr.Dataset, steps: xr.Dataset, approach: xr.Dataset, model: xr.Dataset, *, settings: StaticLoading
) -> xr.Dataset:
    """Compare the record with the viscoelastic model and with Hertz's steps.

    Inputs are stored as by :func:`.table_of`; ``slope`` (uncertain, load) is the change with each of the contact radius
    at the end of a load, measured minus model.
    """
    time, ours, theirs = approach["time"].values, approach["contact_radius"].values, model["contact_radius"].values
    kept, radius = approach["is_settled"].values.astype(bool), settings.sphere.radius
    held = np.maximum(np.searchsorted(steps["begin"].values, time, side="right") - 1, 0)
    inputs = {
        "radius": radius,
        SCALE: Quantity(1.0, float(displacement.attrs["u_systematic_relative"]), "1"),
        TOUCH: Quantity(0.0, float(steps["u_touch"]), "m"),
        DRIFT: Quantity(0.0, settings.steps.drift.value, "m"),
        MODULUS: Quantity(1.0, 0.0, "1"),
        LOADS: Quantity(1.0, 0.0, "1"),
    } | inputs_of(model)
    steep = np.divide(radius.value, 2.0 * ours, out=np.zeros_like(ours), where=ours > 0.0)
    of_radius = (ours / 2 - theirs / 3) / radius.value
    own = [of_radius, ours / 2, -steep, steep * time / time[-1], theirs / 3, -theirs / 3]
    slopes = np.array([*own, *(-theirs * model["slope"].values)])
    u = np.array([given.u for given in inputs.values()])[:, None] * np.ones(time.size)
    u[list(inputs).index(LOADS)] = (steps["u_force"].values / steps["force"].values)[held]
    places = []
    for begin, end in spans(steps):
        inside = np.flatnonzero(kept & (ours > 0.0) & (time > begin) & (time < end))
        places += split(time, inside, float(time[inside[:1]].sum()), end, begin)
    along = along_curve(*stretches(ours - theirs, places), stretch_means(slopes * u, places)) if places else None
    elastic = model["hertz_radius_relaxed"].values[held]
    rms, of_hertz = (nrmse(ours[kept], curve[kept]) for curve in (theirs, elastic))
    table = curve_table((), [(along, rms, float(np.mean((ours - theirs)[kept])))], "m")
    for other, error in (("model", rms), ("hertz", of_hertz)):
        table[f"nrmse_contact_radius_{other}"] = variable((), error, "1", f"rms error over the range of {other}")

    first, last = zip(*(windows(time, span, settings) for span in spans(steps)), strict=True)
    simulated, u_simulated, depth = stretch_means(
        [theirs, model["u_contact_radius"].values, model["approach"].values], last
    )
    level, u_level = (approach[f"{part}level_contact_radius"].values for part in ("", "u_"))
    # the radius of the sphere counts in both: with its root in one, its third root in the other
    u_gap = np.sqrt(u_level**2 + u_simulated**2 - level * simulated / 3 * (radius.u / radius.value) ** 2)
    creep = depth - stretch_means([model["approach"].values], first)[0]
    table["creep_model"] = variable("load", creep, "m", "growth of the approach under the load, model")
    hertz = level - model["hertz_radius_relaxed"].values
    table["hertz_difference"] = variable("load", hertz, "m", "contact radius, measured minus Hertz")
    text = "contact radius at the end of the load, model"
    table |= with_u("radius_model", "load", simulated, u_simulated, "m", text)
    text = "contact radius, measured minus model"
    table |= with_u("radius_difference", "load", level - simulated, u_gap, "m", text)
    text = f"change with an input, SI: {text}"
    table["slope"] = variable(("uncertain", "load"), stretch_means(slopes, last), "1", text)
    made = xr.Dataset(table, {"time": approach["time"], "load": steps["load"]}, {"reference": model.attrs["reference"]})
    return made.merge(table_of(inputs))


def rows(comparison: xr.Dataset, approach: xr.Dataset, *, settings: StaticLoading) -> Iterator[Row]:
    """Yield the rows of ``compare``."""
    yield curve_row("contact radius", "m", int(comparison["time"].size), comparison)
    for i, load in enumerate(settings.loads):
        yield row(
            "contact radius",
            "m",
            1,
            condition=f"{load.mass.value:g} kg",
            slopes=slopes_of(comparison, "slope", i),
            measured=with_its_u(approach, "level_contact_radius", i),
            model=with_its_u(comparison, "radius_model", i),
            u_difference=comparison["u_radius_difference"][i],
        )
